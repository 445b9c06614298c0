//! What commands print: text, tables, JSON and progress bars.
//!
//! A reader may close the standard output or the standard error at any time, as `| head` does. That neither ends a command
//! nor changes its exit code: the rest of its text is dropped. Only a [`Stream`], whose length has no bound, ends early.

use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use comfy_table::{Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use swarmbench_client::client::ClientError;
use swarmbench_protocol::failure::Failures;

use crate::server::StartError;

/// Prints a line to the standard output.
macro_rules! out {
    ($($text:tt)*) => {
        $crate::cli::output::text(&format_args!("{}\n", format_args!($($text)*)))
    };
}

/// Prints a line to the standard error.
macro_rules! note {
    ($($text:tt)*) => {
        $crate::cli::output::note_line(&format_args!($($text)*))
    };
}

/// The first error of the standard output that is not about a reader that has gone.
static FAILED: OnceLock<io::Error> = OnceLock::new();

/// Whether a [`Stream`] has lost its reader.
static CUT: AtomicBool = AtomicBool::new(false);

/// Prints a text to the standard output. [`code`] reports what fails.
pub(super) fn text(text: &dyn std::fmt::Display) {
    let mut out = io::stdout().lock();
    check(write!(out, "{text}"));
}

/// What `note!` is made of. Nobody can be told of its errors.
pub(super) fn note_line(line: &dyn std::fmt::Display) {
    drop(writeln!(io::stderr().lock(), "{line}"));
}

/// Prints a value as indented JSON.
pub(super) fn json(value: &impl Serialize) -> anyhow::Result<()> {
    out!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}

fn check(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        // Only the first one is reported.
        drop(FAILED.set(error));
    }
}

/// The standard output for data of any length. A write without a reader is an error, which ends the command with success.
pub(super) struct Stream(io::Stdout);

pub(super) fn stream() -> Stream {
    Stream(io::stdout())
}

impl Stream {
    fn noting<T>(result: io::Result<T>) -> io::Result<T> {
        if result.as_ref().is_err_and(|error| error.kind() == ErrorKind::BrokenPipe) {
            CUT.store(true, Ordering::Relaxed);
        }
        result
    }
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Self::noting(self.0.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        Self::noting(self.0.flush())
    }
}

/// An error and its causes, without those that the sentence before them has already.
fn in_words(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// What to do about a server that asks for a key.
fn hint(error: &anyhow::Error) -> &'static str {
    let mut refused = error.chain().filter_map(|cause| cause.downcast_ref::<ClientError>());
    let is_keyless = refused.any(|error| {
        matches!(error, ClientError::Refused { problem, .. } if problem.code == "unauthorized")
    });
    if is_keyless { "; commands take a key from --key or SWARMBENCH_KEY" } else { "" }
}

/// The exit code of a server that has to be started again (`EX_TEMPFAIL` of sysexits).
const START_AGAIN: u8 = 75;

/// Prints the error of a command, if any, and returns the exit code of the process.
pub(super) fn code(result: anyhow::Result<ExitCode>) -> ExitCode {
    check(io::stdout().flush());
    match (result, FAILED.get()) {
        (Err(_), _) if CUT.load(Ordering::Relaxed) => ExitCode::SUCCESS,
        (Err(error), _) => {
            note!("error: {}{}", in_words(&error), hint(&error));
            match error.downcast_ref::<StartError>() {
                Some(StartError::Excluded) => ExitCode::from(START_AGAIN),
                _ => ExitCode::FAILURE,
            }
        }
        (Ok(_), Some(error)) => {
            note!("error: the standard output cannot be written: {error}");
            ExitCode::FAILURE
        }
        (Ok(code), None) => code,
    }
}

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

/// Rows whose reasons are shown below a board.
const REASONS_MAX: usize = 10;

/// Why answers did not count: the first rows of a board that have such answers, in lines of at most `width` columns.
pub(super) fn reasons<'a>(
    rows: impl Iterator<Item = (&'a str, &'a Failures)>,
    width: u16,
) -> Vec<String> {
    let failing: Vec<_> = rows.filter(|(_, failures)| !failures.is_empty()).collect();
    let shown = failing.iter().take(REASONS_MAX).map(|(name, failures)| {
        wrapped(&format!("{name}: answers that did not count: {}", failures.words()), width.into())
    });
    let more = failing.len().saturating_sub(REASONS_MAX);
    let rest = (more > 0).then(|| format!("and {more} more rows: --json has all"));
    shown.chain(rest).collect()
}

/// A sentence in lines of at most `width` columns; a longer word has a line of its own. Further lines are indented.
pub(super) fn wrapped(text: &str, width: usize) -> String {
    let (mut lines, mut column) = (String::new(), 0);
    for word in text.split(' ') {
        let length = word.chars().count();
        if column > 0 && column + 1 + length > width {
            lines.push_str("\n  ");
            column = 2;
        } else if column > 0 {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += length;
    }
    lines
}
