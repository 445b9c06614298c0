//! What is written: each entry is a row, or a change of one.

use jiff::Timestamp;
use swarmbench_engine::AgentId;

use crate::ids::{CompetitionKey, EntryKey, EpisodeId, EpisodeKey, RunKey, TokenHash};
use crate::journal::Tally;
use crate::journal::chain::Head;
use crate::journal::record::RawRecord;
use crate::keys::{KeyRow, OwnerKey};
use crate::store::imports::ImportRow;

/// One change of the database.
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
    /// A claim of seats.
    Claim(Box<ClaimRow>),
    /// All seats are claimed: the final record of their holders.
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
    /// A new key.
    AddKey(Box<KeyRow>),
    /// A key is revoked.
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
        /// The name of how it ended.
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
        /// Whether an organizer vouches for its model.
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
    /// The episode whose journal it continues, if any: after a refused entry, later ones would leave a gap.
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

    /// About how many bytes it takes in the queue of the writer.
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
    /// Whether an organizer vouches for its model.
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
    /// The key with which it is created; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    /// The suite's name.
    pub suite: String,
    /// The suite's digest.
    pub digest: String,
    /// JSON: what was decided about it.
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
    /// The hash of its token; `None` where the server itself plays.
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
    /// Further details, as JSON.
    pub detail: serde_json::Value,
}

/// A new episode.
#[derive(Clone, Debug)]
pub struct OpeningRow {
    /// Its number.
    pub episode: EpisodeKey,
    /// Its public id.
    pub id: EpisodeId,
    /// The key with which it is created; `None` on a server without keys.
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
    /// The holder's key; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    /// The public id of that key.
    pub key: Option<String>,
    /// Who plays.
    pub model: String,
    /// Further declarations about the player.
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
    /// The seats; empty where the creator holds all of them, which needs no rows.
    pub agents: Vec<AgentId>,
    /// Their tokens.
    pub tokens: Vec<TokenRow>,
    /// The key by which a repeated claim finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// The final record of who holds which seat of an episode.
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
