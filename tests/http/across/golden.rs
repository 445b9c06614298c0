//! Records the golden journals of the current rules revision, which `tests/golden.rs` replays:
//!
//! ```sh
//! cargo test --test http -- --ignored golden_journals_are_recorded
//! ```
//!
//! The recorder plays the games of [`games`] on a server whose time is moved by hand, and writes what is missing
//! in `tests/golden/REVISION/`. What is there already is never written again: see CONTRIBUTING.md.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::{Value, json};
use swarmbench_client::client::Client;
use swarmbench_client::play::play;
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{RULES_REVISION, RuleSet, TaskName};
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::verify;
use swarmbench_players::default_for;
use swarmbench_testkit::worlds::Dice;

use crate::app::{Episode, TestApp};

#[tokio::test]
#[ignore = "writes files; only a new rules revision, or a new game, has something to record"]
async fn golden_journals_are_recorded() {
    let folder = folder();
    fs::create_dir_all(&folder).expect("a folder");
    let app = TestApp::with_manual_clock().await;
    for game in games() {
        let file = folder.join(format!("{}.jsonl", game.name));
        if !file.exists() {
            let episode = game.record(&app).await;
            keep(&app, &episode, &file, game.name).await;
        }
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{RULES_REVISION}"))
}

/// Proves the journal of an episode, writes it, and notes its head and its score.
async fn keep(app: &TestApp, episode: &Episode, file: &Path, name: &str) {
    let journal = app.journal(episode).await;
    let shown = app.show(episode).await;
    let head = shown["result"]["journal_head"].as_str().and_then(Head::parse);
    let report = verify(journal.as_bytes(), head, Solver::Both, |_, _| ()).expect("a proof");
    File::create_new(file).and_then(|mut file| file.write_all(journal.as_bytes())).expect("a file");
    let heads = file.with_file_name("heads.tsv");
    let mut heads = OpenOptions::new().create(true).append(true).open(heads).expect("a table");
    writeln!(heads, "{name}\t{}\t{}", report.head, report.score).expect("a line");
}

/// A game to be recorded.
pub(crate) struct GoldenGame {
    name: &'static str,
    config: Value,
    how: How,
}

/// A way to play a game.
enum How {
    /// To its end, by the task's default player.
    BuiltIn,
    /// Some rounds by all seats at random, with messages; to the end where no number is given.
    Random(Option<u64>),
    /// The same by the answers of a language model, valid and invalid ones.
    Answers,
    /// At random, by seats of which some are quick, some use their banks and some never act.
    Clocks,
    /// At random by the creator and by somebody who claimed two seats; the server plays the rest.
    SeveralHolders,
    /// Three rounds, then some of the seats act once more and the creator ends it.
    Aborted,
    /// Three rounds, then some of the seats act once more and nobody comes back.
    Abandoned,
}

#[expect(clippy::too_many_lines, reason = "it is a table")]
pub(crate) fn games() -> Vec<GoldenGame> {
    use RuleSet::{Paper, Reference};
    use TaskName::{Flocking, Foraging, Pursuit, Synchronization, Transport};

    let game = |name, task: TaskName, rules: RuleSet, rest: Value, how| {
        let mut config = json!({ "task": task.name(), "rules": rules.name(), "model": name });
        let fields = config.as_object_mut().expect("an object");
        fields.extend(rest.as_object().expect("an object").clone());
        GoldenGame { name, config, how }
    };
    let seed = |seed: u64| json!({ "seed": seed, "max_round": 16 });
    vec![
        // Every task by its default player, in both rule sets. Those of Transport end by `task_done`.
        game("transport-paper", Transport, Paper, json!({ "seed": 27 }), How::BuiltIn),
        game("transport-reference", Transport, Reference, json!({ "seed": 5 }), How::BuiltIn),
        game("pursuit-paper", Pursuit, Paper, seed(27), How::BuiltIn),
        game("pursuit-reference", Pursuit, Reference, seed(3), How::BuiltIn),
        game("synchronization-paper", Synchronization, Paper, seed(0), How::BuiltIn),
        game("synchronization-reference", Synchronization, Reference, seed(9), How::BuiltIn),
        game(
            "foraging-paper",
            Foraging,
            Paper,
            json!({ "seed": 27, "num_agents": 7, "max_round": 32 }),
            How::BuiltIn,
        ),
        game(
            "foraging-reference",
            Foraging,
            Reference,
            json!({ "seed": 2, "num_agents": 7, "max_round": 32 }),
            How::BuiltIn,
        ),
        game(
            "flocking-paper",
            Flocking,
            Paper,
            json!({ "seed": 27, "num_agents": 8, "max_round": 40 }),
            How::BuiltIn,
        ),
        game(
            "flocking-reference",
            Flocking,
            Reference,
            json!({ "seed": 4, "num_agents": 13, "max_round": 12, "width": 16, "height": 16 }),
            How::BuiltIn,
        ),
        // Messages: noise, delays, small and large windows, no memory and a long one.
        game(
            "noise-and-delay-paper",
            Synchronization,
            Paper,
            json!({
                "seed": 9_007_199_254_740_991_u64, "num_agents": 9, "width": 14, "height": 9,
                "view_size": 7, "noise": 0.4, "max_delay": 3, "max_round": 18,
            }),
            How::Random(None),
        ),
        game(
            "noise-and-delay-reference",
            Pursuit,
            Reference,
            json!({
                "seed": 11, "num_agents": 9, "width": 9, "height": 9, "view_size": 3, "noise": 0.25,
                "max_delay": 2, "max_round": 18, "memory": 0,
            }),
            How::Random(None),
        ),
        game(
            "all-noise-foraging",
            Foraging,
            Paper,
            json!({
                "seed": 12, "num_agents": 10, "width": 8, "height": 13, "view_size": 27, "noise": 1.0,
                "memory": 50, "max_round": 15,
            }),
            How::Random(None),
        ),
        // Centralized control; in the first the commander escapes with the others, one by one.
        game(
            "commander-escapes",
            Transport,
            Paper,
            json!({ "seed": 6, "control": "centralized", "max_delay": 2 }),
            How::BuiltIn,
        ),
        game(
            "centralized-paper",
            Foraging,
            Paper,
            json!({
                "seed": 14, "control": "centralized", "num_agents": 6, "width": 12, "height": 8,
                "noise": 0.3, "max_delay": 1, "max_round": 20,
            }),
            How::Random(None),
        ),
        game(
            "centralized-answers",
            Transport,
            Reference,
            json!({ "seed": 15, "control": "centralized", "num_agents": 8, "max_round": 15 }),
            How::Answers,
        ),
        // Answers of language models.
        game(
            "answers-synchronization",
            Synchronization,
            Paper,
            json!({
                "seed": 16, "num_agents": 8, "max_round": 14,
                "agent_meta": { "temperature": 0.7, "note": "ünïcode 🐜", "deep": [[{}]] },
            }),
            How::Answers,
        ),
        game(
            "answers-flocking",
            Flocking,
            Reference,
            json!({ "seed": 17, "num_agents": 9, "max_round": 15, "prompt_template": "{{ round }}" }),
            How::Answers,
        ),
        // Few and many agents.
        game(
            "one-agent",
            Foraging,
            Reference,
            json!({ "seed": 18, "num_agents": 1, "width": 8, "height": 8, "max_round": 60, "memory": 0 }),
            How::BuiltIn,
        ),
        game(
            "thirty-agents",
            Transport,
            Paper,
            json!({ "seed": 19, "num_agents": 30, "width": 11, "height": 8, "max_round": 7 }),
            How::Random(None),
        ),
        game(
            "crowded-pursuit",
            Pursuit,
            Paper,
            json!({ "seed": 20, "num_agents": 22, "width": 9, "height": 8, "max_round": 7 }),
            How::Random(None),
        ),
        // Clocks that ran out, and what was taken from banks.
        game(
            "clocks",
            Synchronization,
            Reference,
            json!({
                "seed": 21, "num_agents": 5, "max_round": 20, "round_deadline_s": 10, "bank_s": 7.5,
            }),
            How::Clocks,
        ),
        game(
            "clocks-without-banks",
            Pursuit,
            Paper,
            json!({ "seed": 22, "num_agents": 4, "max_round": 10, "round_deadline_s": 0.05 }),
            How::Clocks,
        ),
        // Several holders, one of them the server.
        game(
            "several-holders",
            Foraging,
            Paper,
            json!({
                "seed": 28, "num_agents": 6, "max_round": 12, "open_seats": 4, "fill_after_s": 10,
                "noise": 0.2,
            }),
            How::SeveralHolders,
        ),
        // Ends of every kind, and none.
        game("done-at-once", Flocking, Paper, json!({ "seed": 23, "num_agents": 1 }), How::BuiltIn),
        game(
            "aborted",
            Transport,
            Reference,
            json!({ "seed": 24, "num_agents": 6, "start": "manual", "visibility": "owner" }),
            How::Aborted,
        ),
        game(
            "abandoned",
            Foraging,
            Paper,
            json!({ "seed": 25, "num_agents": 6, "idle_timeout_s": 60 }),
            How::Abandoned,
        ),
        game(
            "still-running",
            Flocking,
            Paper,
            json!({ "seed": 26, "num_agents": 6, "width": 10, "height": 17, "max_round": 100_000 }),
            How::Random(Some(6)),
        ),
    ]
}

impl GoldenGame {
    /// Plays it.
    pub(crate) async fn record(&self, app: &TestApp) -> Episode {
        let created = app.post("/api/v1/episodes").json(&self.config).ok().await;
        let episode = Episode::of(&created);
        let mut players = Players { dice: Dice(self.config["seed"].as_u64().expect("a seed")) };
        match self.how {
            How::BuiltIn => {
                let created = serde_json::from_value(created).expect("an episode");
                let task = TaskName::parse(self.config["task"].as_str().expect("a task"));
                let player = default_for(task.expect("a task"));
                let client = Client::new(app.base()).expect("a client");
                play(&client, &created, player, 1, |_, _| ()).await.expect("a game");
            }
            How::Random(rounds) => {
                players.play(app, &episode, rounds.unwrap_or(u64::MAX), Players::act).await;
            }
            How::Answers => players.play(app, &episode, u64::MAX, Players::answer).await,
            How::Clocks => players.play_by_the_clock(app, &episode).await,
            How::SeveralHolders => players.play_with_others(app, &episode).await,
            How::Aborted => {
                app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
                players.play(app, &episode, 3, Players::act).await;
                players.some_act(app, &episode).await;
                app.delete(&episode.path("")).token(&episode.swarm).ok().await;
            }
            How::Abandoned => {
                players.play(app, &episode, 3, Players::act).await;
                players.some_act(app, &episode).await;
                app.pass(Duration::from_mins(1));
                app.obs_after(episode.seat(0), 3).await;
            }
        }
        episode
    }
}

/// Messages: difficult ones, and usual ones.
const TEXTS: [&str; 12] = [
    "the block is to the left",
    "going (3, 4) → (3, 5), \"don't\" wait",
    "one\r\ntwo\nthree\tfour\u{0}five\u{7f}",
    "\u{85}\u{2028}in between\u{2029} ",
    "🐜🐜🏳️‍🌈 👩‍👩‍👧 é",
    "向左走，不要停",
    "\u{202e}backwards\u{202c} \u{feff}",
    "back\\slash \"quotes\" </script> {{ round }}",
    " \t ",
    "",
    "a message of more than one hundred and twenty characters, which is cut where the limit is, and ends in three dots to show that there was more",
    "ёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёёё",
];

/// Answers of language models; `{A}` is an action, `{M}` a text, `{R}` an agent.
const ANSWERS: [&str; 16] = [
    "ACTION: {A}",
    "I see the others.\n\nACTION: {A}\nMSG: {M}",
    "**Action:** {A}\n**Msg:** \"{M}\"",
    "## ACTION: [{A}] MSG: ({M})",
    "1. action: move {A}, then stop\n2. msg: `{M}`",
    "MSG: {M}",
    "ACTION: MSG: {M}",
    "TO: {R}\nMSG: {M}\nACTION: {A}",
    "TO: Agent {R} ACTION: {A} MSG: {M}",
    "ACTION: UP\nACTION: {A}",
    "ACTION： {A}\r\nMSG： {M}",
    "I would go {A}.",
    "ACTION: JUMP\nMSG: {M}",
    "ACTION: {A}\nACTION: none",
    "",
    "{\"ACTION\": \"{A}\"}\u{0}",
];

/// All seats of an episode, played by what dice say.
struct Players {
    dice: Dice,
}

type Decide = fn(&mut Players, &Episode, &Value) -> Value;

impl Players {
    fn one_of(&mut self, texts: &[&str]) -> String {
        texts[self.dice.below(texts.len())].to_owned()
    }

    /// Any action; every second one with a message, and from the commander now and then to one alone.
    fn act(&mut self, episode: &Episode, seen: &Value) -> Value {
        let action = self.action(seen);
        let mut act =
            json!({ "episode": episode.id, "agent": seen["agent"], "round": seen["round"] });
        act["action"] = json!(action);
        if self.dice.below(2) == 0 {
            act["message"] = json!(self.one_of(&TEXTS));
            let agents = episode.seats().count();
            let commands = episode.config["control"] == "centralized" && seen["agent"] == "Agent_0";
            if commands && agents > 1 && self.dice.below(2) == 0 {
                act["to"] = json!(format!("Agent_{}", 1 + self.dice.below(agents - 1)));
            }
        }
        act
    }

    fn action(&mut self, seen: &Value) -> String {
        let actions = seen["actions"].as_array().expect("actions");
        actions[self.dice.below(actions.len())].as_str().expect("a name").to_owned()
    }

    /// The answer of a language model, with what it cost.
    fn answer(&mut self, episode: &Episode, seen: &Value) -> Value {
        let (action, message) = (self.action(seen), self.one_of(&TEXTS));
        let receiver = format!("Agent_{}", self.dice.below(episode.seats().count() + 1));
        let answer = self.one_of(&ANSWERS);
        let answer = answer.replace("{A}", &action).replace("{M}", &message);
        let mut act = json!({
            "episode": episode.id, "agent": seen["agent"], "round": seen["round"],
            "response": answer.replace("{R}", &receiver),
        });
        match self.dice.below(4) {
            0 => act["usage"] = json!({ "prompt_tokens": 812, "completion_tokens": 31 }),
            1 => act["usage"] = json!({ "latency_ms": u64::MAX }),
            2 => act["reasoning"] = json!("hm,\nlet me \"think\" 🤔\u{1}"),
            _ => {}
        }
        act
    }

    /// Plays `rounds` rounds, or to the end.
    async fn play(&mut self, app: &TestApp, episode: &Episode, rounds: u64, decide: Decide) {
        for _ in 0..rounds {
            let seen = app.swarm_obs(episode).await;
            if seen.is_empty() {
                break;
            }
            app.pass(Duration::from_millis(1234));
            let acts: Vec<_> = seen.iter().map(|seen| decide(self, episode, seen)).collect();
            for receipt in app.swarm_act(episode, &acts).await {
                assert_eq!(receipt["duplicate"], false, "{receipt}");
            }
        }
    }

    /// Plays with somebody else, who claims two seats, and with the server, which fills the others.
    async fn play_with_others(&mut self, app: &TestApp, episode: &Episode) {
        let claim = json!({ "seats": 2, "model": "another", "agent_meta": { "top_p": 0.9 } });
        let claimed = app.post(&episode.path("/claims")).json(&claim).ok().await;
        let other = claimed["swarm_token"].as_str().expect("a token");
        app.pass(Duration::from_secs(10));
        loop {
            for token in [&*episode.swarm, other] {
                let seen = app.get("/swarm/obs?wait=60").token(token).ok().await;
                if seen["finished"] == true {
                    return;
                }
                let seen = crate::app::list(&seen["observations"]);
                let acts: Vec<_> = seen.iter().map(|seen| self.act(episode, seen)).collect();
                app.post("/swarm/act").token(token).json(&json!({ "acts": acts })).ok().await;
            }
        }
    }

    /// Every second seat acts in the open round, which stays open.
    async fn some_act(&mut self, app: &TestApp, episode: &Episode) {
        let seen = app.swarm_obs(episode).await;
        let acts: Vec<_> = seen.iter().skip(1).step_by(2).map(|s| self.act(episode, s)).collect();
        for receipt in app.swarm_act(episode, &acts).await {
            assert_eq!(receipt["duplicate"], false, "{receipt}");
        }
    }

    /// Plays to the end. In each round a third of the seats is quick, a third comes after the deadline
    /// (and may be too late), a third does not come at all.
    async fn play_by_the_clock(&mut self, app: &TestApp, episode: &Episode) {
        let deadline = Duration::from_secs_f64(
            episode.config["round_deadline_s"].as_f64().expect("a deadline"),
        );
        loop {
            let seen = app.swarm_obs(episode).await;
            let Some(round) = seen.first().map(|seen| seen["round"].as_u64().expect("a round"))
            else {
                break;
            };
            let (mut quick, mut late) = (Vec::new(), Vec::new());
            for seen in &seen {
                match self.dice.below(3) {
                    0 => quick.push(self.act(episode, seen)),
                    1 => late.push(self.act(episode, seen)),
                    _ => {}
                }
            }
            app.swarm_act(episode, &quick).await;
            app.pass(deadline + Duration::from_millis(1500));
            app.swarm_act(episode, &late).await;
            // Every bank is at most 7.5 seconds.
            app.pass(Duration::from_secs(7));
            app.obs_after(episode.seat(0), round).await;
        }
    }
}
