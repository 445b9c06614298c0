//! Cells and sheets as text.

use std::iter;

use serde_json::{Map, Value, json};
use swarmbench_protocol::table::{text as guarded, write_csv};

use super::{Cell, Column, Kind, Sheet, SheetRow, one_line};

/// A cell for people. `between` separates its two parts.
pub(super) fn plain(cell: &Cell, kind: Kind, between: char) -> String {
    match cell {
        Cell::Empty => String::new(),
        Cell::Score { mean, deviation, games, .. } => {
            // On a line of its own, ± is adjacent to its number.
            let gap = if between == ' ' { " " } else { "" };
            format!("{mean:.2}{between}±{gap}{deviation:.2} ({games})")
        }
        Cell::Number(number) => match kind {
            Kind::Fixed(digits) => format!("{number:.digits$}"),
            Kind::Percent => format!("{number:+.1} %"),
            Kind::Score => number.to_string(),
        },
    }
}

fn in_markdown(cell: &Cell, kind: Kind) -> String {
    match cell {
        Cell::Score { best: true, .. } => format!("**{}**", plain(cell, kind, ' ')),
        _ => plain(cell, kind, ' '),
    }
}

fn in_latex(cell: &Cell, kind: Kind) -> String {
    match cell {
        Cell::Empty => String::new(),
        Cell::Score { mean, deviation, games, best } => {
            let score = format!("{mean:.2} \\pm {deviation:.2}");
            let score = if *best { format!("\\mathbf{{{score}}}") } else { score };
            format!("${score}$ ({games})")
        }
        Cell::Number(number) if kind == Kind::Percent => format!("${number:+.1}\\,\\%$"),
        Cell::Number(_) => format!("${}$", plain(cell, kind, ' ')),
    }
}

/// Escapes Markdown, so that names of players have no effect.
pub(super) fn escaped_markdown(text: &str) -> String {
    let mut escaped = String::new();
    for letter in one_line(text).chars() {
        if "\\`*_[]<>|#&".contains(letter) {
            escaped.push('\\');
        }
        escaped.push(letter);
    }
    escaped
}

pub(super) fn escaped_latex(text: &str) -> String {
    let mut escaped = String::new();
    for letter in one_line(text).chars() {
        match letter {
            '\\' => escaped.push_str("\\textbackslash{}"),
            '^' => escaped.push_str("\\textasciicircum{}"),
            '~' => escaped.push_str("\\textasciitilde{}"),
            '<' => escaped.push_str("\\textless{}"),
            '>' => escaped.push_str("\\textgreater{}"),
            '|' => escaped.push_str("\\textbar{}"),
            '{' | '}' | '$' | '&' | '#' | '_' | '%' => escaped.extend(['\\', letter]),
            letter => escaped.push(letter),
        }
    }
    escaped
}

pub(super) fn markdown(sheet: &Sheet) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let names = sheet.heads.iter().chain(sheet.columns.iter().map(|column| &column.name));
    let rules = sheet.heads.iter().map(|_| "---").chain(sheet.columns.iter().map(|_| "---:"));
    let rows = sheet.rows.iter().map(|row| {
        let cells = row.cells.iter().zip(&sheet.columns);
        let heads = row.heads.iter().map(|head| escaped_markdown(&head.to_string()));
        line(heads.chain(cells.map(|(cell, column)| in_markdown(cell, column.kind))).collect())
    });
    let top = line(names.map(|name| escaped_markdown(name)).collect())
        + &line(rules.map(str::to_owned).collect());
    iter::once(top).chain(rows).collect()
}

/// A `tabular` environment with rules of booktabs.
pub(super) fn latex(sheet: &Sheet) -> String {
    let line = |cells: Vec<String>| format!("{} \\\\\n", cells.join(" & "));
    let names = sheet.heads.iter().chain(sheet.columns.iter().map(|column| &column.name));
    let top = format!(
        "\\begin{{tabular}}{{@{{}}{}{}@{{}}}}\n\\toprule\n{}\\midrule\n",
        "l".repeat(sheet.heads.len()),
        "r".repeat(sheet.columns.len()),
        line(names.map(|name| escaped_latex(name)).collect())
    );
    let rows = sheet.rows.iter().map(|row| {
        let cells = row.cells.iter().zip(&sheet.columns);
        let heads = row.heads.iter().map(|head| escaped_latex(&head.to_string()));
        line(heads.chain(cells.map(|(cell, column)| in_latex(cell, column.kind))).collect())
    });
    let end = "\\bottomrule\n\\end{tabular}\n".to_owned();
    iter::once(top).chain(rows).chain([end]).collect()
}

/// All sheets as one JSON object: `tables`, each with its `rows` and `notes`, and the `notes` on all.
pub(super) fn json(sheets: &[Sheet], notes: &[String]) -> String {
    let value = |cell: &Cell| match cell {
        Cell::Empty => Value::Null,
        Cell::Score { mean, deviation, games, .. } => {
            json!({ "mean": mean, "deviation": deviation, "games": games })
        }
        Cell::Number(number) => json!(number),
    };
    let row = |sheet: &Sheet, row: &SheetRow| {
        let names = sheet.columns.iter().map(|column| column.name.clone());
        let cells: Map<String, Value> = names.zip(row.cells.iter().map(value)).collect();
        let heads: Map<String, Value> =
            sheet.heads.iter().cloned().zip(row.heads.iter().map(Value::from)).collect();
        json!({ "row": heads, "cells": cells })
    };
    let table = |sheet: &Sheet| {
        let rows: Vec<Value> = sheet.rows.iter().map(|of| row(sheet, of)).collect();
        // Tables had groups, and programs may read them.
        json!({ "group": {}, "rows": rows, "notes": sheet.notes })
    };
    let tables: Vec<Value> = sheets.iter().map(table).collect();
    format!("{:#}\n", json!({ "tables": tables, "notes": notes }))
}

/// Sheets in CSV with numbers in full precision. Sheets with the same columns share one table; an empty line separates others.
pub(super) fn csv(sheets: &[Sheet]) -> String {
    let mut tables: Vec<(Vec<String>, Vec<Vec<String>>)> = Vec::new();
    for sheet in sheets {
        let heads = sheet.heads.iter().cloned();
        let names = told_apart(heads.chain(sheet.columns.iter().flat_map(fields)));
        let rows = sheet.rows.iter().map(|row| {
            let heads = row.heads.iter().map(|head| guarded(&head.to_string()));
            let cells = row.cells.iter().zip(&sheet.columns);
            heads.chain(cells.flat_map(|(cell, column)| values(cell, column))).collect()
        });
        match tables.last_mut() {
            Some((last, all)) if *last == names => all.extend(rows),
            _ => tables.push((names, rows.collect())),
        }
    }
    let tables = tables.into_iter().map(|(names, rows)| write_csv(&names, rows.into_iter()));
    tables.collect::<Vec<_>>().join("\r\n")
}

/// The names of columns, of which no two are the same: `a b` and `a_b` are one name in CSV. The first keeps it.
fn told_apart(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    for name in names {
        let further = (2_usize..).map(|number| format!("{name}_{number}"));
        let free = iter::once(name.clone()).chain(further).find(|name| !all.contains(name));
        all.extend(free);
    }
    all
}

/// The columns of CSV of a column.
fn fields(column: &Column) -> Vec<String> {
    let name = guarded(&column.name).replace(", ", "_").replace(' ', "_");
    match column.kind {
        Kind::Score => ["mean", "deviation", "n"].map(|part| format!("{name}_{part}")).to_vec(),
        Kind::Percent => vec![format!("{name}_percent")],
        Kind::Fixed(_) => vec![name],
    }
}

fn values(cell: &Cell, column: &Column) -> Vec<String> {
    match cell {
        Cell::Empty => vec![String::new(); fields(column).len()],
        Cell::Score { mean, deviation, games, .. } => {
            vec![mean.to_string(), deviation.to_string(), games.to_string()]
        }
        Cell::Number(number) => vec![number.to_string()],
    }
}

#[cfg(test)]
mod tests {
    use super::super::SheetRow;
    use super::*;

    fn sheet(name: &str) -> Sheet {
        let kinds = [("score", Kind::Score), ("change", Kind::Percent), ("n", Kind::Fixed(0))];
        let cells = vec![
            Cell::Score { mean: 9.6, deviation: 0.25, games: 5, best: true },
            Cell::Number(41.379),
            Cell::Empty,
        ];
        Sheet {
            heads: vec!["model".to_owned()],
            columns: kinds.map(|(name, kind)| Column { name: name.to_owned(), kind }).to_vec(),
            rows: vec![SheetRow { heads: vec![name.into()], cells }],
            notes: Vec::new(),
        }
    }

    #[test]
    fn names_of_players_mean_nothing_to_latex() {
        assert_eq!(
            escaped_latex("\\input{a} $x$ & #1 ^2 _i ~ 5%\nb"),
            "\\textbackslash{}input\\{a\\} \\$x\\$ \\& \\#1 \\textasciicircum{}2 \\_i \
             \\textasciitilde{} 5\\% b"
        );
        let text = latex(&sheet("a_b & c"));
        assert!(
            text.contains("a\\_b \\& c & $\\mathbf{9.60 \\pm 0.25}$ (5) & $+41.4\\,\\%$ &  \\\\\n"),
            "{text}"
        );
        assert!(text.contains("model & score & change & n \\\\\n\\midrule"));
    }

    #[test]
    fn markdown_has_bold_and_escaped_names() {
        let text = markdown(&sheet("a|b*"));
        assert!(text.contains("| a\\|b\\* | **9.60 ± 0.25 (5)** | +41.4 % |"), "{text}");
    }

    #[test]
    fn no_two_columns_of_csv_have_one_name() {
        let mut sheet = sheet("b");
        let names = ["team 1", "team_1", "model", "team_1_2"];
        let column = |name: &str| Column { name: name.to_owned(), kind: Kind::Fixed(0) };
        sheet.columns = names.map(column).to_vec();
        sheet.rows.clear();
        assert_eq!(csv(&[sheet]), "model,team_1,team_1_2,model_2,team_1_2_2\r\n");
    }

    #[test]
    fn csv_has_full_precision_and_one_header_for_equal_columns() {
        let text = csv(&[sheet("=a"), sheet("b")]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            [
                "model,score_mean,score_deviation,score_n,change_percent,n",
                "'=a,9.6,0.25,5,41.379,",
                "b,9.6,0.25,5,41.379,",
            ]
        );
    }

    #[test]
    fn json_has_what_a_row_is_in_its_type() {
        use super::super::super::games::Value as Head;
        let heads = [
            ("model", "a".into(), json!("a")),
            ("num_agents", Head::Number(12.0), json!(12)),
            ("noise", Head::Number(0.2), json!(0.2)),
            ("mixed", Head::Flag(true), json!(true)),
            ("temperature", Head::Missing, Value::Null),
        ];
        let mut of = sheet("a");
        of.heads = heads.iter().map(|(name, ..)| (*name).to_owned()).collect();
        of.rows[0].heads = heads.iter().map(|(_, head, _)| head.clone()).collect();
        let written: Value = serde_json::from_str(&super::json(&[of], &[])).expect("JSON");
        let expected: Map<String, Value> =
            heads.into_iter().map(|(name, _, value)| (name.to_owned(), value)).collect();
        assert_eq!(written["tables"][0]["rows"][0]["row"], Value::Object(expected));
    }
}
