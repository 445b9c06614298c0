//! Handles to episodes, for the rest of the server.

use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use jiff::Timestamp;
use swarmbench_engine::{AgentId, World};
use tokio::sync::{Semaphore, mpsc, oneshot, watch};
use tokio_util::sync::CancellationToken;

use super::super::in_flight::{InFlightLimit, InFlightPermits};
use super::super::keyframes::Keyframes;
use super::super::lockstep::{RecordedAct, Submission};
use super::super::snapshot::Snapshot;
use super::super::spec::Spec;
use super::mailbox::{
    ActError, Batch, Claim, ClaimError, Claimed, Earlier, Envelope, Message, Outcomes, Reply, Sent,
    StartError,
};
use super::times::Times;
use crate::budget::Reservation;
use crate::fair::Party;
use crate::ids::{EpisodeId, EpisodeKey, RunKey};
use crate::keys::OwnerKey;
use crate::store::entries::Entry;
use crate::store::port::EpisodeStore;
use crate::store::{Stopped, StoreError};
use swarmbench_clock::Clock;

/// Commands (starts, aborts, claims) in an episode's mailbox at once; further ones wait outside.
pub(super) const COMMANDS_WAITING_MAX: usize = 64;

/// An episode in memory: its description, and the state that its actor updates and its handles read.
pub struct Running {
    pub id: EpisodeId,
    /// Number of the episode in the journal.
    pub key: EpisodeKey,
    /// Key that created the episode, if any.
    pub owner: Option<OwnerKey>,
    /// Run of the episode, if any.
    pub run: Option<RunKey>,
    /// Party for which its work is done.
    pub party: Party,
    pub spec: Arc<Spec>,
    pub created_at: Timestamp,
    pub(in super::super) hosted: OnceLock<Vec<(AgentId, String)>>,
    pub(in super::super) keyframes: Mutex<Keyframes>,
    pub(in super::super) ends_at: AtomicI64,
    pub(in super::super) times: Arc<Times>,
}

/// Handle to an episode in memory. Clones share it.
#[derive(Clone)]
pub struct Handle(pub(super) Arc<Inner>);

pub(super) struct Inner {
    pub(super) episode: Arc<Running>,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) journal: Arc<dyn EpisodeStore>,
    pub(super) mailbox: mpsc::UnboundedSender<Envelope>,
    /// Limits the acts in the mailbox.
    pub(super) in_flight: Arc<InFlightLimit>,
    /// Limits the commands in the mailbox.
    pub(super) commands: Semaphore,
    /// Serializes lookups of acts of past rounds, so that one episode does not occupy all connections to the database.
    pub(super) lookups: tokio::sync::Mutex<()>,
    pub(super) published: watch::Receiver<Arc<Snapshot>>,
    /// Memory of the episode, freed with the last handle.
    pub(super) memory: Arc<Reservation>,
    pub(super) settled: CancellationToken,
    pub(super) gone: CancellationToken,
}

impl std::ops::Deref for Handle {
    type Target = Running;

    fn deref(&self) -> &Running {
        &self.0.episode
    }
}

impl Handle {
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(&self.0.published.borrow())
    }

    /// Follows the published state.
    pub fn follow(&self) -> watch::Receiver<Arc<Snapshot>> {
        self.0.published.clone()
    }

    /// Submits acts for several seats. The outcomes come in the same order, once they are durable.
    pub async fn submit(&self, acts: Vec<(AgentId, Submission)>) -> Outcomes {
        let at = self.0.clock.now();
        let round = self.snapshot().world.round();
        let mut outcomes: Outcomes = acts.iter().map(|_| Err(ActError::Busy)).collect();
        let (mut permits, refused) = self.0.in_flight.take(acts.iter().map(|(agent, _)| *agent));
        let (now, past): (Vec<Sent>, Vec<Sent>) = (acts.into_iter().enumerate())
            .filter(|(_, (agent, _))| refused.binary_search(agent).is_err())
            .map(|(place, (agent, submission))| Sent {
                place,
                agent,
                submission,
                earlier: Earlier::Unknown,
            })
            .partition(|sent| sent.submission.round >= round);
        let permits_of_now = permits.split(now.iter().map(|sent| sent.agent));
        // Acts that may decide a round wait for nothing.
        let late =
            self.send_batch(at, Batch { acts: now, permits: permits_of_now }, &mut outcomes).await;
        if !past.is_empty() || !late.is_empty() {
            Box::pin(self.submit_past(at, (past, late), permits, &mut outcomes)).await;
        }
        outcomes
    }

    /// Submits acts for rounds that were over before they were sent (`past`), and for rounds that were over when they arrived
    /// (`late`).
    async fn submit_past(
        &self,
        at: Timestamp,
        (past, late): (Vec<Sent>, Vec<Sent>),
        permits: InFlightPermits,
        outcomes: &mut Outcomes,
    ) {
        if !late.is_empty()
            && let Err(error) = self.0.journal.keep(Vec::new()).await
        {
            // Their rounds were on the way to the disk, and the lookups must include them.
            for sent in &late {
                outcomes[sent.place] = Err(error.clone().into());
            }
            return;
        }
        let mut batch = Batch { acts: Vec::new(), permits };
        for mut sent in past.into_iter().chain(late) {
            match self.earlier(&sent).await {
                Ok(earlier) => {
                    sent.earlier = Earlier::Found(earlier);
                    batch.acts.push(sent);
                }
                Err(error) => outcomes[sent.place] = Err(error.into()),
            }
        }
        self.send_batch(at, batch, outcomes).await;
    }

    /// Hands acts to the actor and notes their outcomes. Returns the acts that arrived after the end of their round.
    async fn send_batch(&self, at: Timestamp, batch: Batch, outcomes: &mut Outcomes) -> Vec<Sent> {
        if batch.acts.is_empty() {
            return Vec::new();
        }
        let places: Vec<usize> = batch.acts.iter().map(|sent| sent.place).collect();
        let (reply, replies) = oneshot::channel();
        // Without an actor the reply is dropped.
        drop(self.0.mailbox.send((at, Message::Submit { batch, reply })));
        let Ok(replies) = replies.await else {
            for place in places {
                outcomes[place] = Err(gone().into());
            }
            return Vec::new();
        };
        let mut late = Vec::new();
        for (place, reply) in replies {
            match reply {
                Reply::Outcome(outcome) => outcomes[place] = outcome,
                Reply::Late(sent) => late.push(sent),
            }
        }
        late
    }

    /// Act of a seat in a round that is over and durable.
    async fn earlier(&self, sent: &Sent) -> Result<Option<RecordedAct>, StoreError> {
        let _lookup = self.0.lookups.lock().await;
        let act = self.0.journal.act(self.key, sent.submission.round, sent.agent).await?;
        let recorded = act.map(|act| RecordedAct::stored(act, &self.spec.config)).transpose();
        recorded.map_err(StoreError::broken)
    }

    /// Claims open seats, durably. With the last open seat the episode starts, unless its creator wants to start it.
    pub async fn claim(&self, claim: Claim) -> Result<Claimed, ClaimError> {
        self.command(|reply| Message::Claim { claim: Box::new(claim), reply }).await
    }

    /// Starts a waiting episode; nothing changes where it has started.
    pub async fn start(&self) -> Result<(), StartError> {
        self.command(|reply| Message::Start { reply }).await
    }

    /// Aborts the episode; nothing changes where it has ended.
    pub async fn abort(&self) -> Result<(), StoreError> {
        self.abort_with(Vec::new()).await
    }

    /// Aborts the episode and stores audit entries in the same transaction; stores nothing where the episode has ended.
    pub async fn abort_with(&self, audit_entries: Vec<Entry>) -> Result<(), StoreError> {
        self.command(|reply| Message::Abort { audit_entries, reply }).await
    }

    async fn command<T, E: From<StoreError>>(
        &self,
        message: impl FnOnce(oneshot::Sender<Result<T, E>>) -> Message,
    ) -> Result<T, E> {
        let _permit = self.0.commands.acquire().await;
        let (reply, done) = oneshot::channel();
        drop(self.0.mailbox.send((self.0.clock.now(), message(reply))));
        done.await.unwrap_or_else(|_| Err(gone().into()))
    }

    /// Seats that the server plays, with the names of their players; none before the start.
    pub fn hosted(&self) -> &[(AgentId, String)] {
        self.hosted.get().map_or(&[], Vec::as_slice)
    }

    /// Latest keyframe of `round` or an earlier round.
    pub fn keyframe(&self, round: u32) -> Arc<World> {
        self.keyframes.lock().expect("nothing panics while it holds this").before(round)
    }

    /// Time at which the episode ends without a request.
    pub(in super::super) fn ends_at(&self) -> Timestamp {
        Timestamp::from_millisecond(self.ends_at.load(Ordering::Acquire)).unwrap_or(Timestamp::MAX)
    }

    /// Times of the episode, which outlive it in the registry.
    pub(in super::super) fn times(&self) -> Arc<Times> {
        Arc::clone(&self.times)
    }

    /// Party to whose share the memory belongs, if to any.
    pub(in super::super) fn memory_party(&self) -> Option<Party> {
        self.0.memory.party()
    }

    /// Waits until work that was due when the actor started is durable and published, or has failed. Until then nobody may see the
    /// episode: it may have ended.
    pub(in super::super) async fn settled(&self) {
        self.0.settled.cancelled().await;
    }

    /// Cancelled when the actor has ended and hands nothing more to the journal.
    pub(in super::super) fn gone(&self) -> CancellationToken {
        self.0.gone.clone()
    }

    /// Whether the actor has ended before the episode: after a refused entry, or a fault.
    pub(crate) fn is_dead(&self) -> bool {
        self.0.gone.is_cancelled() && !self.snapshot().status.is_over()
    }

    /// Whether other handles exist.
    pub(in super::super) fn is_shared(&self) -> bool {
        Arc::strong_count(&self.0) > 1
    }
}

/// Error of a request that the actor no longer answers.
pub(super) fn gone() -> StoreError {
    StoreError::Stopped(Stopped::Episode)
}
