//! Runs: suites of games for one model, with one token.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use rstest::rstest;
use serde_json::{Value, json};

use crate::app::{Answer, TestApp, check_problem, fields, list, number};

/// Two tasks on two seeds, for two agents and two rounds: four games.
fn small() -> Value {
    json!({
        "suite": {
            "name": "small", "tasks": ["Synchronization", "Foraging"], "seeds": [4, 9],
            "settings": { "num_agents": 2, "max_round": 2 },
        },
        "model": "a model",
    })
}

fn with(mut request: Value, more: &Value) -> Value {
    for (field, value) in more.as_object().expect("an object") {
        request[field] = value.clone();
    }
    request
}

/// A run as it was created.
#[derive(Clone, Debug)]
struct Run {
    id: String,
    token: String,
    created: Value,
}

impl Run {
    fn of(created: &Value) -> Self {
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        Self {
            id: text(&created["id"]),
            token: text(&created["swarm_token"]),
            created: created.clone(),
        }
    }

    fn path(&self, rest: &str) -> String {
        format!("/api/v1/runs/{}{rest}", self.id)
    }
}

async fn create(app: &TestApp, request: Value) -> Run {
    Run::of(&app.post("/api/v1/runs").json(&request).ok().await)
}

async fn show(app: &TestApp, run: &Run) -> Value {
    app.get(&run.path("")).token(&run.token).ok().await
}

async fn look(app: &TestApp, run: &Run, query: &str) -> Value {
    app.get(&format!("/swarm/obs{query}")).token(&run.token).ok().await
}

async fn send(app: &TestApp, run: &Run, acts: &[Value]) -> Vec<Value> {
    let call = app.post("/swarm/act").token(&run.token).json(&json!({ "acts": acts }));
    list(&call.ok().await["receipts"])
}

fn seen(looked: &Value) -> Vec<Value> {
    list(&looked["observations"])
}

fn text<'a>(value: &'a Value, field: &str) -> &'a str {
    value[field].as_str().unwrap_or_else(|| panic!("{field} is no text: {value}"))
}

/// What everybody does who has nothing better to do.
fn stay(observation: &Value) -> Value {
    json!({
        "episode": observation["episode"], "agent": observation["agent"],
        "round": observation["round"], "action": "STAY",
    })
}

/// The games of a run that have this status, by their slots.
fn slots(shown: &Value, status: &str) -> Vec<u64> {
    let games = list(&shown["games"]);
    games.iter().filter(|game| game["status"] == status).map(|game| number(&game["slot"])).collect()
}

/// Plays all that waits until the run is over; returns which seats of which rounds were shown, each once.
async fn play(app: &TestApp, run: &Run) -> Vec<(String, String, u64)> {
    let mut shown = Vec::new();
    let mut place = String::new();
    loop {
        let looked = look(app, run, &format!("?wait=60{place}")).await;
        if looked["finished"] == true {
            assert!(seen(&looked).is_empty());
            return shown;
        }
        let acts: Vec<Value> = seen(&looked).iter().map(stay).collect();
        assert!(!acts.is_empty(), "it waited for nothing: {looked}");
        for receipt in send(app, run, &acts).await {
            assert_eq!(receipt["duplicate"], false, "{receipt}");
        }
        shown.extend(seen(&looked).iter().map(|seen| {
            (
                text(seen, "episode").to_owned(),
                text(seen, "agent").to_owned(),
                number(&seen["round"]),
            )
        }));
        place = format!("&after={}", text(&looked, "cursor"));
    }
}

/// Plays the open rounds of one game until it has ended.
async fn play_game(app: &TestApp, run: &Run, episode: &str) {
    loop {
        let looked = look(app, run, "?limit=1024").await;
        let acts: Vec<Value> =
            (seen(&looked).iter()).filter(|seen| seen["episode"] == episode).map(stay).collect();
        if acts.is_empty() {
            return;
        }
        send(app, run, &acts).await;
    }
}

/// Waits until the run stands so that `is` holds, by its events.
async fn until(app: &TestApp, run: &Run, is: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..10_000 {
        let shown = show(app, run).await;
        if is(&shown) {
            return shown;
        }
    }
    panic!("it does not come: {}", show(app, run).await);
}

/// A number beside what is stored.
async fn stored(app: &TestApp, query: &'static str) -> i64 {
    let path = format!("sqlite://{}?mode=ro", app.database().display());
    let pool = sqlx::SqlitePool::connect(&path).await.expect("the database");
    sqlx::query_scalar(query).fetch_one(&pool).await.expect("a number")
}

mod playing {
    use super::*;

    #[tokio::test]
    async fn a_run_is_played_with_one_token_and_its_games_are_opened_as_others_end() {
        let app = TestApp::with_manual_clock().await;
        let run = create(&app, with(small(), &json!({ "parallel": 3 }))).await;
        assert_eq!(slots(&run.created, "running"), [0, 1, 2]);
        assert_eq!(slots(&run.created, "planned"), [3]);
        let plan: Vec<_> = list(&run.created["games"])
            .iter()
            .map(|game| (text(game, "task").to_owned(), number(&game["seed"])))
            .collect();
        let expected =
            [("Synchronization", 4), ("Synchronization", 9), ("Foraging", 4), ("Foraging", 9)];
        assert_eq!(plan, expected.map(|(task, seed)| (task.to_owned(), seed)));

        let shown = play(&app, &run).await;
        // Four games, two seats, two rounds: every observation came, and only once.
        assert_eq!(shown.len(), 16);
        assert_eq!(shown.iter().collect::<BTreeSet<_>>().len(), 16);
        let result = show(&app, &run).await;
        assert_eq!(result["status"], "finished");
        assert_eq!(slots(&result, "finished"), [0, 1, 2, 3]);
        assert_eq!((&result["played"], &result["planned"]), (&json!(4), &json!(4)));
        assert_eq!(
            (&result["acts"]["sent"], &result["acts"]["clock_outs"]),
            (&json!(16), &json!(0))
        );
        assert_eq!(result["acts"]["invalid_share"], 0.0);

        // Its episodes say to which run they belong, and are found by it.
        let listed = app.get(&format!("/api/v1/episodes?run={}", run.id)).ok().await;
        assert_eq!(list(&listed["items"]).len(), 4);
        for item in list(&listed["items"]) {
            assert_eq!((&item["run"], &item["model"]), (&json!(run.id), &json!("a model")));
            assert_eq!(item["status"], "finished");
        }
        let other = app.get("/api/v1/episodes?run=run_0").ok().await;
        assert_eq!(other["items"], json!([]));

        // The token stays valid.
        let looked = look(&app, &run, "?wait=60").await;
        assert_eq!((&looked["observations"], &looked["finished"]), (&json!([]), &json!(true)));
        let (episode, agent, _) = &shown[0];
        let act = |round: u64, action: &str| json!({ "episode": episode, "agent": agent, "round": round, "action": action });
        let receipts = send(&app, &run, &[act(1, "STAY"), act(2, "STAY")]).await;
        assert_eq!(receipts[0]["duplicate"], true);
        check_problem(&receipts[1], 409, "episode_over");
    }

    #[tokio::test]
    async fn the_result_is_the_mean_and_the_deviation_over_the_seeds() {
        let app = TestApp::start().await;
        let run = create(&app, small()).await;
        play(&app, &run).await;
        let result = show(&app, &run).await;
        let mut total = 0.0;
        for task in list(&result["tasks"]) {
            let of_task =
                list(&result["games"]).into_iter().filter(|game| game["task"] == task["task"]);
            let mut scores = Vec::new();
            for game in of_task {
                let episode =
                    app.get(&format!("/api/v1/episodes/{}", text(&game, "episode"))).ok().await;
                assert_eq!(game["score"], episode["score"]);
                scores.push(episode["score"].as_f64().expect("a number"));
            }
            let mean = f64::midpoint(scores[0], scores[1]);
            assert_eq!(task["mean"], mean);
            let deviation = task["deviation"].as_f64().expect("a number");
            assert!((deviation - ((scores[0] - scores[1]) / 2.0).abs()).abs() < 1e-12, "{task}");
            total += mean;
        }
        assert_eq!(result["total"], total);
    }

    #[tokio::test]
    async fn a_wait_sees_other_games_and_games_that_are_still_to_be_opened() {
        let app = TestApp::with_manual_clock().await;
        let run = create(&app, with(small(), &json!({ "parallel": 2 }))).await;
        let looked = look(&app, &run, "?wait=60").await;
        assert_eq!(seen(&looked).len(), 4);
        let of = |game: usize| text(&run.created["games"][game], "episode").to_owned();
        let acts = |looked: &Value, episode: &str| {
            let seen = seen(looked).into_iter().filter(|seen| seen["episode"] == episode);
            seen.map(|seen| stay(&seen)).collect::<Vec<_>>()
        };
        // The second game continues while the first is waited for, too.
        let place = format!("?wait=60&after={}", text(&looked, "cursor"));
        let second = acts(&looked, &of(1));
        let (next, _) = tokio::join!(look(&app, &run, &place), send(&app, &run, &second));
        assert_eq!(seen(&next).len(), 2);
        for seen in seen(&next) {
            assert_eq!((text(&seen, "episode"), &seen["round"]), (&*of(1), &json!(1)));
        }
        // It ends; what comes next is a game that was not there when the wait began.
        let place = format!("?wait=60&after={}", text(&next, "cursor"));
        let last = acts(&next, &of(1));
        let (opened, _) = tokio::join!(look(&app, &run, &place), send(&app, &run, &last));
        assert_eq!(seen(&opened).len(), 2);
        for seen in seen(&opened) {
            assert_eq!((&seen["round"], &seen["task"]["name"]), (&json!(0), &json!("Foraging")));
        }
        // Without a cursor all that wait are shown, the oldest first.
        let all = look(&app, &run, "").await;
        let episodes: Vec<_> =
            seen(&all).iter().map(|seen| text(seen, "episode").to_owned()).collect();
        assert_eq!(episodes[0], of(0));
        assert_eq!(episodes.len(), 4);
        assert_ne!(episodes[2], of(0));
    }

    #[tokio::test]
    async fn a_page_is_cut_through_several_games() {
        let app = TestApp::start().await;
        let run = create(&app, with(small(), &json!({ "parallel": 4 }))).await;
        let (mut counts, mut all) = (Vec::new(), Vec::new());
        let mut place = String::new();
        for _ in 0..4 {
            let looked = look(&app, &run, &format!("?limit=3{place}")).await;
            counts.push(seen(&looked).len());
            all.extend(seen(&looked));
            place = format!("&after={}", text(&looked, "cursor"));
        }
        assert_eq!(counts, [3, 3, 2, 0]);
        assert_eq!(all, seen(&look(&app, &run, "?limit=1024").await));
        let order: Vec<_> = all.iter().map(|seen| text(seen, "episode")).collect();
        let games = list(&run.created["games"]);
        let expected: Vec<_> =
            games.iter().flat_map(|game| [text(game, "episode"), text(game, "episode")]).collect();
        assert_eq!(order, expected, "the oldest first");
    }

    #[tokio::test]
    async fn a_wait_for_nothing_is_empty_when_the_time_is_up() {
        let app = TestApp::with_manual_clock().await;
        let run = create(&app, small()).await;
        let looked = look(&app, &run, "").await;
        let place = text(&looked, "cursor").to_owned();
        let wait = app.get(&format!("/swarm/obs?wait=10&after={place}")).token(&run.token);
        let looked = app.pass_until(tokio::spawn(wait.ok())).await;
        assert_eq!((&looked["observations"], &looked["finished"]), (&json!([]), &json!(false)));
        assert_eq!(text(&looked, "cursor"), place);
    }

    #[tokio::test]
    async fn acts_go_to_their_own_games_and_to_no_others() {
        let app = TestApp::start().await;
        let run = create(&app, small()).await;
        let other = create(&app, small()).await;
        let alone = app.create(json!({ "task": "Foraging", "num_agents": 2 })).await;
        let of = |run: &Run, game: usize| run.created["games"][game]["episode"].clone();
        let act = |episode: Value, agent: &str, round: u64| json!({ "episode": episode, "agent": agent, "round": round, "action": "STAY" });
        let table = [
            (act(of(&run, 1), "Agent_0", 0), Ok((1, false))),
            (act(of(&run, 0), "Agent_1", 0), Ok((1, false))),
            (act(of(&other, 0), "Agent_0", 0), Err((404, "not_found"))),
            (act(json!(alone.id), "Agent_0", 0), Err((404, "not_found"))),
            (act(json!("ep_0"), "Agent_0", 0), Err((404, "not_found"))),
            (act(of(&run, 2), "Agent_2", 0), Err((404, "not_found"))),
            (act(of(&run, 2), "Agent_1", 1), Err((409, "round_ahead"))),
            (act(of(&run, 1), "Agent_1", 0), Ok((0, false))),
            (act(of(&run, 0), "Agent_1", 0), Ok((1, true))),
            (json!({ "agent": "Agent_0" }), Err((422, "invalid"))),
        ];
        let acts: Vec<Value> = table.iter().map(|(act, _)| act.clone()).collect();
        let receipts = send(&app, &run, &acts).await;
        assert_eq!(receipts.len(), table.len());
        for (receipt, (act, expected)) in receipts.iter().zip(&table) {
            match expected {
                Ok((waiting, duplicate)) => {
                    assert_eq!(receipt["episode"], act["episode"], "{receipt}");
                    assert_eq!(receipt["agent"], act["agent"], "{receipt}");
                    assert_eq!(receipt["waiting_for"], *waiting, "{receipt}");
                    assert_eq!(receipt["duplicate"], *duplicate, "{receipt}");
                }
                Err((status, code)) => check_problem(receipt, *status, code),
            }
        }
        let rounds: Vec<_> = list(&show(&app, &run).await["games"])
            .iter()
            .map(|game| number(&game["round"]))
            .collect();
        assert_eq!(rounds, [0, 1, 0, 0]);
        assert_eq!(app.obs(alone.seat(0)).await["acted"], false);
        assert_eq!(seen(&look(&app, &other, "").await).len(), 8);
    }

    /// Each of several clients sees every observation once, though rounds of many games are resolved at
    /// the same moments, and games come and go.
    #[tokio::test(flavor = "multi_thread", worker_threads = 4)]
    async fn nobody_misses_a_round_that_is_opened_while_others_look() {
        let app = TestApp::start().await;
        let suite = json!({
            "name": "many", "tasks": ["Synchronization"], "seeds": (0..40).collect::<Vec<_>>(),
            "settings": { "num_agents": 1, "max_round": 5 },
        });
        let request = with(small(), &json!({ "suite": suite, "parallel": 16 }));
        let run = create(&app, request).await;
        let app = &app;
        // Each of them plays the games whose ids end so; all of them see all.
        let client = |part: u64| {
            let run = run.clone();
            async move {
                let mut all = Vec::new();
                let mut place = String::new();
                loop {
                    let looked = look(app, &run, &format!("?wait=60{place}")).await;
                    if looked["finished"] == true {
                        return all;
                    }
                    assert!(!seen(&looked).is_empty(), "a wait that saw nothing");
                    let mine = |seen: &&Value| {
                        let id = text(seen, "episode");
                        u64::from_str_radix(&id[id.len() - 2..], 16).expect("digits") % 4 == part
                    };
                    let acts: Vec<Value> = seen(&looked).iter().filter(mine).map(stay).collect();
                    if !acts.is_empty() {
                        for receipt in send(app, &run, &acts).await {
                            assert_eq!(receipt["duplicate"], false, "{receipt}");
                        }
                    }
                    all.extend(
                        seen(&looked)
                            .iter()
                            .filter(mine)
                            .map(|seen| (text(seen, "episode").to_owned(), number(&seen["round"]))),
                    );
                    place = format!("&after={}", text(&looked, "cursor"));
                }
            }
        };
        let parts = tokio::join!(client(0), client(1), client(2), client(3));
        let all: Vec<_> = [parts.0, parts.1, parts.2, parts.3].concat();
        assert_eq!(all.len(), 200, "every round of every game was seen by who played it");
        assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), 200, "and once");
        assert_eq!(show(app, &run).await["played"], 40);
    }

    #[tokio::test]
    async fn who_watches_is_told_of_every_game_and_of_the_end() {
        let app = TestApp::start().await;
        let run = create(&app, with(small(), &json!({ "parallel": 1 }))).await;
        let events = app.get(&run.path("/events")).token(&run.token).send();
        let (events, _) = tokio::join!(events, play(&app, &run));
        assert_eq!(events.status, 200);
        assert_eq!(events.header("content-type"), "text/event-stream");
        let told: Vec<(String, Value)> = (events.text().split("\n\n"))
            .filter_map(|event| {
                let line = |name: &str| {
                    event.lines().find_map(|line| line.strip_prefix(&format!("{name}: ")))
                };
                Some((
                    line("event")?.to_owned(),
                    serde_json::from_str(line("data")?).expect("JSON"),
                ))
            })
            .collect();
        let (last, games) = told.split_last().expect("events");
        assert_eq!((&*last.0, &last.1), ("finished", &show(&app, &run).await));
        let mut states: BTreeMap<u64, Vec<String>> = BTreeMap::new();
        for (name, game) in games {
            assert_eq!(name, "game");
            states.entry(number(&game["slot"])).or_default().push(text(game, "status").to_owned());
        }
        for slot in 0..4 {
            assert_eq!(states[&slot].last().expect("an event"), "finished", "{states:?}");
        }
        // A later client gets the result.
        let again = app.get(&run.path("/events")).token(&run.token).send().await.text();
        assert_eq!(again.matches("event: game").count(), 4);
        assert_eq!(again.matches("event: finished").count(), 1);
    }
}

mod ending {
    use super::*;

    #[tokio::test]
    async fn an_aborted_run_has_what_it_has() {
        let app = TestApp::with_manual_clock().await;
        let run = create(&app, with(small(), &json!({ "parallel": 2 }))).await;
        let first = text(&run.created["games"][0], "episode").to_owned();
        play_game(&app, &run, &first).await;
        let before = until(&app, &run, |shown| slots(shown, "running") == [1, 2]).await;
        assert_eq!((&before["status"], &before["played"]), (&json!("running"), &json!(1)));
        // Before the end the means are of what has ended.
        assert_eq!(before["tasks"][0]["mean"], before["games"][0]["score"]);
        assert_eq!(before["tasks"][1]["mean"], Value::Null);

        // Both open games are seen; the next event of them is their end.
        let seen = |place: &Value| {
            let all = place["observations"].as_array().expect("observations").iter();
            all.map(|seen| text(seen, "episode").to_owned()).collect::<BTreeSet<_>>().len()
        };
        let mut place = look(&app, &run, "").await;
        while seen(&place) < 2 {
            place = look(&app, &run, "").await;
        }
        let place = format!("?wait=60&after={}", text(&place, "cursor"));
        let abort = app.delete(&run.path("")).token(&run.token);
        let (looked, aborted) = tokio::join!(look(&app, &run, &place), abort.ok());
        assert_eq!((&looked["observations"], &looked["finished"]), (&json!([]), &json!(true)));
        assert_eq!(aborted["status"], "aborted");
        assert_eq!(slots(&aborted, "aborted"), [1, 2]);
        assert_eq!(slots(&aborted, "planned"), [3]);
        assert_eq!((&aborted["played"], &aborted["planned"]), (&json!(3), &json!(4)));
        // What was never played counts as 0.
        assert_eq!(aborted["tasks"][1]["mean"], 0.0);
        assert_eq!(aborted["total"], aborted["tasks"][0]["mean"]);
        let act = json!({
            "episode": aborted["games"][1]["episode"], "agent": "Agent_0", "round": 0, "action": "UP",
        });
        check_problem(&send(&app, &run, &[act]).await[0], 409, "episode_over");

        // Once more changes nothing, and neither does time.
        assert_eq!(app.delete(&run.path("")).token(&run.token).ok().await, aborted);
        app.pass(Duration::from_secs(200_000));
        assert_eq!(show(&app, &run).await, aborted);
    }

    #[tokio::test]
    async fn a_finished_run_is_not_aborted() {
        let app = TestApp::start().await;
        let run = create(&app, small()).await;
        play(&app, &run).await;
        app.delete(&run.path("")).token(&run.token).problem(409, "episode_over").await;
        assert_eq!(show(&app, &run).await["status"], "finished");
    }

    #[tokio::test]
    async fn a_run_that_nobody_plays_any_more_is_abandoned() {
        let app = TestApp::with_manual_clock().await;
        let request = with(small(), &json!({ "parallel": 2, "idle_timeout_s": 100 }));
        let run = create(&app, request).await;
        app.pass(Duration::from_mins(1));
        // One of the two games advances a little.
        let act = json!({
            "episode": run.created["games"][1]["episode"], "agent": "Agent_0", "round": 0, "action": "UP",
        });
        send(&app, &run, &[act]).await;
        app.pass(Duration::from_mins(1));
        let shown = until(&app, &run, |shown| !slots(shown, "abandoned").is_empty()).await;
        assert_eq!((slots(&shown, "abandoned"), slots(&shown, "running")), (vec![0], vec![1]));
        assert_eq!(shown["status"], "running", "the game that is open may be played to its end");
        app.pass(Duration::from_mins(1));
        let shown = until(&app, &run, |shown| shown["status"] != "running").await;
        assert_eq!(shown["status"], "abandoned");
        assert_eq!(slots(&shown, "planned"), [2, 3]);
        assert_eq!(look(&app, &run, "?wait=60").await["finished"], true);
    }

    #[tokio::test]
    async fn a_game_that_is_aborted_counts_as_it_stands() {
        let app = TestApp::start().await;
        let run = create(&app, with(small(), &json!({ "parallel": 1 }))).await;
        let first = text(&run.created["games"][0], "episode").to_owned();
        app.delete(&format!("/api/v1/episodes/{first}")).token(&run.token).ok().await;
        play(&app, &run).await;
        let result = show(&app, &run).await;
        assert_eq!((&result["status"], &result["played"]), (&json!("finished"), &json!(4)));
        assert_eq!(slots(&result, "aborted"), [0]);
    }
}

mod creating {
    use super::*;

    #[tokio::test]
    async fn a_built_in_suite_is_what_its_definition_says() {
        let app = TestApp::start().await;
        let suites = list(&app.get("/api/v1/suites").ok().await["items"]);
        let names: Vec<_> =
            suites.iter().map(|suite| (text(suite, "name"), text(suite, "rules"))).collect();
        let pairs = |name| [(name, "paper"), (name, "reference")];
        assert_eq!(names, [pairs("standard"), pairs("quick")].concat());
        let digests: BTreeSet<_> = suites.iter().map(|suite| text(suite, "digest")).collect();
        assert_eq!(digests.len(), 4);
        assert_eq!(suites[0]["seeds"], json!([27, 42, 57, 72, 87]));
        assert_eq!((&suites[0]["games"], &suites[2]["games"]), (&json!(25), &json!(5)));
        for (suite, rounds) in [(&suites[0], 100), (&suites[2], 20)] {
            assert_eq!(suite["settings"]["max_round"], rounds);
            assert_eq!(list(&suite["tasks"]).len(), 5);
        }

        let request = json!({
            "suite": "quick", "rules": "reference", "model": "a model", "temperature": 0.5, "top_p": 0.9,
            "agent_meta": { "prompting": "short" }, "prompt_template": "{{ round }}", "parallel": 2,
        });
        let run = create(&app, request).await;
        assert_eq!(run.created["suite"], suites[3]);
        let told = ["temperature", "top_p", "agent_meta"].map(|field| &run.created[field]);
        assert_eq!(told, [&json!(0.5), &json!(0.9), &json!({ "prompting": "short" })]);
        assert_eq!(text(&run.created, "template_digest").len(), 12);
        let first = &run.created["games"][0];
        let episode = app.get(&format!("/api/v1/episodes/{}", text(first, "episode"))).ok().await;
        let meta = json!({ "prompting": "short", "temperature": 0.5, "top_p": 0.9 });
        assert_eq!(episode["config"]["agent_meta"], meta);
        assert_eq!(episode["config"]["prompt_template"], "{{ round }}");
        for (field, value) in
            [("seed", json!(27)), ("max_round", json!(20)), ("num_agents", json!(12))]
        {
            assert_eq!(episode["config"][field], value);
        }
        assert_eq!(episode["config"]["rules"], "reference");
    }

    #[tokio::test]
    async fn clocks_make_another_suite() {
        let app = TestApp::start().await;
        let clocks = json!({ "suite": "quick", "round_deadline_s": 30, "bank_s": 60 });
        let run = create(&app, with(small(), &clocks)).await;
        let suites = list(&app.get("/api/v1/suites").ok().await["items"]);
        assert_eq!(run.created["suite"]["name"], "quick");
        assert_ne!(run.created["suite"]["digest"], suites[2]["digest"]);
        assert_eq!(run.created["suite"]["settings"]["round_deadline_s"], 30);
        assert!(look(&app, &run, "").await["observations"][0]["deadline"].is_string());
    }

    #[rstest]
    #[case(json!({ "suite": null }), &["suite"])]
    #[case(json!({ "suite": "long" }), &["suite"])]
    #[case(json!({ "suite": 3 }), &["suite"])]
    #[case(json!({ "suite": {} }), &["suite"])]
    #[case(json!({ "suite": { "name": "x", "seeds": [1], "speed": 2 } }), &["suite"])]
    #[case(json!({ "suite": { "name": "quick", "seeds": [1] } }), &["suite.name"])]
    #[case(json!({ "suite": { "name": "", "seeds": [] } }), &["suite.name", "suite.seeds"])]
    #[case(json!({ "suite": { "name": "x", "seeds": [1, 1] } }), &["suite.seeds"])]
    #[case(json!({ "suite": { "name": "x", "seeds": [-1] } }), &["suite.seeds"])]
    #[case(json!({ "suite": { "name": "x", "seeds": [9_007_199_254_740_992_i64] } }), &["suite.seeds"])]
    #[case(json!({ "suite": { "name": "x", "seeds": [1], "tasks": ["Chess"] } }), &["suite.tasks"])]
    #[case(json!({ "suite": { "name": "x", "seeds": [1], "tasks": [] } }), &["suite.tasks"])]
    #[case(
        json!({ "suite": { "name": "x", "seeds": (0..300).collect::<Vec<_>>() } }),
        &["suite"]
    )]
    #[case(
        json!({ "suite": { "name": "x", "seeds": [1], "settings": { "width": 3, "noise": 2 } } }),
        &["suite.settings.width", "suite.settings.noise"]
    )]
    #[case(json!({ "rules": "chess" }), &["rules"])]
    #[case(json!({ "model": null }), &["model"])]
    #[case(json!({ "model": "a\nb", "temperature": -1, "top_p": 2 }), &["model", "temperature", "top_p"])]
    #[case(json!({ "parallel": 0 }), &["parallel"])]
    #[case(json!({ "parallel": 65 }), &["parallel"])]
    #[case(json!({ "player": "chess-master" }), &["player", "player"])]
    #[case(json!({ "player": "round-clock" }), &["player"])]
    #[case(json!({ "visibility": "sealed" }), &["visibility"])]
    #[case(json!({ "prompt_template": "{% for x in y %}" }), &["prompt_template"])]
    #[case(json!({ "idle_timeout_s": 0, "bank_s": -1 }), &["bank_s", "idle_timeout_s"])]
    #[case(json!({ "agent_meta": { "x": "y".repeat(20_000) } }), &["agent_meta"])]
    #[case(json!({ "seed": 3 }), &["seed"])]
    #[tokio::test]
    async fn what_cannot_be_played_is_refused_by_name(#[case] more: Value, #[case] named: &[&str]) {
        let app = TestApp::start().await;
        let call = app.post("/api/v1/runs").json(&with(small(), &more));
        let problem = call.problem(422, "invalid").await;
        assert_eq!(fields(&problem), named, "{problem}");
        assert_eq!(app.get("/api/v1/runs").ok().await["items"], json!([]));
        assert_eq!(app.get("/api/v1/episodes").ok().await["items"], json!([]));
    }

    #[tokio::test]
    async fn a_repeated_creation_gives_the_same_run_and_a_new_token() {
        let app = TestApp::start().await;
        let call = || app.post("/api/v1/runs").header("Idempotency-Key", "once");
        let first = Run::of(&call().json(&small()).ok().await);
        look(&app, &first, "").await;
        let again = Run::of(&call().json(&small()).ok().await);
        assert_eq!(again.id, first.id);
        app.get("/swarm/obs").token(&first.token).problem(401, "unauthorized").await;
        assert_eq!(seen(&look(&app, &again, "").await).len(), 8);
        call().json(&with(small(), &json!({ "model": "another" }))).problem(422, "invalid").await;
        assert_eq!(list(&app.get("/api/v1/runs").ok().await["items"]).len(), 1);
        assert_eq!(list(&app.get("/api/v1/episodes").ok().await["items"]).len(), 4);
    }

    #[tokio::test]
    async fn a_client_that_lost_its_token_gets_another() {
        let app = TestApp::builder().keys().start().await;
        let (owner, _) = app.key(json!({ "name": "owner" })).await;
        let call = app.post("/api/v1/runs").token(&owner).json(&small());
        let run = Run::of(&call.ok().await);
        look(&app, &run, "").await;
        let fresh = app.post(&run.path("/token")).token(&owner).send().await;
        assert_eq!((fresh.status, fresh.header("cache-control")), (200, "no-store"));
        app.get("/swarm/obs").token(&run.token).problem(401, "unauthorized").await;
        let run = Run { token: text(&fresh.json(), "swarm_token").to_owned(), ..run };
        play(&app, &run).await;
        // Also when it is over.
        app.post(&run.path("/token")).token(&owner).ok().await;
        let (member, _) = app.key(json!({ "name": "member" })).await;
        app.post(&run.path("/token")).token(&member).problem(403, "forbidden").await;
    }

    #[tokio::test]
    async fn what_the_server_plays_itself_has_no_token() {
        let app = TestApp::start().await;
        let request = with(small(), &json!({ "player": "default" }));
        let created = app.post("/api/v1/runs").json(&request).ok().await;
        assert_eq!(
            (&created["swarm_token"], &created["player"]),
            (&Value::Null, &json!("default"))
        );
        let path = format!("/api/v1/runs/{}/token", text(&created, "id"));
        app.post(&path).problem(403, "forbidden").await;
    }

    #[tokio::test]
    async fn runs_are_listed_the_newest_first() {
        let app = TestApp::start().await;
        let mut ids = Vec::new();
        for model in ["a", "b", "a"] {
            ids.push(create(&app, with(small(), &json!({ "model": model }))).await);
        }
        app.delete(&ids[0].path("")).ok().await;
        let find = async |query: &str| -> Vec<usize> {
            let found = app.get(&format!("/api/v1/runs{query}")).ok().await;
            let place = |item: &Value| ids.iter().position(|run| item["id"] == run.id.as_str());
            list(&found["items"]).iter().map(|item| place(item).expect("a known run")).collect()
        };
        assert_eq!(find("").await, [2, 1, 0]);
        assert_eq!(find("?model=a").await, [2, 0]);
        assert_eq!(find("?status=aborted").await, [0]);
        assert_eq!(find("?suite=small&status=running").await, [2, 1]);
        assert!(find("?suite=standard").await.is_empty());
        let page = app.get("/api/v1/runs?limit=2").ok().await;
        assert_eq!(list(&page["items"]).len(), 2);
        let rest = format!("?limit=2&cursor={}", text(&page, "next_cursor"));
        assert_eq!(find(&rest).await, [0]);
        for query in ["?status=done", "?limit=0", "?cursor=x", "?task=Foraging"] {
            app.get(&format!("/api/v1/runs{query}")).problem(400, "malformed").await;
        }
        let item = &app.get("/api/v1/runs?status=aborted").ok().await["items"][0];
        assert_eq!((&item["played"], &item["total"]), (&json!(4), &json!(0.0)));
        app.get("/api/v1/runs/run_0").problem(404, "not_found").await;
    }
}

mod waiting_for_a_place {
    use super::*;

    #[tokio::test]
    async fn a_run_waits_until_others_have_ended() {
        let builder = TestApp::builder().manual_clock();
        let app = builder.limits(|limits| limits.episodes_unfinished_max = 3).start().await;
        let alone = app.create(json!({ "task": "Foraging" })).await;
        let run = create(&app, small()).await;
        assert_eq!(slots(&run.created, "running"), [0, 1]);
        let problem = app.post("/api/v1/runs").json(&small()).problem(503, "overloaded").await;
        assert_eq!(problem["limit"]["name"], "episodes_unfinished_max");
        // Whenever one of its games has ended, the next one is opened.
        let first = text(&run.created["games"][0], "episode").to_owned();
        play_game(&app, &run, &first).await;
        until(&app, &run, |shown| slots(shown, "running") == [1, 2]).await;
        // The place of another is found by the sweep, which comes every minute.
        app.delete(&alone.path("")).token(&alone.swarm).ok().await;
        assert_eq!(slots(&show(&app, &run).await, "running"), [1, 2]);
        app.pass(Duration::from_secs(61));
        until(&app, &run, |shown| slots(shown, "running") == [1, 2, 3]).await;
        play(&app, &run).await;
        assert_eq!(show(&app, &run).await["status"], "finished");
    }

    #[tokio::test]
    async fn nothing_is_opened_on_a_full_disk() {
        let app = TestApp::with_manual_clock().await;
        let run = create(&app, with(small(), &json!({ "parallel": 1 }))).await;
        app.disk.set(4);
        let problem = app.post("/api/v1/runs").json(&small()).problem(503, "overloaded").await;
        assert_eq!(problem["limit"]["name"], "disk_free_percent_min");
        let first = text(&run.created["games"][0], "episode").to_owned();
        play_game(&app, &run, &first).await;
        app.pass(Duration::from_secs(61));
        let shown = until(&app, &run, |shown| slots(shown, "running").is_empty()).await;
        assert_eq!(
            (&shown["status"], slots(&shown, "planned")),
            (&json!("running"), vec![1, 2, 3])
        );
        app.disk.set(50);
        // The sweep of a minute before may not have ended yet: then the next one finds the place.
        for _ in 0..200 {
            app.pass(Duration::from_secs(61));
            if slots(&show(&app, &run).await, "running") == [1] {
                return;
            }
        }
        panic!("no game is opened: {}", show(&app, &run).await);
    }
}

mod restarting {
    use super::*;

    /// Every game of the plan that counts, and no slot twice.
    fn check(shown: &Value) {
        let counted: Vec<_> = list(&shown["games"])
            .iter()
            .filter(|game| game["episode"].is_string() && game["void_reason"].is_null())
            .map(|game| number(&game["slot"]))
            .collect();
        assert_eq!(counted.len(), counted.iter().collect::<BTreeSet<_>>().len(), "{shown}");
    }

    #[tokio::test]
    async fn a_run_goes_on_after_a_stop() {
        let mut app = TestApp::start().await;
        let run = create(&app, with(small(), &json!({ "parallel": 2 }))).await;
        let first = text(&run.created["games"][0], "episode").to_owned();
        play_game(&app, &run, &first).await;
        until(&app, &run, |shown| slots(shown, "running") == [1, 2]).await;
        let place = look(&app, &run, "").await;
        let before = show(&app, &run).await;
        app.restart().await;
        assert_eq!(show(&app, &run).await, before);
        // All that waits comes again, whatever the cursor.
        let again = look(&app, &run, &format!("?after={}", text(&place, "cursor"))).await;
        assert_eq!(seen(&again).len(), 4);
        play(&app, &run).await;
        let result = show(&app, &run).await;
        check(&result);
        assert_eq!((&result["status"], &result["played"]), (&json!("finished"), &json!(4)));
    }

    /// The process is gone at any moment of a run; whatever the disk holds then is played to the same end.
    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_crash_at_any_moment_leaves_nothing_double_or_forgotten() {
        let app = TestApp::start().await;
        let run = create(&app, with(small(), &json!({ "parallel": 3 }))).await;
        let mut crashes = 0;
        loop {
            let looked = look(&app, &run, "?wait=60").await;
            let over = looked["finished"] == true;
            if !over {
                let acts: Vec<Value> = seen(&looked).iter().take(1).map(stay).collect();
                send(&app, &run, &acts).await;
            }
            let after = app.after_a_crash().await;
            crashes += 1;
            let shown = show(&after, &run).await;
            check(&shown);
            assert!(over || shown["status"] == "running" || crashes > 8, "{shown}");
            play(&after, &run).await;
            let result = show(&after, &run).await;
            check(&result);
            assert_eq!((&result["status"], &result["played"]), (&json!("finished"), &json!(4)));
            assert_eq!(stored(&after, "SELECT count(*) FROM results").await, 4);
            if over {
                break;
            }
        }
        assert!(crashes > 16, "{crashes}");
    }

    /// A crash between the steps that belong together, made by hand.
    #[rstest]
    #[case::created_but_no_game_opened("DELETE FROM episodes", "running", 2)]
    #[case::a_game_has_ended_and_none_was_opened(
        "UPDATE episodes SET status = 'finished', reason = 'rounds_played', ended_at = 1 WHERE slot = 0",
        "running",
        2
    )]
    #[case::the_run_is_aborted_but_its_games_are_not(
        "UPDATE runs SET status = 'aborted', ended_at = 1",
        "aborted",
        0
    )]
    #[case::a_game_is_voided_but_has_not_ended(
        "UPDATE episodes SET voided_at = 1, void_reason = 'x' WHERE slot = 0",
        "running",
        2
    )]
    #[case::the_last_game_has_ended_but_not_the_run(
        "UPDATE episodes SET status = 'finished', reason = 'rounds_played', ended_at = 1",
        "finished",
        0
    )]
    #[tokio::test]
    async fn what_was_left_half_done_is_done_at_the_start(
        #[case] change: &'static str,
        #[case] status: &str,
        #[case] running: usize,
    ) {
        let mut app = TestApp::start().await;
        let mut request = with(small(), &json!({ "parallel": 2 }));
        if status == "finished" {
            request["suite"]["tasks"] = json!(["Synchronization"]);
        }
        let run = create(&app, request).await;
        app.stop().await;
        let path = format!("sqlite://{}", app.database().display());
        let pool = sqlx::SqlitePool::connect(&path).await.expect("the database");
        sqlx::query(change).execute(&pool).await.expect("a change");
        pool.close().await;
        app.start_again().await;
        let shown = until(&app, &run, |shown| {
            let games = list(&shown["games"]);
            let open = games.iter().filter(|game| game["status"] == "running");
            open.count() == running && shown["status"] == status
        })
        .await;
        check(&shown);
        if status == "running" {
            play(&app, &run).await;
        }
        let result = show(&app, &run).await;
        check(&result);
        assert_eq!(look(&app, &run, "?wait=60").await["finished"], true);
    }
}

mod voiding {
    use super::*;

    async fn void(app: &TestApp, episode: &str, key: &str) -> Answer {
        let call = app.post(&format!("/api/v1/episodes/{episode}/void")).token(key);
        call.json(&json!({ "reason": "power cut" })).send().await
    }

    #[tokio::test]
    async fn what_the_host_broke_is_played_again() {
        let app = TestApp::builder().keys().start().await;
        let (owner, _) = app.key(json!({ "name": "owner" })).await;
        let request = with(small(), &json!({ "parallel": 2 }));
        let run = Run::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await);
        let of = |game: usize| text(&run.created["games"][game], "episode").to_owned();
        // A game that is played, and one that has ended.
        play_game(&app, &run, &of(0)).await;
        assert_eq!(void(&app, &of(0), &owner).await.status, 403);
        assert_eq!(void(&app, &of(0), &run.token).await.status, 403);
        for game in [0, 1] {
            let voided = void(&app, &of(game), &app.organizer).await;
            assert_eq!(voided.status, 200, "{}", voided.text());
            assert_eq!(voided.json()["void_reason"], "power cut");
            assert_ne!(voided.json()["status"], "running");
        }
        // Again: nothing changes, not even the reason.
        let call = app.post(&format!("/api/v1/episodes/{}/void", of(0))).token(&app.organizer);
        let again = call.json(&json!({ "reason": "another" })).ok().await;
        assert_eq!(again["void_reason"], "power cut");
        assert_eq!(
            stored(&app, "SELECT count(*) FROM audit WHERE action = 'episode.void'").await,
            2
        );

        play(&app, &run).await;
        let result = show(&app, &run).await;
        assert_eq!(result["status"], "finished");
        let told = ["played", "planned", "voided"].map(|field| number(&result[field]));
        assert_eq!(told, [4, 4, 2]);
        assert_eq!(list(&result["games"]).len(), 6);
        assert_eq!(result["acts"]["sent"], 16, "acts in games that count");
        assert_eq!(slots(&result, "finished"), [0, 0, 1, 2, 3]);
    }

    #[tokio::test]
    async fn what_is_voided_after_the_end_counts_for_nothing() {
        let app = TestApp::builder().keys().start().await;
        let request = with(small(), &json!({ "visibility": "public" }));
        let call = app.post("/api/v1/runs").token(&app.organizer).json(&request);
        let run = Run::of(&call.ok().await);
        play(&app, &run).await;
        let before = show(&app, &run).await;
        let first = text(&run.created["games"][0], "episode").to_owned();
        assert_eq!(void(&app, &first, &app.organizer).await.status, 200);
        let after = show(&app, &run).await;
        let told = ["played", "planned", "voided"].map(|field| number(&after[field]));
        assert_eq!(told, [3, 3, 1]);
        assert_eq!(after["status"], "finished");
        assert_eq!(after["tasks"][0]["mean"], before["games"][1]["score"]);
        assert_eq!(after["tasks"][0]["deviation"], 0.0);
        assert_eq!(list(&after["games"]).len(), 4);
    }

    #[tokio::test]
    async fn an_episode_without_a_run_is_voided_too() {
        let app = TestApp::builder().keys().start().await;
        let episode = app.create_with(&app.organizer, json!({ "task": "Foraging" })).await;
        let voided = void(&app, &episode.id, &app.organizer).await.json();
        assert_eq!(
            (&voided["status"], &voided["void_reason"]),
            (&json!("aborted"), &json!("power cut"))
        );
        let call = app.post(&episode.path("/void")).token(&app.organizer);
        let problem = call.json(&json!({ "reason": "" })).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["reason"]);
        let call = app.post("/api/v1/episodes/ep_0/void").token(&app.organizer);
        call.json(&json!({ "reason": "x" })).problem(404, "not_found").await;
    }
}

mod seeing {
    use super::*;

    /// The answer to each caller for a run that they may or may not read.
    #[tokio::test]
    async fn a_run_is_seen_like_its_episodes() {
        let app = TestApp::builder().keys().start().await;
        let (owner, _) = app.key(json!({ "name": "owner" })).await;
        let (member, _) = app.key(json!({ "name": "member" })).await;
        let create = async |visibility: &str| {
            let request = with(small(), &json!({ "visibility": visibility }));
            Run::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await)
        };
        let private = create("owner").await;
        let public = create("public").await;
        for (run, token, status, with_seeds) in [
            (&private, None, 404, false),
            (&private, Some(&member), 404, false),
            (&private, Some(&public.token), 404, false),
            (&private, Some(&private.token), 200, true),
            (&private, Some(&owner), 200, true),
            (&private, Some(&app.organizer), 200, true),
            (&public, None, 200, false),
            (&public, Some(&member), 200, false),
            (&public, Some(&private.token), 200, false),
            (&public, Some(&public.token), 200, true),
            (&public, Some(&owner), 200, true),
        ] {
            let ask = |path: &str| {
                let call = app.get(path);
                token.map_or_else(|| app.get(path), |token| call.token(token))
            };
            let shown = ask(&run.path("")).send().await;
            assert_eq!(shown.status, status, "{}", shown.text());
            let listed = ask("/api/v1/runs").ok().await;
            let is_listed = list(&listed["items"]).iter().any(|item| item["id"] == run.id.as_str());
            assert_eq!(is_listed, status == 200);
            if status == 200 {
                let shown = shown.json();
                assert_eq!(shown["suite"]["seeds"].is_array(), with_seeds, "{shown}");
                assert_eq!(shown["suite"]["digest"].is_string(), with_seeds);
                assert_eq!(shown["games"][0]["seed"].is_number(), with_seeds);
            }
            let abort = app.delete(&run.path(""));
            let abort = token.map_or_else(|| app.delete(&run.path("")), |token| abort.token(token));
            if !with_seeds {
                let expected = if status == 200 { 403 } else { 404 };
                assert_eq!(abort.send().await.status, expected);
            }
        }
        // After its end everybody may know everything.
        app.delete(&private.path("")).token(&owner).ok().await;
        let shown = app.get(&private.path("")).ok().await;
        assert_eq!(shown["suite"]["seeds"], json!([4, 9]));
        assert_eq!(shown["games"][3]["seed"], 9);
        // What an organizer does to what belongs to others is noted.
        app.delete(&public.path("")).token(&app.organizer).ok().await;
        assert_eq!(stored(&app, "SELECT count(*) FROM audit WHERE action = 'run.abort'").await, 1);
    }

    #[tokio::test]
    async fn of_a_sealed_run_its_player_sees_only_that_it_is_there_and_how_far_it_is() {
        let mut app = TestApp::builder().keys().start().await;
        let (owner, _) = app.key(json!({ "name": "owner" })).await;
        let mut request = with(small(), &json!({ "parallel": 2 }));
        request["suite"]["seeds"] = json!([707_070_707, 808_080_808]);
        let run = Run::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await);
        // Only competitions seal runs.
        app.stop().await;
        let path = format!("sqlite://{}", app.database().display());
        let pool = sqlx::SqlitePool::connect(&path).await.expect("the database");
        let seal = "
            UPDATE runs SET visibility = 'sealed', definition = json_set(definition, '$.visibility', 'sealed');
            UPDATE episodes SET visibility = 'sealed',
                                opening = json_set(opening, '$.config.visibility', 'sealed')";
        sqlx::raw_sql(seal).execute(&pool).await.expect("a change");
        pool.close().await;
        app.start_again().await;

        let check = async |app: &TestApp, run: &Run, played: u64| {
            for token in [&owner, &run.token] {
                let shown = app.get(&run.path("")).token(token).ok().await;
                assert_eq!(number(&shown["played"]), played);
                for field in ["digest", "seeds"] {
                    assert_eq!(shown["suite"][field], Value::Null);
                }
                for task in list(&shown["tasks"]).iter().chain([&shown]) {
                    let told = ["mean", "deviation", "total"].map(|field| task[field].is_number());
                    assert_eq!(told, [false; 3], "{task}");
                }
                for game in list(&shown["games"]) {
                    let told = ["seed", "score", "reason"].map(|field| &game[field]);
                    assert_eq!(told, [&Value::Null; 3], "{game}");
                }
                let listed = app.get("/api/v1/runs").token(token).ok().await;
                assert_eq!(list(&listed["items"]).len(), 1);
                for answer in [shown, listed] {
                    let text = answer.to_string();
                    assert!(!text.contains("707070707") && !text.contains("808080808"), "{text}");
                }
                app.delete(&run.path("")).token(token).problem(403, "forbidden").await;
            }
            app.get(&run.path("")).problem(404, "not_found").await;
            assert_eq!(app.get("/api/v1/runs").ok().await["items"], json!([]));
            let all = app.get(&run.path("")).token(&app.organizer).ok().await;
            assert_eq!(all["suite"]["seeds"], json!([707_070_707, 808_080_808]));
        };
        check(&app, &run, 0).await;
        // Its player gets a new token, and plays.
        let fresh = app.post(&run.path("/token")).token(&owner).ok().await;
        let run = Run { token: text(&fresh, "swarm_token").to_owned(), ..run };
        play(&app, &run).await;
        check(&app, &run, 4).await;
        let events = app.get(&run.path("/events")).token(&owner).send().await.text();
        assert!(events.contains("event: finished"), "{events}");
        assert!(!events.contains("707070707") && !events.contains("808080808"), "{events}");
    }

    #[tokio::test]
    async fn a_token_of_a_run_reads_its_episodes_and_creates_nothing() {
        let app = TestApp::builder().keys().start().await;
        let (owner, _) = app.key(json!({ "name": "owner" })).await;
        let run = Run::of(&app.post("/api/v1/runs").token(&owner).json(&small()).ok().await);
        let episode = text(&run.created["games"][0], "episode").to_owned();
        for path in ["", "/state", "/journal"] {
            let call = app.get(&format!("/api/v1/episodes/{episode}{path}")).token(&run.token);
            assert_eq!(call.send().await.status, 200, "{path}");
        }
        app.post("/api/v1/runs").token(&run.token).json(&small()).problem(403, "forbidden").await;
        app.get("/obs").token(&run.token).problem(403, "forbidden").await;
        let listed = app.get("/api/v1/episodes").token(&run.token).ok().await;
        assert_eq!(list(&listed["items"]).len(), 4);
        app.post("/api/v1/runs").json(&small()).problem(401, "unauthorized").await;
    }
}
