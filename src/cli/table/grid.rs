//! Games in the cells of a table.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::ensure;
use swarmbench_analysis::means::mean_and_deviation;

use super::super::games::{Axes, RankedValue, Selected, Value, games_told};
use super::super::sheet::{Cell, Column, Kind, Sheet, SheetRow};

/// Maximum rows or columns of a table.
const LINES_MAX: usize = 1000;

/// Columns of the games from which a table is made.
pub(super) struct Layout {
    pub(super) rows: Vec<String>,
    pub(super) columns: Vec<String>,
    pub(super) value: String,
    /// Columns in which games may differ.
    pub(super) ignored: Vec<String>,
    /// Option by which the user names the rows.
    pub(super) option: &'static str,
}

/// Values of some columns of a game.
pub(super) type Key = Vec<RankedValue>;

pub(super) struct Grid {
    pub(super) layout: Layout,
    pub(super) rows: BTreeSet<Key>,
    pub(super) columns: BTreeSet<Key>,
    /// Defined values of the games by row and column.
    cells: BTreeMap<(Key, Key), Vec<f64>>,
    pub(super) notes: Vec<String>,
}

impl Grid {
    /// # Errors
    /// If a column does not exist, there is no value, or games of different settings share a cell.
    pub(super) fn of(
        selected: &Selected,
        chosen: Vec<usize>,
        layout: Layout,
    ) -> anyhow::Result<Self> {
        let Selected { games, .. } = selected;
        let apart: Vec<String> = layout.rows.iter().chain(&layout.columns).cloned().collect();
        for column in &apart {
            games.check_column(column)?;
        }
        let axes = Axes { apart: &apart, ignored: &layout.ignored, option: layout.option };
        let shared = games.shared(&chosen, &axes)?;
        games.check_numbers(&layout.value, &chosen)?;
        let key = |names: &[String], game: usize| -> Key {
            names.iter().map(|name| RankedValue::of(name, games.value(name, game))).collect()
        };
        let mut seeds: BTreeMap<(Key, Key), BTreeSet<RankedValue>> = BTreeMap::new();
        let mut grid = Self {
            rows: BTreeSet::new(),
            columns: BTreeSet::new(),
            cells: BTreeMap::new(),
            notes: vec![format!("{}: mean ± population standard deviation (games)", layout.value)],
            layout,
        };
        let mut undefined = 0;
        for game in chosen {
            let place = (key(&grid.layout.rows, game), key(&grid.layout.columns, game));
            grid.rows.insert(place.0.clone());
            grid.columns.insert(place.1.clone());
            seeds
                .entry(place.clone())
                .or_default()
                .insert(RankedValue::of("seed", games.value("seed", game)));
            match games.number(&grid.layout.value, game) {
                Some(value) => grid.cells.entry(place).or_default().push(value),
                None => undefined += 1,
            }
        }
        ensure!(!grid.cells.is_empty(), "{} is undefined in all of these games", grid.layout.value);
        for lines in [&grid.rows, &grid.columns] {
            ensure!(
                lines.len() <= LINES_MAX,
                "the table would have {} rows or columns, more than {LINES_MAX}",
                lines.len()
            );
        }
        grid.notes.extend(shared);
        if seeds.values().collect::<BTreeSet<_>>().len() > 1 {
            grid.notes.push("cells differ in their seeds, so in the layouts played".to_owned());
        }
        if undefined > 0 {
            let undefined = games_told(undefined);
            grid.notes
                .push(format!("in {undefined} {} is undefined: not counted", grid.layout.value));
        }
        Ok(grid)
    }

    pub(super) fn cell(&self, row: &Key, column: &Key) -> Cell {
        let scores = self.cells.get(&(row.clone(), column.clone()));
        let found = scores.and_then(|scores| Some((scores.len(), mean_and_deviation(scores)?)));
        found.map_or(Cell::Empty, |(games, (mean, deviation))| Cell::Score {
            mean,
            deviation,
            games,
            best: false,
        })
    }

    pub(super) fn mean(&self, row: &Key, column: &Key) -> Option<f64> {
        match self.cell(row, column) {
            Cell::Score { mean, .. } => Some(mean),
            _ => None,
        }
    }

    fn head(row: &Key) -> Vec<Value> {
        row.iter().map(|place| place.1.clone()).collect()
    }

    fn heading(&self, column: &Key) -> String {
        if column.is_empty() {
            return self.layout.value.clone();
        }
        let parts = self.layout.columns.iter().zip(Self::head(column)).map(|(name, value)| {
            let is_clear = matches!(name.as_str(), "task" | "model" | "control" | "rules");
            if is_clear { value.to_string() } else { format!("{name} {value}") }
        });
        parts.collect::<Vec<_>>().join(", ")
    }

    /// A sheet with these columns, and the cells of each row.
    pub(super) fn sheet_of(
        &self,
        columns: Vec<Column>,
        cells: impl Fn(&Key) -> Vec<Cell>,
    ) -> Sheet {
        let row = |row: &Key| SheetRow { heads: Self::head(row), cells: cells(row) };
        Sheet {
            heads: self.layout.rows.clone(),
            columns,
            rows: self.rows.iter().map(row).collect(),
            notes: self.notes.clone(),
        }
    }

    /// A sheet of all cells. Scores of tasks have a total: the sum of the means, if the row has all.
    pub(super) fn sheet(&self) -> Sheet {
        let mut columns: Vec<Column> = (self.columns.iter())
            .map(|column| Column { name: self.heading(column), kind: Kind::Score })
            .collect();
        let has_total = self.layout.columns == ["task"] && self.layout.value == "score";
        if has_total {
            columns.push(Column { name: "total".to_owned(), kind: Kind::Fixed(2) });
        }
        self.sheet_of(columns, |row| {
            let mut cells: Vec<Cell> =
                self.columns.iter().map(|column| self.cell(row, column)).collect();
            if has_total {
                let means = self.columns.iter().map(|column| self.mean(row, column));
                cells.push(means.sum::<Option<f64>>().map_or(Cell::Empty, Cell::Number));
            }
            cells
        })
    }
}
