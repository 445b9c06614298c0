//! Several servers on one database: who is alive, who plays what, and what all have to know.
//!
//! The database decides everything. A server is alive as long as its row in `members` is renewed, by the database's clock; what
//! it plays is in `places`, where only what nobody has can be taken; and both go when its row in `nodes` is deleted, which also
//! ends all that it writes. So nothing here has to be right about who is alive: a server that is excluded by mistake writes nothing
//! any more, and answers nothing once it has not been seen for [`ANSWERS_FOR`].

mod changes;
mod members;
mod places;

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use tokio::sync::watch;

use super::group::session_name;
use super::session::{self, Server};
use crate::ids::Place;
use crate::store::StoreError;
use crate::store::sql::{Connection, query};
use changes::ChangesRead;
pub(in crate::store) use changes::write;
pub(in crate::store) use members::check;
pub use members::{Beat, Death, JoinError, Joining, Look, Member};
use places::State;
pub use places::Unowned;

/// A member that was not seen for so long is taken over.
pub const TAKEN_OVER_AFTER: Duration = Duration::from_secs(6);

/// A beat that comes no sooner is late: one a second is usual.
const LATE_AFTER: Duration = Duration::from_millis(1500);

/// How long after its last beat a member answers. Less than [`TAKEN_OVER_AFTER`], so that it never answers for what another has.
pub const ANSWERS_FOR: Duration = Duration::from_millis(4500);

/// How long an answer of the database is waited for where it is not about what was played.
const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

/// How far the clock of a member may be from that of the database.
pub const CLOCK_OFF_MAX: Duration = Duration::from_millis(500);

/// This server as one of several. All methods may fail with [`StoreError::Failed`] once it was excluded.
pub struct Cluster {
    server: Server,
    incarnation: i64,
    slot: i16,
    started: Instant,
    /// A connection that waits for no disk, and for no commit of this server.
    beats: tokio::sync::Mutex<Option<Connection>>,
    /// A connection whose commits are durable.
    takes: tokio::sync::Mutex<Option<Connection>>,
    places: Mutex<HashMap<Place, State>>,
    /// What may have been taken and is not continued yet: the client that asked for it may be gone.
    taken: Mutex<HashSet<Place>>,
    /// All members, as they were seen last.
    members: Mutex<Arc<[Member]>>,
    /// Their numbers; changes when one comes or goes.
    incarnations: watch::Sender<Vec<i64>>,
    /// Whether this server takes what nobody has.
    takes_work: AtomicBool,
    /// Until when this server answers, in milliseconds after `started`.
    answers_until: AtomicU64,
    /// By which revision this server acts.
    seen: AtomicU64,
    changes: tokio::sync::Mutex<ChangesRead>,
    /// How many reads of changes have begun.
    reads: AtomicU64,
}

impl std::fmt::Debug for Cluster {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cluster").field("incarnation", &self.incarnation).finish_non_exhaustive()
    }
}

impl Cluster {
    /// The number of this server, which no other ever gets.
    pub const fn incarnation(&self) -> i64 {
        self.incarnation
    }

    /// A small number that no other member has at this time.
    pub const fn slot(&self) -> i16 {
        self.slot
    }

    /// Whether this server was seen lately enough to answer for what it has.
    pub fn may_answer(&self) -> bool {
        let now = u64::try_from(self.started.elapsed().as_millis()).unwrap_or(u64::MAX);
        now < self.answers_until.load(Ordering::Acquire)
    }

    /// Whether this server takes what nobody has: it is reached by the others, and does not stop.
    pub fn takes_work(&self) -> bool {
        self.takes_work.load(Ordering::Acquire)
    }

    /// For how long this server may answer still.
    pub fn answers_for(&self) -> Duration {
        let until = Duration::from_millis(self.answers_until.load(Ordering::Acquire));
        until.saturating_sub(self.started.elapsed())
    }

    fn answers_from(&self, sent: Instant) {
        let until = sent.duration_since(self.started) + ANSWERS_FOR;
        self.answers_until
            .store(u64::try_from(until.as_millis()).unwrap_or(u64::MAX), Ordering::Release);
    }

    fn places(&self) -> MutexGuard<'_, HashMap<Place, State>> {
        self.places.lock().expect("nothing panics while it holds this")
    }

    fn taken(&self) -> MutexGuard<'_, HashSet<Place>> {
        self.taken.lock().expect("nothing panics while it holds this")
    }

    /// Does something on one of the two connections, which is made where there is none. It is given up where that fails.
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
            // An error that PostgreSQL answered leaves a connection that can be used, unless it ends or is a standby now.
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
                // The row of this server in `nodes` is gone.
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
            // A beat that a crash of the database has lost was none.
            Purpose::Beats => {
                query("SET synchronous_commit = off").execute(&mut connection).await?;
                members::show_connected(&mut connection, self.incarnation).await?;
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

    /// Ends the sessions of this server, after its row was deleted.
    pub(in crate::store) async fn close(&self) {
        for link in [&self.beats, &self.takes] {
            if let Some(connection) = link.lock().await.take() {
                // The process ends anyway.
                drop(connection.close().await);
            }
        }
    }
}

/// What a connection is for.
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

/// The code of an error where a row refers to one that is gone.
const FOREIGN_KEY: &str = "23503";

/// Whether an error of this code passes: PostgreSQL ends or starts, is out of something, or became a standby.
fn is_passing(code: &str) -> bool {
    matches!(&code[..2], "08" | "25" | "40" | "53" | "55" | "57" | "58")
}

/// The class of advisory locks by which members show that their process lives.
const ALIVE: i32 = 0x5377_6172;

fn alive_key(incarnation: i64) -> i64 {
    incarnation & 0x7fff_ffff
}
