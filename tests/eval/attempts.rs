//! Attempts in competitions, played by their entrants.

use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use swarmbench_client::client::Client;
use swarmbench_clock::{Clock, SystemClock};

use super::bench::{Bench, Done, Running, Serving};
use crate::llm::endpoint::{Endpoint, Reply, Seen};

/// Questions of an attempt: two tasks on one seed, three rounds, two agents.
const QUESTIONS: usize = 12;

/// A competition on a server with keys.
struct Cup {
    bench: Bench,
    serving: Serving,
    organizer: Client,
    id: String,
}

/// Entrant of a competition.
struct Entrant {
    id: String,
    key: String,
}

/// The clock may decide more rounds than the server tells at once.
#[tokio::test]
async fn notes_outlast_many_rounds_of_the_clock() {
    let quick = json!({
        "suite": { "tasks": ["Synchronization"], "seeds": 1, "settings": { "num_agents": 1, "max_round": 60 } },
        "clocks": { "round_deadline_s": 0.2 },
    });
    let cup = Cup::open_for(3600, quick).await;
    let blue = cup.enter(json!({ "name": "blue", "model": "m" })).await;
    let asked = AtomicUsize::new(0);
    let endpoint = Endpoint::start(move |_, seen| {
        if !seen.prompt().starts_with("You are Agent_") {
            return Reply::says("ready");
        }
        match asked.fetch_add(1, Ordering::Relaxed) {
            0 => Reply::says("ACTION: STAY\nNOTES: planted notes"),
            1 => Reply::says("ACTION: STAY").after(Duration::from_secs(6)),
            _ => Reply::says("ACTION: STAY\nNOTES: others"),
        }
    })
    .await;
    let args = [&model(&endpoint)[..], &["--scratchpad", "40"]].concat();
    cup.eval(&blue, &args).await.ends(0);
    let seen = endpoint.seen();
    let played: Vec<_> =
        seen.iter().filter(|seen| seen.prompt().starts_with("You are Agent_")).collect();
    for asked in &played[1..3] {
        assert!(asked.body.to_string().contains("planted notes"), "{}", asked.body);
    }
    cup.serving.stop().await;
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_else(|| panic!("a text: {value}")).to_owned()
}

impl Cup {
    /// Opens a competition for a number of seconds, with some fields changed.
    async fn open_for(seconds: u64, change: Value) -> Self {
        let bench = Bench::new();
        let mut command = Command::new(swarmbench_testkit::program::program());
        let args = ["key", "create", "--name", "o", "--role", "organizer", "--db", "swarmbench.db"];
        let made = command.args(args).current_dir(bench.folder.path()).output().expect("it runs");
        let key = String::from_utf8(made.stdout).expect("UTF-8").trim().to_owned();
        let serving = bench.serve().await;
        let organizer = Client::new(&serving.base).expect("an address").with_key(key);
        let now = SystemClock.now();
        let mut request = json!({
            "name": "a cup", "opens_at": now.to_string(),
            "closes_at": (now + Duration::from_secs(seconds)).to_string(),
            "suite": {
                "tasks": ["Synchronization", "Pursuit"], "seeds": 1,
                "settings": { "num_agents": 2, "max_round": 3 },
            },
            "clocks": { "round_deadline_s": 600, "idle_timeout_s": 7200 },
            "attempts": 2, "parallel": 2, "board": "hidden",
        });
        for (field, value) in change.as_object().expect("fields") {
            request[field] = value.clone();
        }
        let created: Value =
            organizer.post("/api/v1/competitions", &request).await.expect("a competition");
        Self { bench, serving, organizer, id: text(&created["id"]) }
    }

    async fn open() -> Self {
        Self::open_for(3600, json!({})).await
    }

    fn path(&self, rest: &str) -> String {
        format!("/api/v1/competitions/{}{rest}", self.id)
    }

    /// Enters with this declaration, and with a new key.
    async fn enter(&self, declared: Value) -> Entrant {
        let made: Value =
            self.serving.client.post(&self.path("/entrants"), &declared).await.expect("an entrant");
        Entrant { id: text(&made["id"]), key: text(&made["key"]) }
    }

    /// `swarmbench eval --attempt` with the key of an entrant.
    fn command(&self, entrant: &Entrant, args: &[&str]) -> Command {
        let attempt = ["--attempt", &self.id, "--server", &self.serving.base];
        let mut command = self.bench.command(&[&attempt, args].concat());
        command.env("SWARMBENCH_KEY", &entrant.key);
        command
    }

    async fn eval(&self, entrant: &Entrant, args: &[&str]) -> Done {
        Running::of(self.command(entrant, args)).end().await
    }

    /// The attempts, as their entrant sees them.
    async fn attempts(&self, entrant: &Entrant) -> Vec<Value> {
        let client = Client::new(&self.serving.base).expect("an address");
        let client = client.with_key(entrant.key.clone());
        let list: Value = client.get(&self.path("/attempts")).await.expect("a list");
        list["items"].as_array().expect("items").clone()
    }
}

fn model(endpoint: &Endpoint) -> [&str; 4] {
    ["--model", "m", "--api-base", endpoint.base()]
}

/// The questions of agents, without the one that is asked before an attempt is started.
fn questions(endpoint: &Endpoint) -> usize {
    endpoint.seen().iter().filter(|seen| seen.prompt().starts_with("You are Agent_")).count()
}

#[tokio::test]
async fn an_attempt_is_played_to_its_end_with_what_was_declared() {
    let cup = Cup::open().await;
    let blue = cup.enter(json!({ "name": "blue", "model": "m", "temperature": 0.5 })).await;
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: SWITCH")).await;
    let play = [&model(&endpoint)[..], &["--price", "1000,2000"]].concat();
    let planned = cup.eval(&blue, &[&play[..], &["--dry-run"]].concat()).await.ends(0);
    planned.says(&[
        "a cup, blue: 1 sealed seeds",
        "num_agents 2",
        "1 runs, 2 games; models would be asked at most 12 times",
    ]);
    assert!(cup.attempts(&blue).await.is_empty(), "nothing was started");
    let done = cup.eval(&blue, &play).await.ends(0);
    let done = done.says(&[
        "attempt 1 of blue in a cup: run_",
        "is new: 2 games, 2 at once; no round begins after 20",
        "Synchronization #1 ended after 3 rounds: score",
        &format!("swarmbench competition board {} --server", cup.id),
    ]);
    // The entrant's own result: each of both lights changes at the same time in every round.
    let attempts = cup.attempts(&blue).await;
    assert_eq!((attempts.len(), &attempts[0]["status"]), (1, &json!("finished")));
    let total = attempts[0]["total"].as_f64().expect("a total");
    let row = done.out.lines().find(|line| line.contains(" m ")).expect("a row");
    assert!(row.contains(&format!("{total:.2}")) && row.contains("0.24"), "{total} {}", done.out);
    assert_eq!((questions(&endpoint), endpoint.seen().len()), (QUESTIONS, QUESTIONS + 1));
    let is_declared = |seen: &Seen| seen.body["temperature"] == json!(0.5);
    assert!(endpoint.seen().iter().all(is_declared));
    // The same again: it is shown, and no other attempt is started unasked.
    let board = cup.eval(&blue, &[&play[..], &["--format", "json"]].concat()).await.ends(0);
    let board = board.says(&["is finished; --again starts the next attempt"]);
    let board: Value = serde_json::from_str(&board.out).expect("JSON");
    assert_eq!(
        (&board["rows"][0]["total"], &board["rows"][0]["seeds"]),
        (&json!(total), &Value::Null)
    );
    assert_eq!((questions(&endpoint), cup.attempts(&blue).await.len()), (QUESTIONS, 1));
    cup.eval(&blue, &[&play[..], &["--again"]].concat()).await.ends(0).says(&["attempt 2 of blue"]);
    assert_eq!(questions(&endpoint), 2 * QUESTIONS);
    let more = [
        ("--again", "all 2 attempts were started"),
        ("--attempt-number=3", "there are 2 attempts"),
    ];
    for (option, said) in more {
        let done = cup.eval(&blue, &[&play[..], &[option]].concat()).await.ends(1);
        done.says(&["no attempt was started: ", said]);
    }
    cup.eval(&blue, &[&play[..], &["--attempt-number", "1"]].concat()).await.ends(0);
    assert_eq!(questions(&endpoint), 2 * QUESTIONS);
    cup.serving.stop().await;
}

#[tokio::test]
async fn after_a_kill_the_same_command_plays_the_same_attempt_on() {
    let cup = Cup::open().await;
    let blue = cup.enter(json!({ "name": "blue", "model": "m" })).await;
    let endpoint = Endpoint::start(|number, _| {
        let reply = Reply::says("ACTION: STAY");
        if number < 6 { reply } else { reply.held_until(1) }
    })
    .await;
    let running =
        Running::of(cup.command(&blue, &[&model(&endpoint)[..], &["--requests", "1"]].concat()));
    endpoint.has_seen(7).await;
    running.signal(Signal::KILL);
    running.end().await;
    let begun = cup.attempts(&blue).await;
    assert_eq!((begun.len(), &begun[0]["status"]), (1, &json!("running")));
    let other = Endpoint::start(|_, _| Reply::says("ACTION: STAY")).await;
    let done = cup.eval(&blue, &model(&other)).await.ends(0);
    done.says(&["attempt 1 of blue in a cup", "resumes: 0 of 2 games were played"]);
    let ended = cup.attempts(&blue).await;
    assert_eq!((ended.len(), &ended[0]["status"]), (1, &json!("finished")));
    assert_eq!(ended[0]["run"], begun[0]["run"]);
    // Of the five answers none or some of the last round may not have been kept; the others are not asked again.
    let asked = questions(&other);
    assert!((QUESTIONS - 5..=QUESTIONS - 1).contains(&asked), "{asked}");
    assert_eq!(other.seen().len(), asked, "nothing is tried before an attempt that runs already");
    cup.serving.stop().await;
}

#[tokio::test]
async fn another_player_than_the_declared_one_starts_no_attempt() {
    let cup = Cup::open().await;
    let blue = cup.enter(json!({ "name": "blue", "model": "m", "top_p": 0.9 })).await;
    cup.bench.write("mine.j2", "You are {{ agent }}.");
    cup.bench.write("tasks.toml", "models = ['m']\ntasks = ['Foraging']\n[settings]\nnoise = 0.5");
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: STAY")).await;
    let refused: [(&[&str], &str); 15] = [
        (
            &["--model", "other"],
            r#"the entrant "blue" declared model "m", not "other". No attempt was started"#,
        ),
        (&["--model", "m", "--temperature", "1"], "declared temperature none, not 1"),
        (&["--model", "m", "--top-p", "0.5"], "declared top_p 0.9, not 0.5"),
        (
            &["--model", "m", "--system", "Be brief."],
            "declared a system message with the digest none, not",
        ),
        (
            &["--model", "m", "--prompt-template", "mine.j2"],
            "declared the prompt template with the digest none, not",
        ),
        (
            &["--player", "default"],
            r#"declared model "m", not "built-in/default"; top_p 0.9, not none"#,
        ),
        (
            &["--model", "m,other"],
            "an attempt is played by one model or player, asked in one way; this names 2",
        ),
        (&["--model", "m", "--task", "Foraging", "--seeds", "1"], "so leave out --task, --seeds"),
        (
            &["--model", "m", "--view-size", "3", "--parallel", "2"],
            "so leave out --parallel, --view-size",
        ),
        (&["tasks.toml"], "so leave out `tasks` of the file, `settings.noise` of the file"),
        (&["--model", "m", "--verify"], "leave out --verify"),
        (&["--model", "m", "--replay", "mine.j2"], "leave out --replay"),
        (&["--model", "m", "--entrant", "ent_other"], "the entrant is not known here"),
        (&["--model", "m", "--key", "secret_wrong"], "the server does not take this key"),
        (&["--model", "m", "--key", ""], "the server does not take this key"),
    ];
    for (args, said) in refused {
        let args = [args, &["--api-base", endpoint.base()]].concat();
        cup.eval(&blue, &args).await.ends(1).says(&[said]);
    }
    let other = cup.enter(json!({ "name": "red", "model": "m" })).await;
    let args = [&model(&endpoint)[..], &["--entrant", &other.id]].concat();
    cup.eval(&blue, &args).await.ends(1).says(&["is not an entrant of this key"]);
    assert!(cup.attempts(&blue).await.is_empty() && endpoint.seen().is_empty());
    // What the server does not show is said.
    let args = [&model(&endpoint)[..], &["--max-tokens", "9", "--dry-run"]].concat();
    cup.eval(&blue, &args)
        .await
        .ends(0)
        .says(&["does not show what was declared about --max-tokens"]);
    cup.serving.stop().await;
}

#[tokio::test]
async fn an_endpoint_that_takes_no_question_costs_no_attempt() {
    let cup = Cup::open().await;
    let blue = cup.enter(json!({ "name": "blue", "model": "m" })).await;
    let endpoint = Endpoint::start(|_, _| Reply::error(401, "no such key")).await;
    let done = cup.eval(&blue, &model(&endpoint)).await.ends(1);
    done.says(&["asks for a good key (401)", "no attempt was started"]);
    assert!(cup.attempts(&blue).await.is_empty());
    cup.serving.stop().await;
}

#[tokio::test]
async fn built_in_players_play_attempts_and_a_key_with_several_entrants_names_one() {
    let cup = Cup::open_for(3600, json!({ "entries_per_key": 2 })).await;
    let member: Value =
        cup.organizer.post("/api/v1/keys", &json!({ "name": "a member" })).await.expect("a key");
    let key = text(&member["secret"]);
    let client = Client::new(&cup.serving.base).expect("an address").with_key(key.clone());
    let mut ids = Vec::new();
    for (name, model) in [("one", "built-in/default"), ("two", "random")] {
        let declared = json!({ "name": name, "model": model });
        let made: Value = client.post(&cup.path("/entrants"), &declared).await.expect("an entrant");
        ids.push(text(&made["id"]));
    }
    let member = Entrant { id: ids[1].clone(), key };
    let play = ["--player", "random"];
    let said = ["this key has 2 entrants: name one with --entrant: ", &ids[0], &ids[1]];
    cup.eval(&member, &play).await.ends(1).says(&said);
    let named = [&play[..], &["--entrant", &member.id]].concat();
    cup.eval(&member, &named).await.ends(0).says(&["attempt 1 of two in a cup", "built-in/random"]);
    let attempts = cup.attempts(&member).await;
    assert_eq!(attempts.len(), 1);
    assert_eq!(
        (&attempts[0]["entrant"], &attempts[0]["status"]),
        (&json!(member.id), &json!("finished"))
    );
    cup.serving.stop().await;
}

#[tokio::test]
async fn an_attempt_that_closes_in_the_middle_says_so() {
    let long = json!({
        "suite": { "tasks": ["Synchronization"], "seeds": 2, "settings": { "num_agents": 1, "max_round": 1000 } },
        "clocks": { "round_deadline_s": 0.1 },
    });
    let cup = Cup::open_for(10, long).await;
    let blue = cup.enter(json!({ "name": "blue", "model": "m" })).await;
    let endpoint =
        Endpoint::start(|_, _| Reply::says("ACTION: SWITCH").after(Duration::from_millis(20)))
            .await;
    let done = cup.eval(&blue, &model(&endpoint)).await.ends(1);
    done.says(&[
        "error: attempt 1 closed at 20",
        "before all of it was played. It counts with what it has.",
    ]);
    assert_eq!(cup.attempts(&blue).await[0]["status"], "closed");
    // Afterwards it is shown, and nothing can be started.
    cup.eval(&blue, &model(&endpoint)).await.ends(0).says(&["is closed; --again starts the next"]);
    let again = [&model(&endpoint)[..], &["--again"]].concat();
    cup.eval(&blue, &again).await.ends(1).says(&["no attempt was started: "]);
    cup.serving.stop().await;
}
