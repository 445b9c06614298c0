//! Boards, as tables on a terminal.

use comfy_table::{CellAlignment, ContentArrangement, Table};
use swarmbench_engine::{AnswerReader, TaskName};
use swarmbench_protocol::board::{BoardRow, CrossPlay, CrossPlayPair, Leaderboard, RowDifference};

use crate::output::{self, mean, rank, reasons, table, total};

/// Minimum terminal width for confidence intervals and failures.
const WIDE: u16 = 132;

/// Prints a board.
pub fn show(board: &Leaderboard) {
    // Output to a file or a pipe has lines of any length.
    let width = output::width();
    let Leaderboard { suite, digest, rules, pick, sort, .. } = board;
    out!("{suite}@{digest}, rules {rules}, {pick} run of each, by {sort}");
    if board.items.is_empty() {
        out!("no run has finished yet");
        return;
    }
    out!("{}", rows(board, width));
    let failing = board.items.iter().map(|row| (row.model.as_str(), &row.failures));
    for reason in reasons(failing, width) {
        out!("{reason}");
    }
    out!("? this name is not vouched for   * a row of the paper");
    if board.items.iter().any(|row| !row.other_rules.is_empty()) {
        out!("≠ played by other rules than those of this board, at its scale");
    }
    out!("declared, enforced: whether each seat decided for itself");
    if width < WIDE {
        out!("{WIDE} columns, or --csv, also show confidence intervals and failures");
    }
}

fn rows(board: &Leaderboard, width: u16) -> Table {
    let is_wide = width >= WIDE;
    let mut headings = vec!["", "model"];
    headings.extend(board.tasks.iter().map(|task| short(task)));
    headings.push("total");
    let has_costs = is_wide && board.items.iter().any(|row| row.cost_usd.is_some());
    headings.extend(has_costs.then_some("$ a game"));
    if is_wide {
        headings.extend(["below the row above", "what went wrong"]);
    }
    let mut shown = table(&headings);
    fit(&mut shown, width);
    for row in &board.items {
        let mut cells = vec![rank(row.rank), player(row)];
        cells.extend(board.tasks.iter().map(|task| score(row, task)));
        cells.push(total(row.total));
        cells.extend(has_costs.then(|| cost(row)));
        if is_wide {
            cells.push(below(row.difference.as_ref()));
            cells.push(failures(row));
        }
        shown.add_row(cells);
    }
    for (number, column) in shown.column_iter_mut().enumerate() {
        if number != 1 && number < board.tasks.len() + 3 + usize::from(has_costs) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    shown
}

/// Mean cost of a game in US dollars; a lower bound where the cost of some answers is unknown.
fn cost(row: &BoardRow) -> String {
    let Some(cost) = row.cost_usd else { return String::new() };
    let mark = if row.costs_are_whole == Some(true) { "" } else { "≥" };
    format!("{mark}{cost:.4}")
}

/// Distance of a row from a better one, with the interval of 95 %.
pub fn below(difference: Option<&RowDifference>) -> String {
    let Some(difference) = difference else { return String::new() };
    let interval = match (difference.low, difference.high) {
        (Some(low), Some(high)) => format!("95 %: {low:.2} to {high:.2}"),
        _ => "too few seeds: no interval".to_owned(),
    };
    format!("{:.2}\n{interval}", difference.mean)
}

/// Wraps cells so that the table fits a terminal.
pub fn fit(table: &mut Table, width: u16) {
    if width < u16::MAX {
        table.set_content_arrangement(ContentArrangement::Dynamic).set_width(width);
    }
}

/// Heading of a task. The longest name is shortened.
pub fn short(task: &str) -> &str {
    if task == TaskName::Synchronization.name() { "Synchr." } else { task }
}

/// Player of a row, and remarks about its run.
fn player(row: &BoardRow) -> String {
    let mark = match (row.reference, row.vouched) {
        (true, _) => " *",
        (false, Some(false)) => " ?",
        (false, _) => "",
    };
    let mut text = format!("{}{mark}", row.model);
    let settings = [
        row.owner.as_ref().map(|owner| format!("by {owner}")),
        row.temperature.map(|temperature| format!("T {temperature}")),
        row.top_p.map(|top_p| format!("top_p {top_p}")),
        row.sampling.clone(),
        row.prompt.clone().filter(|name| name != "default").map(|name| format!("prompt {name}")),
        row.answer_reader.clone().filter(|name| !AnswerReader::is_usual(name)),
    ];
    let run = [
        row.imported.then(|| "from files".to_owned()),
        row.status.clone().filter(|status| status != "finished"),
        row.decentralization.clone(),
        row.kind.clone(),
        row.runs.filter(|&runs| runs > 1).map(|runs| format!("{runs} runs")),
    ];
    for line in [settings.as_slice(), run.as_slice()] {
        let parts: Vec<&str> = line.iter().flatten().map(String::as_str).collect();
        if !parts.is_empty() {
            text.push('\n');
            text.push_str(&parts.join(", "));
        }
    }
    for holder in &row.holders {
        text.push('\n');
        text.push_str(&holder.in_short());
    }
    text
}

/// Score of a task with its deviation below, and the number of games if some are missing.
fn score(row: &BoardRow, task: &String) -> String {
    let Some(score) = row.tasks.get(task) else { return String::new() };
    let (Some(mean), Some(deviation)) = (score.mean, score.deviation) else {
        return "–".to_owned();
    };
    let mark = if row.other_rules.contains(task) { "≠" } else { "" };
    let games = match (score.games, score.planned) {
        (Some(games), Some(planned)) if games < planned => format!("\n{games}/{planned}"),
        _ => String::new(),
    };
    format!("{mark}{mean:.2}\n±{deviation:.2}{games}")
}

fn failures(row: &BoardRow) -> String {
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let parts = [
        row.invalid_share
            .filter(|&share| share > 0.0)
            .map(|share| format!("{} invalid", percent(share))),
        (row.timeout_share.filter(|&share| share > 0.0))
            .map(|share| format!("{} out of time", percent(share))),
        row.voided.filter(|&voided| voided > 0).map(|voided| format!("{voided} not counted")),
    ];
    parts.into_iter().flatten().collect::<Vec<_>>().join("\n")
}

/// Prints how well models play together.
pub fn show_cross_play(found: &CrossPlay) {
    if found.items.is_empty() {
        out!("no episode with seats of several holders has finished yet");
        return;
    }
    let mut shown = table(&["task", "rules", "models", "games", "score", "settings"]);
    for pair in &found.items {
        let CrossPlayPair {
            task,
            rules,
            settings,
            models: [a, b],
            vouched,
            games,
            mean: score,
            deviation,
        } = pair;
        let mark = if *vouched { "" } else { " ?" };
        shown.add_row([
            task.clone(),
            rules.clone(),
            format!("{a}\n{b}{mark}"),
            games.to_string(),
            mean(Some(*score), Some(*deviation)),
            unusual(settings),
        ]);
    }
    out!("{shown}");
    out!("? one of these names is not vouched for");
}

/// Settings that differ from the standard.
fn unusual(settings: &serde_json::Map<String, serde_json::Value>) -> String {
    let standard = serde_json::to_value(swarmbench_protocol::suite::SuiteSettings::default());
    let standard = standard.unwrap_or_default();
    let other = settings.iter().filter(|(name, value)| standard.get(name) != Some(value));
    let parts: Vec<String> = other.map(|(name, value)| format!("{name} {value}")).collect();
    if parts.is_empty() { "standard".to_owned() } else { parts.join("\n") }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use swarmbench_protocol::act::UsageSums;
    use swarmbench_protocol::board::TaskScore;
    use swarmbench_protocol::failure::Failures;

    fn row(model: &str) -> BoardRow {
        let score =
            TaskScore { mean: Some(9.6), deviation: Some(0.49), games: Some(4), planned: Some(5) };
        let tasks: BTreeMap<String, TaskScore> =
            TaskName::ALL.iter().map(|task| (task.name().to_owned(), score)).collect();
        BoardRow {
            rank: Some(1),
            id: "0".repeat(32),
            reference: false,
            imported: false,
            rules: "paper".to_owned(),
            converted: Vec::new(),
            other_rules: Vec::new(),
            table: None,
            note: None,
            owner: Some("alice".to_owned()),
            model: model.to_owned(),
            temperature: Some(0.7),
            top_p: None,
            sampling: Some("effort low".to_owned()),
            prompt_template: None,
            prompt: Some("default".to_owned()),
            answer_reader: Some("last-marker".to_owned()),
            vouched: Some(false),
            decentralization: Some("declared".to_owned()),
            kind: None,
            holders: Vec::new(),
            runs: Some(2),
            run: Some("run_0".to_owned()),
            status: Some("aborted".to_owned()),
            started_at: None,
            total: Some(48.0),
            tasks,
            difference: None,
            invalid_share: Some(0.031),
            failures: Failures::EMPTY,
            timeout_share: Some(0.0),
            clock_out_share: Some(0.0),
            voided: Some(1),
            prompt_tokens: None,
            completion_tokens: None,
            usage: UsageSums::NONE,
            cost_usd: Some(0.032),
            costs_are_whole: Some(false),
            metrics: std::collections::BTreeMap::new(),
        }
    }

    #[test]
    fn a_row_has_all_columns_and_fits_a_terminal() {
        let board = Leaderboard {
            suite: "standard".to_owned(),
            digest: "0123456789ab".to_owned(),
            rules: "paper".to_owned(),
            tasks: TaskName::ALL.iter().map(|task| task.name().to_owned()).collect(),
            sort: "total".to_owned(),
            pick: "best".to_owned(),
            rows: 1,
            metrics: Vec::new(),
            metrics_method: None,
            items: vec![row("a-model-of-26-characters-x")],
            next_cursor: None,
        };
        let narrow = rows(&board, 80).to_string();
        // Long names are wrapped, and nothing is missing.
        for expected in
            ["?", "alice", "T 0.7", "aborted", "declared", "9.60", "±0.49", "4/5", "48.00"]
        {
            assert!(narrow.contains(expected), "{expected} is missing in\n{narrow}");
        }
        let widest = |text: &str| text.lines().map(|line| line.chars().count()).max();
        assert!(widest(&narrow) <= Some(80), "{narrow}");
        let wide = rows(&board, WIDE).to_string();
        assert!(widest(&wide) <= Some(WIDE.into()), "{wide}");
        assert!(wide.contains("3.1 % invalid") && wide.contains("1 not counted"), "{wide}");
        assert!(!wide.contains("out of time") && wide.contains(" ≥0.0320 "), "{wide}");
    }
}
