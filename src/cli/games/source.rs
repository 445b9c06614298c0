//! Sources of games, and the selection among them.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use tokio_util::sync::CancellationToken;

use super::super::options::ServerArgs;
use super::super::output::{progress_bar, set};
use super::{Condition, Games, Selected, Value, games_told, told};
use crate::dataset::export::{Export, Selection};
use crate::dataset::rows::{self, Lines, Row};
use crate::dataset::tables::TableName;
use crate::store::episodes::{Filter, Readable};
use crate::store::port::StoredEpisode;
use crate::store::{Location, Store};

/// Source of games.
#[derive(Clone, Debug, clap::Args)]
pub(in super::super) struct Source {
    /// The games of an export instead of a server's: a folder of `swarmbench export FOLDER --format jsonl` (or parquet), or
    /// its file of episodes. May be repeated.
    #[arg(long, value_name = "PATH", conflicts_with = "db")]
    from: Vec<PathBuf>,
    /// The games of a database instead of a server's. The database is only read, so its server may keep running.
    #[arg(long)]
    db: Option<Location>,
    #[command(flatten)]
    pub(in super::super) server: ServerArgs,
}

#[derive(Clone, Debug, clap::Args)]
pub(in super::super) struct Choice {
    #[command(flatten)]
    pub(in super::super) source: Source,
    /// Use only games in which this column has this value, or one of several: `view_size=5`, `temperature=0,1`. `none` stands
    /// for a missing value. A value with commas stands in double quotes: `suite="a, b"`. May be repeated.
    #[arg(long = "where", value_name = "COLUMN=VALUE,…")]
    conditions: Vec<Condition>,
    /// Columns of `agent_meta` that do not change how a model plays: games of one model may differ in these.
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',')]
    pub(in super::super) ignore: Vec<String>,
}

impl Choice {
    /// Adds a condition: the column has this value.
    #[must_use]
    pub(in super::super) fn with(mut self, column: &str, value: &str) -> Self {
        let values = vec![value.to_owned()];
        self.conditions.push(Condition { column: column.to_owned(), values });
        self
    }

    /// Whether the source is a server, without conditions.
    pub(in super::super) fn is_whole_server(&self) -> bool {
        let Source { from, db, .. } = &self.source;
        from.is_empty() && db.is_none() && self.conditions.is_empty()
    }

    /// Reads the games, and selects those that count: finished and not voided.
    pub(in super::super) async fn select(&self) -> anyhow::Result<Selected> {
        self.of(self.source.read(Wanted::episodes(), Games::default()).await?)
    }

    /// Selects among games that were read.
    pub(super) fn of(&self, games: Games) -> anyhow::Result<Selected> {
        selected(games, &self.conditions)
    }

    #[cfg(test)]
    pub(super) fn of_folders<const N: usize>(folders: [&Path; N]) -> Self {
        let from = folders.map(Path::to_owned).to_vec();
        let server = ServerArgs { server: String::new(), key: None };
        Self {
            source: Source { from, db: None, server },
            conditions: Vec::new(),
            ignore: Vec::new(),
        }
    }
}

/// A table, and the games whose rows are wanted.
pub(super) struct Wanted {
    pub(super) table: TableName,
    /// Restricts the rows to a task.
    pub(super) task: Option<String>,
    /// Restricts the rows to these games.
    pub(super) episodes: Option<BTreeSet<String>>,
}

impl Wanted {
    const fn episodes() -> Self {
        Self { table: TableName::Episodes, task: None, episodes: None }
    }
}

/// Consumer of rows.
pub(super) trait Reader: Send + 'static {
    fn add(&mut self, row: Row) -> anyhow::Result<()>;
}

impl Reader for Games {
    fn add(&mut self, row: Row) -> anyhow::Result<()> {
        self.add(row)
    }
}

impl Source {
    /// Reads the rows of a table. Rows of other games may be among them.
    pub(super) async fn read<R: Reader>(&self, wanted: Wanted, reader: R) -> anyhow::Result<R> {
        let Self { from, db, server } = self.clone();
        if !from.is_empty() {
            tokio::task::spawn_blocking(move || of_files(&from, wanted.table, reader)).await?
        } else if let Some(db) = db {
            tokio::task::spawn_blocking(move || of_database(&db, &wanted, reader)).await?
        } else {
            of_server(server, &wanted, reader).await
        }
    }
}

/// Passes rows to a reader, and its error on.
fn adding(reader: &mut impl Reader) -> impl FnMut(Row) -> io::Result<()> + '_ {
    |row| reader.add(row).map_err(|error| io::Error::other(format!("{error:#}")))
}

fn of_files<R: Reader>(paths: &[PathBuf], table: TableName, mut reader: R) -> anyhow::Result<R> {
    for path in paths {
        let file = file_of(path, table)?;
        rows::read(&file, adding(&mut reader)).with_context(|| format!("{}", file.display()))?;
    }
    Ok(reader)
}

/// File of a table: a path is either the folder, or the file of episodes in it.
fn file_of(path: &Path, table: TableName) -> anyhow::Result<PathBuf> {
    ensure!(
        path.extension().is_none_or(|end| end != "partial"),
        "{} is an incomplete export: export the games again",
        path.display()
    );
    let is_file = !path.is_dir();
    if is_file && table == TableName::Episodes {
        return Ok(path.to_owned());
    }
    let folder = if is_file { path.parent().unwrap_or(path) } else { path };
    let name = table.name();
    let files = ["jsonl", "parquet"].map(|end| folder.join(format!("{name}.{end}")));
    files.into_iter().find(|file| file.is_file()).with_context(|| {
        format!(
            "{} has no file {name}.jsonl or {name}.parquet: name a folder of `swarmbench export FOLDER --format jsonl`",
            folder.display()
        )
    })
}

fn of_database<R: Reader>(db: &Location, wanted: &Wanted, mut reader: R) -> anyhow::Result<R> {
    let Wanted { table, task, episodes } = wanted;
    let runtime = tokio::runtime::Handle::current();
    let store = runtime.block_on(Store::open_to_read(db))?;
    let bar = progress_bar("{bar:30} {pos} of {len} games, {elapsed}");
    let filter = Filter {
        readable: Readable::All,
        task: task.clone(),
        forks: Filter::of_forks(false, false),
        ..Filter::default()
    };
    let selection = Selection { filter, episode: None };
    let is_wanted = |stored: &StoredEpisode| {
        episodes.as_ref().is_none_or(|episodes| episodes.contains(stored.id.as_str()))
    };
    let progress = |done, of| set(&bar, done, of);
    let export = Export::select(&store, &selection, is_wanted, progress, CancellationToken::new())?;
    let exported = export.lines(*table, Lines::new(adding(&mut reader)))?;
    bar.finish_and_clear();
    runtime.block_on(store.close());
    for (episode, problem) in &exported.broken {
        note!("left out: {episode} is damaged: {problem}");
    }
    Ok(reader)
}

async fn of_server<R: Reader>(
    server: ServerArgs,
    wanted: &Wanted,
    mut reader: R,
) -> anyhow::Result<R> {
    let client = server.client().await?;
    let bar = progress_bar("{spinner} {bytes} {elapsed}");
    let mut lines = Lines::new(adding(&mut reader));
    let mut out = bar.wrap_write(&mut lines);
    let path = format!("/api/v1/exports/{}.jsonl", wanted.table.name());
    let query: Vec<(&str, &String)> = wanted.task.iter().map(|task| ("task", task)).collect();
    let sent = client.download(&path, &query, &mut out).await;
    bar.finish_and_clear();
    sent?;
    lines.finish()?;
    Ok(reader)
}

fn selected(games: Games, conditions: &[Condition]) -> anyhow::Result<Selected> {
    ensure!(games.len > 0, "there are no games that have ended");
    let all: Vec<usize> = (0..games.len).collect();
    for condition in conditions {
        games.check_column(&condition.column)?;
        let counts = games.counts(&condition.column, &all);
        if !counts.keys().any(|value| condition.holds(value)) {
            bail!("no game matches {condition}; {} is {}", condition.column, told(&counts));
        }
    }
    let holds = |game: usize| {
        conditions.iter().all(|condition| condition.holds(games.value(&condition.column, game)))
    };
    let matching: Vec<usize> = all.into_iter().filter(|&game| holds(game)).collect();
    if matching.is_empty() {
        let all: Vec<String> = conditions.iter().map(ToString::to_string).collect();
        bail!("no game matches all of {}", all.join(" "));
    }
    let (mut chosen, mut left_out) = (Vec::new(), BTreeMap::<String, usize>::new());
    for game in matching {
        let status = games.value("status", game).to_string();
        if *games.value("void_reason", game) != Value::Missing {
            *left_out.entry("voided".to_owned()).or_default() += 1;
        } else if status == "finished" {
            chosen.push(game);
        } else {
            *left_out.entry(status).or_default() += 1;
        }
    }
    let left_out: Vec<String> =
        left_out.iter().map(|(status, games)| format!("{games} {status}")).collect();
    let left_out = left_out.join(", ");
    ensure!(!chosen.is_empty(), "no game is finished: {left_out}");
    let counted = format!("{} that finished", games_told(chosen.len()));
    let notes = vec![if left_out.is_empty() {
        counted
    } else {
        format!("{counted}; not counted: {left_out}")
    }];
    Ok(Selected { games, chosen, notes })
}
