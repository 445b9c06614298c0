//! Responses of any length, made and sent part by part; and the memory of large responses.
//!
//! A part is made with a permit, of which there are few, and in reserved memory. The permit is returned before the part is sent, so
//! a slow reader holds only its own part. The stream is dropped with the connection, so no part is made for a client that is gone.

use std::sync::Arc;
use std::time::Duration;

use axum::BoxError;
use axum::body::{Body, HttpBody, to_bytes};
use axum::response::Response;
use bytes::Bytes;
use futures::stream;

use super::error::{ApiError, Code};
use super::limits::Limits;
use crate::budget::{Budget, Exhausted, Reservation, SMALL_BYTES};
use crate::episode::registry::Registry;
use crate::fair::{Busy, FairLimit, Party, Permit, Rank, Shares};
use crate::store;
use crate::store::StoreError;
use crate::work::Workers;

/// Time that a request waits for a permit.
const PERMIT_TIMEOUT: Duration = Duration::from_secs(5);

/// Time after which a stream asks again for a permit when too many wait.
const AGAIN: Duration = Duration::from_millis(500);

pub(super) trait Parts: Send + 'static {
    /// The next part, of about `bytes_max` bytes and at most one record more; none at the end.
    fn next(
        &mut self,
        bytes_max: usize,
    ) -> impl Future<Output = Result<Option<Vec<u8>>, StoreError>> + Send;
}

pub(super) struct Streams {
    registry: Registry,
    workers: Workers,
    part_bytes_max: usize,
    /// Permits to make a part of a journal or of an export.
    pub(super) parts: FairLimit,
    /// Exports that are being made or wait for their readers.
    pub(super) exports: Arc<Budget>,
    /// Open event streams.
    pub(super) events: Arc<Budget>,
}

/// Divisor of a limit that gives the streams which organizers and judges may open in addition.
const OVERSEERS_PART: usize = 4;

impl Streams {
    pub(super) fn new(registry: Registry, workers: Workers, limits: &Limits) -> Self {
        let open = |name, most: usize| Budget::new(name, most, most.div_ceil(OVERSEERS_PART));
        let shares = Shares::halved(limits.heavy_at_once_max);
        Self {
            registry,
            workers,
            part_bytes_max: limits.stream_part_bytes_max,
            parts: FairLimit::heavy(shares, PERMIT_TIMEOUT),
            exports: open("exports_open_max", limits.exports_open_max),
            events: open("event_streams_max", limits.event_streams_max),
        }
    }
}

/// A permit, awaited as long as necessary.
pub(super) async fn patiently(limit: &FairLimit, party: Party) -> Permit {
    loop {
        match limit.acquire(party, Rank::Normal).await {
            Ok(permit) => return permit,
            Err(_) => tokio::time::sleep(AGAIN).await,
        }
    }
}

/// Refusal of a request for which no permit is free.
pub(super) fn refused(busy: Busy) -> ApiError {
    let detail = "too many journals and exports are being read at once; try again later";
    ApiError::no_permit(busy, detail).retry_after(PERMIT_TIMEOUT)
}

/// Bytes with the reservation of their memory; both are released when the bytes are sent.
struct Reserved<T, R> {
    bytes: T,
    _room: R,
}

impl<T: AsRef<[u8]>, R> AsRef<[u8]> for Reserved<T, R> {
    fn as_ref(&self) -> &[u8] {
        self.bytes.as_ref()
    }
}

impl Streams {
    /// Makes the first part of a response at once, and each further one after the client has taken those before it.
    pub(super) async fn in_parts(
        self: &Arc<Self>,
        mut parts: impl Parts,
    ) -> Result<Body, ApiError> {
        let party = Party::current();
        let permit = self.parts.acquire(party, Rank::Normal).await.map_err(refused)?;
        let first = self.part((party, permit), &mut parts).await?;
        let streams = Arc::clone(self);
        let rest = stream::try_unfold((parts, first), move |(mut parts, ready)| {
            let streams = Arc::clone(&streams);
            async move {
                if ready.is_some() {
                    return Ok(ready.map(|part| (part, (parts, None))));
                }
                let workers = streams.workers.clone();
                let next = async move {
                    let permit = patiently(&streams.parts, party).await;
                    let part = streams.part((party, permit), &mut parts);
                    let part = store::patiently(part).await?;
                    Ok::<_, BoxError>(part.map(|part| (part, (parts, None))))
                };
                workers.in_background(next).await?
            }
        });
        Ok(Body::from_stream(rest))
    }

    /// Makes one part: a small one if no memory is free.
    async fn part(
        &self,
        (party, _permit): (Party, Permit),
        parts: &mut impl Parts,
    ) -> Result<Option<Bytes>, StoreError> {
        let most = self.part_bytes_max;
        let small = |_| self.registry.budget().take(most.min(SMALL_BYTES), None);
        let room = self.registry.room(most).unwrap_or_else(small);
        // The connection's own task has no party.
        let next = Rank::Normal.scope(party.scope(parts.next(room.amount())));
        let Some(bytes) = next.await? else { return Ok(None) };
        room.resize(bytes.capacity());
        Ok(Some(Bytes::from_owner(Reserved { bytes, _room: room })))
    }
}

/// Maximum bytes of a response that reserves no memory, as each connection is counted with that many.
const FREE_ANSWER_BYTES: usize = 16 * 1024;

/// Part of the memory that large responses may have together. Each party has its share of it, apart from its share for games.
const ANSWERS_PART: usize = 2;

/// Memory of large responses until they are sent.
pub(super) struct Answers {
    registry: Registry,
    large: Arc<Budget>,
}

/// A shorter form of a response, sent where no memory is free for all of it: the receipts of durable acts.
#[derive(Clone)]
pub(super) struct Short(Bytes);

impl Short {
    /// Adds a shorter form to a response that needs memory.
    pub(super) fn of(mut response: Response, short: impl FnOnce() -> Vec<u8>) -> Response {
        if reserved_bytes(&response).is_some() {
            response.extensions_mut().insert(Self(short().into()));
        }
        response
    }
}

/// Bytes that a response reserves. A response without an exact size is sent in parts that reserve their own memory.
fn reserved_bytes(response: &Response) -> Option<usize> {
    let bytes = response.body().size_hint().exact()?;
    let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
    (bytes > FREE_ANSWER_BYTES).then_some(bytes)
}

impl Answers {
    pub(super) fn new(registry: Registry, limits: &Limits) -> Self {
        let most = limits.memory_bytes_max / ANSWERS_PART;
        Self { registry, large: Budget::new("memory_bytes_max", most, 0) }
    }

    /// Reserves the memory of a large response until it is sent. If none is free, its shorter form is sent; without one, the response
    /// to a repeatable request is refused.
    pub(super) async fn reserve(
        &self,
        is_repeatable: bool,
        mut response: Response,
    ) -> Result<Response, ApiError> {
        let Some(mut bytes) = reserved_bytes(&response) else { return Ok(response) };
        let mut rooms = self.rooms(bytes);
        if rooms.is_err()
            && let Some(Short(short)) = response.extensions_mut().remove()
        {
            bytes = short.len();
            *response.body_mut() = short.into();
            if bytes <= FREE_ANSWER_BYTES {
                return Ok(response);
            }
            rooms = self.rooms(bytes);
        }
        let rooms = match rooms {
            Ok(rooms) => rooms,
            Err(full) if is_repeatable => return Err(full.into()),
            // What was created cannot be refused any more: the response may have its only tokens.
            Err(_) => {
                let large = self.large.take(bytes, Some(Party::current()));
                (self.registry.budget().take(bytes, None), Some(large))
            }
        };
        let (parts, body) = response.into_parts();
        let bytes = whole(body).await?;
        Ok(Response::from_parts(parts, Bytes::from_owner(Reserved { bytes, _room: rooms }).into()))
    }

    fn rooms(&self, bytes: usize) -> Result<(Reservation, Option<Reservation>), Exhausted> {
        let share = || self.large.reserve(bytes, Some(Party::current()), Rank::Normal);
        let large = (bytes > SMALL_BYTES).then(share).transpose()?;
        Ok((self.registry.room(bytes)?, large))
    }
}

/// Collects the body of a response that was made as a whole.
pub(super) async fn whole(body: Body) -> Result<Bytes, ApiError> {
    let bytes = to_bytes(body, usize::MAX).await;
    bytes.map_err(|error| ApiError::new(Code::Internal, error.to_string()))
}
