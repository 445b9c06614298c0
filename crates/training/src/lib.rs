//! Many episodes in one process, stepped together, as arrays: environments for training.
//!
//! A [`Batch`] has a number of environments of the same settings. [`Batch::reset`] and [`Batch::step`] write
//! observations and rewards into slices that the caller owns ([`Frame`], [`Gains`]). Layouts, rounds and scores are the
//! engine's, so an environment with the seed of a hosted episode plays exactly that episode; [`Batch::journal`] proves
//! it.
//!
//! ```
//! use swarmbench_engine::{Settings, TaskName};
//! use swarmbench_training::{Arrays, Batch, Options, Turn};
//!
//! let settings = Settings { memory: 0, ..Settings::standard(TaskName::Foraging, 0) };
//! let mut batch = Batch::new(&settings, Options { environments: 4, seed: 27, ..Options::default() })?;
//! let mut arrays = Arrays::new(&batch.shape());
//! batch.reset(&[], None, arrays.frame())?;
//! let up = vec![0; 4 * 12];
//! let (frame, gains) = arrays.parts();
//! batch.step(Turn { actions: &up, messages: Vec::new() }, frame, gains, None)?;
//! # Ok::<(), swarmbench_training::BatchError>(())
//! ```
//!
//! The crate is separate so that it is built and tested without Python.

mod arrays;
mod batch;
mod environment;
mod options;
mod partners;
mod record;
mod rewards;
mod window;

pub use arrays::{Arrays, Frame, Gains};
pub use batch::{Batch, BatchError, Said, Turn};
pub use options::{Autoreset, Mask, Observations, Options, Rewards, Shape};
pub use partners::Partners;
pub use record::StateError;
pub use window::CHANNELS;
