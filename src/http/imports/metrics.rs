//! `GET /api/v1/imports/{id}/metrics`.

use axum::Json;

use super::super::episodes::metrics::{MetricsParams, definition};
use super::super::prelude::*;
use super::unreadable;
use crate::dataset::measure::ImportMeter;
use crate::measure::{self, SERIES_BYTES_OF_A_ROUND, method};
use crate::store::metrics::Measured;
use swarmbench_protocol::metrics::GameMetrics;

/// Rounds that are read and measured at once.
const CHUNK: u32 = 64;

/// Show the metrics of an imported game.
///
/// The metrics are those of an episode; values that the files of a game lack (who heard a message, what was remembered) are
/// null.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}/metrics",
    operation_id = "show_import_metrics",
    tag = "data",
    params(MetricsParams),
    responses(
        (status = 200, description = "The metrics", body = GameMetrics),
        (status = 404, description = "`not_found`: no such game, or no such state"),
        (status = 422, description = "`invalid`: an earlier version stored more than the limit `import_state_bytes_max`"),
        (status = 503, description = "`overloaded`: too many games are being measured"),
    )
)]
pub(in super::super) async fn show_import_metrics(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<MetricsParams>,
) -> Result<Json<GameMetrics>, ApiError> {
    let definition = definition(params.definition.as_deref())?;
    let wanted = params.series()?;
    let stored = app.import(&caller, &id).await?;
    let states = wanted.map(|wanted| wanted.of(stored.rounds)).transpose()?;
    let kept = if states.is_some() { stored.rounds as usize + 1 } else { 1 };
    let _memory = app.registry.room(kept * SERIES_BYTES_OF_A_ROUND)?;
    let _permit = app.heavy.replay().await?;
    let mut meter = ImportMeter::new(&stored, states.is_some()).map_err(unreadable)?;
    let mut from = 0;
    while from <= stored.rounds {
        let to = (stored.rounds + 1).min(from + CHUNK);
        let (rounds, memory) = app.imported_rounds(&stored, from, to).await?;
        from += u32::try_from(rounds.len()).expect("a part");
        let added = app.heavy.render(move || {
            let _memory = memory;
            rounds.iter().try_for_each(|round| meter.add(round)).map(|()| meter)
        });
        meter = added.await?.map_err(unreadable)?;
    }
    let metrics = meter.finish().map_err(unreadable)?;
    let measured = Measured::of(&metrics);
    Ok(Json(GameMetrics {
        episode: stored.id.clone(),
        task: stored.task.clone(),
        status: "imported".to_owned(),
        rounds: stored.rounds,
        score: stored.score,
        method: method(definition),
        sampled: measured.sampled(),
        values: measure::values(&measured, definition),
        series: states.map(|states| measure::series(&metrics, definition, states, stored.rounds)),
    }))
}
