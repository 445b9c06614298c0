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

    const CAPS: Caps = Caps {
        episodes_unfinished_max: 6,
        episodes_per_key_max: 2,
        reserved_percent: 0,
        journal_bytes_per_episode_max: 10_000,
        journal_bytes_per_key_max: 15_000,
        journal_bytes_per_key_s_max: 0,
    };
    const OWN: Party = Party::of(Group::Owner(OwnerKey(7)));
    const HOST: Party = Party::SERVER;
    const CUP: CompetitionKey = CompetitionKey(1);

    fn entrant(competition: i64, owner: i64) -> Party {
        Party::entrant(CompetitionKey(competition), OwnerKey(owner))
    }

    fn at(seconds: i64) -> Timestamp {
        Timestamp::from_second(1_000_000 + seconds).expect("a time")
    }

    /// A server in which a party opens episodes until it gets no more.
    struct Opener {
        quotas: Quotas,
        next: i64,
    }

    impl Opener {
        fn of(episodes_unfinished_max: usize, reserved_percent: u32) -> Self {
            let episodes_per_key_max = usize::MAX;
            let caps =
                Caps { episodes_unfinished_max, episodes_per_key_max, reserved_percent, ..CAPS };
            Self { quotas: Quotas::new(caps), next: 0 }
        }

        fn one(&mut self, party: Party, purpose: Purpose) -> Result<(), Full> {
            self.next += 1;
            self.quotas.admit(EpisodeKey(self.next), party, purpose)
        }

        /// Number of further episodes that the party gets.
        fn all(&mut self, party: Party, purpose: Purpose) -> usize {
            (0..10_000).take_while(|_| self.one(party, purpose).is_ok()).count()
        }
    }

    #[test]
    fn caps_hold_for_a_key_and_for_all() {
        let quotas = Quotas::new(CAPS);
        let admit = |key, party| quotas.admit(EpisodeKey(key), party, Purpose::Usual);
        assert_eq!(admit(1, OWN), Ok(()));
        assert_eq!(admit(2, OWN), Ok(()));
        assert_eq!(admit(3, OWN), Err(Full::EpisodesOfKey(2)));
        assert_eq!([4, 5, 6, 7].map(|key| admit(key, HOST)), [Ok(()); 4]);
        assert_eq!(admit(8, HOST), Err(Full::Episodes(6)));
        quotas.release(EpisodeKey(1));
        quotas.release(EpisodeKey(1));
        assert_eq!(quotas.unfinished(), 5);
        assert_eq!(admit(3, HOST), Ok(()));
        // A recovered episode is not counted twice.
        quotas.note(EpisodeKey(3), HOST);
        assert_eq!(quotas.unfinished(), 6);
    }

    #[test]
    fn groups_share_the_episodes_and_a_newcomer_finds_some() {
        let mut opener = Opener::of(1000, 10);
        let usual = Purpose::Usual;
        // 950 are open to all parties, and 850 of them to parties that have some.
        assert_eq!(opener.all(Party::of_key(Some(OwnerKey(1))), usual), 425);
        assert_eq!(opener.all(Party::of_key(None), usual), 213);
        // Entrants registered by one person, however many, share what one competition has, and get a first game each.
        let entrants: Vec<usize> = (0..50).map(|n| opener.all(entrant(1, n), usual)).collect();
        assert!(entrants.iter().all(|count| *count > 0), "{entrants:?}");
        assert_eq!(entrants.iter().sum::<usize>(), 149, "{entrants:?}");
        assert_eq!(opener.one(entrant(2, 1), usual), Ok(()), "another competition starts");
        // The host's own programs share with nobody, and leave the reserve.
        assert_eq!(opener.all(HOST, usual), 162);
        assert_eq!(opener.one(entrant(3, 1), usual), Err(Full::Episodes(1000)));
        assert_eq!(opener.all(entrant(3, 1), Purpose::NextGame), 1, "a run goes on");
        assert_eq!(opener.all(OWN, Purpose::Organizer), 49);
    }

    /// Number of episodes that greedy entrants with `parallel` games each hold on a server of the usual size, and number of
    /// entrants without any that then get a first game.
    fn newcomers(competitions: i64, entrants: i64, parallel: usize) -> (usize, usize) {
        let mut opener = Opener::of(20_000, 10);
        for (cup, number) in (0..entrants).map(|number| (number % competitions, number)) {
            let one = |_: &usize| opener.one(entrant(cup, number), Purpose::Usual).is_ok();
            (0..parallel).take_while(one).for_each(drop);
        }
        let held = opener.quotas.unfinished();
        let first = |number: &i64| opener.one(entrant(0, *number), Purpose::Usual).is_ok();
        (held, (entrants..20_000).take_while(first).count())
    }

    #[test]
    fn greedy_entrants_leave_first_games_to_others() {
        for (competitions, entrants, parallel, expected) in [
            // Without greedy entrants half of all places are for one competition, so that others start.
            (1, 0, 0, (0, 9500)),
            (1, 162, 64, (8524, 5157)),
            (1, 1000, 64, (9362, 4319)),
            (1, 1000, 1, (1000, 8500)),
            // Entrants take what they can get, in many competitions at once.
            (1, 1000, usize::MAX, (9486, 4257)),
            (20, 162, usize::MAX, (17_095, 948)),
            (20, 1000, usize::MAX, (17_933, 509)),
        ] {
            let found = newcomers(competitions, entrants, parallel);
            assert_eq!(found, expected, "{entrants} entrants of {competitions} competitions");
        }
    }

    #[test]
    fn an_entrant_that_has_games_has_no_first_one_however_many_runs_it_starts() {
        let mut opener = Opener::of(100, 10);
        let greedy = opener.all(entrant(1, 1), Purpose::Usual);
        // Each of its runs asks for its next game.
        assert_eq!(opener.all(entrant(1, 1), Purpose::NextGame), 0);
        // Games that end and begin again move no bound.
        for key in 1..=20 {
            opener.quotas.release(EpisodeKey(key));
            opener.one(entrant(1, 1), Purpose::Usual).expect("the place that it gave back");
        }
        assert_eq!(opener.all(entrant(1, 1), Purpose::Usual), 0, "{greedy}");
        assert_eq!(opener.one(entrant(1, 2), Purpose::Usual), Ok(()));
    }

    #[test]
    fn an_entrant_leaves_episodes_to_others_of_the_same_competition() {
        let mut opener = Opener::of(1000, 0);
        let first = opener.all(entrant(1, 1), Purpose::Usual);
        let second = opener.all(entrant(1, 2), Purpose::Usual);
        assert_eq!((first, second), (250, 125));
        let share = opener.one(entrant(1, 1), Purpose::Usual);
        let limit = share.map_err(Full::limit);
        assert_eq!(limit, Err(("episodes_unfinished_max", 1000)));
    }

    #[test]
    fn a_run_goes_on_as_long_as_others_have_half() {
        let mut opener = Opener::of(100, 20);
        let of = |cup, owners: std::ops::Range<i64>| owners.map(move |owner| entrant(cup, owner));
        let mut go_on = |mut parties: Box<dyn Iterator<Item = Party>>| {
            let goes_on = |party: &Party| opener.one(*party, Purpose::NextGame).is_ok();
            parties.by_ref().take_while(goes_on).count()
        };
        assert_eq!(go_on(Box::new(of(1, 0..100))), 50);
        assert_eq!(go_on(Box::new(of(2, 0..100))), 45, "half of the reserve is left");
        assert_eq!(opener.one(entrant(3, 2), Purpose::NextGame), Err(Full::Episodes(100)));
    }

    /// Decision of [`Quotas`], computed from a list of all open episodes.
    fn model(caps: &Caps, open: &[Party], party: Party, purpose: Purpose) -> bool {
        let own = open.iter().filter(|other| **other == party).count();
        let group: Vec<_> = open.iter().filter(|other| other.group == party.group).collect();
        let playing = group.iter().collect::<std::collections::HashSet<_>>().len();
        let all = caps.episodes_unfinished_max;
        let of_all = |percent: u32| all * percent as usize / 100;
        let is_next = purpose == Purpose::NextGame && own == 0;
        let reserved = of_all(caps.reserved_percent) / if is_next { 4 } else { 2 };
        let free = (all - reserved).saturating_sub(open.len());
        let free_for_more = free.saturating_sub(of_all(caps.reserved_percent));
        let is_entrant = matches!(party.group, Group::Competition(_));
        match purpose {
            Purpose::Organizer => open.len() < all,
            Purpose::NextGame | Purpose::Usual if own > 0 => {
                let left = free_for_more.saturating_sub(group.len());
                left > 0 && (!is_entrant || own < left.div_ceil(2))
            }
            Purpose::NextGame => free > 0 && playing < all.div_ceil(2),
            Purpose::Usual => free > 0 && playing < free,
        }
    }

    proptest::proptest! {
        #[test]
        fn episodes_are_shared_as_by_one_who_counts_all(
            all in 1..80_usize,
            reserved in 0..30_u32,
            steps in proptest::collection::vec((0..5_i64, 0..4_i64, 0..12_u8), 0..200),
        ) {
            let mut opener = Opener::of(all, reserved);
            let caps = opener.quotas.caps;
            let mut open: Vec<(EpisodeKey, Party)> = Vec::new();
            for (group, member, what) in steps {
                let own = Party::of(Group::Owner(OwnerKey(100 + group)));
                let party = if group < 3 { entrant(group, member) } else { own };
                let purpose = match what {
                    0..7 => Purpose::Usual,
                    7..9 => Purpose::NextGame,
                    9 => Purpose::Organizer,
                    _ => {
                        if let Some(ended) = open.iter().position(|(_, other)| *other == party) {
                            opener.quotas.release(open.swap_remove(ended).0);
                        }
                        opener.quotas.tidy(at(0));
                        continue;
                    }
                };
                let parties: Vec<_> = open.iter().map(|(_, party)| *party).collect();
                let is_admitted = opener.one(party, purpose).is_ok();
                proptest::prop_assert_eq!(is_admitted, model(&caps, &parties, party, purpose));
                if is_admitted {
                    open.push((EpisodeKey(opener.next), party));
                }
            }
        }
    }

    #[test]
    fn what_has_ended_is_forgotten() {
        let mut opener = Opener::of(10, 0);
        opener.one(entrant(1, 1), Purpose::Usual).expect("a place");
        opener.one(Party::of_key(None), Purpose::Usual).expect("a place");
        for key in 1..=opener.next {
            opener.quotas.release(EpisodeKey(key));
        }
        opener.quotas.tidy(at(0));
        let usage = opener.quotas.usage();
        assert_eq!((usage.by_group.len(), usage.by_party.len()), (0, 0));
    }

    #[test]
    fn bytes_are_limited_but_small_acts_always_fit() {
        let quotas = Quotas::new(CAPS);
        let (own, cup) = (EpisodeKey(1), EpisodeKey(2));
        quotas.note(own, OWN);
        quotas.note(cup, Party::within(Some(CUP), None));
        let check = |episode, used, more| quotas.check_act(episode, used, more, at(0));
        assert_eq!(check(own, 9_000, 1_000), Ok(()));
        assert_eq!(check(own, 9_000, 3_000), Err(Full::BytesOfEpisode(10_000)));
        assert_eq!(check(own, 99_000, ACT_BYTES_ALWAYS), Ok(()));
        quotas.add_bytes(own, 14_000, at(0));
        assert_eq!(check(own, 0, 3_000), Err(Full::BytesOf { whose: Whose::Key, most: 15_000 }));
        assert_eq!(check(cup, 0, 3_000), Ok(()), "nobody's key, nobody's bytes");
        quotas.note_competition(CUP, 58_000);
        assert_eq!(
            check(cup, 0, 3_000),
            Err(Full::BytesOf { whose: Whose::Competition, most: 60_000 })
        );
        quotas.note_bytes(OwnerKey(7), 1_000);
        assert_eq!(
            quotas.check(OWN, Purpose::Usual),
            Err(Full::BytesOf { whose: Whose::Key, most: 15_000 })
        );
    }

    #[test]
    fn large_acts_come_at_a_pace_and_small_ones_at_any() {
        let most = 10_000;
        let caps = Caps {
            journal_bytes_per_key_s_max: most,
            journal_bytes_per_episode_max: u64::MAX,
            journal_bytes_per_key_max: u64::MAX,
            ..CAPS
        };
        let quotas = Quotas::new(caps);
        for owner in 1..=5 {
            quotas.note(EpisodeKey(owner), entrant(1, owner));
        }
        // Number of acts of 10,000 bytes that an owner gets in.
        let flood = |owner, now| {
            let one = |_: &u32| {
                let fits = quotas.check_act(EpisodeKey(owner), 0, most, now).is_ok();
                if fits {
                    quotas.add_bytes(EpisodeKey(owner), most, now);
                }
                fits
            };
            (0..10_000).take_while(one).count()
        };
        let check = |owner, now| quotas.check_act(EpisodeKey(owner), 0, most, now);
        assert_eq!(flood(1, at(0)), 9, "eight seconds' worth, and one more");
        let whose = Whose::Entrant;
        let late = Err(Full::BytesPerSecond { whose, most, after_ms: 1000 });
        assert_eq!(check(1, at(0)), late);
        assert_eq!(quotas.check_act(EpisodeKey(1), 0, ACT_BYTES_ALWAYS, at(0)), Ok(()));
        // Other entrants of the competition write, too, until it is too much together.
        assert_eq!([2, 3, 4].map(|owner| flood(owner, at(0))), [9, 9, 6]);
        let whose = Whose::Competition;
        let late = Err(Full::BytesPerSecond { whose, most: 4 * most, after_ms: 250 });
        assert_eq!(check(5, at(0)), late);
        assert_eq!(flood(5, at(1)), 4);
        assert_eq!(flood(1, at(100)), 9);
        // A clock that was set back lets nobody wait for hours.
        assert_eq!(check(1, at(-3600)), Ok(()));
    }
}
