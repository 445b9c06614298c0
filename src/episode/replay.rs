//! States of earlier rounds: replayed from a cached state, once for concurrent requests.

use std::collections::HashMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard};

use futures::FutureExt;
use futures::future::{Shared, WeakShared};
use quick_cache::Weighter;
use quick_cache::sync::Cache;
use swarmbench_engine::World;

use super::actor::{Handle, Host};
use super::heavy::{self, off_thread, step_micros};
use super::recovery::RecoveryError;
use crate::fair::{Party, Rank};
use crate::ids::EpisodeKey;
use crate::journal::replay::acts_of;
use crate::store::port::RoundActs;
use crate::work::Cancelled;

/// Bytes of cached states.
const RECENT_BYTES_MAX: u64 = 32 * 1024 * 1024;

/// The initial capacity of the cache of states.
const RECENT_EXPECTED: usize = 256;

/// Rounds that are read and played at once.
const ROUNDS_MAX: u32 = 64;

/// Acts that are read at once.
const ACTS_MAX: u32 = 4096;

/// Bytes of an act as it is played again, at most: without its answer and its reasons.
const ACT_BYTES_MAX: usize = 1024;

/// Microseconds for which rounds are played in one piece; a single round may take longer.
const PIECE_MICROS: u64 = 100_000;

/// How many rounds of an episode are read and played in one piece.
pub(super) fn rounds_at_once(config: &swarmbench_engine::Config) -> u32 {
    let by_acts = ACTS_MAX / u32::from(config.num_agents()).max(1);
    let by_time = u32::try_from(PIECE_MICROS / step_micros(config)).unwrap_or(ROUNDS_MAX);
    by_acts.min(by_time).clamp(1, ROUNDS_MAX)
}

/// Estimated bytes of the acts of `rounds` rounds during a replay. They are reserved, free or not: only so
/// many replays and recoveries run at once (`replays_max`, `take_ups_max`).
pub(super) fn acts_bytes(config: &swarmbench_engine::Config, rounds: u32) -> usize {
    rounds as usize * usize::from(config.num_agents()) * ACT_BYTES_MAX
}

/// A state of an episode: its number, and the round.
type Key = (EpisodeKey, u32);

type Replayed = Result<Arc<World>, RecoveryError>;

type Replay = Pin<Box<dyn Future<Output = Replayed> + Send>>;

#[derive(Clone)]
struct Bytes;

impl Weighter<Key, Arc<World>> for Bytes {
    fn weight(&self, _: &Key, world: &Arc<World>) -> u64 {
        world.approximate_bytes() as u64
    }
}

/// Replays in progress, and the states that they computed lately.
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
    fn under_way(&self) -> MutexGuard<'_, HashMap<Key, WeakShared<Replay>>> {
        self.under_way.lock().expect("nothing panics while it holds this")
    }

    /// The replay that leads to a state: the one that is under way, or a new one. It ends when nobody waits
    /// for it any more.
    fn of(&self, key: Key, begin: impl FnOnce() -> Replay) -> Shared<Replay> {
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

/// The state after `round` rounds, from a kept state before it, or from `near` where that is nearer,
/// and the stored acts.
///
/// # Errors
/// Where the journal cannot be read or does not play again, or too much heavy work waits.
pub async fn state_at(
    host: &Host,
    handle: &Handle,
    round: u32,
    near: Option<&Arc<World>>,
) -> Result<Arc<World>, RecoveryError> {
    let kept = handle.keyframe(round);
    let near = near.filter(|near| (kept.round()..=round).contains(&near.round()));
    let from = near.unwrap_or(&kept);
    if from.round() == round {
        return Ok(Arc::clone(from));
    }
    let key = (handle.key, round);
    if let Some(world) = host.replays.recent.get(&key) {
        return Ok(world);
    }
    let replay = host.replays.of(key, || {
        let (host, handle, from) = (host.clone(), handle.clone(), Arc::clone(from));
        Box::pin(async move {
            let world = play(&host, &handle, from, round, Party::current()).await?;
            host.replays.recent.insert(key, Arc::clone(&world));
            Ok(world)
        })
    });
    replay.await
}

/// Replays rounds, piece by piece, and yields in between.
async fn play(
    host: &Host,
    handle: &Handle,
    mut world: Arc<World>,
    round: u32,
    party: Party,
) -> Replayed {
    let at_once = rounds_at_once(world.config());
    let micros = step_micros(world.config());
    while world.round() < round {
        let from = world.round();
        let to = round.min(from + at_once);
        let _memory = host.budget.take(acts_bytes(world.config(), to - from), None);
        let acts = host.journal.acts(handle.key, from, to).await?;
        let is_heavy = heavy::is_long(micros * u64::from(to - from));
        let play = move |cancelled: &Cancelled<'_>| steps(&world, &acts, to, cancelled);
        let share = (party, Rank::Normal);
        world = off_thread(&host.workers, "replay", share, is_heavy, play)
            .await?
            .map_err(|problem| RecoveryError::Broken { episode: handle.id.to_string(), problem })?;
    }
    Ok(world)
}

fn steps(
    world: &World,
    acts: &[(u32, RoundActs)],
    to: u32,
    cancelled: &Cancelled<'_>,
) -> Result<Arc<World>, String> {
    let mut world = world.clone();
    let mut acts = acts.iter().peekable();
    while world.round() < to {
        if cancelled.is_cancelled() {
            return Err("nobody waits for it any more".to_owned());
        }
        let given = acts.next_if(|(round, _)| *round == world.round());
        let records = given.iter().flat_map(|(_, acts)| acts).map(|(_, act)| &act.record);
        let acts = acts_of(world.config(), records)?;
        world.step(&acts);
    }
    Ok(Arc::new(world))
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
    async fn a_state_that_many_ask_for_at_once_is_made_once() {
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
        // Nobody holds the first one any more.
        assert!(replays.of((EpisodeKey(1), 5), begin).await.is_ok());
        assert_eq!(begun.load(Ordering::Relaxed), 3);
    }

    #[tokio::test]
    async fn it_goes_on_while_one_waits_and_ends_with_the_last() {
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

    #[test]
    fn rounds_are_played_in_pieces_of_a_tenth_of_a_second() {
        let at_once = |task, agents, view| {
            let mut settings = Settings::standard(task, 1);
            (settings.num_agents, settings.width, settings.height) = (agents, 64, 64);
            (settings.view_size, settings.memory) = (view, 0);
            rounds_at_once(&Config::check(&settings).expect("good settings"))
        };
        assert_eq!(at_once(TaskName::Transport, 10, 5), 64);
        assert_eq!(at_once(TaskName::Transport, 1024, 3), 4);
        assert_eq!(at_once(TaskName::Transport, 256, 63), 4);
        assert_eq!(at_once(TaskName::Flocking, 256, 5), 1);
    }
}
