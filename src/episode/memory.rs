//! How much memory an episode takes, in round numbers: enough to keep all of them together within a budget.

use swarmbench_engine::{Config, World};

/// Bytes of a cell of a board.
const CELL: usize = 3;

/// Bytes of an agent in a state: its body, its act and its message.
const AGENT: usize = 400;

/// Bytes of an agent whatever round it is: its seat, its clock, its place in the snapshot.
const SEAT: usize = 400;

/// Bytes of an episode beside its worlds: its task, its channels, its description.
const EPISODE: usize = 8 * 1024;

/// Bytes of a cell in an observation that is written out.
const WRITTEN_CELL: usize = 4;

/// Bytes that the observations of one round are taken to have at most.
const WRITTEN_MAX: usize = 8 * 1024 * 1024;

/// Bytes of the state after `round` rounds, with all that agents remember in it.
#[must_use]
pub fn of_world(config: &Config, round: u32) -> usize {
    let settings = config.settings();
    let size = |cells: i64| usize::try_from(cells).unwrap_or(usize::MAX);
    let agents = usize::from(config.num_agents());
    let board =
        (size(settings.width) * size(settings.height) * CELL).saturating_add(agents * AGENT);
    let remembered = size(settings.memory).min(round as usize);
    board.saturating_mul(remembered + 1)
}

/// Bytes of the observations of one round, once they are written out for all agents.
fn of_observations(config: &Config) -> usize {
    let settings = config.settings();
    let size = |cells: i64| usize::try_from(cells).unwrap_or(usize::MAX);
    let view = size(settings.view_size).saturating_mul(size(settings.view_size));
    let cells = view.saturating_mul(size(settings.memory).max(1));
    let one = cells.saturating_mul(WRITTEN_CELL).saturating_add(AGENT);
    one.saturating_mul(config.num_agents().into()).min(WRITTEN_MAX)
}

/// Bytes of an episode that stands at `world` and keeps other states of `kept` bytes.
#[must_use]
pub fn of_episode(world: &World, kept: usize) -> usize {
    at_round(world.config(), world.round()).saturating_add(kept)
}

/// Bytes of an episode in round `round`, without other states that it keeps.
#[must_use]
pub fn at_round(config: &Config, round: u32) -> usize {
    let agents = usize::from(config.num_agents()) * SEAT;
    EPISODE + agents + of_world(config, round).saturating_add(of_observations(config))
}

#[cfg(test)]
mod tests {
    use super::*;
    use swarmbench_engine::{Settings, TaskName};

    fn config(change: impl FnOnce(&mut Settings)) -> Config {
        let mut settings = Settings::standard(TaskName::Synchronization, 1);
        change(&mut settings);
        Config::check(&settings).expect("good settings")
    }

    #[test]
    fn the_standard_setting_is_small_and_the_largest_maps_are_not() {
        assert!(at_round(&config(|_| {}), 100) < crate::budget::SMALL_BYTES);
        let large = config(|settings| {
            (settings.width, settings.height) = (256, 256);
            (settings.num_agents, settings.memory) = (1, 50);
        });
        // 51 boards of 65,536 cells were measured as 6.6 MB.
        assert!((6_600_000..20_000_000).contains(&of_world(&large, 50)));
        assert!(of_world(&large, 0) < of_world(&large, 50) / 50);
    }
}
