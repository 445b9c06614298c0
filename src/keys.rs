//! Keys for people, and their roles.

use jiff::Timestamp;
use swarmbench_protocol::key::KeySummary;

use crate::ids::{Token, TokenHash, TokenKind, dated_id};
use swarmbench_clock::Entropy;
use swarmbench_protocol::names;

/// Number of an access key in the database; never shown. Episodes that were created with a key belong to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct OwnerKey(pub i64);

swarmbench_engine::named! {
    /// Rights of the holder of a key.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
    pub enum Role {
        /// Starts attempts in a competition and sees their results; nothing else.
        Entrant = "entrant",
        /// Creates episodes, and controls these.
        Member = "member",
        /// Reads all that organizers read except keys and contacts, and changes nothing.
        Judge = "judge",
        /// May do everything: read and end all episodes, create and revoke keys.
        Organizer = "organizer",
    }
}

pub const NAME_CHARS_MAX: usize = 100;

/// A key without its token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Key {
    /// `None` before the key is stored.
    pub number: Option<OwnerKey>,
    pub id: String,
    pub role: Role,
    pub name: String,
    pub created_at: Timestamp,
    pub expires_at: Option<Timestamp>,
    pub revoked_at: Option<Timestamp>,
}

impl Key {
    /// Makes a key and its token, which must be shown once. The error describes an invalid name.
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

    /// Whether the key is accepted at `now`.
    pub fn is_good(&self, now: Timestamp) -> bool {
        self.revoked_at.is_none() && self.expires_at.is_none_or(|at| now < at)
    }

    /// `good`, `expired` or `revoked`.
    pub fn state(&self, now: Timestamp) -> &'static str {
        match (self.revoked_at, self.is_good(now)) {
            (Some(_), _) => "revoked",
            (None, true) => "good",
            (None, false) => "expired",
        }
    }
    pub fn summary(&self, now: Timestamp) -> KeySummary {
        KeySummary {
            id: self.id.clone(),
            name: self.name.clone(),
            role: self.role.name().to_owned(),
            state: self.state(now).to_owned(),
            created_at: self.created_at.into(),
            expires_at: self.expires_at.map(Into::into),
            revoked_at: self.revoked_at.map(Into::into),
        }
    }
}

/// A key with the hash of its token.
#[derive(Clone, Debug)]
pub struct KeyRow {
    pub key: Key,
    pub hash: TokenHash,
    /// First key of the team, if this is the key of another member.
    pub acts_for: Option<OwnerKey>,
}
