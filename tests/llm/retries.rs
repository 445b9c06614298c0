//! Errors that may be gone the next time are retried, with longer and longer pauses.

use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use serde_json::json;
use swarmbench_client::llm::{Spent, Stop};
use swarmbench_clock::Clock;
use tokio::io::AsyncReadExt;
use tokio::net::TcpListener;

use crate::llm::endpoint::{Endpoint, Reply, completion};
use crate::llm::time::{Leaps, TIME_OUT};
use crate::llm::{Bench, ask, question, stop_of};

/// A name, a reply, and the count that it raises.
type Case = (&'static str, Reply, fn(&Spent) -> u64);

/// All kinds of trouble that pass, and how they are counted.
fn troubles() -> Vec<Case> {
    let answer = || Reply::says("ACTION: UP");
    vec![
        ("408", Reply::error(408, "too slow"), |spent| spent.troubles.server),
        ("409", Reply::error(409, "locked"), |spent| spent.troubles.server),
        ("425", Reply::error(425, "too early"), |spent| spent.troubles.server),
        ("500", Reply::error(500, "oops"), |spent| spent.troubles.server),
        ("502", Reply::text(502, "<html><h1>Bad Gateway</h1></html>"), |spent| {
            spent.troubles.server
        }),
        ("504", Reply::text(504, ""), |spent| spent.troubles.server),
        ("520", Reply::text(520, "error code: 520"), |spent| spent.troubles.server),
        ("429", Reply::error(429, "slow down"), |spent| spent.troubles.load),
        ("503", Reply::error(503, "overloaded"), |spent| spent.troubles.load),
        ("529", Reply::error(529, "overloaded"), |spent| spent.troubles.load),
        ("a hang-up", answer().breaking(), |spent| spent.troubles.connections),
        ("a page", Reply::text(200, "<html>Sign in!</html>"), |spent| spent.troubles.unreadable),
        ("nothing", Reply::text(200, ""), |spent| spent.troubles.unreadable),
        ("half of it", Reply::text(200, "{\"choices\": ["), |spent| spent.troubles.unreadable),
        ("other JSON", Reply::json(200, &json!({ "ok": true })), |spent| spent.troubles.unreadable),
        ("a list", Reply::json(200, &json!([1])), |spent| spent.troubles.unreadable),
        ("too much", Reply::text(200, vec![b' '; 9 << 20]), |spent| spent.troubles.unreadable),
        (
            "an error with success",
            Reply::json(200, &json!({ "error": { "message": "upstream", "code": 502 } })),
            |spent| spent.troubles.server,
        ),
        (
            "a limit with success",
            Reply::json(200, &json!({ "error": { "message": "slow down", "code": 429 } })),
            |spent| spent.troubles.load,
        ),
        (
            "an error in the choice",
            Reply::json(
                200,
                &json!({ "choices": [{ "error": { "message": "upstream", "code": 502 } }] }),
            ),
            |spent| spent.troubles.server,
        ),
    ]
}

#[tokio::test]
async fn what_may_pass_is_tried_again() {
    for (name, reply, count) in troubles() {
        let endpoint = Endpoint::replies(vec![reply]).await;
        let bench = Bench::new(&endpoint);
        let model = bench.model();
        let answer = model.answer(&question(0, 0)).await.expect(name);
        assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 1), "{name}");
        assert_eq!(endpoint.seen().len(), 2, "{name}");
        let [pause] = bench.clock.pauses()[..] else {
            panic!("{name}: {:?}", bench.clock.pauses())
        };
        assert!((0.5..1.0).contains(&pause.as_secs_f64()), "{name}: {pause:?}");
        let spent = model.spent();
        assert_eq!((count(&spent), spent.troubles.total()), (1, 1), "{name}: {spent:?}");
        assert_eq!((spent.requests, spent.retries, spent.answers, spent.in_flight), (2, 1, 1, 0));
    }
}

/// An endpoint that answers once, and then fails for ever.
async fn failing(status: u16) -> Endpoint {
    Endpoint::start(move |number, _| match number {
        0 => Reply::says("ACTION: UP"),
        _ => Reply::error(status, "oops"),
    })
    .await
}

/// It may be the wrong address, so nobody waits for minutes; a refusal for its load shows that it is one.
#[tokio::test]
async fn an_address_that_never_gave_an_answer_is_tried_three_times() {
    let page = || Reply::text(200, "<html>Sign in</html>").header("content-type", "text/html");
    for (reply, last) in [
        (
            page as fn() -> Reply,
            "200 with text/html, is the address right? It begins: <html>Sign in</html>",
        ),
        (|| Reply::error(500, "oops"), "500, oops"),
        (
            || Reply::json(200, &json!({ "ok": 1 })),
            "200 with application/json that is no chat completion: {\"ok\":1}",
        ),
        (|| Reply::says("ACTION: UP").breaking(), "connection closed before message completed"),
    ] {
        let endpoint = Endpoint::start(move |number, _| match number {
            0 => Reply::error(429, "slow down"),
            _ => reply(),
        })
        .await;
        let model = Bench::new(&endpoint).model();
        let stop = stop_of(&model).await;
        assert!(matches!(&stop, Stop::Unreachable { tries: 4, is_unknown: true, .. }), "{stop:?}");
        let text = stop.to_string();
        assert!(text.contains(last) || last.starts_with("connection"), "{text}");
        assert!(
            text.contains("see whether it is the right one, and whether --timeout allows"),
            "{text}"
        );
        assert_eq!(model.trouble().map(|cause| text.contains(&cause)), Some(true));
        assert_eq!(endpoint.seen().len(), 4);
    }
}

/// Gateways say 503 of addresses that nothing answers; who counts requests, names a time or an error is waited for.
#[tokio::test]
async fn a_gateway_without_a_model_is_no_endpoint_under_load() {
    let page = "<html>503 Service Temporarily Unavailable</html>";
    let cases: [(fn() -> Reply, u32); 6] = [
        (|| Reply::text(503, "no healthy upstream"), 3),
        (|| Reply::json(503, &json!({ "message": "Service Unavailable" })), 3),
        (|| Reply::text(529, ""), 3),
        (|| Reply::text(503, "busy").header("retry-after", "1"), 10),
        (|| Reply::text(429, "slow down"), 10),
        (|| Reply::error(503, "Loading model"), 10),
    ];
    for (reply, expected) in cases {
        let endpoint = Endpoint::start(move |_, _| reply()).await;
        let stop = stop_of(&Bench::new(&endpoint).model()).await;
        assert!(
            matches!(&stop, Stop::Unreachable { tries, is_unknown: true, .. } if *tries == expected),
            "{stop:?}"
        );
    }
    // One that has answered is under load, whoever says so.
    let endpoint = Endpoint::start(move |number, _| match number {
        0 => Reply::says("ACTION: UP"),
        _ => Reply::text(503, page),
    })
    .await;
    let model = Bench::new(&endpoint).model();
    model.answer(&question(0, 1)).await.expect("the first answer");
    let stop = stop_of(&model).await;
    assert!(matches!(&stop, Stop::Unreachable { tries: 10, is_unknown: false, .. }), "{stop:?}");
}

#[tokio::test]
async fn an_endpoint_that_is_slower_than_the_timeout_is_told_after_three_tries() {
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: UP").held_until(1)).await;
    let bench = Bench::new(&endpoint);
    let model = bench.model();
    let asked = ask(&model, question(0, 0));
    for request in 1..=3 {
        endpoint.has_seen(request).await;
        bench.clock.pass(TIME_OUT);
    }
    let stop = asked.await.expect("no panic").expect_err("it stops").to_string();
    assert!(stop.contains("3 tries in a row; the last: no whole answer within 10000 s"), "{stop}");
    assert!(stop.contains("--timeout"), "{stop}");
}

#[tokio::test]
async fn pauses_grow_until_it_is_given_up() {
    for status in [500, 429] {
        let endpoint = failing(status).await;
        let mut bench = Bench::new(&endpoint);
        bench.settings.retries = 8;
        let model = bench.model();
        model.answer(&question(0, 1)).await.expect("the first answer");
        let stop = stop_of(&model).await;
        let Stop::Unreachable { url, tries, last, is_unknown: false } = stop else { panic!() };
        assert_eq!(url, format!("{}/chat/completions", endpoint.base()));
        assert_eq!((tries, last), (9, format!("{status}, oops")));
        assert_eq!(endpoint.seen().len(), 10);
        let pauses = bench.clock.pauses();
        assert_eq!(pauses.len(), 8, "{pauses:?}");
        for (pause, least) in pauses.iter().zip([0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0]) {
            assert!((least..2.0 * least).contains(&pause.as_secs_f64()), "{pauses:?}");
        }
        let text = stop_of(&model).await.to_string();
        assert!(text.contains("9 tries") && text.contains("run the same command again"), "{text}");
        assert_eq!(endpoint.seen().len(), 10, "nobody asks an endpoint that was given up");
    }
}

#[tokio::test]
async fn no_pause_is_longer_than_the_patience() {
    for status in [500, 429] {
        let endpoint = failing(status).await;
        let mut bench = Bench::new(&endpoint);
        bench.settings.patience = Duration::from_secs(3);
        let model = bench.model();
        model.answer(&question(0, 1)).await.expect("the first answer");
        stop_of(&model).await;
        let pauses = bench.clock.pauses();
        assert_eq!(pauses.len(), 9);
        assert!(pauses.iter().all(|pause| *pause <= Duration::from_secs(3)), "{pauses:?}");
    }
}

#[tokio::test]
async fn the_endpoint_says_when_to_come_again() {
    // The clock stands at 12:00:00.
    for (name, told, wait) in [
        ("retry-after", "7", 7.0),
        ("retry-after", "7.5", 7.5),
        ("retry-after", "Sun, 01 Mar 2026 12:00:30 GMT", 30.0),
        ("retry-after", "Sunday, 01-Mar-26 12:00:30 GMT", 30.0),
        ("retry-after-ms", "7500", 7.5),
    ] {
        for status in [429, 500, 503] {
            let refusal = Reply::error(status, "later").header(name, told);
            let endpoint = Endpoint::replies(vec![refusal]).await;
            let bench = Bench::new(&endpoint);
            bench.model().answer(&question(0, 0)).await.expect("an answer");
            let pauses: Vec<_> = bench.clock.pauses().iter().map(Duration::as_secs_f64).collect();
            assert_eq!(pauses, [wait], "{name}: {told}");
        }
    }
    // What is no time, has passed or is too short does not make anybody hurry.
    for told in ["soon", "-5", "0", "Sun, 01 Mar 2026 11:00:00 GMT", "nan", "1e400", ""] {
        let refusal = || Reply::error(429, "later").header("retry-after", told);
        let endpoint = Endpoint::replies(vec![refusal(), refusal()]).await;
        let bench = Bench::new(&endpoint);
        bench.model().answer(&question(0, 0)).await.expect("an answer");
        let pauses = bench.clock.pauses();
        assert_eq!(pauses.len(), 2);
        assert!((0.5..1.0).contains(&pauses[0].as_secs_f64()), "{told}: {pauses:?}");
        assert!((1.0..2.0).contains(&pauses[1].as_secs_f64()), "{told}: {pauses:?}");
    }
}

#[tokio::test]
async fn who_asks_for_more_than_the_patience_is_left_alone() {
    for status in [429, 503, 500] {
        let refusal = Reply::error(status, "daily limit").header("retry-after", "7200");
        let endpoint = Endpoint::replies(vec![refusal]).await;
        let bench = Bench::new(&endpoint);
        let model = bench.model();
        let stop = stop_of(&model).await;
        let Stop::ComeLater { wait_s: 7200, patience_s: 600, .. } = stop else {
            panic!("{stop:?}")
        };
        assert!(stop.to_string().contains("--patience"), "{stop}");
        assert_eq!(stop_of(&model).await, stop);
        assert_eq!((endpoint.seen().len(), bench.clock.pauses().len()), (1, 0));
    }
}

#[tokio::test]
async fn an_answer_that_does_not_come_whole_in_time_is_asked_for_again() {
    let silent = Reply::says("ACTION: DOWN").held_until(1);
    let slow = Reply::says("ACTION: LEFT").stalling();
    let endpoint = Endpoint::replies(vec![silent, slow]).await;
    let bench = Bench::new(&endpoint);
    let model = bench.model();
    let asked = ask(&model, question(0, 0));
    for request in 1..=2 {
        endpoint.has_seen(request).await;
        let trouble = (request == 2).then(|| "no whole answer within 10000 s".to_owned());
        assert_eq!(model.trouble(), trouble);
        assert_eq!(model.spent().in_flight, 1);
        bench.clock.pass(TIME_OUT);
    }
    let answer = asked.await.expect("no panic").expect("an answer");
    assert_eq!((answer.response.as_str(), answer.retries), ("ACTION: UP", 2));
    assert_eq!(model.trouble(), None);
    // It is the time of the request that succeeded.
    assert_eq!(answer.usage.latency_ms, Some(0));
    assert_eq!(model.spent().troubles.time_outs, 2);
}

#[tokio::test]
async fn nobody_at_the_address() {
    let endpoint = Endpoint::replies(vec![]).await;
    let closed = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = closed.local_addr().expect("an address");
    drop(closed);
    let mut bench = Bench::new(&endpoint);
    bench.settings.api_base = format!("http://{address}/v1");
    let model = bench.model();
    let text = stop_of(&model).await.to_string();
    // It may be a typing error, so nobody waits for minutes.
    assert!(text.contains(&address.to_string()) && text.contains("3 tries"), "{text}");
    assert!(text.to_lowercase().contains("refused"), "{text}");
    assert_eq!(model.spent().troubles.connections, 3);
}

#[tokio::test]
async fn an_endpoint_that_has_answered_before_is_waited_for() {
    let endpoint = Endpoint::replies(vec![]).await;
    let bench = Bench::new(&endpoint);
    let model = bench.model();
    model.answer(&question(0, 0)).await.expect("an answer");
    endpoint.ends().await;
    let stop = model.answer(&question(0, 1)).await.expect_err("it is gone");
    assert!(matches!(stop, Stop::Unreachable { tries: 10, .. }), "{stop}");
}

#[tokio::test]
async fn who_hangs_up_before_answering_is_asked_again() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let server = tokio::spawn(async move {
        for _ in 0..3 {
            let (mut connection, _) = listener.accept().await.expect("a connection");
            let mut some = [0; 16];
            connection.read_exact(&mut some).await.expect("a request");
        }
    });
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.api_base = format!("http://{address}/v1");
    bench.settings.retries = 2;
    let model = bench.model();
    let stop = stop_of(&model).await;
    assert!(matches!(stop, Stop::Unreachable { tries: 3, .. }), "{stop:?}");
    assert_eq!(model.spent().troubles.connections, 3);
    server.await.expect("three came");
}

#[tokio::test]
async fn one_that_is_refused_waits_alone() {
    let refusal = Reply::error(429, "slow down").header("retry-after", "100");
    let endpoint = Endpoint::replies(vec![refusal]).await;
    let bench = Bench::with(&endpoint, Leaps::standing(), 4, None);
    let model = bench.model();
    let first = ask(&model, question(0, 0));
    bench.clock.has_seen(1).await;
    model.answer(&question(1, 0)).await.expect("an answer");
    assert_eq!(bench.clock.pauses(), [Duration::from_secs(100)]);
    assert_eq!(endpoint.seen().len(), 2);
    bench.clock.pass(Duration::from_secs(100));
    first.await.expect("no panic").expect("an answer");
    assert_eq!(endpoint.seen().len(), 3);
}

/// The number of refusals that closes the gate.
const MANY: usize = 11;

#[tokio::test]
async fn when_many_are_refused_the_others_wait() {
    let refusal = || Reply::error(429, "slow down").header("retry-after", "100");
    let endpoint = Endpoint::replies((0..MANY).map(|_| refusal()).collect()).await;
    let mut bench = Bench::with(&endpoint, Leaps::standing(), 16, None);
    let model = bench.model();
    let refused: Vec<_> = (0..11).map(|agent| ask(&model, question(agent, 0))).collect();
    bench.clock.has_seen(MANY).await;
    assert_eq!(endpoint.seen().len(), MANY);
    // Another way to ask the same model.
    bench.settings.sampling.temperature = Some(0.0);
    let other = ask(&bench.model(), question(11, 0));
    bench.clock.has_seen(MANY + 1).await;
    assert_eq!(bench.clock.pauses(), [Duration::from_secs(100); MANY + 1]);
    assert_eq!(endpoint.seen().len(), MANY);
    // Another model is another matter.
    bench.settings.model = "swarm-2".to_owned();
    bench.model().answer(&question(12, 0)).await.expect("an answer");
    bench.clock.pass(Duration::from_secs(100));
    for asked in refused.into_iter().chain([other]) {
        asked.await.expect("no panic").expect("an answer");
    }
    assert_eq!(endpoint.seen().len(), MANY + 1 + MANY + 1);
}

#[tokio::test]
async fn who_waits_at_a_closed_gate_takes_no_turn_from_other_models() {
    let endpoint = Endpoint::start(|_, seen| {
        let refusal = || Reply::error(429, "slow down").header("retry-after", "100");
        match (seen.body["model"].as_str(), seen.prompt()) {
            (Some("swarm-1"), prompt) if prompt.contains("Agent_10.") => refusal().held_until(1),
            (Some("swarm-1"), prompt) if !prompt.contains("Agent_11.") => refusal(),
            (Some("swarm-2"), prompt) if prompt.contains("Agent_20.") => {
                Reply::says("ACTION: UP").held_until(2)
            }
            _ => Reply::says("ACTION: UP"),
        }
    })
    .await;
    let mut bench = Bench::with(&endpoint, Leaps::standing(), 2, None);
    let first = bench.model();
    bench.settings.model = "swarm-2".to_owned();
    let second = bench.model();
    let mut refused: Vec<_> = (0..10).map(|agent| ask(&first, question(agent, 0))).collect();
    bench.clock.has_seen(10).await;
    // One of each model is in flight; another of the first has passed its gate and waits for a turn.
    refused.push(ask(&first, question(10, 0)));
    endpoint.has_seen(11).await;
    let held = ask(&second, question(20, 0));
    endpoint.has_seen(12).await;
    let waiting = ask(&first, question(11, 0));
    tokio::task::yield_now().await;
    endpoint.release();
    // With one refusal more the gate of the first model closes.
    bench.clock.has_seen(MANY).await;
    assert_eq!(bench.clock.pauses(), [Duration::from_secs(100); MANY]);
    second.answer(&question(21, 0)).await.expect("there is a turn for it");
    assert_eq!(endpoint.seen().len(), 13, "none of the first model's came before its time");
    endpoint.release();
    held.await.expect("no panic").expect("an answer");
    bench.clock.pass(Duration::from_secs(100));
    waiting.await.expect("no panic").expect("an answer");
    for asked in refused {
        asked.abort();
    }
}

#[tokio::test]
async fn fewer_are_in_flight_after_many_refusals_and_more_after_answers() {
    const SEATS: u32 = 48;
    // All 16 that come first are refused together; the next are there together, and the last.
    let endpoint = Endpoint::start(|number, _| match number {
        0..16 => Reply::error(429, "slow down").held_until(1),
        16..32 => Reply::says("ACTION: UP").held_until(2),
        256.. => Reply::says("ACTION: UP").held_until(3),
        _ => Reply::says("ACTION: UP"),
    })
    .await;
    let bench = Bench::with(&endpoint, Leaps::standing(), 16, None);
    let model = bench.model();
    let all = |agents: Range<u32>, round| {
        agents.map(|agent| ask(&model, question(agent, round))).collect::<Vec<_>>()
    };
    let mut asked = all(0..16, 0);
    endpoint.has_seen(16).await;
    assert_eq!(model.spent().in_flight, 16);
    endpoint.release();
    // Ten pause alone, the others until the gate opens; with two of those who come now they are eight.
    bench.clock.has_seen(10 + 6).await;
    asked.extend(all(16..SEATS, 0));
    bench.clock.has_seen(10 + 8).await;
    assert_eq!(model.spent().troubles.load, 16);
    // Sixteen refusals of one moment are one closing, so no pause has grown.
    let longest = bench.clock.pauses().into_iter().max().expect("a pause");
    assert!(longest < Duration::from_secs(1), "{longest:?}");
    bench.clock.pass(Duration::from_secs(1));
    endpoint.has_seen(16 + 8).await;
    assert_eq!(model.spent().in_flight, 8);
    endpoint.release();
    for asked in asked {
        asked.await.expect("no panic").expect("an answer");
    }
    for round in 1..5 {
        for asked in all(0..SEATS, round) {
            asked.await.expect("no panic").expect("an answer");
        }
    }
    let asked = all(0..SEATS, 5);
    endpoint.has_seen(256 + 16).await;
    endpoint.release();
    for asked in asked {
        asked.await.expect("no panic").expect("an answer");
    }
    assert_eq!((endpoint.most_at_once(), endpoint.seen().len()), (16, 16 + 6 * SEATS as usize));
}

#[tokio::test]
async fn an_endpoint_that_bears_one_at_a_time_answers_all() {
    const SEATS: u32 = 40;
    // It refuses a client while another is connected.
    let busy = Arc::new(Mutex::new(Vec::new()));
    let clock = Arc::new(Leaps::leaping());
    let (seen, now) = (busy.clone(), clock.clone());
    let endpoint = Endpoint::start(move |_, _| {
        let mut seen = seen.lock().expect("a lock");
        let at = now.now();
        // One request a second of its clock.
        if seen.last().is_some_and(|last| at.duration_since(*last).as_secs() < 1) {
            return Reply::error(429, "one a second").header("retry-after", "1");
        }
        seen.push(at);
        Reply::says("ACTION: UP")
    })
    .await;
    let mut bench = Bench::with(&endpoint, Leaps::leaping(), 16, None);
    bench.allowance = swarmbench_client::llm::Allowance::new(16, None, clock.clone());
    bench.settings.retries = 3;
    let model = bench.model();
    let asked: Vec<_> = (0..SEATS).map(|agent| ask(&model, question(agent, 0))).collect();
    for asked in asked {
        asked.await.expect("no panic").expect("nobody is given up while others are answered");
    }
    assert_eq!(busy.lock().expect("a lock").len(), SEATS as usize);
    assert_eq!(model.spent().answers, u64::from(SEATS));
    // It settles: without a width that shrinks, nearly all requests would be refusals.
    let refusals = model.spent().troubles.load;
    assert!(refusals < 3 * u64::from(SEATS), "{refusals}");
}

#[tokio::test]
async fn the_whole_story_of_one_question() {
    let good = completion(&json!({ "content": "ACTION: UP" }), "stop");
    let endpoint = Endpoint::replies(vec![
        Reply::error(429, "slow down").header("retry-after", "5"),
        Reply::error(500, "oops"),
        Reply::text(200, "<html>"),
        Reply::json(200, &good),
    ])
    .await;
    let bench = Bench::new(&endpoint);
    let model = bench.model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(answer.retries, 3);
    let spent = model.spent();
    assert_eq!((spent.requests, spent.retries, spent.troubles.total()), (4, 3, 3));
    assert_eq!((spent.prompt_tokens, spent.completion_tokens), (10, 5));
    assert_eq!(bench.allowance.spent(), 15);
}
