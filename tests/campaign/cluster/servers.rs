//! Three servers on one database, each behind proxies of its own, and what the database knows of them.

use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use sqlx::postgres::PgConnection;
use swarmbench_testkit::dice::{Dice, tell};
use swarmbench_testkit::postgres::{OwnServer, Scratch};
use swarmbench_testkit::program::{PATIENCE, Server, Site, complaints, program};
use tempfile::TempDir;

use crate::campaign::doors::Doors;
use crate::campaign::ledger::{Ledger, Played};
use crate::campaign::proxy::Proxy;

/// Servers of the cluster.
pub(crate) const SERVERS: usize = 3;

/// The exit code of a server that others have taken over.
const START_AGAIN: i32 = 75;

/// Last words of an excluded server.
const EXCLUDED: &str = "the other servers have excluded this one";

/// Permitted complaints of a server that was taken over.
const REASONS_OF_EXCLUDED: [&str; 3] = [
    EXCLUDED,
    "another server has taken the database over",
    "the actor of an episode has ended: the episode is recovered from the journal",
];

/// Permitted complaints of a server while others die, and while it does not reach them or the database.
const REASONS: [&str; 20] = [
    "a server is dead: the others take its work over",
    "the work of a server that may be dead cannot be taken over",
    "work that no server does cannot be taken over",
    "idle games and runs cannot be released",
    "another server cannot be reached from this one",
    "the database does not answer: this server cannot renew its lease",
    "the database is not reached",
    "the database does not answer, as a commit that waits for a standby",
    "canceling the wait for synchronous replication",
    "sqlx_core::pool",
    "sqlx::pool::acquire",
    // A session of a dead server that has just ended by itself.
    "is not a PostgreSQL backend process",
    "competitions that have closed cannot be listed",
    "runs cannot be advanced",
    "old changes cannot be deleted",
    "boards cannot be read",
    "games that have ended cannot be measured; trying again",
    "a game is not measured",
    "a request failed",
    "answered status=503",
];

/// One server, whichever process it is.
pub(crate) struct Slot {
    site: Site,
    /// Between it and the database.
    pub(crate) database: Proxy,
    /// Between the others and it.
    pub(crate) peers: Proxy,
    listens: u16,
    server: Option<Server>,
}

pub(crate) struct Cluster {
    slots: Vec<Slot>,
    pub(crate) doors: Arc<Doors>,
    pub(crate) scratch: Scratch,
    /// Connection of the test itself, past all proxies.
    connection: PgConnection,
    folder: TempDir,
    /// Take-overs of a server that was alive.
    pub(crate) exclusions: u64,
    /// The PostgreSQL of this campaign alone, whose settings faults change.
    server: Option<OwnServer>,
}

/// A port that no program has, below those that the host gives to connections. No two tests of this run get the same one, also
/// before they listen there.
pub(crate) fn free_port() -> u16 {
    static DRAWN: AtomicU32 = AtomicU32::new(0);
    loop {
        // Another run may have its ports still.
        let number =
            std::process::id().wrapping_mul(97).wrapping_add(DRAWN.fetch_add(1, Ordering::Relaxed));
        let port = 20_000 + u16::try_from(number % 12_000).expect("small");
        if std::net::TcpListener::bind(("127.0.0.1", port)).is_ok() {
            return port;
        }
    }
}

impl Cluster {
    pub(crate) async fn new(seed: u64) -> Self {
        let server = rustix::process::geteuid().is_root().then(OwnServer::start);
        let scratch = match &server {
            Some(server) => Scratch::in_server(&server.url()).await,
            None => Scratch::new().await.expect("the tests run on PostgreSQL"),
        };
        let database = Scratch::address_of(scratch.url());
        let mut slots = Vec::new();
        for _ in 0..SERVERS {
            let database = Proxy::before(database.clone()).await;
            let listens = free_port();
            let peers = Proxy::at(free_port(), format!("127.0.0.1:{listens}")).await;
            let site = Site::at(scratch.url_at(database.address));
            slots.push(Slot { site, database, peers, listens, server: None });
        }
        let doors = slots.iter().map(|slot| Arc::clone(&slot.site.door)).collect();
        let folder = TempDir::new().expect("a folder");
        std::fs::write(folder.path().join("secret"), "a secret of the campaign").expect("a file");
        let connection = scratch.connect().await;
        let doors = Doors::new(seed, doors);
        Self { slots, doors, scratch, connection, folder, exclusions: 0, server }
    }

    /// True if the settings of PostgreSQL are those of this campaign alone.
    pub(crate) const fn has_own_server(&self) -> bool {
        self.server.is_some()
    }

    pub(crate) fn slot(&self, slot: usize) -> &Slot {
        &self.slots[slot]
    }

    pub(crate) fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// The file with the secret that all of them have.
    pub(crate) fn secret(&self) -> String {
        self.folder.path().join("secret").display().to_string()
    }

    pub(crate) fn start(&mut self, slot: usize) {
        let secret = self.secret();
        let Slot { site, peers, listens, server, .. } = &mut self.slots[slot];
        assert!(server.is_none(), "it runs");
        peers.open();
        let (address, listen) = (peers.address.to_string(), format!("127.0.0.1:{listens}"));
        let mut command = Command::new(program());
        command.env("RUST_LOG", "info");
        let options = [
            "--cluster-address",
            &address,
            "--cluster-listen",
            &listen,
            "--cluster-secret-file",
            &secret,
        ];
        *server = Some(site.start_by(command, &options));
    }

    /// Waits until a server takes games.
    pub(crate) async fn ready(&mut self, slot: usize) -> Duration {
        self.server(slot).ready().await
    }

    pub(crate) async fn start_all(&mut self) {
        for slot in 0..SERVERS {
            if self.slots[slot].server.is_none() {
                self.start(slot);
            }
        }
        for slot in 0..SERVERS {
            self.ready(slot).await;
        }
    }

    fn server(&mut self, slot: usize) -> &mut Server {
        self.slots[slot].server.as_mut().expect("it runs")
    }

    /// `kill -9`. What it had of ports is refused when this returns.
    pub(crate) fn kill(&mut self, slot: usize) {
        let server = self.slots[slot].server.take().expect("it runs");
        let log = server.kill();
        self.slots[slot].peers.leave();
        check_log(slot, &log, &[]);
    }

    /// SIGTERM; the server must end well. It takes no request any more once it was told.
    pub(crate) async fn stop(&mut self, slot: usize) -> Duration {
        let server = self.slots[slot].server.take().expect("it runs");
        let (status, taken, log) = server.terminate().await;
        self.slots[slot].peers.leave();
        assert_eq!(status.code(), Some(0), "server {slot}: {log:#?}");
        check_log(slot, &log, &[]);
        taken
    }

    pub(crate) fn freeze(&mut self, slot: usize) {
        self.doors.excuse(slot, true);
        self.server(slot).freeze();
    }

    pub(crate) fn thaw(&mut self, slot: usize) {
        self.server(slot).thaw();
    }

    /// From now on a server may be taken over, and ends then.
    pub(crate) fn expect_exclusion(&mut self, slot: usize) {
        let run = self.server(slot).run;
        self.slots[slot].site.door.expect_end(run);
    }

    /// Does what supervisors do: a server that has ended because it was taken over is started again, and all get ready.
    pub(crate) async fn mend(&mut self) {
        for slot in 0..SERVERS {
            if self.slots[slot].server.is_some() && self.incarnation(slot).await.is_none() {
                // It is about to notice.
                let began = Instant::now();
                while self.server(slot).exit().is_none() {
                    assert!(
                        began.elapsed() < PATIENCE,
                        "server {slot} was taken over and goes on: {:#?}",
                        self.server(slot).log()
                    );
                    tokio::time::sleep(Duration::from_millis(10)).await;
                }
            }
            if let Some(status) = self.slots[slot].server.as_mut().and_then(Server::exit) {
                let run = self.server(slot).run;
                let may_end = self.slots[slot].site.door.has_ended(run);
                let log = self.slots[slot].server.take().expect("it ran").kill();
                assert!(may_end, "server {slot} ended by itself: {status:?} {log:#?}");
                assert_eq!(status.code(), Some(START_AGAIN), "server {slot}: {log:#?}");
                assert!(log.iter().any(|line| line.contains(EXCLUDED)), "{slot}: {log:#?}");
                check_log(slot, &log, &REASONS_OF_EXCLUDED);
                self.exclusions += 1;
                self.start(slot);
            }
        }
        self.start_all().await;
        for slot in 0..SERVERS {
            self.doors.excuse(slot, false);
        }
    }

    /// The servers, as the database has them: number and address.
    async fn addresses(&mut self) -> Vec<(i64, String)> {
        sqlx::query_as("SELECT incarnation, address FROM members ORDER BY incarnation")
            .fetch_all(&mut self.connection)
            .await
            .expect("servers")
    }

    /// Servers that play together now.
    pub(crate) async fn servers(&mut self) -> Vec<i64> {
        self.addresses().await.into_iter().map(|(incarnation, _)| incarnation).collect()
    }

    /// The number of a server, if it is in the cluster.
    pub(crate) async fn incarnation(&mut self, slot: usize) -> Option<i64> {
        let address = self.slots[slot].peers.address.to_string();
        let servers = self.addresses().await;
        servers.into_iter().find(|(_, of)| *of == address).map(|(incarnation, _)| incarnation)
    }

    /// The servers that play games that have not ended, each once per game.
    pub(crate) async fn owners(&mut self) -> Vec<usize> {
        let servers = self.addresses().await;
        let owners: Vec<i64> = sqlx::query_scalar(
            "SELECT p.owner FROM places p JOIN episodes e ON e.key = p.key
             WHERE p.kind = 0 AND e.ended_at IS NULL ORDER BY p.key",
        )
        .fetch_all(&mut self.connection)
        .await
        .expect("owners");
        let slot = |owner: i64| {
            let (_, address) = servers.iter().find(|(incarnation, _)| *incarnation == owner)?;
            self.slots.iter().position(|slot| slot.peers.address.to_string() == *address)
        };
        owners.into_iter().filter_map(slot).collect()
    }

    /// The games that a server plays at this moment, as clients know them.
    pub(crate) async fn played_by(&mut self, slot: usize, ledger: &Ledger) -> Vec<Arc<Played>> {
        let Some(incarnation) = self.incarnation(slot).await else { return Vec::new() };
        let ids: Vec<String> = sqlx::query_scalar(
            "SELECT e.id FROM places p JOIN episodes e ON e.key = p.key
             WHERE p.kind = 0 AND e.ended_at IS NULL AND p.owner = $1",
        )
        .bind(incarnation)
        .fetch_all(&mut self.connection)
        .await
        .expect("games");
        let mut running = ledger.running();
        running.retain(|played| ids.contains(&played.created.id));
        running
    }

    /// Ends sessions of the servers: each with a chance of one in `of`, and at least one.
    pub(crate) async fn end_sessions(&mut self, dice: &Dice, of: usize) -> usize {
        let all: Vec<i32> = sqlx::query_scalar(
            "SELECT pid FROM pg_stat_activity
             WHERE datname = current_database() AND pid <> pg_backend_pid() ORDER BY pid",
        )
        .fetch_all(&mut self.connection)
        .await
        .expect("sessions");
        let mut chosen: Vec<i32> = all.iter().copied().filter(|_| dice.one_in(of)).collect();
        if chosen.is_empty() {
            chosen.push(*dice.pick(&all));
        }
        for pid in &chosen {
            let end = sqlx::query("SELECT pg_terminate_backend($1)").bind(pid);
            end.execute(&mut self.connection).await.expect("it may end them");
        }
        chosen.len()
    }

    async fn number(&mut self, statement: &'static str) -> i64 {
        sqlx::query_scalar(statement).fetch_one(&mut self.connection).await.expect("a number")
    }

    /// Waits until each game that has not ended is played by exactly one server, and nothing belongs to anybody else.
    pub(crate) async fn settle(&mut self) {
        let began = Instant::now();
        loop {
            let strays = self
                .number("SELECT count(*) FROM places WHERE owner NOT IN (SELECT incarnation FROM members)")
                .await;
            assert_eq!(strays, 0, "somebody who is not in the cluster has places");
            let nobodys = self
                .number(
                    "SELECT count(*) FROM episodes e WHERE e.ended_at IS NULL AND e.run IS NULL
                         AND NOT EXISTS (SELECT 1 FROM places p WHERE p.kind = 0 AND p.key = e.key)",
                )
                .await;
            let twice = self
                .number("SELECT count(*) FROM (SELECT 1 FROM places GROUP BY kind, key HAVING count(*) > 1) AS t")
                .await;
            assert_eq!(twice, 0, "a place has two owners");
            if nobodys == 0 {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "nobody plays {nobodys} games");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Waits until the servers have given back what is over.
    pub(crate) async fn all_given_back(&mut self) {
        let began = Instant::now();
        loop {
            let kept = self.number("SELECT count(*) FROM places WHERE kind = 0").await;
            if kept == 0 {
                return;
            }
            assert!(began.elapsed() < PATIENCE, "{kept} places of games that are over are kept");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
}

impl Drop for Cluster {
    /// Keeps the logs of a run that has failed.
    fn drop(&mut self) {
        if !std::thread::panicking() {
            return;
        }
        let kept = TempDir::new().map(TempDir::keep);
        let Ok(kept) = kept else { return };
        for (number, slot) in self.slots.iter_mut().enumerate() {
            let Some(server) = &mut slot.server else { continue };
            let ended = format!("ended by itself: {:?}", server.exit());
            let log = server.log().join("\n");
            drop(std::fs::write(
                kept.join(format!("server-{number}")),
                format!("{log}\n{ended}\n"),
            ));
        }
        tell(&format!("the logs of the servers are kept: {}", kept.display()));
    }
}

/// Nothing may be in a log that nobody expects.
fn check_log(slot: usize, log: &[String], further: &[&str]) {
    assert!(!log.iter().any(|line| line.contains("panicked")), "server {slot}: {log:#?}");
    let has_reason = |line: &&String| {
        let mut reasons = REASONS.iter().chain(further);
        reasons.any(|reason| line.contains(reason))
    };
    let unexpected: Vec<_> = complaints(log).into_iter().filter(|line| !has_reason(line)).collect();
    assert_eq!(unexpected, Vec::<&String>::new(), "server {slot}");
}
