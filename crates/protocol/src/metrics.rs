//! Metrics of games (`docs/evaluate/metrics.md`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Value of a metric for a whole game.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricValue {
    /// Mean over the rounds in which the metric is defined, unless the metric says otherwise; null if it is undefined.
    pub value: Option<f64>,
    /// Number of rounds from which the value was computed.
    pub rounds: u32,
}

/// Values of metrics by their names.
pub type MetricValues = BTreeMap<String, MetricValue>;

/// Method by which metrics were computed. Values of different methods cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricsMethod {
    /// Definition: `paper` or `toolkit`.
    pub definition: String,
    /// Revision of all definitions.
    pub metrics_revision: u32,
    /// Embedder that turned texts into vectors, for the metrics that compare vectors.
    pub embedder: String,
}

/// Metrics of an episode or of an imported game.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GameMetrics {
    /// Id of the game.
    pub episode: String,
    /// Name of the task.
    pub task: String,
    /// Status of the game; `imported` for an imported game.
    pub status: String,
    /// Number of resolved rounds.
    pub rounds: u32,
    /// Score after these rounds.
    pub score: f64,
    /// Method by which the metrics were computed.
    #[serde(flatten)]
    pub method: MetricsMethod,
    /// Whether texts were left out of a comparison because a round had too many.
    pub sampled: bool,
    /// Values of the game.
    pub values: BTreeMap<String, MetricValue>,
    /// Values of states, if requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<MetricSeries>,
}

/// Values of some states, in order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricSeries {
    /// First state: 0 is the layout, `n` the state after `n` rounds.
    pub from: u32,
    /// Number of states in each list.
    pub length: u32,
    /// First state after the lists; null if they reach the newest state.
    pub next: Option<u32>,
    /// Whole numbers of each state; null where undefined.
    pub counts: BTreeMap<String, Vec<Option<u64>>>,
    /// Metrics of each state; null where undefined.
    pub values: BTreeMap<String, Vec<Option<f64>>>,
}

/// Metrics of the games of a run, or a page of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunMetrics {
    /// Id of the run.
    pub run: String,
    /// Method by which the metrics were computed.
    #[serde(flatten)]
    pub method: MetricsMethod,
    /// Means over the games of this page, by task and metric.
    pub tasks: BTreeMap<String, BTreeMap<String, MetricMean>>,
    /// Games that have ended and were not voided, in the order of the plan.
    pub items: Vec<GameMetrics>,
    /// Cursor of the next page; null on the last page.
    pub next_cursor: Option<String>,
}

/// Mean over games.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricMean {
    /// Mean over the games in which the metric is defined.
    pub mean: f64,
    /// Population standard deviation.
    pub deviation: f64,
    /// Number of games with a value.
    pub games: u32,
}
