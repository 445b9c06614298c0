//! Journals as input of commands: files or downloads.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, anyhow, ensure};
use serde::Deserialize;
use swarmbench_analysis::game::{Setup, State};
use swarmbench_analysis::journal::decisions;
use swarmbench_analysis::{Meter, Options};
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{Act, AgentId, World};
use swarmbench_journal::record::{ActRecord, Opening, Record};
use swarmbench_journal::replay::verify_seen;
use swarmbench_replay::draw::frame::Moment;
use tokio_util::sync::CancellationToken;

use super::options::ServerArgs;
use swarmbench_clock::files;

/// Maximum bytes of a line of a journal or of a competition's file: more than all acts of a round can have.
const LINE_BYTES_MAX: usize = 256 * 1024 * 1024;

/// A reader of lines that fails on a line beyond its bound, before the line fills the memory.
pub struct Lines<R> {
    file: R,
    /// Bytes of the current line.
    line: usize,
    most: usize,
}

impl<R> Lines<R> {
    pub const fn new(file: R) -> Self {
        Self { file, line: 0, most: LINE_BYTES_MAX }
    }
}

/// First bytes of a database of SQLite.
const SQLITE: &[u8] = b"SQLite format 3\0";

/// Opens a file to read it line by line. A database, which has journals but is none, is refused.
pub fn open_lines(path: &Path) -> anyhow::Result<Lines<BufReader<File>>> {
    let shown = path.display();
    let open = || {
        let mut file = BufReader::new(files::open(path)?);
        let is_database = file.fill_buf()?.starts_with(SQLITE);
        io::Result::Ok((file, is_database))
    };
    let (file, is_database) = open().with_context(|| shown.to_string())?;
    ensure!(
        !is_database,
        "{shown} is a database, and a file with a journal is wanted: `swarmbench verify --db {shown}` checks all its games, \
         and `swarmbench serve --db {shown}` serves them to commands that take the id of a game"
    );
    Ok(Lines::new(file))
}

impl<R: BufRead> BufRead for Lines<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.line > self.most {
            return Err(io::Error::other(format!("a line has more than {} bytes", self.most)));
        }
        self.file.fill_buf()
    }

    fn consume(&mut self, bytes: usize) {
        // The caller has seen these bytes, so they are still buffered.
        let taken = self.file.fill_buf().map_or(&[][..], |shown| &shown[..bytes.min(shown.len())]);
        self.line = match taken.iter().rposition(|byte| *byte == b'\n') {
            Some(end) => taken.len() - end - 1,
            None => self.line + taken.len(),
        };
        self.file.consume(bytes);
    }
}

impl<R: BufRead> Read for Lines<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(into)?;
        self.consume(read);
        Ok(read)
    }
}

/// A journal that can be read repeatedly.
pub enum Journal {
    File(PathBuf),
    Bytes(Vec<u8>),
}

impl Journal {
    /// The file with this name, else the journal of the episode with this id.
    pub async fn find(game: &str, server: ServerArgs) -> anyhow::Result<Self> {
        let path = Path::new(game);
        if path.is_file() {
            return Ok(Self::File(path.to_owned()));
        }
        let is_id = game.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
        ensure!(
            is_id && !path.exists(),
            "{game} is neither a journal file nor the id of an episode"
        );
        let address = server.server.clone();
        let bytes = server.client().await?.journal(game, None).await.with_context(|| {
            format!("there is no file {game}, and {address} does not give the journal of an episode {game}")
        })?;
        Ok(Self::Bytes(bytes))
    }

    pub fn open(&self) -> anyhow::Result<Box<dyn BufRead + '_>> {
        Ok(match self {
            Self::File(path) => Box::new(open_lines(path)?),
            Self::Bytes(bytes) => Box::new(bytes.as_slice()),
        })
    }
}

/// Facts of a game that are known before its replay.
pub struct Outline {
    pub opening: Box<Opening>,
    /// Score after each round.
    pub scores: Vec<f64>,
    /// End of the game; `None` if it is unfinished.
    pub end: Option<Ended>,
}

#[derive(Deserialize)]
pub struct Ended {
    pub status: String,
    pub reason: String,
}

#[derive(Deserialize)]
struct Line<T> {
    record: T,
}

#[derive(Deserialize)]
struct Scored {
    kind: String,
    score: Option<f64>,
    #[serde(flatten)]
    end: Option<Ended>,
}

impl Outline {
    /// Reads a journal without verification.
    pub fn of(journal: &Journal) -> anyhow::Result<Self> {
        let mut lines = journal.open()?.lines();
        let no_journal = "this is no journal; `swarmbench verify --help` says how to get one";
        let first = lines.next().context("the journal is empty")?.context(no_journal)?;
        let first: Line<Record> = serde_json::from_str(&first).context(no_journal)?;
        let Record::Opening(opening) = first.record else {
            return Err(anyhow!("this is no journal: its first record is not an opening"));
        };
        let mut scores = Vec::new();
        let mut end = None;
        for (number, line) in (2..).zip(lines) {
            let line: Line<Scored> = serde_json::from_str(&line?)
                .with_context(|| format!("line {number} is not a line of a journal"))?;
            match line.record.kind.as_str() {
                "round" => scores.extend(line.record.score),
                "end" => end = line.record.end,
                _ => {}
            }
        }
        Ok(Self { opening, scores, end })
    }

    /// Number of the last state.
    pub fn last(&self) -> u32 {
        u32::try_from(self.scores.len()).unwrap_or(u32::MAX)
    }
}

/// Replays a game up to the state `last`, and passes the wanted states to `see`, each with what was decided in it, and with each
/// agent's view if `windows`. `progress` gets the number of every state.
/// # Errors
/// If the journal does not verify up to there, `see` fails, or `stop` is cancelled.
pub fn replay(
    journal: &Journal,
    (last, windows): (u32, bool),
    wanted: impl Fn(u32) -> bool,
    stop: &CancellationToken,
    progress: impl Fn(u32),
    mut see: impl FnMut(&Moment) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let mut open: Option<Moment> = None;
    let mut meter: Option<Meter> = None;
    visit(journal, stop, |world, acts| {
        let state = State::of(world);
        if let Some(meter) = &mut meter {
            meter.round(&decisions(world.config(), acts), state, None);
            if let Some(mut moment) = open.take() {
                moment.decided(&decided(world, acts), world, *meter.now().0);
                see(&moment)?;
            }
        } else {
            // Counts need no comparison of texts.
            let options = Options { series: false, vectors: false, edits: false };
            meter = Some(Meter::new(Setup::of(world), state, options));
        }
        progress(world.round());
        if world.round() > last {
            return Ok(ControlFlow::Break(()));
        }
        if wanted(world.round()) {
            open = Some(Moment::of(world, windows));
        }
        Ok(ControlFlow::Continue(()))
    })?;
    // The last state has no decisions.
    open.as_ref().map_or(Ok(()), see)
}

/// Replays a game, and passes every state with the acts that led to it to `see`, until that breaks off.
///
/// # Errors
/// If the journal does not verify up to there, `see` fails, or `stop` is cancelled.
pub fn visit(
    journal: &Journal,
    stop: &CancellationToken,
    mut see: impl FnMut(&World, &[ActRecord]) -> anyhow::Result<ControlFlow<()>>,
) -> anyhow::Result<()> {
    let ended = Arc::new(AtomicBool::new(false));
    let reader = Ending { journal: journal.open()?, ended: Arc::clone(&ended) };
    let mut seen = Ok(ControlFlow::Continue(()));
    let replayed = verify_seen(reader, None, Solver::Flow, |world, acts| {
        if !matches!(seen, Ok(ControlFlow::Continue(()))) {
            return;
        }
        seen = if stop.is_cancelled() { Err(anyhow!("cancelled")) } else { see(world, acts) };
        if !matches!(seen, Ok(ControlFlow::Continue(()))) {
            ended.store(true, Ordering::Relaxed);
        }
    });
    seen.map(drop)?;
    replayed.map(drop).context("the journal cannot be replayed; `swarmbench verify` checks it")
}

/// Acts of a round for the engine. The replay has already applied them, so their names are valid.
fn decided(world: &World, acts: &[ActRecord]) -> Vec<(u16, Act)> {
    let known =
        |record: &ActRecord| Some((AgentId::parse(&record.agent)?.0, record.act(world.config())?));
    acts.iter().filter_map(known).collect()
}

/// A journal that ends after the current line once `ended` is set.
struct Ending<R> {
    journal: R,
    ended: Arc<AtomicBool>,
}

impl<R: BufRead> Read for Ending<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        if self.ended.load(Ordering::Relaxed) { Ok(0) } else { self.journal.read(into) }
    }
}

impl<R: BufRead> BufRead for Ending<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        if self.ended.load(Ordering::Relaxed) { Ok(&[]) } else { self.journal.fill_buf() }
    }

    fn consume(&mut self, bytes: usize) {
        self.journal.consume(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_without_an_end_is_an_error() {
        let text = b"four\nfive5\n\n12345678\n";
        for buffer in 1..20 {
            let lines = |most| {
                let file = BufReader::with_capacity(buffer, &text[..]);
                Lines { most, ..Lines::new(file) }
            };
            let mut read = Vec::new();
            lines(9).read_to_end(&mut read).expect("short lines");
            assert_eq!(read, text);
            let mut line = Vec::new();
            let mut endless = Lines {
                most: 1000,
                ..Lines::new(BufReader::with_capacity(buffer, io::repeat(b'x')))
            };
            assert!(endless.read_until(b'\n', &mut line).is_err());
            assert!(line.len() <= 1020, "{}", line.len());
        }
    }
}
