//! A game as its metrics need it. Imported games have all of this, too.

use swarmbench_engine::{
    Action, AgentId, AgentState, Body, Control, Delivery, Direction, Kind, Pos, TaskName, World,
};

/// Facts of a game that are the same in all rounds.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// The task.
    pub task: TaskName,
    /// The rule for who may talk to whom.
    pub control: Control,
    /// Rows of the map.
    pub height: i32,
    /// Columns of the map.
    pub width: i32,
    /// Rows and columns of an agent's window.
    pub view_size: i32,
    /// Rounds that an agent remembers; `None` if an imported game does not say it.
    pub memory: Option<u32>,
    /// Cells of the layout without a fixed object (walls, nest, food).
    pub open_cells: usize,
}

/// A state of a game.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// The score so far.
    pub score: f64,
    /// All agents in the order of their numbers.
    pub agents: Vec<Agent>,
    /// Cells of the block (Transport), those outside the map included; empty in other tasks.
    pub block: Vec<Pos>,
    /// Free neighbours of the prey, 0 to 4 (Pursuit).
    pub prey_freedom: Option<u32>,
}

/// An agent in a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Agent {
    /// The cell of the agent, or the cell to which it escaped.
    pub at: Pos,
    /// True if the agent is on the map.
    pub alive: bool,
    /// True if the agent's light is on (Synchronization).
    pub light_on: Option<bool>,
}

/// The decision of an agent in a round. The default is that of an agent that has escaped.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Decision {
    /// The action, if any.
    pub action: Option<Action>,
    /// The message as it was passed on, if any; never empty.
    pub message: Option<String>,
    /// True if the answer could not be read.
    pub invalid: bool,
    /// True if the agent's clock expired.
    pub timeout: bool,
    /// Tokens of prompt and answer together, if reported.
    pub tokens: Option<u64>,
}

/// A message that was delivered with a state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// The agent that reads it.
    pub receiver: AgentId,
    /// The agent that sent it; under the rules `reference` it may be the receiver.
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

    /// Rows and columns that an agent sees on each side.
    pub(crate) const fn reach(&self) -> i32 {
        self.view_size / 2
    }

    /// True if a cell lies on the map.
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

    /// The agents on the map, with their indices.
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

    /// True if the receiver is the sender.
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
