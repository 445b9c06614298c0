//! Lists of episodes: filters, pages, and what each caller may see.

use rstest::rstest;
use serde_json::{Value, json};

use super::{finish, request, with};
use crate::app::{TestApp, list};

async fn ids(app: &TestApp, query: &str) -> Vec<String> {
    let page = app.get(&format!("/api/v1/episodes?{query}")).ok().await;
    let id = |item: &Value| item["id"].as_str().expect("an id").to_owned();
    list(&page["items"]).iter().map(id).collect()
}

#[tokio::test]
async fn a_list_is_filtered_newest_first() {
    let app = TestApp::start().await;
    let made = [
        json!({ "task": "Pursuit", "model": "a" }),
        json!({ "task": "Transport", "model": "a", "start": "manual" }),
        json!({ "task": "Pursuit", "model": "b" }),
        json!({ "task": "Synchronization", "model": "b", "num_agents": 1, "max_round": 1 }),
        json!({ "task": "Pursuit", "model": "b" }),
    ];
    let mut episodes = Vec::new();
    for request in made {
        episodes.push(app.create(request).await);
    }
    finish(&app, &episodes[3]).await;
    app.delete(&episodes[4].path("")).token(&episodes[4].swarm).ok().await;
    let table: [(&str, &[usize]); 11] = [
        ("", &[4, 3, 2, 1, 0]),
        ("task=Pursuit", &[4, 2, 0]),
        ("model=a", &[1, 0]),
        ("model=A", &[]),
        ("status=running", &[2, 0]),
        ("status=waiting", &[1]),
        ("status=finished", &[3]),
        ("status=aborted", &[4]),
        ("status=abandoned", &[]),
        ("task=Pursuit&model=b&status=running", &[2]),
        ("run=run_1", &[]),
    ];
    for (query, expected) in table {
        let expected: Vec<_> = expected.iter().map(|&place| episodes[place].id.clone()).collect();
        assert_eq!(ids(&app, query).await, expected, "{query}");
    }
}

#[tokio::test]
async fn pages_follow_each_other_without_gaps() {
    let app = TestApp::start().await;
    let mut all = Vec::new();
    for number in 0..7 {
        let request =
            with(request(1, 1), "model", json!(if number % 2 == 0 { "even" } else { "odd" }));
        all.insert(0, app.create(request).await.id);
    }
    for (filter, limit, expected) in [
        ("", 1, all.clone()),
        ("", 3, all.clone()),
        ("", 7, all.clone()),
        ("&model=even", 2, all.iter().step_by(2).cloned().collect()),
    ] {
        let mut seen = Vec::new();
        let mut place = String::new();
        loop {
            let page =
                app.get(&format!("/api/v1/episodes?limit={limit}{filter}{place}")).ok().await;
            let items = list(&page["items"]);
            assert!((1..=limit).contains(&items.len()));
            seen.extend(items.iter().map(|item| item["id"].as_str().expect("an id").to_owned()));
            match page["next_cursor"].as_str() {
                Some(next) => place = format!("&cursor={next}"),
                None => break,
            }
            // What is created meanwhile is newer than every cursor.
            app.create(with(super::request(1, 1), "model", json!("late"))).await;
        }
        seen.retain(|id| all.contains(id));
        assert_eq!(seen, expected, "by {limit}{filter}");
    }
}

#[tokio::test]
async fn an_item_is_what_show_answers() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 2)).await;
    app.all_act(&episode, "SWITCH").await;
    for _ in 0..2 {
        let item = app.get("/api/v1/episodes").ok().await["items"][0].clone();
        assert_eq!(item, app.get(&episode.path("")).ok().await);
        finish(&app, &episode).await;
    }
}

#[tokio::test]
async fn a_page_beyond_the_limit_names_it() {
    let app = TestApp::start().await;
    let call = app.get("/api/v1/episodes?limit=1001");
    let problem = call.problem(400, "malformed").await;
    assert_eq!(problem["limit"], json!({ "name": "page_items_max", "value": 1000 }));
}

#[rstest]
#[case("limit=0")]
#[case("limit=1001")]
#[case("limit=-1")]
#[case("status=asleep")]
#[case("task=Chess")]
#[case("cursor=7")]
#[case("cursor=cxyz")]
#[case("cursor=c-1")]
#[case("order=asc")]
#[case("limit=1&limit=2")]
#[tokio::test]
async fn a_bad_query_is_malformed(#[case] query: &str) {
    let app = TestApp::start().await;
    app.get(&format!("/api/v1/episodes?{query}")).problem(400, "malformed").await;
}

#[tokio::test]
async fn an_owners_episode_is_listed_after_its_end() {
    let app = TestApp::start().await;
    let episode = app.create(with(request(1, 1), "visibility", json!("owner"))).await;
    assert_eq!(app.get("/api/v1/episodes").ok().await["items"], json!([]));
    // Its creator sees it before.
    let own = app.get("/api/v1/episodes").token(&episode.swarm).ok().await;
    assert_eq!(own["items"][0]["id"], episode.id);
    finish(&app, &episode).await;
    assert_eq!(app.get("/api/v1/episodes").ok().await["items"][0]["id"], episode.id);
}
