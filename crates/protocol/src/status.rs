//! Words of the wire for episodes and runs that several shapes share.

use serde::{Deserialize, Serialize};

/// The status of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "openapi", derive(utoipa::ToSchema), schema(as = StatusName))]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Created, not started.
    Waiting,
    /// Rounds are played.
    Running,
    /// Played to its end.
    Finished,
    /// Ended by its creator.
    Aborted,
    /// Ended because nobody acted any more.
    Abandoned,
}

impl Status {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Waiting, Self::Running, Self::Finished, Self::Aborted, Self::Abandoned];

    /// Its name on the wire and in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Running => "running",
            Self::Finished => "finished",
            Self::Aborted => "aborted",
            Self::Abandoned => "abandoned",
        }
    }

    /// The status with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }

    /// Whether nothing happens any more.
    #[must_use]
    pub const fn is_over(self) -> bool {
        match self {
            Self::Waiting | Self::Running => false,
            Self::Finished | Self::Aborted | Self::Abandoned => true,
        }
    }
}

/// The status of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunStatus {
    /// Games are played, or are still to be opened.
    Running,
    /// All games were played.
    Finished,
    /// Ended by its creator, or an organizer.
    Aborted,
    /// Ended because nobody acted any more.
    Abandoned,
    /// Ended because its competition closed.
    Closed,
}

impl RunStatus {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Running, Self::Finished, Self::Aborted, Self::Abandoned, Self::Closed];

    /// Its name on the wire and in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Finished => "finished",
            Self::Aborted => "aborted",
            Self::Abandoned => "abandoned",
            Self::Closed => "closed",
        }
    }

    /// The status with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }
}

/// Who reads state, events and resolved rounds of an episode before its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// Anyone.
    Public,
    /// Its creator.
    Owner,
    /// Organizers alone, also after its end, until its competition is revealed.
    Sealed,
}

impl Visibility {
    /// All of them; a creator may choose but the last.
    pub const ALL: [Self; 3] = [Self::Public, Self::Owner, Self::Sealed];

    /// Its name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Public => "public",
            Self::Owner => "owner",
            Self::Sealed => "sealed",
        }
    }

    /// The one with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|visibility| visibility.name() == name)
    }
}
