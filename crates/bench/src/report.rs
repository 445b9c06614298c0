//! Reports: tables on a terminal, JSON elsewhere.

use std::io::{IsTerminal as _, stdout};

use serde::Serialize;
use serde_json::Value;
use swarmbench_terminal::{self as terminal, fields, table};

/// Objects up to which each has a column of its own.
const COLUMNS_MAX: usize = 8;

/// Prints a report: its lists of objects as tables, each under its name, and its other values in one table before them.
/// Scripts, which read no terminal, get JSON.
pub(crate) fn print(report: &impl Serialize) -> anyhow::Result<()> {
    if !stdout().is_terminal() {
        return terminal::json(report);
    }
    let mut values = Vec::new();
    flatten(String::new(), &serde_json::to_value(report)?, &mut values);
    let (lists, single): (Vec<_>, Vec<_>) = values.into_iter().partition(|(_, v)| is_rows(v));
    out!("{}", fields(single.iter().map(|(name, value)| (name.as_str(), text(value)))));
    for (name, list) in lists {
        let rows = list.as_array().into_iter().flatten().map(|row| {
            let mut cells = Vec::new();
            flatten(String::new(), row, &mut cells);
            cells
        });
        let rows: Vec<_> = rows.collect();
        let headings: Vec<&str> = rows[0].iter().map(|(heading, _)| heading.as_str()).collect();
        let is_turned = rows.len() < COLUMNS_MAX;
        let mut shown = table(if is_turned { &[""] } else { &headings });
        if is_turned {
            shown.add_rows(headings.iter().enumerate().map(|(at, heading)| {
                let cells = rows.iter().filter_map(move |cells| cells.get(at));
                std::iter::once((*heading).to_owned()).chain(cells.map(|(_, value)| text(value)))
            }));
        } else {
            shown.add_rows(rows.iter().map(|cells| cells.iter().map(|(_, value)| text(value))));
        }
        out!("\n{name}\n{shown}");
    }
    Ok(())
}

/// Adds the values of nested objects, under their names joined by blanks. A list of objects stays one value.
fn flatten(name: String, value: &Value, values: &mut Vec<(String, Value)>) {
    let Value::Object(object) = value else { return values.push((name, value.clone())) };
    for (key, value) in object {
        flatten(format!("{name} {key}").trim().to_owned(), value, values);
    }
}

fn is_rows(value: &Value) -> bool {
    value.as_array().is_some_and(|list| list.first().is_some_and(Value::is_object))
}

fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => {
            number.as_f64().map_or_else(String::new, |number| format!("{number:.1}"))
        }
        Value::Array(list) => list.iter().map(text).collect::<Vec<_>>().join("\n"),
        other => other.to_string(),
    }
}
