//! Competitions, their entrants, attempts and boards; and what organizers did.

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

/// What a competition is to be. The same shape in TOML is what `swarmbench competition create` takes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(example = json!({
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
    /// When attempts can first be started; at once where that is not in the future.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub opens_at: Option<Timestamp>,
    /// No round begins at or after this time; open rounds may end.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub closes_at: Option<Timestamp>,
    /// What is played in each attempt.
    pub suite: Option<SealedSuite>,
    /// The clocks of all games; `round_deadline_s` is required, so that a round that is open at the closing time ends.
    #[cfg_attr(feature = "openapi", schema(required))]
    pub clocks: Option<Clocks>,
    /// `anybody` or `codes`.
    #[cfg_attr(feature = "openapi", schema(default = "anybody"))]
    pub entry: Option<String>,
    /// How many attempts an entrant has, all open for the whole time; or the window of each.
    #[cfg_attr(feature = "openapi", schema(default = 1))]
    pub attempts: Option<Attempts>,
    /// How many attempts on other sealed seeds an entrant has in place of voided ones; 100 with the attempts at most.
    #[cfg_attr(feature = "openapi", schema(default = 0, minimum = 0, maximum = 99))]
    pub spares: Option<u32>,
    /// How many games of an attempt are open at a time.
    #[cfg_attr(feature = "openapi", schema(default = 5, minimum = 1, maximum = 100))]
    pub parallel: Option<u32>,
    /// Which attempt counts: `best`, `last` or `first`.
    #[cfg_attr(feature = "openapi", schema(default = "best"))]
    pub counts: Option<String>,
    /// What is shown of the board before the end: `public`, `hidden` or `frozen`.
    #[cfg_attr(feature = "openapi", schema(default = "public"))]
    pub board: Option<String>,
    /// When a frozen board stops changing.
    pub board_freezes_at: Option<Timestamp>,
    /// How many entrants one key may have.
    #[cfg_attr(feature = "openapi", schema(default = 1, minimum = 1, maximum = 100))]
    pub entries_per_key: Option<u32>,
    /// How many attempts an entrant may start on one day in UTC; as many as it has where this is left out.
    #[cfg_attr(feature = "openapi", schema(minimum = 1, maximum = 100))]
    pub attempts_per_day: Option<u32>,
    /// What entrants accept when they enter: 1 to 20,000 characters.
    pub terms: Option<String>,
    /// The categories of entrants, each of which is in one of them: at most 20, each of 1 to 40 characters.
    #[cfg_attr(feature = "openapi", schema(example = json!(["models", "people", "rules"])))]
    pub categories: Option<Vec<String>>,
    /// What decides between equal totals, in this order: `invalid` (the smaller share of invalid answers), `timeouts` (the smaller
    /// share of moves that timed out), `attempts` (fewer attempts), `earliest` (the attempt that counts ended earlier).
    #[cfg_attr(feature = "openapi", schema(example = json!(["invalid", "earliest"])))]
    pub tie_breaks: Option<Vec<String>>,
    /// When entrants read states, journals and scores of their own games: `sealed` (with everybody, after the end) or `ended` (once
    /// the window of the attempt has closed).
    #[cfg_attr(feature = "openapi", schema(default = "sealed"))]
    pub own_games: Option<String>,
}

/// What is played in each attempt: every task once on each of its sealed seeds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct SealedSuite {
    /// Names of tasks; all five by default.
    #[serde(default, deserialize_with = "crate::any_case::tasks")]
    pub tasks: Option<Vec<String>>,
    /// How many sealed seeds each attempt has.
    #[cfg_attr(feature = "openapi", schema(default = 5, minimum = 1, maximum = 100))]
    pub seeds: Option<u32>,
    /// How many of these make the board before the end; then the others make the final one. With 0 all make both.
    #[cfg_attr(feature = "openapi", schema(default = 0, maximum = 99))]
    pub public_seeds: Option<u32>,
    /// `paper` or `reference`.
    #[cfg_attr(feature = "openapi", schema(default = "paper"))]
    #[serde(default, deserialize_with = "crate::any_case::rules")]
    pub rules: Option<String>,
    /// The settings of all games; by default those of the standard setting.
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
    /// The time without any act after which a game ends as abandoned.
    #[cfg_attr(feature = "openapi", schema(default = 86_400, minimum = 1, maximum = 31_536_000))]
    pub idle_timeout_s: Option<Seconds>,
}

/// How many attempts, or when each may be played.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(untagged)]
pub enum Attempts {
    /// The number of attempts, all open for the whole time.
    Count(u32),
    /// The window of each, in order.
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

/// When an attempt may be played.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AttemptWindow {
    /// When it can first be started; by default when the competition opens.
    pub opens_at: Option<Timestamp>,
    /// No round of it begins at or after this time; by default the time at which the competition closes.
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
    /// `announced`, `open`, `closing` (the last rounds still run), `closed` (everything is open to all) or `cancelled`.
    pub phase: String,
    /// When attempts can first be started.
    pub opens_at: Timestamp,
    /// No round begins at or after this time.
    pub closes_at: Timestamp,
    /// What is played in each attempt.
    pub suite: SealedSuite,
    /// The clocks of all games.
    pub clocks: Clocks,
    /// `anybody` or `codes`.
    pub entry: String,
    /// The window of each attempt, in order.
    pub attempts: Vec<AttemptWindow>,
    /// How many attempts on other sealed seeds an entrant has in place of voided ones.
    #[serde(default)]
    pub spares: u32,
    /// How many games of an attempt are open at a time.
    pub parallel: u32,
    /// Which attempt counts.
    pub counts: String,
    /// What is shown of the board before the end.
    pub board: String,
    /// When a frozen board stops changing.
    pub board_freezes_at: Option<Timestamp>,
    /// How many entrants one key may have.
    pub entries_per_key: u32,
    /// How many attempts an entrant may start on one day in UTC; null: as many as it has.
    #[serde(default)]
    pub attempts_per_day: Option<u32>,
    /// What entrants accept when they enter.
    #[serde(default)]
    pub terms: Option<Terms>,
    /// The categories of entrants, each of which is in one of them.
    #[serde(default)]
    pub categories: Vec<String>,
    /// What decides between equal totals, in this order.
    #[serde(default)]
    pub tie_breaks: Vec<String>,
    /// When entrants read their own games: `sealed` or `ended`.
    #[serde(default)]
    pub own_games: String,
    /// Whether each task is played on seeds of its own; false in competitions that were created before servers drew these.
    #[serde(default)]
    pub seeds_by_task: bool,
    /// SHA-256 of the salt and then all sealed seeds, in hexadecimal: published before anybody plays, so that
    /// everybody can check afterwards that no seed was changed.
    pub commitment: String,
    /// The salt in hexadecimal, once the competition is closed.
    pub salt: Option<String>,
    /// The sealed seeds in hexadecimal, attempt by attempt, once the competition is closed.
    pub seeds: Option<Vec<String>>,
    /// When it was created.
    pub created_at: Timestamp,
    /// When everything was opened to all.
    pub revealed_at: Option<Timestamp>,
    /// When the organizer cancelled it, if so.
    #[serde(default)]
    pub cancelled_at: Option<Timestamp>,
    /// Why it was cancelled.
    #[serde(default)]
    pub cancel_reason: Option<String>,
    /// Whether it is in no list but the organizers'.
    #[serde(default)]
    pub hidden: bool,
    /// Another text after each change of what organizers may change: for `if_revision`. Empty from servers of earlier versions.
    #[serde(default)]
    pub revision: String,
}

/// What entrants accept when they enter.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Terms {
    /// From 1; each change makes the next one. Entrants keep the version that they accepted.
    pub version: u32,
    /// The text.
    pub text: String,
}

/// What an organizer changes about a competition that has not closed. Fields that are left out do not change.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CompetitionChange {
    /// Another name.
    pub name: Option<String>,
    /// Another description.
    pub description: Option<String>,
    /// A later end, for games that are opened afterwards. Windows that end with the competition end with it again.
    pub closes_at: Option<Timestamp>,
    /// Later ends of the windows of single attempts, for games that are opened afterwards.
    pub attempts: Option<Vec<WindowExtension>>,
    /// Whether it is in no list but the organizers': for a rehearsal.
    pub hidden: Option<bool>,
    /// Other terms, as their next version: 1 to 20,000 characters. Who has entered keeps the version that it accepted.
    pub terms: Option<String>,
    /// The `revision` of the competition as the organizer saw it: where it has another by now, nothing is changed (409 `changed`).
    pub if_revision: Option<String>,
    /// Why; everybody sees it. 1 to 500 characters.
    pub reason: Option<String>,
}

/// A later end of the window of an attempt.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct WindowExtension {
    /// The attempt, from 1.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub attempt: u32,
    /// No round of it begins at or after this time.
    pub closes_at: Timestamp,
}

/// Why an organizer cancels a competition.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CancelRequest {
    /// The reason, which everybody sees: 1 to 500 characters.
    #[cfg_attr(feature = "openapi", schema(min_length = 1, max_length = 500))]
    pub reason: String,
}

/// What an organizer did in a competition, as everybody sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct OrganizerAction {
    /// When.
    pub at: Timestamp,
    /// What was done.
    #[cfg_attr(feature = "openapi", schema(example = "competition.change"))]
    pub action: String,
    /// The id of the competition, entrant, run or game that it concerns.
    pub subject: String,
    /// Further facts: what was changed from what to what, and why.
    pub detail: Value,
}

page! {
    /// What organizers did in a competition, newest first.
    OrganizerActions of OrganizerAction
}

/// What an organizer announces to all who follow a competition.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AnnouncementRequest {
    /// 1 to 2,000 characters of plain text.
    #[cfg_attr(feature = "openapi", schema(example = "Attempt 2 opens an hour later."))]
    pub text: String,
}

/// What an organizer announced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Announcement {
    /// When.
    pub at: Timestamp,
    /// What.
    pub text: String,
}

page! {
    /// Announcements, newest first.
    Announcements of Announcement
}

page! {
    /// A page of competitions, newest first.
    CompetitionList of Competition
}

/// Invitation codes that an organizer asks for.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct CodesRequest {
    /// The receiver of each code, shown to organizers alone. 1 to 1,000 labels of 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(required, example = json!(["team blue", "team red"])))]
    pub labels: Vec<String>,
}

/// An invitation code.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationCode {
    /// Its receiver.
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

/// An invitation code as organizers see it later: without the code itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct InvitationSummary {
    /// Its receiver.
    pub label: String,
    /// `unused`, `used` or `revoked`.
    pub state: String,
    /// The entrant that used it.
    pub entrant: Option<String>,
    /// When it was made.
    pub created_at: Timestamp,
    /// When it was revoked.
    pub revoked_at: Option<Timestamp>,
}

page! {
    /// Invitation codes, in the order in which they were made.
    InvitationList of InvitationSummary
}

/// Which unused invitation codes are revoked: those with a label, and those that are named themselves.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct RevokeCodesRequest {
    /// Labels; each revokes all unused codes that have it.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(example = json!(["team blue"])))]
    pub labels: Vec<String>,
    /// Codes.
    #[serde(default)]
    pub codes: Vec<String>,
}

/// Which entrants an organizer excludes at once: those that fit all fields that are given.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct ExclusionRequest {
    /// The address or network from which they registered, like `203.0.113.7` or `2001:db8::/32`.
    pub address: Option<String>,
    /// They registered at this time or later.
    pub registered_from: Option<Timestamp>,
    /// They registered before this time.
    pub registered_before: Option<Timestamp>,
    /// A pattern of names in any case: `*` stands for any characters, `?` for one.
    #[cfg_attr(feature = "openapi", schema(example = "bot-*"))]
    pub name: Option<String>,
    /// How many entrants they are, from the preview; left out, they are shown, and nothing is done.
    pub count: Option<u32>,
    /// The reason, which everybody sees: 1 to 500 characters. Required where `count` is given.
    pub reason: Option<String>,
}

/// The entrants that were excluded, or would be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Exclusion {
    /// Whether they were excluded; else this is a preview.
    pub excluded: bool,
    /// How many they are.
    pub count: u32,
    /// The first 1,000 of them, in the order in which they registered.
    pub items: Vec<EntrantSummary>,
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
    /// What else is known of who plays; at most 16 KiB of JSON.
    #[cfg_attr(feature = "openapi", schema(value_type = Option<serde_json::Map<String, serde_json::Value>>))]
    pub agent_meta: Option<Carried>,
    /// A prompt template of its own.
    pub prompt_template: Option<String>,
    /// The invitation code, if the competition asks for one. Where anybody may enter it takes a reserved place.
    pub code: Option<String>,
    /// One of the competition's categories, if it has some.
    pub category: Option<String>,
    /// The version of the terms that the entrant accepts, if the competition has terms.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub accepts_terms: Option<u32>,
    /// How organizers reach it, an address of mail for instance: 1 to 200 characters. Organizers and the entrant see it, nobody else.
    pub contact: Option<String>,
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
    /// The digest of the prompt template; null for the built-in one.
    pub prompt_template: Option<String>,
    /// The name of the prompt: `default`, `toolkit` or `custom:` and the first digits of `prompt_template`. A declared system
    /// message (`system_message` in `agent_meta`) adds `+system:` and the first digits of its SHA-256.
    #[serde(default)]
    pub prompt: String,
    /// `active`, `withdrawn` or `disqualified`.
    pub status: String,
    /// Why it withdrew or was disqualified.
    pub reason: Option<String>,
    /// Whether an organizer vouches for the model.
    pub vouched: bool,
    /// When it registered.
    pub registered_at: Timestamp,
    /// Its category, if the competition has some.
    #[serde(default)]
    pub category: Option<String>,
    /// The version of the terms that it accepted last, if the competition has terms.
    #[serde(default)]
    pub terms: Option<u32>,
    /// Whether its personal data were erased.
    #[serde(default)]
    pub erased: bool,
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

/// Another member of an entrant's team, who gets a key.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct MemberRequest {
    /// The member's name, which the team, organizers and judges see: 1 to 100 characters.
    #[cfg_attr(feature = "openapi", schema(example = "Ada", min_length = 1, max_length = 100))]
    pub name: String,
}

/// A member of a team.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MemberSummary {
    /// The id of the member's key.
    #[cfg_attr(feature = "openapi", schema(example = "key_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub id: String,
    /// The member's name.
    pub name: String,
    /// When it was added.
    pub added_at: Timestamp,
    /// When it was removed, if it was.
    pub removed_at: Option<Timestamp>,
}

/// The members of a team that were added, in that order. Who entered is none of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct MemberList {
    /// All of them, removed ones too.
    pub items: Vec<MemberSummary>,
}

/// A new member of a team.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CreatedMember {
    /// The member.
    #[serde(flatten)]
    pub member: MemberSummary,
    /// The member's key, shown this once. It does what the entrant's own key does.
    pub key: String,
}

/// A new key in place of one that an entrant has lost.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct ReplacedKey {
    /// The entrant.
    pub entrant: String,
    /// The key, shown this once. The one before is good for nothing any more.
    pub key: String,
}

page! {
    /// All entrants, in the order in which they registered.
    EntrantList of EntrantSummary
}

/// An entrant with its own results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantDetail {
    /// The entrant.
    #[serde(flatten)]
    pub entrant: EntrantSummary,
    /// How organizers reach it; null for judges.
    #[serde(default)]
    pub contact: Option<String>,
    /// Its attempts, in the order in which they were started; the last 1,000 of them.
    pub attempts: Vec<AttemptSummary>,
}

/// How organizers reach an entrant.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct EntrantContact {
    /// The entrant's id.
    pub entrant: String,
    /// Its name.
    pub name: String,
    /// Its category, if the competition has some.
    pub category: Option<String>,
    /// `active`, `withdrawn` or `disqualified`.
    pub status: String,
    /// How organizers reach it; null where it left none or was erased.
    pub contact: Option<String>,
}

page! {
    /// How organizers reach the entrants, in the order in which they registered.
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

/// What an organizer changes about an entrant, or the entrant about itself: it may rename and withdraw itself. Fields that are
/// left out do not change.
#[serde_with::skip_serializing_none]
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct EntrantChange {
    /// Another name, that no other entrant has, until the competition closes.
    pub name: Option<String>,
    /// `active`, `withdrawn` or `disqualified`.
    pub status: Option<String>,
    /// Why; everybody sees it. 1 to 500 characters; a disqualification needs one.
    pub reason: Option<String>,
    /// Whether you vouch for it that the declared model plays.
    pub vouched: Option<bool>,
    /// Another of the competition's categories; organizers only.
    pub category: Option<String>,
    /// The newest version of the terms, which the entrant accepts.
    pub accepts_terms: Option<u32>,
    /// Another contact; an empty one removes it.
    pub contact: Option<String>,
}

/// Games on open seeds, to practise.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct PracticeRequest {
    /// The entrant; required if the key has several.
    pub entrant: Option<String>,
    /// Seeds, on each of which every task is played once: 1 to 10 of them; by default a single one that the server draws.
    #[cfg_attr(feature = "openapi", schema(example = json!([7])))]
    pub seeds: Option<Vec<i64>>,
    /// Tasks of the competition; all by default.
    #[serde(default, deserialize_with = "crate::any_case::tasks")]
    pub tasks: Option<Vec<String>>,
}

/// A practice run that was started.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StartedPractice {
    /// Whose it is.
    pub entrant: String,
    /// Its run.
    #[cfg_attr(feature = "openapi", schema(example = "run_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub run: String,
    /// Its seeds.
    pub seeds: Vec<u64>,
    /// How many games it has.
    pub games: usize,
    /// No round begins at or after this time.
    pub closes_at: Timestamp,
    /// The token of all seats of all its games, shown this once: play with it over `/swarm/obs` and `/swarm/act`.
    pub swarm_token: String,
}

/// Which attempt is to be started.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct AttemptRequest {
    /// The entrant; required if the key has several.
    pub entrant: Option<String>,
    /// Its number, from 1; by default the next open one.
    #[cfg_attr(feature = "openapi", schema(minimum = 1))]
    pub attempt: Option<u32>,
}

/// An attempt that was started.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct StartedAttempt {
    /// Its number.
    pub attempt: u32,
    /// Whether it is played on spare seeds, in place of a voided one.
    #[serde(default)]
    pub on_spare_seeds: bool,
    /// Whose it is.
    pub entrant: String,
    /// Its run.
    #[cfg_attr(feature = "openapi", schema(example = "run_0198f2c55cf77c3e8f1be8a0c1a2b3c4"))]
    pub run: String,
    /// How many games it has.
    pub games: usize,
    /// No round begins at or after this time.
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
    /// Whether it is played on spare seeds, in place of a voided one.
    #[serde(default)]
    pub on_spare_seeds: bool,
    /// Its run.
    pub run: String,
    /// `running`, `finished`, `aborted`, `abandoned` or `closed`.
    pub status: String,
    /// When it was started.
    pub created_at: Timestamp,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
    /// How many games it has.
    pub games: usize,
    /// How many of them have ended.
    pub games_ended: usize,
    /// Why it was voided, if it was; then it may be started again.
    pub voided: Option<String>,
    /// The result of each task, once it is over.
    pub tasks: Option<Vec<TaskMean>>,
    /// The sum of the means, once it is over.
    pub total: Option<f64>,
}

/// An attempt that was voided.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct VoidedAttempt {
    /// The attempt.
    #[serde(flatten)]
    pub attempt: AttemptSummary,
    /// How much of its seeds the entrant has seen, where it will play again on the same: the competition has no spare seeds, or
    /// the entrant has used all.
    pub seen: Option<SeenSeeds>,
}

/// How much an entrant has seen of seeds on which it will play again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct SeenSeeds {
    /// How many games of the attempt were opened, of `games`.
    pub games_opened: usize,
    /// How many rounds of them were played, in all.
    pub rounds: u64,
    /// What that means, in a sentence.
    pub warning: String,
}

page! {
    /// Attempts, in the order in which they were started.
    AttemptList of AttemptSummary
}

/// The result of an attempt in a task.
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
    /// Planned games, without voided ones. Those that were not played count as 0.
    pub planned: u32,
    /// Voided games; they do not count.
    pub voided: u32,
}

/// The board of a competition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionBoard {
    /// What is shown: `all`; `totals` while seeds are sealed; or `nothing`.
    pub shows: String,
    /// Which seeds make it: `all`; `public` or `final` where the competition has public seeds.
    #[serde(default)]
    pub part: String,
    /// The category of the entrants that it ranks, if one was asked for.
    #[serde(default)]
    pub category: Option<String>,
    /// A frozen board shows attempts that were over before this time.
    pub frozen_at: Option<Timestamp>,
    /// The metrics that were asked for, in that order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// How their values were computed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metrics_method: Option<MetricsMethod>,
    /// Entrants with a rank, then those without a counting attempt, then those who withdrew or were disqualified.
    pub items: Vec<CompetitionRow>,
    /// Where the next page begins; null on the last.
    pub next_cursor: Option<String>,
}

/// A row of the board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct CompetitionRow {
    /// 1, 2, 2, 4; null without a counting attempt.
    pub rank: Option<u32>,
    /// The entrant.
    pub entrant: EntrantSummary,
    /// The number of the attempt that counts.
    pub attempt: Option<u32>,
    /// Whether that was played on spare seeds, in place of a voided one.
    #[serde(default)]
    pub on_spare_seeds: bool,
    /// Its run.
    pub run: Option<String>,
    /// How the run ended.
    pub run_status: Option<String>,
    /// The result of each task; empty while seeds are sealed.
    pub tasks: Vec<TaskMean>,
    /// The sum of the means.
    pub total: Option<f64>,
    /// How far it is below the nearest row above, with an interval of 95 %; `to` is that entrant's id. Null while seeds
    /// are sealed, for the first row, and for rows without a rank.
    #[serde(default)]
    pub difference: Option<RowDifference>,
    /// The share of invalid answers.
    pub invalid_share: f64,
    /// How many answers were invalid, by the reason; empty while seeds are sealed. Games of earlier versions do not tell it.
    #[serde(default)]
    #[cfg_attr(feature = "openapi", schema(value_type = BTreeMap<String, u64>))]
    pub failures: Failures,
    /// The share of moves that timed out.
    #[serde(default)]
    pub timeout_share: f64,
    /// The old name of `timeout_share`.
    pub clock_share: f64,
    /// Voided games of the attempt.
    pub voided_games: u32,
    /// Attempts that are over and were not voided.
    pub attempts: u32,
    /// Voided attempts.
    pub voided_attempts: u32,
    /// `declared`: the entrant has all seats, and so can pool what they see; `enforced`: it cannot; null under
    /// centralized control.
    pub decentralization: Option<String>,
    /// Of each task the metrics that were asked for: means over the games of the attempt that counts. Empty while seeds are
    /// sealed.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub metrics: BTreeMap<String, BTreeMap<String, Option<f64>>>,
}

/// An action of an organizer in the audit log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = Deed))]
pub struct AuditEntry {
    /// When.
    pub at: Timestamp,
    /// The id of the organizer's key, or `local` for work on the server's own machine.
    pub who: String,
    /// What was done.
    #[cfg_attr(feature = "openapi", schema(example = "entrant.change"))]
    pub action: String,
    /// The id of the competition, entrant, … that the action concerns.
    pub subject: String,
    /// Further facts.
    pub detail: Value,
}

page! {
    /// A page of the audit log, newest first.
    AuditLog of AuditEntry
}
