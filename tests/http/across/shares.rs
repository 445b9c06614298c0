//! Fair shares: a client that wants all of a resource leaves enough to others.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::timeout;

use crate::app::{PATIENCE, TestApp, list, number};
use crate::cup::{Attempt, Cup, pass_minutes};

/// Behind a proxy that says whom it forwards.
fn forwarded(access: &mut swarmbench::http::Access) {
    access.trusted_proxies = vec!["127.0.0.0/8".parse().expect("a net")];
}

#[tokio::test]
async fn one_competition_leaves_places_to_another() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.episodes_unfinished_max = 16).start().await;
    let greedy = Cup::with(&app, json!({ "parallel": 4 })).await;
    let other = Cup::with(&app, json!({})).await;
    pass_minutes(&app, 10).await;
    let mut runs = Vec::new();
    let refused = loop {
        let entrant = greedy.enter(&app, &format!("entrant {}", runs.len())).await;
        let start = app.post(&greedy.path("/attempts")).token(&entrant.key).json(&json!({}));
        let answer = start.send().await;
        if answer.status != 201 {
            assert_eq!((answer.status, answer.header("retry-after")), (503, "10"));
            break answer.json();
        }
        runs.push(Attempt::of(&answer.json()).run);
    };
    let limit = json!({ "name": "episodes_unfinished_max", "value": 16 });
    assert_eq!(refused["limit"], limit);
    // Its further games hold half of all places, its last entrants have their first, and its last run says for what it waits.
    let mut open = 0;
    let mut waits_for = Value::Null;
    for run in &runs {
        let path = format!("/api/v1/runs/{run}");
        let shown = app.get(&path).token(&app.organizer).ok().await;
        let games = list(&shown["games"]);
        open += games.iter().filter(|game| game["status"] == "running").count();
        waits_for = shown["waits_for"].clone();
    }
    assert_eq!((open, waits_for), (10, limit));
    // Somebody else's starts, and plays as many games at a time as it wants.
    let entrant = other.enter(&app, "late").await;
    let attempt = other.start(&app, &entrant).await;
    let path = format!("/api/v1/runs/{}", attempt.run);
    let shown = app.get(&path).token(&app.organizer).ok().await;
    let games = list(&shown["games"]);
    assert_eq!(games.iter().filter(|game| game["status"] == "running").count(), 2, "{shown}");
    assert_eq!(shown["waits_for"], Value::Null);
}

/// The games of a run that are open.
async fn open_games(app: &TestApp, run: &str) -> usize {
    let shown = app.get(&format!("/api/v1/runs/{run}")).token(&app.organizer).ok().await;
    list(&shown["games"]).iter().filter(|game| game["status"] == "running").count()
}

/// However many greedy ones entered before: others of the same competition start, and play all of their games.
#[tokio::test]
async fn the_last_places_of_a_competition_are_for_entrants_who_have_none() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.episodes_unfinished_max = 40).start().await;
    let cup = Cup::open(&app, json!({ "parallel": 64 })).await;
    let (mut open, mut last) = (Vec::new(), None);
    for number in 0..12 {
        let entrant = cup.enter(&app, &format!("entrant {number}")).await;
        let attempt = cup.start(&app, &entrant).await;
        open.push(open_games(&app, &attempt.run).await);
        last = Some(attempt);
    }
    assert_eq!(open, [4, 4, 4, 3, 1, 1, 1, 1, 1, 1, 1, 1]);
    let last = last.expect("a run");
    last.play(&app, 1).await;
    let shown = app.get(&format!("/api/v1/runs/{}", last.run)).token(&app.organizer).ok().await;
    assert_eq!(shown["status"], "finished", "{shown}");
}

/// A key that was made for an entrant is no group of its own, also after a restart.
#[tokio::test]
async fn practice_takes_places_of_its_competition() {
    let builder = TestApp::builder().manual_clock().keys();
    let mut app = builder.limits(|limits| limits.episodes_unfinished_max = 16).start().await;
    let greedy = Cup::with(&app, json!({ "parallel": 64 })).await;
    let other = Cup::open(&app, json!({})).await;
    let seeds: Vec<u32> = (0..10).collect();
    for number in 0..6 {
        if number == 3 {
            app.restart().await;
        }
        let entrant = greedy.enter(&app, &format!("entrant {number}")).await;
        let practice = app.post(&greedy.path("/practice")).token(&entrant.key);
        practice.json(&json!({ "seeds": seeds })).send().await;
    }
    let entrant = other.enter(&app, "late").await;
    let attempt = other.start(&app, &entrant).await;
    assert_eq!(open_games(&app, &attempt.run).await, 2);
}

#[tokio::test]
async fn a_run_of_an_entrant_that_has_left_opens_no_more_games_until_it_is_readmitted() {
    let mut app = TestApp::builder().manual_clock().keys().start().await;
    let cup = Cup::open(&app, json!({ "parallel": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let games = async |app: &TestApp| {
        let path = format!("/api/v1/runs/{}", attempt.run);
        let shown = app.get(&path).token(&app.organizer).ok().await;
        list(&shown["games"]).iter().filter(|game| !game["episode"].is_null()).count()
    };
    cup.change(&app, &blue, json!({ "status": "withdrawn" })).await;
    for _ in 0..3 {
        attempt.act(&app, 1).await;
    }
    app.restart().await;
    assert_eq!((games(&app).await, open_games(&app, &attempt.run).await), (1, 0));
    cup.change(&app, &blue, json!({ "status": "active" })).await;
    app.restart().await;
    assert_eq!((games(&app).await, open_games(&app, &attempt.run).await), (2, 1));
}

#[tokio::test]
async fn a_key_leaves_memory_to_others() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.memory_bytes_max = 2_000_000).start().await;
    // Its clock keeps it in memory.
    let request = json!({
        "task": "Synchronization", "num_agents": 1, "width": 256, "height": 256, "memory": 0,
        "round_deadline_s": 3600,
    });
    let (greedy, _) = app.key(json!({ "name": "greedy" })).await;
    let (other, _) = app.key(json!({ "name": "other" })).await;
    let create = |key: &str| app.post("/api/v1/episodes").token(key).json(&request);
    for _ in 0..3 {
        create(&greedy).ok().await;
    }
    let refused = loop {
        let answer = create(&greedy).send().await;
        if answer.status != 201 {
            break answer;
        }
    };
    assert_eq!((refused.status, refused.header("retry-after")), (503, "5"));
    let limit = json!({ "name": "memory_bytes_max", "value": 2_000_000 });
    assert_eq!(refused.json()["limit"], limit);
    create(&other).ok().await;
    create(&app.organizer).ok().await;
}

#[tokio::test]
async fn strangers_of_a_server_without_keys_share_by_address() {
    let app = TestApp::builder()
        .limits(|limits| limits.episodes_unfinished_max = 8)
        .access(|access| {
            access.open = true;
            forwarded(access);
        })
        .start()
        .await;
    let task = json!({ "task": "Synchronization", "num_agents": 2 });
    let create =
        |address: &str| app.post("/api/v1/episodes").header("x-forwarded-for", address).json(&task);
    for _ in 0..4 {
        create("198.51.100.1").ok().await;
    }
    let problem = create("198.51.100.1").problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "episodes_unfinished_max");
    create("198.51.100.2").ok().await;
}

/// Whoever has a /48 of IPv6 has 65,536 networks in it.
#[tokio::test]
async fn networks_of_one_site_share_as_one_address() {
    let builder = TestApp::builder().limits(|limits| limits.episodes_unfinished_max = 8);
    let access = |access: &mut swarmbench::http::Access| {
        access.open = true;
        forwarded(access);
    };
    let app = builder.access(access).start().await;
    let task = json!({ "task": "Synchronization", "num_agents": 2 });
    let create =
        |address: &str| app.post("/api/v1/episodes").header("x-forwarded-for", address).json(&task);
    for network in 0..4 {
        create(&format!("2001:db8:1:{network}::1")).ok().await;
    }
    let problem = create("2001:db8:1:4::1").problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "episodes_unfinished_max");
    create("2001:db8:2::1").ok().await;
}

#[tokio::test]
async fn long_acts_come_at_a_pace_and_short_ones_always() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.journal_bytes_per_key_s_max = 1000).start().await;
    let (blue, _) = app.key(json!({ "name": "blue" })).await;
    let (red, _) = app.key(json!({ "name": "red" })).await;
    let task = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 50 });
    let act =
        |bytes: usize| json!({ "round": 0, "action": "STAY", "reasoning": "x".repeat(bytes) });
    let mut episodes = Vec::new();
    for _ in 0..3 {
        episodes.push(app.create_with(&blue, task.clone()).await);
    }
    // Eight seconds' worth at once; the last one of them may be longer.
    app.act(episodes[0].seat(0), &act(6_000)).await;
    app.act(episodes[1].seat(0), &act(6_000)).await;
    let late = || app.post("/act").token(episodes[2].seat(0)).json(&act(6_000));
    let refused = late().send().await;
    assert_eq!(refused.status, 429, "{}", refused.text());
    let problem = refused.json();
    assert_eq!(problem["code"], "rate_limited");
    let limit = json!({ "name": "journal_bytes_per_key_s_max", "value": 1000 });
    assert_eq!(problem["limit"], limit);
    let wait = number(&problem["retry_after_ms"]);
    assert!((3_000..6_000).contains(&wait), "{wait}");
    // What was taken is answered again, short acts are taken, and others write.
    assert_eq!(app.act(episodes[0].seat(0), &act(6_000)).await["duplicate"], true);
    app.act(episodes[2].seat(1), &act(1_500)).await;
    let other = app.create_with(&red, task.clone()).await;
    app.act(other.seat(0), &act(6_000)).await;
    app.pass(Duration::from_millis(wait - 1));
    late().problem(429, "rate_limited").await;
    app.pass(Duration::from_millis(1));
    late().ok().await;
}

#[tokio::test]
async fn entries_an_hour_are_limited_by_address() {
    let app = TestApp::builder()
        .manual_clock()
        .keys()
        .limits(|limits| limits.entries_per_address_h_max = 2)
        .access(forwarded)
        .start()
        .await;
    let cup = Cup::with(&app, json!({})).await;
    let enter = |address: &str, name: &str| {
        let entry = json!({ "name": name, "model": "m" });
        app.post(&cup.path("/entrants")).header("x-forwarded-for", address).json(&entry)
    };
    enter("198.51.100.1", "one").ok().await;
    // What is refused for something else takes nothing.
    enter("198.51.100.1", "οne").problem(422, "invalid").await;
    enter("198.51.100.1", "two").ok().await;
    let problem = enter("198.51.100.1", "three").problem(429, "rate_limited").await;
    let limit = json!({ "name": "entries_per_address_h_max", "value": 2 });
    assert_eq!((&problem["limit"], number(&problem["retry_after_ms"])), (&limit, 1_800_000));
    enter("198.51.100.2", "three").ok().await;
    enter("198.51.100.1", "of the organizer").token(&app.organizer).ok().await;
    app.pass(Duration::from_mins(30));
    enter("198.51.100.1", "four").ok().await;
}

#[tokio::test]
async fn a_site_enters_a_few_times_as_often_as_an_address() {
    let app = TestApp::builder()
        .manual_clock()
        .keys()
        .limits(|limits| limits.entries_per_address_h_max = 1)
        .access(forwarded)
        .start()
        .await;
    let cup = Cup::with(&app, json!({})).await;
    let enter = |address: &str| {
        let entry = json!({ "name": format!("from {address}"), "model": "m" });
        app.post(&cup.path("/entrants")).header("x-forwarded-for", address).json(&entry)
    };
    for network in 0..8 {
        enter(&format!("2001:db8:1:{network}::1")).ok().await;
    }
    enter("2001:db8:1:8::1").problem(429, "rate_limited").await;
    enter("2001:db8:2:8::1").ok().await;
}

/// One network cannot close a competition: the last places are for those with a code, and for other networks.
#[tokio::test]
async fn entrants_of_one_network_leave_places_to_others() {
    let builder = TestApp::builder().manual_clock().keys().limits(|limits| {
        limits.entrants_max = 20;
        limits.entries_per_address_h_max = 0;
    });
    let mut app = builder.access(forwarded).start().await;
    let cup = Cup::with(&app, json!({})).await;
    let labels = json!({ "labels": ["a", "b", "c"] });
    let codes = app.post(&cup.path("/codes")).token(&app.organizer).json(&labels).ok().await;
    let enter = |app: &TestApp, address: &str, name: &str, code: Option<usize>| {
        let code = code.map(|number| codes["items"][number]["code"].clone());
        let entry = json!({ "name": name, "model": "m", "code": code });
        app.post(&cup.path("/entrants")).header("x-forwarded-for", address).json(&entry)
    };
    for number in 0..16 {
        let address = format!("198.51.100.{number}");
        enter(&app, &address, &format!("greedy {number}"), None).ok().await;
    }
    // A restart makes no network a new one.
    app.restart().await;
    let problem = enter(&app, "198.51.100.99", "greedy", None).problem(403, "forbidden").await;
    let limit = json!({ "name": "reserved_percent", "value": 10 });
    assert_eq!(problem["limit"], limit);
    enter(&app, "2001:db8:1:1::1", "first of its site", None).ok().await;
    enter(&app, "2001:db8:1:2::1", "second", None).problem(403, "forbidden").await;
    enter(&app, "203.0.113.1", "first of its network", None).ok().await;
    // Half of the reserve is left: for codes, and for organizers.
    let problem = enter(&app, "192.0.2.1", "another", None).problem(403, "forbidden").await;
    assert_eq!(problem["limit"], limit);
    enter(&app, "198.51.100.1", "invited", Some(0)).ok().await;
    enter(&app, "192.0.2.1", "of the organizer", None).token(&app.organizer).ok().await;
    let problem = enter(&app, "192.0.2.1", "late", Some(1)).problem(403, "forbidden").await;
    assert_eq!(problem["limit"], json!({ "name": "entrants_max", "value": 20 }));
}

#[tokio::test]
async fn an_excluded_entrant_frees_its_place_but_not_its_name() {
    let builder = TestApp::builder().manual_clock().keys();
    let mut app = builder.limits(|limits| limits.entrants_max = 2).start().await;
    let cup = Cup::with(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    cup.enter(&app, "red").await;
    let enter = |app: &TestApp, name: &str| {
        app.post(&cup.path("/entrants")).json(&json!({ "name": name, "model": "m" }))
    };
    enter(&app, "green").problem(403, "forbidden").await;
    let change = json!({ "status": "withdrawn", "reason": "on its own" });
    cup.change(&app, &blue, change.clone()).await;
    // Twice is once.
    cup.change(&app, &blue, change).await;
    enter(&app, "BLUE").problem(422, "invalid").await;
    app.restart().await;
    enter(&app, "green").ok().await;
    enter(&app, "yellow").problem(403, "forbidden").await;
}

#[tokio::test]
async fn requests_at_once_are_limited_by_address_behind_a_proxy() {
    let app = TestApp::builder()
        .limits(|limits| limits.connections_per_address_max = 1)
        .access(forwarded)
        .start()
        .await;
    let episode = app.create(json!({ "task": "Synchronization", "num_agents": 2 })).await;
    let path = episode.path("/events");
    let look = |address: &str| app.get(&path).header("x-forwarded-for", address);
    // A stream is one as long as it is read.
    let stream = look("198.51.100.1").open().await;
    assert_eq!(stream.status(), 200);
    let problem = look("198.51.100.1").problem(503, "overloaded").await;
    let limit = json!({ "name": "connections_per_address_max", "value": 1 });
    assert_eq!(problem["limit"], limit);
    drop(look("198.51.100.2").open().await);
    drop(stream);
    // The server notices sooner or later.
    let asked = || app.get("/healthz").header("x-forwarded-for", "198.51.100.1").send();
    let noticed = async { while asked().await.status != 200 {} };
    timeout(PATIENCE, noticed).await.expect("its place is free at some time");
}

#[tokio::test]
async fn a_board_is_made_once_and_again_when_something_has_changed() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let cup = Cup::open(&app, json!({})).await;
    let names = async || {
        let listed = app.get(&cup.path("/entrants")).ok().await;
        list(&listed["items"]).iter().map(|item| item["name"].to_string()).collect::<Vec<_>>()
    };
    let blue = cup.enter(&app, "blue").await;
    assert_eq!(names().await.len(), 1);
    cup.enter(&app, "red").await;
    assert_eq!(names().await.len(), 2);
    // An entrant sees its own attempts, an organizer all, each after every change.
    let attempts = async |token: &str| {
        list(&app.get(&cup.path("/attempts")).token(token).ok().await["items"]).len()
    };
    assert_eq!((attempts(&blue.key).await, attempts(&app.organizer).await), (0, 0));
    cup.start(&app, &blue).await;
    assert_eq!((attempts(&blue.key).await, attempts(&app.organizer).await), (1, 1));
    // The answer for organizers is cached for nobody else, in any order of requests.
    let shows = async |token: Option<&str>| {
        let call = || app.get(&cup.path("/board"));
        let call = token.map_or_else(call, |token| call().token(token));
        call.ok().await["shows"].clone()
    };
    for _ in 0..2 {
        assert_eq!(shows(Some(&app.organizer)).await, "all");
        assert_eq!(shows(None).await, "totals");
    }
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two models" })).await;
    let shown = cup.rows(&app, None).await;
    let row = shown.iter().find(|row| row["entrant"]["name"] == "blue").expect("a row");
    assert_eq!(row["entrant"]["status"], "disqualified");
}

/// However much of a list is asked for: one that is short does not wait until others have their long answers.
#[tokio::test]
async fn a_short_list_waits_for_no_long_answer() {
    let builder = TestApp::builder().manual_clock().keys();
    let app = builder.limits(|limits| limits.heavy_at_once_max = 0).start().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    cup.start(&app, &blue).await;
    for number in 0..14 {
        cup.enter(&app, &format!("team {number}")).await;
    }
    for list_of in ["/entrants", "/entrants?limit=1000", "/attempts", "/attempts?limit=1000"] {
        app.get(&cup.path(list_of)).token(&blue.key).ok().await;
    }
    for number in 14..20 {
        cup.enter(&app, &format!("team {number}")).await;
    }
    let problem = app.get(&cup.path("/entrants")).problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "heavy_at_once_max");
    app.get(&cup.path("/entrants?limit=16")).ok().await;
    app.get(&cup.path("/entrants?limit=20")).ok().await;
    app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
}
