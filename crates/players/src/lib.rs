//! Built-in `SwarmBench` players: from an observation to an act, with no other input.
//!
//! A player is made for one [`Seat`] and decides one round after another:
//!
//! ```
//! use std::sync::Arc;
//! use swarmbench_engine::{AgentId, Config, Settings, TaskName, World};
//! use swarmbench_players::{Player, Seat, default_for};
//!
//! let task = TaskName::Synchronization;
//! let mut world = World::new(Arc::new(Config::check(&Settings::standard(task, 27))?));
//! let make = |agent| default_for(task).make(&Seat::of(world.config(), agent, 1));
//! let mut players: Vec<_> = world.agents().map(make).collect();
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
//! [`game::play`] does the same in one call.
//!
//! # Adding a player
//!
//! Write a file that is named like the player, in the folder of its task, with a type that implements [`Player`] and a
//! function `make` that makes one for a seat. Add a line to the table in the folder's `mod.rs`: its name, the tasks
//! that it plays, a summary in one sentence, and `make`. The tests play every line of every table, so no other
//! registration is needed. A player uses only its seat and its observations: it may remember anything, draw from a
//! generator seeded by its seat, and must cope with any observation without a panic.

mod assign;
mod chance;
mod chart;
mod flocking;
mod foraging;
pub mod game;
mod pursuit;
mod random;
mod synchronization;
mod talk;
mod transport;
mod walk;

use dyn_clone::DynClone;
use sha2::{Digest as _, Sha256};
use swarmbench_engine::{Act, AgentId, Config, Observation, RuleSet, TaskName};

/// A player for one seat. Deterministic: its decisions depend only on its [`Seat`] and its observations. A clone decides like the player
/// if it is shown the same.
pub trait Player: DynClone + Send {
    /// Decides the act for the round that the observation shows.
    fn decide(&mut self, observation: &Observation) -> Act;
}

dyn_clone::clone_trait_object!(Player);

/// A seat: what an agent may know before the game, and the seed of its player.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Seat {
    /// The agent that the player controls.
    pub agent: AgentId,
    /// Number of agents in the game.
    pub num_agents: u16,
    /// Columns of the map, its wall ring included.
    pub width: u16,
    /// Rows of the map, its wall ring included.
    pub height: u16,
    /// The task.
    pub task: TaskName,
    /// The rule set.
    pub rules: RuleSet,
    /// The player's own seed; never the episode's, which would reveal the layout.
    pub seed: u64,
}

impl Seat {
    /// The seat of an agent in a game of these settings; `seed` is the seed of the whole swarm's players.
    #[must_use]
    pub fn of(config: &Config, agent: AgentId, seed: u64) -> Self {
        let settings = config.settings();
        let size = |cells: i64| u16::try_from(cells).expect("a checked map is small");
        Self {
            agent,
            num_agents: config.num_agents(),
            width: size(settings.width),
            height: size(settings.height),
            task: config.task(),
            rules: config.rules(),
            seed: Self::seed_of(agent, seed),
        }
    }

    /// The seat of a player that a server hosts or that is a partner in training. Its seed is a hash of the episode's
    /// seed: the same episode is played the same way again, and the episode's seed is not revealed. `salt` keeps the
    /// hash of a sealed episode from being recomputed; it is empty for others.
    #[must_use]
    pub fn hosted(config: &Config, agent: AgentId, salt: &[u8]) -> Self {
        let mut hash = Sha256::new();
        hash.update("the player of a seat");
        hash.update(config.settings().seed.to_be_bytes());
        hash.update(agent.0.to_be_bytes());
        hash.update(salt);
        let hash: [u8; 32] = hash.finalize().into();
        let seed = u64::from_be_bytes(*hash.first_chunk().expect("a hash has 32 bytes"));
        Self { seed, ..Self::of(config, agent, 0) }
    }

    /// The seed of one agent's player, derived from the swarm's.
    #[must_use]
    pub const fn seed_of(agent: AgentId, swarm: u64) -> u64 {
        swarm.wrapping_mul(1 << 16).wrapping_add(agent.0 as u64)
    }
}

/// A built-in player, selected by name.
#[derive(Debug)]
pub struct BuiltIn {
    /// Name in lower case with hyphens.
    pub name: &'static str,
    /// The tasks that it plays.
    pub tasks: &'static [TaskName],
    /// Description in one sentence.
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

/// Every built-in player, task by task and the best of each task first; `random` plays all tasks.
static BUILT_INS: [&[BuiltIn]; 6] = [
    transport::PLAYERS,
    pursuit::PLAYERS,
    synchronization::PLAYERS,
    foraging::PLAYERS,
    flocking::PLAYERS,
    &[random::PLAYER],
];

/// Every built-in player, task by task and the best of each task first.
pub fn all() -> impl Iterator<Item = &'static BuiltIn> {
    BUILT_INS.iter().copied().flatten()
}

/// The name that stands for the best player of each task.
pub const DEFAULT_PLAYER: &str = "default";

/// Finds the player `name` that plays `task`; [`DEFAULT_PLAYER`] stands for the best player of the task.
///
/// # Errors
/// [`UnknownPlayer`] if no player of that name plays the task; its message lists those that do.
pub fn find(name: &str, task: TaskName) -> Result<&'static BuiltIn, UnknownPlayer> {
    of_task(task)
        .find(|player| name == DEFAULT_PLAYER || player.name == name)
        .ok_or_else(|| UnknownPlayer { name: name.to_owned(), task })
}

/// The best player of a task, used if none is named.
#[must_use]
pub fn default_for(task: TaskName) -> &'static BuiltIn {
    of_task(task).next().expect("random plays every task")
}

/// The players of a task, the best one first and `random` last.
pub fn of_task(task: TaskName) -> impl Iterator<Item = &'static BuiltIn> {
    all().filter(move |player| player.tasks.contains(&task))
}

/// No player of this name plays the task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownPlayer {
    /// The requested name.
    pub name: String,
    /// The task of the game.
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
