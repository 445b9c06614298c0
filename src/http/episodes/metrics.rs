//! `GET /api/v1/episodes/{id}/metrics`.

use std::ops::Range;

use axum::Json;
use serde::Deserialize;
use swarmbench_analysis::Definition;
use utoipa::IntoParams;

use super::super::extract::{one_of, optional_flag};
use super::super::prelude::*;
use crate::fair::Party;
use crate::measure::{self, SERIES_BYTES_OF_A_ROUND, measure, method};
use crate::store::entries::Entry;
use crate::store::metrics::{Measured, MetricsRow, stored_method};
use crate::store::port::StoredEpisode;
use swarmbench_protocol::metrics::GameMetrics;

/// States whose values one answer has at most.
pub(in super::super) const SERIES_STATES_MAX: u32 = 1000;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct MetricsParams {
    /// Definition: `paper` (the default) or `toolkit`.
    pub(in super::super) definition: Option<String>,
    /// Whether to add the values of states to those of the game.
    #[serde(default, deserialize_with = "optional_flag")]
    series: Option<bool>,
    /// First state of the series; by default 0, the layout.
    from: Option<u32>,
    /// Number of states of the series, up to 1,000, which is also the default.
    #[param(minimum = 1, maximum = 1000)]
    states: Option<u32>,
}

/// The definition with this name.
pub(in super::super) fn definition(name: Option<&str>) -> Result<Definition, ApiError> {
    one_of("definition", name, &Definition::ALL.map(Definition::name))?;
    Ok(name.and_then(Definition::parse).unwrap_or_default())
}

/// Range of a series.
#[derive(Clone, Copy)]
pub(in super::super) struct Wanted {
    from: u32,
    states: u32,
}

impl MetricsParams {
    /// Range of states, if a series is requested.
    pub(in super::super) fn series(&self) -> Result<Option<Wanted>, ApiError> {
        if self.series != Some(true) {
            return match (self.from, self.states) {
                (None, None) => Ok(None),
                _ => Err(ApiError::new(Code::Malformed, "from and states need series=true")),
            };
        }
        let states = self.states.unwrap_or(SERIES_STATES_MAX);
        if !(1..=SERIES_STATES_MAX).contains(&states) {
            let detail = format!("states must be from 1 to {SERIES_STATES_MAX}, is {states}");
            return Err(ApiError::new(Code::Malformed, detail));
        }
        Ok(Some(Wanted { from: self.from.unwrap_or(0), states }))
    }
}

impl Wanted {
    /// The wanted ones of the states of a game with this many rounds.
    pub(in super::super) fn of(self, rounds: u32) -> Result<Range<u32>, ApiError> {
        if self.from > rounds {
            let detail = format!("the game has {rounds} rounds, and no state {}", self.from);
            return Err(ApiError::new(Code::NotFound, detail).at_round(rounds));
        }
        Ok(self.from..(rounds + 1).min(self.from.saturating_add(self.states)))
    }
}

/// Show the metrics of an episode.
///
/// Metrics are whole numbers and means that describe how the swarm spoke, chose and moved (`docs/evaluate/metrics.md`). A
/// running episode has those of its rounds so far.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/metrics",
    operation_id = "show_episode_metrics",
    tag = "episodes",
    params(MetricsParams),
    responses(
        (status = 200, description = "The metrics", body = GameMetrics),
        (status = 403, description = "`forbidden`: only the creator may read them before the end"),
        (status = 404, description = "`not_found`: no such episode, or no such state"),
        (status = 503, description = "`overloaded`: too many episodes are being replayed"),
    )
)]
pub(in super::super) async fn show_episode_metrics(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<MetricsParams>,
) -> Result<Json<GameMetrics>, ApiError> {
    let definition = definition(params.definition.as_deref())?;
    let wanted = params.series()?;
    let stored = app.readable_episode(&caller, id).await?;
    let states = wanted.map(|wanted| wanted.of(stored.rounds)).transpose()?;
    let measured = app.measured(&stored).await?;
    let series = match states {
        None => None,
        Some(states) => {
            // A frame of the toolkit has what was decided in its state.
            let to = stored.rounds.min(states.end);
            let _memory = app.registry.room((to as usize + 1) * SERIES_BYTES_OF_A_ROUND)?;
            let _permit = app.heavy.replay().await?;
            let metrics = measure(app.registry.host(), &stored, to, true, Party::current()).await?;
            Some(measure::series(&metrics, definition, states, stored.rounds))
        }
    };
    let mut shown = game_metrics(&stored, &measured, definition)?;
    shown.series = series;
    Ok(Json(shown))
}

/// The metrics of an episode in the shape of the wire.
pub(in super::super) fn game_metrics(
    stored: &StoredEpisode,
    measured: &Measured,
    definition: Definition,
) -> Result<GameMetrics, ApiError> {
    let spec = super::spec(stored)?;
    Ok(GameMetrics {
        episode: stored.id.to_string(),
        task: spec.config.task().name().to_owned(),
        status: stored.status.clone(),
        rounds: stored.rounds,
        score: stored.score,
        method: method(definition),
        sampled: measured.sampled(),
        values: measure::values(measured, definition),
        series: None,
    })
}

impl App {
    /// Stored metrics of an episode. Without any, it is measured, and the values of an ended one are stored.
    pub(in super::super) async fn measured(
        &self,
        stored: &StoredEpisode,
    ) -> Result<Measured, ApiError> {
        if let Some(found) = self.store.metrics_of(stored.episode, stored_method()).await? {
            return Ok(Measured::read(&found)?);
        }
        let _permit = self.heavy.replay().await?;
        let metrics =
            measure(self.registry.host(), stored, stored.rounds, false, Party::current()).await?;
        let measured = Measured::of(&metrics);
        if stored.ended_at.is_some() {
            let metrics = Some(Box::new(MetricsRow::new(stored.episode, &measured)));
            self.store.keep(vec![Entry::Measured { number: None, metrics }]).await?;
        }
        Ok(measured)
    }
}
