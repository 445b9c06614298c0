//! The records of a journal and their bytes.
//!
//! A record is a JSON object without line breaks; its bytes are what the chain hashes, so they are
//! stored and never written anew. In a journal file each line is
//! `{"hash":"…","record":{…}}` with the head of the chain after the record.

use std::sync::Arc;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error as _, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::value::RawValue;
use swarmbench_engine::{Act, Action, AgentId, Config, Message, Seed, SettingErrors, Settings};

use super::chain::Head;
pub use swarmbench_protocol::act::Usage;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::failure::Failure;

/// The version of this format.
pub const FORMAT: u32 = 1;

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
    /// The bytes of a record as it is first written.
    pub fn write<T: Serialize>(record: &T) -> Self {
        Self(serde_json::value::to_raw_value(record).expect("records have string keys").into())
    }

    /// A record from the store.
    ///
    /// # Errors
    /// If they are no JSON.
    pub fn from_stored(text: String) -> Result<Self, serde_json::Error> {
        RawValue::from_string(text).map(|value| Self(value.into()))
    }

    /// The record as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        self.0.get()
    }

    /// Reads the record.
    ///
    /// # Errors
    /// If it is another kind of record.
    pub fn read<'a, T: Deserialize<'a>>(&'a self) -> Result<T, serde_json::Error> {
        serde_json::from_str(self.as_str())
    }

    /// The line of a journal file for this record.
    #[must_use]
    pub fn line(&self, head: Head) -> String {
        format!("{{\"hash\":\"{head}\",\"record\":{}}}\n", self.as_str())
    }
}

/// A record of any kind; its field `kind` says which.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Record {
    /// The first record.
    Opening(Box<Opening>),
    /// Who holds which seat; only where there are several holders, or the server hosts players.
    Seats(Seats),
    /// A resolved round.
    Round(Round),
    /// The last record.
    End(End),
}

/// A record that begins with its kind, as it is written. Unlike [`Record`], which keeps all fields until it has found the
/// kind, it is read in one pass.
struct KindFirst(Record);

impl<'de> Deserialize<'de> for KindFirst {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Fields;
        impl<'de> Visitor<'de> for Fields {
            type Value = Record;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a record")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Record, A::Error> {
                let kind = map.next_entry::<&str, &str>()?;
                let rest = MapAccessDeserializer::new(map);
                match kind {
                    Some(("kind", "opening")) => Box::deserialize(rest).map(Record::Opening),
                    Some(("kind", "seats")) => Seats::deserialize(rest).map(Record::Seats),
                    Some(("kind", "round")) => Round::deserialize(rest).map(Record::Round),
                    Some(("kind", "end")) => End::deserialize(rest).map(Record::End),
                    _ => Err(A::Error::missing_field("kind")),
                }
            }
        }
        deserializer.deserialize_map(Fields).map(Self)
    }
}

impl Record {
    /// Reads a record.
    ///
    /// # Errors
    /// If the text is none.
    pub fn parse(text: &str) -> Result<Self, serde_json::Error> {
        let read = serde_json::from_str(text).map(|KindFirst(record)| record);
        read.or_else(|_| serde_json::from_str(text))
    }
}

/// What an episode is.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Opening {
    /// The version of the format.
    pub format: u32,
    /// The public id.
    pub episode: String,
    /// The revision of the rules by which it is played.
    pub rules_revision: u32,
    /// When it was created.
    pub created_at: jiff::Timestamp,
    /// All settings.
    pub config: RecordedConfig,
    /// Who plays: further fields of the creator.
    pub agent_meta: Carried,
    /// The text of the prompt template.
    pub prompt_template: String,
    /// The revision of the words that the program itself puts into prompts; journals before revision 2 name none.
    #[serde(default = "first_prompt_revision", skip_serializing_if = "is_first_prompt_revision")]
    pub prompt_revision: u32,
    /// The digest of the layout, in hexadecimal.
    pub digest: String,
    /// The public id of the run to which it belongs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Random hexadecimal digits in a sealed episode, so that its seed cannot be found by trying seeds until the hashes
    /// match.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub salt: Option<String>,
    /// From which state of another episode it continues, if it is a fork.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fork: Option<Fork>,
}

/// The state of another episode from which a fork continues. The journal of the fork has all rounds before it, too.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fork {
    /// The public id of the other episode, its parent.
    pub episode: String,
    /// How many rounds of the parent were taken over; also the first round of the fork's own.
    pub round: u32,
    /// The head of the parent's chain before that round, in hexadecimal.
    pub head: String,
}

/// The revision of prompts in journals that name none.
#[must_use]
pub const fn first_prompt_revision() -> u32 {
    1
}

/// Whether journals leave this revision out.
#[must_use]
pub const fn is_first_prompt_revision(revision: &u32) -> bool {
    *revision == 1
}

impl Opening {
    /// Whether boards count the episode: it belongs to a run, or several holders play it, and it is no fork.
    #[must_use]
    pub fn counts(&self) -> bool {
        let is_listed = self.run.is_some() || !self.config.open_seats.is_empty();
        is_listed && self.fork.is_none()
    }

    /// The first round that was decided in the episode itself: all before it were taken over from its parent.
    #[must_use]
    pub fn first_round(&self) -> u32 {
        self.fork.as_ref().map_or(0, |fork| fork.round)
    }
}

swarmbench_protocol::game_settings! {
    checked
    /// All settings of an episode, under the names that the wire has for them.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    #[expect(missing_docs, reason = "the names are those of the wire, described there")]
    pub struct RecordedConfig {
        pub task: String,
        pub rules: String,
        pub control: String,
        pub seed: Seed,
        ..settings,
        pub round_deadline_ms: Option<u64>,
        pub bank_ms: u64,
        pub start: String,
        pub idle_timeout_ms: u64,
        pub visibility: String,
        pub model: String,
        pub custom_template: bool,
        /// No round begins at or after this time.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub closes_at: Option<jiff::Timestamp>,
        /// Numbers of the agents whose seats were open to claims.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        pub open_seats: Vec<u16>,
        /// The time after which built-in players take the unclaimed seats.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub fill_after_ms: Option<u64>,
        /// Which built-in player takes them.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub fill_with: Option<String>,
        /// The built-in player that the server hosts on the creator's seats.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pub player: Option<String>,
    }
}

impl RecordedConfig {
    /// The engine's part of the settings; the rest has its defaults.
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

    /// The engine's part of the settings, checked.
    ///
    /// # Errors
    /// If these settings are not allowed, or no longer.
    pub fn engine(&self) -> Result<Config, SettingErrors> {
        Config::check(&Settings {
            task: self.task.clone(),
            rules: self.rules.clone(),
            seed: self.seed.into(),
            ..Settings::from(self)
        })
    }
}

/// Who holds which seat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seats {
    /// All that hold seats, in order of their numbers.
    pub holders: Vec<SeatHolder>,
    /// All seats, in order of the agents' numbers.
    pub seats: Vec<HeldSeat>,
}

/// Who holds seats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeatHolder {
    /// The number of the claim in its episode; 0 is the creator.
    pub holder: u32,
    /// Who plays.
    pub model: String,
    /// Who plays: further fields of the holder.
    pub agent_meta: Carried,
    /// The public id of the holder's key, where one was needed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
    /// The built-in player that the server hosts on these seats, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub player: Option<String>,
}

/// A seat that has a holder.
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
    /// Its number, from 0.
    pub round: u32,
    /// What every living agent did.
    pub acts: Vec<A>,
    /// The digest of the state after it, in hexadecimal.
    pub digest: String,
    /// The score after it.
    pub score: f64,
}

/// The end of an episode.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct End<A = ActRecord> {
    /// `finished`, `aborted` or `abandoned`.
    pub status: String,
    /// Why: `task_done`, `rounds_played`, `aborted`, `idle` or `closed`.
    pub reason: String,
    /// How many rounds were resolved.
    pub rounds: u32,
    /// The final score.
    pub score: f64,
    /// Acts of a round that was not resolved any more.
    pub open_acts: Vec<A>,
}

/// Who decided an act.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The player, by a structured action or by the answer of a language model.
    Player,
    /// The clock: it expired, so the agent does nothing.
    Clock,
}

/// What a seat did in a round.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActRecord {
    /// The agent's name.
    pub agent: String,
    /// Who decided.
    pub source: Source,
    /// The action, if any.
    pub action: Option<String>,
    /// The message, if any, as it was delivered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// The only receiver of a commander's message.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub to: Option<String>,
    /// False for an invalid answer of a language model.
    pub valid: bool,
    /// Why the answer is invalid. Journals of earlier versions do not tell it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<Failure>,
    /// The language model's answer, where it gave one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub response: Option<String>,
    /// What the answer cost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub usage: Option<Usage>,
    /// Free text, stored for readers of replays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reasoning: Option<String>,
    /// The part of the seat's bank that the act used, in milliseconds.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub bank_spent_ms: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
const fn is_zero(value: &u64) -> bool {
    *value == 0
}

/// What a seat decided in a round: the engine's act, and what was said around it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decision {
    /// Who decided.
    pub source: Source,
    /// What the agent does.
    pub act: Act,
    /// False for an invalid answer of a language model.
    pub valid: bool,
    /// Why the answer is invalid. Journals of earlier versions do not tell it.
    pub failure: Option<Failure>,
    /// The language model's answer, where it gave one.
    pub response: Option<String>,
    /// What the answer cost.
    pub usage: Option<Usage>,
    /// Free text, stored for readers of replays.
    pub reasoning: Option<String>,
}

impl Decision {
    /// An act of a player, without an answer of a language model.
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
        }
    }

    /// The decision of a seat whose clock expired.
    #[must_use]
    pub fn clock_ran_out() -> Self {
        Self { source: Source::Clock, ..Self::of_player(Act::default()) }
    }

    /// Its record.
    #[must_use]
    pub fn record(&self, agent: AgentId, bank_spent_ms: u64) -> ActRecord {
        let Self { source, act, valid, failure, response, usage, reasoning } = self.clone();
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
            bank_spent_ms,
        }
    }

    /// Its record without the answer of a language model and the reasoning: no state follows from these, and they may be
    /// large. `None` where it has neither.
    #[must_use]
    pub fn brief_record(&self, agent: AgentId, bank_spent_ms: u64) -> Option<ActRecord> {
        let Self { source, act, valid, failure, response, usage, reasoning } = self;
        (response.is_some() || reasoning.is_some()).then(|| {
            let brief = Self {
                source: *source,
                act: act.clone(),
                valid: *valid,
                failure: *failure,
                response: None,
                usage: *usage,
                reasoning: None,
            };
            brief.record(agent, bank_spent_ms)
        })
    }

    /// Bytes of the texts that a player sent with it.
    #[must_use]
    pub fn text_bytes(&self) -> u64 {
        let message = self.act.message.as_ref().map(Message::as_str);
        let texts = [message, self.response.as_deref(), self.reasoning.as_deref()];
        texts.into_iter().flatten().map(|text| text.len() as u64).sum()
    }
}

impl ActRecord {
    /// As a fork takes it over: what it did and said in the game, and nothing of who decided it.
    #[must_use]
    pub fn taken_over(self) -> Self {
        Self { response: None, usage: None, reasoning: None, bank_spent_ms: 0, ..self }
    }

    /// Without the answer of a language model and the reasoning; `None` where it has neither.
    #[must_use]
    pub fn brief(self) -> Option<Self> {
        let has_texts = self.response.is_some() || self.reasoning.is_some();
        has_texts.then_some(Self { response: None, reasoning: None, ..self })
    }

    /// Whether it is as a fork takes it over.
    #[must_use]
    pub const fn is_taken_over(&self) -> bool {
        self.response.is_none()
            && self.usage.is_none()
            && self.reasoning.is_none()
            && self.bank_spent_ms == 0
    }

    /// The act for the engine, if the names in it are known.
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
            // It was normalised before it was recorded, and doing so again changes nothing.
            Some(text) => Some(Message::new(text).filter(|message| message.as_str() == text)?),
            None => None,
        };
        Some(Act { action, message, to })
    }

    /// What was decided, if the names in it are known.
    #[must_use]
    pub fn decision(self, config: &Config) -> Option<Decision> {
        let act = self.act(config)?;
        let Self { source, valid, failure, response, usage, reasoning, .. } = self;
        Some(Decision { source, act, valid, failure, response, usage, reasoning })
    }
}

/// The line of a journal file for the next record of a chain, and the head after it.
#[must_use]
pub fn next_line(record: &RawRecord, head: Head) -> (String, Head) {
    let head = head.link(record.as_str().as_bytes());
    (record.line(head), head)
}

/// A record that is written around the bytes of its acts: the same as writing a [`Record`].
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum AroundActs<'a> {
    Round(Round<&'a RawValue>),
    End(End<&'a RawValue>),
}

/// The record of a round around those of its acts.
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

/// The record of an end around those of the acts of its open round.
#[must_use]
pub fn end_record(end: End<&RawRecord>) -> RawRecord {
    let End { status, reason, rounds, score, open_acts } = end;
    let open_acts = open_acts.into_iter().map(|act| &*act.0).collect();
    RawRecord::write(&AroundActs::End(End { status, reason, rounds, score, open_acts }))
}

/// The line of a journal file for a record with a list of acts, before the first act and after the last: a
/// line can be written act by act.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Up to the opening bracket of the list.
    pub before: String,
    /// From the closing bracket of the list on.
    pub after: String,
}

impl Frame {
    /// The frame of a round.
    #[must_use]
    pub fn of_round(round: u32, digest: &str, score: f64, head: Head) -> Self {
        Self::of(&round_record(round, std::iter::empty(), digest, score), head)
    }

    /// The frame of an end, whatever acts it has now.
    #[must_use]
    pub fn of_end(end: End, head: Head) -> Self {
        let End { status, reason, rounds, score, .. } = end;
        let end = End { status, reason, rounds, score, open_acts: Vec::new() };
        Self::of(&end_record(end), head)
    }

    /// Splits the line of a record with an empty list; nothing else in such a record is an empty list.
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

    /// Settings that no new episode may have are in old journals, and these are played to their end.
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
                usage: Some(Usage { prompt_tokens: Some(3), ..Usage::default() }),
                reasoning: None,
                bank_spent_ms: 12,
            },
            Decision::clock_ran_out().record(AgentId(1), 0),
        ]
    }

    /// Lines are written act by act, and hashed as a whole: both must agree.
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

    /// Rounds are written from the bytes of their acts, and read as a whole: both must agree.
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
