//! Three servers on one PostgreSQL: they are killed, stopped, cut off from the database and from each other, and the database goes
//! away. Clients ask any of them, and everything that holds for one server must hold for all of them together.

pub(crate) mod refusals;
mod servers;
mod times;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use swarmbench::store::Location;
use swarmbench_testkit::dice::{Dice, number, seed, tell};
use swarmbench_testkit::postgres::Standby;
use swarmbench_testkit::program::PATIENCE;

use crate::campaign::audit::{Totals, check_database, journals};
use crate::campaign::clients::{Clients, while_playing};
use crate::campaign::kills::Moment;
use crate::campaign::ledger::Played;
use crate::campaign::proxy::{Proxy, Way};
use servers::{Cluster, SERVERS};
use times::{Kind, Times};

/// Faults of a kind, unless `SWARMBENCH_CLUSTER_KILLS`, `_STOPS` and `_PARTITIONS` say otherwise.
const FEW: u64 = 5;

/// Games that are played at once.
const TABLES: usize = 6;

/// Durations of stops: the others take a server over after 6 s. The last one only where there are many.
const STOPS: [Duration; 3] =
    [Duration::from_secs(3), Duration::from_secs(7), Duration::from_secs(30)];

/// Durations of cuts.
const CUTS: [Duration; 3] =
    [Duration::from_secs(3), Duration::from_secs(8), Duration::from_secs(20)];

/// Absence of the database, in a short run and in a long one.
const AWAY: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(20)];

/// After this time nobody is taken over by mistake any more.
const NOBODY_LATER: Duration = Duration::from_secs(8);

/// A server that is not seen for a shorter time keeps what it plays.
const KEPT: Duration = Duration::from_secs(4);

/// After how many faults the times so far are shown.
const SHOWN_EVERY: usize = 25;

/// Delay of a slow network, each way.
const SLOW: Duration = Duration::from_millis(100);

/// Kinds of faults.
#[derive(Clone, Copy, Debug)]
enum Fault {
    /// `kill -9` of the server that plays some game.
    Kill(Moment),
    KillTwo,
    /// SIGSTOP, and SIGCONT after a while.
    Stop(Duration),
    /// Between a server and the database.
    DatabaseCut(Break, Duration),
    /// Between a server and the others.
    ServersCut(Apart, Duration),
    /// Sessions of any servers are ended by the database.
    Sessions,
    /// The database is away from all servers.
    DatabaseAway(Duration),
    /// Commits wait for a standby that is away. Its sessions that wait are ended, or not.
    StandbyAway(Duration, Sessions),
    /// SIGTERM of the server that plays some game.
    Graceful,
    /// Each is stopped and started again, one after the other.
    Rolling,
    /// All are killed at once.
    All,
}

/// Fate of sessions that wait for a standby.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sessions {
    Wait,
    Ended,
}

/// Ways in which a server does not reach the database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Break {
    /// Connections break, and no others can be made.
    Broken,
    Held,
    QuestionsHeld,
    AnswersHeld,
    QuestionsLost,
    AnswersLost,
    /// The network is slow, and works.
    Slow,
}

impl Break {
    const ALL: [Self; 7] = [
        Self::Broken,
        Self::Held,
        Self::QuestionsHeld,
        Self::AnswersHeld,
        Self::QuestionsLost,
        Self::AnswersLost,
        Self::Slow,
    ];

    fn begin(self, proxy: &Proxy) {
        match self {
            Self::Broken => {
                proxy.close();
                proxy.break_all();
            }
            Self::Held => proxy.set_ways(Way::Held, Way::Held),
            Self::QuestionsHeld => proxy.set_ways(Way::Held, Way::Open),
            Self::AnswersHeld => proxy.set_ways(Way::Open, Way::Held),
            Self::QuestionsLost => proxy.set_ways(Way::Lost, Way::Open),
            Self::AnswersLost => proxy.set_ways(Way::Open, Way::Lost),
            Self::Slow => proxy.set_delay(SLOW),
        }
    }

    fn end(self, proxy: &Proxy) {
        if matches!(self, Self::QuestionsLost | Self::AnswersLost) {
            proxy.break_all();
        }
        proxy.open();
    }
}

/// Ways in which servers do not reach each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Apart {
    /// The host of one refuses connections of the others.
    Refused,
    /// Connections to one break, and no others can be made.
    Broken,
    /// Requests to one server, and its answers, are held.
    Held,
    QuestionsHeld,
    AnswersHeld,
    /// Requests of one server to the others are held; they reach it.
    OutgoingHeld,
    /// Two do not reach each other, and both reach the third one.
    Pair,
}

impl Apart {
    const ALL: [Self; 7] = [
        Self::Held,
        Self::Refused,
        Self::Broken,
        Self::OutgoingHeld,
        Self::QuestionsHeld,
        Self::Pair,
        Self::AnswersHeld,
    ];
}

/// Numbers of faults.
struct Setting {
    kills: u64,
    stops: u64,
    partitions: u64,
}

impl Setting {
    fn of_environment() -> Self {
        Self {
            kills: number("SWARMBENCH_CLUSTER_KILLS").unwrap_or(FEW),
            stops: number("SWARMBENCH_CLUSTER_STOPS").unwrap_or(FEW),
            partitions: number("SWARMBENCH_CLUSTER_PARTITIONS").unwrap_or(FEW),
        }
    }

    /// All faults in an order of the seed.
    fn faults(&self, seed: u64, has_own_server: bool) -> Vec<Fault> {
        let is_long = |count: u64| count > FEW;
        let one_of = |all: &[Duration], number: u64, of: u64| {
            let few = if is_long(of) { all.len() } else { 2 };
            all[usize::try_from(number).expect("few") % few]
        };
        let nth = |number: u64, of: usize| usize::try_from(number).expect("few") % of;
        let mut faults = Vec::new();
        faults.extend((0..self.kills).map(|number| match number % 8 {
            7 => Fault::KillTwo,
            _ => Fault::Kill(Moment::ALL[nth(number, Moment::ALL.len())]),
        }));
        faults
            .extend((0..self.stops).map(|number| Fault::Stop(one_of(&STOPS, number, self.stops))));
        let from = Dice::of(seed, "partitions").below(7) as u64;
        faults.extend((0..self.partitions).map(|number| {
            let (way, time) = (from + number / 2, one_of(&CUTS, number / 2, self.partitions));
            if number.is_multiple_of(2) {
                Fault::DatabaseCut(Break::ALL[nth(way, Break::ALL.len())], time)
            } else {
                Fault::ServersCut(Apart::ALL[nth(way, Apart::ALL.len())], time)
            }
        }));
        let away = AWAY[usize::from(is_long(self.kills.max(self.stops).max(self.partitions)))];
        let some = |per: u64, least: u64, fault: Fault| {
            std::iter::repeat_n(fault, usize::try_from((self.kills / per).max(least)).expect("few"))
        };
        faults.extend(some(10, 2, Fault::Sessions));
        faults.extend(some(10, 2, Fault::Graceful));
        faults.extend(some(50, 1, Fault::Rolling));
        faults.extend(some(50, 1, Fault::All));
        faults.extend(some(100, 1, Fault::DatabaseAway(away)));
        if has_own_server {
            faults.extend(some(100, 1, Fault::StandbyAway(2 * away, Sessions::Wait)));
            faults.extend(some(100, 1, Fault::StandbyAway(2 * away, Sessions::Ended)));
        }
        if let Ok(only) = std::env::var("SWARMBENCH_CLUSTER_ONLY") {
            faults.retain(|fault| format!("{fault:?}").contains(&only));
        }
        let dice = Dice::of(seed, "order");
        for last in (1..faults.len()).rev() {
            faults.swap(last, dice.below(last + 1));
        }
        faults
    }
}

/// The cluster, those who play, and how long they waited.
struct Campaign {
    cluster: Cluster,
    clients: Arc<Clients>,
    times: Times,
}

pub(crate) async fn servers_lose_nothing_and_play_nothing_twice() {
    let seed = seed("cluster");
    let cluster = Cluster::new(seed).await;
    let began = Instant::now();
    let clients = Clients::of_several(seed, Arc::clone(&cluster.doors));
    let mut campaign = Campaign { cluster, clients: Arc::clone(&clients), times: Times::default() };
    campaign.cluster.start_all().await;
    let mut tables = clients.sit_down(TABLES);
    let faults = Setting::of_environment().faults(seed, campaign.cluster.has_own_server());
    while_playing(&mut tables, async {
        for (number, fault) in faults.iter().enumerate() {
            let dice = Dice::of(seed, &format!("fault {number}"));
            let (before, acts) = (Instant::now(), *clients.acknowledged.borrow());
            print!("{:>4}/{} {fault:?}", number + 1, faults.len());
            campaign.suffer(*fault, &dice).await;
            println!(
                ": {:.1} s, {} acts, {:.0} s in all",
                before.elapsed().as_secs_f64(),
                *clients.acknowledged.borrow() - acts,
                began.elapsed().as_secs_f64(),
            );
            if (number + 1) % SHOWN_EVERY == 0 {
                campaign.times.show();
            }
        }
    })
    .await;
    clients.finish(tables).await;
    clients.judge_late_answers().await;
    let totals = journals(&clients).await;
    assert_eq!(totals.acts, clients.counts.acknowledged.load(Ordering::SeqCst));
    let Campaign { cluster, times, .. } = &mut campaign;
    cluster.all_given_back().await;
    for slot in 0..SERVERS {
        cluster.stop(slot).await;
    }
    assert_eq!(cluster.servers().await, Vec::<i64>::new(), "they have left");
    let location: Location = cluster.scratch.url().parse().expect("a location");
    check_database(location).await;
    show(&clients, totals, &faults, times, cluster, began.elapsed());
    times.check();
}

impl Campaign {
    /// Makes a fault, waits until all games that it concerns go on, mends what is broken, and lets all clients look whether
    /// everything is as it was.
    async fn suffer(&mut self, fault: Fault, dice: &Dice) {
        self.clients.further(&self.clients.acknowledged, 1 + dice.below(10)).await;
        match fault {
            Fault::Kill(moment) => self.kill(moment, dice).await,
            Fault::KillTwo => self.kill_two(dice).await,
            Fault::Stop(time) => self.stop(time, dice).await,
            Fault::DatabaseCut(way, time) => self.cut_database(way, time, dice).await,
            Fault::ServersCut(way, time) => self.cut_servers(way, time, dice).await,
            Fault::Sessions => self.end_sessions(dice).await,
            Fault::DatabaseAway(time) => self.take_database_away(time).await,
            Fault::StandbyAway(time, sessions) => self.take_standby_away(time, sessions).await,
            Fault::Graceful => {
                let victim = self.victim(dice).await;
                self.stop_well(victim, Kind::Graceful).await;
            }
            Fault::Rolling => {
                for slot in 0..SERVERS {
                    self.stop_well(slot, Kind::Rolling).await;
                    self.cluster.mend().await;
                }
            }
            Fault::All => self.kill_all(dice).await,
        }
        let broken = Instant::now();
        self.cluster.mend().await;
        self.cluster.settle().await;
        let mended = Instant::now();
        let epoch = self.cluster.doors.next_epoch();
        self.clients.all_checked(epoch).await;
        print!(
            ", mended in {:.1} s, looked over in {:.1} s",
            (mended - broken).as_secs_f64(),
            mended.elapsed().as_secs_f64(),
        );
    }

    /// The server that plays some game.
    async fn victim(&mut self, dice: &Dice) -> usize {
        let owners = self.cluster.owners().await;
        if owners.is_empty() { dice.below(SERVERS) } else { *dice.pick(&owners) }
    }

    /// From now on it is measured how long the next receipts of these games take.
    fn begin(games: &[Arc<Played>]) -> Instant {
        let now = Instant::now();
        for played in games {
            played.await_receipt(now);
        }
        now
    }

    /// Waits until all of these games have gone on, or have ended. Players with a clock may let it run out, so they are waited
    /// for and not measured.
    async fn go_on(&mut self, kind: Kind, games: &[Arc<Played>]) {
        let began = Instant::now();
        for played in games {
            while played.next_receipt().is_none() && !played.has_ended() {
                assert!(began.elapsed() < PATIENCE, "{kind:?}: {} does not go on", played.name());
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            if let Some(taken) = played.next_receipt()
                && !played.game.is_clocked()
            {
                self.times.note(kind, taken);
            }
        }
    }

    async fn kill(&mut self, moment: Moment, dice: &Dice) {
        let clients = Arc::clone(&self.clients);
        let victim = self.victim(dice).await;
        let games = self.cluster.played_by(victim, &clients.ledger).await;
        match moment {
            Moment::Acknowledged => {
                clients.further(&clients.acknowledged, 1 + dice.below(5)).await;
            }
            Moment::Sent => {
                clients.further(&clients.sent, 1 + dice.below(5)).await;
                tokio::time::sleep(dice.time(Duration::from_millis(4))).await;
            }
            Moment::Start | Moment::Ready => {}
            Moment::Any => tokio::time::sleep(dice.time(Duration::from_millis(100))).await,
        }
        self.cluster.kill(victim);
        Self::begin(&games);
        if matches!(moment, Moment::Start | Moment::Ready) {
            self.cluster.start(victim);
            if moment == Moment::Start {
                tokio::time::sleep(dice.time(Duration::from_millis(400))).await;
            } else {
                self.cluster.ready(victim).await;
                tokio::time::sleep(dice.time(Duration::from_millis(60))).await;
            }
            self.cluster.kill(victim);
        }
        self.go_on(Kind::Killed, &games).await;
    }

    async fn kill_two(&mut self, dice: &Dice) {
        let spared = dice.below(SERVERS);
        let victims: Vec<usize> = (0..SERVERS).filter(|slot| *slot != spared).collect();
        let mut games = Vec::new();
        for victim in &victims {
            games.extend(self.cluster.played_by(*victim, &self.clients.ledger).await);
        }
        for victim in victims {
            self.cluster.kill(victim);
        }
        Self::begin(&games);
        self.go_on(Kind::TwoKilled, &games).await;
    }

    async fn kill_all(&mut self, dice: &Dice) {
        let games = self.clients.ledger.running();
        for slot in 0..SERVERS {
            self.cluster.kill(slot);
        }
        Self::begin(&games);
        tokio::time::sleep(dice.time(Duration::from_millis(300))).await;
        self.cluster.start_all().await;
        self.go_on(Kind::AllKilled, &games).await;
    }

    async fn stop_well(&mut self, victim: usize, kind: Kind) {
        let games = self.cluster.played_by(victim, &self.clients.ledger).await;
        Self::begin(&games);
        self.cluster.stop(victim).await;
        self.go_on(kind, &games).await;
    }

    async fn stop(&mut self, time: Duration, dice: &Dice) {
        let victim = self.victim(dice).await;
        let games = self.cluster.played_by(victim, &self.clients.ledger).await;
        let servers = self.cluster.servers().await;
        if time > KEPT {
            self.cluster.expect_exclusion(victim);
        }
        self.cluster.freeze(victim);
        let stopped = Self::begin(&games);
        tokio::time::sleep(time).await;
        self.cluster.thaw(victim);
        assert!(stopped.elapsed() >= time);
        let kind = if time > KEPT { Kind::StoppedForLong } else { Kind::StoppedShortly };
        self.go_on(kind, &games).await;
        if time <= KEPT {
            self.nobody_was_taken_over(&servers).await;
        }
    }

    async fn cut_database(&mut self, way: Break, time: Duration, dice: &Dice) {
        let victim = self.victim(dice).await;
        let games = self.cluster.played_by(victim, &self.clients.ledger).await;
        let servers = self.cluster.servers().await;
        let is_kept = time <= KEPT || way == Break::Slow;
        if !is_kept {
            self.cluster.expect_exclusion(victim);
        }
        way.begin(&self.cluster.slot(victim).database);
        Self::begin(&games);
        tokio::time::sleep(time).await;
        way.end(&self.cluster.slot(victim).database);
        let kind = match way {
            Break::Slow => Kind::SlowDatabase,
            _ if is_kept => Kind::CutOffShortly,
            _ => Kind::CutOffForLong,
        };
        self.go_on(kind, &games).await;
        if is_kept {
            self.nobody_was_taken_over(&servers).await;
        }
    }

    async fn cut_servers(&mut self, way: Apart, time: Duration, dice: &Dice) {
        let victim = self.victim(dice).await;
        let games = self.cluster.played_by(victim, &self.clients.ledger).await;
        let servers = self.cluster.servers().await;
        let incarnation = self.cluster.incarnation(victim).await;
        let other = (victim + 1 + dice.below(SERVERS - 1)) % SERVERS;
        let of_other = self.cluster.incarnation(other).await;
        let peers = &self.cluster.slot(victim).peers;
        match way {
            Apart::Refused => {
                peers.leave();
                peers.break_all();
            }
            Apart::Broken => {
                peers.close();
                peers.break_all();
            }
            Apart::Held => peers.set_ways(Way::Held, Way::Held),
            Apart::QuestionsHeld => peers.set_ways(Way::Held, Way::Open),
            Apart::AnswersHeld => peers.set_ways(Way::Open, Way::Held),
            Apart::OutgoingHeld => {
                for slot in self.cluster.slots() {
                    slot.peers.hold_caller(incarnation);
                }
            }
            Apart::Pair => {
                peers.hold_caller(of_other);
                self.cluster.slot(other).peers.hold_caller(incarnation);
            }
        }
        Self::begin(&games);
        tokio::time::sleep(time).await;
        for slot in self.cluster.slots() {
            slot.peers.open();
        }
        self.go_on(Kind::Apart, &games).await;
        self.nobody_was_taken_over(&servers).await;
    }

    async fn end_sessions(&mut self, dice: &Dice) {
        let games = self.clients.ledger.running();
        let servers = self.cluster.servers().await;
        Self::begin(&games);
        let of = *dice.pick(&[1, 2, 4]);
        self.cluster.end_sessions(dice, of).await;
        self.go_on(Kind::SessionsEnded, &games).await;
        self.nobody_was_taken_over(&servers).await;
    }

    async fn take_database_away(&mut self, time: Duration) {
        let games = self.clients.ledger.running();
        let servers = self.cluster.servers().await;
        for slot in self.cluster.slots() {
            Break::Broken.begin(&slot.database);
        }
        tokio::time::sleep(time).await;
        for slot in self.cluster.slots() {
            Break::Broken.end(&slot.database);
        }
        let back = Self::begin(&games);
        self.go_on(Kind::DatabaseBack, &games).await;
        // Each has to show again that it lives, before the others may think that it does not.
        tokio::time::sleep(NOBODY_LATER.saturating_sub(back.elapsed())).await;
        self.nobody_was_taken_over(&servers).await;
    }

    async fn take_standby_away(&mut self, time: Duration, sessions: Sessions) {
        let games = self.clients.ledger.running();
        let servers = self.cluster.servers().await;
        let standby = Standby::of(&self.cluster.scratch).await;
        standby.set(true).await;
        let away = tokio::time::sleep(time);
        match sessions {
            Sessions::Wait => away.await,
            // Those that servers open in their place wait and are ended as well.
            Sessions::Ended => tokio::select! {
                () = away => {}
                never = async { loop { standby.end_waiting().await } } => never,
            },
        }
        standby.set(false).await;
        let back = Self::begin(&games);
        self.go_on(Kind::StandbyBack, &games).await;
        tokio::time::sleep(NOBODY_LATER.saturating_sub(back.elapsed())).await;
        self.nobody_was_taken_over(&servers).await;
    }

    async fn nobody_was_taken_over(&mut self, before: &[i64]) {
        assert_eq!(self.cluster.servers().await, before, "somebody was taken over that lives");
    }
}

fn show(
    clients: &Clients,
    totals: Totals,
    faults: &[Fault],
    times: &Times,
    cluster: &Cluster,
    taken: Duration,
) {
    let counts = &clients.counts;
    let of = |is_one: fn(&Fault) -> bool| faults.iter().filter(|fault| is_one(fault)).count();
    let mut rows = vec![
        ("faults", faults.len() as u64),
        ("  killed", of(|fault| matches!(fault, Fault::Kill(_) | Fault::KillTwo)) as u64),
        ("  stopped", of(|fault| matches!(fault, Fault::Stop(_))) as u64),
        ("  cut off from the database", of(|fault| matches!(fault, Fault::DatabaseCut(..))) as u64),
        ("  cut off from other servers", of(|fault| matches!(fault, Fault::ServersCut(..))) as u64),
        ("  without a standby", of(|fault| matches!(fault, Fault::StandbyAway(..))) as u64),
        ("servers taken over that were alive", cluster.exclusions),
    ];
    for (name, value) in [
        ("acts acknowledged", &counts.acknowledged),
        ("acts that came too late", &counts.came_late),
        ("acts whose answer was lost, kept", &counts.lost_and_kept),
        ("acts whose answer was lost, not kept", &counts.lost_and_not_kept),
        ("acknowledged acts sent again and confirmed", &counts.confirmed),
        ("creations sent again", &counts.creations_repeated),
        ("clients that found all in order after a fault", &counts.checked_after_restart),
        ("states compared", &counts.states_compared),
        ("answers 503", &counts.unavailable),
        ("late answers, all right", &counts.late_answers),
        ("late answers 503", &counts.late_unavailable),
        ("late answers that never came", &counts.late_broken),
    ] {
        rows.push((name, value.load(Ordering::SeqCst)));
    }
    rows.extend([
        ("episodes finished, journals verified", totals.episodes),
        ("rounds", totals.rounds),
        ("acts of players in the journals", totals.acts),
        ("acts of clocks in the journals", totals.acts_by_clock),
        ("whole campaign, s", taken.as_secs()),
    ]);
    println!();
    for (name, value) in rows {
        println!("{name:<50}{value:>10}");
    }
    times.show();
    tell(&format!(
        "cluster: {} faults, {} acts acknowledged, all was in order, {:.0} s",
        faults.len(),
        totals.acts,
        taken.as_secs_f64()
    ));
}
