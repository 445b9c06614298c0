//! Import: reads a folder or an archive with any number of batches, one game at a time.
//!
//! A batch is a folder with an index. Nothing is unpacked to the disk, and a name in an archive never becomes a path. A
//! problem with a file is reported with its name, and reading continues with the others.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufRead as _, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use serde::de::{DeserializeOwned, DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;
use swarmbench_clock::files;
use zip::ZipArchive;

use super::bounds::{Bounded, Bounds};
use super::format::{self, META, Meta, is_run_id};
use super::imported::Builder;
use crate::store::entries::ImportRow;

/// Description of a valid run id.
const NO_RUN_ID: &str = "is not one: it has 1 to 128 letters, digits, -, _, spaces and parentheses";

const BUFFER_BYTES: usize = 64 * 1024;

/// The mark that some programs put at the beginning of a text file.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// Maximum characters of a reported problem, and of a file name in it.
const PROBLEM_CHARS_MAX: usize = 500;

/// The part that is not imported because of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skipped {
    Game,
    /// The game is imported without its acts.
    Acts,
    /// A file, or the rest of an index; its games are unknown.
    File,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problem {
    pub skipped: Skipped,
    pub file: String,
    pub problem: String,
}

impl Problem {
    /// Truncates both texts: they may quote a file, and there may be many problems.
    fn new(skipped: Skipped, file: impl AsRef<str>, problem: impl AsRef<str>) -> Self {
        let cut = |text: &str| text.chars().take(PROBLEM_CHARS_MAX).collect();
        Self { skipped, file: cut(file.as_ref()), problem: cut(problem.as_ref()) }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    #[error("{path} cannot be read: {source}")]
    Io { path: PathBuf, source: io::Error },
    #[error("{path} is neither a folder nor a zip archive that can be read: {source}")]
    Archive { path: PathBuf, source: zip::result::ZipError },
    #[error("{path} has more than {most} files")]
    Entries { path: PathBuf, most: usize },
}

pub trait Taker {
    /// Receives a complete game. An error ends the import.
    fn game(&mut self, game: ImportRow) -> anyhow::Result<()>;

    /// Receives the problem of a skipped file or run.
    fn problem(&mut self, problem: Problem);

    /// Receives the finished and the total number of games.
    fn progress(&mut self, done: u64, of: u64);
}

/// Reads all games in a folder or archive.
pub fn read(path: &Path, bounds: &Bounds, taker: &mut dyn Taker) -> anyhow::Result<()> {
    let mut place = NumberedFiles::open(path, bounds, taker)?;
    let batches = Batches::of(place.names(), taker);
    let of = batches.0.values().map(|batch| batch.games.len() as u64).sum();
    let mut done = 0;
    let reading = Reading { bounds, total: Cell::new(0) };
    for (folder, batch) in batches.0 {
        let problem = |problem: Problem| {
            let file = if folder.is_empty() {
                problem.file
            } else {
                format!("{}/{}", folder.escape_debug(), problem.file)
            };
            Problem { file, ..problem }
        };
        let mut runs: Vec<(String, Box<RawValue>)> = Vec::new();
        let read = match batch.index {
            Some(index) => reading.index(&mut place, index, &mut runs),
            None => Err("is missing, so the players are not known".to_owned()),
        };
        if let Err(why) = read {
            let why = format!("{why}; it has {} runs", runs.len());
            taker.problem(problem(Problem::new(Skipped::File, META, why)));
        }
        let mut games = batch.games;
        for (run_id, meta) in runs {
            let logs = games.remove(&run_id);
            done += u64::from(logs.is_some());
            let (game, wrong) = reading.game(&mut place, &run_id, &meta, logs.unwrap_or_default());
            for wrong in wrong {
                taker.problem(problem(wrong));
            }
            if let Some(game) = game {
                taker.game(game)?;
            }
            taker.progress(done, of);
        }
        for (run_id, logs) in games {
            done += 1;
            let file = if logs.states.is_some() { format::game_file } else { format::agent_file };
            let why = format!("its run is not in {META}");
            taker.problem(problem(Problem::new(Skipped::Game, file(&run_id), why)));
        }
        taker.progress(done, of);
    }
    Ok(())
}

/// The files of a batch, by their numbers in [`NumberedFiles`].
#[derive(Default)]
struct Batch {
    index: Option<usize>,
    games: BTreeMap<String, Logs>,
}

#[derive(Clone, Copy, Default)]
struct Logs {
    states: Option<usize>,
    acts: Option<usize>,
}

struct Batches(BTreeMap<String, Batch>);

impl Batches {
    fn of(names: Vec<String>, taker: &mut dyn Taker) -> Self {
        let mut batches: BTreeMap<String, Batch> = BTreeMap::new();
        for (place, path) in names.into_iter().enumerate() {
            let (folder, name) = path.rsplit_once('/').unwrap_or(("", &path));
            if folder.split('/').any(|part| part == "__MACOSX") {
                // macOS adds these folders with attributes of files to its archives.
                continue;
            }
            let mut problem = |skipped, problem: &str| {
                taker.problem(Problem::new(skipped, path.escape_debug().to_string(), problem));
            };
            let log = |start: &str| name.strip_prefix(start)?.strip_suffix(".json");
            if name == META {
                batches.entry(folder.to_owned()).or_default().index = Some(place);
            } else if let Some((is_game, run_id)) = (log("game_log_").map(|id| (true, id)))
                .or_else(|| log("agent_log_").map(|id| (false, id)))
            {
                if !is_run_id(run_id) {
                    problem(Skipped::Game, &format!("the run id in its name {NO_RUN_ID}"));
                    continue;
                }
                let logs = batches.entry(folder.to_owned()).or_default();
                let logs = logs.games.entry(run_id.to_owned()).or_default();
                *(if is_game { &mut logs.states } else { &mut logs.acts }) = Some(place);
            } else if Path::new(name).extension().is_some_and(|end| end.eq_ignore_ascii_case("zip"))
            {
                let why = "is a nested archive, and is not opened; import it by itself";
                problem(Skipped::File, why);
            }
        }
        Self(batches)
    }
}

/// The source of numbered files.
enum NumberedFiles {
    Folder(Vec<(String, PathBuf)>),
    Archive(Box<ZipArchive<BufReader<Limited>>>),
}

/// A file with a limit of bytes to be read.
struct Limited {
    file: File,
    left: Rc<Cell<u64>>,
}

impl Read for Limited {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer)?;
        let left = self.left.get().checked_sub(read as u64);
        self.left.set(left.ok_or_else(|| io::Error::other("its directory is too large"))?);
        Ok(read)
    }
}

impl Seek for Limited {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl NumberedFiles {
    fn open(path: &Path, bounds: &Bounds, taker: &mut dyn Taker) -> Result<Self, ReadError> {
        let failed = |source| ReadError::Io { path: path.to_owned(), source };
        if fs::metadata(path).map_err(failed)?.is_dir() {
            let mut found = Found::default();
            walk(path, "", bounds.folders_max, bounds, &mut found)?;
            found.files.sort();
            for (name, problem) in found.skipped {
                taker.problem(Problem::new(Skipped::File, name, problem));
            }
            return Ok(Self::Folder(found.files));
        }
        let mut file = files::open(path).map_err(failed)?;
        if declared(&mut file).map_err(failed)? > bounds.entries_max as u64 {
            return Err(ReadError::Entries { path: path.to_owned(), most: bounds.entries_max });
        }
        let left = Rc::new(Cell::new(bounds.directory_bytes_max));
        let file = Limited { file, left: Rc::clone(&left) };
        let archive = ZipArchive::new(BufReader::with_capacity(BUFFER_BYTES, file));
        let archive =
            archive.map_err(|source| ReadError::Archive { path: path.to_owned(), source })?;
        // Entries have bounds of their own.
        left.set(u64::MAX);
        if archive.len() > bounds.entries_max {
            return Err(ReadError::Entries { path: path.to_owned(), most: bounds.entries_max });
        }
        Ok(Self::Archive(Box::new(archive)))
    }

    fn names(&self) -> Vec<String> {
        match self {
            Self::Folder(files) => files.iter().map(|(name, _)| name.clone()).collect(),
            // Names that are not UTF-8 match no file of the format.
            Self::Archive(archive) => (archive.file_names())
                .map(|name| name.map(Cow::into_owned).unwrap_or_default())
                .collect(),
        }
    }

    /// Opens a file; the second value is its packed size in the archive.
    fn file(&mut self, number: usize) -> io::Result<(Box<dyn Read + '_>, Option<u64>)> {
        match self {
            Self::Folder(files) => Ok((Box::new(File::open(&files[number].1)?), None)),
            Self::Archive(archive) => {
                let file = archive.by_index(number)?;
                let packed = file.compressed_size();
                Ok((Box::new(file), Some(packed)))
            }
        }
    }
}

/// Files of a folder.
#[derive(Default)]
struct Found {
    files: Vec<(String, PathBuf)>,
    /// Skipped files with the reasons.
    skipped: Vec<(String, String)>,
}

impl Found {
    fn skip(&mut self, name: &str, why: &str) {
        self.skipped.push((name.escape_debug().to_string(), why.to_owned()));
    }
}

/// Lists the files of a folder without following links.
fn walk(
    folder: &Path,
    name: &str,
    deeper: usize,
    bounds: &Bounds,
    found: &mut Found,
) -> Result<(), ReadError> {
    let failed = |source| ReadError::Io { path: folder.to_owned(), source };
    for entry in fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let kind = entry.file_type().map_err(failed)?;
        let is_text = entry.file_name().to_str().is_some();
        let own = entry.file_name().to_string_lossy().into_owned();
        let name = if name.is_empty() { own } else { format!("{name}/{own}") };
        if !is_text {
            found.skip(&name, "has a name that is not UTF-8");
        } else if kind.is_file() {
            found.files.push((name, entry.path()));
            if found.files.len() + found.skipped.len() > bounds.entries_max {
                let most = bounds.entries_max;
                return Err(ReadError::Entries { path: folder.to_owned(), most });
            }
        } else if kind.is_dir() && deeper > 0 {
            walk(&entry.path(), &name, deeper - 1, bounds, found)?;
        } else if kind.is_dir() {
            found.skip(&name, &format!("is more than {} folders deep", bounds.folders_max));
        } else {
            found.skip(&name, "is not a regular file, and is not followed");
        }
    }
    Ok(())
}

/// The number of entries that an archive declares, checked before its directory is read into memory.
fn declared(file: &mut File) -> io::Result<u64> {
    // The end record is followed by a comment of at most 64 KiB; the end record of Zip64 directly precedes it.
    const TAIL_BYTES: u64 = 64 * 1024 + 22 + 20 + 56;
    let bytes = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(bytes.saturating_sub(TAIL_BYTES)))?;
    let mut tail = Vec::new();
    file.take(TAIL_BYTES).read_to_end(&mut tail)?;
    file.seek(SeekFrom::Start(0))?;
    let mut most = 0;
    for (at, mark) in tail.windows(4).enumerate() {
        let count = match mark {
            b"PK\x05\x06" => tail.get(at + 10..at + 12),
            b"PK\x06\x06" => tail.get(at + 32..at + 40),
            _ => None,
        };
        let mut number = [0; 8];
        if let Some(count) = count {
            number[..count.len()].copy_from_slice(count);
        }
        most = most.max(u64::from_le_bytes(number));
    }
    Ok(most)
}

struct Reading<'a> {
    bounds: &'a Bounds,
    total: Cell<u64>,
}

impl Reading<'_> {
    /// Reads a game and reports the problems of its files.
    fn game(
        &self,
        place: &mut NumberedFiles,
        run_id: &str,
        meta: &RawValue,
        logs: Logs,
    ) -> (Option<ImportRow>, Vec<Problem>) {
        let skip = |file: String, why| (None, vec![Problem::new(Skipped::Game, file, why)]);
        if !is_run_id(run_id) {
            let shown: String = run_id.chars().take(60).collect();
            return skip(META.to_owned(), format!("the run id {shown:?} {NO_RUN_ID}"));
        }
        let mut wrong = Vec::new();
        let meta: Result<Meta, String> =
            serde_json::from_str(meta.get()).map_err(|error| error.to_string());
        let mut builder = match meta.and_then(|meta| Builder::new(run_id, meta, *self.bounds)) {
            Ok(builder) => builder,
            Err(why) => return skip(META.to_owned(), format!("run {run_id}: {why}")),
        };
        let read = match logs.states {
            Some(states) => self.list(place, states, &mut |row| builder.add_state(row)),
            None => Err("is missing".to_owned()),
        };
        if let Err(why) = read {
            return skip(format::game_file(run_id), why);
        }
        let read = match logs.acts {
            Some(acts) => {
                let read = self.list(place, acts, &mut |row| builder.add_act(&row));
                read.and_then(|()| builder.pack())
            }
            None => Err("is missing".to_owned()),
        };
        if let Err(why) = read {
            builder.without_acts();
            let why = format!("{why}; the game is imported without its acts");
            wrong.push(Problem::new(Skipped::Acts, format::agent_file(run_id), why));
        }
        match builder.finish() {
            Ok(row) => (Some(row), wrong),
            Err(why) => skip(format::game_file(run_id), why),
        }
    }

    /// Reads an array and passes on its elements one at a time.
    fn list<T: DeserializeOwned>(
        &self,
        place: &mut NumberedFiles,
        number: usize,
        add: &mut dyn FnMut(T) -> Result<(), String>,
    ) -> Result<(), String> {
        let elements = Elements { add, kind: std::marker::PhantomData };
        self.json(place, number, *self.bounds, elements)
    }

    /// Reads an index. Of a truncated one, `runs` gets the complete entries.
    fn index(
        &self,
        place: &mut NumberedFiles,
        number: usize,
        runs: &mut Vec<(String, Box<RawValue>)>,
    ) -> Result<(), String> {
        let most = self.bounds.entries_max;
        self.json(place, number, self.bounds.of_index(), Runs { runs, most })
    }

    fn json<S>(
        &self,
        place: &mut NumberedFiles,
        number: usize,
        bounds: Bounds,
        what: S,
    ) -> Result<(), String>
    where
        S: for<'de> DeserializeSeed<'de, Value = ()>,
    {
        let (file, packed) = place.file(number).map_err(|error| error.to_string())?;
        let file = Bounded::new(file, packed, bounds, &self.total);
        let mut file = BufReader::with_capacity(BUFFER_BYTES, file);
        let start = file.fill_buf().map_err(|error| error.to_string())?;
        if start.starts_with(BYTE_ORDER_MARK) {
            file.consume(BYTE_ORDER_MARK.len());
        }
        let mut json = serde_json::Deserializer::from_reader(file);
        let read = what.deserialize(&mut json).and_then(|()| json.end());
        read.map_err(|error| match error.classify() {
            serde_json::error::Category::Eof => format!("is truncated: {error}"),
            _ => error.to_string(),
        })
    }
}

/// Deserializes an array element by element.
struct Elements<'a, T> {
    add: &'a mut dyn FnMut(T) -> Result<(), String>,
    kind: std::marker::PhantomData<T>,
}

impl<'de, T: DeserializeOwned> DeserializeSeed<'de> for Elements<'_, T> {
    type Value = ();

    fn deserialize<D: serde::Deserializer<'de>>(self, json: D) -> Result<(), D::Error> {
        json.deserialize_seq(self)
    }
}

impl<'de, T: DeserializeOwned> Visitor<'de> for Elements<'_, T> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a list")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        while let Some(element) = list.next_element()? {
            (self.add)(element).map_err(serde::de::Error::custom)?;
        }
        Ok(())
    }
}

/// Deserializes an index with each run left as text. Settings are parsed one run at a time, so an invalid one does not affect
/// the others.
struct Runs<'a> {
    runs: &'a mut Vec<(String, Box<RawValue>)>,
    most: usize,
}

impl<'de> DeserializeSeed<'de> for Runs<'_> {
    type Value = ();

    fn deserialize<D: serde::Deserializer<'de>>(self, json: D) -> Result<(), D::Error> {
        json.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Runs<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("an object with runs by their ids")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(run_id) = map.next_key::<String>()? {
            if self.runs.len() >= self.most {
                map.next_value::<IgnoredAny>()?;
                return Err(serde::de::Error::custom(format!(
                    "it has more than {} runs",
                    self.most
                )));
            }
            self.runs.push((run_id, map.next_value()?));
        }
        Ok(())
    }
}
