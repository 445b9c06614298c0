//! `swarmbench export`

use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::{HumanBytes, HumanCount};
use swarmbench_engine::TaskName;
use tokio_util::sync::CancellationToken;

use super::options::client;
use super::output::{progress_bar, set};
use super::play::task;
use crate::dataset::export::{Export, Exported, ImportedGames, Selection};
use crate::dataset::files::{Archive, Files, Folder};
use crate::dataset::tables::TableName;
use crate::episode::Status;
use crate::ids::EpisodeId;
use crate::store::Store;
use crate::store::episodes::{Filter, Readable};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The database is only read; its server may keep running. An incomplete export has a name that ends in \
    .partial.\n\nThe format `dataset` is that of the public toolkit (docs/evaluate/dataset.md): its scripts read the folder. \
    `jsonl` and `parquet` write the two tables acts and rounds into it.\n\nExamples:\n  \
    swarmbench export games --db swarmbench.db\n  \
    swarmbench export games.zip --task Transport --model my-model\n  \
    swarmbench export tables --format parquet\n  \
    swarmbench export games.zip --server http://127.0.0.1:8080"
)]
pub(super) struct Args {
    /// The folder to create, or the archive if the name ends in .zip; it must not exist.
    to: PathBuf,
    /// The database of the server.
    #[arg(long, env = "SWARMBENCH_DB", default_value = "swarmbench.db")]
    db: PathBuf,
    /// Download an archive from this server instead, of all episodes that your key may read.
    #[arg(long, conflicts_with_all = ["imported", "format"])]
    server: Option<String>,
    /// Your key, for `--server`.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// The format.
    #[arg(long, value_enum, default_value = "dataset")]
    format: Format,
    /// Only episodes of this run.
    #[arg(long)]
    run: Option<String>,
    /// Only episodes of this task.
    #[arg(long, value_parser = task)]
    task: Option<TaskName>,
    /// Only episodes of this model.
    #[arg(long)]
    model: Option<String>,
    /// Only episodes with this status: waiting, running, finished, aborted or abandoned. Default: all that have
    /// ended.
    #[arg(long, value_parser = status)]
    status: Option<Status>,
    /// Only this episode.
    #[arg(long)]
    episode: Option<String>,
    /// Imported games instead of episodes of this server.
    #[arg(long, conflicts_with_all = ["run", "status", "episode", "format"])]
    imported: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// The files of the public toolkit.
    Dataset,
    /// Acts and rounds as JSON Lines.
    Jsonl,
    /// Acts and rounds as Parquet.
    Parquet,
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
    let exported = if let Some(server) = args.server.clone() {
        if !is_archive {
            bail!("a server sends an archive: name a file that ends in .zip");
        }
        download(&args, &server, &partial).await?;
        None
    } else {
        let partial = partial.clone();
        let work = move || write(&args, &partial, is_archive);
        Some(tokio::task::spawn_blocking(work).await??)
    };
    std::fs::rename(&partial, &to)
        .with_context(|| format!("{} cannot be renamed", partial.display()))?;
    if let Some(Exported { episodes, rounds, acts, broken }) = exported {
        println!(
            "{}: {} games, {} rounds, {} acts",
            to.display(),
            HumanCount(episodes),
            HumanCount(rounds),
            HumanCount(acts)
        );
        for (episode, problem) in &broken {
            eprintln!("left out: {episode} cannot be replayed: {problem}");
        }
        if !broken.is_empty() {
            bail!("{} episodes are left out; the others are written", broken.len());
        }
    } else {
        println!("{}: {}", to.display(), HumanBytes(std::fs::metadata(&to)?.len()));
    }
    Ok(())
}

/// Writes all files, on a thread of its own.
fn write(args: &Args, partial: &Path, is_archive: bool) -> anyhow::Result<Exported> {
    let runtime = tokio::runtime::Handle::current();
    let store = runtime.block_on(Store::open_to_read(&args.db))?;
    let bar = progress_bar("{bar:30} {pos} of {len} games, {elapsed}");
    let progress = |done, of| set(&bar, done, of);
    let mut files: Box<dyn Files> = if is_archive {
        Box::new(Archive::new(create(partial)?))
    } else {
        std::fs::create_dir(partial).with_context(|| not_created(partial))?;
        Box::new(Folder::new(partial.to_owned()))
    };
    let task = args.task.map(|task| task.name().to_owned());
    let exported = if args.imported {
        ImportedGames::select(&store, task, args.model.clone(), progress)?.dataset(&mut *files)?
    } else {
        let run = match &args.run {
            None => None,
            Some(id) => {
                let run = runtime.block_on(store.find_run(id))?;
                Some(run.with_context(|| format!("there is no run {id}"))?.run)
            }
        };
        let status = args.status.map(|status| status.name().to_owned());
        let filter = Filter {
            status,
            task,
            played_by: args.model.clone(),
            run,
            readable: Readable::All,
            ..Filter::default()
        };
        let selection =
            Selection { filter, episode: args.episode.clone().map(EpisodeId::from_text) };
        let select =
            || Export::select(&store, &selection, |_| true, progress, CancellationToken::new());
        match args.format {
            Format::Dataset => select()?.dataset(&mut *files)?,
            Format::Jsonl => {
                select()?.lines(TableName::Acts, create(&partial.join("acts.jsonl"))?)?;
                select()?.lines(TableName::Rounds, create(&partial.join("rounds.jsonl"))?)?
            }
            Format::Parquet => {
                select()?.parquet(TableName::Acts, create(&partial.join("acts.parquet"))?)?;
                select()?.parquet(TableName::Rounds, create(&partial.join("rounds.parquet"))?)?
            }
        }
    };
    bar.finish_and_clear();
    drop(files);
    runtime.block_on(store.close());
    Ok(exported)
}

fn not_created(path: &Path) -> String {
    let path = path.display();
    format!("{path} cannot be created; if it is left over from an interrupted export, remove it")
}

fn create(path: &Path) -> anyhow::Result<File> {
    File::create_new(path).with_context(|| not_created(path))
}

async fn download(args: &Args, server: &str, partial: &Path) -> anyhow::Result<()> {
    let client = client(server, args.key.clone())?;
    let task = args.task.map(|task| task.name().to_owned());
    let status = args.status.map(|status| status.name().to_owned());
    let query: Vec<(&str, &String)> = [
        ("run", &args.run),
        ("task", &task),
        ("model", &args.model),
        ("status", &status),
        ("episode", &args.episode),
    ]
    .into_iter()
    .filter_map(|(name, value)| Some((name, value.as_ref()?)))
    .collect();
    let bar = progress_bar("{spinner} {bytes} {elapsed}");
    let mut file = create(partial)?;
    client.download("/api/v1/exports/dataset.zip", &query, &mut bar.wrap_write(&mut file)).await?;
    bar.finish_and_clear();
    Ok(file.sync_all()?)
}
