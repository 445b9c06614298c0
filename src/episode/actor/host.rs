//! What all actors of a server share.

use std::sync::Arc;

use futures::future::BoxFuture;
use tokio::sync::mpsc;

use super::super::quota::Quotas;
use super::super::replays::Replays;
use super::handle::Handle;
use crate::budget::Budget;
use crate::fair::{Group, Party};
use crate::ids::RunKey;
use crate::keys::OwnerKey;
use crate::store::StoreError;
use crate::store::port::EpisodeStore;
use crate::work::Workers;
use swarmbench_clock::Clock;

/// Starts a task that runs on its own.
pub type Spawn = Arc<dyn Fn(BoxFuture<'static, ()>) + Send + Sync>;

/// What all actors of a server share.
#[derive(Clone)]
pub struct Host {
    /// Where entries are stored.
    pub journal: Arc<dyn EpisodeStore>,
    /// Where the time comes from.
    pub clock: Arc<dyn Clock>,
    /// What runs the actors.
    pub spawn: Spawn,
    /// Per-owner quotas.
    pub quotas: Arc<Quotas>,
    /// The memory that worlds and answers may take together.
    pub budget: Arc<Budget>,
    /// What does heavy work.
    pub workers: Workers,
    /// Replays of earlier rounds, shared and cached.
    pub replays: Arc<Replays>,
    /// Notified of every run of which an episode has ended, durably.
    pub ended: mpsc::UnboundedSender<RunKey>,
    /// Notified of every recovered episode of which the server may play seats.
    pub hosted: mpsc::UnboundedSender<Handle>,
}

impl Host {
    /// For whom the work of an episode is done: for the entrant of a competition, else for the holder of the
    /// key with which it was created.
    pub(in super::super) async fn party(
        &self,
        owner: Option<OwnerKey>,
        run: Option<RunKey>,
    ) -> Result<Party, StoreError> {
        if let Some(run) = run
            && let Some((competition, owner)) = self.journal.entrant(run).await?
        {
            return Ok(Party::entrant(competition, owner));
        }
        Ok(owner.map_or(Party::SERVER, |owner| Party::of(Group::Owner(owner))))
    }
}
