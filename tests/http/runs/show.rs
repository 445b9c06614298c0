//! The page of a run: results, and what each caller may see.

use serde_json::{Value, json};

use super::{TestRun, create, play, show, small, stored, text, with};
use crate::app::{TestApp, list, number};

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

/// The answer to each caller for a run that they may or may not read.
#[tokio::test]
async fn a_run_is_seen_like_its_episodes() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let create = async |visibility: &str| {
        let request = with(small(), &json!({ "visibility": visibility }));
        TestRun::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await)
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
async fn the_player_of_a_sealed_run_sees_only_its_progress() {
    let mut app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let mut request = with(small(), &json!({ "parallel": 2 }));
    request["suite"]["seeds"] = json!([707_070_707, 808_080_808]);
    let run = TestRun::of(&app.post("/api/v1/runs").token(&owner).json(&request).ok().await);
    // Only competitions seal runs.
    app.stop().await;
    let seal = "
        UPDATE runs SET visibility = 'sealed',
            definition = replace(replace(definition, '\"visibility\":\"public\"', '\"visibility\":\"sealed\"'),
                                 '\"visibility\":\"owner\"', '\"visibility\":\"sealed\"');
        UPDATE episodes SET visibility = 'sealed',
            opening = replace(replace(opening, '\"visibility\":\"public\"', '\"visibility\":\"sealed\"'),
                              '\"visibility\":\"owner\"', '\"visibility\":\"sealed\"'), template = NULL";
    app.tamper(seal).await;
    app.start_again().await;

    let check = async |app: &TestApp, run: &TestRun, played: u64| {
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
    let run = TestRun { token: text(&fresh, "swarm_token").to_owned(), ..run };
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
    let run = TestRun::of(&app.post("/api/v1/runs").token(&owner).json(&small()).ok().await);
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
