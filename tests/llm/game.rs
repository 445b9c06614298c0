//! Whole games, with the offline model of the examples at every seat: the rules' own prompts and their own reading of
//! answers.

use std::sync::Arc;

use futures::future::join_all;
use swarmbench_client::llm::{Cassette, Model, Question, Stop};
use swarmbench_engine::{AgentId, Config, Settings, TaskName, World, answer};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;
use tokio::net::TcpListener;

use crate::llm::Bench;
use crate::llm::endpoint::Endpoint;

#[path = "../../examples/fake_model/endpoint.rs"]
mod fake_model;

/// Plays a game; the score, and how many answers were valid and invalid.
async fn play(model: &Model, settings: &Settings) -> Result<(f64, usize, usize), Stop> {
    let config = Arc::new(Config::check(settings).expect("settings"));
    let game = format!("{}/{}", config.task().name(), settings.seed);
    let mut world = World::new(config.clone());
    let (mut valid, mut invalid) = (0, 0);
    while !world.is_over() {
        let agents: Vec<AgentId> = world.agents().collect();
        let questions: Vec<_> = (agents.iter())
            .map(|agent| {
                let seen = world.observe(*agent);
                let description = swarmbench_prompt::tasks::description(&config);
                let sight = Sight::of(&seen, "ep_1".to_owned(), description, Status::Running, None);
                let prompt =
                    swarmbench_prompt::render(swarmbench_prompt::BUILT_IN, &sight, &config)
                        .expect("a prompt");
                Question {
                    system: None,
                    game: game.clone(),
                    agent: agent.to_string(),
                    round: seen.round,
                    prompt,
                    items: Vec::new(),
                    schema: None,
                }
            })
            .collect();
        let asked = questions.iter().map(|question| model.answer(question));
        let mut acts = Vec::new();
        for (agent, said) in agents.iter().zip(join_all(asked).await) {
            let read = answer::parse(&said?.response, &config, *agent);
            *if read.is_valid() { &mut valid } else { &mut invalid } += 1;
            acts.push(read.act);
        }
        world.step(&acts);
    }
    Ok((world.score(), valid, invalid))
}

fn settings(task: TaskName, max_round: u32) -> Settings {
    Settings { max_round: max_round.into(), ..Settings::standard(task, 27) }
}

#[tokio::test]
async fn the_offline_model_plays_all_tasks_and_a_cassette_plays_them_again() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let server = tokio::spawn(async move { axum::serve(listener, fake_model::router()).await });
    let nobody = Endpoint::replies(vec![]).await;
    let mut bench = Bench::with(&nobody, crate::llm::time::Leaps::leaping(), 8, None);
    bench.settings.api_base = format!("http://{address}/v1");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    let rounds = 12_u32;
    let games: Vec<_> = TaskName::ALL.map(|task| settings(task, rounds)).into();
    let model = bench.model_on(Some(&Cassette::record(&path).expect("a cassette")));
    let mut played = Vec::new();
    for game in &games {
        let (score, valid, invalid) = play(&model, game).await.expect("a game");
        assert!(valid > 0 && invalid == 0, "{}: {valid} valid, {invalid} invalid", game.task);
        played.push((score, valid, invalid));
    }
    let sync = games.iter().position(|game| game.task == "Synchronization").expect("a task");
    assert!(
        (played[sync].0 - f64::from(rounds)).abs() < 1e-9,
        "every round scores: {}",
        played[sync].0
    );
    let spent = model.spent();
    assert_eq!(spent.unmetered + spent.failures.total() + spent.retries, 0);
    assert_eq!(bench.allowance.spent(), spent.prompt_tokens + spent.completion_tokens);
    server.abort();
    drop(model);
    let replay = bench.model_on(Some(&Cassette::replay(&path).expect("a cassette")));
    for (game, score) in games.iter().zip(played) {
        assert_eq!(play(&replay, game).await.expect("a game"), score);
    }
    assert_eq!((replay.spent().requests, replay.spent().replayed), (0, spent.answers));
    // With other rules the prompts are others, and nothing is made up.
    let longer = settings(TaskName::Flocking, rounds + 1);
    let stop = play(&replay, &longer).await.expect_err("it was not recorded");
    assert!(matches!(stop, Stop::NotOnCassette { round: 0, .. }), "{stop}");
}
