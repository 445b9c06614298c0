//! What could still be scored: the worth of a state, and what each decision lost of it (`docs/evaluate/worth.md`).
//!
//! The *reference swarm* of a task is its default built-in player on every seat. The worth of a state is the score that this
//! swarm reaches when it plays on from there, having seen what the agents saw before. It is computed by *rollouts*: the engine and
//! the players are deterministic, so a state has one worth, and it equals the score of a fork that the reference plays.
//!
//! ```
//! use std::sync::Arc;
//! use swarmbench_engine::{Config, Settings, TaskName, World};
//! use swarmbench_worth::{Appraiser, Decided, Game};
//!
//! let settings = Settings::standard(TaskName::Synchronization, 27);
//! let layout = Arc::new(World::new(Arc::new(Config::check(&settings)?)));
//! let idle = vec![Decided::default(); layout.agents().count()];
//! let game = Game { layout, rounds: vec![idle; 5] };
//! let worth = Appraiser::new(game, false).finish_on(1, |_| {});
//! // The swarm could have scored in each of these five rounds.
//! assert_eq!(worth.values[0] - worth.values[5], 5.0);
//! # Ok::<(), swarmbench_engine::SettingErrors>(())
//! ```

mod appraiser;
mod journal;
mod line;
mod sent;
mod words;

pub use appraiser::{Appraiser, Decided, Game, Kind, Worth, rounds_of};
pub use journal::{decided, game_of};
pub use line::Liner;
pub use sent::{DEAREST, method, sent, without};

/// Revision of all definitions: a worth of another revision is computed again.
pub const WORTH_REVISION: u32 = 1;
