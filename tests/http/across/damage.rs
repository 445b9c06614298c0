//! `swarmbench verify --db` finds what is damaged: wherever a byte of a database is changed, either it is found, or
//! nothing that is kept has changed, or it is one of the few columns that follow from nothing else.

use std::collections::BTreeMap;
use std::path::Path;
use swarmbench_testkit::needs;

use serde_json::{Value, json};
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, Row};
use swarmbench::competitions::FORMATS;
use swarmbench::store::check::{Checked, check};

use crate::app::program::{printed, swarmbench};
use crate::app::{Episode, TestApp};
use crate::cup::{Cup, pass_minutes, server};

/// Fields that no hash covers: names and labels, times, who may read, and what is only said.
const UNCHECKED: [(&str, &str); 72] = [
    ("_sqlx_migrations", "description"),
    ("_sqlx_migrations", "execution_time"),
    ("_sqlx_migrations", "installed_on"),
    ("acts", "at"),
    ("acts", "waiting_for"),
    ("audit", "action"),
    ("audit", "at"),
    ("audit", "competition"),
    ("audit", "detail"),
    ("audit", "shown"),
    ("audit", "subject"),
    ("audit", "who"),
    ("claims", "agent_meta"),
    ("claims", "claimed_at"),
    ("claims", "idempotency_body"),
    ("claims", "model"),
    ("competitions", "cancel_reason"),
    ("competitions", "cancelled_at"),
    ("competitions", "created_at"),
    ("competitions", "definition"),
    ("competitions", "hidden"),
    ("competitions", "id"),
    ("competitions", "revealed_at"),
    ("entries", "address"),
    ("entries", "category"),
    ("entries", "contact"),
    ("entries", "declaration"),
    ("entries", "erased_at"),
    ("entries", "name"),
    ("entries", "published"),
    ("entries", "reason"),
    ("entries", "registered_at"),
    ("entries", "terms"),
    ("entries", "vouched"),
    ("episodes", "bytes"),
    ("episodes", "clocked"),
    // The last digits of scores that lists show are not compared.
    ("episodes", "curve"),
    ("episodes", "ended_at"),
    ("episodes", "idempotency_body"),
    ("episodes", "own_games"),
    ("episodes", "revealed"),
    ("episodes", "score"),
    ("episodes", "started_at"),
    ("episodes", "void_reason"),
    ("episodes", "voided_at"),
    ("invitations", "created_at"),
    ("invitations", "hash"),
    ("invitations", "label"),
    ("invitations", "revoked_at"),
    ("keys", "acts_for"),
    ("keys", "created_at"),
    ("keys", "expires_at"),
    ("keys", "name"),
    ("keys", "revoked_at"),
    ("keys", "role"),
    ("looks", "competition"),
    ("looks", "kind"),
    ("looks", "look"),
    ("looks", "written"),
    ("rounds", "at"),
    ("runs", "closes_at"),
    ("runs", "created_at"),
    ("runs", "definition"),
    ("runs", "ended_at"),
    ("runs", "idempotency_body"),
    ("runs", "revealed"),
    ("runs", "void_reason"),
    ("runs", "voided_at"),
    ("seats", "claimed_at"),
    ("tokens", "agent"),
    ("unmeasured", "episode"),
    ("unmeasured", "number"),
];

/// A small database with rows in most tables.
async fn database() -> Vec<u8> {
    let mut app = server().await;
    let (member, _) = app.key(json!({ "name": "a member of the team" })).await;
    let request = |more: Value| {
        let mut request = json!({ "task": "Synchronization", "num_agents": 3, "max_round": 3, "model": "a model" });
        request.as_object_mut().expect("fields").extend(more.as_object().expect("fields").clone());
        request
    };
    let finished = app.create_with(&member, request(json!({ "seed": 1 }))).await;
    for _ in 0..3 {
        app.all_act(&finished, "SWITCH").await;
    }
    let running = app.create_with(&member, request(json!({ "seed": 2 }))).await;
    app.all_act(&running, "STAY").await;
    let aborted = app.create_with(&member, request(json!({ "seed": 3 }))).await;
    app.act(aborted.seat(0), &json!({ "round": 0, "action": "STAY", "message": "hello" })).await;
    app.delete(&aborted.path("")).token(&aborted.swarm).ok().await;
    let lobby = app.create_with(&member, request(json!({ "seed": 4, "open_seats": 2 }))).await;
    let claim = json!({ "seats": 1, "model": "another model" });
    app.post(&lobby.path("/claims")).token(&member).json(&claim).ok().await;
    let cup = Cup::open(
        &app,
        json!({ "suite": {
        "tasks": ["Synchronization"], "seeds": 2, "settings": { "num_agents": 2, "max_round": 2 },
    } }),
    )
    .await;
    let blue = cup.enter(&app, "team blue").await;
    cup.start(&app, &blue).await.play(&app, 2).await;
    cup.start(&app, &blue).await.act(&app, 1).await;
    pass_minutes(&app, 1).await;
    app.stop().await;
    // The times of migrations are those of the machine. Without them the file has the same bytes each time.
    let mut rows =
        SqliteConnectOptions::new().filename(app.database()).connect().await.expect("it opens");
    let same = "UPDATE _sqlx_migrations SET installed_on = '2026-01-01 00:00:00', execution_time = 1; VACUUM;
                PRAGMA wal_checkpoint(TRUNCATE)";
    sqlx::raw_sql(same).execute(&mut rows).await.expect("written");
    rows.close().await.expect("closed");
    std::fs::read(app.database()).expect("a database")
}

/// All that is kept, by table and column; an error where it cannot be read.
async fn contents(path: &Path) -> Result<BTreeMap<(String, String), Vec<String>>, sqlx::Error> {
    let options = SqliteConnectOptions::new().filename(path).read_only(true).immutable(true);
    let mut database = options.disable_statement_logging().connect().await?;
    let mut contents = BTreeMap::new();
    let columns =
        "SELECT t.name AS t, c.name AS c FROM sqlite_master t, pragma_table_info(t.name) c
                   WHERE t.type = 'table' ORDER BY t.name, c.cid";
    for row in sqlx::query(columns).fetch_all(&mut database).await? {
        let (table, column) = (row.try_get::<String, _>("t")?, row.try_get::<String, _>("c")?);
        let values = values(&mut database, &table, &column).await?;
        contents.insert((table, column), values);
    }
    database.close().await?;
    Ok(contents)
}

async fn values(
    database: &mut SqliteConnection,
    table: &str,
    column: &str,
) -> Result<Vec<String>, sqlx::Error> {
    let query = format!("SELECT hex(quote({column})) FROM {table} NOT INDEXED");
    sqlx::query_scalar(AssertSqlSafe(query)).fetch_all(database).await
}

async fn checked(path: &Path) -> Checked {
    check(path, &FORMATS, |_, _| ()).await.unwrap_or_else(|error| Checked {
        // Tables of another version are refused with a sentence.
        more_damages: 1,
        damages: vec![swarmbench::store::check::Damage {
            subject: "all".to_owned(),
            problem: error.to_string(),
        }],
        ..Checked::default()
    })
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_changed_byte_is_found_wherever_something_follows_from_it() {
    let sound = database().await;
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("damaged.db");
    std::fs::write(&file, &sound).expect("written");
    let found = checked(&file).await;
    assert!(found.is_sound() && found.episodes >= 6 && found.rounds >= 8, "{found:?}");
    let before = contents(&file).await.expect("it can be read");

    let written: Vec<usize> = (0..sound.len()).filter(|&place| sound[place] != 0).collect();
    let (mut found, mut unused, mut unchecked) = (0, 0, BTreeMap::new());
    for (number, &place) in written.iter().step_by(written.len() / 250).enumerate() {
        let mut damaged = sound.clone();
        damaged[place] ^= if number % 2 == 0 { 1 } else { 0x45 };
        std::fs::write(&file, &damaged).expect("written");
        if !checked(&file).await.is_sound() {
            found += 1;
            continue;
        }
        let after = contents(&file).await;
        let after = after.unwrap_or_else(|error| panic!("byte {place} was not found: {error}"));
        let changed: Vec<_> =
            before.iter().filter(|(key, was)| after.get(*key) != Some(*was)).collect();
        if changed.is_empty() {
            unused += 1;
        }
        for ((table, column), _) in changed {
            let known = UNCHECKED.contains(&(table, column));
            assert!(known, "byte {place} changes {table}.{column}, and nobody notices");
            *unchecked.entry(format!("{table}.{column}")).or_insert(0) += 1;
        }
    }
    println!(
        "{found} found, {unused} in unused space, in columns that nothing follows from: {unchecked:?}"
    );
    assert!(found > 125, "{found} of 250, {unused} unused, {unchecked:?}");
}

/// A blob whose type alone is damaged has the same bytes as a text.
#[needs(sqlite)]
#[tokio::test]
async fn a_checksum_of_another_type_is_found() {
    let app = TestApp::start().await;
    app.tamper("UPDATE _sqlx_migrations SET checksum = CAST(checksum AS TEXT) WHERE version = 1")
        .await;
    let found = checked(&app.database()).await.damages;
    assert!(found.iter().any(|damage| damage.subject == "the tables"), "{found:?}");
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn damage_is_named_and_the_command_fails() {
    let app = TestApp::start().await;
    let request = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 1 });
    let mut games = Vec::new();
    for _ in 0..3 {
        let episode = app.create(request.clone()).await;
        app.all_act(&episode, "SWITCH").await;
        games.push(episode);
    }
    let verify = async |app: &TestApp| {
        let db = app.database().display().to_string();
        let output = swarmbench(&["verify", "--db", &db]).await;
        (output.status.code(), printed(&output))
    };
    // Beside the server, too.
    let (code, said) = verify(&app).await;
    assert!(code == Some(0) && said.contains("3 episodes with 3 rounds"), "{said}");
    let mut database =
        SqliteConnectOptions::new().filename(app.database()).connect().await.expect("it opens");
    let damages = "UPDATE acts SET record = replace(record, 'SWITCH', 'STAY') WHERE episode = 1 AND agent = 0;
                   DELETE FROM rounds WHERE episode = 2;
                   INSERT INTO tokens (hash, episode) VALUES (zeroblob(32), 77);";
    sqlx::raw_sql(damages).execute(&mut database).await.expect("written");
    database.close().await.expect("closed");
    let (code, said) = verify(&app).await;
    assert_eq!(code, Some(1), "{said}");
    let id = |game: &Episode| game.id.clone();
    for expected in
        [id(&games[0]), id(&games[1]), "the table tokens: 1 rows".to_owned(), "3 places".to_owned()]
    {
        assert!(said.contains(&expected), "{expected} is not in {said}");
    }
    assert!(!said.contains(&games[2].id), "{said}");
}

#[needs(sqlite)]
#[tokio::test]
async fn what_is_stored_a_second_time_is_compared_with_the_records() {
    let app = TestApp::start().await;
    let request = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 1 });
    let episode = app.create(request).await;
    let response = format!("{} ACTION: SWITCH", "because ".repeat(100));
    for agent in 0..2 {
        let act = json!({ "round": 0, "response": response });
        app.act(episode.seat(agent), &act).await;
    }
    assert!(checked(&app.database()).await.is_sound());
    assert_eq!(app.count("SELECT count(*) FROM acts WHERE brief IS NOT NULL").await, 2);
    app.tamper("UPDATE acts SET brief = replace(brief, 'Agent_1', 'Agent_0')").await;
    let found = checked(&app.database()).await.damages;
    let subjects: Vec<_> = found.iter().map(|damage| damage.subject.as_str()).collect();
    assert_eq!(subjects, ["act of agent 1 in round 0 of episode 1"], "{found:?}");
}

/// A worth is stored beside the metrics of its game.
#[tokio::test]
async fn a_game_whose_worth_was_asked_for_is_sound() {
    let app = TestApp::start().await;
    let request = json!({ "task": "Foraging", "num_agents": 2, "max_round": 1 });
    let episode = app.create(request).await;
    app.all_act(&episode, "STAY").await;
    let path = format!("/api/v1/episodes/{}/worth", episode.id);
    assert_eq!(app.get(&path).ok().await["rounds"], 1);
    let rows = "SELECT count(*) FROM metrics WHERE embedder LIKE 'worth%'";
    assert_eq!(app.count(rows).await, 2);
    let checked = check(app.location(), &FORMATS, |_, _| ()).await.expect("read");
    assert!(checked.is_sound() && checked.episodes == 1, "{checked:?}");
}
