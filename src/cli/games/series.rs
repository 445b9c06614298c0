//! Columns of the table of rounds: the values of all states of each game.

use std::collections::BTreeMap;

use anyhow::{bail, ensure};
use serde_json::Value as Json;

use super::source::{Choice, Reader, Wanted};
use super::{Selected, Value};
use crate::dataset::rows::Row;
use crate::dataset::tables::TableName;

/// Maximum numbers, as all are in memory.
const VALUES_MAX: usize = 20_000_000;

/// Values by column, then by state.
pub(in super::super) type Series = Vec<Vec<Option<f64>>>;

/// Rounds read so far.
struct Rounds {
    columns: Vec<&'static str>,
    places: BTreeMap<String, usize>,
    /// Series in the order of `places`.
    series: Vec<Series>,
    /// Whether each column exists.
    found: Vec<bool>,
    values: usize,
}

impl Reader for Rounds {
    fn add(&mut self, row: Row) -> anyhow::Result<()> {
        let episode = row.get("episode").and_then(Json::as_str);
        let round = row.get("round").and_then(Json::as_u64).and_then(|n| usize::try_from(n).ok());
        let (Some(episode), Some(round)) = (episode, round) else {
            bail!("a row has no episode or no round: it is no table of rounds");
        };
        let Some(&place) = self.places.get(episode) else { return Ok(()) };
        for (column, series) in self.series[place].iter_mut().enumerate() {
            // A game may be in several folders.
            if round < series.len() {
                return Ok(());
            }
            let missing = series.len();
            ensure!(round == missing, "the state {missing} of {episode} is missing");
            let name = self.columns[column];
            self.found[column] |= row.contains_key(name);
            series.push(row.get(name).and_then(Json::as_f64));
        }
        self.values += self.columns.len();
        ensure!(
            self.values <= VALUES_MAX,
            "the rounds have more than {VALUES_MAX} numbers: select games with --where"
        );
        Ok(())
    }
}

impl Choice {
    /// Reads columns of the rounds of selected games: for each game, in the order of `columns`, the value of each state.
    pub(in super::super) async fn series(
        &self,
        selected: &Selected,
        columns: Vec<&'static str>,
    ) -> anyhow::Result<Vec<Series>> {
        let Selected { games, chosen, .. } = selected;
        let id = |game: usize| games.value("episode", game).to_string();
        let places: BTreeMap<String, usize> =
            chosen.iter().map(|&game| id(game)).zip(0..).collect();
        let mut tasks = games.counts("task", chosen).into_keys();
        let task = tasks.next().filter(|_| tasks.next().is_none()).map(Value::to_string);
        let wanted = Wanted {
            table: TableName::Rounds,
            task,
            episodes: Some(places.keys().cloned().collect()),
        };
        let rounds = Rounds {
            series: vec![vec![Vec::new(); columns.len()]; chosen.len()],
            found: vec![false; columns.len()],
            values: 0,
            places,
            columns,
        };
        let Rounds { columns, series, found, .. } = self.source.read(wanted, rounds).await?;
        if let Some((_, missing)) = found.iter().zip(&columns).find(|(found, _)| !**found) {
            bail!(
                "the rounds have no column {missing}: they were exported by an earlier version; export them again with \
                 `swarmbench export FOLDER --format jsonl`"
            );
        }
        for (&game, series) in chosen.iter().zip(&series) {
            let states = series.first().map_or(0, Vec::len);
            let all = games.number("rounds", game).map(|rounds| rounds + 1.0);
            #[expect(clippy::cast_precision_loss, reason = "a game has few states")]
            let is_whole = all.is_none_or(|all| states as f64 >= all);
            ensure!(
                is_whole && states > 0,
                "there are {states} states of {}, which is not all: export the games again",
                id(game)
            );
        }
        Ok(series)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Games;
    use super::*;

    /// Writes a folder with one game of two states and this table of rounds, and reads series from it.
    async fn read(rounds: &str, columns: &[&'static str]) -> anyhow::Result<Vec<Series>> {
        let folder = tempfile::tempdir()?;
        let episode = "{\"episode\":\"b\",\"task\":\"Pursuit\",\"model\":\"m\",\"status\":\"finished\",\
                       \"score\":2,\"rounds\":1,\"void_reason\":null}\n";
        std::fs::write(folder.path().join("episodes.jsonl"), episode)?;
        std::fs::write(folder.path().join("rounds.jsonl"), rounds)?;
        // Repeated folders count once.
        let choice = Choice::of_folders([folder.path(), folder.path()]);
        let selected = choice.select().await?;
        assert_eq!(selected.chosen, [0]);
        choice.series(&selected, columns.to_vec()).await
    }

    #[tokio::test]
    async fn series_are_those_of_the_selected_games() {
        let rounds = "{\"episode\":\"b\",\"round\":0,\"score\":0,\"x\":null}\n\
                      {\"episode\":\"z\",\"round\":7}\n\
                      {\"episode\":\"b\",\"round\":1,\"score\":1.5,\"x\":3}\n";
        let series = read(rounds, &["score", "x"]).await.expect("series");
        assert_eq!(series, [vec![vec![Some(0.0), Some(1.5)], vec![None, Some(3.0)]]]);
    }

    #[tokio::test]
    async fn faults_of_rounds_say_what_is_missing() {
        for (rounds, expected) in [
            ("{\"episode\":\"b\",\"round\":1}\n", "the state 0 of b is missing"),
            ("{\"episode\":\"b\",\"round\":0}\n{\"epis", "line 2 is damaged"),
            ("{\"round\":0}\n", "it is no table of rounds"),
            ("{\"episode\":\"b\",\"round\":0,\"score\":0}\n", "there are 1 states of b"),
            (
                "{\"episode\":\"b\",\"round\":0}\n{\"episode\":\"b\",\"round\":1}\n",
                "no column score",
            ),
            ("", "no column score"),
        ] {
            let error = format!("{:#}", read(rounds, &["score"]).await.expect_err(rounds));
            assert!(error.contains(expected), "{error}");
        }
    }

    #[tokio::test]
    async fn a_choice_can_be_narrowed() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("episodes.jsonl"), "").expect("written");
        let choice = Choice::of_folders([folder.path()]);
        let none = choice.select().await.map(|selected| selected.chosen).expect_err("no games");
        assert!(none.to_string().contains("no games that have ended"), "{none}");
        let mut games = Games::default();
        for (episode, model) in [("1", "a"), ("2", "b,c")] {
            let row = serde_json::json!({
                "episode": episode, "task": "Pursuit", "model": model, "status": "finished",
                "score": 1, "void_reason": null,
            });
            games.add(row.as_object().expect("an object").clone()).expect("a game");
        }
        // Values of `with` are not split at commas.
        let selected = choice.with("model", "b,c").of(games).expect("a game");
        assert_eq!(selected.chosen, [1]);
    }
}
