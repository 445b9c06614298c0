//! Numbers of the paper for comparison. They were made with the public toolkit instead of this server, so they are marked wherever
//! they are shown, and have no games to replay or to compare seed by seed.

use std::sync::LazyLock;

use serde::Deserialize;
use swarmbench_engine::TaskName;

use super::{RowId, scale};

swarmbench_engine::named! {
    /// Table of the paper that a row is from.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Table {
        /// Language models, five games a task.
        Models = "models",
        /// Rule-based baselines, each for one task, twenty games.
        Rules = "rules",
        /// People, or strategies that people had found.
        Humans = "humans",
    }
}

impl Table {
    /// Suite of the table's games.
    #[must_use]
    pub const fn suite(self) -> &'static str {
        match self {
            Self::Models => "standard",
            Self::Rules | Self::Humans => "baselines",
        }
    }
}

/// A row of the paper.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Id of the row.
    pub id: RowId,
    /// Table that the row is from.
    pub table: Table,
    /// Name of the player.
    pub name: String,
    /// Numbers by task.
    pub tasks: Vec<Numbers>,
}

/// Numbers of one task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers {
    /// Task.
    pub task: TaskName,
    /// Mean score.
    pub mean: f64,
    /// Standard deviation of the scores.
    pub deviation: f64,
    /// Number of games, if known.
    pub games: Option<u32>,
}

impl Reference {
    /// Numbers of a task.
    #[must_use]
    pub fn task(&self, task: TaskName) -> Option<&Numbers> {
        self.tasks.iter().find(|numbers| numbers.task == task)
    }

    /// Sum of the means of these tasks, if none is missing.
    #[must_use]
    pub fn total(&self, tasks: &[TaskName]) -> Option<f64> {
        tasks.iter().try_fold(0.0, |sum, &task| Some(sum + self.task(task)?.mean))
    }
}

/// Rule set of the paper's scores, which determines their scale.
pub const RULES: &str = "paper";

/// All rows in the order of the paper.
pub static REFERENCES: LazyLock<Vec<Reference>> = LazyLock::new(read);

/// All rows at the scale of the rules `reference`.
static CONVERTED: LazyLock<Vec<Reference>> = LazyLock::new(|| {
    let mut rows = REFERENCES.clone();
    for numbers in rows.iter_mut().flat_map(|row| &mut row.tasks) {
        let factor = scale::factor(numbers.task, RULES, "reference").unwrap_or(1.0);
        numbers.mean *= factor;
        numbers.deviation *= factor;
    }
    rows
});

/// Rows on the board of a built-in suite, at the scale of its rules.
pub fn rows(suite: &str, rules: &str) -> impl Iterator<Item = &'static Reference> {
    let all = if rules == RULES { &REFERENCES } else { &CONVERTED };
    all.iter().filter(move |row| row.table.suite() == suite)
}

/// A line of `reference.csv`.
#[derive(Deserialize)]
struct Line {
    table: Table,
    name: String,
    task: String,
    mean: f64,
    deviation: f64,
    games: Option<u32>,
}

fn read() -> Vec<Reference> {
    let mut rows: Vec<Reference> = Vec::new();
    for line in csv::Reader::from_reader(&include_bytes!("reference.csv")[..]).into_deserialize() {
        let Line { table, name, task, mean, deviation, games } = line.expect("a line of the file");
        let task = TaskName::parse(&task).expect("a task");
        let numbers = Numbers { task, mean, deviation, games };
        match rows.last_mut() {
            Some(row) if (row.table, &row.name) == (table, &name) => row.tasks.push(numbers),
            _ => {
                let id = RowId::of(&[b"reference", table.name().as_bytes(), name.as_bytes()]);
                rows.push(Reference { id, table, name, tasks: vec![numbers] });
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Last column of the table of models, as printed.
    const TOTALS: [(&str, &str); 13] = [
        ("gemini-2.0-flash", "27.40"),
        ("o4-mini", "26.62"),
        ("claude-3.7-sonnet", "25.70"),
        ("gpt-4.1", "20.10"),
        ("deepseek-v3", "17.20"),
        ("gpt-4o", "11.80"),
        ("o3-mini", "11.10"),
        ("qwq-32b", "10.10"),
        ("deepseek-r1", "10.01"),
        ("llama-3.1-70b", "9.90"),
        ("llama-4-scout", "9.50"),
        ("gpt-4.1-mini", "8.40"),
        ("claude-3.5-haiku", "7.20"),
    ];

    fn of(table: Table) -> impl Iterator<Item = &'static Reference> {
        REFERENCES.iter().filter(move |row| row.table == table)
    }

    #[test]
    fn the_models_add_up_to_the_totals_that_are_printed() {
        let totals = of(Table::Models)
            .map(|row| (row.name.as_str(), row.total(&TaskName::ALL).expect("all tasks")));
        let totals: Vec<_> = totals.map(|(name, total)| (name, format!("{total:.2}"))).collect();
        assert_eq!(totals, TOTALS.map(|(name, total)| (name, total.to_owned())));
        assert!(of(Table::Models).flat_map(|row| &row.tasks).all(|task| task.games == Some(5)));
    }

    #[test]
    fn rows_are_on_the_board_of_their_games_at_the_scale_of_its_rules() {
        assert_eq!(rows("standard", "paper").count(), 13);
        assert_eq!(rows("baselines", "paper").count(), 15 + 1);
        assert_eq!(rows("quick", "paper").count(), 0);
        for (paper, converted) in rows("baselines", "paper").zip(rows("baselines", "reference")) {
            for (ours, theirs) in paper.tasks.iter().zip(&converted.tasks) {
                let factor = if ours.task == TaskName::Flocking { 2.0 } else { 1.0 };
                let expected = (ours.mean * factor, ours.deviation * factor);
                assert_eq!((theirs.mean, theirs.deviation), expected);
            }
        }
    }

    #[test]
    fn every_number_of_the_three_tables_is_there() {
        let of_rules: Vec<_> = of(Table::Rules).collect();
        assert_eq!(of_rules.len(), 15);
        for task in TaskName::ALL {
            let three = of_rules.iter().filter(|row| row.task(task).is_some()).count();
            assert_eq!(three, 3, "{task:?}");
        }
        assert!(of_rules.iter().all(|row| row.tasks.len() == 1 && row.tasks[0].games == Some(20)));
        let humans: Vec<_> = of(Table::Humans).collect();
        assert_eq!(humans.len(), 1);
        let tasks: Vec<_> = humans[0].tasks.iter().map(|numbers| numbers.task).collect();
        assert_eq!(tasks.len(), 4);
        assert!(!tasks.contains(&TaskName::Pursuit), "the paper has no such row");
        assert_eq!(REFERENCES.iter().map(|row| row.tasks.len()).sum::<usize>(), 13 * 5 + 15 + 4);
        // Sums over whole columns of the printed tables.
        let sum = |table, number: fn(&Numbers) -> f64| {
            let numbers = of(table).flat_map(|row| &row.tasks).map(number).sum::<f64>();
            format!("{numbers:.2}")
        };
        assert_eq!(sum(Table::Models, |task| task.mean), "195.03");
        assert_eq!(sum(Table::Models, |task| task.deviation), "81.80");
        assert_eq!(sum(Table::Rules, |task| task.mean), "33.82");
        assert_eq!(sum(Table::Rules, |task| task.deviation), "18.17");
        assert_eq!(sum(Table::Humans, |task| task.mean), "78.66");
        assert_eq!(sum(Table::Humans, |task| task.deviation), "8.33");
    }
}
