//! Computations of the paper's tables beyond means.

use std::collections::BTreeSet;

use anyhow::{Context, ensure};
use swarmbench_analysis::means::mean;

use super::super::games::{RankedValue, Value};
use super::super::sheet::{Cell, Column, Kind, Sheet};
use super::grid::{Grid, Key};

/// Change from `old` to `new` in percent; none if `old` is 0.
fn change(new: f64, old: f64) -> Option<f64> {
    (old != 0.0).then(|| (new - old) / old * 100.0)
}

fn number(number: Option<f64>) -> Cell {
    number.map_or(Cell::Empty, Cell::Number)
}

fn column(name: &str, kind: Kind) -> Column {
    Column { name: name.to_owned(), kind }
}

/// Sorts rows by total, highest first; rows without a total come last.
pub(super) fn sorted_by_total(mut sheet: Sheet) -> Sheet {
    sheet.rows.sort_by(|a, b| match (a.cells.last(), b.cells.last()) {
        (Some(Cell::Number(a)), Some(Cell::Number(b))) => b.total_cmp(a),
        (a, b) => matches!(b, Some(Cell::Number(_))).cmp(&matches!(a, Some(Cell::Number(_)))),
    });
    sheet
}

/// Marks the highest mean of each row.
pub(super) fn best_of_rows(mut sheet: Sheet) -> Sheet {
    for row in &mut sheet.rows {
        let means = row.cells.iter().filter_map(|cell| match cell {
            Cell::Score { mean, .. } => Some(*mean),
            _ => None,
        });
        let highest = means.fold(f64::NEG_INFINITY, f64::max);
        for cell in &mut row.cells {
            if let Cell::Score { mean, best, .. } = cell {
                *best = *mean >= highest;
            }
        }
    }
    sheet.notes.push("bold: the highest mean of its row (in Markdown and LaTeX)".to_owned());
    sheet
}

/// Scores of centralized and decentralized control, and the change from the second to the first.
pub(super) fn centralized(grid: &Grid) -> anyhow::Result<Sheet> {
    let of = |control: &str| -> anyhow::Result<Key> {
        let key = vec![RankedValue::of("control", &Value::Text(control.into()))];
        ensure!(
            grid.columns.contains(&key),
            "no game has {control} control, and the table compares both: \
             `swarmbench eval examples/eval/centralized.toml` plays them"
        );
        Ok(key)
    };
    let (new, old) = (of("centralized")?, of("decentralized")?);
    let columns = vec![
        column("centralized", Kind::Score),
        column("decentralized", Kind::Score),
        column("change", Kind::Percent),
    ];
    Ok(grid.sheet_of(columns, |row| {
        let means = grid.mean(row, &new).zip(grid.mean(row, &old));
        let change = means.and_then(|(new, old)| change(new, old));
        vec![grid.cell(row, &new), grid.cell(row, &old), number(change)]
    }))
}

/// Scores with noise and delay in each task, their average, the average of the same tasks without, and the change.
pub(super) fn noise(grid: &Grid) -> anyhow::Result<Sheet> {
    let none = || RankedValue::of("noise", &Value::Number(0.0));
    let (quiet, noisy): (BTreeSet<&[RankedValue]>, BTreeSet<&[RankedValue]>) =
        (grid.columns.iter())
            .map(|column| &column[..2])
            .partition(|condition| *condition == [none(), none()]);
    let quiet = quiet.first().context(
        "no game is without noise and delay, and the table compares with such: \
         `swarmbench eval examples/eval/noise.toml` plays both",
    )?;
    let told = |condition: &&[RankedValue]| {
        format!("noise {} max_delay {}", condition[0].1, condition[1].1)
    };
    let all: Vec<String> = noisy.iter().map(told).collect();
    ensure!(
        all.len() == 1,
        "the table compares one kind of noise and delay with none, and these games have {}: select with --where \
         noise=0,0.2 --where max_delay=0,4",
        if all.is_empty() { "none".to_owned() } else { all.join("; ") }
    );
    let noisy = noisy.first().context("there is one")?;
    let tasks: BTreeSet<&RankedValue> = grid.columns.iter().map(|column| &column[2]).collect();
    let key = |condition: &[RankedValue], task: &RankedValue| -> Key {
        condition.iter().chain([task]).cloned().collect()
    };
    let average = |row: &Key, condition: &[RankedValue]| {
        let means: Option<Vec<f64>> =
            tasks.iter().map(|task| grid.mean(row, &key(condition, task))).collect();
        mean(&means?)
    };
    let mut columns: Vec<Column> =
        tasks.iter().map(|task| column(&task.1.to_string(), Kind::Score)).collect();
    columns.push(column("original average", Kind::Fixed(2)));
    columns.push(column("average", Kind::Fixed(2)));
    columns.push(column("change", Kind::Percent));
    let mut sheet = grid.sheet_of(columns, |row| {
        let (old, new) = (average(row, quiet), average(row, noisy));
        let change = new.zip(old).and_then(|(new, old)| change(new, old));
        let cells = tasks.iter().map(|task| grid.cell(row, &key(noisy, task)));
        cells.chain([number(old), number(new), number(change)]).collect()
    });
    sheet.notes.push(format!(
        "tasks and average: {}; original average: of the same tasks without; a model has averages if it played all tasks \
         both ways",
        all.concat()
    ));
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table S.5 of the paper prints +5, +41 and +164 %: it truncates decimals.
    #[test]
    fn changes_of_the_paper() {
        let found = [(9.9, 9.4), (8.2, 5.8), (8.8, 8.8), (9.0, 3.4)]
            .map(|(new, old)| change(new, old).map(f64::trunc));
        assert_eq!(found, [5.0, 41.0, 0.0, 164.0].map(Some));
        assert_eq!(change(0.0, 0.0), None);
    }
}
