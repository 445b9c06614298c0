//! Tables and progress bars.

use std::io::Write as _;

use comfy_table::{Table, presets};
use indicatif::{ProgressBar, ProgressStyle};

pub(super) fn table(headings: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    if headings.iter().any(|heading| !heading.is_empty()) {
        table.set_header(headings);
    }
    table
}

/// A table of names and values.
pub(super) fn fields<'a>(rows: impl IntoIterator<Item = (&'a str, String)>) -> Table {
    let mut table = table(&["", ""]);
    table.add_rows(rows.into_iter().map(|(name, value)| [name.to_owned(), value]));
    table
}

/// Prints a text and a line feed; a reader that has gone is an error, not a panic.
pub(super) fn say(text: impl std::fmt::Display) -> anyhow::Result<()> {
    Ok(writeln!(std::io::stdout().lock(), "{text}")?)
}

/// A cell, empty without a value.
pub(super) fn cell(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

pub(super) fn rank(rank: Option<impl ToString>) -> String {
    rank.map_or_else(|| "–".to_owned(), |rank| rank.to_string())
}

pub(super) fn total(total: Option<f64>) -> String {
    cell(total.map(|total| format!("{total:.2}")))
}

pub(super) fn mean(mean: Option<f64>, deviation: Option<f64>) -> String {
    cell(mean.zip(deviation).map(|(mean, deviation)| format!("{mean:.2} ± {deviation:.2}")))
}

pub(super) fn progress_bar(template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).expect("a valid template");
    ProgressBar::new(0).with_style(style)
}

/// Shows that `done` of `all` is done.
pub(super) fn set(bar: &ProgressBar, done: u64, all: u64) {
    bar.set_length(all);
    bar.set_position(done);
}
