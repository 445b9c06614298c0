//! A cache of responses that are the same for all callers: boards and lists. Each is computed once for concurrent requests and
//! cached until a result changes. The ranking behind the pages of a competition's board is cached in the same way; a task of its
//! own recomputes a large one that is being read, so that no reader waits for it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use axum::body::Body;
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use jiff::Timestamp;
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};

use super::error::ApiError;
use super::stream::whole;
use crate::fair::{Party, Rank};
use crate::store::Store;
use swarmbench_clock::{Clock, after};

/// Size from which an entry is large: it takes long to compute, so it is computed at most once a second.
const LARGE_BYTES: usize = 64 * 1024;

/// Time for which a large entry is served although results have changed.
const LARGE_FRESH_FOR: Duration = Duration::from_secs(1);

/// Time for which a followed entry is served after it was last found current or was computed. Its task recomputes it every
/// [`LARGE_FRESH_FOR`]; readers wait for one that is more overdue.
const FOLLOWED_FRESH_FOR: Duration = Duration::from_secs(3);

/// Time for which an entry is followed after its last read.
const FOLLOWED_AFTER_READ: Duration = Duration::from_mins(1);

/// Maximum followed entries: each may be computed once a second.
const FOLLOWED_MAX: usize = 8;

/// State of the results from which an entry was computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Results {
    /// Revision as read before the computation.
    revision: u64,
    at: Timestamp,
}

#[derive(Debug)]
pub(super) struct Cached<T> {
    pub(super) of: Results,
    pub(super) what: T,
}

/// Memory use of an entry.
pub(super) trait Weighted {
    fn bytes(&self) -> usize;
}

/// A cached response.
#[derive(Debug)]
pub(super) struct CachedResponse {
    headers: HeaderMap,
    body: Bytes,
}

/// Entries by question, which is the text of the request's parameters.
pub(super) struct SharedCache<T> {
    entries: Cache<String, Arc<Cached<T>>, ByBytes>,
    store: Store,
    clock: Arc<dyn Clock>,
    followed: Mutex<HashMap<String, Followed>>,
}

/// An entry that a task recomputes as long as it is read.
struct Followed {
    read_at: Timestamp,
    /// Last time at which the entry was current.
    fresh_at: Timestamp,
}

#[derive(Clone)]
struct ByBytes;

impl<T: Weighted> Weighter<String, Arc<Cached<T>>> for ByBytes {
    fn weight(&self, question: &String, made: &Arc<Cached<T>>) -> u64 {
        // Bytes of headers and of the cache's overhead.
        const AROUND: usize = 512;
        (question.len() + made.what.bytes() + AROUND) as u64
    }
}

impl<T: Weighted> SharedCache<T> {
    /// A cache of `bytes_max` bytes in one shard, so that a large entry fits on a machine with many cores, too.
    pub(super) fn new(bytes_max: u64, (store, clock): (Store, Arc<dyn Clock>)) -> Self {
        let mut options = OptionsBuilder::new();
        options.shards(1).estimated_items_capacity(1000).weight_capacity(bytes_max);
        let options = options.build().expect("both capacities are named");
        let hasher = DefaultHashBuilder::default();
        let entries = Cache::with_options(options, ByBytes, hasher, DefaultLifecycle::default());
        Self { entries, store, clock, followed: Mutex::default() }
    }

    pub(super) fn results(&self) -> Results {
        Results { revision: self.store.writer().changes().revision(), at: self.clock.now() }
    }

    /// The entry of a question, computed by `make` on a miss. Concurrent requests for it wait; if the request that computes it is
    /// dropped, the next one takes over.
    pub(super) async fn entry(
        &self,
        question: String,
        make: impl Future<Output = Result<Cached<T>, ApiError>>,
    ) -> Result<Arc<Cached<T>>, ApiError> {
        let asked = self.results();
        let is_valid = |made: &Cached<T>| made.is_valid(asked.revision, self.clock.now());
        self.entry_where(question, is_valid, make).await
    }

    async fn entry_where(
        &self,
        question: String,
        is_valid: impl Fn(&Cached<T>) -> bool,
        make: impl Future<Output = Result<Cached<T>, ApiError>>,
    ) -> Result<Arc<Cached<T>>, ApiError> {
        loop {
            match self.entries.get_value_or_guard_async(&question).await {
                Ok(made) if is_valid(&made) => return Ok(made),
                Ok(old) => {
                    self.entries.remove_if(&question, |made| Arc::ptr_eq(made, &old));
                }
                Err(place) => {
                    let mut made = Rank::Normal.scope(make).await?;
                    // The age counts from the end of a long computation.
                    made.of.at = self.clock.now();
                    let made = Arc::new(made);
                    // An entry larger than the cache serves only the requests that wait now.
                    drop(place.insert(Arc::clone(&made)));
                    return Ok(made);
                }
            }
        }
    }
}

impl<T: Weighted + Send + Sync + 'static> SharedCache<T> {
    /// Entry like [`SharedCache::entry`]. After a large entry was computed, a task recomputes it after changes, and readers get
    /// the latest one. `make` gets the previous entry. The task ends when `stopped` completes.
    pub(super) async fn followed_entry<F>(
        self: &Arc<Self>,
        question: String,
        make: impl Fn(Option<Arc<Cached<T>>>) -> F + Send + 'static,
        stopped: impl Future<Output = ()> + Send + 'static,
    ) -> Result<Arc<Cached<T>>, ApiError>
    where
        F: Future<Output = Result<Cached<T>, ApiError>> + Send,
    {
        if let Some(made) = self.read_followed(&question) {
            return Ok(made);
        }
        let before = self.entries.peek(&question);
        let made = self.entry(question.clone(), Box::pin(make(before))).await?;
        if made.what.bytes() >= LARGE_BYTES && self.begin_to_follow(&question) {
            let cache = Arc::clone(self);
            // The computation serves all readers, so it runs for the server, not for one of their parties.
            let follow = Party::SERVER.scope(Rank::Normal.scope(async move {
                let leave = Leave { cache: &cache, question: &question };
                tokio::select! {
                    () = cache.follow(leave.question, make) => {}
                    () = stopped => {}
                }
            }));
            tokio::spawn(follow);
        }
        Ok(made)
    }

    /// A followed entry, if it is fresh enough. Counts as a read.
    fn read_followed(&self, question: &str) -> Option<Arc<Cached<T>>> {
        let now = self.clock.now();
        let mut all = self.all_followed();
        let followed = all.get_mut(question)?;
        followed.read_at = now;
        let is_fresh = now < after(followed.fresh_at, FOLLOWED_FRESH_FOR);
        drop(all);
        is_fresh.then(|| self.entries.get(question)).flatten()
    }

    /// Registers a question to be followed; false if it is followed already or [`FOLLOWED_MAX`] are.
    fn begin_to_follow(&self, question: &str) -> bool {
        let mut all = self.all_followed();
        if all.len() >= FOLLOWED_MAX || all.contains_key(question) {
            return false;
        }
        let now = self.clock.now();
        all.insert(question.to_owned(), Followed { read_at: now, fresh_at: now });
        true
    }

    /// Recomputes an entry after changes, as long as it is read.
    async fn follow<F>(&self, question: &str, make: impl Fn(Option<Arc<Cached<T>>>) -> F)
    where
        F: Future<Output = Result<Cached<T>, ApiError>>,
    {
        loop {
            self.clock.sleep_until(after(self.clock.now(), LARGE_FRESH_FOR)).await;
            // Reads commits of other servers. If this keeps failing, the next reader gets the error.
            let Ok(()) = self.store.catch_up().await else { return };
            let results = self.results();
            let is_read =
                |followed: &Followed| results.at < after(followed.read_at, FOLLOWED_AFTER_READ);
            if !self.all_followed().get(question).is_some_and(is_read) {
                return;
            }
            // An entry that the cache evicted is computed at its next read.
            let Some(before) = self.entries.peek(question) else { return };
            if before.of.revision < results.revision {
                let Ok(made) = make(Some(before)).await else { return };
                self.entries.insert(question.to_owned(), Arc::new(made));
            }
            if let Some(followed) = self.all_followed().get_mut(question) {
                followed.fresh_at = results.at;
            }
        }
    }

    fn all_followed(&self) -> MutexGuard<'_, HashMap<String, Followed>> {
        self.followed.lock().expect("nothing panics while it holds this")
    }
}

/// Ends following when the task ends, however it does.
struct Leave<'a, T: Weighted + Send + Sync + 'static> {
    cache: &'a SharedCache<T>,
    question: &'a str,
}

impl<T: Weighted + Send + Sync + 'static> Drop for Leave<'_, T> {
    fn drop(&mut self) {
        self.cache.all_followed().remove(self.question);
    }
}

impl<T: Weighted> Cached<T> {
    /// A valid entry is as new as the revision at which the request arrived; a large one may be a little older.
    fn is_valid(&self, revision: u64, now: Timestamp) -> bool {
        let is_young = self.of.at <= now && now < after(self.of.at, LARGE_FRESH_FOR);
        self.of.revision >= revision || (self.what.bytes() >= LARGE_BYTES && is_young)
    }
}

impl Weighted for CachedResponse {
    fn bytes(&self) -> usize {
        self.body.len()
    }
}

impl CachedResponse {
    async fn read(response: Response) -> Result<Self, ApiError> {
        let (parts, body) = response.into_parts();
        Ok(Self { headers: parts.headers, body: whole(body).await? })
    }

    fn response(&self) -> Response {
        let mut response = Response::new(Body::from(self.body.clone()));
        *response.headers_mut() = self.headers.clone();
        response
    }
}

impl SharedCache<CachedResponse> {
    /// The response to a question that has the same one for all callers, computed by `make` on a miss.
    pub(super) async fn answer(
        &self,
        question: String,
        make: impl Future<Output = Result<Response, ApiError>>,
    ) -> Result<Response, ApiError> {
        let make = async {
            let of = self.results();
            Ok(Cached { of, what: CachedResponse::read(make.await?).await? })
        };
        Ok(self.entry(question, make).await?.what.response())
    }

    /// Answer like [`SharedCache::answer`] for lists of entrants, which do not change when a game ends.
    pub(super) async fn answer_of_entrants(
        &self,
        question: String,
        make: impl Future<Output = Result<Response, ApiError>>,
    ) -> Result<Response, ApiError> {
        let now =
            || Results { revision: self.store.writer().changes().entrants(), at: self.clock.now() };
        let asked = now().revision;
        let make = async {
            let of = now();
            Ok(Cached { of, what: CachedResponse::read(make.await?).await? })
        };
        let is_valid = |made: &Cached<CachedResponse>| made.is_valid(asked, self.clock.now());
        Ok(self.entry_where(question, is_valid, make).await?.what.response())
    }

    /// The response to a question about a cached entry, whose results are `of`: computed by `make` once for each state of the
    /// entry.
    pub(super) async fn answer_of(
        &self,
        question: String,
        of: Results,
        make: impl Future<Output = Result<Response, ApiError>>,
    ) -> Result<Response, ApiError> {
        let make = async { Ok(Cached { of, what: CachedResponse::read(make.await?).await? }) };
        let is_valid = |made: &Cached<CachedResponse>| made.of.revision >= of.revision;
        Ok(self.entry_where(question, is_valid, make).await?.what.response())
    }
}
