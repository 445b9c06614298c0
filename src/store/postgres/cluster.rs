//! Several servers on one database: who is alive, who plays what, and what all have to know.
//!
//! The database decides everything. A server is alive as long as its row in `members` is renewed, by the database's clock; what
//! it plays is in `places`, where only what nobody has can be taken; and both go when its row in `nodes` is deleted, which also
//! ends all that it writes. So nothing here has to be right about who is alive: whoever is excluded by mistake writes nothing
//! any more, and answers nothing once it has not been seen for [`ANSWERS_FOR`].

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use sha2::{Digest as _, Sha256};
use sqlx::postgres::PgArguments;
use sqlx::{Arguments as _, Row as _};
use tokio::sync::watch;

use super::group::session_name;
use super::session::{self, Server};
use crate::ids::{EpisodeKey, Place, RunKey};
use crate::store::entries::Entry;
use crate::store::results::Effect;
use crate::store::sql::{Begin, Connection, Engine, query};
use crate::store::{OpenError, StoreError};

/// A member that was not seen for so long is taken over.
pub const TAKEN_OVER_AFTER: Duration = Duration::from_secs(6);

/// How long a new member has for its first beat, until which it opens the database and has nothing that others could take over.
const STARTS_WITHIN: Duration = Duration::from_mins(1);

/// How long after its last beat a member answers. Less than [`TAKEN_OVER_AFTER`], so that it never answers for what another has.
pub const ANSWERS_FOR: Duration = Duration::from_millis(4500);

/// How long an answer of the database is waited for where it is not about what was played.
const ANSWER_PATIENCE: Duration = Duration::from_secs(2);

/// How far the clock of a member may be from that of the database.
pub const CLOCK_OFF_MAX: Duration = Duration::from_millis(500);

/// Members at the same time: each has a slot.
const MEMBERS_MAX: i16 = 1024;

/// Old changes are kept for so long; a member that has not read them meanwhile reads everything again.
const CHANGES_KEPT: Duration = Duration::from_mins(30);

/// How long it waits before it asks a database again that did not answer.
const PAUSE: Duration = Duration::from_millis(500);

/// Places that one statement takes or gives back.
const PLACES_AT_ONCE: usize = 1000;

/// What a server says of itself when it joins others.
#[derive(Clone, Debug)]
pub struct Joining {
    /// Where the others reach it: host and port.
    pub address: String,
    /// What all members know, and nobody else.
    pub secret: Arc<[u8]>,
    /// Whether it takes nothing, and lets the others answer all that is about what is played.
    pub forwards_only: bool,
    /// Reads the time of day of this host.
    pub host_ms: fn() -> i64,
}

/// Why a server cannot join. Each says what to do.
#[derive(Debug, thiserror::Error)]
pub enum JoinError {
    #[error(
        "the secret is not that of the other servers on {0}: give all of them the same --cluster-secret-file. To change it, stop \
         all of them first. If they are a cluster of their own, name another database with --db"
    )]
    Secret(String),
    #[error(
        "the clock of this machine is {off_ms} ms {direction} that of the database: it may be {most} ms off. Synchronize both, \
         with chrony say, and start again",
        most = CLOCK_OFF_MAX.as_millis()
    )]
    Clock { off_ms: u64, direction: &'static str },
    #[error("there are {MEMBERS_MAX} servers on {0} already")]
    Full(String),
    #[error(
        "another server with the address {0} is running on this database: give each its own --node"
    )]
    Address(String),
}

/// A server among those that play together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Member {
    /// Its number, which no other ever gets.
    pub incarnation: i64,
    /// Where the others reach it.
    pub address: String,
    /// Host and process, for people.
    pub name: String,
    pub version: String,
    pub joined_at_ms: i64,
    /// When it was last seen, and how long ago that was, by the clock of the database.
    pub beat_at_ms: i64,
    pub seen_ms_ago: i64,
    /// Whether the database has its session: it ends with its process, or with its connection.
    pub is_connected: bool,
    pub clock_offset_ms: i64,
    /// Whether it takes work.
    pub is_ready: bool,
    /// Episodes in its memory.
    pub episodes: u32,
    /// Games, runs and competitions that it has taken.
    pub places: u32,
}

/// What a look at the database showed.
#[derive(Clone, Debug, Default)]
pub struct Look {
    /// All members, the oldest first.
    pub members: Vec<Member>,
    /// By which revision members have to act.
    pub revision: i64,
}

/// What a member says of itself with each beat.
#[derive(Clone, Copy, Debug)]
pub struct Beat {
    pub is_ready: bool,
    pub episodes: u32,
}

/// How a member is known to be dead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Death {
    /// It was not seen for [`TAKEN_OVER_AFTER`].
    Expired,
    /// Its process is gone.
    Seen,
}

/// Something unfinished that nobody plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unowned {
    pub place: Place,
    /// Whether it advances by itself.
    pub clocked: bool,
}

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
    /// What may have been taken and is not continued yet: whoever asked for it may be gone.
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

/// What this server does with a place that it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Has,
    /// It is about to give it back: nothing is begun there any more.
    Leaves,
}

#[derive(Default)]
struct ChangesRead {
    /// All older transactions have been read.
    horizon: i64,
    /// What was read of later ones.
    newer: HashSet<(i64, i16, i64)>,
    at: Option<Instant>,
    /// The number of the last read that is complete.
    complete: u64,
}

impl std::fmt::Debug for Cluster {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cluster").field("incarnation", &self.incarnation).finish_non_exhaustive()
    }
}

/// What the table `cluster` has of the secret.
fn digest(secret: &[u8]) -> Vec<u8> {
    let mut hash = Sha256::new();
    hash.update(b"swarmbench cluster\0");
    hash.update(secret);
    hash.finalize().to_vec()
}

/// Checks that a server may play together with those that use the database, before it changes anything.
pub(in crate::store) async fn check(
    server: &Server,
    connection: &mut Connection,
    joining: &Joining,
) -> Result<(), OpenError> {
    let failed = |error| server.failed(error);
    let (before, now) = (
        (joining.host_ms)(),
        query("SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000 AS bigint)"),
    );
    let database: i64 = now.one(connection).await.map_err(failed)?;
    let after = (joining.host_ms)();
    let off = i64::midpoint(before, after) - database;
    // When the database read its clock is known to half of this.
    let unsure = before.abs_diff(after) / 2;
    if off.unsigned_abs().saturating_sub(unsure)
        > u64::try_from(CLOCK_OFF_MAX.as_millis()).unwrap_or(0)
    {
        let direction = if off > 0 { "ahead of" } else { "behind" };
        return Err(JoinError::Clock { off_ms: off.unsigned_abs(), direction }.into());
    }
    let known: bool =
        query("SELECT to_regclass('cluster') IS NOT NULL").one(connection).await.map_err(failed)?;
    if !known {
        return Ok(());
    }
    let secret: Option<Vec<u8>> =
        query("SELECT secret FROM cluster WHERE EXISTS (SELECT 1 FROM members)")
            .optional(connection)
            .await
            .map_err(failed)?;
    if secret.is_some_and(|secret| secret != digest(&joining.secret)) {
        return Err(JoinError::Secret(server.location().to_owned()).into());
    }
    Ok(())
}

impl Cluster {
    /// Joins the servers that play on a database, as the one with this number.
    pub(in crate::store) async fn join(
        server: &Server,
        connection: &mut Connection,
        incarnation: i64,
        joining: &Joining,
    ) -> Result<Arc<Self>, OpenError> {
        // One after another, so that no two get the same slot.
        let (slot, seen) = connection
            .transaction(Begin::Write, async |connection| {
                query("LOCK TABLE members IN SHARE ROW EXCLUSIVE MODE").execute(connection).await?;
                enter(server.location(), connection, incarnation, joining).await
            })
            .await
            .map_err(|error| match error {
                EnterError::Refused(refused) => OpenError::from(refused),
                EnterError::Database(error) => server.failed(error).into(),
            })?;
        let cluster = Self {
            server: server.clone(),
            incarnation,
            slot: i16::try_from(slot).expect("a slot is a small number"),
            started: Instant::now(),
            beats: tokio::sync::Mutex::default(),
            takes: tokio::sync::Mutex::default(),
            places: Mutex::default(),
            taken: Mutex::default(),
            members: Mutex::new(Arc::default()),
            incarnations: watch::Sender::new(Vec::new()),
            takes_work: AtomicBool::new(false),
            answers_until: AtomicU64::new(0),
            seen: AtomicU64::new(seen.unsigned_abs()),
            changes: tokio::sync::Mutex::default(),
            reads: AtomicU64::new(0),
        };
        cluster.answers_from(Instant::now());
        Ok(Arc::new(cluster))
    }

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

    /// The revision of tokens and keys by which this server acts.
    pub fn seen(&self) -> i64 {
        i64::try_from(self.seen.load(Ordering::Acquire)).unwrap_or(i64::MAX)
    }

    fn places(&self) -> MutexGuard<'_, HashMap<Place, State>> {
        self.places.lock().expect("nothing panics while it holds this")
    }

    /// Whether this server has a place, and keeps it.
    pub fn has(&self, place: Place) -> bool {
        self.places().get(&place) == Some(&State::Has)
    }

    /// Notes the members, as they were seen last.
    pub fn set_members(&self, members: Arc<[Member]>) {
        let numbers: Vec<i64> = members.iter().map(|member| member.incarnation).collect();
        *self.members.lock().expect("nothing panics while it holds this") = members;
        self.incarnations.send_if_modified(|known| {
            let is_new = *known != numbers;
            *known = numbers;
            is_new
        });
    }

    /// Completes when a member is gone: it has left, or was excluded.
    pub fn gone(&self, incarnation: i64) -> impl Future<Output = ()> + Send + 'static {
        let mut known = self.incarnations.subscribe();
        async move {
            let is_gone = |known: &Vec<i64>| !known.contains(&incarnation);
            if known.wait_for(is_gone).await.is_err() {
                // This server ends.
                std::future::pending::<()>().await;
            }
        }
    }

    /// The members, as they were seen last, the oldest first.
    pub fn members(&self) -> Arc<[Member]> {
        Arc::clone(&self.members.lock().expect("nothing panics while it holds this"))
    }

    /// Whether this is the oldest member that takes work: it does what one of them has to. For a moment there may be two.
    pub fn is_oldest(&self) -> bool {
        let members = self.members();
        let oldest = members.iter().find(|member| member.is_ready);
        oldest.is_some_and(|oldest| oldest.incarnation == self.incarnation)
    }

    /// Which member takes a place that nobody has: for each place another, and the same for all who ask, as long as they see the
    /// same members. Few places change hands when a member comes or goes (rendezvous hashing).
    pub fn preferred(&self, place: Place) -> i64 {
        let (kind, key) = place.numbers();
        self.preferred_for(mixed(key.cast_unsigned()) ^ u64::from(kind.unsigned_abs()))
    }

    /// The same of anything that has a number.
    pub fn preferred_for(&self, number: u64) -> i64 {
        let members = self.members();
        let ready =
            members.iter().filter(|member| member.is_ready).map(|member| member.incarnation);
        let weight = |member: &i64| mixed(mixed(member.cast_unsigned()) ^ number);
        ready.max_by_key(weight).unwrap_or(self.incarnation)
    }

    /// What this server has.
    pub fn all_places(&self) -> Vec<Place> {
        self.places().keys().copied().collect()
    }

    /// Notes what new entries, which are durable now, have taken.
    pub(in crate::store) fn note(&self, entries: &[Entry]) {
        if entries.iter().any(|entry| taken_by(entry).is_some()) {
            let mut places = self.places();
            places.extend(entries.iter().filter_map(taken_by).map(|place| (place, State::Has)));
        }
    }

    /// Says that this server is alive. Errors but [`StoreError::Failed`] say nothing of that.
    pub async fn beat(&self, beat: Beat, host_ms: fn() -> i64) -> Result<(), StoreError> {
        let sent = Instant::now();
        let (before, places) = (host_ms(), self.places().len());
        let found: Option<i64> = self
            .on(&self.beats, Purpose::Beats, async |connection| {
                let update = query(
                    "UPDATE members SET beat_at = now_ms(),
                         is_ready = $2, episodes = $3, places = $4
                     WHERE incarnation = $1 RETURNING beat_at",
                );
                let update = update
                    .bind(self.incarnation)
                    .bind(beat.is_ready)
                    .bind(beat.episodes)
                    .bind(i64::try_from(places).unwrap_or(i64::MAX));
                update.optional(connection).await
            })
            .await?;
        let database = found.ok_or(StoreError::Failed)?;
        self.takes_work.store(beat.is_ready, Ordering::Release);
        self.answers_from(sent);
        let after = host_ms();
        if u128::from(before.abs_diff(after)) > CLOCK_OFF_MAX.as_millis() {
            // An answer that took so long says little of the clock: the last offset stays.
            return Ok(());
        }
        let offset = i64::midpoint(before, after) - database;
        self.on(&self.beats, Purpose::Beats, async |connection| {
            let update = query("UPDATE members SET offset_ms = $2 WHERE incarnation = $1 AND abs(offset_ms - $2) > 5");
            update.bind(self.incarnation).bind(offset).execute(connection).await
        })
        .await?;
        Ok(())
    }

    /// All members, and the revision by which they have to act.
    pub async fn look(&self) -> Result<Look, StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            let revision = query("SELECT revision FROM cluster").one(connection).await?;
            let rows = query(
                "SELECT m.incarnation, m.address, n.name, m.version, n.started_at,
                        now_ms() - m.beat_at, m.offset_ms, m.is_ready,
                        m.episodes, m.places, l.objid IS NOT NULL, m.beat_at
                 FROM members m JOIN nodes n ON n.incarnation = m.incarnation
                 LEFT JOIN pg_locks l ON l.locktype = 'advisory' AND l.granted AND l.objsubid = 2
                     AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database())
                     AND CAST(l.classid AS bigint) = $1 AND CAST(l.objid AS bigint) = (m.incarnation & 2147483647)
                 ORDER BY m.incarnation",
            );
            let rows = rows.bind(i64::from(ALIVE)).fetch_all(connection).await?;
            let members = rows.iter().map(|row| {
                Ok(Member {
                    incarnation: row.try_get(0)?,
                    address: row.try_get(1)?,
                    name: row.try_get(2)?,
                    version: row.try_get(3)?,
                    joined_at_ms: row.try_get(4)?,
                    seen_ms_ago: row.try_get(5)?,
                    clock_offset_ms: row.try_get(6)?,
                    is_ready: row.try_get(7)?,
                    episodes: row.try_get(8)?,
                    places: row.try_get(9)?,
                    is_connected: row.try_get(10)?,
                    beat_at_ms: row.try_get(11)?,
                })
            });
            let members = members.collect::<Result<_, sqlx::Error>>()?;
            Ok(Look { members, revision })
        })
        .await
    }

    /// Whether the database has a session of a member. It ends with the process of the member, or with its connection.
    pub async fn is_connected(&self, incarnation: i64) -> Result<bool, StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            is_connected(connection, incarnation).await
        })
        .await
    }

    /// Excludes a dead member: nothing of it is written any more, and what it had is free. False where it is alive after all.
    pub async fn exclude(&self, incarnation: i64, death: Death) -> Result<bool, StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            exclude(connection, incarnation, death).await
        })
        .await
    }

    /// Whether something at a place is unfinished. Competitions can be changed also when they are over.
    pub async fn is_unfinished(&self, place: Place) -> Result<bool, StoreError> {
        let (text, key) = match place {
            Place::Game(EpisodeKey(key)) => {
                ("SELECT EXISTS (SELECT 1 FROM episodes WHERE key = $1 AND ended_at IS NULL)", key)
            }
            Place::Run(RunKey(key)) => (
                "SELECT EXISTS (SELECT 1 FROM runs WHERE key = $1 AND ended_at IS NULL)
                     OR EXISTS (SELECT 1 FROM episodes WHERE run = $1 AND ended_at IS NULL)",
                key,
            ),
            Place::Competition(_) => return Ok(true),
        };
        self.on(&self.takes, Purpose::Takes, async |connection| {
            query(text).bind(key).one(connection).await
        })
        .await
    }

    fn taken(&self) -> MutexGuard<'_, HashSet<Place>> {
        self.taken.lock().expect("nothing panics while it holds this")
    }

    /// What [`Cluster::take`] may have taken since this was last asked: all that is unfinished there is to be continued.
    pub fn take_taken(&self) -> Vec<Place> {
        self.taken().drain().collect()
    }

    /// Notes that places may have been taken.
    pub fn note_taken(&self, places: impl IntoIterator<Item = Place>) {
        self.taken().extend(places);
    }

    /// Takes those of these places that nobody has; who has each now, in an order of its own.
    pub async fn take(&self, wanted: &[Place]) -> Result<Vec<(Place, i64)>, StoreError> {
        // Before it is done, as the caller may not be there any more when it is.
        self.note_taken(wanted.iter().copied());
        self.take_noted(wanted).await
    }

    /// Takes places as [`Cluster::take`] does, for a caller that continues what is there.
    pub async fn take_noted(&self, wanted: &[Place]) -> Result<Vec<(Place, i64)>, StoreError> {
        let mut owners = Vec::with_capacity(wanted.len());
        let mut missing = wanted.to_vec();
        // In one order, so that two servers do not wait for each other.
        missing.sort_unstable();
        while !missing.is_empty() {
            let some: Vec<Place> = missing.drain(..missing.len().min(PLACES_AT_ONCE)).collect();
            let found = self
                .on(&self.takes, Purpose::Takes, async |connection| {
                    let found = take(connection, &some, self.incarnation).await?;
                    // While nobody else has the connection: what is known here follows what is written there in its order.
                    let mut places = self.places();
                    for (place, _) in found.iter().filter(|(_, owner)| *owner == self.incarnation) {
                        places.entry(*place).or_insert(State::Has);
                    }
                    Ok(found)
                })
                .await?;
            let known: HashSet<Place> = found.iter().map(|(place, _)| *place).collect();
            // Another server took it at this moment.
            missing.extend(some.into_iter().filter(|place| !known.contains(place)));
            owners.extend(found);
        }
        Ok(owners)
    }

    /// Begins to give a place back: from now on nothing is begun there. False where this server does not have it.
    pub fn leave(&self, place: Place) -> bool {
        match self.places().get_mut(&place) {
            Some(state) => {
                *state = State::Leaves;
                true
            }
            None => false,
        }
    }

    /// Keeps a place after all.
    pub fn stay(&self, place: Place) {
        if let Some(state) = self.places().get_mut(&place) {
            *state = State::Has;
        }
    }

    /// Gives back places that [`Cluster::leave`] has begun to: nothing is written there any more. Where the database does not answer,
    /// nobody knows whether they are given back; then it goes on until that is certain, and this server does nothing there.
    pub async fn release(&self, places: &[Place]) -> Result<(), StoreError> {
        for some in places.chunks(PLACES_AT_ONCE) {
            let takings = loop {
                match self.takings(some).await {
                    Err(StoreError::Away) => tokio::time::sleep(PAUSE).await,
                    answered => break answered?,
                }
            };
            while let Err(error) = self.delete(&takings, some).await {
                if !matches!(error, StoreError::Away) {
                    return Err(error);
                }
                tokio::time::sleep(PAUSE).await;
            }
        }
        Ok(())
    }

    /// The numbers of rows by which this server has places.
    async fn takings(&self, places: &[Place]) -> Result<Vec<i64>, StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let (kinds, keys) = columns(places);
            let mut arguments = PgArguments::default();
            arguments.add(kinds).map_err(sqlx::Error::Encode)?;
            arguments.add(keys).map_err(sqlx::Error::Encode)?;
            arguments.add(self.incarnation).map_err(sqlx::Error::Encode)?;
            let Engine::Postgres(connection) = connection.engine() else {
                unreachable!("it is of PostgreSQL")
            };
            let rows = sqlx::query_with(
                "SELECT p.taking FROM places p JOIN unnest($1::smallint[], $2::bigint[]) AS w (kind, key)
                     ON p.kind = w.kind AND p.key = w.key WHERE p.owner = $3",
                arguments,
            );
            let rows = rows.fetch_all(connection).await?;
            rows.iter().map(|row| row.try_get(0)).collect()
        })
        .await
    }

    async fn delete(&self, takings: &[i64], places: &[Place]) -> Result<(), StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let mut arguments = PgArguments::default();
            arguments.add(takings.to_vec()).map_err(sqlx::Error::Encode)?;
            let Engine::Postgres(connection) = connection.engine() else {
                unreachable!("it is of PostgreSQL")
            };
            let delete =
                sqlx::query_with("DELETE FROM places WHERE taking = ANY($1::bigint[])", arguments);
            delete.execute(connection).await?;
            let mut held = self.places();
            for place in places {
                held.remove(place);
            }
            Ok(())
        })
        .await
    }

    /// Gives back all places at which everything is over.
    pub async fn release_ended(&self) -> Result<usize, StoreError> {
        self
            .on(&self.takes, Purpose::Takes, async |connection| {
                let delete = query(
                    "DELETE FROM places p WHERE p.owner = $1 AND (
                         p.kind = 0 AND EXISTS (SELECT 1 FROM episodes e WHERE e.key = p.key AND e.ended_at IS NOT NULL)
                         OR p.kind = 1
                             AND EXISTS (SELECT 1 FROM runs r WHERE r.key = p.key AND r.ended_at IS NOT NULL)
                             AND NOT EXISTS (SELECT 1 FROM episodes e WHERE e.run = p.key AND e.ended_at IS NULL))
                     RETURNING CAST(p.kind AS bigint), p.key",
                );
                let ended: Vec<(i64, i64)> = delete.bind(self.incarnation).all(connection).await?;
                let mut places = self.places();
                let mut released = 0;
                for (kind, key) in ended {
                    let place = i16::try_from(kind).ok().and_then(|kind| Place::from_numbers(kind, key));
                    released += usize::from(place.is_some_and(|place| places.remove(&place).is_some()));
                }
                Ok(released)
            })
            .await
    }

    /// Who has a place.
    pub async fn owner(&self, place: Place) -> Result<Option<i64>, StoreError> {
        let (kind, key) = place.numbers();
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let owner = query("SELECT owner FROM places WHERE kind = $1 AND key = $2");
            owner.bind(i64::from(kind)).bind(key).optional(connection).await
        })
        .await
    }

    /// What is unfinished and played by nobody.
    pub async fn unowned(&self) -> Result<Vec<Unowned>, StoreError> {
        let rows: Vec<(i64, i64, bool)> = self
            .on(&self.takes, Purpose::Takes, async |connection| {
                let rows = query(
                    "SELECT CAST(0 AS bigint), e.key, e.clocked FROM episodes e
                     WHERE e.status IN ('waiting', 'running') AND e.run IS NULL
                         AND NOT EXISTS (SELECT 1 FROM places p WHERE p.kind = 0 AND p.key = e.key)
                     UNION ALL
                     SELECT 1, u.key, bool_or(u.clocked) FROM (
                         SELECT key, false AS clocked FROM runs WHERE status = 'running'
                         UNION ALL
                         SELECT run, clocked FROM episodes WHERE run IS NOT NULL AND status IN ('waiting', 'running')) u
                     WHERE NOT EXISTS (SELECT 1 FROM places p WHERE p.kind = 1 AND p.key = u.key)
                     GROUP BY u.key",
                );
                rows.all(connection).await
            })
            .await?;
        let unowned = |(kind, key, clocked): (i64, i64, bool)| {
            let place = Place::from_numbers(i16::try_from(kind).ok()?, key)?;
            Some(Unowned { place, clocked })
        };
        Ok(rows.into_iter().filter_map(unowned).collect())
    }

    /// Tells all members that tokens or keys were revoked; the revision by which they have to act.
    pub async fn announce(&self) -> Result<i64, StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let count = query("UPDATE cluster SET revision = revision + 1 RETURNING revision");
            count.one(connection).await
        })
        .await
    }

    /// Notes that this server acts by a revision.
    pub async fn act_by(&self, revision: i64) -> Result<(), StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            let update = query("UPDATE members SET seen = $2 WHERE incarnation = $1 AND seen < $2");
            update.bind(self.incarnation).bind(revision).execute(connection).await
        })
        .await?;
        self.seen.fetch_max(revision.unsigned_abs(), Ordering::AcqRel);
        Ok(())
    }

    /// Whether all members act by a revision.
    pub async fn all_act_by(&self, revision: i64) -> Result<bool, StoreError> {
        self.on(&self.beats, Purpose::Beats, async |connection| {
            // One that starts knows no token yet, and has its first beat before it answers anybody.
            let behind = query(
                "SELECT NOT EXISTS (SELECT 1 FROM members WHERE seen < $1 AND beat_at <= now_ms() + $2)",
            );
            let starts = i64::try_from(TAKEN_OVER_AFTER.as_millis()).unwrap_or(i64::MAX);
            behind.bind(revision).bind(starts).one(connection).await
        })
        .await
    }

    /// Reads what other members have committed since the last read, and hands it to `note`; or `forget` where some of it is not
    /// known any more. Of many callers at once few read.
    pub(in crate::store) async fn read_changes(
        &self,
        note: impl Fn(Effect),
        forget: impl FnOnce(),
    ) -> Result<(), StoreError> {
        let wanted = self.reads.fetch_add(1, Ordering::AcqRel) + 1;
        let mut read = self.changes.lock().await;
        if read.complete >= wanted {
            return Ok(());
        }
        // All that ask until now are served by this read.
        let serves = self.reads.load(Ordering::Acquire);
        let horizon = read.horizon;
        let rows = self
            .on(&self.takes, Purpose::Takes, async |connection| {
                let rows = query(
                    "SELECT CAST(CAST(pg_snapshot_xmin(pg_current_snapshot()) AS text) AS bigint),
                            CAST(CAST(c.xid AS text) AS bigint), CAST(c.kind AS bigint), c.key
                     FROM (VALUES (1)) AS one LEFT JOIN changes c
                         ON c.xid >= CAST(CAST($1 AS text) AS xid8) AND c.owner <> $2",
                );
                let rows = rows.bind(horizon.to_string()).bind(self.incarnation);
                rows.all::<(i64, Option<i64>, Option<i64>, Option<i64>)>(connection).await
            })
            .await?;
        let is_first = read.at.is_none();
        if read.at.is_some_and(|at| at.elapsed() > CHANGES_KEPT / 2) {
            forget();
        }
        let mut newer = HashSet::new();
        for (next, xid, kind, key) in rows {
            read.horizon = read.horizon.max(next);
            let (Some(xid), Some(kind), Some(key)) = (xid, kind, key) else { continue };
            let Ok(kind) = i16::try_from(kind) else { continue };
            if !is_first && !read.newer.contains(&(xid, kind, key)) {
                note(Effect { kind, key });
            }
            newer.insert((xid, kind, key));
        }
        let horizon = read.horizon;
        newer.retain(|(xid, ..)| *xid >= horizon);
        read.newer = newer;
        read.at = Some(Instant::now());
        read.complete = serves;
        Ok(())
    }

    /// Deletes changes that all members have read long ago.
    pub async fn delete_old_changes(&self) -> Result<(), StoreError> {
        let kept = i64::try_from(CHANGES_KEPT.as_millis()).unwrap_or(i64::MAX);
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let delete = query("DELETE FROM changes WHERE at < now_ms() - $1");
            delete.bind(kept).execute(connection).await
        })
        .await?;
        Ok(())
    }

    /// Deletes what is left of forks that a dead member did not complete.
    pub async fn delete_incomplete_forks(&self) -> Result<(), StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            crate::store::forks::delete_incomplete(connection).await
        })
        .await
    }

    /// Does something on one of the two connections, which is made where there is none. It is given up where that fails.
    async fn on<T>(
        &self,
        link: &tokio::sync::Mutex<Option<Connection>>,
        purpose: Purpose,
        work: impl AsyncFnOnce(&mut Connection) -> Result<T, sqlx::Error>,
    ) -> Result<T, StoreError> {
        let mut link = link.lock().await;
        let done = tokio::time::timeout(ANSWER_PATIENCE, async {
            let mut connection = match link.take() {
                Some(connection) => connection,
                None => self.connect(purpose).await?,
            };
            let done = work(&mut connection).await;
            // An error that PostgreSQL answered leaves a connection that can be used.
            if done.as_ref().err().is_none_or(|error| session::sqlstate(error).is_some()) {
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
                *link = None;
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
                let lock =
                    query("SELECT pg_try_advisory_lock(CAST($1 AS integer), CAST($2 AS integer))");
                let lock = lock.bind(i64::from(ALIVE)).bind(alive_key(self.incarnation));
                // An old session of this server may still have it.
                let _: bool = lock.one(&mut connection).await?;
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

/// Why the rows of a new member were not added.
#[derive(Debug, thiserror::Error)]
enum EnterError {
    #[error(transparent)]
    Refused(#[from] JoinError),
    #[error(transparent)]
    Database(#[from] sqlx::Error),
}

/// Adds the rows of a new member, which has a slot to itself.
async fn enter(
    location: &str,
    connection: &mut Connection,
    incarnation: i64,
    joining: &Joining,
) -> Result<(i64, i64), EnterError> {
    let secret = digest(&joining.secret);
    // Where nobody is there any more, it may be another.
    let kept = query(
        "INSERT INTO cluster (secret) VALUES ($1) ON CONFLICT (one) DO UPDATE SET secret = excluded.secret
         WHERE cluster.secret = excluded.secret OR NOT EXISTS (SELECT 1 FROM members)",
    );
    if kept.bind(&secret).execute(connection).await? == 0 {
        return Err(JoinError::Secret(location.to_owned()).into());
    }
    // The process that had this address is gone, as this one listens there; unless another machine has it, too.
    let same: Vec<i64> = query("SELECT incarnation FROM members WHERE address = $1")
        .bind(&joining.address)
        .all(connection)
        .await?;
    for before in same {
        if is_connected(connection, before).await? {
            return Err(JoinError::Address(joining.address.clone()).into());
        }
        delete(connection, before, Death::Seen).await?;
    }
    let joined = query(
        "INSERT INTO members (incarnation, slot, address, version, beat_at, seen)
         SELECT $1, s.slot, $2, $3, now_ms() + $5, c.revision
         FROM cluster c, generate_series(0, $4) AS s (slot)
         WHERE NOT EXISTS (SELECT 1 FROM members m WHERE m.slot = s.slot)
         ORDER BY s.slot LIMIT 1 RETURNING slot, seen",
    );
    let joined = joined
        .bind(incarnation)
        .bind(&joining.address)
        .bind(env!("CARGO_PKG_VERSION"))
        .bind(i64::from(MEMBERS_MAX - 1))
        .bind(i64::try_from(STARTS_WITHIN.as_millis()).unwrap_or(i64::MAX))
        .optional::<(i64, i64)>(connection)
        .await?;
    joined.ok_or_else(|| JoinError::Full(location.to_owned()).into())
}

async fn is_connected(connection: &mut Connection, incarnation: i64) -> Result<bool, sqlx::Error> {
    let lock = query(
        "SELECT EXISTS (SELECT 1 FROM pg_locks WHERE locktype = 'advisory' AND granted AND objsubid = 2
             AND database = (SELECT oid FROM pg_database WHERE datname = current_database())
             AND CAST(classid AS bigint) = $1 AND CAST(objid AS bigint) = $2)",
    );
    lock.bind(i64::from(ALIVE)).bind(alive_key(incarnation)).one(connection).await
}

/// Deletes the rows of a member, in the order that excludes it for certain: a beat that comes later finds no row, and a commit
/// that is under way ends before, or is none. False where it was seen meanwhile.
async fn exclude(
    connection: &mut Connection,
    incarnation: i64,
    death: Death,
) -> Result<bool, sqlx::Error> {
    // A transaction that it has left open would be waited for.
    let sessions = query(
        "SELECT CAST(pid AS bigint) FROM pg_stat_activity
         WHERE datname = current_database() AND (application_name = $1 OR application_name LIKE $1 || '/%')
             AND EXISTS (SELECT 1 FROM members WHERE incarnation = $2 AND ($3 OR beat_at < now_ms() - $4))",
    );
    let sessions: Vec<i64> = sessions
        .bind(session_name(incarnation))
        .bind(incarnation)
        .bind(death == Death::Seen)
        .bind(ttl_ms())
        .all(connection)
        .await?;
    for pid in sessions {
        session::terminate(connection, pid).await?;
    }
    connection
        .transaction(Begin::Write, async |connection| delete(connection, incarnation, death).await)
        .await
}

/// Deletes the rows of a member, in the transaction that is open; false where it was seen meanwhile.
async fn delete(
    connection: &mut Connection,
    incarnation: i64,
    death: Death,
) -> Result<bool, sqlx::Error> {
    let expired =
        query("DELETE FROM members WHERE incarnation = $1 AND ($2 OR beat_at < now_ms() - $3)");
    let expired = expired.bind(incarnation).bind(death == Death::Seen).bind(ttl_ms());
    if expired.execute(connection).await? == 0 {
        return Ok(false);
    }
    let node = query("DELETE FROM nodes WHERE incarnation = $1").bind(incarnation);
    node.execute(connection).await?;
    Ok(true)
}

fn ttl_ms() -> i64 {
    i64::try_from(TAKEN_OVER_AFTER.as_millis()).unwrap_or(i64::MAX)
}

/// A number in which each bit depends on all bits of this one (the finalizer of `splitmix64`).
const fn mixed(number: u64) -> u64 {
    let number = (number ^ (number >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let number = (number ^ (number >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    number ^ (number >> 31)
}

fn columns(places: &[Place]) -> (Vec<i16>, Vec<i64>) {
    places.iter().map(|place| place.numbers()).unzip()
}

async fn take(
    connection: &mut Connection,
    wanted: &[Place],
    owner: i64,
) -> Result<Vec<(Place, i64)>, sqlx::Error> {
    let (kinds, keys) = columns(wanted);
    let mut arguments = PgArguments::default();
    arguments.add(kinds).map_err(sqlx::Error::Encode)?;
    arguments.add(keys).map_err(sqlx::Error::Encode)?;
    arguments.add(owner).map_err(sqlx::Error::Encode)?;
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("it is of PostgreSQL")
    };
    let rows = sqlx::query_with(
        "WITH wanted AS (SELECT kind, key FROM unnest($1::smallint[], $2::bigint[]) AS t (kind, key)),
              taken AS (INSERT INTO places (kind, key, owner) SELECT kind, key, $3 FROM wanted ORDER BY kind, key
                        ON CONFLICT DO NOTHING RETURNING kind, key, owner)
         SELECT kind, key, owner FROM taken
         UNION ALL SELECT p.kind, p.key, p.owner FROM places p JOIN wanted w ON w.kind = p.kind AND w.key = p.key",
        arguments,
    );
    let rows = rows.fetch_all(connection).await?;
    let owners = rows.iter().map(|row| {
        let (kind, key, owner): (i16, i64, i64) =
            (row.try_get(0)?, row.try_get(1)?, row.try_get(2)?);
        Ok(Place::from_numbers(kind, key).map(|place| (place, owner)))
    });
    owners.filter_map(Result::transpose).collect()
}

/// The place that an entry takes for the server that writes it.
fn taken_by(entry: &Entry) -> Option<Place> {
    match entry {
        Entry::Open(row) if row.run.is_none() => Some(Place::Game(row.episode)),
        _ => None,
    }
}

/// Writes what the other members have to know of entries, in the transaction that has them.
pub(in crate::store) async fn write(
    connection: &mut Connection,
    incarnation: i64,
    entries: impl Iterator<Item = &Entry> + Clone,
) -> Result<(), sqlx::Error> {
    let forks = entries.clone().filter_map(|entry| match entry {
        Entry::BeginForks(episodes) => Some(episodes.as_slice()),
        _ => None,
    });
    let forks = forks.flatten().map(|episode| Place::Game(*episode));
    let places: Vec<Place> = entries.clone().filter_map(taken_by).chain(forks).collect();
    if !places.is_empty() {
        take(connection, &places, incarnation).await?;
    }
    let effects: Vec<Effect> = entries.filter_map(Effect::of).collect();
    if effects.is_empty() {
        return Ok(());
    }
    let mut arguments = PgArguments::default();
    let (kinds, keys): (Vec<i16>, Vec<i64>) =
        effects.iter().map(|effect| (effect.kind, effect.key)).unzip();
    arguments.add(kinds).map_err(sqlx::Error::Encode)?;
    arguments.add(keys).map_err(sqlx::Error::Encode)?;
    arguments.add(incarnation).map_err(sqlx::Error::Encode)?;
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("it is of PostgreSQL")
    };
    sqlx::query_with(
        "INSERT INTO changes (owner, kind, key, at)
         SELECT $3, t.kind, t.key, now_ms()
         FROM unnest($1::smallint[], $2::bigint[]) AS t (kind, key)",
        arguments,
    )
    .execute(connection)
    .await
    .map(drop)
}
