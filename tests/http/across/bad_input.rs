//! A wrong request gets the documented error and changes nothing.

use reqwest::Method;
use rstest::rstest;
use serde_json::{Value, json};

use crate::app::{Call, DOCUMENT, Episode, TestApp, check_problem, fields, list};

/// An episode in the middle of its second round: seat 0 has acted, seat 1 has not.
async fn playing(app: &TestApp) -> Episode {
    let request = json!({ "task": "Synchronization", "seed": 6, "num_agents": 2, "max_round": 4 });
    let episode = app.create(request).await;
    app.all_act(&episode, "SWITCH").await;
    app.act(episode.seat(0), &json!({ "round": 1, "action": "UP" })).await;
    episode
}

/// All that could have changed.
async fn everything(app: &TestApp, episode: &Episode) -> Value {
    let mut seen = Vec::new();
    for token in episode.seats() {
        seen.push(app.obs(token).await);
    }
    let episodes = app.get("/api/v1/episodes").ok().await;
    let journal = app.journal(episode).await;
    json!([seen, app.state(episode).await, app.swarm_obs(episode).await, episodes, journal])
}

/// Expects a request to be refused so, and nothing to have changed by it.
async fn refused(call: impl FnOnce(&TestApp, &Episode) -> Call, status: u16, code: &str) -> Value {
    let app = TestApp::start().await;
    let episode = playing(&app).await;
    let before = everything(&app, &episode).await;
    let problem = call(&app, &episode).problem(status, code).await;
    assert_eq!(everything(&app, &episode).await, before);
    problem
}

mod bodies {
    use super::*;

    /// The routes that take a body, and the token for each.
    fn post(app: &TestApp, episode: &Episode, route: &str) -> Call {
        let call = app.post(route);
        match route {
            "/act" => call.token(episode.seat(1)),
            "/swarm/act" => call.token(&episode.swarm),
            _ => call,
        }
    }

    #[rstest]
    #[case::empty(b"")]
    #[case::cut_off(br#"{"round": 1, "action": "UP""#)]
    #[case::two(br#"{"round": 1, "action": "UP"} {}"#)]
    #[case::single_quotes(b"{'round': 1}")]
    #[case::trailing_comma(br#"{"round": 1,}"#)]
    #[case::nan(br#"{"round": NaN}"#)]
    #[case::html(b"<html>")]
    #[case::not_utf8(b"{\"round\": 1, \"action\": \"\xff\"}")]
    #[case::half_a_character(b"{\"round\": 1, \"action\": \"\xc3\"}")]
    #[case::half_a_surrogate(br#"{"round": 1, "action": "\ud800"}"#)]
    #[case::byte_order_mark(b"\xef\xbb\xbf{}")]
    #[tokio::test]
    async fn a_body_that_is_no_json_is_malformed(
        #[values("/act", "/swarm/act", "/api/v1/episodes")] route: &str,
        #[case] body: &[u8],
    ) {
        refused(|app, episode| post(app, episode, route).body(body), 400, "malformed").await;
    }

    #[rstest]
    #[tokio::test]
    async fn json_nested_too_deep_is_malformed(#[values("/act", "/api/v1/episodes")] route: &str) {
        let body = format!("{{\"acts\": {}{}}}", "[".repeat(30_000), "]".repeat(30_000));
        refused(|app, episode| post(app, episode, route).body(body), 400, "malformed").await;
    }

    /// Bodies that nest deeper than any stack, at every route that takes one.
    #[tokio::test]
    async fn no_body_is_too_deep_for_the_server() {
        let app = TestApp::start().await;
        let episode = playing(&app).await;
        let bodies =
            ["[", "{\"agent_meta\":", "{\"params\":{\"_meta\":"].map(|open| open.repeat(4_000));
        for (path, item) in DOCUMENT["paths"].as_object().expect("paths") {
            let path = path.replace("{id}", &episode.id);
            let operations = item.as_object().expect("operations").iter();
            for (method, _) in operations.filter(|(_, said)| !said["requestBody"].is_null()) {
                let method = method.to_uppercase().parse::<Method>().expect("a method");
                for body in &bodies {
                    let call = app.call(method.clone(), &path).token(&episode.swarm);
                    let status = call.body(body.as_str()).send().await.status;
                    assert!((400..500).contains(&status), "{method} {path}: {status}");
                }
            }
        }
        app.obs(episode.seat(0)).await;
    }

    /// A refusal that quotes the body is not larger than the body.
    #[rstest]
    #[case::text(r#"{"name": "a", "model": "m", "temperature": "?"}"#)]
    #[case::words_of_the_refusal(r#"{"name": "a", "model": "m", "temperature": ", expected ?"}"#)]
    #[case::name(r#"{"name": "a", "model": "m", "?": 1}"#)]
    #[tokio::test]
    async fn a_refusal_quotes_the_beginning(#[case] body: &str) {
        let app = crate::cup::server().await;
        let cup = crate::cup::Cup::open(&app, json!({})).await;
        // In a text of Rust each of them takes eight bytes.
        let body = body.replace('?', &"\u{200b}".repeat(15_000));
        let answer = app.post(&cup.path("/entrants")).body(&*body).send().await;
        check_problem(&answer.json(), 422, "invalid");
        assert!(answer.body.len() < 16_000, "{} bytes", answer.body.len());
    }

    #[tokio::test]
    async fn an_act_nested_too_deep_is_malformed_for_itself() {
        let app = TestApp::start().await;
        let episode = playing(&app).await;
        let good = episode.act(&json!("Agent_1"), 1, "UP");
        let body = format!("{{\"acts\": [{}{}, {good}]}}", "[".repeat(60_000), "]".repeat(60_000));
        let receipts = post(&app, &episode, "/swarm/act").body(body).ok().await["receipts"].clone();
        check_problem(&receipts[0], 400, "malformed");
        assert_eq!(receipts[1]["waiting_for"], 0);
    }

    #[rstest]
    #[case(json!([]))]
    #[case(json!("UP"))]
    #[case(json!(null))]
    #[case(json!(1))]
    #[tokio::test]
    async fn a_body_that_is_no_object_is_invalid(
        #[values("/act", "/swarm/act", "/api/v1/episodes")] route: &str,
        #[case] body: Value,
    ) {
        refused(|app, episode| post(app, episode, route).json(&body), 422, "invalid").await;
    }

    #[rstest]
    #[case("/act", json!({ "round": 1, "action": "UP", "mesage": "m", "Reasoning": 1 }), &["Reasoning", "mesage"])]
    #[case("/act", json!({ "round": 1, "action": "UP", "usage": { "tokens": 1 } }), &["usage"])]
    #[case("/act", json!({ "round": 1, "action": "UP", "agent": "Agent_1" }), &["agent"])]
    #[case("/act", json!({ "round": "1", "action": "UP" }), &["round"])]
    #[case("/act", json!({ "round": -1, "action": "UP" }), &["round"])]
    #[case("/act", json!({ "round": 1.5, "action": "UP" }), &["round"])]
    #[case("/act", json!({ "round": 4_294_967_296_u64, "action": "UP" }), &["round"])]
    #[case("/act", json!({ "round": 1, "action": 3 }), &["action"])]
    #[case("/act", json!({ "round": 1, "action": "UP", "message": ["m"] }), &["message"])]
    #[case("/act", json!({ "round": 1, "response": {} }), &["response"])]
    #[case("/act", json!({ "round": 1, "action": "UP", "usage": { "latency_ms": -1 } }), &["usage"])]
    #[case("/act", json!({ "round": 1, "action": "UP", "reasoning": 7 }), &["reasoning"])]
    #[case("/act", json!({}), &["round"])]
    #[case("/swarm/act", json!({ "acts": [], "act": [] }), &["act"])]
    #[case("/swarm/act", json!({ "acts": "all" }), &["acts"])]
    #[case("/api/v1/episodes", json!({ "task": "Pursuit", "agents": 3 }), &["agents"])]
    #[case("/api/v1/episodes", json!({ "task": "Pursuit", "memory": "5" }), &["memory"])]
    #[case("/api/v1/episodes", json!({ "task": "Pursuit", "noise": "loud" }), &["noise"])]
    #[tokio::test]
    async fn fields_that_are_unknown_or_of_another_type_are_named(
        #[case] route: &str,
        #[case] body: Value,
        #[case] named: &[&str],
    ) {
        let call = |app: &TestApp, episode: &Episode| post(app, episode, route).json(&body);
        assert_eq!(fields(&refused(call, 422, "invalid").await), named);
    }

    #[tokio::test]
    async fn a_field_that_comes_twice_is_invalid() {
        let body = br#"{"round": 1, "action": "UP", "action": "DOWN"}"#;
        let call = |app: &TestApp, episode: &Episode| post(app, episode, "/act").body(body);
        let problem = refused(call, 422, "invalid").await;
        assert!(
            problem["detail"].as_str().is_some_and(|text| text.contains("`action`")),
            "{problem}"
        );
    }

    #[rstest]
    #[case("/act", 256 * 1024, "body_bytes_max")]
    #[case("/api/v1/episodes", 64 * 1024, "anonymous_body_bytes_max")]
    #[case("/swarm/act", 8 * 1024 * 1024, "swarm_body_bytes_max")]
    #[tokio::test]
    async fn a_body_beyond_the_limit_is_too_large(
        #[case] route: &str,
        #[case] limit: usize,
        #[case] name: &str,
        #[values(1, 3_000_000)] beyond: usize,
    ) {
        let call = |app: &TestApp, episode: &Episode| {
            post(app, episode, route).body(vec![b' '; limit + beyond])
        };
        let problem = refused(call, 413, "too_large").await;
        assert_eq!(problem["limit"], json!({ "name": name, "value": limit }));
    }

    #[tokio::test]
    async fn a_body_of_too_many_values_is_too_large() {
        let body = json!({ "suite": { "name": "s", "seeds": vec![1; 8200] }, "model": "m" });
        let call = |app: &TestApp, _: &Episode| app.post("/api/v1/runs").json(&body);
        let problem = refused(call, 413, "too_large").await;
        assert_eq!(problem["limit"], json!({ "name": "body_values_max", "value": 8192 }));
    }

    #[tokio::test]
    async fn a_body_at_the_limit_is_read() {
        let app = TestApp::start().await;
        let episode = playing(&app).await;
        let mut body = br#"{"round": 1, "action": "UP"}"#.to_vec();
        body.resize(256 * 1024, b' ');
        assert_eq!(post(&app, &episode, "/act").body(body).ok().await["waiting_for"], 0);
    }

    #[rstest]
    #[case(None, 415)]
    #[case(Some("text/plain"), 415)]
    #[case(Some("application/x-www-form-urlencoded"), 415)]
    #[case(Some("application/json; charset=utf-8"), 200)]
    #[case(Some("Application/JSON"), 200)]
    #[tokio::test]
    async fn a_body_says_that_it_is_json(#[case] kind: Option<&str>, #[case] status: u16) {
        let app = TestApp::start().await;
        let episode = playing(&app).await;
        let mut call = reqwest::Client::new()
            .post(format!("{}/act", app.base()))
            .bearer_auth(episode.seat(1))
            .body(r#"{"round": 1, "action": "UP"}"#);
        if let Some(kind) = kind {
            call = call.header("content-type", kind);
        }
        assert_eq!(call.send().await.expect("an answer").status().as_u16(), status);
        assert_eq!(app.state(&episode).await["round"], if status == 200 { 2 } else { 1 });
    }
}

mod tokens {
    use super::*;

    /// The routes that want a seat token, and those that want a swarm token.
    const SEAT: [&str; 2] = ["GET /obs", "POST /act"];
    const SWARM: [&str; 2] = ["GET /swarm/obs", "POST /swarm/act"];

    /// A request that would be good with the right token.
    fn request(app: &TestApp, episode: &Episode, route: &str) -> Call {
        let (method, path) = route.split_once(' ').expect("a method and a path");
        let call = app.call(method.parse().expect("a method"), path);
        match path {
            "/act" => call.json(&json!({ "round": 1, "action": "UP" })),
            "/swarm/act" => {
                call.json(&json!({ "acts": [episode.act(&json!("Agent_1"), 1, "UP")] }))
            }
            _ => call,
        }
    }

    #[rstest]
    #[tokio::test]
    async fn without_a_token_nothing_is_seen_or_done(
        #[values(SEAT[0], SEAT[1], SWARM[0], SWARM[1])] route: &str,
    ) {
        refused(|app, episode| request(app, episode, route), 401, "unauthorized").await;
    }

    #[rstest]
    #[case::nothing("")]
    #[case::no_scheme("seat_aaaa")]
    #[case::garbage("Bearer garbage")]
    #[case::empty("Bearer ")]
    #[case::checksum("Bearer seat_aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa")]
    #[case::basic("Basic c2VhdDpzZWF0")]
    #[case::long(&"x".repeat(4000))]
    #[tokio::test]
    async fn a_text_that_is_no_token_is_unknown(
        #[values(SEAT[0], SEAT[1], SWARM[0], SWARM[1], "GET /api/v1/episodes")] route: &str,
        #[case] header: &str,
    ) {
        let call = |app: &TestApp, episode: &Episode| {
            request(app, episode, route).header("authorization", header)
        };
        refused(call, 401, "unauthorized").await;
    }

    #[tokio::test]
    async fn a_refusal_asks_for_a_bearer_token() {
        let app = TestApp::start().await;
        assert_eq!(app.get("/obs").send().await.header("www-authenticate"), "Bearer");
    }

    #[rstest]
    #[tokio::test]
    async fn a_token_with_one_letter_changed_is_unknown(#[values(SEAT[0], SEAT[1])] route: &str) {
        let call = |app: &TestApp, episode: &Episode| {
            let mut token = episode.seat(1).to_owned();
            let last = token.pop().expect("a letter");
            token.push(if last == 'a' { 'b' } else { 'a' });
            request(app, episode, route).token(&token)
        };
        refused(call, 401, "unauthorized").await;
    }

    #[rstest]
    #[tokio::test]
    async fn a_swarm_token_is_none_for_a_seat(#[values(SEAT[0], SEAT[1])] route: &str) {
        let call =
            |app: &TestApp, episode: &Episode| request(app, episode, route).token(&episode.swarm);
        refused(call, 403, "forbidden").await;
    }

    #[rstest]
    #[tokio::test]
    async fn a_seat_token_is_none_for_the_swarm(#[values(SWARM[0], SWARM[1])] route: &str) {
        let call =
            |app: &TestApp, episode: &Episode| request(app, episode, route).token(episode.seat(1));
        refused(call, 403, "forbidden").await;
    }

    #[rstest]
    #[tokio::test]
    async fn a_token_of_an_episode_creates_no_other(#[values(false, true)] is_swarm: bool) {
        let call = |app: &TestApp, episode: &Episode| {
            let token = if is_swarm { &episode.swarm } else { episode.seat(0) };
            app.post("/api/v1/episodes").token(token).json(&json!({ "task": "Pursuit" }))
        };
        refused(call, 403, "forbidden").await;
    }

    #[tokio::test]
    async fn a_swarm_token_acts_for_no_other_episode() {
        let app = TestApp::start().await;
        let (one, other) = (playing(&app).await, playing(&app).await);
        let before = everything(&app, &one).await;
        let problems = app.swarm_act(&other, &[one.act(&json!("Agent_1"), 1, "UP")]).await;
        assert_eq!(problems[0]["code"], "not_found");
        assert_eq!(everything(&app, &one).await, before);
    }

    #[tokio::test]
    async fn revoked_tokens_are_unknown() {
        let app = TestApp::start().await;
        let create = || async {
            let request = json!({ "task": "Pursuit", "num_agents": 2 });
            let call = app.post("/api/v1/episodes").header("idempotency-key", "k").json(&request);
            Episode::of(&call.ok().await)
        };
        let lost = create().await;
        app.obs(lost.seat(1)).await;
        create().await;
        for route in SEAT {
            request(&app, &lost, route).token(lost.seat(1)).problem(401, "unauthorized").await;
        }
        for route in SWARM {
            request(&app, &lost, route).token(&lost.swarm).problem(401, "unauthorized").await;
        }
    }
}

mod rounds {
    use super::*;

    #[rstest]
    #[case::past(0, "already_acted")]
    #[case::next(2, "round_ahead")]
    #[case::beyond_the_end(4, "round_ahead")]
    #[case::largest(u64::from(u32::MAX), "round_ahead")]
    #[tokio::test]
    async fn an_act_for_another_round_is_a_conflict(#[case] round: u64, #[case] code: &str) {
        let act = json!({ "round": round, "action": "LEFT" });
        let call =
            |app: &TestApp, episode: &Episode| app.post("/act").token(episode.seat(1)).json(&act);
        assert_eq!(refused(call, 409, code).await["round"], 1);
    }

    #[tokio::test]
    async fn an_act_after_the_end_is_a_conflict() {
        let app = TestApp::start().await;
        let episode = playing(&app).await;
        app.delete(&episode.path("")).token(&episode.swarm).ok().await;
        let before = everything(&app, &episode).await;
        for (round, code) in [(0, "already_acted"), (1, "episode_over"), (2, "round_ahead")] {
            let act = json!({ "round": round, "action": "LEFT" });
            app.post("/act").token(episode.seat(1)).json(&act).problem(409, code).await;
        }
        assert_eq!(everything(&app, &episode).await, before);
    }
}

mod routes {
    use super::*;

    #[rstest]
    #[case("GET", "/api/v1/episodes/ep_0")]
    #[case("GET", "/api/v1/episodes/0")]
    #[case("GET", "/api/v1/episodes/%FF")]
    #[case("GET", "/api/v1/episodes/..%2F..%2Fetc")]
    #[case("GET", "/api/v1/episodes/' OR 1=1 --")]
    #[case("GET", "/api/v1/episodes/ep_0/state")]
    #[case("GET", "/api/v1/episodes/ep_0/events")]
    #[case("GET", "/api/v1/episodes/ep_0/journal")]
    #[case("POST", "/api/v1/episodes/ep_0/start")]
    #[case("DELETE", "/api/v1/episodes/ep_0")]
    #[case::no_route("GET", "/nothing")]
    #[case::no_route("GET", "/obs/")]
    #[case::no_route("GET", "/OBS")]
    #[case::no_route("GET", "/api/v2/episodes")]
    #[case::no_route("POST", "/api/v1/episodes/ep_0/stop")]
    #[tokio::test]
    async fn what_does_not_exist_is_not_found(#[case] method: &str, #[case] path: &str) {
        let method = method.parse().expect("a method");
        refused(|app, _| app.call(method, path), 404, "not_found").await;
    }

    #[rstest]
    #[case("POST", "/obs", "GET")]
    #[case("GET", "/act", "POST")]
    #[case("PUT", "/act", "POST")]
    #[case("DELETE", "/swarm/obs", "GET")]
    #[case("GET", "/swarm/act", "POST")]
    #[case("PATCH", "/api/v1/episodes", "GET")]
    #[case("POST", "/api/v1/episodes/ep_0", "DELETE")]
    #[case("POST", "/healthz", "GET")]
    #[tokio::test]
    async fn a_method_that_a_route_has_not_is_named(
        #[case] method: &str,
        #[case] path: &str,
        #[case] allowed: &str,
    ) {
        let app = TestApp::start().await;
        let call = || app.call(method.parse().expect("a method"), path);
        let problem = call().problem(405, "method_not_allowed").await;
        assert!(problem["detail"].as_str().is_some_and(|text| text.contains(method)), "{problem}");
        let answer = call().send().await;
        let named: Vec<_> = answer.header("allow").split(',').map(str::trim).collect();
        assert!(named.contains(&allowed), "{named:?}");
    }

    #[rstest]
    #[case("wait=61")]
    #[case("wait=-0.5")]
    #[case("wait=NaN")]
    #[case("wait=inf")]
    #[case("wait=soon")]
    #[case("after=-1")]
    #[case("after=4294967296")]
    #[case("after=")]
    #[case("prompt=maybe")]
    #[case("token=seat_x")]
    #[case("after=1&after=2")]
    #[tokio::test]
    async fn a_bad_query_is_malformed(#[case] query: &str) {
        let call = |app: &TestApp, episode: &Episode| {
            app.get(&format!("/obs?{query}")).token(episode.seat(1))
        };
        refused(call, 400, "malformed").await;
    }

    #[rstest]
    #[case("wait=61")]
    #[case("wait=x")]
    #[case("after=1")]
    #[tokio::test]
    async fn an_act_with_a_bad_query_is_not_taken(#[case] query: &str) {
        let act = json!({ "round": 1, "action": "UP" });
        let call = |app: &TestApp, episode: &Episode| {
            app.post(&format!("/act?{query}")).token(episode.seat(1)).json(&act)
        };
        refused(call, 400, "malformed").await;
    }

    #[rstest]
    #[case("POST", "/swarm/act")]
    #[case("POST", "/api/v1/episodes")]
    #[case("GET", "/api/v1/episodes/{id}")]
    #[case("DELETE", "/api/v1/episodes/{id}")]
    #[case("POST", "/api/v1/episodes/{id}/start")]
    #[case("GET", "/api/v1/episodes/{id}/state")]
    #[case("GET", "/api/v1/episodes/{id}/events")]
    #[case("GET", "/api/v1/episodes/{id}/journal")]
    #[case("GET", "/api/v1/episodes/{id}/replay")]
    #[case("GET", "/api/v1/episodes/{id}/rounds/0/agents/Agent_0")]
    #[case("GET", "/api/v1/episodes/{id}/scores")]
    #[case("GET", "/api/v1/episodes/{id}/verification")]
    #[tokio::test]
    async fn an_unknown_query_field_is_malformed_everywhere(
        #[case] method: &str,
        #[case] path: &str,
    ) {
        let call = |app: &TestApp, episode: &Episode| {
            let path = format!("{}?verbose=1", path.replace("{id}", &episode.id));
            let call =
                app.call(method.parse().expect("a method"), &path).json(&json!({ "acts": [] }));
            if path.starts_with("/swarm") { call.token(&episode.swarm) } else { call }
        };
        let problem = refused(call, 400, "malformed").await;
        assert!(
            problem["detail"].as_str().is_some_and(|text| text.contains("verbose")),
            "{problem}"
        );
    }

    #[tokio::test]
    async fn a_wait_beyond_the_limit_names_it() {
        let call =
            |app: &TestApp, episode: &Episode| app.get("/obs?wait=61").token(episode.seat(1));
        let problem = refused(call, 400, "malformed").await;
        assert_eq!(problem["limit"], json!({ "name": "wait_s_max", "value": 60 }));
    }
}

/// Everything in one: a program that tries anything leaves the server as it was.
#[tokio::test]
async fn a_server_that_was_asked_nonsense_plays_on() {
    let app = TestApp::start().await;
    let episode = playing(&app).await;
    let before = everything(&app, &episode).await;
    let paths = ["/obs", "/act", "/swarm/obs", "/swarm/act", "/api/v1/episodes", "/x"];
    let bodies: [&[u8]; 6] = [b"", b"{}", b"[]", b"null", b"\xff", b"{\"acts\":[{}]}"];
    for path in paths {
        for body in bodies {
            for method in ["GET", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"] {
                let call = app.call(method.parse().expect("a method"), path);
                let answer = call.token(&episode.swarm).body(body).send().await;
                assert!(answer.status < 500, "{method} {path} {body:?}: {}", answer.text());
            }
        }
    }
    assert_eq!(everything(&app, &episode).await, before);
    assert_eq!(list(&before[0]).len(), 2);
    app.all_act(&episode, "STAY").await;
    assert_eq!(app.state(&episode).await["round"], 2);
}
