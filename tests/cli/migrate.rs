//! Databases that move to the other engine, and back. Where no PostgreSQL is named, they move from file to file.

use std::collections::BTreeSet;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::Poll;
use swarmbench_testkit::needs;

use flate2::read::GzDecoder;
use futures::future::{Either, poll_fn, select};
use serde_json::Value;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _, Row as _};
use swarmbench::competitions::FORMATS;
use swarmbench::server::{Parts, Server};
use swarmbench::store::copy::{Copied, CopyError, Step, copy};
use swarmbench::store::{Location, OpenError, Store};
use swarmbench_testkit::host::ManualClock;
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

use super::{swarmbench, text};
use swarmbench_testkit::postgres::Scratch;

/// The golden databases, each in a folder with the number of its newest migration.
const DATABASES: &str = "tests/golden/database";

/// A folder with a golden database in it.
struct Golden {
    folder: TempDir,
    facts: Value,
}

impl Golden {
    fn new() -> Self {
        Self::of("0013")
    }

    /// The names of all of them, oldest first.
    fn all() -> Vec<String> {
        let files = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(DATABASES));
        let names = files.expect("the folder").map(|file| file.expect("a folder").file_name());
        let mut names: Vec<_> = names.map(|name| name.into_string().expect("UTF-8")).collect();
        names.sort_unstable();
        names
    }

    fn of(name: &str) -> Self {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join(DATABASES).join(name);
        let unpacked = |name: &str| {
            let mut bytes = Vec::new();
            let file = std::fs::File::open(golden.join(name)).expect("a file");
            GzDecoder::new(file).read_to_end(&mut bytes).expect("gzip");
            bytes
        };
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("golden.db"), unpacked("swarmbench.db.gz"))
            .expect("it is written");
        let facts = serde_json::from_slice(&unpacked("facts.json.gz")).expect("JSON");
        Self { folder, facts }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).display().to_string()
    }

    fn db(&self) -> String {
        self.path("golden.db")
    }
}

/// A database to move to, with what keeps it.
struct MoveTarget {
    location: String,
    scratch: Option<Scratch>,
}

impl MoveTarget {
    /// A file, and PostgreSQL where the tests run on it.
    async fn all(golden: &Golden) -> Vec<Self> {
        let mut places = vec![Self { location: golden.path("moved.db"), scratch: None }];
        if let Some(scratch) = Scratch::new().await {
            places.push(Self { location: scratch.url().to_owned(), scratch: Some(scratch) });
        }
        places
    }

    /// Rows copied so far; none where there is no unfinished copy.
    async fn copied(&self) -> Option<i64> {
        let sum = "SELECT CAST(sum(copied) AS bigint) FROM copying";
        if let Some(scratch) = &self.scratch {
            return sqlx::query_scalar(sum).fetch_one(&mut scratch.connect().await).await.ok();
        }
        sqlx::query_scalar(sum).fetch_one(&mut read(&self.location).await?).await.ok()
    }
}

async fn read(path: &str) -> Option<SqliteConnection> {
    let options = SqliteConnectOptions::new().filename(path).read_only(true);
    options.connect().await.ok()
}

async fn write(path: &str, statement: &'static str) {
    let mut connection =
        SqliteConnectOptions::new().filename(path).connect().await.expect("a database");
    sqlx::query(statement).execute(&mut connection).await.expect("it is written");
    connection.close().await.expect("it is closed");
}

fn migrate(from: &str, to: &str) -> [String; 5] {
    ["migrate", "--from", from, "--to", to].map(str::to_owned)
}

/// Output of the command with `--json`.
fn migrated(from: &str, to: &str) -> Value {
    let output = swarmbench(&["migrate", "--json", "--from", from, "--to", to]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Error of a command that has to fail.
fn refused(args: &[&str]) -> String {
    let output = swarmbench(args);
    assert!(!output.status.success(), "{args:?}: {}", text(&output.stdout));
    text(&output.stderr)
}

fn location(text: &str) -> Location {
    text.parse().expect("a location")
}

async fn moved(from: &str, to: &str) -> Result<Copied, CopyError> {
    copy(&location(from), &location(to), &FORMATS, |_| ()).await
}

/// Answers of a server over a database, at the moment at which it was recorded: all that was recorded, and lists.
async fn answers(db: &str, facts: &Value) -> Vec<(String, u16, String)> {
    let string = |value: &Value| value.as_str().expect("a text").to_owned();
    let now = string(&facts["now"]).parse().expect("a time");
    let parts = Parts { clock: Arc::new(ManualClock::new(now)), ..Parts::default() };
    let server = Server::open(location(db), parts).await.expect("it opens");
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let base = format!("http://{}", listener.local_addr().expect("an address"));
    let (stop, stopped) = oneshot::channel::<()>();
    let serving = tokio::spawn(server.run(listener, async { drop(stopped.await) }));
    let organizer = string(&facts["organizer"]);
    let lists = [
        "episodes?limit=100",
        "runs?limit=100",
        "imports?limit=100",
        "competitions?limit=100",
        "keys",
        "audit",
    ];
    let mut asked: Vec<_> =
        lists.iter().map(|list| (format!("/api/v1/{list}"), organizer.clone())).collect();
    for answer in facts["answers"].as_array().expect("answers") {
        asked.push((string(&answer["path"]), string(&answer["token"])));
    }
    for journal in facts["journals"].as_array().expect("journals") {
        asked.push((string(&journal["path"]), organizer.clone()));
    }
    let client = reqwest::Client::new();
    let mut answers = Vec::new();
    for (path, token) in asked {
        let mut call = client.get(format!("{base}{path}"));
        if !token.is_empty() {
            call = call.bearer_auth(&token);
        }
        let answer = call.send().await.expect("an answer");
        let status = answer.status().as_u16();
        answers.push((path, status, answer.text().await.expect("a text")));
    }
    drop(stop);
    serving.await.expect("it ran").expect("it stopped in good order");
    answers
}

#[tokio::test]
async fn a_database_moves_there_and_back_and_is_the_same() {
    let golden = Golden::new();
    let from = golden.db();
    // Before any program opens it: later a part of it may be in its -wal file.
    let served = golden.path("served.db");
    std::fs::copy(&from, &served).expect("a copy");
    let expected = answers(&served, &golden.facts).await;
    assert!(expected.iter().filter(|(_, status, _)| *status == 200).count() > 300);
    for place in MoveTarget::all(&golden).await {
        let there = migrated(&from, &place.location);
        let back = golden.path(if place.scratch.is_some() { "back.db" } else { "again.db" });
        let again = migrated(&place.location, &back);
        assert_eq!(there["tables"], again["tables"]);
        assert_eq!((&there["episodes"], &there["sound"]), (&76.into(), &true.into()), "{there}");
        assert!(there["rows"].as_u64().is_some_and(|rows| rows > 5000), "{there}");
        assert!(!there["to"].to_string().contains("swarmbench:"), "a password is shown: {there}");
        for db in [&from, &place.location, &back] {
            let verified = swarmbench(&["verify", "--db", db]);
            assert!(verified.status.success(), "{db}: {}", text(&verified.stdout));
        }
        if let Some(scratch) = &place.scratch {
            assert_eq!(columns_of_postgres(scratch).await, columns_of_sqlite(&back).await);
            let next =
                "INSERT INTO keys (id, hash, role, name, created_at) VALUES ('key_', '', '', '', 0)
                        RETURNING number = (SELECT max(number) + 1 FROM keys)";
            let mut connection = scratch.connect().await;
            let mut trying = connection.begin().await.expect("a transaction");
            let is_next: bool =
                sqlx::query_scalar(next).fetch_one(&mut *trying).await.expect("a number");
            assert!(is_next, "the next key has a number of its own");
            trying.rollback().await.expect("it leaves no trace");
        }
        // Last, as servers write.
        for db in [&place.location, &back] {
            for (expected, answer) in expected.iter().zip(answers(db, &golden.facts).await) {
                assert_eq!(*expected, answer, "{db}");
            }
        }
    }
}

/// Whatever version made a database: it is opened, which brings its tables up to date, moves there, and from the other
/// engine back. From file to file both ways are the same.
#[tokio::test]
async fn databases_of_all_versions_move_there_and_back_and_are_the_same() {
    let names = Golden::all();
    assert!(names.len() >= 10, "{names:?}");
    for name in names {
        let golden = Golden::of(&name);
        let from = golden.db();
        Store::open(location(&from)).await.expect("it opens").close().await;
        let scratch = Scratch::new().await;
        let there = scratch
            .as_ref()
            .map_or_else(|| golden.path("moved.db"), |scratch| scratch.url().to_owned());
        let moved = migrated(&from, &there);
        assert!(moved["rows"].as_u64().is_some_and(|rows| rows > 100), "{name}: {moved}");
        assert_eq!(moved["sound"], true, "{name}");
        if scratch.is_some() {
            let again = migrated(&there, &golden.path("back.db"));
            assert_eq!(again["sound"], true, "{name}");
            assert_eq!(moved["tables"], again["tables"], "{name}");
            assert_eq!(moved["rows"], again["rows"], "{name}");
        }
    }
}

/// All columns with their tables.
async fn columns_of_sqlite(path: &str) -> BTreeSet<(String, String)> {
    let columns = "SELECT t.name, c.name FROM sqlite_schema t JOIN pragma_table_info(t.name) c
                   WHERE t.type = 'table' AND t.name NOT LIKE '\\_sqlx%' ESCAPE '\\'";
    let mut connection = read(path).await.expect("a database");
    let rows = sqlx::query(columns).fetch_all(&mut connection).await.expect("columns");
    rows.iter().map(|row| (row.get(0), row.get(1))).collect()
}

async fn columns_of_postgres(scratch: &Scratch) -> BTreeSet<(String, String)> {
    let columns = "SELECT CAST(table_name AS text), CAST(column_name AS text) FROM information_schema.columns
                   WHERE table_schema = current_schema() AND table_name NOT IN ('_sqlx_migrations', 'changes', 'cluster', 'members', 'nodes', 'places')";
    let rows = sqlx::query(columns).fetch_all(&mut scratch.connect().await).await.expect("columns");
    rows.iter().map(|row| (row.get(0), row.get(1))).collect()
}

#[tokio::test]
async fn a_copy_that_is_dropped_at_any_step_is_refused_and_continues() {
    let golden = Golden::new();
    let from = golden.db();
    let whole = moved(&from, &golden.path("whole.db")).await.expect("a copy");
    for place in MoveTarget::all(&golden).await {
        let to = location(&place.location);
        let (mut steps_max, mut interrupted) = (1, 0);
        let copied = loop {
            let steps = AtomicUsize::new(0);
            let from = location(&from);
            let copying = Box::pin(copy(&from, &to, &FORMATS, |step| {
                // Nothing is in the target before its texts were searched.
                steps.fetch_add(usize::from(!matches!(step, Step::Search(_))), Ordering::Relaxed);
            }));
            let enough = poll_fn(|_| {
                let is_enough = steps.load(Ordering::Relaxed) >= steps_max;
                if is_enough { Poll::Ready(()) } else { Poll::Pending }
            });
            if let Either::Left((copied, _)) = select(copying, enough).await {
                break copied.expect("a copy");
            }
            interrupted += 1;
            refuses(&to).await;
            // Small steps first: the table is left between any two of its pieces.
            steps_max += steps_max.div_ceil(3);
        };
        assert!(interrupted > 8, "{interrupted}");
        assert!(copied.is_continued);
        assert_eq!((&copied.tables, &copied.checked), (&whole.tables, &whole.checked));
        Store::open(&to).await.expect("it is whole").close().await;
    }
}

/// A copy that is not finished opens for nobody.
async fn refuses(unfinished: &Location) {
    // PostgreSQL notices after a moment that a connection was dropped.
    let opened = loop {
        match Store::open(unfinished).await {
            Err(OpenError::InUse(_)) => tokio::task::yield_now().await,
            opened => break opened,
        }
    };
    assert!(matches!(opened, Err(OpenError::Incomplete { .. })), "{opened:?}");
    let read = Store::open_to_read(unfinished).await;
    assert!(matches!(read, Err(OpenError::Incomplete { .. })), "{read:?}");
}

/// Ends a process that is at work.
fn kill(mut process: Child) {
    process.kill().expect("it ran");
    process.wait().expect("it ended");
}

#[tokio::test]
async fn a_copy_that_is_killed_is_refused_by_servers_and_continues() {
    let golden = Golden::new();
    let from = golden.db();
    for place in MoveTarget::all(&golden).await {
        let to = &place.location;
        for least in [1, 1500, 4000] {
            let mut process = Command::new(swarmbench_testkit::program::program());
            let process =
                process.args(migrate(&from, to)).stdout(Stdio::null()).stderr(Stdio::null());
            let mut process = process.spawn().expect("the binary runs");
            while place.copied().await.is_none_or(|copied| copied < least) {
                assert!(process.try_wait().expect("a process").is_none(), "it ended early");
            }
            kill(process);
            refuses(&location(to)).await;
            let again = format!("`swarmbench migrate --from {from}");
            for args in [
                vec!["serve", "--addr", "127.0.0.1:0", "--db", to],
                vec!["verify", "--db", to],
                vec!["key", "create", "--name", "alice", "--db", to],
                vec!["board", "rebuild", "--db", to],
                vec!["migrate", "--from", to, "--to", "never.db"],
            ] {
                let said = refused(&args);
                assert!(
                    said.contains("unfinished copy") && said.contains(&again),
                    "{args:?}: {said}"
                );
            }
        }
        if place.scratch.is_none() {
            let said = refused(&["backup", "--db", to, &golden.path("backup.db")]);
            assert!(said.contains("unfinished copy"), "{said}");
        }
        // Another source is not mixed with the first one.
        let other = golden.path("other.db");
        std::fs::copy(&from, &other).expect("a copy");
        let said = refused(&["migrate", "--from", &other, "--to", to]);
        assert!(said.contains(&format!("an unfinished copy of {from}")), "{said}");
        assert_eq!(migrated(&from, to)["continued"], true);
        assert!(swarmbench(&["verify", "--db", to]).status.success());
    }
}

#[tokio::test]
async fn a_source_that_was_written_meanwhile_is_noticed() {
    let golden = Golden::new();
    let (from, to) = (golden.db(), golden.path("moved.db"));
    {
        let is_compared = AtomicUsize::new(0);
        let (from, to) = (location(&from), location(&to));
        let copying = Box::pin(copy(&from, &to, &FORMATS, |step| {
            is_compared
                .fetch_add(usize::from(matches!(step, Step::Compare { .. })), Ordering::Relaxed);
        }));
        let compared = poll_fn(|_| match is_compared.load(Ordering::Relaxed) {
            0 => Poll::Pending,
            _ => Poll::Ready(()),
        });
        assert!(matches!(select(copying, compared).await, Either::Right(_)));
    }
    write(&from, "UPDATE keys SET name = 'another' WHERE number = 2").await;
    let said = moved(&from, &to).await.expect_err("it differs").to_string();
    assert!(said.contains("differs from its source at the row 2 of the table keys"), "{said}");
    assert!(said.contains("Begin again"), "{said}");
    refuses(&location(&to)).await;
}

#[tokio::test]
async fn a_database_with_rows_of_its_own_is_never_overwritten() {
    let golden = Golden::new();
    let from = golden.db();
    for place in MoveTarget::all(&golden).await {
        let to = &place.location;
        let made = swarmbench(&["key", "create", "--name", "alice", "--db", to]);
        assert!(made.status.success(), "{}", text(&made.stderr));
        let said = refused(&["migrate", "--from", &from, "--to", to]);
        for expected in ["rows of its own, in the table keys", "not overwritten", "createdb"] {
            assert!(said.contains(expected), "{said}");
        }
        let store = Store::open(&location(to)).await.expect("it is as it was");
        assert!(store.has_keys().await.expect("keys"));
        store.close().await;
    }
    // Nor is a database of another program.
    let other = golden.path("recipes.db");
    std::fs::File::create(&other).expect("a file");
    write(&other, "CREATE TABLE recipes (name TEXT)").await;
    let said = refused(&["migrate", "--from", &from, "--to", &other]);
    assert!(said.contains("not a database of this program"), "{said}");
}

#[test]
fn errors_of_a_move_say_what_to_do() {
    let golden = Golden::new();
    let (from, to) = (golden.db(), golden.path("moved.db"));
    for (from, to, expected) in [
        (&from, &from, "name two databases"),
        (&golden.path("no.db"), &to, "name that of the stopped server with --from"),
        (&from, &golden.path("no/moved.db"), "create it, or name another file with --to"),
        (&from, &"postgres://nobody@127.0.0.1:1/x".to_owned(), "is PostgreSQL running there"),
    ] {
        let said = refused(&["migrate", "--from", from, "--to", to]);
        assert!(said.contains(expected), "{said}");
        assert!(!PathBuf::from(&to).exists() || from == to);
    }
    let folder = golden.folder.path();
    let server = super::Serving::start(&folder.join("golden.db"), &[]);
    let said = refused(&["migrate", "--from", &from, "--to", &to]);
    assert!(said.contains("stop the server that has it"), "{said}");
    drop(server);
}

#[needs(postgres)]
#[tokio::test]
async fn a_text_that_postgres_cannot_store_is_named_before_anything_is_copied() {
    let scratch = Scratch::new().await.expect("the tests run on PostgreSQL");
    let golden = Golden::new();
    write(&golden.db(), "UPDATE imports SET model = 'a' || char(0) || 'b' WHERE key = 3").await;
    let said = refused(&["migrate", "--from", &golden.db(), "--to", scratch.url()]);
    for expected in ["the row 3 of the table imports", "U+0000", "Nothing was copied", "delete"] {
        assert!(said.contains(expected), "{said}");
    }
    let tables = "SELECT count(*) FROM pg_tables WHERE schemaname = current_schema()";
    let tables = sqlx::query_scalar::<_, i64>(tables);
    assert_eq!(tables.fetch_one(&mut scratch.connect().await).await.expect("a number"), 0);
}
