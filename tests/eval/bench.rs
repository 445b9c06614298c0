//! A folder with a database, the program in it, and a look into what it left.

use std::io::Read as _;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};

use serde_json::Value;
use swarmbench::server::{Parts, Server};
use swarmbench_client::client::Client;
use swarmbench_protocol::run::{RunDetail, RunList};
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::{JoinHandle, spawn_blocking};

/// The database where nobody names one.
const DATABASE: &str = "swarmbench.db";

/// Result of a call of the program.
#[derive(Debug)]
pub(crate) struct Done {
    pub(crate) status: ExitStatus,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Done {
    pub(crate) fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// Asserts the exit code.
    pub(crate) fn ends(self, code: i32) -> Self {
        assert_eq!(self.code(), Some(code), "{}\n{}", self.out, self.err);
        self
    }

    /// Asserts that the output has all of these texts.
    pub(crate) fn says(self, texts: &[&str]) -> Self {
        for text in texts {
            let said = self.out.contains(text) || self.err.contains(text);
            assert!(said, "{text:?} is not in {}\n{}", self.out, self.err);
        }
        self
    }
}

/// A folder in which the program runs.
pub(crate) struct Bench {
    pub(crate) folder: TempDir,
}

/// A running call, and what was read of its standard error already.
pub(crate) struct Running(Child, Vec<u8>);

impl Bench {
    pub(crate) fn new() -> Self {
        Self { folder: TempDir::new().expect("a folder") }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("a file");
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).expect("a file")
    }

    /// `swarmbench eval` with these arguments, whatever the environment of the test has.
    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(swarmbench_testkit::program::program());
        command.arg("eval").args(args).current_dir(self.folder.path());
        for name in ["OPENAI_API_KEY", "OPENAI_BASE_URL", "SWARMBENCH_SERVER", "SWARMBENCH_KEY"] {
            command.env_remove(name);
        }
        // A proxy for the world outside is not asked for what is on this machine.
        for name in ["NO_PROXY", "no_proxy"] {
            command.env_remove(name);
        }
        command.env("http_proxy", "http://127.0.0.1:1").stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Runs it to its end.
    pub(crate) async fn eval(&self, args: &[&str]) -> Done {
        self.start(args).end().await
    }

    /// Starts it.
    pub(crate) fn start(&self, args: &[&str]) -> Running {
        Running::of(self.command(args))
    }

    /// The board that a call wrote as JSON to its standard output.
    pub(crate) async fn board(&self, args: &[&str]) -> Value {
        let done = self.eval(&[args, &["--format", "json"]].concat()).await.ends(0);
        serde_json::from_str(&done.out).unwrap_or_else(|_| panic!("{}\n{}", done.out, done.err))
    }

    /// A server over the database that the program left.
    pub(crate) async fn serve(&self) -> Serving {
        let server = Server::open(&self.path(DATABASE), Parts::default()).await.expect("it opens");
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let base = format!("http://{}", listener.local_addr().expect("an address"));
        let (stop, stopped) = oneshot::channel::<()>();
        let task = tokio::spawn(async move {
            server.run(listener, async { drop(stopped.await) }).await.expect("a good end");
        });
        let client = Client::new(&base).expect("an address");
        Serving { base, client, stop, task }
    }

    /// All bytes of all files that the program left.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        let files = std::fs::read_dir(self.folder.path()).expect("a folder");
        files
            .flat_map(|file| std::fs::read(file.expect("a file").path()).expect("a file"))
            .collect()
    }
}

impl Running {
    pub(crate) fn of(mut command: Command) -> Self {
        Self(command.spawn().expect("the program runs"), Vec::new())
    }

    /// Sends it a signal.
    pub(crate) fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_child(&self.0);
        rustix::process::kill_process(pid, signal).expect("it runs");
    }

    /// Interrupts it, each time it is called.
    pub(crate) fn interrupter(&self) -> impl Fn() + use<> {
        let pid = rustix::process::Pid::from_child(&self.0);
        // It may have ended.
        move || _ = rustix::process::kill_process(pid, rustix::process::Signal::INT)
    }

    /// Waits until it says this on its standard error.
    pub(crate) async fn until_it_says(mut self, text: &'static str) -> Self {
        let reading = spawn_blocking(move || {
            let mut byte = [0];
            while !String::from_utf8_lossy(&self.1).contains(text) {
                let stderr = self.0.stderr.as_mut().expect("it is piped");
                stderr.read_exact(&mut byte).expect("it says it before its end");
                self.1.extend(byte);
            }
            self
        });
        reading.await.expect("no panic")
    }

    pub(crate) async fn end(self) -> Done {
        let Self(child, read) = self;
        let output = spawn_blocking(|| child.wait_with_output().expect("it ran")).await;
        let output = output.expect("no panic");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        let err = text([read, output.stderr].concat());
        Done { status: output.status, out: text(output.stdout), err }
    }
}

/// A server of the test.
pub(crate) struct Serving {
    pub(crate) base: String,
    pub(crate) client: Client,
    stop: oneshot::Sender<()>,
    task: JoinHandle<()>,
}

impl Serving {
    pub(crate) async fn stop(self) {
        drop(self.stop);
        self.task.await.expect("no panic");
    }

    /// All runs, newest first, with their games.
    pub(crate) async fn runs(&self) -> Vec<RunDetail> {
        let list: RunList = self.client.get("/api/v1/runs").await.expect("a list");
        let mut runs = Vec::new();
        for run in list.items {
            runs.push(self.client.run(&run.id, None).await.expect("a run"));
        }
        runs
    }

    /// The only run.
    pub(crate) async fn run(&self) -> RunDetail {
        let mut runs = self.runs().await;
        assert_eq!(runs.len(), 1, "{runs:?}");
        runs.remove(0)
    }

    /// The acts of a run, by its games: round and record.
    pub(crate) async fn acts(&self, run: &RunDetail) -> Vec<(u64, Value)> {
        let mut acts = Vec::new();
        for game in &run.games {
            let episode = game.episode.as_deref().expect("it was opened");
            let journal = self.client.journal(episode, None).await.expect("a journal");
            for line in String::from_utf8(journal).expect("UTF-8").lines() {
                let record: Value = serde_json::from_str(line).expect("JSON");
                let record = &record["record"];
                for act in record["acts"].as_array().into_iter().flatten() {
                    acts.push((record["round"].as_u64().expect("a round"), act.clone()));
                }
            }
        }
        acts
    }
}
