//! `POST /swarm/act`: the acts of several seats in one call.

use rstest::rstest;
use serde_json::{Value, json};

use super::{agents, look};
use crate::across::vectors;
use crate::app::{TestApp, check_problem, fields, game, list, number};

#[tokio::test]
async fn receipts_come_in_the_order_of_the_acts() {
    let app = TestApp::start().await;
    let episode = app.create(game(4, 2)).await;
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
    let episode = app.create(game(3, 2)).await;
    let other = app.create(game(3, 2)).await;
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
    let episode = app.create(game(2, 4)).await;
    let act = |seat: u32, round: u64| episode.act(&json!(format!("Agent_{seat}")), round, "STAY");
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
    let episode = app.create(game(2, 2)).await;
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
    let episode = app.create(game(2, 2)).await;
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
    let episode = app.create(game(2, 2)).await;
    let call = app.post("/swarm/act").token(&episode.swarm).body(body);
    let problem = call.problem(422, "invalid").await;
    if !named.is_empty() {
        assert_eq!(fields(&problem), named);
    }
}
