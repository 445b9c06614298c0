//! The interface between episodes and the store: ordered entries in, journals out.

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

pub type Reply<'a, T> = BoxFuture<'a, Result<T, StoreError>>;

/// Called once entries are durable, or with the error that prevents it.
pub type Committed = Box<dyn FnOnce(Result<(), StoreError>) + Send>;

/// Calls `append` at once; the future completes when the entries are durable.
pub fn committed(append: impl FnOnce(Committed)) -> Reply<'static, ()> {
    let (done, kept) = tokio::sync::oneshot::channel();
    append(Box::new(move |result| drop(done.send(result))));
    async move { kept.await.unwrap_or(Err(StoreError::Stopped(Stopped::Writer))) }.boxed()
}

#[derive(Clone, Debug)]
pub struct StoredEpisode {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// Key that created the episode.
    pub owner: Option<OwnerKey>,
    pub run: Option<RunKey>,
    /// Whether the episode was sealed and is now public.
    pub revealed: bool,
    /// Close of the attempt's window, from which on the owner can read the ended game even while it is sealed.
    pub own_from: Option<Timestamp>,
    pub opening: RawRecord,
    /// First round played in this episode; a fork shares earlier ones with its parent.
    pub first_round: u32,
    /// Record of the seats' holders, written once all seats are held.
    pub seating: Option<RawRecord>,
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    pub status: String,
    /// Name of the ending.
    pub reason: Option<String>,
    /// End record of an ended episode; `None` in summaries. Large end records come without the acts of the open round.
    pub end: Option<RawRecord>,
    /// Chain head after the last stored record.
    pub head: Head,
    /// Bytes of all acts; known once the episode has ended.
    pub act_bytes: Option<u64>,
    pub rounds: u32,
    /// Score after `rounds` rounds.
    pub score: f64,
    /// Whether somebody declared that a person plays.
    pub has_people: bool,
    /// Scores in equal steps of rounds; only in lists, and only of an ended episode.
    pub curve: Option<Vec<f64>>,
    pub created_at: Timestamp,
    /// Time of the newest record; in summaries, time of creation.
    pub newest_at: Timestamp,
    /// Time of the last act, or else of the manual start; `None` in summaries.
    pub last_act_at: Option<Timestamp>,
    pub ended_at: Option<Timestamp>,
    pub void_reason: Option<String>,
}

#[derive(Clone, Debug)]
pub struct Unfinished {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// Key that created the episode.
    pub owner: Option<OwnerKey>,
    pub run: Option<RunKey>,
    /// Whether rounds have a deadline.
    pub clocked: bool,
    /// Settings and number of resolved rounds, which determine the cost of recovery; only for clocked episodes.
    pub played: Option<(RecordedConfig, u32)>,
}

/// Acts of one round in order of seats.
pub type RoundActs = Vec<(AgentId, StoredAct)>;

#[derive(Clone, Debug)]
pub struct StoredAct {
    pub record: ActRecord,
    /// Size of the stored record.
    pub bytes: u64,
    /// Number of seats without an act after this one.
    pub waiting_for: u32,
}

#[derive(Clone, Debug)]
pub struct StoredRound {
    pub round: u32,
    /// Digest of the state after the round.
    pub digest: [u8; 32],
    /// Score after the round.
    pub score: f64,
    /// Chain head after the round.
    pub head: Head,
}

/// Storage of journals. Appended entries become durable in the order of the calls.
pub trait EpisodeStore: Send + Sync + 'static {
    /// Queues entries, which are committed all or none; then calls `committed`. Never blocks.
    fn append(&self, entries: Vec<Entry>, committed: Committed);

    /// Queues entries and waits until they and all entries appended before are durable; without entries it is a barrier.
    /// Entries appended later may be durable first. Dropping the future does not cancel the commit.
    fn keep(&self, entries: Vec<Entry>) -> Reply<'_, ()> {
        committed(|committed| self.append(entries, committed))
    }

    /// Accepts entries of an episode again. After a refused entry all later ones of its episode are refused, as they would
    /// leave a gap. The caller makes sure that the old actor has ended and all of its entries were answered.
    fn recovered(&self, _episode: EpisodeKey) {}

    /// Whether this server owns a place. In a cluster, each place has at most one owner.
    fn has(&self, _place: Place) -> bool {
        true
    }

    /// Takes a place unless another server owns it; returns whether this server owns it now. Later reads include everything
    /// that a former owner has written there.
    fn take(&self, _place: Place) -> Reply<'_, bool> {
        std::future::ready(Ok(true)).boxed()
    }

    fn episode(&self, id: EpisodeId) -> Reply<'_, Option<StoredEpisode>>;

    /// All unfinished episodes, clocked ones first.
    fn unfinished(&self) -> Reply<'_, Vec<Unfinished>>;

    /// Holders with their seats, in order of their numbers; empty where the creator holds all seats.
    fn holders(&self, episode: EpisodeKey) -> Reply<'_, Vec<Held>>;

    /// Competition and entrant of an attempt, or of practice with a key made for the competition.
    fn entrant(&self, run: RunKey) -> Reply<'_, Option<(CompetitionKey, OwnerKey)>>;

    /// Public id of a key.
    fn key_id(&self, owner: OwnerKey) -> Reply<'_, Option<String>>;

    /// Acts of the rounds `from..to` by round, without `response` and `reasoning`, which may be large and do not affect the
    /// state.
    fn acts(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<(u32, RoundActs)>>;

    /// Complete acts of one round.
    fn round_acts(&self, episode: EpisodeKey, round: u32) -> Reply<'_, RoundActs>;

    fn act(&self, episode: EpisodeKey, round: u32, agent: AgentId) -> Reply<'_, Option<StoredAct>>;

    /// Resolved rounds `from..to`.
    fn rounds(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<StoredRound>>;
}
