//! A game, as far as its metrics need it: also games that were imported have all of this.

use swarmbench_engine::{
    Action, AgentId, AgentState, Body, Control, Delivery, Direction, Kind, Pos, TaskName, World,
};

/// What is the same in all rounds of a game.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// The task.
    pub task: TaskName,
    /// Who may talk to whom.
    pub control: Control,
    /// Rows of the map.
    pub height: i32,
    /// Columns of the map.
    pub width: i32,
    /// Rows and columns of an agent's window.
    pub view_size: i32,
    /// How many rounds an agent remembers; `None` where an imported game does not say it.
    pub memory: Option<u32>,
    /// Cells of the layout on which nothing fixed lies (walls, nest, food).
    pub open_cells: usize,
}

/// A state of a game.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// The score so far.
    pub score: f64,
    /// All agents in order of their numbers.
    pub agents: Vec<Agent>,
    /// Cells of the block (Transport), also those outside the map; empty elsewhere.
    pub block: Vec<Pos>,
    /// Free neighbours of the prey, 0 to 4 (Pursuit).
    pub prey_freedom: Option<u32>,
}

/// An agent in a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Agent {
    /// Where it is; where it went when it escaped.
    pub at: Pos,
    /// Whether it is on the map.
    pub alive: bool,
    /// Whether its light is on (Synchronization).
    pub light_on: Option<bool>,
}

/// What an agent decided in a round. The default is what an agent that has escaped decides.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Decision {
    /// The action, if any.
    pub action: Option<Action>,
    /// The message as it was sent on, if any; never empty.
    pub message: Option<String>,
    /// False for an answer that could not be read.
    pub invalid: bool,
    /// Whether its clock expired.
    pub timeout: bool,
    /// Tokens of the prompt and of the answer together, where they were reported.
    pub tokens: Option<u64>,
}

/// A message that was delivered with a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// Who reads it.
    pub receiver: AgentId,
    /// Who sent it; may be the receiver itself (rules `reference`).
    pub sender: AgentId,
    /// The round in which it was sent.
    pub sent: u32,
    /// The text as the receiver reads it: noise may have changed it.
    pub text: String,
}

impl Setup {
    /// The setup of a game at its layout.
    #[must_use]
    pub fn of(layout: &World) -> Self {
        let (config, board) = (layout.config(), layout.board());
        let view_size = config.settings().view_size;
        let (height, width) = (board.grid().height(), board.grid().width());
        let cells = (0..height).flat_map(|i| (0..width).map(move |j| Pos::new(i, j)));
        let is_fixed = |kind| matches!(kind, Kind::Wall | Kind::Nest | Kind::Food);
        Self {
            task: config.task(),
            control: config.control(),
            height,
            width,
            view_size: i32::try_from(view_size).expect("a checked setting is small"),
            memory: Some(u32::try_from(config.memory()).expect("a memory is short")),
            open_cells: cells.filter(|&cell| !board.kind_at(cell).is_some_and(is_fixed)).count(),
        }
    }

    /// How many rows and columns an agent sees on each side.
    pub(crate) const fn reach(&self) -> i32 {
        self.view_size / 2
    }

    /// Whether a cell lies on the map.
    pub(crate) const fn contains(&self, cell: Pos) -> bool {
        0 <= cell.i && cell.i < self.height && 0 <= cell.j && cell.j < self.width
    }
}

impl State {
    /// The state of a game that is played or replayed.
    #[must_use]
    pub fn of(world: &World) -> Self {
        let board = world.board();
        let body_of = |kind| board.bodies().iter().find(|body| body.kind() == kind);
        let agent = |state: AgentState| Agent {
            at: state.at,
            alive: state.alive,
            light_on: state.light_on,
        };
        let is_free = |cell: &Pos| board.grid().is_free(*cell);
        let freedom = |prey: &Body| {
            Direction::ALL.map(|d| prey.at().toward(d)).iter().filter(|c| is_free(c)).count()
        };
        Self {
            score: world.score(),
            agents: world.agent_states().map(agent).collect(),
            block: body_of(Kind::Block).into_iter().flat_map(Body::cells).collect(),
            prey_freedom: body_of(Kind::Prey)
                .map(|prey| u32::try_from(freedom(prey)).expect("at most 4")),
        }
    }

    /// The agents on the map, with their places in the list.
    pub(crate) fn living(&self) -> impl Iterator<Item = (usize, &Agent)> {
        self.agents.iter().enumerate().filter(|(_, agent)| agent.alive)
    }
}

impl Heard {
    /// All messages that were delivered with a state.
    #[must_use]
    pub fn all(world: &World) -> Vec<Self> {
        let own = |delivery: Delivery<'_>| Self {
            receiver: delivery.receiver,
            sender: delivery.sender,
            sent: delivery.sent,
            text: delivery.text.to_string(),
        };
        world.heard().map(own).collect()
    }

    /// Whether the receiver is the sender itself.
    pub(crate) fn is_own(&self) -> bool {
        self.receiver == self.sender
    }
}

impl Decision {
    /// The direction of a move action.
    pub(crate) fn direction(&self) -> Option<Direction> {
        self.action.and_then(Action::direction)
    }
}
