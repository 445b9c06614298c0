//! `swarmbench verify`

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use swarmbench_engine::physics::Solver;

use crate::journal::chain::Head;
use crate::journal::replay::verify;

#[derive(Debug, clap::Args)]
#[command(after_help = "Get a journal with\n  \
    curl -s http://127.0.0.1:8080/api/v1/episodes/EPISODE/journal > game.jsonl")]
pub(super) struct Args {
    /// The journal file; - for the standard input.
    file: PathBuf,
    /// The head of the journal's chain, as the server shows it for a finished episode. Without it a
    /// journal only proves to be consistent, with it to be that one.
    #[arg(long)]
    head: Option<String>,
    /// How physics finds who moves: by the exact flow, by the integer linear program of the paper
    /// (slower), or by both, which must agree.
    #[arg(long, default_value = "flow")]
    solver: SolverName,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SolverName {
    Flow,
    Ilp,
    Both,
}

pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let head = match &args.head {
        None => None,
        Some(text) => match Head::parse(text) {
            Some(head) => Some(head),
            None => bail!("--head must be 64 hexadecimal digits, as the server shows them"),
        },
    };
    let solver = match args.solver {
        SolverName::Flow => Solver::Flow,
        SolverName::Ilp => Solver::Ilp,
        SolverName::Both => Solver::Both,
    };
    let journal: Box<dyn BufRead> = if args.file.as_os_str() == "-" {
        Box::new(BufReader::new(std::io::stdin()))
    } else {
        let file = File::open(&args.file);
        Box::new(BufReader::new(file.with_context(|| format!("{}", args.file.display()))?))
    };
    let bar = ProgressBar::new(0).with_style(
        ProgressStyle::with_template("{bar:30} round {pos} of {len}").expect("a valid template"),
    );
    let report = verify(journal, head, solver, |round, of| {
        bar.set_length(of.into());
        bar.set_position(round.into());
    });
    bar.finish_and_clear();
    let report = report.with_context(|| format!("{} does not verify", args.file.display()))?;
    let mut table = super::play::table(&["", ""]);
    let config = &report.opening.config;
    let end = report.end.as_ref().map_or("none: it was still running".to_owned(), |end| {
        format!("{} ({})", end.status, end.reason)
    });
    let holders = report.seats.iter().flat_map(|seats| {
        seats.holders.iter().map(|holder| {
            let count = seats.seats.iter().filter(|seat| seat.holder == holder.holder).count();
            let who = match (&holder.player, &holder.key) {
                (Some(player), _) => format!("played by the server ({player})"),
                (None, Some(key)) => format!("of {key}"),
                (None, None) => "of nobody known".to_owned(),
            };
            ("seats", format!("{count} for {}, {who}", holder.model))
        })
    });
    for (what, value) in [
        ("episode", report.opening.episode.clone()),
        ("task", format!("{}, rules {}, seed {}", config.task, config.rules, config.seed)),
        ("model", config.model.clone()),
        ("rounds played again", format!("{} of at most {}", report.rounds, config.max_round)),
        ("score, recomputed", format!("{}", report.score)),
        ("end", end),
        ("head", report.head.to_string()),
    ]
    .into_iter()
    .chain(holders)
    {
        table.add_row([what.to_owned(), value]);
    }
    println!("{table}");
    match head {
        Some(_) => println!("verified: this is the journal with that head"),
        None => println!("consistent: compare the head with the server's, or pass it with --head"),
    }
    Ok(())
}
