//! Answers that are the same for all who ask: boards and lists. Each is made once, however many ask, and kept as long
//! as no result has changed. So is the ranking of which the pages of a competition's board are parts.

use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use jiff::Timestamp;
use quick_cache::sync::{Cache, DefaultLifecycle};
use quick_cache::{DefaultHashBuilder, OptionsBuilder, Weighter};

use super::App;
use super::error::{ApiError, Code};
use crate::clock::after;
use crate::fair::Rank;

/// Bytes of all answers that are kept.
pub(super) const ANSWERS_BYTES_MAX: u64 = 48 * 1024 * 1024;

/// Bytes of all rankings that are kept.
pub(super) const RANKINGS_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// From so many bytes on something is large: it takes long to make, and is made once a second at most.
const LARGE_BYTES: usize = 64 * 1024;

/// How old may be what is large.
const LARGE_STAYS: Duration = Duration::from_secs(1);

/// The results of which something was made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Results {
    /// Which of them were known before it was made.
    revision: u64,
    at: Timestamp,
}

/// Something as it was made.
#[derive(Debug)]
pub(super) struct Made<T> {
    pub(super) of: Results,
    pub(super) what: T,
}

/// What is kept in memory.
pub(super) trait Kept {
    /// How much it takes.
    fn bytes(&self) -> usize;
}

/// An answer that was made.
#[derive(Debug)]
pub(super) struct Answer {
    headers: HeaderMap,
    body: Bytes,
}

/// What was made, by what was asked.
pub(super) struct MadeOnce<T>(Cache<String, Arc<Made<T>>, BytesOf>);

#[derive(Clone)]
struct BytesOf;

impl<T: Kept> Weighter<String, Arc<Made<T>>> for BytesOf {
    fn weight(&self, question: &String, made: &Arc<Made<T>>) -> u64 {
        // Headers and what the cache itself needs.
        const AROUND: usize = 512;
        (question.len() + made.what.bytes() + AROUND) as u64
    }
}

impl<T: Kept> MadeOnce<T> {
    /// Keeps so many bytes, in one piece: something large is to have room in it on a machine of many cores, too.
    pub(super) fn new(bytes_max: u64) -> Self {
        let mut options = OptionsBuilder::new();
        options.shards(1).estimated_items_capacity(1000).weight_capacity(bytes_max);
        let options = options.build().expect("both capacities are named");
        let hasher = DefaultHashBuilder::default();
        Self(Cache::with_options(options, BytesOf, hasher, DefaultLifecycle::default()))
    }
}

impl<T: Kept> Made<T> {
    /// Whether it still serves somebody who asks when these results are known.
    fn serves(&self, revision: u64, now: Timestamp) -> bool {
        let is_young = self.of.at <= now && now < after(self.of.at, LARGE_STAYS);
        self.of.revision >= revision || (self.what.bytes() >= LARGE_BYTES && is_young)
    }
}

impl Kept for Answer {
    fn bytes(&self) -> usize {
        self.body.len()
    }
}

impl Answer {
    async fn read(response: Response) -> Result<Self, ApiError> {
        let (parts, body) = response.into_parts();
        let body = to_bytes(body, usize::MAX).await;
        let body = body.map_err(|error| ApiError::new(Code::Internal, error.to_string()))?;
        Ok(Self { headers: parts.headers, body })
    }

    fn response(&self) -> Response {
        let mut response = Response::new(Body::from(self.body.clone()));
        *response.headers_mut() = self.headers.clone();
        response
    }
}

impl App {
    /// The results that are known now.
    pub(super) fn results(&self) -> Results {
        Results { revision: self.store.writer().changes().revision(), at: self.clock.now() }
    }

    /// The answer to a question that has the same answer for all, made by `make` where none is kept.
    pub(super) async fn made_once(
        &self,
        question: String,
        make: impl Future<Output = Result<Response, ApiError>>,
    ) -> Result<Response, ApiError> {
        let make = async {
            let of = self.results();
            Ok((of, make.await?))
        };
        self.made_once_of(question, make).await
    }

    /// The same where `make` knows of which results it made the answer.
    pub(super) async fn made_once_of(
        &self,
        question: String,
        make: impl Future<Output = Result<(Results, Response), ApiError>>,
    ) -> Result<Response, ApiError> {
        let make = async {
            let (of, response) = make.await?;
            Ok(Made { of, what: Answer::read(response).await? })
        };
        Ok(self.kept(&self.answers, question, make).await?.what.response())
    }

    /// What is kept for a question, made by `make` where nothing is. Whoever asks while it is being made waits for it;
    /// where the one for whom it is made goes, the next goes on.
    pub(super) async fn kept<T: Kept>(
        &self,
        kept: &MadeOnce<T>,
        question: String,
        make: impl Future<Output = Result<Made<T>, ApiError>>,
    ) -> Result<Arc<Made<T>>, ApiError> {
        let asked = self.results();
        loop {
            match kept.0.get_value_or_guard_async(&question).await {
                Ok(made) if made.serves(asked.revision, self.clock.now()) => return Ok(made),
                Ok(old) => {
                    kept.0.remove_if(&question, |made| Arc::ptr_eq(made, &old));
                }
                Err(place) => {
                    let mut made = Rank::Normal.scope(make).await?;
                    // What takes long to make is not made again as soon as it is there.
                    made.of.at = self.clock.now();
                    let made = Arc::new(made);
                    // One that is larger than all that is kept is made for whoever waits for it now.
                    drop(place.insert(Arc::clone(&made)));
                    return Ok(made);
                }
            }
        }
    }
}
