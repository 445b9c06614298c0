//! Duties of a server: it takes places without an owner, resumes unfinished work there, and releases idle places.

use super::{Others as _, Port};
use crate::cluster::{number_of, preferred};
use crate::ids::Place;
use crate::store::StoreError;

/// Takes unowned places that this server is to keep, and resumes what is unfinished there.
pub(super) async fn adopt<P: Port + Sync>(port: &P) -> Result<(), StoreError> {
    let unowned = port.unowned().await?;
    let (me, servers) = (port.me(), port.others().servers());
    let is_own = |place: &Place| port.places().keeper(*place, me, &servers) == Some(me);
    port.places().note_taken(unowned.into_iter().filter(is_own));
    resume_taken(port).await
}

/// Resumes everything unfinished at places that this server has taken: the request that took a place resumed one game of a run at
/// most, or its client is gone.
pub(super) async fn resume_taken<P: Port + Sync>(port: &P) -> Result<(), StoreError> {
    let wanted = port.places().drain_taken();
    if wanted.is_empty() {
        return Ok(());
    }
    let resumed = async {
        // The database may not have answered some takes.
        let owners = port.take(&wanted).await?;
        let is_own = |(place, owner): &(Place, _)| *owner == port.me() && port.places().has(*place);
        let owned: Vec<Place> = owners.into_iter().filter(is_own).map(|(place, _)| place).collect();
        port.resume(&owned).await
    };
    let resumed = resumed.await;
    if resumed.is_err() {
        port.places().note_taken(wanted);
    }
    resumed
}

/// Releases places where everything has ended, and idle ones that another server is preferred for since it joined.
pub(super) async fn tidy<P: Port + Sync>(port: &P) -> Result<(), StoreError> {
    port.release_ended().await?;
    let mut leaving = port.places().all();
    // Its tokens lead to the server that took a place, so a place moves to no server that was there before.
    let servers = port.others().servers();
    let moves = |place| {
        let preferred = preferred(&servers, number_of(place));
        preferred.is_some_and(|server| port.places().is_older(place, server))
    };
    leaving.retain(|place| !matches!(place, Place::Competition(_)) && moves(*place));
    if leaving.is_empty() {
        return Ok(());
    }
    let (mut leaving, _held) = port.idle(leaving);
    leaving.retain(|place| port.places().leave(*place));
    // Whatever began before that is visible now, and nothing begins any more.
    let evicted = port.evict(&leaving).await?;
    let stays = leaving.into_iter().filter(|place| !evicted.contains(place));
    stays.for_each(|place| port.places().stay(place));
    let evicted: Vec<Place> = evicted.into_iter().collect();
    port.release(&evicted).await?;
    if !evicted.is_empty() {
        tracing::info!(places = evicted.len(), "gave up idle games for other servers");
    }
    Ok(())
}
