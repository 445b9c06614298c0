//! `GET /swarm/acts`: earlier acts of a seat, page by page.

use serde_json::{Value, json};

use crate::app::{TestApp, game, list, number};

#[tokio::test]
async fn older_acts_that_do_not_fit_are_on_the_next_page() {
    let app = TestApp::start().await;
    let episode = app.create(game(1, 30)).await;
    let text = "n".repeat(60_000);
    for round in 0..22 {
        let act = json!({
            "round": round, "response": "ACTION: STAY",
            "harness": { "added": text, "scratchpad": format!("notes of {round}") },
        });
        app.act(episode.seat(0), &act).await;
    }
    let page = async |query: &str| -> Vec<Value> {
        let path = format!("/swarm/acts?episode={}&agent=Agent_0{query}", episode.id);
        list(&app.get(&path).token(&episode.swarm).ok().await["acts"])
    };
    let rounds =
        |acts: &[Value]| -> Vec<u64> { acts.iter().map(|act| number(&act["round"])).collect() };
    // What the program added counts, too: 18 texts are more than 1 MiB.
    let newest = page("&last=20").await;
    assert_eq!(rounds(&newest), (4..22).collect::<Vec<_>>());
    assert_eq!(newest[17]["act"]["harness"]["scratchpad"], "notes of 21");
    let older = page("&last=20&before=4").await;
    assert_eq!(rounds(&older), [0, 1, 2, 3]);
    assert_eq!(rounds(&page("&last=2&before=9").await), [7, 8]);
    assert_eq!(rounds(&page("&before=900").await), [21], "nothing is known of later rounds");
    assert!(page("&before=0").await.is_empty());
    let path = format!("/swarm/acts?episode={}&agent=Agent_0&before=-1", episode.id);
    app.get(&path).token(&episode.swarm).problem(400, "malformed").await;
}
