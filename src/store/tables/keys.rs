//! The table `keys`.

use crate::ids::TokenHash;
use crate::keys::{Key, OwnerKey};
use crate::store::Store;
use crate::store::StoreError;
use crate::store::sql::{Builder, from_row, query};

const SELECT: &str = "SELECT number, id, role, name, created_at, expires_at, revoked_at FROM keys ";

impl Store {
    /// All keys in order of their numbers, including revoked and expired ones.
    pub async fn keys(&self) -> Result<Vec<Key>, StoreError> {
        self.list_keys(None, u32::MAX).await
    }

    /// A page of all keys in order of their numbers, starting after `after`.
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

    /// Finds a key by number, including revoked and expired ones.
    pub async fn key(&self, number: OwnerKey) -> Result<Option<Key>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("WHERE number = ").push_bind(number.0);
        self.fetch_optional(query.build()).await
    }

    /// Whether any key exists, revoked and expired ones included.
    pub async fn has_keys(&self) -> Result<bool, StoreError> {
        self.fetch_one(query("SELECT EXISTS (SELECT 1 FROM keys)")).await
    }

    /// Finds a key by the hash of its token, including revoked and expired ones. The key of a team's member has the number of
    /// the team's first key, and so its permissions.
    pub async fn find_key(&self, hash: TokenHash) -> Result<Option<Key>, StoreError> {
        let query = query(
            "SELECT coalesce(acts_for, number) AS number, id, role, name, created_at, expires_at, revoked_at
             FROM keys WHERE hash = $1",
        );
        self.fetch_optional(query.bind(&hash.0[..])).await
    }

    /// The keys of a team except the first one, in order of creation, including revoked ones.
    pub async fn team_keys(&self, first: OwnerKey) -> Result<Vec<Key>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("WHERE acts_for = ").push_bind(first.0).push(" ORDER BY number");
        self.fetch_all(query.build()).await
    }
}

from_row! {
    Key { number, id, role, name, created_at, expires_at, revoked_at }
}
