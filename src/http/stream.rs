//! Answers of any length, made and sent part by part; and the memory of large answers.
//!
//! A part is made with a permit, of which there are few, and in memory that is reserved. The permit is returned before
//! the part is sent, so a slow reader holds its own part and nothing that others wait for. No part is made for a
//! client that is gone: the stream is dropped with the connection.

use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::BoxError;
use axum::body::{Body, HttpBody};
use axum::extract::{Request, State};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures::stream;
use hyper::body::{Frame, SizeHint};

use super::App;
use super::error::{ApiError, Code};
use super::limits::{Limits, STREAMS_WAITING_MAX, STREAMS_WAITING_PER_GROUP_MAX};
use crate::budget::{Reservation, SMALL_BYTES};
use crate::fair::{Busy, FairLimit, Party, Permit, Rank, Shares};
use crate::store;
use crate::store::StoreError;

/// How long a request waits for a permit.
const PATIENCE: Duration = Duration::from_secs(5);

/// After how long a stream asks for its permit again, where too many wait.
const AGAIN: Duration = Duration::from_millis(500);

/// Where parts come from.
pub(super) trait Parts: Send + 'static {
    /// The next part, of about `bytes_max` bytes and at most one record more; none at the end.
    fn next(
        &mut self,
        bytes_max: usize,
    ) -> impl Future<Output = Result<Option<Vec<u8>>, StoreError>> + Send;
}

/// What streams share.
#[derive(Debug)]
pub(super) struct Streams {
    /// Permits to read a part of a journal.
    journals: FairLimit,
    /// Permits to make a piece of an export.
    pub(super) exports: FairLimit,
    /// Exports that are made or wait for their readers.
    pub(super) exports_open: StreamLimit,
    /// Event streams that are open.
    pub(super) events: StreamLimit,
}

/// Bounds what stays open for long: in all, and for each party.
#[derive(Debug)]
pub(super) struct StreamLimit {
    limit: FairLimit,
    /// What is open, for the text of the error.
    what: &'static str,
    of_a_party: (&'static str, usize),
}

impl StreamLimit {
    fn new(
        name: &'static str,
        most: usize,
        what: &'static str,
        of_a_party: (&'static str, usize),
    ) -> Self {
        // The client tries again later: it may take long until a permit is free.
        let patience = Duration::from_millis(100);
        let limit = FairLimit::new(name, shares(most, of_a_party.1), patience);
        Self { limit, what, of_a_party }
    }

    /// A permit for the party.
    pub(super) async fn take(&self, party: Party) -> Result<Permit, ApiError> {
        let permit = self.limit.acquire(party, Rank::Normal).await;
        permit.map_err(|busy| {
            let (name, slots) = self.of_a_party;
            let is_full = self.limit.load().0 >= busy.slots;
            refused(if is_full { busy } else { Busy { name, slots } }, self.what)
        })
    }
}

impl Streams {
    pub(super) fn new(limits: &Limits) -> Self {
        let turns = |name, slots| FairLimit::new(name, shares(slots, slots), PATIENCE);
        Self {
            journals: turns("journals_max", limits.journals_max),
            exports: turns("exports_max", limits.exports_max),
            exports_open: StreamLimit::new(
                "exports_open_max",
                limits.exports_open_max,
                "exports are open",
                ("exports_open_per_party_max", limits.exports_open_per_party_max),
            ),
            events: StreamLimit::new(
                "event_streams_max",
                limits.event_streams_max,
                "event streams are open",
                ("event_streams_per_party_max", limits.event_streams_per_party_max),
            ),
        }
    }
}

/// A member of a group gets so many slots, the group at least as many, and otherwise half of all.
fn shares(slots: usize, of_a_member: usize) -> Shares {
    Shares {
        slots,
        reserve: 0,
        slots_per_group: of_a_member.max(slots.div_ceil(2)),
        slots_per_member: of_a_member,
        waiting: STREAMS_WAITING_MAX,
        waiting_per_group: STREAMS_WAITING_PER_GROUP_MAX,
    }
}

/// A permit, however long that takes.
pub(super) async fn patiently(limit: &FairLimit, party: Party) -> Permit {
    loop {
        match limit.acquire(party, Rank::Normal).await {
            Ok(permit) => return permit,
            Err(_) => tokio::time::sleep(AGAIN).await,
        }
    }
}

/// The answer to a request for which no permit is free.
pub(super) fn refused(busy: Busy, what: &str) -> ApiError {
    let Busy { name, slots } = busy;
    let detail =
        format!("the maximum number of {what} is reached ({name} is {slots}); try again later");
    ApiError::limit(Code::Overloaded, name, slots, detail).retry_after(PATIENCE)
}

/// Bytes with the memory that is reserved for them; both go when the bytes are sent.
struct Reserved<T> {
    bytes: T,
    _room: Reservation,
}

impl<T: AsRef<[u8]>> AsRef<[u8]> for Reserved<T> {
    fn as_ref(&self) -> &[u8] {
        self.bytes.as_ref()
    }
}

impl App {
    /// Makes the first part of an answer, and each further one when the client has taken those before it.
    pub(super) async fn in_parts(&self, mut parts: impl Parts) -> Result<Body, ApiError> {
        let party = Party::current();
        let turn = self.streams.journals.acquire(party, Rank::Normal).await;
        let turn = turn.map_err(|busy| refused(busy, "journals are being read"))?;
        let first = self.part((party, turn), &mut parts).await?;
        let app = self.clone();
        let rest = stream::try_unfold((parts, first), move |(mut parts, ready)| {
            let app = app.clone();
            async move {
                if ready.is_some() {
                    return Ok(ready.map(|part| (part, (parts, None))));
                }
                let workers = app.workers.clone();
                let next = async move {
                    let turn = patiently(&app.streams.journals, party).await;
                    let part = store::patiently(app.part((party, turn), &mut parts)).await?;
                    Ok::<_, BoxError>(part.map(|part| (part, (parts, None))))
                };
                workers.in_background(next).await?
            }
        });
        Ok(Body::from_stream(rest))
    }

    /// Makes one part in its turn. Where no memory is free it is a small one.
    async fn part(
        &self,
        (party, _turn): (Party, Permit),
        parts: &mut impl Parts,
    ) -> Result<Option<Bytes>, StoreError> {
        let most = self.limits.stream_part_bytes_max;
        let small = |_| self.registry.budget().take(most.min(SMALL_BYTES), None);
        let room = self.registry.room(most).unwrap_or_else(small);
        // The connection's own task does not know for whom it works.
        let next = Rank::Normal.scope(party.scope(parts.next(room.bytes())));
        let Some(bytes) = next.await? else { return Ok(None) };
        room.resize(bytes.capacity());
        Ok(Some(Bytes::from_owner(Reserved { bytes, _room: room })))
    }
}

/// Reserves the memory of a large answer until it is sent. Where none is free, what was only read is refused.
pub(super) async fn reserve(State(app): State<App>, request: Request, next: Next) -> Response {
    let is_read = request.method() == Method::GET;
    let response = next.run(request).await;
    let Some(bytes) = response.body().size_hint().exact() else { return response };
    let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
    if bytes <= SMALL_BYTES {
        return response;
    }
    let room = match app.registry.room(bytes) {
        Ok(room) => room,
        Err(full) if is_read => return ApiError::from(full).into_response(),
        Err(_) => app.registry.budget().take(bytes, None),
    };
    response.map(|body| Body::new(Large { body, room: Some(room) }))
}

/// A large body; its memory goes with its bytes.
struct Large {
    body: Body,
    room: Option<Reservation>,
}

impl HttpBody for Large {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let polled = Pin::new(&mut self.body).poll_frame(context);
        polled.map_ok(|frame| {
            // It has one frame of data: only what was written out whole has an exact size.
            frame.map_data(|bytes| match self.room.take() {
                Some(room) => Bytes::from_owner(Reserved { bytes, _room: room }),
                None => bytes,
            })
        })
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
