//! One task an episode: it performs what [`lockstep`](super::lockstep) says.
//!
//! Only the actor steps the engine. What an event leads to goes to the journal in one piece: an act,
//! and with the last act of a round the resolved round and perhaps the end. The commit that holds it
//! publishes the new state and then sends the receipts, so whoever has a receipt finds the state that
//! goes with it, and nothing is shown or acknowledged that could be lost.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use swarmbench_engine::{AgentId, Config, TaskName, World};
use tokio::sync::{mpsc, oneshot, watch};

use super::lockstep::{Effect, Event, Given, Lockstep, Receipt, Refusal, Submission};
use super::spec::Spec;
use super::{Ending, Snapshot, Status};
use crate::clock::Clock;
use crate::ids::EpisodeId;
use crate::journal::chain::Head;
use crate::journal::record::{End, RawRecord, Record, Source, round_record};
use crate::journal::replay::acts_of;
use crate::journal::{ActRow, EndRow, Entry, EpisodeKey, Journal, JournalError, RoundRow};

/// Messages that wait for one episode; whoever sends more waits too.
const MAILBOX_MAX: usize = 256;

/// Why an act was not acknowledged.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ActError {
    /// By the rules of the barrier.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// It could not be kept.
    #[error(transparent)]
    Journal(#[from] JournalError),
}

/// What each of several acts came to, in their order.
pub type Outcomes = Vec<Result<Receipt, ActError>>;

enum Message {
    Submit { acts: Vec<(AgentId, Submission)>, reply: oneshot::Sender<Outcomes> },
    Start { reply: oneshot::Sender<Result<(), JournalError>> },
    Abort { reply: oneshot::Sender<Result<(), JournalError>> },
}

/// What all actors of a server share.
#[derive(Clone)]
pub struct Host {
    /// Where entries are kept.
    pub journal: Arc<dyn Journal>,
    /// Where the time comes from.
    pub clock: Arc<dyn Clock>,
    /// Counts opened rounds.
    pub opened: Arc<AtomicU64>,
    /// Counts episodes in memory that have not ended.
    pub live: Arc<AtomicUsize>,
}

/// An episode as others see it. Cloning shares it.
#[derive(Clone)]
pub struct Handle {
    /// Its public id.
    pub id: EpisodeId,
    /// Its number in the journal.
    pub key: EpisodeKey,
    /// What it is.
    pub spec: Arc<Spec>,
    /// When it was created.
    pub created_at: jiff::Timestamp,
    mailbox: mpsc::Sender<Message>,
    published: watch::Receiver<Arc<Snapshot>>,
    keyframes: Arc<Mutex<Keyframes>>,
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
        let count = acts.len();
        let (reply, outcomes) = oneshot::channel();
        // Whether the actor is gone shows when nobody answers.
        drop(self.mailbox.send(Message::Submit { acts, reply }).await);
        outcomes.await.unwrap_or_else(|_| vec![Err(gone().into()); count])
    }

    /// Starts a waiting episode; one that has started is left as it is.
    ///
    /// # Errors
    /// Where that could not be kept.
    pub async fn start(&self) -> Result<(), JournalError> {
        self.command(|reply| Message::Start { reply }).await
    }

    /// Aborts the episode; one that has ended is left as it is.
    ///
    /// # Errors
    /// Where that could not be kept.
    pub async fn abort(&self) -> Result<(), JournalError> {
        self.command(|reply| Message::Abort { reply }).await
    }

    async fn command(
        &self,
        message: impl FnOnce(oneshot::Sender<Result<(), JournalError>>) -> Message,
    ) -> Result<(), JournalError> {
        let (reply, done) = oneshot::channel();
        drop(self.mailbox.send(message(reply)).await);
        done.await.unwrap_or_else(|_| Err(gone()))
    }

    /// The latest kept state of round `round` or before.
    #[must_use]
    pub fn keyframe(&self, round: u32) -> Arc<World> {
        self.keyframes.lock().expect("nothing panics while it holds this").before(round)
    }
}

fn gone() -> JournalError {
    JournalError("the episode has stopped".into())
}

/// States kept on the way, so that one of any round comes quickly. When there are too many, every
/// second one is dropped.
pub(super) struct Keyframes {
    stride: u32,
    worlds: Vec<Arc<World>>,
}

impl Keyframes {
    const MAX: usize = 32;

    /// Starts with the layout. Few rounds lie between two states where rounds are heavy; where they
    /// are light, playing some hundreds again costs less than keeping states of every short game.
    pub(super) fn new(layout: Arc<World>) -> Self {
        let stride = if is_heavy(layout.config()) { 32 } else { 512 };
        Self { stride, worlds: vec![layout] }
    }

    pub(super) fn offer(&mut self, world: &Arc<World>) {
        if !world.round().is_multiple_of(self.stride) || world.round() == 0 {
            return;
        }
        self.worlds.push(Arc::clone(world));
        if self.worlds.len() > Self::MAX {
            self.stride *= 2;
            self.worlds.retain(|world| world.round().is_multiple_of(self.stride));
        }
    }

    fn before(&self, round: u32) -> Arc<World> {
        let place = self.worlds.partition_point(|world| world.round() <= round);
        Arc::clone(&self.worlds[place.saturating_sub(1)])
    }
}

/// An episode that is about to run.
pub(super) struct Fresh {
    pub(super) id: EpisodeId,
    pub(super) key: EpisodeKey,
    pub(super) spec: Arc<Spec>,
    pub(super) created_at: jiff::Timestamp,
    pub(super) world: Arc<World>,
    pub(super) head: Head,
    pub(super) lockstep: Lockstep,
    pub(super) keyframes: Keyframes,
}

/// Starts the actor of an episode on the current runtime.
pub(super) fn spawn(host: Host, fresh: Fresh, tracker: &tokio_util::task::TaskTracker) -> Handle {
    let (mailbox, messages) = mpsc::channel(MAILBOX_MAX);
    if fresh.lockstep.outcome().is_none() {
        host.live.fetch_add(1, Ordering::Relaxed);
    }
    let keyframes = Arc::new(Mutex::new(fresh.keyframes));
    let snapshot = snapshot(&host, &fresh.lockstep, &fresh.world, fresh.head);
    let (publish, published) = watch::channel(snapshot);
    let handle = Handle {
        id: fresh.id.clone(),
        key: fresh.key,
        spec: fresh.spec,
        created_at: fresh.created_at,
        mailbox,
        published,
        keyframes: Arc::clone(&keyframes),
    };
    let actor = Actor {
        host,
        id: fresh.id,
        key: fresh.key,
        world: fresh.world,
        head: fresh.head,
        lockstep: fresh.lockstep,
        keyframes,
        publish,
    };
    tracker.spawn(actor.run(messages));
    handle
}

fn snapshot(host: &Host, lockstep: &Lockstep, world: &Arc<World>, head: Head) -> Arc<Snapshot> {
    let agents = usize::from(world.config().num_agents());
    let snapshot = Snapshot {
        status: lockstep.status(),
        world: Arc::clone(world),
        head,
        outcome: lockstep.outcome(),
        opened_at: lockstep.opened_at(),
        opened: host.opened.fetch_add(1, Ordering::Relaxed) + 1,
        banks: lockstep.banks(),
        acted: (0..agents).map(|_| AtomicBool::new(false)).collect(),
        written: (0..agents).map(|_| std::sync::OnceLock::new()).collect(),
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
    world: Arc<World>,
    head: Head,
    lockstep: Lockstep,
    keyframes: Arc<Mutex<Keyframes>>,
    publish: watch::Sender<Arc<Snapshot>>,
}

impl Actor {
    async fn run(mut self, mut messages: mpsc::Receiver<Message>) {
        self.take_up().await;
        loop {
            let wake = self.lockstep.wakes_at();
            let clock = Arc::clone(&self.host.clock);
            let tick = async {
                match wake {
                    Some(at) => clock.sleep_until(at).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                message = messages.recv() => match message {
                    Some(message) => self.take(message).await,
                    None => return,
                },
                () = tick => self.happen(Event::Tick, None).await,
            }
        }
    }

    /// What is due before the first event: a layout that is solved already, or a round whose acts
    /// were all kept before a restart.
    async fn take_up(&mut self) {
        let effects = self.lockstep.close();
        self.perform(effects, |_| {}).await;
        self.end_if_solved().await;
    }

    /// A layout can be solved before the first round; nobody can act in it.
    async fn end_if_solved(&mut self) {
        if self.lockstep.status() == Status::Running && self.world.is_over() {
            self.happen(Event::Done, None).await;
        }
    }

    async fn take(&mut self, message: Message) {
        match message {
            Message::Submit { acts, reply } => self.submit(acts, reply).await,
            Message::Start { reply } => {
                self.happen(Event::Start, Some(reply)).await;
                self.end_if_solved().await;
            }
            Message::Abort { reply } => self.happen(Event::Abort, Some(reply)).await,
        }
    }

    async fn happen(
        &mut self,
        event: Event,
        reply: Option<oneshot::Sender<Result<(), JournalError>>>,
    ) {
        let effects = self.lockstep.apply(self.host.clock.now(), event);
        self.perform(effects, |result| {
            if let Some(reply) = reply {
                // Whoever asked may have gone.
                drop(reply.send(result));
            }
        })
        .await;
    }

    async fn submit(&mut self, acts: Vec<(AgentId, Submission)>, reply: oneshot::Sender<Outcomes>) {
        let mut effects = Vec::new();
        let mut outcomes: Outcomes = Vec::with_capacity(acts.len());
        for (agent, submission) in acts {
            let earlier = match self.earlier(agent, submission.round).await {
                Ok(earlier) => earlier,
                Err(error) => {
                    outcomes.push(Err(error.into()));
                    continue;
                }
            };
            let event = Event::Submit { agent, submission, earlier };
            for effect in self.lockstep.apply(self.host.clock.now(), event) {
                match effect {
                    Effect::Answer(answer) => outcomes.push(answer.map_err(ActError::from)),
                    other => effects.push(other),
                }
            }
        }
        self.perform(effects, |result| {
            // Nothing is acknowledged that may not be kept, not even for the second time; and nothing is
            // refused because of what may not be kept, such as a clock that ran out.
            let confirm = |outcome: Result<Receipt, ActError>| match &result {
                Ok(()) => outcome,
                Err(error) => Err(ActError::Journal(error.clone())),
            };
            drop(reply.send(outcomes.into_iter().map(confirm).collect()));
        })
        .await;
    }

    /// What a seat did in a round that is over.
    async fn earlier(&self, agent: AgentId, round: u32) -> Result<Option<Given>, JournalError> {
        if round >= self.world.round() {
            return Ok(None);
        }
        // The round may still be on its way to the disk: what is found must include it.
        self.host.journal.keep(Vec::new()).await?;
        let act = self.host.journal.act(self.key, round, agent).await?;
        Ok(act.map(|act| Given { record: act.record, waiting_for: act.waiting_for }))
    }

    /// Performs effects: queues all that is to be kept in one piece; `then` is told once it, and
    /// all that was queued before, is durable and published.
    async fn perform(
        &mut self,
        effects: Vec<Effect>,
        then: impl FnOnce(Result<(), JournalError>) + Send + 'static,
    ) {
        let open = Arc::clone(&self.publish.borrow());
        let mut entries = Vec::new();
        let mut acted = Vec::new();
        let mut opens = false;
        for effect in effects {
            match effect {
                Effect::KeepStart => {
                    let at = self.host.clock.now();
                    entries.push(Entry::Start { episode: self.key, at });
                }
                Effect::KeepAct { agent, given } => {
                    acted.push(agent);
                    entries.push(self.act_entry(agent, &given));
                }
                Effect::Resolve => {
                    if let Err(error) = self.resolve(&mut entries).await {
                        tracing::error!(episode = %self.id, %error, "a round was not resolved");
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
        let next = opens.then(|| snapshot(&self.host, &self.lockstep, &self.world, self.head));
        let publish = self.publish.clone();
        let committed = move |result: Result<(), JournalError>| {
            if result.is_ok() {
                for agent in acted {
                    open.set_acted(agent);
                }
                if let Some(next) = next {
                    publish.send_replace(next);
                }
            }
            then(result);
        };
        self.host.journal.append(entries, Box::new(committed));
    }

    fn act_entry(&self, agent: AgentId, given: &Given) -> Entry {
        let kind = match (given.record.source, given.record.valid) {
            (Source::Clock, _) => "clock",
            (Source::Player, true) => "valid",
            (Source::Player, false) => "invalid",
        };
        metrics::counter!("swarmbench_acts_total", "kind" => kind).increment(1);
        Entry::Act(ActRow {
            episode: self.key,
            round: self.world.round(),
            agent,
            waiting_for: given.waiting_for,
            at: self.host.clock.now(),
            record: RawRecord::write(&given.record),
        })
    }

    /// Steps the engine by the acts of the open round and writes the round's record, and the end
    /// where it was the last.
    async fn resolve(&mut self, entries: &mut Vec<Entry>) -> Result<(), JournalError> {
        let round = self.world.round();
        let config = Arc::clone(self.world.config());
        let acts = acts_of(&config, self.lockstep.records())
            .map_err(|problem| JournalError(problem.into()))?;
        let before = Arc::clone(&self.world);
        let step = move || {
            let mut world = World::clone(&before);
            world.step(&acts);
            let digest = world.digest();
            (Arc::new(world), digest)
        };
        let (world, digest) = if is_heavy(&config) {
            let stepped = tokio::task::spawn_blocking(step).await;
            stepped.map_err(|error| JournalError(error.to_string().into()))?
        } else {
            step()
        };
        let records: Vec<RawRecord> = self.lockstep.records().map(RawRecord::write).collect();
        let record = round_record(round, records.iter(), &digest.to_string(), world.score());
        self.head = self.head.link(record.as_str().as_bytes());
        self.world = world;
        self.keyframes.lock().expect("nothing panics while it holds this").offer(&self.world);
        metrics::counter!("swarmbench_rounds_total", "task" => config.task().name()).increment(1);
        let now = self.host.clock.now();
        entries.push(Entry::Round(RoundRow {
            episode: self.key,
            round,
            digest: digest.0,
            score: self.world.score(),
            head: self.head,
            at: now,
        }));
        let ending = if self.world.is_done() {
            Some(Ending::TaskDone)
        } else {
            self.world.is_over().then_some(Ending::RoundsPlayed)
        };
        let alive = self.world.agents().map(|agent| self.world.is_alive(agent)).collect();
        self.lockstep.apply(now, Event::Resolved { alive, ending });
        if let Some(ending) = ending {
            let entry = self.end_entry(ending);
            entries.push(entry);
        }
        Ok(())
    }

    /// Writes the record of the end.
    fn end_entry(&mut self, ending: Ending) -> Entry {
        self.host.live.fetch_sub(1, Ordering::Relaxed);
        let status = ending.status().name();
        let record = RawRecord::write(&Record::End(End {
            status: status.to_owned(),
            reason: ending.name().to_owned(),
            rounds: self.world.round(),
            score: self.world.score(),
            open_acts: self.lockstep.records().cloned().collect(),
        }));
        self.head = self.head.link(record.as_str().as_bytes());
        metrics::counter!("swarmbench_episodes_ended_total", "status" => status).increment(1);
        tracing::info!(
            episode = %self.id, status, reason = ending.name(), score = self.world.score(), "ended"
        );
        Entry::End(EndRow {
            episode: self.key,
            status,
            record,
            head: self.head,
            at: self.lockstep.outcome().map_or_else(|| self.host.clock.now(), |o| o.at),
        })
    }
}

/// Whether a step can take more than a few milliseconds and has to leave the async threads.
#[must_use]
pub fn is_heavy(config: &Config) -> bool {
    let settings = config.settings();
    config.num_agents() > 128
        || settings.width * settings.height > 64 * 64
        || (config.task() == TaskName::Flocking && config.num_agents() > 24)
}
