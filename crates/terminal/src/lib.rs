//! Input and output of programs: [`arguments`], text, tables, JSON and progress bars. The server's program and
//! `crates/bench` share it.
//!
//! Much of the text comes from others: names, journals, responses of servers. Control characters would act on a terminal, and
//! direction marks make a text look like another one, so text is escaped here ([`shown`]), also when it goes to a file, which may
//! be read in a terminal later. Data for programs (JSON, CSV, exports) are escaped only on a terminal.
//!
//! A reader may close standard output or standard error at any time, as `| head` does. That neither ends a command nor changes its
//! exit code: the rest of the text is dropped. Only a [`Stream`], whose length is unbounded, ends early.

use std::borrow::Cow;
use std::io::{self, ErrorKind, IsTerminal as _, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

use comfy_table::{Table, presets};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};
use serde::Serialize;
use swarmbench_protocol::names::shown;

pub mod arguments;

/// Prints a line to the standard output.
#[macro_export]
macro_rules! out {
    ($($text:tt)*) => {
        $crate::text(&format_args!("{}\n", format_args!($($text)*)))
    };
}

/// Prints a line to the standard error.
#[macro_export]
macro_rules! note {
    ($($text:tt)*) => {
        $crate::note_line(&format_args!($($text)*))
    };
}

/// First error of standard output, other than a reader that has gone.
static FAILED: OnceLock<io::Error> = OnceLock::new();

/// Interval between lines of progress if there is no terminal.
pub const LINE_EVERY: Duration = Duration::from_mins(1);

/// True if a [`Stream`] has lost its reader.
static CUT: AtomicBool = AtomicBool::new(false);

/// Prints text for people to standard output. [`code`] reports errors.
pub fn text(text: &dyn std::fmt::Display) {
    check(io::stdout().lock().write_all(shown(&text.to_string()).as_bytes()));
}

/// Prints data for programs to standard output.
pub fn data(data: &str) {
    let data = if io::stdout().is_terminal() { shown(data) } else { Cow::Borrowed(data) };
    check(io::stdout().lock().write_all(data.as_bytes()));
}

/// Implementation of `note!`. Its errors cannot be reported anywhere.
pub fn note_line(line: &dyn std::fmt::Display) {
    drop(writeln!(io::stderr().lock(), "{}", shown(&line.to_string())));
}

/// Prints a value as JSON.
///
/// # Errors
/// If the value has no form in JSON.
pub fn json(value: &impl Serialize) -> anyhow::Result<()> {
    data(&(serde_json::to_string_pretty(value)? + "\n"));
    Ok(())
}

fn check(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        // Only the first error is reported.
        drop(FAILED.set(error));
    }
}

/// Standard output for data of any length. A write without a reader is an error, which ends the command successfully.
#[derive(Debug)]
pub struct Stream(io::Stdout);

/// Standard output as a stream.
#[must_use]
pub fn stream() -> Stream {
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
        if self.0.is_terminal() {
            let text = String::from_utf8_lossy(bytes);
            return Self::noting(self.0.write_all(shown(&text).as_bytes())).map(|()| bytes.len());
        }
        Self::noting(self.0.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        Self::noting(self.0.flush())
    }
}

/// An error and its causes, except causes that the sentence before already contains.
fn in_words(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Prints the error of a command, if any, and the advice that `hint` has for it. Returns the exit code of the process.
pub fn code(
    result: anyhow::Result<ExitCode>,
    hint: impl Fn(&anyhow::Error) -> &'static str,
) -> ExitCode {
    check(io::stdout().flush());
    match (result, FAILED.get()) {
        (Err(_), _) if CUT.load(Ordering::Relaxed) => ExitCode::SUCCESS,
        (Err(error), _) => {
            note!("error: {}{}", in_words(&error), hint(&error));
            ExitCode::FAILURE
        }
        (Ok(_), Some(error)) => {
            note!("error: the standard output cannot be written: {error}");
            ExitCode::FAILURE
        }
        (Ok(code), None) => code,
    }
}

/// An empty table with a heading for each column; without a heading if all are empty.
#[must_use]
pub fn table(headings: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    if headings.iter().any(|heading| !heading.is_empty()) {
        table.set_header(headings);
    }
    table
}

/// A table of names and values.
#[must_use]
pub fn fields<'a>(rows: impl IntoIterator<Item = (&'a str, String)>) -> Table {
    let mut table = table(&["", ""]);
    table.add_rows(rows.into_iter().map(|(name, value)| [name.to_owned(), value]));
    table
}

/// Text of a cell; empty without a value.
#[must_use]
pub fn cell(value: Option<impl ToString>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// Terminal of standard error for progress bars. Escapes their texts, so that only the bars move the cursor.
#[derive(Debug, Default)]
struct Terminal(Mutex<Vec<u8>>);

impl Terminal {
    fn push(&self, text: &str) -> io::Result<()> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).write_all(text.as_bytes())
    }

    fn go(&self, cells: usize, way: char) -> io::Result<()> {
        if cells == 0 { Ok(()) } else { self.push(&format!("\u{1b}[{cells}{way}")) }
    }
}

impl TermLike for Terminal {
    fn width(&self) -> u16 {
        note_width().unwrap_or(80)
    }

    fn move_cursor_up(&self, n: usize) -> io::Result<()> {
        self.go(n, 'A')
    }

    fn move_cursor_down(&self, n: usize) -> io::Result<()> {
        self.go(n, 'B')
    }

    fn move_cursor_right(&self, n: usize) -> io::Result<()> {
        self.go(n, 'C')
    }

    fn move_cursor_left(&self, n: usize) -> io::Result<()> {
        self.go(n, 'D')
    }

    fn write_line(&self, line: &str) -> io::Result<()> {
        self.push(&format!("{}\n", shown(line)))
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        self.push(&shown(text))
    }

    fn clear_line(&self) -> io::Result<()> {
        self.push("\r\u{1b}[2K")
    }

    fn flush(&self) -> io::Result<()> {
        let drawn = std::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner));
        io::stderr().lock().write_all(&drawn)
    }
}

/// Draw target of progress bars: hidden if standard error is not a terminal.
fn draw_target() -> ProgressDrawTarget {
    let is_dumb = std::env::var_os("TERM").is_some_and(|name| name == "dumb");
    if is_dumb || !is_watched() {
        return ProgressDrawTarget::hidden();
    }
    ProgressDrawTarget::term_like_with_hz(Box::<Terminal>::default(), 20)
}

/// True if the standard error is a terminal.
#[must_use]
pub fn is_watched() -> bool {
    io::stderr().is_terminal()
}

/// Columns of the terminal; no limit without one.
#[must_use]
pub fn width() -> u16 {
    terminal_size::terminal_size().map_or(u16::MAX, |(width, _)| width.0)
}

/// Columns of standard error, if it is a terminal.
#[must_use]
pub fn note_width() -> Option<u16> {
    terminal_size::terminal_size_of(io::stderr()).map(|(columns, _)| columns.0)
}

/// A progress bar that is drawn by `template`.
#[must_use]
pub fn progress_bar(template: &str) -> ProgressBar {
    ProgressBar::with_draw_target(Some(0), draw_target()).with_style(style(template))
}

/// Progress bars below each other.
#[must_use]
pub fn progress_bars() -> MultiProgress {
    MultiProgress::with_draw_target(draw_target())
}

/// A style of progress bars.
///
/// # Panics
/// If the template is not one of indicatif.
#[must_use]
pub fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("a valid template")
}

/// Sets a bar to `done` of `all`.
pub fn set(bar: &ProgressBar, done: u64, all: u64) {
    bar.set_length(all);
    bar.set_position(done);
}

/// Wraps a sentence at `width` columns; a longer word gets a line of its own. Further lines are indented.
#[must_use]
pub fn wrapped(text: &str, width: usize) -> String {
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
