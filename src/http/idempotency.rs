//! Repeatable creations: a repeat with the same `Idempotency-Key` and body returns what the first one created.

use std::collections::HashMap;
use std::sync::{Arc, Mutex as StdMutex, Weak};

use axum::http::HeaderMap;
use sha2::{Digest, Sha256};
use tokio::sync::{Mutex, OwnedMutexGuard};

use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::keys::OwnerKey;
use crate::store::StoreError;

/// A lock for each name in use, which serializes its creations.
#[derive(Default)]
pub(super) struct Creations(StdMutex<HashMap<String, Weak<Mutex<()>>>>);

impl Creations {
    pub(super) async fn lock(&self, name: &str) -> OwnedMutexGuard<()> {
        let lock = {
            let mut locks = self.0.lock().expect("nothing panics while it holds this");
            if locks.len() == locks.capacity() {
                locks.retain(|_, lock| lock.strong_count() > 0);
                let kept = locks.len();
                locks.reserve(kept + 1);
            }
            let known = locks.get(name).and_then(Weak::upgrade);
            known.unwrap_or_else(|| {
                let lock = Arc::default();
                locks.insert(name.to_owned(), Arc::downgrade(&lock));
                lock
            })
        };
        lock.lock_owned().await
    }

    pub(super) async fn lock_key(
        &self,
        named: Option<&Idempotency>,
    ) -> Option<OwnedMutexGuard<()>> {
        match named {
            Some((key, _)) => Some(self.lock(key).await),
            None => None,
        }
    }
}

/// Key of a creation, and the digest of its body.
pub(super) type Idempotency = (String, [u8; 32]);

/// The key that a request names, if any. Each owner has a separate namespace.
pub(super) fn idempotency(
    headers: &HeaderMap,
    owner: Option<OwnerKey>,
    body: impl AsRef<[u8]>,
    limits: &Limits,
) -> Result<Option<Idempotency>, ApiError> {
    let Some(value) = headers.get("idempotency-key") else { return Ok(None) };
    let most = limits.name_chars_max;
    let key = value.to_str().ok().filter(|key| (1..=most).contains(&key.len()));
    let key = key.ok_or_else(|| {
        let detail = format!("Idempotency-Key must be 1 to {most} printable ASCII characters");
        ApiError::new(Code::Malformed, detail)
    })?;
    let owner = owner.map_or_else(String::new, |OwnerKey(number)| number.to_string());
    Ok(Some((format!("{owner}/{key}"), Sha256::digest(body).into())))
}

/// The object created earlier with this key. It is an error if its body was different.
pub(super) async fn created_before<'a, T, B: AsRef<[u8]>, F>(
    named: Option<&'a Idempotency>,
    find: impl FnOnce(&'a str) -> F,
) -> Result<Option<T>, ApiError>
where
    F: Future<Output = Result<Option<(T, B)>, StoreError>>,
{
    let Some((key, body)) = named else { return Ok(None) };
    match find(key).await? {
        Some((_, first)) if first.as_ref() != body => Err(ApiError::other_body()),
        found => Ok(found.map(|(created, _)| created)),
    }
}
