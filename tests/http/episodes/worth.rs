//! What could still be scored in an episode, against forks that the reference plays.

use serde_json::{Value, json};

use super::{finish, request, with};
use crate::app::program::{printed, swarmbench};
use crate::app::{Episode, TestApp, list, until};
use crate::cup::{Cup, pass_minutes, server};

/// The score of a fork that the server plays with the default player.
async fn forked(app: &TestApp, episode: &Episode, round: usize) -> f64 {
    let body = json!({ "round": round, "player": "default" });
    let made = app.post(&episode.path("/fork")).json(&body).ok().await;
    let fork = Episode::of(&made["episodes"][0]);
    until("the fork is played", async || app.show(&fork).await["status"] == "finished").await;
    app.show(&fork).await["result"]["score"].as_f64().expect("a score")
}

fn numbers(values: &Value) -> Vec<f64> {
    list(values).iter().map(|value| value.as_f64().expect("a number")).collect()
}

#[tokio::test]
async fn a_worth_is_the_score_of_a_fork_that_the_reference_plays() {
    let app = TestApp::start().await;
    for (task, rules) in [("Pursuit", "paper"), ("Foraging", "reference"), ("Flocking", "paper")] {
        let settings =
            json!({ "task": task, "rules": rules, "seed": 5, "num_agents": 6, "max_round": 8 });
        let episode = app.create(settings).await;
        for action in ["LEFT", "UP", "STAY", "UP", "RIGHT", "DOWN", "STAY", "LEFT"] {
            app.all_act(&episode, action).await;
        }
        let worth = app.get(&episode.path("/worth")).ok().await;
        let values = numbers(&worth["values"]);
        assert_eq!(values.len(), 9);
        for (round, value) in values.iter().enumerate().take(8) {
            assert_eq!(
                forked(&app, &episode, round).await.to_bits(),
                value.to_bits(),
                "{task} {round}"
            );
        }
        assert_eq!(worth["values"][8], worth["score"]);
        let losses = list(&worth["losses"]);
        let sum: f64 = losses.iter().map(|loss| loss["loss"].as_f64().expect("a number")).sum();
        assert!((sum - (values[0] - values[8])).abs() < 1e-9);
        assert_eq!(losses[0]["seats"].as_object().expect("seats").len(), 6);
        assert_eq!((&worth["missing"], &worth["worth_revision"]), (&json!([]), &json!(1)));
        // What is stored is what was computed, and the curve alone is a part of it.
        assert_eq!(app.get(&episode.path("/worth")).ok().await, worth);
        let curve = app.get(&episode.path("/worth?seats=false")).ok().await;
        assert_eq!((&curve["values"], &curve["seats"]), (&worth["values"], &Value::Null));
    }
}

#[tokio::test]
async fn a_running_game_has_the_worth_of_its_rounds_so_far() {
    let app = TestApp::start().await;
    let episode = app.create(request(3, 10)).await;
    for _ in 0..4 {
        app.all_act(&episode, "STAY").await;
    }
    let worth = app.get(&episode.path("/worth")).ok().await;
    let values = numbers(&worth["values"]);
    assert!(values[0] > 9.5 && values[4] < 8.0, "{values:?}");
    assert_eq!(worth["accuracy"], values[4] / values[0]);
    assert_eq!(worth["settled_round"], Value::Null);
    app.all_act(&episode, "SWITCH").await;
    let worth = app.get(&episode.path("/worth?seats=false")).ok().await;
    assert_eq!(numbers(&worth["values"])[..5], values);
    assert_eq!(list(&worth["values"]).len(), 6);
}

#[tokio::test]
async fn the_line_is_what_the_reference_does_next() {
    let app = TestApp::start().await;
    let episode = app.create(request(3, 6)).await;
    app.all_act(&episode, "STAY").await;
    let line = app.get(&episode.path("/line?round=1&rounds=3")).ok().await;
    let rounds = list(&line["rounds"]);
    assert_eq!(rounds.iter().map(|round| &round["round"]).collect::<Vec<_>>(), [1, 2, 3]);
    assert_eq!(list(&rounds[0]["agents"]).len(), 3);
    let all = app.get(&episode.path("/line?round=0&rounds=100")).ok().await;
    assert_eq!(list(&all["rounds"]).len(), 6);
    assert_eq!(all["rounds"][5]["score"], 6.0);
    app.get(&episode.path("/line?round=2")).problem(404, "not_found").await;
    for wrong in
        ["/line?round=-1", "/line?round=0&rounds=0", "/line?round=0&rounds=101", "/worth?seats=2"]
    {
        app.get(&episode.path(wrong)).problem(400, "malformed").await;
    }
}

#[tokio::test]
async fn a_large_game_says_which_part_is_missing() {
    let app = TestApp::start().await;
    let create = |agents: u32, rounds: u32| json!({ "task": "Foraging", "seed": 1, "num_agents": agents, "max_round": rounds, "width": 64, "height": 64 });
    let episode = app.create(create(40, 100)).await;
    let worth = app.get(&episode.path("/worth")).ok().await;
    assert_eq!((list(&worth["values"]).len(), &worth["missing"]), (1, &json!([])));
    let episode = app.create(create(1024, 1500)).await;
    let worth = app.get(&episode.path("/worth")).ok().await;
    assert_eq!(worth["values"], Value::Null);
    assert_eq!(worth["missing"][0]["part"], "values");
    let detail = worth["missing"][0]["detail"].as_str().expect("a text");
    assert!(detail.contains("more than worth_seconds_max, 90"), "{detail}");
    app.get(&episode.path("/line?round=0")).problem(422, "invalid").await;
}

#[tokio::test]
async fn who_may_fork_may_read_the_worth() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let episode = app.create_with(&owner, with(request(2, 3), "visibility", json!("public"))).await;
    app.all_act(&episode, "SWITCH").await;
    for path in ["/worth", "/line?round=0"] {
        let read = |token: &str| app.get(&episode.path(path)).token(token);
        read(&member).problem(403, "forbidden").await;
        read(episode.seat(0)).problem(403, "forbidden").await;
        app.get(&episode.path(path)).problem(403, "forbidden").await;
        read(&owner).ok().await;
    }
    finish(&app, &episode).await;
    app.get(&episode.path("/worth")).ok().await;
    // With several holders nobody reads it before the end, the creator included.
    let mixed = app.create_with(&owner, with(request(2, 3), "open_seats", json!(1))).await;
    for key in [&owner, &app.organizer] {
        app.get(&mixed.path("/worth")).token(key).problem(403, "forbidden").await;
    }
}

#[tokio::test]
async fn the_worth_of_a_sealed_game_is_read_after_the_reveal() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "attempts": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 2).await;
    let all =
        list(&app.get("/api/v1/episodes?limit=1000").token(&app.organizer).ok().await["items"]);
    let path = format!("/api/v1/episodes/{}/worth", all[0]["id"].as_str().expect("an id"));
    for token in [&app.organizer, &blue.key] {
        app.get(&path).token(token).problem(403, "forbidden").await;
    }
    pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    app.get(&path).token(&blue.key).ok().await;
}

#[tokio::test]
async fn boards_show_the_accuracy_of_stored_worths_and_compute_none() {
    let app = TestApp::start().await;
    let suite = json!({ "name": "s", "tasks": ["Synchronization"], "seeds": [1, 2], "settings": { "num_agents": 2, "max_round": 4 } });
    let body = json!({ "suite": suite, "model": "m", "player": "default" });
    let run = app.post("/api/v1/runs").json(&body).ok().await;
    let path = format!("/api/v1/runs/{}", run["id"].as_str().expect("an id"));
    until("the run is played", async || app.get(&path).ok().await["status"] == "finished").await;
    let board = "/api/v1/leaderboard?suite=s&metrics=accuracy,stillness";
    let metrics =
        async || app.get(board).ok().await["items"][0]["metrics"]["Synchronization"].take();
    assert_eq!(metrics().await["accuracy"], Value::Null);
    let games = app.get(&path).ok().await["games"].take();
    let [other, game] = [0, 1].map(|game| games[game]["episode"].as_str().expect("an id"));
    let store = async |game: &str| {
        app.get(&format!("/api/v1/episodes/{game}/worth?seats=false")).ok().await;
    };
    store(other).await;
    // A mean over some of the games would be one over those that somebody chose.
    assert_eq!(metrics().await["accuracy"], Value::Null);
    store(game).await;
    until("the board has it", async || metrics().await["accuracy"] == 1.0).await;
    // The same of the game's journal, by the command, and in the table of games.
    let shown = printed(&swarmbench(&["worth", game, "--json", "--server", app.base()]).await);
    let shown: Value = serde_json::from_str(&shown).expect("JSON");
    assert_eq!((&shown["accuracy"], &shown["values"][0]), (&json!(1.0), &json!(4.0)));
}

#[tokio::test]
async fn nothing_more_can_be_scored_in_a_game_that_was_aborted() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 3)).await;
    let of = async || app.get(&episode.path("/worth")).ok().await;
    let (first, last) = (1.0, 0.0);
    assert_eq!(of().await["accuracy"], first);
    app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    let worth = of().await;
    assert_eq!((&worth["accuracy"], &worth["score"]), (&json!(last), &json!(0.0)));
}

#[tokio::test]
async fn a_worth_of_the_table_is_the_stored_one() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 3)).await;
    finish(&app, &episode).await;
    let row = async |table: &str| {
        let path = format!("/api/v1/exports/{table}.jsonl");
        let text = app.get(&path).send().await.text();
        let last = text.lines().last().expect("a row").to_owned();
        serde_json::from_str::<Value>(&last).expect("JSON")
    };
    assert_eq!(row("episodes").await["accuracy"], Value::Null);
    let worth = app.get(&episode.path("/worth")).ok().await;
    let games = row("episodes").await;
    assert_eq!(
        (&games["accuracy"], &games["worth_start"]),
        (&worth["accuracy"], &worth["values"][0])
    );
    assert_eq!(row("rounds").await["worth"], worth["values"][3]);
    assert!(row("acts").await["loss"].is_number());
}
