//! The worth of stored games (`docs/evaluate/worth.md`): rollouts on the worker threads, in pieces.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use swarmbench_engine::{Config, World};
use swarmbench_worth::{Decided, Game, decided, rounds_of};

use crate::episode::actor::Host;
use crate::episode::heavy::step_micros;
use crate::episode::replay::Rounds;
use crate::episode::replays::RecoveryError;
use crate::fair::{Party, Rank};
use crate::measure::layout_of;
use crate::store::port::StoredEpisode;
use crate::work::{Cancelled, WorkError, Workers};

/// Time of a piece of work; a single round may take longer.
const PIECE: Duration = Duration::from_millis(20);

/// Seconds that the worth of one game may take by an estimate. 100 rounds of 16 agents take fewer, with the losses of all seats.
const WORTH_SECONDS_MAX: u64 = 90;

/// Microseconds of a player's decision on a small map. In another one it reads 50 cells of the map and of its window.
const MICROS_OF_A_DECISION: u64 = 50;

/// Why the worth of a game is not computed, or its seats' losses if `with_seats`; `None` if it is.
pub fn too_much(config: &Config, rounds: u32, with_seats: bool) -> Option<String> {
    let settings = config.settings();
    let cells = |height: i64, width: i64| height.unsigned_abs() * width.unsigned_abs();
    let map = cells(settings.height, settings.width);
    let seen = map + map.min(cells(settings.view_size, settings.view_size));
    let decision = MICROS_OF_A_DECISION + seen / 50;
    let round = step_micros(config) + u64::from(config.num_agents()) * decision;
    let seconds = rounds_of(config, rounds, with_seats).saturating_mul(round) / 1_000_000;
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

/// Function that works on until the time is up, and breaks with the result.
type Work<W, R> = fn(Box<W>, &dyn Fn() -> bool) -> ControlFlow<R, Box<W>>;

/// Works to the end in pieces, each in its party's turn.
pub async fn in_pieces<W: Send + 'static, R: Send + 'static>(
    workers: &Workers,
    party: Party,
    begin: impl FnOnce() -> W + Send + 'static,
    work: Work<W, R>,
) -> Result<R, WorkError> {
    let begin = move |_: &Cancelled<'_>| Box::new(begin());
    let mut unfinished = workers.run("worth", party, Rank::Normal, begin).await?;
    loop {
        let piece = move |cancelled: &Cancelled<'_>| {
            let begun = Instant::now();
            work(unfinished, &|| cancelled.is_cancelled() || begun.elapsed() > PIECE)
        };
        match workers.run("worth", party, Rank::Normal, piece).await? {
            ControlFlow::Continue(more) => unfinished = more,
            ControlFlow::Break(result) => return Ok(result),
        }
    }
}
