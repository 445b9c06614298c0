//! What one answer costs at most, and what a new game may not ask for.

use std::sync::LazyLock;

use serde_json::{Value, json};
use swarmbench_engine::{Control, Settings, TaskName};
use swarmbench_testkit::corners::corners;

use crate::app::{Episode, TestApp, fields, list};
use crate::cup;

/// Follows a list of one kind from its first page to its last; all its items, and how many pages it had.
async fn follow(app: &TestApp, path: &str, bytes_max: usize) -> (Vec<Value>, usize) {
    let (mut items, mut pages, mut cursor) = (Vec::new(), 0, String::new());
    loop {
        let answer = app.get(&format!("{path}{cursor}")).token(&app.organizer).send().await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert!(answer.text().len() <= bytes_max, "{} bytes", answer.text().len());
        let page = answer.json();
        items.extend(list(&page["items"]));
        pages += 1;
        match page["next_cursor"].as_str() {
            Some(next) => {
                cursor = format!("{}cursor={next}", if path.contains('?') { '&' } else { '?' });
            }
            None => return (items, pages),
        }
    }
}

#[tokio::test]
async fn lists_end_where_an_answer_is_full_and_go_on_by_their_cursor() {
    let bytes_max = 16_000;
    let app = TestApp::builder().keys().limits(|limits| limits.answer_bytes_max = bytes_max);
    let app = app.start().await;
    let meta = json!({ "notes": "x".repeat(6_000) });
    for seed in 0..5 {
        let episode =
            json!({ "task": "Flocking", "num_agents": 2, "agent_meta": meta, "seed": seed });
        app.create_with(&app.organizer, episode).await;
        let suite = json!({ "name": "mine", "tasks": ["Flocking"], "seeds": [seed] });
        let run = json!({ "suite": suite, "model": "a model", "agent_meta": meta });
        app.post("/api/v1/runs").token(&app.organizer).json(&run).ok().await;
    }
    for _ in 0..120 {
        app.key(json!({ "name": "k".repeat(100) })).await;
    }
    for (path, count) in [
        ("/api/v1/episodes?limit=1000", 10),
        ("/api/v1/runs?limit=1000", 5),
        ("/api/v1/keys", 121),
        ("/api/v1/audit?limit=1000", 120),
    ] {
        let (items, pages) = follow(&app, path, bytes_max).await;
        assert_eq!(items.len(), count, "{path}");
        assert!(pages > 1, "{path}");
        let mut ids: Vec<String> = items.iter().map(ToString::to_string).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count, "{path}: something stands on two pages");
    }
    let (items, pages) = follow(&app, "/api/v1/episodes?limit=3", usize::MAX).await;
    assert_eq!((items.len(), pages), (10, 5), "two of the large ones fit into an answer");
}

/// Follows a board as CSV from its first page to its last: what stands in a column, and how many pages there were.
async fn follow_csv(
    app: &TestApp,
    path: &str,
    column: &str,
    bytes_max: usize,
) -> (Vec<String>, usize) {
    let (mut cells, mut pages, mut cursor, mut heads) = (Vec::new(), 0, String::new(), Vec::new());
    loop {
        let call = app.get(&format!("{path}{cursor}")).token(&app.organizer);
        let answer = call.send().await;
        let text = answer.text();
        assert!(answer.status == 200 && text.len() <= bytes_max, "{} bytes", text.len());
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        heads.push(reader.headers().expect("a head").clone());
        let place = heads[0].iter().position(|name| name == column).expect("the column");
        cells.extend(reader.records().map(|record| record.expect("a record")[place].to_owned()));
        pages += 1;
        match answer.header("x-next-cursor") {
            "" => break,
            next => cursor = format!("&cursor={next}"),
        }
    }
    heads.dedup();
    assert_eq!(heads.len(), 1, "{path}: all pages have the same columns");
    (cells, pages)
}

#[tokio::test]
async fn boards_end_where_an_answer_is_full_and_go_on_by_their_cursor() {
    let bytes_max = 2_500;
    let app = TestApp::builder().manual_clock().keys();
    let app = app.limits(|limits| limits.answer_bytes_max = bytes_max).start().await;
    let cup = cup::Cup::open(&app, json!({})).await;
    for n in 0..20 {
        let entrant = cup.enter(&app, &format!("a \"quoted\" team {n}")).await;
        if n == 7 {
            cup.start(&app, &entrant).await.play(&app, 4).await;
        }
    }
    let names = |items: &[Value], at: &str| -> Vec<String> {
        items.iter().map(|row| row.pointer(at).expect("it").as_str().expect("it").into()).collect()
    };
    for (path, csv, id, column, count) in [
        (cup.path("/board"), cup.path("/board?format=csv"), "/entrant/id", "entrant", 20),
        (
            "/api/v1/leaderboard?limit=1000".to_owned(),
            "/api/v1/leaderboard?format=csv".to_owned(),
            "/id",
            "row",
            13,
        ),
    ] {
        let (items, pages) = follow(&app, &path, bytes_max).await;
        let ids = names(&items, id);
        assert_eq!(ids.len(), count, "{path}");
        assert!(pages > 1, "{path}");
        let (cells, pages) = follow_csv(&app, &csv, column, bytes_max).await;
        assert_eq!(cells, ids, "{csv}");
        assert!(pages > 1, "{csv}");
    }
    let (items, pages) = follow(&app, &cup.path("/board?limit=2"), bytes_max).await;
    assert_eq!((items.len(), pages), (20, 10));
    assert_eq!(items[0]["entrant"]["name"], "a \"quoted\" team 7");
    let page = app.get(&cup.path("/board?limit=2")).token(&app.organizer).ok().await;
    let next = page["next_cursor"].as_str().expect("a cursor").to_owned();
    // Somebody who enters while another reads does not move what is read.
    cup.enter(&app, "late").await;
    let call = app.get(&cup.path(&format!("/board?limit=2&cursor={next}"))).token(&app.organizer);
    assert_eq!(list(&call.ok().await["items"]), items[2..4]);
    for wrong in ["cursor=c1", "cursor=-", "cursor=cx-ent", "limit=0", "limit=1001"] {
        app.get(&cup.path(&format!("/board?{wrong}"))).problem(400, "malformed").await;
    }
}

/// All seats in the order in which they are given, page by page.
async fn look_at_all(
    app: &TestApp,
    swarm: &str,
    query: &str,
    bytes_max: usize,
) -> (Vec<String>, usize) {
    let (mut seen, mut pages, mut cursor) = (Vec::new(), 0, String::new());
    loop {
        let path = format!("/swarm/obs?limit=1024{query}{cursor}");
        let answer = app.get(&path).token(swarm).send().await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        let looked = answer.json();
        let observations = list(&looked["observations"]);
        if observations.is_empty() {
            return (seen, pages);
        }
        if observations.len() > 1 {
            assert!(answer.text().len() <= bytes_max, "{} bytes", answer.text().len());
        }
        seen.extend(observations.iter().map(|seen| seen["agent"].to_string()));
        pages += 1;
        cursor = format!("&after={}", looked["cursor"].as_str().expect("a cursor"));
    }
}

#[tokio::test]
async fn no_seat_is_lost_where_not_all_fit_into_an_answer() {
    let request = json!({ "task": "Flocking", "num_agents": 12, "max_round": 2 });
    for (bytes_max, least) in [(9_000, 2), (1_000, 12)] {
        let app = TestApp::builder().limits(|limits| limits.answer_bytes_max = bytes_max);
        let app = app.start().await;
        let episode = app.create(request.clone()).await;
        for query in ["", "&prompt=true"] {
            let (seen, pages) = look_at_all(&app, &episode.swarm, query, bytes_max).await;
            let all: Vec<String> = (0..12).map(|n| format!("\"Agent_{n}\"")).collect();
            assert_eq!(seen, all, "{query}");
            assert!(pages >= least && pages <= 12, "{pages} pages of {bytes_max} bytes{query}");
        }
    }
}

/// The whole text of a template of three nested loops, for all seats in one call.
#[tokio::test]
async fn a_template_that_repeats_itself_fills_no_memory() {
    let app = TestApp::start().await;
    let (loops, ends) = ("{% for a in actions %}".repeat(3), "{% endfor %}".repeat(3));
    let body = "long ".repeat(200);
    let request = |template: String| json!({ "task": "Flocking", "num_agents": 100, "width": 40, "height": 40, "prompt_template": template });
    // 5³ times 1,000 bytes each: nearly as much as a prompt may have.
    let episode = app.create(request(format!("{loops}{body}{ends}"))).await;
    let (seen, pages) = look_at_all(&app, &episode.swarm, "&prompt=true", 8_000_000).await;
    assert_eq!(seen.len(), 100);
    assert!(pages >= 2, "100 × 125 kB in {pages} answers");
    let episode = app.create(request(format!("{loops}{body}{body}{ends}"))).await;
    let call = app.get("/swarm/obs?prompt=true&limit=1024").token(&episode.swarm);
    call.problem(422, "template_failed").await;
}

#[tokio::test]
async fn new_games_see_and_send_no_more_than_a_round_can_bear() {
    let app = TestApp::builder().manual_clock().keys().start().await;
    let settings =
        json!({ "num_agents": 1024, "width": 256, "height": 256, "view_size": 513, "memory": 0 });
    let mut episode = settings.clone();
    episode["task"] = json!("Synchronization");
    let post = |path: &str, body: &Value| app.post(path).token(&app.organizer).json(body);
    let problem = post("/api/v1/episodes", &episode).problem(422, "invalid").await;
    assert_eq!(fields(&problem), ["num_agents", "num_agents"]);
    let detail = problem["detail"].as_str().expect("a text");
    assert!(
        detail.contains("× cells of a window must be at most 1048576, is 269485056"),
        "{detail}"
    );
    assert!(detail.contains("must be at most 131072, is 1048576"), "{detail}");
    let suite = json!({ "name": "mine", "tasks": ["Synchronization"], "seeds": [1, 2], "settings": settings });
    let run = json!({ "suite": suite, "model": "a model" });
    let problem = post("/api/v1/runs", &run).problem(422, "invalid").await;
    assert_eq!(fields(&problem)[0], "suite.settings.num_agents");
    let mut cup = cup::request();
    cup["suite"] = json!({ "seeds": 2, "tasks": ["Synchronization"], "settings": settings });
    let problem = post("/api/v1/competitions", &cup).problem(422, "invalid").await;
    assert_eq!(fields(&problem)[0], "suite.settings.num_agents");
}

/// Cells of the window of an agent.
fn window(settings: &Settings) -> i64 {
    match &*settings.control {
        "centralized" => settings.width * settings.height,
        _ => settings.view_size.pow(2),
    }
}

/// How many agents one of them hears at most.
fn heard(settings: &Settings) -> i64 {
    match &*settings.control {
        "centralized" => settings.num_agents,
        _ => settings.num_agents.min(window(settings)),
    }
}

/// What makes an answer large, or a round.
const COSTS: [fn(&Settings) -> i64; 6] = [
    window,
    heard,
    |settings| settings.num_agents,
    |settings| settings.num_agents * window(settings),
    |settings| settings.num_agents * heard(settings),
    |settings| settings.num_agents * settings.memory * window(settings),
];

/// The dearest new games: for each of these costs a corner of the settings where it is largest. Different tasks
/// take turns. Nothing is late in them, so that all that is said is heard at once.
static DEAREST: LazyLock<Vec<Settings>> = LazyLock::new(|| {
    let mut dearest = Vec::new();
    for control in Control::ALL {
        let tasks = TaskName::ALL.into_iter();
        let all: Vec<_> = tasks.flat_map(|task| corners(task, control)).collect();
        for (number, cost) in COSTS.iter().enumerate() {
            let most = all.iter().map(cost).max();
            let dear: Vec<_> = all.iter().filter(|settings| Some(cost(settings)) == most).collect();
            let settings =
                Settings { max_delay: 0, ..dear[number * dear.len() / COSTS.len()].clone() };
            let is_same = |other: &Settings| {
                Settings { task: settings.task.clone(), ..other.clone() } == settings
            };
            if !dearest.iter().any(is_same) {
                dearest.push(settings);
            }
        }
    }
    dearest
});

/// A request for a game with these settings.
fn request(settings: &Settings) -> Value {
    json!({
        "task": settings.task, "control": settings.control, "num_agents": settings.num_agents,
        "width": settings.width, "height": settings.height, "view_size": settings.view_size,
        "memory": settings.memory, "max_round": 100,
    })
}

/// All agents say as much as one can.
async fn talk(app: &TestApp, episode: &Episode, round: u64) {
    let act = |agent| {
        let mut act = episode.act(&json!(format!("Agent_{agent}")), round, "STAY");
        act["message"] = json!("\u{1f41d}".repeat(120));
        act
    };
    let acts: Vec<Value> = (0..episode.seats().count()).map(act).collect();
    for receipt in app.swarm_act(episode, &acts).await {
        assert_eq!(receipt["round"], round, "{receipt}");
    }
}

/// A game with these settings in which everybody has talked for some rounds.
async fn talkative(app: &TestApp, settings: &Settings, rounds: u64) -> Episode {
    let episode = app.create(request(settings)).await;
    for round in 0..rounds {
        talk(app, &episode, round).await;
    }
    episode
}

/// Asks once; the bytes of the answer, which are no more than an answer has.
async fn bytes(app: &TestApp, path: &str, token: &str) -> usize {
    let mut answer = app.get(path).token(token).send().await;
    // A busy machine may refuse heavy work after five seconds.
    for _ in 0..10 {
        if answer.status != 503 {
            break;
        }
        answer = app.get(path).token(token).send().await;
    }
    assert_eq!(answer.status, 200, "{path}: {}", answer.text());
    assert!(answer.body.len() <= 8_000_000, "{} bytes: {path}", answer.body.len());
    answer.body.len()
}

/// Of the looks of this process that wrote cells on async threads: how many wrote at most `cells` there, and how
/// many there were.
async fn looks_on_async_threads(app: &TestApp, cells: &str) -> (u64, u64) {
    let metrics = app.get("/metrics").send().await.text();
    let value = |series: String| {
        let line = metrics.lines().find_map(|line| line.strip_prefix(&series));
        line.unwrap_or_else(|| panic!("no {series}")).trim().parse().expect("a number")
    };
    let bucket = format!("swarmbench_look_cells_bucket{{thread=\"async\",le=\"{cells}\"}}");
    (value(bucket), value("swarmbench_look_cells_count{thread=\"async\"}".to_owned()))
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_dearest_requests_of_new_games_stay_within_their_bounds() {
    let app = TestApp::start().await;
    let mut most = [0; 3];
    for settings in &*DEAREST {
        let rounds = settings.memory.clamp(1, 2).unsigned_abs();
        let episode = talkative(&app, settings, rounds).await;
        let case = format!("{settings:?}");
        let last = episode.seats().count() - 1;
        for seat in [episode.seat(0), episode.seat(last)] {
            let (look, prompt) =
                (bytes(&app, "/obs", seat).await, bytes(&app, "/obs?prompt=true", seat).await);
            assert!(look <= 2_000_000, "{look} bytes: {case}");
            assert!(prompt <= 4_000_000, "{prompt} bytes: {case}");
            most[0] = look.max(most[0]);
            most[1] = prompt.max(most[1]);
        }
        let page = bytes(&app, "/swarm/obs?limit=1024", &episode.swarm).await;
        most[2] = page.max(most[2]);
        bytes(&app, "/swarm/obs?limit=8&prompt=true", &episode.swarm).await;
        let state = bytes(&app, &episode.path("/state"), &episode.swarm).await;
        assert!(state <= 250_000, "{state} bytes: {case}");
        app.delete(&episode.path("")).token(&episode.swarm).ok().await;
    }
    // Some come near: what is asked for is the dearest.
    let [look, prompt, page] = most;
    assert!(look > 1_000_000 && prompt > 2_000_000 && page > 7_000_000, "{most:?}");
    let (small, all) = looks_on_async_threads(&app, "32768").await;
    assert!(all > 0);
    assert_eq!(small, all, "more than a piece was written on an async thread");
}

/// Quotes take two bytes in an answer, and other characters six.
#[tokio::test]
async fn the_longest_prompts_of_own_templates_fit_into_an_answer() {
    let app = TestApp::start().await;
    let by_window = |settings: &&Settings| window(settings);
    let settings = DEAREST.iter().max_by_key(by_window).expect("a corner");
    let game = |text: &str| {
        let mut request = request(settings);
        let text = text.repeat(4_000 / text.len());
        request["prompt_template"] =
            json!(format!("{{% for row in views[0].cells %}}{text}{{% endfor %}}"));
        request
    };
    let episode = app.create(game("\"")).await;
    let long = bytes(&app, "/obs?prompt=true", episode.seat(0)).await;
    assert!(long > 5_000_000, "{long} bytes");
    let episode = app.create(game("\u{1}")).await;
    let call = app.get("/obs?prompt=true").token(episode.seat(0));
    let problem = call.problem(422, "template_failed").await;
    assert!(problem["detail"].to_string().contains("bytes as JSON"), "{problem}");
}
