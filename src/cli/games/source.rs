//! Where games are read, and which of them are selected.

use std::collections::BTreeMap;
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
use crate::store::Store;
use crate::store::episodes::{Filter, Readable};

#[derive(Debug, clap::Args)]
pub(in super::super) struct Choice {
    /// Instead of a server: a folder of `swarmbench export FOLDER --format jsonl` (or parquet), or its file of episodes.
    /// May be given several times.
    #[arg(long, value_name = "PATH", conflicts_with = "db")]
    from: Vec<PathBuf>,
    /// Instead of a server: its database. It is only read; its server may keep running.
    #[arg(long)]
    db: Option<PathBuf>,
    #[command(flatten)]
    server: ServerArgs,
    /// Only games in which this column has this value, or one of several: `view_size=5`, `temperature=0,1`. `none` stands for
    /// a missing value. May be given several times.
    #[arg(long = "where", value_name = "COLUMN=VALUE,…")]
    conditions: Vec<Condition>,
    /// Columns of `agent_meta` that do not change how a model plays: its games may differ in them.
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',')]
    pub(in super::super) ignore: Vec<String>,
}

impl Choice {
    /// Reads the games, and selects those that count: finished ones that were not voided.
    pub(in super::super) async fn select(self) -> anyhow::Result<Selected> {
        let Self { from, db, server, conditions, ignore: _ } = self;
        let games = if !from.is_empty() {
            tokio::task::spawn_blocking(move || of_files(&from)).await??
        } else if let Some(db) = db {
            tokio::task::spawn_blocking(move || of_database(&db)).await??
        } else {
            of_server(server).await?
        };
        selected(games, &conditions)
    }
}

/// Adds rows to games. The error is that of a reader.
fn adding(games: &mut Games) -> impl FnMut(Row) -> io::Result<()> + '_ {
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

/// The file of episodes of a folder.
fn file_of(path: &Path) -> anyhow::Result<PathBuf> {
    ensure!(
        path.extension().is_none_or(|end| end != "partial"),
        "{} is an incomplete export: export the games again",
        path.display()
    );
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let files = ["episodes.jsonl", "episodes.parquet"].map(|name| path.join(name));
    files.into_iter().find(|file| file.is_file()).with_context(|| {
        format!(
            "{} has no file episodes.jsonl or episodes.parquet: name a folder of `swarmbench export FOLDER --format jsonl`",
            path.display()
        )
    })
}

fn of_database(db: &Path) -> anyhow::Result<Games> {
    let runtime = tokio::runtime::Handle::current();
    let store = runtime.block_on(Store::open_to_read(db))?;
    let bar = progress_bar("{bar:30} {pos} of {len} games, {elapsed}");
    let filter = Filter { readable: Readable::All, ..Filter::default() };
    let selection = Selection { filter, episode: None };
    let mut games = Games::default();
    let progress = |done, of| set(&bar, done, of);
    let export = Export::select(&store, &selection, |_| true, progress, CancellationToken::new())?;
    let exported = export.lines(TableName::Episodes, Lines::new(adding(&mut games)))?;
    bar.finish_and_clear();
    runtime.block_on(store.close());
    for (episode, problem) in &exported.broken {
        eprintln!("left out: {episode} is damaged: {problem}");
    }
    Ok(games)
}

async fn of_server(server: ServerArgs) -> anyhow::Result<Games> {
    let client = server.client()?;
    let mut games = Games::default();
    let bar = progress_bar("{spinner} {bytes} {elapsed}");
    let mut lines = Lines::new(adding(&mut games));
    let mut out = bar.wrap_write(&mut lines);
    let sent = client.download("/api/v1/exports/episodes.jsonl", &[], &mut out).await;
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
