//! Faults of a PostgreSQL before anything is written, and their messages: each sentence has to say what to do.

use std::net::TcpListener;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use swarmbench_testkit::needs;
use swarmbench_testkit::postgres::Scratch;

use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _};
use swarmbench::store::entries::{AuditRow, Entry};
use swarmbench::store::{Location, OpenError, Store};

use crate::store::{location, scratch};

/// Maximum time until a program of these tests listens.
const PATIENCE: Duration = Duration::from_secs(20);

/// The sentences of an error, the causes too.
fn sentences(error: &OpenError) -> String {
    let mut said = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        said = format!("{said}: {error}");
        cause = error.source();
    }
    said
}

/// Message of a database that is not opened.
async fn refused(location: impl Into<Location>) -> String {
    match Store::open(location).await {
        Err(error) => sentences(&error),
        Ok(store) => {
            store.close().await;
            panic!("it was opened")
        }
    }
}

/// The password of the server for tests.
fn password(scratch: &Scratch) -> String {
    let (user, _) = scratch.url().rsplit_once('@').expect("an address with a user");
    user.rsplit_once(':').expect("an address with a password").1.to_owned()
}

/// Runs statements as the superuser of the server for tests, who has the same password.
async fn as_superuser(scratch: &Scratch, statements: &str) {
    let options: PgConnectOptions = scratch.url().parse().expect("an address");
    let options = options.username("postgres").disable_statement_logging();
    let mut connection: PgConnection = options.connect().await.expect("a superuser");
    let statements = AssertSqlSafe(statements.to_owned());
    sqlx::raw_sql(statements).execute(&mut connection).await.expect("it is done");
    connection.close().await.expect("it closes");
}

fn note() -> Entry {
    Entry::Audit(Box::new(AuditRow {
        at: jiff::Timestamp::UNIX_EPOCH,
        who: "local".to_owned(),
        action: "test.note",
        subject: "x".repeat(8 * 1024),
        detail: serde_json::Value::Null,
        shown: None,
    }))
}

#[needs(postgres)]
#[tokio::test]
async fn a_wrong_password_is_refused_with_where_passwords_come_from() {
    let scratch = scratch().await;
    let url = scratch.url().replace(&password(&scratch), "guessed");
    let said = refused(url.as_str()).await;
    for expected in ["check user and password", "password_file", "pg_hba.conf"] {
        assert!(said.contains(expected), "{said}");
    }
    assert!(!said.contains("guessed"), "it has no password: {said}");
    // The right one may be in a file.
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("password");
    std::fs::write(&file, format!("{}\n", password(&scratch))).expect("written");
    let url = format!("{}?password_file={}", url.replace(":guessed", ""), file.display());
    Store::open(url.as_str()).await.expect("it opens").close().await;
    let said = refused(url.replace("/password", "/no-such-file").as_str()).await;
    assert!(said.contains("no-such-file") && said.contains("cannot be read"), "{said}");
}

#[needs(postgres)]
#[tokio::test]
async fn a_database_that_is_not_there_is_named_with_how_to_make_it() {
    let scratch = scratch().await;
    let said = refused(format!("{}_not", scratch.url()).as_str()).await;
    assert!(said.contains("there is no database") && said.contains("createdb"), "{said}");
}

#[tokio::test]
async fn a_port_at_which_nothing_listens_is_named() {
    let port = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("it").port();
    let said = refused(format!("postgres://me@127.0.0.1:{port}/x").as_str()).await;
    assert!(said.contains("is PostgreSQL running there"), "{said}");
}

#[needs(postgres)]
#[tokio::test]
async fn tables_of_a_later_version_are_left_as_they_are() {
    let scratch = scratch().await;
    Store::open(location(&scratch)).await.expect("it opens").close().await;
    let mut other = scratch.connect().await;
    let later =
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                 VALUES (9999, 'later', true, '\\x00', 1)";
    sqlx::query(later).execute(&mut other).await.expect("it is later");
    let said = refused(location(&scratch)).await;
    assert!(said.contains("a later version") && said.contains("start that version"), "{said}");
    let read = Store::open_to_read(location(&scratch)).await.expect_err("it is not read");
    assert!(sentences(&read).contains("another version"), "{read}");
    other.close().await.expect("it closes");
}

/// The same of a file.
#[tokio::test]
async fn a_file_of_a_later_version_is_left_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("games.db");
    Store::open(&path).await.expect("it opens").close().await;
    let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&path);
    let mut other = options.connect().await.expect("a database");
    let later =
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time)
                 VALUES (9999, 'later', true, x'00', 1)";
    sqlx::query(later).execute(&mut other).await.expect("it is later");
    other.close().await.expect("it closes");
    let said = refused(&path).await;
    assert!(said.contains("a later version") && said.contains("start that version"), "{said}");
}

#[needs(postgres)]
#[tokio::test]
async fn a_role_that_may_not_make_tables_is_told_the_right_that_it_needs() {
    let scratch = scratch().await;
    let name = format!("guest_{}", std::process::id());
    let password = password(&scratch);
    as_superuser(&scratch, &format!("CREATE ROLE {name} LOGIN PASSWORD '{password}'")).await;
    let url = scratch.url().replace("://swarmbench:", &format!("://{name}:"));
    let said = refused(url.as_str()).await;
    as_superuser(&scratch, &format!("DROP ROLE {name}")).await;
    for expected in ["may not make tables", "OWNER TO", "GRANT CREATE ON SCHEMA"] {
        assert!(said.contains(expected), "{said}");
    }
}

/// A full disk is like a tablespace on one: the commit fails, and works again once there is room.
#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_is_a_pause_that_says_what_it_waits_for() {
    let scratch = scratch().await;
    let disk = Disk::new();
    let (name, space) = (scratch.name(), format!("small_{}", std::process::id()));
    let make = format!("CREATE TABLESPACE {space} LOCATION '{}'", disk.space().display());
    as_superuser_elsewhere(&scratch, &make).await;
    let moved = format!("ALTER DATABASE {name} SET TABLESPACE {space}");
    as_superuser_elsewhere(&scratch, &moved).await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    store.keep(vec![note()]).await.expect("there is room");
    disk.fill();
    let write = {
        let store = store.clone();
        tokio::spawn(async move {
            for _ in 0..200 {
                store.keep(vec![note()]).await?;
            }
            Ok::<_, swarmbench::store::StoreError>(())
        })
    };
    let started = Instant::now();
    let blocked = loop {
        if let Some(blocked) = store.writer().blocked() {
            break blocked.to_string();
        }
        assert!(started.elapsed() < PATIENCE && !write.is_finished(), "nothing is blocked");
        tokio::time::sleep(Duration::from_millis(20)).await;
    };
    assert!(blocked.contains("the disk of the database is full"), "{blocked}");
    disk.make_room();
    write.await.expect("no panic").expect("all of it is kept, now that there is room");
    let noted = store.audit(None, u32::MAX).await.expect("read").len();
    assert_eq!(noted, 201, "nothing is lost or doubled");
    assert!(!store.writer().has_failed() && store.writer().blocked().is_none());
    store.close().await;
    as_superuser_elsewhere(&scratch, &format!("ALTER DATABASE {name} SET TABLESPACE pg_default"))
        .await;
    as_superuser_elsewhere(&scratch, &format!("DROP TABLESPACE {space}")).await;
}

/// Statements about a database itself, from another one.
async fn as_superuser_elsewhere(scratch: &Scratch, statement: &str) {
    let options: PgConnectOptions = scratch.url().parse().expect("an address");
    let options = options.username("postgres").database("postgres").disable_statement_logging();
    let mut connection = options.connect().await.expect("a superuser");
    let done = sqlx::raw_sql(AssertSqlSafe(statement.to_owned())).execute(&mut connection).await;
    done.unwrap_or_else(|error| panic!("{statement}: {error}"));
    connection.close().await.expect("it closes");
}

/// A small disk in memory, which root alone can make.
struct Disk(tempfile::TempDir);

impl Disk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", "size=24m,mode=0777", "tmpfs"])
            .arg(folder.path())
            .stderr(Stdio::null())
            .status();
        assert!(mounted.is_ok_and(|status| status.success()), "root may mount");
        let disk = Self(folder);
        std::fs::create_dir(disk.space()).expect("a folder");
        let owned = Command::new("chown").arg("postgres").arg(disk.space()).status();
        assert!(owned.is_ok_and(|status| status.success()), "PostgreSQL has a user postgres");
        disk
    }

    fn space(&self) -> std::path::PathBuf {
        self.0.path().join("space")
    }

    fn filler(&self) -> std::path::PathBuf {
        self.0.path().join("filler")
    }

    /// Takes all room there is.
    fn fill(&self) {
        use std::io::Write as _;
        let mut file = std::fs::File::create(self.filler()).expect("a file");
        while file.write_all(&[0; 4096]).is_ok() {}
    }

    fn make_room(&self) {
        std::fs::remove_file(self.filler()).expect("it is removed");
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // Lazily: PostgreSQL may still be closing its files.
        drop(Command::new("umount").arg("--lazy").arg(self.0.path()).status());
    }
}

/// The real pooler in its most usual mode, in which sessions are shared.
#[needs(postgres, pgbouncer)]
#[tokio::test]
async fn a_pooler_that_shares_sessions_is_refused_and_another_is_not() {
    let scratch = scratch().await;
    for (mode, is_refused) in [("transaction", true), ("session", false)] {
        let pooler = Pooler::start(&scratch, &format!("pool_mode = {mode}"));
        if is_refused {
            let said = refused(pooler.url.as_str()).await;
            assert!(said.contains("pooler") && said.contains("pool_mode = session"), "{said}");
        } else {
            let store = Store::open(pooler.url.as_str()).await.expect("each has its own session");
            store.keep(vec![note()]).await.expect("kept");
            store.close().await;
        }
    }
}

/// A pooler as it is configured by default, but for TLS.
#[needs(postgres, pgbouncer)]
#[tokio::test]
async fn a_certificate_of_another_authority_is_told_from_a_server_that_is_not_there() {
    let scratch = scratch().await;
    let folder = tempfile::tempdir().expect("a folder");
    let [own, other] = ["own", "other"].map(|name| folder.path().join(name));
    for name in [&own, &other] {
        certify(name);
    }
    let (certificate, key) = (own.with_extension("crt"), own.with_extension("key"));
    let tls = format!(
        "client_tls_sslmode = require\nclient_tls_cert_file = {}\nclient_tls_key_file = {}",
        certificate.display(),
        key.display()
    );
    drop(Command::new("chown").args(["-R", "postgres"]).arg(folder.path()).status());
    let pooler = Pooler::start(&scratch, &tls);
    let by = |authority: &std::path::Path| {
        let authority = authority.with_extension("crt");
        format!("{}?sslmode=verify-full&sslrootcert={}", pooler.url, authority.display())
    };
    let said = refused(by(&other).as_str()).await;
    for expected in ["TLS with", "the authority that signed", "invalid peer certificate"] {
        assert!(said.contains(expected), "{said}");
    }
    let store = Store::open(by(&own).as_str()).await.expect("its authority is known");
    store.close().await;
}

/// Makes a key and a certificate for 127.0.0.1 that is signed by itself.
fn certify(name: &std::path::Path) {
    let made = Command::new("openssl")
        .args([
            "req",
            "-x509",
            "-newkey",
            "ec",
            "-pkeyopt",
            "ec_paramgen_curve:P-256",
            "-nodes",
            "-days",
            "2",
        ])
        .args(["-subj", "/CN=127.0.0.1", "-addext", "subjectAltName=IP:127.0.0.1"])
        .args(["-addext", "basicConstraints=critical,CA:FALSE"])
        .arg("-keyout")
        .arg(name.with_extension("key"))
        .arg("-out")
        .arg(name.with_extension("crt"))
        .stderr(Stdio::null())
        .status();
    assert!(made.is_ok_and(|status| status.success()), "openssl makes a certificate");
}

/// A pgbouncer of its own.
struct Pooler {
    process: Child,
    url: String,
    _folder: tempfile::TempDir,
}

impl Pooler {
    fn start(scratch: &Scratch, further: &str) -> Self {
        let port =
            TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("it").port();
        let (user, at) = scratch.url().rsplit_once('@').expect("an address with a user");
        let (host, _) = at.split_once('/').expect("an address with a database");
        let (host, port_behind) = host.split_once(':').expect("a port");
        let folder = tempfile::tempdir().expect("a folder");
        let users = folder.path().join("users.txt");
        std::fs::write(&users, format!("\"swarmbench\" \"{}\"\n", password(scratch)))
            .expect("written");
        let settings = format!(
            "[databases]\n* = host={host} port={port_behind}\n[pgbouncer]\nlisten_addr = 127.0.0.1\nlisten_port = {port}\n\
             unix_socket_dir =\nauth_type = plain\nauth_file = {users}\ndefault_pool_size = 20\n{further}\nlogfile = {log}\npidfile =\n",
            users = users.display(),
            log = folder.path().join("log").display(),
        );
        let file = folder.path().join("pgbouncer.ini");
        std::fs::write(&file, settings).expect("written");
        // It refuses to run as root.
        let user_of = "postgres";
        drop(Command::new("chown").args(["-R", user_of]).arg(folder.path()).status());
        let mut command = Command::new("/usr/sbin/pgbouncer");
        command.arg("--quiet").args(["--user", user_of]).arg(&file);
        let process = command.stdin(Stdio::null()).spawn().expect("it starts");
        let url = format!("{user}@127.0.0.1:{port}/{}", scratch.name());
        let pooler = Self { process, url, _folder: folder };
        let started = Instant::now();
        while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(started.elapsed() < PATIENCE, "the pooler does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
        pooler
    }
}

impl Drop for Pooler {
    fn drop(&mut self) {
        drop(self.process.kill());
        drop(self.process.wait());
    }
}
