//! Replays of an episode, page by page.

use std::time::Duration;

use serde_json::{Value, json};

use super::{finish, request, with};
use crate::app::{Episode, TestApp, list, number};

const TASKS: [&str; 5] = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"];

/// Agents do and say different things, some of them nothing.
async fn play(app: &TestApp, episode: &Episode, rounds: usize) {
    let actions = ["UP", "LEFT", "DOWN", "RIGHT", "STAY"];
    for round in 0..rounds {
        let mut acts = Vec::new();
        for (number, seen) in app.swarm_obs(episode).await.iter().enumerate() {
            let action = actions[(round * round + 3 * number) % 5];
            let mut act = episode.act(&seen["agent"], round as u64, action);
            if (round + number) % 3 == 0 {
                act["message"] = json!(format!("{round}: {number} goes {action}?"));
            }
            acts.push(act);
        }
        app.swarm_act(episode, &acts).await;
    }
}

async fn replay(app: &TestApp, episode: &Episode, query: &str) -> Value {
    app.get(&episode.path(&format!("/replay{query}"))).token(&episode.swarm).ok().await
}

/// A list that is left out where it is empty.
fn or_empty(items: &Value) -> Vec<Value> {
    if items.is_null() { Vec::new() } else { list(items) }
}

fn positions(state: &Value) -> Value {
    let of = |agent: &Value| [agent["i"].clone(), agent["j"].clone()];
    Value::Array(list(&state["agents"]).iter().flat_map(of).collect())
}

/// The numbers of the agents of a state that have this flag.
fn flagged(state: &Value, flag: &str, value: bool) -> Value {
    let agents = list(&state["agents"]);
    let found = (0..agents.len()).filter(|&number| agents[number][flag] == value);
    found.map(|number| json!(number)).collect()
}

#[tokio::test]
async fn a_replay_has_the_states_that_were_published() {
    let mut app = TestApp::start().await;
    let mut episodes = Vec::new();
    for task in TASKS {
        let episode = app.create(json!({ "task": task, "seed": 27, "max_round": 9 })).await;
        play(&app, &episode, 9).await;
        episodes.push(episode);
    }
    for _ in 0..2 {
        for episode in &episodes {
            let shown = replay(&app, episode, "").await;
            assert_eq!((&shown["rounds"], &shown["length"]), (&json!(9), &json!(10)));
            assert_eq!((&shown["next"], &shown["status"]), (&Value::Null, &json!("finished")));
            let states = list(&shown["states"]);
            for (round, state) in states.iter().enumerate() {
                let path = episode.path(&format!("/state?round={round}"));
                let published = app.get(&path).ok().await;
                assert_eq!(
                    (&state["round"], &state["at"]),
                    (&json!(round), &positions(&published))
                );
                assert_eq!(state["score"], published["score"]);
                let or_none = |field: &str| json!(or_empty(&state[field]));
                assert_eq!(or_none("gone"), flagged(&published, "alive", false));
                assert_eq!(or_none("lit"), flagged(&published, "light_on", true));
                assert_eq!(or_none("loaded"), flagged(&published, "carrying_food", true));
                for place in ["prey", "block"] {
                    let at = &published[place];
                    let cell = if at.is_null() { Value::Null } else { json!([at["i"], at["j"]]) };
                    assert_eq!(state[place], cell);
                }
                assert_eq!(state["distance"], published["distance"]);
                same_map(&shown, state, &published);
            }
            same_values(&app, episode, &shown).await;
        }
        app.restart().await;
    }
}

/// The ground, the block, the prey and the agents are the grid.
fn same_map(shown: &Value, state: &Value, published: &Value) {
    let mut rows: Vec<Vec<char>> = list(&shown["ground"])
        .iter()
        .map(|row| row.as_str().expect("a row").chars().collect())
        .collect();
    let mut put = |i: i64, j: i64, symbol: char| {
        let cell = usize::try_from(i).ok().zip(usize::try_from(j).ok());
        if let Some(cell) = cell.and_then(|(i, j)| rows.get_mut(i)?.get_mut(j)) {
            *cell = symbol;
        }
    };
    let at = |value: &Value| value.as_i64().expect("a number");
    for cell in shown["block_cells"].as_array().into_iter().flatten() {
        let block = &state["block"];
        put(at(&block[0]) + at(&cell[0]), at(&block[1]) + at(&cell[1]), 'B');
    }
    if state["prey"].is_array() {
        put(at(&state["prey"][0]), at(&state["prey"][1]), 'P');
    }
    for agent in list(&state["at"]).chunks(2) {
        put(at(&agent[0]), at(&agent[1]), 'A');
    }
    let rows: Vec<String> = rows.into_iter().map(String::from_iter).collect();
    assert_eq!(json!(rows), published["grid"]);
}

/// The metrics are those of the series.
async fn same_values(app: &TestApp, episode: &Episode, shown: &Value) {
    let measured = app.get(&episode.path("/metrics?series=true")).ok().await;
    let metrics = shown["metrics"].as_object().expect("metrics");
    assert!(metrics.len() >= 12, "{metrics:?}");
    for (name, values) in metrics {
        let series = list(&measured["series"]["values"][name]);
        for (value, exact) in list(values).iter().zip(&series) {
            match (value.as_f64(), exact.as_f64()) {
                (Some(value), Some(exact)) => assert!((value - exact).abs() <= 5e-5, "{name}"),
                (value, exact) => assert_eq!(value, exact, "{name}"),
            }
        }
        assert_eq!(list(values).len(), series.len());
    }
}

#[tokio::test]
async fn pages_are_cut_from_the_whole_and_overlap_by_one_state() {
    let app = TestApp::start().await;
    let episode = app
        .create(json!({ "task": "Pursuit", "seed": 4, "num_agents": 4, "max_round": 130 }))
        .await;
    play(&app, &episode, 130).await;
    let first = replay(&app, &episode, "").await;
    assert_eq!((&first["length"], &first["next"]), (&json!(101), &json!(100)));
    let second = replay(&app, &episode, "?from=100").await;
    assert_eq!((&second["length"], &second["next"]), (&json!(31), &Value::Null));
    assert_eq!(first["states"][100], second["states"][0]);
    let states = [list(&first["states"]), list(&second["states"])[1..].to_vec()].concat();
    // In both directions, from the cache and not.
    for from in (0..=130).rev().step_by(7).chain(0..4).chain([99, 100, 101]) {
        let page = replay(&app, &episode, &format!("?from={from}&rounds=3&ground=false")).await;
        let end = 130.min(from + 3);
        assert_eq!(list(&page["states"]), states[from..=end], "{from}");
        assert_eq!(page["next"], if end < 130 { json!(end) } else { Value::Null });
        assert_eq!((page["ground"].is_null(), &page["from"]), (true, &json!(from)));
    }
}

#[tokio::test]
async fn it_says_who_said_what_and_who_reads_it() {
    let app = TestApp::with_manual_clock().await;
    // Two agents that stand side by side, and see each other.
    let request = json!({ "task": "Synchronization", "seed": 1, "num_agents": 2, "max_round": 5,
        "width": 8, "height": 8, "view_size": 15, "round_deadline_s": 10 });
    let episode = app.create(request).await;
    let act = async |agent: usize, act: Value| app.act(episode.seat(agent), &act).await;
    act(0, json!({ "round": 0, "action": "SWITCH", "message": "lights <b>on</b>" })).await;
    act(1, json!({ "round": 0, "response": "what?" })).await;
    act(0, json!({ "round": 1, "action": "STAY" })).await;
    app.pass(Duration::from_secs(10));
    app.obs_after(episode.seat(0), 1).await;
    for agent in 0..2 {
        act(agent, json!({ "round": 2, "action": "STAY", "message": "same" })).await;
    }
    // The open round is not shown.
    act(0, json!({ "round": 3, "action": "UP", "message": "secret plan" })).await;
    let shown = replay(&app, &episode, "").await;
    assert!(!shown.to_string().contains("secret plan"));
    assert_eq!((&shown["rounds"], &shown["length"]), (&json!(3), &json!(4)));
    let states = list(&shown["states"]);
    assert_eq!(states[0]["actions"], Value::Null);
    assert_eq!(states[1]["actions"], "X-");
    assert_eq!((&states[1]["lit"], &states[1]["invalid"]), (&json!([0]), &json!([1])));
    assert_eq!(states[1]["said"], json!([{ "from": 0, "text": "lights <b>on</b>" }]));
    assert_eq!(states[1]["heard"], json!([{ "from": 0, "by": [1] }]));
    assert_eq!(states[1]["marks"], json!(["invalid"]));
    assert_eq!((&states[2]["actions"], &states[2]["timeouts"]), (&json!("S-"), &json!([1])));
    assert_eq!(states[2]["marks"], json!(["timeout", "silence"]));
    assert_eq!(states[3]["marks"], json!(["convergence"]));
    // It grows with the game.
    act(1, json!({ "round": 3, "action": "STAY" })).await;
    let shown = replay(&app, &episode, "?from=3").await;
    assert_eq!(
        (&shown["length"], &shown["states"][1]["said"][0]["text"]),
        (&json!(2), &json!("secret plan"))
    );
}

#[tokio::test]
async fn late_and_changed_messages_are_told_from_others() {
    let app = TestApp::start().await;
    let request = json!({ "task": "Synchronization", "seed": 5, "num_agents": 4, "max_round": 12,
        "width": 8, "height": 8, "view_size": 15, "noise": 0.5, "max_delay": 2 });
    let episode = app.create(request).await;
    let says = |round: u64, agent: &Value| {
        format!("{round} {} and a longer text", agent.as_str().expect("a name"))
    };
    for round in 0..12 {
        let act = |seen: &Value| {
            let mut act = episode.act(&seen["agent"], round, "STAY");
            act["message"] = json!(says(round, &seen["agent"]));
            act
        };
        let acts: Vec<Value> = app.swarm_obs(&episode).await.iter().map(act).collect();
        app.swarm_act(&episode, &acts).await;
    }
    let shown = replay(&app, &episode, "").await;
    let (mut late, mut changed) = (0, 0);
    for round in 1..=12 {
        let state = &shown["states"][round];
        for agent in 0..4_u64 {
            let path = episode.path(&format!("/rounds/{round}/agents/Agent_{agent}"));
            let one = app.get(&path).ok().await;
            let inbox = list(&one["inbox"]);
            let texts: Vec<&Value> = inbox.iter().map(|message| &message["text"]).collect();
            let read = list(&one["observation"]["messages"]);
            assert_eq!(texts, read.iter().collect::<Vec<_>>());
            let heard = or_empty(&state["heard"]);
            let mine = heard.iter().filter(|heard| list(&heard["by"]).contains(&json!(agent)));
            assert_eq!(mine.count(), inbox.len());
            for message in &inbox {
                let sent = number(&message["sent"]);
                let original = says(sent, &message["from"]);
                if message["original"].is_null() {
                    assert_eq!(message["text"], original);
                } else {
                    assert_eq!(message["original"], original);
                    assert_ne!(message["text"], original);
                    changed += 1;
                }
                late += u32::from(sent + 1 < round as u64);
            }
        }
        for heard in or_empty(&state["heard"]) {
            let sent = heard["sent"].as_u64().unwrap_or(round as u64 - 1);
            assert!(sent < round as u64 && (heard["sent"].is_null() || heard["text"].is_string()));
        }
    }
    assert!(late > 5 && changed > 5, "{late} {changed}");
}

#[tokio::test]
async fn while_several_hold_seats_it_shows_no_more_than_the_states() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (other, _) = app.key(json!({ "name": "other" })).await;
    let game = json!({ "task": "Synchronization", "seed": 9, "num_agents": 2, "max_round": 2,
        "width": 8, "height": 8, "view_size": 15, "open_seats": 1, "visibility": "public" });
    let episode = app.create_with(&owner, game).await;
    let claim = app.post(&episode.path("/claims")).token(&other).json(&json!({})).ok().await;
    let theirs = claim["seats"][0]["token"].as_str().expect("a token");
    for round in 0..2 {
        let shown = app.get(&episode.path("/replay")).token(&owner).ok().await;
        let text = shown.to_string();
        assert_eq!(shown["metrics"], json!({}));
        assert_eq!(shown["length"], round + 1);
        for hidden in ["actions", "said", "heard", "marks", "psst"] {
            assert!(!text.contains(hidden), "{hidden} is in {text}");
        }
        let seen = app.get(&episode.path("/replay")).token(&app.organizer).ok().await.to_string();
        assert_eq!(seen.contains("psst"), round > 0);
        for token in [episode.seat(0), theirs] {
            app.act(token, &json!({ "round": round, "action": "STAY", "message": "psst" })).await;
        }
    }
    let shown = app.get(&episode.path("/replay")).ok().await;
    assert_eq!(shown["states"][1]["said"][0]["text"], "psst");
}

#[tokio::test]
async fn what_is_not_there_is_refused_by_name() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 5)).await;
    app.all_act(&episode, "UP").await;
    let problem = app.get(&episode.path("/replay?from=2")).problem(404, "not_found").await;
    assert_eq!(problem["round"], 1);
    for rounds in ["0", "101"] {
        let path = episode.path(&format!("/replay?rounds={rounds}"));
        let problem = app.get(&path).problem(400, "malformed").await;
        assert_eq!(problem["limit"], json!({ "name": "replay_rounds_max", "value": 100 }));
    }
    for query in ["rounds=x", "from=-1", "ground=maybe", "round=1"] {
        app.get(&episode.path(&format!("/replay?{query}"))).problem(400, "malformed").await;
    }
    app.get("/api/v1/episodes/ep_none/replay").problem(404, "not_found").await;
    // The first page of a game without rounds is its layout.
    let waiting = app.create(with(request(2, 5), "start", json!("manual"))).await;
    let shown = replay(&app, &waiting, "").await;
    assert_eq!((&shown["length"], &shown["next"]), (&json!(1), &Value::Null));
    // One that was ended shows what was resolved.
    app.act(episode.seat(0), &json!({ "round": 1, "action": "UP" })).await;
    app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    assert_eq!(replay(&app, &episode, "").await["length"], 2);
    finish(&app, &episode).await;
}
