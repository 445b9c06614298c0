//! The worth of games from their journals.

use std::io::BufRead;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use swarmbench_engine::physics::Solver;
use swarmbench_engine::{AgentId, Config, World};
use swarmbench_journal::record::{ActRecord, Source};
use swarmbench_journal::replay::{Fault, JournalReport, RoundFault, acts_of, verify_seen};

use crate::{Appraiser, Decided, Game, Worth};

/// Decisions between two reports of the progress.
const PIECE: u64 = 2000;

/// Reads and checks a journal. Returns its game beside the report.
///
/// # Errors
/// The first fault of the journal.
pub fn game_of(journal: impl BufRead) -> Result<(JournalReport, Game), Fault> {
    let mut game: Option<Game> = None;
    let report = verify_seen(journal, None, Solver::Flow, |world, acts| match &mut game {
        None => game = Some(Game { layout: Arc::new(World::clone(world)), rounds: Vec::new() }),
        Some(game) => {
            let decided = decided(world.config(), acts).expect("the journal was checked");
            game.rounds.push(decided);
        }
    })?;
    Ok((report, game.expect("a whole journal has a layout")))
}

/// Decisions of a round in the order of agents, from their records.
///
/// # Errors
/// If a record names an agent or an act that the game does not have.
pub fn decided<'a>(
    config: &Config,
    records: impl IntoIterator<Item = &'a ActRecord> + Clone,
) -> Result<Vec<Decided>, RoundFault> {
    let acts = acts_of(config, records.clone())?;
    let mut decided: Vec<Decided> =
        acts.into_iter().map(|act| Decided { act, ..Decided::default() }).collect();
    for record in records {
        let agent = AgentId::parse(&record.agent);
        if let Some(decided) = agent.and_then(|agent| decided.get_mut(agent.index())) {
            decided.is_invalid = !record.valid;
            decided.is_late = record.source == Source::Clock;
        }
    }
    Ok(decided)
}

/// Computes the worth of a game on some threads; the number of threads changes nothing but the time. Calls `progress` with the
/// rounds that are done and all rounds.
pub fn appraise(
    game: &Game,
    with_seats: bool,
    threads: usize,
    progress: impl Fn(usize, usize) + Sync,
) -> Worth {
    let (threads, rounds) = (threads.max(1), game.rounds.len());
    let done = AtomicUsize::new(0);
    let work = |share: usize| {
        let mut part = Appraiser::sharing(game.clone(), with_seats, (share, threads));
        let mut before = 0;
        loop {
            let is_done = part.work(PIECE);
            // Parts do other rounds of about the same cost: each has done its share of the rounds that it has passed.
            let passed = part.rounds() / threads;
            done.fetch_add(passed - before, Ordering::Relaxed);
            before = passed;
            progress(done.load(Ordering::Relaxed).min(rounds), rounds);
            if is_done {
                return part;
            }
        }
    };
    let parts = thread::scope(|scope| {
        let work = &work;
        let running: Vec<_> = (0..threads).map(|share| scope.spawn(move || work(share))).collect();
        running.into_iter().map(|part| part.join().expect("no part panics")).collect()
    });
    progress(rounds, rounds);
    Appraiser::join(parts)
}
