//! Competitions: runs on seeds that are secret until the end.
//!
//! - [`definition`]: decisions of the organizer, and their checks.
//! - [`change`]: changes of them.
//! - [`sealed`]: seeds, and the commitment that proves that they never changed.
//! - [`phase`]: phases, and which attempts may be started.
//! - [`standings`]: the counting attempt of each entrant, and the ranking.
//! - [`shown`]: public views in the shapes of the wire.
//! - [`export`]: a whole competition in one file; [`verify`]: verification of such a file.

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
    /// Participation of an entrant.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum EntrantStatus {
        /// The entrant takes part.
        Active = "active",
        /// The entrant has left; its results are shown without a rank.
        Withdrawn = "withdrawn",
        /// The organizer has excluded the entrant; its results are shown without a rank.
        Disqualified = "disqualified",
    }
}
