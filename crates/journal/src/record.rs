//! The records of a journal and their bytes.
//!
//! A record is a JSON object without line breaks. The chain hashes its bytes, so they are stored and never serialized
//! again. A line of a journal file is `{"hash":"…","record":{…}}` with the head of the chain after the record.

use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use serde::de::value::{CowStrDeserializer, MapAccessDeserializer};
use serde::de::{DeserializeSeed, Error as _, IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::value::RawValue;
use swarmbench_engine::{Act, Action, AgentId, Config, Message, Seed, SettingErrors, Settings};

use super::chain::Head;
use swarmbench_protocol::act::Harness;
pub use swarmbench_protocol::act::Usage;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::failure::Failure;

/// The version of this format that journals name.
pub const FORMAT: u32 = 1;

/// The newest version that is read. Fields that journals of [`FORMAT`] do not have are in journals of this version alone, so that
/// older programs refuse them by the version, and not by a field that they do not know.
pub const NEWEST_FORMAT: u32 = 2;

/// The bytes of a record. Cloning shares them.
#[derive(Clone, Debug)]
pub struct RawRecord(Arc<RawValue>);

impl PartialEq for RawRecord {
    fn eq(&self, other: &Self) -> bool {
        self.as_str() == other.as_str()
    }
}

impl Eq for RawRecord {}

impl RawRecord {
    /// Serializes a new record.
    pub fn write<T: Serialize>(record: &T) -> Self {
        Self(serde_json::value::to_raw_value(record).expect("records have string keys").into())
    }

    /// A record from the store.
    ///
    /// # Errors
    /// If the text is no JSON.
    pub fn from_stored(text: String) -> Result<Self, serde_json::Error> {
        RawValue::from_string(text).map(|value| Self(value.into()))
    }

    /// The JSON of the record.
    #[must_use]
    pub fn as_str(&self) -> &str {
        self.0.get()
    }

    /// Reads the record.
    ///
    /// # Errors
    /// If it is a record of another kind.
    pub fn read<'a, T: Deserialize<'a>>(&'a self) -> Result<T, serde_json::Error> {
        serde_json::from_str(self.as_str())
    }

    /// The line of a journal file for this record.
    #[must_use]
    pub fn line(&self, head: Head) -> String {
        format!("{{\"hash\":\"{head}\",\"record\":{}}}\n", self.as_str())
    }
}

/// A record of any kind, which its field `kind` names.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Record {
    /// The first record.
    Opening(Box<Opening>),
    /// The holders of the seats; only if there are several, or if the server hosts players.
    Seats(Seats),
    /// A resolved round.
    Round(Round),
    /// The last record.
    End(End),
}

/// The kind of a record, which its field `kind` names, wherever it stands.
///
/// # Errors
/// If the text is no object, or has no kind.
pub fn kind_of(text: &str) -> Result<Cow<'_, str>, serde_json::Error> {
    #[derive(Deserialize)]
    struct Kind<'a> {
        #[serde(borrow)]
        kind: Cow<'a, str>,
    }
    // Servers write it first.
    let first = text.strip_prefix(r#"{"kind":""#).and_then(|rest| rest.split_once('"'));
    match first {
        Some((kind, _)) if !kind.contains('\\') => Ok(Cow::Borrowed(kind)),
        _ => serde_json::from_str(text).map(|Kind { kind }| kind),
    }
}

/// Reads all fields of a record but its kind, in one pass. The reader of an enum with a tag would buffer them, which takes up to
/// sixty bytes of memory for each byte.
///
/// # Errors
/// If the fields are others.
pub fn fields_of<'de, T: Deserialize<'de>>(text: &'de str) -> Result<T, serde_json::Error> {
    struct Fields<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Fields<T> {
        type Value = T;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a record")
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            T::deserialize(MapAccessDeserializer::new(WithoutKind { map, was_seen: false }))
        }
    }
    let mut json = serde_json::Deserializer::from_str(text);
    let read = json.deserialize_map(Fields(PhantomData))?;
    json.end().map(|()| read)
}

/// The fields of a record without its kind.
struct WithoutKind<A> {
    map: A,
    was_seen: bool,
}

impl<'de, A: MapAccess<'de>> MapAccess<'de> for WithoutKind<A> {
    type Error = A::Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, A::Error> {
        #[derive(Deserialize)]
        struct Name<'a>(#[serde(borrow)] Cow<'a, str>);
        while let Some(Name(name)) = self.map.next_key()? {
            if name != "kind" {
                return seed.deserialize(CowStrDeserializer::new(name)).map(Some);
            }
            if std::mem::replace(&mut self.was_seen, true) {
                return Err(A::Error::duplicate_field("kind"));
            }
            self.map.next_value::<IgnoredAny>()?;
        }
        Ok(None)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, A::Error> {
        self.map.next_value_seed(seed)
    }
}

impl Record {
    /// Reads a record.
    ///
    /// # Errors
    /// If the text is no record.
    pub fn parse(text: &str) -> Result<Self, serde_json::Error> {
        match &*kind_of(text)? {
            "opening" => fields_of(text).map(Record::Opening),
            "seats" => fields_of(text).map(Record::Seats),
            "round" => fields_of(text).map(Record::Round),
            "end" => fields_of(text).map(Record::End),
            other => Err(serde_json::Error::unknown_variant(
                other,
                &["opening", "seats", "round", "end"],
            )),
        }
    }
}

/// The definition of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Opening {
    /// The version of the format.
    pub format: u32,
    /// The public id.
    pub episode: String,
    /// The revision of the rules of the game.
    pub rules_revision: u32,
    /// The time of creation.
    pub created_at: jiff::Timestamp,
    /// All settings.
    pub config: RecordedConfig,
    /// Further fields of the creator about the player.
    pub agent_meta: Carried,
    /// The text of the prompt template.
    pub prompt_template: String,
    /// The revision of the program's own words in prompts; journals before revision 2 name none.
    #[serde(default = "first_prompt_revision", skip_serializing_if = "is_first_prompt_revision")]
    pub prompt_revision: u32,
    /// The digest of the layout, in hexadecimal.
    pub digest: String,
    /// The public id of its run, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Random hexadecimal digits in a sealed episode, so that nobody can find its seed by trying seeds until the
    /// hashes match.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub salt: Option<String>,
    /// The state of another episode that a fork continues.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fork: Option<Fork>,
}

/// The state of another episode that a fork continues. The journal of the fork also contains all earlier rounds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fork {
    /// The public id of the other episode, its parent.
    pub episode: String,
    /// The number of rounds taken over from the parent, and thus the fork's own first round.
    pub round: u32,
    /// The head of the parent's chain before that round, in hexadecimal.
    pub head: String,
}

/// The revision of prompts in journals that name none.
#[must_use]
pub const fn first_prompt_revision() -> u32 {
    1
}

/// True if journals leave this revision out.
#[must_use]
pub const fn is_first_prompt_revision(revision: &u32) -> bool {
    *revision == 1
}

impl Opening {
    /// True if boards count the episode: it belongs to a run or has several holders, and it is no fork.
    #[must_use]
    pub fn counts(&self) -> bool {
        let is_listed = self.run.is_some() || self.config.is_mixed();
        is_listed && self.fork.is_none()
    }

    /// The first round that was decided in this episode; earlier ones were taken over from its parent.
    #[must_use]
    pub fn first_round(&self) -> u32 {
        self.fork.as_ref().map_or(0, |fork| fork.round)
    }
}

swarmbench_protocol::game_settings! {
    checked
    /// The settings of an episode, under their names on the wire.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(missing_docs, reason = "the names are those of the wire, described there")]
    pub struct RecordedConfig {
        pub task: String,
        pub rules: String,
        pub control: String,
        pub seed: Seed,
        ..settings,
        #[serde(deserialize_with = "Option::deserialize")]
        pub round_deadline_ms: Option<u64>,
        pub bank_ms: u64,
        pub start: String,
        pub idle_timeout_ms: u64,
        pub visibility: String,
        pub model: String,
        pub custom_template: bool,
        /// The time from which on no round begins.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub closes_at: Option<jiff::Timestamp>,
        /// The indices of agents whose seats were open to claims.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub open_seats: Vec<u16>,
        /// The time after which built-in players take the unclaimed seats.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub fill_after_ms: Option<u64>,
        /// The built-in player that takes the unclaimed seats.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub fill_with: Option<String>,
        /// The built-in player that the server hosts on the creator's seats.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub player: Option<String>,
        /// The holders of a team, which has all seats from the creation on; holder 1 is the first.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub holders: Vec<TeamHolder>,
    }
}

/// A holder of a team, as it was declared at the creation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeamHolder {
    /// The name of the holder within its team.
    pub name: String,
    /// The name of the player.
    pub model: String,
    /// The indices of its agents, in order.
    pub seats: Vec<u16>,
    /// The built-in player that the server hosts on these seats, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
}

impl RecordedConfig {
    /// True if several holders may have seats: some were open to claims, or a team has all.
    #[must_use]
    pub fn is_mixed(&self) -> bool {
        !self.open_seats.is_empty() || !self.holders.is_empty()
    }

    /// Records the engine's settings; all others have their defaults.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        let settings = config.settings();
        Self {
            task: settings.task,
            rules: settings.rules,
            seed: config.seed(),
            start: "now".to_owned(),
            ..Self::from(config)
        }
    }

    /// Checks the engine's settings.
    ///
    /// # Errors
    /// If the current rules do not allow these settings.
    pub fn engine(&self) -> Result<Config, SettingErrors> {
        Config::check(&Settings {
            task: self.task.clone(),
            rules: self.rules.clone(),
            seed: self.seed.into(),
            ..Settings::from(self)
        })
    }
}

/// The holders of all seats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seats {
    /// All holders of seats, in the order of their numbers.
    pub holders: Vec<SeatHolder>,
    /// All seats, in the order of the agents.
    pub seats: Vec<HeldSeat>,
}

/// A holder of seats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeatHolder {
    /// The number of the claim in its episode; 0 is the creator.
    pub holder: u32,
    /// The name of the player.
    pub model: String,
    /// Further fields of the holder about the player.
    pub agent_meta: Carried,
    /// The public id of the holder's key, if a key was required.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
    /// The built-in player that the server hosts on these seats, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
}

/// A seat and its holder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldSeat {
    /// The agent's name.
    pub agent: String,
    /// The number of its holder.
    pub holder: u32,
}

/// A resolved round.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round<A = ActRecord> {
    /// The number of the round, from 0.
    pub round: u32,
    /// The acts of all living agents.
    pub acts: Vec<A>,
    /// The digest of the state after the round, in hexadecimal.
    pub digest: String,
    /// The score after the round.
    pub score: f64,
}

/// The end of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct End<A = ActRecord> {
    /// `finished`, `aborted` or `abandoned`.
    pub status: String,
    /// The reason: `task_done`, `rounds_played`, `aborted`, `idle` or `closed`.
    pub reason: String,
    /// The number of resolved rounds.
    pub rounds: u32,
    /// The final score.
    pub score: f64,
    /// Acts of the last round if it was never resolved.
    pub open_acts: Vec<A>,
}

/// The origin of an act.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The player, by a structured action or by the answer of a language model.
    Player,
    /// The expired clock: the agent does nothing.
    Clock,
}

/// The act of a seat in a round.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActRecord {
    /// The agent's name.
    pub agent: String,
    /// The origin.
    pub source: Source,
    /// The action, if any.
    #[serde(deserialize_with = "Option::deserialize")]
    pub action: Option<String>,
    /// The message, if any, as it was delivered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// The only receiver of a commander's message.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<String>,
    /// True if the act counts, which an invalid answer of a language model does not.
    pub valid: bool,
    /// The reason why the answer is invalid, which journals of earlier versions do not contain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// The language model's answer, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub response: Option<String>,
    /// The tokens and duration of the answer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Box<Usage>>,
    /// Free text, stored for readers of replays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reasoning: Option<String>,
    /// What the player's program added to the prompt, and kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub harness: Option<Box<Harness>>,
    /// Milliseconds of the seat's bank that the act used.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub bank_spent_ms: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
const fn is_zero(value: &u64) -> bool {
    *value == 0
}

/// The decision of a seat in a round: the engine's act, and the texts around it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decision {
    /// The origin.
    pub source: Source,
    /// The act.
    pub act: Act,
    /// True if the act counts, which an invalid answer of a language model does not.
    pub valid: bool,
    /// The reason why the answer is invalid, which journals of earlier versions do not contain.
    pub failure: Option<Failure>,
    /// The language model's answer, if any.
    pub response: Option<String>,
    /// The tokens and duration of the answer.
    pub usage: Option<Box<Usage>>,
    /// Free text, stored for readers of replays.
    pub reasoning: Option<String>,
    /// What the player's program added to the prompt, and kept.
    pub harness: Option<Box<Harness>>,
}

impl Decision {
    /// The decision of a player without a language model's answer.
    #[must_use]
    pub const fn of_player(act: Act) -> Self {
        let source = Source::Player;
        Self {
            source,
            act,
            valid: true,
            failure: None,
            response: None,
            usage: None,
            reasoning: None,
            harness: None,
        }
    }

    /// The decision of a seat whose clock expired.
    #[must_use]
    pub fn clock_ran_out() -> Self {
        Self { source: Source::Clock, ..Self::of_player(Act::default()) }
    }

    /// The record of the decision.
    #[must_use]
    pub fn record(&self, agent: AgentId, bank_spent_ms: u64) -> ActRecord {
        let Self { source, act, valid, failure, response, usage, reasoning, harness } =
            self.clone();
        ActRecord {
            agent: agent.to_string(),
            source,
            action: act.action.map(|action| action.name().to_owned()),
            message: act.message.map(|message| message.to_string()),
            to: act.to.map(|to| to.to_string()),
            valid,
            failure,
            response,
            usage,
            reasoning,
            harness,
            bank_spent_ms,
        }
    }

    /// The record without the texts around the act, which may be large and which no state depends on. `None` if there are
    /// none.
    #[must_use]
    pub fn brief_record(&self, agent: AgentId, bank_spent_ms: u64) -> Option<ActRecord> {
        let Self { source, act, valid, failure, response, usage, reasoning, harness } = self;
        (response.is_some() || reasoning.is_some() || harness.is_some()).then(|| {
            let brief = Self {
                source: *source,
                act: act.clone(),
                valid: *valid,
                failure: *failure,
                response: None,
                usage: usage.clone(),
                reasoning: None,
                harness: None,
            };
            brief.record(agent, bank_spent_ms)
        })
    }

    /// Bytes of the texts that a player sent with the decision.
    #[must_use]
    pub fn text_bytes(&self) -> u64 {
        let message = self.act.message.as_ref().map(Message::as_str);
        let texts = [message, self.response.as_deref(), self.reasoning.as_deref()];
        let of_harness = self.harness.iter().flat_map(|harness| harness.texts());
        texts.into_iter().flatten().chain(of_harness).map(|text| text.len() as u64).sum()
    }
}

impl ActRecord {
    /// The record as a fork takes it over: the act and the message, without traces of who decided.
    #[must_use]
    pub fn taken_over(self) -> Self {
        let harness = None;
        Self { response: None, usage: None, reasoning: None, harness, bank_spent_ms: 0, ..self }
    }

    /// Removes the texts around the act; `None` if there are none.
    #[must_use]
    pub fn brief(self) -> Option<Self> {
        let has_texts =
            self.response.is_some() || self.reasoning.is_some() || self.harness.is_some();
        has_texts.then(|| self.without_texts())
    }

    /// The record without the texts around the act.
    #[must_use]
    pub fn without_texts(self) -> Self {
        Self { response: None, reasoning: None, harness: None, ..self }
    }

    /// True if the record has only the fields that a fork takes over.
    #[must_use]
    pub const fn is_taken_over(&self) -> bool {
        self.response.is_none()
            && self.usage.is_none()
            && self.reasoning.is_none()
            && self.harness.is_none()
            && self.bank_spent_ms == 0
    }

    /// Converts the record to an act of the engine; `None` for unknown names.
    #[must_use]
    pub fn act(&self, config: &Config) -> Option<Act> {
        let action = match &self.action {
            Some(name) => Some(Action::parse(config.task(), name)?),
            None => None,
        };
        let to = match &self.to {
            Some(name) => Some(AgentId::parse(name)?),
            None => None,
        };
        let message = match &self.message {
            // A recorded message is already normalised, so this must not change it.
            Some(text) => Some(Message::new(text).filter(|message| message.as_str() == text)?),
            None => None,
        };
        Some(Act { action, message, to })
    }

    /// Converts the record to a decision; `None` for unknown names.
    #[must_use]
    pub fn decision(self, config: &Config) -> Option<Decision> {
        let act = self.act(config)?;
        let Self { source, valid, failure, response, usage, reasoning, harness, .. } = self;
        Some(Decision { source, act, valid, failure, response, usage, reasoning, harness })
    }
}

/// The line of a journal file for the next record of a chain, and the head after it.
#[must_use]
pub fn next_line(record: &RawRecord, head: Head) -> (String, Head) {
    let head = head.link(record.as_str().as_bytes());
    (record.line(head), head)
}

/// A record around the serialized records of its acts, which equals the serialized [`Record`].
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum AroundActs<'a> {
    Round(Round<&'a RawValue>),
    End(End<&'a RawValue>),
}

/// Builds the record of a round from those of its acts.
#[must_use]
pub fn round_record<'a>(
    round: u32,
    acts: impl Iterator<Item = &'a RawRecord>,
    digest: &str,
    score: f64,
) -> RawRecord {
    let (acts, digest) = (acts.map(|act| &*act.0).collect(), digest.to_owned());
    RawRecord::write(&AroundActs::Round(Round { round, acts, digest, score }))
}

/// Builds the record of an end from those of the open round's acts.
#[must_use]
pub fn end_record(end: End<&RawRecord>) -> RawRecord {
    let End { status, reason, rounds, score, open_acts } = end;
    let open_acts = open_acts.into_iter().map(|act| &*act.0).collect();
    RawRecord::write(&AroundActs::End(End { status, reason, rounds, score, open_acts }))
}

/// The parts of a journal line before the first act and after the last, for writing the line act by act.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The line up to the opening bracket of the list of acts.
    pub before: String,
    /// The line from the closing bracket on.
    pub after: String,
}

impl Frame {
    /// The frame of a round.
    #[must_use]
    pub fn of_round(round: u32, digest: &str, score: f64, head: Head) -> Self {
        Self::of(&round_record(round, std::iter::empty(), digest, score), head)
    }

    /// The frame of an end, whatever its acts.
    #[must_use]
    pub fn of_end(end: End, head: Head) -> Self {
        let End { status, reason, rounds, score, .. } = end;
        let end = End { status, reason, rounds, score, open_acts: Vec::new() };
        Self::of(&end_record(end), head)
    }

    /// Splits the line of a record at its empty list, which is the only one.
    fn of(record: &RawRecord, head: Head) -> Self {
        let line = record.line(head);
        let place = line.rfind("[]").map_or(line.len(), |place| place + 1);
        let (before, after) = line.split_at(place);
        Self { before: before.to_owned(), after: after.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Old journals contain settings that no new episode may have, and such episodes are played to their end.
    #[test]
    fn a_journal_of_settings_that_are_too_large_for_a_new_episode_is_read() {
        let settings = Settings {
            num_agents: 1024,
            width: 256,
            height: 256,
            view_size: 513,
            memory: 0,
            ..Settings::standard(swarmbench_engine::TaskName::Transport, 1)
        };
        assert!(Config::admit(&settings).is_err());
        let text = serde_json::json!({
            "task": settings.task, "rules": settings.rules, "control": settings.control, "seed": 1,
            "num_agents": 1024, "width": 256, "height": 256, "view_size": 513, "memory": 0,
            "max_round": 100, "noise": 0.0, "max_delay": 0, "round_deadline_ms": null, "bank_ms": 0,
            "start": "now", "idle_timeout_ms": 1000, "visibility": "public", "model": "m",
            "custom_template": false,
        });
        let recorded: RecordedConfig = serde_json::from_value(text).expect("a configuration");
        assert_eq!(recorded.engine().expect("it can be played").settings(), settings);
    }

    fn two_acts() -> Vec<ActRecord> {
        vec![
            ActRecord {
                agent: "Agent_0".to_owned(),
                source: Source::Player,
                action: Some("UP".to_owned()),
                message: Some("a \"quoted\" – [] line".to_owned()),
                to: None,
                valid: true,
                failure: None,
                response: Some("x\nACTION: UP".to_owned()),
                usage: Some(Box::new(Usage { prompt_tokens: Some(3), ..Usage::default() })),
                reasoning: None,
                harness: None,
                bank_spent_ms: 12,
            },
            Decision::clock_ran_out().record(AgentId(1), 0),
        ]
    }

    /// A line is written act by act, but hashed as a whole.
    #[test]
    fn a_line_written_act_by_act_is_the_line_written_at_once() {
        let head = Head([7; 32]);
        let acts = two_acts();
        let raw: Vec<RawRecord> = acts.iter().map(RawRecord::write).collect();
        for count in 0..=2 {
            let joined: Vec<&str> = raw[..count].iter().map(RawRecord::as_str).collect();
            let joined = joined.join(",");
            let round = Frame::of_round(3, "00ff", 0.1, head);
            let whole = round_record(3, raw[..count].iter(), "00ff", 0.1).line(head);
            assert_eq!(format!("{}{joined}{}", round.before, round.after), whole);
            let end = End {
                status: "aborted".to_owned(),
                reason: "aborted".to_owned(),
                rounds: 3,
                score: -1.5,
                open_acts: acts[..count].to_vec(),
            };
            let whole = RawRecord::write(&Record::End(end.clone())).line(head);
            let End { status, reason, rounds, score, .. } = end.clone();
            let open_acts = raw[..count].iter().collect();
            let from_bytes = end_record(End { status, reason, rounds, score, open_acts });
            assert_eq!(from_bytes.line(head), whole);
            let end = Frame::of_end(end, head);
            assert_eq!(format!("{}{joined}{}", end.before, end.after), whole);
        }
    }

    #[test]
    fn a_record_has_its_kind_anywhere_and_once_and_all_its_fields() {
        let read = |text: &str| Record::parse(text).map_err(|error| error.to_string());
        let rest = r#""status":"aborted","reason":"aborted","rounds":0,"score":0.5,"open_acts":[]"#;
        for text in [
            format!(r#"{{"kind":"end",{rest}}}"#),
            format!(r#"{{{rest},"kind":"end"}}"#),
            format!(r#"{{{rest},"k\u0069nd":"e\u006ed"}}"#),
        ] {
            assert!(matches!(read(&text), Ok(Record::End(_))), "{text}");
        }
        let act = r#"{"agent":"Agent_0","source":"clock","valid":true}"#;
        for (text, says) in [
            (format!(r#"{{"kind":"end",{rest},"kind":"end"}}"#), "duplicate field `kind`"),
            (format!(r#"{{"kind":"end",{rest},"rounds":0}}"#), "duplicate field `rounds`"),
            (format!(r#"{{"kind":"end",{rest},"more":0}}"#), "unknown field `more`"),
            (format!(r#"{{"kind":"end",{rest}}} 1"#), "trailing characters"),
            (format!(r#"{{"kind":"other",{rest}}}"#), "unknown variant `other`"),
            (format!("{{{rest}}}"), "missing field `kind`"),
            (
                format!(r#"{{"kind":"end",{}}}"#, rest.replace("[]", &format!("[{act}]"))),
                "missing field `action`",
            ),
        ] {
            let problem = read(&text).expect_err("it is no record");
            assert!(problem.contains(says), "{text}: {problem}");
        }
    }

    /// The first fault is reported where it is: nothing reads the record a second time, with more memory.
    #[test]
    fn a_record_that_is_wrong_is_read_once() {
        let acts = "1,".repeat(1000);
        let text = format!(r#"{{"kind":"round","round":0,"acts":[{acts}"#);
        let problem = Record::parse(&text).expect_err("an act is a number").to_string();
        assert!(problem.contains("invalid type: integer `1`"), "{problem}");
    }

    /// A round is joined from the bytes of its acts, but read as a whole.
    #[test]
    fn a_round_joined_from_its_acts_is_the_round_written_at_once() {
        let acts = two_acts();
        let raw: Vec<RawRecord> = acts.iter().map(RawRecord::write).collect();
        let score = 9.950_000_000_000_001;
        let joined = round_record(7, raw.iter(), "00ff", score);
        let whole = Record::Round(Round { round: 7, acts, digest: "00ff".to_owned(), score });
        assert_eq!(joined.as_str(), RawRecord::write(&whole).as_str());
        let Record::Round(read) = joined.read().expect("a record") else { panic!("not a round") };
        assert_eq!(read.score.to_bits(), score.to_bits());
        assert!(!joined.as_str().contains("\"bank_spent_ms\":0"));
    }
}
