//! A table of numbers, written for a terminal or as CSV, Markdown or LaTeX.

mod text;

use std::path::PathBuf;

use anyhow::Context;
use comfy_table::{CellAlignment, ColumnConstraint, Table};

use super::games::Value;
use super::output::{table, width};
use swarmbench_commands::boards::{fit, short};
use text::{latex, markdown, plain};

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Format {
    Table,
    Csv,
    Markdown,
    /// A LaTeX table with the rules of the package booktabs.
    Latex,
    /// JSON, row by row, with numbers in full precision.
    Json,
}

#[derive(Debug, clap::Args)]
pub(super) struct Showing {
    /// The format of the table.
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
    /// Print JSON: the same as --format json.
    #[arg(long, conflicts_with = "format")]
    json: bool,
    /// The file to write the table into.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Kind of the cells of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Mean, deviation and number of games.
    Score,
    /// A number with this many decimal places.
    Fixed(usize),
    /// A change in percent.
    Percent,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum Cell {
    #[default]
    Empty,
    Score {
        mean: f64,
        deviation: f64,
        games: usize,
        /// Whether the score is the best of its row.
        best: bool,
    },
    Number(f64),
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct SheetRow {
    /// One value per head of the sheet.
    pub(super) heads: Vec<Value>,
    /// One cell per column of the sheet.
    pub(super) cells: Vec<Cell>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Sheet {
    /// Names of the columns that identify a row.
    pub(super) heads: Vec<String>,
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<SheetRow>,
    pub(super) notes: Vec<String>,
}

impl Showing {
    /// Writes sheets one below the other, followed by notes on all.
    pub(super) fn show(&self, sheets: &[Sheet], notes: &[String]) -> anyhow::Result<()> {
        let width = match &self.output {
            None => width(),
            Some(_) => u16::MAX,
        };
        let format = if self.json { Format::Json } else { self.format };
        let text = written(format, sheets, notes, width);
        match &self.output {
            Some(path) => std::fs::write(path, text).with_context(|| path.display().to_string())?,
            None if format == Format::Table => super::output::text(&text),
            None => super::output::data(&text),
        }
        if format == Format::Csv {
            // CSV has no place for sentences.
            for note in sheets.iter().flat_map(|sheet| &sheet.notes).chain(notes) {
                note!("{note}");
            }
        }
        Ok(())
    }
}

fn written(format: Format, sheets: &[Sheet], notes: &[String], width: u16) -> String {
    match format {
        Format::Csv => return text::csv(sheets),
        Format::Json => return text::json(sheets, notes),
        Format::Table | Format::Markdown | Format::Latex => {}
    }
    let sentence = |note: &String| match format {
        Format::Latex => format!("% {}\n", one_line(note)),
        Format::Markdown => format!("\n{}\n", text::escaped_markdown(note)),
        Format::Table | Format::Csv | Format::Json => format!("{note}\n"),
    };
    let mut parts: Vec<String> = (sheets.iter())
        .map(|sheet| {
            let body = match format {
                Format::Latex => latex(sheet),
                Format::Markdown => markdown(sheet),
                Format::Table | Format::Csv | Format::Json => {
                    terminal(sheet, 0..sheet.columns.len(), width)
                }
            };
            body + &sheet.notes.iter().map(sentence).collect::<String>()
        })
        .collect();
    parts.push(notes.iter().map(sentence).collect());
    let gap = if format == Format::Table { "" } else { "\n" };
    parts.join(gap)
}

fn one_line(text: &str) -> String {
    text.split(['\n', '\r']).collect::<Vec<_>>().join(" ")
}

/// Lays columns of a sheet out for `width` columns of a terminal: cells have two lines if it is too narrow, then the columns are
/// split into several tables.
fn terminal(sheet: &Sheet, columns: std::ops::Range<usize>, width: u16) -> String {
    for is_narrow in [false, true] {
        let (mut shown, least) = table_of(sheet, columns.clone(), is_narrow);
        if least <= width.into() || (is_narrow && columns.len() < 2) {
            fit(&mut shown, width);
            return format!("{shown}\n");
        }
    }
    let middle = columns.start + columns.len().div_ceil(2);
    terminal(sheet, columns.start..middle, width) + &terminal(sheet, middle..columns.end, width)
}

/// Minimum columns of a terminal into which a text may be wrapped.
const HEAD_COLUMNS: usize = 11;

/// A table in which only heads may wrap, and its minimum width in columns of a terminal.
fn table_of(sheet: &Sheet, columns: std::ops::Range<usize>, is_narrow: bool) -> (Table, usize) {
    let between = if is_narrow { '\n' } else { ' ' };
    let names = sheet.columns[columns.clone()].iter().map(|column| {
        let name = short(&column.name);
        if is_narrow { name.replace(' ', "\n") } else { name.to_owned() }
    });
    let headings: Vec<String> = sheet.heads.iter().cloned().chain(names).collect();
    let mut shown = table(&headings.iter().map(String::as_str).collect::<Vec<_>>());
    for row in &sheet.rows {
        let cells = row.cells[columns.clone()].iter().zip(&sheet.columns[columns.clone()]);
        let cells = cells.map(|(cell, column)| plain(cell, column.kind, between));
        let heads = row.heads.iter().map(|head| short(&head.to_string()).to_owned());
        shown.add_row(heads.chain(cells));
    }
    for column in shown.column_iter_mut().skip(sheet.heads.len()) {
        column.set_cell_alignment(CellAlignment::Right);
        column.set_constraint(ColumnConstraint::ContentWidth);
    }
    let whole = shown.lines().next().map_or(0, |line| line.chars().count());
    let spare = (0..sheet.heads.len()).map(|place| {
        let texts = sheet.rows.iter().map(|row| row.heads[place].to_string());
        let texts = texts.chain([sheet.heads[place].clone()]);
        let widest = texts.map(|text| text.chars().count()).max().unwrap_or(0);
        widest.saturating_sub(HEAD_COLUMNS)
    });
    let least = whole - spare.sum::<usize>();
    (shown, least)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(columns: usize) -> Sheet {
        let cell = Cell::Score { mean: 9.6, deviation: 0.489_9, games: 5, best: false };
        let name = |number| format!("Task {number}");
        Sheet {
            heads: vec!["model".to_owned()],
            columns: (0..columns)
                .map(|number| Column { name: name(number), kind: Kind::Score })
                .collect(),
            rows: vec![SheetRow {
                heads: vec!["a-model-of-26-characters-x".into()],
                cells: vec![cell; columns],
            }],
            notes: Vec::new(),
        }
    }

    #[test]
    fn every_table_fits_80_columns_and_no_number_is_broken() {
        for columns in [1, 3, 5, 6, 12] {
            let shown = terminal(&sheet(columns), 0..columns, 80);
            let widest = shown.lines().map(|line| line.chars().count()).max();
            assert!(widest <= Some(80), "{shown}");
            assert_eq!(shown.matches("±").count(), columns, "{shown}");
            assert_eq!(shown.matches("0.49 (5)").count(), columns, "{shown}");
        }
        let wide = terminal(&sheet(12), 0..12, u16::MAX);
        assert!(wide.contains("9.60 ± 0.49 (5)"), "{wide}");
    }

    #[test]
    fn sentences_are_comments_of_latex() {
        let notes = ["a\n\\input{b}".to_owned()];
        let text = written(Format::Latex, &[sheet(1)], &notes, 80);
        assert!(text.contains("\n% a \\input{b}\n"), "{text}");
    }
}
