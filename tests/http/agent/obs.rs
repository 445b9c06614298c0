//! `GET /obs`: what one agent sees.

use std::collections::BTreeSet;

use rstest::rstest;
use serde_json::{Value, json};

use super::{act, commanded, two_agents};
use crate::app::{TestApp, list, number, until};

#[rstest]
#[case("Transport", None)]
#[case("Pursuit", None)]
#[case("Synchronization", Some("light_on"))]
#[case("Foraging", Some("carrying_food"))]
#[case("Flocking", None)]
#[tokio::test]
async fn an_observation_has_the_fields_of_the_contract_and_its_task(
    #[case] task: &str,
    #[case] own: Option<&str>,
) {
    let app = TestApp::start().await;
    let episode = app.create(json!({ "task": task, "seed": 3 })).await;
    let seen = app.obs(episode.seat(7)).await;
    let names: BTreeSet<_> = seen.as_object().expect("an object").keys().cloned().collect();
    let common = "episode agent status round max_round task score alive acted position view \
                  messages actions history past_views deadline remaining_ms bank_ms";
    let expected = common.split(' ').filter(|name| !name.is_empty()).chain(own);
    assert_eq!(names, expected.map(str::to_owned).collect());
    assert_eq!(seen["episode"], episode.id);
    assert_eq!(seen["agent"], "Agent_7");
    assert_eq!(seen["status"], "running");
    assert_eq!((number(&seen["round"]), number(&seen["max_round"])), (0, 100));
    assert_eq!(seen["task"]["name"], task);
    assert!(seen["task"]["description"].as_str().is_some_and(|text| text.len() > 40));
    assert_eq!((&seen["alive"], &seen["acted"]), (&json!(true), &json!(false)));
    for without_clock in ["deadline", "remaining_ms", "bank_ms"] {
        assert_eq!(seen[without_clock], Value::Null);
    }
}

#[tokio::test]
async fn the_window_shows_the_cells_from_its_origin_on() {
    let app = TestApp::start().await;
    let request = json!({ "task": "Transport", "seed": 27, "view_size": 7 });
    let episode = app.create(request).await;
    let state = app.state(&episode).await;
    let grid: Vec<Vec<char>> = (list(&state["grid"]).iter())
        .map(|row| row.as_str().expect("a row").chars().collect())
        .collect();
    let mut cells_seen = 0;
    for (place, token) in episode.seats().enumerate() {
        let seen = app.obs(token).await;
        let at = &state["agents"][place];
        assert_eq!(seen["position"], json!({ "i": at["i"], "j": at["j"] }));
        let origin = &seen["view"]["origin"];
        let corner = |axis: &str| origin[axis].as_i64().expect("a number");
        for (i, row) in (corner("i")..).zip(list(&seen["view"]["cells"])) {
            for (j, cell) in (corner("j")..).zip(list(&row)) {
                let cell = cell.as_str().expect("a symbol");
                let (i, j) = (usize::try_from(i), usize::try_from(j));
                let below = i.ok().and_then(|i| grid.get(i)?.get(j.ok()?));
                let expected = match cell {
                    "*" => None,
                    "Y" => Some('A'),
                    other if other.parse::<u32>().is_ok() => Some('A'),
                    other => other.chars().next(),
                };
                assert_eq!(below.copied(), expected, "{cell} of {}", seen["agent"]);
                cells_seen += 1;
            }
        }
    }
    assert_eq!(cells_seen, 12 * 7 * 7);
}

#[tokio::test]
async fn it_remembers_what_it_did_and_saw_newest_first() {
    let app = TestApp::start().await;
    let mut request = two_agents(10);
    request["memory"] = json!(3);
    let episode = app.create(request).await;
    let mut views = Vec::new();
    for (round, action) in (0..).zip(["UP", "DOWN", "LEFT", "none", "RIGHT"]) {
        views.push(app.obs(episode.seat(0)).await["view"].clone());
        let answer = match action {
            "none" => json!({ "round": round, "response": "I do not know." }),
            known => json!({ "round": round, "action": known, "message": format!("m{round}") }),
        };
        app.act(episode.seat(0), &answer).await;
        app.act(episode.seat(1), &act(round, "STAY")).await;
    }
    let seen = app.obs_after(episode.seat(0), 4).await;
    assert_eq!(
        seen["history"],
        json!([
            { "round": 4, "action": "RIGHT", "message": "m4" },
            { "round": 3, "action": null, "message": null },
            { "round": 2, "action": "LEFT", "message": "m2" },
        ])
    );
    let past = |round: usize| json!({ "round": round, "origin": views[round]["origin"], "cells": views[round]["cells"] });
    assert_eq!(seen["past_views"], json!([past(4), past(3)]));
}

#[tokio::test]
async fn looking_changes_nothing() {
    let app = TestApp::start().await;
    let episode = app.create(two_agents(3)).await;
    let before = (app.state(&episode).await, app.obs(episode.seat(0)).await);
    for query in ["", "?after=0", "?prompt=true", "?wait=5", "?after=7&wait=0"] {
        app.get(&format!("/obs{query}")).token(episode.seat(0)).ok().await;
    }
    assert_eq!((app.state(&episode).await, app.obs(episode.seat(0)).await), before);
    let receipt = app.act(episode.seat(0), &act(0, "UP")).await;
    assert_eq!(receipt["waiting_for"], 1);
    assert_eq!(app.obs(episode.seat(0)).await["acted"], true);
    assert_eq!(app.obs(episode.seat(1)).await["acted"], false);
}

#[tokio::test]
async fn a_wait_ends_when_the_round_is_past() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(two_agents(3)).await;
    let acts = async {
        app.act(episode.seat(0), &act(0, "SWITCH")).await;
        app.act(episode.seat(1), &act(0, "STAY")).await;
    };
    // The clock stands still, so only the round can end this wait.
    let (seen, ()) = tokio::join!(app.obs_after(episode.seat(0), 0), acts);
    assert_eq!((number(&seen["round"]), &seen["acted"]), (1, &json!(false)));
    // What is past already does not wait at all.
    assert_eq!(app.obs_after(episode.seat(1), 0).await["round"], 1);
}

#[tokio::test]
async fn a_wait_ends_when_the_time_is_up() {
    let app = TestApp::with_manual_clock().await;
    let mut request = two_agents(3);
    request["round_deadline_s"] = json!(1000);
    let episode = app.create(request).await;
    let wait = app.get("/obs?after=0&wait=30").token(episode.seat(0));
    let seen = app.pass_until(tokio::spawn(wait.ok())).await;
    assert_eq!((number(&seen["round"]), &seen["status"]), (0, &json!("running")));
    let left = number(&seen["remaining_ms"]);
    assert!(left <= 970_000, "it came after {left} ms were left, before its time was up");
}

#[tokio::test]
async fn a_wait_ends_when_the_episode_ends() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(two_agents(3)).await;
    let abort = async {
        app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    };
    let (seen, ()) = tokio::join!(app.obs_after(episode.seat(0), 0), abort);
    assert_eq!((number(&seen["round"]), &seen["status"]), (0, &json!("aborted")));
    assert_eq!(seen["result"]["reason"], "aborted");
    assert_eq!(seen["result"]["score"], 0.0);
    assert_eq!(seen["result"]["journal_head"].as_str().map(str::len), Some(64));
    // After the end nothing waits any more.
    assert_eq!(app.obs_after(episode.seat(1), 9).await["status"], "aborted");
}

#[tokio::test]
async fn a_wait_ends_when_the_server_stops() {
    let mut app = TestApp::builder().limits(|limits| limits.waits_max = 1).start().await;
    let episode = app.create(two_agents(3)).await;
    let ask = |wait: &str| app.get(&format!("/obs?after=0&wait={wait}")).token(episode.seat(0));
    // The only place is taken once a second wait is refused; the first gets a head start, so
    // that it is not refused instead.
    let waiting = tokio::spawn(ask("60").ok());
    loop {
        for _ in 0..50 {
            app.get("/healthz").ok().await;
        }
        assert!(!waiting.is_finished());
        if ask("0.001").send().await.status == 503 {
            break;
        }
    }
    let problem = ask("0.001").problem(503, "overloaded").await;
    assert_eq!(problem["limit"], json!({ "name": "waits_max", "value": 1 }));
    assert_eq!(problem["retry_after_ms"], 1000);
    app.stop().await;
    assert_eq!(waiting.await.expect("no panic")["round"], 0);
}

#[tokio::test]
async fn a_client_that_hangs_up_waits_no_more() {
    let app = TestApp::builder().limits(|limits| limits.waits_max = 1).start().await;
    let episode = app.create(two_agents(3)).await;
    let ask = |wait: &str| app.get(&format!("/obs?after=0&wait={wait}")).token(episode.seat(0));
    // The only place is taken once a second wait is refused.
    let mut waiting = tokio::spawn(ask("60").send());
    while ask("0.001").send().await.status != 503 {
        if waiting.is_finished() {
            // It was refused itself.
            waiting = tokio::spawn(ask("60").send());
        }
        for _ in 0..50 {
            app.get("/healthz").ok().await;
        }
    }
    waiting.abort();
    until("its place is free", async || ask("0.001").send().await.status == 200).await;
}

/// More than servers pass on together.
#[tokio::test]
async fn a_large_observation_is_sent_completely() {
    let app = TestApp::start().await;
    // Each takes two bytes as JSON.
    let quotes = "\"".repeat(20_000);
    let mut request = two_agents(3);
    request["prompt_template"] =
        json!(format!("{{% for action in actions %}}{quotes}{{% endfor %}}"));
    let episode = app.create(request).await;
    let seen = app.get("/obs?prompt=true").token(episode.seat(0)).ok().await;
    let actions = list(&seen["actions"]).len();
    assert!(actions >= 5, "{actions}");
    assert_eq!(seen["prompt"], quotes.repeat(actions));
}

#[tokio::test]
async fn everybody_sees_the_whole_map() {
    let app = TestApp::start().await;
    let episode = commanded(&app).await;
    app.all_act(&episode, "STAY").await;
    for token in episode.seats() {
        let seen = app.obs(token).await;
        for view in [&seen["view"], &seen["past_views"][0]] {
            assert_eq!(view["origin"], json!({ "i": 0, "j": 0 }));
            let rows = list(&view["cells"]);
            assert_eq!(rows.len(), 10);
            assert!(rows.iter().all(|row| list(row).len() == 12));
        }
    }
}

#[tokio::test]
async fn a_prompt_comes_only_where_it_was_asked_for() {
    let app = TestApp::start().await;
    let episode = app.create(json!({ "task": "Pursuit", "num_agents": 2 })).await;
    let ask = |query: &str| app.get(&format!("/obs{query}")).token(episode.seat(1)).ok();
    assert_eq!(ask("").await.get("prompt"), None);
    assert_eq!(ask("?prompt=false").await.get("prompt"), None);
    let mut seen = ask("?prompt=true").await;
    let prompt = seen["prompt"].take();
    let prompt = prompt.as_str().expect("a text");
    assert!(prompt.contains("You are Agent_1"), "{prompt}");
    assert!(prompt.contains(seen["task"]["description"].as_str().expect("a text")));
    // Apart from that it is the same observation.
    seen.as_object_mut().expect("an object").remove("prompt");
    assert_eq!(seen, ask("").await);
}

#[tokio::test]
async fn an_episode_may_bring_its_own_template() {
    let app = TestApp::start().await;
    let template = "{{ agent }}, {{ round }} of {{ max_round }}: {{ messages | length }}";
    let mut request = two_agents(4);
    request["prompt_template"] = json!(template);
    let episode = app.create(request).await;
    assert_eq!(episode.config["prompt_template"], template);
    app.all_act(&episode, "STAY").await;
    let seen = app.get("/obs?prompt=true").token(episode.seat(1)).ok().await;
    assert_eq!(seen["prompt"], "Agent_1, 1 of 4: 0");
    let seen = app.get("/swarm/obs?prompt=true").token(&episode.swarm).ok().await;
    assert_eq!(seen["observations"][0]["prompt"], "Agent_0, 1 of 4: 0");
}

#[tokio::test]
async fn no_move_is_lost_by_a_template_that_fails() {
    let app = TestApp::start().await;
    let mut request = two_agents(2);
    // It fails from the second round on.
    request["prompt_template"] = json!("{% if round == 1 %}{{ nothing.at.all }}{% endif %}fine");
    let episode = app.create(request).await;
    let prompt = |route: &str, token: &str| app.get(&format!("{route}?prompt=true")).token(token);
    assert_eq!(prompt("/obs", episode.seat(0)).ok().await["prompt"], "fine");
    app.all_act(&episode, "STAY").await;
    prompt("/obs", episode.seat(0)).problem(422, "template_failed").await;
    prompt("/swarm/obs", &episode.swarm).problem(422, "template_failed").await;
    assert_eq!(app.obs(episode.seat(0)).await["round"], 1);
    app.all_act(&episode, "STAY").await;
    assert_eq!(prompt("/obs", episode.seat(0)).ok().await["prompt"], "fine");
}
