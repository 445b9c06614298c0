//! Rights of each caller to read an episode, before and after its end.

use rstest::rstest;
use serde_json::json;

use super::{finish, request, with};
use crate::app::{Episode, TestApp};

/// Caller of a route.
#[derive(Clone, Copy, Debug)]
enum Who {
    Nobody,
    Seat,
    Creator,
    Stranger,
}

/// Statuses of the reading routes for `who`: show, state, events and journal.
async fn statuses(app: &TestApp, episode: &Episode, stranger: &Episode, who: Who) -> [u16; 4] {
    let mut statuses = [0; 4];
    for (status, rest) in statuses.iter_mut().zip(["", "/state", "/events", "/journal"]) {
        let call = app.get(&episode.path(rest));
        let call = match who {
            Who::Nobody => call,
            Who::Seat => call.token(episode.seat(0)),
            Who::Creator => call.token(&episode.swarm),
            Who::Stranger => call.token(&stranger.swarm),
        };
        *status = call.open().await.status().as_u16();
    }
    statuses
}

#[rstest]
#[case("public", Who::Nobody, [200, 200, 200, 200])]
#[case("public", Who::Creator, [200, 200, 200, 200])]
#[case("public", Who::Seat, [200, 200, 200, 403])]
#[case("public", Who::Stranger, [200, 200, 200, 403])]
#[case("owner", Who::Nobody, [404, 404, 404, 404])]
#[case("owner", Who::Creator, [200, 200, 200, 200])]
#[case("owner", Who::Seat, [200, 403, 403, 403])]
#[case("owner", Who::Stranger, [404, 404, 404, 404])]
#[tokio::test]
async fn visibility_limits_who_reads_until_the_end(
    #[case] visibility: &str,
    #[case] who: Who,
    #[case] expected: [u16; 4],
) {
    let app = TestApp::start().await;
    let stranger = app.create(request(1, 1)).await;
    let episode = app.create(with(request(1, 2), "visibility", json!(visibility))).await;
    app.all_act(&episode, "SWITCH").await;
    assert_eq!(statuses(&app, &episode, &stranger, who).await, expected, "while it runs");
    finish(&app, &episode).await;
    assert_eq!(statuses(&app, &episode, &stranger, who).await, [200; 4], "after its end");
}
