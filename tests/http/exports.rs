//! `/api/v1/exports`: what an export holds, and who gets it.

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _};
use std::path::Path;

use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use serde_json::{Map, Value, json};
use zip::ZipArchive;

use crate::app::program::{swarmbench, text};
use crate::app::{Episode, TestApp, list, number};

/// An episode that was played, with all that its players were shown.
pub(crate) struct Played {
    pub(crate) episode: Episode,
    /// Observation with prompt, and act, by round and agent.
    pub(crate) turns: Vec<Vec<(Value, Value)>>,
    pub(crate) score: Value,
}

/// Plays an episode as language models would: with answers, messages and what they cost.
pub(crate) async fn play(app: &TestApp, request: Value) -> Played {
    let episode = app.create(request).await;
    let mut turns = Vec::new();
    loop {
        let call = app.get("/swarm/obs?limit=1024&prompt=true").token(&episode.swarm);
        let seen = list(&call.ok().await["observations"]);
        if seen.is_empty() {
            break;
        }
        let acts: Vec<Value> = seen.iter().map(|seen| act(&episode, seen)).collect();
        app.swarm_act(&episode, &acts).await;
        turns.push(seen.into_iter().zip(acts).collect());
    }
    let score = app.show(&episode).await["result"]["score"].clone();
    Played { episode, turns, score }
}

/// Every kind of act: an action, an answer that is one, an answer that is none.
fn act(episode: &Episode, seen: &Value) -> Value {
    let round = number(&seen["round"]);
    let agent = seen["agent"].as_str().expect("a name");
    let own: u64 = agent["Agent_".len()..].parse().expect("a number");
    let actions = list(&seen["actions"]);
    let turn = usize::try_from(own + round).expect("small");
    let action = actions[turn % actions.len()].as_str().expect("a name");
    let mut act = json!({ "episode": episode.id, "agent": agent, "round": round });
    match own % 3 {
        0 => {
            act["action"] = json!(action);
            if round.is_multiple_of(2) {
                act["message"] = json!(format!("I go \"{action}\" – from {own}"));
            }
        }
        1 => {
            act["response"] = json!(format!("Let me think.\nMSG: here is {own}\nACTION: {action}"));
            act["usage"] = json!({ "prompt_tokens": 100, "completion_tokens": 10 + round, "latency_ms": 1500 });
        }
        _ => act["response"] = json!("I cannot decide."),
    }
    act
}

pub(crate) fn request(task: &str) -> Value {
    json!({ "task": task, "seed": 27, "num_agents": 6, "max_round": 6, "model": "exported" })
}

pub(crate) const TASKS: [&str; 5] =
    ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"];

/// The files of an archive.
pub(crate) fn unpack(bytes: &[u8]) -> BTreeMap<String, Value> {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).expect("an archive");
    let mut files = BTreeMap::new();
    for number in 0..archive.len() {
        let mut file = archive.by_index(number).expect("an entry");
        let mut text = String::new();
        file.read_to_string(&mut text).expect("UTF-8, and the sum is right");
        let name = file.name().expect("a name").into_owned();
        files.insert(name, serde_json::from_str(&text).expect("JSON"));
    }
    files
}

/// The files of a folder.
pub(crate) fn open(folder: &Path) -> BTreeMap<String, Value> {
    let entries =
        std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
    entries
        .map(|entry| {
            let name = entry.file_name().into_string().expect("UTF-8");
            let text = std::fs::read_to_string(entry.path()).expect("UTF-8");
            (name, serde_json::from_str(&text).expect("JSON"))
        })
        .collect()
}

pub(crate) async fn dataset(app: &TestApp, query: &str) -> BTreeMap<String, Value> {
    unpack(&app.get(&format!("/api/v1/exports/dataset.zip{query}")).send().await.body)
}

pub(crate) fn keys(value: &Value) -> Vec<&str> {
    value.as_object().expect("an object").keys().map(String::as_str).collect()
}

fn sorted<const N: usize>(mut names: [&'static str; N]) -> Vec<&'static str> {
    names.sort_unstable();
    names.into()
}

/// A state's grid as the server shows it, from the cells of an export.
fn shown(grid: &Value) -> Vec<String> {
    let row = |row: &Value| list(row).iter().filter_map(Value::as_str).collect::<String>();
    list(grid).iter().map(|cells| row(cells).replace('a', "A")).collect()
}

fn seconds(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

/// Checks one game of an export against what its players and spectators were shown.
async fn check_game(app: &TestApp, files: &BTreeMap<String, Value>, played: &Played) {
    let Played { episode, turns, score } = played;
    let meta = &files["meta_log.json"][&episode.id];
    for name in [
        "model",
        "task",
        "num_agents",
        "max_round",
        "width",
        "height",
        "seed",
        "view_size",
        "rules",
        "control",
    ] {
        assert_eq!(meta[name], episode.config[name], "{name}");
    }
    let states = list(&files[&format!("game_log_{}.json", episode.id)]);
    assert_eq!(states.len(), turns.len() + 1);
    assert_eq!(&states.last().expect("a state")["score"], score);
    for (round, state) in states.iter().enumerate() {
        check_state(app, played, round, state).await;
        if let Some(before) = round.checked_sub(1) {
            // The toolkit's script for trends refuses games in which the score falls.
            for name in ["score", "timestamp"] {
                assert!(seconds(&states[before][name]) <= seconds(&state[name]), "{name}");
            }
        }
    }
    let acts = list(&files[&format!("agent_log_{}.json", episode.id)]);
    let given: Vec<_> = turns.iter().flatten().collect();
    assert_eq!(acts.len(), given.len());
    let mut tokens: BTreeMap<String, u64> = BTreeMap::new();
    for (row, (seen, act)) in acts.iter().zip(given) {
        if let Some(told) = act["usage"]["completion_tokens"].as_u64() {
            *tokens.entry(seen["agent"].to_string()).or_default() += told;
            assert_eq!(row["api_call_time"], 1.5);
        } else {
            assert_eq!(row["api_call_time"], Value::Null);
        }
        let told = tokens.get(&seen["agent"].to_string());
        assert_eq!(row["total_llm_tokens"], told.map_or(Value::Null, |all| json!(all)));
        check_act(&episode.config, &states, row, seen, act);
    }
}

/// Checks a state against the one that spectators are shown.
async fn check_state(app: &TestApp, played: &Played, round: usize, state: &Value) {
    let Played { episode, turns, .. } = played;
    let names = ["timestamp", "task", "round", "grid", "agents", "score", "messages"];
    assert_eq!(keys(state), sorted(names));
    assert!(seconds(&state["timestamp"]) > 1e9);
    let path = episode.path(&format!("/state?round={round}"));
    let now = app.get(&path).token(&episode.swarm).ok().await;
    assert_eq!((&state["round"], &state["task"]), (&json!(round), &episode.config["task"]));
    assert_eq!(state["score"], now["score"]);
    assert_eq!(json!(shown(&state["grid"])), now["grid"]);
    for cell in list(&state["grid"]).iter().flat_map(list) {
        assert_eq!(cell.as_str().map(|cell| cell.chars().count()), Some(1), "{cell}");
    }
    for (agent, at) in list(&now["agents"]).iter().zip(list(&state["agents"])) {
        assert_eq!(at, json!({ "id": agent["agent"], "x": agent["j"], "y": agent["i"] }));
        if agent["alive"] == true {
            let place = |name: &str| usize::try_from(number(&agent[name])).expect("small");
            let is_off = [&agent["light_on"], &agent["carrying_food"]].contains(&&json!(false));
            let cell = &state["grid"][place("i")][place("j")];
            assert_eq!(cell, if is_off { "a" } else { "A" });
        }
    }
    let said = round.checked_sub(1).map_or(&[][..], |before| &turns[before]);
    let said = said.iter().filter_map(|(seen, act)| {
        let text = match act["response"].as_str() {
            Some(text) => text.split_once("MSG: ")?.1.lines().next()?,
            None => act["message"].as_str()?,
        };
        Some(json!({ "round": round - 1, "agent_name": seen["agent"], "message": text }))
    });
    assert_eq!(list(&state["messages"]), said.collect::<Vec<_>>(), "round {round}");
}

/// Checks an act against what its player was shown and sent.
fn check_act(config: &Value, states: &[Value], row: &Value, seen: &Value, act: &Value) {
    let names = [
        "timestamp",
        "task",
        "round",
        "agent_id",
        "view",
        "prompt",
        "response",
        "action",
        "message",
        "api_call_time",
        "action_success",
        "total_llm_tokens",
        "model",
        "holder",
    ];
    let is_prose = act["response"].as_str().is_some_and(|text| !text.contains("ACTION: "));
    assert_eq!(row.get("failure"), is_prose.then(|| json!("no_marker")).as_ref());
    let told = keys(row).into_iter().filter(|key| *key != "failure");
    assert_eq!(told.collect::<Vec<_>>(), sorted(names));
    assert_eq!((&row["model"], &row["holder"]), (&config["model"], &json!(0)));
    assert_eq!((&row["round"], &row["agent_id"]), (&seen["round"], &seen["agent"]));
    // The prompt is the very text that the server gave to the player.
    assert_eq!(row["prompt"], seen["prompt"]);
    let agent = seen["agent"].as_str().expect("a name");
    let own = own_cell(config, seen, &agent["Agent_".len()..]);
    let cell = |cell: &Value| if cell == "Y" { json!(own) } else { cell.clone() };
    let row_of = |cells: &Value| list(cells).iter().map(cell).collect::<Vec<_>>();
    let cells: Vec<_> = list(&seen["view"]["cells"]).iter().map(row_of).collect();
    assert_eq!(row["view"], json!(cells));
    assert_eq!(row["response"], act.get("response").cloned().unwrap_or_else(|| json!("")));
    let action = match act["response"].as_str() {
        Some(text) => text.split_once("ACTION: ").map_or("STAY", |(_, action)| action),
        None => act["action"].as_str().expect("an action"),
    };
    assert_eq!(row["action"], action);
    let place = |round: u64, name: &str| {
        let agents = list(&states[usize::try_from(round).expect("small")]["agents"]);
        let at = agents.iter().find(|at| at["id"] == agent).expect("an agent");
        at[name].as_i64().expect("a place")
    };
    let round = number(&seen["round"]);
    let moved = |name: &str| place(round + 1, name) - place(round, name);
    let succeeds = match action {
        "UP" => moved("y") < 0,
        "DOWN" => moved("y") > 0,
        "LEFT" => moved("x") < 0,
        "RIGHT" => moved("x") > 0,
        other => other == "SWITCH",
    };
    assert_eq!(row["action_success"], succeeds, "{row}");
}

/// An agent's own cell, written as others see it.
fn own_cell(config: &Value, seen: &Value, number: &str) -> String {
    let flags = [&seen["light_on"], &seen["carrying_food"]];
    let marks = config["rules"] == "paper";
    let is_marked = flags.iter().any(|flag| **flag == marks);
    format!("{}{number}", if is_marked { "$" } else { "" })
}

#[tokio::test]
async fn an_export_holds_what_players_and_spectators_were_shown() {
    let app = TestApp::start().await;
    let mut all = Vec::new();
    for task in TASKS {
        all.push(play(&app, request(task)).await);
    }
    let mut other = request("Synchronization");
    other["rules"] = json!("reference");
    other["control"] = json!("centralized");
    all.push(play(&app, other).await);
    let answer = app.get("/api/v1/exports/dataset.zip").send().await;
    assert_eq!((answer.status, answer.header("content-type")), (200, "application/zip"));
    assert_eq!(answer.header("content-disposition"), "attachment; filename=\"dataset.zip\"");
    assert_eq!(answer.header("vary"), "accept");
    let bytes = app.get("/api/v1/exports/dataset.zip").header("accept", "application/octet-stream");
    let bytes = bytes.send().await;
    assert_eq!(bytes.header("content-type"), "application/octet-stream");
    assert_eq!(unpack(&bytes.body), unpack(&answer.body));
    let files = unpack(&answer.body);
    assert_eq!(files.len(), 1 + 2 * all.len());
    assert_eq!(keys(&files["meta_log.json"]).len(), all.len());
    for played in &all {
        check_game(&app, &files, played).await;
    }
}

/// The rows of a table, from JSON Lines.
async fn lines(app: &TestApp, path: &str) -> Vec<Map<String, Value>> {
    let answer = app.get(&format!("/api/v1/exports/{path}")).send().await;
    assert_eq!((answer.status, answer.header("content-type")), (200, "application/x-ndjson"));
    let row = |line: &str| match serde_json::from_str(line) {
        Ok(Value::Object(row)) => row,
        other => panic!("{other:?}"),
    };
    answer.text().lines().map(row).collect()
}

/// The rows of a table, from Parquet.
async fn rows(app: &TestApp, path: &str) -> Vec<Map<String, Value>> {
    let answer = app.get(&format!("/api/v1/exports/{path}")).send().await;
    assert_eq!(answer.header("content-type"), "application/vnd.apache.parquet");
    let file = SerializedFileReader::new(bytes::Bytes::from(answer.body)).expect("a Parquet file");
    let value = |field: &Field| match field {
        Field::Null => Value::Null,
        Field::Str(text) => json!(text),
        Field::Long(number) => json!(number),
        Field::Double(number) => json!(number),
        Field::Bool(flag) => json!(flag),
        Field::TimestampMillis(at) => {
            let at = jiff::Timestamp::from_millisecond(*at).expect("a time");
            json!(format!("{at:.3}"))
        }
        other => panic!("{other}"),
    };
    let row = |row: parquet::record::Row| {
        row.get_column_iter().map(|(name, field)| (name.clone(), value(field))).collect()
    };
    file.get_row_iter(None).expect("rows").map(|found| row(found.expect("a row"))).collect()
}

#[tokio::test]
async fn tables_say_the_same_as_lines_and_as_parquet() {
    let app = TestApp::start().await;
    let played = play(&app, request("Synchronization")).await;
    play(&app, request("Foraging")).await;
    for (table, length) in [("episodes", 2), ("acts", 2 * 36), ("rounds", 2 * 7)] {
        let (lines, rows) = (
            lines(&app, &format!("{table}.jsonl")).await,
            rows(&app, &format!("{table}.parquet")).await,
        );
        assert_eq!(lines, rows);
        assert_eq!(lines.len(), length);
        let times = lines.iter().flatten().filter(|(name, _)| name.ends_with("_at"));
        for (name, at) in times {
            let digits = at.as_str().and_then(|at| Some(at.strip_suffix('Z')?.rsplit_once('.')?.1));
            assert_eq!(digits.map(str::len), Some(3), "{name} {at}");
        }
    }
    let acts = lines(&app, "acts.jsonl?task=Synchronization").await;
    for (row, (seen, act)) in acts.iter().zip(played.turns.iter().flatten()) {
        assert_eq!((&row["episode"], &row["round"]), (&json!(played.episode.id), &seen["round"]));
        assert_eq!(json!(format!("Agent_{}", row["agent"])), seen["agent"]);
        assert_eq!((&row["i"], &row["j"]), (&seen["position"]["i"], &seen["position"]["j"]));
        let response = act.get("response").cloned().unwrap_or(Value::Null);
        assert_eq!(row["response"], response);
        assert_eq!(row["valid"], response != "I cannot decide.");
        assert_eq!(row["action"] == Value::Null, row["valid"] == false);
        assert_eq!(row["latency_ms"], act["usage"]["latency_ms"]);
        assert_eq!((&row["source"], &row["model"]), (&json!("player"), &json!("exported")));
        assert_eq!(row["run"], Value::Null);
    }
    let rounds = lines(&app, "rounds.jsonl?task=Synchronization").await;
    assert_eq!(rounds[0]["acts"], Value::Null);
    for (round, row) in rounds.iter().enumerate().skip(1) {
        assert_eq!(
            (&row["round"], &row["acts"], &row["invalid"]),
            (&json!(round), &json!(6), &json!(2))
        );
        assert_eq!(row["alive"], 6);
    }
    assert_eq!(rounds.last().expect("a round")["score"], played.score);
}

/// The row of the episode has every field of its summary.
fn check_row(row: &Map<String, Value>, summary: &Value) {
    for (name, value) in summary.as_object().expect("an object") {
        let column = match name.as_str() {
            "config" | "result" if value.is_object() => {
                check_row(row, value);
                continue;
            }
            // They follow from `agent_meta` and `open_seats`.
            "people" | "mixed" => continue,
            "id" => "episode",
            "round" => "rounds",
            "result" => "reason",
            "fork" => "fork_of",
            "start" => "start_mode",
            other => other,
        };
        let cell = &row[column];
        match value {
            Value::Number(number) => assert_eq!(cell.as_f64(), number.as_f64(), "{name}"),
            Value::Object(_) => assert_eq!(cell, &json!(value.to_string()), "{name}"),
            Value::String(text) if name.ends_with("_at") => {
                let time = |text: &str| text.parse::<jiff::Timestamp>().expect("a time");
                assert_eq!(time(cell.as_str().expect("a text")), time(text), "{name}");
            }
            Value::Null | Value::Bool(_) | Value::String(_) | Value::Array(_) => {
                assert_eq!(cell, value, "{name}");
            }
        }
    }
}

#[tokio::test]
async fn a_row_of_an_episode_has_what_its_summary_has() {
    let app = TestApp::start().await;
    let mut settings = request("Pursuit");
    for (name, value) in [
        ("noise", json!(0.5)),
        ("round_deadline_s", json!(99.5)),
        ("agent_meta", json!({ "temperature": 0.5 })),
        ("prompt_template", json!("Act.")),
    ] {
        settings[name] = value;
    }
    let all = [play(&app, settings).await, play(&app, request("Flocking")).await];
    let rows = lines(&app, "episodes.jsonl").await;
    for (row, played) in rows.iter().zip(&all) {
        check_row(row, &app.show(&played.episode).await);
        assert_eq!((&row["mixed"], &row["models"]), (&json!(false), &json!(r#"["exported"]"#)));
        assert_eq!(row["started_at"], row["created_at"]);
    }
    assert_eq!(rows.len(), all.len());
    // Neither started: one waits for that, the other was aborted while it waited for holders of seats.
    let waiting = app.create(json!({ "task": "Pursuit", "start": "manual" })).await;
    let aborted = app.create(json!({ "task": "Pursuit", "open_seats": 2 })).await;
    app.delete(&aborted.path("")).token(&aborted.swarm).ok().await;
    for (episode, status) in [(&waiting, "waiting"), (&aborted, "aborted")] {
        let path = format!("/api/v1/exports/episodes.jsonl?status={status}");
        let row = app.get(&path).token(&waiting.swarm).send().await.json();
        let shown = app.get(&episode.path("")).token(&episode.swarm).ok().await;
        check_row(row.as_object().expect("a row"), &shown);
        assert_eq!(row["started_at"], Value::Null);
        assert_eq!(row["journal_head"] == Value::Null, status == "waiting");
    }
}

/// A game of three holders: the server plays the seat of the creator, `blue` has `Agent_2` and `green` the others.
async fn play_mixed(app: &TestApp) -> String {
    let request = json!({
        "task": "Synchronization", "num_agents": 4, "max_round": 2, "model": "creator",
        "player": "random", "open_seats": 3,
    });
    let created = app.post("/api/v1/episodes").json(&request).ok().await;
    let id = created["id"].as_str().expect("an id").to_owned();
    let mut tokens = Vec::new();
    for claim in
        [json!({ "agent": "Agent_2", "model": "blue" }), json!({ "seats": 2, "model": "green" })]
    {
        let path = format!("/api/v1/episodes/{id}/claims");
        let claimed = app.post(&path).json(&claim).ok().await;
        tokens.push(claimed["swarm_token"].as_str().expect("a token").to_owned());
    }
    for token in [&tokens[..], &tokens[..]].concat() {
        let seen = app.get("/swarm/obs?wait=60").token(&token).ok().await;
        let acts = list(&seen["observations"]).into_iter().map(|seen| {
            json!({ "episode": id, "agent": seen["agent"], "round": seen["round"], "action": "STAY" })
        });
        let acts = json!({ "acts": acts.collect::<Vec<_>>() });
        app.post("/swarm/act").token(&token).json(&acts).ok().await;
    }
    let end = app.get("/swarm/obs?wait=60").token(&tokens[0]).ok().await;
    assert_eq!(end["finished"], true, "{end}");
    id
}

#[tokio::test]
async fn each_act_says_who_played_its_seat() {
    let app = TestApp::start().await;
    let mixed = play_mixed(&app).await;
    let own = play(&app, request("Pursuit")).await.episode.id;
    let holders = [
        ("creator", 0, json!("random")),
        ("green", 2, Value::Null),
        ("blue", 1, Value::Null),
        ("green", 2, Value::Null),
    ];
    let acts = lines(&app, &format!("acts.jsonl?episode={mixed}")).await;
    assert_eq!(acts.len(), 2 * holders.len());
    for (row, (model, holder, player)) in acts.iter().zip(holders.iter().cycle()) {
        assert_eq!((&row["model"], &row["holder"]), (&json!(model), &json!(holder)));
        assert_eq!((&row["player"], &row["mixed"]), (player, &json!(true)));
    }
    let episodes = lines(&app, "episodes.jsonl?mixed=true").await;
    assert_eq!(episodes.len(), 1);
    assert_eq!(episodes[0]["models"], r#"["blue","creator","green"]"#);
    assert_eq!(episodes[0]["model"], "creator");
    assert!(episodes[0]["started_at"].as_str() >= episodes[0]["created_at"].as_str());
    let rounds = lines(&app, "rounds.jsonl?mixed=true").await;
    assert!(rounds.iter().all(|row| row["mixed"] == true && row["model"] == "creator"));

    let files = dataset(&app, "?mixed=true").await;
    let meta = &files["meta_log.json"][&mixed];
    assert_eq!(meta["model"], json!(["creator", "green", "blue", "green"]));
    assert_eq!((&meta["mixed"], &meta["holders"]), (&json!(true), &json!([0, 2, 1, 2])));
    let rows = list(&files[&format!("agent_log_{mixed}.json")]);
    for (row, (model, holder, player)) in rows.iter().zip(holders.iter().cycle()) {
        assert_eq!((&row["model"], &row["holder"]), (&json!(model), &json!(holder)));
        assert_eq!(row.get("player"), Some(player).filter(|player| !player.is_null()));
    }

    // Filters.
    for (query, expected, acts) in [
        ("?mixed=false", vec![&own], 36),
        ("?model=green", vec![&mixed], 4),
        ("?model=creator", vec![&mixed], 2),
        ("?model=exported", vec![&own], 36),
        ("?model=blue&mixed=false", vec![], 0),
    ] {
        let ids: Vec<Value> = expected.into_iter().map(|id| json!(id)).collect();
        let episodes = lines(&app, &format!("episodes.jsonl{query}")).await;
        assert_eq!(episodes.iter().map(|row| row["episode"].clone()).collect::<Vec<_>>(), ids);
        assert_eq!(lines(&app, &format!("acts.jsonl{query}")).await.len(), acts, "{query}");
    }
    let other = format!("/api/v1/exports/acts.jsonl?episode={own}&mixed=true");
    app.get(&other).problem(404, "not_found").await;
    app.get("/api/v1/exports/acts.jsonl?mixed=perhaps").problem(400, "malformed").await;

    // What was exported is imported, and comes out again.
    let place = tempfile::tempdir().expect("a folder");
    let path = |name: &str| place.path().join(name).display().to_string();
    std::fs::write(
        path("games.zip"),
        app.get("/api/v1/exports/dataset.zip?mixed=true").send().await.body,
    )
    .expect("written");
    for args in [
        vec!["import".to_owned(), path("games.zip")],
        vec!["export".to_owned(), path("again"), "--imported".to_owned()],
    ] {
        let output =
            swarmbench(&[&args[..], &["--db".to_owned(), path("other.db")]].concat()).await;
        assert!(output.status.success(), "{}", text(&output.stderr));
    }
    assert_eq!(open(&place.path().join("again")), files);
}

#[tokio::test]
async fn an_export_without_games_is_an_error_that_names_models() {
    let app = TestApp::start().await;
    play(&app, request("Pursuit")).await;
    play_mixed(&app).await;
    let place = tempfile::tempdir().expect("a folder");
    let out = place.path().join("games.zip").display().to_string();
    let tables = place.path().join("tables").display().to_string();
    let db = app.db();
    let (in_file, from_server) = (["--db", &db], ["--server", app.base()]);
    let models = "models that have games: \"exported\", ";
    for (to, source, filters, said) in [
        (&out, &in_file, &["--model", "exprted"][..], models),
        (&out, &from_server, &["--model", "exprted"], models),
        (&tables, &in_file, &["--model", "exprted", "--format", "parquet"], models),
        (&out, &in_file, &["--model", "blue", "--no-mixed"], "--model blue --no-mixed"),
        (&out, &from_server, &["--model", "blue", "--no-mixed"], "--model blue --no-mixed"),
        (&out, &in_file, &["--episode", "ep_0"], "no game matches --episode ep_0"),
        (&out, &from_server, &["--episode", "ep_0"], "the episode is not known"),
        (&out, &in_file, &["--status", "aborted"], "no game matches --status aborted"),
    ] {
        let output = swarmbench(&[&["export", to][..], source, filters].concat()).await;
        let error = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{filters:?}");
        assert!(error.contains(said), "{filters:?}: {error}");
        assert_eq!(std::fs::read_dir(place.path()).expect("a folder").count(), 0, "{filters:?}");
    }
    let output =
        swarmbench(&["export", &tables, "--no-mixed", "--format", "jsonl", "--db", &db]).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    for table in ["episodes", "acts", "rounds"] {
        let lines = std::fs::read_to_string(format!("{tables}/{table}.jsonl")).expect("a table");
        assert!(lines.lines().all(|line| line.contains(r#""mixed":false"#)) && !lines.is_empty());
    }
}

#[tokio::test]
async fn only_what_may_be_read_is_exported() {
    let app = TestApp::builder().keys().start().await;
    let (owner, _) = app.key(json!({ "name": "owner" })).await;
    let (member, _) = app.key(json!({ "name": "member" })).await;
    let organizer = app.organizer.clone();
    let settings = |visibility: &str| json!({ "task": "Synchronization", "num_agents": 1, "max_round": 3, "visibility": visibility });
    let running = app.create_with(&owner, settings("owner")).await;
    let public = app.create_with(&owner, settings("public")).await;
    let over = app.create_with(&owner, settings("owner")).await;
    for episode in [&running, &public, &over] {
        app.all_act(episode, "SWITCH").await;
    }
    app.delete(&over.path("")).token(&owner).ok().await;
    let ids = |rows: &[u8]| -> Vec<String> {
        let text = String::from_utf8(rows.to_vec()).expect("UTF-8");
        let id = |line: &str| {
            let row: Value = serde_json::from_str(line).expect("a row");
            row["episode"].as_str().expect("an id").to_owned()
        };
        text.lines().map(id).collect()
    };
    let asked = async |token: Option<&str>, query: &str| {
        let call = app.get(&format!("/api/v1/exports/acts.jsonl{query}"));
        let call = match token {
            Some(token) => call.token(token),
            None => call,
        };
        call.send().await
    };
    // Without a status only what has ended, which everybody may read.
    for token in
        [None, Some(owner.as_str()), Some(&member), Some(&organizer), Some(running.seat(0))]
    {
        assert_eq!(ids(&asked(token, "").await.body), [over.id.as_str()]);
    }
    // A running episode goes to those who may read its journal: it tells the seed.
    for (token, expected) in [
        (None, vec![]),
        (Some(member.as_str()), vec![]),
        (Some(public.seat(0)), vec![]),
        (Some(&public.swarm), vec![&public]),
        (Some(&owner), vec![&running, &public]),
        (Some(&organizer), vec![&running, &public]),
    ] {
        let expected: Vec<&str> = expected.iter().map(|episode| episode.id.as_str()).collect();
        assert_eq!(ids(&asked(token, "?status=running").await.body), expected);
    }
    let one = format!("?status=running&episode={}", running.id);
    assert_eq!(asked(Some(&member), &one).await.status, 404);
    assert_eq!(ids(&asked(Some(&owner), &one).await.body), [running.id.as_str()]);
    let one = format!("?episode={}", running.id);
    assert_eq!(asked(Some(&owner), &one).await.status, 404);
    assert_eq!(dataset(&app, "").await["meta_log.json"].as_object().map(Map::len), Some(1));
}

#[tokio::test]
async fn filters_choose_and_nonsense_is_refused() {
    let app = TestApp::start().await;
    let mut ids = Vec::new();
    for (task, model) in [("Pursuit", "one"), ("Pursuit", "two"), ("Foraging", "two")] {
        let request = json!({ "task": task, "model": model, "num_agents": 2, "max_round": 1 });
        let episode = app.create(request).await;
        app.all_act(&episode, "STAY").await;
        ids.push(episode.id);
    }
    let aborted = app.create(json!({ "task": "Pursuit", "model": "one" })).await;
    app.delete(&aborted.path("")).token(&aborted.swarm).ok().await;
    for (query, expected) in [
        ("", vec![&ids[0], &ids[1], &ids[2], &aborted.id]),
        ("?task=Pursuit", vec![&ids[0], &ids[1], &aborted.id]),
        ("?model=two", vec![&ids[1], &ids[2]]),
        ("?task=Pursuit&model=two", vec![&ids[1]]),
        ("?status=aborted", vec![&aborted.id]),
        ("?status=running", vec![]),
        ("?model=three", vec![]),
        ("?run=run_0", vec![]),
    ] {
        let files = dataset(&app, query).await;
        let mut expected: Vec<&str> = expected.into_iter().map(String::as_str).collect();
        expected.sort_unstable();
        assert_eq!(keys(&files["meta_log.json"]), expected, "{query}");
        assert_eq!(files.len(), 1 + 2 * expected.len());
    }
    let files = dataset(&app, &format!("?episode={}", ids[1])).await;
    assert_eq!(keys(&files["meta_log.json"]), [ids[1].as_str()]);
    // A game of which no round was played has its layout.
    let files = dataset(&app, "?status=aborted").await;
    assert_eq!(list(&files[&format!("game_log_{}.json", aborted.id)]).len(), 1);
    assert_eq!(files[&format!("agent_log_{}.json", aborted.id)], json!([]));
    // Tables without rows.
    assert!(lines(&app, "acts.jsonl?model=three").await.is_empty());
    assert!(rows(&app, "acts.parquet?model=three").await.is_empty());
    for (path, status, code) in [
        ("dataset.tar", 404, "not_found"),
        ("acts.jsonl?episode=ep_0", 404, "not_found"),
        ("acts.jsonl?task=Chess", 400, "malformed"),
        ("acts.jsonl?status=lost", 400, "malformed"),
        ("acts.jsonl?colour=red", 400, "malformed"),
    ] {
        app.get(&format!("/api/v1/exports/{path}")).problem(status, code).await;
    }
}

/// The episodes of a run, and what of them says that they belong to it.
#[tokio::test]
async fn a_run_is_exported_by_its_id() {
    let app = TestApp::start().await;
    app.delete(&app.create(request("Pursuit")).await.path("")).send().await;
    let suite = json!({
        "name": "small", "tasks": ["Pursuit"], "seeds": [4, 9], "settings": { "num_agents": 2, "max_round": 1 },
    });
    let created =
        app.post("/api/v1/runs").json(&json!({ "suite": suite, "model": "m" })).ok().await;
    let (id, token) =
        (created["id"].as_str().expect("an id"), created["swarm_token"].as_str().expect("a token"));
    loop {
        let seen = app.get("/swarm/obs?wait=10").token(token).ok().await;
        let stay = |seen: &Value| {
            let (episode, agent) = (&seen["episode"], &seen["agent"]);
            json!({ "episode": episode, "agent": agent, "round": seen["round"], "action": "STAY" })
        };
        let acts: Vec<Value> = list(&seen["observations"]).iter().map(stay).collect();
        if acts.is_empty() && seen["finished"] == true {
            break;
        }
        app.post("/swarm/act").token(token).json(&json!({ "acts": acts })).ok().await;
    }
    let files = dataset(&app, &format!("?run={id}")).await;
    let metas = files["meta_log.json"].as_object().expect("an object");
    assert_eq!(
        metas.values().map(|meta| &meta["seed"]).collect::<Vec<_>>(),
        [&json!(4), &json!(9)]
    );
    assert!(metas.values().all(|meta| meta["run"] == id && meta["model"] == "m"));
    let rows = lines(&app, &format!("acts.jsonl?run={id}")).await;
    assert_eq!(rows.len(), 4);
    assert!(rows.iter().all(|row| row["run"] == id));
    assert_eq!(lines(&app, "rounds.jsonl").await.len(), 2 + 2 + 1);
}

#[tokio::test]
async fn exports_at_once_are_limited() {
    let app = TestApp::builder().limits(|limits| limits.exports_open_max = 0).start().await;
    let problem = app.get("/api/v1/exports/acts.jsonl").problem(503, "overloaded").await;
    assert_eq!(problem["limit"]["name"], "exports_open_max");
    // One turn, taken again and again: a turn ends with its export.
    let app = TestApp::builder().limits(|limits| limits.heavy_at_once_max = 1).start().await;
    for _ in 0..20 {
        assert_eq!(app.get("/api/v1/exports/acts.jsonl").send().await.status, 200);
    }
}

/// An episode whose journal was changed is left out and named; the others are whole.
#[tokio::test]
async fn a_game_that_does_not_replay_is_left_out() {
    let mut app = TestApp::start().await;
    let sound = play(&app, request("Pursuit")).await;
    let broken = play(&app, request("Foraging")).await;
    app.stop().await;
    let db = app.db();
    // That of the game which was created last.
    app.tamper(
        "UPDATE rounds SET digest = (SELECT digest FROM rounds WHERE round = 3 ORDER BY episode LIMIT 1)
         WHERE round = 4 AND episode = (SELECT max(key) FROM episodes)",
    )
    .await;
    let place = tempfile::tempdir().expect("a folder");
    let folder = place.path().join("games");
    let output = swarmbench(&["export", &folder.display().to_string(), "--db", &db]).await;
    let said = text(&output.stderr);
    assert!(!output.status.success() && said.contains(&broken.episode.id), "{said}");
    app.start_again().await;
    let files = dataset(&app, "").await;
    assert_eq!(files.len(), 3);
    check_game(&app, &files, &sound).await;
    assert_eq!(open(&folder), files);
    assert_eq!(lines(&app, "acts.jsonl").await.len(), 36);
}
