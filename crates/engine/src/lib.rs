//! The `SwarmBench` simulation, exactly by the rules (`docs/rules.md`), and nothing else: no clock, no
//! files, no network, no wire format.
//!
//! Lay an episode out. [`Settings`] are unchecked, a [`Config`] is checked:
//!
//! ```
//! use std::sync::Arc;
//! use swarmbench_engine::{Config, Settings, TaskName, World};
//!
//! let settings = Settings::standard(TaskName::Transport, 27);
//! let mut world = World::new(Arc::new(Config::check(&settings)?));
//! assert_eq!(world.spectator_view().grid[1], "W....BBB.W");
//!
//! let too_small = Settings { width: 4, ..settings };
//! let refused = Config::check(&too_small).unwrap_err();
//! assert_eq!(refused.to_string(), "width must be from 8 to 256, is 4");
//! # Ok::<(), swarmbench_engine::SettingErrors>(())
//! ```
//!
//! Step. Every agent decides once a round; an empty act is valid:
//!
//! ```
//! # use std::sync::Arc;
//! # use swarmbench_engine::{Config, Settings, TaskName, World};
//! use swarmbench_engine::{Act, Action};
//! # let settings = Settings::standard(TaskName::Synchronization, 27);
//! # let mut world = World::new(Arc::new(Config::check(&settings)?));
//!
//! let mut acts = vec![Act::default(); 12];
//! acts[3] = Act::of(Action::Switch);
//! world.step(&acts);
//! assert_eq!((world.round(), world.is_over()), (1, false));
//! # Ok::<(), swarmbench_engine::SettingErrors>(())
//! ```
//!
//! Observe. An agent sees its window, a spectator the whole map:
//!
//! ```
//! # use std::sync::Arc;
//! # use swarmbench_engine::{Config, Settings, TaskName, World};
//! use swarmbench_engine::{AgentId, Seen};
//! # let settings = Settings::standard(TaskName::Transport, 27);
//! # let world = World::new(Arc::new(Config::check(&settings)?));
//!
//! let view = world.observe(AgentId(8)).view.expect("it has not escaped");
//! let first: Vec<String> = view.rows().next().unwrap().iter().map(Seen::to_string).collect();
//! assert_eq!(first, ["0", "3", ".", "10", "W"]);
//! # Ok::<(), swarmbench_engine::SettingErrors>(())
//! ```

pub mod answer;
pub mod physics;
pub mod tasks;

mod act;
mod body;
mod canvas;
mod check;
mod config;
mod digest;
mod grid;
mod mail;
mod message;
mod names;
mod observe;
mod rng;
mod seed;
mod settings;
mod step;
mod world;

pub use act::{Act, Action, AgentId};
pub use body::{Board, Body, Kind};
pub use canvas::Canvas;
pub use check::{SettingError, SettingErrors, limits};
pub use config::Config;
pub use digest::Digest;
pub use grid::{BodyId, Direction, Grid, Pos};
pub use mail::Delivery;
pub use message::Message;
pub use names::{AnswerReader, Control, RuleSet, TaskName};
pub use observe::{
    AgentState, Landmarks, Observation, PastView, Remembered, Seen, SpectatorView, View,
};
pub use seed::{Seed, SeedError};
pub use settings::Settings;
pub use step::Scratch;
pub use world::World;

/// The revision of the rules that this engine plays; every journal names the one it was played by. Any change of
/// behaviour is a new revision.
pub const RULES_REVISION: u32 = 1;
