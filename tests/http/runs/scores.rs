//! The scores of the games of a run.

use serde_json::{Value, json};

use super::{create, play, small, text};
use crate::app::{TestApp, list};

#[tokio::test]
async fn a_run_has_the_scores_of_its_games_page_by_page() {
    let app = TestApp::start().await;
    let run = create(&app, small()).await;
    let path = format!("/api/v1/runs/{}/scores", run.id);
    // Games that are played are there from the beginning.
    let opened = list(&app.get(&path).ok().await["items"]);
    assert!(!opened.is_empty());
    assert!(opened.iter().all(|game| game["scores"] == json!([0.0])), "{opened:?}");
    play(&app, &run).await;
    let games = list(&app.get(&path).ok().await["items"]);
    assert_eq!(games.len(), 4);
    for game in &games {
        let path = format!("/api/v1/episodes/{}/scores?points=50", text(game, "episode"));
        assert_eq!(&app.get(&path).ok().await, game);
    }
    let (mut paged, mut cursor) = (Vec::<Value>::new(), String::new());
    loop {
        let page = app.get(&format!("{path}?limit=3{cursor}")).ok().await;
        paged.extend(list(&page["items"]));
        let Some(next) = page["next_cursor"].as_str() else { break };
        cursor = format!("&cursor={next}");
    }
    assert_eq!(paged, games);
    for wrong in ["limit=0", "limit=201", "cursor=x", "points=0", "points=1001"] {
        app.get(&format!("{path}?{wrong}")).problem(400, "malformed").await;
    }
}
