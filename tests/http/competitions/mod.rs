//! Competitions: created, entered, played, closed, shown.

mod export;

use std::collections::BTreeSet;
use std::time::Duration;

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{TestApp, fields, list, number};
use crate::cup::{Attempt, Cup, pass_minutes, request, server};

fn texts(values: &[Value], field: &str) -> Vec<String> {
    values.iter().map(|value| value[field].as_str().unwrap_or("-").to_owned()).collect()
}

#[tokio::test]
async fn whatever_is_wrong_with_a_competition_is_named() {
    let app = server().await;
    let with = |path: &str, value: Value| {
        let mut body = request();
        let mut place = &mut body;
        for name in path.split('.') {
            place = &mut place[name];
        }
        *place = value;
        body
    };
    for (body, field) in [
        (with("name", json!("")), "name"),
        (with("name", Value::Null), "name"),
        (with("opens_at", Value::Null), "opens_at"),
        (with("closes_at", Value::Null), "closes_at"),
        (with("closes_at", json!("2026-03-01T12:10:00Z")), "closes_at"),
        (with("closes_at", json!("next week")), "closes_at"),
        (with("clocks", Value::Null), "clocks.round_deadline_s"),
        (with("clocks.round_deadline_s", json!(0)), "clocks.round_deadline_s"),
        (with("clocks.bank_s", json!(-1)), "clocks.bank_s"),
        (with("entry", json!("friends")), "entry"),
        (with("counts", json!("worst")), "counts"),
        (with("board", json!("green")), "board"),
        (with("board", json!("frozen")), "board_freezes_at"),
        (with("attempts", json!(0)), "attempts"),
        (with("attempts", json!(101)), "attempts"),
        (with("attempts", json!("many")), "attempts"),
        (with("attempts", json!([{ "opens_at": "2026-03-01T12:00:00Z" }])), "attempts[0].opens_at"),
        (with("suite.tasks", json!(["Chess"])), "suite.tasks"),
        (with("suite.seeds", json!(0)), "suite.seeds"),
        (with("suite.settings.width", json!(2)), "suite.settings.width"),
        (with("suite.settings.depth", json!(2)), "suite"),
        (with("parallel", json!(0)), "parallel"),
        (with("entries_per_key", json!(0)), "entries_per_key"),
        (with("prize", json!(1000)), "prize"),
    ] {
        let call = app.post("/api/v1/competitions").token(&app.organizer).json(&body);
        let named = fields(&call.problem(422, "invalid").await);
        assert!(named.contains(&field.to_owned()), "{field}: {named:?}");
    }
    let all = app.post("/api/v1/competitions").token(&app.organizer).json(&json!({}));
    let named = fields(&all.problem(422, "invalid").await);
    assert_eq!(named, ["name", "opens_at", "closes_at", "clocks.round_deadline_s"]);
    assert_eq!(list(&app.get("/api/v1/competitions").ok().await["items"]).len(), 0);
}

#[tokio::test]
async fn the_commitment_is_there_from_the_beginning_and_the_seeds_are_not() {
    let mut app = server().await;
    let cup = Cup::with(&app, json!({})).await;
    let commitment = cup.created["commitment"].as_str().expect("a text").to_owned();
    assert_eq!(commitment.len(), 64);
    let shown = cup.show(&app).await;
    assert_eq!(shown, cup.created);
    assert_eq!((&shown["phase"], &shown["salt"]), (&json!("announced"), &Value::Null));
    assert_eq!(shown["seeds"], Value::Null);
    let listed = app.get("/api/v1/competitions").ok().await;
    assert_eq!(list(&listed["items"]), [shown]);
    app.restart().await;
    pass_minutes(&app, 10).await;
    assert_eq!(cup.show(&app).await["phase"], "open");
    // Nobody plays, so it is closed as soon as its time is over.
    pass_minutes(&app, 50).await;
    let closed = cup.closed(&app).await;
    assert_eq!(closed["commitment"], commitment.as_str());
    let hex = |text: &Value| {
        data_encoding::HEXLOWER.decode(text.as_str().expect("text").as_bytes()).expect("hex")
    };
    let seeds: Vec<u8> = list(&closed["seeds"]).iter().flat_map(hex).collect();
    assert_eq!(seeds.len(), 2 * 2 * 16);
    let hash = <sha2::Sha256 as sha2::Digest>::digest([hex(&closed["salt"]), seeds].concat());
    assert_eq!(data_encoding::HEXLOWER.encode(&hash), commitment);
}

#[tokio::test]
async fn competitions_are_listed_page_by_page() {
    let app = server().await;
    let mut made = Vec::new();
    for place in 0..3 {
        made.insert(0, Cup::with(&app, json!({ "name": format!("cup {place}") })).await.id);
    }
    let first = app.get("/api/v1/competitions?limit=2").ok().await;
    let cursor = first["next_cursor"].as_str().expect("there is more");
    let rest = app.get(&format!("/api/v1/competitions?limit=2&cursor={cursor}")).ok().await;
    assert_eq!(rest["next_cursor"], Value::Null);
    let ids = [list(&first["items"]), list(&rest["items"])].concat();
    assert_eq!(texts(&ids, "id"), made);
    app.get("/api/v1/competitions?limit=0").problem(400, "malformed").await;
    app.get("/api/v1/competitions?cursor=x").problem(400, "malformed").await;
}

#[tokio::test]
async fn who_has_no_key_gets_one_that_is_good_for_the_competition_alone() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let task = json!({ "task": "Flocking" });
    app.post("/api/v1/episodes").token(&blue.key).json(&task).problem(403, "forbidden").await;
    let key = json!({ "name": "more" });
    app.post("/api/v1/keys").token(&blue.key).json(&key).problem(403, "forbidden").await;
    let path = cup.path(&format!("/entrants/{}", blue.id));
    let own = app.get(&path).token(&blue.key).ok().await;
    assert_eq!((&own["name"], &own["attempts"]), (&json!("blue"), &json!([])));
    // Results are nobody else's before the board shows them.
    let red = cup.enter(&app, "red").await;
    app.get(&path).token(&red.key).problem(403, "forbidden").await;
    app.get(&path).problem(401, "unauthorized").await;
    app.get(&path).token(&app.organizer).ok().await;
    let listed = app.get(&cup.path("/entrants")).ok().await;
    assert_eq!(texts(&list(&listed["items"]), "name"), ["blue", "red"]);
    assert!(!listed.to_string().contains("secret_"), "{listed}");
    let change = app.call(Method::PATCH, &path).token(&blue.key).json(&json!({ "vouched": true }));
    change.problem(403, "forbidden").await;
    for (entry, field) in [
        (json!({ "name": "Blue ", "model": "m" }), "name"),
        (json!({ "name": "", "model": "m" }), "name"),
        (json!({ "name": "green" }), "model"),
        (json!({ "name": "green", "model": "m", "temperature": -1 }), "temperature"),
        (json!({ "name": "green", "model": "m", "top_p": 2 }), "top_p"),
        (json!({ "name": "green", "model": "m", "prompt_template": "{{" }), "prompt_template"),
        (json!({ "name": "green", "model": "m", "code": "x" }), "code"),
        (
            json!({ "name": "green", "model": "m", "agent_meta": { "a": "x".repeat(20_000) } }),
            "agent_meta",
        ),
    ] {
        let call = app.post(&cup.path("/entrants")).json(&entry);
        assert_eq!(fields(&call.problem(422, "invalid").await), [field], "{entry}");
    }
}

#[tokio::test]
async fn a_key_enters_as_often_as_it_may_and_another_model_is_another_entrant() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 2 })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let enter = |model: &str| {
        let entry = json!({ "name": format!("with {model}"), "model": model });
        app.post(&cup.path("/entrants")).token(&member).json(&entry)
    };
    let first = enter("one").ok().await;
    assert_eq!(first["key"], Value::Null, "it has a key");
    let second = enter("two").ok().await;
    assert_ne!(first["id"], second["id"]);
    enter("three").problem(403, "forbidden").await;
    // With two entrants it has to say for which one it starts.
    let start = |body: Value| app.post(&cup.path("/attempts")).token(&member).json(&body);
    assert_eq!(fields(&start(json!({})).problem(422, "invalid").await), ["entrant"]);
    let started = start(json!({ "entrant": second["id"] })).ok().await;
    assert_eq!(started["entrant"], second["id"]);
    start(json!({ "entrant": "ent_0" })).problem(403, "forbidden").await;
    // An organizer's own entrants are vouched for.
    let entry = json!({ "name": "house", "model": "m" });
    let own = app.post(&cup.path("/entrants")).token(&app.organizer).json(&entry).ok().await;
    assert_eq!((&own["vouched"], &first["vouched"]), (&json!(true), &json!(false)));
}

#[tokio::test]
async fn an_invitation_code_is_good_once() {
    let app = server().await;
    let cup = Cup::with(&app, json!({ "entry": "codes" })).await;
    let other = Cup::with(&app, json!({ "entry": "codes" })).await;
    let codes = async |cup: &Cup, labels: Value| {
        let call = app.post(&cup.path("/codes")).token(&app.organizer);
        call.json(&json!({ "labels": labels })).ok().await
    };
    let made = codes(&cup, json!(["team blue", "team red"])).await;
    let code = |place: usize| made["items"][place]["code"].as_str().expect("a code").to_owned();
    assert_eq!(made["items"][1]["label"], "team red");
    let elsewhere = codes(&other, json!(["them"])).await["items"][0]["code"].clone();
    let enter = |name: &str, code: Value| {
        let entry = json!({ "name": name, "model": "m", "code": code });
        app.post(&cup.path("/entrants")).json(&entry)
    };
    for wrong in [Value::Null, json!("invite_x"), elsewhere, json!(app.organizer)] {
        enter("blue", wrong).problem(403, "forbidden").await;
    }
    // A name that is not allowed uses no code up.
    enter("", json!(code(0))).problem(422, "invalid").await;
    enter("blue", json!(code(0))).ok().await;
    enter("red", json!(code(0))).problem(403, "forbidden").await;
    enter("red", json!(code(1))).ok().await;
    // Of many who use one at the same time one is let in.
    let last = codes(&cup, json!(["last"])).await["items"][0]["code"].clone();
    let all = futures::future::join_all((0..8).map(|place| {
        let call = enter(&format!("racer {place}"), last.clone());
        async move { call.send().await.status }
    }));
    let mut all = all.await;
    all.sort_unstable();
    assert_eq!(all, [201, 403, 403, 403, 403, 403, 403, 403]);
    // A code is no token.
    app.get("/api/v1/episodes").token(&code(1)).problem(401, "unauthorized").await;
    for (labels, field) in [
        (json!([]), "labels"),
        (json!(["x".repeat(101)]), "labels[0]"),
        (json!(["a", "b\n"]), "labels[1]"),
    ] {
        let call = app.post(&cup.path("/codes")).token(&app.organizer);
        let call = call.json(&json!({ "labels": labels }));
        assert_eq!(fields(&call.problem(422, "invalid").await), [field]);
    }
    pass_minutes(&app, 60).await;
    enter("late", json!(code(1))).problem(409, "closed").await;
    let call = app.post(&cup.path("/codes")).token(&app.organizer);
    call.json(&json!({ "labels": ["late"] })).problem(409, "closed").await;
}

#[tokio::test]
async fn attempts_are_started_within_their_number_and_their_windows() {
    let app = server().await;
    let windows = json!([
        { "closes_at": "2026-03-01T12:20:00Z" },
        { "opens_at": "2026-03-01T12:30:00Z" },
    ]);
    let cup = Cup::with(&app, json!({ "attempts": windows })).await;
    let blue = cup.enter(&app, "blue").await;
    let start = |body: Value| app.post(&cup.path("/attempts")).token(&blue.key).json(&body);
    app.pass(Duration::from_millis(10 * 60_000 - 1));
    start(json!({})).problem(409, "closed").await;
    app.pass(Duration::from_millis(1));
    // Nobody scouts the second one.
    start(json!({ "attempt": 2 })).problem(409, "closed").await;
    let started = start(json!({})).ok().await;
    assert_eq!((&started["attempt"], &started["games"]), (&json!(1), &json!(4)));
    assert_eq!(started["closes_at"], "2026-03-01T12:20:00Z");
    for again in [json!({}), json!({ "attempt": 1 }), json!({ "attempt": 3 })] {
        start(again).problem(409, "closed").await;
    }
    // The first window closes for entrants that have not started.
    let red = cup.enter(&app, "red").await;
    app.pass(Duration::from_millis(10 * 60_000 - 1));
    let last = app.post(&cup.path("/attempts")).token(&red.key).json(&json!({ "attempt": 1 }));
    assert_eq!(last.ok().await["attempt"], 1);
    let green = cup.enter(&app, "green").await;
    app.pass(Duration::from_millis(1));
    let late = app.post(&cup.path("/attempts")).token(&green.key).json(&json!({ "attempt": 1 }));
    late.problem(409, "closed").await;
    pass_minutes(&app, 10).await;
    assert_eq!(start(json!({})).ok().await["attempt"], 2);
    app.post(&cup.path("/attempts")).json(&json!({})).problem(401, "unauthorized").await;
    let (stranger, _) = app.key(json!({ "name": "stranger" })).await;
    let call = app.post(&cup.path("/attempts")).token(&stranger).json(&json!({}));
    call.problem(403, "forbidden").await;
}

#[tokio::test]
async fn an_attempt_has_the_same_seeds_for_all_and_no_other_attempt_has_them() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "parallel": 4 })).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let mut seeds: Vec<BTreeSet<(String, u64)>> = Vec::new();
    for entrant in [&blue, &red, &blue, &red] {
        let attempt = cup.start(&app, entrant).await;
        let episodes = attempt.episodes(&app).await;
        let seed = |episode: &Value| {
            let task = episode["task"].as_str().expect("a task").to_owned();
            (task, number(&episode["config"]["seed"]))
        };
        seeds.push(episodes.iter().map(seed).collect());
    }
    assert_eq!(seeds[0].len(), 4);
    assert_eq!((&seeds[0], &seeds[2]), (&seeds[1], &seeds[3]));
    let plain = |of: &BTreeSet<(String, u64)>| of.iter().map(|(_, seed)| *seed).collect();
    let (first, second): (BTreeSet<u64>, BTreeSet<u64>) = (plain(&seeds[0]), plain(&seeds[2]));
    assert_eq!((first.len(), second.len()), (2, 2), "every task is played on each");
    assert!(first.is_disjoint(&second));
}

#[tokio::test]
async fn a_start_that_is_repeated_gives_the_same_attempt_a_new_token() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let start = |key: &str, body: Value| {
        let call = app.post(&cup.path("/attempts")).token(key).json(&body);
        call.header("Idempotency-Key", "first")
    };
    let first = Attempt::of(&start(&blue.key, json!({})).ok().await);
    first.look(&app).await;
    let again = Attempt::of(&start(&blue.key, json!({})).ok().await);
    assert_eq!((&first.run, first.number), (&again.run, again.number));
    assert_ne!(first.swarm, again.swarm);
    app.get("/swarm/obs").token(&first.swarm).problem(401, "unauthorized").await;
    again.look(&app).await;
    start(&blue.key, json!({ "attempt": 2 })).problem(422, "invalid").await;
    // Everybody has names of their own.
    assert_ne!(Attempt::of(&start(&red.key, json!({})).ok().await).run, first.run);
    // Of many that start at the same time each attempt is started once.
    let green = cup.enter(&app, "green").await;
    let all = futures::future::join_all((0..6).map(|_| {
        let call = app.post(&cup.path("/attempts")).token(&green.key).json(&json!({}));
        async move { call.send().await.status }
    }));
    let mut all = all.await;
    all.sort_unstable();
    assert_eq!(all, [201, 201, 409, 409, 409, 409]);
}

#[tokio::test]
async fn entrants_of_one_key_give_their_starts_the_same_name() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 8 })).await;
    let (member, _) = app.key(json!({ "name": "a member" })).await;
    let mut entrants = Vec::new();
    for number in 0..8 {
        let entry = json!({ "name": format!("team {number}"), "model": "m" });
        let made = app.post(&cup.path("/entrants")).token(&member).json(&entry).ok().await;
        entrants.push(made["id"].clone());
    }
    let starts = entrants.iter().map(|entrant| {
        let call = app.post(&cup.path("/attempts")).token(&member);
        call.header("idempotency-key", "the same").json(&json!({ "entrant": entrant })).send()
    });
    let started = futures::future::join_all(starts).await;
    let runs: BTreeSet<String> =
        started.iter().map(|start| start.json()["run"].to_string()).collect();
    assert!(started.iter().all(|start| start.status == 201));
    assert_eq!(runs.len(), 8, "each has its own");
    app.get("/readyz").ok().await;
}

#[tokio::test]
async fn names_that_look_the_same_are_the_same() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    cup.enter(&app, "blue").await;
    let enter = |name: &str| {
        let entry = json!({ "name": name, "model": "m" });
        app.post(&cup.path("/entrants")).json(&entry).send()
    };
    for name in ["blue", " BLUE", "blu\u{435}", "bl\u{200b}ue", "\u{202e}eulb", "   ", "a\u{2028}b"]
    {
        let refused = enter(name).await;
        assert_eq!(refused.status, 422, "{name:?}: {}", refused.text());
        assert_eq!(refused.json()["fields"][0]["field"], "name");
    }
    assert_eq!(enter("green").await.status, 201);
    assert_eq!(enter("\u{3164}").await.status, 422);
}

#[tokio::test]
async fn models_that_look_the_same_are_written_the_same() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let enter = |name: &str, model: &str| {
        let entry = json!({ "name": name, "model": model });
        app.post(&cup.path("/entrants")).json(&entry).send()
    };
    assert_eq!(enter("blue", "family-1").await.status, 201);
    assert_eq!(enter("red", "family-1").await.status, 201, "many may play with one model");
    for model in [
        "Family-1",
        "fam\u{456}ly-1",
        "family-l",
        "family\u{3164}-1",
        "\u{3164}",
        "buiIt-in/random",
    ] {
        let refused = enter("green", model).await;
        assert_eq!(refused.status, 422, "{model:?}: {}", refused.text());
        assert_eq!(refused.json()["fields"][0]["field"], "model", "{model:?}");
    }
    assert_eq!(enter("green", "family-2").await.status, 201);
    let hidden = json!({ "task": "Pursuit", "model": "a\u{ffa0}" });
    app.post("/api/v1/episodes").token(&app.organizer).json(&hidden).problem(422, "invalid").await;
    let label = json!({ "labels": ["good", "\u{3164}"] });
    let call = app.post(&cup.path("/codes")).token(&app.organizer).json(&label);
    assert_eq!(call.problem(422, "invalid").await["fields"][0]["field"], "labels[1]");
}

/// Where a name is given: the path, the field, and the body with a name.
type Place<'a> = (String, &'a str, Box<dyn Fn(&str) -> Value + 'a>);

#[tokio::test]
async fn names_have_to_be_seen_wherever_one_is_given() {
    let app = server().await;
    let open_seats = json!({ "task": "Pursuit", "num_agents": 2, "open_seats": 2 });
    let lobby = app.create_with(&app.organizer, open_seats).await;
    let suite = |name: &str| json!({ "name": name, "tasks": ["Pursuit"], "seeds": [1] });
    let cup = |name: &str| {
        let mut request = crate::cup::request();
        request["name"] = json!(name);
        request
    };
    let path = |name: &str| format!("/api/v1/{name}");
    let places: [Place<'_>; 6] = [
        (path("episodes"), "model", Box::new(|name| json!({ "task": "Pursuit", "model": name }))),
        (path("runs"), "model", Box::new(|name| json!({ "suite": "quick", "model": name }))),
        (
            path("runs"),
            "suite.name",
            Box::new(|name| json!({ "suite": suite(name), "model": "m" })),
        ),
        (lobby.path("/claims"), "model", Box::new(|name| json!({ "seats": 1, "model": name }))),
        (path("keys"), "name", Box::new(|name| json!({ "name": name }))),
        (path("competitions"), "name", Box::new(cup)),
    ];
    for (path, field, body) in places {
        let post = |name: &str| app.post(&path).token(&app.organizer).json(&body(name));
        let of_models = ["Built-in/random", "buiIt-in/random", "built-\u{456}n/random"];
        let alike = of_models.into_iter().filter(|_| field == "model");
        for name in ["\u{3164}", "a\u{3164}", "a\u{ffa0}", "a\u{200b}", "\u{202e}a"]
            .into_iter()
            .chain(alike)
        {
            let problem = post(name).problem(422, "invalid").await;
            assert_eq!(fields(&problem), [field], "{path} {name:?}: {problem}");
        }
        assert_eq!(post("ünïcode 模型").send().await.status, 201, "{path}");
    }
}

#[tokio::test]
async fn nobody_else_gets_onto_the_board_of_a_competition() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (member, _) = app.key(json!({ "name": "a member" })).await;
    let suite = json!({ "name": cup.id, "tasks": ["Pursuit"], "seeds": [1] });
    let call = app.post("/api/v1/runs").token(&member);
    let refused = call.json(&json!({ "suite": suite, "model": "m" })).send().await;
    assert_eq!(
        (refused.status, &refused.json()["fields"][0]["field"]),
        (422, &json!("suite.name"))
    );
}

#[tokio::test]
async fn only_the_organizer_ends_a_ranked_game() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    let seen = attempt.look(&app).await;
    let episode = seen["observations"][0]["episode"].as_str().expect("an id").to_owned();
    let path = format!("/api/v1/episodes/{episode}");
    app.delete(&path).token(&attempt.swarm).problem(403, "forbidden").await;
    app.delete(&path).token(&blue.key).problem(403, "forbidden").await;
    app.post(&format!("{path}/start")).token(&blue.key).problem(403, "forbidden").await;
    app.delete(&path).problem(404, "not_found").await;
    assert_eq!(app.delete(&path).token(&app.organizer).ok().await["status"], "aborted");
}

#[tokio::test]
async fn an_attempt_that_the_host_broke_may_be_played_again_on_the_same_seeds() {
    let app = server().await;
    let cup = Cup::open(&app, json!({ "attempts": 1, "parallel": 4 })).await;
    let blue = cup.enter(&app, "blue").await;
    let broken = cup.start(&app, &blue).await;
    broken.act(&app, 4).await;
    let voided = cup.void(&app, &broken, "a power cut").await;
    assert_eq!((&voided["status"], &voided["voided"]), (&json!("aborted"), &json!("a power cut")));
    // The first reason stays.
    assert_eq!(cup.void(&app, &broken, "something else").await["voided"], "a power cut");
    let again = cup.start(&app, &blue).await;
    assert_eq!((again.number, again.run == broken.run), (1, false));
    let seeds = async |attempt: &Attempt| -> BTreeSet<u64> {
        let episodes = attempt.episodes(&app).await;
        episodes.iter().map(|episode| number(&episode["config"]["seed"])).collect()
    };
    assert_eq!(seeds(&again).await, seeds(&broken).await);
    again.play(&app, 4).await;
    let rows = cup.rows(&app, None).await;
    assert_eq!((&rows[0]["attempts"], &rows[0]["voided_attempts"]), (&json!(1), &json!(1)));
    assert_eq!(rows[0]["run"], again.run.as_str());
    let call = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    call.problem(409, "closed").await;
    let path = cup.path("/attempts/run_0/void");
    let call = app.post(&path).token(&app.organizer).json(&json!({ "reason": "x" }));
    call.problem(404, "not_found").await;
    let path = cup.path(&format!("/attempts/{}/void", again.run));
    let call = app.post(&path).token(&app.organizer).json(&json!({ "reason": "" }));
    assert_eq!(fields(&call.problem(422, "invalid").await), ["reason"]);
    let call = app.post(&path).token(&blue.key).json(&json!({ "reason": "mine" }));
    call.problem(403, "forbidden").await;
}

#[tokio::test]
async fn who_is_disqualified_is_shown_with_the_reason_and_without_a_rank() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (blue, red) = (cup.enter(&app, "blue").await, cup.enter(&app, "red").await);
    let attempt = cup.start(&app, &blue).await;
    attempt.play(&app, 4).await;
    cup.start(&app, &red).await.play(&app, 0).await;
    let names = async || {
        let rows = cup.rows(&app, None).await;
        let row = |row: &Value| {
            let name = row["entrant"]["name"].as_str().expect("a name").to_owned();
            (row["rank"].as_u64(), name)
        };
        rows.iter().map(row).collect::<Vec<_>>()
    };
    assert_eq!(names().await, [(Some(1), "blue".to_owned()), (Some(2), "red".to_owned())]);
    let path = cup.path(&format!("/entrants/{}", blue.id));
    let change = |body: Value| app.call(Method::PATCH, &path).token(&app.organizer).json(&body);
    for (body, field) in [
        (json!({ "status": "disqualified" }), "reason"),
        (json!({ "status": "banned", "reason": "x" }), "status"),
        (json!({ "reason": "x" }), "reason"),
        (json!({ "status": "withdrawn", "reason": "" }), "reason"),
        (json!({ "rank": 1 }), "rank"),
    ] {
        assert_eq!(fields(&change(body).problem(422, "invalid").await), [field]);
    }
    let reason = "two entrants of one team";
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": reason })).await;
    assert_eq!(names().await, [(Some(1), "red".to_owned()), (None, "blue".to_owned())]);
    let rows = cup.rows(&app, None).await;
    assert_eq!(rows[1]["entrant"]["reason"], reason);
    assert!(rows[1]["total"].is_number(), "{}", rows[1]);
    let call = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
    let problem = call.problem(403, "forbidden").await;
    assert!(problem["detail"].as_str().expect("a text").contains(reason), "{problem}");
    // It can be taken back, and the word of an organizer is shown.
    let changed = cup.change(&app, &blue, json!({ "status": "active", "vouched": true })).await;
    assert_eq!((&changed["reason"], &changed["vouched"]), (&Value::Null, &json!(true)));
    assert_eq!(names().await[0].1, "blue");
    cup.start(&app, &blue).await;
    cup.change(&app, &red, json!({ "status": "withdrawn" })).await;
    assert_eq!(cup.rows(&app, None).await[1]["entrant"]["status"], "withdrawn");
}

#[tokio::test]
async fn the_board_is_public_hidden_or_frozen_and_organizers_see_all_of_it() {
    let app = server().await;
    let public = Cup::with(&app, json!({})).await;
    let hidden = Cup::with(&app, json!({ "board": "hidden" })).await;
    let freezes = json!({ "board": "frozen", "board_freezes_at": "2026-03-01T12:30:00Z" });
    let frozen = Cup::open(&app, freezes).await;
    let mut entrants = Vec::new();
    for cup in [&public, &hidden, &frozen] {
        let blue = cup.enter(&app, "blue").await;
        cup.start(&app, &blue).await.play(&app, 0).await;
        entrants.push(blue);
    }
    let board = async |cup: &Cup| app.get(&cup.path("/board")).ok().await;
    for (cup, shows, rows) in
        [(&public, "totals", 1), (&hidden, "nothing", 0), (&frozen, "totals", 1)]
    {
        let shown = board(cup).await;
        assert_eq!((&shown["shows"], list(&shown["items"]).len()), (&json!(shows), rows));
        for row in list(&shown["items"]) {
            // The means of single tasks could be those of single games.
            assert_eq!((&row["rank"], &row["tasks"]), (&json!(1), &json!([])));
            assert_eq!(row["decentralization"], "declared");
        }
        let all = app.get(&cup.path("/board")).token(&app.organizer).ok().await;
        assert_eq!((&all["shows"], list(&all["items"][0]["tasks"]).len()), (&json!("all"), 2));
    }
    let before = board(&frozen).await["items"][0]["total"].clone();
    // A second attempt is better, and over when the board is frozen, to the millisecond.
    pass_minutes(&app, 20).await;
    let second = frozen.start(&app, &entrants[2]).await;
    second.play(&app, 4).await;
    let shown = board(&frozen).await;
    assert_eq!(
        (&shown["items"][0]["total"], &shown["frozen_at"]),
        (&before, &json!("2026-03-01T12:30:00Z"))
    );
    assert_eq!(shown["items"][0]["attempts"], 1);
    let all = app.get(&frozen.path("/board")).token(&app.organizer).ok().await;
    assert_eq!(all["items"][0]["attempts"], 2);
    assert_ne!(all["items"][0]["total"], before);
    // Its holder sees the result at once.
    let path = frozen.path(&format!("/entrants/{}", entrants[2].id));
    let own = app.get(&path).token(&entrants[2].key).ok().await;
    assert_eq!(own["attempts"][1]["total"], all["items"][0]["total"]);
    assert_eq!(own["attempts"][1]["tasks"], all["items"][0]["tasks"]);
    // At the end everything is open.
    pass_minutes(&app, 40).await;
    for cup in [&public, &hidden, &frozen] {
        cup.closed(&app).await;
        let shown = board(cup).await;
        assert_eq!((&shown["shows"], list(&shown["items"]).len()), (&json!("all"), 1));
    }
    let csv = app.get(&frozen.path("/board?format=csv")).send().await;
    assert_eq!((csv.status, csv.header("content-type")), (200, "text/csv; charset=utf-8"));
    let text = csv.text();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let head: Vec<String> = reader.headers().expect("a head").iter().map(str::to_owned).collect();
    let row = reader.records().next().expect("a row").expect("a row");
    let cell = |name: &str| {
        row[head.iter().position(|column| column == name).expect("a column")].to_owned()
    };
    let total = all["items"][0]["total"].as_f64().expect("a number");
    assert_eq!(
        (cell("rank"), cell("name"), cell("total")),
        ("1".to_owned(), "blue".to_owned(), total.to_string())
    );
    assert_eq!(cell("Pursuit_games"), "2");
    app.get(&frozen.path("/board?format=xml")).problem(400, "malformed").await;
}

#[tokio::test]
async fn what_was_not_played_counts_as_nothing() {
    let app = server().await;
    let clocks = json!({ "round_deadline_s": 10, "idle_timeout_s": 60 });
    let mut suite = request()["suite"].clone();
    suite["settings"]["max_round"] = json!(50);
    let cup = Cup::open(&app, json!({ "clocks": clocks, "suite": suite })).await;
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    for _ in 0..3 {
        attempt.act(&app, 4).await;
    }
    // Two games were played; then nobody acts any more, and the next ones are abandoned.
    let path = cup.path(&format!("/entrants/{}", blue.id));
    let own = async || app.get(&path).token(&blue.key).ok().await["attempts"][0].clone();
    for second in 0..10_000 {
        if second < 100 {
            app.pass(Duration::from_secs(1));
        }
        if own().await["status"] != "running" {
            break;
        }
    }
    let shown = own().await;
    let tasks = list(&shown["tasks"]);
    assert_eq!(tasks.len(), 2, "{shown}");
    assert_eq!((&shown["status"], &shown["games_ended"]), (&json!("abandoned"), &json!(2)));
    for (task, games) in tasks.iter().zip([0, 2]) {
        assert_eq!((&task["games"], &task["planned"]), (&json!(games), &json!(2)), "{shown}");
    }
    assert_eq!((&tasks[0]["mean"], &tasks[0]["deviation"]), (&json!(0.0), &json!(0.0)));
    let row = &cup.rows(&app, None).await[0];
    assert_eq!((&row["total"], &row["run"]), (&shown["total"], &json!(attempt.run)));
    assert!(row["clock_share"].as_f64() > Some(0.0), "{row}");
}

/// What happens at the closing time, to the millisecond.
mod closing {
    use super::*;

    /// A cup in which one game of four rounds is open at a time.
    async fn started(app: &TestApp) -> (Cup, Attempt) {
        let suite = json!({
            "tasks": ["Synchronization"], "seeds": 2,
            "settings": { "num_agents": 2, "max_round": 4, "view_size": 3 },
        });
        let cup = Cup::open(app, json!({ "suite": suite, "parallel": 1 })).await;
        let blue = cup.enter(app, "blue").await;
        let attempt = cup.start(app, &blue).await;
        (cup, attempt)
    }

    /// Lets every round but the last run until just before the closing time, at 13:00.
    async fn until_closing(app: &TestApp, attempt: &Attempt) {
        // Every round takes its whole clock; those that wait wake every ten seconds.
        attempt.act(app, 0).await;
        app.pass(Duration::from_secs(5));
    }

    async fn games(app: &TestApp, attempt: &Attempt) -> Vec<(String, u64)> {
        let mut all = attempt.episodes(app).await;
        all.reverse();
        let game = |game: &Value| {
            let reason = game["result"]["reason"].as_str().unwrap_or("running").to_owned();
            (reason, number(&game["round"]))
        };
        all.iter().map(game).collect()
    }

    #[tokio::test]
    async fn the_round_that_runs_may_end_and_no_other_begins() {
        let app = server().await;
        let (cup, attempt) = started(&app).await;
        // 12:10: nobody acts for 49 minutes and 55 seconds, but the clocks would run out. So the attempt is started
        // late instead.
        cup.void(&app, &attempt, "a rehearsal").await;
        app.pass(Duration::from_secs(50 * 60 - 5));
        let (blue, red) = (cup.enter(&app, "late").await, cup.enter(&app, "red").await);
        let attempt = cup.start(&app, &blue).await;
        let other = cup.start(&app, &red).await;
        until_one_round(&app, &attempt).await;
        app.pass(Duration::from_millis(4_999));
        assert_eq!(cup.show(&app).await["phase"], "open");
        // A round that is resolved just before is followed by another one, ...
        attempt.act(&app, 4).await;
        assert_eq!(number(&attempt.look(&app).await["observations"][0]["round"]), 2);
        app.pass(Duration::from_millis(1));
        assert_eq!(cup.show(&app).await["phase"], "closing");
        let start = app.post(&cup.path("/attempts")).token(&blue.key).json(&json!({}));
        start.problem(409, "closed").await;
        // ... which may still be played, and is the last.
        assert_eq!(number(&attempt.look(&app).await["observations"][0]["round"]), 2);
        attempt.act(&app, 4).await;
        let seen = attempt.look(&app).await;
        assert_eq!((&seen["observations"], &seen["finished"]), (&json!([]), &json!(true)));
        assert_eq!(games(&app, &attempt).await, [("closed".to_owned(), 3)]);
        // The other one has its clock, to the end: its round began at 12:59:55.
        assert_eq!(cup.show(&app).await["phase"], "closing");
        assert_eq!(games(&app, &other).await, [("running".to_owned(), 0)]);
        app.pass(Duration::from_millis(4_999));
        assert_eq!(games(&app, &other).await, [("running".to_owned(), 0)]);
        app.pass(Duration::from_millis(1));
        cup.closed(&app).await;
        assert_eq!(games(&app, &other).await, [("closed".to_owned(), 1)]);
        // What was played counts, what was not counts as 0.
        let rows = cup.rows(&app, None).await;
        assert_eq!(texts(&rows, "run_status")[..2], ["closed", "closed"]);
        let task = &rows[0]["tasks"][0];
        assert_eq!((&task["games"], &task["planned"]), (&json!(1), &json!(2)));
        assert_eq!(rows[0]["run"], attempt.run.as_str());
    }

    async fn until_one_round(app: &TestApp, attempt: &Attempt) {
        attempt.act(app, 4).await;
        assert_eq!(number(&attempt.look(app).await["observations"][0]["round"]), 1);
    }

    #[tokio::test]
    async fn a_server_that_was_down_over_the_closing_time_catches_up() {
        let mut app = server().await;
        let (cup, attempt) = started(&app).await;
        attempt.act(&app, 4).await;
        app.stop().await;
        pass_minutes(&app, 100).await;
        app.start_again().await;
        // The round that was open gets its full clock again, and is the last.
        let seen = attempt.look(&app).await;
        assert_eq!(number(&seen["observations"][0]["round"]), 1);
        assert_eq!(cup.show(&app).await["phase"], "closing");
        let blue = app.post(&cup.path("/entrants")).json(&json!({ "name": "x", "model": "m" }));
        blue.problem(409, "closed").await;
        app.pass(Duration::from_secs(10));
        cup.closed(&app).await;
        assert_eq!(games(&app, &attempt).await, [("closed".to_owned(), 2)]);
        assert_eq!(cup.rows(&app, None).await[0]["run_status"], "closed");
    }

    #[tokio::test]
    async fn a_crash_in_the_last_round_loses_nothing() {
        let app = server().await;
        let (cup, attempt) = started(&app).await;
        until_closing(&app, &attempt).await;
        pass_minutes(&app, 50).await;
        // By now the clocks of the round that was open have run out, after the closing time.
        let shown = cup.closed(&app).await;
        let again = app.after_a_crash().await;
        assert_eq!(cup.show(&again).await, shown);
        assert_eq!(cup.rows(&again, None).await, cup.rows(&app, None).await);
        assert_eq!(cup.export(&again).await, cup.export(&app).await);
    }

    #[tokio::test]
    async fn the_window_of_an_attempt_closes_as_the_competition_does() {
        let app = server().await;
        let windows = json!([{ "closes_at": "2026-03-01T12:20:00Z" }]);
        let suite = json!({ "tasks": ["Synchronization"], "seeds": 2,
            "settings": { "num_agents": 2, "max_round": 4, "view_size": 3 } });
        let change = json!({ "attempts": windows, "suite": suite, "parallel": 1 });
        let cup = Cup::open(&app, change).await;
        let blue = cup.enter(&app, "blue").await;
        let attempt = cup.start(&app, &blue).await;
        app.pass(Duration::from_mins(10));
        // The clock of the first round has run out, after the closing time.
        for _ in 0..10_000 {
            if attempt.look(&app).await["finished"] == true {
                break;
            }
        }
        assert_eq!(games(&app, &attempt).await, [("closed".to_owned(), 1)]);
        let own = app.get(&cup.path("/attempts")).token(&blue.key).ok().await;
        assert_eq!(own["items"][0]["status"], "closed");
        // Its seeds are still sealed.
        assert_eq!(cup.show(&app).await["seeds"], Value::Null);
    }
}

#[tokio::test]
async fn what_organizers_do_is_in_the_audit_log() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({ "entry": "codes" })).await;
    let labels = json!({ "labels": ["blue"] });
    let codes = app.post(&cup.path("/codes")).token(&app.organizer).json(&labels).ok().await;
    let entry = json!({ "name": "blue", "model": "m", "code": codes["items"][0]["code"] });
    let made = app.post(&cup.path("/entrants")).json(&entry).ok().await;
    let blue = crate::cup::Entrant {
        id: made["id"].as_str().expect("an id").to_owned(),
        key: made["key"].as_str().expect("a key").to_owned(),
    };
    let attempt = cup.start(&app, &blue).await;
    cup.void(&app, &attempt, "a power cut").await;
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "unfair" })).await;
    let (member, key) = app.key(json!({ "name": "member" })).await;
    app.delete(&format!("/api/v1/keys/{key}")).token(&app.organizer).ok().await;
    app.delete(&format!("/api/v1/keys/{key}")).token(&app.organizer).ok().await;
    let (other, _) = app.key(json!({ "name": "other" })).await;
    let of_member = app.create_with(&other, json!({ "task": "Flocking" })).await;
    app.delete(&of_member.path("")).token(&app.organizer).ok().await;
    let own = app.create_with(&app.organizer, json!({ "task": "Flocking" })).await;
    app.delete(&own.path("")).token(&app.organizer).ok().await;
    let export = format!("/api/v1/exports/competitions/{}", cup.id);
    assert_eq!(app.get(&export).token(&app.organizer).send().await.status, 200);
    app.restart().await;
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    let mut items = list(&log["items"]);
    items.reverse();
    let audited: Vec<(String, String)> =
        texts(&items, "action").into_iter().zip(texts(&items, "subject")).collect();
    let expected = [
        ("competition.create", cup.id.as_str()),
        ("competition.codes", &cup.id),
        ("attempt.void", &attempt.run),
        ("entrant.change", &blue.id),
        ("key.create", &key),
        ("key.revoke", &key),
        ("key.create", ""),
        ("episode.abort", &of_member.id),
        ("competition.export", &cup.id),
    ];
    assert_eq!(audited.len(), expected.len(), "{audited:#?}");
    for ((action, subject), (what, of)) in audited.iter().zip(expected) {
        assert!(action == what && (of.is_empty() || of == subject), "{action} {subject}");
    }
    assert!(texts(&items, "who").iter().all(|who| who.starts_with("key_")), "{log}");
    assert_eq!(items[3]["detail"]["reason"], "unfair");
    assert!(!log.to_string().contains("invite_") && !log.to_string().contains("secret_"));
    // Page by page.
    let page = app.get("/api/v1/audit?limit=4").token(&app.organizer).ok().await;
    let cursor = page["next_cursor"].as_str().expect("there is more");
    let rest = app.get(&format!("/api/v1/audit?cursor={cursor}")).token(&app.organizer).ok().await;
    assert_eq!(list(&page["items"]).len() + list(&rest["items"]).len(), expected.len());
    app.get("/api/v1/audit").token(&member).problem(401, "unauthorized").await;
    app.get("/api/v1/audit").token(&other).problem(403, "forbidden").await;
}
