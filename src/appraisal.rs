//! The worth of stored games (`docs/evaluate/worth.md`): rollouts on the worker threads, in pieces.

use std::sync::Arc;

use swarmbench_engine::{Config, World};
use swarmbench_worth::{
    Appraiser, Decided, Game, WORTH_DECISIONS_MAX, Worth, decided, decisions_of,
};

use crate::episode::actor::Host;
use crate::episode::heavy::step_micros;
use crate::episode::replay::Rounds;
use crate::episode::replays::RecoveryError;
use crate::fair::{Party, Rank};
use crate::measure::layout_of;
use crate::store::port::StoredEpisode;
use crate::work::{Cancelled, WorkError, Workers};

/// Decisions that are computed in one piece, about a tenth of a second; a single rollout may take longer.
const PIECE: u64 = 2000;

/// Seconds that all rounds of the rollouts of one game may take, without the decisions of players.
const WORTH_SECONDS_MAX: u64 = 60;

/// Microseconds of a decision, for the estimate of a replay that shows players all states.
const MICROS_OF_A_DECISION: u64 = 50;

/// Bytes of a decision in memory, its message included.
const DECISION_BYTES: usize = 512;

/// Bytes of a game's decisions in memory.
pub fn game_bytes(config: &Config, rounds: u32) -> usize {
    rounds as usize * usize::from(config.num_agents()) * DECISION_BYTES
}

/// Why the worth of a game is not computed, or its seats' losses if `with_seats`; `None` if it is.
pub fn too_much(config: &Config, rounds: u32, with_seats: bool) -> Option<String> {
    let decisions = decisions_of(config, rounds, with_seats);
    let what = if with_seats { "losses of seats take" } else { "it takes" };
    if decisions > WORTH_DECISIONS_MAX {
        return Some(format!(
            "{what} up to {decisions} decisions of the reference, more than worth_decisions_max, {WORTH_DECISIONS_MAX}"
        ));
    }
    let steps = decisions / u64::from(config.num_agents()).max(1);
    let micros = steps.saturating_mul(step_micros(config));
    let seconds = micros / 1_000_000;
    (seconds > WORTH_SECONDS_MAX).then(|| {
        format!(
            "{what} about {seconds} s of rounds of this size, more than worth_seconds_max, {WORTH_SECONDS_MAX}"
        )
    })
}

/// Reads the first `to` rounds of a game.
pub async fn game(
    host: &Host,
    stored: &StoredEpisode,
    to: u32,
    party: Party,
) -> Result<Game, RecoveryError> {
    let layout = layout_of(stored)?;
    let rounds = Rounds {
        id: &stored.id,
        key: stored.episode,
        to,
        checked: false,
        work: ("worth", party),
        see_micros: MICROS_OF_A_DECISION,
    };
    let seen: Result<Vec<Vec<Decided>>, String> = Ok(Vec::new());
    let (_, seen) = rounds
        .play(host, Arc::clone(&layout), seen, |seen, acts, world: &Arc<World>| {
            let Ok(rounds) = seen else { return };
            match decided(world.config(), acts.iter().map(|(_, act)| &act.record)) {
                Ok(round) => rounds.push(round),
                Err(fault) => *seen = Err(fault.to_string()),
            }
        })
        .await?;
    let broken = |problem| RecoveryError::Broken { episode: stored.id.to_string(), problem };
    Ok(Game { layout, rounds: seen.map_err(broken)? })
}

/// Computes the worth of a game in pieces, each in its party's turn.
pub async fn appraise(
    workers: &Workers,
    game: Game,
    with_seats: bool,
    party: Party,
) -> Result<(Game, Worth), WorkError> {
    let mut appraiser = Box::new(Appraiser::new(game.clone(), with_seats));
    loop {
        let piece = move |_: &Cancelled<'_>| {
            let is_done = appraiser.work(PIECE);
            (appraiser, is_done)
        };
        let is_done;
        (appraiser, is_done) = workers.run("worth", party, Rank::Normal, piece).await?;
        if is_done {
            let finish = move |_: &Cancelled<'_>| (game, appraiser.finish());
            return workers.run("worth", party, Rank::Normal, finish).await;
        }
    }
}
