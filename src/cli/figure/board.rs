//! Final scores, of games or of the board of a server.

use anyhow::ensure;
use swarmbench_boards::collection::Question;
use swarmbench_figures::board::{Board, Row, Score};
use swarmbench_figures::series::Summary;
use swarmbench_protocol::board::{BoardRow, Leaderboard};

use super::super::options::ServerArgs;
use super::{models, rows, tasks};

/// The most rows of a figure.
const ROWS_MAX: usize = 100;

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    games: Option<rows::Selection>,
    #[command(flatten)]
    server: ServerArgs,
    /// Of a server: the suite, its name, or name@digest where several have that name (standard).
    #[arg(long, conflicts_with = "from")]
    suite: Option<String>,
    /// Of a server: the rule set, paper or reference (paper).
    #[arg(long, conflicts_with = "from")]
    rules: Option<String>,
    /// Of a server: hide the results of the paper.
    #[arg(long, conflicts_with = "from")]
    no_reference: bool,
}

pub(super) async fn figure(args: Args) -> anyhow::Result<Board> {
    let Args { games, server, suite, rules, no_reference } = args;
    let board = if let Some(games) = games {
        of_games(&games)?
    } else {
        let question = Question { suite, rules, no_reference, ..Question::default() };
        of_board(&server.client()?.leaderboard(&question).await?)
    };
    ensure!(!board.rows.is_empty(), "the board has no rows: no run has finished yet");
    ensure!(
        board.rows.len() <= ROWS_MAX,
        "{} rows are more than the {ROWS_MAX} of a figure: select models with --where model=…",
        board.rows.len()
    );
    Ok(board)
}

/// All games of a model, by the sum of the means, the highest first.
fn of_games(args: &rows::Selection) -> anyhow::Result<Board> {
    let games = args.games()?;
    let notes = vec![rows::shared(&games, &[])?];
    let tasks = tasks(&games);
    let row = |model: String| {
        let score = |task: &String| {
            let own = games.iter().filter(|game| game.model == model && game.task == *task);
            let scores: Vec<f64> = own.map(|game| game.score).collect();
            let Summary { mean, deviation, n } = Summary::of(&scores)?;
            Some(Score { mean, deviation: Some(deviation), n: Some(n) })
        };
        Row { scores: tasks.iter().map(score).collect(), reference: false, model }
    };
    let mut rows: Vec<Row> = models(&games).into_iter().map(row).collect();
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
