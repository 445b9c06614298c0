//! The rights of tokens and keys. They are cached, so that most requests ask no database.

use quick_cache::sync::Cache;
use tokio::sync::watch;

use super::error::ApiError;
use crate::fair::Party;
use crate::ids::{CompetitionKey, Token, TokenHash, TokenKind};
use crate::keys::{OwnerKey, Role};
use crate::store::Store;
use crate::store::tokens::Grant;

const TOKENS_CACHED: usize = 100_000;

pub(super) struct Tokens {
    store: Store,
    grants: Cache<TokenHash, Grant>,
    /// The competitions for which entrants' keys were made; they never change.
    entered: Cache<OwnerKey, CompetitionKey>,
    /// Number of revocations.
    revocations: watch::Sender<u64>,
}

impl Tokens {
    pub(super) fn new(store: Store) -> Self {
        let (grants, entered) = (Cache::new(TOKENS_CACHED), Cache::new(TOKENS_CACHED));
        Self { store, grants, entered, revocations: watch::Sender::new(0) }
    }

    /// The rights of the token that was sent, if it is known.
    pub(super) async fn grant(&self, sent: &str) -> Result<Option<Grant>, ApiError> {
        let hash = TokenHash::of(sent);
        if let Some(grant) = self.grants.get(&hash) {
            return Ok(Some(grant));
        }
        match Token::parse(sent) {
            Some(token) => Box::pin(self.read(token.kind(), hash)).await,
            None => Ok(None),
        }
    }

    /// Reads the rights of a token that is not cached.
    async fn read(&self, kind: TokenKind, hash: TokenHash) -> Result<Option<Grant>, ApiError> {
        let revocations = self.revocations();
        let grant = match kind {
            TokenKind::Seat | TokenKind::Swarm => self.store.find_token(hash).await?,
            TokenKind::Key => self.store.find_key(hash).await?.map(Grant::Key),
            TokenKind::Invitation => None,
        };
        let Some(grant) = grant else { return Ok(None) };
        self.cache(hash, grant.clone(), revocations);
        Ok(Some(grant))
    }

    /// Number of revocations: see [`Tokens::cache`].
    pub(super) fn revocations(&self) -> u64 {
        *self.revocations.borrow()
    }

    /// Receiver of all later revocations.
    pub(super) fn follow_revocations(&self) -> watch::Receiver<u64> {
        self.revocations.subscribe()
    }

    /// Caches the rights of a token that was read, or made, when tokens had been revoked `revocations` times.
    pub(super) fn cache(&self, hash: TokenHash, grant: Grant, revocations: u64) {
        self.grants.insert(hash, grant);
        if self.revocations() != revocations {
            // It may have been revoked since then, before it was cached.
            self.grants.remove(&hash);
        }
    }

    /// Removes tokens from the cache; they must be revoked in the store already.
    pub(super) fn forget(&self, is_revoked: impl Fn(&Grant) -> bool) {
        // Rights that were read before are not cached any more; streams look at theirs once the cache is without these.
        self.revocations.send_if_modified(|count| {
            *count += 1;
            false
        });
        self.grants.retain(|_, grant| !is_revoked(grant));
        self.revocations.send_modify(|_| ());
    }

    /// The party of a token. None if the token has no owner.
    pub(super) async fn party(&self, grant: &Grant) -> Result<Option<Party>, ApiError> {
        let (competition, owner) = match grant {
            Grant::Seat { owner, .. } | Grant::Swarm { owner, .. } => (None, *owner),
            Grant::Run { owner, competition, .. } => (*competition, *owner),
            Grant::Key(key) => match key.number.filter(|_| key.role == Role::Entrant) {
                Some(owner) => (Box::pin(self.competition_of(owner)).await?, Some(owner)),
                None => (None, key.number),
            },
        };
        Ok(owner.map(|owner| Party::within(competition, Some(owner))))
    }

    /// The competition for which an entrant's key was made.
    async fn competition_of(&self, owner: OwnerKey) -> Result<Option<CompetitionKey>, ApiError> {
        if let Some(known) = self.entered.get(&owner) {
            return Ok(Some(known));
        }
        let found = self.store.competition_of(owner).await?;
        if let Some(competition) = found {
            self.entered.insert(owner, competition);
        }
        Ok(found)
    }
}
