//! Servers that must not start: each says why, and what to do.

use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use super::servers::{Cluster, free_port};
#[cfg(target_os = "linux")]
use crate::campaign::preload;
use swarmbench_testkit::program::{PATIENCE, Site, program};

/// The program of an earlier version.
const OLD_PROGRAM: &str = "SWARMBENCH_OLD_PROGRAM";

/// Last words of a program that has ended by itself.
struct Refused {
    status: ExitStatus,
    text: String,
}

impl Refused {
    /// Checks that it has failed, with these words.
    fn because(&self, words: &str) {
        assert_eq!(self.status.code(), Some(1), "{}", self.text);
        assert!(self.text.contains(words), "it does not say {words:?}: {}", self.text);
    }
}

/// Runs a program that is to end by itself.
async fn refused(mut command: Command) -> Refused {
    let log = tempfile::tempfile().expect("a file");
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command.stderr(log.try_clone().expect("a file"));
    let mut child = command.spawn().expect("the binary runs");
    let began = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("it can be asked") {
            break Some(status);
        }
        if began.elapsed() > PATIENCE {
            drop(child.kill());
            drop(child.wait());
            break None;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    let mut text = String::new();
    let mut log = log;
    std::io::Seek::rewind(&mut log).expect("a file");
    std::io::Read::read_to_string(&mut log, &mut text).expect("UTF-8");
    Refused { status: status.unwrap_or_else(|| panic!("it goes on: {text}")), text }
}

fn serve(program: PathBuf, db: &str, options: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(["serve", "--addr", "127.0.0.1:0", "--db", db]).args(options);
    command
}

/// A cluster with its first two servers running.
async fn two() -> Cluster {
    let mut cluster = Cluster::new(0).await;
    for slot in 0..2 {
        cluster.start(slot);
        cluster.ready(slot).await;
    }
    cluster
}

pub(crate) async fn a_server_that_does_not_fit_says_why_and_ends() {
    let mut cluster = two().await;
    let servers = cluster.servers().await;
    let (url, secret) = (cluster.scratch.url().to_owned(), cluster.secret());
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let (other, short) = (file("other", "another secret of the campaign"), file("short", "short"));
    let here = |port: u16| format!("127.0.0.1:{port}");
    let (own, nobodys) = (here(free_port()), here(free_port()));
    let taken = cluster.slot(0).peers.address.to_string();
    let sqlite = folder.path().join("swarmbench.db").display().to_string();
    let with = |address: &str, listen: &str, secret: &str, db: &str| {
        let options = [
            "--cluster-address",
            address,
            "--cluster-listen",
            listen,
            "--cluster-secret-file",
            secret,
        ];
        refused(serve(program(), db, &options))
    };
    with(&own, &own, &other, &url).await.because("the secret is not that of the other servers");
    with(&own, &own, &short, &url).await.because("has 5 bytes, 16 are needed");
    with(&nobodys, &own, &secret, &url).await.because("nothing answers at");
    with(&taken, &own, &secret, &url).await.because("another server with the address");
    with(&taken, &taken, &secret, &url).await.because("is another program there?");
    with(&own, &own, &secret, &sqlite).await.because("a cluster cannot share the file");
    let alone = refused(serve(program(), &url, &[])).await;
    alone.because("is in use by another process");
    assert_eq!(cluster.servers().await, servers, "those who were refused have changed nothing");
    for slot in 0..2 {
        cluster.stop(slot).await;
    }
    // Where nobody is there any more, the secret may be another.
    let site = Site::at(url.clone());
    let options = ["--cluster-address", &own, "--cluster-secret-file", &other];
    let mut server = site.start_by(Command::new(program()), &options);
    server.ready().await;
    let (status, _, log) = server.terminate().await;
    assert_eq!(status.code(), Some(0), "{log:#?}");
}

/// Row of a dead server with the address of a living one, as after all servers were killed and started again.
pub(crate) async fn a_dead_server_at_the_address_of_another_keeps_nobody_out() {
    let cluster = two().await;
    let (secret, own) = (cluster.secret(), format!("127.0.0.1:{}", free_port()));
    let mut other = cluster.scratch.connect().await;
    for statement in [
        "INSERT INTO nodes (incarnation, name, started_at) OVERRIDING SYSTEM VALUE VALUES (0, 'dead', 0)",
        "INSERT INTO members (incarnation, slot, address, version, beat_at, is_ready, seen)
         SELECT 0, 1000, address, version, now_ms(), true, seen FROM members ORDER BY incarnation LIMIT 1",
    ] {
        sqlx::query(statement).execute(&mut other).await.expect("the row of a dead server");
    }
    let site = Site::at(cluster.scratch.url().to_owned());
    let options = ["--cluster-address", &own, "--cluster-secret-file", &secret];
    let mut server = site.start_by(Command::new(program()), &options);
    server.ready().await;
    let (status, _, log) = server.terminate().await;
    assert_eq!(status.code(), Some(0), "{log:#?}");
}

#[cfg(target_os = "linux")]
pub(crate) async fn a_server_with_a_wrong_clock_does_not_join() {
    let mut cluster = two().await;
    let servers = cluster.servers().await;
    let folder = tempfile::tempdir().expect("a folder");
    let library = preload::library("clock.c", folder.path());
    for (off, words) in
        [("5", "ms ahead of that of the database"), ("-5", "ms behind that of the database")]
    {
        let own = format!("127.0.0.1:{}", free_port());
        let secret = cluster.secret();
        let options = ["--cluster-address", &own, "--cluster-secret-file", &secret];
        let mut command = serve(program(), cluster.scratch.url(), &options);
        command.env("LD_PRELOAD", &library).env("SWARMBENCH_CLOCK_OFF", off);
        refused(command).await.because(words);
    }
    assert_eq!(cluster.servers().await, servers);
}

/// A clock that goes wrong while the others' stay right: the server leaves, and does not come back before it is right.
#[cfg(target_os = "linux")]
pub(crate) async fn a_server_whose_clock_goes_wrong_leaves_its_work_to_the_others() {
    let mut cluster = two().await;
    let servers = cluster.servers().await;
    let folder = tempfile::tempdir().expect("a folder");
    let library = preload::library("clock.c", folder.path());
    let (wrong, own) = (folder.path().join("wrong"), format!("127.0.0.1:{}", free_port()));
    let secret = cluster.secret();
    let options = ["--cluster-address", &own, "--cluster-secret-file", &secret];
    let with_clock = |mut command: Command| {
        command.env("LD_PRELOAD", &library).env("SWARMBENCH_CLOCK_OFF", "5");
        command.env("SWARMBENCH_CLOCK_FILE", &wrong);
        command
    };
    let site = Site::at(cluster.scratch.url().to_owned());
    let mut server = site.start_by(with_clock(Command::new(program())), &options);
    server.ready().await;
    assert_eq!(cluster.servers().await.len(), servers.len() + 1);
    std::fs::write(&wrong, "").expect("written");
    let status = server.ended().await;
    assert_eq!(status.code(), Some(75), "it is to be started again");
    assert_eq!(cluster.servers().await, servers, "it gave back what it had");
    let command = with_clock(serve(program(), cluster.scratch.url(), &options));
    refused(command).await.because("ms ahead of that of the database");
}

/// A database that was restored from a backup, or a standby without the last commits that took over.
pub(crate) async fn a_server_whose_commits_are_lost_leaves_its_work_to_the_others() {
    let mut cluster = two().await;
    let servers = cluster.servers().await;
    let (secret, own) = (cluster.secret(), format!("127.0.0.1:{}", free_port()));
    let site = Site::at(cluster.scratch.url().to_owned());
    let options = ["--cluster-address", &own, "--cluster-secret-file", &secret];
    let mut server = site.start_by(Command::new(program()), &options);
    server.ready().await;
    let joined = cluster.servers().await.into_iter().max().expect("it is in the cluster");
    assert!(!servers.contains(&joined));
    let mut other = cluster.scratch.connect().await;
    let lose = "UPDATE nodes SET committed = committed - 1 WHERE incarnation = $1";
    sqlx::query(lose).bind(joined).execute(&mut other).await.expect("a commit is lost");
    let status = server.ended().await;
    assert_eq!(status.code(), Some(75), "it is to be started again");
    server.end();
    let (log, says) = (server.log(), "the other servers play on");
    let last = log.iter().find(|line| line.contains(says));
    assert!(last.is_some_and(|line| line.contains("were acknowledged")), "{log:#?}");
    let began = Instant::now();
    while cluster.servers().await != servers {
        assert!(began.elapsed() < PATIENCE, "nobody takes it over");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// True if a program of the version before is there.
pub(crate) fn has_old_program() -> bool {
    std::env::var_os(OLD_PROGRAM).is_some()
}

pub(crate) async fn an_older_server_and_a_cluster_exclude_each_other() {
    let old = std::env::var_os(OLD_PROGRAM)
        .map(PathBuf::from)
        .expect("the program of the version before");
    let mut cluster = Cluster::new(0).await;
    // The old one was there first: it makes the tables, and has the database to itself.
    let site = Site::at(cluster.scratch.url().to_owned());
    let mut server = site.start_by(Command::new(&old), &[]);
    server.ready().await;
    let own = format!("127.0.0.1:{}", free_port());
    let secret = cluster.secret();
    let options = ["--cluster-address", &own, "--cluster-secret-file", &secret];
    let new = refused(serve(program(), cluster.scratch.url(), &options)).await;
    new.because("is in use by another process");
    let (status, _, log) = server.terminate().await;
    assert_eq!(status.code(), Some(0), "it did not notice anything: {log:#?}");
    // Now the cluster has it.
    cluster.start_all().await;
    let servers = cluster.servers().await;
    let refusal = refused(serve(old.clone(), cluster.scratch.url(), &[])).await;
    refusal.because("is in use by another process");
    assert_eq!(cluster.servers().await, servers);
    cluster.stop(0).await;
    cluster.stop(1).await;
    cluster.stop(2).await;
    // Nor does it start when they have left, as it does not know these tables.
    let refusal = refused(serve(old, cluster.scratch.url(), &[])).await;
    // In the words of that version.
    refusal.because("migration 15 was previously applied");
}
