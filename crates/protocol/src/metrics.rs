//! Metrics of games (`docs/evaluate/metrics.md`).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// The value of a metric for a whole game.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricValue {
    /// The mean over the rounds in which it is defined, unless the metric says otherwise; null where it is undefined.
    pub value: Option<f64>,
    /// From how many rounds it was computed.
    pub rounds: u32,
}

/// Values of metrics by their names.
pub type MetricValues = BTreeMap<String, MetricValue>;

/// How values of metrics were computed. Values of different methods cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricsMethod {
    /// `paper` or `toolkit`.
    pub definition: String,
    /// The revision of all definitions.
    pub metrics_revision: u32,
    /// What turned texts into vectors, for the metrics that compare vectors.
    pub embedder: String,
}

/// The metrics of an episode or of an imported game.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct GameMetrics {
    /// The id of the game.
    pub episode: String,
    /// The task.
    pub task: String,
    /// Its status; `imported` for an imported game.
    pub status: String,
    /// Resolved rounds.
    pub rounds: u32,
    /// The score after them.
    pub score: f64,
    /// How the values were computed.
    #[serde(flatten)]
    pub method: MetricsMethod,
    /// Whether texts were left out of a comparison because a round had too many.
    pub sampled: bool,
    /// The values of the game.
    pub values: BTreeMap<String, MetricValue>,
    /// Values of states, where they were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub series: Option<MetricSeries>,
}

/// Values of some states, in order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricSeries {
    /// The first state: 0 is the layout, `n` the state after `n` rounds.
    pub from: u32,
    /// How many states there are in each list.
    pub length: u32,
    /// The first state that is not in the lists; null where they reach the newest.
    pub next: Option<u32>,
    /// Whole numbers of each state; null where undefined.
    pub counts: BTreeMap<String, Vec<Option<u64>>>,
    /// Metrics of each state; null where undefined.
    pub values: BTreeMap<String, Vec<Option<f64>>>,
}

/// The metrics of the games of a run, or a page of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct RunMetrics {
    /// The run.
    pub run: String,
    /// How the values were computed.
    #[serde(flatten)]
    pub method: MetricsMethod,
    /// Of each task the means over its games on this page, by metric.
    pub tasks: BTreeMap<String, BTreeMap<String, MetricMean>>,
    /// Games that have ended and were not voided, in the order of the plan.
    pub items: Vec<GameMetrics>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// A mean over games.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MetricMean {
    /// The mean over the games in which the metric is defined.
    pub mean: f64,
    /// The population standard deviation.
    pub deviation: f64,
    /// How many games have a value.
    pub games: u32,
}
