//! `/api/v1/episodes`: create, list, show, start, abort, and what spectators read.

use rstest::rstest;
use serde_json::{Value, json};

use crate::app::{Episode, TestApp, fields, list, number};

fn request(agents: u32, rounds: u32) -> Value {
    json!({ "task": "Synchronization", "seed": 9, "num_agents": agents, "max_round": rounds })
}

fn with(mut request: Value, field: &str, value: Value) -> Value {
    request[field] = value;
    request
}

async fn finish(app: &TestApp, episode: &Episode) {
    while app.show(episode).await["status"] == "running" {
        app.all_act(episode, "SWITCH").await;
    }
}

mod create {
    use std::collections::BTreeSet;

    use super::*;

    #[tokio::test]
    async fn defaults_are_filled_in() {
        let app = TestApp::start().await;
        let answer = app.post("/api/v1/episodes").json(&json!({ "task": "Pursuit" })).send().await;
        assert_eq!(answer.status, 201);
        let created = answer.json();
        let seed = created["config"]["seed"].clone();
        assert!(number(&seed) < 1 << 53);
        assert_eq!(
            created["config"],
            json!({
                "task": "Pursuit", "seed": seed, "rules": "paper", "num_agents": 12, "width": 10,
                "height": 10, "view_size": 5, "memory": 5, "max_round": 100,
                "control": "decentralized", "noise": 0.0, "max_delay": 0, "round_deadline_s": null,
                "bank_s": 0, "start": "now", "idle_timeout_s": 86_400, "visibility": "public",
                "model": "unnamed", "agent_meta": {}, "prompt_template": null, "open_seats": 0,
                "fill_after_s": null, "fill_with": null, "player": null,
            })
        );
        let episode = Episode::of(&created);
        assert!(episode.id.starts_with("ep_"), "{}", episode.id);
        assert_eq!(answer.header("location"), episode.path(""));
        assert_eq!(answer.header("cache-control"), "no-store");
        let tokens: BTreeSet<&str> = episode.seats().chain([episode.swarm.as_str()]).collect();
        assert_eq!(tokens.len(), 13);
        assert!(episode.seats().all(|token| token.starts_with("seat_")));
        assert!(episode.swarm.starts_with("swarm_"));
        // Seeds are drawn anew each time.
        let other = app.create(json!({ "task": "Pursuit" })).await;
        assert_ne!(other.config["seed"], seed);
    }

    #[tokio::test]
    async fn every_setting_is_kept() {
        let app = TestApp::start().await;
        let request = json!({
            "task": "Transport", "seed": 9_007_199_254_740_991_i64, "rules": "paper",
            "num_agents": 7, "width": 14, "height": 11, "view_size": 9, "memory": 2,
            "max_round": 33, "control": "centralized", "noise": 0.25, "max_delay": 3,
            "round_deadline_s": 0.05, "bank_s": 12.5, "start": "manual", "idle_timeout_s": 1,
            "visibility": "owner", "model": "m-1", "agent_meta": { "temperature": 0.7, "tags": ["a"] },
            "prompt_template": "{{ agent }}", "open_seats": 0, "fill_after_s": null, "fill_with": null,
            "player": "random",
        });
        let episode = app.create(request.clone()).await;
        assert_eq!(episode.config, request);
        assert_eq!(app.show(&episode).await["config"], request);
    }

    #[rstest]
    #[case("task", json!("Chess"))]
    #[case("task", json!(""))]
    #[case("task", json!(null))]
    #[case("task", json!(3))]
    #[case("seed", json!(-1))]
    #[case("seed", json!(9_007_199_254_740_992_i64))]
    #[case("seed", json!(1.5))]
    #[case("seed", json!("7"))]
    #[case("rules", json!("toolkit"))]
    #[case("num_agents", json!(0))]
    #[case("num_agents", json!(1025))]
    #[case("num_agents", json!(65))] // does not fit on the 64 cells inside
    #[case("width", json!(7))]
    #[case("width", json!(257))]
    #[case("height", json!(7))]
    #[case("height", json!(true))]
    #[case("view_size", json!(4))]
    #[case("view_size", json!(1))]
    #[case("view_size", json!(23))]
    #[case("memory", json!(-1))]
    #[case("memory", json!(51))]
    #[case("max_round", json!(0))]
    #[case("max_round", json!(100_001))]
    #[case("control", json!("anarchy"))]
    #[case("noise", json!(-0.1))]
    #[case("noise", json!(1.1))]
    #[case("max_delay", json!(101))]
    #[case("round_deadline_s", json!(0.01))]
    #[case("round_deadline_s", json!(86_401))]
    #[case("bank_s", json!(-1))]
    #[case("bank_s", json!(604_801))]
    #[case("start", json!("later"))]
    #[case("idle_timeout_s", json!(0.5))]
    #[case("idle_timeout_s", json!(31_536_001))]
    #[case("visibility", json!("nobody"))]
    #[case("visibility", json!("sealed"))]
    #[case("model", json!(""))]
    #[case("model", json!("a\nb"))]
    #[case("model", json!("x".repeat(201)))]
    #[case("agent_meta", json!([1]))]
    #[case("agent_meta", json!({ "much": "x".repeat(16 * 1024) }))]
    #[case("prompt_template", json!("{{ agent"))]
    #[case("prompt_template", json!("{% set x = 1 %}"))]
    #[case("prompt_template", json!("x".repeat(32 * 1024 + 1)))]
    #[case("colour", json!("red"))]
    #[tokio::test]
    async fn a_setting_that_is_not_allowed_is_named(#[case] field: &str, #[case] value: Value) {
        let app = TestApp::start().await;
        let call =
            app.post("/api/v1/episodes").json(&with(json!({ "task": "Pursuit" }), field, value));
        assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
        assert_eq!(app.get("/api/v1/episodes").ok().await["items"], json!([]));
    }

    #[rstest]
    #[case::square(json!({ "task": "Pursuit", "rules": "reference", "width": 12 }), "width")]
    #[case::flocking(json!({ "task": "Flocking", "num_agents": 257, "width": 40, "height": 40 }), "num_agents")]
    #[case::one_memory(json!({ "task": "Pursuit", "width": 100, "height": 100, "view_size": 101, "memory": 10 }), "memory")]
    #[case::all_memory(json!({ "task": "Pursuit", "width": 100, "height": 100, "view_size": 101, "memory": 6, "num_agents": 200 }), "memory")]
    #[case::acts(json!({ "task": "Pursuit", "max_round": 100_000, "num_agents": 101, "width": 40, "height": 40 }), "max_round")]
    #[case::missing(json!({ "seed": 1 }), "task")]
    #[tokio::test]
    async fn a_combination_that_is_not_allowed_is_named(
        #[case] request: Value,
        #[case] field: &str,
    ) {
        let app = TestApp::start().await;
        let call = app.post("/api/v1/episodes").json(&request);
        assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
    }

    #[tokio::test]
    async fn everything_that_is_wrong_is_named_at_once() {
        let app = TestApp::start().await;
        let request =
            json!({ "task": "Pursuit", "width": 4, "noise": 2, "start": "never", "bank_s": -3 });
        let problem = app.post("/api/v1/episodes").json(&request).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["width", "noise", "bank_s", "start"]);
        for named in ["width must be from 8 to 256, is 4", "bank_s must be"] {
            assert!(
                problem["detail"].as_str().is_some_and(|text| text.contains(named)),
                "{problem}"
            );
        }
    }

    #[tokio::test]
    async fn no_more_episodes_live_at_once_than_the_limit_says() {
        let app =
            TestApp::builder().limits(|limits| limits.episodes_unfinished_max = 2).start().await;
        let first = app.create(request(1, 1)).await;
        app.create(request(1, 1)).await;
        let call = || app.post("/api/v1/episodes").json(&request(1, 1));
        let problem = call().problem(503, "overloaded").await;
        assert_eq!(problem["limit"], json!({ "name": "episodes_unfinished_max", "value": 2 }));
        finish(&app, &first).await;
        call().ok().await;
    }
}

mod idempotency {
    use super::*;

    async fn create(app: &TestApp, key: &str) -> Episode {
        let call = app.post("/api/v1/episodes").header("idempotency-key", key).json(&request(2, 3));
        Episode::of(&call.ok().await)
    }

    async fn expect_revoked(app: &TestApp, lost: &Episode) {
        app.get("/obs").token(lost.seat(1)).problem(401, "unauthorized").await;
        app.get("/swarm/obs").token(&lost.swarm).problem(401, "unauthorized").await;
    }

    #[tokio::test]
    async fn a_repeat_gives_the_same_episode_with_fresh_tokens() {
        let mut app = TestApp::start().await;
        let first = create(&app, "k").await;
        app.all_act(&first, "SWITCH").await;
        assert_eq!(app.obs(first.seat(1)).await["round"], 1);
        let second = create(&app, "k").await;
        assert_eq!((&second.id, &second.config), (&first.id, &first.config));
        expect_revoked(&app, &first).await;
        assert_eq!(app.obs(second.seat(1)).await["round"], 1);
        assert_eq!(app.swarm_obs(&second).await.len(), 2);
        app.restart().await;
        expect_revoked(&app, &first).await;
        let third = create(&app, "k").await;
        assert_eq!(third.id, first.id);
        expect_revoked(&app, &second).await;
        finish(&app, &third).await;
        // It is the same even after its end.
        let fourth = create(&app, "k").await;
        assert_eq!(
            (&fourth.id, app.show(&fourth).await["status"].clone()),
            (&first.id, json!("finished"))
        );
        assert_eq!(list(&app.get("/api/v1/episodes").ok().await["items"]).len(), 1);
    }

    #[tokio::test]
    async fn another_key_or_none_gives_another_episode() {
        let app = TestApp::start().await;
        let first = create(&app, "k").await;
        assert_ne!(create(&app, "K").await.id, first.id);
        assert_ne!(app.create(request(2, 3)).await.id, first.id);
        assert_eq!(app.obs(first.seat(0)).await["round"], 0, "its tokens are untouched");
    }

    #[tokio::test]
    async fn another_body_is_refused_and_revokes_nothing() {
        let app = TestApp::start().await;
        let first = create(&app, "k").await;
        let call = app.post("/api/v1/episodes").header("idempotency-key", "k");
        call.json(&request(2, 4)).problem(422, "invalid").await;
        assert_eq!(app.obs(first.seat(0)).await["round"], 0);
    }

    #[tokio::test]
    async fn repeats_at_the_same_time_create_one_episode() {
        let app = TestApp::start().await;
        let all = futures::future::join_all((0..8).map(|_| create(&app, "k"))).await;
        assert!(all.iter().all(|episode| episode.id == all[0].id));
        // Only the tokens that were given out last are good.
        let mut good = 0;
        for episode in &all {
            good += u32::from(app.get("/obs").token(episode.seat(0)).send().await.status == 200);
        }
        assert_eq!(good, 1);
    }

    #[rstest]
    #[case(1, None)]
    #[case(200, None)]
    #[case(0, Some("malformed"))]
    #[case(201, Some("malformed"))]
    #[tokio::test]
    async fn a_key_has_1_to_200_characters(#[case] length: usize, #[case] refused: Option<&str>) {
        let app = TestApp::start().await;
        let key = "k".repeat(length);
        let call =
            app.post("/api/v1/episodes").header("idempotency-key", &key).json(&request(2, 3));
        match refused {
            None => drop(call.ok().await),
            Some(code) => drop(call.problem(400, code).await),
        }
    }
}

mod lists {
    use super::*;

    async fn ids(app: &TestApp, query: &str) -> Vec<String> {
        let page = app.get(&format!("/api/v1/episodes?{query}")).ok().await;
        let id = |item: &Value| item["id"].as_str().expect("an id").to_owned();
        list(&page["items"]).iter().map(id).collect()
    }

    #[tokio::test]
    async fn a_list_is_filtered_newest_first() {
        let app = TestApp::start().await;
        let made = [
            json!({ "task": "Pursuit", "model": "a" }),
            json!({ "task": "Transport", "model": "a", "start": "manual" }),
            json!({ "task": "Pursuit", "model": "b" }),
            json!({ "task": "Synchronization", "model": "b", "num_agents": 1, "max_round": 1 }),
            json!({ "task": "Pursuit", "model": "b" }),
        ];
        let mut episodes = Vec::new();
        for request in made {
            episodes.push(app.create(request).await);
        }
        finish(&app, &episodes[3]).await;
        app.delete(&episodes[4].path("")).token(&episodes[4].swarm).ok().await;
        let table: [(&str, &[usize]); 11] = [
            ("", &[4, 3, 2, 1, 0]),
            ("task=Pursuit", &[4, 2, 0]),
            ("model=a", &[1, 0]),
            ("model=A", &[]),
            ("status=running", &[2, 0]),
            ("status=waiting", &[1]),
            ("status=finished", &[3]),
            ("status=aborted", &[4]),
            ("status=abandoned", &[]),
            ("task=Pursuit&model=b&status=running", &[2]),
            ("run=run_1", &[]),
        ];
        for (query, expected) in table {
            let expected: Vec<_> =
                expected.iter().map(|&place| episodes[place].id.clone()).collect();
            assert_eq!(ids(&app, query).await, expected, "{query}");
        }
    }

    #[tokio::test]
    async fn pages_follow_each_other_without_gaps() {
        let app = TestApp::start().await;
        let mut all = Vec::new();
        for number in 0..7 {
            let request =
                with(request(1, 1), "model", json!(if number % 2 == 0 { "even" } else { "odd" }));
            all.insert(0, app.create(request).await.id);
        }
        for (filter, limit, expected) in [
            ("", 1, all.clone()),
            ("", 3, all.clone()),
            ("", 7, all.clone()),
            ("&model=even", 2, all.iter().step_by(2).cloned().collect()),
        ] {
            let mut seen = Vec::new();
            let mut place = String::new();
            loop {
                let page =
                    app.get(&format!("/api/v1/episodes?limit={limit}{filter}{place}")).ok().await;
                let items = list(&page["items"]);
                assert!((1..=limit).contains(&items.len()));
                seen.extend(
                    items.iter().map(|item| item["id"].as_str().expect("an id").to_owned()),
                );
                match page["next_cursor"].as_str() {
                    Some(next) => place = format!("&cursor={next}"),
                    None => break,
                }
                // What is created meanwhile is newer than every cursor.
                app.create(with(super::request(1, 1), "model", json!("late"))).await;
            }
            seen.retain(|id| all.contains(id));
            assert_eq!(seen, expected, "by {limit}{filter}");
        }
    }

    #[tokio::test]
    async fn an_item_is_what_show_answers() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 2)).await;
        app.all_act(&episode, "SWITCH").await;
        for _ in 0..2 {
            let item = app.get("/api/v1/episodes").ok().await["items"][0].clone();
            assert_eq!(item, app.get(&episode.path("")).ok().await);
            finish(&app, &episode).await;
        }
    }

    #[tokio::test]
    async fn a_page_beyond_the_limit_names_it() {
        let app = TestApp::start().await;
        let call = app.get("/api/v1/episodes?limit=1001");
        let problem = call.problem(400, "malformed").await;
        assert_eq!(problem["limit"], json!({ "name": "page_items_max", "value": 1000 }));
    }

    #[rstest]
    #[case("limit=0")]
    #[case("limit=1001")]
    #[case("limit=-1")]
    #[case("status=asleep")]
    #[case("task=Chess")]
    #[case("cursor=7")]
    #[case("cursor=cxyz")]
    #[case("cursor=c-1")]
    #[case("order=asc")]
    #[case("limit=1&limit=2")]
    #[tokio::test]
    async fn a_bad_query_is_malformed(#[case] query: &str) {
        let app = TestApp::start().await;
        app.get(&format!("/api/v1/episodes?{query}")).problem(400, "malformed").await;
    }
}

mod lifecycle {
    use super::*;

    #[tokio::test]
    async fn an_episode_is_shown_as_it_stands() {
        let app = TestApp::with_manual_clock().await;
        let episode = app.create(request(2, 2)).await;
        assert_eq!(
            app.show(&episode).await,
            json!({
                "id": episode.id, "status": "running", "task": "Synchronization", "model": "unnamed",
                "round": 0, "score": 0.0, "created_at": "2026-03-01T12:00:00Z", "ended_at": null,
                "result": null, "config": episode.config, "run": null, "void_reason": null,
            })
        );
        app.pass(std::time::Duration::from_millis(1500));
        finish(&app, &episode).await;
        let shown = app.show(&episode).await;
        assert_eq!((&shown["status"], number(&shown["round"])), (&json!("finished"), 2));
        assert_eq!(shown["ended_at"], "2026-03-01T12:00:01.5Z");
        assert_eq!(shown["result"]["rounds"], 2);
        assert_eq!(shown["result"]["score"], shown["score"]);
    }

    #[tokio::test]
    async fn an_aborted_episode_keeps_what_was_played() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 5)).await;
        app.all_act(&episode, "SWITCH").await;
        app.act(episode.seat(1), &json!({ "round": 1, "action": "UP" })).await;
        let aborted = app.delete(&episode.path("")).token(&episode.swarm).ok().await;
        assert_eq!((&aborted["status"], number(&aborted["round"])), (&json!("aborted"), 1));
        assert_eq!(aborted["result"]["reason"], "aborted");
        // A second time changes nothing.
        assert_eq!(app.delete(&episode.path("")).token(&episode.swarm).ok().await, aborted);
        let act = json!({ "round": 1, "action": "STAY" });
        app.post("/act").token(episode.seat(0)).json(&act).problem(409, "episode_over").await;
        let report = journals::verified(&app.journal(&episode).await);
        let end = report.end.expect("an end");
        assert_eq!((end.status.as_str(), end.rounds), ("aborted", 1));
        let left: Vec<_> = end.open_acts.iter().map(|act| act.agent.as_str()).collect();
        assert_eq!(left, ["Agent_1"]);
    }

    #[tokio::test]
    async fn an_episode_that_has_ended_is_neither_aborted_nor_started() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 1)).await;
        finish(&app, &episode).await;
        let before = app.show(&episode).await;
        let abort = app.delete(&episode.path("")).token(&episode.swarm);
        assert_eq!(abort.problem(409, "episode_over").await["round"], 1);
        let start = app.post(&episode.path("/start")).token(&episode.swarm);
        assert_eq!(start.problem(409, "episode_over").await["round"], 1);
        assert_eq!(app.show(&episode).await, before);
    }

    #[tokio::test]
    async fn a_manual_episode_waits_for_its_start() {
        let mut app = TestApp::start().await;
        let episode = app.create(with(request(2, 1), "start", json!("manual"))).await;
        let act = json!({ "round": 0, "action": "SWITCH" });
        for _ in 0..2 {
            assert_eq!(app.show(&episode).await["status"], "waiting");
            let seen = app.obs(episode.seat(0)).await;
            assert_eq!((&seen["status"], number(&seen["round"])), (&json!("waiting"), 0));
            app.post("/act").token(episode.seat(0)).json(&act).problem(409, "round_ahead").await;
            app.restart().await;
        }
        for _ in 0..2 {
            let started = app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
            assert_eq!(started["status"], "running");
            // Starting it again changes nothing.
            app.act(episode.seat(0), &act).await;
        }
        app.restart().await;
        assert_eq!(app.show(&episode).await["status"], "running");
        assert_eq!(app.obs(episode.seat(0)).await["acted"], true);
        finish(&app, &episode).await;
        let shown = app.show(&episode).await;
        assert_eq!(shown["result"]["reason"], "rounds_played");
    }

    #[tokio::test]
    async fn a_waiting_episode_can_be_aborted() {
        let app = TestApp::start().await;
        let episode = app.create(with(request(2, 1), "start", json!("manual"))).await;
        let aborted = app.delete(&episode.path("")).token(&episode.swarm).ok().await;
        assert_eq!((&aborted["status"], number(&aborted["round"])), (&json!("aborted"), 0));
        journals::verified(&app.journal(&episode).await);
    }
}

mod visibility {
    use super::*;

    /// Who asks.
    #[derive(Clone, Copy, Debug)]
    enum Who {
        Nobody,
        Seat,
        Creator,
        Stranger,
    }

    /// What `who` gets from the reading routes: show, state, events and journal.
    async fn statuses(app: &TestApp, episode: &Episode, stranger: &Episode, who: Who) -> [u16; 4] {
        let mut statuses = [0; 4];
        for (status, rest) in statuses.iter_mut().zip(["", "/state", "/events", "/journal"]) {
            let call = app.get(&episode.path(rest));
            let call = match who {
                Who::Nobody => call,
                Who::Seat => call.token(episode.seat(0)),
                Who::Creator => call.token(&episode.swarm),
                Who::Stranger => call.token(&stranger.swarm),
            };
            *status = call.open().await.status().as_u16();
        }
        statuses
    }

    #[rstest]
    #[case("public", Who::Nobody, [200, 200, 200, 200])]
    #[case("public", Who::Creator, [200, 200, 200, 200])]
    #[case("public", Who::Seat, [200, 200, 200, 403])]
    #[case("public", Who::Stranger, [200, 200, 200, 403])]
    #[case("owner", Who::Nobody, [404, 404, 404, 404])]
    #[case("owner", Who::Creator, [200, 200, 200, 200])]
    #[case("owner", Who::Seat, [200, 403, 403, 403])]
    #[case("owner", Who::Stranger, [404, 404, 404, 404])]
    #[tokio::test]
    async fn until_the_end_it_says_who_reads_and_afterwards_all_do(
        #[case] visibility: &str,
        #[case] who: Who,
        #[case] expected: [u16; 4],
    ) {
        let app = TestApp::start().await;
        let stranger = app.create(request(1, 1)).await;
        let episode = app.create(with(request(1, 2), "visibility", json!(visibility))).await;
        app.all_act(&episode, "SWITCH").await;
        assert_eq!(statuses(&app, &episode, &stranger, who).await, expected, "while it runs");
        finish(&app, &episode).await;
        assert_eq!(statuses(&app, &episode, &stranger, who).await, [200; 4], "after its end");
    }

    #[tokio::test]
    async fn an_owners_episode_is_listed_after_its_end() {
        let app = TestApp::start().await;
        let episode = app.create(with(request(1, 1), "visibility", json!("owner"))).await;
        assert_eq!(app.get("/api/v1/episodes").ok().await["items"], json!([]));
        // Its creator sees it before.
        let own = app.get("/api/v1/episodes").token(&episode.swarm).ok().await;
        assert_eq!(own["items"][0]["id"], episode.id);
        finish(&app, &episode).await;
        assert_eq!(app.get("/api/v1/episodes").ok().await["items"][0]["id"], episode.id);
    }

    #[tokio::test]
    async fn a_player_does_not_learn_the_seed_before_the_end() {
        let app = TestApp::start().await;
        let episode = app.create(with(request(1, 1), "visibility", json!("owner"))).await;
        let seed = || async {
            let shown = app.get(&episode.path("")).token(episode.seat(0)).ok().await;
            shown["config"]["seed"].clone()
        };
        assert_eq!(seed().await, Value::Null);
        assert_eq!(app.show(&episode).await["config"]["seed"], 9);
        finish(&app, &episode).await;
        assert_eq!(seed().await, 9);
    }

    #[tokio::test]
    async fn only_the_creator_starts_and_aborts() {
        let app = TestApp::start().await;
        let stranger = app.create(request(1, 1)).await;
        let request =
            with(with(request(1, 1), "visibility", json!("owner")), "start", json!("manual"));
        let episode = app.create(request).await;
        let calls = || [app.delete(&episode.path("")), app.post(&episode.path("/start"))];
        for call in calls() {
            call.problem(404, "not_found").await;
        }
        for call in calls() {
            call.token(&stranger.swarm).problem(404, "not_found").await;
        }
        for call in calls() {
            call.token(episode.seat(0)).problem(403, "forbidden").await;
        }
        assert_eq!(app.show(&episode).await["status"], "waiting");
        app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
        app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    }

    #[tokio::test]
    async fn a_token_of_another_episode_aborts_no_public_one() {
        let app = TestApp::start().await;
        let (one, other) = (app.create(request(1, 1)).await, app.create(request(1, 1)).await);
        app.delete(&one.path("")).token(&other.swarm).problem(403, "forbidden").await;
        app.delete(&one.path("")).token(other.seat(0)).problem(403, "forbidden").await;
        assert_eq!(app.show(&one).await["status"], "running");
    }
}

mod states {
    use super::*;

    #[tokio::test]
    async fn a_state_of_any_round_is_what_was_published_then() {
        let mut app = TestApp::start().await;
        // More rounds than states are kept on the way.
        let rounds = 270;
        let request =
            json!({ "task": "Foraging", "seed": 4, "num_agents": 2, "max_round": rounds });
        let episode = app.create(request).await;
        let mut published = vec![app.state(&episode).await];
        for round in 0..rounds {
            let action =
                ["UP", "RIGHT", "RIGHT", "DOWN", "LEFT", "DOWN", "RIGHT"][round * round % 7];
            app.all_act(&episode, action).await;
            published.push(app.state(&episode).await);
        }
        assert!(published.windows(2).any(|pair| pair[0]["agents"] != pair[1]["agents"]));
        for _ in 0..2 {
            for (round, expected) in published.iter().enumerate() {
                let state = app.get(&episode.path(&format!("/state?round={round}"))).ok().await;
                assert_eq!(&state, expected);
            }
            app.restart().await;
        }
    }

    #[tokio::test]
    async fn a_round_that_has_not_come_is_not_found() {
        let app = TestApp::start().await;
        let episode = app.create(request(1, 2)).await;
        app.all_act(&episode, "UP").await;
        let problem = app.get(&episode.path("/state?round=2")).problem(404, "not_found").await;
        assert_eq!(problem["round"], 1);
        app.get(&episode.path("/state?round=-1")).problem(400, "malformed").await;
    }
}

mod events {
    use super::*;

    /// A server-sent event.
    #[derive(Clone, Debug, PartialEq)]
    struct Event {
        kind: String,
        id: Option<u64>,
        data: Value,
    }

    /// Reads events until the server ends the stream, or `most` of them.
    async fn read(mut response: reqwest::Response, most: usize) -> Vec<Event> {
        assert_eq!(response.status(), 200);
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        let mut events = Vec::new();
        let mut text = String::new();
        while let Some(chunk) = response.chunk().await.expect("a chunk") {
            text.push_str(std::str::from_utf8(&chunk).expect("UTF-8"));
            while let Some((block, rest)) = text.split_once("\n\n") {
                events.extend(event(block));
                text = rest.to_owned();
            }
            if events.len() >= most {
                return events;
            }
        }
        assert_eq!(text, "", "the stream ends with a whole event");
        events
    }

    fn event(block: &str) -> Option<Event> {
        let field = |name: &str| {
            block
                .lines()
                .find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))
                .map(str::trim_start)
        };
        // A block without data is a comment that keeps the connection open.
        let data = serde_json::from_str(field("data")?).expect("JSON");
        let id = field("id").map(|id| id.parse().expect("a number"));
        Some(Event { kind: field("event")?.to_owned(), id, data })
    }

    async fn all(app: &TestApp, episode: &Episode, query: &str, last: Option<&str>) -> Vec<Event> {
        let call = app.get(&episode.path(&format!("/events{query}")));
        let call = match last {
            Some(last) => call.header("last-event-id", last),
            None => call,
        };
        read(call.open().await, usize::MAX).await
    }

    #[tokio::test]
    async fn every_round_is_told_while_it_happens_and_then_the_end() {
        let app = TestApp::with_manual_clock().await;
        let episode = app.create(request(2, 4)).await;
        app.all_act(&episode, "SWITCH").await;
        // The first round is over already, the others come while somebody listens.
        let listening = app.get(&episode.path("/events")).open().await;
        let play = async {
            let mut states = vec![app.state(&episode).await];
            for action in ["UP", "SWITCH", "SWITCH"] {
                app.all_act(&episode, action).await;
                states.push(app.state(&episode).await);
            }
            states
        };
        let (events, states) = tokio::join!(read(listening, usize::MAX), play);
        let (end, rounds) = events.split_last().expect("events");
        assert_eq!(rounds.len(), 4);
        for ((event, state), number) in rounds.iter().zip(&states).zip(1..) {
            assert_eq!((event.kind.as_str(), event.id), ("round", Some(number)));
            let expected =
                json!({ "round": number, "score": state["score"], "agents": state["agents"] });
            assert_eq!(event.data, expected);
        }
        assert_eq!((end.kind.as_str(), end.id), ("finished", None));
        assert_eq!(end.data, app.show(&episode).await["result"]);
    }

    #[tokio::test]
    async fn a_reader_resumes_after_the_last_event_it_has() {
        let mut app = TestApp::start().await;
        let episode = app.create(request(2, 6)).await;
        finish(&app, &episode).await;
        let told = all(&app, &episode, "", None).await;
        assert_eq!(told.len(), 7);
        app.restart().await;
        assert_eq!(all(&app, &episode, "", None).await, told);
        assert_eq!(all(&app, &episode, "", Some("4")).await, told[4..]);
        assert_eq!(all(&app, &episode, "?after=4", None).await, told[4..]);
        assert_eq!(all(&app, &episode, "?after=1", Some("5")).await, told[5..]);
        assert_eq!(all(&app, &episode, "", Some("6")).await, told[6..]);
        assert_eq!(all(&app, &episode, "", Some("99")).await, told[6..]);
    }

    #[tokio::test]
    async fn a_reader_that_goes_away_misses_nothing_when_it_resumes() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 3)).await;
        app.all_act(&episode, "SWITCH").await;
        let seen = read(app.get(&episode.path("/events")).open().await, 1).await;
        assert_eq!(seen[0].id, Some(1));
        finish(&app, &episode).await;
        let rest = all(&app, &episode, "", Some("1")).await;
        let ids: Vec<_> = rest.iter().map(|event| event.id).collect();
        assert_eq!(ids, [Some(2), Some(3), None]);
    }

    #[tokio::test]
    async fn an_open_stream_ends_when_the_server_stops() {
        let mut app = TestApp::start().await;
        let episode = app.create(request(2, 3)).await;
        app.all_act(&episode, "SWITCH").await;
        let listening =
            tokio::spawn(read(app.get(&episode.path("/events")).open().await, usize::MAX));
        app.stop().await;
        assert!(listening.await.expect("a clean end of the stream").len() <= 1);
    }

    #[tokio::test]
    async fn an_aborted_episode_is_told_as_its_end() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 3)).await;
        let listening = app.get(&episode.path("/events")).open().await;
        app.delete(&episode.path("")).token(&episode.swarm).ok().await;
        let told = read(listening, usize::MAX).await;
        assert_eq!((told.len(), told[0].kind.as_str()), (1, "finished"));
        assert_eq!(told[0].data["reason"], "aborted");
    }

    #[rstest]
    #[case("here")]
    #[case("-1")]
    #[case("1.5")]
    #[tokio::test]
    async fn an_id_that_no_event_has_is_malformed(#[case] id: &str) {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 3)).await;
        let call = app.get(&episode.path("/events")).header("last-event-id", id);
        call.problem(400, "malformed").await;
        app.get(&episode.path(&format!("/events?after={id}"))).problem(400, "malformed").await;
    }
}

mod journals {
    use sha2::{Digest, Sha256};
    use swarmbench::journal::chain::Head;
    use swarmbench::journal::replay::{Fault, Report, verify};
    use swarmbench_engine::physics::Solver;

    use super::*;

    fn check(journal: &[u8], head: Option<Head>) -> Result<Report, Fault> {
        verify(journal, head, Solver::Flow, |_, _| ())
    }

    pub(super) fn verified(journal: &str) -> Report {
        check(journal.as_bytes(), None).expect("it plays again")
    }

    /// A finished episode with all kinds of acts, and its journal.
    async fn played(app: &TestApp) -> (Episode, String) {
        let episode = app.create(request(3, 4)).await;
        app.all_act(&episode, "SWITCH").await;
        let answers = [
            json!({ "round": 1, "response": "ACTION: UP\nMSG: grüße", "reasoning": "\"\\\u{1F41D}" }),
            json!({ "round": 1, "response": "none", "usage": { "latency_ms": 5 } }),
            json!({ "round": 1, "action": "SWITCH", "message": "on" }),
        ];
        for (token, answer) in episode.seats().zip(&answers) {
            app.act(token, answer).await;
        }
        finish(app, &episode).await;
        let journal = app.journal(&episode).await;
        (episode, journal)
    }

    #[tokio::test]
    async fn its_lines_are_chained_by_their_hashes() {
        let app = TestApp::start().await;
        let (episode, journal) = played(&app).await;
        let kinds = ["opening", "round", "round", "round", "round", "end"];
        assert_eq!(journal.lines().count(), kinds.len());
        let mut head = [0_u8; 32];
        for (line, kind) in journal.lines().zip(kinds) {
            let parsed: Value = serde_json::from_str(line).expect("JSON");
            assert_eq!(parsed["record"]["kind"], kind);
            // `{"hash":"…","record":` and 64 digits stand before a record, `}` after it.
            let record = &line[r#"{"hash":"","record":"#.len() + 64..line.len() - 1];
            head = Sha256::new().chain_update(head).chain_update(record).finalize().into();
            assert_eq!(parsed["hash"], Head(head).to_string());
        }
        let shown = app.show(&episode).await;
        assert_eq!(shown["result"]["journal_head"], Head(head).to_string());
        let report = check(journal.as_bytes(), Some(Head(head))).expect("it plays again");
        assert_eq!(json!(report.score), shown["score"]);
        assert_eq!(report.opening.episode, episode.id);
        assert_eq!(report.opening.rules_revision, swarmbench_engine::RULES_REVISION);
        assert_eq!(report.opening.prompt_template, swarmbench::prompt::BUILT_IN);
    }

    #[tokio::test]
    async fn that_of_a_running_episode_is_its_beginning() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 3)).await;
        let mut beginnings = vec![app.journal(&episode).await];
        for _ in 0..3 {
            app.all_act(&episode, "SWITCH").await;
            beginnings.push(app.journal(&episode).await);
        }
        let whole = beginnings.pop().expect("four");
        for (beginning, rounds) in beginnings.iter().zip(0..) {
            assert_eq!(beginning.lines().count(), 1 + rounds);
            assert!(whole.starts_with(beginning.as_str()));
            let report = verified(beginning);
            assert_eq!((report.rounds as usize, report.end.is_none()), (rounds, true));
            // It is consistent, but not the whole: the head tells.
            let head = verified(&whole).head;
            assert!(matches!(check(beginning.as_bytes(), Some(head)), Err(Fault::Whole(_))));
        }
        assert_eq!(whole.lines().count(), 5);
    }

    #[rstest]
    #[case::lowest_bit(0x01, 3)]
    #[case::case_bit(0x20, 5)]
    #[case::not_ascii(0x80, 11)]
    #[tokio::test]
    async fn a_changed_byte_is_found_in_its_line(#[case] flip: u8, #[case] stride: usize) {
        let app = TestApp::start().await;
        let (_, journal) = played(&app).await;
        let journal = journal.into_bytes();
        for place in (0..journal.len()).step_by(stride) {
            let mut changed = journal.clone();
            changed[place] ^= flip;
            let expected = journal[..place].split(|&byte| byte == b'\n').count();
            match check(&changed, None) {
                Err(Fault::Line { line, .. }) => assert_eq!(line, expected, "byte {place}"),
                other => panic!("byte {place} of line {expected}: {other:?}"),
            }
        }
    }

    #[tokio::test]
    async fn lines_that_are_gone_doubled_or_swapped_are_found() {
        let app = TestApp::start().await;
        let (_, journal) = played(&app).await;
        let lines: Vec<&str> = journal.lines().collect();
        let joined = |lines: &[&str]| lines.join("\n") + "\n";
        assert_eq!(joined(&lines), journal);
        for place in 0..lines.len() - 1 {
            let mut gone = lines.clone();
            gone.remove(place);
            let mut doubled = lines.clone();
            doubled.insert(place, lines[place]);
            let mut swapped = lines.clone();
            swapped.swap(place, place + 1);
            let unfinished = journal[..journal.len() - 1].to_owned();
            for changed in [joined(&gone), joined(&doubled), joined(&swapped), unfinished] {
                assert!(matches!(check(changed.as_bytes(), None), Err(Fault::Line { .. })));
            }
        }
    }
}

/// A layout that solves the task leaves nothing to act in; its creator sees that at once.
#[tokio::test]
async fn a_manual_start_of_a_solved_layout_is_its_end() {
    let app = TestApp::start().await;
    let solved = json!({ "task": "Flocking", "rules": "reference", "seed": 578, "num_agents": 3,
        "start": "manual" });
    let episode = app.create(solved).await;
    assert_eq!(app.show(&episode).await["status"], "waiting");
    let started = app.post(&episode.path("/start")).ok().await;
    assert_eq!(
        (&started["status"], &started["result"]["reason"]),
        (&json!("finished"), &json!("task_done"))
    );
}
