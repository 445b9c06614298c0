//! Replays of stored rounds: for states of earlier rounds, and of episodes from their layout on.

use std::sync::Arc;

use futures::try_join;
use swarmbench_engine::{Digest, World};

use super::actor::{Handle, Host};
use super::heavy::{self, off_thread, step_micros};
use super::replays::RecoveryError;
use crate::fair::{Party, Rank};
use crate::ids::{EpisodeId, EpisodeKey};
use crate::store::port::{RoundActs, StoredEpisode, StoredRound};
use crate::work::Cancelled;
use swarmbench_journal::replay::{Replayer, RoundFault, acts_of};

/// Maximum number of rounds that are read and played in one piece.
const ROUNDS_MAX: u32 = 64;

/// Maximum number of acts that are read in one piece.
const ACTS_MAX: u32 = 4096;

/// Maximum bytes of an act in a replay, which leaves out its answer and its reasoning.
const ACT_BYTES_MAX: usize = 1024;

/// Microseconds for which rounds are played in one piece; a single round may take longer.
const PIECE_MICROS: u64 = 100_000;

/// Number of rounds of an episode that are read and played in one piece.
fn rounds_at_once(config: &swarmbench_engine::Config) -> u32 {
    let by_acts = ACTS_MAX / u32::from(config.num_agents()).max(1);
    let by_time = u32::try_from(PIECE_MICROS / step_micros(config)).unwrap_or(ROUNDS_MAX);
    by_acts.min(by_time).clamp(1, ROUNDS_MAX)
}

/// Estimated bytes of the acts of `rounds` rounds during a replay. They are reserved even where none are free: `replays_max`
/// bounds the replays and recoveries that run at once.
fn acts_bytes(config: &swarmbench_engine::Config, rounds: u32) -> usize {
    rounds as usize * usize::from(config.num_agents()) * ACT_BYTES_MAX
}

/// Stored rounds to play again.
pub struct Rounds<'a> {
    pub id: &'a EpisodeId,
    pub key: EpisodeKey,
    /// Round up to which to play.
    pub to: u32,
    /// Whether to compare every state with its stored digest.
    pub checked: bool,
    /// Kind of work for the metrics, and the party for which it is done.
    pub work: (&'static str, Party),
    /// Estimated time of `see` for a round, in microseconds.
    pub see_micros: u64,
}

impl<'a> Rounds<'a> {
    /// The first `to` rounds of a stored episode, for a reader of every state.
    pub const fn of(
        stored: &'a StoredEpisode,
        to: u32,
        work: (&'static str, Party),
        see_micros: u64,
    ) -> Self {
        Self { id: &stored.id, key: stored.episode, to, checked: false, work, see_micros }
    }

    /// Plays the rounds from `world` on, piece by piece, and yields in between. `see` gets the acts of each round and the state
    /// after it.
    pub async fn play<S: Send + 'static>(
        self,
        host: &Host,
        world: Arc<World>,
        mut seen: S,
        see: fn(&mut S, &RoundActs, &Arc<World>),
    ) -> Result<(Arc<World>, S), RecoveryError> {
        let Self { id, key, to: end, checked, work: (kind, party), see_micros } = self;
        let at_once = rounds_at_once(world.config());
        let micros = step_micros(world.config()) + see_micros;
        let mut replayer = Replayer::new(world);
        while replayer.world().round() < end {
            let from = replayer.world().round();
            let to = end.min(from + at_once);
            let _memory = host.budget.take(acts_bytes(replayer.world().config(), to - from), None);
            let rounds = async {
                if checked { host.journal.rounds(key, from, to).await.map(Some) } else { Ok(None) }
            };
            let (acts, rounds) = try_join!(host.journal.acts(key, from, to), rounds)?;
            let piece = Piece { to, acts, rounds };
            let play = move |cancelled: &Cancelled<'_>| {
                let result =
                    piece.play(&mut replayer, cancelled, |acts, world| see(&mut seen, acts, world));
                result.map(|()| (replayer, seen))
            };
            // A caller that looks at every state is in no hurry.
            let is_heavy = see_micros > 0 || heavy::is_long(micros * u64::from(to - from));
            let share = (party, Rank::Normal);
            (replayer, seen) = off_thread(&host.workers, kind, share, is_heavy, play)
                .await?
                .map_err(|problem| RecoveryError::Broken { episode: id.to_string(), problem })?;
        }
        Ok((replayer.into_world(), seen))
    }
}

/// Rounds that were read together.
struct Piece {
    to: u32,
    acts: Vec<(u32, RoundActs)>,
    rounds: Option<Vec<StoredRound>>,
}

impl Piece {
    fn play(
        self,
        replayer: &mut Replayer,
        cancelled: &Cancelled<'_>,
        mut see: impl FnMut(&RoundActs, &Arc<World>),
    ) -> Result<(), String> {
        let mut acts = self.acts.into_iter().peekable();
        let mut stored = self.rounds.map(|rounds| rounds.into_iter().peekable());
        for round in replayer.world().round()..self.to {
            if cancelled.is_cancelled() {
                return Err("nobody waits for the replay any more".to_owned());
            }
            let digest = match &mut stored {
                Some(stored) => {
                    let stored = stored.next_if(|stored| stored.round == round);
                    let stored = stored.ok_or_else(|| format!("round {round} is missing"))?;
                    Some(Digest(stored.digest).to_string())
                }
                None => None,
            };
            let given = acts.next_if(|(number, _)| *number == round);
            let given = given.map(|(_, acts)| acts).unwrap_or_default();
            let at = |fault: RoundFault| format!("round {round}: {fault}");
            let acts = acts_of(replayer.world().config(), given.iter().map(|(_, act)| &act.record));
            replayer.play(round, &acts.map_err(at)?, digest.as_deref()).map_err(at)?;
            see(&given, replayer.world());
        }
        Ok(())
    }
}

/// Computes the state after `round` rounds with the stored acts, from the last keyframe before it, or from `near` where that is
/// nearer.
pub async fn state_at(
    host: &Arc<Host>,
    handle: &Handle,
    round: u32,
    near: Option<&Arc<World>>,
) -> Result<Arc<World>, RecoveryError> {
    let keyframe = handle.keyframe(round);
    let near = near.filter(|near| (keyframe.round()..=round).contains(&near.round()));
    let from = near.unwrap_or(&keyframe);
    if from.round() == round {
        return Ok(Arc::clone(from));
    }
    let key = (handle.key, round);
    if let Some(world) = host.replays.recent(key) {
        return Ok(world);
    }
    let replay = host.replays.of(key, || {
        let (host, handle, from) = (Arc::clone(host), handle.clone(), Arc::clone(from));
        Box::pin(async move {
            let work = ("replay", Party::current());
            let (id, checked) = (&handle.id, false);
            let rounds = Rounds { id, key: handle.key, to: round, checked, work, see_micros: 0 };
            let (world, ()) = rounds.play(&host, from, (), |(), _, _| {}).await?;
            host.replays.keep(key, &world);
            Ok(world)
        })
    });
    replay.await
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::{Config, Settings, TaskName};

    use super::*;

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
