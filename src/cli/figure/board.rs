//! Figure of final scores, of games or of a server's board.

use std::collections::BTreeMap;

use anyhow::ensure;
use swarmbench_boards::collection::Question;
use swarmbench_figures::board::{Board, Row, Score};
use swarmbench_figures::series::Summary;
use swarmbench_protocol::board::{BoardRow, Leaderboard};

use super::super::games::{Choice, Selected};
use super::super::options::rules;
use super::{groups, scores, select};

/// Maximum rows of a figure.
const ROWS_MAX: usize = 100;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    games: Choice,
    /// The suite, for results of a server: its name, or name@digest where several suites have that name (standard).
    #[arg(long, conflicts_with_all = ["from", "db", "conditions"])]
    suite: Option<String>,
    /// The rule set, for results of a server: paper or reference (paper).
    #[arg(long, value_parser = rules, conflicts_with_all = ["from", "db", "conditions"])]
    rules: Option<String>,
    /// Hide the results of the paper, which a server adds.
    #[arg(long, conflicts_with_all = ["from", "db", "conditions"])]
    no_reference: bool,
}

pub(super) async fn figure(args: Args) -> anyhow::Result<Board> {
    let Args { games, suite, rules, no_reference } = args;
    let board = if games.is_whole_server() {
        let question = Question { suite, rules, no_reference, ..Question::default() };
        of_board(&games.source.server.client().await?.leaderboard(&question).await?)
    } else {
        of_games(&games).await?
    };
    ensure!(!board.rows.is_empty(), "the board has no rows: no run has finished yet");
    ensure!(
        board.rows.len() <= ROWS_MAX,
        "{} rows are more than the {ROWS_MAX} of a figure: select models with --where model=…",
        board.rows.len()
    );
    Ok(board)
}

/// Scores of all games by model, ordered by the sum of the means, highest first.
async fn of_games(choice: &Choice) -> anyhow::Result<Board> {
    let Selected { games, chosen, notes } = select(choice, &["task", "model"]).await?;
    let tasks: Vec<String> =
        groups(&games, "task", &chosen).into_iter().map(|(task, _)| task).collect();
    let row = |(model, of_model): (String, Vec<usize>)| {
        let of_tasks: BTreeMap<_, _> = groups(&games, "task", &of_model).into_iter().collect();
        let score = |task: &String| {
            let Summary { mean, deviation, n } = Summary::of(&scores(&games, of_tasks.get(task)?))?;
            Some(Score { mean, deviation: Some(deviation), n: Some(n) })
        };
        Row { scores: tasks.iter().map(score).collect(), reference: false, model }
    };
    let mut rows: Vec<Row> = groups(&games, "model", &chosen).into_iter().map(row).collect();
    let total = |row: &Row| row.scores.iter().flatten().map(|score| score.mean).sum::<f64>();
    rows.sort_by(|a, b| total(b).total_cmp(&total(a)));
    Ok(Board { title: "Final scores".to_owned(), notes, tasks, rows })
}

fn of_board(board: &Leaderboard) -> Board {
    let Leaderboard { suite, digest, rules, pick, sort, tasks, items, .. } = board;
    let row = |row: &BoardRow| {
        let score = |task: &String| {
            let score = row.tasks.get(task)?;
            let n = score.games.and_then(|games| usize::try_from(games).ok());
            Some(Score { mean: score.mean?, deviation: score.deviation, n })
        };
        Row {
            model: row.model.clone(),
            reference: row.reference,
            scores: tasks.iter().map(score).collect(),
        }
    };
    Board {
        title: format!("Board of {suite}"),
        notes: vec![format!("{suite}@{digest}, rules {rules}, {pick} run of each, by {sort}")],
        tasks: tasks.clone(),
        rows: items.iter().map(row).collect(),
    }
}
