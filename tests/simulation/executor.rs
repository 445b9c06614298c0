//! An executor of tasks on one thread. It makes no choice: its driver says which task is polled next.

use std::collections::{BTreeMap, BTreeSet};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};

use futures::future::BoxFuture;
use swarmbench::episode::actor::Spawn;

use swarmbench::cluster::Incarnation;

/// The number of a task, in the order of starts.
pub(crate) type TaskId = u64;

/// All tasks of a run.
#[derive(Default)]
pub(crate) struct Executor {
    tasks: BTreeMap<TaskId, Task>,
    started: TaskId,
    /// Started tasks that are not yet in `tasks`.
    spawned: Arc<Mutex<Vec<Started>>>,
    /// Stopped servers, whose tasks do not run.
    stopped: BTreeSet<Incarnation>,
}

/// A started task, and its server.
type Started = (Incarnation, BoxFuture<'static, ()>);

/// The owner of clients' tasks, in place of a server.
pub(crate) const CLIENTS: Incarnation = 0;

struct Task {
    future: BoxFuture<'static, ()>,
    /// Server of the task.
    server: Incarnation,
    /// True if the task runs as long as its server does.
    is_lasting: bool,
    woken: Arc<Woken>,
}

/// True if a task is woken.
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Executor {
    /// A handle that starts tasks of a server.
    pub(crate) fn spawner(&self, server: Incarnation) -> Spawn {
        let spawned = Arc::clone(&self.spawned);
        Arc::new(move |future| spawned.lock().expect("one thread").push((server, future)))
    }

    /// Starts a task, which first runs when it is chosen.
    pub(crate) fn spawn(&mut self, server: Incarnation, future: BoxFuture<'static, ()>) -> TaskId {
        self.started += 1;
        let woken = Arc::new(Woken(AtomicBool::new(true)));
        self.tasks.insert(self.started, Task { future, server, is_lasting: false, woken });
        self.started
    }

    /// Starts a task that runs as long as its server does.
    pub(crate) fn spawn_lasting(&mut self, server: Incarnation, future: BoxFuture<'static, ()>) {
        let task = self.spawn(server, future);
        if let Some(task) = self.tasks.get_mut(&task) {
            task.is_lasting = true;
        }
    }

    /// The woken tasks of running servers, in the order of their numbers.
    pub(crate) fn runnable(&mut self) -> Vec<TaskId> {
        let spawned = std::mem::take(&mut *self.spawned.lock().expect("one thread"));
        for (server, future) in spawned {
            self.spawn(server, future);
        }
        let runs = |task: &Task| {
            task.woken.0.load(Ordering::Relaxed) && !self.stopped.contains(&task.server)
        };
        self.tasks.iter().filter(|(_, task)| runs(task)).map(|(&id, _)| id).collect()
    }

    /// Stops a server abruptly: its tasks do not run, but their wakes are remembered.
    pub(crate) fn stop(&mut self, server: Incarnation) {
        self.stopped.insert(server);
    }

    /// Resumes a server.
    pub(crate) fn go_on(&mut self, server: Incarnation) {
        self.stopped.remove(&server);
    }

    pub(crate) fn is_stopped(&self, server: Incarnation) -> bool {
        self.stopped.contains(&server)
    }

    /// Polls a task until it waits; returns whether it has ended.
    pub(crate) fn poll(&mut self, id: TaskId) -> bool {
        let Some(task) = self.tasks.get_mut(&id) else { return true };
        task.woken.0.store(false, Ordering::Relaxed);
        let waker = Waker::from(Arc::clone(&task.woken));
        let ended = task.future.as_mut().poll(&mut Context::from_waker(&waker)).is_ready();
        if ended {
            self.tasks.remove(&id);
        }
        ended
    }

    /// Drops a task.
    pub(crate) fn drop_task(&mut self, id: TaskId) {
        self.tasks.remove(&id);
    }

    /// True if a task has not ended.
    pub(crate) fn is_alive(&self, id: TaskId) -> bool {
        self.tasks.contains_key(&id)
    }

    /// The number of unfinished tasks that should end at some time.
    pub(crate) fn len(&self) -> usize {
        self.tasks.values().filter(|task| !task.is_lasting).count()
    }

    /// Drops all tasks of a server.
    pub(crate) fn crash(&mut self, server: Incarnation) {
        self.stopped.remove(&server);
        let (lost, kept) = std::mem::take(&mut self.tasks)
            .into_iter()
            .partition(|(_, task)| task.server == server);
        self.tasks = kept;
        let lost: BTreeMap<TaskId, Task> = lost;
        drop(lost);
        self.spawned.lock().expect("one thread").retain(|(of, _)| *of != server);
    }
}

/// Yields a number of times.
pub(crate) async fn pause(times: usize) {
    for _ in 0..times {
        Once(false).await;
    }
}

struct Once(bool);

impl Future for Once {
    type Output = ();

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        if std::mem::replace(&mut self.0, true) {
            return Poll::Ready(());
        }
        context.waker().wake_by_ref();
        Poll::Pending
    }
}
