//! Plays an episode, or a whole run, with a built-in player for every seat, over real HTTP.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use swarmbench_engine::{AgentId, RuleSet, TaskName};
use swarmbench_players::{BuiltIn, Player, Seat};

use super::client::{Client, ClientError};
use crate::wire::act::{ActRequest, SwarmAct, SwarmReceipt};
use crate::wire::episode::{CreatedEpisode, EpisodeSummary};
use crate::wire::observation::{Observation, Sight};
use crate::wire::run::RunDetail;

/// Seconds that one look waits for something to happen.
const WAIT_S: u32 = 30;

/// An episode could not be played.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// A request failed.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// An act was refused.
    #[error("the server refused an act of {agent} in round {round}: {detail}")]
    Refused {
        /// Whose act.
        agent: String,
        /// For which round.
        round: u32,
        /// Why.
        detail: String,
    },
    /// An observation cannot be understood.
    #[error("the server sent an observation that no player understands (round {0})")]
    Strange(u32),
}

/// Plays an episode to its end; `progress` is told the round and the score after every round.
///
/// # Errors
/// See [`PlayError`].
pub async fn play(
    client: &Client,
    created: &CreatedEpisode,
    player: &BuiltIn,
    player_seed: u64,
    mut progress: impl FnMut(u32, f64),
) -> Result<EpisodeSummary, PlayError> {
    let config = &created.config;
    let mut players: BTreeMap<String, Box<dyn Player>> = BTreeMap::new();
    let decide = |observation: &Observation| {
        let sight = &observation.sight;
        let player = match players.entry(sight.agent.clone()) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let size = (config.num_agents.into(), config.width, config.height);
                let seat = seat(&config.task, &config.rules, size, &sight.agent, player_seed);
                new.insert(player.make(&seat.ok_or(PlayError::Strange(sight.round))?))
            }
        };
        progress(sight.round, sight.score);
        self::decide(&mut **player, observation)
    };
    play_seats(client, &created.swarm_token, decide).await?;
    let summary = client.episode(&created.id).await?;
    progress(summary.round, summary.score);
    Ok(summary)
}

/// Plays what is left of a run with built-in players; `progress` is told of every observation.
///
/// # Errors
/// See [`PlayError`].
pub async fn play_run(
    client: &Client,
    run: &RunDetail,
    token: &str,
    player: impl Fn(TaskName) -> Option<&'static BuiltIn>,
    player_seed: u64,
    mut progress: impl FnMut(&Sight),
) -> Result<RunDetail, PlayError> {
    let suite = &run.run.suite;
    let settings = &suite.settings;
    let size = (settings.num_agents, settings.width, settings.height);
    let mut players: BTreeMap<(String, String), Box<dyn Player>> = BTreeMap::new();
    let decide = |observation: &Observation| {
        let sight = &observation.sight;
        let player = match players.entry((sight.episode.clone(), sight.agent.clone())) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(new) => {
                let seat = seat(&sight.task.name, &suite.rules, size, &sight.agent, player_seed);
                let made = seat.and_then(|seat| Some(player(seat.task)?.make(&seat)));
                new.insert(made.ok_or(PlayError::Strange(sight.round))?)
            }
        };
        progress(sight);
        self::decide(&mut **player, observation)
    };
    play_seats(client, token, decide).await?;
    Ok(client.run(&run.run.id, Some(token)).await?)
}

/// Has all seats of a swarm token decide, whenever they are to, until all is over.
async fn play_seats(
    client: &Client,
    token: &str,
    mut decide: impl FnMut(&Observation) -> Result<SwarmAct, PlayError>,
) -> Result<(), PlayError> {
    let mut cursor: Option<String> = None;
    loop {
        let look = client.swarm_obs(token, cursor.as_deref(), WAIT_S).await?;
        if look.finished {
            return Ok(());
        }
        let acts = look.observations.iter().map(&mut decide).collect::<Result<Vec<_>, _>>()?;
        if !acts.is_empty() {
            let sent = acts.clone();
            let done = client.swarm_act(token, acts).await?;
            check(&sent, &done.receipts)?;
        }
        cursor = Some(look.cursor);
    }
}

/// What a player may know of its seat before the game.
fn seat(
    task: &str,
    rules: &str,
    (num_agents, width, height): (i64, i64, i64),
    name: &str,
    seed: u64,
) -> Option<Seat> {
    let agent = AgentId::parse(name)?;
    Some(Seat {
        agent,
        num_agents: u16::try_from(num_agents).ok()?,
        width: u16::try_from(width).ok()?,
        height: u16::try_from(height).ok()?,
        task: TaskName::parse(task)?,
        rules: RuleSet::ALL.into_iter().find(|known| known.name() == rules)?,
        seed: Seat::seed_of(agent, seed),
    })
}

fn decide(player: &mut dyn Player, observation: &Observation) -> Result<SwarmAct, PlayError> {
    let sight = &observation.sight;
    let seen = sight.to_engine().ok_or(PlayError::Strange(sight.round))?;
    let act = player.decide(&seen);
    let request = ActRequest {
        round: sight.round,
        // Whoever decides nothing stays where it is.
        action: Some(act.action.map_or("STAY", |action| action.name()).to_owned()),
        message: act.message.map(|message| message.to_string()),
        to: act.to.map(|to| to.to_string()),
        ..ActRequest::default()
    };
    Ok(SwarmAct::of(sight.episode.clone(), sight.agent.clone(), request))
}

/// A clock may have run out or somebody aborted the episode; anything else is an error.
fn check(sent: &[SwarmAct], receipts: &[SwarmReceipt]) -> Result<(), PlayError> {
    for (act, receipt) in sent.iter().zip(receipts) {
        if let SwarmReceipt::Problem(problem) = receipt
            && !["round_over", "episode_over"].contains(&problem.code.as_str())
        {
            return Err(PlayError::Refused {
                agent: act.agent.clone(),
                round: act.round,
                detail: problem.detail.clone(),
            });
        }
    }
    Ok(())
}
