//! Resources that all actors of a server share.

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

/// Spawns a detached task.
pub type Spawn = Arc<dyn Fn(BoxFuture<'static, ()>) + Send + Sync>;

#[derive(Clone)]
pub struct Host {
    pub journal: Arc<dyn EpisodeStore>,
    pub clock: Arc<dyn Clock>,
    pub spawn: Spawn,
    pub quotas: Arc<Quotas>,
    /// Memory that worlds and answers share.
    pub budget: Arc<Budget>,
    /// Threads for heavy work.
    pub workers: Workers,
    /// Replays of earlier rounds, shared and cached.
    pub replays: Arc<Replays>,
    /// Receives the run of every episode that has ended, durably.
    pub ended: mpsc::UnboundedSender<RunKey>,
    /// Receives every episode whose actor starts, where the server may play seats.
    pub hosted: mpsc::UnboundedSender<Handle>,
}

impl Host {
    /// Party for which an episode's work is done: the entrant of a competition, or else the key that created the episode.
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
