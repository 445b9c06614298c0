//! Players that the server itself hosts.
//!
//! A hosted seat is played like any other: its player is shown the engine's observation of that seat
//! and nothing else, and its acts go the way of all acts, to the barrier and into the journal. What a
//! player decides follows from what it was shown before. So it is shown every round in which its agent
//! lives, once and in order, also those that went by without it; after a restart that are all rounds
//! so far, and the game continues as if nothing had happened.

use std::sync::Arc;
use std::time::Duration;

use futures::future::{Either, select};
use sha2::{Digest, Sha256};
use swarmbench_engine::{Action, AgentId, TaskName, World};
pub use swarmbench_players::DEFAULT_PLAYER;
use swarmbench_players::{Player, Seat, find};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use crate::clock::after;
use crate::episode::Status;
use crate::episode::actor::{ActError, Handle, Host};
use crate::episode::lockstep::Submission;
use crate::episode::recovery::RecoveryError;
use crate::episode::replay::state_at;
use crate::episode::spec::Spec;
use crate::fair::{FairLimit, Party, Rank, Shares};
use crate::journal::record::Decision;
use crate::store::StoreError;
use crate::work::{Cancelled, WorkError};

/// Rounds of hosted games that are decided, or on their way to the disk, at once. Hosted games would play as
/// fast as the disk goes; this leaves the larger part of each commit to all others.
pub const HOSTED_ROUNDS_MAX: usize = 4;

/// How long a game waits whose players could not be shown what they had seen, as too many others read.
const PLAY_AGAIN: Duration = Duration::from_secs(1);

/// Permits of hosted games to play a round: a group has no more than three of four.
#[must_use]
pub fn permits() -> FairLimit {
    let shares = Shares {
        slots: HOSTED_ROUNDS_MAX,
        reserve: 0,
        slots_per_group: HOSTED_ROUNDS_MAX - 1,
        slots_per_member: HOSTED_ROUNDS_MAX / 2,
        // Each game waits for one permit at most.
        waiting: usize::MAX,
        waiting_per_group: usize::MAX,
    };
    FairLimit::new("hosted_rounds_max", shares, Duration::MAX)
}

/// The name of the player that plays a task under this name, which may be that of each task's own.
///
/// # Errors
/// Where no player of that name plays the task; the text names those that do.
pub fn player(name: &str, task: TaskName) -> Result<String, String> {
    let found = find(name, task).map_err(|error| error.to_string())?;
    Ok(found.name.to_owned())
}

/// Plays the server's seats of all episodes that come, until it is asked to stop.
pub async fn run(
    mut episodes: mpsc::UnboundedReceiver<Handle>,
    host: Host,
    stop: CancellationToken,
) {
    let permits = permits();
    while let Either::Left((Some(handle), _)) =
        select(Box::pin(episodes.recv()), Box::pin(stop.cancelled())).await
    {
        let (host, stop, permits) = (host.clone(), stop.clone(), permits.clone());
        tokio::spawn(async move {
            let id = handle.id.clone();
            let party = handle.party;
            loop {
                let playing = Box::pin(party.scope(play(handle.clone(), &host, &permits)));
                match select(playing, Box::pin(stop.cancelled())).await {
                    // The database closes when the server stops.
                    Either::Left((Err(_), _)) if stop.is_cancelled() => return,
                    Either::Left((Err(error), _)) if error.is_temporary() && !handle.is_dead() => {
                        tracing::warn!(episode = %id, %error, "hosted seats are not played at the moment; retrying soon");
                        host.clock.sleep_until(after(host.clock.now(), PLAY_AGAIN)).await;
                    }
                    Either::Left((Err(error), _)) => {
                        tracing::error!(episode = %id, %error, "hosted seats are no longer played");
                        return;
                    }
                    Either::Left((Ok(()), _)) | Either::Right(_) => return,
                }
            }
        });
    }
}

/// Why hosted seats cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum HostedError {
    /// An episode names a player that is not built in.
    #[error("{0}")]
    Unknown(String),
    /// Earlier observations cannot be replayed.
    #[error(transparent)]
    Recovery(#[from] RecoveryError),
    /// A player failed.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// An act could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

impl HostedError {
    /// Whether the same will work later: too many others read or wanted heavy work at the moment.
    fn is_temporary(&self) -> bool {
        match self {
            Self::Recovery(RecoveryError::Journal(error)) | Self::Journal(error) => {
                matches!(error, StoreError::Busy)
            }
            Self::Recovery(RecoveryError::Work(error)) | Self::Work(error) => {
                *error == WorkError::Busy
            }
            Self::Recovery(RecoveryError::Broken { .. }) | Self::Unknown(_) => false,
        }
    }
}

/// Plays the server's seats of one episode to its end.
///
/// # Errors
/// Where players or their memory cannot be created, or the journal fails.
pub async fn play(handle: Handle, host: &Host, permits: &FairLimit) -> Result<(), HostedError> {
    let mut published = handle.follow();
    let mut players: Option<Players> = None;
    loop {
        let snapshot = Arc::clone(&published.borrow_and_update());
        match snapshot.status {
            Status::Finished | Status::Aborted | Status::Abandoned => return Ok(()),
            Status::Waiting => {}
            Status::Running => {
                let mut all = match players.take() {
                    Some(players) => players,
                    None if handle.hosted().is_empty() => return Ok(()),
                    None => Players::new(&handle.spec, handle.hosted())?,
                };
                let _permit = permits.acquire_always(handle.party, Rank::Normal).await;
                let round = snapshot.world.round();
                let mut last = None;
                while all.shown < round {
                    let world = state_at(host, &handle, all.shown, last.as_ref()).await?;
                    (all, _) = all.decide_off_thread(&world, host, handle.party).await?;
                    last = Some(world);
                }
                if all.shown == round {
                    let decided;
                    (all, decided) =
                        all.decide_off_thread(&snapshot.world, host, handle.party).await?;
                    // After a restart some of them may have acted before it.
                    let acts = decided.into_iter().filter(|(agent, _)| snapshot.waits_for(*agent));
                    for outcome in handle.submit(acts.collect()).await {
                        match outcome {
                            // A clock may have run out, or the episode ended.
                            Ok(_) | Err(ActError::Refused(_) | ActError::Busy) => {}
                            Err(ActError::Journal(error)) => return Err(error.into()),
                        }
                    }
                }
                players = Some(all);
            }
        }
        if published.changed().await.is_err() {
            // Its actor has ended; its recovery sends a new handle.
            return Ok(());
        }
    }
}

/// The players of one episode's hosted seats. Their memory is reserved with that of the episode.
pub struct Players {
    seats: Vec<(AgentId, Box<dyn Player>)>,
    /// The first round that they were not shown.
    shown: u32,
}

impl Players {
    /// The players of these seats, by their names; they were shown nothing yet.
    ///
    /// # Errors
    /// Where one is not built in.
    pub fn new(spec: &Spec, hosted: &[(AgentId, String)]) -> Result<Self, HostedError> {
        let made = hosted.iter().map(|(agent, name)| {
            let built_in = find(name, spec.config.task());
            let built_in = built_in.map_err(|error| HostedError::Unknown(error.to_string()))?;
            Ok((*agent, built_in.make(&seat(spec, *agent))))
        });
        let seats = made.collect::<Result<_, HostedError>>()?;
        Ok(Self { seats, shown: 0 })
    }

    /// Shows all that live their observations of the next round, and asks what they do.
    pub fn decide(&mut self, world: &World) -> Vec<(AgentId, Submission)> {
        let seats = self.seats.iter_mut().filter(|(agent, _)| world.is_alive(*agent));
        let decided = seats.map(|(agent, player)| (*agent, decision(world, *agent, &mut **player)));
        let decided = decided.collect();
        self.shown = world.round() + 1;
        decided
    }

    /// Has them decide off the async threads, always: hosted games would play as fast as the disk goes, and so
    /// they leave the processors to all others. It is never refused: each game has one decision at a time.
    async fn decide_off_thread(
        mut self,
        world: &Arc<World>,
        host: &Host,
        party: Party,
    ) -> Result<(Self, Vec<(AgentId, Submission)>), HostedError> {
        let world = Arc::clone(world);
        let work = move |_: &Cancelled<'_>| {
            let decided = self.decide(&world);
            (self, decided)
        };
        Ok(host.workers.run_always("decision", party, Rank::Normal, work).await?)
    }
}

fn decision(world: &World, agent: AgentId, player: &mut dyn Player) -> Submission {
    let mut act = player.decide(&world.observe(agent));
    // A player without a decision stays.
    act.action.get_or_insert(Action::Stay);
    Submission { round: world.round(), decision: Decision::of_player(act) }
}

/// What a player may know of its seat before the game. Its own seed follows from the episode's, so that
/// the same episode is played the same again, but tells nothing of it.
fn seat(spec: &Spec, agent: AgentId) -> Seat {
    let mut hash = Sha256::new();
    hash.update("the player of a seat");
    hash.update(spec.config.settings().seed.to_be_bytes());
    hash.update(agent.0.to_be_bytes());
    hash.update(spec.salt.as_deref().unwrap_or_default());
    let hash: [u8; 32] = hash.finalize().into();
    let seed = u64::from_be_bytes(*hash.first_chunk().expect("a hash has 32 bytes"));
    Seat { seed, ..Seat::of(&spec.config, agent, 0) }
}
