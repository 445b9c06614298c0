//! The leases of servers: a server beats, watches the others, takes over places of dead ones, and gives up places
//! that others prefer.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use swarmbench::ids::Place;
use swarmbench::store::StoreError;
use swarmbench_clock::{Clock as _, after, until};
use tokio::sync::watch;

use super::{Member, Net, Node};
use crate::simulation::broken::Flaw;
use crate::simulation::database::Incarnation;

/// Interval between two looks of a server at the others.
const LOOKS_EVERY: Duration = Duration::from_millis(250);

/// Looks per beat.
const LOOKS_PER_BEAT: u32 = 4;

/// Interval between two searches for abandoned work while no server comes or goes.
const SEARCHES_EVERY: Duration = Duration::from_secs(30);

/// Interval at which a server gives up places that others prefer, and places where everything has ended.
const TIDIES_EVERY: Duration = Duration::from_secs(10);

/// Beats for a server and watches the others, until the server is excluded.
pub(crate) async fn beat(node: Arc<Node>, looked: watch::Sender<()>) {
    for tick in 0_u32.. {
        if tick.is_multiple_of(LOOKS_PER_BEAT) {
            let sent = node.clock.now();
            let (at, me, is_ready) = (|| node.lease_clock(), node.incarnation, !node.is_shut());
            let is_known = node.journal.at_database(|tables| tables.beat(me, at(), is_ready)).await;
            if !is_known {
                return node.journal.set_excluded();
            }
            let is_late = node.flaw == Some(Flaw::LeaseFromTheReply);
            node.answers_from(if is_late { node.clock.now() } else { sent });
        }
        let members = node.journal.at_database(|tables| {
            let now = node.lease_clock();
            let member =
                |(incarnation, row): (Incarnation, crate::simulation::database::Node)| Member {
                    incarnation,
                    is_expired: tables.is_expired(incarnation, now),
                    is_ready: row.is_ready,
                };
            tables.nodes().into_iter().map(member).collect()
        });
        let members = members.await;
        *node.members.lock().expect("one thread") = members;
        looked.send_replace(());
        node.clock.sleep_until(after(node.clock.now(), LOOKS_EVERY)).await;
    }
}

/// Takes over places of dead servers and places without an owner, and gives up places that others prefer.
pub(crate) async fn work(net: Arc<Net>, node: Arc<Node>, mut looked: watch::Receiver<()>) {
    let me = node.incarnation;
    let mut known: Vec<Incarnation> = Vec::new();
    let (mut searched, mut tidied) = (None, node.clock.now());
    while looked.changed().await.is_ok() {
        let members = node.members();
        for member in members.iter().filter(|member| member.incarnation != me) {
            let is_gone = !net.is_there(member.incarnation);
            if member.is_expired || is_gone {
                exclude(&node, member.incarnation, is_gone).await;
            }
        }
        // An error means that this server is excluded.
        drop(continue_taken(&node).await);
        let ready = members.iter().filter(|member| member.is_ready);
        let ready: Vec<Incarnation> = ready.map(|member| member.incarnation).collect();
        if !ready.contains(&me) {
            continue;
        }
        let now = node.clock.now();
        let is_due = searched.is_none_or(|at| until(at, now) >= SEARCHES_EVERY);
        if (ready != known || is_due) && adopt(&node).await.is_ok() {
            (known, searched) = (ready, Some(now));
        }
        if until(tidied, now) >= TIDIES_EVERY {
            tidied = now;
            node.journal.release_ended().await;
            // The next attempt tries again.
            drop(give_up(&node).await);
        }
    }
}

/// Excludes a dead server: it can no longer write, and its places are free. Does nothing if the server was seen
/// meanwhile, unless its process is gone.
pub(super) async fn exclude(node: &Node, dead: Incarnation, is_gone: bool) {
    if node.flaw == Some(Flaw::FreesPlacesFirst) {
        let frees = |tables: &mut crate::simulation::database::Tables| {
            if is_gone || tables.is_expired(dead, node.lease_clock()) {
                tables.free(dead);
            }
        };
        node.journal.at_database(frees).await;
    }
    let deletes = |tables: &mut crate::simulation::database::Tables| {
        if is_gone || tables.is_expired(dead, node.lease_clock()) {
            tables.delete(dead);
        }
    };
    node.journal.at_database(deletes).await;
    node.members.lock().expect("one thread").retain(|member| member.incarnation != dead);
}

/// Takes and continues the places without an owner that prefer this server.
async fn adopt(node: &Node) -> Result<(), StoreError> {
    let mut unowned = node.journal.at_database(|tables| tables.unowned()).await;
    unowned.retain(|one| node.preferred(Place::Game(one.episode)) == node.incarnation);
    let mut taken = Vec::new();
    for one in unowned {
        let place = Place::Game(one.episode);
        node.journal.take_place(place).await?;
        taken.push(place);
    }
    if node.flaw == Some(Flaw::ForgetsWhatItTook) {
        return continue_at(node, taken).await;
    }
    continue_taken(node).await
}

/// Continues places that this server took for a request whose client may be gone.
async fn continue_taken(node: &Node) -> Result<(), StoreError> {
    if node.flaw == Some(Flaw::ForgetsWhatItTook) {
        return Ok(());
    }
    continue_at(node, node.journal.take_taken().into_iter().collect()).await
}

async fn continue_at(node: &Node, mut places: Vec<Place>) -> Result<(), StoreError> {
    for place in &places {
        node.journal.take_noted(*place).await?;
    }
    places.retain(|place| node.journal.plays_at(*place));
    if places.is_empty() {
        return Ok(());
    }
    // Some episodes may have ended since.
    let mut unfinished = node.journal.at_database(|tables| tables.unfinished()).await;
    unfinished.retain(|one| places.contains(&Place::Game(one.episode)));
    node.registry.adopt(unfinished).await;
    Ok(())
}

/// Gives up idle games that prefer another server.
async fn give_up(node: &Node) -> Result<(), StoreError> {
    let (journal, registry) = (&node.journal, &node.registry);
    for place in journal.places() {
        if node.preferred(place) == node.incarnation {
            continue;
        }
        if node.flaw == Some(Flaw::GivesUpWhatIsUsed) {
            journal.leave(place);
            journal.release(place).await;
            continue;
        }
        if registry.idle_places(HashSet::from([place])).is_empty() {
            continue;
        }
        if !journal.leave(place) {
            continue;
        }
        let given = registry.give_up(HashSet::from([place])).await?;
        if given.is_empty() {
            journal.stay(place);
        } else {
            journal.release(place).await;
        }
    }
    Ok(())
}
