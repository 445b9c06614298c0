//! A server for one test, and what a client does with it.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use reqwest::{Client, Method, RequestBuilder, StatusCode};
use serde_json::{Value, json};
use swarmbench::clock::{Clock, ManualClock, SeededEntropy, SystemClock};
use swarmbench::host::ManualDisk;
use swarmbench::http::auth::Access;
use swarmbench::http::limits::Limits;
use swarmbench::keys::{Key, KeyRow, Role};
use swarmbench::server::{Parts, Server, StartError};
use swarmbench::store::Store;
use swarmbench::store::entries::Entry;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Nothing takes this long; a test that hangs is to fail.
pub(crate) const PATIENCE: Duration = Duration::from_secs(100);

/// How a server is started.
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
    stop: oneshot::Sender<()>,
    task: JoinHandle<Result<(), StartError>>,
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
        let row = KeyRow { key, hash: token.hash() };
        let store = Store::open(&self.database()).await.expect("it opens");
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
        for _ in 0..10_000 {
            if self.problems().await.is_empty() {
                return;
            }
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
        }
        panic!("it does not get ready: {}", self.problems().await);
    }

    /// What keeps the server from being used, as it says itself; empty where nothing does.
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
        for _ in 0..100_000 {
            if self.problems().await.contains(problem) {
                return;
            }
        }
        panic!("no {problem:?}: {:?}", self.problems().await);
    }

    async fn launch(&mut self) {
        assert!(self.running.is_none(), "it runs");
        let parts = self.parts();
        let server = Server::open(&self.database(), parts).await.expect("it opens");
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let base = format!("http://{}", listener.local_addr().expect("an address"));
        let (stop, stopped) = oneshot::channel::<()>();
        // The sender may go without a word; that stops it as well.
        let task = tokio::spawn(server.run(listener, async move { drop(stopped.await) }));
        self.running = Some(Running { base, stop, task });
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
        }
    }

    /// A server over what the disk holds now, as after the end of the process without any notice.
    pub(crate) async fn after_a_crash(&self) -> Self {
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
        let mut app = Self {
            directory: TempDir::new().expect("a directory"),
            clock: self.clock.clone(),
            disk: Arc::clone(&self.disk),
            limits: self.limits,
            access: self.access.clone(),
            starts: self.starts + 100,
            client: self.client.clone(),
            running: None,
            organizer: self.organizer.clone(),
        };
        for (file, name) in files {
            std::fs::copy(file, app.directory.path().join(name)).expect("a copy");
        }
        app.start_again().await;
        app
    }

    /// Stops the server in good order.
    pub(crate) async fn stop(&mut self) {
        let Running { stop, task, .. } = self.running.take().expect("it runs");
        stop.send(()).expect("it listens");
        task.await.expect("no panic").expect("a good end");
    }

    /// Stops the server and starts it over the same database.
    pub(crate) async fn restart(&mut self) {
        self.stop().await;
        self.start_again().await;
    }

    pub(crate) fn database(&self) -> PathBuf {
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
        let mut database = self.other_program().await;
        sqlx::raw_sql(statement).execute(&mut database).await.expect("a good statement");
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

    pub(crate) async fn create(&self, request: Value) -> Episode {
        Episode::of(&self.post("/api/v1/episodes").json(&request).ok().await)
    }

    /// The current observation of a seat.
    pub(crate) async fn obs(&self, token: &str) -> Value {
        self.get("/obs").token(token).ok().await
    }

    /// The observation of a seat once the round is past `round`.
    pub(crate) async fn obs_after(&self, token: &str, round: u64) -> Value {
        let seen = self.get(&format!("/obs?after={round}&wait=60")).token(token).ok().await;
        assert!(seen["round"].as_u64() > Some(round) || seen["result"].is_object(), "{seen}");
        seen
    }

    /// Acts for a seat.
    pub(crate) async fn act(&self, token: &str, act: &Value) -> Value {
        self.post("/act").token(token).json(act).ok().await
    }

    /// The observations that wait for an act.
    pub(crate) async fn swarm_obs(&self, episode: &Episode) -> Vec<Value> {
        list(&self.get("/swarm/obs?limit=1024").token(&episode.swarm).ok().await["observations"])
    }

    /// Acts for several seats.
    pub(crate) async fn swarm_act(&self, episode: &Episode, acts: &[Value]) -> Vec<Value> {
        let body = json!({ "acts": acts });
        list(&self.post("/swarm/act").token(&episode.swarm).json(&body).ok().await["receipts"])
    }

    /// All seats that wait for an act do the same; returns the round that they answered.
    pub(crate) async fn all_act(&self, episode: &Episode, action: &str) -> u64 {
        let seen = self.swarm_obs(episode).await;
        let round = seen.first().expect("a seat that waits")["round"].as_u64().expect("a number");
        let act = |seen: &Value| episode.act(&seen["agent"], round, action);
        let acts: Vec<Value> = seen.iter().map(act).collect();
        for receipt in self.swarm_act(episode, &acts).await {
            assert_eq!(receipt["duplicate"], false, "{receipt}");
        }
        round
    }

    pub(crate) async fn show(&self, episode: &Episode) -> Value {
        self.get(&episode.path("")).token(&episode.swarm).ok().await
    }

    pub(crate) async fn state(&self, episode: &Episode) -> Value {
        self.get(&episode.path("/state")).token(&episode.swarm).ok().await
    }

    pub(crate) async fn journal(&self, episode: &Episode) -> String {
        let answer = self.get(&episode.path("/journal")).token(&episode.swarm).send().await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.text()
    }
}

/// An episode as it was created.
#[derive(Clone, Debug)]
pub(crate) struct Episode {
    pub(crate) id: String,
    pub(crate) swarm: String,
    pub(crate) config: Value,
    /// The tokens of the agents, in order.
    seats: Vec<String>,
}

impl Episode {
    pub(crate) fn of(created: &Value) -> Self {
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        let seats = list(&created["seats"]);
        for (number, seat) in seats.iter().enumerate() {
            assert_eq!(seat["agent"], format!("Agent_{number}"));
        }
        Self {
            id: text(&created["id"]),
            swarm: text(&created["swarm_token"]),
            config: created["config"].clone(),
            seats: seats.iter().map(|seat| text(&seat["token"])).collect(),
        }
    }

    /// The token of an agent.
    pub(crate) fn seat(&self, number: usize) -> &str {
        &self.seats[number]
    }

    pub(crate) fn seats(&self) -> impl Iterator<Item = &str> {
        self.seats.iter().map(String::as_str)
    }

    pub(crate) fn path(&self, rest: &str) -> String {
        format!("/api/v1/episodes/{}{rest}", self.id)
    }

    /// An act for one of several seats.
    pub(crate) fn act(&self, agent: &Value, round: u64, action: &str) -> Value {
        json!({ "episode": self.id, "agent": agent, "round": round, "action": action })
    }
}

/// A request on its way.
pub(crate) struct Call(RequestBuilder);

impl Call {
    pub(crate) fn token(self, token: &str) -> Self {
        Self(self.0.bearer_auth(token))
    }

    pub(crate) fn header(self, name: &str, value: &str) -> Self {
        Self(self.0.header(name, value))
    }

    pub(crate) fn json(self, body: &Value) -> Self {
        Self(self.0.json(body))
    }

    /// A body that says that it is JSON.
    pub(crate) fn body(self, body: impl Into<Vec<u8>>) -> Self {
        Self(self.0.header("content-type", "application/json").body(body.into()))
    }

    /// The answer before its body has come.
    pub(crate) async fn open(self) -> reqwest::Response {
        self.0.send().await.expect("an answer")
    }

    pub(crate) async fn send(self) -> Answer {
        Answer::of(self.open().await).await
    }

    /// The body of an answer that is no error.
    pub(crate) async fn ok(self) -> Value {
        let answer = self.send().await;
        let good = [StatusCode::OK, StatusCode::CREATED].map(|status| status.as_u16());
        assert!(good.contains(&answer.status), "{} {}", answer.status, answer.text());
        answer.json()
    }

    /// The problem that is expected; the OpenAPI document must have announced it.
    pub(crate) async fn problem(self, status: u16, code: &str) -> Value {
        let (client, request) = self.0.build_split();
        let request = request.expect("a request");
        let (method, path) = (request.method().clone(), request.url().path().to_owned());
        let answer = Answer::of(client.execute(request).await.expect("an answer")).await;
        assert_eq!(answer.header("content-type"), "application/problem+json", "{}", answer.text());
        let problem = answer.json();
        check_problem(&problem, status, code);
        assert_eq!(answer.status, status, "{problem}");
        if let Some(said) = announced(&method, &path, status) {
            assert!(said.contains(&format!("`{code}`")), "{method} {path} {status}: {said:?}");
        }
        problem
    }
}

/// The OpenAPI document.
pub(crate) static DOCUMENT: LazyLock<Value> =
    LazyLock::new(|| serde_json::from_str(&swarmbench::http::openapi::document()).expect("JSON"));

/// What the OpenAPI document says of a status of a route; none where it has no such route.
fn announced(method: &Method, path: &str, status: u16) -> Option<String> {
    let fits = |route: &str| {
        let same = |(part, sent): (&str, &str)| part.starts_with('{') || part == sent;
        let count = |text: &str| text.split('/').count();
        count(route) == count(path) && route.split('/').zip(path.split('/')).all(same)
    };
    let paths = DOCUMENT["paths"].as_object().expect("paths");
    let (_, item) = paths.iter().find(|(route, _)| fits(route))?;
    let operation = item.get(method.as_str().to_lowercase())?;
    let said = operation["responses"][status.to_string()]["description"].as_str();
    Some(said.unwrap_or("nothing").to_owned())
}

/// Checks that a problem has all members that every problem has.
pub(crate) fn check_problem(problem: &Value, status: u16, code: &str) {
    assert_eq!(problem["code"], code, "{problem}");
    assert_eq!(problem["status"], status, "{problem}");
    assert_eq!(problem["type"], format!("urn:swarmbench:problem:{code}"), "{problem}");
    for member in ["title", "detail"] {
        assert!(problem[member].as_str().is_some_and(|text| !text.is_empty()), "{problem}");
    }
}

/// The fields that a problem names.
pub(crate) fn fields(problem: &Value) -> Vec<String> {
    let name = |field: &Value| field["field"].as_str().expect("a name").to_owned();
    list(&problem["fields"]).iter().map(name).collect()
}

/// An answer.
pub(crate) struct Answer {
    pub(crate) status: u16,
    headers: reqwest::header::HeaderMap,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    async fn of(response: reqwest::Response) -> Self {
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        let body = response.bytes().await.expect("a whole body").to_vec();
        Self { status, headers, body }
    }

    /// An answer whose body does not end.
    pub(crate) fn without_body(response: &reqwest::Response) -> Self {
        let (status, headers) = (response.status().as_u16(), response.headers().clone());
        Self { status, headers, body: Vec::new() }
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().expect("ASCII"))
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8(self.body.clone()).expect("UTF-8")
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {}", self.text()))
    }
}

/// The items of a list.
pub(crate) fn list(value: &Value) -> Vec<Value> {
    value.as_array().unwrap_or_else(|| panic!("not a list: {value}")).clone()
}

/// A number of a kind that JSON has only one of.
pub(crate) fn number(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("not a whole number: {value}"))
}
