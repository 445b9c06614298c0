//! Public ids, and tokens that are shown once.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use jiff::Timestamp;
use sha2::{Digest, Sha256};

use swarmbench_clock::Entropy;

/// Keys of rows in the database: short, never shown.
macro_rules! row_keys {
    ($($(#[doc = $doc:literal])* $name:ident;)*) => {$(
        $(#[doc = $doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name(pub i64);
    )*};
}

row_keys! {
    /// Key of an episode.
    EpisodeKey;
    /// Key of a run.
    RunKey;
    /// Key of a competition.
    CompetitionKey;
    /// Key of an entrant of a competition.
    EntryKey;
    /// Key of an imported game.
    ImportKey;
}

/// Source of keys for new rows, each larger than all before.
#[derive(Debug)]
pub struct Numbers {
    next: AtomicI64,
    /// Slot of this server when several share the database. Each then composes numbers from milliseconds, its slot and a count.
    slot: Option<i64>,
}

impl Numbers {
    /// Low bits for the count, which limit how many consecutive numbers are possible. Above them are 10 bits for the slot, then
    /// milliseconds.
    const COUNT_BITS: u32 = 12;
    const SLOT_BITS: u32 = 10 + Self::COUNT_BITS;

    /// Numbers after `last`.
    pub const fn after(last: i64) -> Self {
        Self { next: AtomicI64::new(last + 1), slot: None }
    }

    /// Numbers of a server of a cluster; `slot` is its own alone. Their order is that of time, also between servers.
    pub const fn of_slot(slot: i16, last: i64) -> Self {
        Self { next: AtomicI64::new(last + 1), slot: Some(slot as i64) }
    }

    /// The first of `count` consecutive numbers.
    pub fn take(&self, count: usize, now: Timestamp) -> i64 {
        let count = i64::try_from(count).expect("a few numbers");
        let first_of = |next: i64| {
            let Some(slot) = self.slot else { return next };
            let block = |millis: i64| (millis << Self::SLOT_BITS) | (slot << Self::COUNT_BITS);
            let now = block(now.as_millisecond());
            let last = next - 1;
            // Continues the block that this server has begun, if enough numbers are left.
            let begun = block(last >> Self::SLOT_BITS);
            let end = begun + (1 << Self::COUNT_BITS);
            if last < now {
                now
            } else if (begun..end).contains(&last) && next + count <= end {
                next
            } else {
                block((last >> Self::SLOT_BITS) + 1)
            }
        };
        let taken = self
            .next
            .fetch_update(Ordering::AcqRel, Ordering::Acquire, |next| Some(first_of(next) + count));
        match taken {
            Ok(before) => first_of(before),
            Err(_) => unreachable!("there is always a next number"),
        }
    }
}

/// Unit of work that one server of a cluster does alone: play a game that belongs to no run, play a run with all its
/// games, or change a competition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Place {
    Game(EpisodeKey),
    Run(RunKey),
    Competition(CompetitionKey),
}

impl Place {
    pub fn of_game(episode: EpisodeKey, run: Option<RunKey>) -> Self {
        run.map_or(Self::Game(episode), Self::Run)
    }

    /// The stored form: the number of the kind and the key.
    pub const fn numbers(self) -> (i16, i64) {
        match self {
            Self::Game(EpisodeKey(key)) => (0, key),
            Self::Run(RunKey(key)) => (1, key),
            Self::Competition(CompetitionKey(key)) => (2, key),
        }
    }

    /// The place with these numbers; none for a kind that this program does not know.
    pub const fn from_numbers(kind: i16, key: i64) -> Option<Self> {
        match kind {
            0 => Some(Self::Game(EpisodeKey(key))),
            1 => Some(Self::Run(RunKey(key))),
            2 => Some(Self::Competition(CompetitionKey(key))),
            _ => None,
        }
    }
}

/// Public id of an episode: `ep_` and 32 hexadecimal digits that grow with time. Clones share the text.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EpisodeId(Arc<str>);

impl EpisodeId {
    pub fn new(now: Timestamp, entropy: &dyn Entropy) -> Self {
        Self(dated_id("ep_", now, entropy).into())
    }

    /// An id as stored or received; such an episode may not exist.
    pub fn from_text(text: String) -> Self {
        Self(text.into())
    }
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for EpisodeId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// A prefix and 32 hexadecimal digits that grow with time.
pub(crate) fn dated_id(prefix: &str, now: Timestamp, entropy: &dyn Entropy) -> String {
    let mut random = [0; 10];
    entropy.fill(&mut random);
    let millis = u64::try_from(now.as_millisecond()).unwrap_or(0);
    let uuid = uuid::Builder::from_unix_timestamp_millis(millis, &random).into_uuid();
    format!("{prefix}{}", uuid.simple())
}

/// Kind of a token, which is recognized by its prefix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    /// One agent of one episode.
    Seat,
    /// Several seats.
    Swarm,
    /// A person.
    Key,
    /// An invitation to a competition, valid for nothing else.
    Invitation,
}

impl TokenKind {
    const ALL: [Self; 4] = [Self::Seat, Self::Swarm, Self::Key, Self::Invitation];
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Seat => "seat_",
            Self::Swarm => "swarm_",
            Self::Key => "secret_",
            Self::Invitation => "invite_",
        }
    }
}

/// A token in clear text: a prefix, 192 random bits and a checksum. Shown once, never stored, and hidden from `Debug`.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// The stored form of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TokenHash(pub [u8; 32]);

impl TokenHash {
    /// Hash of any text, which need not be a valid token.
    pub fn of(text: &str) -> Self {
        Self(Sha256::digest(text).into())
    }
}

const RANDOM_BYTES: usize = 24;

/// Routing name of a server: two base32 characters. Load balancers read it at the beginning of a token, and send the request to that
/// server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoutingName([u8; 2]);

impl RoutingName {
    const CHARACTERS: &[u8; 32] = b"abcdefghijklmnopqrstuvwxyz234567";

    /// Parses two characters out of a–z and 2–7.
    pub fn parse(text: &str) -> Option<Self> {
        let values: [u8; 2] = text.as_bytes().try_into().ok()?;
        let value = |byte| Self::CHARACTERS.iter().position(|one| *one == byte);
        let [first, second] = values.map(|byte| value(byte).and_then(|at| u8::try_from(at).ok()));
        Some(Self([first?, second?]))
    }

    /// Puts the name in place of the first ten bits.
    fn write(self, bytes: &mut [u8; RANDOM_BYTES + 4]) {
        let [first, second] = self.0;
        bytes[0] = first << 3 | second >> 2;
        bytes[1] = second << 6 | bytes[1] & 0x3f;
    }
}

impl fmt::Display for RoutingName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.0.map(|value| char::from(Self::CHARACTERS[usize::from(value)]));
        write!(f, "{first}{second}")
    }
}

impl Token {
    pub fn new(kind: TokenKind, entropy: &dyn Entropy) -> Self {
        Self::named(kind, None, entropy)
    }

    /// New token. A routing name replaces the first ten of its 192 random bits.
    pub fn named(kind: TokenKind, name: Option<RoutingName>, entropy: &dyn Entropy) -> Self {
        let mut bytes = [0; RANDOM_BYTES + 4];
        entropy.fill(&mut bytes[..RANDOM_BYTES]);
        if let Some(name) = name {
            name.write(&mut bytes);
        }
        let checksum = crc32fast::hash(&bytes[..RANDOM_BYTES]);
        bytes[RANDOM_BYTES..].copy_from_slice(&checksum.to_be_bytes());
        let body = data_encoding::BASE32_NOPAD.encode(&bytes).to_ascii_lowercase();
        Self(format!("{}{body}", kind.prefix()))
    }

    /// Parses a received token. A token with a wrong checksum was never issued.
    pub fn parse(text: &str) -> Option<Self> {
        let body = text.strip_prefix(Self::kind_of(text)?.prefix())?;
        let bytes =
            data_encoding::BASE32_NOPAD.decode(body.to_ascii_uppercase().as_bytes()).ok()?;
        let (random, checksum) = bytes.split_at_checked(RANDOM_BYTES)?;
        (checksum == crc32fast::hash(random).to_be_bytes()).then(|| Self(text.to_owned()))
    }

    fn kind_of(text: &str) -> Option<TokenKind> {
        TokenKind::ALL.into_iter().find(|kind| text.starts_with(kind.prefix()))
    }
    pub fn kind(&self) -> TokenKind {
        Self::kind_of(&self.0).expect("every token has a prefix")
    }

    /// The token in clear text, for its holder.
    pub fn reveal(&self) -> &str {
        &self.0
    }
    pub fn hash(&self) -> TokenHash {
        TokenHash::of(&self.0)
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_servers_give_different_numbers_in_the_order_of_time() {
        let at = |millis| Timestamp::from_millisecond(millis).expect("a time");
        let alone = Numbers::after(7);
        assert_eq!((alone.take(1, at(5)), alone.take(3, at(5)), alone.take(1, at(5))), (8, 9, 12));
        let (one, two) = (Numbers::of_slot(0, 7), Numbers::of_slot(1023, 7));
        let mut taken = std::collections::BTreeSet::new();
        let mut last = 0;
        for millis in [1000, 1000, 1001, 999, 1002] {
            for count in [1, 4096, 1, 17, 4000, 96] {
                for numbers in [&one, &two] {
                    let first = numbers.take(count, at(millis));
                    let count = i64::try_from(count).expect("few");
                    assert!((first..first + count).all(|number| taken.insert(number)));
                    last = last.max(first + count - 1);
                }
            }
        }
        // A later server in the same slot continues after all of them, and time orders the numbers of different servers.
        let later = Numbers::of_slot(0, last);
        assert!(later.take(1, at(1)) > last);
        assert!(one.take(1, at(5000)) < two.take(1, at(5001)));
        assert!(two.take(1, at(6000)) < one.take(1, at(6001)));
    }
    use swarmbench_testkit::host::SeededEntropy;

    #[test]
    fn a_token_with_any_character_changed_is_refused_unseen() {
        let token = Token::new(TokenKind::Seat, &SeededEntropy::new(1));
        assert_eq!(Token::parse(token.reveal()), Some(token.clone()));
        for place in 0..token.reveal().len() {
            let mut bytes = token.reveal().as_bytes().to_vec();
            bytes[place] = if bytes[place] == b'a' { b'b' } else { b'a' };
            let changed = String::from_utf8(bytes).expect("ASCII");
            assert_eq!(Token::parse(&changed), None, "{changed}");
        }
        assert_eq!(format!("{token:?}"), "Token(…)");
    }

    #[test]
    fn a_token_begins_with_the_name_of_its_server() {
        let entropy = SeededEntropy::new(1);
        for text in ["aa", "77", "q4", "z2"] {
            let name = RoutingName::parse(text).expect("a name");
            assert_eq!(name.to_string(), text);
            for kind in [TokenKind::Seat, TokenKind::Swarm] {
                let (one, other) =
                    [(); 2].map(|()| Token::named(kind, Some(name), &entropy)).into();
                assert!(one.reveal().starts_with(&format!("{}{text}", kind.prefix())), "{text}");
                assert_eq!(Token::parse(one.reveal()), Some(one.clone()));
                assert_ne!(one.reveal()[9..], other.reveal()[9..]);
            }
        }
        for bad in ["", "a", "abc", "A2", "a1", "a8", "é", "a "] {
            assert_eq!(RoutingName::parse(bad), None, "{bad:?}");
        }
    }
}
