//! Language models, played by an endpoint of the test.

use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::{Value, json};

use super::bench::{Bench, Running};
use crate::llm::endpoint::{Endpoint, Reply, Seen, completion};

/// Small games: two agents, four rounds.
const SMALL: [&str; 6] = ["--num-agents", "2", "--max-round", "4", "--seeds", "1,2"];

/// Answer of an agent that switches its light.
fn switch() -> Reply {
    Reply::says("I look around.\n**ACTION:** SWITCH\nMSG: hello")
}

fn with<'a>(endpoint: &'a Endpoint, more: &[&'a str]) -> Vec<&'a str> {
    let usual = ["--model", "m", "--api-base", endpoint.base(), "--task", "Synchronization"];
    [&usual[..], &SMALL, more].concat()
}

#[tokio::test]
async fn every_seat_is_a_conversation_with_the_prompt_of_the_server() {
    let bench = Bench::new();
    let endpoint =
        Endpoint::start(
            |number, _| {
                if number % 4 == 0 { Reply::says("I do not know.") } else { switch() }
            },
        )
        .await;
    let sampling = ["--temperature", "0.7", "--top-p", "0.9", "--max-tokens", "64"];
    let extra = ["--extra", r#"{"reasoning_effort": "low"}"#, "--verify"];
    let board = bench.board(&with(&endpoint, &[&sampling[..], &extra].concat())).await;
    let row = &board["rows"][0];
    assert_eq!(
        (&row["model"], &row["status"], &row["verified"]),
        (&"m".into(), &"finished".into(), &true.into())
    );
    // Two seeds, four rounds, two agents; every fourth answer is none; 10 and 5 tokens each.
    let acts = &row["acts"];
    assert_eq!((&acts["sent"], &acts["invalid"]), (&16.into(), &4.into()));
    assert_eq!((&acts["prompt_tokens"], &acts["completion_tokens"]), (&160.into(), &80.into()));
    let seen = endpoint.seen();
    assert_eq!(seen.len(), 16);
    for Seen { uri, body, .. } in &seen {
        assert_eq!(uri.path(), "/v1/chat/completions");
        assert_eq!(body["model"], "m");
        let sent =
            ["temperature", "top_p", "max_tokens", "reasoning_effort"].map(|name| &body[name]);
        assert_eq!(sent, [&json!(0.7), &json!(0.9), &json!(64), &json!("low")]);
        let messages = body["messages"].as_array().expect("messages");
        assert_eq!((messages.len(), &messages[0]["role"]), (1, &"user".into()));
    }
    // The prompts are those of the server: of each agent, its round, and what it did.
    for (agent, round) in [("Agent_0", 0), ("Agent_1", 3)] {
        let of = |seen: &&Seen| {
            let prompt = seen.prompt();
            prompt.starts_with(&format!("You are {agent},"))
                && prompt.contains(&format!("Round: {round} (of 4)"))
        };
        assert_eq!(seen.iter().filter(of).count(), 2, "{agent} {round} {}", seen[0].prompt());
    }
    let serving = bench.serve().await;
    let run = serving.run().await;
    assert_eq!((run.run.temperature, run.run.top_p), (Some(0.7), Some(0.9)));
    let eval = &run.run.agent_meta.values()["eval"];
    assert_eq!(
        (&eval["max_tokens"], &eval["extra"]["reasoning_effort"]),
        (&64.into(), &"low".into())
    );
    // What was said, and what it cost, is with each act.
    for (_, act) in serving.acts(&run).await {
        assert!(act["response"].is_string(), "{act}");
        assert_eq!(
            (&act["usage"]["prompt_tokens"], &act["usage"]["completion_tokens"]),
            (&10.into(), &5.into())
        );
        assert!(act["usage"]["latency_ms"].is_u64(), "{act}");
        if act["valid"] == true {
            assert_eq!((&act["action"], &act["message"]), (&"SWITCH".into(), &"hello".into()));
        }
    }
    serving.stop().await;
}

#[tokio::test]
async fn a_commander_says_to_whom_it_speaks() {
    let bench = Bench::new();
    let endpoint =
        Endpoint::start(|_, _| Reply::says("ACTION: SWITCH\nMSG: on\nTO: Agent_1")).await;
    let done = bench.eval(&with(&endpoint, &["--control", "centralized", "--seeds", "5"])).await;
    done.ends(0);
    let serving = bench.serve().await;
    let run = serving.run().await;
    assert_eq!(run.run.suite.settings.control, "centralized");
    for (_, act) in serving.acts(&run).await {
        let expected = if act["agent"] == "Agent_0" { json!("Agent_1") } else { json!(null) };
        assert_eq!(act.get("to").cloned().unwrap_or_default(), expected, "{act}");
    }
    serving.stop().await;
}

#[tokio::test]
async fn what_a_model_does_wrong_is_an_invalid_answer_and_the_game_goes_on() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|number, _| match number % 5 {
        0 => {
            Reply::json(200, &completion(&json!({ "role": "assistant", "content": null }), "stop"))
        }
        1 => Reply::json(
            200,
            &completion(&json!({ "role": "assistant", "content": null, "refusal": "No." }), "stop"),
        ),
        2 => Reply::says(""),
        3 => Reply::says("ACTION: FLY"),
        _ => switch(),
    })
    .await;
    let board = bench.board(&with(&endpoint, &[])).await;
    let acts = &board["rows"][0]["acts"];
    // Of 16 answers the numbers 4, 9 and 14 are some.
    assert_eq!((&acts["sent"], &acts["invalid"]), (&16.into(), &13.into()), "{board}");
}

#[tokio::test]
async fn an_endpoint_in_trouble_costs_no_move() {
    let bench = Bench::new();
    let tried = AtomicUsize::new(0);
    let endpoint = Endpoint::start(move |_, _| match tried.fetch_add(1, Ordering::Relaxed) {
        2 => Reply::error(500, "oops"),
        5 => Reply::text(502, "<html>bad gateway</html>"),
        7 => switch().breaking(),
        _ => switch(),
    })
    .await;
    let board = bench.board(&with(&endpoint, &["--patience", "1"])).await;
    let acts = &board["rows"][0]["acts"];
    assert_eq!((&acts["sent"], &acts["invalid"]), (&16.into(), &0.into()), "{board}");
    assert_eq!(endpoint.seen().len(), 19);
}

#[tokio::test]
async fn a_wrong_key_stops_at_once_and_is_kept_nowhere() {
    let bench = Bench::new();
    let key = "sk-0123456789abcdef0123456789";
    let endpoint = Endpoint::start(move |_, seen| {
        assert_eq!(seen.headers["authorization"], format!("Bearer {key}"));
        Reply::error(401, &format!("Incorrect API key provided: {key}"))
    })
    .await;
    let call = |args: &[&str]| {
        let mut command = bench.command(args);
        command.env("MY_KEY", key);
        Running::of(command)
    };
    let args = with(&endpoint, &["--api-key-env", "MY_KEY", "--cassette", "tape.jsonl"]);
    let done = call(&args).end().await.ends(1);
    let done = done.says(&[
        "asks for a good key (401)",
        "MY_KEY",
        "0 of 2 games",
        "fix that, then run the same command again",
    ]);
    let in_text = |text: &str| text.contains(key);
    assert!(!in_text(&done.out) && !in_text(&done.err), "{}{}", done.out, done.err);
    assert!(!bench.bytes().windows(key.len()).any(|part| part == key.as_bytes()));
    // With a good one the same command resumes.
    drop(endpoint);
    let endpoint = Endpoint::start(|_, _| switch()).await;
    let args = with(&endpoint, &["--api-key-env", "MY_KEY", "--cassette", "tape.jsonl"]);
    call(&args).end().await.ends(0).says(&["resumes: 0 of 2 games"]);
    assert!(!bench.bytes().windows(key.len()).any(|part| part == key.as_bytes()));
}

#[tokio::test]
async fn an_unknown_model_or_a_silent_endpoint_stops_with_a_sentence_that_helps() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| Reply::error(404, "The model `m` does not exist")).await;
    bench.eval(&with(&endpoint, &[])).await.ends(1).says(&["The model `m` does not exist"]);
    // Nobody listens there; that may change, so it is another code.
    let away = with(&endpoint, &["--api-base", "http://127.0.0.1:1/v1", "--retries", "0"]);
    let away: Vec<&str> = away.into_iter().filter(|arg| *arg != endpoint.base()).collect();
    let away: Vec<&str> = {
        // The first --api-base has lost its value.
        let mut seen = false;
        away.into_iter()
            .filter(|arg| *arg != "--api-base" || std::mem::replace(&mut seen, true))
            .collect()
    };
    bench.eval(&away).await.ends(3).says(&["gave no answer", "run the same command again"]);
}

#[tokio::test]
async fn a_budget_stops_it_and_the_same_command_goes_on() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| switch()).await;
    // An answer costs 15 tokens; all of it 240.
    let args = with(&endpoint, &["--budget", "90", "--requests", "1"]);
    let mut calls = 0;
    loop {
        let done = bench.eval(&args).await;
        calls += 1;
        if done.code() == Some(0) {
            break;
        }
        done.ends(3).says(&["budget", "run the same command again"]);
    }
    assert_eq!(calls, 3);
    // Nothing that was paid for was asked again.
    assert_eq!(endpoint.seen().len(), 16);
}

/// The answers of the game that a stopped call has left open are on its board, and are counted once when it is played on.
#[tokio::test]
async fn the_board_of_a_stopped_run_has_what_was_answered() {
    let bench = Bench::new();
    let endpoint =
        Endpoint::start(|number, _| if number % 2 == 0 { Reply::says("Hm.") } else { switch() })
            .await;
    let args = with(&endpoint, &["--requests", "1", "--stop-share", "off", "--format", "json"]);
    // An answer costs 15 tokens.
    let stopped = bench.eval(&[&args[..], &["--budget", "90"]].concat()).await.ends(3);
    let board: Value = serde_json::from_str(&stopped.out).expect("JSON");
    let acts = &board["rows"][0]["acts"];
    assert_eq!((&acts["sent"], &acts["invalid"]), (&json!(6), &json!(3)));
    assert_eq!(acts["invalid_share"], 0.5);
    assert_eq!((&acts["prompt_tokens"], &acts["completion_tokens"]), (&json!(60), &json!(30)));
    let ended = bench.eval(&args).await.ends(0);
    let board: Value = serde_json::from_str(&ended.out).expect("JSON");
    assert_eq!(board["rows"][0]["acts"]["sent"], 16);
}

#[tokio::test]
async fn the_budget_of_several_models_is_told_once_with_all_that_was_spent() {
    let bench = Bench::new();
    let held = || Endpoint::start(|_, _| switch().held_until(1));
    let (one, other) = (held().await, held().await);
    bench.write(
        "two.toml",
        &format!(
            "tasks = 'Synchronization'\nseeds = 1\nbudget = 1\nrequests = 1\n[settings]\nnum_agents = 2\nmax_round = 2\n\
             [[models]]\nname = 'one'\napi_base = '{}'\n[[models]]\nname = 'other'\napi_base = '{}'\n",
            one.base(),
            other.base()
        ),
    );
    let running = bench.start(&["two.toml"]);
    one.has_seen(1).await;
    other.has_seen(1).await;
    // The first answer spends the budget, while the other one is in flight.
    one.release();
    other.release();
    let done = running.end().await.ends(3).says(&["the budget is spent: 30 of 1 tokens"]);
    assert_eq!(done.err.matches("the budget is spent").count(), 1, "{}", done.err);
}

#[tokio::test]
async fn several_models_are_several_rows_and_each_is_where_it_is_said_to_be() {
    let bench = Bench::new();
    let (one, other) =
        (Endpoint::start(|_, _| switch()).await, Endpoint::start(|_, _| switch()).await);
    bench.write(
        "two.toml",
        &format!(
            "tasks = 'Synchronization'\nseeds = 1\n[settings]\nnum_agents = 2\nmax_round = 2\n\
             [[models]]\nname = 'one'\napi_base = '{}'\n\
             [[models]]\nname = 'the other'\nmodel = 'other-model'\napi_base = '{}'\ntemperature = 0.5\n",
            one.base(),
            other.base()
        ),
    );
    let board = bench.board(&["two.toml"]).await;
    let rows = board["rows"].as_array().expect("rows");
    let names: Vec<_> = rows.iter().map(|row| row["model"].as_str().expect("a name")).collect();
    assert_eq!(names, ["one", "the other"]);
    assert_eq!((one.seen().len(), other.seen().len()), (4, 4));
    assert!(
        one.seen()
            .iter()
            .all(|seen| seen.body["model"] == "one" && seen.body.get("temperature").is_none())
    );
    assert!(
        other
            .seen()
            .iter()
            .all(|seen| seen.body["model"] == "other-model" && seen.body["temperature"] == 0.5)
    );
}

#[tokio::test]
async fn a_recording_plays_the_same_games_without_an_endpoint() {
    let bench = Bench::new();
    let endpoint =
        Endpoint::start(|number, _| if number % 3 == 0 { Reply::says("Hm.") } else { switch() })
            .await;
    let recorded = bench.board(&with(&endpoint, &["--cassette", "tape.jsonl"])).await;
    let asked = endpoint.seen().len();
    drop(endpoint);
    let tape = bench.path("tape.jsonl").display().to_string();
    let replay = |seeds: &'static str| {
        ["--model", "m", "--task", "Synchronization"]
            .into_iter()
            .chain(SMALL[..4].iter().copied())
            .chain(["--seeds", seeds])
    };
    let elsewhere = Bench::new();
    let args: Vec<&str> = replay("1,2").chain(["--replay", &tape]).collect();
    let replayed = elsewhere.board(&args).await;
    for what in ["tasks", "acts", "total", "seeds"] {
        assert_eq!(replayed["rows"][0][what], recorded["rows"][0][what]);
    }
    assert_eq!(recorded["rows"][0]["acts"]["sent"], asked);
    let args: Vec<&str> = replay("3").chain(["--replay", &tape]).collect();
    let done = elsewhere.eval(&args).await.ends(1);
    done.says(&["no answer for Agent_0 in round 0 of Synchronization/3/"]);
}

/// The recording of the examples: after a change of prompts it has to be recorded again, as its file says.
#[tokio::test]
async fn the_committed_recording_plays() {
    let bench = Bench::new();
    let example = |name: &str| {
        let path =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/eval").join(name);
        path.display().to_string()
    };
    let (file, tape) = (example("cassette.toml"), example("cassette.jsonl"));
    let board = bench.board(&[&file, "--replay", &tape, "--verify"]).await;
    let row = &board["rows"][0];
    assert_eq!((&row["model"], &row["verified"]), (&"fake".into(), &true.into()));
    // Two games of six rounds for three agents.
    assert_eq!(row["acts"]["sent"], 36);
    let answers = std::fs::read_to_string(&tape).expect("a file").lines().count() - 2;
    assert_eq!(answers, 36);
}

/// What is asked beside the temperature is a part of the identity where it is set, and boards show it.
#[tokio::test]
async fn options_of_reasoning_make_runs_of_their_own_and_are_on_boards() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| switch()).await;
    let usual = ["--model", "m", "--api-base", endpoint.base(), "--task", "Synchronization"];
    let usual = [&usual[..], &["--num-agents", "2", "--max-round", "2", "--seeds", "1"]].concat();
    bench.eval(&usual).await.ends(0);
    let options = [
        "--effort",
        "low",
        "--max-completion-tokens",
        "512",
        "--extra",
        r#"{"top_k": 20, "user": "me"}"#,
    ];
    let board = bench.board(&[&usual[..], &options].concat()).await;
    let sampling = "effort low, max_completion_tokens 512, top_k 20";
    assert_eq!(board["rows"][0]["sampling"], sampling, "{board}");
    let body = endpoint.seen().pop().expect("a request").body;
    assert_eq!(
        ["reasoning_effort", "max_completion_tokens", "top_k", "user"].map(|name| &body[name]),
        [&json!("low"), &json!(512), &json!(20), &json!("me")]
    );
    let asked = endpoint.seen().len();
    // The same again is not played again, with or without a stream.
    let shown = bench.eval(&[&usual[..], &options, &["--stream"]].concat()).await.ends(0);
    shown.says(&["was played before", "sampling", sampling]);
    assert_eq!(endpoint.seen().len(), asked);
    let serving = bench.serve().await;
    let runs = serving.runs().await;
    let told: Vec<_> = runs.iter().map(|run| run.run.sampling.as_deref()).collect();
    assert_eq!(told, [Some(sampling), None]);
    let suite = format!(
        "{}@{}",
        runs[0].run.suite.name,
        runs[0].run.suite.digest.as_deref().expect("a digest")
    );
    let path = [("suite", &*suite), ("reference", "false")];
    let board: Value =
        serving.client.get_with("/api/v1/leaderboard", &path).await.expect("a board");
    let items = board["items"].as_array().expect("rows");
    let told: Vec<_> = items.iter().map(|row| row["sampling"].as_str()).collect();
    assert_eq!(told.len(), 2, "{board}");
    assert!(told.contains(&None) && told.contains(&Some(sampling)), "{board}");
    serving.stop().await;
    for (more, words) in [
        (&["--thinking-budget", "9"][..], "a thinking budget is an option of api anthropic"),
        (&["--reasoning-summary", "auto"], "an option of api responses, and openai has none"),
    ] {
        bench.eval(&[&usual[..], more].concat()).await.ends(1).says(&[words]);
    }
}

/// The limit of the command line takes the place of the other name of the file's.
#[tokio::test]
async fn options_of_reasoning_are_those_of_each_model_of_a_file() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, seen| match seen.uri.path() {
        "/v1/chat/completions" => switch(),
        _ => Reply::error(401, "no"),
    })
    .await;
    bench.write(
        "models.toml",
        &format!(
            "tasks = 'Synchronization'\nseeds = 1\napi_base = '{}'\nmax_tokens = 100\neffort = 'low'\nstream = true\n\
             [settings]\nnum_agents = 2\nmax_round = 1\n\
             [[models]]\nname = 'a'\n[[models]]\nname = 'b'\nmax_completion_tokens = 200\neffort = 'high'\nstream = false\n",
            endpoint.base()
        ),
    );
    bench.board(&["models.toml"]).await;
    let of = |model: &str| {
        let seen = endpoint
            .seen()
            .into_iter()
            .rfind(|seen| seen.body["model"] == model)
            .expect("a request");
        ["max_tokens", "max_completion_tokens", "reasoning_effort", "stream"]
            .map(|name| seen.body.get(name).cloned().unwrap_or_default())
    };
    assert_eq!(of("a"), [json!(100), Value::Null, json!("low"), json!(true)]);
    assert_eq!(of("b"), [Value::Null, json!(200), json!("high"), Value::Null]);
    bench.board(&["models.toml", "--max-completion-tokens", "300", "--model", "a"]).await;
    assert_eq!(of("a"), [Value::Null, json!(300), json!("low"), json!(true)]);
    // By another interface the same run is the same run, so another model is asked.
    let done = bench.eval(&["models.toml", "--api", "responses", "--model", "c"]).await.ends(1);
    done.says(&["/v1/responses asks for a good key (401)"]);
}

#[tokio::test]
async fn a_game_is_played_again_and_the_earlier_one_is_kept_and_named() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| switch()).await;
    let args = with(&endpoint, &["--cassette", "tape.jsonl"]);
    let again = |game: &'static str| [&args[..], &["--replay-game", game]].concat();
    bench
        .eval(&again("Synchronization/1"))
        .await
        .ends(1)
        .says(&["no run of m", "leave out --replay-game"]);
    bench.eval(&args).await.ends(0);
    let asked = endpoint.seen().len();
    assert_eq!(asked, 16);
    bench.eval(&again("Synchronization/7")).await.ends(1).says(&[
        "no run of m as it is asked here has a game Synchronization/7 to play again",
        "name the tasks, seeds and settings",
    ]);
    bench
        .eval(&again("Synchronization"))
        .await
        .ends(2)
        .says(&["a task and a seed, such as Transport/27"]);
    let done = bench.eval(&[&again("Synchronization/2")[..], &["--verify"]].concat()).await.ends(0);
    let done = done.says(&[
        "plays again what is kept beside it",
        "Synchronization 2 (ep_",
        "verified: 2 games",
    ]);
    assert!(!done.err.contains("Synchronization 1"), "{}", done.err);
    // The answers of the earlier game, on the cassette, are not those of this one.
    assert_eq!(endpoint.seen().len(), asked + 8);
    let serving = bench.serve().await;
    let run = serving.run().await;
    assert_eq!(
        (run.run.status.as_str(), run.run.played, run.run.planned, run.run.voided),
        ("finished", 2, 2, 1)
    );
    let told: Vec<_> =
        run.games.iter().map(|game| (game.slot, game.void_reason.as_deref())).collect();
    let reason = Some("played again: asked for with --replay-game");
    assert_eq!(told, [(0, None), (1, reason), (1, None)]);
    assert!(run.games.iter().all(|game| game.status == "finished" && game.score.is_some()));
    serving.stop().await;
    // Without the option nothing is played again.
    bench.eval(&args).await.ends(0).says(&["was played before"]);
    assert_eq!(endpoint.seen().len(), asked + 8);
}

/// An address that is no endpoint, or one that is slower than the timeout, names the cause after three tries.
#[tokio::test]
async fn an_address_that_never_answers_says_why_at_once() {
    let bench = Bench::new();
    let page = || {
        Reply::text(200, "<html>Sign in</html>").header("content-type", "text/html; charset=utf-8")
    };
    let endpoint = Endpoint::start(move |_, _| page()).await;
    let usual = ["--model", "m", "--task", "Synchronization", "--seeds", "1", "--num-agents", "1"];
    let done = bench.eval(&[&usual[..], &["--api-base", endpoint.base()]].concat()).await.ends(3);
    done.says(&[
        "3 tries",
        "200 with text/html, is the address right?",
        "whether it is the right one",
    ]);
    let silent = Endpoint::start(|_, _| switch().held_until(1)).await;
    let args = [&usual[..], &["--api-base", silent.base(), "--timeout", "1"]].concat();
    let done = bench.eval(&args).await.ends(3);
    done.says(&[
        "3 tries",
        "no whole answer within 1 s",
        "whether --timeout allows an answer its time",
    ]);
}
