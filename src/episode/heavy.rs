//! Estimates of an episode's work, and where it runs: heavy work leaves the async threads.

use swarmbench_engine::{Config, Control, TaskName};

use crate::fair::{Party, Rank};
use crate::work::{Cancelled, WorkError, Workers};

/// Longest step that runs on the async threads, in microseconds.
const LIGHT_MICROS: u64 = 2000;

/// Estimates the time of a step and its digest at worst, in microseconds.
///
/// The settings alone decide the estimate, so that decisions based on it can be repeated. Measured in milliseconds, with random
/// acts and messages from all agents, on one core of 2026:
///
/// | task | agents | map | window | late or lost messages | step | digest | estimate |
/// | --- | ---: | ---: | ---: | --- | ---: | ---: | ---: |
/// | any but Flocking | 24 | 24² to 256² | 5 | no | 0.01 | 0.00 | 0.2 |
/// | any but Flocking | 1,024 | 256² | 5 | no | 0.4 | 0.3 | 10 |
/// | any but Flocking | 1,024 | 36² | 5 | no | 2 | 11 | 10 |
/// | any but Flocking | 256 | 64² | 129 | no | 3 | 20 | 23 |
/// | any but Flocking | 1,024 | 36² | 15 | yes | 207 | 82 | 277 |
/// | any but Flocking | 1,024 | 256² | 513 | no | 85 | 404 | 368 |
/// | any but Flocking | 512 | 256² | 513 | yes | 151 | 107 | 315 |
/// | any, centralized | 512 | 26² | all | yes | 0.9 | 5 | 1.2 |
/// | Flocking | 24 | 24² to 256² | 5 | no | 0.2 | 0.00 | 0.3 |
/// | Flocking | 64 | 64² | 5 | no | 1.3 | 0.01 | 3.2 |
/// | Flocking | 128 | 64² | 5 | no | 31 | 0.03 | 43 |
/// | Flocking | 256 | 256² | 5 | no | 770 | 0.06 | 664 |
///
/// Two things are expensive: messages that are delivered, and Flocking, with the fourth power of its agents.
pub fn step_micros(config: &Config) -> u64 {
    let agents = u64::from(config.num_agents());
    let settings = config.settings();
    let delivered = deliveries(config);
    let is_disturbed = settings.max_delay > 0 || settings.noise > 0.0;
    let messages = if is_disturbed { delivered * 6 / 5 } else { delivered * 35 / 100 };
    let flocking = if config.task() == TaskName::Flocking { agents.pow(4) / 6500 } else { 0 };
    20 + agents + messages + flocking
}

/// Upper bound of the messages that a round delivers.
fn deliveries(config: &Config) -> u64 {
    let agents = u64::from(config.num_agents());
    let in_sight = match config.control() {
        Control::Centralized => 1,
        Control::Decentralized => {
            let view = config.settings().view_size.unsigned_abs();
            agents.saturating_sub(1).min(view * view)
        }
    };
    agents * in_sight
}

/// Whether work of this many microseconds has to leave the async threads.
pub const fn is_long(micros: u64) -> bool {
    micros > LIGHT_MICROS
}

/// Whether a step can take more than a few milliseconds and has to leave the async threads.
pub fn is_heavy(config: &Config) -> bool {
    is_long(step_micros(config))
}

/// Does work for a party, off the async threads where it is heavy. Work that a running game waits for is always admitted: a game
/// has one round at a time.
pub(crate) async fn off_thread<T: Send + 'static>(
    workers: &Workers,
    kind: &'static str,
    (party, rank): (Party, Rank),
    heavy: bool,
    work: impl FnOnce(&Cancelled<'_>) -> T + Send + 'static,
) -> Result<T, WorkError> {
    match rank {
        _ if !heavy => Ok(work(&Cancelled::NEVER)),
        Rank::Urgent => workers.run_always(kind, party, rank, work).await,
        Rank::Normal => workers.run(kind, party, rank, work).await,
    }
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::Settings;

    use super::*;

    fn config(task: TaskName, agents: i64, size: i64) -> Config {
        let mut settings = Settings::standard(task, 1);
        (settings.num_agents, settings.width, settings.height) = (agents, size, size);
        (settings.view_size, settings.memory) = (5, 0);
        Config::check(&settings).expect("good settings")
    }

    #[test]
    fn standard_games_are_light_and_large_flocks_are_not() {
        for task in TaskName::ALL {
            let standard = Config::check(&Settings::standard(task, 1)).expect("good settings");
            assert!(!is_heavy(&standard), "{}: {} µs", task.name(), step_micros(&standard));
            assert!(!is_heavy(&config(task, 24, 256)), "a large map alone costs nothing");
        }
        assert!(is_heavy(&config(TaskName::Flocking, 64, 64)));
        // Measured as 514 to 770 ms.
        let largest = step_micros(&config(TaskName::Flocking, 256, 256));
        assert!((500_000..900_000).contains(&largest), "{largest} µs");
    }

    #[test]
    fn messages_that_are_heard_everywhere_are_heavy() {
        let mut settings = Settings::standard(TaskName::Pursuit, 1);
        (settings.num_agents, settings.width, settings.height) = (128, 64, 64);
        (settings.view_size, settings.memory) = (129, 0);
        assert!(is_heavy(&Config::check(&settings).expect("good settings")));
        settings.view_size = 3;
        assert!(!is_heavy(&Config::check(&settings).expect("good settings")));
    }
}
