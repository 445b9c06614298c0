//! Rights in a competition: they end when a member is removed from a team, or an entrant is disqualified or erased.

use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};
use swarmbench_boards::competition::verify::{Expected, verify};
use swarmbench_engine::physics::Solver;

use crate::app::{Call, TestApp, list, texts};
use crate::cup::{Attempt, Cup, Entrant, server};

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

fn path(cup: &Cup, entrant: &Entrant) -> String {
    cup.path(&format!("/entrants/{}", entrant.id))
}

/// Adds a member to a team: its id and its key.
async fn member(app: &TestApp, cup: &Cup, of: &Entrant, name: &str) -> (String, String) {
    let path = format!("{}/members", path(cup, of));
    let made = app.post(&path).token(&of.key).json(&json!({ "name": name })).ok().await;
    (text(&made["id"]), text(&made["key"]))
}

fn remove(app: &TestApp, cup: &Cup, of: &Entrant, member: &str, key: &str) -> Call {
    let path = format!("{}/members/{member}", path(cup, of));
    app.call(Method::DELETE, &path).token(key)
}

/// The games of a run that have not ended, and how the run and its games have ended.
async fn state(app: &TestApp, run: &str) -> (usize, Value, Vec<Value>) {
    let shown = app.get(&format!("/api/v1/runs/{run}")).token(&app.organizer).ok().await;
    let opened = list(&shown["games"]).into_iter().filter(|game| !game["episode"].is_null());
    let statuses: Vec<Value> = opened.map(|game| game["status"].clone()).collect();
    let open = statuses.iter().filter(|status| **status == "running").count();
    (open, shown["status"].clone(), statuses)
}

/// The code with which an act of a game that was seen before is refused; null where it is accepted.
async fn refused(app: &TestApp, attempt: &Attempt, seen: &Value) -> Value {
    let seen = &list(&seen["observations"])[0];
    let act = json!({
        "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"], "action": "STAY",
    });
    let call = app.post("/swarm/act").token(&attempt.swarm).json(&json!({ "acts": [act] }));
    call.ok().await["receipts"][0]["code"].clone()
}

#[tokio::test]
async fn a_removed_member_plays_nothing_of_its_team_any_more() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let (ada, key) = member(&app, &cup, &blue, "Ada").await;
    let started = app.post(&cup.path("/attempts")).token(&key).ok().await;
    let attempt = Attempt::of(&started);
    let practice = app.post(&cup.path("/practice")).token(&key).ok().await;
    let practice = text(&practice["swarm_token"]);
    attempt.act(&app, 1).await;
    app.get("/swarm/obs").token(&practice).ok().await;
    remove(&app, &cup, &blue, &ada, &blue.key).ok().await;
    for token in [&attempt.swarm, &practice] {
        let problem = app.get("/swarm/obs").token(token).problem(401, "unauthorized").await;
        assert!(text(&problem["detail"]).contains("replaced or revoked"), "{problem}");
    }
    let replace = format!("/api/v1/runs/{}/token", attempt.run);
    app.post(&replace).token(&key).problem(401, "unauthorized").await;
    app.restart().await;
    app.get("/swarm/obs").token(&attempt.swarm).problem(401, "unauthorized").await;
    // The team goes on with a token of its own.
    let swarm = text(&app.post(&replace).token(&blue.key).ok().await["swarm_token"]);
    Attempt { swarm, ..attempt }.play(&app, 4).await;
    let own = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(own["items"][0]["status"], "finished");
}

#[tokio::test]
async fn an_organizer_who_revokes_the_key_of_a_member_ends_its_tokens() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let (ada, _) = member(&app, &cup, &blue, "Ada").await;
    let (attempt, other) = (cup.start(&app, &blue).await, cup.start(&app, &red).await);
    app.delete(&format!("/api/v1/keys/{ada}")).token(&app.organizer).ok().await;
    app.get("/swarm/obs").token(&attempt.swarm).problem(401, "unauthorized").await;
    // Those of other teams stay good.
    other.look(&app).await;
}

/// A thief of a key has asked for tokens with it.
#[tokio::test]
async fn tokens_of_attempts_end_with_the_key_that_entered() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let refuse = async |tokens: &[&str]| {
        for token in tokens {
            app.get("/swarm/obs").token(token).problem(401, "unauthorized").await;
        }
    };
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let (attempt, other) = (cup.start(&app, &blue).await, cup.start(&app, &red).await);
    let practice = app.post(&cup.path("/practice")).token(&blue.key).ok().await;
    let practice = text(&practice["swarm_token"]);
    app.get("/swarm/obs").token(&practice).ok().await;
    attempt.act(&app, 1).await;
    let replaced = app.post(&format!("{}/key", path(&cup, &blue))).token(&app.organizer);
    let key = text(&replaced.ok().await["key"]);
    refuse(&[&attempt.swarm, &practice]).await;
    let replace = format!("/api/v1/runs/{}/token", attempt.run);
    app.post(&replace).token(&blue.key).problem(401, "unauthorized").await;
    // The entrant plays the same games with a new token.
    let swarm = text(&app.post(&replace).token(&key).ok().await["swarm_token"]);
    let attempt = Attempt { swarm, ..attempt };
    attempt.act(&app, 1).await;

    let keys = app.get("/api/v1/keys").token(&app.organizer).ok().await;
    let first = list(&keys["items"]).into_iter().find(|key| key["name"] == "blue");
    let first = text(&first.expect("the entrant's key")["id"]);
    app.delete(&format!("/api/v1/keys/{first}")).token(&app.organizer).ok().await;
    refuse(&[&attempt.swarm]).await;
    let swarm = text(&app.post(&replace).token(&app.organizer).ok().await["swarm_token"]);
    Attempt { swarm, ..attempt }.play(&app, 1).await;

    // Tokens of games outside competitions stay valid.
    let (green, id) = app.key(json!({ "name": "green" })).await;
    let entry = json!({ "name": "green", "model": "m" });
    app.post(&cup.path("/entrants")).token(&green).json(&entry).ok().await;
    let started = Attempt::of(&app.post(&cup.path("/attempts")).token(&green).ok().await);
    let run = json!({ "suite": "quick", "model": "m" });
    let elsewhere = app.post("/api/v1/runs").token(&green).json(&run).ok().await;
    app.delete(&format!("/api/v1/keys/{id}")).token(&app.organizer).ok().await;
    refuse(&[&started.swarm]).await;
    app.get("/swarm/obs").token(&text(&elsewhere["swarm_token"])).ok().await;
    other.look(&app).await;
}

#[tokio::test]
async fn members_remove_themselves_alone_and_who_entered_removes_all() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let (ada, of_ada) = member(&app, &cup, &blue, "Ada").await;
    let (grace, of_grace) = member(&app, &cup, &blue, "Grace").await;
    let (alan, _) = member(&app, &cup, &blue, "Alan").await;
    let problem = remove(&app, &cup, &blue, &grace, &of_ada).problem(403, "forbidden").await;
    assert!(text(&problem["detail"]).contains("with its own key"), "{problem}");
    remove(&app, &cup, &blue, &ada, &of_ada).ok().await;
    remove(&app, &cup, &blue, &alan, &app.organizer).ok().await;

    let erase = |key: &str| app.call(Method::DELETE, &path(&cup, &blue)).token(key);
    let problem = erase(&of_grace).problem(403, "forbidden").await;
    assert!(text(&problem["detail"]).contains("with which it entered"), "{problem}");
    assert_eq!(app.get(&path(&cup, &blue)).token(&blue.key).ok().await["erased"], false);
    erase(&blue.key).ok().await;
    app.get(&path(&cup, &blue)).token(&of_grace).problem(401, "unauthorized").await;
}

#[tokio::test]
async fn a_disqualified_entrant_plays_starts_and_invites_no_more() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({ "parallel": 1 })).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let (attempt, other) = (cup.start(&app, &blue).await, cup.start(&app, &red).await);
    let practice = app.post(&cup.path("/practice")).token(&blue.key).ok().await;
    while state(&app, &attempt.run).await.2.len() < 2 {
        attempt.act(&app, 4).await;
    }
    let seen = attempt.look(&app).await;
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two teams" })).await;
    assert_eq!(refused(&app, &attempt, &seen).await, "episode_over");
    assert_eq!(attempt.look(&app).await["finished"], true);
    let (open, status, games) = state(&app, &attempt.run).await;
    assert_eq!((open, status), (0, json!("aborted")));
    assert_eq!(games, ["finished", "aborted"]);
    assert_eq!(state(&app, &text(&practice["run"])).await.1, "aborted");
    for route in ["/attempts", "/practice"] {
        let problem = app.post(&cup.path(route)).token(&blue.key).problem(403, "forbidden").await;
        assert!(text(&problem["detail"]).contains("two teams"), "{problem}");
    }
    let members = format!("{}/members", path(&cup, &blue));
    let add = app.post(&members).token(&blue.key).json(&json!({ "name": "Ada" }));
    let problem = add.problem(403, "forbidden").await;
    assert!(text(&problem["detail"]).contains("disqualified: two teams"), "{problem}");

    // Who is taken back plays its next attempt; what was ended stays so, and can be voided.
    cup.change(&app, &blue, json!({ "status": "active" })).await;
    app.restart().await;
    assert_eq!(state(&app, &attempt.run).await.0, 0);
    assert_eq!(cup.start(&app, &blue).await.number, 2);
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two teams" })).await;
    other.play(&app, 4).await;

    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    let file = cup.export(&app).await;
    let report = verify(file.as_bytes(), Expected::default(), Solver::Flow, |_| {});
    let report = report.expect("the file of a competition with an excluded entrant");
    assert_eq!((report.attempts, report.rows.len()), (3, 2));
    let rows = cup.rows(&app, None).await;
    assert_eq!(
        rows.iter().map(|row| row["rank"].clone()).collect::<Vec<_>>(),
        [json!(1), json!(null)]
    );
    let excluded = rows[1]["entrant"].clone();
    assert_eq!(texts(&[excluded], "status"), ["disqualified"]);
}

#[tokio::test]
async fn many_who_are_excluded_at_once_play_no_more() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let mut attempts = Vec::new();
    for number in 0..3 {
        let bot = cup.enter(&app, &format!("bot {number}")).await;
        attempts.push(cup.start(&app, &bot).await);
    }
    let exclude = json!({ "name": "bot *", "count": 3, "reason": "one team" });
    app.post(&cup.path("/exclusions")).token(&app.organizer).json(&exclude).ok().await;
    for attempt in &attempts {
        let (open, status, _) = state(&app, &attempt.run).await;
        assert_eq!((open, status), (0, json!("aborted")));
    }
}

#[tokio::test]
async fn an_erased_entrant_plays_no_more() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 2 })).await;
    let (own, _) = app.key(json!({ "role": "member", "name": "team" })).await;
    let entry = json!({ "name": "blue", "model": "m" });
    let made = app.post(&cup.path("/entrants")).token(&own).json(&entry).ok().await;
    let blue = Entrant { id: text(&made["id"]), key: own };
    let attempt = cup.start(&app, &blue).await;
    attempt.act(&app, 4).await;
    let seen = attempt.look(&app).await;
    app.call(Method::DELETE, &path(&cup, &blue)).token(&blue.key).ok().await;
    assert_eq!(refused(&app, &attempt, &seen).await, "episode_over");
    let (open, status, _) = state(&app, &attempt.run).await;
    assert_eq!((open, status), (0, json!("aborted")));
    app.restart().await;
    app.post(&cup.path("/attempts")).token(&blue.key).problem(403, "forbidden").await;
}

/// The server stopped after an exclusion, before the games had ended: they end with its next start.
#[tokio::test]
async fn what_an_excluded_entrant_plays_ends_also_after_a_stop() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let practice = app.post(&cup.path("/practice")).token(&blue.key).ok().await;
    attempt.act(&app, 4).await;
    app.stop().await;
    app.tamper("UPDATE entries SET status = 'disqualified', reason = 'two teams';").await;
    app.start_again().await;
    let (open, status, _) = state(&app, &attempt.run).await;
    assert_eq!((open, status), (0, json!("aborted")));
    assert_eq!(state(&app, &text(&practice["run"])).await.1, "aborted");
}

/// Two requests of one moment: what both answered, in whichever order they were done.
#[tokio::test]
async fn what_is_started_while_its_entrant_is_disqualified_is_ended() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    for number in 0..12 {
        let blue = cup.enter(&app, &format!("team no. {number}")).await;
        let decision = json!({ "status": "disqualified", "reason": "two teams" });
        let start = |route: &str| app.post(&cup.path(route)).token(&blue.key).send();
        let (decided, attempt, practice) = tokio::join!(
            app.call(Method::PATCH, &path(&cup, &blue)).token(&app.organizer).json(&decision).ok(),
            start("/attempts"),
            start("/practice"),
        );
        assert_eq!(decided["status"], "disqualified");
        for answer in [attempt, practice] {
            if answer.status != 201 {
                assert_eq!(answer.status, 403, "{}", answer.text());
                continue;
            }
            assert_eq!(state(&app, &text(&answer.json()["run"])).await.1, "aborted");
        }
        let running = "SELECT count(*) FROM runs WHERE status = 'running'";
        assert_eq!(app.count(running).await, 0, "of team no. {number}");
    }
}

#[tokio::test]
async fn a_member_that_is_added_while_its_team_is_erased_has_no_key() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    for number in 0..12 {
        let blue = cup.enter(&app, &format!("team no. {number}")).await;
        let (added, erased) = tokio::join!(
            app.post(&format!("{}/members", path(&cup, &blue)))
                .token(&blue.key)
                .json(&json!({ "name": "Ada" }))
                .send(),
            app.call(Method::DELETE, &path(&cup, &blue)).token(&app.organizer).ok(),
        );
        assert_eq!(erased["erased"], true);
        if added.status == 201 {
            let key = text(&added.json()["key"]);
            app.get(&path(&cup, &blue)).token(&key).problem(401, "unauthorized").await;
        }
    }
    assert_eq!(app.count("SELECT count(*) FROM keys WHERE name = 'Ada'").await, 0);
}

/// The key with which a team entered, or that of a member: an entrant of either is of the team.
#[tokio::test]
async fn a_member_enters_for_its_team() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let other = Cup::open(&app, json!({ "entries_per_key": 2 })).await;
    let blue = cup.enter(&app, "blue").await;
    let (_, ada) = member(&app, &cup, &blue, "Ada").await;
    let enter = |cup: &Cup, name: &str| {
        let entry = json!({ "name": name, "model": "m" });
        app.post(&cup.path("/entrants")).token(&ada).json(&entry)
    };
    enter(&cup, "green").problem(403, "forbidden").await;
    let made = enter(&other, "green").ok().await;
    enter(&other, "teal").ok().await;
    let problem = enter(&other, "cyan").problem(403, "forbidden").await;
    assert!(text(&problem["detail"]).contains("has 2 entrants already"), "{problem}");
    let green = Entrant { id: text(&made["id"]), key: blue.key.clone() };
    let start = json!({ "entrant": green.id });
    app.post(&other.path("/attempts")).token(&ada).json(&start).ok().await;

    // A key stays good for the entrants that are not erased.
    app.call(Method::DELETE, &path(&other, &green)).token(&blue.key).ok().await;
    app.post(&cup.path("/attempts")).token(&blue.key).ok().await;
    app.get(&path(&cup, &blue)).token(&ada).ok().await;
    for entrant in list(&app.get(&other.path("/entrants")).ok().await["items"]) {
        let erase = other.path(&format!("/entrants/{}", text(&entrant["id"])));
        app.call(Method::DELETE, &erase).token(&app.organizer).ok().await;
    }
    app.get(&path(&cup, &blue)).token(&ada).ok().await;
    app.call(Method::DELETE, &path(&cup, &blue)).token(&app.organizer).ok().await;
    for key in [&blue.key, &ada] {
        app.get(&path(&cup, &blue)).token(key).problem(401, "unauthorized").await;
    }
}

#[tokio::test]
async fn nothing_is_written_again_of_who_was_erased() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (own, _) = app.key(json!({ "role": "member", "name": "team" })).await;
    let entry = json!({ "name": "blue", "model": "m" });
    let made = app.post(&cup.path("/entrants")).token(&own).json(&entry).ok().await;
    let blue = Entrant { id: text(&made["id"]), key: own };
    app.call(Method::DELETE, &path(&cup, &blue)).token(&blue.key).ok().await;
    let again = json!({ "status": "withdrawn", "reason": "Ada Lovelace" });
    let change = app.call(Method::PATCH, &path(&cup, &blue)).token(&blue.key).json(&again);
    change.problem(409, "closed").await;
    // An organizer still decides about it.
    let decision = json!({ "status": "disqualified", "reason": "two teams" });
    assert_eq!(cup.change(&app, &blue, decision).await["reason"], "two teams");
}

#[tokio::test]
async fn who_is_disqualified_can_still_be_reached() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two teams" })).await;
    let change =
        |change: Value| app.call(Method::PATCH, &path(&cup, &blue)).token(&blue.key).json(&change);
    change(json!({ "contact": "a@b.c" })).ok().await;
    change(json!({ "contact": "a@b.c", "name": "green" })).problem(403, "forbidden").await;
}

/// Streams and answers that are waited for were allowed to who asked; they are not sent to who may not ask any more.
#[tokio::test]
async fn what_is_waited_for_is_not_sent_to_a_revoked_key_or_token() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "parallel": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let (ada, key) = member(&app, &cup, &blue, "Ada").await;
    let attempt = Attempt::of(&app.post(&cup.path("/attempts")).token(&key).ok().await);
    let request = json!({ "name": "judge", "role": "judge" });
    let judge = app.post("/api/v1/keys").token(&app.organizer).json(&request).ok().await;
    let game = text(&attempt.episodes(&app).await[0]["id"]);
    let stream = |path: String, token: &Value| app.get(&path).token(&text(token)).open();
    let watched = stream(format!("/api/v1/episodes/{game}/events"), &judge["secret"]).await;
    let of_run = stream(format!("/api/v1/runs/{}/events", attempt.run), &json!(key)).await;
    assert!(watched.status().is_success() && of_run.status().is_success());

    // One seat of three has acted: the others' round is waited for.
    let seen = &list(&attempt.look(&app).await["observations"])[0];
    let act = json!({
        "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"], "action": "STAY",
    });
    let path = "/swarm/act?wait=1";
    let waiting = app.post(path).token(&attempt.swarm).json(&json!({ "acts": [act] })).send();
    let revoked = async {
        tokio::task::yield_now().await;
        remove(&app, &cup, &blue, &ada, &blue.key).ok().await;
        app.delete(&format!("/api/v1/keys/{}", text(&judge["id"])))
            .token(&app.organizer)
            .ok()
            .await;
        app.pass(Duration::from_secs(2));
    };
    let (answer, ()) = tokio::join!(waiting, revoked);
    assert_eq!(answer.status, 401, "{}", answer.text());
    // Both streams have ended, and the game goes on.
    for stream in [watched, of_run] {
        let rest = tokio::time::timeout(Duration::from_secs(20), stream.text()).await;
        assert!(!rest.expect("it ends").expect("UTF-8").contains("event: finished"));
    }
    assert_eq!(state(&app, &attempt.run).await.1, "running");
}

/// The key in the database has another token than the server knew when the request came: a replacement was committed before what
/// the request asks for.
#[tokio::test]
async fn a_request_that_is_overtaken_by_the_replacement_of_its_key_does_nothing() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    app.get(&path(&cup, &blue)).token(&blue.key).ok().await;
    app.tamper("UPDATE keys SET hash = substr(hash, 2) WHERE name = 'blue';").await;

    let members = format!("{}/members", path(&cup, &blue));
    let token = format!("/api/v1/runs/{}/token", attempt.run);
    for (method, path, body) in [
        (Method::POST, &token, json!({})),
        (Method::POST, &cup.path("/attempts"), json!({})),
        (Method::POST, &cup.path("/practice"), json!({})),
        (Method::POST, &members, json!({ "name": "Ada" })),
        (Method::PATCH, &path(&cup, &blue), json!({ "name": "green" })),
        (Method::DELETE, &path(&cup, &blue), json!({})),
    ] {
        let call = app.call(method, path).token(&blue.key);
        let call = if body == json!({}) { call } else { call.json(&body) };
        let problem = call.problem(401, "unauthorized").await;
        assert!(text(&problem["detail"]).contains("was replaced or revoked"), "{path}: {problem}");
    }
    assert_eq!(app.count("SELECT count(*) FROM runs").await, 1);
    assert_eq!(app.count("SELECT count(*) FROM keys WHERE name = 'Ada'").await, 0);
    let shown = app.get(&path(&cup, &blue)).token(&app.organizer).ok().await;
    assert_eq!((&shown["name"], &shown["erased"]), (&json!("blue"), &json!(false)));
    // The refused requests replaced nothing.
    attempt.look(&app).await;
}

/// Two requests of one moment, in whichever order they are done.
#[tokio::test]
async fn an_old_key_gets_no_token_beside_its_replacement() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    for number in 0..8 {
        let blue = cup.enter(&app, &format!("team no. {number}")).await;
        let run = cup.start(&app, &blue).await.run;
        let replace = format!("{}/key", path(&cup, &blue));
        let (replaced, token) = tokio::join!(
            app.post(&replace).token(&app.organizer).ok(),
            app.post(&format!("/api/v1/runs/{run}/token")).token(&blue.key).send(),
        );
        assert!(replaced["key"].is_string());
        if token.status == 200 {
            let token = text(&token.json()["swarm_token"]);
            app.get("/swarm/obs").token(&token).problem(401, "unauthorized").await;
        } else {
            assert_eq!(token.status, 401, "{}", token.text());
        }
    }
}
