//! Observations of agents, and the view of a spectator (rules: *What an agent sees*).

use crate::act::{Act, AgentId};
use crate::body::{Board, Kind};
use crate::config::Config;
use crate::grid::Pos;
use crate::message::Message;
use crate::names::Control;
use crate::names::RuleSet;
use crate::names::TaskName;
use crate::tasks::Task;
use crate::world::World;

/// A cell as an agent sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Seen {
    /// `*`: outside the map.
    Outside,
    /// `.`
    Empty,
    /// `W`
    Wall,
    /// `N`
    Nest,
    /// `F`
    Food,
    /// `B`
    Block,
    /// `P`
    Prey,
    /// `Y`: the agent itself.
    Yourself,
    /// Another agent by its number, after a `$` if it bears a mark.
    Agent {
        /// The number of the agent.
        number: u16,
        /// True if the light is on, or the agent carries food, under the rules `paper`; the opposite under `reference`.
        marked: bool,
    },
}

impl std::fmt::Display for Seen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let symbol = match *self {
            Self::Outside => "*",
            Self::Empty => ".",
            Self::Wall => "W",
            Self::Nest => "N",
            Self::Food => "F",
            Self::Block => "B",
            Self::Prey => "P",
            Self::Yourself => "Y",
            Self::Agent { number, marked } => {
                return write!(f, "{}{number}", if marked { "$" } else { "" });
            }
        };
        f.write_str(symbol)
    }
}

impl Seen {
    /// Reads a cell as [`Display`](std::fmt::Display) writes it.
    #[must_use]
    pub fn parse(symbol: &str) -> Option<Self> {
        Some(match symbol {
            "*" => Self::Outside,
            "." => Self::Empty,
            "W" => Self::Wall,
            "N" => Self::Nest,
            "F" => Self::Food,
            "B" => Self::Block,
            "P" => Self::Prey,
            "Y" => Self::Yourself,
            _ => {
                let number = symbol.strip_prefix('$');
                let marked = number.is_some();
                Self::Agent { number: number.unwrap_or(symbol).parse().ok()?, marked }
            }
        })
    }
}

/// A rectangle of cells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct View {
    /// The top-left cell; may lie outside the map.
    pub origin: Pos,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// All cells, row by row.
    pub cells: Vec<Seen>,
}

impl View {
    /// The rows from top to bottom.
    pub fn rows(&self) -> impl Iterator<Item = &[Seen]> {
        self.cells.chunks(self.width.max(1))
    }

    /// All cells with their positions on the map.
    pub fn positions(&self) -> impl Iterator<Item = (Pos, Seen)> + '_ {
        self.rows().zip(self.origin.i..).flat_map(move |(row, i)| {
            row.iter().zip(self.origin.j..).map(move |(&seen, j)| (Pos::new(i, j), seen))
        })
    }
}

/// Everything that an agent may know when it decides a round.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The agent that observes.
    pub agent: AgentId,
    /// The task.
    pub task: TaskName,
    /// The round to be decided.
    pub round: u32,
    /// Number of rounds after which the episode ends.
    pub max_round: u32,
    /// The score so far.
    pub score: f64,
    /// The agent's position; `None` once it has escaped.
    pub position: Option<Pos>,
    /// The agent's window; `None` once it has escaped.
    pub view: Option<View>,
    /// State of the agent's light; in Synchronization only.
    pub light_on: Option<bool>,
    /// Load of the agent; in Foraging only.
    pub carrying_food: Option<bool>,
    /// The messages delivered to it, sorted by text.
    pub messages: Vec<Message>,
    /// The agent's last acts, newest first, at most as many as it remembers.
    pub history: Vec<Remembered>,
    /// The agent's last views, newest first, at most one fewer than it remembers.
    pub past_views: Vec<PastView>,
}

/// An act of the agent in an earlier round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remembered {
    /// The round.
    pub round: u32,
    /// The act.
    pub act: Act,
}

/// A view of the agent in an earlier round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PastView {
    /// The round.
    pub round: u32,
    /// The view.
    pub view: View,
}

/// The whole state, as a spectator sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct SpectatorView {
    /// Rounds resolved.
    pub round: u32,
    /// The score so far.
    pub score: f64,
    /// The map row by row, one character for each cell; `A` for agents.
    pub grid: Vec<String>,
    /// All agents in order of their numbers.
    pub agents: Vec<AgentState>,
    /// The prey's position (Pursuit).
    pub prey: Option<Pos>,
    /// The top-left cell of the block's shape (Transport).
    pub block: Option<Pos>,
    /// The cost of the placement (Flocking).
    pub distance: Option<f64>,
}

/// The objects and the cost of a task, as a spectator sees them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Landmarks {
    /// The prey's position (Pursuit).
    pub prey: Option<Pos>,
    /// The top-left cell of the block's shape (Transport).
    pub block: Option<Pos>,
    /// The cost of the placement (Flocking).
    pub distance: Option<f64>,
}

/// An agent, as a spectator sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AgentState {
    /// The agent.
    pub agent: AgentId,
    /// The agent's position; the cell to which it went if it has escaped.
    pub at: Pos,
    /// True if the agent is on the map.
    pub alive: bool,
    /// State of the agent's light (Synchronization).
    pub light_on: Option<bool>,
    /// Load of the agent (Foraging).
    pub carrying_food: Option<bool>,
}

impl World {
    /// The current observation of `agent`.
    ///
    /// # Panics
    /// Panics if the episode has no such agent.
    #[must_use]
    pub fn observe(&self, agent: AgentId) -> Observation {
        let config = &*self.config;
        let own = agent.index();
        let flags = self.task.flags();
        let (light_on, carrying_food) = self.flag_of(agent);
        let position = self.is_alive(agent).then(|| self.board.agents()[own].at);
        let lived = || self.past.iter().filter(|moment| !moment.board.agents()[own].gone);
        Observation {
            agent,
            task: config.task,
            round: self.round,
            max_round: config.max_round,
            score: self.score,
            position,
            view: position.map(|_| view(config, &self.board, flags, agent)),
            light_on,
            carrying_food,
            messages: (self.mail.inbox[own].iter()).map(|received| received.text.clone()).collect(),
            history: lived()
                .map(|moment| Remembered { round: moment.round, act: moment.acts[own].clone() })
                .collect(),
            past_views: lived()
                .filter(|moment| self.round - moment.round < remembered_views(config))
                .map(|moment| PastView {
                    round: moment.round,
                    view: view(config, &moment.board, &moment.flags, agent),
                })
                .collect(),
        }
    }

    /// The cell on which the last round caught a prey (Pursuit).
    #[must_use]
    pub const fn caught(&self) -> Option<Pos> {
        match &self.task {
            Task::Pursuit(task) => task.caught,
            _ => None,
        }
    }

    /// Approximate size of an observation, in cells: the cells of all windows, and 16 for each text.
    #[must_use]
    pub fn observation_cells(&self, agent: AgentId) -> usize {
        const TEXT_CELLS: usize = 16;
        let config = &*self.config;
        let views = self.past.len().min(config.memory.saturating_sub(1));
        let now = usize::from(self.is_alive(agent));
        let texts = self.mail.inbox[agent.index()].len() + self.past.len();
        config.window() * (now + views) + TEXT_CELLS * texts
    }

    /// The current view of a spectator.
    #[must_use]
    pub fn spectator_view(&self) -> SpectatorView {
        let agents = self.agent_states().collect();
        let Landmarks { prey, block, distance } = self.landmarks();
        let grid = self.board.grid();
        let symbol = |i, j| self.board.kind_at(Pos::new(i, j)).map_or('.', symbol);
        let row = |i| (0..grid.width()).map(|j| symbol(i, j)).collect();
        SpectatorView {
            round: self.round,
            score: self.score,
            grid: (0..grid.height()).map(row).collect(),
            agents,
            prey,
            block,
            distance,
        }
    }

    /// The objects and the cost of the task.
    #[must_use]
    pub fn landmarks(&self) -> Landmarks {
        let at = |id| Some(self.board.body(id).at);
        match &self.task {
            Task::Transport(task) => Landmarks { block: at(task.block), ..Landmarks::default() },
            Task::Pursuit(task) => Landmarks { prey: at(task.prey), ..Landmarks::default() },
            Task::Flocking(task) => {
                Landmarks { distance: Some(task.current), ..Landmarks::default() }
            }
            Task::Synchronization(_) | Task::Foraging(_) => Landmarks::default(),
        }
    }

    /// All agents in order of their numbers, as a spectator sees them.
    pub fn agent_states(&self) -> impl Iterator<Item = AgentState> + '_ {
        self.agents().zip(self.board.agents()).map(|(agent, body)| {
            let (light_on, carrying_food) = self.flag_of(agent);
            AgentState { agent, at: body.at, alive: !body.gone, light_on, carrying_food }
        })
    }

    /// State of the agent's light, and its load; `None` if the task has no such flag.
    fn flag_of(&self, agent: AgentId) -> (Option<bool>, Option<bool>) {
        match &self.task {
            Task::Synchronization(task) => (Some(task.light_on[agent.index()]), None),
            Task::Foraging(task) => (None, Some(task.carrying[agent.index()])),
            Task::Transport(_) | Task::Pursuit(_) | Task::Flocking(_) => (None, None),
        }
    }
}

/// One more than the number of past views that are shown: the current view counts as remembered.
fn remembered_views(config: &Config) -> u32 {
    u32::try_from(config.memory).expect("a memory is short")
}

/// The window of an agent: centred on it, or the whole map under centralized control.
fn view(config: &Config, board: &Board, flags: &[bool], agent: AgentId) -> View {
    let center = board.agents()[agent.index()].at;
    let (origin, height, width) = match config.control {
        Control::Decentralized => {
            let reach = config.reach();
            (Pos::new(center.i - reach, center.j - reach), config.view_size, config.view_size)
        }
        Control::Centralized => (Pos::new(0, 0), config.height, config.width),
    };
    let see = |at: Pos| {
        if !board.grid().contains(at) {
            return Seen::Outside;
        }
        let Some(id) = board.grid().get(at) else { return Seen::Empty };
        match board.body(id).kind {
            Kind::Agent if id.index() == agent.index() => Seen::Yourself,
            Kind::Agent => {
                let marked = flags.get(id.index()).is_some_and(|&flag| match config.rules {
                    RuleSet::Paper => flag,
                    RuleSet::Reference => !flag,
                });
                Seen::Agent { number: id.0, marked }
            }
            Kind::Wall => Seen::Wall,
            Kind::Nest => Seen::Nest,
            Kind::Food => Seen::Food,
            Kind::Block => Seen::Block,
            Kind::Prey => Seen::Prey,
        }
    };
    let length = |cells: i32| usize::try_from(cells).expect("a positive size");
    let mut cells = Vec::with_capacity(length(height * width));
    for i in origin.i..origin.i + height {
        cells.extend((origin.j..origin.j + width).map(|j| see(Pos::new(i, j))));
    }
    View { origin, height: length(height), width: length(width), cells }
}

/// The symbol of a body on a spectator's grid.
const fn symbol(kind: Kind) -> char {
    match kind {
        Kind::Agent => 'A',
        Kind::Wall => 'W',
        Kind::Nest => 'N',
        Kind::Food => 'F',
        Kind::Block => 'B',
        Kind::Prey => 'P',
    }
}
