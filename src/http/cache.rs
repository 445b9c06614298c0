//! A cache of answers that are the same for all callers: boards and lists. Each is computed once for concurrent requests
//! and cached until a result changes. The ranking behind the pages of a competition's board is cached in the same way.

use std::sync::Arc;
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
use crate::fair::Rank;
use crate::store::Store;
use swarmbench_clock::{Clock, after};

/// Bytes of all cached answers.
pub(super) const ANSWERS_BYTES_MAX: u64 = 48 * 1024 * 1024;

/// Bytes of all cached rankings.
pub(super) const RANKINGS_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// An entry of at least this size is large: it takes long to compute, and is computed once a second at most.
const LARGE_BYTES: usize = 64 * 1024;

/// How long a large entry is served although results have changed.
const LARGE_FRESH_FOR: Duration = Duration::from_secs(1);

/// The results from which an entry was computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Results {
    /// The revision that was known before.
    revision: u64,
    at: Timestamp,
}

/// An entry with the results from which it was computed.
#[derive(Debug)]
pub(super) struct Cached<T> {
    pub(super) of: Results,
    pub(super) what: T,
}

/// What an entry takes in memory.
pub(super) trait Weighted {
    /// Its size in bytes.
    fn bytes(&self) -> usize;
}

/// A response as it is cached.
#[derive(Debug)]
pub(super) struct Answer {
    headers: HeaderMap,
    body: Bytes,
}

/// Entries by what was asked.
pub(super) struct SharedCache<T> {
    entries: Cache<String, Arc<Cached<T>>, ByBytes>,
    store: Store,
    clock: Arc<dyn Clock>,
}

#[derive(Clone)]
struct ByBytes;

impl<T: Weighted> Weighter<String, Arc<Cached<T>>> for ByBytes {
    fn weight(&self, question: &String, made: &Arc<Cached<T>>) -> u64 {
        // Headers and the overhead of the cache.
        const AROUND: usize = 512;
        (question.len() + made.what.bytes() + AROUND) as u64
    }
}

impl<T: Weighted> SharedCache<T> {
    /// A cache of `bytes_max` bytes in one shard: a large entry has to fit on a machine of many cores, too.
    pub(super) fn new(bytes_max: u64, (store, clock): (Store, Arc<dyn Clock>)) -> Self {
        let mut options = OptionsBuilder::new();
        options.shards(1).estimated_items_capacity(1000).weight_capacity(bytes_max);
        let options = options.build().expect("both capacities are named");
        let hasher = DefaultHashBuilder::default();
        let entries = Cache::with_options(options, ByBytes, hasher, DefaultLifecycle::default());
        Self { entries, store, clock }
    }

    /// The results that are known now.
    pub(super) fn results(&self) -> Results {
        Results { revision: self.store.writer().changes().revision(), at: self.clock.now() }
    }

    /// The entry of a question, computed by `make` on a cache miss. Concurrent requests for it wait; if the request
    /// that computes it is dropped, the next one takes over.
    pub(super) async fn entry(
        &self,
        question: String,
        make: impl Future<Output = Result<Cached<T>, ApiError>>,
    ) -> Result<Arc<Cached<T>>, ApiError> {
        let asked = self.results();
        loop {
            match self.entries.get_value_or_guard_async(&question).await {
                Ok(made) if made.is_valid(asked.revision, self.clock.now()) => return Ok(made),
                Ok(old) => {
                    self.entries.remove_if(&question, |made| Arc::ptr_eq(made, &old));
                }
                Err(place) => {
                    let mut made = Rank::Normal.scope(make).await?;
                    // Its age counts from the end of a long computation.
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

impl<T: Weighted> Cached<T> {
    /// Whether it is still valid for a request that came at this revision.
    fn is_valid(&self, revision: u64, now: Timestamp) -> bool {
        let is_young = self.of.at <= now && now < after(self.of.at, LARGE_FRESH_FOR);
        self.of.revision >= revision || (self.what.bytes() >= LARGE_BYTES && is_young)
    }
}

impl Weighted for Answer {
    fn bytes(&self) -> usize {
        self.body.len()
    }
}

impl Answer {
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

impl SharedCache<Answer> {
    /// The answer to a question that has the same answer for all callers, computed by `make` on a cache miss.
    pub(super) async fn answer(
        &self,
        question: String,
        make: impl Future<Output = Result<Response, ApiError>>,
    ) -> Result<Response, ApiError> {
        let make = async {
            let of = self.results();
            Ok((of, make.await?))
        };
        self.answer_of(question, make).await
    }

    /// The same where `make` returns the results from which it computed the answer.
    pub(super) async fn answer_of(
        &self,
        question: String,
        make: impl Future<Output = Result<(Results, Response), ApiError>>,
    ) -> Result<Response, ApiError> {
        let make = async {
            let (of, response) = make.await?;
            Ok(Cached { of, what: Answer::read(response).await? })
        };
        Ok(self.entry(question, make).await?.what.response())
    }
}
