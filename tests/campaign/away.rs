//! PostgreSQL goes away, at any moment and for any time, and comes back: connections break with commits under way, so that
//! nobody knows whether these were done. It is a pause: nothing that was acknowledged is lost, nothing is written twice, and the
//! server does not end.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::campaign::audit::audit_after;
use crate::campaign::clients::{Clients, while_playing};
use crate::campaign::proxy::{Proxy, Way};
use swarmbench_testkit::dice::{Dice, number, seed, tell};
use swarmbench_testkit::postgres::{self, Scratch};
use swarmbench_testkit::program::{PATIENCE, Site};

/// Absences of the database, unless `SWARMBENCH_CUTS` says otherwise.
const CUTS: u64 = 12;

/// Duration of one absence. Acts that were sent before wait as long.
const LONG: Duration = Duration::from_secs(20);

/// Permitted complaints of the server while the database is away: that it is, connections that broke, and requests that had to
/// read it.
const REASONS: [&str; 4] =
    ["the database is not reached", "sqlx_core::pool", "a request failed", "answered status=503"];

/// Games that are played at once.
const TABLES: usize = 6;

/// Ways in which connections break.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    /// All at once, in both directions.
    Whole,
    /// Answers of the database are lost for a while before the connections break: commits are done, and nobody knows.
    Answers,
    /// Requests of the server are lost for a while: commits are not done, and nobody knows.
    Questions,
}

/// Breaks all connections, and refuses further ones for this time.
async fn cut(proxy: &Proxy, cut: Cut, blind: Duration, away: Duration) {
    let lost_if = |is_lost| if is_lost { Way::Lost } else { Way::Open };
    proxy.close();
    proxy.set_ways(lost_if(cut == Cut::Questions), lost_if(cut == Cut::Answers));
    if cut != Cut::Whole {
        tokio::time::sleep(blind).await;
    }
    proxy.break_all();
    tokio::time::sleep(away).await;
    proxy.open();
}

pub(crate) async fn a_database_that_goes_away_is_a_pause() {
    let url = postgres::server().expect("a server for tests");
    let seed = seed("away");
    let cuts = number("SWARMBENCH_CUTS").unwrap_or(CUTS);
    let began = Instant::now();
    let proxy = Proxy::before(Scratch::address_of(&url)).await;
    let site = Site::new().through(proxy.address);
    let mut server = site.start();
    server.ready().await;
    let clients = Clients::new(seed, site.door.clone());
    clients.expect_pauses();
    let mut tables = clients.sit_down(TABLES);
    let mut longest = Duration::ZERO;
    let cutting = async {
        for number in 1..=cuts {
            let dice = Dice::of(seed, &format!("cut {number}"));
            clients.further(&clients.acknowledged, 1 + dice.below(30)).await;
            tokio::time::sleep(dice.time(Duration::from_millis(20))).await;
            let way = *dice.pick(&[Cut::Whole, Cut::Answers, Cut::Questions]);
            let away = if number == cuts { LONG } else { dice.time(Duration::from_millis(1500)) };
            cut(&proxy, way, dice.time(Duration::from_millis(200)), away).await;
            let back = Instant::now();
            clients.further(&clients.acknowledged, 1).await;
            longest = longest.max(back.elapsed());
            assert!(longest < PATIENCE, "it does not continue");
        }
    };
    while_playing(&mut tables, cutting).await;
    clients.finish(tables).await;
    let log = server.log();
    assert!(!log.iter().any(|line| line.contains("a commit failed")), "{log:#?}");
    let lost = log.iter().filter(|line| line.contains("a commit whose answer was lost")).count();
    let totals = audit_after(&site, server, &clients, &REASONS).await;
    assert_eq!(totals.acts, clients.counts.acknowledged.load(Ordering::SeqCst));
    tell(&format!(
        "away: {cuts} cuts, {lost} commits were settled, {} acts acknowledged, {} journals verified, at most {} ms until the \
         next receipt after the database was back, {} connections, {:.0} s",
        totals.acts,
        totals.episodes,
        longest.as_millis(),
        proxy.opened(),
        began.elapsed().as_secs_f64(),
    ));
}
