//! Bodies as they arrive: how many bytes of them there may be, in all and of one party, and how long they may take.
//!
//! A large body has more than [`LIGHT_BODY_BYTES_MAX`] bytes, or does not say how many. It is refused before it is read
//! where its sender has sent as much as it may; it waits for a permit to be handled; and a group gets no more memory for
//! such bodies than is free.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
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
use crate::fair::{Busy, FairLimit, Group, Party, Permit, Rank, Shares};

/// Bytes of a body that is read and handled in one piece on the threads on which games run. A larger one, or one that does
/// not say how large it is, is handled on threads of lower priority.
pub(super) const LIGHT_BODY_BYTES_MAX: usize = 128 * 1024;

/// Whether the body is small.
pub(super) fn is_light(request: &Request) -> bool {
    request.body().size_hint().upper().is_some_and(|bytes| bytes <= LIGHT_BODY_BYTES_MAX as u64)
}

/// How long a large body waits for its permit.
const PATIENCE: Duration = Duration::from_secs(5);

#[derive(Debug)]
pub(super) struct Bodies {
    limits: Limits,
    all: AtomicUsize,
    /// Bytes of large bodies by group; no entry is 0.
    large: Mutex<HashMap<Group, usize>>,
    /// Permits to handle a large one.
    permits: FairLimit,
}

impl Bodies {
    pub(super) fn new(limits: &Limits) -> Self {
        let shares = Shares::halved(limits.large_bodies_max, limits.large_bodies_waiting_max);
        let shares = Shares { slots_per_member: 1, ..shares };
        Self {
            limits: *limits,
            all: AtomicUsize::new(0),
            large: Mutex::default(),
            permits: FairLimit::new("large_bodies_max", shares, PATIENCE),
        }
    }

    fn large(&self) -> MutexGuard<'_, HashMap<Group, usize>> {
        self.large.lock().expect("nothing panics while it holds this")
    }
}

/// A body that has arrived. Its bytes are counted, and a large one has a permit, until this is dropped.
pub(super) struct Arrived {
    bytes: Bytes,
    _permit: Option<Permit>,
    _counted: Counted,
}

impl Arrived {
    /// The bytes alone, which are counted no more.
    pub(super) fn into_bytes(self) -> Bytes {
        self.bytes
    }
}

impl AsRef<[u8]> for Arrived {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// Bytes of a body that are counted until this is dropped.
struct Counted {
    bodies: Arc<Bodies>,
    group: Group,
    bytes: usize,
    /// How many of them are counted for the group: all of a large body.
    of_group: usize,
}

impl Counted {
    fn new(bodies: &Arc<Bodies>, group: Group) -> Self {
        Self { bodies: Arc::clone(bodies), group, bytes: 0, of_group: 0 }
    }

    fn grow_to(&mut self, bytes: usize) -> Result<(), ApiError> {
        let bodies = &self.bodies;
        let more = bytes - self.bytes;
        self.bytes = bytes;
        let all = bodies.all.fetch_add(more, Ordering::Relaxed) + more;
        let of_group = if bytes > LIGHT_BODY_BYTES_MAX {
            let mut groups = bodies.large();
            let held = groups.entry(self.group).or_default();
            *held += bytes - self.of_group;
            self.of_group = bytes;
            *held
        } else {
            0
        };
        let most = bodies.limits.bodies_bytes_max;
        if most.checked_sub(all).is_some_and(|free| of_group <= free) {
            return Ok(());
        }
        let detail = "too many large bodies arrive at once; send it again later, or in pieces";
        Err(ApiError::limit(Code::Overloaded, "bodies_bytes_max", most, detail)
            .retry_after(Duration::from_secs(1)))
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.bodies.all.fetch_sub(self.bytes, Ordering::Relaxed);
        if self.of_group == 0 {
            return;
        }
        if let Entry::Occupied(mut held) = self.bodies.large().entry(self.group) {
            *held.get_mut() -= self.of_group;
            if *held.get() == 0 {
                held.remove();
            }
        }
    }
}

impl Bodies {
    /// Reads a body of at most `limit` bytes that says it is JSON and is text.
    pub(super) async fn json(
        self: &Arc<Self>,
        request: Request,
        limit: usize,
        limit_name: &str,
    ) -> Result<Arrived, ApiError> {
        let says_json = is_json(request.headers());
        let (bytes, counted) = self.collect(request.into_body(), limit, limit_name).await?;
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
        Ok(Arrived { bytes, _permit: permit, _counted: counted })
    }

    /// Reads a body that is passed on, and that is not large.
    pub(super) async fn light(self: &Arc<Self>, body: Body) -> Result<Arrived, ApiError> {
        let limit = LIGHT_BODY_BYTES_MAX;
        let (bytes, counted) = self.collect(body, limit, "body_bytes_max").await?;
        Ok(Arrived { bytes, _permit: None, _counted: counted })
    }

    async fn collect(
        self: &Arc<Self>,
        body: Body,
        limit: usize,
        limit_name: &str,
    ) -> Result<(Bytes, Counted), ApiError> {
        let mut body = Limited::new(body, limit);
        let mut bytes = BytesMut::new();
        let mut counted = Counted::new(self, Party::current().group);
        let started = Instant::now();
        loop {
            // Most bodies have arrived with their heads, and need no timer.
            let frame = if let Some(frame) = body.frame().now_or_never() {
                Ok(frame)
            } else {
                let late = started + patience(&self.limits, bytes.len());
                tokio::time::timeout_at(late, body.frame()).await
            };
            match frame {
                Ok(Some(Ok(frame))) => {
                    bytes.extend(frame.into_data());
                    counted.grow_to(bytes.len())?;
                }
                Ok(None) => return Ok((bytes.freeze(), counted)),
                Ok(Some(Err(error))) if error.is::<LengthLimitError>() => {
                    let detail = format!("the body has more than {limit} bytes");
                    return Err(ApiError::limit(Code::TooLarge, limit_name, limit, detail));
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

/// The time limit of a body of which `received` bytes have arrived: a large one may be slow, but has to
/// keep coming.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_holds_no_more_bytes_of_large_bodies_than_are_free() {
        let limits = Limits { bodies_bytes_max: 1_000_000, ..Limits::default() };
        let bodies = Arc::new(Bodies::new(&limits));
        let of = |address: u8| Group::Address([192, 0, 2, address].into());
        let arrive = |address, bytes| {
            let mut body = Counted::new(&bodies, of(address));
            body.grow_to(bytes / 2).and_then(|()| body.grow_to(bytes)).map(|()| body)
        };
        let first = arrive(1, 400_000).expect("less than half");
        assert!(arrive(1, 200_000).is_err(), "more than half of all");
        let second = arrive(2, 300_000).expect("as much as is free then");
        assert!(arrive(2, 200_000).is_err(), "more than is free");
        let small: Vec<_> = (0..2).map(|_| arrive(1, LIGHT_BODY_BYTES_MAX)).collect();
        assert!(small.iter().all(Result::is_ok), "small ones pass while there is room");
        assert!(arrive(3, LIGHT_BODY_BYTES_MAX).is_err(), "there is none");
        drop((first, second, small));
        assert_eq!(bodies.all.load(Ordering::Relaxed), 0);
        assert!(bodies.large().is_empty());
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
