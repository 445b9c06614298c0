//! Words of the wire that several shapes of episodes and runs share.

use serde::{Deserialize, Serialize};

swarmbench_engine::named! {
    /// Status of an episode.
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
        /// Ended by its creator or an organizer, or by the close of its competition.
        Aborted = "aborted",
        /// Ended by its idle timeout.
        Abandoned = "abandoned",
    }
}

impl Status {
    /// Whether the episode has ended.
    #[must_use]
    pub const fn is_over(self) -> bool {
        match self {
            Self::Waiting | Self::Running => false,
            Self::Finished | Self::Aborted | Self::Abandoned => true,
        }
    }
}

swarmbench_engine::named! {
    /// Status of a run.
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
    /// Readers of state, events and resolved rounds of an episode before its end.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Visibility {
        /// Anyone.
        Public = "public",
        /// The creator.
        Owner = "owner",
        /// Organizers and judges, also after the end, until the competition is revealed.
        Sealed = "sealed",
    }
}
