//! A standby that is away: PostgreSQL has written a commit, and does not say so until the standby has it, too. Sessions that
//! wait for that are ended, as happens where a server loses patience or its connection: nothing is written twice, and nothing
//! that is stored is refused.

use std::collections::{BTreeMap, HashSet};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::process::Command;
use std::time::{Duration, Instant};

use sqlx::ConnectOptions as _;
use sqlx::postgres::{PgConnectOptions, PgConnection};
use swarmbench::store::Store;
use swarmbench_testkit::needs;
use swarmbench_testkit::postgres::Scratch;
use tempfile::TempDir;
use tokio::sync::Mutex;

use super::sessions::{joined, note, noted};
use super::{Pair, Playing, SEEDS, location, missing, play};

/// A server of PostgreSQL for one test, whose settings no other test has.
struct OwnServer {
    _parent: TempDir,
    folder: PathBuf,
}

/// Starts and stops servers of PostgreSQL.
fn script() -> Command {
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join(".ci/postgres"))
}

impl OwnServer {
    fn start() -> Self {
        let parent = tempfile::tempdir().expect("a folder");
        // The user of PostgreSQL has to reach what is in it.
        std::fs::set_permissions(parent.path(), PermissionsExt::from_mode(0o755)).expect("ours");
        let folder = parent.path().join("postgres");
        let made = script().arg("--keep").arg(&folder).output().expect("the script runs");
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        Self { _parent: parent, folder }
    }

    fn url(&self) -> String {
        let url = std::fs::read_to_string(self.folder.join("url")).expect("it is written");
        url.trim().to_owned()
    }
}

impl Drop for OwnServer {
    fn drop(&mut self) {
        drop(script().arg("--stop").arg(&self.folder).output());
    }
}

/// Who says that there is a standby, which never comes.
pub(super) struct Standby(Mutex<PgConnection>);

impl Standby {
    async fn of(scratch: &Scratch) -> Self {
        let options: PgConnectOptions = scratch.url().parse().expect("an address");
        let options = options.username("postgres").disable_statement_logging();
        Self(Mutex::new(options.connect().await.expect("a superuser")))
    }

    async fn set(&self, is_awaited: bool) {
        let mut connection = self.0.lock().await;
        let name = if is_awaited {
            "ALTER SYSTEM SET synchronous_standby_names = 'ghost'"
        } else {
            "ALTER SYSTEM SET synchronous_standby_names = ''"
        };
        for statement in [name, "SELECT pg_reload_conf()"] {
            sqlx::query(statement).execute(&mut *connection).await.expect("it is set");
        }
    }

    /// Ends two sessions of a server that wait for the standby, one after the other: that of a commit, and that by which the
    /// server makes sure of it.
    async fn end_waiting(&self) {
        let mut ended = HashSet::new();
        while ended.len() < 2 {
            let mut connection = self.0.lock().await;
            let waiting: Vec<i32> = sqlx::query_scalar(
                "SELECT pid FROM pg_stat_activity WHERE datname = current_database()
                     AND application_name LIKE 'swarmbench/%' AND wait_event = 'SyncRep'",
            )
            .fetch_all(&mut *connection)
            .await
            .expect("they are listed");
            for pid in &waiting {
                let end = sqlx::query("SELECT pg_terminate_backend($1)").bind(pid);
                end.execute(&mut *connection).await.expect("it ends");
            }
            drop(connection);
            ended.extend(waiting);
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    /// Does something while the standby is away, until two sessions that wait for it were ended.
    pub(super) async fn away<T>(&self, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        self.set(true).await;
        let done = tokio::select! {
            done = &mut work => Some(done),
            () = self.end_waiting() => None,
        };
        self.set(false).await;
        match done {
            Some(done) => done,
            None => work.await,
        }
    }
}

#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn entries_of_all_kinds_are_kept_once_while_a_standby_is_away() {
    let server = OwnServer::start();
    let mut reached = BTreeMap::new();
    for seed in 0..SEEDS {
        let pair = Pair::over(Scratch::in_server(&server.url()).await).await;
        let standby = Standby::of(&pair.scratch).await;
        let playing = Playing(seed);
        play(seed, pair, Some(&standby), &mut reached).await;
        drop(playing);
    }
    assert!(reached["ok"] > 20 && reached["refused"] > 0, "{reached:?}");
    let missing = missing(&reached);
    assert!(missing.is_empty(), "no history has {missing:?}, only {reached:?}");
}

#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn a_commit_that_waits_for_a_standby_is_told_before_it_is_given_up() {
    let server = OwnServer::start();
    let scratch = Scratch::in_server(&server.url()).await;
    let standby = Standby::of(&scratch).await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    standby.set(true).await;
    let started = Instant::now();
    let keeping = tokio::spawn({
        let store = store.clone();
        async move { store.keep(vec![note(1)]).await }
    });
    let blocked = loop {
        assert!(!keeping.is_finished(), "nothing confirms it");
        if let Some(blocked) = store.writer().blocked() {
            break blocked.to_string();
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    };
    assert!(blocked.contains("a commit that waits for a standby"), "{blocked}");
    assert!(started.elapsed() < Duration::from_secs(4), "{:?}", started.elapsed());
    standby.set(false).await;
    keeping.await.expect("no panic").expect("it is confirmed");
    assert_eq!(store.writer().blocked(), None);
    store.close().await;
}

/// Servers of a cluster share the lock of the database, so an old session does not keep a new one from it.
#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn a_server_of_a_cluster_keeps_entries_once_while_a_standby_is_away() {
    let server = OwnServer::start();
    let scratch = Scratch::in_server(&server.url()).await;
    let standby = Standby::of(&scratch).await;
    let store = joined(&scratch, 1).await;
    for number in 0..20 {
        let kept = standby.away(store.keep(vec![note(number)])).await;
        kept.unwrap_or_else(|error| panic!("{number}: {error}"));
    }
    assert_eq!(noted(&store).await, (0..20).map(|number| (number, 1)).collect());
    assert!(!store.writer().has_failed());
    store.close().await;
}
