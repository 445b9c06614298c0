//! The part of its parent that a fork takes over: the rounds before its own first one, and the state after them.

use std::sync::Arc;

use swarmbench_engine::{AgentId, Config, World};

use super::actor::Host;
use super::heavy::off_thread;
use super::keyframes::Keyframes;
use super::replay::Rounds;
use super::replays::RecoveryError;
use crate::fair::{Party, Rank};
use crate::store::port::{RoundActs, StoredEpisode};
use crate::work::Cancelled;
use swarmbench_journal::record::{RawRecord, Source, round_record};

/// Estimated time in which the records of a round are written, in microseconds.
const WRITE_MICROS: u64 = 20;

/// Rounds that were played, as they stand in the journals of forks.
pub struct Past {
    /// State after the rounds.
    pub(super) world: Arc<World>,
    pub(super) keyframes: Keyframes,
    pub(super) rounds: Vec<PastRound>,
    /// Journal bytes of the acts.
    pub(super) bytes: u64,
}

pub(super) struct PastRound {
    pub(super) acts: Vec<PastAct>,
    pub(super) record: RawRecord,
    /// Digest of the state after the round.
    pub(super) digest: [u8; 32],
    /// Score after the round.
    pub(super) score: f64,
}

pub(super) struct PastAct {
    pub(super) agent: AgentId,
    pub(super) waiting_for: u32,
    pub(super) source: Source,
    pub(super) record: RawRecord,
}

impl Past {
    /// The past before the first round: only the layout.
    pub fn none(layout: Arc<World>) -> Self {
        let keyframes = Keyframes::new(Arc::clone(&layout));
        Self { world: layout, keyframes, rounds: Vec::new(), bytes: 0 }
    }

    /// Reads the first `round` rounds of an episode, which must be resolved, and plays them again.
    pub async fn read(
        host: &Host,
        parent: &StoredEpisode,
        config: Arc<Config>,
        round: u32,
    ) -> Result<Self, RecoveryError> {
        let party = Party::current();
        let lay_out = move |_: &Cancelled<'_>| Arc::new(World::new(config));
        let share = (party, Rank::Normal);
        let layout = off_thread(&host.workers, "layout", share, true, lay_out).await?;
        let rounds = Rounds::of(parent, round, ("fork", party), WRITE_MICROS);
        let rounds = Rounds { checked: true, ..rounds };
        let past = Self::none(Arc::clone(&layout));
        let (world, past) = rounds.play(host, layout, past, Self::see).await?;
        Ok(Self { world, ..past })
    }

    /// Whether the rules end the episode after these rounds.
    pub fn is_over(&self) -> bool {
        self.world.is_over()
    }

    /// Number of acts and rounds.
    pub(super) fn rows(&self) -> usize {
        self.rounds.iter().map(|round| round.acts.len() + 1).sum()
    }

    fn see(&mut self, acts: &RoundActs, world: &Arc<World>) {
        let acts: Vec<PastAct> = (acts.iter())
            .map(|(agent, act)| PastAct {
                agent: *agent,
                waiting_for: act.waiting_for,
                source: act.record.source,
                record: RawRecord::write(&act.record.clone().taken_over()),
            })
            .collect();
        self.bytes += acts.iter().map(|act| act.record.as_str().len() as u64).sum::<u64>();
        let (digest, score) = (world.digest(), world.score());
        let records = acts.iter().map(|act| &act.record);
        let record = round_record(world.round() - 1, records, &digest.to_string(), score);
        self.rounds.push(PastRound { acts, record, digest: digest.0, score });
        self.keyframes.offer(world);
    }
}
