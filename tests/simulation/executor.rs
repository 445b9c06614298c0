//! Runs tasks on one thread. It never chooses: its driver says which task is polled next.

use std::collections::{BTreeMap, BTreeSet};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};

use futures::future::BoxFuture;
use swarmbench::episode::actor::Spawn;

use crate::simulation::database::Incarnation;

/// The number of a task; they are counted in the order in which they were started.
pub(crate) type TaskId = u64;

/// All tasks of a run.
#[derive(Default)]
pub(crate) struct Executor {
    tasks: BTreeMap<TaskId, Task>,
    started: TaskId,
    /// What tasks have started, not yet taken in.
    spawned: Arc<Mutex<Vec<Started>>>,
    /// Servers that are stopped: none of their tasks runs.
    stopped: BTreeSet<Incarnation>,
}

/// A task that was started, and the server of which it is.
type Started = (Incarnation, BoxFuture<'static, ()>);

/// In the place of a server: the clients.
pub(crate) const CLIENTS: Incarnation = 0;

struct Task {
    future: BoxFuture<'static, ()>,
    /// The server of which it is.
    server: Incarnation,
    /// Whether it goes on as long as its server does.
    is_lasting: bool,
    woken: Arc<Woken>,
}

/// Whether a task has something to do.
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Executor {
    /// What starts tasks of a server here.
    pub(crate) fn spawner(&self, server: Incarnation) -> Spawn {
        let spawned = Arc::clone(&self.spawned);
        Arc::new(move |future| spawned.lock().expect("one thread").push((server, future)))
    }

    /// Starts a task; it runs when it is first chosen.
    pub(crate) fn spawn(&mut self, server: Incarnation, future: BoxFuture<'static, ()>) -> TaskId {
        self.started += 1;
        let woken = Arc::new(Woken(AtomicBool::new(true)));
        self.tasks.insert(self.started, Task { future, server, is_lasting: false, woken });
        self.started
    }

    /// Starts a task that goes on as long as its server does.
    pub(crate) fn spawn_lasting(&mut self, server: Incarnation, future: BoxFuture<'static, ()>) {
        let task = self.spawn(server, future);
        if let Some(task) = self.tasks.get_mut(&task) {
            task.is_lasting = true;
        }
    }

    /// The tasks that have something to do and may run, in order of their numbers.
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

    /// Stops a server where it stands: its tasks wait, and so does what wakes them.
    pub(crate) fn stop(&mut self, server: Incarnation) {
        self.stopped.insert(server);
    }

    /// Lets a server go on.
    pub(crate) fn go_on(&mut self, server: Incarnation) {
        self.stopped.remove(&server);
    }

    pub(crate) fn is_stopped(&self, server: Incarnation) -> bool {
        self.stopped.contains(&server)
    }

    /// Polls a task until it waits; whether it has ended.
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

    /// Ends a task where it stands.
    pub(crate) fn drop_task(&mut self, id: TaskId) {
        self.tasks.remove(&id);
    }

    /// Whether a task has not ended.
    pub(crate) fn is_alive(&self, id: TaskId) -> bool {
        self.tasks.contains_key(&id)
    }

    /// How many tasks have not ended that should end some time.
    pub(crate) fn len(&self) -> usize {
        self.tasks.values().filter(|task| !task.is_lasting).count()
    }

    /// Ends all tasks of a server where they stand.
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
