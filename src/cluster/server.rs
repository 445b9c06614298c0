//! The servers of a cluster.

use std::time::Duration;

use crate::ids::Place;

/// Number of a server, unique for all time.
pub type Incarnation = i64;

/// Age of the last beat at which a server may be excluded.
pub const TAKEN_OVER_AFTER: Duration = Duration::from_secs(6);

/// Age at which a beat is late. One beat a second is usual.
const LATE_AFTER: Duration = Duration::from_millis(1500);

/// Time for a new server's first beat. Until then it opens the database and owns nothing to be taken over.
pub const STARTS_WITHIN: Duration = Duration::from_mins(1);

/// Tolerated offset between a server's clock and the database's.
pub const CLOCK_OFF_MAX: Duration = Duration::from_millis(500);

/// Longest pause between two commits of a server.
const COMMIT_PAUSE_MAX: Duration = Duration::from_millis(5);

/// A server of the cluster, as the database shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerRow {
    pub incarnation: Incarnation,
    /// Host and port for requests of the other servers.
    pub address: String,
    /// Host and process, for people.
    pub name: String,
    pub version: String,
    pub joined_at_ms: i64,
    /// Time of the last beat, and its age, by the database's clock. The age is negative while a server starts.
    pub beat_at_ms: i64,
    pub seen_ms_ago: i64,
    /// Whether the server has a session in the database, which ends with its process or connection.
    pub is_connected: bool,
    pub clock_offset_ms: i64,
    /// Whether the server takes places.
    pub is_ready: bool,
    /// Episodes in memory.
    pub episodes: u32,
    /// Games, runs and competitions owned.
    pub places: u32,
}

impl ServerRow {
    /// Whether the clock of the server is too far from the database's.
    pub(super) fn is_off(&self) -> bool {
        u128::from(self.clock_offset_ms.unsigned_abs()) > CLOCK_OFF_MAX.as_millis()
    }
}

/// Pause of a server after a commit that took `took`, where `playing` servers commit to the same database: on average each of
/// the others has its turn meanwhile. Commits carry more acts for it, and a cluster hardly commits more often than one server.
pub fn commit_pause(took: Duration, playing: usize) -> Duration {
    let others = u32::try_from(playing.saturating_sub(1)).unwrap_or(u32::MAX);
    took.saturating_mul(others).min(COMMIT_PAUSE_MAX)
}

/// Evidence of a server's death.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Death {
    /// No beat for [`TAKEN_OVER_AFTER`].
    Expired,
    /// The session is gone and the beat is late. A cut connection to the database looks the same.
    Seen,
    /// Another process listens at its address.
    Replaced,
}

impl Death {
    /// Minimum age of the last beat in milliseconds; negative where any age will do: a start dates its beat ahead by
    /// [`STARTS_WITHIN`].
    #[must_use]
    pub fn silent_ms(self) -> i64 {
        let silent = match self {
            Self::Expired => TAKEN_OVER_AFTER,
            Self::Seen => LATE_AFTER,
            Self::Replaced => return -2 * i64::try_from(STARTS_WITHIN.as_millis()).unwrap_or(0),
        };
        i64::try_from(silent.as_millis()).unwrap_or(i64::MAX)
    }
}

/// The server that should take a free place, or anything else with a number, by rendezvous hashing: servers that see the same
/// cluster agree, places are spread over servers, and few of them change when a server comes or goes. `None` if no server takes
/// places.
#[must_use]
pub fn preferred(servers: &[ServerRow], number: u64) -> Option<Incarnation> {
    let ready = servers.iter().filter(|row| row.is_ready).map(|row| row.incarnation);
    ready.max_by_key(|row| mixed(mixed(row.cast_unsigned()) ^ number))
}

/// The number of a place for [`preferred`].
#[must_use]
pub fn number_of(place: Place) -> u64 {
    let (kind, key) = place.numbers();
    mixed(key.cast_unsigned()) ^ u64::from(kind.unsigned_abs())
}

/// Mixes the bits of a number (the finalizer of `splitmix64`).
const fn mixed(number: u64) -> u64 {
    let number = (number ^ (number >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let number = (number ^ (number >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    number ^ (number >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_pauses_for_the_commits_of_others_and_not_for_long() {
        let took = Duration::from_millis(1);
        assert_eq!(commit_pause(took, 0), Duration::ZERO);
        assert_eq!(commit_pause(took, 1), Duration::ZERO);
        assert_eq!(commit_pause(took, 3), took * 2);
        assert_eq!(commit_pause(Duration::MAX, usize::MAX), COMMIT_PAUSE_MAX);
    }
}
