//! The server's program as a child process, with its time and its memory.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use rustix::process::{Pid, Signal, kill_process};
use swarmbench_testkit::program::peak_memory_bytes;

/// Pause between two readings of a process's memory.
const LOOK_AGAIN: Duration = Duration::from_millis(50);

/// The server's program.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Program {
    /// The program to measure. Default: `swarmbench` beside this program, where cargo builds both.
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
}

impl Program {
    fn path(&self) -> anyhow::Result<PathBuf> {
        let path = match &self.program {
            Some(path) => path.clone(),
            None => std::env::current_exe()?
                .with_file_name(format!("swarmbench{}", std::env::consts::EXE_SUFFIX)),
        };
        if !path.is_file() {
            bail!(
                "there is no program {}: `cargo build --release --bin swarmbench` builds it, and --program names another",
                path.display()
            );
        }
        Ok(path)
    }

    /// Starts the program with these arguments. Standard output goes to the file, if one is named.
    pub(crate) fn start(&self, args: &[&str], into: Option<&Path>) -> anyhow::Result<Child> {
        Child::start(&self.path()?, args, into)
    }
}

/// A running process.
pub(super) struct Child {
    process: Killed,
    started: Instant,
    output: JoinHandle<std::io::Result<Vec<u8>>>,
    memory: JoinHandle<Option<u64>>,
}

/// A process that is killed on drop.
struct Killed(std::process::Child);

impl Drop for Killed {
    fn drop(&mut self) {
        // Both calls fail if the process has ended.
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

/// A process that ended successfully.
pub(super) struct Finished {
    pub(super) seconds: f64,
    /// Standard output of the child.
    pub(super) output: Vec<u8>,
    /// Peak memory, if the host reports it.
    pub(super) memory_bytes: Option<u64>,
}

impl Child {
    fn start(program: &Path, args: &[&str], into: Option<&Path>) -> anyhow::Result<Self> {
        let stdout = match into {
            Some(file) => File::create(file).with_context(|| file.display().to_string())?.into(),
            None => Stdio::piped(),
        };
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::null()).stdout(stdout);
        // Environment variables for this command must not affect the child.
        for (name, _) in std::env::vars_os() {
            if name.as_encoded_bytes().starts_with(b"SWARMBENCH_") {
                command.env_remove(name);
            }
        }
        command.env("RUST_LOG", "warn");
        let mut child = Killed(command.spawn()?);
        let started = Instant::now();
        let stdout = child.0.stdout.take();
        let output = thread::spawn(move || {
            let mut read = Vec::new();
            stdout.map_or(Ok(0), |mut stdout| stdout.read_to_end(&mut read))?;
            Ok(read)
        });
        let id = child.0.id();
        let memory = thread::spawn(move || {
            let mut most = None;
            // The reading fails once the process has ended.
            while let Some(now) = peak_memory_bytes(id) {
                most = Some(now);
                thread::sleep(LOOK_AGAIN);
            }
            most
        });
        Ok(Self { process: child, started, output, memory })
    }

    /// Exit status, if the process has ended.
    pub(super) fn ended(&mut self) -> anyhow::Result<Option<String>> {
        Ok(self.process.0.try_wait()?.map(|status| status.to_string()))
    }

    /// Waits for the end. It is an error if the process failed.
    pub(super) async fn finished(self) -> anyhow::Result<Finished> {
        tokio::task::spawn_blocking(move || self.wait()).await?
    }

    fn wait(mut self) -> anyhow::Result<Finished> {
        let status = self.process.0.wait()?;
        let seconds = self.started.elapsed().as_secs_f64();
        if !status.success() {
            bail!("a part of the measurement failed: {status}");
        }
        let panicked = |_| anyhow::anyhow!("a thread of the measurement panicked");
        let output = self.output.join().map_err(panicked)??;
        let memory_bytes = self.memory.join().map_err(panicked)?;
        Ok(Finished { seconds, output, memory_bytes })
    }

    /// Asks the process to stop, as its service manager would, and waits for its end.
    pub(super) async fn stop(self) -> anyhow::Result<Finished> {
        kill_process(Pid::from_child(&self.process.0), Signal::TERM)?;
        self.finished().await
    }
}
