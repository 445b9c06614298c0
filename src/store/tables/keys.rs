//! The table `keys`.

use crate::ids::TokenHash;
use crate::keys::{Key, OwnerKey};
use crate::store::Store;
use crate::store::StoreError;
use crate::store::sql::{Builder, from_row, query};

const SELECT: &str = "SELECT number, id, role, name, created_at, expires_at, revoked_at FROM keys ";

impl Store {
    /// All keys that were ever made, in order.
    pub async fn keys(&self) -> Result<Vec<Key>, StoreError> {
        self.list_keys(None, u32::MAX).await
    }

    /// The keys that were ever made, in order, from the one after `after` on.
    pub async fn list_keys(
        &self,
        after: Option<OwnerKey>,
        limit: u32,
    ) -> Result<Vec<Key>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("WHERE number > ").push_bind(after.map_or(-1, |key| key.0));
        query.push(" ORDER BY number LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    /// The key with this number, revoked and expired ones too.
    pub async fn key(&self, number: OwnerKey) -> Result<Option<Key>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("WHERE number = ").push_bind(number.0);
        self.fetch_optional(query.build()).await
    }

    /// Whether a key was ever made.
    pub async fn has_keys(&self) -> Result<bool, StoreError> {
        self.fetch_one(query("SELECT EXISTS (SELECT 1 FROM keys)")).await
    }

    /// The key whose token has this hash, revoked and expired ones too. That of a member of a team has the number of the
    /// team's first key, and so its rights.
    pub async fn find_key(&self, hash: TokenHash) -> Result<Option<Key>, StoreError> {
        let query = query(
            "SELECT coalesce(acts_for, number) AS number, id, role, name, created_at, expires_at, revoked_at
             FROM keys WHERE hash = $1",
        );
        self.fetch_optional(query.bind(&hash.0[..])).await
    }

    /// The keys of a team beside its first one, revoked ones too, in the order in which they were made.
    pub async fn team_keys(&self, first: OwnerKey) -> Result<Vec<Key>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("WHERE acts_for = ").push_bind(first.0).push(" ORDER BY number");
        self.fetch_all(query.build()).await
    }
}

from_row! {
    Key { number, id, role, name, created_at, expires_at, revoked_at }
}
