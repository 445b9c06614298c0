//! `swarmbench-bench instructions`: the number of processor instructions for an observation, an act, a commit, a round,
//! counted by valgrind, and compared with the committed numbers in `counts.toml`. A count hardly depends on the machine
//! and on other processes, so it reveals changes of a few per cent.
//!
//! The program starts itself under valgrind. There [`benchmarks`] does the work; [`counting`] marks the counted part.

#[macro_use]
mod counting;

mod benchmarks;
mod callgrind;
mod counts;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use counts::Counts;

const FILE: &str = "crates/bench/counts.toml";

#[derive(Debug, clap::Args)]
#[command(
    after_help = "`.ci/instructions` builds the program with the profile to which the committed counts belong."
)]
pub(crate) struct Args {
    /// Write the counts into crates/bench/counts.toml, instead of comparing them with it.
    #[arg(long)]
    accept: bool,
    /// Keep a profile of each benchmark in this folder, for `callgrind_annotate`.
    #[arg(long, value_name = "FOLDER")]
    profiles: Option<PathBuf>,
    /// Count several times, and show how much the counts differ.
    #[arg(long, value_name = "RUNS", conflicts_with = "accept", value_parser = clap::value_parser!(u16).range(2..))]
    spread: Option<u16>,
    /// Internal: run the benchmarks, under valgrind.
    #[arg(long, hide = true)]
    counted: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if args.counted {
        benchmarks::all();
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(runs) = args.spread {
        return spread(runs);
    }
    let now = callgrind::count(args.profiles.as_deref())?;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(FILE);
    if args.accept {
        std::fs::write(&file, now.to_string()).with_context(|| format!("{FILE} is not written"))?;
        out!("{now}\nwritten to {FILE}: commit it, and say in the commit why a number has grown");
        return Ok(ExitCode::SUCCESS);
    }
    let text = std::fs::read_to_string(&file).with_context(|| format!("{FILE} is not read"))?;
    let comparison = Counts::read(&text)?.compare(&now);
    out!("{comparison}");
    Ok(if comparison.passes() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Counts several times, and shows how much the counts differ.
fn spread(runs: u16) -> anyhow::Result<ExitCode> {
    let mut all: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for run in 1..=runs {
        note!("run {run} of {runs}");
        for (benchmark, instructions) in callgrind::count(None)?.instructions {
            all.entry(benchmark).or_default().push(instructions);
        }
    }
    out!("| benchmark | least | most | spread |");
    out!("| --- | ---: | ---: | ---: |");
    for (benchmark, counts) in all {
        let (least, most) = (counts.iter().min().unwrap_or(&0), counts.iter().max().unwrap_or(&0));
        out!("| {benchmark} | {least} | {most} | {:.2} % |", counts::percent(*least, *most));
    }
    Ok(ExitCode::SUCCESS)
}
