//! This server's part in a cluster: it shows that it is alive, watches the other servers, takes over places of dead servers and
//! places without an owner, and releases idle places that other servers are preferred for.
//!
//! The database decides everything that has to be right ([`Cluster`]). This module decides when to ask.

use std::collections::{HashMap, HashSet};
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::episode::registry::Registry;
use crate::fair::Party;
use crate::ids::{EpisodeKey, Place};
use crate::run::manager::Runs;
use crate::store::{
    ANSWERS_FOR, Beat, CLOCK_OFF_MAX, Cluster, Death, Member, Store, StoreError, TAKEN_OVER_AFTER,
};
use swarmbench_clock::{Clock as _, SystemClock};

/// Interval between looks at the other servers.
const LOOKS_EVERY: Duration = Duration::from_millis(250);

/// Looks per beat, with which this server shows that it is alive.
const LOOKS_PER_BEAT: u32 = 4;

/// Interval between searches for unowned places while no server comes or goes.
const SEARCHES_EVERY: Duration = Duration::from_secs(30);

/// Interval between releases of places that other servers are preferred for, or where everything has ended.
const TIDIES_EVERY: Duration = Duration::from_secs(10);

/// Interval between deletions of old changes.
const DELETES_EVERY: Duration = Duration::from_mins(5);

/// Time for which this server's clock may be too far from the database's before the server leaves its places to others.
const CLOCK_OFF_PATIENCE: Duration = Duration::from_secs(10);

/// Timeout for a live process to accept a connection.
const ACCEPT_PATIENCE: Duration = Duration::from_millis(500);

/// Dependencies of a server's part in the cluster.
pub struct Parts {
    pub store: Store,
    pub cluster: Arc<Cluster>,
    pub registry: Registry,
    pub runs: Runs,
    /// Whether the other servers reach this one.
    pub is_reachable: Arc<AtomicBool>,
    /// Whether this server takes no places, and lets the others answer.
    pub forwards_only: bool,
    /// Cancelled when this server stops: it takes no more places.
    pub stop: CancellationToken,
    /// Cancelled when this server has to stop: its clock is off, and those of others are not.
    pub clock_is_off: CancellationToken,
    /// Called when this server has taken the places that waited for it; repeatedly where it only forwards.
    pub ready: Arc<dyn Fn() + Send + Sync>,
    /// Called when tokens or keys were revoked, before this server confirms the revocation.
    pub revoked: Arc<dyn Fn() + Send + Sync>,
}

/// Time of day of this host, in milliseconds.
pub fn host_ms() -> i64 {
    SystemClock.now().as_millisecond()
}

/// Runs until this server is excluded.
pub async fn run(parts: Parts) {
    let parts = Arc::new(parts);
    let (look, seen) = watch::channel(Seen::default());
    let beating = beat(Arc::clone(&parts), look);
    let working = work(Arc::clone(&parts), seen);
    tokio::select! {
        () = beating => {}
        () = working => {}
    }
}

/// The last look at the cluster.
#[derive(Clone, Default)]
struct Seen {
    members: Arc<[Member]>,
    /// Time since which the database has answered every look; `None` while it does not answer.
    up_since: Option<Instant>,
}

/// Beats, and looks at the other servers, until this server is excluded.
async fn beat(parts: Arc<Parts>, look: watch::Sender<Seen>) {
    let cluster = &parts.cluster;
    let mut up_since = None;
    let mut clock = OwnClock::default();
    for tick in 0_u32.. {
        let looked = async {
            if tick.is_multiple_of(LOOKS_PER_BEAT) {
                cluster.beat(said(&parts), host_ms).await?;
            }
            cluster.look().await
        };
        match looked.await {
            Ok(seen) => {
                let members: Arc<[Member]> = seen.members.into();
                cluster.set_members(Arc::clone(&members));
                if seen.revision > cluster.seen() {
                    (parts.revoked)();
                    if let Err(StoreError::Failed) = cluster.act_by(seen.revision).await {
                        return parts.store.set_excluded();
                    }
                }
                if clock.see(&members, cluster.incarnation(), Instant::now()) {
                    parts.clock_is_off.cancel();
                }
                metrics::gauge!("swarmbench_nodes").set(count(members.len()));
                let up_since = *up_since.get_or_insert_with(Instant::now);
                look.send_replace(Seen { members, up_since: Some(up_since) });
            }
            Err(StoreError::Failed) => return parts.store.set_excluded(),
            Err(error) => {
                if up_since.is_some() || tick == 0 {
                    tracing::warn!(%error, "the database does not answer: this server cannot renew its lease");
                }
                up_since = None;
                look.send_modify(|seen| seen.up_since = None);
            }
        }
        metrics::gauge!("swarmbench_lease_seconds").set(cluster.answers_for().as_secs_f64());
        tokio::time::sleep(LOOKS_EVERY).await;
    }
}

fn said(parts: &Parts) -> Beat {
    Beat {
        is_ready: parts.is_reachable.load(Ordering::Acquire)
            && !parts.forwards_only
            && !parts.stop.is_cancelled(),
        episodes: u32::try_from(parts.registry.in_memory()).unwrap_or(u32::MAX),
    }
}

/// Whether the clock of this machine is too far from that of the database, and since when.
#[derive(Default)]
struct OwnClock {
    off_since: Option<Instant>,
}

impl OwnClock {
    /// Takes in a look at the cluster and warns once; returns whether this server must leave its places to others. Where all
    /// clocks are off, the database's is.
    fn see(&mut self, members: &[Member], me: i64, now: Instant) -> bool {
        let Some(own) = members.iter().find(|member| member.incarnation == me) else {
            return false;
        };
        let off_ms = own.clock_offset_ms;
        #[expect(clippy::cast_precision_loss, reason = "a gauge is a double")]
        metrics::gauge!("swarmbench_clock_offset_seconds").set(off_ms as f64 / 1000.0);
        if !is_off(own) {
            self.off_since = None;
            return false;
        }
        if self.off_since.is_none() {
            tracing::error!(
                off_ms,
                "the clock of this machine is too far from that of the database: synchronize both"
            );
        }
        let since = *self.off_since.get_or_insert(now);
        let is_heir = |one: &Member| {
            one.incarnation != me && one.is_ready && one.is_connected && !is_off(one)
        };
        now.duration_since(since) >= CLOCK_OFF_PATIENCE && members.iter().any(is_heir)
    }
}

fn is_off(member: &Member) -> bool {
    u128::from(member.clock_offset_ms.unsigned_abs()) > CLOCK_OFF_MAX.as_millis()
}

/// Takes over places of dead servers and places without an owner, and releases places that other servers are preferred for.
async fn work(parts: Arc<Parts>, mut seen: watch::Receiver<Seen>) {
    let cluster = &parts.cluster;
    let mut known = None;
    let mut beats = Beats::default();
    let (mut searched, mut tidied, mut deleted) = (None, Instant::now(), Instant::now());
    loop {
        if seen.changed().await.is_err() {
            return;
        }
        let now = seen.borrow_and_update().clone();
        if now.up_since.is_none() {
            continue;
        }
        beats.see(&now.members);
        for member in
            now.members.iter().filter(|member| member.incarnation != cluster.incarnation())
        {
            let is_silent = beats.is_silent(member) && now.up_since.is_some_and(is_long_ago);
            if let Err(error) = watch_over(cluster, member, is_silent).await {
                tracing::warn!(%error, server = member.name, "the work of a server that may be dead cannot be taken over");
            }
        }
        if let Err(error) = continue_taken(&parts).await {
            tracing::warn!(%error, "work that this server has taken over cannot be continued");
        }
        let ready =
            now.members.iter().filter(|member| member.is_ready).map(|member| member.incarnation);
        let ready: Vec<i64> = ready.collect();
        if !ready.contains(&cluster.incarnation()) {
            if parts.forwards_only && !ready.is_empty() {
                (parts.ready)();
            }
            continue;
        }
        let is_due = searched.is_none_or(|at: Instant| at.elapsed() >= SEARCHES_EVERY);
        // A server that is gone leaves places behind, even if it took no more work.
        let all: Vec<i64> = now.members.iter().map(|member| member.incarnation).collect();
        let seen_now = Some((ready, all));
        if seen_now != known || is_due {
            match adopt(&parts).await {
                Ok(()) => {
                    if searched.is_none() {
                        (parts.ready)();
                    }
                    known = seen_now;
                    searched = Some(Instant::now());
                }
                Err(error) => {
                    tracing::warn!(%error, "work that no server does cannot be taken over");
                }
            }
        }
        if tidied.elapsed() >= TIDIES_EVERY {
            tidied = Instant::now();
            let tidy = async {
                cluster.release_ended().await?;
                give_up(&parts).await
            };
            if let Err(error) = tidy.await {
                tracing::warn!(%error, "idle games and runs cannot be released");
            }
        }
        if cluster.is_oldest() && deleted.elapsed() >= DELETES_EVERY {
            deleted = Instant::now();
            if let Err(error) = cluster.delete_old_changes().await {
                tracing::warn!(%error, "old changes cannot be deleted");
            }
        }
        metrics::gauge!("swarmbench_places").set(count(cluster.all_places().len()));
    }
}

#[expect(clippy::cast_precision_loss, reason = "a gauge is a double")]
const fn count(number: usize) -> f64 {
    number as f64
}

/// Beats of the other servers, as this server has seen them. The clock of the database alone could be set forward.
#[derive(Default)]
struct Beats(HashMap<i64, (i64, Instant)>);

impl Beats {
    fn see(&mut self, members: &[Member]) {
        let now = Instant::now();
        let last = std::mem::take(&mut self.0);
        let seen = members.iter().map(|member| {
            let (number, beat_at) = (member.incarnation, member.beat_at_ms);
            let same = last.get(&number).filter(|(last, _)| *last == beat_at);
            (number, (beat_at, same.map_or(now, |(_, since)| *since)))
        });
        self.0 = seen.collect();
    }

    /// Whether no beat of a server has come for longer than it may answer without one.
    fn is_silent(&self, member: &Member) -> bool {
        self.0.get(&member.incarnation).is_some_and(|(_, since)| since.elapsed() > ANSWERS_FOR)
    }
}

/// Whether a live server would have beaten since then: while the database was away, none could.
fn is_long_ago(since: Instant) -> bool {
    since.elapsed() > TAKEN_OVER_AFTER
}

/// Takes over a server where it is dead.
async fn watch_over(cluster: &Cluster, member: &Member, is_silent: bool) -> Result<(), StoreError> {
    // Negative while a server starts.
    let is_expired = i128::from(member.seen_ms_ago) > TAKEN_OVER_AFTER.as_millis().cast_signed();
    let death = if is_expired && is_silent {
        Death::Expired
    } else if !member.is_connected && is_dead(cluster, member).await {
        Death::Seen
    } else {
        return Ok(());
    };
    exclude(cluster, member.incarnation, death).await
}

/// Whether the process of a server is gone: the database has no session of it, and its address refuses connections. An address
/// that does not answer proves nothing, as the process may be stopped, or cut off.
pub async fn is_dead(cluster: &Cluster, member: &Member) -> bool {
    let connecting = TcpStream::connect(&member.address);
    let refused = match tokio::time::timeout(ACCEPT_PATIENCE, connecting).await {
        Ok(Err(error)) => error.kind() == ErrorKind::ConnectionRefused,
        Ok(Ok(_)) | Err(_) => false,
    };
    refused && matches!(cluster.is_connected(member.incarnation).await, Ok(false))
}

/// Takes over a server whose process is gone.
pub async fn take_over(cluster: &Cluster, incarnation: i64) -> Result<(), StoreError> {
    exclude(cluster, incarnation, Death::Seen).await
}

async fn exclude(cluster: &Cluster, incarnation: i64, death: Death) -> Result<(), StoreError> {
    if cluster.exclude(incarnation, death).await? {
        tracing::warn!(incarnation, ?death, "a server is dead: the others take its work over");
        metrics::counter!("swarmbench_takeovers_total").increment(1);
        cluster.delete_incomplete_forks().await?;
    }
    let left = cluster.members();
    let left = left.iter().filter(|member| member.incarnation != incarnation).cloned();
    cluster.set_members(left.collect());
    Ok(())
}

/// Takes unowned places that this server is preferred for, and continues what is played there.
async fn adopt(parts: &Parts) -> Result<(), StoreError> {
    let cluster = &parts.cluster;
    let mut unowned = cluster.unowned().await?;
    unowned.retain(|one| cluster.is_preferred(one.place));
    // Clocked games come first: they go on without requests.
    unowned.sort_by_key(|one| !one.clocked);
    let wanted: Vec<Place> = unowned.into_iter().map(|one| one.place).collect();
    if wanted.is_empty() {
        return Ok(());
    }
    cluster.take(&wanted).await?;
    continue_taken(parts).await
}

/// Continues everything unfinished at places that this server has taken: the request that took a place continued one game of a run
/// at most, or its client is gone.
async fn continue_taken(parts: &Parts) -> Result<(), StoreError> {
    let Parts { store, cluster, registry, runs, .. } = parts;
    let wanted = cluster.take_taken();
    if wanted.is_empty() {
        return Ok(());
    }
    let unfinished = async {
        // The database may not have answered some takes.
        let mut places = cluster.take_noted(&wanted).await?;
        places.retain(|(place, owner)| *owner == cluster.incarnation() && cluster.has(*place));
        let places: Vec<Place> = places.into_iter().map(|(place, _)| place).collect();
        let unfinished = store.unfinished_at(&places).await?;
        let keys: Vec<EpisodeKey> = unfinished.iter().map(|episode| episode.episode).collect();
        let accounts = store.accounts_of(&keys).await?;
        Ok((places, unfinished, accounts))
    };
    let (places, unfinished, accounts) = match unfinished.await {
        Ok(found) => found,
        Err(error) => {
            cluster.note_taken(wanted);
            return Err(error);
        }
    };
    for (episode, owner, competition) in accounts {
        registry.host().quotas.note(episode, Party::within(competition, owner));
    }
    let episodes = registry.adopt(unfinished).await;
    tracing::info!(places = places.len(), episodes, "took over work that no server did");
    for place in places {
        if let Place::Run(run) = place {
            runs.try_advance(run).await;
        }
    }
    Ok(())
}

/// Releases idle games and runs that another server is preferred for since it joined.
async fn give_up(parts: &Parts) -> Result<(), StoreError> {
    let Parts { cluster, registry, runs, .. } = parts;
    let mut leaving: HashSet<Place> = cluster.all_places().into_iter().collect();
    leaving
        .retain(|place| !matches!(place, Place::Competition(_)) && !cluster.is_preferred(*place));
    if leaving.is_empty() {
        return Ok(());
    }
    let mut leaving = registry.idle_places(leaving);
    let of_runs: Vec<_> = leaving
        .iter()
        .filter_map(|place| match place {
            Place::Run(run) => Some(*run),
            Place::Game(_) | Place::Competition(_) => None,
        })
        .collect();
    let held = runs.hold(&of_runs);
    leaving.retain(|place| match place {
        Place::Run(run) => held.contains_key(run),
        Place::Game(_) => true,
        Place::Competition(_) => false,
    });
    leaving.retain(|place| cluster.leave(*place));
    // Whatever began before `leave` is visible now, and nothing begins any more.
    let given = registry.give_up(leaving.clone()).await?;
    for place in leaving.difference(&given) {
        cluster.stay(*place);
    }
    let given: Vec<Place> = given.into_iter().collect();
    cluster.release(&given).await?;
    if !given.is_empty() {
        tracing::info!(places = given.len(), "gave up idle games for other servers");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(incarnation: i64, clock_offset_ms: i64) -> Member {
        Member {
            incarnation,
            address: "127.0.0.1:7000".to_owned(),
            name: "a machine, process 1".to_owned(),
            version: "1".to_owned(),
            joined_at_ms: 0,
            beat_at_ms: 0,
            seen_ms_ago: 0,
            is_connected: true,
            clock_offset_ms,
            is_ready: true,
            episodes: 0,
            places: 0,
        }
    }

    /// What a server says that has seen these members for so long.
    fn leaves(members: &[Member], seconds: u64) -> bool {
        let (mut clock, start) = (OwnClock::default(), Instant::now());
        let mut seen = (0..=seconds).map(|second| start + Duration::from_secs(second));
        seen.any(|now| clock.see(members, 1, now))
    }

    #[test]
    fn a_server_whose_clock_stays_off_leaves_its_work_to_one_whose_clock_is_right() {
        let patience = CLOCK_OFF_PATIENCE.as_secs();
        let (off, right) = (member(1, -501), member(2, 500));
        assert!(leaves(&[off.clone(), right.clone()], patience));
        assert!(!leaves(&[off.clone(), right.clone()], patience - 1), "it may come back");
        assert!(!leaves(&[member(1, 500), right.clone()], 1000));
        for nobody in [
            member(2, 501),
            Member { is_ready: false, ..right.clone() },
            Member { is_connected: false, ..right },
        ] {
            assert!(!leaves(&[off.clone(), nobody], 1000), "nobody would play on");
        }
        assert!(!leaves(&[off], 1000), "nobody would play on");
    }

    #[test]
    fn a_clock_that_was_right_in_between_is_off_anew() {
        let (mut clock, start) = (OwnClock::default(), Instant::now());
        let right = member(2, 0);
        for second in 0..1000 {
            let offset = if second % 9 == 0 { 0 } else { 60_000 };
            let now = start + Duration::from_secs(second);
            assert!(!clock.see(&[member(1, offset), right.clone()], 1, now));
        }
    }
}
