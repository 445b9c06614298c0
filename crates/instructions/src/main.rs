//! The number of processor instructions for an observation, an act, a commit, a round: counted by valgrind, and
//! compared with the committed numbers in `counts.toml`. A count hardly depends on the machine and on other
//! processes, so it reveals changes of a few per cent.
//!
//! ```sh
//! .ci/instructions                    # compares
//! .ci/instructions --accept           # writes the new numbers
//! .ci/instructions --profiles FOLDER  # one profile a benchmark, for callgrind_annotate
//! .ci/instructions --spread 10        # counts ten times, and shows how much the counts differ
//! ```
//!
//! The program starts itself under valgrind. There [`benchmarks`] does the work; [`counting`] marks the counted part.

#[macro_use]
mod counting;

mod benchmarks;
mod callgrind;
mod counts;
#[path = "../../../benches/server/mod.rs"]
mod server;
// A file of the test kit, included here without the kit's other dependencies.
#[path = "../../../tests/testkit/src/worlds.rs"]
#[expect(unreachable_pub, reason = "it is a module of a library")]
mod worlds;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use callgrind::COUNTED;
use counts::Counts;

/// The allocator of the server's program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const FILE: &str = "crates/instructions/counts.toml";

/// The options.
#[derive(Default)]
struct Asked {
    counted: bool,
    accept: bool,
    profiles: Option<PathBuf>,
    spread: Option<usize>,
}

fn main() -> ExitCode {
    match asked().and_then(|asked| run(&asked)) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn asked() -> Result<Asked, String> {
    let mut asked = Asked::default();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = |what| arguments.next().ok_or(format!("{argument} needs {what}"));
        match argument.as_str() {
            COUNTED => asked.counted = true,
            "--accept" => asked.accept = true,
            "--profiles" => asked.profiles = Some(value("a folder")?.into()),
            "--spread" => {
                let runs = value("a number of runs")?;
                let runs = runs.parse().ok().filter(|runs| *runs > 1);
                asked.spread = Some(runs.ok_or("--spread needs a number of runs, 2 or more")?);
            }
            // Cargo adds this option.
            "--bench" => {}
            _ => {
                return Err(format!(
                    "{argument} is not known; there are --accept, --profiles FOLDER and --spread RUNS"
                ));
            }
        }
    }
    Ok(asked)
}

fn run(asked: &Asked) -> Result<ExitCode, String> {
    if asked.counted {
        benchmarks::all();
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(runs) = asked.spread {
        spread(runs)?;
        return Ok(ExitCode::SUCCESS);
    }
    let now = callgrind::count(asked.profiles.as_deref())?;
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(FILE);
    if asked.accept {
        let written = std::fs::write(&file, now.to_string());
        written.map_err(|error| format!("{FILE} cannot be written: {error}"))?;
        print!("{now}");
        println!("\nwritten to {FILE}: commit it, and say in the commit why a number has grown");
        return Ok(ExitCode::SUCCESS);
    }
    let text = std::fs::read_to_string(&file);
    let text = text.map_err(|error| format!("{FILE} cannot be read: {error}"))?;
    let comparison = Counts::read(&text)?.compare(&now);
    println!("{comparison}");
    Ok(if comparison.passes() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Counts several times, and shows how much the counts differ.
fn spread(runs: usize) -> Result<(), String> {
    let mut all: BTreeMap<String, Vec<u64>> = BTreeMap::new();
    for run in 1..=runs {
        eprintln!("run {run} of {runs}");
        for (benchmark, instructions) in callgrind::count(None)?.instructions {
            all.entry(benchmark).or_default().push(instructions);
        }
    }
    println!("| benchmark | least | most | spread |");
    println!("| --- | ---: | ---: | ---: |");
    for (benchmark, counts) in all {
        let (least, most) = (counts.iter().min().unwrap_or(&0), counts.iter().max().unwrap_or(&0));
        println!("| {benchmark} | {least} | {most} | {:.2} % |", counts::percent(*least, *most));
    }
    Ok(())
}
