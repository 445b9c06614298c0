//! Request bodies: limits on their memory, in total and per party, and on the time they take to arrive.
//!
//! A connection's own memory covers a body of [`FREE_BODY_BYTES`]. A longer one reserves a multiple of its bytes, which also covers
//! its parsed form. A large body has more than [`LIGHT_BODY_BYTES_MAX`] bytes or an unknown length: it waits for a permit to be
//! handled. Without a token a body has at most `anonymous_body_bytes_max` bytes.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::Request;
use axum::http::{HeaderMap, header};
use bytes::{Bytes, BytesMut};
use futures::FutureExt;
use http_body_util::{BodyExt, LengthLimitError, Limited};
use hyper::body::Body as _;
use tokio::time::Instant;

use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::budget::{Budget, Reservation};
use crate::fair::{Busy, FairLimit, Party, Permit, Rank, Shares};

/// Maximum bytes of a body that is handled in one piece on the threads of running games. A larger body, or one of unknown length,
/// is handled on threads of lower priority.
pub(super) const LIGHT_BODY_BYTES_MAX: usize = 128 * 1024;

/// Maximum bytes of a body that reserves no memory, as each connection is counted with that many.
pub(super) const FREE_BODY_BYTES: usize = 8 * 1024;

/// Factor by which a body's bytes are reserved: for the growing buffer that collects it and for its parsed JSON.
const BODY_FACTOR: usize = 3;

/// A light body announces at most [`LIGHT_BODY_BYTES_MAX`] bytes.
pub(super) fn is_light(request: &Request) -> bool {
    request.body().size_hint().upper().is_some_and(|bytes| bytes <= LIGHT_BODY_BYTES_MAX as u64)
}

/// Time that a large body waits for its permit.
const PATIENCE: Duration = Duration::from_secs(5);

#[derive(Debug)]
pub(super) struct Bodies {
    limits: Limits,
    /// Bytes, with a reserve for requests with a token.
    memory: Arc<Budget>,
    /// Permits to handle large bodies.
    permits: FairLimit,
}

impl Bodies {
    pub(super) fn new(limits: &Limits) -> Self {
        let shares = Shares { slots_per_member: 1, ..Shares::halved(limits.heavy_at_once_max) };
        let bytes = limits.bodies_bytes_max;
        Self {
            limits: *limits,
            memory: Budget::new("bodies_bytes_max", bytes, bytes),
            permits: FairLimit::heavy(shares, PATIENCE),
        }
    }
}

/// A complete body. Its memory, and the permit of a large one, are held until this is dropped.
pub(super) struct Arrived {
    bytes: Bytes,
    _permit: Option<Permit>,
    _memory: Option<Reservation>,
}

impl Arrived {
    /// The bytes, whose memory is reserved as long as this lives.
    pub(super) fn bytes(&self) -> Bytes {
        self.bytes.clone()
    }
}

impl AsRef<[u8]> for Arrived {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// Maximum length of a body, and the rank at which its memory is reserved.
struct Bounds<'a> {
    rank: Rank,
    limit: usize,
    limit_name: &'a str,
}

struct Collected<'a> {
    memory: &'a Arc<Budget>,
    rank: Rank,
    bytes: BytesMut,
    reserved: Option<Reservation>,
}

impl Collected<'_> {
    fn add(&mut self, more: &[u8]) -> Result<(), ApiError> {
        self.bytes.extend_from_slice(more);
        if self.bytes.len() <= FREE_BODY_BYTES {
            return Ok(());
        }
        let new = || self.memory.take(0, Some(Party::current()));
        let reserved = self.reserved.get_or_insert_with(new);
        let more = BODY_FACTOR * self.bytes.len() - reserved.amount();
        reserved.grow(more, self.rank).map_err(|full| {
            let (name, most) = full.limit();
            let detail = "too many large bodies arrive at once; send it again later, or in pieces";
            ApiError::limit(Code::Overloaded, name, most, detail)
                .retry_after(Duration::from_secs(1))
        })
    }
}

impl Bodies {
    /// Reads a JSON body of at most `limit` bytes. It must be UTF-8, and valid JSON must have its content type.
    pub(super) async fn json(
        &self,
        request: Request,
        limit: usize,
        limit_name: &str,
    ) -> Result<Arrived, ApiError> {
        let says_json = is_json(request.headers());
        // Extractors have refused unknown tokens.
        let has_token = request.headers().contains_key(header::AUTHORIZATION);
        let bounds = self.bounds(has_token, limit, limit_name);
        let (bytes, memory) = self.collect(request.into_body(), bounds).await?;
        let permit = if bytes.len() > LIGHT_BODY_BYTES_MAX {
            Some(self.permits.acquire(Party::current(), Rank::Normal).await.map_err(busy)?)
        } else {
            None
        };
        if let Err(error) = std::str::from_utf8(&bytes) {
            return Err(ApiError::new(Code::Malformed, format!("the body is not UTF-8: {error}")));
        }
        if !says_json && serde_json::from_slice::<serde::de::IgnoredAny>(&bytes).is_ok() {
            return Err(ApiError::new(
                Code::UnsupportedMediaType,
                "send the header `Content-Type: application/json` with the body",
            ));
        }
        Ok(Arrived { bytes, _permit: permit, _memory: memory })
    }

    /// Reads a light body that will be forwarded, of a client with a known token or without one.
    pub(super) async fn light(&self, has_token: bool, body: Body) -> Result<Arrived, ApiError> {
        let bounds = self.bounds(has_token, LIGHT_BODY_BYTES_MAX, "body_bytes_max");
        let (bytes, memory) = self.collect(body, bounds).await?;
        Ok(Arrived { bytes, _permit: None, _memory: memory })
    }

    /// Bounds of a body of a client with a known token, or without one.
    fn bounds<'a>(&self, has_token: bool, limit: usize, limit_name: &'a str) -> Bounds<'a> {
        if has_token {
            return Bounds { rank: Rank::Urgent, limit, limit_name };
        }
        let anonymous = self.limits.anonymous_body_bytes_max;
        if limit <= anonymous {
            return Bounds { rank: Rank::Normal, limit, limit_name };
        }
        Bounds { rank: Rank::Normal, limit: anonymous, limit_name: "anonymous_body_bytes_max" }
    }

    async fn collect(
        &self,
        body: Body,
        Bounds { rank, limit, limit_name }: Bounds<'_>,
    ) -> Result<(Bytes, Option<Reservation>), ApiError> {
        let mut body = Limited::new(body, limit);
        let memory = &self.memory;
        let mut collected = Collected { memory, rank, bytes: BytesMut::new(), reserved: None };
        let started = Instant::now();
        loop {
            // Most bodies arrive together with their heads and need no timer.
            let frame = if let Some(frame) = body.frame().now_or_never() {
                Ok(frame)
            } else {
                let late = started + patience(&self.limits, collected.bytes.len());
                tokio::time::timeout_at(late, body.frame()).await
            };
            match frame {
                Ok(Some(Ok(frame))) => collected.add(&frame.into_data().unwrap_or_default())?,
                Ok(None) => return Ok((collected.bytes.freeze(), collected.reserved)),
                Ok(Some(Err(error))) if error.is::<LengthLimitError>() => {
                    return Err(too_large(limit_name, limit));
                }
                Ok(Some(Err(_))) => {
                    return Err(ApiError::new(Code::Malformed, "the body broke off"));
                }
                Err(_) => {
                    metrics::counter!("swarmbench_connections_cut_total", "reason" => "body")
                        .increment(1);
                    let detail = "the body did not arrive in time";
                    return Err(ApiError::new(Code::Malformed, detail));
                }
            }
        }
    }
}

fn busy(busy: Busy) -> ApiError {
    let detail = "too many large bodies are handled at once; send it again later, or in pieces";
    ApiError::no_permit(busy, detail)
}

/// Time limit of a body of which `received` bytes have arrived: a large one may be slow but must keep arriving.
fn patience(limits: &Limits, received: usize) -> Duration {
    let more = received as u64 * 1000 / limits.body_bytes_per_s_min;
    Duration::from_millis(limits.body_ms_max + more)
}

fn is_json(headers: &HeaderMap) -> bool {
    let value = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok());
    value.is_some_and(|value| {
        let essence = value.split(';').next().unwrap_or_default().trim();
        essence.eq_ignore_ascii_case("application/json")
    })
}

pub(super) fn too_large(limit_name: &str, limit: usize) -> ApiError {
    let detail = format!("the body has more than {limit} bytes");
    ApiError::limit(Code::TooLarge, limit_name, limit, detail)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fair::{Group, Origin};

    #[test]
    fn bodies_without_a_token_leave_memory_to_those_who_play() {
        let limits = Limits { bodies_bytes_max: 1_000_000, ..Limits::default() };
        let bodies = Bodies::new(&limits);
        let arrive = |address: u8, rank, bytes: usize| {
            let memory = &bodies.memory;
            let mut body = Collected { memory, rank, bytes: BytesMut::new(), reserved: None };
            let from = Party::of(Group::Address([192, 0, 2, address].into()));
            let origin = Origin::of(from, rank);
            let arrived =
                origin.enter(|| (0..bytes / 1000).try_for_each(|_| body.add(&[b' '; 1000])));
            arrived.is_ok().then_some(body)
        };
        let unfinished: Vec<_> =
            (0..200).filter_map(|n| arrive(n % 8, Rank::Normal, 64_000)).collect();
        assert!((1..=5).contains(&unfinished.len()), "{} unfinished bodies", unfinished.len());
        assert!(arrive(9, Rank::Normal, 8_000).is_some(), "a short one needs no memory");
        let long = arrive(9, Rank::Urgent, 131_000).expect("the reserve");
        assert!(long.reserved.as_ref().is_some_and(|held| held.amount() == 3 * 131_000));
        drop((unfinished, long));
        assert_eq!(bodies.memory.used(), 0);
    }

    #[test]
    fn a_body_earns_time_by_coming() {
        let limits = Limits::default();
        let seconds = |received| patience(&limits, received).as_secs();
        assert_eq!(seconds(0), 5);
        assert_eq!(seconds(32 * 1024), 6);
        assert_eq!(seconds(limits.swarm_body_bytes_max), 5 + 256);
    }
}
