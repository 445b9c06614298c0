//! Work of more than a few milliseconds leaves the async threads.

use swarmbench_engine::{Config, TaskName};

use crate::journal::JournalError;

/// Whether a step can take more than a few milliseconds and has to leave the async threads.
#[must_use]
pub fn is_heavy(config: &Config) -> bool {
    let settings = config.settings();
    config.num_agents() > 128
        || settings.width * settings.height > 64 * 64
        || (config.task() == TaskName::Flocking && config.num_agents() > 24)
}

/// Does work, off the async threads where it is heavy.
pub(crate) async fn off_thread<T: Send + 'static>(
    heavy: bool,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, JournalError> {
    if !heavy {
        return Ok(work());
    }
    let done = crate::telemetry::spawn_blocking(work).await;
    done.map_err(|error| JournalError(error.to_string().into()))
}
