//! A database of the time before the bounds, with what attacks left in it: templates that nest deeper than any stack, games with
//! clocks that carry much JSON, names that a terminal would obey, and an import with very many acts.

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use sqlx::{Connection as _, SqliteConnection, query, query_scalar};
use swarmbench::ids::{Token, TokenKind};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::verify;
use swarmbench_protocol::suite::digest_of_template;
use swarmbench_testkit::host::SeededEntropy;
use swarmbench_testkit::needs;
use swarmbench_testkit::program::{Site, program};
use tokio::task::JoinSet;

use super::{Facts, folder, text, unpack};
use crate::across::templates::killers;
use crate::app::mcp::read;
use crate::app::program::{printed, swarmbench};
use crate::app::{TestApp, game, list};

/// The golden database into which they are written: of the version that the attacks ended.
const MIGRATION: &str = "0016";

/// `--memory-max` of the server that starts over it, and what it may have resident beside twice that, in MiB.
const MEMORY_MIB: u64 = 128;
const MEMORY_RESERVE_MIB: u64 = 64;

/// Games with clocks, each with 16 KB of JSON, which as trees of values take 1.3 MB each.
const CARRYING: usize = 400;

/// An import, and the acts of its first round.
const CROWDED: &str = "imp_aec2316b84ed2deacea906c6dc2b2ab5";
const IMPORTED_ACTS: usize = 400_000;

/// Sequence that a terminal obeys: it sets the title of the window.
const ESCAPE: &str = "\u{1b}]0;owned\u{7}";

/// A game whose template fails.
struct Planted {
    id: String,
    seat: String,
    swarm: String,
    limit: &'static str,
}

/// Writes what the attacks stored.
async fn plant(database: &Path, facts: &Facts) -> Vec<Planted> {
    let url = format!("sqlite://{}", database.display());
    let mut rows = SqliteConnection::connect(&url).await.expect("the database");
    let mut rows = rows.begin().await.expect("a transaction");
    let clocked = text(&facts.running[3]["id"]);
    let opening: String = query_scalar("SELECT opening FROM episodes WHERE id = $1")
        .bind(&clocked)
        .fetch_one(&mut *rows)
        .await
        .expect("an opening");
    let entropy = SeededEntropy::new(1 << 60);
    let own = "{{ round }} {{ score }}";
    let meta = format!(r#"{{"x":[{}]}}"#, vec![r#"{"":0}"#; 1990].join(","));
    let killers = killers();
    let carrying = (0..CARRYING).map(|_| None);
    let mut planted = Vec::new();
    for (number, killer) in killers.iter().map(Some).chain(carrying).enumerate() {
        let id = format!("{}{number:08x}", &clocked[..clocked.len() - 8]);
        let opening = opening.replace(&clocked, &id);
        let opening =
            opening.replace(r#""model":"unnamed""#, &format!(r#""model":{}"#, json!(ESCAPE)));
        let opening = opening.replace(r#""agent_meta":{}"#, &format!(r#""agent_meta":{meta}"#));
        let at = opening.find(own).expect("its template");
        let cut = opening.replace(own, "");
        let (kept, head, template) = match killer {
            None => (&opening, Head::START.link(opening.as_bytes()), None),
            Some((killer, _)) => {
                let hash = Sha256::digest(killer).to_vec();
                let key: i64 = query_scalar(
                    "INSERT INTO templates (hash, text) VALUES ($1, $2) RETURNING key",
                )
                .bind(hash)
                .bind(killer)
                .fetch_one(&mut *rows)
                .await
                .expect("a template");
                let whole = opening.replace(own, killer);
                (&cut, Head::START.link(whole.as_bytes()), Some(key))
            }
        };
        let key: i64 = query_scalar(
            "INSERT INTO episodes (id, opening, task, model, visibility, status, clocked, head, created_at, template,
                                   template_at, open_seats)
             SELECT $1, $2, task, $3, visibility, status, clocked, $4, created_at, $5, $6, open_seats
             FROM episodes WHERE id = $7 RETURNING key",
        )
        .bind(&id)
        .bind(kept)
        .bind(ESCAPE)
        .bind(head.0.to_vec())
        .bind(template)
        .bind(template.map(|_| i64::try_from(opening[..at].chars().count()).expect("it is short")))
        .bind(&clocked)
        .fetch_one(&mut *rows)
        .await
        .expect("an episode");
        let tokens = plant_tokens(&mut rows, key, &entropy).await;
        if let Some(&(_, limit)) = killer {
            let [swarm, seat] = tokens;
            planted.push(Planted { id, seat, swarm, limit });
        }
    }
    let (killer, _) = &killers[0];
    let declaration = json!({ "model": "deep", "prompt_template": killer }).to_string();
    query(
        "UPDATE entries SET declaration = $1, model = 'deep', name = name || $2, template = $3, brief = NULL
         WHERE competition = (SELECT key FROM competitions WHERE id = $4)",
    )
        .bind(declaration)
        .bind(ESCAPE)
        .bind(digest_of_template(killer))
        .bind(&facts.cups.open)
        .execute(&mut *rows)
        .await
        .expect("entrants");
    query("UPDATE runs SET definition = replace(definition, '\"model\":', $1) WHERE status = 'running' AND entry IS NULL")
        .bind(format!("\"prompt_template\":\"{killer}\",\"model\":"))
        .execute(&mut *rows)
        .await
        .expect("runs");
    let act = b"{\"agent_id\": \"Agent_1\", \"action\": \"UP\", \"message\": \"up\"}\n";
    let mut acts = GzEncoder::new(Vec::new(), Compression::fast());
    acts.write_all(&act.repeat(IMPORTED_ACTS)).expect("memory");
    query("UPDATE import_rounds SET acts = $1 WHERE round = 0 AND import = (SELECT key FROM imports WHERE id = $2)")
        .bind(acts.finish().expect("memory"))
        .bind(CROWDED)
        .execute(&mut *rows)
        .await
        .expect("acts");
    rows.commit().await.expect("a commit");
    planted
}

/// Writes tokens of an episode's swarm and of its first seat.
async fn plant_tokens(
    rows: &mut SqliteConnection,
    episode: i64,
    entropy: &SeededEntropy,
) -> [String; 2] {
    let tokens = [TokenKind::Swarm, TokenKind::Seat].map(|kind| Token::new(kind, entropy));
    for (token, agent) in tokens.iter().zip([None, Some(0)]) {
        query("INSERT INTO tokens (hash, episode, agent) VALUES ($1, $2, $3)")
            .bind(token.hash().0.to_vec())
            .bind(episode)
            .bind(agent)
            .execute(&mut *rows)
            .await
            .expect("a token");
    }
    tokens.map(|token| token.reveal().to_owned())
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_database_of_attacks_ends_no_server() {
    let golden = folder().join(MIGRATION);
    let facts: Facts =
        serde_json::from_slice(&unpack(&golden.join("facts.json.gz"))).expect("facts");
    let site = Site::new();
    std::fs::write(site.db(), unpack(&golden.join("swarmbench.db.gz"))).expect("written");
    let planted = plant(Path::new(site.db()), &facts).await;
    let bytes = std::fs::read(site.db()).expect("a database");
    starts_within_its_memory(&site, &facts, &planted).await;

    let builder = TestApp::builder().clock_at(&facts.now).key_of(&facts.organizer);
    let mut app = builder.database(bytes).start().await;
    for game in &planted {
        fails_in_all_prompts(&app, game).await;
        let journal = app
            .get(&format!("/api/v1/episodes/{}/journal", game.id))
            .token(&facts.organizer)
            .send()
            .await;
        verify(&*journal.body, None, Solver::Flow, |_, _| ()).expect("a chain");
        says_nothing_to_terminals(&journal.text(), site.folder()).await;
    }
    // Entrants and runs of before play without prompts.
    let start = app.post(&format!("/api/v1/competitions/{}/attempts", facts.cups.open));
    let start = start.token(&facts.cups.entrant).json(&json!({})).ok().await;
    for swarm in [text(&start["swarm_token"]), text(&facts.runs[0]["swarm_token"])] {
        let observations = app.get("/swarm/obs").token(&swarm).ok().await;
        assert!(!list(&observations["observations"]).is_empty(), "{observations}");
    }
    let swarm = text(&start["swarm_token"]);
    app.get("/swarm/obs?prompt=true").token(&swarm).problem(422, "template_failed").await;
    let look = format!("/api/v1/imports/{CROWDED}/rounds/0/agents/Agent_1");
    let problem = app.get(&look).token(&facts.organizer).problem(422, "invalid").await;
    assert_eq!(problem["limit"]["name"], "import_state_bytes_max", "{problem}");
    let exported = app.get("/api/v1/exports/dataset.zip").token(&facts.organizer).send().await;
    assert_eq!(exported.status, 200, "{}", exported.text());

    app.stop().await;
    let db = app.db();
    let games = site.folder().join("games").display().to_string();
    for command in [&["verify", "--db", &db][..], &["export", "--db", &db, &games]] {
        let output = swarmbench(command).await;
        let said = printed(&output);
        assert!(output.status.success() && !said.contains('\u{1b}'), "{command:?}: {said}");
    }
}

/// The program starts over the database, all who were in it look at once, and an honest game is played beside them.
async fn starts_within_its_memory(site: &Site, facts: &Facts, planted: &[Planted]) {
    let mut command = Command::new(program());
    command.env("SWARMBENCH_MEMORY_MAX", format!("{MEMORY_MIB}MiB")).env("RUST_LOG", "info");
    let mut server = site.start_by(command, &[]);
    server.ready().await;
    let base = site.door.now().expect("it listens").base;
    let client = reqwest::Client::new();
    let ask =
        |path: &str, token: &str| client.get(format!("{base}{path}")).bearer_auth(token).send();
    let mut looks = JoinSet::new();
    for game in planted {
        looks.spawn(ask("/obs?prompt=true", &game.seat));
    }
    for look in ["replay", "metrics", "rounds/0/agents/Agent_1"].repeat(8) {
        looks.spawn(ask(&format!("/api/v1/imports/{CROWDED}/{look}"), &facts.organizer));
    }
    let honest = client.post(format!("{base}/api/v1/episodes")).bearer_auth(&facts.member);
    let honest = honest.json(&game(2, 2)).send().await.expect("an answer");
    let honest: Value = honest.json().await.expect("JSON");
    for (round, seat) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let token = text(&honest["seats"][seat]["token"]);
        let act = client.post(format!("{base}/act")).bearer_auth(token);
        let act = act.json(&json!({ "round": round, "action": "STAY" })).send().await;
        assert_eq!(act.expect("an answer").status(), 200, "{honest}");
    }
    for look in looks.join_all().await {
        let status = look.expect("an answer").status().as_u16();
        assert!([422, 503].contains(&status), "{status}");
    }
    let games = ask("/api/v1/episodes?limit=1000", &facts.organizer).await.expect("an answer");
    assert_eq!(games.status(), 200);
    if cfg!(target_os = "linux") {
        let most = 2 * MEMORY_MIB + MEMORY_RESERVE_MIB;
        let peak = server.memory_peak_mib();
        assert!((1..=most).contains(&peak), "{peak} MiB were resident; at most {most}");
    }
    let (status, _, log) = server.terminate().await;
    assert!(status.success(), "{log:#?}");
    assert!(!log.iter().any(|line| line.contains('\u{1b}')), "{log:#?}");
}

async fn fails_in_all_prompts(app: &TestApp, game: &Planted) {
    let asked = |path: &str, token: &str| app.get(path).token(token);
    let problem = asked("/obs?prompt=true", &game.seat).problem(422, "template_failed").await;
    assert!(problem.to_string().contains(game.limit), "{problem}");
    asked("/swarm/obs?prompt=true", &game.swarm).problem(422, "template_failed").await;
    asked("/obs", &game.seat).ok().await;
    let looked = app.tool(&game.seat, "look", json!({})).await;
    assert!(read(&looked)[0].starts_with("The episode's prompt template fails"), "{looked}");
    let round =
        asked(&format!("/api/v1/episodes/{}/rounds/0/agents/Agent_0", game.id), &game.swarm);
    let shown: Value = round.ok().await;
    assert!(shown["prompt"].is_null() && shown["prompt_problem"].is_string(), "{shown}");
}

/// The check of a journal shows no character that a terminal would obey.
async fn says_nothing_to_terminals(journal: &str, folder: &Path) {
    let file = folder.join("game.jsonl");
    std::fs::write(&file, journal).expect("a file");
    let file = file.display().to_string();
    let output = swarmbench(&["verify", &file]).await;
    let said = printed(&output);
    assert!(
        output.status.success() && said.contains("owned") && !said.contains('\u{1b}'),
        "{said}"
    );
}
