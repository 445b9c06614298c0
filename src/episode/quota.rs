//! Per-owner quotas: episodes that have not ended, and bytes in the journal.
//!
//! Two rules share the unfinished episodes. A group is a competition, a key, or a network without keys; a party is an entrant of a
//! competition, or else the group itself.
//!
//! - A party with episodes opens another as long as its group has fewer open than are free, and an entrant only as long as it has
//!   fewer than its competition could still open. So one group alone has half at most, two have a third each, and further games
//!   never take the last places.
//! - A party without episodes needs no share: it opens one as long as fewer parties of its group play than places are free.
//!
//! A few places are reserved for organizers, and for runs that go on.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Mutex;

use jiff::Timestamp;

use crate::fair::{Group, Party};
use crate::ids::{CompetitionKey, EpisodeKey};
use crate::keys::OwnerKey;

/// Caps on use. Requests beyond them are refused; running episodes continue.
#[derive(Clone, Copy, Debug)]
pub struct Caps {
    /// Unfinished episodes in total.
    pub episodes_unfinished_max: usize,
    /// Unfinished episodes of one key.
    pub episodes_per_key_max: usize,
    /// Percentage of all episodes that is reserved for parties without an unfinished one; half as many are reserved for organizers
    /// and for the next games of runs.
    pub reserved_percent: u32,
    /// Journal bytes of the acts of one episode.
    pub journal_bytes_per_episode_max: u64,
    /// Journal bytes of the acts of all episodes of one key, or of one network without keys. A competition gets
    /// [`KEYS_OF_COMPETITION`] times as many.
    pub journal_bytes_per_key_max: u64,
    /// Bytes of large acts per second that an entrant, a key or a network may write, on average; 0 for no limit. All entrants of a
    /// competition together get [`KEYS_OF_COMPETITION`] times as many.
    pub journal_bytes_per_key_s_max: u64,
}

impl Caps {
    /// Number of reserved episodes.
    const fn reserved(&self) -> usize {
        self.episodes_unfinished_max * self.reserved_percent as usize / 100
    }

    /// Cap on the journal bytes of a group's acts.
    const fn bytes_of(&self, group: Group) -> u64 {
        times_keys(self.journal_bytes_per_key_max, group)
    }

    /// Cap on the bytes per second of a group's large acts.
    const fn bytes_per_s_of(&self, group: Group) -> u64 {
        times_keys(self.journal_bytes_per_key_s_max, group)
    }
}

const fn times_keys(of_key: u64, group: Group) -> u64 {
    match group {
        Group::Competition(_) => of_key.saturating_mul(KEYS_OF_COMPETITION),
        _ => of_key,
    }
}

/// Limits of a competition's journal bytes, as a multiple of those of a key.
pub const KEYS_OF_COMPETITION: u64 = 4;

/// Size of an act's record that is stored whatever the quotas say: an action and a message always fit, so that an episode can be
/// played to its end.
pub const ACT_BYTES_ALWAYS: u64 = 2048;

/// Seconds of the permitted rate that may be written at once.
pub const BURST_S: i64 = 8;

/// Divisor of the bytes that a key may write: a network that plays nothing, and has written no more than this fraction, is
/// forgotten.
const FORGOTTEN: u64 = 100;

impl Party {
    /// Party of a key outside of competitions. Callers without a key and without a known address share one group.
    pub fn of_key(owner: Option<OwnerKey>) -> Self {
        let unknown = Group::Address(IpAddr::V4(Ipv4Addr::UNSPECIFIED));
        Self::of(owner.map_or(unknown, Group::Owner))
    }

    /// Party of a key in a competition, or else outside.
    pub fn within(competition: Option<CompetitionKey>, owner: Option<OwnerKey>) -> Self {
        let entrant = |key| Self { group: Group::Competition(key), member: owner };
        competition.map_or_else(|| Self::of_key(owner), entrant)
    }

    /// Key of the party, if any.
    pub const fn owner(self) -> Option<OwnerKey> {
        match self.group {
            Group::Owner(owner) => Some(owner),
            Group::Competition(_) => self.member,
            Group::Server | Group::Address(_) => None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Any other episode.
    Usual,
    /// Next game of a run that has none open. If its party has none either, half of the organizers' reserve is open to it, too.
    NextGame,
    /// Episode of an organizer: all of the reserve is open to it, and it may exceed a share.
    Organizer,
}

/// A cap that was reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Full {
    #[error("the server already plays its maximum of {0} episodes; wait until some have ended")]
    Episodes(usize),
    #[error(
        "this key already has its maximum of {0} unfinished episodes; end some, or wait until some have ended"
    )]
    EpisodesOfKey(usize),
    /// The group, or the entrant in it, already has its share of the episodes.
    #[error(
        "this {whose} has {open} unfinished episodes, as many as are free for it of {most}; end some episodes, or wait until some have ended"
    )]
    EpisodesOfShare {
        whose: Whose,
        open: usize,
        /// The server's maximum of episodes.
        most: usize,
    },
    #[error(
        "the acts of this episode take {0} bytes already; send them without `reasoning`, and an `action` instead of a long `response`"
    )]
    BytesOfEpisode(u64),
    #[error(
        "the acts of all episodes of this {whose} take {most} bytes already; ask the organizer for more, or send acts without `reasoning` and with short responses"
    )]
    BytesOf { whose: Whose, most: u64 },
    #[error(
        "this {whose} sent more than {most} bytes of long acts and forks a second; send this again later, or with less text"
    )]
    BytesPerSecond {
        whose: Whose,
        /// Permitted bytes per second.
        most: u64,
        /// Time after which the same act is accepted, in milliseconds.
        after_ms: u64,
    },
}

/// Kind of party or group that reached a cap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whose {
    Competition,
    /// An entrant of a competition.
    Entrant,
    Key,
    /// A network without keys.
    Network,
}

impl std::fmt::Display for Whose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Competition => "competition",
            Self::Entrant => "entrant",
            Self::Key => "key",
            Self::Network => "address",
        })
    }
}

impl Full {
    /// Name and value of the cap.
    pub const fn limit(self) -> (&'static str, u64) {
        match self {
            Self::Episodes(most) | Self::EpisodesOfShare { most, .. } => {
                ("episodes_unfinished_max", most as u64)
            }
            Self::EpisodesOfKey(most) => ("episodes_per_key_max", most as u64),
            Self::BytesOfEpisode(most) => ("journal_bytes_per_episode_max", most),
            Self::BytesOf { most, .. } => ("journal_bytes_per_key_max", most),
            Self::BytesPerSecond { most, .. } => ("journal_bytes_per_key_s_max", most),
        }
    }
}

const fn whose(group: Group) -> Whose {
    match group {
        Group::Competition(_) => Whose::Competition,
        Group::Owner(_) => Whose::Key,
        Group::Address(_) | Group::Server => Whose::Network,
    }
}

/// Use by each owner; shared by all episodes of a server.
#[derive(Debug)]
pub struct Quotas {
    caps: Caps,
    usage: Mutex<Usage>,
}

#[derive(Debug, Default)]
struct Usage {
    unfinished: HashMap<EpisodeKey, Party>,
    by_owner: HashMap<OwnerKey, OfOwner>,
    by_group: HashMap<Group, Share>,
    by_party: HashMap<Party, Share>,
}

#[derive(Clone, Copy, Debug, Default)]
struct OfOwner {
    episodes: usize,
    bytes: u64,
}

/// Use of a group or a party.
#[derive(Clone, Copy, Debug, Default)]
struct Share {
    episodes: usize,
    /// For a group: its parties with unfinished episodes.
    playing: usize,
    bytes: u64,
    bucket: TokenBucket,
}

impl Quotas {
    pub fn new(caps: Caps) -> Self {
        Self { caps, usage: Mutex::default() }
    }

    fn usage(&self) -> std::sync::MutexGuard<'_, Usage> {
        self.usage.lock().expect("nothing panics while it holds this")
    }

    pub fn admit(&self, episode: EpisodeKey, party: Party, purpose: Purpose) -> Result<(), Full> {
        let mut usage = self.usage();
        usage.check(&self.caps, party, purpose)?;
        usage.begin(episode, party);
        Ok(())
    }

    /// Whether a new episode is admitted now.
    pub fn check(&self, party: Party, purpose: Purpose) -> Result<(), Full> {
        self.usage().check(&self.caps, party, purpose)
    }

    /// Counts an unfinished episode that exists already; repeating it changes nothing.
    pub fn note(&self, episode: EpisodeKey, party: Party) {
        self.usage().begin(episode, party);
    }

    /// Stops counting an episode that has ended, or was not created after all.
    pub fn release(&self, episode: EpisodeKey) {
        self.usage().end(episode);
    }

    pub fn unfinished(&self) -> usize {
        self.usage().unfinished.len()
    }

    /// Whether an act with `more` bytes of text may be recorded now for an episode whose acts take `used` bytes.
    pub fn check_act(
        &self,
        episode: EpisodeKey,
        used: u64,
        more: u64,
        now: Timestamp,
    ) -> Result<(), Full> {
        if more <= ACT_BYTES_ALWAYS {
            return Ok(());
        }
        let caps = &self.caps;
        if used + more > caps.journal_bytes_per_episode_max {
            return Err(Full::BytesOfEpisode(caps.journal_bytes_per_episode_max));
        }
        let usage = self.usage();
        let Some(party) = usage.unfinished.get(&episode) else { return Ok(()) };
        usage.check_bytes(caps, *party, more)?;
        usage.check_rate(caps, *party, now)
    }

    /// Counts the bytes of an episode's act.
    pub fn add_bytes(&self, episode: EpisodeKey, bytes: u64, now: Timestamp) {
        let mut usage = self.usage();
        let Some(party) = usage.unfinished.get(&episode).copied() else { return };
        usage.add_bytes(party, bytes);
        if bytes > ACT_BYTES_ALWAYS {
            usage.write(&self.caps, party, bytes, now);
        }
    }

    /// Counts the bytes of `count` forks that a party makes at once, `bytes` each, if they may be written now.
    pub fn take_forks(
        &self,
        party: Party,
        (bytes, count): (u64, u64),
        now: Timestamp,
    ) -> Result<(), Full> {
        let caps = &self.caps;
        let all = bytes.saturating_mul(count);
        let mut usage = self.usage();
        usage.check_bytes(caps, party, all)?;
        usage.check_rate(caps, party, now)?;
        usage.add_bytes(party, all);
        usage.write(caps, party, all, now);
        Ok(())
    }

    /// Returns the bytes of forks that were not made.
    pub fn release_forks(&self, party: Party, (bytes, count): (u64, u64)) {
        self.usage().release_bytes(party, bytes.saturating_mul(count));
    }

    /// Returns bytes that were counted for acts which were not recorded.
    pub fn release_bytes(&self, episode: EpisodeKey, bytes: u64) {
        let mut usage = self.usage();
        let Some(party) = usage.unfinished.get(&episode).copied() else { return };
        usage.release_bytes(party, bytes);
    }

    /// Counts bytes that were written with a key earlier.
    pub fn note_bytes(&self, owner: OwnerKey, bytes: u64) {
        self.usage().by_owner.entry(owner).or_default().bytes += bytes;
    }

    /// Counts bytes that were written in a competition earlier.
    pub fn note_competition(&self, competition: CompetitionKey, bytes: u64) {
        let group = Group::Competition(competition);
        self.usage().by_group.entry(group).or_default().bytes += bytes;
    }

    /// Forgets groups and parties that use nothing.
    pub fn tidy(&self, now: Timestamp) {
        let forgotten = self.caps.journal_bytes_per_key_max / FORGOTTEN;
        let mut usage = self.usage();
        usage.by_party.retain(|_, share| share.episodes > 0 || share.bucket.is_behind(now));
        usage.by_group.retain(|group, share| {
            let bytes = match group {
                Group::Competition(_) => share.bytes > 0,
                Group::Address(_) => share.bytes > forgotten,
                // `by_owner` counts the bytes of keys.
                Group::Owner(_) | Group::Server => false,
            };
            bytes || share.episodes > 0 || share.bucket.is_behind(now)
        });
    }
}

impl Usage {
    fn check(&self, caps: &Caps, party: Party, purpose: Purpose) -> Result<(), Full> {
        let all = caps.episodes_unfinished_max;
        let reserved = caps.reserved();
        let own = self.by_party.get(&party).map_or(0, |share| share.episodes);
        let open = match purpose {
            Purpose::Organizer => all,
            Purpose::NextGame if own == 0 => all - reserved / 4,
            Purpose::NextGame | Purpose::Usual => all - reserved / 2,
        };
        let free = open.saturating_sub(self.unfinished.len());
        if free == 0 {
            return Err(Full::Episodes(all));
        }
        if let Some(owner) = party.owner() {
            let own = self.by_owner.get(&owner).copied().unwrap_or_default();
            if own.episodes >= caps.episodes_per_key_max {
                return Err(Full::EpisodesOfKey(caps.episodes_per_key_max));
            }
        }
        self.check_bytes(caps, party, 1)?;
        let is_free = purpose == Purpose::Organizer || party.group == Group::Server;
        if is_free { Ok(()) } else { self.check_share(caps, party, purpose, own, free) }
    }

    /// Whether a party with `own` episodes may open one of the `free` ones.
    fn check_share(
        &self,
        caps: &Caps,
        party: Party,
        purpose: Purpose,
        own: usize,
        free: usize,
    ) -> Result<(), Full> {
        let all = caps.episodes_unfinished_max;
        let group = self.by_group.get(&party.group).copied().unwrap_or_default();
        let (used, most) = match purpose {
            // However many runs there are, others keep half of the episodes.
            Purpose::NextGame if own == 0 => (group.playing, all.div_ceil(2)),
            _ if own == 0 => (group.playing, free),
            _ => (group.episodes, free.saturating_sub(caps.reserved())),
        };
        if used >= most {
            let (whose, open) = (whose(party.group), group.episodes);
            return Err(Full::EpisodesOfShare { whose, open, most: all });
        }
        // Each further episode of the competition also leaves one fewer free.
        let is_entrant = matches!(party.group, Group::Competition(_));
        if is_entrant && own > 0 && own >= (most - used).div_ceil(2) {
            return Err(Full::EpisodesOfShare { whose: Whose::Entrant, open: own, most: all });
        }
        Ok(())
    }

    /// Whether `more` bytes fit into the total that may ever be written.
    fn check_bytes(&self, caps: &Caps, party: Party, more: u64) -> Result<(), Full> {
        let most = caps.journal_bytes_per_key_max;
        let own = party.owner().and_then(|owner| self.by_owner.get(&owner));
        if own.is_some_and(|own| own.bytes + more > most) {
            return Err(Full::BytesOf { whose: Whose::Key, most });
        }
        let (whose, most) = (whose(party.group), caps.bytes_of(party.group));
        let written = self.by_group.get(&party.group).map_or(0, |share| share.bytes);
        match party.group {
            Group::Competition(_) | Group::Address(_) if written + more > most => {
                Err(Full::BytesOf { whose, most })
            }
            _ => Ok(()),
        }
    }

    /// Whether the rate limits permit another large act now.
    fn check_rate(&self, caps: &Caps, party: Party, now: Timestamp) -> Result<(), Full> {
        let check = |share: Option<&Share>, whose, most| match share
            .map_or(0, |share| share.bucket.wait_ms(now))
        {
            0 => Ok(()),
            after_ms => Err(Full::BytesPerSecond { whose, most, after_ms }),
        };
        if party.group == Group::Server {
            return Ok(());
        }
        if let Group::Competition(_) = party.group {
            check(self.by_party.get(&party), Whose::Entrant, caps.journal_bytes_per_key_s_max)?;
        }
        let group = self.by_group.get(&party.group);
        check(group, whose(party.group), caps.bytes_per_s_of(party.group))
    }

    fn add_bytes(&mut self, party: Party, bytes: u64) {
        if let Some(owner) = party.owner() {
            self.by_owner.entry(owner).or_default().bytes += bytes;
        }
        self.by_group.entry(party.group).or_default().bytes += bytes;
    }

    fn release_bytes(&mut self, party: Party, bytes: u64) {
        if let Some(own) = party.owner().and_then(|owner| self.by_owner.get_mut(&owner)) {
            own.bytes = own.bytes.saturating_sub(bytes);
        }
        if let Some(share) = self.by_group.get_mut(&party.group) {
            share.bytes = share.bytes.saturating_sub(bytes);
        }
    }

    /// Counts a large act against the rate limits.
    fn write(&mut self, caps: &Caps, party: Party, bytes: u64, now: Timestamp) {
        let group = &mut self.by_group.entry(party.group).or_default().bucket;
        group.write(bytes, caps.bytes_per_s_of(party.group), now);
        if let Group::Competition(_) = party.group {
            let entrant = &mut self.by_party.entry(party).or_default().bucket;
            entrant.write(bytes, caps.journal_bytes_per_key_s_max, now);
        }
    }

    fn begin(&mut self, episode: EpisodeKey, party: Party) {
        let std::collections::hash_map::Entry::Vacant(entry) = self.unfinished.entry(episode)
        else {
            return;
        };
        entry.insert(party);
        if let Some(owner) = party.owner() {
            self.by_owner.entry(owner).or_default().episodes += 1;
        }
        let own = self.by_party.entry(party).or_default();
        let group = self.by_group.entry(party.group).or_default();
        group.playing += usize::from(own.episodes == 0);
        own.episodes += 1;
        group.episodes += 1;
    }

    fn end(&mut self, episode: EpisodeKey) {
        let Some(party) = self.unfinished.remove(&episode) else { return };
        if let Some(own) = party.owner().and_then(|owner| self.by_owner.get_mut(&owner)) {
            own.episodes = own.episodes.saturating_sub(1);
        }
        let own = self.by_party.get_mut(&party);
        if let Some((own, group)) = own.zip(self.by_group.get_mut(&party.group)) {
            own.episodes -= 1;
            group.episodes -= 1;
            group.playing -= usize::from(own.episodes == 0);
        }
    }
}

/// A token bucket, stored as the time at which it is full again.
#[derive(Clone, Copy, Debug, Default)]
struct TokenBucket {
    full_at_us: i64,
}

impl TokenBucket {
    const BURST_US: i64 = BURST_S * 1_000_000;

    /// Whether the bucket is not full.
    fn is_behind(self, now: Timestamp) -> bool {
        self.full_at_us > now.as_microsecond()
    }

    /// Milliseconds until more may be written. One act may exceed the burst; the next one waits for it.
    fn wait_ms(self, now: Timestamp) -> u64 {
        let over = self.full_at_us - now.as_microsecond() - Self::BURST_US;
        // The time is further ahead only where the clock was set back.
        u64::try_from(over).ok().filter(|_| over <= Self::BURST_US).unwrap_or(0).div_ceil(1000)
    }

    /// Takes bytes out of the bucket, of which `per_s` return every second.
    fn write(&mut self, bytes: u64, per_s: u64, now: Timestamp) {
        let Some(us) = bytes.saturating_mul(1_000_000).checked_div(per_s) else { return };
        let now = now.as_microsecond();
        let from = self.full_at_us.clamp(now, now + Self::BURST_US);
        let until = from.saturating_add(i64::try_from(us).unwrap_or(i64::MAX));
        self.full_at_us = until.min(now + 2 * Self::BURST_US);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_ended_is_forgotten() {
        let quotas = Quotas::new(Caps {
            episodes_unfinished_max: 10,
            episodes_per_key_max: 10,
            reserved_percent: 0,
            journal_bytes_per_episode_max: 10_000,
            journal_bytes_per_key_max: 15_000,
            journal_bytes_per_key_s_max: 0,
        });
        let entrant = Party::entrant(CompetitionKey(1), OwnerKey(1));
        for (key, party) in [(EpisodeKey(1), entrant), (EpisodeKey(2), Party::of_key(None))] {
            quotas.admit(key, party, Purpose::Usual).expect("a place");
            quotas.release(key);
        }
        quotas.tidy(Timestamp::UNIX_EPOCH);
        let usage = quotas.usage();
        assert_eq!((usage.by_group.len(), usage.by_party.len()), (0, 0));
    }
}
