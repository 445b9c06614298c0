//! What everybody holds: episodes that have not ended, and bytes in the journal.

use std::collections::HashMap;
use std::sync::Mutex;

use crate::journal::EpisodeKey;
use crate::keys::OwnerKey;

/// How much may be held. What is over it is refused; what runs goes on.
#[derive(Clone, Copy, Debug)]
pub struct Caps {
    /// Episodes that have not ended, in all.
    pub episodes_unfinished_max: usize,
    /// Episodes that have not ended, of one key.
    pub episodes_per_key_max: usize,
    /// Bytes that the acts of one episode may take in the journal.
    pub journal_bytes_per_episode_max: u64,
    /// Bytes that the acts of all episodes of one key may take in the journal.
    pub journal_bytes_per_key_max: u64,
}

/// A record of an act of at most so many bytes is kept whatever was used: an action and a message
/// always fit, so that an episode can be played to its end.
pub const ACT_BYTES_ALWAYS: u64 = 2048;

/// A cap that was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Full {
    /// The server plays as many episodes as it takes.
    #[error("{0} episodes are played already; wait until some have ended")]
    Episodes(usize),
    /// The holder of the key plays as many episodes as one may.
    #[error("{0} episodes of this key are played already; end some, or wait until they have ended")]
    EpisodesOfKey(usize),
    /// The acts of the episode take as many bytes as they may.
    #[error(
        "the acts of this episode take {0} bytes already; send them without `reasoning`, and an `action` instead of a long `response`"
    )]
    BytesOfEpisode(u64),
    /// The acts of all episodes of the key take as many bytes as they may.
    #[error(
        "the acts of all episodes of this key take {0} bytes already; ask the organizer for more, or send acts without `reasoning` and with short responses"
    )]
    BytesOfKey(u64),
}

impl Full {
    /// The name of the cap and its value.
    #[must_use]
    pub const fn limit(self) -> (&'static str, u64) {
        match self {
            Self::Episodes(most) => ("episodes_unfinished_max", most as u64),
            Self::EpisodesOfKey(most) => ("episodes_per_key_max", most as u64),
            Self::BytesOfEpisode(most) => ("journal_bytes_per_episode_max", most),
            Self::BytesOfKey(most) => ("journal_bytes_per_key_max", most),
        }
    }
}

/// Counts what is held; shared by all episodes of a server.
#[derive(Debug)]
pub struct Quotas {
    caps: Caps,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    unfinished: HashMap<EpisodeKey, Option<OwnerKey>>,
    by_owner: HashMap<OwnerKey, OfOwner>,
}

#[derive(Clone, Copy, Debug, Default)]
struct OfOwner {
    episodes: usize,
    bytes: u64,
}

impl Quotas {
    /// Nothing is held yet.
    #[must_use]
    pub fn new(caps: Caps) -> Self {
        Self { caps, held: Mutex::default() }
    }

    fn held(&self) -> std::sync::MutexGuard<'_, Held> {
        self.held.lock().expect("nothing panics while it holds this")
    }

    /// Takes a place for a new episode.
    ///
    /// # Errors
    /// The cap that was reached.
    pub fn admit(&self, episode: EpisodeKey, owner: Option<OwnerKey>) -> Result<(), Full> {
        let mut held = self.held();
        held.check(&self.caps, owner)?;
        held.begin(episode, owner);
        Ok(())
    }

    /// Whether there is a place for a new episode now.
    ///
    /// # Errors
    /// The cap that was reached.
    pub fn check(&self, owner: Option<OwnerKey>) -> Result<(), Full> {
        self.held().check(&self.caps, owner)
    }

    /// Notes an unfinished episode that exists already; doing it again changes nothing.
    pub fn note(&self, episode: EpisodeKey, owner: Option<OwnerKey>) {
        self.held().begin(episode, owner);
    }

    /// Notes that an episode has ended, or was not created after all.
    pub fn release(&self, episode: EpisodeKey) {
        let mut held = self.held();
        if let Some(Some(owner)) = held.unfinished.remove(&episode)
            && let Some(own) = held.by_owner.get_mut(&owner)
        {
            own.episodes = own.episodes.saturating_sub(1);
        }
    }

    /// How many episodes have not ended.
    #[must_use]
    pub fn unfinished(&self) -> usize {
        self.held().unfinished.len()
    }

    /// Whether an act of so many bytes may be kept for an episode whose acts take `used`.
    ///
    /// # Errors
    /// The cap that was reached.
    pub fn check_act(&self, owner: Option<OwnerKey>, used: u64, more: u64) -> Result<(), Full> {
        if more <= ACT_BYTES_ALWAYS {
            return Ok(());
        }
        let caps = &self.caps;
        if used + more > caps.journal_bytes_per_episode_max {
            return Err(Full::BytesOfEpisode(caps.journal_bytes_per_episode_max));
        }
        let own = owner.and_then(|owner| self.held().by_owner.get(&owner).copied());
        if own.is_some_and(|own| own.bytes + more > caps.journal_bytes_per_key_max) {
            return Err(Full::BytesOfKey(caps.journal_bytes_per_key_max));
        }
        Ok(())
    }

    /// Counts bytes that the episodes of a key take.
    pub fn add_bytes(&self, owner: Option<OwnerKey>, bytes: u64) {
        if let Some(owner) = owner {
            self.held().by_owner.entry(owner).or_default().bytes += bytes;
        }
    }
}

impl Held {
    fn check(&self, caps: &Caps, owner: Option<OwnerKey>) -> Result<(), Full> {
        if self.unfinished.len() >= caps.episodes_unfinished_max {
            return Err(Full::Episodes(caps.episodes_unfinished_max));
        }
        if let Some(owner) = owner {
            let own = self.by_owner.get(&owner).copied().unwrap_or_default();
            if own.episodes >= caps.episodes_per_key_max {
                return Err(Full::EpisodesOfKey(caps.episodes_per_key_max));
            }
            if own.bytes >= caps.journal_bytes_per_key_max {
                return Err(Full::BytesOfKey(caps.journal_bytes_per_key_max));
            }
        }
        Ok(())
    }

    fn begin(&mut self, episode: EpisodeKey, owner: Option<OwnerKey>) {
        let is_new = self.unfinished.insert(episode, owner).is_none();
        if let Some(owner) = owner.filter(|_| is_new) {
            self.by_owner.entry(owner).or_default().episodes += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAPS: Caps = Caps {
        episodes_unfinished_max: 3,
        episodes_per_key_max: 2,
        journal_bytes_per_episode_max: 10_000,
        journal_bytes_per_key_max: 15_000,
    };
    const OWN: Option<OwnerKey> = Some(OwnerKey(7));

    #[test]
    fn caps_hold_for_a_key_and_for_all() {
        let quotas = Quotas::new(CAPS);
        assert_eq!(quotas.admit(EpisodeKey(1), OWN), Ok(()));
        assert_eq!(quotas.admit(EpisodeKey(2), OWN), Ok(()));
        assert_eq!(quotas.admit(EpisodeKey(3), OWN), Err(Full::EpisodesOfKey(2)));
        assert_eq!(quotas.admit(EpisodeKey(4), None), Ok(()));
        assert_eq!(quotas.admit(EpisodeKey(5), None), Err(Full::Episodes(3)));
        quotas.release(EpisodeKey(1));
        quotas.release(EpisodeKey(1));
        assert_eq!(quotas.unfinished(), 2);
        assert_eq!(quotas.admit(EpisodeKey(3), OWN), Ok(()));
        // An episode that is taken up again is no second one.
        quotas.note(EpisodeKey(3), OWN);
        assert_eq!(quotas.unfinished(), 3);
    }

    #[test]
    fn bytes_are_limited_but_small_acts_always_fit() {
        let quotas = Quotas::new(CAPS);
        assert_eq!(quotas.check_act(None, 9_000, 1_000), Ok(()));
        assert_eq!(quotas.check_act(None, 9_000, 3_000), Err(Full::BytesOfEpisode(10_000)));
        assert_eq!(quotas.check_act(None, 99_000, ACT_BYTES_ALWAYS), Ok(()));
        quotas.add_bytes(OWN, 14_000);
        assert_eq!(quotas.check_act(OWN, 0, 3_000), Err(Full::BytesOfKey(15_000)));
        assert_eq!(quotas.check_act(None, 0, 3_000), Ok(()), "nobody's key, nobody's bytes");
        assert_eq!(quotas.admit(EpisodeKey(1), OWN), Ok(()));
        quotas.add_bytes(OWN, 1_000);
        assert_eq!(quotas.admit(EpisodeKey(2), OWN), Err(Full::BytesOfKey(15_000)));
    }
}
