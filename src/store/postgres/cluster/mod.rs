//! A cluster of servers on one database: joining, ownership of places, and changes that all servers must know.
//!
//! The database decides everything. A server is alive while its row in `members` is renewed, by the database's clock. The
//! places it owns are in `places`, where only free ones can be taken. Deleting a server's row in `nodes` deletes both, and
//! makes its commits fail. So no decision about who is alive has to be right: a server excluded by mistake commits nothing
//! more, and answers nothing once its last beat is older than [`ANSWERS_FOR`](crate::cluster::ANSWERS_FOR).

mod changes;
mod places;
mod servers;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use tokio::sync::watch;

use super::group::session_name;
use super::session::{self, Server};
use crate::cluster::{Incarnation, Lease, Places, ServerRow};
use crate::store::StoreError;
use crate::store::sql::{Connection, query};
use changes::ChangesRead;
pub(in crate::store) use changes::write;
pub(in crate::store) use servers::check;
pub use servers::{Beat, ClusterSnapshot, JoinError, Joining};

/// Timeout of a statement on the cluster's two connections. The writer has timeouts of its own.
const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

/// This server in its cluster. All methods may fail with [`StoreError::Failed`] once it was excluded.
pub struct Cluster {
    server: Server,
    incarnation: Incarnation,
    slot: i16,
    started: Instant,
    /// A connection that waits for no disk, and for no commit of this server.
    beats: tokio::sync::Mutex<Option<Connection>>,
    /// A connection whose commits are durable.
    takes: tokio::sync::Mutex<Option<Connection>>,
    places: Places,
    /// All servers as last seen.
    servers: Mutex<Arc<[ServerRow]>>,
    /// Numbers of all servers; subscribers learn when one comes or goes.
    incarnations: watch::Sender<Vec<i64>>,
    /// Whether this server takes free places.
    takes_places: AtomicBool,
    lease: Lease,
    /// Applied revision of tokens and keys.
    seen: AtomicU64,
    changes: tokio::sync::Mutex<ChangesRead>,
    /// Number of reads of changes that have begun.
    reads: AtomicU64,
}

impl std::fmt::Debug for Cluster {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cluster").field("incarnation", &self.incarnation).finish_non_exhaustive()
    }
}

impl Cluster {
    /// The number of this server, unique for all time.
    pub const fn incarnation(&self) -> Incarnation {
        self.incarnation
    }

    /// A small number, unique among the current servers.
    pub const fn slot(&self) -> i16 {
        self.slot
    }

    /// Whether this server takes free places: the others can reach it, and it is not stopping.
    pub fn takes_places(&self) -> bool {
        self.takes_places.load(Ordering::Acquire)
    }

    /// The places of this server.
    pub const fn places(&self) -> &Places {
        &self.places
    }

    /// Time left in which this server may answer for its places.
    pub fn answers_for(&self) -> Duration {
        self.lease.left(self.started.elapsed())
    }

    /// Runs `work` on one of the two connections, which is made if there is none and dropped after an error.
    async fn on<T>(
        &self,
        link: &tokio::sync::Mutex<Option<Connection>>,
        purpose: Purpose,
        work: impl AsyncFnOnce(&mut Connection) -> Result<T, sqlx::Error>,
    ) -> Result<T, StoreError> {
        let done = tokio::time::timeout(ANSWER_PATIENCE, async {
            let mut link = link.lock().await;
            let mut connection = match link.take() {
                Some(connection) => connection,
                None => self.connect(purpose).await?,
            };
            let done = work(&mut connection).await;
            // An error reported by PostgreSQL leaves the connection usable, unless the server is stopping or became a
            // standby.
            let may_be_used = |error: &sqlx::Error| {
                session::sqlstate(error).is_some_and(|code| !is_passing(&code))
            };
            if done.as_ref().err().is_none_or(may_be_used) {
                *link = Some(connection);
            }
            done
        })
        .await;
        match done {
            Ok(Err(error)) if session::sqlstate(&error).as_deref() == Some(FOREIGN_KEY) => {
                // A foreign key fails once this server's row in `nodes` is gone.
                Err(StoreError::Failed)
            }
            Ok(Err(error)) if session::sqlstate(&error).is_some_and(|code| is_passing(&code)) => {
                Err(StoreError::Away)
            }
            Ok(done) => Ok(done?),
            Err(_) => Err(StoreError::Away),
        }
    }

    async fn connect(&self, purpose: Purpose) -> Result<Connection, sqlx::Error> {
        let mut connection = Connection::Postgres(self.server.try_connect().await?);
        let name = format!("{}/{}", session_name(self.incarnation), purpose.name());
        session::set_name(&mut connection, &name).await?;
        for setting in ["SET default_transaction_read_only = off", "SET statement_timeout = '5s'"] {
            query(setting).execute(&mut connection).await?;
        }
        match purpose {
            // A beat may be lost in a crash of the database, so its commit need not wait for the disk.
            Purpose::Beats => {
                query("SET synchronous_commit = off").execute(&mut connection).await?;
                servers::show_connected(&mut connection, self.incarnation).await?;
            }
            Purpose::Takes => {
                query(
                    "SELECT set_config('synchronous_commit', CASE current_setting('synchronous_commit')
                         WHEN 'remote_apply' THEN 'remote_apply' ELSE 'on' END, false)",
                )
                .execute(&mut connection)
                .await?;
            }
        }
        Ok(connection)
    }

    /// Closes the sessions of this server, after its row was deleted.
    pub(in crate::store) async fn close(&self) {
        for link in [&self.beats, &self.takes] {
            if let Some(connection) = link.lock().await.take() {
                // Errors do not matter: the process ends.
                drop(connection.close().await);
            }
        }
    }
}

#[derive(Clone, Copy)]
enum Purpose {
    Beats,
    Takes,
}

impl Purpose {
    const fn name(self) -> &'static str {
        match self {
            Self::Beats => "beats",
            Self::Takes => "takes",
        }
    }
}

/// SQLSTATE of a reference to a missing row.
const FOREIGN_KEY: &str = "23503";

/// Whether an error is temporary: PostgreSQL is starting or stopping, lacks resources, or became a standby.
fn is_passing(code: &str) -> bool {
    matches!(&code[..2], "08" | "25" | "40" | "53" | "55" | "57" | "58")
}

/// Class of the advisory locks that prove a server's session.
const ALIVE: i32 = 0x5377_6172;

fn alive_key(incarnation: i64) -> i64 {
    incarnation & 0x7fff_ffff
}
