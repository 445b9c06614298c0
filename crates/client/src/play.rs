//! Plays an episode, or a whole run, with a built-in player for every seat, over real HTTP.

use std::collections::BTreeMap;
use std::sync::Arc;

use swarmbench_engine::physics::Solver;
use swarmbench_engine::{Act, AgentId, RuleSet, TaskName};
use swarmbench_players::{BuiltIn, Player, Seat};
use tokio::sync::Mutex;
use tokio_util::sync::CancellationToken;

use super::client::Client;
use super::drive::{DriveError, Note, Swarm, Thought, drive};
use super::recent::Recent;
use swarmbench_journal::replay::verify_seen;
use swarmbench_protocol::act::{ActRequest, SwarmAct};
use swarmbench_protocol::episode::{CreatedEpisode, EpisodeSummary};
use swarmbench_protocol::observation::{Observation, Sight};
use swarmbench_protocol::run::RunDetail;

/// An error of a built-in player.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlayerError {
    /// An observation cannot be understood.
    #[error("the server sent an observation that no player understands (round {0})")]
    Strange(u32),
    /// There is no player for this task.
    #[error("no player was chosen for {0}")]
    Task(String),
}

/// The players by task.
pub type Players = BTreeMap<TaskName, &'static BuiltIn>;

/// An error that ends the play of an episode.
pub type PlayError = DriveError<PlayerError>;

/// Plays an episode to its end; calls `progress` with the round and the score after every round.
///
/// # Errors
/// See [`DriveError`].
pub async fn play(
    client: &Client,
    created: &CreatedEpisode,
    player: &'static BuiltIn,
    player_seed: u64,
    mut progress: impl FnMut(u32, f64),
) -> Result<EpisodeSummary, PlayError> {
    let config = &created.config;
    let params = GameParams {
        rules: config.rules.clone(),
        num_agents: config.num_agents.into(),
        width: config.width,
        height: config.height,
    };
    let token = &created.swarm_token;
    let players = player.tasks.iter().map(|&task| (task, player)).collect();
    let mut swarm = BuiltIns::new(client, token, params, player_seed, players);
    finish(client, token, &mut swarm, |sight| progress(sight.round, sight.score)).await?;
    let summary = client.episode(&created.id).await?;
    progress(summary.round, summary.score);
    Ok(summary)
}

/// Plays the rest of a run with built-in players; calls `progress` with every observation.
///
/// # Errors
/// See [`DriveError`].
pub async fn play_run(
    client: &Client,
    run: &RunDetail,
    token: &str,
    players: Players,
    player_seed: u64,
    progress: impl FnMut(&Sight),
) -> Result<RunDetail, PlayError> {
    let mut swarm = BuiltIns::new(client, token, GameParams::of(run), player_seed, players);
    finish(client, token, &mut swarm, progress).await?;
    Ok(client.run(&run.run.id, Some(token)).await?)
}

async fn finish(
    client: &Client,
    token: &str,
    swarm: &mut BuiltIns,
    mut progress: impl FnMut(&Sight),
) -> Result<(), PlayError> {
    drive(client, token, swarm, &CancellationToken::new(), |note| {
        if let Note::Looked(looked) = note {
            for seen in looked {
                progress(&seen.sight);
            }
        }
    })
    .await
    .map(|_| ())
}

/// Facts that players know of a game before it begins, beside its task.
#[derive(Clone, Debug)]
pub struct GameParams {
    rules: String,
    num_agents: i64,
    width: i64,
    height: i64,
}

impl GameParams {
    /// The parameters of all games of a run.
    #[must_use]
    pub fn of(run: &RunDetail) -> Self {
        let settings = &run.run.suite.settings;
        Self {
            rules: run.run.suite.rules.clone(),
            num_agents: settings.num_agents,
            width: settings.width,
            height: settings.height,
        }
    }

    /// Facts that a player may know of its seat before the game.
    fn seat(&self, task: TaskName, agent: AgentId, seed: u64) -> Option<Seat> {
        Some(Seat {
            agent,
            num_agents: u16::try_from(self.num_agents).ok()?,
            width: u16::try_from(self.width).ok()?,
            height: u16::try_from(self.height).ok()?,
            task,
            rules: RuleSet::ALL.into_iter().find(|known| known.name() == self.rules)?,
            seed: Seat::seed_of(agent, seed),
        })
    }
}

/// Built-in players on all seats of a swarm token.
///
/// Players that join a running game first get their earlier observations from the journal, so that they decide as if
/// they had played from the start.
pub struct BuiltIns {
    client: Client,
    token: String,
    params: Arc<GameParams>,
    seed: u64,
    players: Players,
    games: Recent<Arc<Mutex<GamePlayers>>>,
}

impl BuiltIns {
    /// Creates the players of each task; `seed` determines their own choices.
    #[must_use]
    pub fn new(
        client: &Client,
        token: &str,
        params: GameParams,
        seed: u64,
        players: Players,
    ) -> Self {
        Self {
            client: client.clone(),
            token: token.to_owned(),
            params: Arc::new(params),
            seed,
            players,
            games: Recent::default(),
        }
    }

    fn decide_game(&mut self, episode: String, looked: Vec<Observation>) -> Thought<PlayerError> {
        let sight = &looked[0].sight;
        let (name, round) = (sight.task.name.clone(), sight.round);
        let task = TaskName::parse(&name);
        let Some((task, built_in)) = task.and_then(|task| Some((task, *self.players.get(&task)?)))
        else {
            return Box::pin(async move { Err(PlayerError::Task(name)) });
        };
        let game = self.games.of(&episode, || {
            let (params, seed) = (Arc::clone(&self.params), self.seed);
            let make = move |agent| Some(built_in.make(&params.seat(task, agent, seed)?));
            Arc::new(Mutex::new(GamePlayers {
                make: Box::new(make),
                players: BTreeMap::new(),
                decided: BTreeMap::new(),
            }))
        });
        let (client, token, game) = (self.client.clone(), self.token.clone(), Arc::clone(game));
        Box::pin(async move {
            let mut game = game.lock_owned().await;
            // An earlier answer may have brought other seats of this game.
            let is_new = round > 0 && game.players.is_empty();
            // A journal that may not be read, as in a competition, leaves players without memory.
            let journal =
                if is_new { client.journal(&episode, Some(&token)).await.ok() } else { None };
            let decide = move || {
                if let Some(journal) = journal {
                    game.remember(&journal);
                }
                looked.iter().map(|seen| game.decide(seen)).collect()
            };
            match tokio::task::spawn_blocking(decide).await {
                Ok(decided) => decided,
                Err(error) => std::panic::resume_unwind(error.into_panic()),
            }
        })
    }
}

impl Swarm for BuiltIns {
    type Error = PlayerError;

    fn reads_prompts(&self) -> bool {
        false
    }

    fn decide(&mut self, looked: Vec<Observation>) -> Vec<Thought<PlayerError>> {
        let mut games: BTreeMap<String, Vec<Observation>> = BTreeMap::new();
        for seen in looked {
            games.entry(seen.sight.episode.clone()).or_default().push(seen);
        }
        games.into_iter().map(|(episode, looked)| self.decide_game(episode, looked)).collect()
    }
}

/// The players of one game.
struct GamePlayers {
    make: Box<dyn Fn(AgentId) -> Option<Box<dyn Player>> + Send>,
    players: BTreeMap<AgentId, Box<dyn Player>>,
    /// The last decision of each agent, with its round, from the replay of the journal.
    decided: BTreeMap<AgentId, (u32, Act)>,
}

impl GamePlayers {
    fn player(&mut self, agent: AgentId) -> Option<&mut Box<dyn Player>> {
        if !self.players.contains_key(&agent) {
            self.players.insert(agent, (self.make)(agent)?);
        }
        self.players.get_mut(&agent)
    }

    /// Replays all earlier observations to the players, those of the open round included: some seats may have acted
    /// in it.
    fn remember(&mut self, journal: &[u8]) {
        // `verify` reports a broken journal; the readable part was replayed.
        drop(verify_seen(journal, None, Solver::Flow, |world, _| {
            for agent in world.agents().filter(|&agent| world.is_alive(agent)) {
                if let Some(player) = self.player(agent) {
                    let act = player.decide(&world.observe(agent));
                    self.decided.insert(agent, (world.round(), act));
                }
            }
        }));
    }

    fn decide(&mut self, observation: &Observation) -> Result<SwarmAct, PlayerError> {
        let sight = &observation.sight;
        let strange = || PlayerError::Strange(sight.round);
        let seen = sight.to_engine().ok_or_else(strange)?;
        let act = match self.decided.remove(&seen.agent) {
            Some((round, act)) if round == seen.round => act,
            _ => self.player(seen.agent).ok_or_else(strange)?.decide(&seen),
        };
        let request = ActRequest {
            round: sight.round,
            // A player that decides nothing stays.
            action: Some(act.action.map_or("STAY", |action| action.name()).to_owned()),
            message: act.message.map(|message| message.to_string()),
            to: act.to.map(|to| to.to_string()),
            ..ActRequest::default()
        };
        Ok(SwarmAct::of(sight.episode.clone(), sight.agent.clone(), request))
    }
}
