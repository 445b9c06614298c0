//! What a server does that plays together with others on one database: it says that it lives, sees who else does, takes over
//! what dead ones had and what nobody plays, and gives up what others are to play.
//!
//! All that has to be right is decided by the database ([`Cluster`]). Here is only when it is asked.

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

/// How often this server looks at the others.
const LOOKS_EVERY: Duration = Duration::from_millis(250);

/// How often it says that it lives, in looks.
const LOOKS_PER_BEAT: u32 = 4;

/// How often it looks for work that nobody does, where no server has come or gone.
const SEARCHES_EVERY: Duration = Duration::from_secs(30);

/// How often it gives up what others are to play, and what is over.
const TIDIES_EVERY: Duration = Duration::from_secs(10);

/// How often old changes are deleted.
const DELETES_EVERY: Duration = Duration::from_mins(5);

/// How long a live process may take to accept a connection.
const ACCEPT_PATIENCE: Duration = Duration::from_millis(500);

/// What a member needs to do its part.
pub struct Parts {
    pub store: Store,
    pub cluster: Arc<Cluster>,
    pub registry: Registry,
    pub runs: Runs,
    /// Whether others reach this server.
    pub is_reachable: Arc<AtomicBool>,
    /// Whether it takes nothing, and lets the others answer.
    pub forwards_only: bool,
    /// Cancelled when this server stops: it takes no more work.
    pub stop: CancellationToken,
    /// Set once it has taken the work that was there for it.
    pub ready: Arc<dyn Fn() + Send + Sync>,
    /// Called when tokens or keys were revoked, before this server acts by it.
    pub revoked: Arc<dyn Fn() + Send + Sync>,
}

/// The time of day of this host, in milliseconds.
pub fn host_ms() -> i64 {
    SystemClock.now().as_millisecond()
}

/// Does the part of this server until it is excluded, or for ever.
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

/// What was seen last.
#[derive(Clone, Default)]
struct Seen {
    members: Arc<[Member]>,
    /// Since when the database has answered all looks.
    up_since: Option<Instant>,
}

/// Says that this server lives, and looks at the others, until it is excluded.
async fn beat(parts: Arc<Parts>, look: watch::Sender<Seen>) {
    let cluster = &parts.cluster;
    let mut up_since = None;
    let mut was_off = false;
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
                note_clock(&members, cluster.incarnation(), &mut was_off);
                metrics::gauge!("swarmbench_nodes").set(count(members.len()));
                let up_since = *up_since.get_or_insert_with(Instant::now);
                look.send_replace(Seen { members, up_since: Some(up_since) });
            }
            Err(StoreError::Failed) => return parts.store.set_excluded(),
            Err(error) => {
                if up_since.is_some() || tick == 0 {
                    tracing::warn!(%error, "the database does not answer: this server cannot show that it lives");
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

/// Warns once where the clock of this machine is too far from that of the database.
fn note_clock(members: &[Member], me: i64, was_off: &mut bool) {
    let Some(own) = members.iter().find(|member| member.incarnation == me) else { return };
    let off_ms = own.clock_offset_ms;
    #[expect(clippy::cast_precision_loss, reason = "a gauge is a double")]
    metrics::gauge!("swarmbench_clock_offset_seconds").set(off_ms as f64 / 1000.0);
    let is_off = u128::from(off_ms.unsigned_abs()) > CLOCK_OFF_MAX.as_millis();
    if is_off && !*was_off {
        tracing::error!(
            off_ms,
            "the clock of this machine is too far from that of the database: synchronize both"
        );
    }
    *was_off = is_off;
}

/// Takes over what dead members had and what nobody plays, and gives up what others are to play.
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
                tracing::warn!(%error, server = member.name, "a server may be dead, and cannot be taken over");
            }
        }
        if let Err(error) = continue_taken(&parts).await {
            tracing::warn!(%error, "work that was taken cannot be continued");
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
        // One that is gone leaves places behind, also where it took no work any more.
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
                Err(error) => tracing::warn!(%error, "work that nobody does cannot be taken"),
            }
        }
        if tidied.elapsed() >= TIDIES_EVERY {
            tidied = Instant::now();
            let tidy = async {
                cluster.release_ended().await?;
                give_up(&parts).await
            };
            if let Err(error) = tidy.await {
                tracing::warn!(%error, "what others are to play cannot be given up");
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

/// What this server itself has seen of the others' beats. The clock of the database alone could be set forward.
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

    /// Whether no beat of a member has come for longer than it answers without one.
    fn is_silent(&self, member: &Member) -> bool {
        self.0.get(&member.incarnation).is_some_and(|(_, since)| since.elapsed() > ANSWERS_FOR)
    }
}

/// Whether a member could have shown meanwhile that it lives: while the database was away, none could.
fn is_long_ago(since: Instant) -> bool {
    since.elapsed() > TAKEN_OVER_AFTER
}

/// Takes a member over where it is dead.
async fn watch_over(cluster: &Cluster, member: &Member, is_silent: bool) -> Result<(), StoreError> {
    // Less than nothing of one that starts.
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

/// Whether the process of a member is gone: the database has no session of it any more, and nothing listens where it did.
/// That nothing answers shows nothing, as it may be stopped, or cut off.
pub async fn is_dead(cluster: &Cluster, member: &Member) -> bool {
    let connecting = TcpStream::connect(&member.address);
    let refused = match tokio::time::timeout(ACCEPT_PATIENCE, connecting).await {
        Ok(Err(error)) => error.kind() == ErrorKind::ConnectionRefused,
        Ok(Ok(_)) | Err(_) => false,
    };
    refused && matches!(cluster.is_connected(member.incarnation).await, Ok(false))
}

/// Takes over a member whose process is gone.
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

/// Takes what nobody plays, where it is for this server, and continues it.
async fn adopt(parts: &Parts) -> Result<(), StoreError> {
    let cluster = &parts.cluster;
    let mut unowned = cluster.unowned().await?;
    unowned.retain(|one| cluster.is_preferred(one.place));
    // Those first that go on without requests.
    unowned.sort_by_key(|one| !one.clocked);
    let wanted: Vec<Place> = unowned.into_iter().map(|one| one.place).collect();
    if wanted.is_empty() {
        return Ok(());
    }
    cluster.take(&wanted).await?;
    continue_taken(parts).await
}

/// Continues all that is unfinished where this server has taken a place: a request has taken it for one game of a run, or its
/// client is gone.
async fn continue_taken(parts: &Parts) -> Result<(), StoreError> {
    let Parts { store, cluster, registry, runs, .. } = parts;
    let wanted = cluster.take_taken();
    if wanted.is_empty() {
        return Ok(());
    }
    let unfinished = async {
        // Some takes may not have been answered.
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
    tracing::info!(places = places.len(), episodes, "took what nobody played");
    for place in places {
        if let Place::Run(run) = place {
            runs.try_advance(run).await;
        }
    }
    Ok(())
}

/// Gives up idle games and runs that another server is to play, as one has come.
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
    // Whatever was begun before is seen now, and nothing is begun any more.
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
