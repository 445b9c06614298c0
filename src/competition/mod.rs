//! Competitions: runs on seeds that nobody knows before the end. All of it is pure: no storage, no clock, no
//! network.
//!
//! - [`definition`]: what an organizer decides, and what is wrong with it.
//! - [`sealed`]: the seeds, and the commitment that shows that they were never changed.
//! - [`phase`]: what is open at which time.
//! - [`standings`]: which attempt of each entrant counts, and who is ahead.
//! - [`export`]: a whole competition in one file; [`verify`]: whether such a file is true.

pub mod definition;
pub mod entrant;
pub mod export;
pub mod phase;
pub mod sealed;
pub mod standings;
pub mod verify;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::clock::Entropy;
use crate::ids::dated_id;

/// A new public id of a competition.
#[must_use]
pub fn new_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("cmp_", now, entropy)
}

/// A new public id of an entrant.
#[must_use]
pub fn new_entrant_id(now: Timestamp, entropy: &dyn Entropy) -> String {
    dated_id("ent_", now, entropy)
}

/// Whether an entrant takes part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EntrantStatus {
    /// It does.
    Active,
    /// It has left; what it played is shown without a rank.
    Withdrawn,
    /// The organizer has excluded it; what it played is shown without a rank.
    Disqualified,
}

impl EntrantStatus {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Active, Self::Withdrawn, Self::Disqualified];

    /// Its name on the wire and in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Active => "active",
            Self::Withdrawn => "withdrawn",
            Self::Disqualified => "disqualified",
        }
    }

    /// The status with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }
}
