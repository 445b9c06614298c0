//! Recovery of an episode from its journal: an unfinished episode continues at the same round, with the acts that were already
//! recorded.

use std::sync::atomic::AtomicI64;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use swarmbench_engine::World;

use super::actor::{EpisodeInit, Host, Running, Times};
use super::heavy::{self, off_thread, step_micros};
use super::keyframes::Keyframes;
use super::lockstep::{Clocks, Lockstep, RecordedAct, ResumeState};
use super::replay::Rounds;
pub use super::replays::RecoveryError;
use super::seating::Seating;
use super::spec::Spec;
use super::status::{Ending, Outcome};
use crate::fair::{Party, Rank};
use crate::store::port::{RoundActs, StoredEpisode};
use crate::work::Cancelled;
use swarmbench_journal::Tally;
use swarmbench_journal::record::{End, RawRecord, Record};

/// Recovers a stored episode. The clock of its open round begins afterwards, however long the recovery took.
pub(super) async fn recover(
    host: &Host,
    stored: StoredEpisode,
    spec: Arc<Spec>,
    party: Party,
    times: Arc<Times>,
) -> Result<EpisodeInit, RecoveryError> {
    let broken = |problem: String| broken(&stored, problem);
    let config = Arc::clone(&spec.config);
    let micros = step_micros(&config);
    let Host { journal, clock, workers, .. } = host;
    let recovered_for = recovered_for(&stored, party);
    let share = (recovered_for, Rank::Normal);
    let lay_out = move |_: &Cancelled<'_>| Arc::new(World::new(config));
    let layout = off_thread(workers, "layout", share, heavy::is_long(micros), lay_out).await?;
    let history = History {
        keyframes: Keyframes::new(Arc::clone(&layout)),
        bank_spent: vec![Duration::ZERO; spec.config.num_agents().into()],
        bytes: 0,
        first_round: spec.first_round(),
        tally: Tally::default(),
    };
    let rounds = Rounds::of(&stored, stored.rounds, ("recovery", recovered_for), 0);
    let rounds = Rounds { checked: true, ..rounds };
    let (world, mut history) = rounds.play(host, layout, history, History::see).await?;
    let open = journal.round_acts(stored.episode, stored.rounds).await?;
    history.count(&open, stored.rounds);
    let outcome = match &stored.end {
        None => None,
        Some(end) => {
            Some(outcome(end, stored.ended_at.unwrap_or_else(|| clock.now())).map_err(broken)?)
        }
    };
    let recorded = open.into_iter().map(|(agent, act)| {
        let recorded = RecordedAct::stored(act, &spec.config)?;
        Ok((agent, recorded))
    });
    let recorded: Result<_, String> = recorded.collect();
    let resume = ResumeState {
        waiting: stored.status == "waiting",
        outcome,
        round: stored.rounds,
        alive: world.agents().map(|agent| world.is_alive(agent)).collect(),
        bank_spent: history.bank_spent,
        recorded: recorded.map_err(broken)?,
        last_act_at: times.last_act_at(),
    };
    let holders =
        if spec.is_seated() { journal.holders(stored.episode).await? } else { Vec::new() };
    let seating = Seating::new(&spec, times.created_at, holders);
    let clocks = clocks(&spec);
    Ok(EpisodeInit {
        episode: Running {
            id: stored.id,
            key: stored.episode,
            owner: stored.owner,
            run: stored.run,
            party,
            spec,
            created_at: stored.created_at,
            hosted: OnceLock::new(),
            keyframes: Mutex::new(history.keyframes),
            ends_at: AtomicI64::default(),
            times,
        },
        world,
        head: stored.head,
        lockstep: Lockstep::new(clocks, resume, clock.now()),
        newest_at: stored.newest_at,
        bytes: history.bytes,
        tally: history.tally,
        seating,
    })
}

/// Party for which an episode of `party` is recovered: the caller, if the episode has ended.
pub(super) fn recovered_for(stored: &StoredEpisode, party: Party) -> Party {
    if stored.end.is_some() { Party::current() } else { party }
}

pub(super) fn described(stored: &StoredEpisode) -> Result<Spec, RecoveryError> {
    match stored.opening.read() {
        Ok(Record::Opening(opening)) => {
            Spec::from_opening(&opening).map_err(|problem| broken(stored, problem))
        }
        Ok(Record::Seats(_) | Record::Round(_) | Record::End(_)) => {
            Err(broken(stored, "it has no opening".to_owned()))
        }
        Err(error) => Err(broken(stored, error.to_string())),
    }
}

fn broken(stored: &StoredEpisode, problem: String) -> RecoveryError {
    RecoveryError::Broken { episode: stored.id.to_string(), problem }
}

/// Result of replaying an episode's resolved rounds, beside the state.
struct History {
    keyframes: Keyframes,
    bank_spent: Vec<Duration>,
    bytes: u64,
    first_round: u32,
    /// Tally of the acts in the episode's own rounds.
    tally: Tally,
}

impl History {
    fn count(&mut self, acts: &RoundActs, round: u32) {
        for (_, act) in acts {
            self.bytes += act.bytes;
            if round >= self.first_round {
                self.tally.add(&act.record);
            }
        }
    }

    fn see(&mut self, acts: &RoundActs, world: &Arc<World>) {
        self.count(acts, world.round() - 1);
        for (agent, act) in acts {
            self.bank_spent[agent.index()] += Duration::from_millis(act.record.bank_spent_ms);
        }
        self.keyframes.offer(world);
    }
}

pub(super) fn clocks(spec: &Spec) -> Clocks {
    Clocks {
        round_deadline: spec.round_deadline,
        bank: spec.bank,
        idle_timeout: spec.idle_timeout,
        closes_at: spec.closes_at,
    }
}

fn outcome(end: &RawRecord, at: jiff::Timestamp) -> Result<Outcome, String> {
    let Record::End(End { reason, .. }) = end.read().map_err(|error| error.to_string())? else {
        return Err("its last record is not an end".to_owned());
    };
    let ending = Ending::parse(&reason).ok_or_else(|| format!("it ended by {reason:?}"))?;
    Ok(Outcome { ending, at })
}
