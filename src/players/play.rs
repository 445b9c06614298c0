//! Plays an episode with a built-in player for every seat, over real HTTP.

use std::collections::BTreeMap;

use swarmbench_engine::{AgentId, RuleSet, TaskName};
use swarmbench_players::{BuiltIn, Player, Seat};

use super::client::{Client, ClientError};
use crate::wire::act::{ActRequest, SwarmAct, SwarmReceipt};
use crate::wire::episode::{CreatedEpisode, EpisodeConfig, EpisodeSummary};
use crate::wire::observation::Observation;

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
    let mut players: BTreeMap<String, Box<dyn Player>> = BTreeMap::new();
    let mut cursor: Option<String> = None;
    loop {
        let look = client.swarm_obs(&created.swarm_token, cursor.as_deref(), WAIT_S).await?;
        if look.finished {
            break;
        }
        let mut acts = Vec::with_capacity(look.observations.len());
        for observation in &look.observations {
            let name = &observation.sight.agent;
            let player = if let Some(player) = players.get_mut(name) {
                player
            } else {
                let seat = seat(&created.config, name, player_seed);
                let seat = seat.ok_or(PlayError::Strange(observation.sight.round))?;
                players.entry(name.clone()).or_insert(player.make(&seat))
            };
            acts.push(decide(&mut **player, observation)?);
            progress(observation.sight.round, observation.sight.score);
        }
        if !acts.is_empty() {
            let sent = acts.clone();
            let done = client.swarm_act(&created.swarm_token, acts).await?;
            check(&sent, &done.receipts)?;
        }
        cursor = Some(look.cursor);
    }
    let summary = client.episode(&created.id).await?;
    progress(summary.round, summary.score);
    Ok(summary)
}

/// What a player may know of its seat before the game.
fn seat(config: &EpisodeConfig, name: &str, seed: u64) -> Option<Seat> {
    let agent = AgentId::parse(name)?;
    Some(Seat {
        agent,
        num_agents: config.num_agents,
        width: u16::try_from(config.width).ok()?,
        height: u16::try_from(config.height).ok()?,
        task: TaskName::parse(&config.task)?,
        rules: RuleSet::ALL.into_iter().find(|rules| rules.name() == config.rules)?,
        seed: seed.wrapping_mul(1 << 16).wrapping_add(u64::from(agent.0)),
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
