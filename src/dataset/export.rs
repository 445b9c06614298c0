//! Export of stored episodes, which are replayed one after the other, round by round.
//!
//! An export reads a few rounds at once and has one episode's world in memory, however many episodes there are; the texts of
//! acts are read part by part. An export needs a thread of its own: it computes, reads the store, and waits for the reader of
//! its output.

use std::collections::{BTreeSet, HashSet};
use std::io::{self, Write};

use serde::Serialize;
use swarmbench_analysis::game::Heard;
use tokio::runtime::Handle;
use tokio_util::sync::CancellationToken;

use super::columns::Table;
use super::files::Files;
use super::format::{self, AgentRow, META};
use super::game::{DatasetGame, GameAct, Turn};
use super::header::Header;
use super::imported::{self, Unreadable};
use super::measure;
use super::tables::{self, Cell, Named, Outcome, TableName};
use crate::ids::{EpisodeId, EpisodeKey, ImportKey};
use crate::run::definition;
use crate::store::entries::ImportedRound;
use crate::store::episodes::{Filter, Readable};
use crate::store::imports::{ImportFilter, StoredImport};
use crate::store::metrics::{Measured, stored_method};
use crate::store::port::StoredEpisode;
use crate::store::records::ActReader;
use crate::store::{Store, StoreError};
use swarmbench_protocol::worth::GameWorth;

/// Rounds of one read.
const CHUNK: u32 = 8;

/// Episodes of one page of the list.
const PAGE: u32 = 100;

/// Bytes of complete acts of one read.
const ACTS_BYTES: usize = 256 * 1024;

/// Bytes buffered before they are compressed or sent.
const BUFFER_BYTES: usize = 64 * 1024;

#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    #[error(transparent)]
    Journal(#[from] StoreError),
    #[error("the export cannot be written: {0}")]
    Io(#[from] io::Error),
    #[error("the table cannot be written: {0}")]
    Table(#[from] parquet::errors::ParquetError),
    #[error("there is no episode {0}")]
    Unknown(String),
    /// The receiver of the export has hung up.
    #[error("the export was stopped")]
    Stopped,
}

/// The episodes to export: all ended ones if the filter names no status.
#[derive(Clone, Debug)]
pub struct Selection {
    pub filter: Filter,
    pub episode: Option<EpisodeId>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    pub episodes: u64,
    pub rounds: u64,
    pub acts: u64,
    /// Episodes that cannot be replayed and are left out, with the reason.
    pub broken: Vec<(String, String)>,
}

pub struct Export<'a> {
    store: &'a Store,
    runtime: Handle,
    /// Keys of the selected episodes, the only data about them that stays in memory.
    keys: Vec<EpisodeKey>,
    /// A model: the table of acts is restricted to its seats.
    played_by: Option<String>,
    exported: Exported,
    progress: Box<dyn FnMut(u64, u64) + 'a>,
    stop: CancellationToken,
}

impl<'a> Export<'a> {
    /// Selects episodes as of now. `may` decides whether an episode may be exported; `progress` gets the written and the
    /// total number of episodes; `stop` ends the export early. Blocks, so not for async threads.
    pub fn select(
        store: &'a Store,
        selection: &Selection,
        may: impl Fn(&StoredEpisode) -> bool,
        progress: impl FnMut(u64, u64) + 'a,
        stop: CancellationToken,
    ) -> Result<Self, ExportError> {
        let runtime = Handle::current();
        let Selection { filter, episode } = selection;
        let wanted = |stored: &StoredEpisode| {
            // A voided episode counts nowhere, and is exported only by its id.
            let counts = stored.void_reason.is_none() || episode.is_some();
            (filter.status.is_some() || stored.ended_at.is_some()) && counts && may(stored)
        };
        let mut keys = Vec::new();
        if let Some(id) = episode {
            let found = runtime.block_on(find(store, filter, id))?.filter(wanted);
            keys.push(found.ok_or_else(|| ExportError::Unknown(id.to_string()))?.episode);
        } else {
            let mut before = None;
            loop {
                check(&stop)?;
                let page = runtime.block_on(store.list_episodes(filter, before, PAGE))?;
                let Some(last) = page.last() else { break };
                before = Some(last.episode);
                keys.extend(
                    page.iter().filter(|stored| wanted(stored)).map(|stored| stored.episode),
                );
            }
        }
        // Lists start with the newest episode, exports with the oldest.
        keys.reverse();
        let (exported, progress) = (Exported::default(), Box::new(progress));
        let played_by = filter.played_by.clone();
        Ok(Self { store, runtime, keys, played_by, exported, progress, stop })
    }

    /// Whether no episode was selected.
    pub const fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// Writes the files of the toolkit: states and acts of each episode, then the index.
    pub fn dataset(mut self, files: &mut dyn Files) -> Result<Exported, ExportError> {
        let mut written = Vec::new();
        let (mut rounds, mut acts) = (0, 0);
        for (done, key) in self.keys.clone().into_iter().enumerate() {
            (self.progress)(done as u64, self.keys.len() as u64);
            let Some((stored, mut game)) = self.sound(key)? else { continue };
            let run_id = stored.id.as_str();
            {
                let mut list = List::array(files.begin(&format::game_file(run_id))?)?;
                list.add(&game.layout())?;
                self.play(&stored, &mut game, |game, turn| {
                    rounds += 1;
                    Ok(list.add(&game.after(turn))?)
                })?;
                list.end()?;
            }
            let mut game = lay_out(&stored)?;
            let mut list = List::array(files.begin(&format::agent_file(run_id))?)?;
            self.play_acts(&stored, &mut game, |game, turn, act| {
                acts += 1;
                Ok(list.add(&game.act(turn, act))?)
            })?;
            list.end()?;
            written.push(key);
        }
        self.index(&written, files.begin(META)?)?;
        files.finish()?;
        Ok(self.finish(rounds, acts))
    }

    fn index(&mut self, keys: &[EpisodeKey], out: &mut dyn Write) -> Result<(), ExportError> {
        let mut entries = List::object(out)?;
        for key in keys {
            let Some(stored) = self.stored(*key)? else { continue };
            entries.add_field(stored.id.as_str(), &lay_out(&stored)?.meta(&stored.status))?;
        }
        Ok(entries.end()?)
    }

    pub fn lines(self, table: TableName, out: impl Write) -> Result<Exported, ExportError> {
        let mut out = io::BufWriter::with_capacity(BUFFER_BYTES, out);
        let exported = self.rows(table, |row| {
            serde_json::to_writer(&mut out, &Named(table.columns(), &row))
                .map_err(io::Error::from)?;
            Ok(out.write_all(b"\n")?)
        })?;
        out.flush()?;
        Ok(exported)
    }

    pub fn parquet(
        self,
        table: TableName,
        out: impl Write + Send,
    ) -> Result<Exported, ExportError> {
        let mut file = Table::new(out, table.name(), table.columns())?;
        let exported = self.rows(table, |row| Ok(file.add(row)?))?;
        file.finish()?;
        Ok(exported)
    }

    fn rows(
        mut self,
        table: TableName,
        mut add: impl FnMut(Vec<Cell>) -> Result<(), ExportError>,
    ) -> Result<Exported, ExportError> {
        let (mut rounds, mut acts) = (0, 0);
        for (done, key) in self.keys.clone().into_iter().enumerate() {
            (self.progress)(done as u64, self.keys.len() as u64);
            match table {
                TableName::Episodes => {
                    check(&self.stop)?;
                    if let Some(row) = self.episode(key)? {
                        add(row)?;
                    }
                }
                TableName::Acts => {
                    let Some((stored, mut game)) = self.sound(key)? else { continue };
                    let worth = self.worth(key)?;
                    self.play_acts(&stored, &mut game, |game, turn, act| {
                        let model = &game.header.holder(act.agent).model;
                        if self.played_by.as_ref().is_some_and(|wanted| wanted != model) {
                            return Ok(());
                        }
                        acts += 1;
                        add(tables::act(game, turn, act, worth.as_ref()))
                    })?;
                }
                TableName::Rounds => {
                    let Some((stored, mut game)) = self.sound(key)? else { continue };
                    let created_at = stored.created_at;
                    let worth = self.worth(key)?;
                    let worth = worth.as_ref();
                    let mut meter = measure::meter(game.world());
                    add(tables::round(&game, None, created_at, meter.now(), worth))?;
                    self.play(&stored, &mut game, |game, turn| {
                        rounds += 1;
                        measure::add(&mut meter, game, turn);
                        add(tables::round(game, Some(turn), created_at, meter.now(), worth))
                    })?;
                }
                TableName::Heard => {
                    let Some((stored, mut game)) = self.sound(key)? else { continue };
                    self.play(&stored, &mut game, |game, _| {
                        let heard = Heard::all(game.world());
                        heard.iter().try_for_each(|heard| add(tables::heard(game, heard)))
                    })?;
                }
                TableName::Views => {
                    let Some((stored, mut game)) = self.sound(key)? else { continue };
                    self.play(&stored, &mut game, |game, turn| {
                        let agents = turn.before.agents();
                        let mut views = agents.filter_map(|agent| tables::view(game, turn, agent));
                        views.try_for_each(&mut add)
                    })?;
                }
            }
        }
        Ok(self.finish(rounds, acts))
    }

    /// An episode's row. An episode without stored metrics is replayed.
    fn episode(&mut self, key: EpisodeKey) -> Result<Option<Vec<Cell>>, ExportError> {
        let Some(stored) = self.stored(key)? else { return Ok(None) };
        let header = match Header::read(&stored) {
            Ok(header) => header,
            Err(problem) => {
                self.leave_out(&stored, problem);
                return Ok(None);
            }
        };
        let measured = match self.measured(&stored) {
            Ok(measured) => measured,
            Err(Fault::Broken(problem)) => {
                self.leave_out(&stored, problem);
                return Ok(None);
            }
            Err(Fault::Error(error)) => return Err(error),
        };
        self.exported.episodes += 1;
        let run = match stored.run {
            Some(run) => self.runtime.block_on(self.store.run(run))?,
            None => None,
        };
        let suite = run.and_then(|run| Some((definition::read(&run).ok()?.suite.name, run.digest)));
        let outcome = Outcome {
            started_at: self.runtime.block_on(self.store.started_at(key))?,
            tally: self.runtime.block_on(self.store.tally_of(key))?,
            suite,
            measured,
            worth: self.worth(key)?,
        };
        Ok(Some(tables::episode(&header, &stored, &outcome)))
    }

    /// The stored worth of an episode.
    fn worth(&self, key: EpisodeKey) -> Result<Option<GameWorth>, ExportError> {
        Ok(self.runtime.block_on(self.store.worth_of(key))?)
    }

    /// Stored metrics of an episode, or else those of a replay.
    fn measured(&self, stored: &StoredEpisode) -> Result<Measured, Fault> {
        let found = self.store.metrics_of(stored.episode, stored_method());
        let found = self.runtime.block_on(found).map_err(ExportError::from)?;
        if let Some(found) = found {
            return Ok(Measured::read(&found).map_err(ExportError::from)?);
        }
        let mut game = DatasetGame::new(stored).map_err(Fault::Broken)?;
        let mut meter = measure::meter(game.world());
        self.try_play(stored, &mut game, |game, turn| {
            measure::add(&mut meter, game, turn);
            Ok(())
        })?;
        Ok(Measured::of(&meter.metrics()))
    }

    fn leave_out(&mut self, stored: &StoredEpisode, problem: String) {
        tracing::error!(episode = %stored.id, problem, "an episode is not exported");
        self.exported.broken.push((stored.id.to_string(), problem));
    }

    fn finish(mut self, rounds: u64, acts: u64) -> Exported {
        let all = self.keys.len() as u64;
        (self.progress)(all, all);
        Exported { rounds, acts, ..self.exported }
    }

    fn stored(&self, key: EpisodeKey) -> Result<Option<StoredEpisode>, ExportError> {
        let all = Filter { readable: Readable::All, ..Filter::default() };
        let next = Some(EpisodeKey(key.0 + 1));
        let found = self.runtime.block_on(self.store.list_episodes(&all, next, 1))?;
        Ok(found.into_iter().find(|stored| stored.episode == key))
    }

    /// A selected episode before its first round; `None` if its journal cannot be replayed. The check by a replay comes
    /// before any output, as a file cannot be withdrawn once begun.
    fn sound(
        &mut self,
        key: EpisodeKey,
    ) -> Result<Option<(StoredEpisode, DatasetGame)>, ExportError> {
        let Some(stored) = self.stored(key)? else { return Ok(None) };
        let played = DatasetGame::new(&stored)
            .map_err(Fault::Broken)
            .and_then(|mut game| self.try_play(&stored, &mut game, |_, _| Ok(())));
        match played {
            Ok(()) => {}
            Err(Fault::Broken(problem)) => {
                self.leave_out(&stored, problem);
                return Ok(None);
            }
            Err(Fault::Error(error)) => return Err(error),
        }
        self.exported.episodes += 1;
        let game = lay_out(&stored)?;
        Ok(Some((stored, game)))
    }

    /// Replays an episode that passed [`Self::sound`].
    fn play(
        &self,
        stored: &StoredEpisode,
        game: &mut DatasetGame,
        each: impl FnMut(&DatasetGame, &Turn) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        self.try_play(stored, game, each).map_err(|fault| match fault {
            Fault::Broken(problem) => changed(stored, &problem),
            Fault::Error(error) => error,
        })
    }

    /// Replays an episode that passed [`Self::sound`], act by act with all texts.
    fn play_acts(
        &self,
        stored: &StoredEpisode,
        game: &mut DatasetGame,
        mut each: impl FnMut(&DatasetGame, &Turn, &GameAct) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let mut texts = ActReader::new(self.store.clone(), stored.episode, stored.rounds);
        self.play(stored, game, |game, turn| {
            for act in &turn.acts {
                check(&self.stop)?;
                let text = self.runtime.block_on(texts.next_of(turn.round, ACTS_BYTES))?;
                let text = text.ok_or_else(|| changed(stored, "an act is missing"))?;
                let record = serde_json::from_str(&text);
                let record = record.map_err(|error| changed(stored, &error.to_string()))?;
                each(game, turn, &act.with(record))?;
            }
            Ok(())
        })
    }

    fn try_play(
        &self,
        stored: &StoredEpisode,
        game: &mut DatasetGame,
        mut each: impl FnMut(&DatasetGame, &Turn) -> Result<(), ExportError>,
    ) -> Result<(), Fault> {
        let mut from = 0;
        while from < stored.rounds {
            let to = stored.rounds.min(from + CHUNK);
            check(&self.stop)?;
            let rounds = self.store.logged_rounds(stored.episode, from, to);
            let rounds = self.runtime.block_on(rounds).map_err(ExportError::from)?;
            if rounds.len() as u64 != u64::from(to - from) {
                return Err(Fault::Broken(format!("a round before round {to} is missing")));
            }
            for round in rounds {
                let turn = game.play(round).map_err(Fault::Broken)?;
                each(game, &turn)?;
            }
            from = to;
        }
        Ok(())
    }
}

pub struct ImportedGames<'a> {
    store: &'a Store,
    runtime: Handle,
    keys: Vec<ImportKey>,
    progress: Box<dyn FnMut(u64, u64) + 'a>,
}

impl<'a> ImportedGames<'a> {
    /// Selects imported games as of now. Blocks, so not for async threads.
    pub fn select(
        store: &'a Store,
        task: Option<String>,
        model: Option<String>,
        progress: impl FnMut(u64, u64) + 'a,
    ) -> Result<Self, ExportError> {
        let (runtime, filter) = (Handle::current(), ImportFilter { task, model });
        let (mut keys, mut before) = (Vec::new(), None);
        loop {
            let page = runtime.block_on(store.list_imports(&filter, before, PAGE))?;
            let Some(last) = page.last() else { break };
            before = Some(last.key);
            keys.extend(page.iter().map(|stored| stored.key));
        }
        keys.reverse();
        Ok(Self { store, runtime, keys, progress: Box::new(progress) })
    }

    /// Whether no game was selected.
    pub const fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// The models of the selected games.
    pub fn models(&self) -> Result<BTreeSet<String>, ExportError> {
        let mut models = BTreeSet::new();
        for key in &self.keys {
            models.extend(self.stored(*key)?.map(|stored| stored.model));
        }
        Ok(models)
    }

    /// Writes games in the form in which they were imported. Of several games with one name only the oldest is written, as
    /// file names are unique.
    pub fn dataset(mut self, files: &mut dyn Files) -> Result<Exported, ExportError> {
        let mut exported = Exported::default();
        let mut names = HashSet::new();
        let mut written = Vec::new();
        for (done, key) in self.keys.iter().enumerate() {
            (self.progress)(done as u64, self.keys.len() as u64);
            let Some(stored) = self.stored(*key)? else { continue };
            if !names.insert(stored.run_id.clone()) {
                let problem = "another game with this name is written".to_owned();
                exported.broken.push((stored.id, problem));
                continue;
            }
            let mut list = List::array(files.begin(&format::game_file(&stored.run_id))?)?;
            self.each(&stored, |round| {
                Ok(list.add(&imported::game_row(&stored.task, round).map_err(unreadable)?)?)
            })?;
            list.end()?;
            let mut list = List::array(files.begin(&format::agent_file(&stored.run_id))?)?;
            self.each(&stored, |round| {
                let mut added = Ok(());
                imported::each_act(round, stored.settings.num_agents, |row: AgentRow| {
                    added = std::mem::replace(&mut added, Ok(())).and_then(|()| list.add(&row));
                    Ok(())
                })
                .map_err(unreadable)?;
                Ok(added?)
            })?;
            list.end()?;
            exported.episodes += 1;
            exported.rounds += u64::from(stored.rounds);
            exported.acts += stored.acts;
            written.push(*key);
        }
        let mut entries = List::object(files.begin(META)?)?;
        for key in written {
            let Some(stored) = self.stored(key)? else { continue };
            let meta = self.runtime.block_on(self.store.imported_meta(key))?.unwrap_or_default();
            entries.add_field(&stored.run_id, &imported::meta(&meta).map_err(unreadable)?)?;
        }
        entries.end()?;
        files.finish()?;
        let all = self.keys.len() as u64;
        (self.progress)(all, all);
        Ok(exported)
    }

    fn stored(&self, key: ImportKey) -> Result<Option<StoredImport>, ExportError> {
        let (all, next) = (ImportFilter::default(), Some(ImportKey(key.0 + 1)));
        let found = self.runtime.block_on(self.store.list_imports(&all, next, 1))?;
        Ok(found.into_iter().find(|stored| stored.key == key))
    }

    fn each(
        &self,
        stored: &StoredImport,
        mut add: impl FnMut(&ImportedRound) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let mut from = 0;
        while from <= stored.rounds {
            let to = (stored.rounds + 1).min(from + CHUNK);
            let bytes = self.runtime.block_on(self.store.imported_bytes(stored.key, from, to))?;
            let to = imported::fitting(from, &bytes).map_err(unreadable)?;
            let rounds = self.runtime.block_on(self.store.imported_rounds(stored.key, from, to))?;
            rounds.iter().try_for_each(&mut add)?;
            from = to;
        }
        Ok(())
    }
}

#[expect(clippy::needless_pass_by_value, reason = "the shape that `map_err` calls")]
fn unreadable(problem: Unreadable) -> ExportError {
    ExportError::Journal(StoreError::broken(problem.to_string()))
}

/// Finds an episode that passes the filter. The caller decides whether it may be read.
async fn find(
    store: &Store,
    filter: &Filter,
    id: &EpisodeId,
) -> Result<Option<StoredEpisode>, StoreError> {
    if matches!(filter.readable, Readable::Nothing) {
        return Ok(None);
    }
    let Some(found) = store.find_summary(id).await? else { return Ok(None) };
    let filter = Filter { readable: Readable::All, ..filter.clone() };
    let next = Some(EpisodeKey(found.episode.0 + 1));
    let first = store.list_episodes(&filter, next, 1).await?.pop();
    Ok(first.filter(|first| first.episode == found.episode))
}

enum Fault {
    Broken(String),
    Error(ExportError),
}

impl From<ExportError> for Fault {
    fn from(error: ExportError) -> Self {
        Self::Error(error)
    }
}

fn check(stop: &CancellationToken) -> Result<(), ExportError> {
    if stop.is_cancelled() { Err(ExportError::Stopped) } else { Ok(()) }
}

fn lay_out(stored: &StoredEpisode) -> Result<DatasetGame, ExportError> {
    DatasetGame::new(stored).map_err(|problem| changed(stored, &problem))
}

/// Error for a journal that changed after its check. Stored episodes never change, so it does not occur.
fn changed(stored: &StoredEpisode, problem: &str) -> ExportError {
    ExportError::Journal(StoreError::broken(format!("episode {}: {problem}", stored.id)))
}

/// Writes a JSON array or object with each element on a line of its own.
struct List<'a> {
    out: io::BufWriter<&'a mut dyn Write>,
    is_empty: bool,
    end: &'static [u8],
}

impl<'a> List<'a> {
    fn array(out: &'a mut dyn Write) -> io::Result<Self> {
        Self::begin(out, b"[", b"\n]\n")
    }

    fn object(out: &'a mut dyn Write) -> io::Result<Self> {
        Self::begin(out, b"{", b"\n}\n")
    }

    fn begin(out: &'a mut dyn Write, begin: &[u8], end: &'static [u8]) -> io::Result<Self> {
        let mut out = io::BufWriter::with_capacity(BUFFER_BYTES, out);
        out.write_all(begin)?;
        Ok(Self { out, is_empty: true, end })
    }

    fn add(&mut self, element: &impl Serialize) -> io::Result<()> {
        self.out.write_all(if std::mem::take(&mut self.is_empty) { b"\n" } else { b",\n" })?;
        Ok(serde_json::to_writer(&mut self.out, element)?)
    }

    fn add_field(&mut self, name: &str, value: &impl Serialize) -> io::Result<()> {
        self.add(&name)?;
        self.out.write_all(b": ")?;
        Ok(serde_json::to_writer(&mut self.out, value)?)
    }

    fn end(mut self) -> io::Result<()> {
        self.out.write_all(self.end)?;
        self.out.flush()
    }
}
