//! Replays of earlier rounds, shared by all that request the same state, and a cache of their results.

use std::collections::HashMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard};

use futures::FutureExt;
use futures::future::{Shared, WeakShared};
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use swarmbench_engine::World;

use crate::ids::EpisodeKey;
use crate::store::StoreError;
use crate::work::WorkError;

/// Capacity of the cache of states, in bytes.
const RECENT_BYTES_MAX: u64 = 32 * 1024 * 1024;

/// Initial capacity of the cache of states.
const RECENT_EXPECTED: usize = 256;

/// Reason why an episode's rounds cannot be replayed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RecoveryError {
    #[error(transparent)]
    Journal(#[from] StoreError),
    #[error(transparent)]
    Work(#[from] WorkError),
    /// The replay differs from the journal.
    #[error("the journal of episode {episode} cannot be replayed: {problem}")]
    Broken {
        /// Public id.
        episode: String,
        problem: String,
    },
}

/// Key of a state: the number of the episode, and the round.
pub type Key = (EpisodeKey, u32);

pub(super) type Replayed = Result<Arc<World>, RecoveryError>;

pub(super) type Replay = Pin<Box<dyn Future<Output = Replayed> + Send>>;

#[derive(Clone)]
struct Bytes;

impl Weighter<Key, Arc<World>> for Bytes {
    fn weight(&self, _: &Key, world: &Arc<World>) -> u64 {
        world.approximate_bytes() as u64
    }
}

/// Replays in progress, and a cache of recently computed states.
pub struct Replays {
    under_way: Mutex<HashMap<Key, WeakShared<Replay>>>,
    recent: Cache<Key, Arc<World>, Bytes>,
}

impl Default for Replays {
    fn default() -> Self {
        let recent = Cache::with_weighter(RECENT_EXPECTED, RECENT_BYTES_MAX, Bytes);
        Self { under_way: Mutex::default(), recent }
    }
}

impl Replays {
    pub(super) fn recent(&self, key: Key) -> Option<Arc<World>> {
        self.recent.get(&key)
    }

    pub fn keep(&self, key: Key, world: &Arc<World>) {
        self.recent.insert(key, Arc::clone(world));
    }

    fn under_way(&self) -> MutexGuard<'_, HashMap<Key, WeakShared<Replay>>> {
        self.under_way.lock().expect("nothing panics while it holds this")
    }

    /// Joins the replay in progress towards a state, or begins one. A replay is cancelled when nobody waits for it any more.
    pub(super) fn of(&self, key: Key, begin: impl FnOnce() -> Replay) -> Shared<Replay> {
        let mut under_way = self.under_way();
        if let Some(replay) = under_way.get(&key).and_then(WeakShared::upgrade) {
            return replay;
        }
        under_way.retain(|_, replay| replay.upgrade().is_some());
        let replay = begin().shared();
        under_way.extend(replay.downgrade().map(|replay| (key, replay)));
        replay
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use futures::future::join_all;
    use swarmbench_engine::{Config, Settings, TaskName};
    use tokio::sync::oneshot;

    use super::*;

    fn world() -> Arc<World> {
        let settings = Settings::standard(TaskName::Synchronization, 1);
        Arc::new(World::new(Arc::new(Config::check(&settings).expect("good settings"))))
    }

    #[tokio::test]
    async fn a_state_that_many_request_at_once_is_computed_once() {
        let (replays, begun) = (Replays::default(), Arc::new(AtomicUsize::new(0)));
        let begin = || -> Replay {
            let begun = Arc::clone(&begun);
            Box::pin(async move {
                begun.fetch_add(1, Ordering::Relaxed);
                tokio::task::yield_now().await;
                Ok(world())
            })
        };
        let asked: Vec<_> = (0..20).map(|_| replays.of((EpisodeKey(1), 5), begin)).collect();
        let other = replays.of((EpisodeKey(1), 6), begin);
        assert!(join_all(asked).await.iter().all(Result::is_ok));
        assert_eq!(begun.load(Ordering::Relaxed), 1);
        assert!(other.await.is_ok());
        // The first replay was cancelled, as nobody waits for it any more.
        assert!(replays.of((EpisodeKey(1), 5), begin).await.is_ok());
        assert_eq!(begun.load(Ordering::Relaxed), 3);
    }

    #[tokio::test]
    async fn it_runs_while_one_waits_and_is_cancelled_with_the_last() {
        let replays = Replays::default();
        let (alive, mut ended) = oneshot::channel::<()>();
        let begin = || -> Replay {
            Box::pin(async move {
                let _alive = alive;
                std::future::pending().await
            })
        };
        let mut first = replays.of((EpisodeKey(1), 5), begin);
        let mut second = replays.of((EpisodeKey(1), 5), || unreachable!("one is under way"));
        assert!(futures::poll!(&mut first).is_pending());
        assert!(futures::poll!(&mut second).is_pending());
        drop(first);
        assert!(ended.try_recv() == Err(oneshot::error::TryRecvError::Empty));
        drop(second);
        assert!(ended.try_recv() == Err(oneshot::error::TryRecvError::Closed));
    }
}
