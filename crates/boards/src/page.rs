//! Pages of leaderboards and cross-play in their wire format.

use swarmbench_engine::TaskName;
use swarmbench_journal::Tally;
use swarmbench_protocol::board::{
    BoardRow, CrossPlay, CrossPlayPair, Leaderboard, RowDifference, TaskScore,
};
use swarmbench_protocol::run::RunHolder;

use super::collection::Ranked;
use super::cross_play::Pair;
use super::interval::Difference;
use super::rank::Source;
use super::reference::Table;
use super::result::TaskResult;
use super::run::{HUMAN, TEAM};
use super::{RowId, scale};

/// Note on rows of the paper.
const NOTE: &str = "a number of the paper, made with the public toolkit; not played here";

/// Note on rows of games read from files.
const IMPORTED: &str = "games from files; not played here, and not verified";

/// A page of a board: `limit` rows from index `start`.
#[must_use]
pub fn leaderboard(ranked: &Ranked, start: usize, limit: usize) -> Leaderboard {
    let end = ranked.rows.len().min(start.saturating_add(limit));
    let items = (start..end).map(|place| row(ranked, place)).collect();
    let last = ranked.rows[..end].last().filter(|_| end < ranked.rows.len());
    let name = |task: &TaskName| task.name().to_owned();
    Leaderboard {
        suite: ranked.board.suite.clone(),
        digest: ranked.board.digest.clone(),
        rules: ranked.board.rules.clone(),
        tasks: ranked.view.tasks.iter().map(name).collect(),
        sort: ranked.view.sort.as_ref().map_or_else(|| "total".to_owned(), name),
        pick: ranked.view.pick.name().to_owned(),
        rows: whole(ranked.rows.len()),
        metrics: Vec::new(),
        metrics_method: None,
        items,
        next_cursor: last.map(|row| write_cursor(row.id(), end)),
    }
}

/// True if every answer has a cost, but for those of players of the server, which have none.
fn are_whole(tally: &Tally, holders: &[RunHolder]) -> bool {
    let seats = |holder: &RunHolder| holder.seats.len() as u64;
    let all: u64 = holders.iter().map(seats).sum();
    let hosted: u64 = holders.iter().filter(|holder| holder.player.is_some()).map(seats).sum();
    // In each round every seat has one act, by its player or by the clock.
    let moves = tally.acts + tally.timeouts;
    let costless = (moves * hosted).checked_div(all).unwrap_or(0);
    tally.usage.priced >= tally.acts.saturating_sub(costless)
}

fn row(ranked: &Ranked, place: usize) -> BoardRow {
    let row = &ranked.rows[place];
    let tasks = ranked.view.tasks.iter();
    let difference = ranked.difference(place);
    let difference = difference.map(|(to, of)| row_difference(to.id().to_string(), of));
    let (total, rank, id) = (row.total(&ranked.view.tasks), row.rank, row.id().to_string());
    let shown_row = match &row.source {
        Source::Reference(reference) => BoardRow {
            reference: true,
            table: Some(reference.table.name().to_owned()),
            kind: kind(reference.table == Table::Humans),
            tasks: tasks
                .filter_map(|&task| {
                    let numbers = reference.task(task)?;
                    let score = TaskScore {
                        mean: Some(numbers.mean),
                        deviation: Some(numbers.deviation),
                        games: numbers.games,
                        planned: None,
                    };
                    Some((task.name().to_owned(), score))
                })
                .collect(),
            ..not_played_here(rank, id, total, &reference.name, NOTE)
        },
        Source::Imported(shown, _) => BoardRow {
            imported: true,
            vouched: Some(false),
            tasks: tasks
                .filter_map(|&task| shown.task(task))
                .map(|task| (task.task.name().to_owned(), score(task)))
                .collect(),
            ..not_played_here(rank, id, total, &shown.run.player.model, IMPORTED)
        },
        Source::Runs { shown, runs } => {
            let of: Vec<&TaskResult> = tasks.filter_map(|&task| shown.task(task)).collect();
            let mut tally = Tally::default();
            for task in &of {
                tally.merge(&task.tally);
            }
            let Tally { acts, timeouts, usage, .. } = tally;
            let has_tokens = tally.prompt_tokens > 0 || tally.completion_tokens > 0;
            let games: u32 = of.iter().map(|task| task.games).sum();
            let run = &shown.run;
            BoardRow {
                rank,
                id,
                owner: run.player.owner.as_ref().map(|owner| owner.name.clone()),
                model: run.player.model.clone(),
                temperature: run.player.temperature,
                top_p: run.player.top_p,
                sampling: run.player.sampling.clone(),
                prompt_template: run.player.prompt.template.clone(),
                prompt: run.prompt.clone(),
                answer_reader: run.answer_reader.clone(),
                vouched: Some(run.vouched),
                decentralization: run.decentralization.map(|kind| kind.name().to_owned()),
                kind: kind(run.is_human)
                    .or_else(|| (!run.player.holders.is_empty()).then(|| TEAM.to_owned())),
                holders: run.player.holders.clone(),
                runs: Some(whole(*runs)),
                run: Some(run.id.clone()),
                status: Some(run.status.clone()),
                started_at: Some(run.created_at.into()),
                total,
                tasks: of.iter().map(|task| (task.task.name().to_owned(), score(task))).collect(),
                difference,
                invalid_share: share(tally.invalid, acts),
                failures: tally.failures,
                timeout_share: share(timeouts, acts + timeouts),
                clock_out_share: share(timeouts, acts + timeouts),
                voided: Some(of.iter().map(|task| task.voided).sum()),
                prompt_tokens: Some(tally.prompt_tokens).filter(|_| has_tokens),
                completion_tokens: Some(tally.completion_tokens).filter(|_| has_tokens),
                usage,
                cost_usd: usage.cost_usd().map(|cost| cost / f64::from(games.max(1))),
                costs_are_whole: (usage.priced > 0).then(|| are_whole(&tally, &run.player.holders)),
                ..BoardRow::default()
            }
        }
    };
    let rules = row.rules(&ranked.board.rules);
    let of = |wanted: &dyn Fn(TaskName) -> bool| {
        let tasks = ranked.view.tasks.iter().filter(|task| wanted(**task));
        let names = tasks.map(|task| task.name().to_owned());
        names.filter(|name| shown_row.tasks.contains_key(name)).collect()
    };
    let to = ranked.board.rules.as_str();
    BoardRow {
        rules: rules.to_owned(),
        converted: of(&|task| scale::factor(task, rules, to).is_some()),
        other_rules: of(&|task| scale::differs(task, rules, to)),
        ..shown_row
    }
}

/// Distance of a row from the better row `to`.
pub(super) fn row_difference(to: String, difference: Difference) -> RowDifference {
    RowDifference {
        to,
        mean: difference.mean,
        low: difference.interval.map(|(low, _)| low),
        high: difference.interval.map(|(_, high)| high),
        pairs: whole(difference.pairs),
    }
}

/// A row without runs.
fn not_played_here(
    rank: Option<u32>,
    id: String,
    total: Option<f64>,
    model: &str,
    note: &str,
) -> BoardRow {
    BoardRow {
        rank,
        id,
        note: Some(note.to_owned()),
        model: model.to_owned(),
        total,
        ..BoardRow::default()
    }
}

/// Kind of a row, for those of people.
fn kind(is_human: bool) -> Option<String> {
    is_human.then(|| HUMAN.to_owned())
}

fn score(task: &TaskResult) -> TaskScore {
    TaskScore {
        mean: task.mean(),
        deviation: task.mean_and_deviation.map(|(_, deviation)| deviation),
        games: Some(task.games),
        planned: Some(task.planned),
    }
}

#[expect(clippy::cast_precision_loss, reason = "nobody gives 2⁵³ answers")]
fn share(part: u64, of: u64) -> Option<f64> {
    (of > 0).then(|| part as f64 / of as f64)
}

fn whole(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// Cursor: the last row of the page, and the index of the next one, in case that row leaves the board.
fn write_cursor(row: RowId, place: usize) -> String {
    format!("{row}-{place:x}")
}

/// Parses a cursor.
#[must_use]
pub fn read_cursor(text: &str) -> Option<(RowId, usize)> {
    let (row, place) = text.split_once('-')?;
    Some((RowId::parse(row)?, usize::from_str_radix(place, 16).ok()?))
}

/// A page of cross-play: `limit` pairs from index `start`.
#[must_use]
pub fn cross_play(pairs: &[Pair], start: usize, limit: usize) -> CrossPlay {
    let start = start.min(pairs.len());
    let end = pairs.len().min(start.saturating_add(limit));
    CrossPlay {
        items: pairs[start..end].iter().map(pair).collect(),
        next_cursor: (end < pairs.len()).then(|| format!("c{end:x}")),
    }
}

/// Index of the first pair of a page, from a cursor.
#[must_use]
pub fn read_cross_play_cursor(text: &str) -> Option<usize> {
    usize::from_str_radix(text.strip_prefix('c')?, 16).ok()
}

fn pair(pair: &Pair) -> CrossPlayPair {
    CrossPlayPair {
        task: pair.setting.task.name().to_owned(),
        rules: pair.setting.rules.clone(),
        settings: serde_json::from_str(&pair.setting.settings).unwrap_or_default(),
        models: pair.models.clone(),
        vouched: pair.vouched,
        games: whole(pair.games),
        mean: pair.mean,
        deviation: pair.deviation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_is_read_as_it_was_written() {
        let row = RowId([7; 16]);
        assert_eq!(read_cursor(&write_cursor(row, 50)), Some((row, 50)));
        for wrong in ["", "c1", "-", "0707-1", "zz-1", &format!("{row}-x")] {
            assert_eq!(read_cursor(wrong), None, "{wrong}");
        }
    }
}
