//! Prompt templates that nest deeper than any stack end no process: they are refused where they come in, and fail where they
//! are stored.

use serde_json::{Value, json};

use crate::agent::readers::rehashed;
use crate::app::mcp::read;
use crate::app::program::{printed, swarmbench, swarmbench_in};
use crate::app::{Call, Episode, TestApp, fields, game};
use crate::cup::{Cup, server};

/// Templates of at most 32 KiB, each of which ended the server, with the limit that they exceed. A parser overflowed its stack
/// by the first four; the others were stored, and ended it at each rendering.
pub(super) fn killers() -> Vec<(String, &'static str)> {
    let printed =
        |before: &str, times, after: &str| format!("{{{{ {}{after} }}}}", before.repeat(times));
    let chain = |link: &str, times: usize| format!("{{{{ agent{} }}}}", link.repeat(times));
    vec![
        (printed("not ", 8_100, "1"), "template_unary_max"),
        (printed("- ", 10_534, "1"), "template_unary_max"),
        (printed("1 if 1 else ", 2_700, "1"), "template_chain_max"),
        (format!("{{% if 0 %}}{}{{% endif %}}", "{% elif 0 %}".repeat(2_334)), "template_elif_max"),
        (chain(".i", 11_031), "template_chain_max"),
        (chain("|upper", 5_000), "template_chain_max"),
        (chain(" or 1", 6_000), "template_chain_max"),
        (chain(" is defined", 2_900), "template_chain_max"),
    ]
}

fn with(request: &Value, template: &str) -> Value {
    let mut request = request.clone();
    request["prompt_template"] = json!(template);
    request
}

#[tokio::test]
async fn none_is_taken_by_any_route() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let (key, _) = app.key(json!({ "name": "member" })).await;
    let episode = app.create_with(&key, game(2, 2)).await;
    let suite = json!({ "suite": { "name": "x", "seeds": [1] }, "model": "m" });
    let entry = json!({ "name": "a", "model": "m" });
    for (template, limit) in killers() {
        for (path, request) in [
            ("/api/v1/episodes", &game(2, 2)),
            ("/api/v1/runs", &suite),
            (&episode.path("/fork"), &json!({ "round": 0 })),
            (&cup.path("/entrants"), &entry),
        ] {
            let call = app.post(path).json(&with(request, &template));
            let call = if path.ends_with("entrants") { call } else { call.token(&key) };
            let problem = call.problem(422, "invalid").await;
            assert_eq!(fields(&problem), ["prompt_template"], "{path}");
            assert!(problem.to_string().contains(limit), "{path}: {problem}");
        }
    }
}

/// A template that is as large as those that the database keeps apart from openings.
fn harmless(number: usize) -> String {
    format!("{number}:{}", "x".repeat(300))
}

impl TestApp {
    /// Puts the killers where harmless templates are stored, as servers did that took them.
    async fn store_killers(&mut self) {
        self.stop().await;
        let mut statements = Vec::new();
        for (number, (killer, _)) in killers().into_iter().enumerate() {
            for (table, column) in
                [("templates", "text"), ("entries", "declaration"), ("runs", "definition")]
            {
                let harmless = harmless(number);
                statements.push(format!(
                    "UPDATE {table} SET {column} = replace({column}, '{harmless}', '{killer}');"
                ));
            }
        }
        self.tamper(statements.concat().leak()).await;
        self.start_again().await;
    }

    /// Asks for prompts of a game in its first round by all routes that make some.
    async fn fails_in_all_prompts(&self, episode: &Episode) {
        let asked = |path: &str, token: &str| self.get(path).token(token);
        asked("/obs?prompt=true", episode.seat(0)).problem(422, "template_failed").await;
        asked("/swarm/obs?prompt=true", &episode.swarm).problem(422, "template_failed").await;
        let looked = self.tool(episode.seat(0), "look", json!({})).await;
        assert!(read(&looked)[0].starts_with("The episode's prompt template fails"), "{looked}");
        self.fails_in_round(episode).await;
    }

    async fn fails_in_round(&self, episode: &Episode) {
        let round: Call = self.get(&episode.path("/rounds/0/agents/Agent_0"));
        let shown = round.token(&episode.swarm).ok().await;
        assert_eq!(shown.get("prompt"), None);
        let problem = shown["prompt_problem"].as_str().expect("a problem");
        assert!(problem.contains("_max (line 1"), "{problem}");
    }
}

#[tokio::test]
async fn stored_ones_fail_and_their_games_are_played() {
    let mut app = TestApp::with_manual_clock().await;
    let mut clocked = game(2, 1);
    clocked["round_deadline_s"] = json!(3600);
    let mut episodes = Vec::new();
    for number in 0..killers().len() {
        let request = if number % 2 == 0 { clocked.clone() } else { game(2, 1) };
        episodes.push(app.create(with(&request, &harmless(number))).await);
    }
    app.store_killers().await;
    for episode in &episodes {
        app.fails_in_all_prompts(episode).await;
        app.all_act(episode, "STAY").await;
        app.fails_in_round(episode).await;
    }
    let exported = app.get("/api/v1/exports/dataset.zip").send().await;
    assert_eq!(exported.status, 200, "{}", exported.text());
    let folder = tempfile::tempdir().expect("a folder");
    let games = folder.path().join("games").display().to_string();
    let output = swarmbench(&["export", "--db", &app.db(), &games]).await;
    assert!(output.status.success(), "{}", printed(&output));
}

#[tokio::test]
async fn entrants_of_before_play_without_prompts() {
    let mut app = server().await;
    let cup = Cup::open(&app, json!({ "entries_per_key": 9 })).await;
    let mut entrants = Vec::new();
    for number in 0..killers().len() {
        let entry = json!({ "name": format!("name {number}"), "model": "m" });
        let call = app.post(&cup.path("/entrants")).json(&with(&entry, &harmless(number)));
        entrants.push(call.ok().await["key"].as_str().expect("a key").to_owned());
    }
    app.store_killers().await;
    for key in &entrants {
        let start = app.post(&cup.path("/attempts")).token(key).json(&json!({})).ok().await;
        let swarm = start["swarm_token"].as_str().expect("a token");
        app.get("/swarm/obs?prompt=true").token(swarm).problem(422, "template_failed").await;
        app.get("/swarm/obs").token(swarm).ok().await;
    }
}

#[tokio::test]
async fn commands_that_read_journals_of_others_show_why_there_is_no_prompt() {
    let app = TestApp::start().await;
    let episode = app.create(with(&game(2, 2), &harmless(0))).await;
    app.all_act(&episode, "STAY").await;
    let journal = app.journal(&episode).await;
    let folder = tempfile::tempdir().expect("a folder");
    let [from, page] = ["game.jsonl", "game.html"].map(|name| folder.path().join(name));
    for (killer, limit) in killers() {
        std::fs::write(&from, rehashed(&journal.replace(&harmless(0), &killer))).expect("a file");
        let output = swarmbench(&[
            "replay",
            "--html",
            &page.display().to_string(),
            "--prompts",
            &from.display().to_string(),
        ])
        .await;
        assert!(output.status.success(), "{}", printed(&output));
        let shown = std::fs::read_to_string(&page).expect("a page");
        assert!(shown.contains("prompt_problem") && shown.contains(limit), "{limit}");
    }
}

#[tokio::test]
async fn commands_that_take_a_template_refuse_it() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(
        folder.path().join("experiment.toml"),
        "prompt_template = \"killer\"\ntasks = \"Foraging\"\nseeds = [1]\n",
    )
    .expect("a file");
    let model = "--model m --api-base http://127.0.0.1:9/v1";
    let eval = format!("eval --task Foraging --seeds 1 --prompt-template killer {model}");
    let commands = [
        eval.clone(),
        format!("{eval} --dry-run"),
        format!("eval experiment.toml {model} --dry-run"),
        format!(
            "competition enter {} --server {} --name a --model m --prompt-template killer",
            cup.id,
            app.base()
        ),
    ];
    for (killer, limit) in killers() {
        std::fs::write(folder.path().join("killer"), killer).expect("a file");
        for command in &commands {
            let words: Vec<&str> = command.split(' ').collect();
            let output = swarmbench_in(folder.path(), &words).await;
            let said = printed(&output);
            assert_eq!(output.status.code(), Some(1), "{command}: {said}");
            assert!(said.contains("template") && said.contains(limit), "{command}: {said}");
            assert!(said.len() < 1000, "{command}: {said}");
        }
    }
    assert_eq!(app.get(&cup.path("/entrants")).ok().await["items"], json!([]));
}
