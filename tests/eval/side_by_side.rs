//! Several models at the same time.

use rustix::process::Signal;

use super::bench::{Bench, Running};
use crate::llm::endpoint::{Endpoint, Reply};

const GAME: &str =
    "tasks = 'Synchronization'\nseeds = [1, 2]\n[settings]\nnum_agents = 2\nmax_round = 2\n";

/// Questions of a model: two seeds, two rounds, two agents.
const ALL: usize = 8;

fn file(models: &[(&str, &Endpoint)]) -> String {
    let models = models.iter().map(|(name, endpoint)| {
        format!("[[models]]\nname = '{name}'\napi_base = '{}'\n", endpoint.base())
    });
    GAME.to_owned() + &models.collect::<String>()
}

fn stays() -> Reply {
    Reply::says("ACTION: STAY")
}

/// Each waits until the other has been asked, so one after the other would wait for ever.
#[tokio::test]
async fn models_of_different_endpoints_play_side_by_side() {
    let bench = Bench::new();
    let held = || Endpoint::start(|number, _| stays().held_until(usize::from(number < 4)));
    let (one, other) = (held().await, held().await);
    bench.write("two.toml", &file(&[("one", &one), ("two", &other)]));
    let running = bench.start(&["two.toml", "--format", "json"]);
    one.has_seen(1).await;
    other.has_seen(1).await;
    one.release();
    other.release();
    let done = running.end().await.ends(0);
    let board: serde_json::Value = serde_json::from_str(&done.out).expect("JSON");
    let rows = board["rows"].as_array().expect("rows");
    let names: Vec<_> = rows.iter().map(|row| row["model"].as_str().expect("a name")).collect();
    assert_eq!(names, ["one", "two"], "the order of the plan");
    assert_eq!((one.seen().len(), other.seen().len()), (ALL, ALL));
}

#[tokio::test]
async fn models_of_one_endpoint_play_one_after_the_other_unless_it_is_said() {
    for (at_once, together) in [("1", false), ("2", true)] {
        let bench = Bench::new();
        let endpoint =
            Endpoint::start(|number, _| stays().held_until(usize::from(number < 4))).await;
        bench.write("two.toml", &file(&[("one", &endpoint), ("two", &endpoint)]));
        let running = bench.start(&["two.toml", "--models-at-once", at_once]);
        endpoint.has_seen(if together { 8 } else { 4 }).await;
        endpoint.release();
        running.end().await.ends(0);
        let seen = endpoint.seen();
        let first_of_two = seen.iter().position(|seen| seen.body["model"] == "two");
        assert_eq!(first_of_two.expect("it played") < ALL, together);
    }
}

#[tokio::test]
async fn a_model_that_fails_loses_nobody_elses_games() {
    let bench = Bench::new();
    let (good, bad) = (
        Endpoint::start(|_, _| stays().held_until(1)).await,
        Endpoint::start(|_, _| Reply::error(404, "The model `bad` does not exist")).await,
    );
    bench.write("three.toml", &file(&[("bad", &bad), ("good", &good), ("worse", &bad)]));
    let running = bench.start(&["three.toml"]);
    // Both models of the bad endpoint are asked: it may have the other.
    bad.has_seen(2).await;
    good.release();
    let done = running.end().await.ends(1);
    let done =
        done.says(&["error: bad: ", "error: worse: ", "2 of 6 games were played", "fix that"]);
    assert!(done.out.contains("good"), "{}", done.out);
    assert_eq!(good.seen().len(), ALL);
}

#[tokio::test]
async fn an_endpoint_that_refuses_the_key_is_not_asked_for_its_next_model() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, _| Reply::error(401, "who are you?")).await;
    bench.write("two.toml", &file(&[("one", &endpoint), ("two", &endpoint)]));
    bench.eval(&["two.toml"]).await.ends(1).says(&["error: one: "]);
    assert!(endpoint.seen().iter().all(|seen| seen.body["model"] == "one"));
}

#[tokio::test]
async fn headers_and_the_interface_come_from_the_command_line() {
    const SECRET: &str = "azure-0123456789abcdef";
    let bench = Bench::new();
    let content = serde_json::json!([{ "type": "text", "text": "ACTION: STAY" }]);
    let message =
        serde_json::json!({ "type": "message", "content": content, "stop_reason": "end_turn" });
    let endpoint = Endpoint::start(move |_, _| Reply::json(200, &message)).await;
    bench.write("games.toml", GAME);
    let usual = ["games.toml", "--model", "m", "--api-base", endpoint.base(), "--api", "anthropic"];
    let with = |more: &[&str]| {
        let mut command = bench.command(&[&usual[..], more].concat());
        command.env("AZURE", SECRET);
        Running::of(command).end()
    };
    let tape = ["--max-tokens", "64", "--header", "api-key: $AZURE", "--cassette", "tape.jsonl"];
    with(&tape).await.ends(0);
    assert_eq!(endpoint.seen().len(), ALL);
    for seen in endpoint.seen() {
        assert_eq!((seen.uri.path(), &seen.body["max_tokens"]), ("/v1/messages", &64.into()));
        assert_eq!(seen.headers["api-key"], SECRET);
        assert!(!seen.headers.contains_key("x-api-key"));
    }
    assert!(!bench.bytes().windows(SECRET.len()).any(|part| part == SECRET.as_bytes()));
    for (more, words) in [
        (&["--header", "api-key"][..], "a header looks like"),
        (&["--header", "api-key: $NONE"], "`export NONE=…`"),
        (&["--header", "a: 1", "--header", "A: 2"], "it is given twice"),
        (&[], "--max-tokens 4096"),
    ] {
        let done = with(&[&["--seeds", "3"], more].concat()).await.says(&[words]);
        assert!([Some(1), Some(2)].contains(&done.code()), "{}", done.err);
    }
    assert_eq!(endpoint.seen().len(), ALL);
}

#[tokio::test]
async fn an_interruption_ends_all_of_them_and_the_same_command_resumes() {
    let bench = Bench::new();
    let held = || Endpoint::start(|_, _| stays().held_until(1));
    let (one, other) = (held().await, held().await);
    bench.write("two.toml", &file(&[("one", &one), ("two", &other)]));
    let running = bench.start(&["two.toml"]);
    one.has_seen(4).await;
    other.has_seen(4).await;
    running.signal(Signal::INT);
    // Nothing begins any more; what is in flight is finished.
    let running = running.until_it_says("no more questions are asked").await;
    one.release();
    other.release();
    running.end().await.ends(130).says(&["run the same command again to resume"]);
    bench.eval(&["two.toml", "--verify"]).await.ends(0).says(&["verified: 4 games"]);
    assert_eq!((one.seen().len(), other.seen().len()), (ALL, ALL), "nothing was asked twice");
}

/// A model with a limit of its own has it beside those of the others.
#[tokio::test]
async fn each_endpoint_and_each_model_has_its_own_limit() {
    let bench = Bench::new();
    let held = || Endpoint::start(|number, _| stays().held_until(usize::from(number < 3)));
    let (one, other) = (held().await, held().await);
    let text = file(&[("one", &one), ("two", &other)]) + "requests = 3\n";
    bench.write("two.toml", &format!("requests = 1\n{text}"));
    let running = bench.start(&["two.toml"]);
    one.has_seen(1).await;
    other.has_seen(3).await;
    assert_eq!((one.most_at_once(), other.most_at_once()), (1, 3));
    one.release();
    other.release();
    running.end().await.ends(0);
    assert!(one.most_at_once() <= 1 && other.most_at_once() <= 3);
    bench.write(
        "wrong.toml",
        &file(&[("one", &one)]).replace("[settings]", "requests = 0\n[settings]"),
    );
    bench.eval(&["wrong.toml"]).await.ends(1).says(&["requests is 0, and may be 1 to 4096"]);
}
