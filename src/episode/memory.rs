//! Estimates of an episode's memory, in round numbers: good enough to keep all episodes together within a budget.

use swarmbench_engine::{Config, World};

use super::spec::Spec;
use swarmbench_journal::record::TeamHolder;

/// Maximum bytes of a board's cell.
const CELL: usize = 3;

/// Bytes of an agent in a state: its body, act and message.
const AGENT: usize = 400;

/// Bytes of an agent outside of states: its seat, clock and place in the snapshot.
const SEAT: usize = 400;

/// Bytes of an episode outside of states: its task, channels and description.
const EPISODE: usize = 8 * 1024;

/// Bytes of a hosted player for each cell of the map, and in addition.
const PLAYER_CELL: usize = 16;
const PLAYER: usize = 16 * 1024;

/// Bytes of an episode in the state `world`, with `keyframes` bytes of keyframes and `hosted` players of the server.
pub fn of_episode(spec: &Spec, world: &World, keyframes: usize, hosted: usize) -> usize {
    let players = of_players(&spec.config, hosted);
    beside_states(spec) + players + world.approximate_bytes().saturating_add(keyframes)
}

/// Upper bound of an episode's bytes in round `round`, before its actual size is known and without other states that it keeps.
pub fn expected(spec: &Spec, round: u32, hosted: usize) -> usize {
    beside_states(spec) + of_players(&spec.config, hosted) + of_world(&spec.config, round)
}

/// Estimated bytes of `hosted` players: most of them remember the map that they saw.
fn of_players(config: &Config, hosted: usize) -> usize {
    let settings = config.settings();
    let cells = usize::try_from(settings.width * settings.height).unwrap_or(usize::MAX);
    hosted * (cells * PLAYER_CELL + PLAYER)
}

/// Upper bound of the bytes of the state after `round` rounds.
pub fn of_world(config: &Config, round: u32) -> usize {
    let settings = config.settings();
    let size = |cells: i64| usize::try_from(cells).unwrap_or(usize::MAX);
    let agents = usize::from(config.num_agents());
    let board =
        (size(settings.width) * size(settings.height) * CELL).saturating_add(agents * AGENT);
    let remembered = size(settings.memory).min(round as usize);
    board.saturating_mul(remembered + 1)
}

/// Bytes of the description with the creator's declarations, counted for each game although games of a run share them.
fn beside_states(spec: &Spec) -> usize {
    let template = if spec.custom_template { spec.prompt_template.len() } else { 0 };
    let holder = |holder: &TeamHolder| {
        size_of::<TeamHolder>() + holder.name.len() + holder.model.len() + 2 * holder.seats.len()
    };
    let holders: usize = spec.holders.iter().map(holder).sum();
    let declared = spec.agent_meta.0.len() + template + holders;
    EPISODE + declared + usize::from(spec.config.num_agents()) * SEAT
}

/// Upper bound of the bytes that the worth of `rounds` rounds takes: their decisions, and states and players of the game and of a
/// rollout.
pub fn of_worth(config: &Config, rounds: u32) -> usize {
    let agents = usize::from(config.num_agents());
    rounds as usize * agents * AGENT
        + 3 * of_world(config, config.max_round())
        + 2 * of_players(config, agents)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use swarmbench_engine::{Settings, TaskName};
    use swarmbench_journal::record::RecordedConfig;
    use swarmbench_protocol::carried::Carried;

    fn spec(change: impl FnOnce(&mut Settings)) -> Spec {
        let mut settings = Settings::standard(TaskName::Synchronization, 1);
        change(&mut settings);
        let config = Config::check(&settings).expect("good settings");
        let config =
            RecordedConfig { visibility: "public".to_owned(), ..RecordedConfig::of(&config) };
        Spec::of(&config, &Carried::default(), "").expect("a good spec")
    }

    #[test]
    fn the_standard_setting_is_small_and_the_largest_maps_are_not() {
        let standard = spec(|_| {});
        assert!(expected(&standard, 100, 0) < crate::budget::SMALL_BYTES);
        let agent_meta = Carried(format!("{:?}", "x".repeat(16_000)).into());
        let more = Spec { agent_meta, ..standard.clone() };
        assert_eq!(expected(&more, 100, 0), expected(&standard, 100, 0) + 16_000);
        let large = spec(|settings| {
            (settings.width, settings.height) = (256, 256);
            (settings.num_agents, settings.memory) = (1, 50);
        });
        let of_world = |round| of_world(&large.config, round);
        assert!(of_world(0) > crate::budget::SMALL_BYTES);
        assert!(of_world(0) < of_world(50) / 50);
    }

    #[test]
    fn no_layout_takes_more_than_was_expected() {
        for (agents, size) in [(1, 8), (12, 10), (1, 256), (1024, 256)] {
            let spec = spec(|settings| {
                (settings.num_agents, settings.width, settings.height) = (agents, size, size);
                (settings.view_size, settings.memory) = (3, 0);
            });
            let expected = expected(&spec, 0, 0);
            let world = World::new(Arc::clone(&spec.config));
            let is = of_episode(&spec, &world, 0, 0);
            assert!(is <= expected + 8192, "{agents} agents, {size} cells: {is}, not {expected}");
        }
    }
}
