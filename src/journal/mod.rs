//! The journal: all that is stored of an episode, enough to replay it.
//!
//! An episode is its journal: the opening (configuration, rules, prompt template), every round's
//! acts with the digest of the state after them, and the end, in a chain of hashes. States, scores
//! and observations are recomputed from it.

mod import;

use std::sync::Arc;

use futures::future::BoxFuture;
use jiff::Timestamp;
use swarmbench_engine::AgentId;

use crate::ids::{EpisodeId, TokenHash};
use crate::keys::{KeyRow, OwnerKey};
use chain::Head;
pub use import::{ImportHash, ImportKey, ImportRow, ImportedGame, ImportedRound, StoredImport};
use record::{ActRecord, RawRecord, RecordedConfig};
pub use swarmbench_journal::{Tally, chain, record, replay};

/// The number of an episode in its journal; short, and never shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EpisodeKey(pub i64);

/// The number of a run in the database; short, and never shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RunKey(pub i64);

/// The number of an entry in a competition; short, and never shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EntryKey(pub i64);

/// The number of a competition in the database; short, and never shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CompetitionKey(pub i64);

/// One thing to be kept.
#[derive(Clone, Debug)]
pub enum Entry {
    /// A new episode.
    Open(Box<OpeningRow>),
    /// A manual start.
    Start {
        /// The episode.
        episode: EpisodeKey,
        /// When.
        at: Timestamp,
    },
    /// What a seat did in a round, or that its clock ran out.
    Act(ActRow),
    /// A resolved round.
    Round(RoundRow),
    /// The end of an episode.
    End(EndRow),
    /// Seats have a holder.
    Claim(Box<ClaimRow>),
    /// All seats have one: who holds which, for good.
    Seat(SeatingRow),
    /// New tokens in place of all that a holder of seats had.
    ReplaceTokens {
        /// The episode.
        episode: EpisodeKey,
        /// The number of the claim; none for the creator.
        holder: Option<u32>,
        /// All the holder's tokens from now on.
        tokens: Vec<TokenRow>,
    },
    /// A new key for somebody.
    AddKey(Box<KeyRow>),
    /// A key is worth nothing any more.
    RevokeKey {
        /// The public id of the key.
        id: String,
        /// When.
        at: Timestamp,
    },
    /// A game that was read from files.
    Import {
        /// The game.
        game: Box<ImportRow>,
        /// When.
        at: Timestamp,
    },
    /// A new run.
    OpenRun(Box<RunRow>),
    /// The end of a run; one that has ended is left as it is.
    EndRun {
        /// The run.
        run: RunKey,
        /// The name of a [`RunStatus`](crate::run::RunStatus).
        status: &'static str,
        /// When.
        at: Timestamp,
    },
    /// A new token in place of the one that a run had.
    ReplaceRunToken {
        /// The run.
        run: RunKey,
        /// The hash of its token from now on.
        hash: TokenHash,
    },
    /// An episode was voided after a fault of the server: it counts nowhere. Voiding it again keeps the first reason.
    VoidEpisode {
        /// The episode.
        episode: EpisodeKey,
        /// What happened.
        reason: String,
        /// When.
        at: Timestamp,
    },
    /// A run was voided after a fault of the server: it does not count as an attempt. Voiding it again keeps the first reason.
    VoidRun {
        /// The run.
        run: RunKey,
        /// What happened.
        reason: String,
        /// When.
        at: Timestamp,
    },
    /// A new competition.
    AddCompetition(Box<CompetitionRow>),
    /// A new entrant of a competition.
    AddEntrant(Box<EntrantRow>),
    /// What an organizer decided about an entrant.
    SetEntrant {
        /// The entrant.
        entry: EntryKey,
        /// The name of its status from now on.
        status: &'static str,
        /// Why it is so.
        reason: Option<String>,
        /// Whether somebody answers for its model.
        vouched: bool,
    },
    /// New invitation codes.
    AddInvitations {
        /// The competition.
        competition: CompetitionKey,
        /// The hash of each code, and what the organizer calls it.
        codes: Vec<(TokenHash, String)>,
        /// When.
        at: Timestamp,
    },
    /// A competition, and all its episodes, are open to all from now on.
    Reveal {
        /// The competition.
        competition: CompetitionKey,
        /// When.
        at: Timestamp,
    },
    /// What an organizer did.
    Audit(Box<AuditRow>),
}

impl Entry {
    /// The episode whose chain of records it continues, or on whose journal later records rest.
    #[must_use]
    pub fn chain(&self) -> Option<EpisodeKey> {
        match self {
            Self::Open(row) => Some(row.episode),
            Self::Start { episode, .. } => Some(*episode),
            Self::Act(row) => Some(row.episode),
            Self::Round(row) => Some(row.episode),
            Self::End(row) => Some(row.episode),
            Self::Claim(row) => Some(row.episode),
            Self::Seat(row) => Some(row.episode),
            _ => None,
        }
    }

    /// About how many bytes it takes while it waits to be written.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let text = match self {
            Self::Open(row) => row.record.as_str().len() + row.tokens.len() * size_of::<TokenRow>(),
            Self::Act(row) => row.record.as_str().len(),
            Self::End(row) => row.record.as_str().len(),
            Self::Seat(row) => row.record.as_str().len(),
            Self::OpenRun(row) => row.definition.len(),
            Self::AddCompetition(row) => row.definition.len() + row.seeds.0.len(),
            Self::AddEntrant(row) => row.declaration.len(),
            Self::Import { game, .. } => game
                .rounds
                .iter()
                .map(|round| round.state.len() + round.acts.as_ref().map_or(0, Vec::len))
                .sum(),
            Self::AddInvitations { codes, .. } => codes.len() * size_of::<(TokenHash, String)>(),
            _ => 0,
        };
        size_of::<Self>() + text
    }
}

/// Bytes that `Debug` does not show.
#[derive(Clone)]
pub struct Secret(pub Vec<u8>);

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret(…)")
    }
}

/// A new competition.
#[derive(Clone, Debug)]
pub struct CompetitionRow {
    /// Its public id.
    pub id: String,
    /// JSON: what was decided about it.
    pub definition: String,
    /// The salt of its commitment.
    pub salt: Secret,
    /// Its sealed seeds, one after the other.
    pub seeds: Secret,
    /// What is published of both.
    pub commitment: [u8; 32],
    /// When it opens.
    pub opens_at: Timestamp,
    /// When it closes.
    pub closes_at: Timestamp,
    /// When it was created.
    pub at: Timestamp,
}

/// A new entrant of a competition.
#[derive(Clone, Debug)]
pub struct EntrantRow {
    /// Its public id.
    pub id: String,
    /// The competition.
    pub competition: CompetitionKey,
    /// The public id of the key to which it belongs.
    pub owner: String,
    /// The name that is shown.
    pub name: String,
    /// The model's name.
    pub model: String,
    /// JSON: what it declared of who plays.
    pub declaration: String,
    /// Tells prompt templates apart; none for the built-in one.
    pub template: Option<String>,
    /// Whether somebody answers for its model.
    pub vouched: bool,
    /// The hash of the invitation code that it uses up, if any.
    pub invitation: Option<TokenHash>,
    /// When it registered.
    pub at: Timestamp,
}

/// A new run.
#[derive(Clone, Debug)]
pub struct RunRow {
    /// Its number.
    pub run: RunKey,
    /// Its public id.
    pub id: String,
    /// The key with which it is created; none where nobody had to show one.
    pub owner: Option<OwnerKey>,
    /// The suite's name.
    pub suite: String,
    /// The suite's digest.
    pub digest: String,
    /// JSON: a [`Definition`](crate::run::definition::Definition).
    pub definition: String,
    /// The model's name.
    pub model: String,
    /// Who may see it before its end, as for its episodes.
    pub visibility: &'static str,
    /// Of an attempt in a competition: the entry, and the attempt's number, from 1.
    pub attempt: Option<(EntryKey, u32)>,
    /// When it was created.
    pub at: Timestamp,
    /// The key by which a repeated creation finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
    /// The hash of its token; none where the server itself plays.
    pub token: Option<TokenHash>,
}

/// What an organizer did.
#[derive(Clone, Debug)]
pub struct AuditRow {
    /// When.
    pub at: Timestamp,
    /// The id of the key, or `local` for work on the server's own machine.
    pub who: String,
    /// What was done, like `key.create`.
    pub action: &'static str,
    /// The id of what it was done to.
    pub subject: String,
    /// What else is to be known, as JSON.
    pub detail: serde_json::Value,
}

/// A new episode.
#[derive(Clone, Debug)]
pub struct OpeningRow {
    /// Its number.
    pub episode: EpisodeKey,
    /// Its public id.
    pub id: EpisodeId,
    /// The key with which it is created; none where nobody had to show one.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, and which game of the run's plan it is.
    pub run: Option<(RunKey, u32)>,
    /// The opening record, to the byte.
    pub record: RawRecord,
    /// The head of its chain.
    pub head: Head,
    /// What lists filter by.
    pub task: &'static str,
    /// What lists filter by.
    pub model: String,
    /// Who reads it before the end.
    pub visibility: &'static str,
    /// Whether it waits for a manual start.
    pub waiting: bool,
    /// Whether its rounds have a deadline; those are recovered first.
    pub clocked: bool,
    /// When it was created.
    pub at: Timestamp,
    /// The key by which a repeated creation finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
    /// Its tokens.
    pub tokens: Vec<TokenRow>,
}

/// Who holds seats of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Holder {
    /// The number of the claim in its episode; 0 is the creator.
    pub number: u32,
    /// The holder's key; none where nobody had to show one.
    pub owner: Option<OwnerKey>,
    /// The public id of that key.
    pub key: Option<String>,
    /// Who plays.
    pub model: String,
    /// What else was told of who plays.
    pub agent_meta: serde_json::Map<String, serde_json::Value>,
    /// The built-in player that the server hosts on these seats.
    pub player: Option<String>,
    /// When the seats were claimed.
    pub at: Timestamp,
}

/// A holder, and the seats.
pub type Held = (Holder, Vec<AgentId>);

/// Seats that have a holder now.
#[derive(Clone, Debug)]
pub struct ClaimRow {
    /// The episode.
    pub episode: EpisodeKey,
    /// Who holds them.
    pub holder: Holder,
    /// The seats; none where the creator alone has seats, which needs no rows.
    pub agents: Vec<AgentId>,
    /// Their tokens.
    pub tokens: Vec<TokenRow>,
    /// The key by which a repeated claim finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// Who holds which seat of an episode, for good.
#[derive(Clone, Debug)]
pub struct SeatingRow {
    /// The episode.
    pub episode: EpisodeKey,
    /// The record, to the byte.
    pub record: RawRecord,
    /// The head of the chain after it.
    pub head: Head,
}

/// A token, as far as it is stored.
#[derive(Clone, Copy, Debug)]
pub struct TokenRow {
    /// The hash of the token.
    pub hash: TokenHash,
    /// The seat that it authorizes; none for several seats of the episode.
    pub agent: Option<AgentId>,
    /// Which holder's seats those are, by the number of the claim; none for the creator's.
    pub holder: Option<u32>,
}

/// What a seat did in a round.
#[derive(Clone, Debug)]
pub struct ActRow {
    /// The episode.
    pub episode: EpisodeKey,
    /// The round.
    pub round: u32,
    /// The seat.
    pub agent: AgentId,
    /// How many seats the round waited for after this act.
    pub waiting_for: u32,
    /// When it came.
    pub at: Timestamp,
    /// The record, to the byte.
    pub record: RawRecord,
}

/// A resolved round; its acts are rows of their own.
#[derive(Clone, Debug)]
pub struct RoundRow {
    /// The episode.
    pub episode: EpisodeKey,
    /// The round.
    pub round: u32,
    /// The digest of the state after it.
    pub digest: [u8; 32],
    /// The score after it.
    pub score: f64,
    /// The head of the chain after it.
    pub head: Head,
    /// When it was resolved.
    pub at: Timestamp,
}

/// The end of an episode.
#[derive(Clone, Debug)]
pub struct EndRow {
    /// The episode.
    pub episode: EpisodeKey,
    /// `finished`, `aborted` or `abandoned`.
    pub status: &'static str,
    /// Why; the name of an ending.
    pub reason: &'static str,
    /// The end record, to the byte.
    pub record: RawRecord,
    /// The head of the whole chain.
    pub head: Head,
    /// Bytes that its acts take.
    pub bytes: u64,
    /// The final score.
    pub score: f64,
    /// How many rounds were resolved.
    pub rounds: u32,
    /// What its acts were.
    pub tally: Tally,
    /// Whether boards count it: it belongs to a run, or several holders played it.
    pub counts: bool,
    /// When it ended.
    pub at: Timestamp,
}

/// The journal could not keep or read something: the host's fault, never a player's.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the journal failed: {0}")]
pub struct JournalError(pub Arc<str>);

impl JournalError {
    const BUSY: &'static str = "too many read at once";

    /// Nothing is broken; too many others read at the moment.
    #[must_use]
    pub fn busy() -> Self {
        Self(Self::BUSY.into())
    }

    /// Whether the same will work later.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        &*self.0 == Self::BUSY
    }
}

/// Told once entries are durable, or that they will never be.
pub type Committed = Box<dyn FnOnce(Result<(), JournalError>) + Send>;

/// An episode as it is stored.
#[derive(Clone, Debug)]
pub struct StoredEpisode {
    /// Its number.
    pub episode: EpisodeKey,
    /// Its public id.
    pub id: EpisodeId,
    /// The key with which it was created, if any.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, if any.
    pub run: Option<RunKey>,
    /// Whether it was sealed and is open to all now.
    pub revealed: bool,
    /// The opening record.
    pub opening: RawRecord,
    /// The record of who holds which seat, if there is one.
    pub seating: Option<RawRecord>,
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    pub status: String,
    /// Why it ended, if it has; the name of an ending.
    pub reason: Option<String>,
    /// The end record of an episode that has ended; not told in summaries. Where it is large, the acts of the
    /// open round are left out of it.
    pub end: Option<RawRecord>,
    /// The head of its chain after the last stored record.
    pub head: Head,
    /// How many rounds are resolved.
    pub rounds: u32,
    /// The score after them.
    pub score: f64,
    /// When it was created.
    pub created_at: Timestamp,
    /// When its newest record came; in summaries, when it was created.
    pub newest_at: Timestamp,
    /// When the last act of a player came, or else the manual start; not told in summaries.
    pub last_act_at: Option<Timestamp>,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
    /// Why it was voided, if it was.
    pub void_reason: Option<String>,
}

/// An episode that has not ended.
#[derive(Clone, Debug)]
pub struct Unfinished {
    /// Its number.
    pub episode: EpisodeKey,
    /// Its public id.
    pub id: EpisodeId,
    /// The key with which it was created, if any.
    pub owner: Option<OwnerKey>,
    /// Whether its rounds have a deadline.
    pub clocked: bool,
    /// Of an episode with deadlines, its settings and how many rounds are resolved: what its recovery costs.
    pub played: Option<(RecordedConfig, u32)>,
}

/// Acts of one round, in order of their seats.
pub type RoundActs = Vec<(AgentId, StoredAct)>;

/// A stored act.
#[derive(Clone, Debug)]
pub struct StoredAct {
    /// The record.
    pub record: ActRecord,
    /// Bytes of the whole record as it is stored.
    pub bytes: u64,
    /// How many seats the round waited for after it.
    pub waiting_for: u32,
}

/// A resolved round, as it is stored.
#[derive(Clone, Debug)]
pub struct StoredRound {
    /// The round.
    pub round: u32,
    /// The digest of the state after it.
    pub digest: [u8; 32],
    /// The score after it.
    pub score: f64,
    /// The head of the chain after it.
    pub head: Head,
}

/// A resolved round with all that is stored of it.
#[derive(Clone, Debug)]
pub struct LoggedRound {
    /// The round.
    pub round: u32,
    /// The digest of the state after it.
    pub digest: [u8; 32],
    /// When it was resolved.
    pub at: Timestamp,
    /// Its acts, in order of their seats.
    pub acts: Vec<LoggedAct>,
}

/// An act with the time at which it came.
#[derive(Clone, Debug)]
pub struct LoggedAct {
    /// The seat.
    pub agent: AgentId,
    /// When it came.
    pub at: Timestamp,
    /// The record.
    pub record: ActRecord,
}

/// What keeps journals. Entries become durable in the order in which they were handed over.
pub trait Journal: Send + Sync + 'static {
    /// Keeps entries, all or none, and tells `committed` once they are durable. Never waits.
    fn append(&self, entries: Vec<Entry>, committed: Committed);

    /// Keeps entries and waits until they, and all that was handed over before them, are durable;
    /// without entries it only waits. They are stored also if the caller is gone.
    fn keep(&self, entries: Vec<Entry>) -> BoxFuture<'_, Result<(), JournalError>> {
        let (done, kept) = tokio::sync::oneshot::channel();
        self.append(entries, Box::new(move |result| drop(done.send(result))));
        let stopped = || Err(JournalError("the writer has stopped".into()));
        Box::pin(async move { kept.await.unwrap_or_else(|_| stopped()) })
    }

    /// Takes entries of an episode again, of which one was refused. Until then all later ones are, as they
    /// would leave a gap. To be called when its old actor has ended and all that it handed over was answered.
    fn recovered(&self, _episode: EpisodeKey) {}

    /// Finds an episode.
    fn episode(&self, id: EpisodeId) -> BoxFuture<'_, Result<Option<StoredEpisode>, JournalError>>;

    /// All episodes that have not ended; those with a round clock first.
    fn unfinished(&self) -> BoxFuture<'_, Result<Vec<Unfinished>, JournalError>>;

    /// Everybody who holds seats of an episode, in order of their numbers, with the seats; nobody where
    /// the creator simply holds all.
    fn holders(&self, episode: EpisodeKey) -> BoxFuture<'_, Result<Vec<Held>, JournalError>>;

    /// The competition and the entrant whose attempt a run is, where it is one.
    fn entrant(
        &self,
        run: RunKey,
    ) -> BoxFuture<'_, Result<Option<(CompetitionKey, OwnerKey)>, JournalError>>;

    /// The public id of a key.
    fn key_id(&self, owner: OwnerKey) -> BoxFuture<'_, Result<Option<String>, JournalError>>;

    /// The acts of the rounds `from..to` by round, without `response` and `reasoning`: no state follows from
    /// these, and they may be large.
    fn acts(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> BoxFuture<'_, Result<Vec<(u32, RoundActs)>, JournalError>>;

    /// The acts of one round, whole.
    fn round_acts(
        &self,
        episode: EpisodeKey,
        round: u32,
    ) -> BoxFuture<'_, Result<RoundActs, JournalError>>;

    /// What one seat did in one round.
    fn act(
        &self,
        episode: EpisodeKey,
        round: u32,
        agent: AgentId,
    ) -> BoxFuture<'_, Result<Option<StoredAct>, JournalError>>;

    /// The resolved rounds `from..to`.
    fn rounds(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> BoxFuture<'_, Result<Vec<StoredRound>, JournalError>>;
}
