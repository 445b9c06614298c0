//! The real program as a process: started, found, killed, stopped.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;
use tokio::sync::watch;

use crate::postgres::Scratch;

/// The maximum duration of any step; a timeout is a failure.
pub const PATIENCE: Duration = Duration::from_mins(1);

/// The maximum duration of a graceful stop.
const STOP: Duration = Duration::from_secs(10);

/// The server's current address for clients, which outlive single runs of the server.
pub struct Door {
    address: watch::Sender<Option<Address>>,
    /// The last run that a test has ended.
    ended: AtomicU64,
}

/// The address of a running server.
#[derive(Clone, Debug)]
pub struct Address {
    pub base: String,
    /// The number of the server's start, from 1.
    pub run: u64,
}

impl Door {
    pub fn new() -> Arc<Self> {
        Arc::new(Self { address: watch::Sender::new(None), ended: AtomicU64::new(0) })
    }

    /// The address of the first listening run after `run`.
    pub async fn after(&self, run: u64) -> Address {
        let mut address = self.address.subscribe();
        let is_open = |address: &Option<Address>| address.as_ref().is_some_and(|a| a.run > run);
        let open = tokio::time::timeout(PATIENCE, address.wait_for(is_open)).await;
        let open = open.unwrap_or_else(|_| panic!("no run after {run} listens"));
        open.expect("the door stays").clone().expect("it was open")
    }

    /// The address of the listening run, if any.
    pub fn now(&self) -> Option<Address> {
        self.address.borrow().clone()
    }

    /// Permits a run to end.
    pub fn expect_end(&self, run: u64) {
        self.ended.fetch_max(run, Ordering::SeqCst);
    }

    /// True if a run was permitted to end.
    pub fn has_ended(&self, run: u64) -> bool {
        self.ended.load(Ordering::SeqCst) >= run
    }

    /// True if this run is listening.
    pub fn is_open(&self, run: u64) -> bool {
        self.address.borrow().as_ref().is_some_and(|address| address.run == run)
    }
}

/// A database, and the options of a server over it.
pub struct Site {
    folder: Option<TempDir>,
    /// The database, if the tests run on PostgreSQL.
    scratch: Option<Scratch>,
    /// The value of `--db`.
    db: String,
    pub door: Arc<Door>,
    runs: AtomicU64,
}

impl Site {
    /// A new folder, below `TMPDIR`.
    pub fn new() -> Self {
        Self::over(TempDir::new().expect("a folder"))
    }

    pub fn over(folder: TempDir) -> Self {
        let scratch = Scratch::new_blocking();
        let file = || folder.path().join("swarmbench.db").display().to_string();
        let db = scratch.as_ref().map_or_else(file, |scratch| scratch.url().to_owned());
        Self { folder: Some(folder), scratch, db, door: Door::new(), runs: AtomicU64::new(0) }
    }

    /// A database with another owner.
    pub fn at(db: String) -> Self {
        Self { folder: None, scratch: None, db, door: Door::new(), runs: AtomicU64::new(0) }
    }

    /// The same database behind another address; PostgreSQL only.
    pub fn through(mut self, address: SocketAddr) -> Self {
        let scratch = self.scratch.as_ref().expect("only PostgreSQL is reached by an address");
        self.db = scratch.url_at(address);
        self
    }

    /// True if the database is one of PostgreSQL.
    pub fn is_on_postgres(&self) -> bool {
        self.scratch.is_some()
    }

    pub fn folder(&self) -> &Path {
        self.folder.as_ref().expect("it is there").path()
    }

    /// The value of `--db` for commands.
    pub fn db(&self) -> &str {
        &self.db
    }

    /// The database without any proxy between it and the server.
    pub fn direct(&self) -> &str {
        self.scratch.as_ref().map_or(self.db.as_str(), Scratch::url)
    }

    pub fn wal(&self) -> PathBuf {
        self.folder().join("swarmbench.db-wal")
    }

    /// Starts a server. Clients learn its address once it listens.
    pub fn start(&self) -> Server {
        self.start_with(&[])
    }

    pub fn start_with(&self, environment: &[(&str, &Path)]) -> Server {
        let mut command = Command::new(program());
        command.env("RUST_LOG", "info").envs(environment.iter().copied());
        self.start_by(command, &[])
    }

    /// Starts a server with a command that takes the program's arguments: the program, or a shell that sets limits
    /// and then executes the program.
    pub fn start_by(&self, mut command: Command, options: &[&str]) -> Server {
        let run = self.runs.fetch_add(1, Ordering::SeqCst) + 1;
        // Every run gets a new port, as somebody's outgoing connection may use an earlier one by now.
        command.args(["serve", "--addr", "127.0.0.1:0", "--db"]).arg(&self.db).args(options);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let started = Instant::now();
        let mut child = command.spawn().expect("the binary runs");
        let log = Arc::new(Mutex::new(Vec::new()));
        let stderr = child.stderr.take().expect("it is piped");
        let (door, lines) = (Arc::clone(&self.door), Arc::clone(&log));
        let listener = std::thread::spawn(move || listen(stderr, &lines, &door, run));
        let door = Arc::clone(&self.door);
        Server { child, run, started, log, listener: Some(listener), door }
    }
}

/// The program under test: the one built with the tests, or the one that `SWARMBENCH_BIN` names.
pub fn program() -> PathBuf {
    std::env::var_os("SWARMBENCH_BIN").map_or_else(built, PathBuf::from)
}

/// The program that cargo built with the tests, which are in `deps` beside it.
fn built() -> PathBuf {
    let test = std::env::current_exe().expect("a test has a path");
    let folder = test.parent().and_then(Path::parent).expect("it is in a folder of the build");
    folder.join(format!("swarmbench{}", std::env::consts::EXE_SUFFIX))
}

/// The program with arguments and without input.
pub fn command<S: AsRef<OsStr>>(arguments: &[S]) -> Command {
    let mut command = Command::new(program());
    command.args(arguments).stdin(Stdio::null());
    command
}

impl Drop for Site {
    fn drop(&mut self) {
        if std::thread::panicking()
            && let Some(folder) = self.folder.take()
        {
            let (seed, kept) = (crate::dice::chosen(), folder.keep());
            crate::dice::tell(&format!(
                "SWARMBENCH_SEED={seed} draws the same again; the database is kept: {}",
                kept.display()
            ));
        }
    }
}

/// Stores the log, and opens the door once the log contains the address.
fn listen(stderr: ChildStderr, log: &Mutex<Vec<String>>, door: &Door, run: u64) {
    for line in BufReader::new(stderr).lines() {
        let Ok(line) = line else { return };
        let mut words = line.split("serving; documentation at ");
        let base = words.nth(1).and_then(|rest| rest.split("/docs").next()).map(str::to_owned);
        log.lock().expect("nothing panics while it holds this").push(line);
        if let Some(base) = base {
            door.address.send_replace(Some(Address { base, run }));
        }
    }
}

/// A running server.
pub struct Server {
    child: Child,
    pub run: u64,
    started: Instant,
    log: Arc<Mutex<Vec<String>>>,
    listener: Option<JoinHandle<()>>,
    door: Arc<Door>,
}

impl Server {
    /// Waits until the server is ready; returns the time since its start.
    pub async fn ready(&mut self) -> Duration {
        let client = reqwest::Client::new();
        let address = self.door.after(self.run - 1).await;
        let asked = Instant::now();
        loop {
            let answer = client.get(format!("{}/readyz", address.base)).send().await;
            if answer.is_ok_and(|answer| answer.status() == 200) {
                return self.started.elapsed();
            }
            let gone = self.child.try_wait().expect("it can be asked");
            assert!(gone.is_none(), "it ended by {gone:?}: {:#?}", self.log());
            assert!(asked.elapsed() < PATIENCE, "it gets not ready: {:#?}", self.log());
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// The most memory that the process has had resident, in MiB; 0 where the host does not say.
    pub fn memory_peak_mib(&self) -> u64 {
        peak_memory_bytes(self.pid()).unwrap_or_default() >> 20
    }

    /// The exit status of the process, if it has ended by itself.
    pub fn exit(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().expect("it can be asked")
    }

    /// Waits until the process ends by itself.
    pub async fn ended(&mut self) -> ExitStatus {
        loop {
            if let Some(status) = self.exit() {
                return status;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// `kill -9`.
    pub fn kill(mut self) -> Vec<String> {
        self.end();
        self.log()
    }

    /// SIGSTOP: the process runs on no processor when this returns.
    pub fn freeze(&self) {
        kill_process(Pid::from_child(&self.child), Signal::STOP).expect("it can be told");
        let status = format!("/proc/{}/stat", self.child.id());
        while !std::fs::read_to_string(&status).is_ok_and(|text| text.contains(") T ")) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// SIGCONT.
    pub fn thaw(&self) {
        kill_process(Pid::from_child(&self.child), Signal::CONT).expect("it can be told");
    }

    /// SIGTERM. Returns the exit status, the duration of the stop, and the log.
    pub async fn terminate(mut self) -> (ExitStatus, Duration, Vec<String>) {
        self.door.ended.store(self.run, Ordering::SeqCst);
        let told = Instant::now();
        kill_process(Pid::from_child(&self.child), Signal::TERM).expect("it can be told");
        let status = loop {
            if let Some(status) = self.child.try_wait().expect("it can be asked") {
                break status;
            }
            assert!(told.elapsed() < STOP, "it does not stop: {:#?}", self.log());
            tokio::time::sleep(Duration::from_millis(1)).await;
        };
        let taken = told.elapsed();
        self.close();
        (status, taken, self.log())
    }

    pub fn log(&self) -> Vec<String> {
        self.log.lock().expect("nothing panics while it holds this").clone()
    }

    pub fn end(&mut self) {
        self.door.ended.store(self.run, Ordering::SeqCst);
        // Both calls fail only if the process has already ended.
        drop(self.child.kill());
        drop(self.child.wait());
        self.close();
    }

    /// Closes the door after the whole log is read, since reading it may open the door.
    fn close(&mut self) {
        if let Some(listener) = self.listener.take() {
            listener.join().expect("it does not panic");
        }
        let is_this = |address: &mut Option<Address>| {
            let found = address.as_ref().is_some_and(|address| address.run <= self.run);
            if found {
                *address = None;
            }
            found
        };
        self.door.address.send_if_modified(is_this);
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

/// Peak memory of a process. `None` if the process has ended, or the host does not report it.
pub fn peak_memory_bytes(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

/// Log lines that report a problem. Not being ready yet is no problem.
pub fn complaints(log: &[String]) -> Vec<&String> {
    let complains = |line: &&String| line.contains(" WARN ") || line.contains(" ERROR ");
    log.iter().filter(complains).filter(|line| !line.contains("path=\"/readyz\"")).collect()
}

/// Waits until a condition holds.
pub async fn until(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "it is not so: {what}");
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
}
