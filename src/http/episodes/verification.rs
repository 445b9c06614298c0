//! `GET /api/v1/episodes/{id}/verification`: the journal, played again by the server.

use std::sync::Arc;

use axum::Json;
use quick_cache::sync::Cache;
use swarmbench_engine::RULES_REVISION;
use swarmbench_engine::physics::Solver;

use super::super::prelude::*;
use super::super::stream::Parts;
use super::journal::JournalReader;
use crate::episode::heavy::off_thread;
use crate::fair::{Party, Rank};
use crate::ids::EpisodeKey;
use crate::store::port::StoredEpisode;
use crate::work::Cancelled;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::{Fault, Verifier};
use swarmbench_protocol::replay::Verification;

/// Verifications that are cached.
pub(in super::super) const VERIFICATIONS_MAX: usize = 4096;

/// Verified journals by episode and head.
pub(in super::super) type Verifications = Cache<(EpisodeKey, Head), Arc<Verification>>;

/// Verify an episode: the server plays its journal again.
///
/// The server checks every hash, digest, act and score; before the end, those of the resolved rounds. It verifies each head of
/// the hash chain once. Whoever may read the journal may request it; `swarmbench verify` does the same with a file.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/verification",
    operation_id = "show_verification",
    tag = "episodes",
    responses(
        (status = 200, description = "The result of the verification", body = Verification),
        (status = 403, description = "`forbidden`: only the creator may read the journal before the end"),
        (status = 503, description = "`overloaded`: too many episodes are being replayed"),
    )
)]
pub(in super::super) async fn show_verification(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<Verification>, ApiError> {
    let stored = app.journaled_episode(&caller, id).await?;
    let verify = async { Ok::<_, ApiError>(Arc::new(app.verify(stored.clone()).await?)) };
    let key = (stored.episode, stored.head);
    let found = app.verifications.get_or_insert_async(&key, verify).await?;
    Ok(Json(Verification::clone(&found)))
}

/// A journal as far as it was checked, and the beginning of its next line.
struct Checked {
    verifier: Verifier,
    line: Vec<u8>,
    fault: Option<Fault>,
}

impl Checked {
    /// Checks the lines that a part completes, up to the first fault.
    fn add(mut self, part: &[u8], cancelled: &Cancelled<'_>) -> Self {
        for piece in part.split_inclusive(|byte| *byte == b'\n') {
            self.line.extend_from_slice(piece);
            if !piece.ends_with(b"\n") || cancelled.is_cancelled() {
                break;
            }
            self.fault = self.verifier.line(&self.line, |_, _| ()).err();
            if self.fault.is_some() {
                break;
            }
            self.line.clear();
        }
        self
    }
}

impl App {
    /// Plays the journal again as far as `stored` tells of it.
    async fn verify(&self, stored: StoredEpisode) -> Result<Verification, ApiError> {
        let part_bytes = self.limits.stream_part_bytes_max;
        let memory = self.registry.room(part_bytes)?;
        let _permit = self.heavy.replay().await?;
        let (id, head) = (stored.id.to_string(), stored.head);
        let mut journal = JournalReader::new(self.store.clone(), stored);
        let verifier = Verifier::new(Solver::Flow);
        let mut checked = Checked { verifier, line: Vec::new(), fault: None };
        let share = (Party::current(), Rank::Normal);
        while checked.fault.is_none()
            && let Some(part) = journal.next(part_bytes).await?
        {
            memory.resize(part.capacity() + checked.line.len());
            let check = move |cancelled: &Cancelled<'_>| checked.add(&part, cancelled);
            checked = off_thread(&self.workers, "verify", share, true, check).await?;
        }
        let Checked { verifier, fault, .. } = checked;
        Ok(verification(id, head, verifier, fault))
    }
}

fn verification(id: String, head: Head, verifier: Verifier, fault: Option<Fault>) -> Verification {
    let world = verifier.world();
    let (rounds, score) = world.map_or((0, 0.0), |world| (world.round(), world.score()));
    let final_digest = world.map(|world| world.digest().to_string());
    let report = match fault {
        None => verifier.finish(Some(head)),
        Some(fault) => Err(fault),
    };
    let layout_digest = report.as_ref().ok().map(|report| report.opening.digest.clone());
    Verification {
        episode: id,
        ok: report.is_ok(),
        problem: report.as_ref().err().map(ToString::to_string),
        rounds,
        score,
        journal_head: head.to_string(),
        layout_digest,
        final_digest: final_digest.filter(|_| report.is_ok()),
        rules_revision: RULES_REVISION,
        version: env!("CARGO_PKG_VERSION").to_owned(),
    }
}
