//! A game, as far as its metrics need it: also games that were imported have all of this.

use swarmbench_engine::{Action, AgentId, Control, Pos, TaskName, World};

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
    /// Cells of the block (Transport); empty elsewhere.
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
        let _ = layout;
        todo!("filled in by the metrics part")
    }
}

impl State {
    /// The state of a game that is played or replayed.
    #[must_use]
    pub fn of(world: &World) -> Self {
        let _ = world;
        todo!("filled in by the metrics part")
    }
}
