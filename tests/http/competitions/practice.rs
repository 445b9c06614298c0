//! Practice: games on open seeds with an entrant's key, which count nowhere in the competition.

use serde_json::{Value, json};

use crate::app::{fields, list, texts};
use crate::cup::{Attempt, Cup, pass_minutes, server};

fn text(value: &Value) -> &str {
    value.as_str().expect("a text")
}

#[tokio::test]
async fn an_entrant_practises_before_and_beside_attempts() {
    let app = server().await;
    // It has not opened.
    let cup = Cup::with(&app, json!({ "terms": null })).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let practise = |body: Value| app.post(&cup.path("/practice")).token(&blue.key).json(&body);
    let first = app.post(&cup.path("/practice")).token(&blue.key).ok().await;
    assert_eq!((&first["games"], list(&first["seeds"]).len()), (&json!(2), 1));
    assert_eq!(first["closes_at"], cup.created["closes_at"]);
    let second = practise(json!({ "seeds": [7, 8], "tasks": ["pursuit"] })).ok().await;
    assert_eq!((&second["games"], &second["seeds"]), (&json!(2), &json!([7, 8])));
    // One at a time: the first one was ended.
    let run = |id: &str| app.get(&format!("/api/v1/runs/{id}"));
    let ended = run(text(&first["run"])).token(&blue.key).ok().await;
    assert_eq!(ended["status"], "aborted");

    // It is read by its entrant as it is played, and by nobody else.
    let own = run(text(&second["run"])).token(&blue.key).ok().await;
    let games = list(&own["games"]);
    assert_eq!(
        (texts(&games, "task"), &games[0]["seed"]),
        (vec!["Pursuit".to_owned(); 2], &json!(7))
    );
    let game = format!("/api/v1/episodes/{}", text(&games[0]["episode"]));
    let shown = app.get(&game).token(&blue.key).ok().await;
    assert_eq!(
        (&shown["config"]["max_round"], &shown["config"]["num_agents"]),
        (&json!(3), &json!(3))
    );
    assert_eq!(shown["model"], "model of blue");
    app.get(&format!("{game}/state")).token(&blue.key).ok().await;
    app.get(&format!("{game}/state")).token(&red.key).problem(404, "not_found").await;
    let played = Attempt {
        run: text(&second["run"]).to_owned(),
        swarm: text(&second["swarm_token"]).to_owned(),
        number: 0,
    };
    played.play(&app, 1).await;
    app.get(&format!("{game}/journal")).token(&blue.key).send().await;

    // An attempt is played beside it, and only that counts.
    pass_minutes(&app, 10).await;
    practise(json!({})).ok().await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 1).await;
    let attempts = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(texts(&list(&attempts["items"]), "run"), [attempt.run.as_str()]);
    let rows = cup.rows(&app, None).await;
    let attempts: Vec<_> = rows.iter().map(|row| row["attempts"].clone()).collect();
    assert_eq!(attempts, [1, 0]);

    for (body, field) in [
        (json!({ "seeds": [] }), "seeds"),
        (json!({ "seeds": [1, 1] }), "seeds"),
        (json!({ "seeds": [-1] }), "seeds"),
        (json!({ "seeds": (0..11).collect::<Vec<_>>() }), "seeds"),
        (json!({ "tasks": ["Flocking"] }), "tasks"),
        (json!({ "tasks": [] }), "tasks"),
    ] {
        assert_eq!(fields(&practise(body).problem(422, "invalid").await), [field]);
    }
    app.post(&cup.path("/practice")).problem(401, "unauthorized").await;
    app.post(&cup.path("/practice")).token(&app.organizer).problem(403, "forbidden").await;
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two teams" })).await;
    practise(json!({})).problem(403, "forbidden").await;
    pass_minutes(&app, 60).await;
    let late = app.post(&cup.path("/practice")).token(&red.key);
    late.problem(409, "closed").await;
}

#[tokio::test]
async fn practice_has_a_largest_number_of_runs_in_a_day() {
    let app = server().await;
    let cup = Cup::with(&app, json!({ "closes_at": "2026-03-09T12:00:00Z" })).await;
    let blue = cup.enter(&app, "blue").await;
    let practise = || {
        let call = app.post(&cup.path("/practice")).token(&blue.key);
        call.json(&json!({ "tasks": ["Pursuit"] }))
    };
    for _ in 0..100 {
        practise().ok().await;
    }
    let problem = practise().problem(403, "forbidden").await;
    assert_eq!(problem["limit"]["name"], "practice_runs_per_day_max", "{problem}");
    pass_minutes(&app, 24 * 60 + 1).await;
    practise().ok().await;
}
