//! Runs this program under valgrind, and reads the counts of callgrind.
//!
//! A library such as gungraun was rejected: it starts a process for each benchmark (each would start a server under
//! valgrind again), follows one thread (SQLite has a thread of its own), and keeps its numbers in the build folder.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, anyhow, bail};

use super::counts::Counts;

/// Counts all benchmarks. Keeps their profiles in a folder, if given.
pub(crate) fn count(profiles: Option<&Path>) -> anyhow::Result<Counts> {
    let folder = tempfile::tempdir().context("no temporary folder")?;
    let dumps = folder.path().join("dump");
    let program = std::env::current_exe().context("no program")?;
    let output = Command::new("valgrind")
        .args(["--quiet", "--tool=callgrind", "--dump-before=*count_boundary*"])
        .arg(format!("--callgrind-out-file={}", dumps.display()))
        .arg(program)
        .args(["instructions", "--counted"])
        // The environment lies on the stack, so its size would move everything after it.
        .env_clear()
        .env("PATH", "/usr/bin:/bin")
        .env("TMPDIR", folder.path())
        .output()
        .context("valgrind cannot be started; on Debian: apt-get install valgrind")?;
    let text = String::from_utf8_lossy(&output.stdout);
    if !output.status.success() {
        let error = String::from_utf8_lossy(&output.stderr);
        bail!("the benchmarks failed under valgrind: {}\n{error}", output.status);
    }
    let mut lines = text.lines();
    let machine = lines.next().context("the benchmarks printed nothing")?.to_owned();
    // Name, instructions and times, in the order of the counts.
    let mut sums: Vec<(String, u64, u64)> = Vec::new();
    for (index, line) in lines.enumerate() {
        let parts = line.split_once(' ');
        let parts = parts.and_then(|(name, times)| Some((name, times.parse::<u64>().ok()?)));
        let (name, times) =
            parts.with_context(|| format!("{line:?} is not a benchmark and a number"))?;
        // Each section has two boundaries; the dump at the second one is its count.
        let dump = folder.path().join(format!("dump.{}", 2 * index + 2));
        let profile = fs::read_to_string(&dump);
        let profile = profile.with_context(|| dump.display().to_string())?;
        let instructions = total(&profile)?;
        if let Some(sum) = sums.iter_mut().find(|sum| sum.0 == name) {
            sum.1 += instructions;
            sum.2 += times;
        } else {
            sums.push((name.to_owned(), instructions, times));
            if let Some(profiles) = profiles {
                let kept = profiles.join(format!("{name}.callgrind"));
                // Calls that began before the boundary are written as 0 calls, which `callgrind_annotate` does not
                // understand.
                fs::create_dir_all(profiles)
                    .and_then(|()| fs::write(&kept, profile.replace("\ncalls=0 ", "\ncalls=1 ")))
                    .with_context(|| kept.display().to_string())?;
            }
        }
    }
    let instructions = sums.into_iter().map(|(name, sum, times)| (name, sum / times)).collect();
    Ok(Counts { rust: rust()?, machine, instructions })
}

/// The version of the compiler.
fn rust() -> anyhow::Result<String> {
    let output = Command::new("rustc").arg("--version").output();
    let output = output.context("rustc cannot be started")?;
    let text = String::from_utf8_lossy(&output.stdout);
    // rustc 1.95.0 (59807616e 2026-04-14)
    let version = text.split_whitespace().nth(1);
    version.map(str::to_owned).ok_or_else(|| anyhow!("{text:?} is not the version of a compiler"))
}

/// The instructions of a profile over all functions and threads.
fn total(profile: &str) -> anyhow::Result<u64> {
    let total = profile.lines().rev().find_map(|line| line.strip_prefix("totals:"));
    let total = total.and_then(|total| total.trim().parse().ok());
    total.context("a profile of callgrind has no total")
}
