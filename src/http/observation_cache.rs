//! Cache of written observations, without the parts that change within a round, for seats and clients that ask again.

use bytes::Bytes;
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use swarmbench_engine::AgentId;

use crate::episode::Status;
use crate::ids::EpisodeKey;

/// Maximum bytes of a cached sight.
const SIGHT_CACHED_BYTES_MAX: usize = 16 * 1024;

/// Bytes of a typical sight, by which the cache estimates its number of entries.
const SIGHT_USUAL_BYTES: u64 = 4 * 1024;

/// Written sights by everything that decides their bytes.
pub(super) struct ObservationCache(Cache<Key, Bytes, ByBytes>);

pub(super) type Key = (EpisodeKey, u32, Status, AgentId);

#[derive(Clone)]
struct ByBytes;

impl Weighter<Key, Bytes> for ByBytes {
    fn weight(&self, _: &Key, sight: &Bytes) -> u64 {
        (sight.len() + size_of::<Key>()) as u64
    }
}

impl ObservationCache {
    pub(super) fn new(bytes_max: u64) -> Self {
        let items = usize::try_from(bytes_max / SIGHT_USUAL_BYTES).unwrap_or(0);
        Self(Cache::with_weighter(items, bytes_max, ByBytes))
    }

    pub(super) fn get(&self, key: &Key) -> Option<Bytes> {
        self.0.get(key)
    }

    /// Caches a sight of at most [`SIGHT_CACHED_BYTES_MAX`] bytes.
    pub(super) fn insert(&self, key: Key, sight: &Bytes) {
        if sight.len() <= SIGHT_CACHED_BYTES_MAX {
            self.0.insert(key, sight.clone());
        }
    }
}
