//! Databases of PostgreSQL for tests: each is made in the server that `SWARMBENCH_TEST_DB` names, and dropped with its owner.

use std::str::FromStr as _;
use std::sync::atomic::{AtomicU64, Ordering};

use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _};

/// The variable with the address of a server in which databases may be made: `.ci/postgres` sets it.
pub const VARIABLE: &str = "SWARMBENCH_TEST_DB";

/// Whether the tests run on PostgreSQL: [`crate::needs`] goes by the same variable.
pub fn is_asked() -> bool {
    std::env::var_os("SWARMBENCH_TEST_ON").is_some_and(|on| !on.is_empty())
}

/// The address of the server for tests, where they run on PostgreSQL.
pub fn server() -> Option<String> {
    let url = std::env::var(VARIABLE).ok().filter(|url| !url.is_empty());
    assert_eq!(
        url.is_some(),
        is_asked(),
        "SWARMBENCH_TEST_ON=postgres belongs to {VARIABLE}: .ci/postgres sets both"
    );
    url
}

/// A database of its own. It is dropped, whoever uses it, when this is.
pub struct Scratch {
    server: PgConnectOptions,
    name: String,
    url: String,
}

impl Scratch {
    /// As [`Scratch::new`], where nothing can wait: on a thread of its own.
    pub fn new_blocking() -> Option<Self> {
        let making = std::thread::spawn(|| {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            runtime.expect("a runtime").block_on(Self::new())
        });
        making.join().expect("no panic")
    }

    /// Makes a database; none where there is no server for tests.
    pub async fn new() -> Option<Self> {
        Some(Self::in_server(&server()?).await)
    }

    /// Makes a database in the server at an address.
    pub async fn in_server(url: &str) -> Self {
        static MADE: AtomicU64 = AtomicU64::new(0);
        let options = PgConnectOptions::from_str(url).expect("an address");
        let options = options.disable_statement_logging();
        let number = MADE.fetch_add(1, Ordering::Relaxed);
        let name = format!("sbt_{}_{number}", std::process::id());
        let (base, _) = url.rsplit_once('/').expect("an address with a database");
        let scratch = Self { server: options, url: format!("{base}/{name}"), name };
        let mut connection = scratch.of_server().await;
        // Left there by an earlier process with this number.
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

    /// Host and port of the server at an address.
    pub fn address_of(url: &str) -> String {
        let (_, host) = url.rsplit_once('@').expect("an address with a user");
        host.split('/').next().expect("a host").to_owned()
    }

    /// The name of the database.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The address of the database.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// The address of the database behind another address.
    pub fn url_at(&self, address: std::net::SocketAddr) -> String {
        let (user, _) = self.url.rsplit_once('@').expect("an address with a user");
        format!("{user}@{address}/{}", self.name)
    }

    /// A connection of another program.
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
        // Nobody waits for it: a connection that this thread's runtime is making would keep the database from being dropped.
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            let Ok(runtime) = runtime else { return };
            runtime.block_on(async {
                let Ok(mut connection) = options.connect().await else { return };
                let statement = format!("DROP DATABASE IF EXISTS {name} WITH (FORCE)");
                // What is left of it goes with the server.
                drop(sqlx::raw_sql(AssertSqlSafe(statement)).execute(&mut connection).await);
            });
        });
    }
}
