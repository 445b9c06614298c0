//! Words of the wire for episodes and runs that several shapes share.

use serde::{Deserialize, Serialize};

swarmbench_engine::named! {
    /// The status of an episode.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
    #[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = StatusName))]
    #[serde(rename_all = "lowercase")]
    pub enum Status {
        /// Created, not started.
        Waiting = "waiting",
        /// Rounds are played.
        Running = "running",
        /// Played to its end.
        Finished = "finished",
        /// Ended by its creator.
        Aborted = "aborted",
        /// Ended by its idle timeout.
        Abandoned = "abandoned",
    }
}

impl Status {
    /// Whether it has ended.
    #[must_use]
    pub const fn is_over(self) -> bool {
        match self {
            Self::Waiting | Self::Running => false,
            Self::Finished | Self::Aborted | Self::Abandoned => true,
        }
    }
}

swarmbench_engine::named! {
    /// The status of a run.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum RunStatus {
        /// Games are played, or are still to be opened.
        Running = "running",
        /// All games were played.
        Finished = "finished",
        /// Ended by its creator, or an organizer.
        Aborted = "aborted",
        /// Ended by its idle timeout.
        Abandoned = "abandoned",
        /// Ended because its competition closed.
        Closed = "closed",
    }
}

swarmbench_engine::named! {
    /// Who reads state, events and resolved rounds of an episode before its end.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Visibility {
        /// Anyone.
        Public = "public",
        /// Its creator.
        Owner = "owner",
        /// Organizers alone, also after its end, until its competition is revealed.
        Sealed = "sealed",
    }
}
