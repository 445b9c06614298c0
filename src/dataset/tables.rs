//! Acts and rounds as rows of a table: one definition for JSON Lines and for Parquet.

use jiff::Timestamp;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::game::{Game, GameAct, Turn, grid};
use swarmbench_journal::record::Source;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Text,
    Whole,
    Real,
    Flag,
    /// In milliseconds of UTC.
    Time,
}

/// Its name and what it holds. Every value may be missing.
pub type Column = (&'static str, Kind);

#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[expect(missing_docs, reason = "the kinds of columns")]
pub enum Cell {
    Missing,
    Text(String),
    Whole(i64),
    Real(f64),
    Flag(bool),
    Time(Timestamp),
}

pub const ACTS: &[Column] = &[
    ("episode", Kind::Text),
    ("run", Kind::Text),
    ("task", Kind::Text),
    ("model", Kind::Text),
    ("seed", Kind::Whole),
    ("rules", Kind::Text),
    ("control", Kind::Text),
    ("round", Kind::Whole),
    ("agent", Kind::Whole),
    ("at", Kind::Time),
    ("source", Kind::Text),
    ("i", Kind::Whole),
    ("j", Kind::Whole),
    ("action", Kind::Text),
    ("action_success", Kind::Flag),
    ("valid", Kind::Flag),
    ("message", Kind::Text),
    ("to", Kind::Text),
    ("response", Kind::Text),
    ("reasoning", Kind::Text),
    ("prompt_tokens", Kind::Whole),
    ("completion_tokens", Kind::Whole),
    ("latency_ms", Kind::Whole),
    ("bank_spent_ms", Kind::Whole),
];

pub const ROUNDS: &[Column] = &[
    ("episode", Kind::Text),
    ("run", Kind::Text),
    ("task", Kind::Text),
    ("model", Kind::Text),
    ("seed", Kind::Whole),
    ("rules", Kind::Text),
    ("control", Kind::Text),
    ("num_agents", Kind::Whole),
    ("width", Kind::Whole),
    ("height", Kind::Whole),
    ("view_size", Kind::Whole),
    ("max_round", Kind::Whole),
    ("round", Kind::Whole),
    ("at", Kind::Time),
    ("score", Kind::Real),
    ("alive", Kind::Whole),
    ("acts", Kind::Whole),
    ("invalid", Kind::Whole),
    ("clock_outs", Kind::Whole),
    ("messages", Kind::Whole),
    ("grid", Kind::Text),
];

/// A row as a line of JSON, with the names of its columns.
pub struct Named<'a>(pub &'a [Column], pub &'a [Cell]);

impl Serialize for Named<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for ((name, _), cell) in self.0.iter().zip(self.1) {
            map.serialize_entry(name, cell)?;
        }
        map.end()
    }
}

fn text(text: Option<&String>) -> Cell {
    text.map_or(Cell::Missing, |text| Cell::Text(text.clone()))
}

fn whole(number: impl TryInto<i64>) -> Cell {
    number.try_into().map_or(Cell::Missing, Cell::Whole)
}

fn optional(number: Option<u64>) -> Cell {
    number.map_or(Cell::Missing, whole)
}

/// The cells that are the same in every row of an episode.
fn head(game: &Game) -> Vec<Cell> {
    let (opening, config) = (&game.opening, &game.opening.config);
    let known = |text: &String| Cell::Text(text.clone());
    vec![
        known(&opening.episode),
        text(opening.run.as_ref()),
        known(&config.task),
        known(&config.model),
        whole(config.seed.get()),
        known(&config.rules),
        known(&config.control),
    ]
}

/// A row for an act of the last round played.
pub fn act(game: &Game, turn: &Turn, act: &GameAct) -> Vec<Cell> {
    let record = &act.record;
    let at = turn.before.agent_states().nth(act.agent.index()).map(|state| state.at);
    let place = |n: Option<i32>| n.map_or(Cell::Missing, whole);
    let usage = record.usage.unwrap_or_default();
    let source = match record.source {
        Source::Player => "player",
        Source::Clock => "clock",
    };
    let mut cells = head(game);
    cells.extend([
        whole(turn.round),
        whole(act.agent.0),
        Cell::Time(act.at),
        Cell::Text(source.to_owned()),
        place(at.map(|at| at.i)),
        place(at.map(|at| at.j)),
        text(record.action.as_ref()),
        Cell::Flag(act.took_effect),
        Cell::Flag(record.valid),
        text(record.message.as_ref()),
        text(record.to.as_ref()),
        text(record.response.as_ref()),
        text(record.reasoning.as_ref()),
        optional(usage.prompt_tokens),
        optional(usage.completion_tokens),
        optional(usage.latency_ms),
        whole(record.bank_spent_ms),
    ]);
    cells
}

/// A row for the current state: `turn` is the round that led to it, or `None` for the layout.
pub fn round(game: &Game, turn: Option<&Turn>, began_at: Timestamp) -> Vec<Cell> {
    let (config, world) = (&game.opening.config, game.world());
    let count = |wanted: &dyn Fn(&GameAct) -> bool| {
        turn.map_or(Cell::Missing, |turn| whole(turn.acts.iter().filter(|act| wanted(act)).count()))
    };
    let grid: Vec<String> = grid(world).into_iter().map(|row| row.concat()).collect();
    let mut cells = head(game);
    cells.extend([
        whole(config.num_agents),
        whole(config.width),
        whole(config.height),
        whole(config.view_size),
        whole(config.max_round),
        whole(world.round()),
        Cell::Time(turn.map_or(began_at, |turn| turn.at)),
        Cell::Real(world.score()),
        whole(world.agent_states().filter(|agent| agent.alive).count()),
        count(&|_| true),
        count(&|act| !act.record.valid),
        count(&|act| act.record.source == Source::Clock),
        count(&|act| act.record.message.is_some()),
        Cell::Text(grid.join("\n")),
    ]);
    cells
}
