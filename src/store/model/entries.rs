//! What is written: each entry is a row, or a change of one.

use jiff::Timestamp;
use swarmbench_engine::{AgentId, Seed};

use crate::ids::{CompetitionKey, EntryKey, EpisodeId, EpisodeKey, RunKey, TokenHash};
use crate::keys::{KeyRow, OwnerKey};
use crate::store::metrics::MetricsRow;
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, RawRecord, Source};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::import::ImportConfig;

/// One change of the database.
#[derive(Clone, Debug)]
pub enum Entry {
    Open(Box<OpeningRow>),
    /// The acts and rounds of these forks come in this commit and in later ones; an [`Entry::Open`] each comes with the last.
    BeginForks(Vec<EpisodeKey>),
    Start {
        episode: EpisodeKey,
        at: Timestamp,
    },
    /// What a seat did in a round, or that its clock ran out.
    Act(ActRow),
    Round(RoundRow),
    End(EndRow),
    Claim(Box<ClaimRow>),
    /// All seats are claimed: the final record of their holders.
    Seat(SeatingRow),
    /// New tokens in place of those that a holder of seats had for some of them.
    ReplaceTokens {
        episode: EpisodeKey,
        /// The number of the claim; none for the creator.
        holder: Option<u32>,
        /// The first and the last of these agents; the token of all seats is that of agent -1.
        agents: (i64, i64),
        /// The holder's tokens for them from now on.
        tokens: Vec<TokenRow>,
    },
    AddKey(Box<KeyRow>),
    /// A key is good for nothing any more; nor are the tokens of running runs of a team, where it is that of a member.
    RevokeKey {
        /// The public id of the key.
        id: String,
        at: Timestamp,
    },
    /// A game that was read from files.
    Import {
        game: Box<ImportRow>,
        at: Timestamp,
    },
    OpenRun(Box<RunRow>),
    /// The end of a run; one that has ended is left as it is.
    EndRun {
        run: RunKey,
        /// The name of how it ended.
        status: &'static str,
        at: Timestamp,
    },
    /// A new token in place of the one that a run had.
    ReplaceRunToken {
        run: RunKey,
        /// The hash of its token from now on.
        hash: TokenHash,
    },
    /// An episode was voided after a fault of the server: it counts nowhere. Voiding it again keeps the first reason.
    VoidEpisode {
        episode: EpisodeKey,
        reason: String,
        at: Timestamp,
    },
    /// A run was voided after a fault of the server: it does not count as an attempt. Voiding it again keeps the first reason.
    VoidRun {
        run: RunKey,
        reason: String,
        at: Timestamp,
    },
    AddCompetition(Box<CompetitionRow>),
    AddEntrant(Box<EntrantRow>),
    /// What an organizer decided about an entrant.
    SetEntrant {
        entry: EntryKey,
        /// The name of its status from now on.
        status: &'static str,
        reason: Option<String>,
        /// Whether an organizer vouches for its model.
        vouched: bool,
    },
    /// What else is stored of an entrant, from now on.
    DescribeEntrant(Box<EntrantFacts>),
    /// An entrant has another name from now on.
    RenameEntrant {
        entry: EntryKey,
        name: String,
        /// Whether it renamed itself, which counts towards the maximum.
        by_itself: bool,
    },
    /// The name of an entrant, and from where it came, are erased. The published file of a competition that is over keeps its name.
    EraseEntrant {
        entry: EntryKey,
        /// The name in place of the erased one.
        name: String,
        at: Timestamp,
    },
    /// A key gets a new token in place of the one that was lost.
    ReplaceKey {
        id: String,
        /// The hash of its token from now on.
        hash: TokenHash,
    },
    /// What an organizer changed about a competition.
    ChangeCompetition {
        competition: CompetitionKey,
        /// JSON: what is decided about it from now on.
        definition: String,
        closes_at: Timestamp,
        /// Whether it is in no list but the organizers'.
        hidden: bool,
    },
    /// The running attempts with this number may be played until then.
    ExtendAttempts {
        competition: CompetitionKey,
        number: u32,
        closes_at: Timestamp,
    },
    /// A competition was cancelled. Cancelling it again keeps the first reason.
    CancelCompetition {
        competition: CompetitionKey,
        reason: String,
        at: Timestamp,
    },
    AddInvitations {
        competition: CompetitionKey,
        /// The hash of each code, and what the organizer calls it.
        codes: Vec<(TokenHash, String)>,
        at: Timestamp,
    },
    /// Invitation codes that nobody has used are good for nobody any more.
    RevokeInvitations {
        hashes: Vec<TokenHash>,
        at: Timestamp,
    },
    /// A competition, and all its episodes, are open to all from now on.
    Reveal {
        competition: CompetitionKey,
        at: Timestamp,
    },
    /// A game that has ended was measured, or cannot be.
    Measured {
        /// Its number in the queue, if it was taken from there.
        number: Option<i64>,
        metrics: Option<Box<MetricsRow>>,
    },
    /// What an organizer did.
    Audit(Box<AuditRow>),
}

impl Entry {
    /// The episode whose journal it continues, if any: after a refused entry, later ones would leave a gap.
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

    /// About how many rows of the database it changes.
    pub fn rows(&self) -> usize {
        match self {
            Self::Open(row) => 1 + row.tokens.len(),
            Self::ReplaceTokens { tokens, .. } => 2 * tokens.len(),
            Self::Import { game, .. } => game.rounds.len(),
            Self::AddInvitations { codes, .. } => codes.len(),
            Self::RevokeInvitations { hashes, .. } => hashes.len(),
            _ => 1,
        }
    }

    /// About how many bytes it takes in the queue of the writer.
    pub fn bytes(&self) -> usize {
        let text = match self {
            Self::Open(row) => row.record.as_str().len() + row.tokens.len() * size_of::<TokenRow>(),
            Self::Act(row) => {
                let brief = row.brief.as_ref().map_or(0, |brief| brief.as_str().len());
                row.record.as_str().len() + brief
            }
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
            Self::Measured { metrics: Some(row), .. } => row.measured.len(),
            Self::BeginForks(episodes) => episodes.len() * size_of::<EpisodeKey>(),
            Self::AddInvitations { codes, .. } => codes.len() * size_of::<(TokenHash, String)>(),
            Self::RevokeInvitations { hashes, .. } => hashes.len() * size_of::<TokenHash>(),
            Self::ChangeCompetition { definition, .. } => definition.len(),
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

#[derive(Clone, Debug)]
pub struct CompetitionRow {
    pub id: String,
    /// JSON: what was decided about it.
    pub definition: String,
    pub salt: Secret,
    /// Its sealed seeds, one after the other.
    pub seeds: Secret,
    /// What is published of both.
    pub commitment: [u8; 32],
    pub opens_at: Timestamp,
    pub closes_at: Timestamp,
    pub at: Timestamp,
}

#[derive(Clone, Debug)]
pub struct EntrantRow {
    pub id: String,
    pub competition: CompetitionKey,
    /// The public id of the key to which it belongs.
    pub owner: String,
    pub name: String,
    pub model: String,
    /// JSON: what it declared of who plays.
    pub declaration: String,
    /// Tells prompt templates apart; none for the built-in one.
    pub template: Option<String>,
    /// Whether an organizer vouches for its model.
    pub vouched: bool,
    /// The hash of the invitation code that it uses up, if any.
    pub invitation: Option<TokenHash>,
    /// The address or network from which it registered, for organizers.
    pub address: Option<String>,
    pub category: Option<String>,
    /// The version of the terms that it accepts.
    pub terms: Option<u32>,
    /// How organizers reach it.
    pub contact: Option<String>,
    pub at: Timestamp,
}

/// What an entrant, or an organizer, may change of it beside its name and its status.
#[derive(Clone, Debug)]
pub struct EntrantFacts {
    pub entry: EntryKey,
    pub category: Option<String>,
    /// The version of the terms that it accepted.
    pub terms: Option<u32>,
    /// How organizers reach it.
    pub contact: Option<String>,
}

#[derive(Clone, Debug)]
pub struct RunRow {
    pub run: RunKey,
    pub id: String,
    /// The key with which it is created; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    pub suite: String,
    pub digest: String,
    /// JSON: what was decided about it.
    pub definition: String,
    pub model: String,
    /// Who may see it before its end, as for its episodes.
    pub visibility: &'static str,
    /// Of an attempt in a competition: the entry, and the attempt's number, from 1.
    pub attempt: Option<(EntryKey, u32)>,
    /// The voided attempt that it plays again, where its seeds are spare ones.
    pub replays: Option<u32>,
    /// The end of its window, if it has one.
    pub closes_at: Option<Timestamp>,
    pub at: Timestamp,
    /// The key by which a repeated creation finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
    /// The hash of its token; `None` where the server itself plays.
    pub token: Option<TokenHash>,
}

/// What an organizer did.
#[derive(Clone, Debug)]
pub struct AuditRow {
    pub at: Timestamp,
    /// The id of the key, or `local` for work on the server's own machine.
    pub who: String,
    /// What was done, like `key.create`.
    pub action: &'static str,
    /// The id of what it was done to.
    pub subject: String,
    /// Further details, as JSON.
    pub detail: serde_json::Value,
    /// The competition that it concerns, and what everybody may see of the details.
    pub shown: Option<(CompetitionKey, serde_json::Value)>,
}

#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a column")]
pub struct OpeningRow {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// The key with which it is created; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, and which game of the run's plan it is.
    pub run: Option<(RunKey, u32)>,
    /// The parent of a fork, and how many rounds of it were taken over.
    pub fork: Option<(EpisodeKey, u32)>,
    pub record: RawRecord,
    /// The head of the chain before the first round of its own.
    pub head: Head,
    /// What lists filter by.
    pub task: &'static str,
    /// What lists filter by.
    pub model: String,
    /// Who reads it before the end.
    pub visibility: &'static str,
    /// Whether it waits for a manual start.
    pub waiting: bool,
    /// Whether seats of it can be claimed.
    pub has_open_seats: bool,
    /// Whether its owner reads it once it has ended, also while it is sealed.
    pub own_games: bool,
    /// Whether its rounds have a deadline; those are recovered first.
    pub clocked: bool,
    pub at: Timestamp,
    /// The key by which a repeated creation finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
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
    pub model: String,
    /// Further declarations about the player.
    pub agent_meta: Carried,
    /// The built-in player that the server hosts on these seats.
    pub player: Option<String>,
    /// When the seats were claimed.
    pub at: Timestamp,
}

pub type Held = (Holder, Vec<AgentId>);

/// Seats that have a holder now.
#[derive(Clone, Debug)]
pub struct ClaimRow {
    pub episode: EpisodeKey,
    pub holder: Holder,
    /// The seats; empty where the creator holds all of them, which needs no rows.
    pub agents: Vec<AgentId>,
    pub tokens: Vec<TokenRow>,
    /// The key by which a repeated claim finds it, and the hash of the body that came with it.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// The final record of who holds which seat of an episode.
#[derive(Clone, Debug)]
pub struct SeatingRow {
    pub episode: EpisodeKey,
    pub record: RawRecord,
    /// The head of the chain after it.
    pub head: Head,
}

/// A token, as far as it is stored.
#[derive(Clone, Copy, Debug)]
pub struct TokenRow {
    pub hash: TokenHash,
    /// The seat that it authorizes; none for several seats of the episode.
    pub agent: Option<AgentId>,
    /// Which holder's seats those are, by the number of the claim; none for the creator's.
    pub holder: Option<u32>,
}

/// What a seat did in a round.
#[derive(Clone, Debug)]
pub struct ActRow {
    pub episode: EpisodeKey,
    pub round: u32,
    pub agent: AgentId,
    /// How many seats the round waited for after this act.
    pub waiting_for: u32,
    /// Who decided.
    pub source: Source,
    pub at: Timestamp,
    pub record: RawRecord,
    /// What is read in place of a large record by whoever needs none of its texts; see [`brief_of`].
    pub brief: Option<RawRecord>,
}

/// Records of more bytes are stored a second time without their texts, if they have any. Those of fewer are read as they
/// are, which costs less.
const WHOLE_BYTES_MAX: usize = 512;

/// What is stored beside a record: where it is large, the same without its texts, which `brief` gives; none if it has no texts.
pub fn brief_of(
    record: &RawRecord,
    brief: impl FnOnce() -> Option<ActRecord>,
) -> Option<RawRecord> {
    let is_large = record.as_str().len() > WHOLE_BYTES_MAX;
    is_large.then(brief).flatten().map(|brief| RawRecord::write(&brief))
}

/// Who decided, as the table of acts has it.
pub(in crate::store) const fn source_code(source: Source) -> u8 {
    match source {
        Source::Player => 0,
        Source::Clock => 1,
    }
}

/// A resolved round; its acts are rows of their own.
#[derive(Clone, Debug)]
pub struct RoundRow {
    pub episode: EpisodeKey,
    pub round: u32,
    /// The digest of the state after it.
    pub digest: [u8; 32],
    /// The score after it.
    pub score: f64,
    /// The head of the chain after it.
    pub head: Head,
    pub at: Timestamp,
}

#[derive(Clone, Debug)]
pub struct EndRow {
    pub episode: EpisodeKey,
    /// `finished`, `aborted` or `abandoned`.
    pub status: &'static str,
    /// Why; the name of an ending.
    pub reason: &'static str,
    pub record: RawRecord,
    /// The head of the whole chain.
    pub head: Head,
    /// Bytes that its acts take.
    pub bytes: u64,
    pub score: f64,
    pub rounds: u32,
    pub seed: Seed,
    pub tally: Tally,
    /// Whether boards count it: it belongs to a run, or several holders played it.
    pub counts: bool,
    pub at: Timestamp,
}

/// A game as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportRow {
    /// Its public id; it follows from the digest.
    pub id: String,
    /// Of its name, its settings and its states.
    pub digest: [u8; 32],
    /// As its files call it.
    pub run_id: String,
    /// Its entry in the index, as JSON.
    pub meta: String,
    pub model: String,
    pub task: String,
    pub seed: u64,
    /// The settings that make games comparable.
    pub settings: ImportConfig,
    /// The score after the last round.
    pub score: f64,
    pub resolved: u32,
    pub acts: u64,
    /// Its states, the layout first.
    pub rounds: Vec<ImportedRound>,
}

/// A state, and what was done in it.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedRound {
    /// How many rounds were resolved; also the round that was decided in this state.
    pub round: u32,
    pub score: f64,
    /// The state, as JSON.
    pub state: String,
    pub acts: Option<Vec<u8>>,
}

impl ImportedRound {
    /// As they are stored.
    pub fn bytes(&self) -> u64 {
        (self.state.len() + self.acts.as_ref().map_or(0, Vec::len)) as u64
    }
}
