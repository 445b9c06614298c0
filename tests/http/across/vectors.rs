//! Every recorded game, played over HTTP: what players and spectators see is what was recorded.

use std::collections::{BTreeMap, BTreeSet};

use rstest::rstest;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::app::{Episode, TestApp, list};

#[derive(Deserialize)]
struct RecordedGame {
    config: Value,
    initial: State,
    rounds: Vec<Round>,
    done: bool,
}

#[derive(Deserialize)]
struct Round {
    inbox: BTreeMap<String, Vec<String>>,
    views: BTreeMap<String, Vec<Vec<String>>>,
    actions: Acts,
    after: State,
}

#[derive(Deserialize)]
struct State {
    agents: Vec<(i64, i64)>,
    grid: Option<Vec<String>>,
    score: f64,
    prey: Option<(i64, i64)>,
    block: Option<(i64, i64)>,
    distance: Option<f64>,
    light_on: Option<Vec<bool>>,
    carrying: Option<Vec<bool>>,
}

const PAPER: &str = include_str!("../../../crates/engine/tests/vectors/paper.jsonl");
const REFERENCE: &str = include_str!("../../../crates/engine/tests/vectors/reference.jsonl");

#[rstest]
#[case::paper(PAPER)]
#[case::reference(REFERENCE)]
#[tokio::test]
async fn recorded_games_are_the_same_over_http(#[case] text: &str) {
    let app = TestApp::start().await;
    for line in text.lines() {
        play(&app, &serde_json::from_str(line).expect("a recorded game")).await;
    }
    assert_eq!(text.lines().count(), 11);
}

/// Acts of all living agents in a round: an action and a message each.
pub(crate) type Acts = BTreeMap<String, (String, String)>;

/// A recorded game in which agents escape: its configuration, and what is done in every round.
pub(crate) fn recorded_transport() -> (Value, Vec<Acts>) {
    let game: RecordedGame =
        serde_json::from_str(PAPER.lines().next().expect("a line")).expect("a game");
    assert_eq!(game.config["task"], "Transport");
    (game.config, game.rounds.into_iter().map(|round| round.actions).collect())
}

/// The acts of a round as they are sent.
pub(crate) fn acts(episode: &Episode, round: u64, acts: &Acts) -> Vec<Value> {
    let act = |(agent, (action, message)): (&String, &(String, String))| {
        let mut act = episode.act(&json!(agent), round, action);
        act["message"] = json!(message);
        act
    };
    acts.iter().map(act).collect()
}

async fn play(app: &TestApp, game: &RecordedGame) {
    let episode = app.create(game.config.clone()).await;
    let title = format!("{} {}", game.config["rules"], game.config["task"]);
    compare_state(&app.state(&episode).await, &game.initial, &title);
    for (number, round) in (0..).zip(&game.rounds) {
        let title = format!("{title}, round {number}");
        compare_observations(&app.swarm_obs(&episode).await, number, round, &title);
        let acts = acts(&episode, number, &round.actions);
        for receipt in app.swarm_act(&episode, &acts).await {
            assert_eq!(receipt["valid"], true, "{title}: {receipt}");
            assert_eq!(receipt["duplicate"], false, "{title}: {receipt}");
        }
        compare_state(&app.state(&episode).await, &round.after, &title);
    }
    let status = app.show(&episode).await["status"].clone();
    assert_eq!(status == "finished", game.done, "{title}: the end");
    assert_eq!(app.swarm_obs(&episode).await.is_empty(), game.done, "{title}: the end");
}

fn compare_observations(seen: &[Value], number: u64, round: &Round, title: &str) {
    let living: BTreeSet<&str> = seen.iter().filter_map(|seen| seen["agent"].as_str()).collect();
    assert_eq!(living, round.actions.keys().map(String::as_str).collect(), "{title}: the living");
    for seen in seen {
        let agent = seen["agent"].as_str().expect("a name");
        assert_eq!(seen["round"], number, "{title}");
        let inbox = round.inbox.get(agent).cloned().unwrap_or_default();
        assert_eq!(seen["messages"], json!(inbox), "{title}: messages of {agent}");
        if let Some(view) = round.views.get(agent) {
            assert_eq!(seen["view"]["cells"], json!(view), "{title}: window of {agent}");
        }
    }
}

fn compare_state(state: &Value, expected: &State, title: &str) {
    let at = |place: &Value| Some((place["i"].as_i64()?, place["j"].as_i64()?));
    let agents = list(&state["agents"]);
    let places: Vec<_> = agents.iter().filter_map(at).collect();
    assert_eq!(places, expected.agents, "{title}: places");
    let score = state["score"].as_f64().expect("a score");
    assert_eq!(score.to_bits(), expected.score.to_bits(), "{title}: score");
    assert_eq!(at(&state["prey"]), expected.prey, "{title}: prey");
    assert_eq!(state["distance"].as_f64(), expected.distance, "{title}: distance");
    let flags = |name: &str| agents.iter().map(|agent| agent[name].as_bool()).collect();
    let (lights, loads): (Option<Vec<_>>, Option<Vec<_>>) =
        (flags("light_on"), flags("carrying_food"));
    assert_eq!(lights, expected.light_on, "{title}: lights");
    assert_eq!(loads, expected.carrying, "{title}: loads");
    // Where the block has left the map, the recorder kept no place of it.
    if list(&state["grid"]).iter().any(|row| row.as_str().is_some_and(|row| row.contains('B'))) {
        assert_eq!(at(&state["block"]), expected.block, "{title}: block");
    }
    if let Some(grid) = &expected.grid {
        // The recorder wrote agents that bear no mark in lower case.
        let grid: Vec<_> = grid.iter().map(|row| row.replace('a', "A")).collect();
        assert_eq!(state["grid"], json!(grid), "{title}: grid");
    }
}
