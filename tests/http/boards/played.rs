//! Runs and games of several holders, played through the server's own parts while no server runs.

use std::sync::Arc;
use std::time::Duration;

use swarmbench::episode::Status;
use swarmbench::episode::actor::{Claim, Handle, Spawn};
use swarmbench::episode::lockstep::Submission;
use swarmbench::episode::quota::{Purpose, Quotas};
use swarmbench::episode::registry::{Creation, Registry};
use swarmbench::episode::seating::Wanted;
use swarmbench::episode::spec::Spec;
use swarmbench::fair::Party;
use swarmbench::http::limits::Limits;
use swarmbench::ids::{EpisodeId, EpisodeKey, RunKey, Token, TokenKind};
use swarmbench::keys::OwnerKey;
use swarmbench::run::definition::Definition;
use swarmbench::run::new_id;
use swarmbench::store::Store;
use swarmbench::store::entries::ImportRow;
use swarmbench::store::entries::{Entry, Holder, RunRow};
use swarmbench::work::Workers;
use swarmbench_clock::Clock;
use swarmbench_engine::{Act, Action, AgentId, Config, Seed, Settings, TaskName};
use swarmbench_journal::record::{Decision, RecordedConfig};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::failure::Failure;
use swarmbench_protocol::import::ImportConfig;
use swarmbench_protocol::suite::{Suite, SuiteSettings};
use swarmbench_testkit::host::{ManualClock, SeededEntropy};

use crate::app::TestApp;

/// Rounds of a game of the suite `small`.
const ROUNDS: u32 = 10;

/// The time of a round, where it has one.
const DEADLINE: Duration = Duration::from_mins(1);

/// The outcome of a game.
#[derive(Clone, Copy, Debug)]
pub(super) enum Did {
    /// The game was played to its end.
    Scored(u32),
    /// The same, with invalid answers and timeouts.
    Wrong { score: u32, invalid: u32, late: u32 },
    /// The game was aborted as soon as it had this score.
    Aborted(u32),
    /// The game was played to its end, and then the host found that it had broken it.
    Voided(u32),
    /// Several agents played until they had this score; then it was aborted.
    Together(u32),
    /// The game is running.
    GoesOn,
    /// The game was never opened.
    NotBegun,
}

fn seeds(count: usize) -> Vec<Seed> {
    [27, 42, 57, 72, 87].map(Seed::from).into_iter().cycle().take(count).collect()
}

/// One agent whose light scores as often as it changes.
pub(super) fn definition(model: &str, games: usize) -> Definition {
    let settings = SuiteSettings {
        num_agents: 1,
        max_round: ROUNDS.into(),
        round_deadline_ms: Some(u64::try_from(DEADLINE.as_millis()).expect("a minute")),
        ..SuiteSettings::default()
    };
    let suite = Suite {
        name: "small".to_owned(),
        tasks: vec!["Synchronization".to_owned()],
        seeds: seeds(games),
        seeds_by_task: false,
        rules: "paper".to_owned(),
        settings,
    };
    of(suite, model)
}

/// The suite of the paper's main table.
pub(super) fn standard(model: &str) -> Definition {
    of(Suite::built_in("standard", "paper").expect("it is built in"), model)
}

fn of(suite: Suite, model: &str) -> Definition {
    Definition {
        suite,
        model: model.to_owned(),
        temperature: Some(1.0),
        top_p: None,
        meta: Carried::default(),
        prompt_template: None,
        prompt_revision: 1,
        player: None,
        holders: Vec::new(),
        parallel: 1,
        visibility: "public".to_owned(),
        idle_timeout_ms: 86_400_000,
        closes_at: None,
        own_games: false,
    }
}

/// The parts of a server that play, over the database of one that is stopped.
pub(super) struct Offline {
    pub(super) store: Store,
    registry: Registry,
    clock: Arc<ManualClock>,
    entropy: SeededEntropy,
    runs: i64,
    last: EpisodeKey,
    game: Option<Handle>,
}

impl Offline {
    pub(super) async fn open(app: &TestApp) -> Self {
        let store = Store::open(app.location()).await.expect("it opens");
        let last = store.last_key().await.expect("it is read");
        let noon = "2026-02-28T12:00:00Z".parse().expect("a time");
        let clock = Arc::new(ManualClock::new(noon));
        let spawn: Spawn = Arc::new(|task| drop(tokio::spawn(task)));
        let quotas = Arc::new(Quotas::new(Limits::default().caps()));
        let journal = Arc::new(store.clone());
        let registry =
            Registry::new(journal, Arc::clone(&clock) as _, quotas, Workers::inline(), spawn, last);
        let entropy = SeededEntropy::new(u64::try_from(last).expect("a count") + 5);
        // The runs of a test that opens the database twice must not have the same numbers.
        Self {
            store,
            registry,
            clock,
            entropy,
            runs: last * 100,
            last: EpisodeKey(last),
            game: None,
        }
    }

    pub(super) async fn close(self) {
        self.store.close().await;
    }

    /// The holder of a key, by name.
    pub(super) async fn owner(&self, name: &str) -> Option<OwnerKey> {
        let keys = self.store.keys().await.expect("they are read");
        keys.iter().find(|key| key.name == name).expect("it was made").number
    }

    /// Plays a run to its end.
    pub(super) async fn run(
        &mut self,
        definition: Definition,
        owner: Option<OwnerKey>,
        games: &[Did],
        status: &'static str,
    ) {
        let run = self.open_run(definition, owner, games).await;
        self.end(run, status).await;
    }

    /// Plays games of a running run.
    pub(super) async fn open_run(
        &mut self,
        definition: Definition,
        owner: Option<OwnerKey>,
        games: &[Did],
    ) -> RunKey {
        self.runs += 1;
        self.clock.advance(Duration::from_secs(1));
        let run = RunKey(self.runs);
        let row = RunRow {
            run,
            id: new_id(self.clock.now(), &self.entropy),
            owner,
            suite: definition.suite.name.clone(),
            digest: definition.suite.digest(),
            definition: serde_json::to_string(&definition).expect("JSON"),
            model: definition.model.clone(),
            visibility: "public",
            attempt: None,
            replays: None,
            closes_at: None,
            at: self.clock.now(),
            idempotency: None,
        };
        let id = row.id.clone();
        self.store.keep(vec![Entry::OpenRun(Box::new(row))]).await.expect("it is kept");
        for (game, did) in definition.suite.plan().iter().zip(games) {
            if matches!(did, Did::NotBegun) {
                continue;
            }
            let mut spec = spec(&definition.suite, &game.task, game.seed, &definition.model);
            spec.run = Some(id.clone());
            let handle = self.create(spec, owner, Some((run, game.slot))).await;
            self.play(&handle, *did).await;
        }
        run
    }

    pub(super) async fn end(&mut self, run: RunKey, status: &'static str) {
        let entry = Entry::EndRun { run, status, at: self.clock.now() };
        self.store.keep(vec![entry]).await.expect("it is kept");
    }

    /// Ends the game that was opened last.
    pub(super) async fn abort_last(&self) {
        let last = self.game.as_ref().expect("one was opened");
        last.abort().await.expect("it is kept");
    }

    /// Takes a game from files.
    pub(super) async fn import(&self, model: &str, seed: u64, score: f64) {
        let row = ImportRow {
            id: format!("imp_{model}{seed}"),
            digest: [u8::try_from(seed).expect("a small seed"); 32],
            run_id: "1".to_owned(),
            meta: "{}".to_owned(),
            model: model.to_owned(),
            task: "Synchronization".to_owned(),
            seed,
            settings: ImportConfig {
                num_agents: 1,
                max_round: ROUNDS,
                width: 10,
                height: 10,
                view_size: 5,
                rules: None,
                control: None,
                memory: None,
                noise: None,
                max_delay: None,
                answer_reader: None,
            },
            score,
            resolved: ROUNDS,
            acts: 0,
            rounds: Vec::new(),
        };
        let entry = Entry::Import { game: Box::new(row), at: self.clock.now() };
        self.store.keep(vec![entry]).await.expect("it is kept");
    }

    /// Voids the last game, this many times.
    pub(super) async fn void_last(&self, times: usize) {
        let reason = "a test".to_owned();
        let entry = Entry::VoidEpisode { episode: self.last, reason, at: self.clock.now() };
        self.store.keep(vec![entry; times]).await.expect("it is kept");
    }

    /// Plays a game of two agents. The seat of the second is claimed for a model, or the server takes it.
    pub(super) async fn mixed(&mut self, score: u32, noise: f64, other: Option<&str>) {
        let mut suite = definition("", 1).suite;
        suite.settings = SuiteSettings { num_agents: 2, noise, ..suite.settings };
        let mut spec = spec(&suite, "Synchronization", 27.into(), "=ours");
        spec.open_seats = vec![AgentId(1)];
        if other.is_none() {
            spec.fill_after = Some(Duration::ZERO);
            spec.fill_with = Some("random".to_owned());
        }
        let handle = self.create(spec, Some(OwnerKey(1)), None).await;
        if let Some(model) = other {
            let holder = Holder {
                number: 0,
                owner: None,
                key: None,
                model: model.to_owned(),
                agent_meta: Carried::default(),
                player: None,
                at: self.clock.now(),
            };
            let seats = vec![Token::new(TokenKind::Seat, &self.entropy).hash()];
            let swarm = Token::new(TokenKind::Swarm, &self.entropy).hash();
            let wanted = Wanted::Seat(AgentId(1));
            let claim = Claim { holder, wanted, seats, swarm, idempotency: None };
            handle.claim(claim).await.expect("it is open");
        }
        let runs = |now: &Arc<swarmbench::episode::Snapshot>| now.status == Status::Running;
        handle.follow().wait_for(runs).await.expect("it starts");
        self.together(&handle, score).await;
        for round in score..ROUNDS {
            submit(&handle, round, &["STAY", "STAY"]).await;
        }
    }

    async fn create(
        &mut self,
        spec: Spec,
        owner: Option<OwnerKey>,
        run: Option<(RunKey, u32)>,
    ) -> Handle {
        let id = EpisodeId::new(self.clock.now(), &self.entropy);
        let (party, purpose) = (Party::of_key(owner), Purpose::Usual);
        let tokens = Vec::new();
        let creation = Creation {
            id,
            party,
            purpose,
            run,
            spec,
            holder_metas: Vec::new(),
            tokens,
            idempotency: None,
        };
        let handle = self.registry.create(creation).await.expect("it is created");
        self.last = handle.key;
        self.game = Some(handle.clone());
        handle
    }

    async fn play(&self, handle: &Handle, did: Did) {
        match did {
            Did::Scored(score) => self.alone(handle, score, 0, 0).await,
            Did::Wrong { score, invalid, late } => self.alone(handle, score, invalid, late).await,
            Did::Voided(score) => {
                self.alone(handle, score, 0, 0).await;
                self.void_last(1).await;
            }
            Did::Aborted(score) => {
                for round in 0..score {
                    submit(handle, round, &["SWITCH"]).await;
                }
                handle.abort().await.expect("it is kept");
            }
            Did::Together(score) => {
                self.together(handle, score).await;
                handle.abort().await.expect("it is kept");
            }
            Did::GoesOn | Did::NotBegun => return,
        }
        let outcome = &handle.snapshot().outcome;
        assert!(outcome.is_some(), "it has ended");
    }

    /// One agent changes its light so often, then gives so many invalid answers, lets the clock run out so often, and
    /// then does nothing.
    async fn alone(&self, handle: &Handle, score: u32, invalid: u32, late: u32) {
        for round in 0..ROUNDS {
            if round < score {
                submit(handle, round, &["SWITCH"]).await;
            } else if round < score + invalid {
                submit(handle, round, &["no action at all"]).await;
            } else if round < score + invalid + late {
                let mut followed = handle.follow();
                self.clock.advance(DEADLINE + Duration::from_millis(1));
                let past =
                    |snapshot: &Arc<swarmbench::episode::Snapshot>| snapshot.world.round() > round;
                followed.wait_for(past).await.expect("it goes on");
            } else {
                submit(handle, round, &["STAY"]).await;
            }
        }
    }

    /// All lights the same, and then all change in every round.
    async fn together(&self, handle: &Handle, score: u32) {
        for round in 0..score {
            let world = Arc::clone(&handle.snapshot().world);
            let light = |agent| world.observe(agent).light_on == Some(true);
            let act = |agent| if round > 0 || !light(agent) { "SWITCH" } else { "STAY" };
            let acts: Vec<&str> = world.agents().map(act).collect();
            submit(handle, round, &acts).await;
        }
    }
}

fn spec(suite: &Suite, task: &str, seed: Seed, model: &str) -> Spec {
    let settings = suite.settings.clone();
    let checked = Config::check(&Settings {
        task: task.to_owned(),
        rules: suite.rules.clone(),
        seed: seed.into(),
        ..Settings::from(&settings)
    });
    let config = RecordedConfig {
        visibility: "public".to_owned(),
        ..RecordedConfig::of(&checked.expect("good settings"))
    };
    let plain = Spec::of(&config, &Carried::default(), "a template").expect("a good game");
    Spec {
        round_deadline: settings.round_deadline_ms.map(Duration::from_millis),
        bank: Duration::from_millis(settings.bank_ms),
        idle_timeout: Duration::from_hours(24),
        model: model.to_owned(),
        ..plain
    }
}

/// Acts for all agents; anything but an action is an invalid answer of a language model.
async fn submit(handle: &Handle, round: u32, actions: &[&str]) {
    let act = |(number, action): (u16, &&str)| {
        let action = Action::parse(TaskName::Synchronization, action).ok_or(*action);
        let decision = match action {
            Ok(action) => Decision::of_player(Act::of(action)),
            Err(answer) => Decision {
                valid: false,
                failure: Some(Failure::NoMarker),
                response: Some(answer.to_owned()),
                ..Decision::of_player(Act::default())
            },
        };
        (AgentId(number), Submission { round, decision })
    };
    let outcomes = handle.submit((0..).zip(actions).map(act).collect()).await;
    for outcome in outcomes {
        outcome.expect("it is kept");
    }
}
