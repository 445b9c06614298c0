//! The minimal server of durable acts: an axum handler reads the body, a bare writer commits a row for each act
//! together with all that arrived meanwhile, and the answer is always the same receipts. It parses no act, checks no
//! token and plays no round.

use std::path::PathBuf;

use axum::Router;
use axum::http::{StatusCode, header};
use axum::routing::{MethodRouter, post};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use sqlx::migrate::Migrator;
use tokio::sync::{mpsc, oneshot};

use super::bare_commit::BareCommit;
use super::bare_handler::{read_body, serve_until_input_ends};
use super::games::SEATS;

/// Maximum number of requests in one commit, as in a server.
const GROUP_MAX: usize = 1024;

/// The settings of the process.
#[derive(Serialize, Deserialize)]
pub(crate) struct Setup {
    /// The folder of its database.
    pub(crate) dir: PathBuf,
    /// Episodes of 12 seats among which the acts are divided.
    pub(crate) episodes: usize,
    /// The record of every act.
    pub(crate) record: String,
}

/// The number of acts of a request, and a channel for the news of their commit.
type Request = (usize, oneshot::Sender<()>);

/// Reads a [`Setup`] from the standard input, prints its address, and serves until the input ends, as
/// [`serve`](super::bare_handler::serve) does.
pub(crate) async fn serve(metrics: fn() -> String, tables: &Migrator) -> std::io::Result<()> {
    let setup = read_body(&mut std::io::stdin().lock())?;
    let Setup { dir, episodes, record } = serde_json::from_slice(&setup)?;
    let bare = BareCommit::open(&dir, tables, episodes, record).await;
    let (queue, requests) = mpsc::unbounded_channel();
    let writer = tokio::spawn(write(bare.map_err(std::io::Error::other)?, requests));
    let receipts = format!("{{\"receipts\":[{}]}}", [RECEIPT; SEATS].join(","));
    let router = Router::new()
        .route("/act", route(queue.clone(), 1, RECEIPT.into()))
        .route("/swarm/act", route(queue, SEATS, receipts.into()));
    serve_until_input_ends(router, metrics).await?;
    writer.abort();
    // The error is the abort; the database is removed with the task.
    drop(writer.await);
    Ok(())
}

/// A receipt in the server's format.
const RECEIPT: &str = r#"{"episode":"ep_00000000000000000000000000000000","agent":"Agent_0","round":1000,"action":"SWITCH","message":"switch all lights on together in the next round","valid":true,"waiting_for":11,"duplicate":false}"#;

fn route(queue: mpsc::UnboundedSender<Request>, acts: usize, answer: Bytes) -> MethodRouter {
    post(move |_body: Bytes| {
        let (queue, answer) = (queue.clone(), answer.clone());
        async move {
            let (committed, kept) = oneshot::channel();
            drop(queue.send((acts, committed)));
            match kept.await {
                Ok(()) => Ok(([(header::CONTENT_TYPE, "application/json")], answer)),
                Err(_) => Err((StatusCode::INTERNAL_SERVER_ERROR, "the bare writer cannot commit")),
            }
        }
    })
}

/// Commits the acts of all waiting requests together, in a loop.
async fn write(mut bare: BareCommit, mut requests: mpsc::UnboundedReceiver<Request>) {
    let mut group = Vec::with_capacity(GROUP_MAX);
    while requests.recv_many(&mut group, GROUP_MAX).await > 0 {
        let acts = group.iter().map(|(acts, _)| acts).sum();
        if bare.commit_next(acts).await.is_err() {
            return;
        }
        for (_, committed) in group.drain(..) {
            // The client may be gone.
            let _ = committed.send(());
        }
    }
}
