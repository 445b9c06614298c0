//! Entries into competitions, and the attempts of those who entered.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::json;
use tokio::time::{Duration, sleep};

use super::{Addresses, Ctx, on_connections};
use crate::attacks::measure::cpu_s;
use crate::attacks::wire::{Request, Source};

/// Attempts that all places take, with 64 games at a time.
const ATTEMPTS: usize = 320;

/// Accounts of one competition that have all places which it may have.
const ACCOUNTS: usize = 60;

/// Networks of the site that enters.
const SITE_NETWORKS: u16 = 256;

/// Connections on which they are started.
const STARTERS: usize = 16;

/// Entrants of another competition start their attempts until there is no place for anybody.
pub(super) async fn places(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("places");
    let cup = ctx.brief.open_cup.clone();
    let started = Arc::new(AtomicUsize::new(0));
    ctx.go().await;
    let attempts = ctx.of(12, ATTEMPTS);
    on_connections(STARTERS, |number| {
        let (ctx, cup, started) = (Arc::clone(&ctx), cup.clone(), Arc::clone(&started));
        async move {
            let mut wire = ctx.wire(addresses, number);
            for entrant in (number..attempts).step_by(STARTERS) {
                let body = json!({ "name": format!("places {entrant}"), "model": "many" });
                let Ok(key) = ctx.enter(&mut wire, &cup, &body).await else { continue };
                if ctx.start(&mut wire, &cup, &key).await.is_ok() {
                    started.fetch_add(1, Ordering::SeqCst);
                }
            }
        }
    })
    .await;
    ctx.note(format!("{} attempts were started", started.load(Ordering::SeqCst)));
    Ok(())
}

/// Entrants of the honest one's competition take all places that it may have, and each that becomes free.
pub(super) async fn many_accounts(ctx: Arc<Ctx>) -> io::Result<()> {
    ctx.go().await;
    on_connections(ACCOUNTS, |number| {
        let ctx = Arc::clone(&ctx);
        async move {
            let (cup, mut wire) = (ctx.brief.cup.clone(), ctx.wire(Addresses::Many, number));
            let body = json!({ "name": format!("account {number}"), "model": "many" });
            let key = ctx.enter(&mut wire, &cup, &body).await.unwrap_or_default();
            let start = Request::post(format!("/api/v1/competitions/{cup}/attempts"), &json!({}));
            let start = start.with(&key);
            for again in 0.. {
                let is_later = wire.ask(&start).await.is_ok_and(|answer| answer.is_later());
                if again == 0 {
                    ctx.take_one(ACCOUNTS);
                }
                if !is_later {
                    return;
                }
                sleep(Duration::from_millis(100)).await;
            }
        }
    })
    .await;
    Ok(())
}

/// All of a site enters the honest one's competition, each time from another address of its /64 networks.
pub(super) async fn one_site(ctx: Arc<Ctx>) -> io::Result<()> {
    let [next, entered] = [0, 0].map(|none| Arc::new(AtomicUsize::new(none)));
    let path = format!("/api/v1/competitions/{}/entrants", ctx.brief.cup);
    ctx.go().await;
    let entering = on_connections(STARTERS, |number| {
        let (ctx, path) = (Arc::clone(&ctx), path.clone());
        let (next, entered) = (Arc::clone(&next), Arc::clone(&entered));
        async move {
            let mut wire = ctx.wire(Addresses::Many, number);
            loop {
                let one = next.fetch_add(1, Ordering::SeqCst);
                let host = u16::try_from(one % usize::from(u16::MAX)).unwrap_or_default();
                wire.source = Source::in_site(host % SITE_NETWORKS, host);
                let body = json!({ "name": format!("site {one}"), "model": "many" });
                match wire.ask(&Request::post(&path, &body)).await {
                    Ok(answer) if answer.is_ok() => {
                        entered.fetch_add(1, Ordering::SeqCst);
                    }
                    _ => sleep(Duration::from_millis(10)).await,
                }
            }
        }
    });
    let noting = async {
        for seconds in 1.. {
            sleep(Duration::from_secs(1)).await;
            ctx.note(format!("{} entries after {seconds} s", entered.load(Ordering::SeqCst)));
        }
    };
    tokio::join!(entering, noting);
    Ok(())
}

/// Anybody enters, from many addresses; the server's time on the processors for each block of entries is noted.
pub(super) async fn registration(ctx: Arc<Ctx>) -> io::Result<()> {
    let block = ctx.of(50, 500);
    let cup = ctx.brief.open_cup.clone();
    let entered = Arc::new(AtomicUsize::new(0));
    let next = Arc::new(AtomicUsize::new(0));
    ctx.go().await;
    let counting = {
        let (ctx, entered) = (Arc::clone(&ctx), Arc::clone(&entered));
        async move {
            let mut before = cpu_s(ctx.brief.server);
            for blocks in 1.. {
                while entered.load(Ordering::SeqCst) < blocks * block {
                    sleep(Duration::from_millis(20)).await;
                }
                let now = cpu_s(ctx.brief.server);
                ctx.note(format!("{} entries: {:.2} s more", blocks * block, now - before));
                before = now;
            }
        }
    };
    let entering = on_connections(8, |number| {
        let (ctx, cup) = (Arc::clone(&ctx), cup.clone());
        let (entered, next) = (Arc::clone(&entered), Arc::clone(&next));
        async move {
            let mut wire = ctx.wire(Addresses::Many, number);
            loop {
                let entrant = next.fetch_add(1, Ordering::SeqCst);
                wire.source = Ctx::source(Addresses::Many, entrant);
                let body = json!({ "name": format!("entrant {entrant}"), "model": "many" });
                let enter = Request::post(format!("/api/v1/competitions/{cup}/entrants"), &body);
                match wire.ask(&enter).await {
                    Ok(answer) if answer.is_ok() => {
                        entered.fetch_add(1, Ordering::SeqCst);
                    }
                    _ => sleep(Duration::from_millis(50)).await,
                }
            }
        }
    });
    tokio::join!(counting, entering);
    Ok(())
}
