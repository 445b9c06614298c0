//! HTTP: the only module of the server that names axum. Handlers hold no SQL and no rules of the game.

mod accept;
mod admit;
mod agent;
mod answer;
mod app;
mod audit;
mod auth;
mod boards;
mod body;
mod cache;
mod checks;
mod claims;
mod client;
mod clock;
mod competitions;
mod description;
mod docs;
mod episodes;
pub mod error;
mod eviction;
mod exports;
mod extract;
mod feed;
mod forward;
mod front;
mod heavy;
mod host;
mod idempotency;
mod imports;
mod in_flight;
mod keys;
pub mod limits;
mod mcp;
mod observation_cache;
pub mod openapi;
mod page;
mod pages;
mod ranking;
mod rates;
mod replay_pages;
mod revoked;
mod router;
mod routes;
mod runs;
mod seeds;
pub mod serve;
mod servers;
mod stream;
mod swarm;
mod timers;
mod tokens;
mod waiting;

pub use agent::act::submission;
pub use app::{Access, App, Foundation};
pub use extract::read;
pub use forward::{Forwarder, ForwardingPeers};
pub use front::Front;
pub use pages::Source;

/// Names that most handlers import.
mod prelude {
    pub(super) use axum::extract::State;
    pub(super) use axum::response::Response;

    pub(super) use super::App;
    pub(super) use super::auth::{Caller, Organizer, Overseer};
    pub(super) use super::checks::Problems;
    pub(super) use super::error::{ApiError, Code};
    pub(super) use super::extract::{Id, Json, Nothing, OptionalJson, Params, Unread};
    pub(super) use crate::telemetry::detached;
}
