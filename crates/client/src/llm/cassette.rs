//! Answers in a file: a recorded conversation is replayed without the endpoint, and an interrupted run pays for no
//! answer twice.
//!
//! A cassette is a text file of JSON lines. The first says what it is. A *voice* is a model, given by the body of
//! its requests but for the messages; one file holds as many as an experiment has. All other lines are answers: whose
//! voice, which game, agent and round, the SHA-256 of the prompt, and the answer. No key, no address and no prompt is in
//! it.
//!
//! An answer is found by all of these, the prompt included: where a game takes another way than it was recorded, nothing
//! is made up. A line is written in one go before its answer is used; what a crash left of a last line is cut off.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

use data_encoding::HEXLOWER;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::Question;
use super::completion::Answer;
use super::stop::Stop;

/// The version of the format.
pub const VERSION: u32 = 1;

/// Bytes of a line: far more than an answer has.
const LINE_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// What the first line of every cassette names.
const NAME: &str = "swarmbench";

/// A cassette. Cloning shares it; all models of an evaluation use the same one.
#[derive(Clone, Debug)]
pub struct Cassette(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    is_recording: bool,
    tape: Mutex<Tape>,
}

/// The file and its index. Answers stay in the file, as there may be many.
#[derive(Debug)]
struct Tape {
    file: File,
    end: u64,
    models: Vec<Map<String, Value>>,
    games: BTreeSet<(usize, String)>,
    /// Rounds of agents, whatever they were asked.
    places: HashSet<Hash>,
    /// Answers: where their lines begin, and how long they are.
    answers: HashMap<Hash, (u64, usize)>,
    /// Whether a write failed: what would follow it might be unreadable.
    is_broken: bool,
}

type Hash = [u8; 32];

/// The first line.
#[derive(Serialize, Deserialize)]
struct Header {
    cassette: String,
    version: u32,
}

impl Header {
    fn current() -> Self {
        Self { cassette: NAME.to_owned(), version: VERSION }
    }
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
    /// SHA-256 of the prompt.
    prompt: String,
    answer: Answer,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    Answer(AnswerLine),
    Model(ModelLine),
}

impl Cassette {
    /// Opens or creates a cassette for recording, by one process at a time.
    ///
    /// # Errors
    /// [`Stop::Cassette`] where it cannot be written, is no cassette, or is in use.
    pub fn record(path: &Path) -> Result<Self, Stop> {
        Self::open(path, true)
    }

    /// Opens a cassette for replay: no endpoint is ever asked.
    ///
    /// # Errors
    /// [`Stop::Cassette`] where it cannot be read or is no cassette.
    pub fn replay(path: &Path) -> Result<Self, Stop> {
        Self::open(path, false)
    }

    fn open(path: &Path, is_recording: bool) -> Result<Self, Stop> {
        let wrong = |what: String| Stop::Cassette { path: path.to_owned(), what };
        let failed = |error: io::Error| wrong(error.to_string());
        let mut options = OpenOptions::new();
        options.read(true).append(is_recording).create(is_recording);
        let file = options.open(path).map_err(failed)?;
        if !file.metadata().map_err(failed)?.is_file() {
            return Err(wrong("it is no regular file".to_owned()));
        }
        if is_recording && matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
            return Err(wrong("another process records on it".to_owned()));
        }
        let mut tape = Tape {
            file,
            end: 0,
            models: Vec::new(),
            games: BTreeSet::new(),
            places: HashSet::new(),
            answers: HashMap::new(),
            is_broken: false,
        };
        tape.read().map_err(wrong)?;
        if is_recording {
            let length = tape.file.metadata().map_err(failed)?.len();
            if length > tape.end {
                tape.file.set_len(tape.end).map_err(failed)?;
            }
            if tape.end == 0 {
                tape.write(&Header::current()).map_err(failed)?;
            }
        } else if tape.end == 0 {
            return Err(wrong("it is empty".to_owned()));
        }
        Ok(Self(Arc::new(Inner { path: path.to_owned(), is_recording, tape: Mutex::new(tape) })))
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Whether it only replays.
    #[must_use]
    pub fn is_replay(&self) -> bool {
        !self.0.is_recording
    }

    /// How many answers it has.
    #[must_use]
    pub fn answers(&self) -> usize {
        self.0.tape().answers.len()
    }

    /// The recorded model with this request body; it is added where it is new.
    pub(super) fn model(&self, body: &Map<String, Value>) -> Result<RecordedModel, Stop> {
        let mut tape = self.0.tape();
        let known = tape.models.iter().position(|known| known == body);
        let number = match known {
            Some(number) => Some(number),
            None if self.0.is_recording => {
                let number = tape.models.len();
                let line = ModelLine { voice: number, body: body.clone() };
                tape.write(&line).map_err(|error| self.0.failed(&error))?;
                tape.models.push(line.body);
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
    /// `None` if the cassette has no answers of this model, and does not record.
    number: Option<usize>,
    body: Map<String, Value>,
}

impl RecordedModel {
    /// The answer to a question; `None` if the endpoint may be asked.
    pub(super) fn find(&self, question: &Question) -> Result<Option<Answer>, Stop> {
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
                why: self.why_not(&tape, question),
            }),
        }
    }

    /// Records an answer.
    pub(super) fn record(&self, question: &Question, answer: &Answer) -> Result<(), Stop> {
        let Cassette(inner) = &self.cassette;
        let Some(voice) = self.number else { return Ok(()) };
        let line = AnswerLine {
            voice,
            game: question.game.clone(),
            agent: question.agent.clone(),
            round: question.round,
            prompt: digest(&question.prompt),
            answer: answer.clone(),
        };
        let mut tape = inner.tape();
        let (from, length) = tape.write(&line).map_err(|error| inner.failed(&error))?;
        tape.note(&line, from, length);
        Ok(())
    }

    fn why_not(&self, tape: &Tape, question: &Question) -> String {
        let Some(number) = self.number else {
            let text = |body: &Map<String, Value>| Value::Object(body.clone()).to_string();
            let known: Vec<_> = tape.models.iter().map(text).collect();
            return format!(
                "it has no answers of a model that is asked with {}, but of {}",
                text(&self.body),
                if known.is_empty() { "none".to_owned() } else { known.join(" and ") }
            );
        };
        if !tape.games.contains(&(number, question.game.clone())) {
            return "it has no game of this name; another task, seed or setting than those that were recorded?".to_owned();
        }
        if tape.places.contains(&hash(&(number, &question.game, &question.agent, question.round))) {
            return "it has an answer to another prompt there, so the game has gone another way than when it was recorded: \
                    another template, other rules, or an answer that came from elsewhere"
                .to_owned();
        }
        "the recording ends before this; record more by asking the endpoint".to_owned()
    }
}

impl Tape {
    /// Reads all whole lines.
    fn read(&mut self) -> Result<(), String> {
        let text = |error: io::Error| error.to_string();
        let mut reader = BufReader::new(self.file.try_clone().map_err(text)?);
        let mut line = Vec::new();
        for number in 1_u64.. {
            line.clear();
            let mut bounded = reader.by_ref().take(LINE_BYTES_MAX);
            let length = bounded.read_until(b'\n', &mut line).map_err(text)?;
            let is_whole = line.last() == Some(&b'\n');
            if number == 1 {
                check_header(&line, is_whole)?;
            }
            if !is_whole && length as u64 == LINE_BYTES_MAX {
                return Err(format!("line {number} is longer than any of a cassette"));
            }
            if !is_whole {
                break;
            }
            if number > 1 {
                self.take(&line).map_err(|what| format!("line {number} {what}"))?;
            }
            self.end += length as u64;
        }
        Ok(())
    }

    /// Notes a line that begins at the end.
    fn take(&mut self, text: &[u8]) -> Result<(), &'static str> {
        match serde_json::from_slice(text) {
            Ok(Line::Model(line)) if line.voice == self.models.len() => self.models.push(line.body),
            Ok(Line::Answer(line)) if line.voice < self.models.len() => {
                self.note(&line, self.end, text.len());
            }
            Ok(_) => return Err("names a model that is not there"),
            Err(_) => return Err("is not one of a cassette; the rest can be used without it"),
        }
        Ok(())
    }

    fn note(&mut self, line: &AnswerLine, from: u64, length: usize) {
        let AnswerLine { voice, game, agent, round, prompt, .. } = line;
        self.games.insert((*voice, game.clone()));
        self.places.insert(hash(&(voice, game, agent, round)));
        self.answers.insert(hash(&(voice, game, agent, round, prompt)), (from, length));
    }

    fn find(&mut self, voice: usize, question: &Question) -> io::Result<Option<Answer>> {
        let Question { game, agent, round, prompt } = question;
        let asked = hash(&(voice, game, agent, round, digest(prompt)));
        let Some(&(from, length)) = self.answers.get(&asked) else { return Ok(None) };
        let mut text = vec![0; length];
        self.file.seek(SeekFrom::Start(from))?;
        self.file.read_exact(&mut text)?;
        Ok(Some(serde_json::from_slice::<AnswerLine>(&text)?.answer))
    }

    /// Adds a line in one write; returns its offset and length.
    fn write(&mut self, line: &impl Serialize) -> io::Result<(u64, usize)> {
        if self.is_broken {
            return Err(io::Error::other("an earlier line could not be written"));
        }
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        self.is_broken = true;
        self.file.write_all(&text)?;
        self.is_broken = false;
        let from = self.end;
        self.end += text.len() as u64;
        Ok((from, text.len()))
    }
}

/// Whether a file is a cassette of a version that can be read; what a crash left of a first line may be cut off later.
fn check_header(line: &[u8], is_whole: bool) -> Result<(), String> {
    let header = serde_json::from_slice::<Header>(line).ok();
    match header.filter(|header| is_whole && header.cassette == NAME) {
        Some(header) if header.version == VERSION => Ok(()),
        Some(Header { version, .. }) => {
            Err(format!("is of version {version}, and this program reads version {VERSION}"))
        }
        None if !is_whole && json(&Header::current()).starts_with(line) => Ok(()),
        None => Err("is another kind of file".to_owned()),
    }
}

fn json(what: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(what).expect("texts and numbers can be written")
}

fn hash(what: &impl Serialize) -> Hash {
    Sha256::digest(json(what)).into()
}

/// SHA-256 of a prompt.
fn digest(prompt: &str) -> String {
    HEXLOWER.encode(&Sha256::digest(prompt))
}
