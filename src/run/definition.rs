//! The definition of a run, as it is stored and played.

pub use swarmbench_boards::run::Definition;
use swarmbench_protocol::suite::PlannedGame;

use super::RunError;
use crate::episode::spec::Spec;
use crate::hosted;
use crate::store::runs::StoredRun;

/// Parses the definition of a stored run, and applies the current end of its window.
pub fn read(stored: &StoredRun) -> Result<Definition, RunError> {
    let decided: Definition = serde_json::from_str(&stored.definition).map_err(|error| {
        RunError::Definition { run: stored.id.clone(), problem: error.to_string() }
    })?;
    let closes_at = stored.closes_at.or(decided.closes_at);
    Ok(Definition { closes_at, ..decided })
}

/// Specification of one game of a run.
pub fn spec(
    definition: &Definition,
    run: &str,
    game: &PlannedGame,
    salt: Option<String>,
) -> Result<Spec, String> {
    let recorded = definition.recorded(game).map_err(|error| error.to_string())?;
    let template = definition.prompt_template.as_deref().unwrap_or(swarmbench_prompt::BUILT_IN);
    let spec = Spec::of(&recorded, &definition.agent_meta(), template)?;
    let player = definition.player.as_deref();
    let player = player.map(|name| hosted::player(name, spec.config.task())).transpose()?;
    let mut holders = spec.holders.clone();
    for holder in &mut holders {
        let task = spec.config.task();
        holder.player =
            holder.player.as_ref().map(|name| hosted::player(name, task)).transpose()?;
    }
    let own_games = definition.own_games;
    Ok(Spec { run: Some(run.to_owned()), salt, player, holders, own_games, ..spec })
}
