//! Competitions: runs on seeds that are secret until the end.
//!
//! - [`definition`]: what an organizer decides, and what is wrong with it.
//! - [`change`]: what of it may change later.
//! - [`sealed`]: the seeds, and the commitment that shows that they were never changed.
//! - [`phase`]: what is open at which time.
//! - [`standings`]: which attempt of each entrant counts, and who is ahead.
//! - [`shown`]: what everybody sees of all that, in the shapes of the wire.
//! - [`export`]: a whole competition in one file; [`verify`]: whether such a file is true.

pub mod change;
pub mod definition;
pub mod entrant;
pub mod export;
pub mod phase;
mod replays;
pub mod sealed;
pub mod shown;
pub mod standings;
pub mod verify;

use serde::{Deserialize, Serialize};

swarmbench_engine::named! {
    /// Whether an entrant takes part.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum EntrantStatus {
        /// It does.
        Active = "active",
        /// It has left; what it played is shown without a rank.
        Withdrawn = "withdrawn",
        /// The organizer has excluded it; what it played is shown without a rank.
        Disqualified = "disqualified",
    }
}
