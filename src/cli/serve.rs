//! `swarmbench serve`

use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::{Context, bail};
use tokio::net::TcpListener;

use crate::server::{Parts, Server, fit_open_files};
use crate::telemetry::{LogFormat, start_logs};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Where to listen.
    #[arg(long, env = "SWARMBENCH_ADDR", default_value = "127.0.0.1:8080")]
    addr: SocketAddr,
    /// The database; created where there is none. One server owns it at a time.
    #[arg(long, env = "SWARMBENCH_DB", default_value = "swarmbench.db")]
    db: PathBuf,
    /// Listen on an address that others can reach, though anyone who reaches it may create, watch
    /// and abort episodes.
    #[arg(long, env = "SWARMBENCH_OPEN", value_parser = clap::builder::FalseyValueParser::new())]
    open: bool,
    /// How logs are written; `RUST_LOG` says which.
    #[arg(long, env = "SWARMBENCH_LOG_FORMAT", default_value = "text")]
    log_format: LogFormat,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    start_logs(args.log_format);
    if !args.addr.ip().is_loopback() && !args.open {
        bail!(
            "{} can be reached from other machines, and this server asks nobody who they are; \
             listen on 127.0.0.1, or add --open if everyone who can reach it may use it",
            args.addr
        );
    }
    let parts = Parts::default();
    let parts = Parts { limits: fit_open_files(parts.limits), ..parts };
    let server = Server::open(&args.db, parts).await?;
    let listener = TcpListener::bind(args.addr)
        .await
        .with_context(|| format!("cannot listen on {}; is another server there?", args.addr))?;
    let addr = listener.local_addr()?;
    tracing::info!(%addr, db = %args.db.display(), "serving; documentation at http://{addr}/docs");
    server.run(listener, super::asked_to_stop()).await?;
    tracing::info!("stopped");
    Ok(())
}
