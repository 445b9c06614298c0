//! Games as rows of an export: episodes, and the series of their rounds.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use serde_json::{Map, Value};
use swarmbench_engine::Settings;

/// The longest line of a table.
const LINE_BYTES_MAX: usize = 4 << 20;
/// The most games of a figure.
const GAMES_MAX: usize = 100_000;
/// The most numbers of series: all are in memory.
const VALUES_MAX: usize = 20_000_000;
/// The most rounds of a game.
const ROUNDS_MAX: usize = 100_000;

/// How metrics were computed: values that differ in it are never in one figure.
const COMPUTED: [&str; 2] = ["metrics_revision", "embedder"];

#[derive(Clone, Debug, clap::Args)]
pub(super) struct Selection {
    /// A folder of `swarmbench export FOLDER --format jsonl`.
    #[arg(long, value_name = "FOLDER")]
    pub(super) from: PathBuf,
    /// Only games in which this column has this value, or one of several, such as `model=a` or `view_size=3,5`. May be
    /// given several times.
    #[arg(long = "where", value_name = "COLUMN=VALUE,…", value_parser = condition)]
    conditions: Vec<Condition>,
}

#[derive(Clone, Debug)]
struct Condition {
    column: String,
    values: Vec<String>,
}

fn condition(text: &str) -> Result<Condition, String> {
    let (column, values) = text
        .split_once('=')
        .ok_or_else(|| format!("{text:?} is no condition such as task=Pursuit"))?;
    let values = values.split(',').map(str::to_owned).collect();
    Ok(Condition { column: column.to_owned(), values })
}

/// A row of a table.
pub(super) struct Row(Map<String, Value>);

impl Row {
    /// A number, if there is one.
    pub(super) fn number(&self, column: &str) -> Option<f64> {
        self.0.get(column)?.as_f64()
    }

    /// Any value as text; empty without one.
    fn shown(&self, column: &str) -> String {
        match self.0.get(column) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => text.clone(),
            Some(value) => value.to_string(),
        }
    }

    fn need(&self, column: &str) -> anyhow::Result<&str> {
        let value = self.0.get(column).and_then(Value::as_str);
        value.with_context(|| format!("the column {column} is missing: this is no such table"))
    }
}

/// A game that finished.
pub(super) struct Game {
    pub(super) episode: String,
    pub(super) task: String,
    pub(super) model: String,
    pub(super) score: f64,
    pub(super) row: Row,
}

impl Selection {
    /// Reads the games that finished, were not voided, and meet all conditions.
    pub(super) fn games(&self) -> anyhow::Result<Vec<Game>> {
        let mut games = Vec::new();
        let mut read = 0;
        rows(&self.from, "episodes", |row| {
            read += 1;
            let meets =
                |condition: &Condition| condition.values.contains(&row.shown(&condition.column));
            let counts = row.need("status")? == "finished" && row.shown("void_reason").is_empty();
            let Some(score) = row.number("score").filter(|_| counts) else { return Ok(()) };
            if !self.conditions.iter().all(meets) {
                return Ok(());
            }
            ensure!(
                games.len() < GAMES_MAX,
                "more than {GAMES_MAX} games: select some with --where"
            );
            let [episode, task, model] = ["episode", "task", "model"].map(|name| row.need(name));
            let (episode, task, model) = (episode?.to_owned(), task?.to_owned(), model?.to_owned());
            games.push(Game { episode, task, model, score, row });
            Ok(())
        })?;
        if games.is_empty() {
            let all: Vec<String> = (self.conditions.iter())
                .map(|condition| format!("{}={}", condition.column, condition.values.join(",")))
                .collect();
            let selected =
                if all.is_empty() { String::new() } else { format!(" with {}", all.join(" ")) };
            bail!("none of the {read} games finished{selected}: there is nothing to draw");
        }
        Ok(games)
    }

    /// Reads columns of the rounds of games: of each game, in the order of `columns`, the value of each state.
    pub(super) fn series(&self, games: &[Game], columns: &[&str]) -> anyhow::Result<Vec<Series>> {
        let places: BTreeMap<&str, usize> =
            games.iter().map(|game| game.episode.as_str()).zip(0..).collect();
        let mut series = vec![vec![Vec::new(); columns.len()]; games.len()];
        let mut found = vec![false; columns.len()];
        let mut values = 0;
        rows(&self.from, "rounds", |row| {
            let Some(&place) = places.get(row.need("episode")?) else { return Ok(()) };
            let round = row.0.get("round").and_then(Value::as_u64).context("a row has no round")?;
            let round = usize::try_from(round).unwrap_or(usize::MAX);
            ensure!(round <= ROUNDS_MAX, "round {round} is more than {ROUNDS_MAX}");
            for (number, column) in columns.iter().enumerate() {
                found[number] |= row.0.contains_key(*column);
                let of_column: &mut Vec<Option<f64>> = &mut series[place][number];
                ensure!(round == of_column.len(), "round {round} is not the next of its game");
                of_column.push(row.number(column));
            }
            values += columns.len();
            ensure!(
                values <= VALUES_MAX,
                "the series have more than {VALUES_MAX} numbers: select games with --where"
            );
            Ok(())
        })?;
        if let Some(missing) = found.iter().position(|found| !found) {
            bail!(
                "the rounds have no column {}: export the games again with this version of swarmbench",
                columns[missing]
            );
        }
        Ok(series)
    }
}

/// By column, the value of each state.
pub(super) type Series = Vec<Vec<Option<f64>>>;

/// The settings that all these games share, as a sentence; those in `apart` may differ.
///
/// # Errors
/// Where games differ in one: games of different settings are not averaged.
pub(super) fn shared(games: &[Game], apart: &[&str]) -> anyhow::Result<String> {
    let all = ["rules"].into_iter().chain(Settings::NAMES.iter().copied());
    let open = all.filter(|name| !apart.contains(name));
    let mut shared = Vec::new();
    for name in open {
        let value = only(games, name)?;
        if !value.is_empty() {
            shared.push(format!("{name} {value}"));
        }
    }
    Ok(shared.join(", "))
}

/// How the metrics of these games were computed, as a sentence.
///
/// # Errors
/// Where it differs between games, or the games have no metrics.
pub(super) fn computed(games: &[Game]) -> anyhow::Result<String> {
    let [revision, embedder] = COMPUTED.map(|name| only(games, name));
    let (revision, embedder) = (revision?, embedder?);
    ensure!(
        !revision.is_empty(),
        "the games have no metrics: export them again with this version of swarmbench"
    );
    Ok(format!("metrics revision {revision}, embedder {embedder}"))
}

/// The value of a column, which must be the same in all games.
fn only(games: &[Game], name: &str) -> anyhow::Result<String> {
    let values: BTreeSet<String> = games.iter().map(|game| game.row.shown(name)).collect();
    let mut all = values.into_iter();
    let first = all.next().unwrap_or_default();
    let others: Vec<String> = all.take(5).collect();
    ensure!(
        others.is_empty(),
        "the games differ in {name}: {first}, {}. Games of different settings are not in one figure: select with --where \
         {name}={first}",
        others.join(", ")
    );
    Ok(first)
}

/// Shows the rows of a table of an export, one after the other.
fn rows(
    folder: &Path,
    table: &str,
    mut each: impl FnMut(Row) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let path = folder.join(format!("{table}.jsonl"));
    let file = File::open(&path).with_context(|| {
        let how = "write one with `swarmbench export FOLDER --format jsonl`";
        format!("{} has no {table}.jsonl: {how}", folder.display())
    })?;
    let mut file = BufReader::new(file);
    let mut line = Vec::new();
    for number in 1.. {
        let at = || format!("{}, line {number}", path.display());
        line.clear();
        let room = LINE_BYTES_MAX as u64 + 1;
        if file.by_ref().take(room).read_until(b'\n', &mut line).with_context(at)? == 0 {
            break;
        }
        ensure!(line.len() <= LINE_BYTES_MAX, "{}: more than {LINE_BYTES_MAX} bytes", at());
        let row = serde_json::from_slice(&line).with_context(at)?;
        each(Row(row)).with_context(at)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with these tables.
    fn export(episodes: &str, rounds: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        for (table, text) in [("episodes", episodes), ("rounds", rounds)] {
            std::fs::write(folder.path().join(format!("{table}.jsonl")), text).expect("written");
        }
        folder
    }

    fn args(folder: &Path, conditions: &[&str]) -> Selection {
        let conditions = conditions.iter().map(|text| condition(text).expect("a condition"));
        Selection { from: folder.to_owned(), conditions: conditions.collect() }
    }

    fn episode(id: &str, agents: u32, status: &str) -> String {
        format!(
            "{{\"episode\":\"{id}\",\"task\":\"Pursuit\",\"model\":\"m\",\"status\":\"{status}\",\"score\":2,\
             \"num_agents\":{agents},\"void_reason\":null}}\n"
        )
    }

    #[test]
    fn games_are_selected_and_settings_are_not_mixed() {
        let text = [("a", 8, "finished"), ("b", 12, "finished"), ("c", 12, "aborted")]
            .map(|(id, agents, status)| episode(id, agents, status));
        let folder = export(&text.concat(), "");
        let all = args(folder.path(), &[]).games().expect("games");
        assert_eq!(all.iter().map(|game| &*game.episode).collect::<Vec<_>>(), ["a", "b"]);
        let mixed = shared(&all, &[]).expect_err("8 and 12 agents").to_string();
        assert!(
            mixed.contains("differ in num_agents: 12, 8") && mixed.contains("--where"),
            "{mixed}"
        );
        assert_eq!(shared(&all, &["num_agents"]).expect("only that differs"), "");
        let some = args(folder.path(), &["num_agents=12,16"]).games().expect("a game");
        assert_eq!(some.len(), 1);
        assert_eq!(shared(&some, &[]).expect("one game"), "num_agents 12");
        let none = args(folder.path(), &["model=x"]).games().err().expect("no game").to_string();
        assert!(none.contains("none of the 3 games finished with model=x"), "{none}");
        let no_metrics = computed(&some).expect_err("an old export").to_string();
        assert!(no_metrics.contains("export them again"), "{no_metrics}");
    }

    #[test]
    fn series_are_read_by_game_and_faults_name_their_line() {
        let rounds = "{\"episode\":\"b\",\"round\":0,\"score\":0,\"x\":null}\n\
                      {\"episode\":\"z\",\"round\":7}\n\
                      {\"episode\":\"b\",\"round\":1,\"score\":1.5,\"x\":3}\n";
        let folder = export(&episode("b", 12, "finished"), rounds);
        let args = args(folder.path(), &[]);
        let games = args.games().expect("games");
        let series = args.series(&games, &["score", "x"]).expect("series");
        assert_eq!(series, [vec![vec![Some(0.0), Some(1.5)], vec![None, Some(3.0)]]]);
        let missing = args.series(&games, &["y"]).expect_err("no such column").to_string();
        assert!(missing.contains("no column y"), "{missing}");
        for (text, expected) in [
            ("{\"episode\":\"b\",\"round\":1}\n", "line 1: round 1 is not the next"),
            ("{\"episode\":\"b\",\"round\":0}\n{\"epis", "line 2"),
            ("[]\n", "line 1"),
            ("{\"round\":0}\n", "the column episode is missing"),
        ] {
            std::fs::write(folder.path().join("rounds.jsonl"), text).expect("written");
            let error = format!("{:#}", args.series(&games, &["score"]).expect_err(text));
            assert!(error.contains(expected), "{error}");
        }
    }
}
