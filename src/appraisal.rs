//! The worth of stored games (`docs/evaluate/worth.md`): rollouts on the worker threads, in pieces.

use std::ops::ControlFlow;
use std::sync::Arc;

use swarmbench_engine::{Config, World};
use swarmbench_worth::{Decided, Game, cost, decided};

use crate::episode::actor::Host;
use crate::episode::heavy::step_micros;
use crate::episode::replay::Rounds;
use crate::episode::replays::RecoveryError;
use crate::fair::{Party, Rank};
use crate::measure::layout_of;
use crate::store::port::StoredEpisode;
use crate::work::{Cancelled, WorkError, Workers};

/// Decisions that are computed in one piece, about a tenth of a second.
const PIECE: u64 = 2000;

/// Seconds that the worth of one game may take by an estimate. 100 rounds of 16 agents take fewer, with the losses of all seats.
const WORTH_SECONDS_MAX: u64 = 90;

/// Microseconds of a player's decision, for estimates.
const MICROS_OF_A_DECISION: u64 = 50;

/// Why the worth of a game is not computed, or its seats' losses if `with_seats`; `None` if it is.
pub fn too_much(config: &Config, rounds: u32, with_seats: bool) -> Option<String> {
    let (rolled, decisions) = cost(config, rounds, with_seats);
    let micros = rolled.saturating_mul(step_micros(config));
    let micros = micros.saturating_add(decisions.saturating_mul(MICROS_OF_A_DECISION));
    let seconds = micros / 1_000_000;
    let what = if with_seats { "losses of seats take" } else { "it takes" };
    (seconds > WORTH_SECONDS_MAX).then(|| {
        format!("{what} up to {seconds} s, more than worth_seconds_max, {WORTH_SECONDS_MAX}")
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
    let rounds = Rounds::of(stored, to, ("worth", party), MICROS_OF_A_DECISION);
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

/// Works to the end in pieces, each in its party's turn. `work` gets the number of decisions of a piece.
pub async fn in_pieces<W: Send + 'static, R: Send + 'static>(
    workers: &Workers,
    party: Party,
    begin: impl FnOnce() -> W + Send + 'static,
    work: fn(Box<W>, u64) -> ControlFlow<R, Box<W>>,
) -> Result<R, WorkError> {
    let begin = move |_: &Cancelled<'_>| Box::new(begin());
    let mut unfinished = workers.run("worth", party, Rank::Normal, begin).await?;
    loop {
        let piece = move |_: &Cancelled<'_>| work(unfinished, PIECE);
        match workers.run("worth", party, Rank::Normal, piece).await? {
            ControlFlow::Continue(more) => unfinished = more,
            ControlFlow::Break(result) => return Ok(result),
        }
    }
}
