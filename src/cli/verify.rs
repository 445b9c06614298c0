//! `swarmbench verify`

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::{HumanCount, ProgressBar, ProgressStyle};
use swarmbench_engine::physics::Solver;

use crate::competition::verify::{self as competition, Expected};
use crate::competitions;
use crate::journal::chain::Head;
use crate::journal::replay::verify;
use crate::store::check::{Damage, check};

#[derive(Debug, clap::Args)]
#[command(after_help = "Get a journal with\n  \
    curl -s http://127.0.0.1:8080/api/v1/episodes/EPISODE/journal > game.jsonl\n\
    and a competition that is closed with\n  \
    swarmbench competition export COMPETITION > cup.jsonl\n\
    A database is checked with --db, beside a running server or without one: its pages, what its rows refer to, every \
    journal by playing it again, and what boards and competitions keep of them. Names, labels, times of acts and \
    hashes of tokens follow from nothing else, so a change of these is not found.")]
pub(super) struct Args {
    /// The journal file; - for the standard input.
    #[arg(required_unless_present = "db")]
    file: Option<PathBuf>,
    /// Check a whole database instead.
    #[arg(long, conflicts_with_all = ["file", "competition", "head", "commitment", "solver"])]
    db: Option<PathBuf>,
    /// The file is the export of a competition: check its commitment and that every game was played on the seed and by
    /// the settings of its place, play all games again, and recompute the board.
    #[arg(long)]
    competition: bool,
    /// The expected head of the hash chain: of the journal, as the server shows it for a finished episode, or of the
    /// export, as the organizer published it. Without it only consistency is checked, not that it is this file.
    #[arg(long)]
    head: Option<String>,
    /// The commitment that was published before the competition was played, in hexadecimal.
    #[arg(long, requires = "competition")]
    commitment: Option<String>,
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

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    match (&args.db, &args.file) {
        (Some(db), _) => run_database(db).await,
        (None, Some(file)) => run_file(&args, file),
        (None, None) => bail!("name a journal file, or a database with --db"),
    }
}

async fn run_database(db: &Path) -> anyhow::Result<()> {
    let style = "{bar:30} episode {pos} of {len}, {eta} left";
    let bar = ProgressBar::new(0)
        .with_style(ProgressStyle::with_template(style).expect("a valid template"))
        .with_message("pages");
    let checked = check(db, &competitions::FORMATS, |done, of| {
        bar.set_length(of);
        bar.set_position(done);
    })
    .await;
    bar.finish_and_clear();
    let checked = checked?;
    let (episodes, rounds) = (HumanCount(checked.episodes), HumanCount(checked.rounds));
    println!("{}: {episodes} episodes with {rounds} rounds were played again", db.display());
    if checked.is_sound() {
        println!("sound: no damage was found");
        return Ok(());
    }
    for Damage { subject, problem } in &checked.damages {
        println!("damaged: {subject}: {problem}");
    }
    let count = checked.damages.len() as u64 + checked.more_damages;
    bail!("{} is damaged in {count} places; go back to a backup that is sound", db.display())
}

fn run_file(args: &Args, file: &Path) -> anyhow::Result<()> {
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
    let journal: Box<dyn BufRead> = if file.as_os_str() == "-" {
        Box::new(BufReader::new(std::io::stdin()))
    } else {
        let opened = File::open(file);
        Box::new(BufReader::new(opened.with_context(|| format!("{}", file.display()))?))
    };
    if args.competition {
        return run_competition(args, file, journal, head, solver);
    }
    let bar = ProgressBar::new(0).with_style(
        ProgressStyle::with_template("{bar:30} round {pos} of {len}").expect("a valid template"),
    );
    let report = verify(journal, head, solver, |round, of| {
        bar.set_length(of.into());
        bar.set_position(round.into());
    });
    bar.finish_and_clear();
    let report = report.with_context(|| format!("{} does not verify", file.display()))?;
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

fn run_competition(
    args: &Args,
    path: &Path,
    file: Box<dyn BufRead>,
    head: Option<Head>,
    solver: Solver,
) -> anyhow::Result<()> {
    let commitment = match &args.commitment {
        None => None,
        Some(text) => match Head::parse(text) {
            Some(Head(bytes)) => Some(bytes),
            None => {
                bail!("--commitment must be 64 hexadecimal digits, as the competition shows them")
            }
        },
    };
    let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
    let style = "{bar:30} {bytes} of {total_bytes}, {msg}";
    let bar = ProgressBar::new(bytes)
        .with_style(ProgressStyle::with_template(style).expect("a valid template"));
    let file = BufReader::new(bar.wrap_read(file));
    let report = competition::verify(file, Expected { commitment, head }, solver, |line| {
        bar.set_message(format!("line {line}"));
    });
    bar.finish_and_clear();
    let report = report.with_context(|| format!("{} does not verify", path.display()))?;
    let told = &report.competition;
    let mut about = super::play::table(&["", ""]);
    let revealed = told.revealed_at.map_or("not yet".to_owned(), |at| at.to_string());
    for (what, value) in [
        ("competition", format!("{} ({})", told.definition.name, told.id)),
        ("closed, open to all", revealed),
        ("entrants", report.entrants.len().to_string()),
        ("attempts", report.attempts.to_string()),
        ("games played again", format!("{}, {} rounds", report.episodes, report.rounds)),
        ("commitment", told.commitment.clone()),
        ("head of the file", report.head.to_string()),
    ] {
        about.add_row([what.to_owned(), value]);
    }
    println!("{about}");
    let mut board = super::play::table(&["rank", "name", "model", "attempt", "total, recomputed"]);
    for row in &report.rows {
        let entrant = report.entrants.iter().find(|entrant| entrant.id == row.entrant);
        board.add_row([
            row.rank.map_or_else(|| "–".to_owned(), |rank| rank.to_string()),
            entrant.map_or_else(String::new, |entrant| entrant.name.clone()),
            entrant.map_or_else(String::new, |entrant| entrant.declaration.model.clone()),
            row.attempt.map_or_else(String::new, |attempt| attempt.to_string()),
            row.total.map_or_else(String::new, |total| format!("{total:.2}")),
        ]);
    }
    println!("{board}");
    match commitment {
        Some(_) => println!("verified: the seeds are those of the published commitment"),
        None => println!(
            "consistent: compare the commitment with the one that was published before anybody played, or pass it \
             with --commitment"
        ),
    }
    Ok(())
}
