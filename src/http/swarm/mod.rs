//! Routes for many seats in one call: of one episode, or of all episodes of a run.

pub(super) mod act;
pub(super) mod acts;
mod next;
pub(super) mod obs;

use std::collections::HashSet;

use futures::future::join_all;
use swarmbench_engine::AgentId;
use tokio::sync::watch;

use super::App;
use super::auth::Swarm;
use super::error::{ApiError, Code};
use crate::episode::actor::Handle;
use crate::ids::{EpisodeId, RunKey};
use crate::run::manager::OpenGames;
use crate::store::tokens::Seats;

/// Seats of one episode, among those that a token authorizes.
struct Seated {
    handle: Handle,
    seats: Seats,
}

impl Seated {
    fn holds(&self, agent: AgentId) -> bool {
        match &self.seats {
            Seats::Creators => self.handle.spec.is_creators(agent),
            Seats::Claimed(seats) => seats.contains(&agent),
            Seats::OfTeam(number) => self.handle.spec.is_of_team_holder(*number, agent),
        }
    }
}

/// Seats that a token authorizes: of an episode, or of the open games of a run.
enum Source {
    Episode(Seated),
    Run {
        run: RunKey,
        seats: Seats,
        open_games: watch::Receiver<OpenGames>,
        games: Option<HashSet<EpisodeId>>,
    },
}

impl Source {
    async fn of(app: &App, swarm: Swarm) -> Result<Self, ApiError> {
        Ok(match swarm {
            Swarm::Episode(id, seats) => {
                Self::Episode(Seated { handle: app.episode(&id).await?, seats })
            }
            Swarm::Run(run, seats) => {
                Self::Run { run, seats, open_games: app.runs.follow(run).await?, games: None }
            }
        })
    }

    /// Episodes with seats that may be waiting, and for a run whether it is over.
    async fn open(&mut self, app: &App) -> Result<(Vec<Seated>, Option<bool>), ApiError> {
        match self {
            Self::Episode(Seated { handle, seats }) => {
                Ok((vec![Seated { handle: handle.clone(), seats: seats.clone() }], None))
            }
            Self::Run { seats, open_games, .. } => {
                let OpenGames { open, is_over } = open_games.borrow_and_update().clone();
                let mut seated = Vec::with_capacity(open.len());
                for found in join_all(open.iter().map(|id| app.episode(id))).await {
                    match found {
                        Ok(handle) => seated.push(Seated { handle, seats: seats.clone() }),
                        // A broken journal was already logged; the other games can be played.
                        Err(error) if error.code() == Code::Internal => {}
                        Err(error) => return Err(error),
                    }
                }
                Ok((seated, Some(is_over)))
            }
        }
    }

    /// The run has other open games than at the last listing.
    fn has_changed(&self) -> bool {
        match self {
            Self::Episode(_) => false,
            Self::Run { open_games, .. } => open_games.has_changed().unwrap_or(false),
        }
    }

    /// Finds the episode again after its actor has ended.
    async fn find_again(&mut self, app: &App) -> Result<(), ApiError> {
        if let Self::Episode(Seated { handle, .. }) = self {
            *handle = app.episode(&handle.id.clone()).await?;
        }
        Ok(())
    }

    /// The episode, or the run with all its games, is over.
    fn is_over(&self) -> bool {
        match self {
            Self::Episode(Seated { handle, .. }) => handle.snapshot().status.is_over(),
            Self::Run { open_games, .. } => open_games.borrow().is_over,
        }
    }

    /// Seats in one episode, also after its end; `None` if the token has no seat there.
    async fn find(&mut self, app: &App, episode: &str) -> Result<Option<Seated>, ApiError> {
        match self {
            Self::Episode(Seated { handle, seats }) => {
                let is_it = handle.id.as_str() == episode;
                Ok(is_it.then(|| Seated { handle: handle.clone(), seats: seats.clone() }))
            }
            Self::Run { run, seats, open_games, games } => {
                let id = EpisodeId::from_text(episode.to_owned());
                let is_open = open_games.borrow().open.contains(&id);
                if !is_open {
                    if games.is_none() {
                        let all = app.store.games_of(*run).await?.into_iter();
                        *games = Some(all.map(|game| game.id).collect());
                    }
                    if !games.as_ref().is_some_and(|games| games.contains(&id)) {
                        return Ok(None);
                    }
                }
                Ok(Some(Seated { handle: app.episode(&id).await?, seats: seats.clone() }))
            }
        }
    }

    /// Completes when other games of the run are open.
    async fn changed(&mut self) {
        let is_changed = match self {
            Self::Episode(_) => false,
            Self::Run { open_games, .. } => open_games.changed().await.is_ok(),
        };
        if !is_changed {
            std::future::pending::<()>().await;
        }
    }
}
