//! Cache of written replay pages, shared by all who ask for the same rounds.

use bytes::Bytes;
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};

use super::error::ApiError;
use crate::ids::{EpisodeKey, ImportKey};
use swarmbench_protocol::replay::ReplayPage;

/// Bytes of a typical page, by which the cache estimates its number of entries.
const PAGE_USUAL_BYTES: u64 = 32 * 1024;

/// Everything that decides the bytes of a page: resolved rounds never change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct PageKey {
    pub(super) game: ReplayedGame,
    pub(super) from: u32,
    /// Last round that the page may contain.
    pub(super) to: u32,
    pub(super) has_decisions: bool,
}

/// Game whose states a page contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum ReplayedGame {
    Episode(EpisodeKey),
    Import(ImportKey),
}

/// A written page, and the number of its last state.
#[derive(Clone, Debug)]
pub(super) struct WrittenPage {
    pub(super) json: Bytes,
    pub(super) last: u32,
}

impl WrittenPage {
    pub(super) fn of(page: &ReplayPage) -> Self {
        let json = serde_json::to_vec(page).expect("string keys").into();
        Self { json, last: page.from + page.length - 1 }
    }
}

/// Written pages, each computed once for concurrent requests.
pub(super) struct ReplayPages(Cache<PageKey, WrittenPage, ByBytes>);

#[derive(Clone)]
struct ByBytes;

impl Weighter<PageKey, WrittenPage> for ByBytes {
    fn weight(&self, _: &PageKey, page: &WrittenPage) -> u64 {
        (page.json.len() + size_of::<(PageKey, WrittenPage)>()) as u64
    }
}

impl ReplayPages {
    /// A cache with one shard, so that the largest page fits on a machine with many cores, too.
    pub(super) fn new(bytes_max: u64) -> Self {
        let items = usize::try_from(bytes_max / PAGE_USUAL_BYTES).unwrap_or(0);
        let mut options = OptionsBuilder::new();
        options.shards(1).estimated_items_capacity(items).weight_capacity(bytes_max);
        let options = options.build().expect("both capacities are named");
        let hasher = DefaultHashBuilder::default();
        Self(Cache::with_options(options, ByBytes, hasher, DefaultLifecycle::default()))
    }

    /// A page, written by `write` on a miss. If the request that writes it is dropped, the next one takes over.
    pub(super) async fn page(
        &self,
        key: PageKey,
        write: impl Future<Output = Result<WrittenPage, ApiError>>,
    ) -> Result<WrittenPage, ApiError> {
        match self.0.get_value_or_guard_async(&key).await {
            Ok(page) => Ok(page),
            Err(place) => {
                let page = write.await?;
                drop(place.insert(page.clone()));
                Ok(page)
            }
        }
    }
}
