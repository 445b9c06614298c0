//! The stream of events of a run.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::{create, play, show, small, text, with};
use crate::app::{TestApp, number};

#[tokio::test]
async fn the_stream_of_a_run_has_every_game_and_the_end() {
    let app = TestApp::start().await;
    let run = create(&app, with(small(), &json!({ "parallel": 1 }))).await;
    let events = app.get(&run.path("/events")).token(&run.token).send();
    let (events, _) = tokio::join!(events, play(&app, &run));
    assert_eq!(events.status, 200);
    assert_eq!(events.header("content-type"), "text/event-stream");
    let told: Vec<(String, Value)> = (events.text().split("\n\n"))
        .filter_map(|event| {
            let line =
                |name: &str| event.lines().find_map(|line| line.strip_prefix(&format!("{name}: ")));
            Some((line("event")?.to_owned(), serde_json::from_str(line("data")?).expect("JSON")))
        })
        .collect();
    let (last, games) = told.split_last().expect("events");
    assert_eq!((&*last.0, &last.1), ("finished", &show(&app, &run).await));
    let mut states: BTreeMap<u64, Vec<String>> = BTreeMap::new();
    for (name, game) in games {
        assert_eq!(name, "game");
        states.entry(number(&game["slot"])).or_default().push(text(game, "status").to_owned());
    }
    for slot in 0..4 {
        assert_eq!(states[&slot].last().expect("an event"), "finished", "{states:?}");
    }
    // A later client gets the result.
    let again = app.get(&run.path("/events")).token(&run.token).send().await.text();
    assert_eq!(again.matches("event: game").count(), 4);
    assert_eq!(again.matches("event: finished").count(), 1);
}
