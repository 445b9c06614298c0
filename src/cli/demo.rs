//! `swarmbench demo`

use std::path::PathBuf;

use anyhow::Context;
use futures::future::try_join_all;
use serde_json::json;
use swarmbench_engine::TaskName;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

use super::output::{self, progress_bars};
use crate::server::{Parts, Server};
use crate::store::Location;
use crate::telemetry::{LogFormat, start_logs};
use swarmbench_client::client::Client;
use swarmbench_commands::play::{bar, play_one, player, request, scores};
use swarmbench_protocol::episode::{EpisodeRequest, EpisodeSummary};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The database. Default: a new file in the directory for temporary files.
    #[arg(long)]
    db: Option<Location>,
    /// The port on 127.0.0.1; 0 for any free port.
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// The seed of all five layouts.
    #[arg(long, default_value_t = 27)]
    seed: i64,
    /// Exit after showing the scores, instead of serving until Ctrl-C.
    #[arg(long)]
    exit: bool,
    /// Print the results as JSON: the address, the database, and the five games in the shape of the API.
    #[arg(long)]
    json: bool,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    if std::env::var_os("RUST_LOG").is_some() {
        start_logs(LogFormat::Text);
    }
    let db = match args.db {
        Some(db) => db,
        None => fresh_database()?.into(),
    };
    let server = Server::open(&db, Parts::default()).await?;
    let listener = TcpListener::bind(("127.0.0.1", args.port)).await.with_context(|| {
        format!(
            "cannot listen on port {}: name another with --port, or none for a free one",
            args.port
        )
    })?;
    let base = format!("http://{}", listener.local_addr()?);
    let (stop, stopped) = oneshot::channel::<()>();
    let serving = tokio::spawn(server.run(listener, async {
        // The server stops when the sender is dropped.
        drop(stopped.await);
    }));
    if !args.json {
        out!("A server runs at {base}. Five tasks are played over HTTP, side by side:\n");
    }
    let played = tokio::select! {
        played = play_all(&base, args.seed) => Some(played?),
        () = swarmbench_commands::stop::asked_to_stop() => None,
    };
    if let Some(played) = played {
        if args.json {
            let games: Vec<_> = played.iter().map(|(_, summary)| summary).collect();
            output::json(&json!({ "server": base, "database": db.to_string(), "games": games }))?;
        } else {
            out!("\n{}\n", scores(played.iter().map(|(player, summary)| (*player, summary))));
            out!("The database is {db}");
            out!("{}", how_to_join(&base));
            if !args.exit {
                out!("The server runs until Ctrl-C.");
            }
        }
        if !args.exit {
            swarmbench_commands::stop::asked_to_stop().await;
        }
    }
    drop(stop);
    serving.await??;
    Ok(())
}

async fn play_all(base: &str, seed: i64) -> anyhow::Result<Vec<(&'static str, EpisodeSummary)>> {
    let client = Client::new(base)?;
    let bars = progress_bars();
    let games = TaskName::ALL.map(|task| {
        let client = client.clone();
        let bars = bars.clone();
        async move {
            let player = player(None, task)?;
            let bar = bars.add(bar(task.name(), player.name));
            let request = EpisodeRequest { seed: Some(seed), ..request(task, player) };
            let (summary, _) = play_one(&client, &request, player, 1, &bar).await?;
            bar.finish();
            anyhow::Ok((player.name, summary))
        }
    });
    try_join_all(games).await
}

/// Path of a new database, in a directory of this process.
fn fresh_database() -> anyhow::Result<PathBuf> {
    let directory = std::env::temp_dir().join(format!("swarmbench-demo-{}", std::process::id()));
    std::fs::create_dir_all(&directory)
        .with_context(|| format!("cannot create {}", directory.display()))?;
    let db = directory.join("swarmbench.db");
    // An earlier process may have had the same id.
    for end in ["", "-wal", "-shm"] {
        let mut old = db.clone().into_os_string();
        old.push(end);
        if let Err(error) = std::fs::remove_file(&old)
            && error.kind() != std::io::ErrorKind::NotFound
        {
            return Err(error).with_context(|| format!("cannot remove {}", db.display()));
        }
    }
    Ok(db)
}

fn how_to_join(base: &str) -> String {
    format!(
        "\nJoin with curl (a game for one agent; look, then act, round by round):

  curl -s {base}/api/v1/episodes -H 'Content-Type: application/json' \\
       -d '{{\"task\": \"Foraging\", \"num_agents\": 1}}' > episode.json
  TOKEN=$(sed 's/.*\"token\":\"\\([^\"]*\\)\".*/\\1/' episode.json)
  curl -s {base}/obs -H \"Authorization: Bearer $TOKEN\"
  curl -s {base}/act -H \"Authorization: Bearer $TOKEN\" -H 'Content-Type: application/json' \\
       -d '{{\"round\": 0, \"action\": \"UP\"}}'

Watch these games in a browser, or take a seat: {base}
All routes: {base}/docs\n"
    )
}
