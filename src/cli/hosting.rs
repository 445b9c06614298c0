//! Server of an evaluation: a temporary one, or one that is already running.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use futures::future::{BoxFuture, LocalBoxFuture};
use swarmbench_commands::eval;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::server::{Parts, Server, StartError};
use crate::store::{Location, OpenError};
use crate::telemetry::{LogFormat, start_logs_of};
use swarmbench_client::client::Client;

/// Default database.
const DATABASE: &str = "swarmbench.db";

#[derive(Debug, clap::Args)]
pub(super) struct Hosting {
    #[arg(
        long,
        value_name = "URL",
        conflicts_with = "db",
        help = "The address of a server to play on [env: SWARMBENCH_SERVER]"
    )]
    server: Option<String>,
    /// Your key, if the server requires one.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// The database of a temporary server, which the command starts unless --server names one. The database is created if it
    /// does not exist (swarmbench.db).
    #[arg(long, value_name = "DATABASE")]
    db: Option<Location>,
    /// The number of games that are open at a time (4).
    #[arg(long, value_name = "GAMES", value_parser = clap::value_parser!(u32).range(1..=64))]
    parallel: Option<u32>,
}

impl Hosting {
    /// Address of a running server; none if this command starts its own.
    fn joined(&self) -> Option<String> {
        let environment = || std::env::var("SWARMBENCH_SERVER").ok().filter(|url| !url.is_empty());
        if self.db.is_some() { None } else { self.server.clone().or_else(environment) }
    }

    fn database(&self) -> Location {
        self.db.clone().unwrap_or_else(|| Location::from(Path::new(DATABASE)))
    }
}

impl eval::Hosting for Hosting {
    fn parallel(&self) -> Option<u32> {
        self.parallel
    }

    fn place(&self) -> String {
        match self.joined() {
            Some(server) => format!("--server {server}"),
            None => format!("--db {}", self.database()),
        }
    }

    fn check_attempt(&self) -> anyhow::Result<()> {
        ensure!(
            self.db.is_none(),
            "an attempt is played on the server of its competition: leave out --db"
        );
        ensure!(
            self.joined().is_some(),
            "an attempt is played on the server of its competition: name that with --server or SWARMBENCH_SERVER"
        );
        ensure!(
            self.key.is_some(),
            "an attempt needs the key of its entrant: show it with --key or SWARMBENCH_KEY"
        );
        Ok(())
    }

    fn open<'h>(
        &'h self,
        stop: &'h CancellationToken,
    ) -> LocalBoxFuture<'h, anyhow::Result<eval::Opened>> {
        Box::pin(async move {
            let (base, hosted) = if let Some(server) = self.joined() {
                (server, None)
            } else {
                let hosted = Hosted::open(self.database(), stop.clone()).await?;
                (hosted.base.clone(), Some(hosted))
            };
            let client = Client::new(&base)?;
            let client = match self.key.clone() {
                Some(key) => client.with_key(key),
                None => client,
            };
            // Requests during games are retried while the server is unavailable; this one is not.
            client.health().await?;
            if let (Some(hosted), None) = (&hosted, &self.key)
                && hosted.has_keys
            {
                bail!(
                    "{} has keys, so its games belong to somebody: show yours with --key or SWARMBENCH_KEY",
                    self.database()
                );
            }
            Ok((client, hosted.map(|hosted| Box::new(hosted) as Box<dyn eval::Hosted>)))
        })
    }
}

/// The server that this command runs.
struct Hosted {
    base: String,
    has_keys: bool,
    failed: CancellationToken,
    stop: oneshot::Sender<()>,
    serving: JoinHandle<Result<(), StartError>>,
}

impl Hosted {
    async fn open(db: Location, stop_playing: CancellationToken) -> anyhow::Result<Self> {
        // Nobody else reads this server's log, and a full disk is reported nowhere else.
        start_logs_of(LogFormat::Text, "swarmbench::store=error");
        let server = match Server::open(&db, Parts::default()).await {
            Err(error @ StartError::Open(OpenError::InUse(_))) => {
                return Err(error).context(
                    "an evaluation with --db has a server of its own; if a server runs on this database, join it \
                     with --server URL",
                );
            }
            opened => opened?,
        };
        let has_keys = server.has_keys();
        let failed = server.failed();
        let listener = TcpListener::bind(("127.0.0.1", 0)).await.context("no port is free")?;
        let base = format!("http://{}", listener.local_addr()?);
        // Retries would be in vain, as the failed server ends with this command.
        let failing = failed.clone().cancelled_owned();
        tokio::spawn(async move {
            failing.await;
            stop_playing.cancel();
        });
        let (stop, stopped) = oneshot::channel::<()>();
        let serving = tokio::spawn(server.run(listener, async {
            // `close` drops the sender.
            drop(stopped.await);
        }));
        note!("{} is served at {base} meanwhile: watch the games there", db);
        Ok(Self { base, has_keys, failed, stop, serving })
    }
}

impl eval::Hosted for Hosted {
    fn close(self: Box<Self>) -> BoxFuture<'static, anyhow::Result<()>> {
        Box::pin(async move {
            drop(self.stop);
            self.serving.await??;
            if self.failed.is_cancelled() {
                bail!("a commit failed, so nothing more could be stored");
            }
            Ok(())
        })
    }
}
