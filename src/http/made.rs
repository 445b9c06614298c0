//! Answers that are the same for all who ask: boards and lists. Each is made once, however many ask, and kept as long
//! as no result has changed.

use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::http::HeaderMap;
use axum::response::Response;
use bytes::Bytes;
use jiff::Timestamp;
use quick_cache::Weighter;
use quick_cache::sync::Cache;

use super::App;
use super::error::{ApiError, Code};
use crate::clock::after;
use crate::fair::{Party, Rank};

/// Bytes of all answers that are kept.
pub(super) const BOARDS_BYTES_MAX: usize = 64 * 1024 * 1024;

/// From so many bytes on an answer is large: it takes long to make, and is made once a second at most.
const LARGE_BYTES: usize = 64 * 1024;

/// How old a large answer may be.
const LARGE_STAYS: Duration = Duration::from_secs(1);

/// An answer as it was made.
#[derive(Debug)]
struct Made {
    /// Which results were known before it was made.
    revision: u64,
    at: Timestamp,
    headers: HeaderMap,
    body: Bytes,
}

/// Answers that were made, by what was asked.
pub(super) struct Answers(Cache<String, Arc<Made>, BytesOf>);

#[derive(Clone)]
struct BytesOf;

impl Weighter<String, Arc<Made>> for BytesOf {
    fn weight(&self, question: &String, made: &Arc<Made>) -> u64 {
        // Headers and what the cache itself needs.
        const AROUND: usize = 512;
        (question.len() + made.body.len() + AROUND) as u64
    }
}

impl Answers {
    pub(super) fn new() -> Self {
        Self(Cache::with_weighter(1000, BOARDS_BYTES_MAX as u64, BytesOf))
    }
}

impl Made {
    /// Whether it is still the answer for somebody who asks when these results are known.
    fn serves(&self, revision: u64, now: Timestamp) -> bool {
        let is_young = self.at <= now && now < after(self.at, LARGE_STAYS);
        self.revision >= revision || (self.body.len() >= LARGE_BYTES && is_young)
    }

    fn answer(&self) -> Response {
        let mut response = Response::new(Body::from(self.body.clone()));
        *response.headers_mut() = self.headers.clone();
        response
    }
}

impl App {
    /// The answer to a question that has the same answer for all, made by `make` where none is kept. Whoever asks
    /// while it is being made waits for it; where the one for whom it is made goes, the next goes on.
    pub(super) async fn made_once(
        &self,
        question: String,
        make: impl Future<Output = Result<Response, ApiError>>,
    ) -> Result<Response, ApiError> {
        let asked = self.store.writer().changes().revision();
        loop {
            match self.answers.0.get_value_or_guard_async(&question).await {
                Ok(made) if made.serves(asked, self.clock.now()) => return Ok(made.answer()),
                Ok(old) => {
                    self.answers.0.remove_if(&question, |made| Arc::ptr_eq(made, &old));
                }
                Err(place) => {
                    let revision = self.store.writer().changes().revision();
                    let at = self.clock.now();
                    // It is everybody's: nobody's other requests delay it.
                    let response = Rank::Normal.scope(Party::SERVER.scope(make)).await?;
                    let (parts, body) = response.into_parts();
                    let body = to_bytes(body, usize::MAX).await;
                    let body =
                        body.map_err(|error| ApiError::new(Code::Internal, error.to_string()))?;
                    let made = Arc::new(Made { revision, at, headers: parts.headers, body });
                    // One that is larger than all that is kept is made for whoever waits for it now.
                    drop(place.insert(Arc::clone(&made)));
                    return Ok(made.answer());
                }
            }
        }
    }
}
