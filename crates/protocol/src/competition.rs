//! Competitions, their entrants, attempts and boards, and the actions of organizers.

use std::collections::BTreeMap;

use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::Seconds;
use crate::board::RowDifference;
use crate::carried::Carried;
use crate::failure::Failures;
use crate::game_settings;
use crate::metrics::MetricsMethod;
use crate::table::{self, Table};
use crate::time::Timestamp;

/// Definition of a new competition. `swarmbench competition create` takes the same shape in TOML.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({
    "name": "Spring cup", "opens_at": "2027-03-01T12:00:00Z", "closes_at": "2027-03-08T12:00:00Z",
    "suite": { "tasks": ["Pursuit", "Foraging"], "seeds": 3 }, "clocks": { "round_deadline_s": 60 },
    "attempts": 2, "entry": "codes", "board": "hidden"
})))]
pub struct CompetitionRequest {
    /// Name of the competition: 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub name: Option<String>,
    /// Information for entrants; at most 10,000 characters.
    pub description: Option<String>,
    /// Time from which attempts can be started; a time that is not in the future means at once.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub opens_at: Option<Timestamp>,
    /// Time from which no round begins; open rounds may end.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub closes_at: Option<Timestamp>,
    /// Games of each attempt.
    pub suite: Option<SealedSuite>,
    /// Clocks of all games; `round_deadline_s` is required, so that a round that is open at the closing time ends.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub clocks: Option<Clocks>,
    /// Entry: `anybody`, or `codes` for holders of invitation codes.
    #[cfg_attr(feature = "openapi", schema(default = "anybody"))]
    pub entry: Option<String>,
    /// Number of attempts of an entrant, all open for the whole time; or the window of each attempt.
    #[cfg_attr(feature = "openapi", schema(default = 1))]
    pub attempts: Option<Attempts>,
    /// Number of attempts on other sealed seeds that an entrant has in place of voided ones; together with the attempts at most
    /// 100.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 99))]
    pub spares: Option<u32>,
    /// Number of games of an attempt that are open at a time.
    #[cfg_attr(feature = "openapi", schema(default = 5, minimum = 1, maximum = 100))]
    pub parallel: Option<u32>,
    /// Attempt that counts: `best`, `last` or `first`.
    #[cfg_attr(feature = "openapi", schema(default = "best"))]
    pub counts: Option<String>,
    /// Board before the end: `public`, `hidden` or `frozen`.
    #[cfg_attr(feature = "openapi", schema(default = "public"))]
    pub board: Option<String>,
    /// Time at which a frozen board stops changing.
    pub board_freezes_at: Option<Timestamp>,
    /// Number of entrants that one key may have.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 100))]
    pub entries_per_key: Option<u32>,
    /// Number of attempts that an entrant may start on one day in UTC; no daily limit by default.
    #[cfg_attr(feature = "openapi", schema(minimum = 1, maximum = 100))]
    pub attempts_per_day: Option<u32>,
    /// Terms that entrants accept when they enter: 1 to 20,000 characters.
    pub terms: Option<String>,
    /// Categories, one of which every entrant is in: at most 20, each of 1 to 40 characters.
    #[cfg_attr(feature = "openapi", schema(example = json!(["models", "people", "rules"])))]
    pub categories: Option<Vec<String>>,
    /// Criteria that decide between equal totals, in this order: `invalid` (smaller share of invalid answers), `timeouts`
    /// (smaller share of moves that timed out), `attempts` (fewer attempts), `earliest` (the attempt that counts ended
    /// earlier).
    #[cfg_attr(feature = "openapi", schema(example = json!(["invalid", "earliest"])))]
    pub tie_breaks: Option<Vec<String>>,
    /// Time from which entrants read states, journals and scores of their own games: `sealed` (with everybody, after the end)
    /// or `ended` (once the window of the attempt has closed).
    #[cfg_attr(feature = "openapi", schema(default = "sealed"))]
    pub own_games: Option<String>,
}

/// Games of each attempt: every task once on each of its sealed seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SealedSuite {
    /// Names of the tasks; all five by default.
    #[serde(default, deserialize_with = "crate::any_case::tasks")]
    pub tasks: Option<Vec<String>>,
    /// Number of sealed seeds of each attempt.
    #[cfg_attr(feature = "openapi", schema(default = 5, minimum = 1, maximum = 100))]
    pub seeds: Option<u32>,
    /// Number of these seeds that make the board before the end; the other seeds then make the final board. With 0 all seeds
    /// make both.
    #[cfg_attr(feature = "openapi", schema(default = 0, maximum = 99))]
    pub public_seeds: Option<u32>,
    /// Rule set: `paper` or `reference`.
    #[cfg_attr(feature = "openapi", schema(default = "paper"))]
    #[serde(default, deserialize_with = "crate::any_case::rules")]
    pub rules: Option<String>,
    /// Settings of all games; those of the standard setting by default.
    pub settings: Option<SealedSettings>,
}

game_settings! {
    partial
    /// Settings of all games, with the names, limits and defaults that they have for an episode.
    #[serde_with::skip_serializing_none]
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
    #[serde(deny_unknown_fields)]
    pub struct SealedSettings {
        /// `decentralized` or `centralized`.
        #[cfg_attr(feature = "openapi", schema(default = "decentralized"))]
        #[serde(default, deserialize_with = "crate::any_case::control")]
        pub control: Option<String>,
        ..settings,
    }
}

/// Clocks of all games.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Clocks {
    /// Seconds that a seat has in a round before its bank is used.
    #[cfg_attr(feature = "openapi", schema(required, minimum = 0.05, maximum = 86400))]
    pub round_deadline_s: Option<Seconds>,
    /// Seconds that a seat may overspend in all rounds of a game together.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 604_800))]
    pub bank_s: Option<Seconds>,
    /// Seconds without any act after which a game ends as abandoned.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<Seconds>,
}

/// Number of attempts, or the window of each.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum Attempts {
    /// Number of attempts, all open for the whole time.
    Count(u32),
    /// Window of each attempt, in order.
    Windows(Vec<AttemptWindow>),
}

impl<'de> Deserialize<'de> for Attempts {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // An untagged enum does not name the field that is wrong.
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Attempts;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a number of attempts, or a list of their windows")
            }

            fn visit_u64<E: Error>(self, count: u64) -> Result<Attempts, E> {
                let wrong = |_| E::invalid_value(Unexpected::Unsigned(count), &self);
                count.try_into().map(Attempts::Count).map_err(wrong)
            }

            fn visit_i64<E: Error>(self, count: i64) -> Result<Attempts, E> {
                let wrong = |_| E::invalid_value(Unexpected::Signed(count), &self);
                count.try_into().map(Attempts::Count).map_err(wrong)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, windows: A) -> Result<Attempts, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(windows)).map(Attempts::Windows)
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// Window in which an attempt may be played.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AttemptWindow {
    /// Time from which the attempt can be started; by default the opening of the competition.
    pub opens_at: Option<Timestamp>,
    /// Time from which no round of the attempt begins; by default the closing of the competition.
    pub closes_at: Option<Timestamp>,
}

/// Competition as everybody sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Competition {
    /// Id of the competition.
    #[cfg_attr(feature = "openapi", schema(example = "cmp_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Name of the competition.
    pub name: String,
    /// Information for entrants.
    pub description: String,
    /// Phase: `announced`, `open`, `closing` (the last rounds still run), `closed` (everything is open to all) or `cancelled`.
    pub phase: String,
    /// Time from which attempts can be started.
    pub opens_at: Timestamp,
    /// Time from which no round begins.
    pub closes_at: Timestamp,
    /// Games of each attempt.
    pub suite: SealedSuite,
    /// Clocks of all games.
    pub clocks: Clocks,
    /// Entry: `anybody`, or `codes` for holders of invitation codes.
    pub entry: String,
    /// Window of each attempt, in order.
    pub attempts: Vec<AttemptWindow>,
    /// Number of attempts on other sealed seeds that an entrant has in place of voided ones.
    #[serde(default)]
    pub spares: u32,
    /// Number of games of an attempt that are open at a time.
    pub parallel: u32,
    /// Attempt that counts: `best`, `last` or `first`.
    pub counts: String,
    /// Board before the end: `public`, `hidden` or `frozen`.
    pub board: String,
    /// Time at which a frozen board stops changing.
    pub board_freezes_at: Option<Timestamp>,
    /// Number of entrants that one key may have.
    pub entries_per_key: u32,
    /// Number of attempts that an entrant may start on one day in UTC; null without a daily limit.
    #[serde(default)]
    pub attempts_per_day: Option<u32>,
    /// Terms that entrants accept when they enter.
    #[serde(default)]
    pub terms: Option<Terms>,
    /// Categories, one of which every entrant is in.
    #[serde(default)]
    pub categories: Vec<String>,
    /// Criteria that decide between equal totals, in this order.
    #[serde(default)]
    pub tie_breaks: Vec<String>,
    /// Time from which entrants read their own games: `sealed` or `ended`.
    #[serde(default)]
    pub own_games: String,
    /// Whether each task is played on its own seeds; false in competitions of servers that did not draw such seeds yet.
    #[serde(default)]
    pub seeds_by_task: bool,
    /// SHA-256 of the salt and then all sealed seeds, in hexadecimal. It is published before anybody plays, so that everybody
    /// can check afterwards that no seed was changed.
    pub commitment: String,
    /// Salt in hexadecimal; null until the competition is closed.
    pub salt: Option<String>,
    /// Sealed seeds in hexadecimal, attempt by attempt; null until the competition is closed.
    pub seeds: Option<Vec<String>>,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time at which everything was opened to all.
    pub revealed_at: Option<Timestamp>,
    /// Time at which an organizer cancelled the competition; null if none did.
    #[serde(default)]
    pub cancelled_at: Option<Timestamp>,
    /// Reason of the cancellation.
    #[serde(default)]
    pub cancel_reason: Option<String>,
    /// Whether only organizers and judges see the competition in lists.
    #[serde(default)]
    pub hidden: bool,
    /// Revision for `if_revision`: changes with every change that organizers may make. Empty from servers of earlier versions.
    #[serde(default)]
    pub revision: String,
}

/// Terms that entrants accept when they enter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Terms {
    /// Version, from 1; each change of the terms makes the next one. Entrants keep the version that they accepted.
    pub version: u32,
    /// Text of the terms.
    pub text: String,
}

/// Changes of a competition that has not closed, by an organizer. Fields that are left out do not change.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CompetitionChange {
    /// New name.
    pub name: Option<String>,
    /// New description.
    pub description: Option<String>,
    /// Later end, for games that are opened afterwards. Windows that end with the competition are extended with it.
    pub closes_at: Option<Timestamp>,
    /// Later ends of the windows of single attempts, for games that are opened afterwards.
    pub attempts: Option<Vec<WindowExtension>>,
    /// Whether only organizers and judges see the competition in lists: for a rehearsal.
    pub hidden: Option<bool>,
    /// New terms, as the next version: 1 to 20,000 characters. Entrants keep the version that they accepted.
    pub terms: Option<String>,
    /// The `revision` of the competition that the organizer saw. If the competition has another revision by now, nothing is
    /// changed (409 `changed`).
    pub if_revision: Option<String>,
    /// Reason, which everybody sees: 1 to 500 characters.
    pub reason: Option<String>,
}

/// Later end of the window of an attempt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct WindowExtension {
    /// Number of the attempt, from 1.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub attempt: u32,
    /// Time from which no round of the attempt begins.
    pub closes_at: Timestamp,
}

/// Cancellation of a competition by an organizer.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CancelRequest {
    /// Reason, which everybody sees: 1 to 500 characters.
    #[cfg_attr(feature = "openapi", schema(min_length = 1, max_length = 500))]
    pub reason: String,
}

/// Action of an organizer in a competition, as everybody sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct OrganizerAction {
    /// Time of the action.
    pub at: Timestamp,
    /// Name of the action.
    #[cfg_attr(feature = "openapi", schema(example = "competition.change"))]
    pub action: String,
    /// Id of the competition, entrant, run or game that the action concerns.
    pub subject: String,
    /// Further facts: old and new values, and the reason.
    pub detail: Value,
}

page! {
    /// Actions of organizers in a competition, newest first.
    OrganizerActions of OrganizerAction
}

/// New announcement to all who follow a competition.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AnnouncementRequest {
    /// Plain text: 1 to 2,000 characters.
    #[cfg_attr(feature = "openapi", schema(example = "Attempt 2 opens an hour later."))]
    pub text: String,
}

/// Announcement of an organizer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Announcement {
    /// Time of the announcement.
    pub at: Timestamp,
    /// Text of the announcement.
    pub text: String,
}

page! {
    /// Announcements, newest first.
    Announcements of Announcement
}

page! {
    /// Page of competitions, newest first.
    CompetitionList of Competition
}

/// Order of invitation codes by an organizer.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CodesRequest {
    /// Receivers of the codes, one label for each; only organizers see them. 1 to 1,000 labels of 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(required, example = json!(["team blue", "team red"])))]
    pub labels: Vec<String>,
}

/// Invitation code.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationCode {
    /// Receiver of the code.
    pub label: String,
    /// Code, good for one entrant and shown only once.
    pub code: String,
}

/// New invitation codes, shown only once.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationCodes {
    /// Codes, one for each label.
    pub items: Vec<InvitationCode>,
}

/// Invitation code as organizers see it later: without the code itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationSummary {
    /// Receiver of the code.
    pub label: String,
    /// State: `unused`, `used` or `revoked`.
    pub state: String,
    /// Id of the entrant that used the code.
    pub entrant: Option<String>,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time at which the code was revoked.
    pub revoked_at: Option<Timestamp>,
}

page! {
    /// Invitation codes, in the order in which they were made.
    InvitationList of InvitationSummary
}

/// Unused invitation codes to revoke: all with one of the labels, and single codes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RevokeCodesRequest {
    /// Labels; each revokes all unused codes that have it.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(example = json!(["team blue"])))]
    pub labels: Vec<String>,
    /// Single codes.
    #[serde(default)]
    pub codes: Vec<String>,
}

/// Entrants that an organizer excludes at once: those that match all fields that are given.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct ExclusionRequest {
    /// Address or network from which the entrants registered, like `203.0.113.7` or `2001:db8::/32`.
    pub address: Option<String>,
    /// Time of registration: this time or later.
    pub registered_from: Option<Timestamp>,
    /// Time of registration: before this time.
    pub registered_before: Option<Timestamp>,
    /// Pattern of names, case-insensitive: `*` stands for any characters, `?` for one.
    #[cfg_attr(feature = "openapi", schema(example = "bot-*"))]
    pub name: Option<String>,
    /// Number of matching entrants, from the preview. If it is left out, the answer is the preview, and nothing is done.
    pub count: Option<u32>,
    /// Reason, which everybody sees: 1 to 500 characters. Required if `count` is given.
    pub reason: Option<String>,
}

/// Entrants that were excluded, or would be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Exclusion {
    /// Whether the entrants were excluded; false in a preview.
    pub excluded: bool,
    /// Number of these entrants.
    pub count: u32,
    /// First 1,000 of these entrants, in the order in which they registered.
    pub items: Vec<EntrantSummary>,
}

/// New entrant and its player. The declaration of the player never changes: another model is another entrant.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct EntrantRequest {
    /// Name on the board: 1 to 100 characters that do not look like a name that another entrant has or had.
    #[cfg_attr(
        feature = "openapi",
        schema(example = "team blue", min_length = 1, max_length = 100)
    )]
    pub name: String,
    /// Name of the model: 1 to 200 characters.
    #[cfg_attr(feature = "openapi", schema(example = "my-model"))]
    pub model: String,
    /// Sampling temperature.
    #[cfg_attr(feature = "openapi", schema(minimum = 0))]
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p).
    #[cfg_attr(feature = "openapi", schema(minimum = 0, maximum = 1))]
    pub top_p: Option<f64>,
    /// Further facts about the player; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
    /// Prompt template of the entrant's own.
    pub prompt_template: Option<String>,
    /// Invitation code, if the competition requires one. If anybody may enter, the code takes a reserved place.
    pub code: Option<String>,
    /// Category of the entrant, if the competition has categories.
    pub category: Option<String>,
    /// Version of the terms that the entrant accepts, if the competition has terms.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub accepts_terms: Option<u32>,
    /// Contact for organizers, such as an email address: 1 to 200 characters. Only organizers and the entrant see it.
    pub contact: Option<String>,
}

/// Entrant as everybody sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantSummary {
    /// Id of the entrant.
    #[cfg_attr(feature = "openapi", schema(example = "ent_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Name of the entrant.
    pub name: String,
    /// Name of the model, as declared.
    pub model: String,
    /// Sampling temperature, as declared.
    pub temperature: Option<f64>,
    /// Nucleus of sampling (top-p), as declared.
    pub top_p: Option<f64>,
    /// Digest of the prompt template; null for the built-in template.
    pub prompt_template: Option<String>,
    /// Name of the prompt: `default`, `toolkit`, `static-first` or `custom:` and the first digits of `prompt_template`. A declared system
    /// message (`system_message` in `agent_meta`) adds `+system:` and the first digits of its SHA-256. `none` for built-in players
    /// and people, who read no prompts.
    #[serde(default)]
    pub prompt: String,
    /// Status: `active`, `withdrawn` or `disqualified`.
    pub status: String,
    /// Reason of the withdrawal or disqualification.
    pub reason: Option<String>,
    /// Whether an organizer vouches for the model.
    pub vouched: bool,
    /// Time of registration.
    pub registered_at: Timestamp,
    /// Category of the entrant, if the competition has categories.
    #[serde(default)]
    pub category: Option<String>,
    /// Version of the terms that the entrant accepted last, if the competition has terms.
    #[serde(default)]
    pub terms: Option<u32>,
    /// Whether the personal data of the entrant were erased.
    #[serde(default)]
    pub erased: bool,
}

/// New entrant.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedEntrant {
    /// The entrant.
    #[serde(flatten)]
    pub entrant: EntrantSummary,
    /// Key of the entrant, shown only once; null if the entrant registered with a key of its own.
    pub key: Option<String>,
}

/// New member of an entrant's team, who gets a key.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MemberRequest {
    /// Name of the member, which the team, organizers and judges see: 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(example = "Ada", min_length = 1, max_length = 100))]
    pub name: String,
}

/// Member of a team.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MemberSummary {
    /// Id of the member's key.
    #[cfg_attr(feature = "openapi", schema(example = "key_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// Name of the member.
    pub name: String,
    /// Time at which the member was added.
    pub added_at: Timestamp,
    /// Time at which the member was removed; null while it is a member.
    pub removed_at: Option<Timestamp>,
}

/// Added members of a team, in the order in which they were added. The one who entered is not among them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MemberList {
    /// Members of the team, removed ones included.
    pub items: Vec<MemberSummary>,
}

/// New member of a team.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedMember {
    /// The member.
    #[serde(flatten)]
    pub member: MemberSummary,
    /// Key of the member, shown only once. It has the same rights as the entrant's own key.
    pub key: String,
}

/// New key that replaces one which an entrant has lost.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplacedKey {
    /// Id of the entrant.
    pub entrant: String,
    /// New key, shown only once. The previous key is no longer valid.
    pub key: String,
}

page! {
    /// Entrants, in the order in which they registered.
    EntrantList of EntrantSummary
}

/// Entrant with its own results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantDetail {
    /// The entrant.
    #[serde(flatten)]
    pub entrant: EntrantSummary,
    /// Contact for organizers; null for judges.
    #[serde(default)]
    pub contact: Option<String>,
    /// Attempts of the entrant, in the order in which they were started; the last 1,000 of them.
    pub attempts: Vec<AttemptSummary>,
}

/// Contact of an entrant, for organizers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantContact {
    /// Id of the entrant.
    pub entrant: String,
    /// Name of the entrant.
    pub name: String,
    /// Category of the entrant, if the competition has categories.
    pub category: Option<String>,
    /// Status: `active`, `withdrawn` or `disqualified`.
    pub status: String,
    /// Contact of the entrant; null if it left none or was erased.
    pub contact: Option<String>,
}

page! {
    /// Contacts of the entrants, in the order in which they registered.
    ContactList of EntrantContact
}

impl Table for ContactList {
    type Row = EntrantContact;

    fn rows(&self) -> &[EntrantContact] {
        &self.items
    }

    fn next_cursor(&self) -> Option<&str> {
        self.next_cursor.as_deref()
    }

    fn columns(&self) -> Vec<String> {
        table::names("entrant name category status contact").collect()
    }

    fn record(&self, _: &[String], row: &EntrantContact) -> Vec<String> {
        let own = |text: &Option<String>| table::text(text.as_deref().unwrap_or_default());
        vec![
            row.entrant.clone(),
            table::text(&row.name),
            own(&row.category),
            row.status.clone(),
            own(&row.contact),
        ]
    }
}

/// Changes of an entrant, by an organizer or by the entrant, which may rename and withdraw itself. Fields that are left out do
/// not change.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct EntrantChange {
    /// New name, until the competition closes; it does not look like a name that another entrant has or had.
    pub name: Option<String>,
    /// New status: `active`, `withdrawn` or `disqualified`.
    pub status: Option<String>,
    /// Reason, which everybody sees: 1 to 500 characters. Required for a disqualification.
    pub reason: Option<String>,
    /// Whether the organizer vouches for the declared model.
    pub vouched: Option<bool>,
    /// New category of the competition's; organizers only.
    pub category: Option<String>,
    /// Newest version of the terms, which the entrant accepts.
    pub accepts_terms: Option<u32>,
    /// New contact; an empty one removes it.
    pub contact: Option<String>,
}

/// Practice games on open seeds.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct PracticeRequest {
    /// Id of the entrant; required if the key has several.
    pub entrant: Option<String>,
    /// Seeds, 1 to 10, on each of which every task is played once; by default one seed that the server draws.
    #[cfg_attr(feature = "openapi", schema(example = json!([7])))]
    pub seeds: Option<Vec<i64>>,
    /// Tasks of the competition; all by default.
    #[serde(default, deserialize_with = "crate::any_case::tasks")]
    pub tasks: Option<Vec<String>>,
}

/// New practice run.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StartedPractice {
    /// Id of the entrant.
    pub entrant: String,
    /// Id of the run.
    #[cfg_attr(feature = "openapi", schema(example = "run_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub run: String,
    /// Seeds of the run.
    pub seeds: Vec<u64>,
    /// Number of games.
    pub games: usize,
    /// Time from which no round begins.
    pub closes_at: Timestamp,
    /// Token of all seats of all games, shown only once: play with it over `/swarm/obs` and `/swarm/act`.
    pub swarm_token: String,
}

/// Attempt to start.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AttemptRequest {
    /// Id of the entrant; required if the key has several.
    pub entrant: Option<String>,
    /// Number of the attempt, from 1; by default the next open one.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub attempt: Option<u32>,
}

/// New attempt.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StartedAttempt {
    /// Number of the attempt.
    pub attempt: u32,
    /// Whether the attempt is played on spare seeds, in place of a voided one.
    #[serde(default)]
    pub on_spare_seeds: bool,
    /// Id of the entrant.
    pub entrant: String,
    /// Id of the attempt's run.
    #[cfg_attr(feature = "openapi", schema(example = "run_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub run: String,
    /// Number of games.
    pub games: usize,
    /// Time from which no round begins.
    pub closes_at: Timestamp,
    /// Token of all seats of all games, shown only once: play with it over `/swarm/obs` and `/swarm/act`.
    pub swarm_token: String,
}

/// Attempt as its entrant sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct AttemptSummary {
    /// Id of the entrant.
    pub entrant: String,
    /// Number of the attempt.
    pub attempt: u32,
    /// Whether the attempt is played on spare seeds, in place of a voided one.
    #[serde(default)]
    pub on_spare_seeds: bool,
    /// Id of the attempt's run.
    pub run: String,
    /// Status: `running`, `finished`, `aborted`, `abandoned` or `closed`.
    pub status: String,
    /// Time at which the attempt was started.
    pub created_at: Timestamp,
    /// Time at which the attempt ended; null before.
    pub ended_at: Option<Timestamp>,
    /// Number of games.
    pub games: usize,
    /// Number of games that have ended.
    pub games_ended: usize,
    /// Reason for which the attempt was voided; null if it was not. A voided attempt may be started again.
    pub voided: Option<String>,
    /// Result of each task, once the attempt is over.
    pub tasks: Option<Vec<TaskMean>>,
    /// Sum of the means, once the attempt is over.
    pub total: Option<f64>,
}

/// Attempt that was voided.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct VoidedAttempt {
    /// The attempt.
    #[serde(flatten)]
    pub attempt: AttemptSummary,
    /// Part of the seeds that the entrant has seen, if it will play again on the same seeds: the competition has no spare
    /// seeds, or the entrant has used all.
    pub seen: Option<SeenSeeds>,
}

/// Part of the seeds that an entrant has seen and on which it will play again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeenSeeds {
    /// Number of games of the attempt that were opened, of `games`.
    pub games_opened: usize,
    /// Number of rounds that were played in these games together.
    pub rounds: u64,
    /// Explanation of the consequences, in a sentence.
    pub warning: String,
}

page! {
    /// Attempts, in the order in which they were started.
    AttemptList of AttemptSummary
}

/// Result of an attempt in a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct TaskMean {
    /// Name of the task.
    pub task: String,
    /// Mean of the scores; null if all games were voided.
    pub mean: Option<f64>,
    /// Population standard deviation of the scores.
    pub deviation: Option<f64>,
    /// Games that were played and count.
    pub games: u32,
    /// Planned games, without voided ones. Planned games that were not played count as 0.
    pub planned: u32,
    /// Number of voided games, which do not count.
    pub voided: u32,
}

/// Board of a competition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionBoard {
    /// Contents of the board: `all`; `totals` while seeds are sealed; or `nothing`.
    pub shows: String,
    /// Seeds that make the board: `all`; `public` or `final` if the competition has public seeds.
    #[serde(default)]
    pub part: String,
    /// Category to which the board is limited; null for all entrants.
    #[serde(default)]
    pub category: Option<String>,
    /// Time at which the board was frozen: it shows only attempts that were over before.
    pub frozen_at: Option<Timestamp>,
    /// Requested metrics, in the requested order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Method by which the metrics were computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metrics_method: Option<MetricsMethod>,
    /// Rows: entrants with a rank, then those without a counting attempt, then those who withdrew or were disqualified.
    pub items: Vec<CompetitionRow>,
    /// Cursor of the next page; null on the last page.
    pub next_cursor: Option<String>,
}

/// Row of the board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionRow {
    /// Rank: 1, 2, 2, 4. Null without a counting attempt.
    pub rank: Option<u32>,
    /// The entrant.
    pub entrant: EntrantSummary,
    /// Number of the attempt that counts.
    pub attempt: Option<u32>,
    /// Whether that attempt was played on spare seeds, in place of a voided one.
    #[serde(default)]
    pub on_spare_seeds: bool,
    /// Id of that attempt's run.
    pub run: Option<String>,
    /// Status of that run.
    pub run_status: Option<String>,
    /// Result of each task; empty while seeds are sealed.
    pub tasks: Vec<TaskMean>,
    /// Sum of the means.
    pub total: Option<f64>,
    /// Distance below the nearest row above, with a 95 % interval; `to` is the id of that row's entrant. Null while seeds are
    /// sealed, for the first row, and for rows without a rank.
    #[serde(default)]
    pub difference: Option<RowDifference>,
    /// Share of invalid answers.
    pub invalid_share: f64,
    /// Invalid answers, counted by reason; empty while seeds are sealed. Games of earlier versions did not record reasons.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = BTreeMap<String, u64>))]
    pub failures: Failures,
    /// Share of moves that timed out.
    #[serde(default)]
    pub timeout_share: f64,
    /// Old name of `timeout_share`.
    pub clock_share: f64,
    /// Voided games of the attempt.
    pub voided_games: u32,
    /// Number of attempts that are over and were not voided.
    pub attempts: u32,
    /// Number of voided attempts.
    pub voided_attempts: u32,
    /// `declared` if the entrant has all seats, and so can pool what they see; `enforced` if it cannot; null under centralized
    /// control.
    pub decentralization: Option<String>,
    /// Requested metrics by task: means over the games of the attempt that counts. Empty while seeds are sealed.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, BTreeMap<String, Option<f64>>>,
}

/// Entry of the audit log: an action of an organizer, a judge's look at a sealed game, or an entrant's own rename.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Deed))]
pub struct AuditEntry {
    /// Time of the action.
    pub at: Timestamp,
    /// Id of the key, or `local` for work on the server's own machine.
    pub who: String,
    /// Name of the action.
    #[cfg_attr(feature = "openapi", schema(example = "entrant.change"))]
    pub action: String,
    /// Id of the competition, entrant, … that the action concerns.
    pub subject: String,
    /// Further facts.
    pub detail: Value,
}

page! {
    /// Page of the audit log, newest first.
    AuditLog of AuditEntry
}
