//! A server for one test, and what a client does with it.

mod call;
mod disk;
mod episode;
pub(crate) mod mcp;
pub(crate) mod program;
pub(crate) mod raw;

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use reqwest::{Client, Method};
use serde_json::Value;
use sqlx::{AssertSqlSafe, Connection as _};
use swarmbench::http::limits::Limits;
use swarmbench::http::{Access, Source};
use swarmbench::keys::{Key, KeyRow, Role};
use swarmbench::server::{Parts, Server, StartError};
use swarmbench::store::entries::Entry;
use swarmbench::store::{Joining, Location, Store};
use swarmbench_clock::{Clock as _, SystemClock};
use swarmbench_testkit::host::{ManualClock, SeededEntropy};
use swarmbench_testkit::postgres::Scratch;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

pub(crate) use self::call::{
    Call, DOCUMENT, HttpAnswer, check_problem, fields, list, number, texts,
};
use self::disk::ManualDisk;
pub(crate) use self::episode::{Episode, game, verified};

/// Longer than anything takes, so that a test that hangs fails.
pub(crate) const PATIENCE: Duration = Duration::from_secs(100);

/// Options of a test server.
#[derive(Default)]
pub(crate) struct Builder {
    clock: Option<Arc<ManualClock>>,
    limits: Limits,
    access: Access,
    keys: bool,
    organizer: String,
    database: Option<Vec<u8>>,
}

impl Builder {
    /// Time passes only by [`TestApp::pass`].
    pub(crate) fn manual_clock(self) -> Self {
        self.clock_at("2026-03-01T12:00:00Z")
    }

    /// The same, from another time on.
    pub(crate) fn clock_at(mut self, now: &str) -> Self {
        self.clock = Some(Arc::new(ManualClock::new(now.parse().expect("a time"))));
        self
    }

    /// Over a database that is there already.
    pub(crate) fn database(mut self, bytes: Vec<u8>) -> Self {
        self.database = Some(bytes);
        self
    }

    /// Whose organizer has this key.
    pub(crate) fn key_of(mut self, organizer: &str) -> Self {
        organizer.clone_into(&mut self.organizer);
        self
    }

    /// With other limits.
    pub(crate) fn limits(mut self, change: impl FnOnce(&mut Limits)) -> Self {
        change(&mut self.limits);
        self
    }

    /// With an organizer's key from the beginning: [`TestApp::organizer`].
    pub(crate) fn keys(mut self) -> Self {
        self.keys = true;
        self
    }

    /// Opened to others.
    pub(crate) fn access(mut self, change: impl FnOnce(&mut Access)) -> Self {
        change(&mut self.access);
        self
    }

    /// Starts it.
    pub(crate) async fn start(self) -> TestApp {
        let mut app = TestApp {
            directory: TempDir::new().expect("a directory"),
            scratch: Scratch::new().await,
            clock: self.clock,
            disk: Arc::new(ManualDisk::new(50)),
            limits: self.limits,
            access: self.access,
            starts: 0,
            client: Client::builder().timeout(PATIENCE).build().expect("a client"),
            running: None,
            organizer: self.organizer,
        };
        if let Some(database) = self.database {
            assert!(app.scratch.is_none(), "a database that is there is a file");
            std::fs::write(app.database(), database).expect("written");
            // Ids that were drawn once are not drawn again.
            app.starts = 1000;
        }
        if self.keys {
            app.organizer = app.first_key().await;
        }
        app.start_again().await;
        app
    }
}

/// A server over a database of its own.
pub(crate) struct TestApp {
    directory: TempDir,
    /// The database, where the tests run on PostgreSQL.
    scratch: Option<Scratch>,
    clock: Option<Arc<ManualClock>>,
    pub(crate) disk: Arc<ManualDisk>,
    limits: Limits,
    access: Access,
    starts: u64,
    client: Client,
    running: Option<Running>,
    /// The key of the organizer, on a server with keys.
    pub(crate) organizer: String,
}

struct Running {
    base: String,
    servers: Vec<OneServer>,
}

/// A server, and what stops it.
struct OneServer {
    stop: oneshot::Sender<()>,
    task: JoinHandle<Result<(), StartError>>,
}

/// Asks until it is so, at most for [`PATIENCE`]: how often a server is asked meanwhile depends on what else runs on the machine.
pub(crate) async fn until(what: &str, mut is_so: impl AsyncFnMut() -> bool) {
    let began = Instant::now();
    while !is_so().await {
        assert!(began.elapsed() < PATIENCE, "never: {what}");
        pause().await;
    }
}

/// Pause between two questions that wait for the same thing. A test that asks without one keeps the processors busy, and schedulers with a
/// group per session (each process of PostgreSQL is one) were seen to let the database wait for 20 s meanwhile.
async fn pause() {
    tokio::time::sleep(Duration::from_millis(2)).await;
}

/// True if a server that plays nothing stands before the one that plays, and forwards everything.
fn is_forwarding() -> bool {
    std::env::var_os("SWARMBENCH_TEST_ON").is_some_and(|on| on == "forwarding")
}

impl TestApp {
    pub(crate) fn builder() -> Builder {
        Builder::default()
    }

    /// A server with the host's clock and the usual limits.
    pub(crate) async fn start() -> Self {
        Self::builder().start().await
    }

    /// A server whose time passes only by [`TestApp::pass`].
    pub(crate) async fn with_manual_clock() -> Self {
        Self::builder().manual_clock().start().await
    }

    /// Makes the first key of the database, as the command line does.
    pub(crate) async fn first_key(&self) -> String {
        let now = "2026-01-01T00:00:00Z".parse().expect("a time");
        let entropy = SeededEntropy::new(77);
        let (key, token) =
            Key::new(Role::Organizer, "the organizer", None, now, &entropy).expect("a good name");
        let row = KeyRow { key, hash: token.hash(), acts_for: None };
        let store = Store::open(self.location()).await.expect("it opens");
        store.keep(vec![Entry::AddKey(Box::new(row))]).await.expect("it is kept");
        store.close().await;
        token.reveal().to_owned()
    }

    /// Has the organizer make a key; returns it with its id.
    pub(crate) async fn key(&self, request: Value) -> (String, String) {
        let made = self.post("/api/v1/keys").token(&self.organizer).json(&request).ok().await;
        let text = |field: &str| made[field].as_str().expect("a text").to_owned();
        (text("secret"), text("id"))
    }

    /// Creates an episode with a key.
    pub(crate) async fn create_with(&self, key: &str, request: Value) -> Episode {
        Episode::of(&self.post("/api/v1/episodes").token(key).json(&request).ok().await)
    }

    /// Starts a server over the same database.
    pub(crate) async fn start_again(&mut self) {
        self.launch().await;
        for _ in 0..30_000 {
            if self.problems().await.is_empty() {
                return;
            }
            pause().await;
        }
        panic!("it does not get ready: {}", self.problems().await);
    }

    /// Starts a server whose clock lies behind what the database holds.
    pub(crate) async fn start_in_doubt(&mut self) {
        self.launch().await;
        for _ in 0..10_000 {
            let problems = self.problems().await;
            assert!(problems.contains("behind the newest entry"), "{problems}");
            if !problems.contains("recovered") {
                return;
            }
            pause().await;
        }
        panic!("it does not get ready: {}", self.problems().await);
    }

    /// Problems that the server names itself; empty if it can be used.
    pub(crate) async fn problems(&self) -> String {
        let answer = self.get("/readyz").send().await;
        if answer.status == 200 {
            return String::new();
        }
        assert_eq!(answer.status, 503, "{}", answer.text());
        answer.json()["detail"].as_str().expect("a detail").to_owned()
    }

    /// Asks until the server says that it has this problem.
    pub(crate) async fn until_problem(&self, problem: &str) {
        for _ in 0..30_000 {
            if self.problems().await.contains(problem) {
                return;
            }
            pause().await;
        }
        panic!("no {problem:?}: {:?}", self.problems().await);
    }

    async fn launch(&mut self) {
        assert!(self.running.is_none(), "it runs");
        if !is_forwarding() {
            let (base, server) = Box::pin(self.start_one(None)).await;
            self.running = Some(Running { base, servers: vec![server] });
            return;
        }
        let (_, playing) = Box::pin(self.start_one(Some(false))).await;
        // The one in front of it is asked; it stops first.
        let (base, forwarding) = Box::pin(self.start_one(Some(true))).await;
        self.running = Some(Running { base, servers: vec![forwarding, playing] });
    }

    /// Starts a server: alone, or as one of several, which plays or only forwards.
    async fn start_one(&mut self, forwards: Option<bool>) -> (String, OneServer) {
        let mut parts = self.parts();
        let for_nodes = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        parts.joining = forwards.map(|forwards_only| Joining {
            address: for_nodes.local_addr().expect("an address").to_string(),
            secret: Arc::from(&b"the secret of the tests"[..]),
            forwards_only,
            routing_name: None,
            host_ms: swarmbench::membership::host_ms,
        });
        let for_nodes = forwards.map(|_| for_nodes);
        let server = Server::open(self.location(), parts).await.expect("it opens");
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let base = format!("http://{}", listener.local_addr().expect("an address"));
        let (stop, stopped) = oneshot::channel::<()>();
        // The sender may go without a word; that stops it as well.
        let stopped = async move { drop(stopped.await) };
        let task = tokio::spawn(server.run_with(listener, for_nodes, stopped));
        (base, OneServer { stop, task })
    }

    /// Another process would be made of such parts. Every start draws other random bytes.
    pub(crate) fn parts(&mut self) -> Parts {
        self.starts += 1;
        let clock = self.clock.clone();
        Parts {
            clock: clock.map_or_else(|| Arc::new(SystemClock) as _, |clock| clock as _),
            entropy: Arc::new(SeededEntropy::new(self.starts << 32)),
            disk: Some(Arc::clone(&self.disk) as _),
            limits: self.limits,
            access: self.access.clone(),
            pages: Source::default(),
            joining: None,
        }
    }

    /// A server over what the disk holds now, as after the end of the process without any notice.
    pub(crate) async fn after_a_crash(&self) -> Self {
        if let Some(scratch) = &self.scratch {
            let mut app = self.another();
            app.scratch = Some(copied(scratch).await);
            app.start_again().await;
            return app;
        }
        let files = std::fs::read_dir(self.directory.path()).expect("a directory");
        let files = files.map(|file| file.expect("a file"));
        self.over(files.map(|file| (file.path(), file.file_name()))).await
    }

    /// A server in a new directory, over a backup and nothing else.
    pub(crate) async fn restored(&self, backup: PathBuf) -> Self {
        let name = self.database().file_name().expect("a name").to_owned();
        self.over([(backup, name)]).await
    }

    /// A server over copies of these files, under these names.
    async fn over(&self, files: impl IntoIterator<Item = (PathBuf, OsString)>) -> Self {
        let mut app = self.another();
        for (file, name) in files {
            std::fs::copy(file, app.directory.path().join(name)).expect("a copy");
        }
        app.start_again().await;
        app
    }

    /// A server of the same kind that does not run, without a database.
    fn another(&self) -> Self {
        Self {
            directory: TempDir::new().expect("a directory"),
            scratch: None,
            clock: self.clock.clone(),
            disk: Arc::clone(&self.disk),
            limits: self.limits,
            access: self.access.clone(),
            starts: self.starts + 100,
            client: self.client.clone(),
            running: None,
            organizer: self.organizer.clone(),
        }
    }

    /// Stops the server in good order.
    pub(crate) async fn stop(&mut self) {
        for OneServer { stop, task } in self.running.take().expect("it runs").servers {
            stop.send(()).expect("it listens");
            task.await.expect("no panic").expect("a good end");
        }
    }

    /// Stops the server and starts it over the same database.
    pub(crate) async fn restart(&mut self) {
        self.stop().await;
        self.start_again().await;
    }

    pub(crate) fn location(&self) -> Location {
        self.db().parse().expect("a location")
    }

    /// The database as commands name it with `--db`.
    pub(crate) fn db(&self) -> String {
        match &self.scratch {
            Some(scratch) => scratch.url().to_owned(),
            None => self.database().display().to_string(),
        }
    }

    /// The file of the database. A test that asks for it `needs(sqlite)`.
    pub(crate) fn database(&self) -> PathBuf {
        assert!(self.scratch.is_none(), "PostgreSQL has no file");
        self.directory.path().join("swarmbench.db")
    }

    pub(crate) fn base(&self) -> &str {
        &self.running.as_ref().expect("it runs").base
    }

    /// The time by the clock that is moved by hand.
    pub(crate) fn now(&self) -> jiff::Timestamp {
        self.clock.as_ref().expect("a manual clock").now()
    }

    /// Lets time pass.
    pub(crate) fn pass(&self, time: Duration) {
        self.clock.as_ref().expect("a manual clock").advance(time);
    }

    /// The clock that is moved by hand.
    pub(crate) fn clock(&self) -> &ManualClock {
        self.clock.as_ref().expect("a manual clock")
    }

    /// Sets the host's time of day, forward or back.
    pub(crate) fn step(&self, ms: i64) {
        self.clock().step(jiff::SignedDuration::from_millis(ms));
    }

    /// Changes the database as another program would.
    pub(crate) async fn tamper(&self, statement: &'static str) {
        if let Some(scratch) = &self.scratch {
            let mut database = scratch.connect().await;
            sqlx::raw_sql(statement).execute(&mut database).await.expect("a good statement");
            database.close().await.expect("it closes");
        } else {
            let mut database = self.other_program().await;
            sqlx::raw_sql(statement).execute(&mut database).await.expect("a good statement");
            database.close().await.expect("it closes");
        }
    }

    /// The same with the statement of the engine.
    pub(crate) async fn tamper_in(&self, sqlite: &'static str, postgres: &'static str) {
        self.tamper(if self.scratch.is_some() { postgres } else { sqlite }).await;
    }

    /// The number that a query of another program gives.
    pub(crate) async fn count(&self, query: &'static str) -> i64 {
        if let Some(scratch) = &self.scratch {
            let mut database = scratch.connect().await;
            let count = sqlx::query_scalar(query).fetch_one(&mut database).await;
            database.close().await.expect("it closes");
            return count.expect("a number");
        }
        let mut database = self.other_program().await;
        let count = sqlx::query_scalar(query).fetch_one(&mut database).await;
        database.close().await.expect("it closes");
        count.expect("a number")
    }

    /// Another program's connection to the database.
    pub(crate) async fn other_program(&self) -> sqlx::SqliteConnection {
        let path = format!("sqlite://{}", self.database().display());
        <sqlx::SqliteConnection as sqlx::Connection>::connect(&path).await.expect("the database")
    }

    /// Lets time pass, second by second, until an answer is there.
    pub(crate) async fn pass_until<T: Send + 'static>(&self, answer: JoinHandle<T>) -> T {
        while !answer.is_finished() {
            self.pass(Duration::from_secs(1));
            self.get("/healthz").ok().await;
        }
        answer.await.expect("no panic")
    }

    pub(crate) fn call(&self, method: Method, path: &str) -> Call {
        Call(self.client.request(method, format!("{}{path}", self.base())))
    }

    pub(crate) fn get(&self, path: &str) -> Call {
        self.call(Method::GET, path)
    }

    pub(crate) fn post(&self, path: &str) -> Call {
        self.call(Method::POST, path)
    }

    pub(crate) fn delete(&self, path: &str) -> Call {
        self.call(Method::DELETE, path)
    }
}

/// A database with all that another one has, as it is at this moment, whoever uses that.
async fn copied(from: &Scratch) -> Scratch {
    let to = Scratch::new().await.expect("there is a server for tests");
    // Its tables, and nothing of the servers that use it.
    let location: Location = to.url().parse().expect("an address");
    Store::open(location).await.expect("it opens").close().await;
    let (mut source, mut target) = (from.connect().await, to.connect().await);
    let begin = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY";
    sqlx::raw_sql(begin).execute(&mut source).await.expect("a transaction");
    let tables: Vec<String> = sqlx::query_scalar(
        "SELECT tablename::text FROM pg_tables
         WHERE schemaname = 'public'
             AND tablename NOT IN ('_sqlx_migrations', 'nodes', 'members', 'places', 'cluster', 'changes')",
    )
    .fetch_all(&mut source)
    .await
    .expect("the tables");
    for table in tables {
        let out = format!("COPY {table} TO STDOUT (FORMAT binary)");
        let rows = source.copy_out_raw(&out).await.expect("its rows");
        let rows: Vec<_> = futures::TryStreamExt::try_collect(rows).await.expect("all of them");
        let into = format!("COPY {table} FROM STDIN (FORMAT binary)");
        let mut copy = target.copy_in_raw(&into).await.expect("a copy");
        for piece in rows {
            copy.send(piece).await.expect("it is taken");
        }
        copy.finish().await.expect("it is complete");
    }
    let identities: Vec<(String, String)> = sqlx::query_as(
        "SELECT table_name::text, column_name::text FROM information_schema.columns
         WHERE table_schema = 'public' AND identity_generation = 'BY DEFAULT'",
    )
    .fetch_all(&mut target)
    .await
    .expect("the columns");
    for (table, column) in identities {
        let set = format!(
            "SELECT setval(pg_get_serial_sequence('{table}', '{column}'),
                           (SELECT coalesce(max({column}), 0) + 1 FROM {table}), false)"
        );
        sqlx::raw_sql(AssertSqlSafe(set)).execute(&mut target).await.expect("a number");
    }
    to
}
