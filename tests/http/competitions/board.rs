//! The board of a competition: public, hidden or frozen.

use std::time::Duration;

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::app::list;
use crate::cup::{Attempt, Cup, pass_minutes, request, server};

#[tokio::test]
async fn nobody_else_gets_onto_the_board_of_a_competition() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (member, _) = app.key(json!({ "name": "a member" })).await;
    let suite = json!({ "name": cup.id, "tasks": ["Pursuit"], "seeds": [1] });
    let call = app.post("/api/v1/runs").token(&member);
    let refused = call.json(&json!({ "suite": suite, "model": "m" })).send().await;
    assert_eq!(
        (refused.status, &refused.json()["fields"][0]["field"]),
        (422, &json!("suite.name"))
    );
}

#[tokio::test]
async fn a_player_that_reads_no_prompts_has_none() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    for (name, model, meta, prompt) in [
        ("blue", "m", json!({}), json!("default")),
        ("red", "built-in/random", json!({}), Value::Null),
        ("green", "us", json!({ "kind": "human" }), Value::Null),
    ] {
        let entry = json!({ "name": name, "model": model, "agent_meta": meta });
        let made = app.post(&cup.path("/entrants")).json(&entry).ok().await;
        let key = made["key"].as_str().expect("a key");
        let attempt = Attempt::of(&app.post(&cup.path("/attempts")).token(key).ok().await);
        attempt.play(&app, 1).await;
        let rows = cup.rows(&app, None).await;
        let row = rows.iter().find(|row| row["entrant"]["name"] == name).expect("its row");
        let named = if prompt.is_null() { &json!("none") } else { &prompt };
        assert_eq!(&row["entrant"]["prompt"], named, "{name}");
        let path = format!("/api/v1/exports/episodes.jsonl?run={}", attempt.run);
        let table = app.get(&path).token(&app.organizer).send().await.text();
        let first: Value =
            serde_json::from_str(table.lines().next().expect("a row")).expect("JSON");
        assert_eq!(first["prompt"], prompt, "{name}");
    }
}

#[tokio::test]
async fn the_board_is_public_hidden_or_frozen_and_organizers_see_all_of_it() {
    let app = server().await;
    let public = Cup::with(&app, json!({})).await;
    let hidden = Cup::with(&app, json!({ "board": "hidden" })).await;
    let freezes = json!({ "board": "frozen", "board_freezes_at": "2026-03-01T12:30:00.000Z" });
    let frozen = Cup::open(&app, freezes).await;
    let mut entrants = Vec::new();
    for cup in [&public, &hidden, &frozen] {
        let blue = cup.enter(&app, "blue").await;
        cup.start(&app, &blue).await.play(&app, 0).await;
        entrants.push(blue);
    }
    let board = async |cup: &Cup| app.get(&cup.path("/board")).ok().await;
    for (cup, shows, rows) in
        [(&public, "totals", 1), (&hidden, "nothing", 0), (&frozen, "totals", 1)]
    {
        let shown = board(cup).await;
        assert_eq!((&shown["shows"], list(&shown["items"]).len()), (&json!(shows), rows));
        for row in list(&shown["items"]) {
            // The means of single tasks could be those of single games.
            assert_eq!((&row["rank"], &row["tasks"]), (&json!(1), &json!([])));
            assert_eq!(row["decentralization"], "declared");
        }
        let all = app.get(&cup.path("/board")).token(&app.organizer).ok().await;
        assert_eq!((&all["shows"], list(&all["items"][0]["tasks"]).len()), (&json!("all"), 2));
    }
    let before = board(&frozen).await["items"][0]["total"].clone();
    // A second attempt is better, and over when the board is frozen, to the millisecond.
    pass_minutes(&app, 20).await;
    let second = frozen.start(&app, &entrants[2]).await;
    second.play(&app, 4).await;
    let shown = board(&frozen).await;
    assert_eq!(
        (&shown["items"][0]["total"], &shown["frozen_at"]),
        (&before, &json!("2026-03-01T12:30:00.000Z"))
    );
    assert_eq!(shown["items"][0]["attempts"], 1);
    let all = app.get(&frozen.path("/board")).token(&app.organizer).ok().await;
    assert_eq!(all["items"][0]["attempts"], 2);
    assert_ne!(all["items"][0]["total"], before);
    // Its holder sees the result at once.
    let path = frozen.path(&format!("/entrants/{}", entrants[2].id));
    let own = app.get(&path).token(&entrants[2].key).ok().await;
    assert_eq!(own["attempts"][1]["total"], all["items"][0]["total"]);
    assert_eq!(own["attempts"][1]["tasks"], all["items"][0]["tasks"]);
    // At the end everything is open.
    pass_minutes(&app, 40).await;
    for cup in [&public, &hidden, &frozen] {
        cup.closed(&app).await;
        let shown = board(cup).await;
        assert_eq!((&shown["shows"], list(&shown["items"]).len()), (&json!("all"), 1));
    }
    let csv = app.get(&frozen.path("/board?format=csv")).send().await;
    assert_eq!((csv.status, csv.header("content-type")), (200, "text/csv; charset=utf-8"));
    let text = csv.text();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let head: Vec<String> = reader.headers().expect("a head").iter().map(str::to_owned).collect();
    let row = reader.records().next().expect("a row").expect("a row");
    let cell = |name: &str| {
        row[head.iter().position(|column| column == name).expect("a column")].to_owned()
    };
    let total = all["items"][0]["total"].as_f64().expect("a number");
    assert_eq!(
        (cell("rank"), cell("name"), cell("total")),
        ("1".to_owned(), "blue".to_owned(), total.to_string())
    );
    assert_eq!(cell("Pursuit_games"), "2");
    assert_eq!(cell("on_spare_seeds"), "false");
    app.get(&frozen.path("/board?format=xml")).problem(400, "malformed").await;
}

#[tokio::test]
async fn what_was_not_played_counts_as_nothing() {
    let app = server().await;
    let clocks = json!({ "round_deadline_s": 10, "idle_timeout_s": 60 });
    let mut suite = request()["suite"].clone();
    suite["settings"]["max_round"] = json!(50);
    let cup = Cup::open(&app, json!({ "clocks": clocks, "suite": suite })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    for _ in 0..3 {
        attempt.act(&app, 4).await;
    }
    // Two games were played; then nobody acts any more, and the next ones are abandoned.
    let path = cup.path(&format!("/entrants/{}", blue.id));
    let own = async || app.get(&path).token(&blue.key).ok().await["attempts"][0].clone();
    for second in 0..10_000 {
        if second < 100 {
            app.pass(Duration::from_secs(1));
        }
        if own().await["status"] != "running" {
            break;
        }
    }
    let shown = own().await;
    let tasks = list(&shown["tasks"]);
    assert_eq!(tasks.len(), 2, "{shown}");
    assert_eq!((&shown["status"], &shown["games_ended"]), (&json!("abandoned"), &json!(2)));
    for (task, games) in tasks.iter().zip([0, 2]) {
        assert_eq!((&task["games"], &task["planned"]), (&json!(games), &json!(2)), "{shown}");
    }
    assert_eq!((&tasks[0]["mean"], &tasks[0]["deviation"]), (&json!(0.0), &json!(0.0)));
    let row = &cup.rows(&app, None).await[0];
    assert_eq!((&row["total"], &row["run"]), (&shown["total"], &json!(attempt.run)));
    assert!(row["clock_share"].as_f64() > Some(0.0), "{row}");
}

#[tokio::test]
async fn metrics_are_on_the_board_once_it_is_open_and_before_that_for_organizers() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "board": "public" })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 2).await;
    let mut sums = BTreeMap::<String, (f64, u32)>::new();
    for episode in attempt.episodes(&app).await {
        let id = episode["id"].as_str().expect("an id");
        let path = format!("/api/v1/episodes/{id}/metrics");
        let metrics = app.get(&path).token(&app.organizer).ok().await;
        let value = metrics["values"]["crowding"]["value"].as_f64().expect("a number");
        let sum = sums.entry(metrics["task"].as_str().expect("a task").to_owned()).or_default();
        *sum = (sum.0 + value, sum.1 + 1);
    }
    let path = cup.path("/board?metrics=crowding,stillness");
    let check = |board: &Value| {
        assert_eq!(board["metrics"], json!(["crowding", "stillness"]));
        for (task, (sum, games)) in &sums {
            let mean = board["items"][0]["metrics"][task]["crowding"].as_f64().expect("a mean");
            assert!((mean - sum / f64::from(*games)).abs() < 1e-12, "{task} {mean}");
        }
    };
    check(&app.get(&path).token(&app.organizer).ok().await);
    for key in [None, Some(&blue.key)] {
        let call = app.get(&path);
        let sealed = match key {
            Some(key) => call.token(key).ok().await,
            None => call.ok().await,
        };
        assert_eq!((&sealed["shows"], sealed.get("metrics")), (&json!("totals"), None));
        assert_eq!(sealed["items"][0].get("metrics"), None);
    }
    pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    check(&app.get(&path).ok().await);
    let csv = app.get(&cup.path("/board?metrics=crowding&format=csv")).send().await.text();
    let head = csv.lines().next().expect("a head");
    assert!(head.ends_with("Pursuit_crowding,Synchronization_crowding"), "{head}");
    app.get(&cup.path("/board?metrics=score")).problem(400, "malformed").await;
}

/// A large board that is read again and again keeps no other request waiting, and is never older than some seconds.
#[tokio::test]
async fn a_large_board_is_kept_up_to_date_while_it_is_read() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    // As many as make a large one.
    for number in 0..120 {
        cup.enter(&app, &format!("team {number}")).await;
    }
    let status = async || {
        let rows = cup.rows(&app, None).await;
        assert_eq!(rows.len(), 121);
        let row = rows.iter().find(|row| row["entrant"]["name"] == "blue").expect("a row");
        row["entrant"]["status"].as_str().expect("a text").to_owned()
    };
    assert_eq!(status().await, "active");
    // Whoever reads now gets what there is, or what came meanwhile.
    cup.change(&app, &blue, json!({ "status": "withdrawn" })).await;
    assert!(["active", "withdrawn"].contains(&&*status().await));
    // Its task wakes within a second, and the board is there soon.
    app.pass(Duration::from_secs(1));
    let mut reads = 0;
    while status().await != "withdrawn" {
        reads += 1;
        assert!(reads < 1000, "it is never made again");
    }
    // Had the task been late, readers would wait for the board themselves.
    cup.change(&app, &blue, json!({ "status": "active" })).await;
    app.pass(Duration::from_secs(4));
    assert_eq!(status().await, "active");
    // A board that nobody reads is not made; the next reader makes it.
    app.pass(Duration::from_mins(2));
    cup.change(&app, &blue, json!({ "status": "withdrawn" })).await;
    app.pass(Duration::from_secs(4));
    assert_eq!(status().await, "withdrawn");
}
