//! Error of an export without games, which names models that have some.

use std::collections::BTreeSet;
use std::io::{self, Write};

use serde::Deserialize;

use crate::dataset::rows::Splitter;

/// Maximum names in the error.
const SHOWN_MAX: usize = 10;

/// Maximum names that are compared.
const NAMES_MAX: usize = 10_000;

/// Models of games. A writer that takes rows of the table `episodes` as JSON Lines.
#[derive(Default)]
pub(super) struct Models {
    names: BTreeSet<String>,
    splitter: Splitter,
}

#[derive(Deserialize)]
struct ModelsRow {
    /// A JSON list.
    models: String,
}

impl Models {
    pub(super) fn add(&mut self, names: impl IntoIterator<Item = String>) {
        add(&mut self.names, names);
    }

    /// The most similar names, nearest first.
    fn nearest(&self, wanted: &str) -> Vec<&str> {
        let wanted = wanted.to_lowercase();
        let likeness = |name: &str| strsim::jaro_winkler(&wanted, &name.to_lowercase());
        let mut names: Vec<(f64, &str)> =
            self.names.iter().map(|name| (likeness(name), name.as_str())).collect();
        names.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        names.into_iter().take(SHOWN_MAX).map(|(_, name)| name).collect()
    }

    /// The error. No game matches `filters`; `model` is the model among them.
    pub(super) fn no_match(&self, filters: &[String], model: Option<&str>) -> anyhow::Error {
        if filters.is_empty() {
            return anyhow::anyhow!("there are no games to export: nothing is written");
        }
        let filters = filters.join(" ");
        let names: Vec<String> = model
            .into_iter()
            .flat_map(|model| self.nearest(model))
            .map(|name| format!("{name:?}"))
            .collect();
        if names.is_empty() {
            return anyhow::anyhow!("no game matches {filters}");
        }
        anyhow::anyhow!("no game matches {filters}; models that have games: {}", names.join(", "))
    }
}

fn add(names: &mut BTreeSet<String>, others: impl IntoIterator<Item = String>) {
    let room = NAMES_MAX - names.len();
    names.extend(others.into_iter().take(room));
}

impl Write for Models {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Self { names, splitter } = self;
        splitter.push(bytes, |line| {
            let row: ModelsRow = serde_json::from_slice(line)?;
            add(names, serde_json::from_str::<Vec<String>>(&row.models)?);
            Ok(())
        })?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_names_come_first_and_there_are_few() {
        let mut models = Models::default();
        models.add((0..20).map(|number| format!("other-{number}")));
        // Rows arrive in chunks of any size.
        for piece in [r#"{"models":"[\"qwen\"]"}"#, "\n{\"models\":\"[\\\"GPT-", "4o\\\"]\"}\n"] {
            models.write_all(piece.as_bytes()).expect("rows");
        }
        let filters = ["--model gtp-4o".to_owned()];
        let error = models.no_match(&filters, Some("gtp-4o")).to_string();
        let names = error.strip_prefix("no game matches --model gtp-4o; models that have games: ");
        let names: Vec<&str> = names.expect("the filters").split(", ").collect();
        assert_eq!((names[0], names.len()), ("\"GPT-4o\"", SHOWN_MAX));
    }
}
