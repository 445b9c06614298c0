//! Built-in `SwarmBench` players: an observation goes in, an act comes out, nothing else is in reach.
//!
//! A player is made for one [`Seat`] and decides one round after another:
//!
//! ```
//! use std::sync::Arc;
//! use swarmbench_engine::{AgentId, Config, RuleSet, Settings, TaskName, World};
//! use swarmbench_players::{Player, Seat, default_for};
//!
//! let task = TaskName::Synchronization;
//! let mut world = World::new(Arc::new(Config::check(&Settings::standard(task, 27))?));
//! let seat = |agent| Seat {
//!     agent, num_agents: 12, width: 10, height: 10, task, rules: RuleSet::Paper, seed: 1,
//! };
//! let mut players: Vec<_> = world.agents().map(|agent| default_for(task).make(&seat(agent))).collect();
//! while !world.is_over() {
//!     let decide = |(agent, player): (AgentId, &mut Box<dyn Player>)| {
//!         player.decide(&world.observe(agent))
//!     };
//!     let acts: Vec<_> = world.agents().zip(&mut players).map(decide).collect();
//!     world.step(&acts);
//! }
//! assert_eq!(world.score(), 100.0);
//! # Ok::<(), swarmbench_engine::SettingErrors>(())
//! ```
//!
//! # Adding a player
//!
//! Write a file that is named like the player, with a type that implements [`Player`] and a function
//! `make` that makes one for a seat. Add a line to the table in this file: its name, the tasks that
//! it plays, what it does in one sentence, and `make`. The tests play every line of the table, so
//! nothing else has to be told. A player keeps to what it was shown: it may remember anything, draw
//! from a generator seeded by its seat, and must cope with any observation without a panic.

mod chance;
mod chart;
mod close_in;
mod map_and_carry;
mod meet_in_the_middle;
mod push_and_leave;
mod random;
mod round_clock;
mod talk;

use swarmbench_engine::{Act, AgentId, Observation, RuleSet, TaskName};

/// A player for one seat. Deterministic given how it was made and what it was shown.
pub trait Player: Send {
    /// What the agent does in the round that the observation shows.
    fn decide(&mut self, observation: &Observation) -> Act;
}

/// How a seat's player is made: what an agent may know before the game, and the player's own seed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seat {
    /// Whose player it is.
    pub agent: AgentId,
    /// How many agents play.
    pub num_agents: u16,
    /// Columns of the map, its wall ring included.
    pub width: u16,
    /// Rows of the map, its wall ring included.
    pub height: u16,
    /// The task.
    pub task: TaskName,
    /// The rule set.
    pub rules: RuleSet,
    /// The player's own seed; never the episode's, which would tell the layout.
    pub seed: u64,
}

/// A built-in player as it is chosen by name.
#[derive(Debug)]
pub struct BuiltIn {
    /// What it is called, in lower case with hyphens.
    pub name: &'static str,
    /// The tasks that it plays.
    pub tasks: &'static [TaskName],
    /// What it does, in one sentence.
    pub summary: &'static str,
    make: fn(&Seat) -> Box<dyn Player>,
}

impl BuiltIn {
    /// Makes the player of one seat.
    #[must_use]
    pub fn make(&self, seat: &Seat) -> Box<dyn Player> {
        (self.make)(seat)
    }
}

/// Every built-in player. The first that plays a task after `random` is the task's default.
static BUILT_INS: [BuiltIn; 6] = [
    BuiltIn {
        name: "random",
        tasks: &TaskName::ALL,
        summary: "Picks any action, every one equally likely, and says nothing.",
        make: random::make,
    },
    BuiltIn {
        name: "push-and-leave",
        tasks: &[TaskName::Transport],
        summary: "Lines up behind the block, pushes it free and out, then leaves through the gap.",
        make: push_and_leave::make,
    },
    BuiltIn {
        name: "close-in",
        tasks: &[TaskName::Pursuit],
        summary: "Calls out where the prey is and walks to the nearest free cell beside it.",
        make: close_in::make,
    },
    BuiltIn {
        name: "round-clock",
        tasks: &[TaskName::Synchronization],
        summary: "Turns its light on in even rounds and off in odd ones.",
        make: round_clock::make,
    },
    BuiltIn {
        name: "map-and-carry",
        tasks: &[TaskName::Foraging],
        summary: "Explores with a remembered map, then walks between food and nest, and tells where they are.",
        make: map_and_carry::make,
    },
    BuiltIn {
        name: "meet-in-the-middle",
        tasks: &[TaskName::Flocking],
        summary: "Fills the outline of the square in the middle of the map, nearest free cell first.",
        make: meet_in_the_middle::make,
    },
];

/// Every built-in player.
#[must_use]
pub fn all() -> &'static [BuiltIn] {
    &BUILT_INS
}

/// The player `name`, if it plays `task`.
///
/// # Errors
/// Where no player of that name plays the task; the error lists those that do.
pub fn find(name: &str, task: TaskName) -> Result<&'static BuiltIn, UnknownPlayer> {
    of_task(task)
        .find(|player| player.name == name)
        .ok_or_else(|| UnknownPlayer { name: name.to_owned(), task })
}

/// The sensible player of a task, used where nobody names one.
#[must_use]
pub fn default_for(task: TaskName) -> &'static BuiltIn {
    let [random, ..] = &BUILT_INS;
    of_task(task).find(|player| player.name != random.name).unwrap_or(random)
}

/// The players of a task in the order of the table.
fn of_task(task: TaskName) -> impl Iterator<Item = &'static BuiltIn> {
    BUILT_INS.iter().filter(move |player| player.tasks.contains(&task))
}

/// No player of this name plays the task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownPlayer {
    /// The name that was asked for.
    pub name: String,
    /// The task that it was to play.
    pub task: TaskName,
}

impl std::fmt::Display for UnknownPlayer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let known: Vec<_> = of_task(self.task).map(|player| player.name).collect();
        let shown: String = self.name.chars().take(40).collect();
        write!(
            f,
            "no built-in player {shown:?} plays {}, only {}",
            self.task.name(),
            known.join(", ")
        )
    }
}

impl std::error::Error for UnknownPlayer {}
