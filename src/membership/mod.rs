//! A server's part in a cluster: it shows that it is alive, watches the other servers, takes over places of dead servers and
//! places without an owner, and releases idle places that other servers are preferred for.
//!
//! [`watch`](crate::cluster::watch) decides what is due, the database whether it may be done. This module does it with any
//! [`Port`]: that of a server ([`Membership`]), or that of the simulation.

mod duties;
mod server;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use crate::cluster::watch::{ClockSeen, Duty, LOOKS_EVERY, Looks, Seen, Suspicion, Work};
use crate::cluster::{Death, Incarnation, Places, ServerRow};
use crate::ids::Place;
use crate::store::StoreError;
pub use server::{Membership, Parts, host_ms};

/// The other servers, and the exclusion of those that are dead.
pub trait Others: Send + Sync {
    /// The servers as last seen, oldest first.
    fn servers(&self) -> Arc<[ServerRow]>;
    fn set_servers(&self, servers: Arc<[ServerRow]>);
    /// Whether the process of a server is gone.
    fn is_dead(&self, row: &ServerRow) -> impl Future<Output = bool> + Send;
    /// Excludes a server: it can commit nothing more, and its places are free. False if it is alive after all.
    fn exclude(
        &self,
        server: Incarnation,
        death: Death,
    ) -> impl Future<Output = Result<bool, StoreError>> + Send;
}

/// Database, clock and games of one server of a cluster.
pub trait Port: 'static {
    type Others: Others;
    /// Runs with which this server does nothing meanwhile.
    type Held<'a>: Send
    where
        Self: 'a;

    fn others(&self) -> &Self::Others;
    fn places(&self) -> &Places;
    fn me(&self) -> Incarnation;
    /// Whether this server takes no places, and lets the others answer.
    fn forwards_only(&self) -> bool;

    /// Time since any moment, of a clock that also runs while the process is stopped.
    fn now(&self) -> Duration;
    fn sleep(&self, pause: Duration) -> impl Future<Output = ()> + Send;

    /// Shows that this server is alive, which renews its lease. [`StoreError::Failed`] means that it was excluded.
    fn beat(&self) -> impl Future<Output = Result<(), StoreError>> + Send;
    /// Reads all servers, and applies what all of them must know. [`StoreError::Failed`] means that this one was excluded.
    fn look(&self) -> impl Future<Output = Result<Vec<ServerRow>, StoreError>> + Send;
    /// Unfinished games and runs without an owner.
    fn unowned(&self) -> impl Future<Output = Result<Vec<Place>, StoreError>> + Send;
    /// Takes the free ones among some places, which the caller resumes; returns the owner of each, in any order.
    fn take(
        &self,
        places: &[Place],
    ) -> impl Future<Output = Result<Vec<(Place, Incarnation)>, StoreError>> + Send;
    /// Releases places that this server has left, once nothing is written there any more.
    fn release(&self, places: &[Place]) -> impl Future<Output = Result<(), StoreError>> + Send;
    /// Releases all places where everything has ended.
    fn release_ended(&self) -> impl Future<Output = Result<(), StoreError>> + Send;
    fn delete_old_changes(&self) -> impl Future<Output = Result<(), StoreError>> + Send;

    /// Continues all unfinished games and runs at owned places.
    fn resume(&self, places: &[Place]) -> impl Future<Output = Result<(), StoreError>> + Send;
    /// The places among some where nothing goes on. Nothing begins in their runs while the second value lives.
    fn idle(&self, places: Vec<Place>) -> (Vec<Place>, Self::Held<'_>);
    /// Evicts the games at places that are still idle; returns these places.
    fn evict(
        &self,
        places: &[Place],
    ) -> impl Future<Output = Result<BTreeSet<Place>, StoreError>> + Send;

    /// This server was excluded.
    fn excluded(&self);
    /// Called, perhaps repeatedly, when the server is ready: places without an owner are taken, or other servers take places.
    fn ready(&self);
    fn clock_seen(&self, clock: ClockSeen);
    /// Shows the state of this server in the metrics.
    fn measure(&self);
}

/// Runs until this server is excluded.
pub async fn run<P: Port + Send + Sync>(port: Arc<P>) {
    let (look, seen) = watch::channel(Seen::default());
    tokio::select! {
        () = beat(Arc::clone(&port), look) => {}
        () = work(port, seen) => {}
    }
}

/// Beats, and looks at the other servers, until this server is excluded.
pub async fn beat<P: Port + Send + Sync>(port: Arc<P>, look: watch::Sender<Seen>) {
    let mut looks = Looks::default();
    loop {
        let looked = async {
            if looks.beats() {
                port.beat().await?;
            }
            port.look().await
        };
        match looked.await {
            Ok(servers) => {
                let servers: Arc<[ServerRow]> = servers.into();
                port.others().set_servers(Arc::clone(&servers));
                let now = port.now();
                port.clock_seen(looks.clock(&servers, port.me(), now));
                look.send_replace(looks.answered(servers, now));
            }
            Err(StoreError::Failed) => return port.excluded(),
            Err(error) => {
                if looks.failed() {
                    tracing::warn!(%error, "the database does not answer: this server cannot renew its lease");
                }
                look.send_modify(|seen| seen.up_since = None);
            }
        }
        port.measure();
        port.sleep(LOOKS_EVERY).await;
    }
}

/// Does after each look what is due.
pub async fn work<P: Port + Send + Sync>(port: Arc<P>, mut looks: watch::Receiver<Seen>) {
    let mut work = Work::new(port.me(), port.forwards_only(), port.now());
    while looks.changed().await.is_ok() {
        let seen = looks.borrow_and_update().clone();
        if seen.up_since.is_none() {
            continue;
        }
        let due = work.due(&seen, port.now());
        for (server, suspicion) in due.suspects {
            let death = match suspicion {
                Suspicion::Expired => exclude(port.others(), server, Death::Expired).await,
                Suspicion::Away => exclude_if_dead(port.others(), server).await,
            };
            warn_of(death, "the work of a server that may be dead cannot be taken over");
        }
        let resumed = duties::resume_taken(&*port).await;
        warn_of(resumed, "work that this server has taken over cannot be continued");
        for duty in due.duties {
            match duty {
                Duty::BeReady => port.ready(),
                Duty::Adopt => match duties::adopt(&*port).await {
                    Ok(()) if work.adopted(&seen, port.now()) => port.ready(),
                    adopted => warn_of(adopted, "work that no server does cannot be taken over"),
                },
                Duty::Tidy => {
                    let tidied = duties::tidy(&*port).await;
                    warn_of(tidied, "idle games and runs cannot be released");
                }
                Duty::DeleteOldChanges => {
                    warn_of(port.delete_old_changes().await, "old changes cannot be deleted");
                }
            }
        }
    }
}

fn warn_of(done: Result<(), StoreError>, what: &str) {
    if let Err(error) = done {
        tracing::warn!(%error, "{what}");
    }
}

/// Excludes a server if its process is gone, which frees its places at once.
///
/// # Errors
///
/// Errors of the database.
pub async fn exclude_if_dead(others: &impl Others, server: Incarnation) -> Result<(), StoreError> {
    let servers = others.servers();
    let Some(row) = servers.iter().find(|row| row.incarnation == server) else {
        return Ok(());
    };
    if others.is_dead(row).await { exclude(others, server, Death::Seen).await } else { Ok(()) }
}

async fn exclude(
    others: &impl Others,
    server: Incarnation,
    death: Death,
) -> Result<(), StoreError> {
    if others.exclude(server, death).await? {
        tracing::warn!(server, ?death, "a server is dead: the others take its work over");
        metrics::counter!("swarmbench_takeovers_total").increment(1);
    }
    let left = others.servers();
    let left = left.iter().filter(|row| row.incarnation != server).cloned();
    others.set_servers(left.collect());
    Ok(())
}
