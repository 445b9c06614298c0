//! Organizers mend a competition: they extend, correct, hide and cancel it, and attempts are played again on spare seeds.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};
use swarmbench_boards::competition::verify::{CompetitionReport, Expected, Fault, verify};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;

use crate::app::{Call, TestApp, fields, list, number, texts};
use crate::cup::{Attempt, Cup, server};

fn change(app: &TestApp, cup: &Cup, change: &Value) -> Call {
    app.call(Method::PATCH, &cup.path("")).token(&app.organizer).json(change)
}

async fn actions(app: &TestApp, cup: &Cup) -> Vec<Value> {
    list(&app.get(&cup.path("/actions")).ok().await["items"])
}

fn check(file: &str) -> Result<CompetitionReport, Fault> {
    verify(file.as_bytes(), Expected::default(), Solver::Flow, |_| {})
}

async fn export(app: &TestApp, cup: &Cup, format: u32) -> String {
    let path = format!("/api/v1/exports/competitions/{}?format={format}", cup.id);
    let answer = app.get(&path).send().await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.text()
}

/// The ends of the games of an attempt, as their journals have them.
async fn ends(app: &TestApp, attempt: &Attempt) -> BTreeSet<String> {
    let mut ends = BTreeSet::new();
    for game in attempt.episodes(app).await {
        let id = game["id"].as_str().expect("an id");
        let path = format!("/api/v1/episodes/{id}/journal");
        let journal = app.get(&path).token(&app.organizer).send().await.text();
        let opening: Value =
            serde_json::from_str(journal.lines().next().expect("a line")).expect("JSON");
        let end = &opening["record"]["config"]["closes_at"];
        ends.insert(end.as_str().expect("an end").to_owned());
    }
    ends
}

#[tokio::test]
async fn an_extended_window_holds_for_all_games_that_are_opened_afterwards() {
    let app = server().await;
    let windows = json!([{ "closes_at": "2026-03-01T12:30:00Z" }, {}]);
    let cup = Cup::open(&app, json!({ "attempts": windows, "parallel": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let longer = json!({
        "closes_at": "2026-03-01T13:30:00.000Z", "reason": "an hour without the server",
        "attempts": [{ "attempt": 1, "closes_at": "2026-03-01T13:15:00Z" }],
    });
    let changed = change(&app, &cup, &longer).ok().await;
    assert_eq!(changed["closes_at"], "2026-03-01T13:30:00.000Z");
    // The second window ended with the competition, and does so again.
    assert_eq!(
        texts(&list(&changed["attempts"]), "closes_at"),
        ["2026-03-01T13:15:00.000Z", "2026-03-01T13:30:00.000Z"]
    );
    attempt.play(&app, 4).await;
    let both = ["2026-03-01T12:30:00Z", "2026-03-01T13:15:00Z"].map(str::to_owned);
    assert_eq!(
        ends(&app, &attempt).await,
        BTreeSet::from(both),
        "the game that was open keeps its end"
    );
    let log = actions(&app, &cup).await;
    assert_eq!(log[0]["action"], "competition.change");
    assert_eq!(log[0]["detail"]["reason"], "an hour without the server");
    let fields = texts(&list(&log[0]["detail"]["changes"]), "field");
    assert_eq!(fields, ["closes_at", "attempts[0].closes_at", "attempts[1].closes_at"]);
    app.pass(Duration::from_mins(90));
    cup.closed(&app).await;
    let file = cup.export(&app).await;
    let report = check(&file).expect("the file of an extended competition");
    assert_eq!((report.competition.format, report.actions.len(), report.episodes), (3, 1, 4));
    // The end of a game must be one that its window had when it was opened.
    let early =
        file.replace("\"from\":\"2026-03-01T12:30:00Z\"", "\"from\":\"2026-03-01T12:29:00Z\"");
    assert!(check(&early).is_err());
    // What was changed must lead to what the file says.
    let reread = |from: &str, to: &str| check(&rechained(&file, from, to)).map(|_| ());
    reread("an hour without the server", "two hours").expect("a reason says nothing of ends");
    let lie = reread(r#""to":"2026-03-01T13:30:00Z""#, r#""to":"2026-03-01T13:40:00Z""#);
    let lie = lie.expect_err("another end than that of the definition").to_string();
    assert!(lie.contains("the last change of"), "{lie}");
}

#[tokio::test]
async fn of_two_organizers_at_once_the_second_is_told_and_overwrites_nothing() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let seen = app.get(&cup.path("")).ok().await["revision"].clone();
    assert!(seen.as_str().is_some_and(|seen| !seen.is_empty()), "{seen}");
    // Both have seen the same, and write the same text at the same moment.
    let text = |text: &str| json!({ "description": text, "if_revision": seen });
    let (one, other) = (text("bring a laptop"), text("bring a charger"));
    let (one, other) =
        tokio::join!(change(&app, &cup, &one).send(), change(&app, &cup, &other).send());
    let mut answers = [one, other];
    answers.sort_by_key(|answer| answer.status);
    let [done, refused] = answers;
    assert_eq!((done.status, refused.status), (200, 409), "{}", refused.text());
    let problem: Value = serde_json::from_str(&refused.text()).expect("JSON");
    assert_eq!(problem["code"], "changed", "{problem}");
    assert!(problem["detail"].as_str().is_some_and(|why| why.contains("if_revision")), "{problem}");
    let now = app.get(&cup.path("")).ok().await;
    let done: Value = serde_json::from_str(&done.text()).expect("JSON");
    assert_eq!((&now["description"], &now["revision"]), (&done["description"], &done["revision"]));
    assert_ne!(now["revision"], seen);
    assert_eq!(actions(&app, &cup).await.len(), 1, "nothing of the refused change was done");
    // A field beside the text is refused as well: its sender has not seen what the competition is now.
    let hide = json!({ "hidden": true, "if_revision": seen });
    change(&app, &cup, &hide).problem(409, "changed").await;
    let hide = json!({ "hidden": true, "if_revision": now["revision"] });
    let hidden = change(&app, &cup, &hide).ok().await;
    assert_ne!(hidden["revision"], now["revision"]);
    // Entrants and announcements change nothing of this.
    cup.enter(&app, "blue").await;
    assert_eq!(app.get(&cup.path("")).ok().await["revision"], hidden["revision"]);
}

/// A file in which a text of its records is another, with hashes that fit.
fn rechained(file: &str, from: &str, to: &str) -> String {
    let mut head = Head::START;
    let mut left = 0;
    let mut text = String::new();
    for line in file.lines() {
        if left > 0 {
            left -= 1;
            text.push_str(line);
            text.push('\n');
            continue;
        }
        let (_, record) = line.split_once(r#","record":"#).expect("a line of a file");
        let record = record.strip_suffix('}').expect("a line of a file").replace(from, to);
        let read: Value = serde_json::from_str(&record).expect("JSON");
        left = if read["kind"] == "episode" { number(&read["lines"]) } else { 0 };
        head = head.link(record.as_bytes());
        writeln!(text, r#"{{"hash":"{head}","record":{record}}}"#)
            .expect("a string takes everything");
    }
    text
}

#[tokio::test]
async fn a_run_whose_game_was_cut_continues_where_its_window_was_extended() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "attempts": 1, "parallel": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    app.pass(Duration::from_mins(49));
    change(&app, &cup, &json!({ "closes_at": "2026-03-01T14:00:00Z" })).ok().await;
    // The open game still closes at 13:00; the three others are played afterwards.
    app.pass(Duration::from_mins(2));
    attempt.play(&app, 4).await;
    let ended: Vec<Value> = attempt.episodes(&app).await;
    let reasons: BTreeSet<_> =
        ended.iter().map(|game| game["result"]["reason"].to_string()).collect();
    assert_eq!(ended.len(), 4, "{reasons:?}");
    let own = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
    assert_eq!(own["items"][0]["status"], "finished", "{own}");
    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    check(&cup.export(&app).await).expect("the file");
}

#[tokio::test]
async fn windows_are_never_shortened_and_nothing_changes_after_the_end() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let shorter = json!({ "closes_at": "2026-03-01T12:50:00Z", "name": "",
        "attempts": [{ "attempt": 3, "closes_at": "2026-03-01T13:00:00Z" }] });
    let problem = change(&app, &cup, &shorter).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["closes_at", "attempts[0].attempt", "name"]);
    let outside = json!({ "attempts": [{ "attempt": 1, "closes_at": "2026-03-01T14:00:00Z" }] });
    let problem = change(&app, &cup, &outside).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["attempts[0].closes_at"]);
    let blue = cup.enter(&app, "blue").await;
    let call = app.call(Method::PATCH, &cup.path("")).token(&blue.key);
    call.json(&json!({ "name": "mine" })).problem(403, "forbidden").await;
    // Nothing is logged that changes nothing.
    change(&app, &cup, &json!({ "closes_at": "2026-03-01T13:00:00Z" })).ok().await;
    assert_eq!(actions(&app, &cup).await, Vec::<Value>::new());
    app.pass(Duration::from_mins(50));
    let late = json!({ "closes_at": "2026-03-01T15:00:00Z" });
    change(&app, &cup, &late).problem(409, "closed").await;
}

#[tokio::test]
async fn texts_are_corrected_and_a_rehearsal_is_hidden() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let texts_of = json!({ "name": "A cup", "description": "for all", "hidden": true });
    let changed = change(&app, &cup, &texts_of).ok().await;
    assert_eq!((&changed["name"], &changed["hidden"]), (&json!("A cup"), &json!(true)));
    let path = "/api/v1/competitions";
    assert_eq!(list(&app.get(path).ok().await["items"]), Vec::<Value>::new());
    let seen = app.get(path).token(&app.organizer).ok().await;
    assert_eq!(seen["items"][0]["id"], cup.id.as_str());
    assert_eq!(cup.show(&app).await["name"], "A cup", "who knows the id still finds it");
    change(&app, &cup, &json!({ "hidden": false })).ok().await;
    assert_eq!(list(&app.get(path).ok().await["items"]).len(), 1);
}

#[tokio::test]
async fn a_rehearsal_that_is_over_is_hidden_and_nothing_else_of_it_changes() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    cup.start(&app, &blue).await.play(&app, 0).await;
    app.pass(Duration::from_hours(1));
    let closed = cup.closed(&app).await;
    let published = cup.export(&app).await;
    let both = json!({ "hidden": true, "name": "another cup" });
    change(&app, &cup, &both).problem(409, "closed").await;
    change(&app, &cup, &json!({ "reason": "none" })).problem(409, "closed").await;
    let hidden = change(&app, &cup, &json!({ "hidden": true, "reason": "a rehearsal" })).ok().await;
    assert_eq!(
        (&hidden["hidden"], &hidden["name"], &hidden["closes_at"]),
        (&json!(true), &closed["name"], &closed["closes_at"])
    );
    let shown = async || list(&app.get("/api/v1/competitions").ok().await["items"]).len();
    assert_eq!(shown().await, 0);
    assert_eq!(actions(&app, &cup).await[0]["detail"]["changes"][0]["field"], "hidden");
    assert_eq!(cup.export(&app).await, published, "its head stays");
    check(&published).expect("the file of a hidden competition");
    change(&app, &cup, &json!({ "hidden": false })).ok().await;
    assert_eq!(shown().await, 1);
}

#[tokio::test]
async fn a_cancelled_competition_ends_and_its_seeds_stay_sealed_until_its_end() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let path = cup.path("/cancel");
    let cancel =
        |reason: &str| app.post(&path).token(&app.organizer).json(&json!({ "reason": reason }));
    assert_eq!(fields(&cancel("").problem(422, "invalid").await), ["reason"]);
    app.post(&path)
        .token(&blue.key)
        .json(&json!({ "reason": "x" }))
        .problem(403, "forbidden")
        .await;
    let cancelled = cancel("the rules were wrong").ok().await;
    assert_eq!((&cancelled["phase"], &cancelled["seeds"]), (&json!("cancelled"), &json!(null)));
    assert_eq!(cancel("another reason").ok().await["cancel_reason"], "the rules were wrong");
    assert_eq!(attempt.look(&app).await["finished"], true);
    let problem = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    let problem = problem.problem(409, "closed").await;
    assert!(problem["detail"].to_string().contains("the rules were wrong"), "{problem}");
    let entry = json!({ "name": "red", "model": "m" });
    app.post(&cup.path("/entrants")).json(&entry).problem(409, "closed").await;
    change(&app, &cup, &json!({ "name": "other" })).problem(409, "closed").await;
    assert_eq!(texts(&actions(&app, &cup).await, "action"), ["competition.cancel"]);
    app.pass(Duration::from_hours(1));
    for _ in 0..1000 {
        if cup.show(&app).await["seeds"] != json!(null) {
            break;
        }
        app.pass(Duration::from_millis(100));
    }
    let report = check(&cup.export(&app).await).expect("the file");
    assert_eq!((report.competition.format, report.actions.len()), (3, 1));
}

#[tokio::test]
async fn a_voided_attempt_is_played_again_on_spare_seeds_and_marked_on_the_board() {
    let app = server().await;
    let change = json!({ "attempts": 1, "spares": 1, "parallel": 4 });
    let cup = Cup::open_before_seeds_by_task(&app, change).await;
    let blue = cup.enter(&app, "blue").await;
    let seeds = async |attempt: &Attempt| -> BTreeSet<u64> {
        let episodes = attempt.episodes(&app).await;
        episodes.iter().map(|episode| number(&episode["config"]["seed"])).collect()
    };
    let broken = cup.start(&app, &blue).await;
    broken.act(&app, 4).await;
    let voided = cup.void(&app, &broken, "a power cut").await;
    assert_eq!(voided["seen"], json!(null), "it plays on other seeds");
    let call = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    let started = call.ok().await;
    assert_eq!((&started["attempt"], &started["on_spare_seeds"]), (&json!(1), &json!(true)));
    let again = Attempt::of(&started);
    assert!(seeds(&again).await.is_disjoint(&seeds(&broken).await));
    again.play(&app, 4).await;
    let rows = cup.rows(&app, None).await;
    assert_eq!((&rows[0]["attempt"], &rows[0]["on_spare_seeds"]), (&json!(1), &json!(true)));
    // The spare seeds are used up: the organizer learns what the entrant has seen of those that are left.
    let voided = cup.void(&app, &again, "another power cut").await;
    assert_eq!(
        (&voided["seen"]["games_opened"], &voided["seen"]["rounds"]),
        (&json!(4), &json!(12))
    );
    let third = cup.start(&app, &blue).await;
    assert_eq!(seeds(&third).await, seeds(&broken).await);
    third.play(&app, 2).await;
    app.pass(Duration::from_hours(1));
    cup.closed(&app).await;
    for format in [1, 2] {
        let report = check(&export(&app, &cup, format).await).expect("the file");
        assert_eq!((report.competition.format, report.attempts), (format, 3));
    }
    // Who plays again what was not voided is found.
    let file = export(&app, &cup, 2).await;
    assert!(check(&file.replace("\"replays\":1", "\"replays\":2")).is_err());
    assert_eq!(check(&cup.export(&app).await).expect("the file").competition.format, 2);
}

#[tokio::test]
async fn unused_codes_are_revoked_and_used_ones_are_not() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "entry": "codes" })).await;
    let path = cup.path("/codes");
    let labels = json!({ "labels": ["blue", "red", "red"] });
    let made = list(&app.post(&path).token(&app.organizer).json(&labels).ok().await["items"]);
    let enter = |name: &str, code: &Value| {
        let entry = json!({ "name": name, "model": "m", "code": code });
        app.post(&cup.path("/entrants")).json(&entry)
    };
    let blue = enter("blue", &made[0]["code"]).ok().await;
    let revoke =
        |which: Value| app.post(&cup.path("/codes/revoke")).token(&app.organizer).json(&which);
    let problem = revoke(json!({ "codes": [made[0]["code"]] })).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["codes[0]"]);
    assert!(problem.to_string().contains(blue["id"].as_str().expect("an id")), "{problem}");
    let problem = revoke(json!({ "labels": ["green"] })).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["labels[0]"]);
    assert_eq!(fields(&revoke(json!({})).problem(422, "invalid").await), ["labels"]);
    let revoked = revoke(json!({ "labels": ["red"] })).ok().await;
    assert_eq!(texts(&list(&revoked["items"]), "state"), ["revoked", "revoked"]);
    // Once more changes nothing, and is no deed.
    let log = actions(&app, &cup).await;
    let again = revoke(json!({ "codes": [made[1]["code"]] })).ok().await;
    assert_eq!(texts(&list(&again["items"]), "state"), ["revoked"]);
    assert_eq!(actions(&app, &cup).await, log);
    let problem = enter("red", &made[1]["code"]).problem(403, "forbidden").await;
    assert!(problem["detail"].to_string().contains("revoked"), "{problem}");
    let all = app.get(&format!("{path}?limit=2")).token(&app.organizer).ok().await;
    let cursor = all["next_cursor"].as_str().expect("another page");
    let rest = app.get(&format!("{path}?limit=2&cursor={cursor}")).token(&app.organizer).ok().await;
    let mut states = texts(&list(&all["items"]), "state");
    states.extend(texts(&list(&rest["items"]), "state"));
    states.sort_unstable();
    assert_eq!(states, ["revoked", "revoked", "used"]);
    app.get(&path).problem(401, "unauthorized").await;
}

#[tokio::test]
async fn many_are_excluded_at_once_after_a_preview_and_one_is_taken_back() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    app.pass(Duration::from_mins(1));
    let bots = [cup.enter(&app, "Bot-1").await, cup.enter(&app, "bot-2").await];
    let path = cup.path("/exclusions");
    let exclude = |which: &Value| app.post(&path).token(&app.organizer).json(which);
    assert_eq!(fields(&exclude(&json!({})).problem(422, "invalid").await), ["name"]);
    let bad = json!({ "address": "here", "name": "bot-*", "count": 2 });
    assert_eq!(fields(&exclude(&bad).problem(422, "invalid").await), ["address", "reason"]);
    let seen = exclude(&json!({ "name": "BOT-*" })).ok().await;
    assert_eq!((&seen["excluded"], &seen["count"]), (&json!(false), &json!(2)));
    assert_eq!(texts(&list(&seen["items"]), "status"), ["active", "active"]);
    let count = |from: &str| json!({ "registered_from": from });
    assert_eq!(exclude(&count("2026-03-01T12:11:00Z")).ok().await["count"], 2);
    assert_eq!(exclude(&json!({ "address": "127.0.0.0/8" })).ok().await["count"], 3);
    assert_eq!(exclude(&json!({ "address": "203.0.113.7" })).ok().await["count"], 0);
    let wrong = json!({ "name": "bot-*", "count": 3, "reason": "one team" });
    exclude(&wrong).problem(409, "closed").await;
    let right = json!({ "name": "bot-*", "count": 2, "reason": "one team" });
    let done = exclude(&right).ok().await;
    assert_eq!(texts(&list(&done["items"]), "status"), ["disqualified", "disqualified"]);
    exclude(&right).problem(409, "closed").await;
    let call = app.post(&cup.path("/attempts")).token(&bots[0].key).json(&json!({}));
    call.problem(403, "forbidden").await;
    cup.change(&app, &bots[0], json!({ "status": "active" })).await;
    cup.start(&app, &bots[0]).await;
    cup.start(&app, &blue).await;
    let log = actions(&app, &cup).await;
    assert_eq!(texts(&log, "action"), ["entrant.change", "entrants.exclude"]);
    assert_eq!(list(&log[1]["detail"]["entrants"]).len(), 2);
    assert!(!log[1].to_string().contains("BOT"), "how they were found is for organizers");
}

#[tokio::test]
async fn everybody_sees_what_organizers_do_to_attempts_of_others() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    attempt.act(&app, 4).await;
    let game = attempt.episodes(&app).await[0]["id"].as_str().expect("an id").to_owned();
    let run = format!("/api/v1/runs/{}", attempt.run);
    app.post(&format!("{run}/token")).token(&app.organizer).ok().await;
    app.delete(&format!("/api/v1/episodes/{game}")).token(&app.organizer).ok().await;
    app.delete(&run).token(&app.organizer).ok().await;
    let members = cup.path(&format!("/entrants/{}/members", blue.id));
    let ada = app.post(&members).token(&blue.key).json(&json!({ "name": "Ada" })).ok().await;
    let key = format!("/api/v1/keys/{}", ada["id"].as_str().expect("an id"));
    app.delete(&key).token(&app.organizer).ok().await;
    let mut log = actions(&app, &cup).await;
    let revoked = log.remove(0);
    assert_eq!(
        (&revoked["action"], &revoked["detail"]),
        (&json!("key.revoke"), &json!({ "entrant": blue.id }))
    );
    assert_eq!(texts(&log, "action"), ["run.abort", "episode.abort", "run.token"]);
    assert_eq!(texts(&log, "subject"), [&*attempt.run, &*game, &*attempt.run]);
    for of_run in [&log[0], &log[2]] {
        assert_eq!(of_run["detail"], json!({ "entrant": blue.id, "attempt": 1 }));
    }
}
