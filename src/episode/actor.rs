//! One task an episode: it performs what [`lockstep`](super::lockstep) says.
//!
//! Only the actor steps the engine. What an event leads to goes to the journal in one piece: an act,
//! and with the last act of a round the resolved round and perhaps the end. The commit that holds it
//! publishes the new state and then sends the receipts, so a client with a receipt finds the state that
//! goes with it, and nothing is shown or acknowledged that could be lost.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, Weak};
use std::time::Duration;

use futures::future::BoxFuture;
use jiff::Timestamp;
use swarmbench_engine::{AgentId, World};
use tokio::sync::{Semaphore, mpsc, oneshot, watch};
use tokio_util::sync::{CancellationToken, DropGuard};

use super::heavy::{self, off_thread, step_micros};
use super::in_flight::{InFlightLimit, InFlightPermits, SEAT_ACTS_WAITING_MAX};
use super::lockstep::{Effect, Event, Lockstep, Receipt, RecordedAct, Refusal, Submission};
use super::memory;
use super::quota::Quotas;
use super::replay::Replays;
use super::seating::{SeatTaken, Seating, Wanted};
use super::spec::{Spec, Visibility};
use super::{Ending, Snapshot, Status};
use crate::budget::{Budget, Reservation};
use crate::clock::{Clock, after};
use crate::fair::{Group, Party, Rank};
use crate::ids::{EpisodeId, EpisodeKey, RunKey, TokenHash};
use crate::journal::Tally;
use crate::journal::chain::Head;
use crate::journal::record::{ActRecord, End, RawRecord, Record, Source, round_record};
use crate::journal::replay::acts_of;
use crate::keys::OwnerKey;
use crate::store::entries::{
    ActRow, ClaimRow, EndRow, Entry, Holder, RoundRow, SeatingRow, TokenRow,
};
use crate::store::port::{EpisodeStore, StoredEpisode};
use crate::store::{Stopped, StoreError};
use crate::work::{Cancelled, Workers};

/// Commands (starts, aborts, claims) that lie in an episode's mailbox at once; others wait for that.
const COMMANDS_WAITING_MAX: usize = 64;

/// Bytes of text that are written to a round's record, and hashed, in a microsecond.
const TEXT_BYTES_PER_MICRO: u64 = 100;

/// Bytes of records that an actor writes in one piece, before others have their turn on its thread.
const PIECE_BYTES: u64 = 256 * 1024;

/// After how long an actor looks at the time of day again, where something waits for it.
const LOOKS_AGAIN_AFTER: Duration = Duration::from_secs(10);

/// Why an act was not acknowledged.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ActError {
    /// By the rules of the barrier.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Too many acts of the same seat wait already.
    #[error("the maximum of {SEAT_ACTS_WAITING_MAX} acts of this seat already wait for an answer")]
    Busy,
    /// It could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

/// What each of several acts came to, in their order.
pub type Outcomes = Vec<Result<Receipt, ActError>>;

/// Why an episode was not started.
#[derive(Clone, Debug, thiserror::Error)]
pub enum StartError {
    /// It cannot begin yet.
    #[error("{0} of its seats are still open")]
    SeatsOpen(u16),
    /// It could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

/// A claim of seats.
#[derive(Clone, Debug)]
pub struct Claim {
    /// Who; the number and the time are not known yet.
    pub holder: Holder,
    /// Which seats.
    pub wanted: Wanted,
    /// The hashes of as many seat tokens as there are seats wanted.
    pub seats: Vec<TokenHash>,
    /// The hash of the token for all of them.
    pub swarm: TokenHash,
    /// The key by which a repeated claim finds it, and the hash of the body.
    pub idempotency: Option<(String, [u8; 32])>,
}

/// The result of a claim.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claimed {
    /// The number of the claim in its episode.
    pub number: u32,
    /// The seats, in the order of the tokens.
    pub agents: Vec<AgentId>,
}

/// Why a claim was refused.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ClaimError {
    /// The seats have holders, or there never were open ones.
    #[error(transparent)]
    SeatTaken(#[from] SeatTaken),
    /// The episode has ended.
    #[error("the episode has ended")]
    Over,
    /// It could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

enum Message {
    Submit { batch: Batch, reply: oneshot::Sender<Vec<(usize, Reply)>> },
    Start { reply: oneshot::Sender<Result<(), StartError>> },
    Abort { audit_entries: Vec<Entry>, reply: oneshot::Sender<Result<(), StoreError>> },
    Claim { claim: Box<Claim>, reply: oneshot::Sender<Result<Claimed, ClaimError>> },
}

/// Acts on their way to the actor, with their permits.
struct Batch {
    acts: Vec<Sent>,
    permits: InFlightPermits,
}

/// An act in flight.
struct Sent {
    /// Its place among the acts of the call.
    place: usize,
    agent: AgentId,
    submission: Submission,
    earlier: Earlier,
}

/// What a seat did in a round that is over.
#[expect(clippy::large_enum_variant, reason = "an act that comes with it is larger still")]
enum Earlier {
    /// Not looked up yet.
    Unknown,
    /// The result of the lookup.
    Found(Option<RecordedAct>),
}

/// The reply to an act.
#[expect(clippy::large_enum_variant, reason = "nearly all are outcomes")]
enum Reply {
    Outcome(Result<Receipt, ActError>),
    /// Its round is over: the caller has to look up what the seat did then. The actor does not, as all
    /// others would wait for it.
    Late(Sent),
}

/// A message with its arrival time: its wait in the mailbox costs no player time.
type Envelope = (Timestamp, Message);

/// Starts a task that runs on its own.
pub type Spawn = Arc<dyn Fn(BoxFuture<'static, ()>) + Send + Sync>;

/// What all actors of a server share.
#[derive(Clone)]
pub struct Host {
    /// Where entries are stored.
    pub journal: Arc<dyn EpisodeStore>,
    /// Where the time comes from.
    pub clock: Arc<dyn Clock>,
    /// What runs the actors.
    pub spawn: Spawn,
    /// Per-owner quotas.
    pub quotas: Arc<Quotas>,
    /// The memory that worlds and answers may take together.
    pub budget: Arc<Budget>,
    /// What does heavy work.
    pub workers: Workers,
    /// Replays of earlier rounds.
    pub replays: Arc<Replays>,
    /// Notified of every run of which an episode has ended, durably.
    pub ended: mpsc::UnboundedSender<RunKey>,
    /// Notified of every recovered episode of which the server may play seats.
    pub hosted: mpsc::UnboundedSender<Handle>,
}

impl Host {
    /// For whom the work of an episode is done: for the entrant of a competition, else for the holder of the
    /// key with which it was created.
    pub(super) async fn party(
        &self,
        owner: Option<OwnerKey>,
        run: Option<RunKey>,
        spec: &Spec,
    ) -> Result<Party, StoreError> {
        // The games of competitions, and no others, are sealed.
        if let Some(run) = run.filter(|_| spec.visibility == Visibility::Sealed)
            && let Some((competition, owner)) = self.journal.entrant(run).await?
        {
            return Ok(Party::entrant(competition, owner));
        }
        Ok(owner.map_or(Party::SERVER, |owner| Party::of(Group::Owner(owner))))
    }
}

/// An episode as others see it. Cloning shares it.
#[derive(Clone)]
pub struct Handle(Arc<Running>);

/// See [`Handle`].
pub struct Running {
    /// Its public id.
    pub id: EpisodeId,
    /// Its number in the journal.
    pub key: EpisodeKey,
    /// The key with which it was created, if any.
    pub owner: Option<OwnerKey>,
    /// The run to which it belongs, if any.
    pub run: Option<RunKey>,
    /// For whom its work is done.
    pub party: Party,
    /// What it is.
    pub spec: Arc<Spec>,
    /// When it was created.
    pub created_at: Timestamp,
    clock: Arc<dyn Clock>,
    journal: Arc<dyn EpisodeStore>,
    mailbox: mpsc::UnboundedSender<Envelope>,
    /// Bounds the acts in the mailbox.
    in_flight: Arc<InFlightLimit>,
    /// Bounds everything else in it.
    commands: Semaphore,
    /// Serializes the lookups of acts of rounds that are over, so that one episode does not occupy all
    /// connections to the database.
    lookups: tokio::sync::Mutex<()>,
    hosted: Arc<OnceLock<Vec<(AgentId, String)>>>,
    published: watch::Receiver<Arc<Snapshot>>,
    keyframes: Arc<Mutex<Keyframes>>,
    ends_at: Arc<AtomicI64>,
    times: Arc<Times>,
    /// The memory that it takes; free again when nobody holds the episode.
    memory: Arc<Reservation>,
    gone: CancellationToken,
}

impl std::ops::Deref for Handle {
    type Target = Running;

    fn deref(&self) -> &Running {
        &self.0
    }
}

impl Handle {
    /// The state that is published now.
    #[must_use]
    pub fn snapshot(&self) -> Arc<Snapshot> {
        Arc::clone(&self.published.borrow())
    }

    /// Follows what is published.
    #[must_use]
    pub fn follow(&self) -> watch::Receiver<Arc<Snapshot>> {
        self.published.clone()
    }

    /// Acts for several seats; the outcomes come in the same order, once they are durable.
    pub async fn submit(&self, acts: Vec<(AgentId, Submission)>) -> Outcomes {
        let at = self.clock.now();
        let round = self.snapshot().world.round();
        let mut outcomes: Outcomes = acts.iter().map(|_| Err(ActError::Busy)).collect();
        let (mut permits, refused) = self.in_flight.take(acts.iter().map(|(agent, _)| *agent));
        let (now, past): (Vec<Sent>, Vec<Sent>) = (acts.into_iter().enumerate())
            .filter(|(_, (agent, _))| !refused.contains(agent))
            .map(|(place, (agent, submission))| Sent {
                place,
                agent,
                submission,
                earlier: Earlier::Unknown,
            })
            .partition(|sent| sent.submission.round >= round);
        let permits_of_now = permits.split(now.iter().map(|sent| sent.agent));
        // What may decide a round does not wait for anything.
        let late =
            self.send_batch(at, Batch { acts: now, permits: permits_of_now }, &mut outcomes).await;
        if !late.is_empty()
            && let Err(error) = self.journal.keep(Vec::new()).await
        {
            // Their rounds were on the way to the disk: what is found must include them.
            for sent in &late {
                outcomes[sent.place] = Err(error.clone().into());
            }
            return outcomes;
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
        self.send_batch(at, batch, &mut outcomes).await;
        outcomes
    }

    /// Hands acts to the actor and notes their outcomes; returns those that came too late for that.
    async fn send_batch(&self, at: Timestamp, batch: Batch, outcomes: &mut Outcomes) -> Vec<Sent> {
        if batch.acts.is_empty() {
            return Vec::new();
        }
        let places: Vec<usize> = batch.acts.iter().map(|sent| sent.place).collect();
        let (reply, told) = oneshot::channel();
        // Where the actor is gone nobody replies.
        drop(self.mailbox.send((at, Message::Submit { batch, reply })));
        let Ok(told) = told.await else {
            for place in places {
                outcomes[place] = Err(gone().into());
            }
            return Vec::new();
        };
        let mut late = Vec::new();
        for (place, told) in told {
            match told {
                Reply::Outcome(outcome) => outcomes[place] = outcome,
                Reply::Late(sent) => late.push(sent),
            }
        }
        late
    }

    /// What a seat did in a round that is over and durable.
    async fn earlier(&self, sent: &Sent) -> Result<Option<RecordedAct>, StoreError> {
        let _turn = self.lookups.lock().await;
        let act = self.journal.act(self.key, sent.submission.round, sent.agent).await?;
        Ok(act.map(|act| RecordedAct { record: act.record, waiting_for: act.waiting_for }))
    }

    /// Claims open seats; they are durable when this returns. With the last open seat the episode
    /// starts, unless its creator wants to start it.
    ///
    /// # Errors
    /// Where they have holders, the episode has ended, or that could not be kept.
    pub async fn claim(&self, claim: Claim) -> Result<Claimed, ClaimError> {
        self.command(|reply| Message::Claim { claim: Box::new(claim), reply }).await
    }

    /// Starts a waiting episode; one that has started is left as it is.
    ///
    /// # Errors
    /// Where seats are open, or that could not be kept.
    pub async fn start(&self) -> Result<(), StartError> {
        self.command(|reply| Message::Start { reply }).await
    }

    /// Aborts the episode; one that has ended is left as it is.
    ///
    /// # Errors
    /// Where that could not be kept.
    pub async fn abort(&self) -> Result<(), StoreError> {
        self.abort_with(Vec::new()).await
    }

    /// Aborts the episode, and keeps what goes with that in the same transaction; nothing where it has ended.
    ///
    /// # Errors
    /// Where that could not be kept.
    pub async fn abort_with(&self, audit_entries: Vec<Entry>) -> Result<(), StoreError> {
        self.command(|reply| Message::Abort { audit_entries, reply }).await
    }

    async fn command<T, E: From<StoreError>>(
        &self,
        message: impl FnOnce(oneshot::Sender<Result<T, E>>) -> Message,
    ) -> Result<T, E> {
        let _turn = self.commands.acquire().await;
        let (reply, done) = oneshot::channel();
        drop(self.mailbox.send((self.clock.now(), message(reply))));
        done.await.unwrap_or_else(|_| Err(gone().into()))
    }

    /// The seats that the server plays, with the names of the players; none before the start.
    #[must_use]
    pub fn hosted(&self) -> &[(AgentId, String)] {
        self.hosted.get().map_or(&[], Vec::as_slice)
    }

    /// The latest kept state of round `round` or before.
    #[must_use]
    pub fn keyframe(&self, round: u32) -> Arc<World> {
        self.keyframes.lock().expect("nothing panics while it holds this").before(round)
    }

    /// When the episode ends unless there is a request.
    pub(super) fn ends_at(&self) -> Timestamp {
        Timestamp::from_millisecond(self.ends_at.load(Ordering::Acquire)).unwrap_or(Timestamp::MAX)
    }

    /// Its times, which outlive it in the registry.
    pub(super) fn times(&self) -> Arc<Times> {
        Arc::clone(&self.times)
    }

    /// The group to whose share its memory belongs, if to any.
    pub(super) fn memory_group(&self) -> Option<Group> {
        self.memory.group()
    }

    /// Cancelled when the actor has ended and hands nothing more to the journal.
    pub(super) fn gone(&self) -> CancellationToken {
        self.gone.clone()
    }

    /// Whether its actor has ended though the episode has not: after an entry was refused, or a fault.
    pub(crate) fn is_dead(&self) -> bool {
        self.gone.is_cancelled() && !self.snapshot().status.is_over()
    }

    /// Whether somebody else holds it, too.
    pub(super) fn is_shared(&self) -> bool {
        Arc::strong_count(&self.0) > 1
    }
}

/// Moments of an episode by the running time. The journal has them by the time of day only, which may have
/// been set since.
pub(super) struct Times {
    pub(super) created_at: Timestamp,
    /// When the last durable act of a player came, or else the start or the creation, in milliseconds.
    last_act_at: AtomicI64,
}

impl Times {
    /// Those of a new episode.
    pub(super) fn new(created_at: Timestamp) -> Self {
        Self { created_at, last_act_at: AtomicI64::new(created_at.as_millisecond()) }
    }

    /// Those of a stored episode, as far as the time of day tells.
    pub(super) fn stored(stored: &StoredEpisode, clock: &dyn Clock) -> Self {
        let times = Self::new(clock.running_at(stored.created_at));
        if let Some(at) = stored.last_act_at {
            times.note_act(clock.running_at(at));
        }
        times
    }

    pub(super) fn last_act_at(&self) -> Timestamp {
        let at = Timestamp::from_millisecond(self.last_act_at.load(Ordering::Acquire));
        at.unwrap_or(self.created_at)
    }

    fn note_act(&self, at: Timestamp) {
        self.last_act_at.store(at.as_millisecond(), Ordering::Release);
    }
}

fn gone() -> StoreError {
    StoreError::Stopped(Stopped::Episode)
}

/// States kept on the way, so that one of any round comes quickly. When there are too many, or they are too
/// large, every second one is dropped.
pub(super) struct Keyframes {
    stride: u32,
    worlds: Vec<Arc<World>>,
    bytes: usize,
}

impl Keyframes {
    /// Microseconds of steps between two states, as long as there is room for all of them.
    const STRIDE_MICROS: u64 = 200_000;
    /// Rounds between two states, where rounds are light: playing some hundreds again costs less than
    /// keeping states of every short game.
    const STRIDE_MAX: u64 = 512;
    /// Bytes of all states; a game takes as long to fill it as the steps between them.
    const BYTES_MAX: usize = 64 * 1024 * 1024;
    /// States, however small they are.
    const COUNT_MAX: usize = 1024;

    /// Starts with the layout, which is always kept.
    pub(super) fn new(layout: Arc<World>) -> Self {
        let stride = Self::STRIDE_MICROS / step_micros(layout.config());
        let stride = u32::try_from(stride.clamp(1, Self::STRIDE_MAX)).expect("at most STRIDE_MAX");
        let bytes = layout.approximate_bytes();
        Self { stride, worlds: vec![layout], bytes }
    }

    pub(super) fn offer(&mut self, world: &Arc<World>) {
        if !world.round().is_multiple_of(self.stride) || world.round() == 0 {
            return;
        }
        self.worlds.push(Arc::clone(world));
        self.bytes += world.approximate_bytes();
        while self.worlds.len() > 1
            && (self.worlds.len() > Self::COUNT_MAX || self.bytes > Self::BYTES_MAX)
        {
            self.stride *= 2;
            self.worlds.retain(|world| world.round().is_multiple_of(self.stride));
            self.bytes = self.worlds.iter().map(|world| world.approximate_bytes()).sum();
        }
    }

    /// About how many bytes they take.
    pub(super) const fn bytes(&self) -> usize {
        self.bytes
    }

    fn before(&self, round: u32) -> Arc<World> {
        let place = self.worlds.partition_point(|world| world.round() <= round);
        Arc::clone(&self.worlds[place.saturating_sub(1)])
    }
}

/// An episode that is about to run.
pub(super) struct EpisodeInit {
    pub(super) id: EpisodeId,
    pub(super) key: EpisodeKey,
    pub(super) owner: Option<OwnerKey>,
    pub(super) run: Option<RunKey>,
    pub(super) party: Party,
    pub(super) spec: Arc<Spec>,
    pub(super) created_at: Timestamp,
    pub(super) times: Arc<Times>,
    pub(super) world: Arc<World>,
    pub(super) head: Head,
    pub(super) lockstep: Lockstep,
    pub(super) keyframes: Keyframes,
    /// When its newest record came.
    pub(super) newest_at: Timestamp,
    /// Bytes that its acts take in the journal.
    pub(super) bytes: u64,
    /// What its acts were.
    pub(super) tally: Tally,
    /// Who holds which seat, where that is not simply the creator.
    pub(super) seating: Option<Seating>,
}

/// Starts the actor of an episode.
pub(super) fn spawn(host: Host, mut init: EpisodeInit, memory: Reservation) -> Handle {
    note_time_of_day(&mut init.lockstep, &init.spec, &*host.clock);
    let (mailbox, messages) = mpsc::unbounded_channel();
    match init.lockstep.outcome() {
        None => host.quotas.note(init.key, Party::of_key(init.owner)),
        // It may have been counted from a list that was older than its end.
        Some(_) => host.quotas.release(init.key),
    }
    let memory = Arc::new(memory);
    let weight = Arc::downgrade(&memory);
    let kept = init.keyframes.bytes();
    let keyframes = Arc::new(Mutex::new(init.keyframes));
    let ends_at = ends_at(&init.lockstep, &*host.clock).as_millisecond();
    let ends_at = Arc::new(AtomicI64::new(ends_at));
    let snapshot = snapshot(&init.lockstep, &init.world, init.head);
    snapshot.set_opened(init.lockstep.opened_at().unwrap_or_else(|| host.clock.now()));
    let latest = Arc::clone(&snapshot);
    let (publish, published) = watch::channel(snapshot);
    let gone = CancellationToken::new();
    let hosted = Arc::new(OnceLock::new());
    if let Some(seating) = init.seating.as_ref().filter(|_| latest.status != Status::Waiting) {
        hosted.get_or_init(|| seating.hosted());
    }
    memory.resize(memory::of_episode(&init.world, kept, hosted_max(&hosted, &init.spec)));
    let handle = Handle(Arc::new(Running {
        id: init.id.clone(),
        key: init.key,
        owner: init.owner,
        run: init.run,
        party: init.party,
        spec: Arc::clone(&init.spec),
        created_at: init.created_at,
        clock: Arc::clone(&host.clock),
        journal: Arc::clone(&host.journal),
        mailbox,
        in_flight: InFlightLimit::new(init.spec.config.num_agents()),
        commands: Semaphore::new(COMMANDS_WAITING_MAX),
        lookups: tokio::sync::Mutex::new(()),
        published,
        keyframes: Arc::clone(&keyframes),
        ends_at: Arc::clone(&ends_at),
        times: Arc::clone(&init.times),
        hosted: Arc::clone(&hosted),
        memory,
        gone: gone.clone(),
    }));
    if init.spec.may_be_hosted() && !latest.status.is_over() {
        // The receiver is gone if hosted seats are not played.
        _ = host.hosted.send(handle.clone());
    }
    let has_clients = !init.spec.is_all_hosted();
    let (spawn, workers) = (Arc::clone(&host.spawn), host.workers.clone());
    let actor = Actor {
        host,
        id: init.id,
        key: init.key,
        run: init.run,
        party: init.party,
        spec: init.spec,
        world: init.world,
        head: init.head,
        lockstep: init.lockstep,
        newest_at: init.newest_at,
        newest_running: Timestamp::MIN,
        bytes: init.bytes,
        tally: init.tally,
        seating: init.seating,
        ahead: Vec::new(),
        hosted,
        keyframes,
        memory: weight,
        ends_at,
        times: init.times,
        publish,
        latest,
        failed: CancellationToken::new(),
        _gone: gone.drop_guard(),
    };
    let actor: BoxFuture<'static, ()> = Box::pin(actor.run(messages));
    if has_clients {
        spawn(actor);
    } else {
        workers.spawn_in_background(actor).unwrap_or_else(|actor| spawn(actor));
    }
    handle
}

/// How many seats the server plays: before the start, how many it may.
fn hosted_max(hosted: &OnceLock<Vec<(AgentId, String)>>, spec: &Spec) -> usize {
    hosted.get().map_or_else(|| spec.hosted_max(), Vec::len)
}

/// Tells the barrier, which goes by the running time, what the time of day says: while that is in doubt
/// nothing is closed or abandoned.
fn note_time_of_day(lockstep: &mut Lockstep, spec: &Spec, clock: &dyn Clock) {
    let is_in_doubt = clock.doubt().is_some();
    let closes_at = spec.closes_at.filter(|_| !is_in_doubt).map(|at| clock.running_at(at));
    lockstep.note_time_of_day(closes_at, is_in_doubt);
}

/// When the episode ends unless there is a request, or when that has to be checked again.
fn ends_at(lockstep: &Lockstep, clock: &dyn Clock) -> Timestamp {
    if lockstep.is_held() { after(clock.now(), LOOKS_AGAIN_AFTER) } else { lockstep.ends_at() }
}

fn snapshot(lockstep: &Lockstep, world: &Arc<World>, head: Head) -> Arc<Snapshot> {
    let agents = usize::from(world.config().num_agents());
    let snapshot = Snapshot {
        status: lockstep.status(),
        world: Arc::clone(world),
        head,
        outcome: lockstep.outcome(),
        opened_at: OnceLock::new(),
        place: OnceLock::new(),
        banks: lockstep.banks(),
        acted: (0..agents).map(|_| AtomicBool::new(false)).collect(),
    };
    for agent in lockstep.acted() {
        snapshot.set_acted(agent);
    }
    Arc::new(snapshot)
}

struct Actor {
    host: Host,
    id: EpisodeId,
    key: EpisodeKey,
    run: Option<RunKey>,
    party: Party,
    spec: Arc<Spec>,
    world: Arc<World>,
    head: Head,
    lockstep: Lockstep,
    /// When its newest record came, by the time of day, which may be set back; records never go back.
    newest_at: Timestamp,
    /// The same by the running time, of the records of this actor.
    newest_running: Timestamp,
    bytes: u64,
    tally: Tally,
    seating: Option<Seating>,
    /// Entries to be recorded before those of the next effects.
    ahead: Vec<Entry>,
    hosted: Arc<OnceLock<Vec<(AgentId, String)>>>,
    keyframes: Arc<Mutex<Keyframes>>,
    /// The memory that the episode takes, as long as anybody holds it.
    memory: Weak<Reservation>,
    ends_at: Arc<AtomicI64>,
    times: Arc<Times>,
    publish: watch::Sender<Arc<Snapshot>>,
    /// The state that is published, or will be once it is durable.
    latest: Arc<Snapshot>,
    /// Cancelled once a commit failed: what is in memory is then ahead of the disk for ever.
    failed: CancellationToken,
    _gone: DropGuard,
}

impl Actor {
    async fn run(mut self, mut messages: mpsc::UnboundedReceiver<Envelope>) {
        let mut published = self.publish.subscribe();
        let failed = self.failed.clone();
        self.resume().await;
        loop {
            note_time_of_day(&mut self.lockstep, &self.spec, &*self.host.clock);
            let wake = self.wakes_at();
            let clock = Arc::clone(&self.host.clock);
            let tick = async {
                match wake {
                    Some(at) => clock.sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                biased;
                () = failed.cancelled() => return,
                message = messages.recv() => match message {
                    Some((at, message)) => self.take(at, message).await,
                    None => return,
                },
                // A round was opened: its clock runs.
                _ = published.changed() => self.note_opening(),
                () = tick => {
                    let now = self.host.clock.now();
                    self.note_opening();
                    let effects = self.tick(now);
                    if !effects.is_empty() || !self.ahead.is_empty() {
                        self.perform(now, effects, |_| {}).await;
                    }
                }
            }
        }
    }

    /// When the next timer of the episode expires.
    fn wakes_at(&self) -> Option<Timestamp> {
        let fills_at = self.seating.as_ref().and_then(Seating::fills_at);
        let fills_at = fills_at.filter(|_| self.lockstep.status() == Status::Waiting);
        [self.lockstep.wakes_at(), fills_at, self.looks_again_at()].into_iter().flatten().min()
    }

    /// When to look at the time of day again, where something waits for it: it may be in doubt, and set.
    fn looks_again_at(&self) -> Option<Timestamp> {
        let rests_on_it = match self.lockstep.status() {
            Status::Waiting => self.lockstep.is_held() || self.spec.closes_at.is_some(),
            Status::Running => self.lockstep.is_held(),
            Status::Finished | Status::Aborted | Status::Abandoned => false,
        };
        rests_on_it.then(|| after(self.host.clock.now(), LOOKS_AGAIN_AFTER))
    }

    /// What is due now: clocks run out, open seats are filled.
    fn tick(&mut self, now: Timestamp) -> Vec<Effect> {
        let mut effects = self.apply(now, Event::Tick);
        if self.lockstep.status() == Status::Waiting
            && let Some((holder, agents)) =
                self.seating.as_mut().and_then(|seating| seating.fill(now))
        {
            let entry = self.claim_entry(holder, agents, Vec::new(), None);
            self.ahead.push(entry);
            effects.extend(self.start_if_seated(now));
        }
        effects
    }

    /// Starts an episode that waited for nothing but its last seat.
    fn start_if_seated(&mut self, at: Timestamp) -> Vec<Effect> {
        let is_seated = self.seating.as_ref().is_none_or(|seating| seating.count_open() == 0);
        if !is_seated || self.spec.manual_start {
            return Vec::new();
        }
        let mut effects = self.apply(at, Event::Start);
        effects.extend(self.end_if_solved(at));
        effects
    }

    /// Tells the barrier when the open round was published.
    fn note_opening(&mut self) {
        let snapshot = Arc::clone(&self.publish.borrow());
        if let Some(at) = snapshot.opened_at()
            && snapshot.world.round() == self.lockstep.round()
            && snapshot.status == self.lockstep.status()
        {
            self.apply(at, Event::Opened { at });
        }
    }

    /// Passes an event with its time to the barrier.
    fn apply(&mut self, at: Timestamp, event: Event) -> Vec<Effect> {
        note_time_of_day(&mut self.lockstep, &self.spec, &*self.host.clock);
        let effects = self.lockstep.apply(at, event);
        self.note_end();
        effects
    }

    /// Publishes when the episode ends unless there is a request.
    fn note_end(&self) {
        let ends_at = ends_at(&self.lockstep, &*self.host.clock);
        self.ends_at.store(ends_at.as_millisecond(), Ordering::Release);
    }

    /// Resumes before the first event: ends a layout that is solved already, or resolves a round whose
    /// acts were all stored before a restart.
    async fn resume(&mut self) {
        let now = self.host.clock.now();
        let mut effects = self.lockstep.close();
        effects.extend(self.end_if_solved(now));
        if !effects.is_empty() {
            self.perform(now, effects, |_| {}).await;
        }
    }

    /// A layout can be solved before the first round; nobody can act in it.
    fn end_if_solved(&mut self, at: Timestamp) -> Vec<Effect> {
        if self.lockstep.status() == Status::Running && self.world.is_over() {
            return self.apply(at, Event::Done);
        }
        Vec::new()
    }

    async fn take(&mut self, at: Timestamp, message: Message) {
        match message {
            Message::Submit { batch, reply } => self.submit(at, batch, reply).await,
            Message::Start { reply } => {
                let open = self.seating.as_ref().map_or(0, Seating::count_open);
                if self.lockstep.status() == Status::Waiting && open > 0 {
                    let refused = move |result: Result<(), StoreError>| {
                        drop(reply.send(Err(
                            result.err().map_or(StartError::SeatsOpen(open), Into::into),
                        )));
                    };
                    return self.perform(at, Vec::new(), refused).await;
                }
                let mut effects = self.apply(at, Event::Start);
                effects.extend(self.end_if_solved(at));
                self.perform_for(at, effects, (), reply).await;
            }
            Message::Abort { audit_entries, reply } => {
                let effects = self.apply(at, Event::Abort);
                if !effects.is_empty() {
                    self.ahead.extend(audit_entries);
                }
                self.perform_for(at, effects, (), reply).await;
            }
            Message::Claim { claim, reply } => {
                let mut effects = self.tick(at);
                match self.claim(at, *claim) {
                    Ok(claimed) => {
                        effects.extend(self.start_if_seated(at));
                        self.perform_for(at, effects, claimed, reply).await;
                    }
                    Err(refused) => {
                        // It is refused for the sake of a claim that may still be on its way to the disk.
                        let told = |result: Result<(), StoreError>| {
                            drop(reply.send(Err(result.err().map_or(refused, Into::into))));
                        };
                        self.perform(at, effects, told).await;
                    }
                }
            }
        }
    }

    /// Performs effects and sends the result to the caller, who may be gone.
    async fn perform_for<T: Send + 'static, E: From<StoreError> + Send + 'static>(
        &mut self,
        at: Timestamp,
        effects: Vec<Effect>,
        outcome: T,
        reply: oneshot::Sender<Result<T, E>>,
    ) {
        let told = |result: Result<(), StoreError>| {
            drop(reply.send(result.map(|()| outcome).map_err(E::from)));
        };
        self.perform(at, effects, told).await;
    }

    /// Assigns open seats to a claim.
    fn claim(&mut self, at: Timestamp, claim: Claim) -> Result<Claimed, ClaimError> {
        let Claim { holder, wanted, seats, swarm, idempotency } = claim;
        if self.lockstep.outcome().is_some() {
            return Err(ClaimError::Over);
        }
        let none_open = match wanted {
            Wanted::Seat(agent) => SeatTaken::Seat(agent),
            Wanted::Any(wanted) => SeatTaken::Few { open: 0, wanted },
        };
        let seating = self.seating.as_mut().ok_or(none_open)?;
        let (holder, agents) = seating.claim(wanted, Holder { at, ..holder })?;
        let number = holder.number;
        let of = |agent, hash| TokenRow { hash, agent, holder: Some(number) };
        let seats = agents.iter().zip(seats).map(|(agent, hash)| of(Some(*agent), hash));
        let tokens = seats.chain([of(None, swarm)]).collect();
        let entry = self.claim_entry(holder, agents.clone(), tokens, idempotency);
        self.ahead.push(entry);
        Ok(Claimed { number, agents })
    }

    fn claim_entry(
        &mut self,
        holder: Holder,
        agents: Vec<AgentId>,
        tokens: Vec<TokenRow>,
        idempotency: Option<(String, [u8; 32])>,
    ) -> Entry {
        let episode = self.key;
        let holder = Holder { at: self.stamp(holder.at), ..holder };
        Entry::Claim(Box::new(ClaimRow { episode, holder, agents, tokens, idempotency }))
    }

    async fn submit(
        &mut self,
        at: Timestamp,
        batch: Batch,
        reply: oneshot::Sender<Vec<(usize, Reply)>>,
    ) {
        self.note_opening();
        let mut effects = Vec::new();
        let mut told: Vec<(usize, Reply)> = Vec::with_capacity(batch.acts.len());
        let mut used = self.bytes;
        let Batch { acts, permits } = batch;
        for sent in acts {
            if sent.submission.round < self.world.round()
                && matches!(sent.earlier, Earlier::Unknown)
            {
                told.push((sent.place, Reply::Late(sent)));
                continue;
            }
            let Sent { place, agent, submission, earlier } = sent;
            let earlier = match earlier {
                Earlier::Found(earlier) => earlier,
                Earlier::Unknown => None,
            };
            let text_bytes = submission.record.text_bytes();
            let room = self.host.quotas.check_act(self.key, used, text_bytes, at);
            for effect in self.apply(at, Event::Submit { agent, submission, earlier, room }) {
                match effect {
                    Effect::Answer(answer) => {
                        told.push((place, Reply::Outcome(answer.map_err(ActError::from))));
                    }
                    other => {
                        used +=
                            if matches!(other, Effect::KeepAct { .. }) { text_bytes } else { 0 };
                        effects.push(other);
                    }
                }
            }
        }
        self.perform(at, effects, |result| {
            // Nothing is acknowledged that may be lost, not even for the second time; and nothing
            // is refused because of something that may be lost.
            if let Err(error) = result {
                for (_, told) in &mut told {
                    *told = Reply::Outcome(Err(error.clone().into()));
                }
            }
            drop(reply.send(told));
            drop(permits);
        })
        .await;
    }

    /// Performs effects of what came at `at`: queues all entries as one job; `then` is
    /// called once it, and all that was queued before, is durable and published.
    async fn perform(
        &mut self,
        at: Timestamp,
        effects: Vec<Effect>,
        then: impl FnOnce(Result<(), StoreError>) + Send + 'static,
    ) {
        // The acts belong to the latest state, which may still be on its way to be published.
        let open = Arc::clone(&self.latest);
        let mut entries = std::mem::take(&mut self.ahead);
        let mut acted = Vec::new();
        let mut opens = false;
        let bytes_before = self.bytes;
        let mut paused_at = self.bytes;
        for effect in effects {
            if self.bytes - paused_at > PIECE_BYTES {
                paused_at = self.bytes;
                tokio::task::yield_now().await;
            }
            match effect {
                Effect::KeepStart => {
                    entries.extend(self.seating_entry());
                    let at = self.stamp(at);
                    entries.push(Entry::Start { episode: self.key, at });
                }
                Effect::KeepAct { agent, recorded } => {
                    acted.push((agent, kind(&recorded)));
                    entries.push(self.act_entry(at, agent, &recorded));
                }
                Effect::Resolve => {
                    if let Err(error) = self.resolve(&mut entries).await {
                        tracing::error!(episode = %self.id, %error, "a round was not resolved");
                        self.host.quotas.release_bytes(self.key, self.bytes - bytes_before);
                        self.failed.cancel();
                        then(Err(error));
                        return;
                    }
                    opens = true;
                }
                Effect::End(ending) => {
                    entries.push(self.end_entry(ending));
                    opens = true;
                }
                Effect::Publish => opens = true,
                Effect::Answer(_) => unreachable!("answers are taken where the event is made"),
            }
        }
        let next = opens.then(|| snapshot(&self.lockstep, &self.world, self.head));
        if let Some(next) = &next {
            self.latest = Arc::clone(next);
        }
        let after_commit = AfterCommit {
            open,
            acted,
            next,
            times: Arc::clone(&self.times),
            last_act_at: self.lockstep.last_act_at(),
            episode: self.id.clone(),
            key: self.key,
            run: self.run,
            is_sealed: self.spec.visibility == Visibility::Sealed,
        };
        let (host, publish) = (self.host.clone(), self.publish.clone());
        let (key, bytes) = (self.key, self.bytes - bytes_before);
        let failed = self.failed.clone();
        let is_barrier = entries.is_empty();
        let committed = move |result: Result<(), StoreError>| {
            // Earlier entries may have been rejected although there is nothing to reject here.
            let result = if is_barrier && failed.is_cancelled() { Err(gone()) } else { result };
            if result.is_ok() {
                after_commit.publish(&host, &publish);
            } else {
                host.quotas.release_bytes(key, bytes);
                failed.cancel();
            }
            then(result);
        };
        self.host.journal.append(entries, Box::new(committed));
    }

    /// Writes the record of who holds which seat; from now on the server plays its own.
    fn seating_entry(&mut self) -> Option<Entry> {
        let seating = self.seating.as_ref()?;
        let (record, head) = seated(seating, self.head);
        self.head = head;
        self.hosted.get_or_init(|| seating.hosted());
        Some(Entry::Seat(SeatingRow { episode: self.key, record, head }))
    }

    /// The time of day at a moment of the running time, as it is written down.
    fn stamp(&mut self, at: Timestamp) -> Timestamp {
        self.newest_running = self.newest_running.max(at);
        self.newest_at = self.newest_at.max(self.host.clock.to_wall(at));
        self.newest_at
    }

    fn act_entry(&mut self, at: Timestamp, agent: AgentId, recorded: &RecordedAct) -> Entry {
        let record = RawRecord::write(&recorded.record);
        let bytes = record.as_str().len() as u64;
        self.bytes += bytes;
        self.tally.add(&recorded.record);
        self.host.quotas.add_bytes(self.key, bytes, at);
        let at = self.stamp(at);
        if recorded.record.source == Source::Player {
            self.lockstep.note_act(self.newest_running);
            self.note_end();
        }
        Entry::Act(ActRow {
            episode: self.key,
            round: self.world.round(),
            agent,
            waiting_for: recorded.waiting_for,
            at,
            record,
        })
    }

    /// Steps the engine by the acts of the open round and writes the round's record, and the end
    /// where it was the last.
    async fn resolve(&mut self, entries: &mut Vec<Entry>) -> Result<(), StoreError> {
        let round = self.world.round();
        let config = Arc::clone(self.world.config());
        let acts = acts_of(&config, self.lockstep.records()).map_err(StoreError::broken)?;
        let before = Arc::clone(&self.world);
        let recorded: Vec<ActRecord> = self.lockstep.records().cloned().collect();
        let text: u64 = recorded.iter().map(ActRecord::text_bytes).sum();
        let head = self.head;
        let step = move |_: &Cancelled<'_>| {
            let mut world = World::clone(&before);
            world.step(&acts);
            let digest = world.digest();
            let records: Vec<RawRecord> = recorded.iter().map(RawRecord::write).collect();
            let record = round_record(round, records.iter(), &digest.to_string(), world.score());
            (Arc::new(world), digest, head.link(record.as_str().as_bytes()))
        };
        let is_heavy = heavy::is_long(step_micros(&config) + text / TEXT_BYTES_PER_MICRO);
        let urgent = (self.party, Rank::Urgent);
        let stepped = off_thread(&self.host.workers, "step", urgent, is_heavy, step).await;
        let (world, digest, head) =
            stepped.map_err(|error| StoreError::broken(error.to_string()))?;
        self.head = head;
        self.world = world;
        self.keep_state();
        let now = self.host.clock.now();
        entries.push(Entry::Round(RoundRow {
            episode: self.key,
            round,
            digest: digest.0,
            score: self.world.score(),
            head: self.head,
            at: self.stamp(now),
        }));
        let ending = if self.world.is_done() {
            Some(Ending::TaskDone)
        } else {
            self.world.is_over().then_some(Ending::RoundsPlayed)
        };
        let alive = self.world.agents().map(|agent| self.world.is_alive(agent)).collect();
        for effect in self.apply(now, Event::Resolved { alive, ending }) {
            // The next round is published with whatever else is to be kept.
            if let Effect::End(ending) = effect {
                entries.push(self.end_entry(ending));
            }
        }
        Ok(())
    }

    /// Keeps the new state for those who ask for it later, and counts the memory that the episode takes now.
    fn keep_state(&self) {
        let mut keyframes = self.keyframes.lock().expect("nothing panics while it holds this");
        keyframes.offer(&self.world);
        if let Some(reservation) = self.memory.upgrade() {
            let hosted = hosted_max(&self.hosted, &self.spec);
            reservation.resize(memory::of_episode(&self.world, keyframes.bytes(), hosted));
        }
    }

    /// Writes the record of the end.
    fn end_entry(&mut self, ending: Ending) -> Entry {
        let status = ending.status().name();
        let record = RawRecord::write(&Record::End(End {
            status: status.to_owned(),
            reason: ending.name().to_owned(),
            rounds: self.world.round(),
            score: self.world.score(),
            open_acts: self.lockstep.records().cloned().collect(),
        }));
        self.head = self.head.link(record.as_str().as_bytes());
        let at = self.lockstep.outcome().map_or_else(|| self.host.clock.now(), |o| o.at);
        Entry::End(EndRow {
            episode: self.key,
            status,
            reason: ending.name(),
            record,
            head: self.head,
            bytes: self.bytes,
            score: self.world.score(),
            rounds: self.world.round(),
            tally: self.tally,
            counts: self.spec.counts(),
            at: self.stamp(at),
        })
    }
}

/// The record of who holds which seat, and the head of a chain with it.
pub(super) fn seated(seating: &Seating, head: Head) -> (RawRecord, Head) {
    let record = RawRecord::write(&seating.record());
    let head = head.link(record.as_str().as_bytes());
    (record, head)
}

/// What is published and counted once a commit is durable.
struct AfterCommit {
    /// The state for which the acts were sent.
    open: Arc<Snapshot>,
    acted: Vec<(AgentId, &'static str)>,
    /// The state after them, if a round or the episode ended.
    next: Option<Arc<Snapshot>>,
    times: Arc<Times>,
    last_act_at: Timestamp,
    episode: EpisodeId,
    key: EpisodeKey,
    run: Option<RunKey>,
    is_sealed: bool,
}

impl AfterCommit {
    /// Marks and publishes what is durable now, and counts it.
    fn publish(self, host: &Host, publish: &watch::Sender<Arc<Snapshot>>) {
        for (agent, kind) in self.acted {
            self.open.set_acted(agent);
            metrics::counter!("swarmbench_acts_total", "kind" => kind).increment(1);
        }
        self.times.note_act(self.last_act_at);
        let Some(next) = self.next else { return };
        let task = next.world.config().task().name();
        let rounds = u64::from(next.world.round() - self.open.world.round());
        metrics::counter!("swarmbench_rounds_total", "task" => task).increment(rounds);
        if let Some(outcome) = next.outcome {
            let status = outcome.ending.status().name();
            host.quotas.release(self.key);
            metrics::counter!("swarmbench_episodes_ended_total", "status" => status).increment(1);
            let score = (!self.is_sealed).then(|| next.world.score());
            tracing::info!(
                episode = %self.episode, status, reason = outcome.ending.name(), score, "ended"
            );
        }
        let ended = self.run.filter(|_| next.outcome.is_some());
        next.set_opened(host.clock.now());
        publish.send_replace(next);
        if let Some(run) = ended {
            // The receiver is gone if runs are not managed.
            _ = host.ended.send(run);
        }
    }
}

/// How an act is counted.
const fn kind(recorded: &RecordedAct) -> &'static str {
    match (recorded.record.source, recorded.record.valid) {
        (Source::Clock, _) => "clock",
        (Source::Player, true) => "valid",
        (Source::Player, false) => "invalid",
    }
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::{Config, Settings, TaskName};

    use super::*;

    #[test]
    fn kept_states_are_closer_where_rounds_are_dear_and_have_a_bound() {
        for (agents, view) in [(10, 5), (128, 41), (256, 63), (1024, 31)] {
            let mut settings = Settings::standard(TaskName::Pursuit, 1);
            (settings.num_agents, settings.width, settings.height) = (agents, 64, 64);
            (settings.view_size, settings.memory) = (view, 0);
            let config = Arc::new(Config::check(&settings).expect("good settings"));
            let kept = Keyframes::new(Arc::new(World::new(Arc::clone(&config))));
            let between = u64::from(kept.stride) * step_micros(&config);
            assert!(between <= Keyframes::STRIDE_MICROS || kept.stride == 1, "{between} µs");
        }
        let settings = Settings { max_round: 10_000, ..Settings::standard(TaskName::Pursuit, 1) };
        let config = Arc::new(Config::check(&settings).expect("good settings"));
        let mut world = World::new(config);
        let mut kept = Keyframes::new(Arc::new(world.clone()));
        kept.stride = 1;
        let stays = vec![swarmbench_engine::Act::default(); 12];
        for _ in 0..2 * Keyframes::COUNT_MAX {
            world.step(&stays);
            kept.offer(&Arc::new(world.clone()));
            assert!(
                kept.worlds.len() <= Keyframes::COUNT_MAX && kept.bytes() <= Keyframes::BYTES_MAX
            );
        }
        assert!(kept.stride > 1, "every second one was dropped");
    }
}
