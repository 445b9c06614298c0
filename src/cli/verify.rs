//! `swarmbench verify`

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::HumanCount;
use serde_json::json;
use swarmbench_engine::physics::Solver;

use super::output::{self, cell, fields, progress_bar, rank, set, table, total};
use crate::competitions;
use crate::store::Location;
use crate::store::check::{Damage, check};
use swarmbench_boards::competition::export::Action;
use swarmbench_boards::competition::standings::StandingsRow;
use swarmbench_boards::competition::verify::{self as competition, Expected};
use swarmbench_commands::journals::{Lines, open_lines};
use swarmbench_journal::chain::Head;
use swarmbench_journal::fork::verify_fork;
use swarmbench_journal::replay::verify;

#[derive(Debug, clap::Args)]
#[command(after_help = "Get a journal with\n  \
    curl -s http://127.0.0.1:8080/api/v1/episodes/EPISODE/journal > game.jsonl\n\
    and a competition that is closed with\n  \
    swarmbench competition export COMPETITION > cup.jsonl\n\
    With --db the command checks a database, whether its server runs or not: its pages, the references between its rows, every \
    journal by replaying it, and the results of boards and competitions. Names, labels, times of acts and \
    hashes of tokens do not follow from other data, so the check cannot find a change of these.")]
pub(super) struct Args {
    /// The journal file; - for the standard input.
    #[arg(required_unless_present = "db")]
    file: Option<PathBuf>,
    /// Check a whole database instead.
    #[arg(long, conflicts_with_all = ["file", "competition", "head", "commitment", "solver", "parent"])]
    db: Option<Location>,
    /// Check the export of a competition: its commitment, the seed and the settings that the plan gives each game, a replay
    /// of all games, and the board, which is computed again.
    #[arg(long)]
    competition: bool,
    /// The expected head of the hash chain: of a journal, the head that the server shows for the finished episode; of an
    /// export, the head that the organizer published. Without a head only the consistency of the file is checked, not its origin.
    #[arg(long)]
    head: Option<String>,
    /// The journal of the parent, if the file to verify is the journal of a fork: check that the fork took over what its parent
    /// played.
    #[arg(long, value_name = "FILE", conflicts_with = "competition")]
    parent: Option<PathBuf>,
    /// The commitment that was published before the competition was played, in hexadecimal.
    #[arg(long, requires = "competition")]
    commitment: Option<String>,
    /// The solver with which physics decides which agents move: the exact flow, the integer linear program of the paper
    /// (slower), or both, which must agree.
    #[arg(long, default_value = "flow")]
    solver: SolverName,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Caveat of a journal that was verified without a head.
const CONSISTENT_JOURNAL: &str = "\
consistent: these acts lead to this score
not proven: that a server kept this episode; anybody can write such a file (docs/journal.md, \"What a head proves\"). Pass \
the head with --head HEAD: the server shows it as result.journal_head of GET /api/v1/episodes/EPISODE once the episode \
has ended";

/// Caveat of a competition's file that was verified without a head.
const UNPROVEN_FILE: &str = "\
not proven: that this is the published file, with all entrants and games; pass the head of the file that the organizer \
published with --head HEAD";

/// Caveat of a competition's file that was verified without a commitment.
const UNPROVEN_SEEDS: &str = "\
not proven: that the seeds were drawn before anybody played, and not chosen afterwards; pass the commitment that was \
published when the competition was created with --commitment COMMITMENT";

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SolverName {
    Flow,
    Ilp,
    Both,
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    match (&args.db, &args.file) {
        (Some(db), _) => run_database(db, args.json).await,
        (None, Some(file)) => run_file(&args, file),
        (None, None) => bail!("name a journal file, or a database with --db"),
    }
}

async fn run_database(db: &Location, as_json: bool) -> anyhow::Result<()> {
    let bar = progress_bar("{bar:30} episode {pos} of {len}, {eta} left");
    let checked = check(db, &competitions::FORMATS, |done, of| set(&bar, done, of)).await;
    bar.finish_and_clear();
    let checked = checked?;
    if as_json {
        let damage = |Damage { subject, problem }: &Damage| json!({ "subject": subject, "problem": problem });
        output::json(&json!({
            "database": db.to_string(), "episodes": checked.episodes, "rounds": checked.rounds, "sound": checked.is_sound(),
            "damages": checked.damages.iter().map(damage).collect::<Vec<_>>(), "more_damages": checked.more_damages,
        }))?;
    } else {
        let (episodes, rounds) = (HumanCount(checked.episodes), HumanCount(checked.rounds));
        out!("{db}: {episodes} episodes with {rounds} rounds were played again");
        for Damage { subject, problem } in &checked.damages {
            out!("damaged: {subject}: {problem}");
        }
        if checked.is_sound() {
            out!("sound: no damage was found");
        }
    }
    if checked.is_sound() {
        return Ok(());
    }
    let count = checked.damages.len() as u64 + checked.more_damages;
    bail!("{db} is damaged in {count} places; go back to a backup that is sound")
}

fn run_file(args: &Args, file: &Path) -> anyhow::Result<()> {
    let head = parse_hash("--head", args.head.as_deref())?;
    let solver = match args.solver {
        SolverName::Flow => Solver::Flow,
        SolverName::Ilp => Solver::Ilp,
        SolverName::Both => Solver::Both,
    };
    let journal: Box<dyn BufRead> = if file.as_os_str() == "-" {
        Box::new(Lines::new(BufReader::new(std::io::stdin())))
    } else {
        Box::new(open_lines(file)?)
    };
    if args.competition {
        return run_competition(args, file, journal, head, solver);
    }
    let bar = progress_bar("{bar:30} round {pos} of {len}");
    let played = |round: u32, of: u32| set(&bar, round.into(), of.into());
    let report = match &args.parent {
        None => verify(journal, head, solver, played).map_err(anyhow::Error::from),
        Some(parent) => verify_fork(journal, open_lines(parent)?, head, solver, played)
            .map_err(anyhow::Error::from),
    };
    bar.finish_and_clear();
    let report = report.with_context(|| format!("{} does not verify", file.display()))?;
    let config = &report.opening.config;
    if args.json {
        let end = report.end.as_ref();
        return output::json(&json!({
            "episode": report.opening.episode, "task": config.task, "rules": config.rules, "seed": config.seed,
            "model": config.model, "rounds": report.rounds, "max_round": config.max_round, "score": report.score,
            "end": end.map(|end| json!({ "status": end.status, "reason": end.reason })),
            "seats": report.seats, "head": report.head.to_string(), "head_is_expected": head.is_some(),
            "fork": report.opening.fork, "parent_is_compared": args.parent.is_some(),
        }));
    }
    let end = report.end.as_ref().map_or("none: it was still running".to_owned(), |end| {
        format!("{} ({})", end.status, end.reason)
    });
    let holders = report.seats.iter().flat_map(|seats| {
        seats.holders.iter().map(|holder| {
            let count = seats.seats.iter().filter(|seat| seat.holder == holder.holder).count();
            let who = match (&holder.player, &holder.key) {
                (Some(player), _) => format!("played by the server ({player})"),
                (None, Some(key)) => format!("of {key}"),
                (None, None) => "without a key".to_owned(),
            };
            ("seats", format!("{count} for {}, {who}", holder.model))
        })
    });
    let rows = [
        ("episode", report.opening.episode.clone()),
        ("task", format!("{}, rules {}, seed {}", config.task, config.rules, config.seed)),
        ("model", config.model.clone()),
        ("rounds played again", format!("{} of at most {}", report.rounds, config.max_round)),
        ("score, recomputed", format!("{}", report.score)),
        ("end", end),
        ("head", report.head.to_string()),
    ];
    let fork = report.opening.fork.as_ref().map(|fork| {
        let compared = if args.parent.is_some() {
            "compared"
        } else {
            "not compared; pass its journal with --parent FILE"
        };
        ("fork", format!("plays on from round {} of {} ({compared})", fork.round, fork.episode))
    });
    out!("{}", fields(rows.into_iter().chain(fork).chain(holders)));
    match head {
        Some(_) => out!("verified: this is the journal with that head"),
        None => out!("{CONSISTENT_JOURNAL}"),
    }
    Ok(())
}

fn parse_hash(option: &str, text: Option<&str>) -> anyhow::Result<Option<Head>> {
    let Some(text) = text else { return Ok(None) };
    let head = Head::parse(text);
    head.map(Some).with_context(|| format!("{option} must be 64 hexadecimal digits"))
}

/// Characters of a text of others in a table: all of a reason that an organizer gives, as its length is limited by default.
const CELL_CHARS_MAX: usize = 1000;

/// The beginning of a text that is too long for a table.
fn cut(text: &str) -> String {
    match text.char_indices().nth(CELL_CHARS_MAX) {
        Some((end, _)) => format!("{} …", &text[..end]),
        None => text.to_owned(),
    }
}

/// Report of a competition's file, as JSON. Actions are copied from the file: as a tree of values they would take up to forty
/// times as much memory.
#[derive(serde::Serialize)]
struct Shown<'a> {
    #[serde(flatten)]
    all: serde_json::Value,
    actions: &'a [Action],
}

fn run_competition(
    args: &Args,
    path: &Path,
    file: Box<dyn BufRead>,
    head: Option<Head>,
    solver: Solver,
) -> anyhow::Result<()> {
    let commitment = parse_hash("--commitment", args.commitment.as_deref())?;
    let commitment = commitment.map(|Head(bytes)| bytes);
    let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
    let bar = progress_bar("{bar:30} {bytes} of {total_bytes}, {msg}");
    bar.set_length(bytes);
    let file = Lines::new(BufReader::new(bar.wrap_read(file)));
    let report = competition::verify(file, Expected { commitment, head }, solver, |line| {
        bar.set_message(format!("line {line}"));
    });
    bar.finish_and_clear();
    let report = report.with_context(|| format!("{} does not verify", path.display()))?;
    let competition = &report.competition;
    let entrant = |id: &str| report.entrants.iter().find(|entrant| entrant.id == id);
    if args.json {
        let row = |row: &StandingsRow| {
            let entrant = entrant(&row.entrant);
            json!({
                "rank": row.rank, "entrant": row.entrant, "name": entrant.map(|entrant| &entrant.name),
                "model": entrant.map(|entrant| &entrant.declaration.model), "attempt": row.attempt, "total": row.total,
            })
        };
        let all = json!({
            "competition": competition.id, "name": competition.definition.name, "revealed_at": competition.revealed_at,
            "entrants": report.entrants.len(), "attempts": report.attempts, "episodes": report.episodes,
            "rounds": report.rounds, "board": report.rows.iter().map(row).collect::<Vec<_>>(),
            "commitment": competition.commitment, "commitment_is_expected": commitment.is_some(),
            "head": report.head.to_string(), "head_is_expected": head.is_some(),
        });
        return output::json(&Shown { all, actions: &report.actions });
    }
    let revealed = competition.revealed_at.map_or("not yet".to_owned(), |at| at.to_string());
    let about = fields([
        ("competition", format!("{} ({})", competition.definition.name, competition.id)),
        ("closed, open to all", revealed),
        ("entrants", report.entrants.len().to_string()),
        ("attempts", report.attempts.to_string()),
        ("games played again", format!("{}, {} rounds", report.episodes, report.rounds)),
        ("commitment", competition.commitment.clone()),
        ("head of the file", report.head.to_string()),
    ]);
    out!("{about}");
    if !report.actions.is_empty() {
        let mut actions = table(&["time", "what an organizer did", "of", "details"]);
        for action in &report.actions {
            let Action { at, action, subject, detail } = action;
            actions.add_row([at.to_string(), cut(action), cut(subject), cut(detail.get())]);
        }
        out!("{actions}");
    }
    let mut board = table(&["rank", "name", "model", "attempt", "total, recomputed"]);
    for row in &report.rows {
        let entrant = entrant(&row.entrant);
        board.add_row([
            rank(row.rank),
            cell(entrant.map(|entrant| cut(&entrant.name))),
            cell(entrant.map(|entrant| cut(&entrant.declaration.model))),
            cell(row.attempt),
            total(row.total),
        ]);
    }
    out!("{board}");
    match head {
        Some(_) => out!("verified: this is the file with that head"),
        None => out!("{UNPROVEN_FILE}"),
    }
    match commitment {
        Some(_) => out!("verified: the seeds are those of the published commitment"),
        None => out!("{UNPROVEN_SEEDS}"),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_of_any_length_is_cut_for_a_table() {
        let long = "ä".repeat(CELL_CHARS_MAX);
        assert_eq!(cut(&long), long);
        assert_eq!(cut(&format!("{long}ää")), format!("{long} …"));
    }
}
