//! The table `keys`.

use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite};

use super::episodes::time;
use super::{Store, failure};
use crate::ids::TokenHash;
use crate::journal::JournalError;
use crate::keys::{Key, OwnerKey, Role};

const SELECT: &str = "SELECT number, id, role, name, created_at, expires_at, revoked_at FROM keys ";

impl Store {
    /// All keys that were ever made, in order.
    ///
    /// # Errors
    /// Where the database cannot be read; so for all functions here.
    pub async fn keys(&self) -> Result<Vec<Key>, JournalError> {
        self.list_keys(None, u32::MAX).await
    }

    /// The keys that were ever made, in order, from the one after `after` on.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn list_keys(
        &self,
        after: Option<OwnerKey>,
        limit: u32,
    ) -> Result<Vec<Key>, JournalError> {
        let mut query = QueryBuilder::<Sqlite>::new(SELECT);
        query.push("WHERE number > ").push_bind(after.map_or(-1, |key| key.0));
        query.push(" ORDER BY number LIMIT ").push_bind(limit);
        let rows = query.build().fetch_all(&self.readers).await.map_err(failure)?;
        rows.iter().map(key).collect::<Result<_, _>>().map_err(failure)
    }

    /// Whether a key was ever made.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn has_keys(&self) -> Result<bool, JournalError> {
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM keys)").fetch_one(&self.readers).await;
        row.and_then(|row| row.try_get(0)).map_err(failure)
    }

    /// The key whose token has this hash, whatever it is worth now.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn find_key(&self, hash: TokenHash) -> Result<Option<Key>, JournalError> {
        let mut query = QueryBuilder::<Sqlite>::new(SELECT);
        query.push("WHERE hash = ").push_bind(&hash.0[..]);
        let row = query.build().fetch_optional(&self.readers).await.map_err(failure)?;
        row.as_ref().map(key).transpose().map_err(failure)
    }
}

fn key(row: &SqliteRow) -> Result<Key, sqlx::Error> {
    let role: String = row.try_get("role")?;
    let role =
        Role::parse(&role).ok_or_else(|| sqlx::Error::Decode(format!("role {role:?}").into()))?;
    let maybe = |column| row.try_get::<Option<i64>, _>(column)?.map(time).transpose();
    Ok(Key {
        number: Some(OwnerKey(row.try_get("number")?)),
        id: row.try_get("id")?,
        role,
        name: row.try_get("name")?,
        created_at: time(row.try_get("created_at")?)?,
        expires_at: maybe("expires_at")?,
        revoked_at: maybe("revoked_at")?,
    })
}
