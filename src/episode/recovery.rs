//! Journal → running episode: every unfinished episode continues at the same round, with the acts
//! that were already recorded.

use std::sync::Arc;
use std::time::Duration;

use swarmbench_engine::World;

use super::actor::{EpisodeInit, Host, Keyframes, Times};
use super::heavy::{self, off_thread, step_micros};
use super::lockstep::{Clocks, Lockstep, RecordedAct, ResumeState};
use super::replay::{acts_bytes, rounds_at_once};
use super::seating::Seating;
use super::spec::Spec;
use super::{Ending, Outcome};
use crate::fair::{Party, Rank};
use crate::journal::Tally;
use crate::journal::record::{End, Record};
use crate::journal::replay::acts_of;
use crate::store::StoreError;
use crate::store::port::{RoundActs, StoredEpisode, StoredRound};
use crate::work::{Cancelled, WorkError};

/// Why an episode cannot be recovered.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RecoveryError {
    /// Its journal cannot be read.
    #[error(transparent)]
    Journal(#[from] StoreError),
    /// Too much heavy work waits.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// Its journal does not play again as it was played.
    #[error("the journal of episode {episode} cannot be replayed: {problem}")]
    Broken {
        /// The public id.
        episode: String,
        /// What is wrong.
        problem: String,
    },
}

/// Takes a stored episode up. Its open round begins when that is done, however long it took.
pub(super) async fn recover(
    host: &Host,
    stored: StoredEpisode,
    spec: Arc<Spec>,
    party: Party,
    times: Arc<Times>,
) -> Result<EpisodeInit, RecoveryError> {
    let broken = |problem: String| broken(&stored, problem);
    let config = Arc::clone(&spec.config);
    let (micros, at_once) = (step_micros(&config), rounds_at_once(&config));
    let Host { journal, clock, workers, budget, .. } = host;
    let share = (recovered_for(&stored, party), Rank::Normal);
    let lay_out = move |_: &Cancelled<'_>| Arc::new(World::new(config));
    let layout = off_thread(workers, "layout", share, heavy::is_long(micros), lay_out).await?;
    let mut track = Track {
        keyframes: Keyframes::new(Arc::clone(&layout)),
        world: layout,
        bank_spent: vec![Duration::ZERO; spec.config.num_agents().into()],
        bytes: 0,
        tally: Tally::default(),
    };
    while track.world.round() < stored.rounds {
        let from = track.world.round();
        let to = stored.rounds.min(from + at_once);
        let _memory = budget.take(acts_bytes(&spec.config, to - from), None);
        let acts = journal.acts(stored.episode, from, to).await?;
        let rounds = journal.rounds(stored.episode, from, to).await?;
        let play = move |cancelled: &Cancelled<'_>| track.play(&acts, &rounds, cancelled);
        let is_heavy = heavy::is_long(micros * u64::from(to - from));
        let played = off_thread(workers, "recovery", share, is_heavy, play).await?;
        track = played.map_err(broken)?;
    }
    let open = journal.round_acts(stored.episode, stored.rounds).await?;
    track.count(&open);
    let outcome = match &stored.end {
        None => None,
        Some(end) => {
            Some(outcome(end, stored.ended_at.unwrap_or_else(|| clock.now())).map_err(broken)?)
        }
    };
    let resume = ResumeState {
        waiting: stored.status == "waiting",
        outcome,
        round: stored.rounds,
        alive: track.world.agents().map(|agent| track.world.is_alive(agent)).collect(),
        bank_spent: track.bank_spent,
        recorded: (open.into_iter())
            .map(|(agent, act)| {
                (agent, RecordedAct { record: act.record, waiting_for: act.waiting_for })
            })
            .collect(),
        last_act_at: times.last_act_at(),
    };
    let holders =
        if spec.is_seated() { journal.holders(stored.episode).await? } else { Vec::new() };
    let seating = Seating::new(&spec, times.created_at, holders);
    let clocks = clocks(&spec);
    Ok(EpisodeInit {
        id: stored.id,
        key: stored.episode,
        owner: stored.owner,
        run: stored.run,
        party,
        spec,
        created_at: stored.created_at,
        times,
        world: track.world,
        head: stored.head,
        lockstep: Lockstep::new(clocks, resume, clock.now()),
        keyframes: track.keyframes,
        newest_at: stored.newest_at,
        bytes: track.bytes,
        tally: track.tally,
        seating,
    })
}

/// The party for which an episode of `party` is recovered: if it has ended, the caller.
pub(super) fn recovered_for(stored: &StoredEpisode, party: Party) -> Party {
    if stored.end.is_some() { Party::current() } else { party }
}

/// The description of a stored episode.
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

/// An episode during its replay from the layout.
struct Track {
    world: Arc<World>,
    keyframes: Keyframes,
    bank_spent: Vec<Duration>,
    bytes: u64,
    tally: Tally,
}

impl Track {
    fn count(&mut self, acts: &RoundActs) {
        for (_, act) in acts {
            self.bytes += act.bytes;
            self.tally.add(&act.record);
        }
    }

    fn play(
        mut self,
        acts: &[(u32, RoundActs)],
        rounds: &[StoredRound],
        cancelled: &Cancelled<'_>,
    ) -> Result<Self, String> {
        for (_, acts) in acts {
            self.count(acts);
        }
        for round in rounds {
            if cancelled.is_cancelled() {
                return Err("nobody waits for it any more".to_owned());
            }
            let recorded: &[_] = match acts.iter().find(|(number, _)| *number == round.round) {
                Some((_, recorded)) => recorded,
                None => &[],
            };
            for (agent, act) in recorded {
                self.bank_spent[agent.index()] += Duration::from_millis(act.record.bank_spent_ms);
            }
            let records = recorded.iter().map(|(_, act)| &act.record);
            let acts = acts_of(self.world.config(), records)?;
            let mut world = World::clone(&self.world);
            if world.is_over() {
                return Err(format!("round {} is one too many", round.round));
            }
            world.step(&acts);
            if world.digest().0 != round.digest {
                return Err(format!("round {} has another digest", round.round));
            }
            self.world = Arc::new(world);
            self.keyframes.offer(&self.world);
        }
        Ok(self)
    }
}

/// The clocks of an episode.
pub(super) fn clocks(spec: &Spec) -> Clocks {
    Clocks {
        round_deadline: spec.round_deadline,
        bank: spec.bank,
        idle_timeout: spec.idle_timeout,
        closes_at: spec.closes_at,
    }
}

fn outcome(
    end: &crate::journal::record::RawRecord,
    at: jiff::Timestamp,
) -> Result<Outcome, String> {
    let Record::End(End { reason, .. }) = end.read().map_err(|error| error.to_string())? else {
        return Err("its last record is not an end".to_owned());
    };
    let ending = Ending::parse(&reason).ok_or_else(|| format!("it ended by {reason:?}"))?;
    Ok(Outcome { ending, at })
}
