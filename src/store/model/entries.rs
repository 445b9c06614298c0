//! Entries of the writer: each is a row, or a change of one.

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

/// A change of the database.
#[derive(Clone, Debug)]
pub enum Entry {
    /// A condition, the first entry of a job: the job is refused unless this token or key has rights in its commit.
    CheckToken(TokenHash),
    Open(Box<OpeningRow>),
    /// The first commit of forks. Their acts and rounds come in this commit and in later ones, and an [`Entry::Open`] for each
    /// in the last.
    BeginForks(Vec<EpisodeKey>),
    Start {
        episode: EpisodeKey,
        at: Timestamp,
    },
    /// The act of a seat in a round, or the expiry of its clock.
    Act(ActRow),
    Round(RoundRow),
    End(EndRow),
    Claim(Box<ClaimRow>),
    /// The final record of the holders, when all seats are claimed.
    Seat(SeatingRow),
    /// New tokens of a holder, in place of those for some of its seats.
    ReplaceTokens {
        episode: EpisodeKey,
        /// Number of the claim; `None` for the creator.
        holder: Option<u32>,
        /// First and last of the agents; the token of all seats has the agent -1.
        agents: (i64, i64),
        /// New tokens of the holder for these agents.
        tokens: Vec<TokenRow>,
    },
    AddKey(Box<KeyRow>),
    /// Revocation of a key. It includes the tokens of a team's running runs if the key is that of a member.
    RevokeKey {
        /// Public id of the key.
        id: String,
        at: Timestamp,
    },
    /// A game that was read from files.
    Import {
        game: Box<ImportRow>,
        at: Timestamp,
    },
    OpenRun(Box<RunRow>),
    /// The end of a run; one that has ended stays as it is.
    EndRun {
        run: RunKey,
        /// Name of the ending.
        status: &'static str,
        at: Timestamp,
    },
    /// Continuation of a finished run, one of whose games is played again.
    ReopenRun {
        run: RunKey,
    },
    /// A new token of a run, in place of the old one.
    ReplaceRunToken {
        run: RunKey,
        /// Number of the holder in the run's team; `None` for a run without a team.
        holder: Option<u32>,
        /// Hash of the new token.
        hash: TokenHash,
    },
    /// Voiding of an episode after a fault of the server: it counts nowhere. A repeat keeps the first reason.
    VoidEpisode {
        episode: EpisodeKey,
        reason: String,
        at: Timestamp,
    },
    /// Voiding of a run after a fault of the server: it does not count as an attempt. A repeat keeps the first reason.
    VoidRun {
        run: RunKey,
        reason: String,
        at: Timestamp,
    },
    AddCompetition(Box<CompetitionRow>),
    AddEntrant(Box<EntrantRow>),
    /// An organizer's decision about an entrant.
    SetEntrant {
        entry: EntryKey,
        /// Name of the new status.
        status: &'static str,
        reason: Option<String>,
        /// Whether an organizer vouches for the model.
        vouched: bool,
    },
    /// New values of an entrant's other columns.
    DescribeEntrant(Box<EntrantFacts>),
    /// A rename of an entrant.
    RenameEntrant {
        entry: EntryKey,
        name: String,
        /// Whether the entrant renamed itself, which counts towards the maximum.
        by_itself: bool,
    },
    /// Erasure of the name and address of an entrant. The published file of a competition that is over keeps the name.
    EraseEntrant {
        entry: EntryKey,
        /// Name in place of the erased one.
        name: String,
        at: Timestamp,
    },
    /// A new token of a key, in place of the lost one.
    ReplaceKey {
        id: String,
        /// Hash of the new token.
        hash: TokenHash,
    },
    /// An organizer's change of a competition.
    ChangeCompetition {
        competition: CompetitionKey,
        /// New definition, as JSON.
        definition: String,
        closes_at: Timestamp,
        /// Whether only organizers see the competition in lists.
        hidden: bool,
    },
    /// A later end of the running attempts with this number.
    ExtendAttempts {
        competition: CompetitionKey,
        number: u32,
        closes_at: Timestamp,
    },
    /// Cancellation of a competition. A repeat keeps the first reason.
    CancelCompetition {
        competition: CompetitionKey,
        reason: String,
        at: Timestamp,
    },
    AddInvitations {
        competition: CompetitionKey,
        /// Hash of each code, and its label.
        codes: Vec<(TokenHash, String)>,
        at: Timestamp,
    },
    /// Revocation of unused invitation codes.
    RevokeInvitations {
        hashes: Vec<TokenHash>,
        at: Timestamp,
    },
    /// Publication of a competition and all of its episodes.
    Reveal {
        competition: CompetitionKey,
        at: Timestamp,
    },
    /// The measurement of an ended game, or its failure.
    Measured {
        /// Number in the queue, if the game was taken from there.
        number: Option<i64>,
        metrics: Option<Box<MetricsRow>>,
    },
    /// An action of an organizer.
    Audit(Box<AuditRow>),
}

impl Entry {
    /// Episode whose journal the entry continues. After a refused entry, later ones of the episode would leave a gap.
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

    /// Approximate number of changed rows.
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

    /// Approximate bytes in the queue of the writer.
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
    /// Definition as JSON.
    pub definition: String,
    pub salt: Secret,
    /// Sealed seeds, concatenated.
    pub seeds: Secret,
    /// Published commitment to salt and seeds.
    pub commitment: [u8; 32],
    pub opens_at: Timestamp,
    pub closes_at: Timestamp,
    pub at: Timestamp,
}

#[derive(Clone, Debug)]
pub struct EntrantRow {
    pub id: String,
    pub competition: CompetitionKey,
    /// Public id of the owner's key.
    pub owner: String,
    pub name: String,
    pub model: String,
    /// Declaration of the player, as JSON.
    pub declaration: String,
    /// Digest of the prompt template; `None` for the built-in one.
    pub template: Option<String>,
    /// Whether an organizer vouches for the model.
    pub vouched: bool,
    /// Hash of the invitation code that the entrant uses up.
    pub invitation: Option<TokenHash>,
    /// Address or network of the registration, shown to organizers.
    pub address: Option<String>,
    pub category: Option<String>,
    /// Accepted version of the terms.
    pub terms: Option<u32>,
    /// Contact for organizers.
    pub contact: Option<String>,
    pub at: Timestamp,
}

/// Facts of an entrant that it or an organizer may change, besides name and status.
#[derive(Clone, Debug)]
pub struct EntrantFacts {
    pub entry: EntryKey,
    pub category: Option<String>,
    /// Accepted version of the terms.
    pub terms: Option<u32>,
    /// Contact for organizers.
    pub contact: Option<String>,
}

#[derive(Clone, Debug)]
pub struct RunRow {
    pub run: RunKey,
    pub id: String,
    /// Key of the creator; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    pub suite: String,
    pub digest: String,
    /// Definition as JSON.
    pub definition: String,
    pub model: String,
    /// Readers of the run and its episodes before their end.
    pub visibility: &'static str,
    /// Entry and attempt number, from 1, of an attempt in a competition.
    pub attempt: Option<(EntryKey, u32)>,
    /// Voided attempt that this spare attempt replaces.
    pub replays: Option<u32>,
    /// End of the window, if there is one.
    pub closes_at: Option<Timestamp>,
    pub at: Timestamp,
    /// Idempotency key of the creation, and the hash of its body.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// Action of an organizer in the audit log.
#[derive(Clone, Debug)]
pub struct AuditRow {
    pub at: Timestamp,
    /// Id of the key, or `local` for work on the server's own machine.
    pub who: String,
    /// Kind of the action, such as `key.create`.
    pub action: &'static str,
    /// Id of the object of the action.
    pub subject: String,
    /// Further details.
    pub detail: serde_json::Value,
    /// Competition that the action concerns, and the public part of the details.
    pub shown: Option<(CompetitionKey, serde_json::Value)>,
}

#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a column")]
pub struct OpeningRow {
    pub episode: EpisodeKey,
    pub id: EpisodeId,
    /// Key of the creator; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    /// Run of the episode, and the place of the game in the run's plan.
    pub run: Option<(RunKey, u32)>,
    /// Parent of a fork, and the number of rounds that were taken over.
    pub fork: Option<(EpisodeKey, u32)>,
    pub record: RawRecord,
    /// Chain head before the first round of the episode itself.
    pub head: Head,
    /// Task, a filter of lists.
    pub task: &'static str,
    /// Model, a filter of lists.
    pub model: String,
    /// Readers of the episode before its end.
    pub visibility: &'static str,
    /// Whether the episode waits for a manual start.
    pub waiting: bool,
    /// Whether several holders may have seats.
    pub is_mixed: bool,
    /// Whether the creator declares that a person plays.
    pub has_people: bool,
    /// Whether the owner reads the ended episode while it is sealed.
    pub own_games: bool,
    /// Whether rounds have a deadline; such episodes are recovered first.
    pub clocked: bool,
    pub at: Timestamp,
    /// Idempotency key of the creation, and the hash of its body.
    pub idempotency: Option<(String, [u8; 32])>,
    pub tokens: Vec<TokenRow>,
}

/// Holder of seats of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Holder {
    /// Number of the claim in the episode; 0 is the creator.
    pub number: u32,
    /// Key of the holder; `None` on a server without keys.
    pub owner: Option<OwnerKey>,
    /// Public id of that key.
    pub key: Option<String>,
    pub model: String,
    /// Further declarations about the player.
    pub agent_meta: Carried,
    /// Built-in player that the server hosts on these seats.
    pub player: Option<String>,
    /// Time of the claim.
    pub at: Timestamp,
}

pub type Held = (Holder, Vec<AgentId>);

/// Claim of seats.
#[derive(Clone, Debug)]
pub struct ClaimRow {
    pub episode: EpisodeKey,
    pub holder: Holder,
    /// Claimed seats; empty if the creator holds all seats, which needs no rows.
    pub agents: Vec<AgentId>,
    pub tokens: Vec<TokenRow>,
    /// Idempotency key of the claim, and the hash of its body.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// Final record of the holders of an episode's seats.
#[derive(Clone, Debug)]
pub struct SeatingRow {
    pub episode: EpisodeKey,
    pub record: RawRecord,
    /// Chain head after the record.
    pub head: Head,
}

/// Stored part of a token.
#[derive(Clone, Copy, Debug)]
pub struct TokenRow {
    pub hash: TokenHash,
    /// Seat of the token; `None` for several seats of the episode.
    pub agent: Option<AgentId>,
    /// Holder of those seats, by the number of the claim; `None` for the creator.
    pub holder: Option<u32>,
}

/// Act of a seat in a round.
#[derive(Clone, Debug)]
pub struct ActRow {
    pub episode: EpisodeKey,
    pub round: u32,
    pub agent: AgentId,
    /// Number of seats without an act after this one.
    pub waiting_for: u32,
    pub source: Source,
    pub at: Timestamp,
    pub record: RawRecord,
    /// Record without its texts, for readers that need none of a large record; see [`brief_of`].
    pub brief: Option<RawRecord>,
}

/// Maximum bytes of a record that is stored once. A larger one with texts is stored a second time without them; a smaller one
/// costs less to read whole.
const WHOLE_BYTES_MAX: usize = 512;

/// Brief record to store beside a large record: the same without its texts. `None` if the record is small or has no texts.
pub fn brief_of(
    record: &RawRecord,
    brief: impl FnOnce() -> Option<ActRecord>,
) -> Option<RawRecord> {
    let is_large = record.as_str().len() > WHOLE_BYTES_MAX;
    is_large.then(brief).flatten().map(|brief| RawRecord::write(&brief))
}

/// Code of the source in the table of acts.
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
    /// Digest of the state after the round.
    pub digest: [u8; 32],
    /// Score after the round.
    pub score: f64,
    /// Chain head after the round.
    pub head: Head,
    pub at: Timestamp,
}

#[derive(Clone, Debug)]
pub struct EndRow {
    pub episode: EpisodeKey,
    /// `finished`, `aborted` or `abandoned`.
    pub status: &'static str,
    /// Name of the ending.
    pub reason: &'static str,
    pub record: RawRecord,
    /// Head of the whole chain.
    pub head: Head,
    /// Bytes of all acts.
    pub bytes: u64,
    pub score: f64,
    pub rounds: u32,
    pub seed: Seed,
    pub tally: Tally,
    /// Whether boards count the episode: it belongs to a run, or several holders played it.
    pub counts: bool,
    pub at: Timestamp,
}

/// Stored imported game.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportRow {
    /// Public id, derived from the digest.
    pub id: String,
    /// Digest of name, settings and states.
    pub digest: [u8; 32],
    /// Name of the game in its files.
    pub run_id: String,
    /// Entry in the index, as JSON.
    pub meta: String,
    pub model: String,
    pub task: String,
    pub seed: u64,
    /// Settings that make games comparable.
    pub settings: ImportConfig,
    /// Score after the last round.
    pub score: f64,
    pub resolved: u32,
    pub acts: u64,
    /// States, the layout first.
    pub rounds: Vec<ImportedRound>,
}

/// State, and the acts in it.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedRound {
    /// Number of resolved rounds, which is also the round that was decided in this state.
    pub round: u32,
    pub score: f64,
    /// State as JSON.
    pub state: String,
    pub acts: Option<Vec<u8>>,
}

impl ImportedRound {
    /// Stored bytes.
    pub fn bytes(&self) -> u64 {
        (self.state.len() + self.acts.as_ref().map_or(0, Vec::len)) as u64
    }
}
