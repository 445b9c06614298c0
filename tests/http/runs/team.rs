//! Runs of a team: each holder plays its own seats of every game with a token of its own.

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench::competitions::FORMATS;
use swarmbench::store::check::check;
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::{JournalReport, verify};

use super::{seen, small, stay, text, with};
use crate::app::{TestApp, fields, list};

/// A team of two models and a player of the server, on four seats of two games.
fn team() -> Value {
    let suite = json!({
        "name": "of a team", "tasks": ["Synchronization"], "seeds": [4, 9],
        "settings": { "num_agents": 4, "max_round": 2 },
    });
    json!({
        "suite": suite, "model": "a team", "parallel": 2, "holders": [
            { "model": "blue", "seats": [3, 0], "temperature": 0.5, "agent_meta": { "x": 1 } },
            { "name": "green one", "model": "green", "seats": [1] },
            { "player": "random", "seats": [2] },
        ],
    })
}

#[derive(Clone, Debug)]
struct Team {
    id: String,
    /// Tokens of the holders that play from outside.
    tokens: Vec<String>,
    created: Value,
}

impl Team {
    fn of(created: Value) -> Self {
        assert_eq!(created["swarm_token"], Value::Null);
        let tokens = list(&created["holder_tokens"]);
        let tokens = tokens.iter().map(|token| text(token, "swarm_token").to_owned()).collect();
        Self { id: text(&created, "id").to_owned(), tokens, created }
    }

    fn path(&self, rest: &str) -> String {
        format!("/api/v1/runs/{}{rest}", self.id)
    }

    fn games(&self) -> Vec<String> {
        let games = list(&self.created["games"]);
        games.iter().filter_map(|game| Some(game["episode"].as_str()?.to_owned())).collect()
    }

    /// The numbers of the agents that wait for acts of a holder.
    async fn waiting(&self, app: &TestApp, holder: usize) -> Vec<Value> {
        let looked = app.get("/swarm/obs?prompt=true").token(&self.tokens[holder]).ok().await;
        seen(&looked)
    }

    /// Every holder stays in every round, until all is over.
    async fn play(&self, app: &TestApp) -> Value {
        loop {
            let mut finished = true;
            for token in &self.tokens {
                let looked = app.get("/swarm/obs?wait=0.2").token(token).ok().await;
                finished &= looked["finished"] == true;
                let acts: Vec<Value> = seen(&looked).iter().map(stay).collect();
                if !acts.is_empty() {
                    app.post("/swarm/act").token(token).json(&json!({ "acts": acts })).ok().await;
                }
            }
            if finished {
                return app.get(&self.path("")).token(&self.tokens[0]).ok().await;
            }
        }
    }
}

fn agents(seen: &[Value]) -> Vec<&str> {
    let mut names: Vec<&str> = seen.iter().map(|seen| text(seen, "agent")).collect();
    names.sort_unstable();
    names.dedup();
    names
}

async fn create(app: &TestApp, key: &str) -> Team {
    let call = app.post("/api/v1/runs").json(&team());
    Team::of(if key.is_empty() { call } else { call.token(key) }.ok().await)
}

/// The journal of a game that has ended, proven.
async fn proven(app: &TestApp, key: &str, episode: &str) -> (String, JournalReport) {
    let path = format!("/api/v1/episodes/{episode}");
    let shown = app.get(&path).token(key).ok().await;
    let head = Head::parse(text(&shown["result"], "journal_head")).expect("a head");
    let journal = app.get(&format!("{path}/journal")).token(key).send().await;
    let report = verify(&*journal.body, Some(head), Solver::Flow, |_, _| ()).expect("a proof");
    (journal.text(), report)
}

/// The same journal with another text in its records, and a chain that fits.
fn forged(journal: &str, from: &str, to: &str) -> String {
    let mut head = Head::START;
    let lines = journal.lines().map(|line| {
        let record = line[84..line.len() - 1].replace(from, to);
        head = head.link(record.as_bytes());
        format!("{{\"hash\":\"{head}\",\"record\":{record}}}\n")
    });
    lines.collect()
}

#[tokio::test]
async fn each_holder_plays_its_own_seats_and_the_board_says_enforced() {
    let app = TestApp::builder().keys().start().await;
    let (owner, id) = app.key(json!({ "name": "owner" })).await;
    let run = create(&app, &owner).await;
    let names: Vec<Value> =
        list(&run.created["holder_tokens"]).iter().map(|token| token["holder"].clone()).collect();
    assert_eq!(names, ["blue", "green one"], "the server plays the third");
    let holders = list(&run.created["holders"]);
    assert_eq!((&holders[0]["seats"], &holders[0]["prompt"]), (&json!([0, 3]), &json!("default")));
    assert_eq!(holders[2]["model"], "built-in/random");
    let [first, second] = &run.games()[..] else { panic!("two games: {}", run.created) };

    let blue = run.waiting(&app, 0).await;
    assert_eq!((agents(&blue), blue.len()), (vec!["Agent_0", "Agent_3"], 4));
    let green = run.waiting(&app, 1).await;
    assert_eq!((agents(&green), green.len()), (vec!["Agent_1"], 2));
    // A holder acts for nobody else, be it a seat of another holder or of the server.
    let acts = [stay(&green[0]), with(stay(&green[0]), &json!({ "agent": "Agent_2" }))];
    let body = json!({ "acts": acts });
    let receipts = app.post("/swarm/act").token(&run.tokens[0]).json(&body).ok().await;
    for receipt in list(&receipts["receipts"]) {
        assert_eq!(receipt["code"], "forbidden", "{receipt}");
    }
    let ended = run.play(&app).await;
    assert_eq!((&ended["status"], &ended["played"]), (&json!("finished"), &json!(2)));

    for episode in [first, second] {
        let (journal, report) = proven(&app, &owner, episode).await;
        let seats = report.seats.expect("a record of seats");
        let held: Vec<u32> = seats.seats.iter().map(|seat| seat.holder).collect();
        assert_eq!(held, [1, 2, 3, 1]);
        let models: Vec<&str> = seats.holders.iter().map(|holder| &*holder.model).collect();
        assert_eq!(models, ["blue", "green", "built-in/random"]);
        assert_eq!(seats.holders[0].key.as_deref(), Some(&*id));
        assert_eq!(seats.holders[0].agent_meta.0.as_ref(), r#"{"temperature":0.5,"x":1}"#);
        assert_eq!(
            (seats.holders[2].player.as_deref(), &seats.holders[2].key),
            (Some("random"), &None)
        );
        // Who holds what was settled in the opening.
        let claims =
            app.get(&format!("/api/v1/episodes/{episode}/claims")).token(&owner).ok().await;
        assert_eq!((&claims["open"], &claims["seats"][3]["model"]), (&json!(0), &json!("blue")));
        assert!(journal.contains(r#""holders":[{"name":"blue","model":"blue","seats":[0,3]}"#));
    }
    let (journal, _) = proven(&app, &owner, first).await;
    for (from, to, fault) in [
        (
            r#"{"agent":"Agent_3","holder":1}"#,
            r#"{"agent":"Agent_3","holder":2}"#,
            "cannot be a seat of holder 2",
        ),
        (r#"{"holder":2,"model":"green""#, r#"{"holder":2,"model":"blue""#, "is not \"green one\""),
        (
            r#""agent_meta":{},"player":"random""#,
            r#""agent_meta":{},"player":"none""#,
            "holder 3 is not",
        ),
    ] {
        assert!(journal.contains(from), "{journal}");
        let forged = forged(&journal, from, to);
        let found = verify(forged.as_bytes(), None, Solver::Flow, |_, _| ()).expect_err("a fault");
        assert!(found.to_string().contains(fault), "{found}");
    }
    let export = app.get("/api/v1/exports/episodes.jsonl").token(&owner).send().await.text();
    let row: Value = serde_json::from_str(export.lines().next().expect("a game")).expect("JSON");
    let column = |name| serde_json::from_str::<Value>(text(&row, name)).expect("JSON");
    assert_eq!(column("team"), json!({ "blue": 2, "green": 1, "built-in/random": 1 }));
    let holders = json!([
        { "model": "blue", "seats": 2, "prompt": "default", "agent_meta": { "temperature": 0.5, "x": 1 } },
        { "model": "green", "seats": 1, "prompt": "default", "agent_meta": {} },
        { "model": "built-in/random", "seats": 1, "prompt": null, "agent_meta": {} },
    ]);
    assert_eq!(column("team_holders"), holders);
    // A model of the same name is another row.
    let suite = team()["suite"].clone();
    let alone = json!({ "suite": suite, "model": "a team", "player": "random" });
    let alone = app.post("/api/v1/runs").token(&owner).json(&alone).ok().await;
    crate::app::until("the other run ends", async || {
        let path = format!("/api/v1/runs/{}", text(&alone, "id"));
        app.get(&path).token(&owner).ok().await["status"] == "finished"
    })
    .await;
    let board = app.get("/api/v1/leaderboard?suite=of%20a%20team").token(&owner).ok().await;
    let rows = list(&board["items"]);
    assert_eq!(rows.len(), 2, "{board}");
    let of_team = rows.iter().find(|row| row["kind"] == "team").expect("a row of the team");
    assert_eq!(
        (&of_team["model"], &of_team["decentralization"]),
        (&json!("a team"), &json!("enforced"))
    );
    assert_eq!((&of_team["run"], of_team["vouched"].as_bool()), (&json!(run.id), Some(false)));
    assert_eq!(list(&of_team["holders"])[0]["temperature"], 0.5);
    assert!(of_team["holders"][0].get("agent_meta").is_none());
    assert!(rows.iter().any(|row| row["kind"].is_null() && row.get("holders").is_none()));
    let csv =
        app.get("/api/v1/leaderboard?suite=of%20a%20team&format=csv").token(&owner).send().await;
    assert!(csv.text().contains("0,3 blue (T 0.5); 1 green; 2 built-in/random"), "{}", csv.text());
}

/// All that is asked about a game and its run.
fn about(run: &Team, episode: &str) -> Vec<String> {
    let of_game = [
        "",
        "/state",
        "/replay",
        "/scores",
        "/journal",
        "/metrics",
        "/worth",
        "/verification",
        "/claims",
        "/rounds/0/agents/Agent_0",
        "/rounds/1/agents/Agent_0",
        "/events",
    ];
    let of_run = ["", "/scores", "/metrics"];
    let lists = ["/api/v1/episodes?limit=50", "/api/v1/runs", "/api/v1/exports/episodes.jsonl"];
    let games = of_game.iter().map(|rest| format!("/api/v1/episodes/{episode}{rest}"));
    let runs = of_run.iter().map(|rest| run.path(rest));
    games.chain(runs).chain(lists.map(str::to_owned)).collect()
}

/// With and without keys: on a server without keys runs are public, and yet their games are not while a team plays.
#[rstest]
#[case(true)]
#[case(false)]
#[tokio::test]
async fn before_the_end_a_holder_gets_nothing_of_the_others(#[case] has_keys: bool) {
    let app = TestApp::builder();
    let app = if has_keys { app.keys() } else { app }.start().await;
    let (owner, stranger) = if has_keys {
        let owner = app.key(json!({ "name": "owner" })).await.0;
        (owner, app.key(json!({ "name": "stranger" })).await.0)
    } else {
        (String::new(), String::new())
    };
    let run = create(&app, &owner).await;
    assert_eq!(run.created["suite"]["seeds"], Value::Null, "{}", run.created);
    let episode = &run.games()[0];
    // What one holder thinks and says to nobody, in all rounds but the last.
    let secret = |seen: &Value| {
        with(
            json!({ "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"] }),
            &json!({
                "response": "planted-answer ACTION: UP", "reasoning": "planted-reason", "harness": {
                    "added": "planted-added", "scratchpad": "planted-notes",
                    "tries": [{ "response": "planted-try", "told": "planted-told" }],
                },
            }),
        )
    };
    let acts: Vec<Value> = run.waiting(&app, 0).await.iter().map(secret).collect();
    let body = json!({ "acts": acts });
    app.post("/swarm/act").token(&run.tokens[0]).json(&body).ok().await;
    let green = run.waiting(&app, 1).await;
    let acts: Vec<Value> = green.iter().map(stay).collect();
    let body = json!({ "acts": acts });
    app.post("/swarm/act?wait=60").token(&run.tokens[1]).json(&body).ok().await;

    let tokens = [run.tokens[0].as_str(), &run.tokens[1], &owner, &stranger, ""];
    for path in about(&run, episode) {
        for token in tokens {
            let call = app.get(&path);
            let call = if token.is_empty() { call } else { call.token(token) };
            let told = if path.ends_with("/events") {
                // A stream of events would not end.
                let response = call.open().await;
                assert!(!response.status().is_success(), "{path} by {token:?}");
                continue;
            } else {
                call.send().await
            };
            let told_text = told.text();
            for secret in ["planted", r#""seed":4"#, r#""seed":9"#, r#""grid""#, r#""at":["#] {
                assert!(!told_text.contains(secret), "{path} by {token:?}: {told_text}");
            }
            if path.ends_with("/state") || path.ends_with("/replay") || path.ends_with("/journal") {
                assert!(matches!(told.status, 401 | 403 | 404), "{path}: {told_text}");
            }
        }
    }
    for token in &run.tokens {
        let looked = app.get("/swarm/obs?prompt=true").token(token).send().await.text();
        assert!(!looked.contains("planted"), "{looked}");
    }
    // Its own seats read what they said, and the notes of each reach nobody else.
    let acts = |agent: &str| format!("/swarm/acts?episode={episode}&agent={agent}&prompt=true");
    for agent in ["Agent_0", "Agent_3"] {
        let own = app.get(&acts(agent)).token(&run.tokens[0]).ok().await;
        assert_eq!(own["acts"][0]["act"]["harness"]["scratchpad"], "planted-notes", "{own}");
        assert!(text(&own["acts"][0], "prompt").contains(agent) && own["acts"][1].is_null());
        app.get(&acts(agent)).token(&run.tokens[1]).problem(403, "forbidden").await;
    }
    let green = app.get(&acts("Agent_1")).token(&run.tokens[1]).send().await.text();
    assert!(!green.contains("planted") && green.contains("STAY"), "{green}");
    for token in [&run.tokens[0], &run.tokens[1]] {
        app.get(&acts("Agent_2")).token(token).problem(403, "forbidden").await;
    }
    if has_keys {
        // Others do not even learn that it exists.
        app.get(&run.path("")).token(&stranger).problem(404, "not_found").await;
        let claim = app.post(&format!("/api/v1/episodes/{episode}/claims")).token(&stranger);
        claim.json(&json!({})).problem(404, "not_found").await;
    }
    // Holders have no rights of the creator.
    for token in &run.tokens {
        app.delete(&run.path("")).token(token).problem(403, "forbidden").await;
        app.post(&run.path("/token")).token(token).problem(403, "forbidden").await;
        let game = format!("/api/v1/episodes/{episode}");
        app.delete(&game).token(token).problem(403, "forbidden").await;
    }
    run.play(&app).await;
    let token = if has_keys { owner } else { run.tokens[0].clone() };
    let (journal, _) = proven(&app, &token, episode).await;
    for planted in ["answer", "reason", "added", "notes", "try", "told"] {
        assert!(journal.contains(&format!("planted-{planted}")), "{planted}");
    }
}

/// What is declared of a holder may say how the others are asked, so before the end it is told to the holder itself alone.
#[tokio::test]
async fn a_holder_learns_nothing_of_what_others_declare() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let mut team = with(team(), &json!({ "visibility": "public" }));
    team["holders"][1]["agent_meta"] = json!({ "system_message": "planted-system" });
    let run = Team::of(app.post("/api/v1/runs").token(&owner).json(&team).ok().await);
    let metas = |shown: &Value| -> Vec<Value> {
        list(&shown["holders"]).iter().map(|holder| holder["agent_meta"].clone()).collect()
    };
    let (blue, green) = (json!({ "x": 1 }), json!({ "system_message": "planted-system" }));
    let own = app.get(&run.path("")).token(&owner).ok().await;
    assert_eq!(metas(&own), [blue.clone(), green.clone(), Value::Null]);
    let first = app.get(&run.path("")).token(&run.tokens[0]).ok().await;
    assert_eq!(metas(&first), [blue, Value::Null, Value::Null], "{first}");
    assert_eq!(first["holders"][1]["name"], "green one");
    let second = app.get(&run.path("")).token(&run.tokens[1]).ok().await;
    assert_eq!(metas(&second), [Value::Null, green, Value::Null], "{second}");
    for path in [run.path(""), "/api/v1/runs".to_owned()] {
        let anybody = app.get(&path).send().await.text();
        assert!(anybody.contains("green one") && !anybody.contains("planted"), "{anybody}");
    }
    let ended = run.play(&app).await;
    assert_eq!(metas(&ended)[1]["system_message"], "planted-system");
}

/// The game of a slot that counts.
fn counting(shown: &Value, slot: u64) -> String {
    let games = list(&shown["games"]);
    let game = games.iter().find(|game| game["slot"] == slot && game["void_reason"].is_null());
    text(game.expect("a game"), "episode").to_owned()
}

/// The creator decides, and where no key says who that is, each of those that play.
#[rstest]
#[case(true)]
#[case(false)]
#[tokio::test]
async fn a_game_of_a_team_is_played_again_and_then_the_board_says_declared(#[case] has_keys: bool) {
    let app = TestApp::builder();
    let app = if has_keys { app.keys() } else { app }.start().await;
    let owner = if has_keys { app.key(json!({ "name": "owner" })).await.0 } else { String::new() };
    let run = create(&app, &owner).await;
    run.play(&app).await;
    let board = async || {
        let call = app.get("/api/v1/leaderboard?suite=of%20a%20team");
        let call = if has_keys { call.token(&owner) } else { call };
        call.ok().await["items"][0].clone()
    };
    let before = board().await;
    assert_eq!((&before["decentralization"], &before["voided"]), (&json!("enforced"), &json!(0)));
    let game = run.games()[0].clone();
    let path = format!("/api/v1/episodes/{game}/repeat");
    let repeat = || app.post(&path).json(&json!({ "reason": "it was ill" }));
    if has_keys {
        let (stranger, _) = app.key(json!({ "name": "stranger" })).await;
        for token in [&run.tokens[0], &run.tokens[1], &stranger] {
            repeat().token(token).problem(403, "forbidden").await;
        }
        let kept = repeat().token(&owner).ok().await;
        assert_eq!(kept["void_reason"], "played again: it was ill");
    } else {
        repeat().token(&run.tokens[1]).ok().await;
        // Whoever may create runs here may also end this one.
        let shown = app.get(&run.path("")).ok().await;
        assert_eq!((&shown["status"], &shown["voided"]), (&json!("running"), &json!(1)));
        repeat().ok().await;
    }
    let ended = run.play(&app).await;
    assert_eq!((&ended["status"], &ended["played"]), (&json!("finished"), &json!(2)));
    assert_ne!(counting(&ended, 0), game);
    let after = board().await;
    assert_eq!((&after["decentralization"], &after["voided"]), (&json!("declared"), &json!(1)));
}

/// Teams whose members differ in nothing but how they are asked are different rows, and each is named.
#[tokio::test]
async fn teams_that_ask_their_members_otherwise_are_other_rows() {
    let app = TestApp::start().await;
    let mut suite = team()["suite"].clone();
    suite["seeds"] = json!([4]);
    for eval in [
        json!({}),
        json!({ "effort": "low" }),
        json!({ "effort": "high" }),
        json!({ "max_tokens": 9 }),
        json!({ "harness": { "history": 2 } }),
    ] {
        let holders = json!([
            { "model": "blue", "seats": [0, 1] },
            { "model": "green", "seats": [2, 3], "agent_meta": { "eval": eval } },
        ]);
        let request = json!({ "suite": suite, "model": "a team", "holders": holders });
        let run = Team::of(app.post("/api/v1/runs").json(&request).ok().await);
        run.play(&app).await;
    }
    let board = app.get("/api/v1/leaderboard?suite=of%20a%20team").ok().await;
    let rows = list(&board["items"]);
    let mut told: Vec<(String, String)> = rows
        .iter()
        .map(|row| {
            let green = &row["holders"][1];
            (green["sampling"].to_string(), green["prompt"].to_string())
        })
        .collect();
    told.sort();
    let expected = [
        (r#""effort high""#, r#""default""#),
        (r#""effort low""#, r#""default""#),
        (r#""max_tokens 9""#, r#""default""#),
        ("null", r#""default""#),
        ("null", r#""default+harness:history=2""#),
    ];
    assert_eq!(told, expected.map(|(sampling, prompt)| (sampling.to_owned(), prompt.to_owned())));
    let csv = app.get("/api/v1/leaderboard?suite=of%20a%20team&format=csv").send().await.text();
    for said in ["2–3 green (effort low)", "(prompt default+harness:history=2)"] {
        assert!(csv.contains(said), "{said}: {csv}");
    }
    let prompts = app.get("/api/v1/exports/episodes.jsonl").send().await.text();
    assert!(prompts.contains("default; default+harness:history=2"), "{prompts}");
}

/// Players of the server cost nothing, and a member that tells no cost leaves the sum incomplete.
#[tokio::test]
async fn costs_of_a_team_are_whole_if_all_models_tell_them() {
    let app = TestApp::start().await;
    for (name, paying) in [("all", [true, true]), ("one", [true, false])] {
        let request = with(team(), &json!({ "model": name }));
        let run = Team::of(app.post("/api/v1/runs").json(&request).ok().await);
        while app.get(&run.path("")).ok().await["status"] == "running" {
            for (holder, pays) in paying.into_iter().enumerate() {
                let acts = run.waiting(&app, holder).await;
                if acts.is_empty() {
                    continue;
                }
                let usage = if pays { json!({ "cost_nano_usd": 1_000_000 }) } else { json!({}) };
                let acts = acts.iter().map(|seen| with(stay(seen), &json!({ "usage": usage })));
                let body = json!({ "acts": acts.collect::<Vec<_>>() });
                app.post("/swarm/act").token(&run.tokens[holder]).json(&body).ok().await;
            }
        }
    }
    let board = app.get("/api/v1/leaderboard?suite=of%20a%20team").ok().await;
    for row in list(&board["items"]) {
        assert_eq!(row["costs_are_whole"], row["model"] == "all", "{row}");
        assert!(row["cost_usd"].as_f64().is_some_and(|cost| cost > 0.0), "{row}");
    }
}

/// The creator plays with itself, also where no key says who that is. Players of the server are nobody's.
#[tokio::test]
async fn members_of_a_team_are_no_pair_in_cross_play() {
    let app = TestApp::start().await;
    create(&app, "").await.play(&app).await;
    let pairs = app.get("/api/v1/cross-play").ok().await;
    let models: Vec<Value> =
        list(&pairs["items"]).iter().map(|pair| pair["models"].clone()).collect();
    let expected = [json!(["blue", "built-in/random"]), json!(["built-in/random", "green"])];
    assert_eq!(models.len(), 2, "{pairs}");
    assert!(expected.iter().all(|pair| models.contains(pair)), "{pairs}");
}

#[tokio::test]
async fn a_long_list_of_wrong_seats_is_told_in_short() {
    let app = TestApp::start().await;
    let holders = |seats: Vec<i64>| json!([{ "model": "a", "seats": seats }]);
    for seats in [vec![-1; 5000], vec![0; 5000], vec![9; 5000]] {
        let request = with(team(), &json!({ "holders": holders(seats) }));
        let problem = app.post("/api/v1/runs").json(&request).problem(422, "invalid").await;
        assert!(fields(&problem).len() < 4, "{problem}");
    }
    // Beyond the limit the problems are counted.
    let nobody = |_| json!({ "seats": [], "top_p": 2, "temperature": -1 });
    let holders: Vec<Value> = (0..64).map(nobody).collect();
    let request = with(team(), &json!({ "holders": holders }));
    let problem = app.post("/api/v1/runs").json(&request).problem(422, "invalid").await;
    let named = list(&problem["fields"]);
    assert_eq!(named.len(), 100);
    let last = text(&named[99], "problem");
    assert!(last.ends_with(" more problems (field_problems_max)"), "{last}");
}

#[tokio::test]
async fn a_lost_token_is_replaced_for_its_holder_alone() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let call = app.post("/api/v1/runs").token(&owner).header("Idempotency-Key", "once");
    let run = Team::of(call.json(&team()).ok().await);
    let replace = |query: &str| app.post(&run.path(&format!("/token{query}"))).token(&owner);
    let problem = replace("").problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["holder"]);
    assert!(problem.to_string().contains("one of blue, green one"), "{problem}");
    replace("?holder=nobody").problem(422, "invalid").await;
    replace("?holder=built-in/random").problem(403, "forbidden").await;
    let fresh = replace("?holder=green%20one").ok().await;
    assert_eq!(fresh["holder"], "green one");
    app.get("/swarm/obs").token(&run.tokens[1]).problem(401, "unauthorized").await;
    app.get("/swarm/obs").token(&run.tokens[0]).ok().await;
    let now =
        Team { tokens: vec![run.tokens[0].clone(), text(&fresh, "swarm_token").to_owned()], ..run };
    assert_eq!(agents(&now.waiting(&app, 1).await), ["Agent_1"]);
    // The same creation again is the same run, with new tokens for all.
    let call = app.post("/api/v1/runs").token(&owner).header("Idempotency-Key", "once");
    let again = Team::of(call.json(&team()).ok().await);
    assert_eq!(again.id, now.id);
    for token in &now.tokens {
        app.get("/swarm/obs").token(token).problem(401, "unauthorized").await;
    }
    assert_eq!(again.play(&app).await["status"], "finished");
    let alone = app.post("/api/v1/runs").token(&owner).json(&small()).ok().await;
    let path = format!("/api/v1/runs/{}/token?holder=blue", text(&alone, "id"));
    app.post(&path).token(&owner).problem(422, "invalid").await;
}

#[tokio::test]
async fn a_team_goes_on_after_a_stop_and_after_a_crash() {
    let mut app = TestApp::start().await;
    let run = create(&app, "").await;
    let blue = run.waiting(&app, 0).await;
    let acts: Vec<Value> = blue.iter().map(stay).collect();
    app.post("/swarm/act").token(&run.tokens[0]).json(&json!({ "acts": acts })).ok().await;
    app.restart().await;
    // The acts of one holder are kept, and the round waits for the other.
    assert_eq!(run.waiting(&app, 0).await, [] as [Value; 0]);
    assert_eq!(agents(&run.waiting(&app, 1).await), ["Agent_1"]);
    let after = app.after_a_crash().await;
    for app in [&app, &after] {
        let ended = run.play(app).await;
        assert_eq!((&ended["status"], &ended["played"]), (&json!("finished"), &json!(2)));
    }
}

#[tokio::test]
async fn a_team_of_players_of_the_server_plays_alone() {
    let app = TestApp::start().await;
    let holders = json!([
        { "name": "a", "player": "random", "seats": [0, 1] }, { "name": "b", "player": "default", "seats": [2, 3] },
    ]);
    let created =
        app.post("/api/v1/runs").json(&with(team(), &json!({ "holders": holders }))).ok().await;
    assert!(created.get("holder_tokens").is_none(), "{created}");
    let path = format!("/api/v1/runs/{}", text(&created, "id"));
    crate::app::until("it ends", async || app.get(&path).ok().await["status"] == "finished").await;
    let board = app.get("/api/v1/leaderboard?suite=of%20a%20team").ok().await;
    let row = &board["items"][0];
    assert_eq!((&row["vouched"], &row["prompt"]), (&json!(true), &Value::Null), "{row}");
    let pairs = app.get("/api/v1/cross-play").ok().await;
    let models = &pairs["items"][0]["models"];
    assert_eq!(models, &json!(["built-in/default", "built-in/random"]), "{pairs}");
    let shown = app.get(&path).ok().await;
    let repeat = format!("/api/v1/episodes/{}/repeat", counting(&shown, 0));
    let call = app.post(&repeat).json(&json!({ "reason": "why not" }));
    call.problem(403, "forbidden").await;
}

#[rstest]
#[case(json!({ "holders": [] }), "holders")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2] }] }), "holders")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2, 3, 4] }] }), "holders[0].seats")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2, 3, -1] }] }), "holders[0].seats")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2, 3, 3] }] }), "holders[0].seats")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2, 3] }, { "model": "b", "seats": [] }] }), "holders[1].seats")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1] }, { "model": "a", "seats": [2, 3] }] }), "holders[1].name")]
#[case(json!({ "holders": [{ "seats": [0, 1, 2, 3] }] }), "holders[0].model")]
#[case(json!({ "holders": [{ "model": "a", "player": "random", "seats": [0, 1, 2, 3] }] }), "holders[0].model")]
#[case(json!({ "holders": [{ "player": "nobody", "seats": [0, 1, 2, 3] }] }), "player")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2, 3], "top_p": 2 }] }), "holders[0].top_p")]
#[case(json!({ "holders": [{ "model": "a", "seats": [0, 1, 2, 3], "agent_meta": { "x": "y".repeat(17_000) } }] }), "holders[0].agent_meta")]
#[case(json!({ "temperature": 1 }), "temperature")]
#[case(json!({ "player": "random" }), "player")]
#[tokio::test]
async fn what_is_no_team_is_refused(#[case] change: Value, #[case] field: &str) {
    let app = TestApp::start().await;
    let call = app.post("/api/v1/runs").json(&with(team(), &change));
    let problem = call.problem(422, "invalid").await;
    assert!(fields(&problem).iter().any(|named| named == field), "{problem}");
}

/// Definition, tokens and results of a team, each damaged in a way that a server would believe.
#[rstest]
#[case::no_team(
    "UPDATE runs SET definition = replace(definition, '\"holders\":[{', '\"holders\":null,\"x\":[{')",
    "cannot be read"
)]
#[case::seats(
    "UPDATE runs SET definition = replace(definition, '[0,3]', '[0,2]')",
    "its players are not those of its run"
)]
#[case::player(
    "UPDATE runs SET definition = replace(definition, '\"player\":\"default\"', '\"player\":\"none\"')",
    "its players are not those of its run"
)]
#[case::sampling(
    "UPDATE runs SET definition = replace(definition, '0.5', '0.7')",
    "its players are not those of its run"
)]
#[case::declaration(
    "UPDATE runs SET definition = replace(definition, '{\"x\":1}', '{\"x\":2}')",
    "its players are not those of its run"
)]
#[case::token_of_all(
    "UPDATE tokens SET holder = NULL WHERE holder = 2",
    "a token of it names no holder of it"
)]
#[case::token_of_nobody(
    "UPDATE tokens SET holder = 4 WHERE holder = 2",
    "a token of it names no holder of it"
)]
#[case::token_of_a_seat(
    "UPDATE tokens SET agent = 1",
    "a seat or a holder that its episode or run"
)]
#[case::hosted(
    "UPDATE runs SET definition = replace(definition, '\"parallel\"', '\"player\":\"random\",\"parallel\"')",
    "its players are not those of its run"
)]
#[case::no_seats("DELETE FROM seats WHERE agent > 1", "2 of its 4 seats have holders")]
#[case::usage("UPDATE results SET usage = '{\"zzz\":1}'", "its own is another")]
#[tokio::test]
async fn a_damaged_team_is_named(#[case] damage: &'static str, #[case] problem: &str) {
    let app = TestApp::start().await;
    let mut request = team();
    request["holders"][2]["player"] = json!("default");
    let run = Team::of(app.post("/api/v1/runs").json(&request).ok().await);
    assert_eq!(run.play(&app).await["status"], "finished");
    let damages = async || check(app.location(), &FORMATS, |_, _| ()).await.expect("read").damages;
    assert_eq!(damages().await, []);
    app.tamper(damage).await;
    let found = damages().await;
    assert!(found.iter().any(|damage| damage.problem.contains(problem)), "{found:?}");
}
