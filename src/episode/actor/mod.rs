//! The actor, one task per episode: it performs the effects of [`lockstep`](super::lockstep).
//!
//! Only the actor steps the engine. Everything that an event causes goes to the journal in one piece: an act, and with the last
//! act of a round the resolved round and perhaps the end. The commit of this piece publishes the new state and then sends the
//! receipts. So a client with a receipt finds the state that goes with it, and nothing is shown or acknowledged that could be
//! lost.

mod commit;
mod handle;
mod host;
mod mailbox;
mod timer;
mod times;

use std::pin::pin;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Weak};
use std::time::Duration;

use futures::future::BoxFuture;
use jiff::Timestamp;
use swarmbench_engine::{AgentId, World};
use tokio::sync::{Semaphore, mpsc, oneshot, watch};
use tokio_util::sync::{CancellationToken, DropGuard};

use super::heavy::{self, off_thread, step_micros};
use super::in_flight::InFlightLimit;
use super::lockstep::{Effect, Event, Lockstep, RecordedAct};
use super::memory;
use super::seating::{SeatTaken, Seating, Wanted};
use super::snapshot::Snapshot;
use super::spec::Spec;
use super::status::{Ending, Status};
use crate::budget::Reservation;
use crate::fair::{Party, Rank};
use crate::store::StoreError;
use crate::store::entries::{
    ActRow, ClaimRow, EndRow, Entry, Holder, RoundRow, SeatingRow, TokenRow, brief_of,
};
use crate::work::Cancelled;
pub(super) use commit::note_end;
use commit::{ActKind, AfterCommit};
use handle::{COMMANDS_WAITING_MAX, Inner, gone};
pub use handle::{Handle, Running};
pub use host::{Host, Spawn};
pub use mailbox::{ActError, Claim, ClaimError, Claimed, Outcomes, StartError};
use mailbox::{Batch, Earlier, Envelope, Message, Reply, Sent};
use swarmbench_clock::{Clock, after};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{End, RawRecord, end_record, round_record};
use timer::Timer;
pub(super) use times::Times;

/// Bytes of text that are written into a round's record, and hashed, per microsecond.
const TEXT_BYTES_PER_MICRO: u64 = 100;

/// Bytes of texts whose records an actor writes before it yields its thread to others.
const PIECE_BYTES: u64 = 256 * 1024;

/// Interval between looks at the time of day, where something depends on it.
const LOOKS_AGAIN_AFTER: Duration = Duration::from_secs(10);

/// Initial state of an actor.
pub(super) struct EpisodeInit {
    pub(super) episode: Running,
    pub(super) world: Arc<World>,
    pub(super) head: Head,
    pub(super) lockstep: Lockstep,
    /// Time of the newest record.
    pub(super) newest_at: Timestamp,
    /// Journal bytes of the acts.
    pub(super) bytes: u64,
    pub(super) tally: Tally,
    /// Holders of the seats; `None` where the creator simply holds all of them.
    pub(super) seating: Option<Seating>,
}

/// Starts the actor of an episode.
pub(super) fn spawn(host: Arc<Host>, init: EpisodeInit, memory: Reservation) -> Handle {
    let EpisodeInit { episode, world, head, mut lockstep, newest_at, bytes, tally, seating } = init;
    note_time_of_day(&mut lockstep, &episode.spec, &*host.clock);
    let (mailbox, messages) = mpsc::unbounded_channel();
    match lockstep.outcome() {
        None => host.quotas.note(episode.key, Party::of_key(episode.owner)),
        // The episode may have been counted from a list that was older than its end.
        Some(_) => host.quotas.release(episode.key),
    }
    let snapshot = Snapshot::new(&lockstep, &world, head);
    snapshot.set_opened(lockstep.opened_at().unwrap_or_else(|| host.clock.now()));
    let latest = Arc::clone(&snapshot);
    let (publish, published) = watch::channel(snapshot);
    if let Some(seating) = seating.as_ref().filter(|_| latest.status != Status::Waiting) {
        episode.hosted.get_or_init(|| seating.hosted());
    }
    let (gone, settled) = (CancellationToken::new(), CancellationToken::new());
    let (episode, memory) = (Arc::new(episode), Arc::new(memory));
    let handle = Handle(Arc::new(Inner {
        episode: Arc::clone(&episode),
        clock: Arc::clone(&host.clock),
        journal: Arc::clone(&host.journal),
        mailbox,
        in_flight: InFlightLimit::new(episode.spec.config.num_agents()),
        commands: Semaphore::new(COMMANDS_WAITING_MAX),
        lookups: tokio::sync::Mutex::new(()),
        published,
        memory: Arc::clone(&memory),
        settled: settled.clone(),
        gone: gone.clone(),
    }));
    let has_clients = !episode.spec.is_all_hosted();
    let (spawn, workers) = (Arc::clone(&host.spawn), host.workers.clone());
    let mut actor = Actor {
        host,
        episode,
        world,
        head,
        lockstep,
        newest_at,
        newest_running: Timestamp::MIN,
        bytes,
        tally,
        seating,
        ahead: Vec::new(),
        memory: Arc::downgrade(&memory),
        publish,
        latest,
        failed: CancellationToken::new(),
        _gone: gone.drop_guard(),
    };
    actor.note_end();
    actor.note_memory();
    let now = actor.host.clock.now();
    let due = actor.due(now);
    if due.is_empty() && actor.ahead.is_empty() {
        settled.cancel();
    }
    if actor.episode.spec.may_be_hosted() && actor.lockstep.outcome().is_none() {
        // The receiver is gone where hosted seats are not played.
        _ = actor.host.hosted.send(handle.clone());
    }
    let actor: BoxFuture<'static, ()> =
        Box::pin(actor.run((now, due), settled.drop_guard(), messages));
    if has_clients {
        spawn(actor);
    } else {
        workers.spawn_in_background(actor).unwrap_or_else(|actor| spawn(actor));
    }
    handle
}

/// Passes the time of day to the barrier, which uses the running time. While the time of day is in doubt, nothing is closed or
/// abandoned.
fn note_time_of_day(lockstep: &mut Lockstep, spec: &Spec, clock: &dyn Clock) {
    let is_in_doubt = clock.doubt().is_some();
    let closes_at = spec.closes_at.filter(|_| !is_in_doubt).map(|at| clock.running_at(at));
    lockstep.note_time_of_day(closes_at, is_in_doubt);
}

struct Actor {
    host: Arc<Host>,
    episode: Arc<Running>,
    world: Arc<World>,
    head: Head,
    lockstep: Lockstep,
    /// Time of the newest record by the time of day, which may be set back; times of records never go back.
    newest_at: Timestamp,
    /// Time of the newest record of this actor by the running time.
    newest_running: Timestamp,
    bytes: u64,
    tally: Tally,
    seating: Option<Seating>,
    /// Entries to record before those of the next effects.
    ahead: Vec<Entry>,
    /// Memory of the episode, as long as there are handles to it.
    memory: Weak<Reservation>,
    publish: watch::Sender<Arc<Snapshot>>,
    /// State that is published, or will be once it is durable.
    latest: Arc<Snapshot>,
    /// Cancelled once a commit failed: the state in memory is then ahead of the disk for ever.
    failed: CancellationToken,
    _gone: DropGuard,
}

impl Actor {
    /// Performs the effects that are due at the start, then handles messages and timers. The effects are recorded at the time for
    /// which the barrier decided them, however late the task gets its first turn.
    async fn run(
        mut self,
        (decided_at, due): (Timestamp, Vec<Effect>),
        settling: DropGuard,
        mut messages: mpsc::UnboundedReceiver<Envelope>,
    ) {
        let mut published = self.publish.subscribe();
        let mut failed = pin!(self.failed.clone().cancelled_owned());
        let mut timer = Timer::default();
        if !due.is_empty() || !self.ahead.is_empty() {
            self.perform(decided_at, due, |_| drop(settling)).await;
        }
        loop {
            timer.set(self.wakes_at(), &*self.host.clock);
            tokio::select! {
                biased;
                () = &mut failed => return,
                message = messages.recv() => match message {
                    Some((at, message)) => self.take(at, message).await,
                    None => return,
                },
                // A round opened: its clock runs.
                _ = published.changed() => self.note_opening(),
                () = timer.expired() => {
                    let now = self.host.clock.now();
                    self.note_opening();
                    let effects = self.tick(now, Event::Tick);
                    if !effects.is_empty() || !self.ahead.is_empty() {
                        self.perform(now, effects, |_| {}).await;
                    }
                }
            }
        }
    }

    /// Time at which the next timer of the episode expires.
    fn wakes_at(&self) -> Option<Timestamp> {
        let fills_at = self.seating.as_ref().and_then(Seating::fills_at);
        let fills_at = fills_at.filter(|_| self.lockstep.status() == Status::Waiting);
        [self.lockstep.wakes_at(), fills_at, self.looks_again_at()].into_iter().flatten().min()
    }

    /// Time of the next look at the time of day, where something depends on it: the time of day may be in doubt, or be set.
    fn looks_again_at(&self) -> Option<Timestamp> {
        let rests_on_it = match self.lockstep.status() {
            Status::Waiting => self.lockstep.is_held() || self.episode.spec.closes_at.is_some(),
            Status::Running => self.lockstep.is_held(),
            Status::Finished | Status::Aborted | Status::Abandoned => false,
        };
        rests_on_it.then(|| after(self.host.clock.now(), LOOKS_AGAIN_AFTER))
    }

    /// Effects that are due at an event: clocks run out, and a built-in player takes open seats.
    fn tick(&mut self, now: Timestamp, event: Event) -> Vec<Effect> {
        self.note_time_of_day();
        let mut effects = self.apply(now, event);
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
        if !is_seated || self.episode.spec.manual_start {
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

    /// Passes the time of day to the barrier: before every message, timer and step, as some depend on it.
    fn note_time_of_day(&mut self) {
        note_time_of_day(&mut self.lockstep, &self.episode.spec, &*self.host.clock);
    }

    /// Passes an event with its time to the barrier.
    fn apply(&mut self, at: Timestamp, event: Event) -> Vec<Effect> {
        let effects = self.lockstep.apply(at, event);
        self.note_end();
        effects
    }

    /// Publishes the time at which the episode ends without a request, or at which that has to be checked again.
    fn note_end(&self) {
        let ends_at = if self.lockstep.is_held() {
            after(self.host.clock.now(), LOOKS_AGAIN_AFTER)
        } else {
            self.lockstep.ends_at()
        };
        self.episode.ends_at.store(ends_at.as_millisecond(), Ordering::Release);
    }

    /// Effects that are due before the first event: a round whose acts were all stored before a restart is resolved; a solved
    /// layout ends, and so does an episode whose time was over before its actor started.
    fn due(&mut self, now: Timestamp) -> Vec<Effect> {
        let mut effects = self.lockstep.close();
        effects.extend(self.end_if_solved(now));
        effects.extend(self.tick(now, Event::Tick));
        effects
    }

    /// Ends an episode whose layout is solved before the first round: nobody can act in it.
    fn end_if_solved(&mut self, at: Timestamp) -> Vec<Effect> {
        if self.lockstep.status() == Status::Running && self.world.is_over() {
            return self.apply(at, Event::Done);
        }
        Vec::new()
    }

    async fn take(&mut self, at: Timestamp, message: Message) {
        self.note_time_of_day();
        // The message may have waited while a round was resolved, and it is recorded after that round. So it counts from then on,
        // and clocks that ran out meanwhile have run out before it.
        let at = at.max(self.newest_running);
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
                let mut effects = self.tick(at, Event::Arrival);
                match self.claim(at, *claim) {
                    Ok(claimed) => {
                        effects.extend(self.start_if_seated(at));
                        self.perform_for(at, effects, claimed, reply).await;
                    }
                    Err(refused) => {
                        // The claim that has the seats may still be on its way to the disk.
                        let refuse = |result: Result<(), StoreError>| {
                            drop(reply.send(Err(result.err().map_or(refused, Into::into))));
                        };
                        self.perform(at, effects, refuse).await;
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
        let answer = |result: Result<(), StoreError>| {
            drop(reply.send(result.map(|()| outcome).map_err(E::from)));
        };
        self.perform(at, effects, answer).await;
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
        let episode = self.episode.key;
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
        let mut replies: Vec<(usize, Reply)> = Vec::with_capacity(batch.acts.len());
        let mut used = self.bytes;
        let mut piece_bytes = 0;
        let Batch { acts, permits } = batch;
        for sent in acts {
            if sent.submission.round < self.world.round()
                && matches!(sent.earlier, Earlier::Unknown)
            {
                replies.push((sent.place, Reply::Late(sent)));
                continue;
            }
            let Sent { place, agent, submission, earlier } = sent;
            let earlier = match earlier {
                Earlier::Found(earlier) => earlier,
                Earlier::Unknown => None,
            };
            let text_bytes = submission.decision.text_bytes();
            let room = self.host.quotas.check_act(self.episode.key, used, text_bytes, at);
            for effect in self.apply(at, Event::Submit { agent, submission, earlier, room }) {
                match effect {
                    Effect::Answer(answer) => {
                        replies.push((place, Reply::Outcome(answer.map_err(ActError::from))));
                    }
                    other => {
                        used +=
                            if matches!(other, Effect::KeepAct { .. }) { text_bytes } else { 0 };
                        effects.push(other);
                    }
                }
            }
            piece_bytes += text_bytes;
            if piece_bytes > PIECE_BYTES {
                piece_bytes = 0;
                tokio::task::yield_now().await;
            }
        }
        self.perform(at, effects, |result| {
            // Nothing that may be lost is acknowledged, not even for the second time, and nothing is refused because of it.
            if let Err(error) = result {
                for (_, reply) in &mut replies {
                    *reply = Reply::Outcome(Err(error.clone().into()));
                }
            }
            drop(reply.send(replies));
            drop(permits);
        })
        .await;
    }

    /// Performs the effects of an event at `at`: queues all entries as one job. `then` is called once this job, and everything
    /// queued before, is durable and published.
    async fn perform(
        &mut self,
        at: Timestamp,
        effects: Vec<Effect>,
        then: impl FnOnce(Result<(), StoreError>) + Send + 'static,
    ) {
        // The acts belong to the latest state, which may still wait for its publication.
        let open = Arc::clone(&self.latest);
        let mut entries = std::mem::take(&mut self.ahead);
        let mut acted = Vec::new();
        let mut opens = false;
        let bytes_before = self.bytes;
        for effect in effects {
            match effect {
                Effect::KeepStart => {
                    entries.extend(self.seating_entry());
                    let at = self.stamp(at);
                    entries.push(Entry::Start { episode: self.episode.key, at });
                }
                Effect::KeepAct { agent, recorded } => {
                    acted.push((agent, ActKind::of(&recorded.decision)));
                    entries.push(self.act_entry(at, agent, recorded));
                }
                Effect::Resolve => {
                    if let Err(error) = self.resolve(&mut entries).await {
                        tracing::error!(episode = %self.episode.id, %error, "a round was not resolved");
                        self.host.quotas.release_bytes(self.episode.key, self.bytes - bytes_before);
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
        let next = opens.then(|| Snapshot::new(&self.lockstep, &self.world, self.head));
        if let Some(next) = &next {
            self.latest = Arc::clone(next);
        }
        let after_commit = AfterCommit {
            open,
            acted,
            next,
            last_act_at: self.lockstep.last_act_at(),
            episode: Arc::clone(&self.episode),
        };
        let (host, publish) = (Arc::clone(&self.host), self.publish.clone());
        let (key, bytes) = (self.episode.key, self.bytes - bytes_before);
        let failed = self.failed.clone();
        let is_barrier = entries.is_empty();
        let committed = move |result: Result<(), StoreError>| {
            // Earlier entries may have been rejected although this job has none to reject.
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

    /// Records the holders of the seats; from now on the server plays its own.
    fn seating_entry(&mut self) -> Option<Entry> {
        let seating = self.seating.as_ref()?;
        let (record, head) = seated(seating, self.head);
        self.head = head;
        self.episode.hosted.get_or_init(|| seating.hosted());
        Some(Entry::Seat(SeatingRow { episode: self.episode.key, record, head }))
    }

    /// Time of day in records for a moment of the running time; it never goes back.
    fn stamp(&mut self, at: Timestamp) -> Timestamp {
        self.newest_running = self.newest_running.max(at);
        self.newest_at = self.newest_at.max(self.host.clock.to_wall(at));
        self.newest_at
    }

    fn act_entry(&mut self, at: Timestamp, agent: AgentId, recorded: RecordedAct) -> Entry {
        let RecordedAct { decision, bank_spent_ms, record, waiting_for } = recorded;
        let brief = brief_of(&record, || decision.brief_record(agent, bank_spent_ms));
        let source = decision.source;
        let bytes = record.as_str().len() as u64;
        self.bytes += bytes;
        self.tally.count(source, decision.valid, decision.failure, decision.usage.as_deref());
        self.host.quotas.add_bytes(self.episode.key, bytes, at);
        let at = self.stamp(at);
        let (episode, round) = (self.episode.key, self.world.round());
        Entry::Act(ActRow { episode, round, agent, waiting_for, source, at, record, brief })
    }

    /// Steps the engine with the acts of the open round, and records the round, and the end where it was the last.
    async fn resolve(&mut self, entries: &mut Vec<Entry>) -> Result<(), StoreError> {
        let round = self.world.round();
        let acts = self.lockstep.acts();
        let before = Arc::clone(&self.world);
        let text: u64 = self.lockstep.recorded().map(|act| act.decision.text_bytes()).sum();
        let records: Vec<RawRecord> =
            self.lockstep.recorded().map(|act| act.record.clone()).collect();
        let head = self.head;
        let step = move |_: &Cancelled<'_>| {
            let mut world = World::clone(&before);
            world.step(&acts);
            let digest = world.digest();
            let record = round_record(round, records.iter(), &digest.to_string(), world.score());
            (Arc::new(world), digest, head.link(record.as_str().as_bytes()))
        };
        let micros = step_micros(self.world.config()) + text / TEXT_BYTES_PER_MICRO;
        let urgent = (self.episode.party, Rank::Urgent);
        let is_heavy = heavy::is_long(micros);
        let stepped = off_thread(&self.host.workers, "step", urgent, is_heavy, step).await;
        let (world, digest, head) =
            stepped.map_err(|error| StoreError::broken(error.to_string()))?;
        self.head = head;
        self.world = world;
        self.episode
            .keyframes
            .lock()
            .expect("nothing panics while it holds this")
            .offer(&self.world);
        self.note_memory();
        let now = self.host.clock.now();
        entries.push(Entry::Round(RoundRow {
            episode: self.episode.key,
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
        self.note_time_of_day();
        for effect in self.apply(now, Event::Resolved { alive, ending }) {
            // This commit publishes the next round, with its other entries.
            if let Effect::End(ending) = effect {
                entries.push(self.end_entry(ending));
            }
        }
        Ok(())
    }

    /// Reserves the memory that the episode takes now; before the start, with all players that it may have.
    fn note_memory(&self) {
        let Some(reservation) = self.memory.upgrade() else { return };
        let hosted =
            self.episode.hosted.get().map_or_else(|| self.episode.spec.hosted_max(), Vec::len);
        let keyframes =
            self.episode.keyframes.lock().expect("nothing panics while it holds this").bytes();
        reservation.resize(memory::of_episode(&self.episode.spec, &self.world, keyframes, hosted));
    }

    /// Records the end.
    fn end_entry(&mut self, ending: Ending) -> Entry {
        let at = self.lockstep.outcome().map_or_else(|| self.host.clock.now(), |o| o.at);
        let at = self.stamp(at);
        let counted = (self.bytes, self.tally);
        let (episode, lockstep, world) = (&self.episode, &self.lockstep, &self.world);
        ended(episode, lockstep, world, counted, &mut self.head, ending, at)
    }
}

impl EpisodeInit {
    /// End of a new episode whose layout is already solved: nobody can act in it.
    pub(super) fn end_if_solved(&mut self) -> Option<Entry> {
        if self.lockstep.status() != Status::Running || !self.world.is_over() {
            return None;
        }
        self.lockstep.apply(self.episode.times.created_at, Event::Done);
        let (lockstep, world, counted) = (&self.lockstep, &self.world, (self.bytes, self.tally));
        let (head, at) = (&mut self.head, self.newest_at);
        Some(ended(&self.episode, lockstep, world, counted, head, Ending::TaskDone, at))
    }
}

/// End of an episode, as it is stored; `head` moves to the end of the chain.
fn ended(
    episode: &Running,
    lockstep: &Lockstep,
    world: &World,
    (bytes, tally): (u64, Tally),
    head: &mut Head,
    ending: Ending,
    at: Timestamp,
) -> Entry {
    let status = ending.status().name();
    let record = end_record(End {
        status: status.to_owned(),
        reason: ending.name().to_owned(),
        rounds: world.round(),
        score: world.score(),
        open_acts: lockstep.recorded().map(|act| &act.record).collect(),
    });
    *head = head.link(record.as_str().as_bytes());
    Entry::End(EndRow {
        episode: episode.key,
        status,
        reason: ending.name(),
        record,
        head: *head,
        bytes,
        score: world.score(),
        rounds: world.round(),
        seed: world.config().seed(),
        tally,
        counts: episode.spec.counts(),
        at,
    })
}

/// Record of the holders of the seats, and the head of the chain with it.
pub(super) fn seated(seating: &Seating, head: Head) -> (RawRecord, Head) {
    let record = RawRecord::write(&seating.record());
    let head = head.link(record.as_str().as_bytes());
    (record, head)
}
