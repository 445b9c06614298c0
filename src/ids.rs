//! Ids that are shown, and tokens that are shown once.

use std::sync::Arc;

use jiff::Timestamp;
use sha2::{Digest, Sha256};

use swarmbench_clock::Entropy;

/// Numbers of rows in the database; short, and never shown.
macro_rules! row_keys {
    ($($(#[doc = $doc:literal])* $name:ident;)*) => {$(
        $(#[doc = $doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub struct $name(pub i64);
    )*};
}

row_keys! {
    /// The number of an episode in the database.
    EpisodeKey;
    /// The number of a run in the database.
    RunKey;
    /// The number of a competition in the database.
    CompetitionKey;
    /// The number of an entrant of a competition in the database.
    EntryKey;
    /// The number of an imported game in the database.
    ImportKey;
}

/// The public id of an episode: `ep_` and 32 hexadecimal digits that grow with time. Cloning shares it.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EpisodeId(Arc<str>);

impl EpisodeId {
    pub fn new(now: Timestamp, entropy: &dyn Entropy) -> Self {
        Self(dated_id("ep_", now, entropy).into())
    }

    /// An id as it was stored or sent; it may not exist.
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

/// The kind of a token, recognized by its prefix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenKind {
    /// One agent of one episode.
    Seat,
    /// Several seats.
    Swarm,
    /// A person.
    Key,
    /// An invitation to a competition; valid for nothing else.
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

/// A token in clear: a prefix, 192 random bits and a checksum. It is shown once and never stored; `Debug` does not show
/// it.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// What is stored of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TokenHash(pub [u8; 32]);

impl TokenHash {
    /// The hash of a token in clear; the text may be anything.
    pub fn of(text: &str) -> Self {
        Self(Sha256::digest(text).into())
    }
}

const RANDOM_BYTES: usize = 24;

impl Token {
    pub fn new(kind: TokenKind, entropy: &dyn Entropy) -> Self {
        let mut bytes = [0; RANDOM_BYTES + 4];
        entropy.fill(&mut bytes[..RANDOM_BYTES]);
        let checksum = crc32fast::hash(&bytes[..RANDOM_BYTES]);
        bytes[RANDOM_BYTES..].copy_from_slice(&checksum.to_be_bytes());
        let body = data_encoding::BASE32_NOPAD.encode(&bytes).to_ascii_lowercase();
        Self(format!("{}{body}", kind.prefix()))
    }

    /// Reads a token that was sent. A token with a wrong checksum was never issued.
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

    /// The token in clear, for its holder.
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
    use swarmbench_clock::SeededEntropy;

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
}
