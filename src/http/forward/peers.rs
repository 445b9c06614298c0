//! Requests that servers of a cluster make of each other, for no client.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::to_bytes;
use axum::extract::Request;
use axum::http::Method;
use axum::response::{IntoResponse as _, Response};
use futures::FutureExt as _;
use futures::future::BoxFuture;
use serde::{Deserialize, Serialize};

use super::super::error::{ApiError, Code};
use super::super::prelude::*;
use super::links::{Failed, OF_A_SERVER, Question};
use super::{Forwarder, Other, Sending, Way, elsewhere, is_elsewhere};
use crate::cluster::route::{End, Route, Sender, Sent, Target, View as _, follow};
use crate::cluster::{Incarnation, ServerRow};
use crate::ids::{Place, RoutingName, RunKey};
use crate::run::manager::Peers;
use crate::run::{RunError, RunStatus};
use crate::store::StoreError;

/// Path prefix of requests between servers.
pub(in super::super) const PATH: &str = "/cluster/";

/// Longest answer of another server, in bytes.
const ANSWER_BYTES_MAX: usize = 64 * 1024;

/// Timeout of a request to end or advance a run.
const ASK_PATIENCE: Duration = Duration::from_secs(10);

/// Timeout of a request for a server's identity.
const HELLO_PATIENCE: Duration = Duration::from_secs(3);

/// Attempts of the other servers to reach this one, and the pause after each: a busy server is late with its answer.
const REACH_ATTEMPTS: u32 = 3;
const REACH_PAUSE: Duration = Duration::from_secs(1);

/// Servers that are asked for it in an attempt: one that is not reached takes seconds.
const REACH_ASKED_MAX: usize = 3;

fn question(method: Method, path: &str) -> Option<Question> {
    Some(Question::bare(method, path.parse().ok()?))
}

/// Identity of a server.
#[derive(Debug, Serialize, Deserialize)]
struct Hello {
    incarnation: Incarnation,
    /// Earlier servers have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    routing_name: Option<String>,
}

/// Forwards steps of runs to the servers that own them.
pub struct ForwardingPeers(pub Arc<Forwarder>);

impl Peers for ForwardingPeers {
    fn advance(&self, run: RunKey) -> BoxFuture<'_, Result<(), RunError>> {
        async move { self.0.ask_owner(run, "advance").await.map(drop) }.boxed()
    }

    fn end(&self, run: RunKey, status: RunStatus) -> BoxFuture<'_, Result<bool, RunError>> {
        async move { self.0.ask_owner(run, &format!("end/{}", status.name())).await }.boxed()
    }

    fn routing_name(&self, run: RunKey) -> BoxFuture<'_, Option<RoutingName>> {
        self.0.name_of_owner(Place::Run(run)).boxed()
    }
}

impl Forwarder {
    /// Asks the owner of a run, or the server that would take it, to advance or end it.
    async fn ask_owner(&self, run: RunKey, what: &str) -> Result<bool, RunError> {
        let place = Place::Run(run);
        let path = format!("{PATH}runs/{}/{what}", run.0);
        let Some(question) = question(Method::POST, &path) else { return Ok(false) };
        // Both steps have the effect of one if they are done twice.
        let sender = Sender::Client { is_repeatable: true, may_resend: true };
        let sending = Asking { question, done: false, is_refused: false };
        let mut way = Way { forwarder: self, sending };
        match follow(Route::new(Target::Place(place), sender), &mut way).await? {
            End::Answered => Ok(way.sending.done),
            // Everything of the run has ended.
            End::Here if !self.cluster.places().has(place) => Ok(false),
            End::Moved if way.sending.is_refused => Err(StoreError::Away.into()),
            // This server took the run meanwhile, and does the step when asked again; or no server has it.
            End::Here | End::Elsewhere | End::Moved | End::Unknown => {
                Err(StoreError::Elsewhere.into())
            }
        }
    }

    /// Name of the server that owns a place, or that will take it.
    async fn name_of_owner(&self, place: Place) -> Option<RoutingName> {
        let owner = self.cluster.keeper(place).filter(|keeper| *keeper != self.me());
        let Some(owner) = owner else { return self.routing_name() };
        if let Some(name) = self.routing_names.get(&owner) {
            return name;
        }
        let hello =
            self.hello(&self.other(owner)?).await.filter(|hello| hello.incarnation == owner)?;
        let name = hello.routing_name.as_deref().and_then(RoutingName::parse);
        self.routing_names.insert(owner, name);
        name
    }

    /// Asks another server, which may not be in the list of servers yet; `None` where it does not answer.
    async fn ask_at(&self, method: Method, path: &str, at: &Other) -> Option<Response> {
        let question = question(method, path)?;
        let gone = std::future::pending;
        self.links.send(&question, None, OF_A_SERVER, at, gone).await.ok()
    }

    /// Checks that the other servers reach this one at `address`. The error tells the operator what is wrong.
    pub async fn check_reachable(&self, address: &str) -> Result<(), String> {
        let me = self.cluster.incarnation();
        let own = Other { incarnation: me, address: address.to_owned() };
        let nobody = || {
            format!(
                "nothing answers at {address}, where the other servers are to reach this one: name an address of this machine with \
                 --cluster-address, and let no firewall be between the servers"
            )
        };
        let other = || {
            format!(
                "another program answers at {address}, where the other servers are to reach this one: name another with --cluster-address"
            )
        };
        if self.hello(&own).await.ok_or_else(nobody)?.incarnation != me {
            return Err(other());
        }
        let mut attempts = 1;
        while let Some(one) = self.not_reached_from(address).await {
            if attempts == REACH_ATTEMPTS {
                return Err(format!(
                    "{address}, where the other servers are to reach this one, is not reached from {one}: name an address that all of \
                     them reach with --cluster-address"
                ));
            }
            attempts += 1;
            tokio::time::sleep(REACH_PAUSE).await;
        }
        Ok(())
    }

    /// Address of the first other server that can tell, if it does not reach this one at `address`.
    async fn not_reached_from(&self, address: &str) -> Option<String> {
        let seen = self.cluster.snapshot().await.ok()?;
        let me = self.cluster.incarnation();
        let others = seen.servers.iter().filter(|row| row.incarnation != me && row.is_ready);
        for one in others.take(REACH_ASKED_MAX) {
            if let Some(is_reached) = self.is_reached_from(one, address).await {
                return (!is_reached).then(|| one.address.clone());
            }
        }
        None
    }

    /// Whether another server reaches this one at `address`; `None` where that one is not reached, which is no fault of the address.
    async fn is_reached_from(&self, one: &ServerRow, address: &str) -> Option<bool> {
        let at = Other { incarnation: one.incarnation, address: one.address.clone() };
        let path = format!("{PATH}reach/{}/{address}", self.cluster.incarnation());
        let asked =
            tokio::time::timeout(HELLO_PATIENCE * 2, self.ask_at(Method::POST, &path, &at)).await;
        match asked {
            // The row is that of a dead server, after which another one was started at its address.
            Ok(Some(response)) if is_elsewhere(&response) => None,
            Ok(Some(response)) => Some(response.status().is_success()),
            Ok(None) | Err(_) => {
                tracing::warn!(
                    server = one.address,
                    "another server cannot be reached from this one"
                );
                None
            }
        }
    }

    /// Identity of the server at an address; `None` where none answers.
    async fn hello(&self, at: &Other) -> Option<Hello> {
        let path = format!("{PATH}hello");
        let asked = tokio::time::timeout(HELLO_PATIENCE, self.ask_at(Method::GET, &path, at));
        let response = asked.await.ok()??;
        let body = to_bytes(response.into_body(), ANSWER_BYTES_MAX).await.ok()?;
        serde_json::from_slice(&body).ok()
    }

    /// Handles a request of another server.
    pub(in super::super) async fn answer(
        &self,
        app: &App,
        request: Request,
    ) -> Result<Response, ApiError> {
        let path = request.uri().path().strip_prefix(PATH).unwrap_or_default();
        let mut parts = path.split('/');
        match (request.method(), parts.next(), parts.next(), parts.next(), parts.next()) {
            (&Method::GET, Some("hello"), None, None, None) => {
                let routing_name = self.routing_name.map(|name| name.to_string());
                Ok(Json(Hello { incarnation: self.me(), routing_name }).into_response())
            }
            (&Method::POST, Some("reach"), Some(incarnation), Some(address), None) => {
                let incarnation = incarnation.parse().map_err(|_| unknown())?;
                let at = Other { incarnation, address: address.to_owned() };
                if self.hello(&at).await.is_some_and(|hello| hello.incarnation == incarnation) {
                    Ok(().into_response())
                } else {
                    Err(ApiError::new(Code::Unavailable, "this server does not reach the address"))
                }
            }
            (&Method::POST, Some("runs"), Some(run), Some(what), status) => {
                let run = RunKey(run.parse().map_err(|_| unknown())?);
                let done = match (what, status) {
                    ("advance", None) => app.runs.advance_here(run).await.map(|()| true),
                    ("end", Some(status)) => {
                        let status = RunStatus::parse(status).ok_or_else(unknown)?;
                        app.runs.end_here(run, status).await
                    }
                    _ => return Err(unknown()),
                };
                match done {
                    Ok(done) => Ok(done.to_string().into_response()),
                    Err(RunError::Store(StoreError::Elsewhere)) => Ok(elsewhere()),
                    Err(error) => Err(error.into()),
                }
            }
            _ => Err(unknown()),
        }
    }
}

/// A request of this server to advance or end a run.
struct Asking {
    question: Question,
    /// The answer.
    done: bool,
    /// The server could not do it.
    is_refused: bool,
}

impl Sending for Asking {
    type Error = StoreError;

    async fn send(&mut self, forwarder: &Forwarder, to: &Other) -> Result<Sent, StoreError> {
        let asked = forwarder.send(&self.question, None, OF_A_SERVER, to);
        let response = match tokio::time::timeout(ASK_PATIENCE, asked).await {
            Ok(Ok(response)) => response,
            Ok(Err(Failed::NotSent)) => return Ok(Sent::NotSent),
            Ok(Err(Failed::Unknown)) | Err(_) => return Ok(Sent::Unknown),
        };
        self.is_refused = !response.status().is_success() && !is_elsewhere(&response);
        if !response.status().is_success() {
            return Ok(Sent::Elsewhere);
        }
        let body = to_bytes(response.into_body(), ANSWER_BYTES_MAX).await;
        self.done = body.is_ok_and(|body| &body[..] == b"true");
        Ok(Sent::Answered)
    }
}

fn unknown() -> ApiError {
    ApiError::not_found("the route between servers")
}
