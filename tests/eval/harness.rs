//! Harnesses: history, notes, further tries and JSON answers, which the acts have and a killed program goes on with.

use std::collections::BTreeMap;

use rustix::process::Signal;
use serde_json::{Value, json};
use swarmbench_client::eval::harness::{AnswerShape, HarnessPlan};

use super::bench::Bench;
use crate::llm::endpoint::{Endpoint, Reply, Seen};
use crate::llm::responses::{message, response};
use crate::llm::schema::check;

const FILE: &str = "tasks = 'Synchronization'\nseeds = 1\n[settings]\nnum_agents = 2\nmax_round = 5\n\
     [harness]\nhistory = 2\nscratchpad = 40\nretries_on_invalid = 1\n";

fn file(endpoint: &Endpoint) -> String {
    format!("{FILE}[[models]]\nname = 'm'\napi_base = '{}'\n", endpoint.base())
}

fn texts(seen: &Seen) -> Vec<String> {
    let messages = seen.body["messages"].as_array().expect("messages");
    messages.iter().map(|message| message["content"].as_str().expect("a text").to_owned()).collect()
}

fn agent(text: &str) -> Option<&str> {
    text.split_whitespace().find(|word| word.starts_with("Agent_")).map(|word| &word[..7])
}

/// Each first answer of a round is invalid, and the second counts in the notes of its agent.
fn answer(seen: &Seen) -> Reply {
    let texts = texts(seen);
    if !texts.last().expect("one").starts_with("Your answer is invalid: ") {
        return Reply::says("I do not know.");
    }
    let asked = &texts[texts.len() - 3];
    let agent = agent(asked).expect("an agent");
    let notes = asked.split_once("Your notes:\n").expect("notes").1.lines().next().expect("a line");
    let count = notes.rsplit(' ').next().and_then(|count| count.parse::<u32>().ok()).unwrap_or(0);
    Reply::says(&format!("ACTION: STAY\nNOTES: planted {agent} {}", count + 1))
}

/// The acts of a run by round and agent, without what took time.
async fn acts(bench: &Bench) -> BTreeMap<(u64, String), Value> {
    let serving = bench.serve().await;
    let run = serving.run().await;
    let acts = serving.acts(&run).await;
    serving.stop().await;
    let acts = acts.into_iter().map(|(round, mut act)| {
        act["usage"].as_object_mut().expect("usage").remove("latency_ms");
        ((round, act["agent"].as_str().expect("a name").to_owned()), act)
    });
    acts.collect()
}

#[tokio::test]
async fn a_model_gets_its_dialogue_its_notes_and_a_second_try_and_nobody_elses() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, seen| answer(seen)).await;
    bench.write("e.toml", &file(&endpoint));
    let done = bench.eval(&["e.toml", "--verify", "--format", "json"]).await.ends(0);
    let board: Value = serde_json::from_str(&done.out).expect("JSON");
    let row = &board["rows"][0];
    assert_eq!(row["verified"], true);
    let prompt = row["prompt"].as_str().expect("a name");
    assert!(prompt.ends_with("+harness:history=2,retries_on_invalid=1,scratchpad=40"), "{prompt}");
    let seen = endpoint.seen();
    assert_eq!(seen.len(), 2 * 2 * 5);
    for asked in &seen {
        let texts = texts(asked);
        let own = agent(&texts[0]).expect("an agent");
        let other = if own == "Agent_0" { "planted Agent_1" } else { "planted Agent_0" };
        assert!(texts.iter().all(|text| !text.contains(other)), "{own}: {texts:?}");
        assert!(asked.body.get("response_format").is_none());
    }
    let all = acts(&bench).await;
    assert_eq!(all.len(), 10);
    for ((round, name), act) in &all {
        let harness = &act["harness"];
        let history: Vec<u64> = (round.saturating_sub(2)..*round).collect();
        let shown = if history.is_empty() { Value::Null } else { json!(history) };
        assert_eq!(harness["history"], shown);
        assert_eq!(harness["scratchpad"], format!("planted {name} {}", round + 1));
        assert_eq!(harness["tries"][0]["response"], "I do not know.");
        assert_eq!(harness["tries"].as_array().map(Vec::len), Some(1));
        assert_eq!((&act["usage"]["prompt_tokens"], &act["valid"]), (&json!(20), &json!(true)));
        // What the model was sent follows from the act and those before it.
        let added = harness["added"].as_str().expect("a text");
        let is_it = |asked: &&Seen| {
            let texts = texts(asked);
            texts.len() == 2 * history.len() + 1
                && texts
                    .last()
                    .is_some_and(|text| text.ends_with(added) && agent(text) == Some(name))
        };
        assert!(seen.iter().any(|asked| is_it(&asked)), "{round} {name}");
    }
}

/// Killed in the middle of a round: the dialogue and the notes go on as if nothing had happened.
#[tokio::test]
async fn a_killed_program_goes_on_with_the_same_dialogue_and_notes() {
    let whole = Bench::new();
    let endpoint = Endpoint::start(|_, seen| answer(seen)).await;
    whole.write("e.toml", &file(&endpoint));
    whole.eval(&["e.toml", "--requests", "1"]).await.ends(0);
    let mut questions: Vec<Vec<String>> = endpoint.seen().iter().map(texts).collect();

    let bench = Bench::new();
    let first = Endpoint::start(|number, seen| {
        let reply = answer(seen);
        if number < 13 { reply } else { reply.held_until(1) }
    })
    .await;
    bench.write("e.toml", &file(&first));
    let running = bench.start(&["e.toml", "--requests", "1"]);
    first.has_seen(14).await;
    running.signal(Signal::KILL);
    running.end().await;
    let second = Endpoint::start(|_, seen| answer(seen)).await;
    bench.write("e.toml", &file(&second));
    bench.eval(&["e.toml", "--verify"]).await.ends(0).says(&["resumes"]);
    assert_eq!(acts(&bench).await, acts(&whole).await);
    let mut asked: Vec<Vec<String>> =
        first.seen().iter().chain(&second.seen()).map(texts).collect();
    for all in [&mut questions, &mut asked] {
        all.sort();
        all.dedup();
    }
    assert_eq!(asked, questions);
}

#[tokio::test]
async fn answers_in_json_follow_a_schema_and_harnesses_have_rows_of_their_own() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, seen| match seen.body.get("response_format") {
        Some(_) => Reply::says(r#"{"action": "STAY", "message": "hi", "notes": "mine"}"#),
        None => Reply::says("ACTION: STAY"),
    })
    .await;
    let base = endpoint.base();
    bench.write(
        "e.toml",
        &format!(
            "tasks = 'Synchronization'\nseeds = 1\napi_base = '{base}'\n[settings]\nnum_agents = 2\nmax_round = 2\n\
             [[models]]\nname = 'plain'\nmodel = 'm'\n\
             [[models]]\nname = 'json'\nmodel = 'm'\nharness = {{ answer = 'json', scratchpad = 9 }}\n"
        ),
    );
    let done = bench.eval(&["e.toml", "--verify", "--format", "json"]).await.ends(0);
    let board: Value = serde_json::from_str(&done.out).expect("JSON");
    let rows = board["rows"].as_array().expect("rows");
    let told = |name: &str| rows.iter().find(|row| row["model"] == name).expect("a row");
    let (plain, json) = (told("plain"), told("json"));
    assert_eq!(
        (&plain["answer_reader"], &json["answer_reader"]),
        (&json!("last-marker"), &json!("json"))
    );
    assert!(!plain["prompt"].as_str().expect("a name").contains("harness"));
    let prompt = json["prompt"].as_str().expect("a name");
    assert!(prompt.ends_with("+harness:answer=json,scratchpad=9"), "{prompt}");
    for row in rows {
        assert_eq!((&row["verified"], &row["acts"]["invalid"]), (&json!(true), &json!(0)), "{row}");
    }
    let seen = endpoint.seen();
    let with: Vec<&Seen> =
        seen.iter().filter(|s| s.body.get("response_format").is_some()).collect();
    assert_eq!((with.len(), seen.len()), (4, 8));
    let schema = &with[0].body["response_format"]["json_schema"]["schema"];
    assert_eq!(schema["required"], json!(["action", "message", "notes"]));
    let actions = json!(["UP", "DOWN", "LEFT", "RIGHT", "STAY", "SWITCH", null]);
    assert_eq!(schema["properties"]["action"]["enum"], actions);
}

#[tokio::test]
async fn harnesses_that_cannot_work_are_refused_before_a_game() {
    let bench = Bench::new();
    for (option, said) in [
        (&["--history", "21"][..], "history is 21, and may be 0 to 20"),
        (&["--scratchpad", "5000"], "scratchpad is 5000"),
        (&["--retries-on-invalid", "9"], "retries_on_invalid is 9"),
        (&["--carry-reasoning", "--history", "1"], "carry_reasoning is an option of api responses"),
    ] {
        let args = [&["--model", "m", "--api-base", "http://127.0.0.1:1"], option].concat();
        bench.eval(&args).await.ends(1).says(&[said]);
    }
}

/// By the document of the interface, and the acts say with which rounds.
#[tokio::test]
async fn encrypted_reasoning_is_carried_and_responses_are_asked_for_json() {
    let bench = Bench::new();
    let reasoning =
        json!({ "type": "reasoning", "id": "rs_1", "summary": [], "encrypted_content": "gAAAA" });
    let said = message(r#"{"action": "STAY", "message": null}"#);
    let reply = response(&json!([reasoning, said]), &json!({}));
    let endpoint = Endpoint::start(move |_, seen| {
        check("CreateResponseBody", &seen.body);
        Reply::json(200, &reply)
    })
    .await;
    let game =
        ["--task", "Synchronization", "--num-agents", "1", "--max-round", "3", "--seeds", "1"];
    let asked = ["--model", "m", "--api", "responses", "--api-base", endpoint.base()];
    let harness = ["--history", "1", "--carry-reasoning", "--answer", "json", "--verify"];
    bench.eval(&[&game[..], &asked, &harness].concat()).await.ends(0);
    let seen = endpoint.seen();
    assert_eq!(seen.len(), 3);
    for (round, asked) in seen.iter().enumerate() {
        assert_eq!(asked.body["text"]["format"]["type"], "json_schema");
        let input = asked.body["input"].as_array().expect("a list");
        let kinds: Vec<&str> = input.iter().filter_map(|item| item["type"].as_str()).collect();
        let expected = ["message", "reasoning", "message", "message"];
        assert_eq!(kinds, expected[if round == 0 { 3 } else { 0 }..]);
    }
    for ((round, _), act) in acts(&bench).await {
        let rounds = if round == 0 { Value::Null } else { json!([round - 1]) };
        assert_eq!((&act["harness"]["history"], &act["harness"]["carried"]), (&rounds, &rounds));
    }
}

/// The notes that the acts of one agent have, which gives these answers, one a round.
async fn notes(shape: &str, answers: &'static [(&'static str, Option<&'static str>)]) {
    let bench = Bench::new();
    let endpoint =
        Endpoint::start(move |number, _| Reply::says(answers[number.min(answers.len() - 1)].0))
            .await;
    let rounds = answers.len().to_string();
    let game = ["--task", "Synchronization", "--num-agents", "1", "--seeds", "1"];
    let asked = ["--model", "m", "--api-base", endpoint.base(), "--stop-share", "off"];
    let harness = ["--scratchpad", "40", "--answer", shape, "--max-round", &rounds];
    bench.eval(&[&game[..], &asked, &harness].concat()).await.ends(0);
    let mut kept = "";
    let acts = acts(&bench).await;
    assert_eq!(acts.len(), answers.len());
    for (act, (text, notes)) in acts.values().zip(answers) {
        kept = notes.unwrap_or(kept);
        assert_eq!(act["harness"]["scratchpad"].as_str().unwrap_or_default(), kept, "{text:?}");
    }
}

#[tokio::test]
async fn notes_are_found_where_models_write_them() {
    notes(
        "markers",
        &[
            ("ACTION: UP\nNOTES: the nest is north", Some("the nest is north")),
            ("NOTES: one\nNOTES: two\n- three\nACTION: UP\nfour", Some("two\n- three")),
            ("**Notes:** bold", Some("bold")),
            ("<think>NOTES: thought</think>ACTION: UP", None),
            ("- **NOTES**: list", Some("list")),
            ("My notes: none", None),
            ("NOTESÄ: x", None),
            ("", None),
            ("NOTES:", Some("")),
        ],
    )
    .await;
    notes(
        "json",
        &[
            (r#"ok {"action":"UP","notes":"n"} {}"#, Some("n")),
            (r#"{"action":"UP","notes":null}"#, None),
            ("{", None),
        ],
    )
    .await;
}

#[test]
fn the_harness_of_the_paper_is_no_part_of_an_identity() {
    let none = HarnessPlan::default();
    assert_eq!(none.meta("last-marker"), None);
    let asked = HarnessPlan { history: Some(2), ..none };
    assert_eq!(asked.meta("json"), Some(json!({ "history": 2, "answer": "json" })));
    let off = HarnessPlan { history: Some(0), answer: Some(AnswerShape::Markers), ..none };
    assert_eq!(off.over(&asked).meta("last-marker"), None);
}

/// The server stores at most 64 KiB of a harness; what no later question needs is left out.
#[tokio::test]
async fn notes_and_tries_of_any_size_do_not_stop_an_evaluation() {
    let bench = Bench::new();
    let text = format!("{}\nNOTES: {}", "x".repeat(5000), "\u{1d54f}".repeat(4000));
    let endpoint = Endpoint::start(move |_, _| Reply::says(&text)).await;
    let game = ["--task", "Synchronization", "--num-agents", "1", "--seeds", "1"];
    let asked = ["--model", "m", "--api-base", endpoint.base(), "--stop-share", "off"];
    let harness = ["--scratchpad", "4000", "--retries-on-invalid", "8", "--max-round", "3"];
    bench.eval(&[&game[..], &asked, &harness].concat()).await.ends(0);
    let acts = acts(&bench).await;
    assert_eq!(acts.len(), 3);
    for ((round, _), act) in acts {
        let harness = &act["harness"];
        assert_eq!(harness["scratchpad"].as_str().map(str::len), Some(16_000));
        assert_eq!(harness["tries"].is_null(), round > 0, "{round}");
    }
}
