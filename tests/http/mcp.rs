//! `/mcp`: the tools of a seat, as a client of the protocol calls them.

use std::time::Duration;

use rstest::rstest;
use serde_json::{Value, json};

use crate::app::mcp::{observed, read, request, result, tool_call, tool_error};
use crate::app::{Call, Episode, TestApp, game, list, texts, until, verified};

/// The other agent acts.
async fn other_acts(app: &TestApp, episode: &Episode, round: u64) {
    app.act(episode.seat(1), &json!({ "round": round, "action": "STAY" })).await;
}

#[rstest]
#[case("2025-03-26")]
#[case("2025-11-25")]
#[tokio::test]
async fn it_introduces_itself_without_a_token(#[case] version: &str) {
    let app = TestApp::start().await;
    let hello = json!({
        "protocolVersion": version, "capabilities": {}, "clientInfo": { "name": "a test", "version": "1" }
    });
    let said = result(&app.mcp(&request("initialize", &hello)).send().await);
    assert_eq!(said["protocolVersion"], version);
    assert_eq!(said["serverInfo"]["name"], "swarmbench");
    assert!(said["instructions"].as_str().is_some_and(|text| text.contains("`look`")), "{said}");
    let note = json!({ "jsonrpc": "2.0", "method": "notifications/initialized" });
    let noted = app.mcp(&note).send().await;
    assert_eq!((noted.status, noted.body.len()), (202, 0));
    let tools = result(&app.mcp(&request("tools/list", &json!({}))).send().await);
    let tools = list(&tools["tools"]);
    assert_eq!(texts(&tools, "name"), ["look", "act"]);
    let hints = |tool: &Value| {
        ["readOnlyHint", "destructiveHint", "idempotentHint", "openWorldHint"]
            .map(|hint| tool["annotations"][hint].as_bool().expect("a hint"))
    };
    assert_eq!(hints(&tools[0]), [true, false, true, false]);
    assert_eq!(hints(&tools[1]), [false, false, true, false]);
    assert_eq!(tools[1]["inputSchema"]["required"], json!(["round", "action"]));
    assert_eq!(tools[1]["inputSchema"]["properties"]["wait_s"]["maximum"], 45);
    assert_eq!(tools[1]["inputSchema"]["additionalProperties"], false);
}

#[tokio::test]
async fn the_newest_version_needs_no_handshake() {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 2)).await;
    let version = "2026-07-28";
    let meta = json!({
        "io.modelcontextprotocol/protocolVersion": version,
        "io.modelcontextprotocol/clientInfo": { "name": "a test", "version": "1" },
        "io.modelcontextprotocol/clientCapabilities": {},
    });
    let params = json!({ "name": "look", "arguments": {}, "_meta": meta });
    let call = app.mcp(&request("tools/call", &params)).header("mcp-protocol-version", version);
    let call = call.header("mcp-method", "tools/call").header("mcp-name", "look");
    let seen = observed(&result(&call.token(episode.seat(0)).send().await));
    assert_eq!(seen["agent"], "Agent_0");
}

#[tokio::test]
async fn it_has_the_rules_and_a_prompt_to_play() {
    let app = TestApp::start().await;
    let ask = async |method: &str, params: Value| {
        result(&app.mcp(&request(method, &params)).send().await)
    };
    let listed = ask("resources/list", json!({})).await;
    assert_eq!(texts(&list(&listed["resources"]), "uri"), ["swarmbench://rules"]);
    let rules = ask("resources/read", json!({ "uri": "swarmbench://rules" })).await;
    let file = std::fs::read_to_string("docs/rules.md").expect("the rules");
    assert_eq!(rules["contents"][0]["text"], file);
    let listed = ask("prompts/list", json!({})).await;
    assert_eq!(texts(&list(&listed["prompts"]), "name"), ["play"]);
    let play = ask("prompts/get", json!({ "name": "play" })).await;
    let text = play["messages"][0]["content"]["text"].as_str().expect("a text");
    assert!(text.contains("`look`") && text.contains("`act`"), "{text}");
}

#[tokio::test]
async fn a_look_is_the_observation_with_its_prompt() {
    let app = TestApp::start().await;
    for task in ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"] {
        let episode = app.create(json!({ "task": task, "seed": 5 })).await;
        for seat in [0, 7] {
            let token = episode.seat(seat);
            let looked = app.tool(token, "look", json!({})).await;
            let seen = app.get("/obs?prompt=true").token(token).ok().await;
            assert_eq!(observed(&looked), seen);
            let [prompt, next] = <[String; 2]>::try_from(read(&looked)).expect("two texts");
            assert_eq!(prompt, seen["prompt"]);
            assert!(next.starts_with("Round 0 is open"), "{next}");
        }
    }
}

#[tokio::test]
async fn a_game_is_played_to_its_end_by_the_texts_alone() {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 3)).await;
    let token = episode.seat(0);
    for round in 0..3 {
        let looked = read(&app.tool(token, "look", json!({ "wait_s": 45 })).await);
        assert!(looked[1].contains(&format!("Round {round} is open")), "{looked:?}");
        other_acts(&app, &episode, round).await;
        let act = json!({ "round": round, "action": "SWITCH", "message": "on" });
        let acted = app.tool(token, "act", act).await;
        let texts = read(&acted);
        assert_eq!(texts[0], format!("Round {round}: SWITCH, message \"on\" is recorded."));
        let receipt = &acted["structuredContent"];
        assert_eq!((&receipt["round"], &receipt["duplicate"]), (&json!(round), &json!(false)));
        let seen = app.get("/obs?prompt=true").token(token).ok().await;
        assert_eq!(receipt["obs"], seen);
        if round < 2 {
            assert_eq!(texts[1], seen["prompt"]);
            assert!(texts[2].contains(&format!("Round {} is open", round + 1)), "{texts:?}");
        } else {
            assert!(
                texts[1].starts_with("The game is over (finished) after round 3 of 3."),
                "{texts:?}"
            );
        }
    }
    let looked = read(&app.tool(token, "look", json!({ "wait_s": 45 })).await);
    assert_eq!(looked.len(), 1);
    assert!(looked[0].contains("Nothing is left to do"), "{looked:?}");
    assert_eq!(verified(&app.journal(&episode).await).rounds, 3);
}

#[tokio::test]
async fn the_same_act_again_is_no_second_move() {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 3)).await;
    let act = json!({ "round": 0, "action": "UP", "wait_s": 0 });
    let first = app.tool(episode.seat(0), "act", act.clone()).await;
    assert!(read(&first)[1].starts_with("You have acted in round 0"), "{first}");
    let again = app.tool(episode.seat(0), "act", act.clone()).await;
    assert_eq!(again["structuredContent"]["duplicate"], true);
    assert_eq!(read(&again)[0], "Round 0: UP had been recorded before; it counts once.");
    // Acts of the wire and of the tools are the same acts.
    let by_wire = app.act(episode.seat(0), &json!({ "round": 0, "action": "UP" })).await;
    assert_eq!(by_wire["duplicate"], true);
    other_acts(&app, &episode, 0).await;
    let late = app.tool(episode.seat(0), "act", act).await;
    assert_eq!(late["structuredContent"]["duplicate"], true);
    assert!(read(&late)[2].contains("Round 1 is open"), "{late}");
}

#[tokio::test]
async fn refusals_are_results_that_say_what_to_do() {
    let app = TestApp::builder().keys().start().await;
    let episode = app.create_with(&app.organizer, game(2, 3)).await;
    let nothing = result(&app.mcp(&tool_call("look", &json!({}))).send().await);
    for (token, status, expected) in [
        ("", 401, "Send a seat token as `Authorization: Bearer TOKEN`."),
        ("seat_nonsense", 401, "The token is unknown, was replaced or revoked, or has expired."),
        (episode.swarm.as_str(), 403, "This is a swarm token; use /swarm/obs"),
        (app.organizer.as_str(), 403, "A key holds no seat; send the seat token"),
    ] {
        for (tool, arguments) in
            [("look", json!({})), ("act", json!({ "round": 0, "action": "UP" }))]
        {
            let refused = match token {
                "" if tool == "look" => nothing.clone(),
                "" => result(&app.mcp(&tool_call(tool, &arguments)).send().await),
                token => app.tool(token, tool, arguments).await,
            };
            let said = tool_error(&refused);
            assert!(
                said.starts_with(expected) && said.contains("it needs the seat token"),
                "{said}"
            );
            assert_eq!(refused["structuredContent"]["status"], status);
        }
    }
    let token = episode.seat(0);
    for (arguments, expected) in [
        (
            json!({ "round": 0, "action": "FLY" }),
            "Action must be one of UP, DOWN, LEFT, RIGHT, STAY, SWITCH, is \"FLY\". Nothing was recorded",
        ),
        (json!({ "round": 1, "action": "UP" }), "round 1 is not open yet"),
        (json!({ "action": "UP" }), "round is missing. Nothing was done"),
        (
            json!({ "round": 0, "action": "UP", "wait_s": 60 }),
            "wait_s must be from 0 to 45 seconds",
        ),
        (json!({ "round": 0, "action": "UP", "to": "Agent_1" }), "To is for the commander"),
        (json!({ "round": 0, "action": "UP", "response": "UP" }), "response is unknown"),
    ] {
        let said = tool_error(&app.tool(token, "act", arguments).await);
        assert!(said.to_lowercase().contains(&expected.to_lowercase()), "{said}");
    }
    assert_eq!(app.obs(token).await["acted"], false, "none of it was an act");
    app.tool(token, "act", json!({ "round": 0, "action": "UP", "wait_s": 0 })).await;
    let other = app.tool(token, "act", json!({ "round": 0, "action": "DOWN" })).await;
    assert_eq!(other["structuredContent"]["code"], "already_acted");
    assert!(tool_error(&other).contains("Call `look` and continue"), "{other}");
    app.delete(&episode.path("")).token(&app.organizer).ok().await;
    let over = app.tool(episode.seat(1), "act", json!({ "round": 0, "action": "UP" })).await;
    assert_eq!(over["structuredContent"]["code"], "episode_over");
    let looked = read(&app.tool(token, "look", json!({})).await);
    assert!(looked[0].starts_with("The game is over (aborted)"), "{looked:?}");
}

#[tokio::test]
async fn what_does_not_exist_is_an_error_of_the_protocol() {
    let app = TestApp::start().await;
    for (method, params, expected) in [
        ("tools/call", json!({ "name": "fly", "arguments": {} }), "the tools are look and act"),
        ("resources/read", json!({ "uri": "swarmbench://seed" }), "there is swarmbench://rules"),
        ("prompts/get", json!({ "name": "win" }), "there is play"),
    ] {
        let answer = app.mcp(&request(method, &params)).send().await.json();
        let said = answer["error"]["message"].as_str().expect("an error");
        assert!(said.contains(expected), "{said}");
    }
    let answer = app.mcp(&request("tools/forget", &json!({}))).send().await.json();
    assert_eq!(answer["error"]["code"], -32601);
}

#[tokio::test]
async fn bodies_that_are_none_are_refused() {
    let app = TestApp::start().await;
    for (body, code) in [
        ("", -32700),
        ("{", -32700),
        ("7", -32600),
        ("{}", -32600),
        ("[]", -32600),
        (r#"[{"jsonrpc":"2.0","id":1,"method":"ping"}]"#, -32600),
    ] {
        let answer = app.post("/mcp").body(body).send().await;
        assert_eq!(
            (answer.status, answer.json()["error"]["code"].clone()),
            (400, json!(code)),
            "{body}"
        );
    }
    let episode = app.create(game(2, 2)).await;
    let seat = Some(episode.seat(0));
    for (bytes, token, name, most) in [
        (256 * 1024, seat, "body_bytes_max", 256 * 1024),
        (16 * 1024, None, "mcp_anonymous_body_bytes_max", 16 * 1024),
        (16 * 1024, Some("seat_unknown"), "mcp_anonymous_body_bytes_max", 16 * 1024),
        (16 * 1024, Some(&*episode.swarm), "mcp_anonymous_body_bytes_max", 16 * 1024),
    ] {
        let act = json!({ "round": 0, "action": "UP", "message": "x".repeat(bytes) });
        let call = app.mcp(&tool_call("act", &act));
        let call = token.into_iter().fold(call, Call::token);
        let problem = call.problem(413, "too_large").await;
        assert_eq!(problem["limit"], json!({ "name": name, "value": most }));
    }
    let values = json!({ "wait_s": vec![0; 300] });
    let refused = app.mcp(&tool_call("look", &values)).send().await;
    assert_eq!(refused.status, 400);
    assert!(refused.text().contains("(mcp_values_max)"), "{}", refused.text());
    for method in ["GET", "DELETE", "PUT"] {
        let method = method.parse().expect("a method");
        let answer = app.call(method, "/mcp").send().await;
        assert_eq!((answer.status, answer.header("allow")), (405, "POST"));
    }
}

#[tokio::test]
async fn what_clients_add_to_a_call_does_not_matter() {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 2)).await;
    let meta = json!({ "progressToken": 1, "example.com/trace": vec![json!({ "": 0 }); 10_000] });
    let params = json!({ "name": "look", "arguments": {}, "_meta": meta, "task": meta });
    let seen = observed(&result(
        &app.mcp(&request("tools/call", &params)).token(episode.seat(0)).send().await,
    ));
    assert_eq!(seen["agent"], "Agent_0");
}

#[tokio::test]
async fn pages_of_other_sites_are_refused() {
    let app = TestApp::builder().access(|access| access.hosts = vec!["swarm.example.org".into()]);
    let app = app.start().await;
    let ping = request("ping", &json!({}));
    // A page of the address that was asked for is the server's own.
    let own = app.mcp(&ping).header("host", "192.0.2.7:8080");
    assert_eq!(own.header("origin", "http://192.0.2.7:8080").send().await.status, 200);
    // A token makes no other site one of the server's.
    let other = app.mcp(&ping).token("seat_any").header("origin", "http://192.0.2.7");
    other.problem(403, "forbidden").await;
    for (name, value, is_good) in [
        ("host", "localhost", true),
        ("host", "127.0.0.1:9", true),
        ("host", "[::1]:9", true),
        ("host", "192.0.2.7:8080", true),
        ("host", "Swarm.example.org:8080", true),
        ("host", "evil.example", false),
        ("host", "swarm.example.org.evil.example", false),
        ("origin", "http://localhost:3000", true),
        ("origin", "https://swarm.example.org", true),
        ("origin", "http://evil.example:8080", false),
        ("origin", "http://192.0.2.7:8080", false),
        ("origin", "null", false),
    ] {
        let call = app.mcp(&ping).header(name, value);
        if is_good {
            assert_eq!(call.send().await.status, 200, "{name} {value}");
        } else {
            let problem = call.problem(403, "forbidden").await;
            let said = problem["detail"].as_str().expect("a detail");
            assert!(
                said.contains(value.trim_start_matches("http://")) && said.contains("--host"),
                "{said}"
            );
        }
    }
}

#[tokio::test]
async fn a_look_waits_for_the_turn_of_its_seat() {
    let app = TestApp::start().await;
    let episode = app.create(game(2, 3)).await;
    let token = episode.seat(0);
    app.tool(token, "act", json!({ "round": 0, "action": "UP", "wait_s": 0 })).await;
    let look = app.tool(token, "look", json!({ "wait_s": 45 }));
    let (looked, ()) = tokio::join!(look, other_acts(&app, &episode, 0));
    assert!(read(&looked)[1].contains("Round 1 is open"), "{looked}");
}

#[tokio::test]
async fn a_wait_that_is_over_is_an_ordinary_result() {
    let app = TestApp::with_manual_clock().await;
    let episode = app.create(game(2, 3)).await;
    let token = episode.seat(0);
    let act = app.tool(token, "act", json!({ "round": 0, "action": "UP", "wait_s": 45 }));
    let acted = passing(&app, act).await;
    assert!(read(&acted)[1].starts_with("You have acted in round 0"), "{acted}");
    assert_eq!(acted["structuredContent"]["obs"]["round"], 0);
    let look = app.tool(token, "look", json!({ "wait_s": 45 }));
    let looked = passing(&app, look).await;
    assert!(read(&looked)[0].contains("the round is still open"), "{looked}");
}

#[tokio::test]
async fn a_look_waits_for_the_start_of_a_game() {
    let app = TestApp::with_manual_clock().await;
    let mut settings = game(2, 3);
    settings["start"] = json!("manual");
    let episode = app.create(settings).await;
    let token = episode.seat(0);
    let looked = passing(&app, app.tool(token, "look", json!({ "wait_s": 2.5 }))).await;
    assert!(read(&looked)[0].starts_with("The game has not started"), "{looked}");
    let call = app.mcp(&tool_call("look", &json!({ "wait_s": 45 }))).token(token);
    let look = tokio::spawn(call.send());
    app.post(&episode.path("/start")).token(&episode.swarm).ok().await;
    let looked = result(&passing(&app, look).await.expect("no panic"));
    assert!(read(&looked)[1].contains("Round 0 is open"), "{looked}");
}

/// Lets time pass until something is done.
async fn passing<T>(app: &TestApp, work: impl Future<Output = T>) -> T {
    tokio::pin!(work);
    loop {
        tokio::select! {
            done = &mut work => return done,
            () = async { app.get("/healthz").ok().await; } => app.pass(Duration::from_millis(500)),
        }
    }
}

#[tokio::test]
async fn a_client_that_hangs_up_waits_no_more() {
    let app = TestApp::builder().limits(|limits| limits.waits_max = 1).start().await;
    let episode = app.create(game(2, 3)).await;
    let token = episode.seat(0);
    app.tool(token, "act", json!({ "round": 0, "action": "UP", "wait_s": 0 })).await;
    let call = |wait: f64| app.mcp(&tool_call("look", &json!({ "wait_s": wait }))).token(token);
    // It waits, and is counted as every request that waits.
    let mut waiting = tokio::spawn(call(45.0).send());
    until("the request is known", async || {
        if waiting.is_finished() {
            // The other one waited at that moment.
            waiting = tokio::spawn(call(45.0).send());
        }
        let refused = result(&call(0.001).send().await);
        refused["structuredContent"]["code"] == "overloaded"
    })
    .await;
    waiting.abort();
    until("its place is free", async || result(&call(0.001).send().await)["isError"] == false)
        .await;
}

#[tokio::test]
async fn a_commander_names_a_receiver() {
    let app = TestApp::start().await;
    let mut settings = game(3, 2);
    settings["control"] = json!("centralized");
    let episode = app.create(settings).await;
    let act =
        json!({ "round": 0, "action": "STAY", "message": "switch", "to": "Agent_2", "wait_s": 0 });
    app.tool(episode.seat(0), "act", act).await;
    for seat in [1, 2] {
        let act = json!({ "round": 0, "action": "STAY", "wait_s": 0, "message": "", "to": "" });
        app.tool(episode.seat(seat), "act", act).await;
    }
    assert_eq!(app.obs_after(episode.seat(1), 0).await["messages"], json!([]));
    assert_eq!(app.obs_after(episode.seat(2), 0).await["messages"], json!(["switch"]));
}

#[tokio::test]
async fn without_a_prompt_it_shows_the_observation() {
    let app = TestApp::start().await;
    let mut settings = game(2, 2);
    settings["prompt_template"] = json!("{% if round == 0 %}{{ nothing.at.all }}{% endif %}fine");
    let episode = app.create(settings).await;
    let looked = app.tool(episode.seat(0), "look", json!({})).await;
    let texts = read(&looked);
    assert!(texts[0].starts_with("The episode's prompt template fails"), "{texts:?}");
    assert!(texts[0].contains("\"actions\":[\"UP\""), "{texts:?}");
    assert_eq!(observed(&looked), app.obs(episode.seat(0)).await);
}

#[tokio::test]
async fn a_large_observation_is_sent_as_text_alone() {
    let app = TestApp::start().await;
    let request = json!({
        "task": "Foraging", "num_agents": 2, "width": 256, "height": 256, "view_size": 301, "max_round": 2, "memory": 0
    });
    let episode = app.create(request).await;
    let looked = app.tool(episode.seat(0), "look", json!({})).await;
    assert_eq!(looked["structuredContent"], Value::Null);
    let seen = app.get("/obs?prompt=true").token(episode.seat(0)).ok().await;
    assert_eq!(read(&looked)[0], seen["prompt"]);
}
