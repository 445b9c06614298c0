//! The minimum that a server does for durable acts: a handler of axum reads the body, a bare writer commits a row for each act
//! together with all that came meanwhile, and then the same receipts are sent every time. No act is parsed, no token is
//! looked at, no round is played.

use axum::Router;
use axum::http::{StatusCode, header};
use axum::routing::{MethodRouter, post};
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use tokio::sync::{mpsc, oneshot};

use super::bare_commit::{BareCommit, Place, Tables};
use super::bare_handler::{read_body, serve_until_input_ends};
use super::games::SEATS;

/// Requests whose acts are committed together at most, as in a server.
const GROUP_MAX: usize = 1024;

/// What the process gets.
#[derive(Serialize, Deserialize)]
pub struct Setup {
    /// Where its database is made.
    pub place: Place,
    /// Episodes of 12 seats among which the acts are divided.
    pub episodes: usize,
    /// The record of every act.
    pub record: String,
}

/// Acts of a request, and whom to tell that they are committed.
type Request = (usize, oneshot::Sender<()>);

/// Reads a [`Setup`] from the standard input, prints its address, and serves until the input ends, as
/// [`serve`](super::bare_handler::serve) does.
///
/// # Errors
/// Where it cannot listen, the database cannot be made, or the input is not a [`Setup`].
pub async fn serve(metrics: fn() -> String, tables: Tables<'_>) -> std::io::Result<()> {
    let setup = read_body(&mut std::io::stdin().lock())?;
    let Setup { place, episodes, record } = serde_json::from_slice(&setup)?;
    let bare = BareCommit::open(&place, tables, episodes, record).await;
    let (queue, requests) = mpsc::unbounded_channel();
    let writer = tokio::spawn(write(bare.map_err(std::io::Error::other)?, requests));
    let receipts = format!("{{\"receipts\":[{}]}}", [RECEIPT; SEATS].join(","));
    let router = Router::new()
        .route("/act", route(queue.clone(), 1, RECEIPT.into()))
        .route("/swarm/act", route(queue, SEATS, receipts.into()));
    serve_until_input_ends(router, metrics).await?;
    writer.abort();
    // An error is that it was aborted; its database goes with it.
    drop(writer.await);
    Ok(())
}

/// A receipt as a server writes it.
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

/// Commits the acts of all requests that wait, again and again.
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
