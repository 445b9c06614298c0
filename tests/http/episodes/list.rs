//! Lists of episodes: filters, pages, and what each caller may see.

use rstest::rstest;
use serde_json::{Value, json};

use super::{finish, request, with};
use crate::app::{Episode, TestApp, list, until};

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
#[case("sort=Score")]
#[case("sort=score&cursor=c1")]
#[case("people=yes")]
#[case("curves=1")]
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

/// All games of a list, page by page.
async fn paged(app: &TestApp, query: &str) -> Vec<Value> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = app.get(&format!("/api/v1/episodes?{query}{cursor}")).ok().await;
        all.extend(list(&page["items"]));
        match page["next_cursor"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}

#[tokio::test]
async fn ended_games_are_sorted_page_by_page() {
    let app = TestApp::start().await;
    let mut made = Vec::new();
    for (seed, rounds, model) in
        [(5, 3, "a"), (9, 1, "b"), (5, 2, "a"), (1, 3, "b"), (7, 2, "a"), (2, 1, "c")]
    {
        let request = with(with(request(1, rounds), "seed", json!(seed)), "model", json!(model));
        let episode = app.create(request).await;
        finish(&app, &episode).await;
        made.push(episode.id);
    }
    let running = app.create(with(request(1, 1), "model", json!("a"))).await;
    let place = |game: &Value| made.iter().position(|id| game["id"] == **id);
    let value = |game: &Value, field: &str| match field {
        "seed" => game["config"]["seed"].as_f64().expect("a seed"),
        "rounds" => game["round"].as_f64().expect("rounds"),
        _ => game["score"].as_f64().expect("a score"),
    };
    for (sort, is_up) in [
        ("score", false),
        ("-score", true),
        ("rounds", false),
        ("-rounds", true),
        ("seed", true),
        ("-seed", false),
    ] {
        let field = sort.trim_start_matches('-');
        for (filter, count) in [
            ("", 6),
            ("&model=a", 3),
            ("&model=d", 0),
            ("&task=Pursuit", 0),
            ("&status=finished", 6),
        ] {
            let games = paged(&app, &format!("limit=2&sort={sort}{filter}")).await;
            assert_eq!(games.len(), count, "{sort}{filter}: the running game has no value");
            for pair in games.windows(2) {
                let (one, other) = (value(&pair[0], field), value(&pair[1], field));
                let (one, other) = if is_up { (one, other) } else { (other, one) };
                let is_equal_in_order = (place(&pair[0]) < place(&pair[1])) == is_up;
                assert!(one < other || (one <= other && is_equal_in_order), "{sort}: {pair:?}");
            }
        }
    }
    let oldest: Vec<_> = paged(&app, "limit=2&sort=oldest").await;
    let ids: Vec<_> = oldest.iter().map(|game| game["id"].as_str().expect("an id")).collect();
    assert_eq!(ids, made.iter().chain([&running.id]).map(String::as_str).collect::<Vec<_>>());

    let first = app.get("/api/v1/episodes?limit=1&sort=score").ok().await;
    let cursor = first["next_cursor"].as_str().expect("a cursor");
    for other in ["newest", "oldest", "-score", "rounds", "seed"] {
        let query = format!("/api/v1/episodes?sort={other}&cursor={cursor}");
        let problem = app.get(&query).problem(400, "malformed").await;
        assert!(problem["detail"].as_str().is_some_and(|text| text.contains("same order")));
    }
}

#[tokio::test]
async fn a_place_among_hidden_games_tells_nothing_of_them() {
    let app = TestApp::start().await;
    for seed in [3, 8] {
        let episode = app.create(with(request(1, 1), "seed", json!(seed))).await;
        finish(&app, &episode).await;
    }
    let hidden = app.create(with(request(1, 1), "visibility", json!("owner"))).await;
    assert_eq!(app.show(&hidden).await["status"], "running");
    for mark in ["s", "S", "r", "R", "d", "D"] {
        let sort = match mark {
            "s" => "score",
            "S" => "-score",
            "r" => "rounds",
            "R" => "-rounds",
            "d" => "seed",
            _ => "-seed",
        };
        // Numbers of games can be guessed; none but those of the list are places in it.
        for number in [3, 4, 1000] {
            let query = format!("sort={sort}&cursor={mark}{number:x}");
            assert_eq!(ids(&app, &query).await, Vec::<String>::new(), "{query}");
        }
    }
}

#[tokio::test]
async fn games_of_a_run_and_forks_are_sorted() {
    let app = TestApp::start().await;
    let other = app.create(request(1, 2)).await;
    finish(&app, &other).await;
    let suite = json!({ "name": "few", "tasks": ["Synchronization"], "seeds": [5, 2, 9], "settings": { "num_agents": 1, "max_round": 1 } });
    let run = app
        .post("/api/v1/runs")
        .json(&json!({ "suite": suite, "model": "m", "player": "default" }))
        .ok()
        .await;
    let run = run["id"].as_str().expect("an id");
    let path = format!("/api/v1/runs/{run}");
    until("the run ends", async || app.get(&path).ok().await["status"] == "finished").await;
    let games = paged(&app, &format!("run={run}&sort=seed&limit=1")).await;
    let seeds: Vec<_> = games.iter().map(|game| game["config"]["seed"].clone()).collect();
    assert_eq!(seeds, [2, 5, 9]);
    let made = app.post(&other.path("/fork")).json(&json!({ "round": 1 })).ok().await;
    let fork = Episode::of(&made["episodes"][0]);
    finish(&app, &fork).await;
    assert_eq!(ids(&app, &format!("fork_of={}&sort=-rounds", other.id)).await, [fork.id.as_str()]);
    assert_eq!(ids(&app, "run=run_0&sort=seed").await, Vec::<String>::new());
}

#[tokio::test]
async fn a_token_of_a_private_server_finds_no_place_of_other_games() {
    let app = TestApp::builder().keys().access(|access| access.private = true).start().await;
    let mut own = None;
    for seed in [3, 5, 8] {
        let game = with(request(1, 1), "seed", json!(seed));
        let game = app.create_with(&app.organizer, game).await;
        finish(&app, &game).await;
        if seed == 5 {
            own = Some(game);
        }
    }
    let own = own.expect("made");
    for number in 1..=4 {
        let query = format!("/api/v1/episodes?sort=seed&cursor=d{number:x}");
        let page = app.get(&query).token(&own.swarm).ok().await;
        assert_eq!(page["items"], json!([]), "{number}");
    }
    let page = app.get("/api/v1/episodes?sort=seed").token(&own.swarm).ok().await;
    assert_eq!(list(&page["items"])[0]["id"], own.id);
}

#[tokio::test]
async fn an_ended_game_has_a_curve_of_few_points_where_it_is_asked_for() {
    let app = TestApp::start().await;
    for rounds in [1, 30, 31, 70] {
        let episode = app.create(request(1, rounds)).await;
        finish(&app, &episode).await;
        let game = app.get("/api/v1/episodes?limit=1&curves=true").ok().await["items"][0].clone();
        let curve = list(&game["curve"]);
        assert!((2..=32).contains(&curve.len()), "{rounds}: {curve:?}");
        assert_eq!((&curve[0], &curve[curve.len() - 1]), (&json!(0.0), &game["score"]));
        let scores = app.get(&episode.path("/scores?points=30")).ok().await;
        assert_eq!(json!(curve), scores["scores"], "the same steps as elsewhere");
    }
    let running = app.create(request(1, 1)).await;
    let games = app.get("/api/v1/episodes?curves=true").ok().await;
    assert_eq!(games["items"][0]["id"], running.id);
    assert!(games["items"][0].get("curve").is_none());
    assert!(app.get("/api/v1/episodes").ok().await["items"][1].get("curve").is_none());
}

#[tokio::test]
async fn games_with_people_are_found() {
    let app = TestApp::start().await;
    let person = json!({ "kind": "human" });
    let alone = app.create(with(request(1, 1), "agent_meta", person.clone())).await;
    app.create(request(1, 1)).await;
    let mixed = with(with(request(2, 1), "open_seats", json!(1)), "agent_meta", json!({}));
    let mixed = app.create(mixed).await;
    assert_eq!(ids(&app, "people=true").await, [alone.id.as_str()]);
    assert_eq!(app.show(&alone).await["people"], true);

    let claim = json!({ "seats": 1, "agent_meta": person });
    let claimed = app.post(&mixed.path("/claims")).json(&claim).ok().await;
    // Holders of an open game do not know of each other.
    assert_eq!(ids(&app, "people=true").await, [alone.id.as_str()]);
    let shown = app.show(&mixed).await;
    assert_eq!((&shown["people"], &shown["mixed"]), (&json!(false), &json!(true)));
    app.delete(&mixed.path("")).token(&mixed.swarm).ok().await;
    assert!(claimed["swarm_token"].is_string(), "{claimed}");
    assert_eq!(ids(&app, "people=true").await, [mixed.id.as_str(), alone.id.as_str()]);
    assert_eq!(ids(&app, "people=true&sort=score").await, [mixed.id.as_str()]);
    assert_eq!(ids(&app, "people=true&model=nobody").await, Vec::<String>::new());
    let games = paged(&app, "people=true&limit=1&sort=oldest").await;
    assert_eq!((&games[0]["id"], &games[1]["id"]), (&json!(alone.id), &json!(mixed.id)));
    assert_eq!(app.show(&mixed).await["people"], true);
}

#[tokio::test]
async fn models_of_games_that_anyone_may_read_are_listed_by_name() {
    let app = TestApp::start().await;
    for model in ["b", "a", "b", "C", "ä"] {
        app.create(with(request(1, 1), "model", json!(model))).await;
    }
    let hidden = with(with(request(1, 1), "model", json!("hidden")), "visibility", json!("owner"));
    let hidden = app.create(hidden).await;
    let models = async |query: &str| app.get(&format!("/api/v1/models{query}")).ok().await;
    assert_eq!(models("").await, json!({ "items": ["C", "a", "b", "ä"], "next_cursor": null }));
    assert_eq!(models("?limit=2").await, json!({ "items": ["C", "a"], "next_cursor": "a" }));
    assert_eq!(models("?limit=2&cursor=a").await["items"], json!(["b", "ä"]));
    finish(&app, &hidden).await;
    assert_eq!(models("?cursor=b").await["items"], json!(["hidden", "ä"]));
    app.get("/api/v1/models?limit=1001").problem(400, "malformed").await;
}
