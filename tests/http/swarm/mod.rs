//! `GET /swarm/obs` and `POST /swarm/act`: several seats in one call.

use rstest::rstest;
use serde_json::{Value, json};

use crate::across::vectors;
use crate::app::{Episode, TestApp, check_problem, fields, list, number};

fn request(agents: u32, rounds: u32) -> Value {
    json!({ "task": "Synchronization", "num_agents": agents, "max_round": rounds })
}

async fn look(app: &TestApp, episode: &Episode, query: &str) -> Value {
    app.get(&format!("/swarm/obs{query}")).token(&episode.swarm).ok().await
}

fn agents(looked: &Value) -> Vec<String> {
    let name = |seen: &Value| seen["agent"].as_str().expect("a name").to_owned();
    list(&looked["observations"]).iter().map(name).collect()
}

fn cursor(looked: &Value) -> &str {
    looked["cursor"].as_str().expect("a cursor")
}

mod looking {
    use super::*;

    #[tokio::test]
    async fn the_observations_are_those_of_obs() {
        let app = TestApp::start().await;
        let episode = app.create(request(3, 2)).await;
        let looked = look(&app, &episode, "").await;
        assert_eq!(looked["finished"], false);
        let mut alone = Vec::new();
        for token in episode.seats() {
            alone.push(app.obs(token).await);
        }
        assert_eq!(looked["observations"], json!(alone));
    }

    #[tokio::test]
    async fn only_seats_that_wait_for_an_act_are_shown() {
        let app = TestApp::start().await;
        let episode = app.create(request(4, 2)).await;
        for acting in [2, 0] {
            app.act(episode.seat(acting), &json!({ "round": 0, "action": "STAY" })).await;
        }
        assert_eq!(agents(&look(&app, &episode, "").await), ["Agent_1", "Agent_3"]);
    }

    #[tokio::test]
    async fn a_cursor_shows_only_what_was_opened_since() {
        let app = TestApp::start().await;
        let episode = app.create(request(5, 3)).await;
        let mut seen = Vec::new();
        let mut place = String::new();
        for expected in [2, 2, 1, 0] {
            let looked = look(&app, &episode, &format!("?limit=2{place}")).await;
            assert_eq!(agents(&looked).len(), expected);
            seen.extend(agents(&looked));
            place = format!("&after={}", cursor(&looked));
        }
        assert_eq!(seen, ["Agent_0", "Agent_1", "Agent_2", "Agent_3", "Agent_4"]);
        // One act opens nothing; the last one opens the next round for all.
        let act = |seat: usize| episode.act(&json!(format!("Agent_{seat}")), 0, "STAY");
        app.swarm_act(&episode, &[act(3)]).await;
        assert!(agents(&look(&app, &episode, &format!("?{}", &place[1..])).await).is_empty());
        app.swarm_act(&episode, &[act(0), act(1), act(2), act(4)]).await;
        let looked = look(&app, &episode, &format!("?{}", &place[1..])).await;
        assert_eq!(agents(&looked), seen);
        assert!(list(&looked["observations"]).iter().all(|seen| seen["round"] == 1));
        // Without the cursor all that wait are shown, again and again.
        assert_eq!(agents(&look(&app, &episode, "").await), seen);
    }

    #[tokio::test]
    async fn a_wait_ends_when_a_round_is_opened() {
        let app = TestApp::with_manual_clock().await;
        let episode = app.create(request(2, 2)).await;
        let looked = look(&app, &episode, "?wait=60").await;
        assert_eq!(agents(&looked).len(), 2, "what waits already is not waited for");
        let place = format!("?wait=60&after={}", cursor(&looked));
        let (looked, _) = tokio::join!(look(&app, &episode, &place), app.all_act(&episode, "STAY"));
        assert_eq!(looked["observations"][0]["round"], 1);
        assert_eq!(agents(&looked).len(), 2);
    }

    #[tokio::test]
    async fn a_wait_is_empty_when_the_time_is_up() {
        let app = TestApp::with_manual_clock().await;
        let episode = app.create(request(2, 2)).await;
        let place = cursor(&look(&app, &episode, "").await).to_owned();
        let wait = app.get(&format!("/swarm/obs?wait=10&after={place}")).token(&episode.swarm);
        let looked = app.pass_until(tokio::spawn(wait.ok())).await;
        assert_eq!((agents(&looked).len(), &looked["finished"]), (0, &json!(false)));
        assert_eq!(cursor(&looked), place);
    }

    #[tokio::test]
    async fn a_waiting_episode_shows_its_seats_once_it_is_started() {
        let app = TestApp::with_manual_clock().await;
        let mut request = request(2, 2);
        request["start"] = json!("manual");
        let episode = app.create(request).await;
        assert!(agents(&look(&app, &episode, "").await).is_empty());
        let start = app.post(&episode.path("/start")).token(&episode.swarm);
        let (looked, _) = tokio::join!(look(&app, &episode, "?wait=60"), start.ok());
        assert_eq!(agents(&looked).len(), 2);
        assert_eq!(looked["observations"][0]["status"], "running");
    }

    #[tokio::test]
    async fn a_finished_episode_says_so_without_a_wait() {
        let app = TestApp::with_manual_clock().await;
        let episode = app.create(request(2, 1)).await;
        let place = cursor(&look(&app, &episode, "").await).to_owned();
        app.all_act(&episode, "STAY").await;
        for query in ["?wait=60".to_owned(), format!("?wait=60&after={place}")] {
            let looked = look(&app, &episode, &query).await;
            assert_eq!((agents(&looked).len(), &looked["finished"]), (0, &json!(true)));
        }
    }

    #[tokio::test]
    async fn a_cursor_of_an_earlier_run_of_the_server_shows_everything() {
        let mut app = TestApp::start().await;
        let episode = app.create(request(3, 2)).await;
        app.all_act(&episode, "STAY").await;
        let place = cursor(&look(&app, &episode, "").await).to_owned();
        app.restart().await;
        let looked = look(&app, &episode, &format!("?after={place}")).await;
        assert_eq!(agents(&looked).len(), 3);
    }

    #[tokio::test]
    async fn a_page_has_256_observations_where_nobody_says_how_many() {
        let app = TestApp::start().await;
        let request = json!({
            "task": "Synchronization", "num_agents": 300, "width": 20, "height": 20,
            "memory": 0, "view_size": 3, "max_round": 1,
        });
        let episode = app.create(request).await;
        let looked = look(&app, &episode, "").await;
        assert_eq!(agents(&looked).len(), 256);
        let rest = look(&app, &episode, &format!("?after={}", cursor(&looked))).await;
        assert_eq!(agents(&rest).len(), 44);
        assert_eq!(agents(&look(&app, &episode, "?limit=1024").await).len(), 300);
    }

    #[rstest]
    #[case("limit=0")]
    #[case("limit=1025")]
    #[case("limit=many")]
    #[case("wait=60.5")]
    #[case("wait=-1")]
    #[case("after=here")]
    #[case("after=0.1.2.3")]
    #[case("after=zz.1.2")]
    #[case("round=1")]
    #[tokio::test]
    async fn a_bad_query_is_malformed(#[case] query: &str) {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 2)).await;
        let call = app.get(&format!("/swarm/obs?{query}")).token(&episode.swarm);
        call.problem(400, "malformed").await;
    }
}

mod acting {
    use super::*;

    #[tokio::test]
    async fn receipts_come_in_the_order_of_the_acts() {
        let app = TestApp::start().await;
        let episode = app.create(request(4, 2)).await;
        let order = [2, 0, 3, 1];
        let act = |seat: &u32| episode.act(&json!(format!("Agent_{seat}")), 0, "STAY");
        let receipts = app.swarm_act(&episode, &order.iter().map(act).collect::<Vec<_>>()).await;
        for ((receipt, seat), left) in receipts.iter().zip(order).zip([3, 2, 1, 0]) {
            let expected = json!({
                "episode": episode.id, "agent": format!("Agent_{seat}"), "round": 0, "action": "STAY",
                "message": null, "valid": true, "duplicate": false, "waiting_for": left,
            });
            assert_eq!(receipt, &expected);
        }
        assert_eq!(app.state(&episode).await["round"], 1);
    }

    #[tokio::test]
    async fn each_act_is_taken_or_refused_for_itself() {
        let app = TestApp::start().await;
        let episode = app.create(request(3, 2)).await;
        let other = app.create(request(3, 2)).await;
        let act = |agent: &str, round: u64, action: &str| episode.act(&json!(agent), round, action);
        let mut unknown_field = act("Agent_2", 0, "UP");
        unknown_field["speed"] = json!(2);
        let mut too_large = act("Agent_2", 0, "UP");
        too_large["reasoning"] = json!("x".repeat(256 * 1024));
        let mut no_round = act("Agent_2", 0, "UP");
        no_round.as_object_mut().expect("an object").remove("round");
        let good = act("Agent_0", 0, "UP");
        let refused = |status: u16, code: &'static str, fields: &'static [&'static str]| {
            Err((status, code, fields))
        };
        let table = [
            (act("Agent_3", 0, "UP"), refused(404, "not_found", &[])),
            (act("agent_0", 0, "UP"), refused(404, "not_found", &[])),
            (other.act(&json!("Agent_0"), 0, "UP"), refused(404, "not_found", &[])),
            (good.clone(), Ok(false)),
            (good.clone(), Ok(true)),
            (act("Agent_0", 0, "DOWN"), refused(409, "already_acted", &[])),
            (act("Agent_1", 1, "UP"), refused(409, "round_ahead", &[])),
            (act("Agent_1", 0, "JUMP"), refused(422, "invalid", &["action"])),
            (unknown_field, refused(422, "invalid", &["speed"])),
            (no_round, refused(422, "invalid", &["round"])),
            (json!(17), refused(422, "invalid", &[])),
            (json!({}), refused(422, "invalid", &["episode"])),
            (
                act("Agent_2", 0, "UP").as_object().map(|_| json!([1])).expect("an object"),
                refused(422, "invalid", &[]),
            ),
            (too_large, refused(413, "too_large", &[])),
            (act("Agent_1", 0, "UP"), Ok(false)),
        ];
        let acts: Vec<Value> = table.iter().map(|(act, _)| act.clone()).collect();
        let receipts = app.swarm_act(&episode, &acts).await;
        assert_eq!(receipts.len(), table.len());
        for (receipt, (act, expected)) in receipts.iter().zip(&table) {
            match expected {
                Ok(duplicate) => assert_eq!(receipt["duplicate"], *duplicate, "{act}: {receipt}"),
                Err((status, code, named)) => {
                    check_problem(receipt, *status, code);
                    if !named.is_empty() {
                        assert_eq!(fields(receipt), *named, "{act}");
                    }
                }
            }
        }
        assert_eq!(agents(&look(&app, &episode, "").await), ["Agent_2"]);
        assert_eq!(agents(&look(&app, &other, "").await).len(), 3, "the other has lost nothing");
    }

    #[tokio::test]
    async fn acts_for_the_next_round_may_follow_in_the_same_call() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 4)).await;
        let act =
            |seat: u32, round: u64| episode.act(&json!(format!("Agent_{seat}")), round, "STAY");
        let acts = [act(0, 0), act(1, 0), act(0, 1), act(1, 1), act(0, 0)];
        let receipts = app.swarm_act(&episode, &acts).await;
        // The round is resolved once the call was taken as a whole, so the next is not open yet.
        for receipt in &receipts[..2] {
            assert_eq!(receipt["duplicate"], false);
        }
        for problem in &receipts[2..4] {
            check_problem(problem, 409, "round_ahead");
        }
        assert_eq!(receipts[4]["duplicate"], true);
        assert_eq!(app.state(&episode).await["round"], 1);
        let receipts = app.swarm_act(&episode, &acts[2..4]).await;
        assert!(receipts.iter().all(|receipt| receipt["duplicate"] == false));
    }

    #[tokio::test]
    async fn an_escaped_seat_among_others_refuses_only_its_own() {
        let app = TestApp::start().await;
        let (config, rounds) = vectors::recorded_transport();
        let episode = app.create(config).await;
        let everybody = rounds[0].len();
        for (round, acts) in (0..).zip(&rounds) {
            let mut sent = vectors::acts(&episode, round, acts);
            let gone: Vec<_> = (0..everybody)
                .map(|seat| format!("Agent_{seat}"))
                .filter(|agent| !acts.contains_key(agent))
                .collect();
            sent.extend(gone.iter().map(|agent| episode.act(&json!(agent), round, "STAY")));
            let receipts = app.swarm_act(&episode, &sent).await;
            let (taken, refused) = receipts.split_at(acts.len());
            assert!(taken.iter().all(|receipt| receipt["duplicate"] == false));
            for problem in refused {
                check_problem(problem, 409, "episode_over");
            }
        }
        assert_eq!(app.show(&episode).await["status"], "finished");
    }

    #[tokio::test]
    async fn at_most_1024_acts_are_taken_at_once() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 2)).await;
        let act = episode.act(&json!("Agent_0"), 0, "STAY");
        let body = |count: usize| json!({ "acts": vec![act.clone(); count] });
        let call = || app.post("/swarm/act").token(&episode.swarm);
        let problem = call().json(&body(1025)).problem(413, "too_large").await;
        assert_eq!(problem["limit"], json!({ "name": "acts_max", "value": 1024 }));
        assert_eq!(app.obs(episode.seat(0)).await["acted"], false);
        let receipts = list(&call().json(&body(1024)).ok().await["receipts"]);
        let fresh = receipts.iter().filter(|receipt| receipt["duplicate"] == false);
        assert_eq!((receipts.len(), fresh.count()), (1024, 1));
        assert!(call().json(&body(0)).ok().await["receipts"] == json!([]));
    }

    #[tokio::test]
    async fn a_body_has_at_most_8_mib() {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 2)).await;
        let act = episode.act(&json!("Agent_0"), 0, "STAY");
        let mut body = json!({ "acts": [act] }).to_string().into_bytes();
        let limit = 8 * 1024 * 1024;
        body.resize(limit + 1, b' ');
        let call = |body: &[u8]| app.post("/swarm/act").token(&episode.swarm).body(body);
        let problem = call(&body).problem(413, "too_large").await;
        assert_eq!(problem["limit"], json!({ "name": "swarm_body_bytes_max", "value": limit }));
        assert_eq!(app.obs(episode.seat(0)).await["acted"], false);
        let receipts = call(&body[..limit]).ok().await["receipts"].clone();
        assert_eq!(number(&receipts[0]["waiting_for"]), 1);
    }

    #[rstest]
    #[case("{}", &["acts"])]
    #[case("{\"acts\": 3}", &["acts"])]
    #[case("{\"acts\": {}}", &["acts"])]
    #[case("{\"acts\": [], \"wait\": 5}", &["wait"])]
    #[case("[]", &[])]
    #[tokio::test]
    async fn a_broken_envelope_fails_as_a_whole(#[case] body: &str, #[case] named: &[&str]) {
        let app = TestApp::start().await;
        let episode = app.create(request(2, 2)).await;
        let call = app.post("/swarm/act").token(&episode.swarm).body(body);
        let problem = call.problem(422, "invalid").await;
        if !named.is_empty() {
            assert_eq!(fields(&problem), named);
        }
    }
}
