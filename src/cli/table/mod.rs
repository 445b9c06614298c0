//! `swarmbench table`

mod formulas;
mod grid;

use super::games::{Choice, Selected, games_told};
use super::sheet::{Sheet, Showing};
use formulas::{best_of_rows, centralized, noise, sorted_by_total};
use grid::{Grid, Layout};

/// Prefix of the models of built-in players.
const BUILT_IN: &str = "built-in/";

#[derive(Debug, clap::Args)]
#[command(
    after_help = "A cell is the mean ± population standard deviation (number of games). The command refuses to average games of \
    different settings. docs/evaluate/tables.md has an example of each table.\n\nExamples:\n  \
    swarmbench table main --db swarmbench.db\n  \
    swarmbench table sensitivity --where model=gpt-4o --format latex > sensitivity.tex\n  \
    swarmbench table --by model,task --value pushes --from games\n  \
    swarmbench table --rows task,temperature --columns top_p --from games --format csv"
)]
pub(super) struct Args {
    /// The table of the paper.
    #[arg(value_enum, required_unless_present_any = ["by", "rows"])]
    name: Option<Name>,
    /// The columns of the games by which to group: settings, or keys of `agent_meta` such as temperature. The column task, or
    /// else the last of several, becomes the columns of the table; all others become its rows.
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',', conflicts_with_all = ["name", "rows", "columns"])]
    by: Vec<String>,
    /// The columns of the games that become the rows of the table.
    #[arg(long, value_name = "COLUMN,…", value_delimiter = ',')]
    rows: Vec<String>,
    /// The columns of the games that become the columns of the table.
    #[arg(
        long,
        value_name = "COLUMN,…",
        value_delimiter = ',',
        requires = "rows",
        conflicts_with = "name"
    )]
    columns: Vec<String>,
    /// The column of the games to average: the score, a metric, or any other column of numbers.
    #[arg(long, value_name = "COLUMN", default_value = "score")]
    value: String,
    #[command(flatten)]
    games: Choice,
    #[command(flatten)]
    showing: Showing,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Name {
    /// Scores of models by tasks, with totals.
    Main,
    /// The built-in players of each task.
    Rules,
    /// Numbers of agents by sizes of the window.
    Sensitivity,
    /// Larger maps and more agents.
    Scaling,
    /// Centralized control compared with decentralized.
    Centralized,
    /// Noise and delay compared with none.
    Noise,
    /// Temperatures where `top_p` is 1, and `top_p` where the temperature is 1.
    Sampling,
    /// Numbers of rounds that agents remember.
    Memory,
}

impl Name {
    /// Columns of games that make up the rows and the columns of the table.
    const fn axes(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Main => (&["model"], &["task"]),
            Self::Rules => (&["task", "model"], &[]),
            Self::Sensitivity => (&["task", "num_agents"], &["view_size"]),
            Self::Scaling => (&["task", "map_size", "num_agents"], &[]),
            Self::Centralized => (&["task"], &["control"]),
            Self::Noise => (&["model"], &["noise", "max_delay", "task"]),
            Self::Sampling => (&["task"], &[]),
            Self::Memory => (&["task"], &["memory"]),
        }
    }
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let Args { name, by, rows, columns, value, games, showing } = args;
    let ignored = games.ignore.clone();
    let selected = games.select().await?;
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let layout = |rows: Vec<String>, columns| Layout {
        rows,
        columns,
        value: value.clone(),
        ignored: ignored.clone(),
        option: if name.is_some() { "--rows" } else { "--by" },
    };
    let Some(name) = name else {
        let (rows, columns) = if by.is_empty() { (rows, columns) } else { pivot(by) };
        let grid = Grid::of(&selected, selected.chosen.clone(), layout(rows, columns))?;
        return showing.show(&[grid.sheet()], &selected.notes);
    };
    let (usual, columns) = name.axes();
    let rows = if rows.is_empty() { owned(usual) } else { rows };
    let grid = |games: Vec<usize>, columns: Vec<String>| {
        Grid::of(&selected, games, layout(rows.clone(), columns))
    };
    let plain = |games| anyhow::Ok(grid(games, owned(columns))?.sheet());
    let all = selected.chosen.clone();
    let sheets = match name {
        Name::Main => vec![sorted_by_total(plain(all)?)],
        Name::Rules => vec![plain(of_built_in(&selected)?)?],
        Name::Sensitivity | Name::Scaling | Name::Memory => vec![plain(all)?],
        Name::Centralized => vec![centralized(&grid(all, owned(columns))?)?],
        Name::Noise => vec![noise(&grid(all, owned(columns))?)?],
        Name::Sampling => sampling(&selected, |games, column| grid(games, vec![column]))?,
    };
    showing.show(&sheets, &selected.notes)
}

/// Tasks become the columns, otherwise the last of `by`.
fn pivot(mut by: Vec<String>) -> (Vec<String>, Vec<String>) {
    if by.len() < 2 {
        return (by, Vec::new());
    }
    let place = by.iter().position(|name| name == "task").unwrap_or(by.len() - 1);
    let column = by.remove(place);
    (by, vec![column])
}

fn of_built_in(selected: &Selected) -> anyhow::Result<Vec<usize>> {
    let is_built_in =
        |game: &usize| selected.games.value("model", *game).to_string().starts_with(BUILT_IN);
    let games: Vec<usize> = selected.chosen.iter().copied().filter(is_built_in).collect();
    anyhow::ensure!(
        !games.is_empty(),
        "none of these games was played by a built-in player: \
         `swarmbench eval examples/eval/baselines.toml` plays them"
    );
    Ok(games)
}

/// One sheet of temperatures and one of `top_p`, each from the games in which the other is 1.
fn sampling(
    selected: &Selected,
    grid: impl Fn(Vec<usize>, String) -> anyhow::Result<Grid>,
) -> anyhow::Result<Vec<Sheet>> {
    [("temperature", "top_p"), ("top_p", "temperature")]
        .into_iter()
        .map(|(varied, fixed)| {
            for column in [varied, fixed] {
                selected.games.check_column(column)?;
            }
            let is_one = |game: &usize| selected.games.number(fixed, *game) == Some(1.0);
            let games: Vec<usize> = selected.chosen.iter().copied().filter(is_one).collect();
            anyhow::ensure!(
                !games.is_empty(),
                "no game has {fixed} 1, so there is nothing to compare"
            );
            let told = format!("{} with {fixed} 1", games_told(games.len()));
            let mut sheet = best_of_rows(grid(games, varied.to_owned())?.sheet());
            sheet.notes.push(told);
            Ok(sheet)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_columns() {
        let pivoted = |by: &[&str]| pivot(by.iter().map(|&name| name.to_owned()).collect());
        let (rows, columns) = pivoted(&["task", "model"]);
        assert_eq!((rows, columns), (vec!["model".to_owned()], vec!["task".to_owned()]));
        let (rows, columns) = pivoted(&["model", "num_agents", "view_size"]);
        assert_eq!((rows.len(), columns), (2, vec!["view_size".to_owned()]));
        assert_eq!(pivoted(&["task"]).1, Vec::<String>::new());
    }
}
