//! Output that several commands share: the cells of boards, and advice.

use swarmbench_client::client::ClientError;
use swarmbench_protocol::failure::Failures;
pub use swarmbench_terminal::{
    LINE_EVERY, cell, data, fields, is_watched, json, note_width, progress_bar, progress_bars, set,
    stream, style, table, text, width, wrapped,
};

/// Advice when a server asks for a key.
pub fn hint(error: &anyhow::Error) -> &'static str {
    let mut refused = error.chain().filter_map(|cause| cause.downcast_ref::<ClientError>());
    let is_keyless = refused.any(|error| {
        matches!(error, ClientError::Refused { problem, .. } if problem.code == "unauthorized")
    });
    if is_keyless { "; commands take a key from --key or SWARMBENCH_KEY" } else { "" }
}

pub fn rank(rank: Option<impl ToString>) -> String {
    rank.map_or_else(|| "–".to_owned(), |rank| rank.to_string())
}

pub fn total(total: Option<f64>) -> String {
    cell(total.map(|total| format!("{total:.2}")))
}

pub fn mean(mean: Option<f64>, deviation: Option<f64>) -> String {
    cell(mean.zip(deviation).map(|(mean, deviation)| format!("{mean:.2} ± {deviation:.2}")))
}

/// Maximum rows whose reasons are shown below a board.
const REASONS_MAX: usize = 10;

/// Reasons for which answers did not count, for the first rows of a board that have some, in lines of at most `width` columns.
pub fn reasons<'a>(rows: impl Iterator<Item = (&'a str, &'a Failures)>, width: u16) -> Vec<String> {
    let failing: Vec<_> = rows.filter(|(_, failures)| !failures.is_empty()).collect();
    let shown = failing.iter().take(REASONS_MAX).map(|(name, failures)| {
        wrapped(&format!("{name}: answers that did not count: {}", failures.words()), width.into())
    });
    let more = failing.len().saturating_sub(REASONS_MAX);
    let rest = (more > 0).then(|| format!("and {more} more rows: --json has all"));
    shown.chain(rest).collect()
}
