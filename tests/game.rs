//! Games for tests that need no server.

use std::sync::Arc;
use std::time::Duration;

use swarmbench::episode::spec::{Spec, Visibility};
use swarmbench_engine::Config;

/// A public game without clocks, holders or hosted players.
pub(crate) fn spec(config: Config) -> Spec {
    Spec {
        config: Arc::new(config),
        round_deadline: None,
        bank: Duration::ZERO,
        manual_start: false,
        idle_timeout: Duration::from_mins(20),
        visibility: Visibility::Public,
        model: "a test".to_owned(),
        agent_meta: swarmbench_protocol::carried::Carried::default(),
        prompt_template: "".into(),
        prompt_revision: 1,
        custom_template: false,
        run: None,
        salt: None,
        fork: None,
        closes_at: None,
        own_games: false,
        open_seats: Vec::new(),
        fill_after: None,
        fill_with: None,
        player: None,
        holders: Vec::new(),
    }
}
