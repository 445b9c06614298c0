//! Check that games with different settings are not averaged.

use std::collections::BTreeSet;

use anyhow::bail;
use swarmbench_engine::Settings;

use super::{Games, Value, one_value, told, usual};

/// Differences that are allowed between games of a table.
pub(in super::super) struct Axes<'a> {
    /// Columns whose values are shown apart.
    pub(in super::super) apart: &'a [String],
    /// Columns about how a player was asked that the user declares irrelevant.
    pub(in super::super) ignored: &'a [String],
    /// Option by which the user can show more settings apart.
    pub(in super::super) option: &'a str,
}

/// Settings of games, and who plays.
fn settings() -> impl Iterator<Item = &'static str> {
    let first = ["task", "model", "rules", "mixed"];
    let last = ["round_deadline_s", "bank_s", "fill_with"];
    first.into_iter().chain(Settings::NAMES.iter().copied()).chain(last)
}

impl Axes<'_> {
    /// Whether this setting is equal within a cell by construction, or may differ.
    fn cover(&self, column: &str) -> bool {
        let is_size = matches!(column, "width" | "height");
        let names = |name: &str| self.apart.iter().chain(self.ignored).any(|axis| axis == name);
        names(column) || (is_size && names("map_size"))
    }
}

impl Games {
    /// Sentences about the settings: those that all these games share, and those in which players were asked differently.
    ///
    /// # Errors
    /// If the games differ in a setting that is not shown apart, or a model was asked in several ways.
    pub(in super::super) fn shared(
        &self,
        games: &[usize],
        axes: &Axes<'_>,
    ) -> anyhow::Result<Vec<String>> {
        if let Some(known) = axes.ignored.iter().find(|name| !self.of_players.contains(*name)) {
            bail!(
                "--ignore {known}: only what agent_meta says about a player can be ignored, here: {}",
                self.of_players.iter().cloned().collect::<Vec<_>>().join(", ")
            );
        }
        let open: Vec<&str> = settings().filter(|name| !axes.cover(name)).collect();
        self.refuse(games, &open, axes, "these games")?;
        let of_players: Vec<&str> =
            self.of_players.iter().map(String::as_str).filter(|name| !axes.cover(name)).collect();
        for (model, of_model) in self.groups("model", games) {
            self.refuse(&of_model, &of_players, axes, &format!("games of {}", model.1))?;
        }
        let shared: Vec<String> = (open.iter().zip(games.first().into_iter().cycle()))
            .filter(|(name, game)| *self.value(name, **game) != Value::Missing)
            .map(|(name, game)| format!("{name} {}", self.value(name, *game)))
            .collect();
        let mut notes = vec![format!("all games: {}", shared.join(", "))];
        let differ: BTreeSet<&str> =
            of_players.into_iter().filter(|name| self.counts(name, games).len() > 1).collect();
        if !differ.is_empty() {
            let differ = differ.into_iter().collect::<Vec<_>>().join(", ");
            notes.push(format!("models were asked with different {differ}"));
        }
        Ok(notes)
    }

    fn refuse(
        &self,
        games: &[usize],
        columns: &[&str],
        axes: &Axes<'_>,
        who: &str,
    ) -> anyhow::Result<()> {
        let mut differ = columns.iter().filter(|name| self.counts(name, games).len() > 1);
        let Some(first) = differ.next() else { return Ok(()) };
        let counts = self.counts(first, games);
        let others: Vec<&str> = differ.copied().collect();
        let others = if others.is_empty() {
            String::new()
        } else {
            format!(", and also in {}", others.join(", "))
        };
        let select = usual(&counts)
            .map(|value| format!("--where {first}='{}'", one_value(&value.to_string())));
        let apart: Vec<&str> = axes.apart.iter().map(String::as_str).chain([*first]).collect();
        let ignore = self
            .of_players
            .contains(*first)
            .then(|| format!(", or, if it does not change how the model plays, --ignore {first}"));
        bail!(
            "{who} differ in {first}: {}{others}. Different settings are not averaged: select with {}, or show them apart with {} \
             {}{}",
            told(&counts),
            select.unwrap_or_default(),
            axes.option,
            apart.join(","),
            ignore.unwrap_or_default()
        );
    }
}
