//! What episodes need of a store: entries are taken in order, and journals are read again.

use futures::FutureExt;
use futures::future::BoxFuture;
use jiff::Timestamp;
use swarmbench_engine::AgentId;

use crate::ids::{CompetitionKey, EpisodeId, EpisodeKey, Place, RunKey};
use crate::keys::OwnerKey;
use crate::store::entries::{Entry, Held};
use crate::store::{Stopped, StoreError};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, RawRecord, RecordedConfig};

/// What a store answers.
pub type Reply<'a, T> = BoxFuture<'a, Result<T, StoreError>>;

/// Called once entries are durable, or with the reason why they never will be.
pub type Committed = Box<dyn FnOnce(Result<(), StoreError>) + Send>;

/// Hands entries over at once, and returns when they are durable.
pub fn committed(append: impl FnOnce(Committed)) -> Reply<'static, ()> {
    let (done, kept) = tokio::sync::oneshot::channel();
    append(Box::new(move |result| drop(done.send(result))));
    async move { kept.await.unwrap_or(Err(StoreError::Stopped(Stopped::Writer))) }.boxed()
}

#[derive(Clone, Debug)]
pub struct StoredEpisode {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// The key with which it was created, if any.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, if any.
    pub run: Option<RunKey>,
    /// Whether it was sealed and is open to all now.
    pub revealed: bool,
    /// Whether its owner reads it once it has ended, also while it is sealed.
    pub own_games: bool,
    pub opening: RawRecord,
    /// The first round that was decided in the episode itself; a fork took over those before.
    pub first_round: u32,
    /// The record of who holds which seat, if there is one.
    pub seating: Option<RawRecord>,
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    pub status: String,
    /// Why it ended, if it has; the name of an ending.
    pub reason: Option<String>,
    /// The end record of an episode that has ended; left out of summaries. Where it is large, the acts of the
    /// open round are left out of it.
    pub end: Option<RawRecord>,
    /// The head of its chain after the last stored record.
    pub head: Head,
    /// Bytes that its acts take, once it has ended.
    pub act_bytes: Option<u64>,
    pub rounds: u32,
    /// The score after them.
    pub score: f64,
    pub created_at: Timestamp,
    /// When its newest record came; in summaries, when it was created.
    pub newest_at: Timestamp,
    /// When the last act of a player came, or else the manual start; left out of summaries.
    pub last_act_at: Option<Timestamp>,
    pub ended_at: Option<Timestamp>,
    pub void_reason: Option<String>,
}

#[derive(Clone, Debug)]
pub struct Unfinished {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// The key with which it was created, if any.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, if any.
    pub run: Option<RunKey>,
    /// Whether its rounds have a deadline.
    pub clocked: bool,
    /// Of an episode with deadlines, its settings and how many rounds are resolved: what its recovery costs.
    pub played: Option<(RecordedConfig, u32)>,
}

/// Acts of one round, in order of their seats.
pub type RoundActs = Vec<(AgentId, StoredAct)>;

#[derive(Clone, Debug)]
pub struct StoredAct {
    pub record: ActRecord,
    /// Bytes of the whole record as it is stored.
    pub bytes: u64,
    /// How many seats the round waited for after it.
    pub waiting_for: u32,
}

#[derive(Clone, Debug)]
pub struct StoredRound {
    pub round: u32,
    /// The digest of the state after it.
    pub digest: [u8; 32],
    /// The score after it.
    pub score: f64,
    /// The head of the chain after it.
    pub head: Head,
}

/// Stores the journals of episodes. Entries that are appended become durable in the order in which they are handed over.
pub trait EpisodeStore: Send + Sync + 'static {
    /// Keeps entries, all or none, and calls `committed` once they are durable. Never waits.
    fn append(&self, entries: Vec<Entry>, committed: Committed);

    /// Keeps entries and waits until they, and all that was appended before them, are durable; without entries it only
    /// waits. What is appended meanwhile may be durable before them. They are stored also if the caller is gone.
    fn keep(&self, entries: Vec<Entry>) -> Reply<'_, ()> {
        committed(|committed| self.append(entries, committed))
    }

    /// Takes entries of an episode again, of which one was refused. Until then all later ones are, as they
    /// would leave a gap. To be called when its old actor has ended and all that it handed over was answered.
    fn recovered(&self, _episode: EpisodeKey) {}

    /// Whether this server plays at a place. Where several servers share a database one of them does.
    fn has(&self, _place: Place) -> bool {
        true
    }

    /// Takes a place unless another server has it; whether this one has it now. What is read later has all that another server
    /// has written there.
    fn take(&self, _place: Place) -> Reply<'_, bool> {
        std::future::ready(Ok(true)).boxed()
    }

    /// Finds an episode.
    fn episode(&self, id: EpisodeId) -> Reply<'_, Option<StoredEpisode>>;

    /// All episodes that have not ended; those with a round clock first.
    fn unfinished(&self) -> Reply<'_, Vec<Unfinished>>;

    /// The holders of seats of an episode with their seats, in order of their numbers; empty where the creator
    /// holds all.
    fn holders(&self, episode: EpisodeKey) -> Reply<'_, Vec<Held>>;

    /// The competition and the entrant whose attempt a run is, or its practice with a key that was made for the competition.
    fn entrant(&self, run: RunKey) -> Reply<'_, Option<(CompetitionKey, OwnerKey)>>;

    /// The public id of a key.
    fn key_id(&self, owner: OwnerKey) -> Reply<'_, Option<String>>;

    /// The acts of the rounds `from..to` by round, without `response` and `reasoning`: no state follows from
    /// these, and they may be large.
    fn acts(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<(u32, RoundActs)>>;

    /// The acts of one round, whole.
    fn round_acts(&self, episode: EpisodeKey, round: u32) -> Reply<'_, RoundActs>;

    /// What one seat did in one round.
    fn act(&self, episode: EpisodeKey, round: u32, agent: AgentId) -> Reply<'_, Option<StoredAct>>;

    /// The resolved rounds `from..to`.
    fn rounds(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<StoredRound>>;
}
