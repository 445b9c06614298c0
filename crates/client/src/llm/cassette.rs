//! Cassettes: files of answers. A recorded conversation is replayed without the endpoint, and an interrupted run pays for no
//! answer twice.
//!
//! A cassette is a text file of JSON lines. The first line names the format. A *voice* is a model, identified by the
//! body of its requests without the messages; one file holds as many as an experiment has. Every other line is an
//! answer: its voice, game, agent and round, the SHA-256 of the prompt and of the system message, and the answer. The
//! file contains no key, no address and no prompt.
//!
//! All of these fields, the prompt included, identify an answer. If a game diverges from the recording, no answer is found, and
//! none is invented.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::Question;
use super::completion::ModelAnswer;
use super::stop::Stop;
use crate::lines::{Hash, Header, LinePosition, Lines, digest, hash};
use swarmbench_protocol::act::{Usage, UsageSums};

/// Version of the format.
pub const VERSION: u32 = 1;

const HEADER: Header = Header { kind: "cassette", version: VERSION };

/// A cassette. Clones share it; all models of an evaluation use the same one.
#[derive(Clone, Debug)]
pub struct Cassette(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    is_recording: bool,
    tape: Mutex<Tape>,
}

/// File with its index. Answers stay in the file, as there may be many.
#[derive(Debug)]
struct Tape {
    lines: Lines,
    index: Index,
}

#[derive(Debug, Default)]
struct Index {
    models: Vec<Map<String, Value>>,
    games: BTreeSet<(usize, String)>,
    /// Hashes of voice, game, agent and round, without the prompt.
    places: HashSet<Hash>,
    /// Positions of answers by their keys.
    answers: HashMap<Hash, LinePosition>,
    /// Sums of the answers of each voice.
    sums: HashMap<usize, Recorded>,
}

/// Sums over the recorded answers of a model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Recorded {
    /// Acts that were asked for; further tries of one are not counted.
    pub acts: u64,
    /// Answers with a number of tokens.
    pub answers: u64,
    /// Tokens of their prompts.
    pub prompt_tokens: u64,
    /// Tokens of the answers.
    pub completion_tokens: u64,
    /// Tokens of caches and of reasoning.
    pub usage: UsageSums,
}

/// A line that declares a model by the body of its requests.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelLine {
    voice: usize,
    body: Map<String, Value>,
}

/// A line with an answer.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AnswerLine {
    voice: usize,
    game: String,
    agent: String,
    round: u32,
    /// SHA-256 of the prompt, and of the items before it, if there are any.
    prompt: String,
    /// SHA-256 of the system message, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    system: Option<String>,
    answer: ModelAnswer,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "a line with a model or an answer was expected")]
enum Line {
    Answer(Box<AnswerLine>),
    Model(ModelLine),
}

impl Cassette {
    /// Opens or creates a cassette for recording, by one process at a time.
    ///
    /// # Errors
    /// [`Stop::Cassette`] if the file cannot be written, is no cassette, or is in use.
    pub fn record(path: &Path) -> Result<Self, Stop> {
        Self::open(path, true)
    }

    /// Opens a cassette for replay: no endpoint is ever asked.
    ///
    /// # Errors
    /// [`Stop::Cassette`] if the file cannot be read or is no cassette.
    pub fn replay(path: &Path) -> Result<Self, Stop> {
        Self::open(path, false)
    }

    fn open(path: &Path, is_recording: bool) -> Result<Self, Stop> {
        let mut index = Index::default();
        let take = |place, line: &[u8]| index.take(place, line).map_err(str::to_owned);
        let lines = Lines::open(path, is_recording, HEADER, take)
            .map_err(|what| Stop::Cassette { path: path.to_owned(), what })?;
        let tape = Mutex::new(Tape { lines, index });
        Ok(Self(Arc::new(Inner { path: path.to_owned(), is_recording, tape })))
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// A replay records nothing.
    #[must_use]
    pub fn is_replay(&self) -> bool {
        !self.0.is_recording
    }

    /// Number of answers.
    #[must_use]
    pub fn answers(&self) -> usize {
        self.0.tape().index.answers.len()
    }

    /// Sums of the recorded answers of a model with this body of requests; `None` without any.
    #[must_use]
    pub fn recorded(&self, body: &Map<String, Value>) -> Option<Recorded> {
        let Tape { index, .. } = &*self.0.tape();
        let voice = index.models.iter().position(|known| known == body)?;
        index.sums.get(&voice).copied().filter(|sums| sums.answers > 0)
    }

    /// Recorded model with this request body. A recording cassette adds an unknown one.
    pub(super) fn model(&self, body: &Map<String, Value>) -> Result<RecordedModel, Stop> {
        let mut tape = self.0.tape();
        let known = tape.index.models.iter().position(|known| known == body);
        let number = match known {
            Some(number) => Some(number),
            None if self.0.is_recording => {
                let number = tape.index.models.len();
                let line = ModelLine { voice: number, body: body.clone() };
                tape.lines.write(&line).map_err(|error| self.0.failed(&error))?;
                tape.index.models.push(line.body);
                Some(number)
            }
            None => None,
        };
        Ok(RecordedModel { cassette: self.clone(), number, body: body.clone() })
    }
}

impl Inner {
    fn tape(&self) -> MutexGuard<'_, Tape> {
        self.tape.lock().expect("nothing panics while it holds this")
    }

    fn failed(&self, error: &io::Error) -> Stop {
        Stop::Cassette { path: self.path.clone(), what: error.to_string() }
    }
}

/// A model on a cassette.
#[derive(Clone, Debug)]
pub(super) struct RecordedModel {
    cassette: Cassette,
    /// `None` if a replayed cassette has no answers of this model.
    number: Option<usize>,
    body: Map<String, Value>,
}

impl RecordedModel {
    /// Recorded answer to a question; `None` if the endpoint may be asked.
    pub(super) fn find(&self, question: &Question) -> Result<Option<ModelAnswer>, Stop> {
        let Cassette(inner) = &self.cassette;
        let mut tape = inner.tape();
        let found = self.number.map(|number| tape.find(number, question)).transpose();
        match found.map_err(|error| inner.failed(&error))?.flatten() {
            Some(answer) => Ok(Some(answer)),
            None if inner.is_recording => Ok(None),
            None => Err(Stop::NotOnCassette {
                path: inner.path.clone(),
                game: question.game.clone(),
                agent: question.agent.clone(),
                round: question.round,
                why: self.why_not(&tape.index, question),
            }),
        }
    }

    pub(super) fn record(&self, question: &Question, answer: &ModelAnswer) -> Result<(), Stop> {
        let Cassette(inner) = &self.cassette;
        let Some(voice) = self.number else { return Ok(()) };
        let line = AnswerLine {
            voice,
            game: question.game.clone(),
            agent: question.agent.clone(),
            round: question.round,
            prompt: digest_of(question),
            system: question.system.as_deref().map(digest),
            answer: answer.clone(),
        };
        let mut tape = inner.tape();
        let place = tape.lines.write(&line).map_err(|error| inner.failed(&error))?;
        tape.index.note(&line, place);
        Ok(())
    }

    fn why_not(&self, index: &Index, question: &Question) -> String {
        let Some(number) = self.number else {
            let text = |body: &Map<String, Value>| Value::Object(body.clone()).to_string();
            let known: Vec<_> = index.models.iter().map(text).collect();
            return format!(
                "it has no answers of a model that is asked with {}, but of {}",
                text(&self.body),
                if known.is_empty() { "none".to_owned() } else { known.join(" and ") }
            );
        };
        if !index.games.contains(&(number, question.game.clone())) {
            return "it has no game of this name; another task, seed or setting than those that were recorded?".to_owned();
        }
        if index.places.contains(&hash(&(number, &question.game, &question.agent, question.round)))
        {
            return "it has an answer to another prompt there, so the game has gone another way than when it was recorded: \
                    another template or system message, other rules, or an answer that came from elsewhere"
                .to_owned();
        }
        "the recording ends before this; record more by asking the endpoint".to_owned()
    }
}

impl Tape {
    fn find(&mut self, voice: usize, question: &Question) -> io::Result<Option<ModelAnswer>> {
        let Question { game, agent, round, system, .. } = question;
        let system = system.as_deref().map(digest);
        let asked = key(voice, game, agent, *round, &digest_of(question), system.as_deref());
        let Some(place) = self.index.answers.get(&asked) else { return Ok(None) };
        let text = self.lines.read(*place)?;
        Ok(Some(serde_json::from_slice::<AnswerLine>(&text)?.answer))
    }
}

impl Index {
    fn take(&mut self, place: LinePosition, text: &[u8]) -> Result<(), &'static str> {
        match serde_json::from_slice(text) {
            Ok(Line::Model(line)) if line.voice == self.models.len() => self.models.push(line.body),
            Ok(Line::Answer(line)) if line.voice < self.models.len() => self.note(&line, place),
            Ok(_) => return Err("names a model that is not there"),
            Err(_) => return Err("is not one of a cassette; the rest can be used without it"),
        }
        Ok(())
    }

    fn note(&mut self, line: &AnswerLine, place: LinePosition) {
        let AnswerLine { voice, game, agent, round, prompt, system, .. } = line;
        self.games.insert((*voice, game.clone()));
        let is_new = self.places.insert(hash(&(voice, game, agent, round)));
        let answer = key(*voice, game, agent, *round, prompt, system.as_deref());
        self.answers.insert(answer, place);
        let sums = self.sums.entry(*voice).or_default();
        sums.acts += u64::from(is_new);
        if let Usage { prompt_tokens: Some(read), completion_tokens: Some(said), .. } =
            line.answer.usage
        {
            sums.answers += 1;
            sums.prompt_tokens = sums.prompt_tokens.saturating_add(read);
            sums.completion_tokens = sums.completion_tokens.saturating_add(said);
            sums.usage.count(&line.answer.usage);
        }
    }
}

/// Digest of a prompt, of the items before it, and of the schema of its answer.
fn digest_of(Question { prompt, items, schema, .. }: &Question) -> String {
    match schema {
        None if items.is_empty() => digest(prompt),
        None => digest(&json!([items, prompt]).to_string()),
        Some(schema) => digest(&json!([items, prompt, schema]).to_string()),
    }
}

/// Key of an answer. Without a system message it equals that of older cassettes.
fn key(
    voice: usize,
    game: &str,
    agent: &str,
    round: u32,
    prompt: &str,
    system: Option<&str>,
) -> Hash {
    let asked = (voice, game, agent, round, prompt);
    system.map_or_else(|| hash(&asked), |system| hash(&(asked, system)))
}
