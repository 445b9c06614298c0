//! `swarmbench export`

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::{HumanBytes, HumanCount, ProgressBar};
use serde_json::json;
use swarmbench_engine::TaskName;
use tokio_util::sync::CancellationToken;

use super::no_match::Models;
use super::output::{self, progress_bar, set};
use crate::dataset::export::{Export, ExportError, Exported, ImportedGames, Selection};
use crate::dataset::files::{Archive, Files, Folder, has_games};
use crate::dataset::tables::TableName;
use crate::episode::Status;
use crate::ids::EpisodeId;
use crate::store::episodes::{Filter, Readable};
use crate::store::{Location, Store};
use swarmbench_commands::options::client;
use swarmbench_commands::play::task;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The export only reads the database, so its server may keep running. The name of an incomplete export ends in \
    .partial.\n\nThe format `dataset` is that of the public toolkit, whose scripts read the folder (docs/evaluate/dataset.md). \
    `jsonl` and `parquet` write the tables episodes, acts and rounds into a folder.\n\nExamples:\n  \
    swarmbench export games --db swarmbench.db\n  \
    swarmbench export games.zip --task Transport --model my-model\n  \
    swarmbench export tables --format parquet\n  \
    swarmbench export tables --format jsonl --with heard,views\n  \
    swarmbench export games.zip --server http://127.0.0.1:8080\n  \
    swarmbench export tables --format parquet --server http://127.0.0.1:8080"
)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
pub(super) struct Args {
    /// The folder to create, or the archive if the name ends in .zip. It must not exist.
    to: PathBuf,
    /// The database of the server.
    #[arg(long, env = "SWARMBENCH_DB", hide_env_values = true, default_value = "swarmbench.db")]
    db: Location,
    /// The address of a server from which to download instead: all episodes that your key may read.
    #[arg(long, conflicts_with = "imported")]
    server: Option<String>,
    /// Your key, for `--server`.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// The format of the export.
    #[arg(long, value_enum, default_value = "dataset")]
    format: Format,
    /// Further tables of jsonl or parquet: the messages that agents received (heard), and their windows (views), which take
    /// much space.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "TABLES")]
    with: Vec<MoreTable>,
    /// Export only episodes of this run.
    #[arg(long)]
    run: Option<String>,
    /// Export only episodes of this task.
    #[arg(long, value_parser = task)]
    task: Option<TaskName>,
    /// Export only episodes in which this model held a seat. The table acts has only the acts of the model's seats.
    #[arg(long)]
    model: Option<String>,
    /// Leave out episodes whose seats had several holders.
    #[arg(long)]
    no_mixed: bool,
    /// Export forks, too: games that continue from a round of another game. Without this option forks are left out, except one
    /// that --episode names.
    #[arg(long)]
    forks: bool,
    /// Export only episodes with this status: waiting, running, finished, aborted or abandoned. Default: all episodes that
    /// have ended.
    #[arg(long, value_parser = status)]
    status: Option<Status>,
    /// Export only this episode.
    #[arg(long)]
    episode: Option<String>,
    /// Export imported games instead of episodes of this server.
    #[arg(long, conflicts_with_all = ["run", "no_mixed", "forks", "status", "episode", "format"])]
    imported: bool,
    /// Print a summary of the export as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// The files of the public toolkit.
    Dataset,
    /// Episodes, acts and rounds as JSON Lines.
    Jsonl,
    /// Episodes, acts and rounds as Parquet.
    Parquet,
}

impl Format {
    /// File extension of tables; none for files of the toolkit.
    const fn end(self) -> Option<&'static str> {
        match self {
            Self::Dataset => None,
            Self::Jsonl => Some("jsonl"),
            Self::Parquet => Some("parquet"),
        }
    }
}

/// A table that is written only when it is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum MoreTable {
    /// The messages that agents received.
    Heard,
    /// The windows that agents saw.
    Views,
}

impl Args {
    fn more_tables(&self) -> Vec<TableName> {
        let table = |more: &MoreTable| match more {
            MoreTable::Heard => TableName::Heard,
            MoreTable::Views => TableName::Views,
        };
        self.with.iter().map(table).collect()
    }

    /// Names of the files of tables.
    fn table_files(&self, end: &str) -> Vec<String> {
        let tables = [TableName::Episodes, TableName::Acts, TableName::Rounds];
        let all = tables.into_iter().chain(self.more_tables());
        all.map(|table| format!("{}.{end}", table.name())).collect()
    }

    /// The filters as a server's query parameters.
    fn query(&self) -> Vec<(&'static str, String)> {
        let filters = [
            ("run", self.run.clone()),
            ("task", self.task()),
            ("model", self.model.clone()),
            ("mixed", self.no_mixed.then(|| false.to_string())),
            ("forks", self.forks.then(|| true.to_string())),
            ("status", self.status()),
            ("episode", self.episode.clone()),
        ];
        filters.into_iter().filter_map(|(name, value)| Some((name, value?))).collect()
    }

    fn task(&self) -> Option<String> {
        self.task.map(|task| task.name().to_owned())
    }

    fn status(&self) -> Option<String> {
        self.status.map(|status| status.name().to_owned())
    }

    /// Error when no game matches.
    fn no_match(&self, models: &Models) -> anyhow::Error {
        let mut filters = Vec::new();
        if self.imported {
            filters.push("--imported".to_owned());
        }
        filters.extend(self.query().into_iter().map(|(name, value)| match name {
            "mixed" => "--no-mixed".to_owned(),
            "forks" => "--forks".to_owned(),
            name => format!("--{name} {value}"),
        }));
        models.no_match(&filters, self.model.as_deref())
    }
}

fn status(name: &str) -> Result<Status, String> {
    let names = Status::ALL.map(Status::name).join(", ");
    Status::parse(name).ok_or_else(|| format!("must be one of {names}"))
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let to = std::path::absolute(&args.to).with_context(|| format!("{}", args.to.display()))?;
    if to.symlink_metadata().is_ok() {
        bail!("{} exists and is not overwritten: name another folder or file", to.display());
    }
    let is_archive = to.extension().is_some_and(|end| end.eq_ignore_ascii_case("zip"));
    let mut partial = to.clone().into_os_string();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    if is_archive && args.format != Format::Dataset {
        bail!("{} is an archive; name a folder for --format jsonl or parquet", to.display());
    }
    let files = args.format.end().map(|end| args.table_files(end));
    let tables = files.as_ref().map(|files| files.join(", "));
    let json = args.json;
    if !args.with.is_empty() && args.format == Format::Dataset {
        bail!("--with names tables: use it with --format jsonl or parquet");
    }
    let exported = if let Some(server) = args.server.clone() {
        match args.format.end() {
            Some(end) => download_tables(&args, &server, &partial, end).await?,
            None if is_archive => download(&args, &server, &partial).await?,
            None => bail!(
                "a server sends an archive: name a file that ends in .zip, or ask for tables with --format"
            ),
        }
        None
    } else {
        let partial = partial.clone();
        let work = move || write(&args, &partial, is_archive);
        Some(tokio::task::spawn_blocking(work).await??)
    };
    std::fs::rename(&partial, &to)
        .with_context(|| format!("{} cannot be renamed", partial.display()))?;
    if let Some(Exported { episodes, rounds, acts, broken }) = exported {
        if json {
            output::json(&json!({
                "to": to, "games": episodes, "rounds": rounds, "acts": acts,
                "left_out": broken.iter().map(|(episode, problem)| json!({ "episode": episode, "problem": problem }))
                    .collect::<Vec<_>>(),
            }))?;
        } else {
            out!(
                "{}: {} games, {} rounds, {} acts",
                to.display(),
                HumanCount(episodes),
                HumanCount(rounds),
                HumanCount(acts)
            );
        }
        for (episode, problem) in &broken {
            note!("left out: {episode} cannot be replayed: {problem}");
        }
        if !broken.is_empty() {
            bail!("{} episodes are left out; the others are written", broken.len());
        }
    } else if json {
        output::json(&json!({ "to": to, "files": files }))?;
    } else if let Some(tables) = tables {
        out!("{}: {tables}", to.display());
    } else {
        out!("{}: {}", to.display(), HumanBytes(std::fs::metadata(&to)?.len()));
    }
    Ok(())
}

/// Writes all files. Blocks, so it needs a thread of its own.
fn write(args: &Args, partial: &Path, is_archive: bool) -> anyhow::Result<Exported> {
    let runtime = tokio::runtime::Handle::current();
    let store = runtime.block_on(Store::open_to_read(&args.db))?;
    let bar = progress_bar("{bar:30} {pos} of {len} games, {elapsed}");
    let exported = if args.imported {
        write_imported(args, &store, &bar, partial, is_archive)
    } else {
        write_episodes(args, &store, &bar, partial, is_archive)
    };
    bar.finish_and_clear();
    runtime.block_on(store.close());
    exported
}

fn write_imported(
    args: &Args,
    store: &Store,
    bar: &ProgressBar,
    partial: &Path,
    is_archive: bool,
) -> anyhow::Result<Exported> {
    let select =
        |model| ImportedGames::select(store, args.task(), model, |done, of| set(bar, done, of));
    let games = select(args.model.clone())?;
    if games.is_empty() {
        let mut models = Models::default();
        models.add(select(None)?.models()?);
        return Err(args.no_match(&models));
    }
    Ok(games.dataset(&mut *files(partial, is_archive)?)?)
}

fn write_episodes(
    args: &Args,
    store: &Store,
    bar: &ProgressBar,
    partial: &Path,
    is_archive: bool,
) -> anyhow::Result<Exported> {
    let mut selection = selection(args, store)?;
    let select = |selection: &Selection| {
        let progress = |done, of| set(bar, done, of);
        Export::select(store, selection, |_| true, progress, CancellationToken::new())
    };
    let export = match select(&selection) {
        Ok(export) if !export.is_empty() => export,
        Ok(_) | Err(ExportError::Unknown(_)) => {
            let mut models = Models::default();
            if selection.filter.played_by.take().is_some() && selection.episode.is_none() {
                select(&selection)?.lines(TableName::Episodes, &mut models)?;
            }
            return Err(args.no_match(&models));
        }
        Err(error) => return Err(error.into()),
    };
    let Some(end) = args.format.end() else {
        return Ok(export.dataset(&mut *files(partial, is_archive)?)?);
    };
    std::fs::create_dir(partial).with_context(|| not_created(partial))?;
    let table = |table: TableName| -> anyhow::Result<Exported> {
        let file = create(&partial.join(format!("{}.{end}", table.name())))?;
        let export = select(&selection)?;
        Ok(match args.format {
            Format::Parquet => export.parquet(table, file)?,
            Format::Dataset | Format::Jsonl => export.lines(table, file)?,
        })
    };
    table(TableName::Episodes)?;
    let acts = table(TableName::Acts)?.acts;
    let rounds = table(TableName::Rounds)?;
    for more in args.more_tables() {
        table(more)?;
    }
    Ok(Exported { acts, ..rounds })
}

fn selection(args: &Args, store: &Store) -> anyhow::Result<Selection> {
    let run = match &args.run {
        None => None,
        Some(id) => {
            let run = tokio::runtime::Handle::current().block_on(store.find_run(id))?;
            Some(run.with_context(|| format!("there is no run {id}"))?.run)
        }
    };
    let filter = Filter {
        status: args.status(),
        task: args.task(),
        played_by: args.model.clone(),
        mixed: args.no_mixed.then_some(false),
        forks: Filter::of_forks(args.forks, args.episode.is_some()),
        run,
        readable: Readable::All,
        ..Filter::default()
    };
    Ok(Selection { filter, episode: args.episode.clone().map(EpisodeId::from_text) })
}

fn files(partial: &Path, is_archive: bool) -> anyhow::Result<Box<dyn Files>> {
    if is_archive {
        return Ok(Box::new(Archive::new(create(partial)?)));
    }
    std::fs::create_dir(partial).with_context(|| not_created(partial))?;
    Ok(Box::new(Folder::new(partial.to_owned())))
}

fn not_created(path: &Path) -> String {
    let path = path.display();
    format!("{path} cannot be created; if it is left over from an interrupted export, remove it")
}

fn create(path: &Path) -> anyhow::Result<File> {
    File::create_new(path).with_context(|| not_created(path))
}

/// Downloads each table into a folder.
async fn download_tables(
    args: &Args,
    server: &str,
    partial: &Path,
    end: &str,
) -> anyhow::Result<()> {
    let client = client(server, args.key.clone()).await?;
    let query = args.query();
    let query: Vec<(&str, &String)> = query.iter().map(|(name, value)| (*name, value)).collect();
    std::fs::create_dir(partial).with_context(|| not_created(partial))?;
    for name in args.table_files(end) {
        let bar = progress_bar("{spinner} {msg} {bytes} {elapsed}").with_message(name.clone());
        let mut file = create(&partial.join(&name))?;
        let path = format!("/api/v1/exports/{name}");
        let sent = client.download(&path, &query, &mut bar.wrap_write(&mut file)).await;
        bar.finish_and_clear();
        sent.with_context(|| format!("{name} is not whole; remove {}", partial.display()))?;
        file.sync_all()?;
    }
    Ok(())
}

async fn download(args: &Args, server: &str, partial: &Path) -> anyhow::Result<()> {
    let client = client(server, args.key.clone()).await?;
    let query = args.query();
    let query: Vec<(&str, &String)> = query.iter().map(|(name, value)| (*name, value)).collect();
    let bar = progress_bar("{spinner} {bytes} {elapsed}");
    let mut file = create(partial)?;
    let out = &mut bar.wrap_write(&mut file);
    let sent = client.download("/api/v1/exports/dataset.zip", &query, out).await;
    bar.finish_and_clear();
    if file.metadata()?.len() == 0 {
        std::fs::remove_file(partial)?;
    }
    sent?;
    file.sync_all()?;
    if has_games(partial)? {
        return Ok(());
    }
    std::fs::remove_file(partial)?;
    let mut models = Models::default();
    if args.model.is_some() && args.episode.is_none() {
        let others: Vec<_> = query.into_iter().filter(|(name, _)| *name != "model").collect();
        let asked = client.download("/api/v1/exports/episodes.jsonl", &others, &mut models).await;
        if let Err(error) = asked {
            note!("the models that have games cannot be listed: {error}");
        }
    }
    Err(args.no_match(&models))
}
