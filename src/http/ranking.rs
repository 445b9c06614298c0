//! The board of a competition, from which its pages are made.

use std::sync::Arc;

use super::cache::Weighted;
use crate::competitions::standings::Version;
use swarmbench_protocol::competition::CompetitionRow;

#[derive(Debug, Default)]
pub(super) struct Ranking {
    pub(super) rows: Vec<CompetitionRow>,
    /// Tasks whose results are shown.
    pub(super) tasks: Vec<String>,
    /// Version of the entrants' results.
    pub(super) version: Version,
    bytes: usize,
}

impl Weighted for Arc<Ranking> {
    fn bytes(&self) -> usize {
        self.bytes
    }
}

impl Ranking {
    pub(super) fn new(rows: Vec<CompetitionRow>, version: Version) -> Self {
        let first = rows.iter().find(|row| !row.tasks.is_empty());
        let tasks = first.map_or(&[][..], |row| &row.tasks);
        let tasks = tasks.iter().map(|task| task.task.clone()).collect();
        let bytes = rows.iter().map(bytes).sum();
        Self { rows, tasks, version, bytes }
    }

    /// Index after this entrant; 0 if none is named. If the entrant is gone, its former number of rows decides.
    pub(super) fn after(&self, entrant: Option<&(String, usize)>) -> usize {
        let Some((id, rows)) = entrant else { return 0 };
        let found = self.rows.iter().position(|row| row.entrant.id == *id);
        found.map_or(*rows, |found| found + 1).min(self.rows.len())
    }
}

/// Approximate memory of a row.
fn bytes(row: &CompetitionRow) -> usize {
    let entrant = &row.entrant;
    let texts = [&entrant.id, &entrant.name, &entrant.model, &entrant.status].map(String::len);
    let more = [&entrant.prompt_template, &entrant.reason, &row.run, &row.run_status]
        .map(|text| text.as_ref().map_or(0, String::len));
    let tasks: usize = row.tasks.iter().map(|task| size_of_val(task) + task.task.len()).sum();
    let to = row.difference.as_ref().map_or(0, |difference| difference.to.len());
    size_of_val(row) + to + texts.into_iter().chain(more).sum::<usize>() + tasks
}
