//! `GET /api/v1/episodes/{id}/worth` and `GET /api/v1/episodes/{id}/line`.

use axum::Json;
use serde::Deserialize;
use swarmbench_engine::Config;
use swarmbench_worth::{Appraiser, Liner, sent, without};
use utoipa::IntoParams;

use super::super::extract::optional_flag;
use super::super::prelude::*;
use crate::appraisal::{game, in_pieces, too_much};
use crate::episode::memory::of_worth;
use crate::fair::{Party, Rank};
use crate::store::entries::Entry;
use crate::store::metrics::MetricsRow;
use crate::store::port::StoredEpisode;
use swarmbench_protocol::worth::{GameWorth, MissingPart, ReferenceLine};

/// Rounds of the reference's line in one answer at most.
const LINE_ROUNDS_MAX: u32 = 100;

/// Rounds of the reference's line in an answer, if none are asked for.
const LINE_ROUNDS: u32 = 10;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct WorthParams {
    /// Whether to add the losses of seats, the default. Without them the answer is there about as many times sooner as there are
    /// seats.
    #[serde(default, deserialize_with = "optional_flag")]
    seats: Option<bool>,
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct LineParams {
    /// Round from whose state the reference plays on; by default that of the newest state.
    round: Option<u32>,
    /// Number of rounds, up to 100; by default 10.
    #[param(minimum = 1, maximum = 100)]
    rounds: Option<u32>,
}

/// Show what could still be scored in an episode.
///
/// The worth of a state is the score that the reference swarm, the task's default built-in player, reaches from there: that of a
/// fork with `"player": "default"` (`docs/evaluate/worth.md`). The answer has the worth of each state, what each round and
/// each seat lost, and the ten decisions that lost most. A worth of a game that has ended is stored.
///
/// Callers who may fork the episode may read it: it is computed from random draws that are still to come.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/worth",
    operation_id = "show_episode_worth",
    tag = "episodes",
    params(WorthParams),
    responses(
        (status = 200, description = "The worth; `missing` says what the server does not compute", body = GameWorth),
        (status = 403, description = "`forbidden`: the caller may not read the seed now; the game is sealed, or has several holders and has not ended"),
        (status = 404, description = "`not_found`: no such episode"),
        (status = 503, description = "`overloaded`: too many worths are being computed"),
    )
)]
pub(in super::super) async fn show_episode_worth(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<WorthParams>,
) -> Result<Json<GameWorth>, ApiError> {
    let (stored, spec, _) = app.forkable(&caller, id, "its worth can be read").await?;
    let asks_seats = params.seats.unwrap_or(true);
    let (config, rounds) = (&*spec.config, stored.rounds);
    let no_seats = too_much(config, rounds, true);
    let with_seats = asks_seats && no_seats.is_none();
    let mut worth = match too_much(config, rounds, false) {
        Some(detail) => without(config.task(), rounds, stored.score, detail),
        None => app.worth(&stored, config, with_seats).await?,
    };
    if !asks_seats {
        (worth.seats, worth.kinds, worth.dearest) = (None, None, None);
        worth.losses.iter_mut().flatten().for_each(|loss| loss.seats = None);
    } else if let Some(detail) = no_seats {
        worth.missing.push(MissingPart { part: "seats".to_owned(), detail });
    }
    worth.episode = Some(stored.id.to_string());
    Ok(Json(worth))
}

/// Show how the reference would play on.
///
/// The rounds that a fork with `"player": "default"` would begin with, without making one. Callers who may fork the episode may
/// read them.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/line",
    operation_id = "show_reference_line",
    tag = "episodes",
    params(LineParams),
    responses(
        (status = 200, description = "The line", body = ReferenceLine),
        (status = 403, description = "`forbidden`: the caller may not read the seed now; the game is sealed, or has several holders and has not ended"),
        (status = 404, description = "`not_found`: no such episode, or no such state"),
        (status = 422, description = "`invalid`: the game is too large"),
        (status = 503, description = "`overloaded`: too many worths are being computed"),
    )
)]
pub(in super::super) async fn show_reference_line(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(LineParams { round, rounds }): Params<LineParams>,
) -> Result<Json<ReferenceLine>, ApiError> {
    let rounds = rounds.unwrap_or(LINE_ROUNDS);
    if !(1..=LINE_ROUNDS_MAX).contains(&rounds) {
        let detail = format!("rounds must be from 1 to {LINE_ROUNDS_MAX}, is {rounds}");
        return Err(ApiError::new(Code::Malformed, detail));
    }
    let (stored, spec, _) = app.forkable(&caller, id, "the reference's line can be read").await?;
    let round = round.unwrap_or(stored.rounds);
    if round > stored.rounds {
        let detail = format!("the game has {} rounds, and no state {round}", stored.rounds);
        return Err(ApiError::new(Code::NotFound, detail).at_round(stored.rounds));
    }
    if let Some(detail) = too_much(&spec.config, 0, false) {
        return Err(ApiError::new(Code::Invalid, detail));
    }
    let _permit = app.heavy.worth().await?;
    let party = Party::current();
    let bytes = of_worth(&spec.config, round);
    let _memory = app.registry.room_of(bytes, Some(party), Rank::Normal)?;
    let game = game(app.registry.host(), &stored, round, party).await?;
    let begin = move || Liner::new(game, round, rounds);
    let mut line = in_pieces(&app.workers, party, begin, Liner::work).await?;
    line.episode = Some(stored.id.to_string());
    Ok(Json(line))
}

impl App {
    /// The stored worth of a game, or a new one, which is stored if the game has ended.
    async fn worth(
        &self,
        stored: &StoredEpisode,
        config: &Config,
        with_seats: bool,
    ) -> Result<GameWorth, ApiError> {
        if let Some(found) = self.stored_worth(stored, with_seats).await? {
            return Ok(found);
        }
        let _permit = self.heavy.worth().await?;
        // Somebody else may have computed it meanwhile.
        if let Some(found) = self.stored_worth(stored, with_seats).await? {
            return Ok(found);
        }
        let (host, party) = (self.registry.host(), Party::current());
        let bytes = of_worth(config, stored.rounds);
        let _memory = self.registry.room_of(bytes, Some(party), Rank::Normal)?;
        let game = game(host, stored, stored.rounds, party).await?;
        let begin = move || Appraiser::new(game, with_seats);
        let worth = in_pieces(&host.workers, party, begin, Appraiser::work).await?;
        let has_ended = stored.ended_at.is_some();
        let worth = self.heavy.render(move || sent(&worth, has_ended)).await?;
        // Somebody else may have stored one with the losses of seats meanwhile.
        if has_ended && (with_seats || self.stored_worth(stored, false).await?.is_none()) {
            let rows = MetricsRow::of_worth(stored.episode, &worth);
            let entry = |row| Entry::Measured { number: None, metrics: Some(Box::new(row)) };
            self.store.keep(rows.map(entry).into()).await?;
        }
        Ok(worth)
    }

    /// The stored worth of a game, if it has the losses of seats or does not need them.
    async fn stored_worth(
        &self,
        stored: &StoredEpisode,
        with_seats: bool,
    ) -> Result<Option<GameWorth>, ApiError> {
        let found = self.store.worth_of(stored.episode).await?;
        Ok(found.filter(|worth| worth.seats.is_some() || !with_seats))
    }
}
