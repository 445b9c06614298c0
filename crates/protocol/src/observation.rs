//! Observations of agents.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use swarmbench_engine::{self as engine, Action, AgentId, Message, Seen, TaskName};

use super::Position;
use super::episode::EpisodeResult;
use super::status::Status;
use crate::time::Timestamp;

/// Current observation of one agent: all that it may know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Observation {
    /// Part that does not change while the round is open.
    #[serde(flatten)]
    pub sight: Sight,
    /// Part that changes while the round is open.
    #[serde(flatten)]
    pub moment: Moment,
}

/// Part of an observation that does not change while the round is open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Sight {
    /// Id of the episode.
    #[cfg_attr(feature = "openapi", schema(example = "ep_0199f0c2a1d87c3e9b5a4d6f10e2b3c4"))]
    pub episode: String,
    /// Name of the agent.
    #[cfg_attr(feature = "openapi", schema(example = "Agent_3"))]
    pub agent: String,
    /// Status of the episode.
    pub status: Status,
    /// Round to be answered: the number of resolved rounds.
    pub round: u32,
    /// Number of rounds after which the episode ends.
    pub max_round: u32,
    /// Task of the swarm.
    pub task: Task,
    /// Score of the whole swarm so far.
    pub score: f64,
    /// False once the agent has escaped.
    pub alive: bool,
    /// Position of the agent; null once it has escaped.
    pub position: Option<Position>,
    /// View of the agent; null once it has escaped.
    pub view: Option<View>,
    /// Whether the agent's light is on (Synchronization only).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_on: Option<bool>,
    /// Whether the agent carries food (Foraging only).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub carrying_food: Option<bool>,
    /// Messages delivered to the agent, sorted and without their senders.
    pub messages: Vec<String>,
    /// Actions of the task.
    pub actions: Vec<String>,
    /// Past acts of the agent, newest first, of at most as many rounds as it remembers.
    pub history: Vec<HistoryEntry>,
    /// Past views of the agent, newest first, at most one fewer than the rounds that it remembers.
    pub past_views: Vec<PastView>,
    /// End of the episode; left out before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub result: Option<EpisodeResult>,
}

/// Part of an observation that changes while the round is open.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Moment {
    /// Whether this seat has answered the round.
    pub acted: bool,
    /// Time at which the seat's clock expires: the opening of the round plus its deadline and the bank. Null without a clock.
    pub deadline: Option<Timestamp>,
    /// Milliseconds until `deadline`. Null without a clock.
    pub remaining_ms: Option<u64>,
    /// Milliseconds left in the seat's bank; `remaining_ms` includes them, and they are used last. Null without a clock.
    pub bank_ms: Option<u64>,
    /// Text for a language model; only if requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prompt: Option<String>,
}

/// Task, as it is described to an agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct Task {
    /// Name of the task.
    #[cfg_attr(feature = "openapi", schema(example = "Transport"))]
    pub name: String,
    /// Description of the task, in words.
    pub description: String,
}

/// Rectangle of cells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct View {
    /// Top-left cell; may lie outside the map.
    pub origin: Position,
    /// Cells: `cells[a][b]` is the cell `(origin.i + a, origin.j + b)`: `.` empty, `W` wall, `B` block, `P` prey, `N` nest, `F`
    /// food, `*` outside the map, `Y` the agent itself, other agents by number, after a `$` if they have a mark.
    pub cells: Vec<Vec<Cell>>,
}

/// Act of the agent in an earlier round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct HistoryEntry {
    /// Round of the act.
    pub round: u32,
    /// Action of the agent; null without one.
    pub action: Option<String>,
    /// Message of the agent; null without one.
    pub message: Option<String>,
}

/// View of the agent in an earlier round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema))]
pub struct PastView {
    /// Round of the view.
    pub round: u32,
    /// Top-left cell.
    pub origin: Position,
    /// Cells, as in a view.
    pub cells: Vec<Vec<Cell>>,
}

/// Cell as it is written: a short symbol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(value_type = String, example = "$11"))]
pub struct Cell(pub Seen);

impl Serialize for Cell {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let symbol = match self.0 {
            Seen::Agent { .. } => return serializer.collect_str(&self.0),
            Seen::Outside => "*",
            Seen::Empty => ".",
            Seen::Wall => "W",
            Seen::Nest => "N",
            Seen::Food => "F",
            Seen::Block => "B",
            Seen::Prey => "P",
            Seen::Yourself => "Y",
        };
        serializer.serialize_str(symbol)
    }
}

impl<'de> Deserialize<'de> for Cell {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let symbol = std::borrow::Cow::<str>::deserialize(deserializer)?;
        let unknown = || serde::de::Error::custom(format!("an unknown cell {symbol:?}"));
        Seen::parse(&symbol).map(Self).ok_or_else(unknown)
    }
}

impl View {
    fn of(view: &engine::View) -> Self {
        Self { origin: view.origin.into(), cells: rows(view) }
    }
}

fn rows(view: &engine::View) -> Vec<Vec<Cell>> {
    view.rows().map(|row| row.iter().copied().map(Cell).collect()).collect()
}

impl Sight {
    /// Observation on the wire, from the engine's.
    #[must_use]
    pub fn of(
        seen: &engine::Observation,
        episode: String,
        description: String,
        status: Status,
        result: Option<EpisodeResult>,
    ) -> Self {
        Self {
            episode,
            agent: seen.agent.to_string(),
            status,
            round: seen.round,
            max_round: seen.max_round,
            task: Task { name: seen.task.name().to_owned(), description },
            score: seen.score,
            alive: seen.position.is_some(),
            position: seen.position.map(Into::into),
            view: seen.view.as_ref().map(View::of),
            light_on: seen.light_on,
            carrying_food: seen.carrying_food,
            messages: if seen.position.is_some() {
                seen.messages.iter().map(ToString::to_string).collect()
            } else {
                Vec::new()
            },
            actions: Action::of_task(seen.task).iter().map(|a| a.name().to_owned()).collect(),
            history: (seen.history.iter())
                .map(|past| HistoryEntry {
                    round: past.round,
                    action: past.act.action.map(|action| action.name().to_owned()),
                    message: past.act.message.as_ref().map(ToString::to_string),
                })
                .collect(),
            past_views: (seen.past_views.iter())
                .map(|past| PastView {
                    round: past.round,
                    origin: past.view.origin.into(),
                    cells: rows(&past.view),
                })
                .collect(),
            result,
        }
    }

    /// Observation for a built-in player; none if a name in it is unknown.
    #[must_use]
    pub fn to_engine(&self) -> Option<engine::Observation> {
        let task = TaskName::parse(&self.task.name)?;
        let history = self.history.iter().map(|past| {
            let action = match &past.action {
                Some(name) => Some(Action::parse(task, name)?),
                None => None,
            };
            let message = past.message.as_deref().and_then(Message::new);
            let act = engine::Act { action, message, to: None };
            Some(engine::Remembered { round: past.round, act })
        });
        let past_views = self.past_views.iter().map(|past| engine::PastView {
            round: past.round,
            view: read_view(past.origin, &past.cells),
        });
        Some(engine::Observation {
            agent: AgentId::parse(&self.agent)?,
            task,
            round: self.round,
            max_round: self.max_round,
            score: self.score,
            position: self.position.map(Into::into),
            view: self.view.as_ref().map(|view| read_view(view.origin, &view.cells)),
            light_on: self.light_on,
            carrying_food: self.carrying_food,
            messages: self.messages.iter().filter_map(|text| Message::new(text)).collect(),
            history: history.collect::<Option<_>>()?,
            past_views: past_views.collect(),
        })
    }
}

fn read_view(origin: Position, cells: &[Vec<Cell>]) -> engine::View {
    engine::View {
        origin: origin.into(),
        height: cells.len(),
        width: cells.first().map_or(0, Vec::len),
        cells: cells.iter().flatten().map(|cell| cell.0).collect(),
    }
}
