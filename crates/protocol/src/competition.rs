//! Competitions, their entrants, attempts and boards; and what organizers did.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::Seconds;
use crate::game_settings;

/// What a competition is to be. The same shape in TOML is what `swarmbench competition create` takes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", schema(example = json!({
    "name": "Spring cup", "opens_at": "2027-03-01T12:00:00Z", "closes_at": "2027-03-08T12:00:00Z",
    "suite": { "tasks": ["Pursuit", "Foraging"], "seeds": 3 }, "clocks": { "round_deadline_s": 60 },
    "attempts": 2, "entry": "codes", "board": "hidden"
})))]
pub struct CompetitionRequest {
    /// 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub name: Option<String>,
    /// What entrants should know; at most 10,000 characters.
    pub description: Option<String>,
    /// From then on attempts may be started.
    #[cfg_attr(feature = "openapi", schema(required, value_type = Option<String>, format = "date-time"))]
    pub opens_at: Option<Timestamp>,
    /// From then on no round begins; those that run may end.
    #[cfg_attr(feature = "openapi", schema(required, value_type = Option<String>, format = "date-time"))]
    pub closes_at: Option<Timestamp>,
    /// What is played in each attempt.
    pub suite: Option<SealedSuite>,
    /// The clocks of all games; `round_deadline_s` must be given, so that a round that runs at the closing time ends.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub clocks: Option<Clocks>,
    /// `anybody` or `codes`.
    #[cfg_attr(feature = "openapi", schema(default = "anybody"))]
    pub entry: Option<String>,
    /// How many attempts an entrant has, all open for the whole time; or the window of each.
    #[cfg_attr(feature = "openapi", schema(default = 1))]
    pub attempts: Option<Attempts>,
    /// How many games of an attempt are open at a time.
    #[cfg_attr(feature = "openapi", schema(default = 5, minimum = 1, maximum = 100))]
    pub parallel: Option<u32>,
    /// Which attempt counts: `best`, `last` or `first`.
    #[cfg_attr(feature = "openapi", schema(default = "best"))]
    pub counts: Option<String>,
    /// What is shown of the board before the end: `public`, `hidden` or `frozen`.
    #[cfg_attr(feature = "openapi", schema(default = "public"))]
    pub board: Option<String>,
    /// From when on a frozen board does not change.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub board_freezes_at: Option<Timestamp>,
    /// How many entrants one key may have.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 100))]
    pub entries_per_key: Option<u32>,
}

/// What is played in each attempt: every task once on each of its sealed seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SealedSuite {
    /// Names of tasks; all five where it is left out.
    pub tasks: Option<Vec<String>>,
    /// How many sealed seeds each attempt has.
    #[cfg_attr(feature = "openapi", schema(default = 5, minimum = 1, maximum = 100))]
    pub seeds: Option<u32>,
    /// `paper` or `reference`.
    #[cfg_attr(feature = "openapi", schema(default = "paper"))]
    pub rules: Option<String>,
    /// The settings of all games; the standard setting where something is left out.
    pub settings: Option<SealedSettings>,
}

game_settings! {
    partial
    /// Settings of all games, with the names, limits and defaults that they have for an episode.
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[serde(deny_unknown_fields)]
    pub struct SealedSettings {
        /// `decentralized` or `centralized`.
        #[cfg_attr(feature = "openapi", schema(default = "decentralized"))]
        #[serde(skip_serializing_if = "Option::is_none")]
        pub control: Option<String>,
        ..settings,
    }
}

/// The clocks of all games.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Clocks {
    /// How long a round lasts for a seat before its bank is touched.
    #[cfg_attr(feature = "openapi", schema(required, minimum = 0.05, maximum = 86400))]
    pub round_deadline_s: Option<Seconds>,
    /// What a seat may overspend in all rounds of a game together.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
    pub bank_s: Option<Seconds>,
    /// After so long without any act a game ends as abandoned.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<Seconds>,
}

/// How many attempts, or when each may be played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum Attempts {
    /// So many, all open for the whole time.
    Count(u32),
    /// The window of each, in order.
    Windows(Vec<AttemptWindow>),
}

/// When an attempt may be played.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AttemptWindow {
    /// From then on it may be started; from the opening of the competition where it is left out.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub opens_at: Option<Timestamp>,
    /// From then on none of its rounds begins; the closing of the competition where it is left out.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub closes_at: Option<Timestamp>,
}

/// A competition as everybody sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Competition {
    /// Its id.
    #[cfg_attr(feature = "openapi", schema(example = "cmp_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Its name.
    pub name: String,
    /// What entrants should know.
    pub description: String,
    /// `announced`, `open`, `closing` (the last rounds still run) or `closed` (everything is open to all).
    pub phase: String,
    /// From then on attempts may be started.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub opens_at: Timestamp,
    /// From then on no round begins.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub closes_at: Timestamp,
    /// What is played in each attempt.
    pub suite: SealedSuite,
    /// The clocks of all games.
    pub clocks: Clocks,
    /// `anybody` or `codes`.
    pub entry: String,
    /// The window of each attempt, in order.
    pub attempts: Vec<AttemptWindow>,
    /// How many games of an attempt are open at a time.
    pub parallel: u32,
    /// Which attempt counts.
    pub counts: String,
    /// What is shown of the board before the end.
    pub board: String,
    /// From when on a frozen board does not change.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub board_freezes_at: Option<Timestamp>,
    /// How many entrants one key may have.
    pub entries_per_key: u32,
    /// SHA-256 of the salt and then all sealed seeds, in hexadecimal: published before anybody plays, so that
    /// everybody can check afterwards that no seed was changed.
    pub commitment: String,
    /// The salt in hexadecimal, once the competition is closed.
    pub salt: Option<String>,
    /// The sealed seeds in hexadecimal, attempt by attempt, once the competition is closed.
    pub seeds: Option<Vec<String>>,
    /// When it was created.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub created_at: Timestamp,
    /// When everything was opened to all.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub revealed_at: Option<Timestamp>,
}

/// A page of competitions.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionList {
    /// The competitions, newest first.
    pub items: Vec<Competition>,
    /// Where the next page begins; null on the last one.
    pub next_cursor: Option<String>,
}

/// Invitation codes that an organizer asks for.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CodesRequest {
    /// For whom each code is: it is shown to organizers alone. 1 to 1,000 labels of 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(required, example = json!(["team blue", "team red"])))]
    pub labels: Vec<String>,
}

/// An invitation code.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationCode {
    /// For whom it is.
    pub label: String,
    /// The code: good for one entrant, and shown this once.
    pub code: String,
}

/// New invitation codes, shown this once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationCodes {
    /// One for each label.
    pub items: Vec<InvitationCode>,
}

/// Who wants to take part, and what plays. None of it changes later: another model is another entrant.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct EntrantRequest {
    /// The name on the board: 1 to 100 characters that no other entrant has.
    #[cfg_attr(
        feature = "openapi",
        schema(example = "team blue", min_length = 1, max_length = 100)
    )]
    pub name: String,
    /// The model's name: 1 to 200 characters.
    #[cfg_attr(feature = "openapi", schema(example = "my-model"))]
    pub model: String,
    /// The sampling temperature.
    #[cfg_attr(feature = "openapi", schema(minimum = 0))]
    pub temperature: Option<f64>,
    /// The nucleus of sampling.
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub top_p: Option<f64>,
    /// Whatever else is to be known of who plays; at most 16 KiB of JSON.
    pub agent_meta: Option<Map<String, Value>>,
    /// A prompt template of its own.
    pub prompt_template: Option<String>,
    /// The invitation code, where the competition asks for one.
    pub code: Option<String>,
}

/// An entrant as everybody sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantSummary {
    /// Its id.
    #[cfg_attr(feature = "openapi", schema(example = "ent_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Its name.
    pub name: String,
    /// The model's name, as declared.
    pub model: String,
    /// The sampling temperature, as declared.
    pub temperature: Option<f64>,
    /// The nucleus of sampling, as declared.
    pub top_p: Option<f64>,
    /// Tells prompt templates apart; null for the built-in one.
    pub prompt_template: Option<String>,
    /// `active`, `withdrawn` or `disqualified`.
    pub status: String,
    /// Why it takes no part any more.
    pub reason: Option<String>,
    /// Whether an organizer answers for it that this is the model.
    pub vouched: bool,
    /// When it registered.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub registered_at: Timestamp,
}

/// A new entrant.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedEntrant {
    /// The entrant.
    #[serde(flatten)]
    pub entrant: EntrantSummary,
    /// The entrant's key, shown this once; null where the entrant registered with a key of its own.
    pub key: Option<String>,
}

/// All entrants.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantList {
    /// The entrants, in the order in which they registered.
    pub items: Vec<EntrantSummary>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// An entrant with its own results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantDetail {
    /// The entrant.
    #[serde(flatten)]
    pub entrant: EntrantSummary,
    /// Its attempts, in the order in which they were started; the last 1,000 of them.
    pub attempts: Vec<AttemptSummary>,
}

/// What an organizer decides about an entrant; what is left out stays.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct EntrantChange {
    /// `active`, `withdrawn` or `disqualified`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub status: Option<String>,
    /// Why; everybody sees it. 1 to 500 characters; a disqualification needs one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Whether you answer for it that the declared model plays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vouched: Option<bool>,
}

/// Which attempt is to be started.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AttemptRequest {
    /// Whose attempt it is, where the key has several entrants.
    pub entrant: Option<String>,
    /// Its number, from 1; the next one that is open where it is left out.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub attempt: Option<u32>,
}

/// An attempt that was started.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StartedAttempt {
    /// Its number.
    pub attempt: u32,
    /// Whose it is.
    pub entrant: String,
    /// Its run.
    #[cfg_attr(feature = "openapi", schema(example = "run_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub run: String,
    /// How many games it has.
    pub games: usize,
    /// From then on no round begins.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub closes_at: Timestamp,
    /// The token of all seats of all its games, shown this once: play with it over `/swarm/obs` and `/swarm/act`.
    pub swarm_token: String,
}

/// An attempt as its entrant sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AttemptSummary {
    /// Whose it is.
    pub entrant: String,
    /// Its number.
    pub attempt: u32,
    /// Its run.
    pub run: String,
    /// `running`, `finished`, `aborted`, `abandoned` or `closed`.
    pub status: String,
    /// When it was started.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub created_at: Timestamp,
    /// When it ended.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub ended_at: Option<Timestamp>,
    /// How many games it has.
    pub games: usize,
    /// How many of them have ended.
    pub games_ended: usize,
    /// Why it was voided, if it was; then it may be started again.
    pub voided: Option<String>,
    /// What it came to in each task, once it is over.
    pub tasks: Option<Vec<TaskMean>>,
    /// The sum of the means, once it is over.
    pub total: Option<f64>,
}

/// Attempts.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AttemptList {
    /// The attempts, in the order in which they were started.
    pub items: Vec<AttemptSummary>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// What an attempt came to in a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TaskMean {
    /// The task.
    pub task: String,
    /// The mean of its scores; null if all games were voided.
    pub mean: Option<f64>,
    /// Their population standard deviation.
    pub deviation: Option<f64>,
    /// Games that were played and count.
    pub games: u32,
    /// Games that were to be played: what was not played counts as 0.
    pub planned: u32,
    /// Voided games; they do not count.
    pub voided: u32,
}

/// The board of a competition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionBoard {
    /// What is shown: `all`; `totals`, as long as seeds are sealed; or `nothing`.
    pub shows: String,
    /// Until when attempts had to be over to be shown on a frozen board.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<String>, format = "date-time"))]
    pub frozen_at: Option<Timestamp>,
    /// Entrants with a rank, then those of whom nothing counts yet, then those who take no part any more.
    pub items: Vec<CompetitionRow>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// A row of the board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionRow {
    /// 1, 2, 2, 4; null where nothing counts.
    pub rank: Option<u32>,
    /// The entrant.
    pub entrant: EntrantSummary,
    /// The number of the attempt that counts.
    pub attempt: Option<u32>,
    /// Its run.
    pub run: Option<String>,
    /// How the run ended.
    pub run_status: Option<String>,
    /// What it came to in each task; empty as long as seeds are sealed.
    pub tasks: Vec<TaskMean>,
    /// The sum of the means.
    pub total: Option<f64>,
    /// The share of invalid answers.
    pub invalid_share: f64,
    /// Which part of the moves were decided by a clock that ran out.
    pub clock_share: f64,
    /// Voided games of the attempt.
    pub voided_games: u32,
    /// Attempts that are over and were not voided.
    pub attempts: u32,
    /// Voided attempts.
    pub voided_attempts: u32,
    /// `declared`: the entrant holds all seats and can pool what they see; `enforced`: it cannot; null under
    /// centralized control.
    pub decentralization: Option<String>,
}

/// Something that an organizer did, as the audit log has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[cfg_attr(feature = "openapi", schema(as = Deed))]
pub struct AuditEntry {
    /// When.
    #[cfg_attr(feature = "openapi", schema(value_type = String, format = "date-time"))]
    pub at: Timestamp,
    /// The id of the organizer's key, or `local` for work on the server's own machine.
    pub who: String,
    /// What was done.
    #[cfg_attr(feature = "openapi", schema(example = "entrant.change"))]
    pub action: String,
    /// The id of what it was done to.
    pub subject: String,
    /// What else is to be known.
    pub detail: Value,
}

/// A page of the audit log.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AuditLog {
    /// What organizers did, newest first.
    pub items: Vec<AuditEntry>,
    /// Where the next page begins; null on the last one.
    pub next_cursor: Option<String>,
}
