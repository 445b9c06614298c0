//! The stream of events of an episode.

use rstest::rstest;
use serde_json::{Value, json};

use super::{finish, request};
use crate::app::{Episode, TestApp};

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
async fn the_stream_has_every_round_when_it_happens_and_then_the_end() {
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
    let listening = tokio::spawn(read(app.get(&episode.path("/events")).open().await, usize::MAX));
    app.stop().await;
    assert!(listening.await.expect("a clean end of the stream").len() <= 1);
}

#[tokio::test]
async fn the_stream_of_an_aborted_episode_has_only_its_end() {
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
