//! The names of entrants and of members: nobody is called like somebody else, and what was used once stays taken.

use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{Call, TestApp, fields, list, texts};
use crate::cup::{Cup, Entrant, server};

fn path(cup: &Cup, entrant: &Entrant) -> String {
    cup.path(&format!("/entrants/{}", entrant.id))
}

fn enter(app: &TestApp, cup: &Cup, name: &str) -> Call {
    app.post(&cup.path("/entrants")).json(&json!({ "name": name, "model": "m" }))
}

fn rename(app: &TestApp, cup: &Cup, entrant: &Entrant, name: &str) -> Call {
    let call = app.call(Method::PATCH, &path(cup, entrant)).token(&entrant.key);
    call.json(&json!({ "name": name }))
}

async fn actions(app: &TestApp, cup: &Cup) -> Vec<Value> {
    list(&app.get(&cup.path("/actions")).ok().await["items"])
}

#[tokio::test]
async fn names_that_differ_in_white_space_dashes_or_case_are_one() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let made = enter(&app, &cup, "  Team \u{a0}Rocket ").ok().await;
    assert_eq!(made["name"], "Team Rocket");
    enter(&app, &cup, "x-ray").ok().await;
    enter(&app, &cup, "Straße").ok().await;
    let taken = [
        "Team Rocket",
        "team\u{3000}ROCKET",
        "X\u{2014}Ray",
        "x\u{2212}ray",
        "x\u{2010}ray",
        "STRASSE",
    ];
    let blue = cup.enter(&app, "blue").await;
    for name in taken {
        let problem = enter(&app, &cup, name).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["name"], "{name:?}");
        rename(&app, &cup, &blue, name).problem(422, "invalid").await;
    }
    // Models are compared in the same way.
    let entry = |name: &str, model: &str| {
        app.post(&cup.path("/entrants")).json(&json!({ "name": name, "model": model }))
    };
    entry("red", "gpt 5").ok().await;
    let problem = entry("green", "gpt  5").problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["model"]);
}

#[tokio::test]
async fn nobody_is_called_like_an_organizer_the_server_or_a_built_in_player() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let members = format!("{}/members", path(&cup, &blue));
    for name in [
        "organizer",
        "Organisers",
        "SERVER",
        "swarm bench",
        "judge",
        "erased ent_01",
        "ent_0198f2c55cf77c3e8f1be8a0c1a2b3c4",
        "built\u{2014}in/random",
        "random",
        "Corner Traps",
        "default",
    ] {
        let add = app.post(&members).token(&blue.key).json(&json!({ "name": name }));
        for call in [enter(&app, &cup, name), rename(&app, &cup, &blue, name), add] {
            let problem = call.problem(422, "invalid").await;
            assert_eq!(fields(&problem), ["name"], "{name:?}");
            assert!(problem.to_string().contains("reserved"), "{problem}");
        }
    }
    let add = |name: &str| app.post(&members).token(&blue.key).json(&json!({ "name": name }));
    let ada = add(" Ada  L ").ok().await;
    assert_eq!(ada["name"], "Ada L");
    assert_eq!(fields(&add("ADA L").problem(422, "invalid").await), ["name"]);
    // Who has lost its key is removed, and added again.
    let own = format!("{members}/{}", ada["id"].as_str().expect("an id"));
    app.call(Method::DELETE, &own).token(&blue.key).ok().await;
    add("Ada L").ok().await;
}

#[tokio::test]
async fn a_name_that_was_used_once_stays_taken() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let green = cup.enter(&app, "green").await;
    rename(&app, &cup, &blue, "sky").ok().await;
    let excluded = json!({ "status": "disqualified", "reason": "two teams" });
    cup.change(&app, &green, excluded).await;
    app.restart().await;
    // Nobody swaps names with others, whatever became of those.
    for name in ["BLUE", "sky", "green"] {
        let problem = rename(&app, &cup, &red, name).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["name"], "{name}");
    }
    rename(&app, &cup, &blue, "Blue").ok().await;
    app.call(Method::DELETE, &path(&cup, &blue)).token(&blue.key).ok().await;
    app.restart().await;
    for name in ["Blue", "sky"] {
        rename(&app, &cup, &red, name).problem(422, "invalid").await;
        enter(&app, &cup, name).problem(422, "invalid").await;
    }
    // In another competition it is free.
    let other = Cup::with(&app, json!({})).await;
    other.enter(&app, "blue").await;
}

#[tokio::test]
async fn of_an_erased_name_only_digests_stay_and_they_go_with_the_end() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let entry = json!({ "name": "Ada Lovelace", "model": "m" });
    let made = app.post(&cup.path("/entrants")).json(&entry).ok().await;
    let text = |field: &str| made[field].as_str().expect("a text").to_owned();
    let blue = Entrant { id: text("id"), key: text("key") };
    rename(&app, &cup, &blue, "Countess Ada").ok().await;
    app.call(Method::DELETE, &path(&cup, &blue)).token(&blue.key).ok().await;
    let digests = "SELECT count(*) FROM used_names WHERE length(look) = 16";
    assert_eq!(app.count(digests).await, 4, "two looks of each name");
    for named in [
        "SELECT count(*) FROM looks WHERE kind <> 'model' OR written <> 'm'",
        "SELECT count(*) FROM entries WHERE name LIKE '%Ada%'",
        "SELECT count(*) FROM keys WHERE name LIKE '%Ada%'",
        "SELECT count(*) FROM audit WHERE detail LIKE '%Ada%'",
    ] {
        assert_eq!(app.count(named).await, 0, "{named}");
    }
    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    app.restart().await;
    assert_eq!(app.count("SELECT count(*) FROM used_names").await, 0);
}

#[tokio::test]
async fn everybody_sees_that_an_entrant_was_renamed_and_how_often_it_may_has_a_limit() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    for number in 0..10 {
        rename(&app, &cup, &blue, &format!("blue {number}")).ok().await;
        // What an organizer calls it does not count.
        if number == 4 {
            cup.change(&app, &blue, json!({ "name": "blue of the north" })).await;
        }
    }
    let problem = rename(&app, &cup, &blue, "blue").problem(403, "forbidden").await;
    assert_eq!(problem["limit"], json!({ "name": "renames_max", "value": 10 }));
    let seen = actions(&app, &cup).await;
    let own = texts(&seen, "action").into_iter().filter(|action| *action == "entrant.rename");
    assert_eq!((own.count(), seen.len()), (10, 11));
    assert_eq!(seen[0]["subject"], blue.id.as_str());
    assert_eq!(seen[0]["detail"], json!({ "rewritten": ["name"] }));
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    let log = list(&log["items"]);
    assert_eq!(log[0]["action"], "entrant.rename");
    assert!(log[0]["who"].as_str().is_some_and(|who| who.starts_with("key_")), "{log:?}");
    // Its names are not noted: they may be erased.
    assert!(!json!([seen, log]).to_string().contains("blue 9"));
    // An organizer corrects a name at any time.
    cup.change(&app, &blue, json!({ "name": "blue" })).await;
    assert_eq!(actions(&app, &cup).await[0]["action"], "entrant.change");
}
