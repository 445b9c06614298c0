//! Sources of games, and the selection among them.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use tokio_util::sync::CancellationToken;

use super::super::output::{progress_bar, set};
use super::{Condition, Games, Selected, Value, games_told, told};
use crate::dataset::export::{Export, Selection};
use crate::dataset::rows::{self, DatasetRow, Lines};
use crate::dataset::tables::TableName;
use crate::store::episodes::{Filter, Readable};
use crate::store::{Location, Store};
use swarmbench_commands::options::ServerArgs;

/// Source of games.
#[derive(Clone, Debug, clap::Args)]
struct Source {
    /// The games of an export instead of a server's: a folder of `swarmbench export FOLDER --format jsonl` (or parquet), or
    /// its file of episodes. May be repeated.
    #[arg(long, value_name = "PATH", conflicts_with = "db")]
    from: Vec<PathBuf>,
    /// The games of a database instead of a server's. The database is only read, so its server may keep running.
    #[arg(long)]
    db: Option<Location>,
    #[command(flatten)]
    server: ServerArgs,
}

#[derive(Clone, Debug, clap::Args)]
pub(in super::super) struct Choice {
    #[command(flatten)]
    source: Source,
    /// Use only games in which this column has this value, or one of several: `view_size=5`, `temperature=0,1`. `none` stands
    /// for a missing value. A value with commas stands in double quotes: `suite="a, b"`. May be repeated.
    #[arg(long = "where", value_name = "COLUMN=VALUE,…")]
    conditions: Vec<Condition>,
    /// Columns of `agent_meta` that do not change how a model plays: games of one model may differ in these.
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',')]
    pub(in super::super) ignore: Vec<String>,
}

impl Choice {
    /// Reads the games, and selects those that count: finished and not voided.
    pub(in super::super) async fn select(&self) -> anyhow::Result<Selected> {
        selected(self.source.read().await?, &self.conditions)
    }
}

impl Source {
    async fn read(&self) -> anyhow::Result<Games> {
        let Self { from, db, server } = self.clone();
        if !from.is_empty() {
            tokio::task::spawn_blocking(move || of_files(&from)).await?
        } else if let Some(db) = db {
            tokio::task::spawn_blocking(move || of_database(&db)).await?
        } else {
            of_server(server).await
        }
    }
}

/// Adds rows to games, and passes their error on.
fn adding(games: &mut Games) -> impl FnMut(DatasetRow) -> io::Result<()> + '_ {
    |row| games.add(row).map_err(|error| io::Error::other(format!("{error:#}")))
}

fn of_files(paths: &[PathBuf]) -> anyhow::Result<Games> {
    let mut games = Games::default();
    for path in paths {
        let file = file_of(path)?;
        rows::read(&file, adding(&mut games)).with_context(|| format!("{}", file.display()))?;
    }
    Ok(games)
}

/// The file of episodes: a path is either this file, or its folder.
fn file_of(path: &Path) -> anyhow::Result<PathBuf> {
    ensure!(
        path.extension().is_none_or(|end| end != "partial"),
        "{} is an incomplete export: export the games again",
        path.display()
    );
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let name = TableName::Episodes.name();
    let files = ["jsonl", "parquet"].map(|end| path.join(format!("{name}.{end}")));
    files.into_iter().find(|file| file.is_file()).with_context(|| {
        format!(
            "{} has no file {name}.jsonl or {name}.parquet: name a folder of `swarmbench export FOLDER --format jsonl`",
            path.display()
        )
    })
}

fn of_database(db: &Location) -> anyhow::Result<Games> {
    let mut games = Games::default();
    let runtime = tokio::runtime::Handle::current();
    let store = runtime.block_on(Store::open_to_read(db))?;
    let bar = progress_bar("{bar:30} {pos} of {len} games, {elapsed}");
    let filter = Filter {
        readable: Readable::All,
        forks: Filter::of_forks(false, false),
        ..Filter::default()
    };
    let selection = Selection { filter, episode: None };
    let progress = |done, of| set(&bar, done, of);
    let export = Export::select(&store, &selection, |_| true, progress, CancellationToken::new())?;
    let exported = export.lines(TableName::Episodes, Lines::new(adding(&mut games)))?;
    bar.finish_and_clear();
    runtime.block_on(store.close());
    for (episode, problem) in &exported.broken {
        note!("left out: {episode} is damaged: {problem}");
    }
    Ok(games)
}

async fn of_server(server: ServerArgs) -> anyhow::Result<Games> {
    let mut games = Games::default();
    let client = server.client().await?;
    let bar = progress_bar("{spinner} {bytes} {elapsed}");
    let mut lines = Lines::new(adding(&mut games));
    let mut out = bar.wrap_write(&mut lines);
    let path = format!("/api/v1/exports/{}.jsonl", TableName::Episodes.name());
    let sent = client.download(&path, &[], &mut out).await;
    bar.finish_and_clear();
    sent?;
    lines.finish()?;
    Ok(games)
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
