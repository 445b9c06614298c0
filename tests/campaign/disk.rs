//! Disks that fail. After a failed commit nothing is acknowledged, the server says so, and after a restart with
//! a sound disk all that was acknowledged is there and the games continue.
//!
//! The faults come from `fault.c`, which is loaded into the server by `LD_PRELOAD`, so the program under test is
//! the one that is shipped. That, and the tmpfs, need Linux; elsewhere this file is left out.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::mount::{MountFlags, UnmountFlags, mount, mount_remount, unmount};
use serde_json::json;
use swarmbench_engine::AgentId;
use swarmbench_protocol::act::{ActRequest, Receipt};
use swarmbench_protocol::episode::CreatedEpisode;
use swarmbench_testkit::dice::{Dice, seed, tell};
use swarmbench_testkit::program::{Server, Site, until};
use tempfile::TempDir;

use crate::campaign::audit::audit;
use crate::campaign::clients::{Clients, while_playing};
use crate::campaign::ledger::Played;
use crate::campaign::plan::By;
use crate::campaign::preload;

/// Games that are played at once.
const TABLES: usize = 4;

/// Attempts to have an act taken.
const TRIES: u64 = 20;

/// A disk that fails on command.
struct FaultyDisk {
    library: PathBuf,
    control: PathBuf,
    _folder: TempDir,
}

impl FaultyDisk {
    fn new() -> Self {
        let folder = TempDir::new().expect("a folder");
        let library = preload::library("fault.c", folder.path());
        Self { library, control: folder.path().join("control"), _folder: folder }
    }

    fn start(&self, site: &Site) -> Server {
        site.start_with(&[("LD_PRELOAD", &self.library), ("SWARMBENCH_FAULT", &self.control)])
    }

    /// From now on the disk fails in this way.
    fn fail(&self, kind: &str) {
        let written = self.control.with_extension("new");
        std::fs::write(&written, kind).expect("it can be written");
        std::fs::rename(&written, &self.control).expect("it can be put in place");
    }

    /// The disk is sound again.
    fn mend(&self) {
        std::fs::remove_file(&self.control).expect("it failed");
    }

    /// Number of failures.
    fn hits(&self) -> u64 {
        std::fs::metadata(self.control.with_extension("hits")).map_or(0, |file| file.len())
    }
}

/// Failures of a disk: what it is, what the library is told, and whether it is mended before the server ends.
pub(crate) const FAILURES: [(&str, &str, bool); 4] = [
    ("no_space", "enospc", true),
    ("an_error_of_the_device", "eio", false),
    ("a_torn_write", "torn", true),
    ("an_error_when_syncing", "sync", false),
];

pub(crate) async fn nothing_is_acknowledged_after_a_failed_commit(kind: &str, mends: bool) {
    let seed = seed(kind);
    let disk = FaultyDisk::new();
    let site = Site::new();
    let clients = Clients::new(seed, site.door.clone());
    let mut tables = clients.sit_down(TABLES);
    let mut server = disk.start(&site);
    let probe = while_playing(&mut tables, async {
        server.ready().await;
        let mut probe = Probe::new(&clients).await;
        let acts = 50 + Dice::of(seed, kind).below(100) as u64;
        until("clients play", || *clients.acknowledged.borrow() >= acts).await;
        let (status, text) = probe.act(&clients, 0).await;
        assert_eq!((status, disk.hits()), (200, 0), "{text}");
        probe.round = 1;
        clients.expect_failure(server.run);
        disk.fail(kind);
        probe.is_refused(&server, &clients).await;
        assert!(disk.hits() > 0);
        if mends {
            // That the disk is sound again changes nothing: nobody knows what it holds.
            disk.mend();
            probe.is_refused(&server, &clients).await;
        }
        probe
    })
    .await;
    let known = acknowledged(&clients);
    let (status, _, log) = server.terminate().await;
    assert!(status.success(), "{status}: {log:#?}");
    let mut server = site.start();
    goes_on(&mut server, &clients, known).await;
    probe.goes_on(&clients).await;
    clients.finish(tables).await;
    audit(&site, server, &clients).await;
}

pub(crate) async fn writes_that_take_only_a_part_do_no_harm() {
    let seed = seed("short");
    let disk = FaultyDisk::new();
    let site = Site::new();
    let clients = Clients::new(seed, site.door.clone());
    let mut tables = clients.sit_down(TABLES);
    disk.fail("short");
    let mut server = disk.start(&site);
    while_playing(&mut tables, async {
        server.ready().await;
        until("clients play", || *clients.acknowledged.borrow() >= 200).await;
    })
    .await;
    assert!(disk.hits() > 200, "{}", disk.hits());
    let known = acknowledged(&clients);
    server.kill();
    let mut server = site.start();
    goes_on(&mut server, &clients, known).await;
    clients.finish(tables).await;
    audit(&site, server, &clients).await;
}

pub(crate) async fn a_disk_that_is_really_full() {
    let seed = seed("full disk");
    let folder = TempDir::new().expect("a folder");
    mount("tmpfs", folder.path(), "tmpfs", MountFlags::empty(), c"size=3m")
        .expect("root may mount");
    let mounted = Mounted(folder.path().to_owned());
    let site = Site::over(folder);
    // Declared after the site, so that it is gone before the folder is removed.
    let mounted = mounted;
    let clients = Clients::new(seed, site.door.clone());
    let mut tables = clients.sit_down(TABLES);
    // Otherwise new games are refused before the disk is full.
    let mut server = site.start_with(&[("SWARMBENCH_DISK_FREE_PERCENT_MIN", Path::new("0"))]);
    clients.expect_failure(server.run);
    let probe = while_playing(&mut tables, async {
        server.ready().await;
        let mut probe = Probe::new(&clients).await;
        // They play until nothing fits any more.
        probe.play(&clients).await;
        probe.is_refused(&server, &clients).await;
        probe
    })
    .await;
    assert!(*clients.acknowledged.borrow() > 20, "it was full at once");
    let known = acknowledged(&clients);
    let (status, _, log) = server.terminate().await;
    assert!(status.success(), "{status}: {log:#?}");
    mount_remount(&mounted.0, MountFlags::empty(), "size=256m").expect("it can grow");
    let mut server = site.start();
    goes_on(&mut server, &clients, known).await;
    probe.goes_on(&clients).await;
    clients.finish(tables).await;
    audit(&site, server, &clients).await;
}

/// A file system that is taken away at the end.
struct Mounted(PathBuf);

impl Drop for Mounted {
    fn drop(&mut self) {
        if let Err(error) = unmount(&self.0, UnmountFlags::DETACH) {
            tell(&format!("{} stays mounted: {error}", Path::display(&self.0)));
        }
    }
}

/// An episode with one seat, in which every act is a round. It is played here and not by the clients, who may
/// all be waiting for something when the disk fails.
struct Probe {
    episode: CreatedEpisode,
    round: u32,
}

impl Probe {
    async fn new(clients: &Clients) -> Self {
        let request = json!({ "task": "Foraging", "num_agents": 1, "max_round": 100_000 });
        let (status, text) = clients.post_once("/api/v1/episodes", "", &request).await;
        assert_eq!(status, 201, "{text}");
        Self { episode: serde_json::from_str(&text).expect("an episode"), round: 0 }
    }

    async fn act(&self, clients: &Clients, round: u32) -> (u16, String) {
        let act = json!({ "round": round, "action": "STAY", "message": format!("round {round}") });
        clients.post_once("/act", &self.episode.seats[0].token, &act).await
    }

    /// Plays until an act is not acknowledged.
    async fn play(&mut self, clients: &Clients) {
        while self.act(clients, self.round).await.0 == 200 {
            self.round += 1;
        }
    }

    /// Nothing is acknowledged, and the server says why.
    async fn is_refused(&self, server: &Server, clients: &Clients) {
        for _ in 0..TRIES {
            for round in [self.round, self.round + 1] {
                let (status, text) = self.act(clients, round).await;
                assert_eq!(status, 503, "{text}");
                assert!(text.contains("\"unavailable\""), "{text}");
            }
        }
        let (status, text) = clients.get_once("/readyz").await;
        assert_eq!(status, 503, "{text}");
        assert!(text.contains("\"unavailable\"") && text.contains("a commit failed"), "{text}");
        assert_eq!(clients.get_once("/healthz").await.0, 200);
        assert_eq!(clients.get_once("/api/v1/episodes").await.0, 200);
        let (_, metrics) = clients.get_once("/metrics").await;
        let name = "swarmbench_commit_failures_total";
        let failures = metrics.lines().find(|line| line.starts_with(name));
        assert_eq!(failures, Some("swarmbench_commit_failures_total 1"));
        let request = json!({ "task": "Foraging" });
        let (status, text) = clients.post_once("/api/v1/episodes", "", &request).await;
        assert_eq!(status, 503, "{text}");
        let line = "a commit failed: nothing is acknowledged until a restart";
        let log = server.log();
        assert_eq!(log.iter().filter(|told| told.contains(line)).count(), 1, "{log:#?}");
    }

    /// All acts are there that were acknowledged, and the next ones are taken.
    async fn goes_on(&self, clients: &Clients) {
        for round in 0..self.round + 2 {
            let (status, text) = self.act(clients, round).await;
            assert_eq!(status, 200, "{text}");
            let receipt: Receipt = serde_json::from_str(&text).expect("a receipt");
            // The act of the failed commit may have been kept or not.
            assert!(receipt.duplicate || round >= self.round, "{receipt:?}");
        }
    }
}

/// All acts that are acknowledged so far.
fn acknowledged(clients: &Clients) -> Vec<(Arc<Played>, AgentId, ActRequest)> {
    let mut known = Vec::new();
    for played in clients.ledger.all() {
        for agent in played.agents() {
            let acts = played.acknowledged_acts(agent).into_iter();
            known.extend(acts.map(|act| (Arc::clone(&played), agent, act)));
        }
    }
    known
}

/// After a restart all is there that was acknowledged before.
async fn goes_on(
    server: &mut Server,
    clients: &Clients,
    known: Vec<(Arc<Played>, AgentId, ActRequest)>,
) {
    server.ready().await;
    for (place, (played, agent, act)) in known.into_iter().enumerate() {
        let by = if place.is_multiple_of(2) { By::Seats } else { By::Swarm };
        clients.confirm(&played, agent, &act, by).await;
    }
    clients.all_checked(server.run).await;
}
