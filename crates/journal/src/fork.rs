//! Verification of a fork against the journal of its parent.

use std::io::BufRead;

use swarmbench_engine::physics::Solver;

use super::chain::Head;
use super::record::{ActRecord, Fork, RawRecord};
use super::replay::{Fault, JournalReport, Verifier};

/// A reason why a journal is not that of a fork of the other.
#[derive(Debug, thiserror::Error)]
pub enum ForkFault {
    /// The journal of the fork does not verify.
    #[error(transparent)]
    Fork(Fault),
    /// The journal of the parent does not verify.
    #[error("the journal of the parent: {0}")]
    Parent(Fault),
    /// Both journals verify, but do not belong together.
    #[error("{0}")]
    Differs(String),
}

/// Replays the journals of a fork and of its parent. Each must verify by itself, and the fork must continue the
/// parent from the round and the head that it names, with the same settings and the same earlier acts.
///
/// `expected` is the head of the fork's chain, as for [`verify`](super::replay::verify). `progress` is called with
/// the current round of a journal and its maximum.
///
/// # Errors
/// A fault of either journal, or the difference between them.
pub fn verify_fork(
    fork: impl BufRead,
    parent: impl BufRead,
    expected: Option<Head>,
    solver: Solver,
    mut progress: impl FnMut(u32, u32),
) -> Result<JournalReport, ForkFault> {
    let fork = play(fork, expected, solver, &mut progress).map_err(ForkFault::Fork)?;
    let parent = play(parent, None, solver, &mut progress).map_err(ForkFault::Parent)?;
    belong_together(&fork, &parent).map_err(ForkFault::Differs)?;
    Ok(fork.report)
}

/// A replayed journal.
struct Played {
    report: JournalReport,
    /// The hash of each state and of the acts that led to it; the layout first.
    steps: Vec<[u8; 32]>,
    /// The number of replayed rounds and the head of the chain after each line.
    heads: Vec<(u32, Head)>,
}

fn play(
    mut journal: impl BufRead,
    expected: Option<Head>,
    solver: Solver,
    progress: &mut impl FnMut(u32, u32),
) -> Result<Played, Fault> {
    let mut verifier = Verifier::new(solver);
    let (mut steps, mut heads) = (Vec::new(), Vec::new());
    loop {
        let mut line = Vec::new();
        if journal.read_until(b'\n', &mut line)? == 0 {
            let report = verifier.finish(expected)?;
            return Ok(Played { report, steps, heads });
        }
        verifier.line(&line, |world, acts| {
            steps.push(step(world.digest().0, acts));
            progress(world.round(), world.config().max_round());
        })?;
        let rounds = verifier.world().map_or(0, swarmbench_engine::World::round);
        heads.push((rounds, verifier.head()));
    }
}

fn step(digest: [u8; 32], acts: &[ActRecord]) -> [u8; 32] {
    let acts: Vec<ActRecord> = acts.iter().cloned().map(ActRecord::taken_over).collect();
    Head(digest).link(RawRecord::write(&acts).as_str().as_bytes()).0
}

fn belong_together(fork: &Played, parent: &Played) -> Result<(), String> {
    let (own, other) = (&fork.report.opening, &parent.report.opening);
    let Some(Fork { episode, round, head }) = &own.fork else {
        return Err(format!("{} is no fork: its opening names no parent", own.episode));
    };
    if *episode != other.episode {
        return Err(format!(
            "its parent is {episode}, and the other journal is that of {}",
            other.episode
        ));
    }
    let rounds = parent.report.rounds;
    if rounds < *round {
        return Err(format!(
            "it continues its parent from round {round}, and the parent's journal has {rounds} rounds; get it again"
        ));
    }
    let settings =
        |config: &super::record::RecordedConfig| config.engine().map(|config| config.settings());
    if settings(&own.config).ok() != settings(&other.config).ok() {
        return Err("the settings of the simulation are not those of its parent".to_owned());
    }
    let of_both = fork.steps.iter().zip(&parent.steps).take(*round as usize + 1);
    if let Some(place) = of_both.clone().position(|(own, other)| own != other) {
        let what =
            place.checked_sub(1).map_or("the layout".to_owned(), |round| format!("round {round}"));
        return Err(format!("{what} is not that of its parent"));
    }
    let named = |&(played, after): &(u32, Head)| played == *round && after.to_string() == *head;
    if !parent.heads.iter().any(named) {
        return Err(format!("the head of its parent before round {round} is not {head}"));
    }
    Ok(())
}
