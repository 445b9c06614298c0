//! `GET /swarm/obs`: the observations of several seats in one call.

use rstest::rstest;
use serde_json::json;

use super::{agents, cursor, look};
use crate::app::{TestApp, game, list};

#[tokio::test]
async fn the_observations_are_those_of_obs() {
    let app = TestApp::start().await;
    let episode = app.create(game(3, 2)).await;
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
    let episode = app.create(game(4, 2)).await;
    for acting in [2, 0] {
        app.act(episode.seat(acting), &json!({ "round": 0, "action": "STAY" })).await;
    }
    assert_eq!(agents(&look(&app, &episode, "").await), ["Agent_1", "Agent_3"]);
}

#[tokio::test]
async fn a_cursor_shows_only_what_was_opened_since() {
    let app = TestApp::start().await;
    let episode = app.create(game(5, 3)).await;
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
    let episode = app.create(game(2, 2)).await;
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
    let episode = app.create(game(2, 2)).await;
    let place = cursor(&look(&app, &episode, "").await).to_owned();
    let wait = app.get(&format!("/swarm/obs?wait=10&after={place}")).token(&episode.swarm);
    let looked = app.pass_until(tokio::spawn(wait.ok())).await;
    assert_eq!((agents(&looked).len(), &looked["finished"]), (0, &json!(false)));
    assert_eq!(cursor(&looked), place);
}

#[tokio::test]
async fn a_waiting_episode_shows_its_seats_once_it_is_started() {
    let app = TestApp::with_manual_clock().await;
    let mut request = game(2, 2);
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
    let episode = app.create(game(2, 1)).await;
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
    let episode = app.create(game(3, 2)).await;
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
    let episode = app.create(game(2, 2)).await;
    let call = app.get(&format!("/swarm/obs?{query}")).token(&episode.swarm);
    call.problem(400, "malformed").await;
}
