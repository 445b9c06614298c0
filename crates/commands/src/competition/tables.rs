//! Tables of competitions, entrants, attempts and boards.

use comfy_table::Table;

use crate::boards::below;
use crate::output::{self, cell, mean, rank, reasons, table, total};
use swarmbench_protocol::competition::{
    AttemptSummary, Competition, CompetitionBoard, EntrantContact, EntrantSummary, InvitationCodes,
    InvitationSummary, MemberSummary, OrganizerAction,
};
use swarmbench_protocol::names::printable;
use swarmbench_protocol::time::Timestamp;

pub(super) fn competitions(list: &[Competition]) -> Table {
    let mut table = table(&["competition", "name", "phase", "opens", "closes"]);
    for one in list {
        let (opens, closes) = (one.opens_at.to_string(), one.closes_at.to_string());
        table.add_row([&one.id, &one.name, &one.phase, &opens, &closes]);
    }
    table
}

pub(super) fn codes(codes: &InvitationCodes) -> Table {
    let mut table = table(&["for", "code"]);
    for code in &codes.items {
        table.add_row([&code.label, &code.code]);
    }
    table
}

pub(super) fn invitations(list: &[InvitationSummary]) -> Table {
    let mut table = table(&["for", "state", "entrant", "made", "revoked"]);
    for code in list {
        table.add_row([
            code.label.clone(),
            code.state.clone(),
            code.entrant.clone().unwrap_or_default(),
            code.created_at.to_string(),
            code.revoked_at.map(|at| at.to_string()).unwrap_or_default(),
        ]);
    }
    table
}

pub(super) fn actions(list: &[OrganizerAction]) -> Table {
    let mut table = table(&["time", "action", "of", "details"]);
    for action in list {
        table.add_row([
            action.at.to_string(),
            action.action.clone(),
            action.subject.clone(),
            action.detail.to_string(),
        ]);
    }
    table
}

pub(super) fn attempts(list: &[AttemptSummary]) -> Table {
    let mut table = table(&["entrant", "attempt", "run", "status", "games", "total", "note"]);
    for attempt in list {
        let voided = attempt.voided.as_ref().map(|reason| format!("does not count: {reason}"));
        let spare = attempt.on_spare_seeds.then(|| "on spare seeds".to_owned());
        let note = voided.or(spare);
        table.add_row([
            attempt.entrant.clone(),
            attempt.attempt.to_string(),
            attempt.run.clone(),
            attempt.status.clone(),
            format!("{} of {}", attempt.games_ended, attempt.games),
            total(attempt.total),
            note.unwrap_or_default(),
        ]);
    }
    table
}

pub(super) fn entrants(list: &[EntrantSummary]) -> Table {
    let mut table = table(&[
        "entrant",
        "name",
        "model",
        "category",
        "status",
        "reason",
        "vouched",
        "registered",
    ]);
    for entrant in list {
        table.add_row([
            entrant.id.clone(),
            entrant.name.clone(),
            entrant.model.clone(),
            entrant.category.clone().unwrap_or_default(),
            entrant.status.clone(),
            entrant.reason.clone().unwrap_or_default(),
            if entrant.vouched { "yes" } else { "no" }.to_owned(),
            entrant.registered_at.to_string(),
        ]);
    }
    table
}

pub(super) fn contacts(list: &[EntrantContact]) -> Table {
    let mut table = table(&["entrant", "name", "category", "status", "contact"]);
    for of in list {
        table.add_row([
            of.entrant.clone(),
            of.name.clone(),
            of.category.clone().unwrap_or_default(),
            of.status.clone(),
            of.contact.clone().unwrap_or_default(),
        ]);
    }
    table
}

pub(super) fn members(list: &[MemberSummary]) -> Table {
    let mut table = table(&["member", "name", "added", "removed"]);
    for member in list {
        table.add_row([
            member.id.clone(),
            member.name.clone(),
            member.added_at.to_string(),
            member.removed_at.map(|at| at.to_string()).unwrap_or_default(),
        ]);
    }
    table
}

pub(super) fn competition(competition: &Competition) -> Table {
    let mut shown = table(&["", ""]);
    let suite = &competition.suite;
    let tasks = suite.tasks.clone().unwrap_or_default().join(", ");
    let seeds = suite.seeds.unwrap_or_default();
    let clock = competition.clocks.round_deadline_s.map_or(0.0, |seconds| seconds.0);
    let time = |at: Option<Timestamp>| at.map_or_else(|| "?".to_owned(), |at| at.to_string());
    let mut row = |what: &str, value: String| {
        shown.add_row([what.to_owned(), value]);
    };
    row("competition", competition.id.clone());
    row("name", competition.name.clone());
    row("description", competition.description.clone());
    row("phase", competition.phase.clone());
    if let Some(reason) = &competition.cancel_reason {
        row("cancelled", format!("{}: {reason}", time(competition.cancelled_at)));
    }
    if competition.hidden {
        row("hidden", "in no list but the organizers'".to_owned());
    }
    row("opens", competition.opens_at.to_string());
    row("closes", competition.closes_at.to_string());
    let rules = suite.rules.clone().unwrap_or_default();
    row("plays", format!("{tasks}, each on {seeds} sealed seeds, rules {rules}"));
    row("clock", format!("{clock} s a round"));
    row("entry", competition.entry.clone());
    for (number, window) in (1..).zip(&competition.attempts) {
        let (opens, closes) = (time(window.opens_at), time(window.closes_at));
        row(&format!("attempt {number}"), format!("from {opens} until {closes}"));
    }
    if competition.spares > 0 {
        row(
            "spares",
            format!("{} attempts on other seeds in place of voided ones", competition.spares),
        );
    }
    row("counts", format!("the {} attempt", competition.counts));
    if !competition.tie_breaks.is_empty() {
        row("equal totals", format!("by {}", competition.tie_breaks.join(", then ")));
    }
    row("board", competition.board.clone());
    if let Some(public) = suite.public_seeds.filter(|public| *public > 0) {
        row("public seeds", format!("{public} of {seeds} until it closes, then the others"));
    }
    if competition.own_games == "ended" {
        row(
            "own games",
            "entrants read theirs once the window of the attempt has closed".to_owned(),
        );
    }
    if !competition.categories.is_empty() {
        row("categories", competition.categories.join(", "));
    }
    if let Some(terms) = &competition.terms {
        row("terms", format!("version {}\n{}", terms.version, printable(&terms.text)));
    }
    row("commitment", competition.commitment.clone());
    row("revision", competition.revision.clone());
    if let (Some(salt), Some(seeds)) = (&competition.salt, &competition.seeds) {
        row("salt", salt.clone());
        row("seeds", seeds.join("\n"));
    }
    shown
}

pub(super) fn print_board(board: &CompetitionBoard) {
    if board.shows == "nothing" {
        out!("The board is hidden until the competition is closed.");
        return;
    }
    let first = board.items.iter().find(|row| !row.tasks.is_empty());
    let tasks: Vec<String> =
        first.map_or(Vec::new(), |row| row.tasks.iter().map(|task| task.task.clone()).collect());
    let mut head = vec!["rank", "name", "model"];
    head.extend(tasks.iter().map(String::as_str));
    head.extend([
        "total",
        "below the row above",
        "attempt",
        "invalid",
        "clock",
        "decentralization",
        "status",
    ]);
    let mut shown = table(&head);
    for row in &board.items {
        let mut cells = vec![
            rank(row.rank),
            row.entrant.name.clone(),
            if row.entrant.vouched {
                row.entrant.model.clone()
            } else {
                format!("{} (not vouched for)", row.entrant.model)
            },
        ];
        for name in &tasks {
            let task = row.tasks.iter().find(|task| task.task == *name);
            cells.push(task.map_or_else(String::new, |task| mean(task.mean, task.deviation)));
        }
        let status = match &row.entrant.reason {
            Some(reason) => format!("{}: {reason}", row.entrant.status),
            None => row.entrant.status.clone(),
        };
        cells.extend([
            total(row.total),
            below(row.difference.as_ref()),
            match row.attempt {
                Some(attempt) if row.on_spare_seeds => format!("{attempt} (on spare seeds)"),
                attempt => cell(attempt),
            },
            format!("{:.1} %", 100.0 * row.invalid_share),
            format!("{:.1} %", 100.0 * row.timeout_share),
            row.decentralization.clone().unwrap_or_default(),
            status,
        ]);
        shown.add_row(cells);
    }
    out!("{shown}");
    let failing = board.items.iter().map(|row| (row.entrant.name.as_str(), &row.failures));
    let width = output::width();
    for reason in reasons(failing, width) {
        out!("{reason}");
    }
    if board.shows == "totals" {
        out!("The scores of each task are shown when the competition is closed.");
    }
    if let Some(at) = board.frozen_at {
        out!("The board is frozen: it shows attempts that ended before {at}.");
    }
}
