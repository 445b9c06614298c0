//! Keys for people, and their roles.

use jiff::Timestamp;
use swarmbench_protocol::key::KeySummary;

use crate::clock::Entropy;
use crate::ids::{Token, TokenHash, TokenKind, dated_id};
use crate::names;

/// The number of a key in the database; short, and never shown. An episode that was created with
/// a key belongs to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct OwnerKey(pub i64);

/// What the holder of a key may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Role {
    /// Start attempts in a competition and see their results; nothing else.
    Entrant,
    /// Create episodes, and do with them what their creator may.
    Member,
    /// Everything: read and end all episodes, make and revoke keys.
    Organizer,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Entrant, Self::Member, Self::Organizer];

    /// Its name on the wire and in the database.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Entrant => "entrant",
            Self::Member => "member",
            Self::Organizer => "organizer",
        }
    }

    /// The role with this name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }
}

/// Characters of the name of a key.
pub const NAME_CHARS_MAX: usize = 100;

/// A key as it is stored: all but the key itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// Its number; none as long as it is not stored.
    pub number: Option<OwnerKey>,
    /// Its public id.
    pub id: String,
    /// What its holder may do.
    pub role: Role,
    /// Whose it is.
    pub name: String,
    /// When it was made.
    pub created_at: Timestamp,
    /// From when on it is worth nothing, if ever.
    pub expires_at: Option<Timestamp>,
    /// When it was revoked, if it was.
    pub revoked_at: Option<Timestamp>,
}

impl Key {
    /// Makes a key for somebody. The token is to be shown once.
    ///
    /// # Errors
    /// What is wrong with the name.
    pub fn new(
        role: Role,
        name: &str,
        expires_at: Option<Timestamp>,
        now: Timestamp,
        entropy: &dyn Entropy,
    ) -> Result<(Self, Token), String> {
        names::check(name, NAME_CHARS_MAX)?;
        let key = Self {
            number: None,
            id: dated_id("key_", now, entropy),
            role,
            name: name.to_owned(),
            created_at: now,
            expires_at,
            revoked_at: None,
        };
        Ok((key, Token::new(TokenKind::Key, entropy)))
    }

    /// Whether it opens anything at that time.
    #[must_use]
    pub fn is_good(&self, now: Timestamp) -> bool {
        self.revoked_at.is_none() && self.expires_at.is_none_or(|at| now < at)
    }

    /// Its status: `good`, `expired` or `revoked`.
    #[must_use]
    pub fn state(&self, now: Timestamp) -> &'static str {
        match (self.revoked_at, self.is_good(now)) {
            (Some(_), _) => "revoked",
            (None, true) => "good",
            (None, false) => "expired",
        }
    }

    /// What is shown of it at a moment.
    #[must_use]
    pub fn summary(&self, now: Timestamp) -> KeySummary {
        KeySummary {
            id: self.id.clone(),
            name: self.name.clone(),
            role: self.role.name().to_owned(),
            state: self.state(now).to_owned(),
            created_at: self.created_at,
            expires_at: self.expires_at,
            revoked_at: self.revoked_at,
        }
    }
}

/// A key with the hash by which it is found.
#[derive(Clone, Debug)]
pub struct KeyRow {
    /// The key.
    pub key: Key,
    /// The hash of its token.
    pub hash: TokenHash,
}
