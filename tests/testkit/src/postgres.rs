//! Databases of PostgreSQL for tests, created on the server that `SWARMBENCH_TEST_DB` names, and dropped with their
//! owners.

use std::collections::HashSet;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::process::Command;
use std::str::FromStr as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _};
use tempfile::TempDir;
use tokio::sync::Mutex;

/// The variable with the URL of a server on which databases may be created; `.ci/postgres` sets it.
pub const VARIABLE: &str = "SWARMBENCH_TEST_DB";

/// True if the tests run on PostgreSQL; [`crate::needs`] decides by the same variable.
pub fn is_asked() -> bool {
    std::env::var_os("SWARMBENCH_TEST_ON").is_some_and(|on| !on.is_empty())
}

/// The URL of the server for tests, if they run on PostgreSQL.
pub fn server() -> Option<String> {
    let url = std::env::var(VARIABLE).ok().filter(|url| !url.is_empty());
    assert_eq!(
        url.is_some(),
        is_asked(),
        "SWARMBENCH_TEST_ON=postgres belongs to {VARIABLE}: .ci/postgres sets both"
    );
    url
}

/// A database that is dropped with this value, even while it is in use.
pub struct Scratch {
    server: PgConnectOptions,
    name: String,
    url: String,
}

impl Scratch {
    /// Creates a database like [`Scratch::new`] for callers that cannot await: on a separate thread.
    pub fn new_blocking() -> Option<Self> {
        let making = std::thread::spawn(|| {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.expect("a runtime").block_on(Self::new())
        });
        making.join().expect("no panic")
    }

    /// Creates a database; `None` without a server for tests.
    pub async fn new() -> Option<Self> {
        Some(Self::in_server(&server()?).await)
    }

    /// Creates a database on the server at a URL.
    pub async fn in_server(url: &str) -> Self {
        static MADE: AtomicU64 = AtomicU64::new(0);
        let options = PgConnectOptions::from_str(url).expect("an address");
        let options = options.disable_statement_logging();
        let number = MADE.fetch_add(1, Ordering::Relaxed);
        let name = format!("sbt_{}_{number}", std::process::id());
        let (base, _) = url.rsplit_once('/').expect("an address with a database");
        let scratch = Self { server: options, url: format!("{base}/{name}"), name };
        let mut connection = scratch.of_server().await;
        // An earlier process with this number may have left a database of this name.
        scratch
            .execute(
                &mut connection,
                &format!("DROP DATABASE IF EXISTS {} WITH (FORCE)", scratch.name),
            )
            .await;
        scratch.execute(&mut connection, &format!("CREATE DATABASE {}", scratch.name)).await;
        drop(connection.close().await);
        scratch
    }

    /// Host and port of the server at a URL.
    pub fn address_of(url: &str) -> String {
        let (_, host) = url.rsplit_once('@').expect("an address with a user");
        host.split('/').next().expect("a host").to_owned()
    }

    /// The name of the database.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The URL of the database.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// The URL of the database behind another address.
    pub fn url_at(&self, address: std::net::SocketAddr) -> String {
        let (user, _) = self.url.rsplit_once('@').expect("an address with a user");
        format!("{user}@{address}/{}", self.name)
    }

    /// Connects to the database as another program.
    pub async fn connect(&self) -> PgConnection {
        self.server.clone().database(&self.name).connect().await.expect("the database answers")
    }

    async fn of_server(&self) -> PgConnection {
        self.server.connect().await.expect("the server for tests answers")
    }

    async fn execute(&self, connection: &mut PgConnection, statement: &str) {
        sqlx::raw_sql(AssertSqlSafe(statement.to_owned()))
            .execute(connection)
            .await
            .unwrap_or_else(|error| panic!("{statement}: {error}"));
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let (options, name) = (self.server.clone(), self.name.clone());
        // A thread of its own, without a wait: a connection that this thread's runtime is making would keep the
        // database from being dropped.
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            let Ok(runtime) = runtime else { return };
            runtime.block_on(async {
                let Ok(mut connection) = options.connect().await else { return };
                let statement = format!("DROP DATABASE IF EXISTS {name} WITH (FORCE)");
                // A database that cannot be dropped disappears with the server.
                drop(sqlx::raw_sql(AssertSqlSafe(statement)).execute(&mut connection).await);
            });
        });
    }
}

/// A server of PostgreSQL for one test, whose settings no other test has. Only root can start one.
pub struct OwnServer {
    _parent: TempDir,
    folder: PathBuf,
}

/// Starts and stops servers of PostgreSQL.
fn script() -> Command {
    Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../.ci/postgres"))
}

impl OwnServer {
    pub fn start() -> Self {
        let parent = tempfile::tempdir().expect("a folder");
        // The user of PostgreSQL has to reach what is in it.
        std::fs::set_permissions(parent.path(), PermissionsExt::from_mode(0o755)).expect("ours");
        let folder = parent.path().join("postgres");
        let made = script().arg("--keep").arg(&folder).output().expect("the script runs");
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        Self { _parent: parent, folder }
    }

    pub fn url(&self) -> String {
        let url = std::fs::read_to_string(self.folder.join("url")).expect("it is written");
        url.trim().to_owned()
    }
}

impl Drop for OwnServer {
    fn drop(&mut self) {
        drop(script().arg("--stop").arg(&self.folder).output());
    }
}

/// The setting that commits wait for a standby, which never comes.
pub struct Standby(Mutex<PgConnection>);

impl Standby {
    pub async fn of(scratch: &Scratch) -> Self {
        let options: PgConnectOptions = scratch.url().parse().expect("an address");
        let options = options.username("postgres").disable_statement_logging();
        Self(Mutex::new(options.connect().await.expect("a superuser")))
    }

    pub async fn set(&self, is_awaited: bool) {
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
    pub async fn end_waiting(&self) {
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
    pub async fn away<T>(&self, work: impl Future<Output = T>) -> T {
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
