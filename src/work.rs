//! Heavy work: a fixed number of threads of low priority, shared fairly.
//!
//! Work of more than a few milliseconds leaves the async threads: steps of large worlds, replays, prompts, boards, decisions of
//! built-in players. It runs on [`Workers`], one thread per core. On Linux their priority is lower than that of the async threads,
//! so that a light request never waits for a core. A [`FairQueue`] decides which job is next, so that no party can block the
//! others. One thread is reserved for urgent jobs, and another prefers normal ones, so that neither kind can occupy all threads.
//!
//! Async threads of the same low priority handle whole requests that no running game waits for, and requests with large bodies:
//! [`Workers::in_background`].

use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Instant;

use futures::future::BoxFuture;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;
use tokio_util::task::AbortOnDropHandle;
use tracing::Instrument as _;

use crate::fair::{FairQueue, Party, Rank, Shares, WAITING_MAX, WAITING_PER_GROUP_MAX};

/// Nice value of worker threads.
const NICE: i32 = 10;

/// Stack size of every thread that serves requests. The deepest prompt template takes 0.8 MiB in a debug build, as
/// `crates/prompt/tests/depth.rs` measures.
pub const STACK_BYTES: usize = 2 * 1024 * 1024;

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WorkError {
    #[error(
        "the queue of heavy work is full, {WAITING_PER_GROUP_MAX} jobs of a group and {WAITING_MAX} in all"
    )]
    Busy,
    /// The work panicked, or the workers have stopped.
    #[error("the work was interrupted")]
    BrokeOff,
}

/// Tells running work whether its caller still waits for the result.
pub struct Cancelled<'a>(&'a (dyn Fn() -> bool + 'a));

impl Cancelled<'_> {
    pub const NEVER: Cancelled<'static> = Cancelled(&|| false);

    /// Whether the caller is gone: further work is wasted.
    pub fn is_cancelled(&self) -> bool {
        (self.0)()
    }
}

/// A queued piece of work.
trait Job: Send {
    fn is_wanted(&self) -> bool;
    fn kind(&self) -> &'static str;
    fn run(self: Box<Self>);
}

struct Task<T, F> {
    kind: &'static str,
    work: F,
    done: oneshot::Sender<T>,
}

impl<T: Send, F: FnOnce(&Cancelled<'_>) -> T + Send> Job for Task<T, F> {
    fn is_wanted(&self) -> bool {
        !self.done.is_closed()
    }

    fn kind(&self) -> &'static str {
        self.kind
    }

    fn run(self: Box<Self>) {
        let Self { work, done, .. } = *self;
        let result = {
            let is_closed = || done.is_closed();
            catch_unwind(AssertUnwindSafe(|| work(&Cancelled(&is_closed))))
        };
        // A panic was already logged; dropping the sender wakes the waiter.
        if let Ok(result) = result {
            drop(done.send(result));
        }
    }
}

type Jobs = FairQueue<Box<dyn Job>>;

struct Shared {
    jobs: Mutex<State>,
    wake: Condvar,
}

struct State {
    queue: Jobs,
    stopped: bool,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.jobs.lock().expect("nothing panics while it holds this")
    }

    fn add(&self, party: Party, rank: Rank, job: Box<dyn Job>) {
        self.state().queue.add(party, rank, job);
        self.wake.notify_all();
    }

    fn push(&self, party: Party, rank: Rank, job: Box<dyn Job>) -> Result<(), WorkError> {
        {
            let queue = &mut self.state().queue;
            if let Err(job) = queue.push(party, rank, job) {
                queue.retain(|job| job.is_wanted());
                queue.push(party, rank, job).map_err(|_| WorkError::Busy)?;
            }
        }
        // Not every thread may take the next job: each one checks.
        self.wake.notify_all();
        Ok(())
    }
}

/// Threads for heavy work. Clones share them; the threads end with the last clone.
#[derive(Clone)]
pub struct Workers(Option<Arc<Owner>>);

/// Owner of the threads, which end when it is dropped.
struct Owner {
    shared: Arc<Shared>,
    threads: usize,
    /// Async threads of low priority; `None` if the host refused more threads.
    background: Option<Runtime>,
}

/// Jobs that a thread takes, in order of preference.
#[derive(Clone, Copy)]
enum Duty {
    /// Only urgent jobs.
    Urgent,
    /// Normal jobs first, then urgent ones.
    Normal,
    /// Urgent jobs first, then normal ones.
    Any,
}

impl Duty {
    const fn of(thread: usize) -> Self {
        match thread {
            0 => Self::Urgent,
            1 => Self::Normal,
            _ => Self::Any,
        }
    }

    fn next(self, queue: &mut Jobs) -> Option<(Party, Rank, Box<dyn Job>)> {
        match self {
            Self::Urgent => queue.pop_of(Rank::Urgent),
            Self::Normal => queue.pop_of(Rank::Normal).or_else(|| queue.pop_of(Rank::Urgent)),
            Self::Any => queue.pop(),
        }
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.shared.state().stopped = true;
        self.shared.wake.notify_all();
        // The last clone may be dropped on one of these threads, so this must not wait for them.
        self.background.take().into_iter().for_each(Runtime::shutdown_background);
    }
}

impl Workers {
    /// One thread per core, and at least two.
    pub fn of_this_host() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        Self::new(cores.max(2))
    }

    /// At least two threads: all but one also do normal jobs.
    pub fn new(threads: usize) -> Self {
        let threads = threads.max(2);
        let queue = FairQueue::new(Shares { reserve: 1, ..Shares::of(threads) });
        let state = State { queue, stopped: false };
        let shared = Arc::new(Shared { jobs: Mutex::new(state), wake: Condvar::new() });
        for number in 0..threads {
            let shared = Arc::clone(&shared);
            let thread = std::thread::Builder::new().name(format!("worker-{number}"));
            let thread = thread.stack_size(STACK_BYTES);
            if let Err(error) = thread.spawn(move || work(&shared, Duty::of(number))) {
                tracing::error!(%error, "a worker thread could not be started");
            }
        }
        let background = background(threads);
        Self(Some(Arc::new(Owner { shared, threads, background })))
    }

    /// No threads: callers do their work themselves. Then the order does not depend on the host, for tests that repeat a run.
    pub const fn inline() -> Self {
        Self(None)
    }

    /// Does work for a party in its turn. Work is not begun once its caller is gone, and can stop early by asking [`Cancelled`].
    /// The time of the work is counted under `kind`.
    pub async fn run<T: Send + 'static>(
        &self,
        kind: &'static str,
        party: Party,
        rank: Rank,
        work: impl FnOnce(&Cancelled<'_>) -> T + Send + 'static,
    ) -> Result<T, WorkError> {
        self.hand_over(kind, work, |shared, job| shared.push(party, rank, job)).await
    }

    /// Does work however much waits: the caller bounds the amount, like an actor, which resolves one round at a time.
    pub async fn run_always<T: Send + 'static>(
        &self,
        kind: &'static str,
        party: Party,
        rank: Rank,
        work: impl FnOnce(&Cancelled<'_>) -> T + Send + 'static,
    ) -> Result<T, WorkError> {
        let add = |shared: &Shared, job| {
            shared.add(party, rank, job);
            Ok(())
        };
        self.hand_over(kind, work, add).await
    }

    /// Queues work with `queue` and waits for its result. Its log lines carry the request's id, too.
    async fn hand_over<T: Send + 'static>(
        &self,
        kind: &'static str,
        work: impl FnOnce(&Cancelled<'_>) -> T + Send + 'static,
        queue: impl FnOnce(&Shared, Box<dyn Job>) -> Result<(), WorkError>,
    ) -> Result<T, WorkError> {
        let Some(Owner { shared, .. }) = self.0.as_deref() else {
            return Ok(work(&Cancelled::NEVER));
        };
        let (done, result) = oneshot::channel();
        let span = tracing::Span::current();
        let work = move |cancelled: &Cancelled<'_>| span.in_scope(|| work(cancelled));
        queue(shared, Box::new(Task { kind, work, done }))?;
        result.await.map_err(|_| WorkError::BrokeOff)
    }

    /// Runs a future on async threads of low priority. The future is dropped when the caller is.
    pub async fn in_background<T: Send + 'static>(
        &self,
        work: impl Future<Output = T> + Send + 'static,
    ) -> Result<T, WorkError> {
        let Some(background) = self.0.as_deref().and_then(|owner| owner.background.as_ref()) else {
            return Ok(work.await);
        };
        let task = AbortOnDropHandle::new(background.spawn(work.in_current_span()));
        task.await.map_err(|error| match error.try_into_panic() {
            // The handler for panics of all requests answers this panic.
            Ok(panic) => std::panic::resume_unwind(panic),
            Err(_) => WorkError::BrokeOff,
        })
    }

    /// Runs a task to its end on async threads of low priority; returns it if there are none.
    pub fn spawn_in_background(
        &self,
        task: BoxFuture<'static, ()>,
    ) -> Result<(), BoxFuture<'static, ()>> {
        match self.0.as_deref().and_then(|owner| owner.background.as_ref()) {
            Some(background) => {
                drop(background.spawn(task));
                Ok(())
            }
            None => Err(task),
        }
    }
    pub fn threads(&self) -> usize {
        self.0.as_deref().map_or(1, |owner| owner.threads)
    }

    /// Numbers of running and waiting jobs.
    pub fn load(&self) -> (usize, usize) {
        let Some(Owner { shared, .. }) = self.0.as_deref() else { return (0, 0) };
        let state = shared.state();
        (state.queue.running(), state.queue.waiting())
    }
}

/// Async threads of low priority, one per core. Threads that they start inherit the priority, such as those of new database
/// connections.
fn background(threads: usize) -> Option<Runtime> {
    let mut builder = Builder::new_multi_thread();
    builder.worker_threads(threads).thread_name("background").enable_all();
    builder.thread_stack_size(STACK_BYTES);
    let runtime = builder.on_thread_start(lower_priority).build();
    runtime
        .inspect_err(|error| tracing::error!(%error, "background threads could not be started"))
        .ok()
}

fn work(shared: &Shared, duty: Duty) {
    lower_priority();
    let mut state = shared.state();
    loop {
        if state.stopped {
            return;
        }
        let Some((party, rank, job)) = duty.next(&mut state.queue) else {
            state = shared.wake.wait(state).expect("nothing panics while it holds this");
            continue;
        };
        drop(state);
        let started = Instant::now();
        if job.is_wanted() {
            let kind = job.kind();
            job.run();
            metrics::histogram!("swarmbench_heavy_seconds", "kind" => kind)
                .record(started.elapsed());
        } else {
            // The memory of the job is freed here, not under the lock of the queue.
            drop(job);
        }
        state = shared.state();
        state.queue.done(party, rank, started.elapsed());
        // Another thread may need the freed slot for a waiting job.
        if state.queue.waiting() > 0 {
            shared.wake.notify_all();
        }
    }
}

/// Lowers the priority of this thread. Other systems than Linux would lower that of the whole process.
#[cfg(target_os = "linux")]
fn lower_priority() {
    if let Err(error) = rustix::process::setpriority_process(None, NICE) {
        tracing::warn!(%error, "the priority of a worker thread cannot be lowered");
    }
}

#[cfg(not(target_os = "linux"))]
const fn lower_priority() {
    let _ = NICE;
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::time::Duration;

    use tracing::{Dispatch, Instrument, Metadata, Span};

    use super::*;
    use crate::fair::Group;
    use crate::keys::OwnerKey;

    fn owner(number: i64) -> Party {
        Party::of(Group::Owner(OwnerKey(number)))
    }

    /// Blocks the one thread for normal jobs until the sender is dropped.
    async fn block(workers: &Workers) -> (mpsc::Sender<()>, tokio::task::JoinHandle<()>) {
        let (release, held) = mpsc::channel::<()>();
        let (started, is_started) = oneshot::channel();
        let workers = workers.clone();
        let task = tokio::spawn(async move {
            let work = move |_: &Cancelled<'_>| {
                let _ = started.send(());
                let _ = held.recv();
            };
            workers.run("test", owner(99), Rank::Normal, work).await.expect("it ends");
        });
        is_started.await.expect("it starts");
        (release, task)
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn what_a_game_waits_for_passes_everything_else() {
        let workers = Workers::new(2);
        let (release, blocking) = block(&workers).await;
        let normal = workers.clone();
        let normal =
            tokio::spawn(async move { normal.run("test", owner(1), Rank::Normal, |_| 1).await });
        assert_eq!(workers.run("test", owner(2), Rank::Urgent, |_| 2).await, Ok(2));
        assert!(!normal.is_finished(), "there is one thread for it, and that is busy");
        drop(release);
        assert_eq!(normal.await.expect("no panic"), Ok(1));
        blocking.await.expect("no panic");
        assert_eq!(workers.load().1, 0);
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn what_games_wait_for_does_not_keep_everything_else_from_all_threads() {
        let workers = Workers::new(2);
        let stop = Arc::new(std::sync::atomic::AtomicBool::new(false));
        // As many games as possible that always have something to do.
        let games: Vec<_> = (0..4)
            .map(|number| {
                let (workers, stop) = (workers.clone(), Arc::clone(&stop));
                tokio::spawn(async move {
                    while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                        let spin = |_: &Cancelled<'_>| std::thread::yield_now();
                        workers
                            .run_always("test", owner(number), Rank::Urgent, spin)
                            .await
                            .expect("it ends");
                    }
                })
            })
            .collect();
        for _ in 0..20 {
            assert_eq!(workers.run("test", owner(9), Rank::Normal, |_| 1).await, Ok(1));
        }
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        for game in games {
            game.await.expect("no panic");
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn too_much_work_is_refused_but_for_what_has_to_be_done() {
        let workers = Workers::new(2);
        let (release, blocking) = block(&workers).await;
        let (mut waiting, mut refused) = (Vec::new(), 0);
        for _ in 0..=WAITING_PER_GROUP_MAX {
            let mut job = Box::pin(workers.run("test", owner(1), Rank::Normal, |_| 1));
            match futures::poll!(&mut job) {
                std::task::Poll::Ready(result) => {
                    assert_eq!(result, Err(WorkError::Busy));
                    refused += 1;
                }
                std::task::Poll::Pending => waiting.push(job),
            }
        }
        assert_eq!(refused, 1);
        let mut owed = Box::pin(workers.run_always("test", owner(1), Rank::Normal, |_| 2));
        assert!(futures::poll!(&mut owed).is_pending());
        waiting.clear();
        drop(release);
        assert_eq!(owed.await, Ok(2));
        blocking.await.expect("no panic");
    }

    #[tokio::test]
    async fn the_background_has_threads_of_its_own_and_low_priority() {
        let workers = Workers::new(2);
        let where_it_runs = async {
            let nice = rustix::process::getpriority_process(None).expect("a priority");
            (std::thread::current().name().map(str::to_owned), nice)
        };
        let (thread, nice) = workers.in_background(where_it_runs).await.expect("it ends");
        assert_eq!(thread.as_deref(), Some("background"));
        #[cfg(target_os = "linux")]
        assert!(nice >= NICE, "{nice}");
        let inline = Workers::inline().in_background(async { 1 }).await;
        assert_eq!(inline, Ok(1));
    }

    #[tokio::test]
    async fn what_runs_in_the_background_ends_with_its_caller_and_panics_with_it() {
        let workers = Workers::new(2);
        let (alive, has_ended) = oneshot::channel::<()>();
        let endless = async move {
            let _alive = alive;
            std::future::pending::<()>().await;
        };
        let mut endless = Box::pin(workers.in_background(endless));
        assert!(futures::poll!(&mut endless).is_pending());
        drop(endless);
        assert!(has_ended.await.is_err(), "it was dropped");
        let failing = workers.clone();
        let failing =
            tokio::spawn(async move { failing.in_background(async { panic!("a fault") }).await });
        assert!(failing.await.is_err_and(|error| error.is_panic()));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn work_that_nobody_waits_for_is_not_begun_and_ends_early() {
        let workers = Workers::new(2);
        let (release, blocking) = block(&workers).await;
        let (ran, has_run) = mpsc::channel();
        let waits = workers.run("test", owner(1), Rank::Normal, move |_| ran.send(()));
        let mut waits = Box::pin(waits);
        assert!(futures::poll!(&mut waits).is_pending());
        drop(waits);
        drop(release);
        blocking.await.expect("no panic");
        let (started, is_started) = oneshot::channel();
        let (ended, has_ended) = oneshot::channel();
        let work = move |cancelled: &Cancelled<'_>| {
            let _ = started.send(());
            while !cancelled.is_cancelled() {
                std::thread::yield_now();
            }
            let _ = ended.send(());
        };
        let mut running = Box::pin(workers.run("test", owner(1), Rank::Normal, work));
        assert!(futures::poll!(&mut running).is_pending());
        is_started.await.expect("it starts");
        drop(running);
        has_ended.await.expect("it notices");
        assert!(has_run.try_recv().is_err(), "the first was not begun");
    }

    #[tokio::test]
    async fn work_is_logged_within_the_request_that_asks_for_it() {
        let logs = Dispatch::new(tracing_subscriber::registry());
        let _here = tracing::dispatcher::set_default(&logs);
        let workers = Workers::new(2);
        for rank in [Rank::Normal, Rank::Urgent] {
            let request = || tracing::info_span!("request");
            let name = |logs: &Dispatch| {
                let logs = logs.clone();
                move |_: &Cancelled<'_>| {
                    let span = || Span::current().metadata().map(Metadata::name);
                    tracing::dispatcher::with_default(&logs, span)
                }
            };
            let run = workers.run("test", owner(1), rank, name(&logs)).instrument(request());
            assert_eq!(run.await, Ok(Some("request")));
            let always = workers.run_always("test", owner(1), rank, name(&logs));
            assert_eq!(always.instrument(request()).await, Ok(Some("request")));
            let outside = workers.run("test", owner(1), rank, name(&logs)).await;
            assert_eq!(outside, Ok(None), "a thread is in no request after it");
        }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_panic_costs_no_thread() {
        let workers = Workers::new(2);
        let done = async {
            for _ in 0..4 {
                let panics =
                    workers.run("test", owner(1), Rank::Normal, |_| panic!("on purpose")).await;
                assert_eq!(panics, Err::<(), _>(WorkError::BrokeOff));
            }
            workers.run("test", owner(1), Rank::Normal, |_| 3).await
        };
        // Without a thread the task would wait for ever.
        let done = tokio::time::timeout(Duration::from_mins(1), done).await;
        assert_eq!(done, Ok(Ok(3)));
    }
}
