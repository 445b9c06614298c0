//! `kill -9` at any moment.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::campaign::audit::{Totals, audit, integrity};
use crate::campaign::clients::{Clients, while_playing};
use swarmbench_testkit::dice::{Dice, number, seed, tell};
use swarmbench_testkit::program::{Server, Site, complaints};

/// Kills, unless `SWARMBENCH_KILLS` says otherwise.
const KILLS: u64 = 30;

/// Games that are played at once.
const TABLES: usize = 6;

/// After how many kills a copy of the database is checked as the kill left it.
const COPY_EVERY: u64 = 5;

/// The moment of a kill.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Moment {
    /// While the server starts and takes its episodes up.
    Start,
    /// Just after it was ready, while all clients look how things stand.
    Ready,
    /// Right after an act was acknowledged.
    Acknowledged,
    /// While an act is on its way, perhaps in the middle of a commit.
    Sent,
    /// Whenever.
    Any,
}

impl Moment {
    pub(crate) const ALL: [Self; 5] =
        [Self::Start, Self::Ready, Self::Acknowledged, Self::Sent, Self::Any];
}

pub(crate) async fn what_was_acknowledged_survives_every_kill() {
    let seed = seed("kills");
    let kills = number("SWARMBENCH_KILLS").unwrap_or(KILLS);
    let began = Instant::now();
    let site = Site::new();
    let clients = Clients::new(seed, site.door.clone());
    let mut tables = clients.sit_down(TABLES);
    let mut ready = Vec::new();
    let mut moments = [0; Moment::ALL.len()];
    let killing = async {
        for kill in 1..=kills {
            let dice = Dice::of(seed, &format!("kill {kill}"));
            let moment = *dice.pick(&Moment::ALL);
            let mut server = site.start();
            await_moment(moment, &mut server, &clients, &dice, &mut ready).await;
            let log = server.kill();
            assert_eq!(complaints(&log), Vec::<&String>::new(), "before kill {kill}");
            if kill.is_multiple_of(COPY_EVERY) {
                check_copy(&site).await;
            }
            moments[moment as usize] += 1;
            if kill.is_multiple_of(10) {
                let acts = *clients.acknowledged.borrow();
                println!("{kill} kills, {acts} acts, {:.0} s", began.elapsed().as_secs_f64());
            }
        }
    };
    while_playing(&mut tables, killing).await;

    // Then everything is played to its end, and must add up.
    let mut server = site.start();
    ready.push(server.ready().await);
    clients.finish(tables).await;
    let totals = audit(&site, server, &clients).await;
    assert_eq!(totals.acts, clients.counts.acknowledged.load(Ordering::SeqCst));
    show(&clients, totals, &moments, &mut ready, began.elapsed());
}

/// Waits for the moment of a kill.
async fn await_moment(
    moment: Moment,
    server: &mut Server,
    clients: &Clients,
    dice: &Dice,
    ready: &mut Vec<Duration>,
) {
    if moment == Moment::Start {
        let usual = ready.last().copied().unwrap_or(Duration::from_millis(100));
        tokio::time::sleep(dice.time(usual * 5 / 4)).await;
        return;
    }
    ready.push(server.ready().await);
    if moment == Moment::Ready {
        tokio::time::sleep(dice.time(Duration::from_millis(60))).await;
        return;
    }
    clients.all_checked(server.run).await;
    match moment {
        Moment::Acknowledged => clients.further(&clients.acknowledged, 1 + dice.below(30)).await,
        Moment::Sent => {
            clients.further(&clients.sent, 1 + dice.below(30)).await;
            tokio::time::sleep(dice.time(Duration::from_millis(4))).await;
        }
        Moment::Start | Moment::Ready | Moment::Any => {
            tokio::time::sleep(dice.time(Duration::from_millis(400))).await;
        }
    }
}

/// Checks the database as a kill left it. That takes a copy, as looking at it would already mend it.
async fn check_copy(site: &Site) {
    if site.is_on_postgres() {
        return;
    }
    let copy = tempfile::tempdir().expect("a folder");
    let db = copy.path().join("swarmbench.db");
    for (from, to) in
        [(Path::new(site.db()), &db), (&site.wal(), &copy.path().join("swarmbench.db-wal"))]
    {
        if from.exists() {
            std::fs::copy(from, to).expect("a copy");
        }
    }
    if db.exists() {
        integrity(&db).await;
    }
}

fn show(
    clients: &Clients,
    totals: Totals,
    moments: &[u64; Moment::ALL.len()],
    ready: &mut [Duration],
    taken: Duration,
) {
    ready.sort();
    let millis = |place: usize| format!("{} ms", ready[place].as_millis());
    let counts = &clients.counts;
    let mut rows = vec![("kills".to_owned(), moments.iter().sum::<u64>().to_string())];
    for (moment, count) in Moment::ALL.iter().zip(moments) {
        rows.push((format!("  at the moment {moment:?}"), count.to_string()));
    }
    for (name, value) in [
        ("acts acknowledged", &counts.acknowledged),
        ("acts that came too late", &counts.came_late),
        ("acts whose answer was lost, kept", &counts.lost_and_kept),
        ("acts whose answer was lost, not kept", &counts.lost_and_not_kept),
        ("acknowledged acts sent again and confirmed", &counts.confirmed),
        ("creations sent again", &counts.creations_repeated),
        ("clients that found all in order after a restart", &counts.checked_after_restart),
        ("states compared", &counts.states_compared),
    ] {
        rows.push((name.to_owned(), value.load(Ordering::SeqCst).to_string()));
    }
    rows.extend([
        ("episodes finished, journals verified".to_owned(), totals.episodes.to_string()),
        ("rounds".to_owned(), totals.rounds.to_string()),
        ("acts of players in the journals".to_owned(), totals.acts.to_string()),
        ("acts of clocks in the journals".to_owned(), totals.acts_by_clock.to_string()),
        ("starts that got ready".to_owned(), ready.len().to_string()),
        ("time to ready, least".to_owned(), millis(0)),
        ("time to ready, median".to_owned(), millis(ready.len() / 2)),
        ("time to ready, most".to_owned(), millis(ready.len() - 1)),
        ("whole campaign".to_owned(), format!("{:.0} s", taken.as_secs_f64())),
    ]);
    println!();
    for (name, value) in rows {
        println!("{name:<50}{value:>10}");
    }
    tell(&format!("kills: {} kills, all was in order", moments.iter().sum::<u64>()));
}
