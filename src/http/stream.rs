//! Answers of any length, made and sent part by part.
//!
//! A part is made in a turn (a permit, of which there are few) and in memory that is reserved. The turn ends before
//! the part is sent, so a slow reader holds its own part and nothing that others wait for. No part is made for a
//! client that is gone: the stream is dropped with the connection.

use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use bytes::Bytes;
use futures::stream;
use tokio::sync::OwnedSemaphorePermit;

use super::App;
use super::error::{ApiError, Code};
use crate::budget::{Reservation, SMALL_BYTES};
use crate::journal::JournalError;

/// How long a request waits for its first turn.
const PATIENCE: Duration = Duration::from_secs(5);

/// Where parts come from.
pub(super) trait Parts: Send + 'static {
    /// The next part, of about `bytes_max` bytes and at most one record more; none at the end.
    fn next(
        &mut self,
        bytes_max: usize,
    ) -> impl Future<Output = Result<Option<Vec<u8>>, JournalError>> + Send;
}

/// Bytes with the memory that is reserved for them; both go when the bytes are sent.
struct Reserved {
    bytes: Vec<u8>,
    _room: Reservation,
}

impl AsRef<[u8]> for Reserved {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl App {
    /// Makes the first part of an answer, and each further one when the client has taken those before it.
    pub(super) async fn in_parts(&self, mut parts: impl Parts) -> Result<Body, ApiError> {
        let turn = tokio::time::timeout(PATIENCE, self.journal_turn()).await;
        let most = self.limits.journals_max;
        let turn = turn.map_err(|_| {
            let detail = format!("{most} journals are being read already; come again later");
            ApiError::limit(Code::Overloaded, "journals_max", most, detail)
                .retry_after(Duration::from_secs(1))
        })?;
        let first = self.part(turn, &mut parts).await?;
        let app = self.clone();
        let rest = stream::try_unfold((app, parts, first), |(app, mut parts, ready)| async move {
            let part = match ready {
                Some(ready) => Some(ready),
                None => app.part(app.journal_turn().await, &mut parts).await?,
            };
            Ok::<_, JournalError>(part.map(|part| (part, (app, parts, None))))
        });
        Ok(Body::from_stream(rest))
    }

    /// A turn to read a part of a journal.
    async fn journal_turn(&self) -> OwnedSemaphorePermit {
        let turn = Arc::clone(&self.journals).acquire_owned().await;
        turn.expect("nobody closes it")
    }

    /// Makes one part. Where no memory is free it is a small one.
    async fn part(
        &self,
        _turn: OwnedSemaphorePermit,
        parts: &mut impl Parts,
    ) -> Result<Option<Bytes>, JournalError> {
        let most = self.limits.stream_part_bytes_max;
        let room = self
            .registry
            .room(most)
            .unwrap_or_else(|_| self.registry.budget().take(most.min(SMALL_BYTES)));
        let Some(bytes) = parts.next(room.bytes()).await? else { return Ok(None) };
        room.resize(bytes.capacity());
        Ok(Some(Bytes::from_owner(Reserved { bytes, _room: room })))
    }
}
