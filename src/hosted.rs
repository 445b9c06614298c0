//! Players that the server hosts.
//!
//! A hosted seat is played like any other: its player sees the engine's observation of that seat and nothing else, and its acts
//! pass the barrier and enter the journal like all acts. A player's decision depends on its earlier observations. So it sees every
//! round in which its agent lives, once and in order, including rounds that it missed; after a restart these are all rounds so
//! far.

use std::sync::Arc;
use std::time::Duration;

use futures::future::{Either, select};
use swarmbench_engine::{Action, AgentId, TaskName, World};
pub use swarmbench_players::DEFAULT_PLAYER;
use swarmbench_players::{Player, Seat, find};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use crate::episode::Status;
use crate::episode::actor::{ActError, Handle, Host};
use crate::episode::lockstep::Submission;
use crate::episode::recovery::RecoveryError;
use crate::episode::replay::state_at;
use crate::episode::spec::Spec;
use crate::fair::{FairLimit, HEAVY_AT_ONCE_MAX, Party, Rank, Shares};
use crate::store::StoreError;
use crate::work::{Cancelled, WorkError};
use swarmbench_clock::after;
use swarmbench_journal::record::Decision;

/// Pause before a game is played again after a temporary failure.
const PLAY_AGAIN: Duration = Duration::from_secs(1);

/// Permits of hosted games to decide and commit a round; a group holds three of four at most. Hosted games would play as fast as
/// the disk allows: this leaves most of each commit to other players.
pub fn permits() -> FairLimit {
    let shares = Shares {
        slots: HEAVY_AT_ONCE_MAX,
        reserve: 0,
        slots_per_group: HEAVY_AT_ONCE_MAX - 1,
        slots_per_member: HEAVY_AT_ONCE_MAX / 2,
        slots_per_single: HEAVY_AT_ONCE_MAX / 2,
        // Each game waits for at most one permit.
        waiting: usize::MAX,
        waiting_per_group: usize::MAX,
    };
    FairLimit::heavy(shares, Duration::MAX)
}

/// Resolves the name of a built-in player, which may be [`DEFAULT_PLAYER`]. An error lists the players of the task.
pub fn player(name: &str, task: TaskName) -> Result<String, String> {
    let found = find(name, task).map_err(|error| error.to_string())?;
    Ok(found.name.to_owned())
}

/// Plays the server's seats in the episodes that it receives, until it is told to stop.
pub async fn run(
    mut episodes: mpsc::UnboundedReceiver<Handle>,
    host: Arc<Host>,
    stop: CancellationToken,
) {
    let permits = permits();
    while let Either::Left((Some(handle), _)) =
        select(Box::pin(episodes.recv()), Box::pin(stop.cancelled())).await
    {
        let (host, stop, permits) = (Arc::clone(&host), stop.clone(), permits.clone());
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

#[derive(Debug, thiserror::Error)]
pub enum HostedError {
    #[error("{0}")]
    Unknown(String),
    /// Earlier observations cannot be replayed.
    #[error(transparent)]
    Recovery(#[from] RecoveryError),
    #[error(transparent)]
    Work(#[from] WorkError),
    #[error(transparent)]
    Journal(#[from] StoreError),
}

impl HostedError {
    /// Whether a retry may succeed: too many others are reading, or waiting for heavy work.
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
pub async fn play(
    handle: Handle,
    host: &Arc<Host>,
    permits: &FairLimit,
) -> Result<(), HostedError> {
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
                    // After a restart some seats have already acted.
                    let acts = decided.into_iter().filter(|(agent, _)| snapshot.waits_for(*agent));
                    for outcome in handle.submit(acts.collect()).await {
                        match outcome {
                            // A clock may have run out, or the episode may have ended.
                            Ok(_) | Err(ActError::Refused(_) | ActError::Busy) => {}
                            Err(ActError::Journal(error)) => return Err(error.into()),
                        }
                    }
                }
                players = Some(all);
            }
        }
        if published.changed().await.is_err() {
            // The actor has ended; the recovery sends the episode again.
            return Ok(());
        }
    }
}

/// Players of one episode's hosted seats. The episode's reservation includes their memory.
pub struct Players {
    seats: Vec<(AgentId, Box<dyn Player>)>,
    /// First round that the players have not been shown.
    shown: u32,
}

impl Players {
    /// Players of these seats, by name, before any round.
    pub fn new(spec: &Spec, hosted: &[(AgentId, String)]) -> Result<Self, HostedError> {
        let made = hosted.iter().map(|(agent, name)| {
            let built_in = find(name, spec.config.task());
            let built_in = built_in.map_err(|error| HostedError::Unknown(error.to_string()))?;
            let salt = spec.salt.as_deref().unwrap_or_default();
            Ok((*agent, built_in.make(&Seat::hosted(&spec.config, *agent, salt.as_bytes()))))
        });
        let seats = made.collect::<Result<_, HostedError>>()?;
        Ok(Self { seats, shown: 0 })
    }

    /// Shows the next round to the players of living agents, and returns their decisions.
    pub fn decide(&mut self, world: &World) -> Vec<(AgentId, Submission)> {
        let seats = self.seats.iter_mut().filter(|(agent, _)| world.is_alive(*agent));
        let decided = seats.map(|(agent, player)| (*agent, decision(world, *agent, &mut **player)));
        let decided = decided.collect();
        self.shown = world.round() + 1;
        decided
    }

    /// Decides a round on a worker thread, however short it takes: hosted games would play as fast as the disk allows. The queue
    /// needs no bound, as each game has one decision at a time.
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
