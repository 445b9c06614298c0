//! Runs and episodes that are made up: their openings and ends are such as the server writes. Acts and rounds are left
//! out, as boards do not read them.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench::episode::spec::Spec;
use swarmbench::ids::{EpisodeKey, RunKey};
use swarmbench::run::definition::{self, Definition};
use swarmbench::store::entries::Entry;
use swarmbench_clock::Clock;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::status::Visibility;
use swarmbench_protocol::suite::Suite;
use swarmbench_testkit::host::SeededEntropy;

use crate::fill::game::NewGame;
use crate::fill::{definition, run_row};

/// Players; each has several runs.
pub(crate) const PLAYERS: i64 = 1000;

/// Time after which a game without acts ends: a day.
const IDLE_TIMEOUT_MS: u64 = 86_400_000;

/// Rows made so far.
pub(crate) struct Made {
    suite: Suite,
    pub(crate) runs: i64,
    pub(crate) episodes: i64,
    random: ChaCha8Rng,
    clock: Arc<dyn Clock>,
}

impl Made {
    /// Generator without runs and episodes.
    pub(crate) fn new(clock: Arc<dyn Clock>) -> Self {
        let suite = Suite::built_in("standard", "paper").expect("it is built in");
        Self { suite, runs: 0, episodes: 0, random: ChaCha8Rng::seed_from_u64(1), clock }
    }

    /// A run that has ended, with all its episodes.
    pub(crate) fn run(&mut self) -> Vec<Entry> {
        self.runs += 1;
        let now = self.clock.now();
        let entropy = SeededEntropy::new(self.runs.unsigned_abs());
        let run = RunKey(self.runs);
        let definition = Definition {
            idle_timeout_ms: IDLE_TIMEOUT_MS,
            ..definition(self.suite.clone(), format!("model-{}", self.runs % PLAYERS))
        };
        let row = run_row(run, &definition, Visibility::Public, now, &entropy);
        let id = row.id.clone();
        let mut entries = vec![Entry::OpenRun(Box::new(row))];
        for game in self.suite.plan() {
            self.episodes += 1;
            let spec = definition::spec(&definition, &id, &game, None).expect("allowed settings");
            let new = NewGame {
                episode: EpisodeKey(self.episodes),
                owner: None,
                run: Some((run, game.slot)),
                spec: Spec { agent_meta: Carried::default(), ..spec },
                at: self.clock.now(),
            };
            let score = f64::from(self.random.next_u32() % 1000) / 50.0;
            entries.extend(new.ended(&SeededEntropy::new(self.episodes.unsigned_abs()), score));
        }
        entries.push(Entry::EndRun { run, status: "finished", at: now });
        entries
    }
}
