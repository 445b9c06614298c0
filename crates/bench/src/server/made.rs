//! Runs and episodes that are made up: their openings and ends are such as the server writes. Acts and rounds are left
//! out, as boards do not read them.

use std::sync::Arc;
use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench::episode::spec::{Spec, Visibility};
use swarmbench::ids::{EpisodeId, EpisodeKey, RunKey};
use swarmbench::run::definition::Definition;
use swarmbench::run::new_id;
use swarmbench::store::entries::{EndRow, Entry, OpeningRow, RunRow};
use swarmbench_clock::{Clock, SeededEntropy};
use swarmbench_engine::{Config, Settings, World};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{End, RawRecord, Record};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::suite::Suite;

/// Players; each has several runs.
pub(crate) const PLAYERS: i64 = 1000;

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
        let model = format!("model-{}", self.runs % PLAYERS);
        let definition = Definition {
            suite: self.suite.clone(),
            model: model.clone(),
            temperature: Some(1.0),
            top_p: Some(1.0),
            meta: Carried::default(),
            prompt_template: None,
            prompt_revision: swarmbench_prompt::REVISION,
            player: None,
            parallel: 4,
            visibility: "public".to_owned(),
            idle_timeout_ms: 86_400_000,
            closes_at: None,
            own_games: false,
        };
        let row = RunRow {
            run,
            id: new_id(now, &entropy),
            owner: None,
            suite: self.suite.name.clone(),
            digest: self.suite.digest(),
            definition: serde_json::to_string(&definition).expect("JSON"),
            model: model.clone(),
            visibility: "public",
            attempt: None,
            replays: None,
            closes_at: None,
            at: now,
            idempotency: None,
            token: None,
        };
        let id = row.id.clone();
        let mut entries = vec![Entry::OpenRun(Box::new(row))];
        for game in self.suite.plan() {
            entries.extend(self.game(run, &id, &game, &model));
        }
        entries.push(Entry::EndRun { run, status: "finished", at: now });
        entries
    }

    fn game(
        &mut self,
        run: RunKey,
        run_id: &str,
        game: &swarmbench_protocol::suite::PlannedGame,
        model: &str,
    ) -> [Entry; 2] {
        self.episodes += 1;
        let now = self.clock.now();
        let seed = i64::from(game.seed);
        let settings = Settings { task: game.task.clone(), seed, ..Settings::default() };
        let config = Arc::new(Config::check(&settings).expect("the standard setting"));
        let world = World::new(Arc::clone(&config));
        let spec = Spec {
            config,
            round_deadline: None,
            bank: Duration::ZERO,
            manual_start: false,
            idle_timeout: Duration::from_hours(24),
            visibility: Visibility::Public,
            model: model.to_owned(),
            agent_meta: Carried::default(),
            prompt_template: swarmbench_prompt::BUILT_IN.into(),
            prompt_revision: swarmbench_prompt::REVISION,
            custom_template: false,
            run: Some(run_id.to_owned()),
            salt: None,
            fork: None,
            closes_at: None,
            own_games: false,
            open_seats: Vec::new(),
            fill_after: None,
            fill_with: None,
            player: None,
        };
        let id = EpisodeId::new(now, &SeededEntropy::new(self.episodes.unsigned_abs()));
        let record = RawRecord::write(&spec.opening(&id, now, &world));
        let head = Head::START.link(record.as_str().as_bytes());
        let score = f64::from(self.random.next_u32() % 1000) / 50.0;
        let end = Record::End(End {
            status: "finished".to_owned(),
            reason: "rounds_played".to_owned(),
            rounds: 100,
            score,
            open_acts: Vec::new(),
        });
        let end = RawRecord::write(&end);
        let episode = EpisodeKey(self.episodes);
        let opening = OpeningRow {
            episode,
            id,
            owner: None,
            run: Some((run, game.slot)),
            fork: None,
            record,
            head,
            task: spec.config.task().name(),
            model: model.to_owned(),
            visibility: spec.visibility.name(),
            waiting: false,
            has_open_seats: false,
            has_people: false,
            own_games: false,
            clocked: false,
            at: now,
            idempotency: None,
            tokens: Vec::new(),
        };
        let ending = EndRow {
            episode,
            status: "finished",
            reason: "rounds_played",
            head: head.link(end.as_str().as_bytes()),
            record: end,
            bytes: 0,
            score,
            rounds: 100,
            seed: game.seed,
            tally: Tally { acts: 1200, invalid: 12, ..Tally::default() },
            counts: true,
            at: now,
        };
        [Entry::Open(Box::new(opening)), Entry::End(ending)]
    }
}
