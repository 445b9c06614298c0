//! Runs tasks on one thread. It never chooses: its driver says which task is polled next.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};

use futures::future::BoxFuture;
use swarmbench::episode::actor::Spawn;

/// The number of a task; they are counted in the order in which they were started.
pub(crate) type TaskId = u64;

/// All tasks of a run.
#[derive(Default)]
pub(crate) struct Executor {
    tasks: BTreeMap<TaskId, Task>,
    started: TaskId,
    /// What tasks have started, not yet taken in.
    spawned: Arc<Mutex<Vec<BoxFuture<'static, ()>>>>,
}

struct Task {
    future: BoxFuture<'static, ()>,
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
    /// What starts tasks here.
    pub(crate) fn spawner(&self) -> Spawn {
        let spawned = Arc::clone(&self.spawned);
        Arc::new(move |future| spawned.lock().expect("one thread").push(future))
    }

    /// Starts a task; it runs when it is first chosen.
    pub(crate) fn spawn(&mut self, future: BoxFuture<'static, ()>) -> TaskId {
        self.started += 1;
        let woken = Arc::new(Woken(AtomicBool::new(true)));
        self.tasks.insert(self.started, Task { future, woken });
        self.started
    }

    /// The tasks that have something to do, in order of their numbers.
    pub(crate) fn runnable(&mut self) -> Vec<TaskId> {
        let spawned = std::mem::take(&mut *self.spawned.lock().expect("one thread"));
        for future in spawned {
            self.spawn(future);
        }
        let woken = |task: &Task| task.woken.0.load(Ordering::Relaxed);
        self.tasks.iter().filter(|(_, task)| woken(task)).map(|(&id, _)| id).collect()
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

    /// How many tasks have not ended.
    pub(crate) fn len(&self) -> usize {
        self.tasks.len()
    }

    /// Ends all tasks where they stand.
    pub(crate) fn crash(&mut self) {
        self.tasks.clear();
        self.spawned.lock().expect("one thread").clear();
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
