//! Every round of every recorded game matches, cell by cell.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{
    Act, Action, AgentId, Config, Message, Scratch, Settings, TaskName, World,
};

#[derive(Deserialize)]
struct RecordedGame {
    config: Recorded,
    initial: State,
    rounds: Vec<Round>,
    done: bool,
}

#[derive(Deserialize)]
struct Recorded {
    task: String,
    rules: String,
    num_agents: i64,
    width: i64,
    height: i64,
    seed: i64,
    view_size: i64,
    max_round: i64,
}

#[derive(Deserialize)]
struct Round {
    inbox: BTreeMap<String, Vec<String>>,
    views: BTreeMap<String, Vec<Vec<String>>>,
    actions: BTreeMap<String, (String, String)>,
    after: State,
}

#[derive(Deserialize)]
struct State {
    agents: Vec<(i32, i32)>,
    grid: Option<Vec<String>>,
    score: f64,
    prey: Option<(i32, i32)>,
    block: Option<(i32, i32)>,
    distance: Option<f64>,
    light_on: Option<Vec<bool>>,
    carrying: Option<Vec<bool>>,
}

fn games(text: &str) -> impl Iterator<Item = RecordedGame> {
    text.lines().map(|line| serde_json::from_str(line).expect("a recorded game"))
}

fn play(game: &RecordedGame, solver: Solver) {
    let recorded = &game.config;
    let settings = Settings {
        task: recorded.task.clone(),
        rules: recorded.rules.clone(),
        seed: recorded.seed,
        num_agents: recorded.num_agents,
        width: recorded.width,
        height: recorded.height,
        view_size: recorded.view_size,
        max_round: recorded.max_round,
        ..Settings::default()
    };
    let config = Config::check(&settings).expect("the game was played");
    let mut world = World::new(Arc::new(config));
    let title = format!("{} {} seed {}", recorded.rules, recorded.task, recorded.seed);
    compare(&world, &game.initial, &title);
    for (number, round) in game.rounds.iter().enumerate() {
        let title = format!("{title}, round {number}");
        compare_observations(&world, round, &title);
        let mut acts = vec![Act::default(); world.agents().count()];
        for (name, (action, message)) in &round.actions {
            let agent = AgentId::parse(name).expect("an agent's name");
            let action = Action::parse(world.config().task(), action);
            assert!(action.is_some(), "{title}: a known action");
            acts[agent.index()] = Act { action, message: Message::new(message), to: None };
        }
        world.step_with(&acts, solver, &mut Scratch::default()).expect("solved");
        compare(&world, &round.after, &title);
    }
    assert_eq!(world.is_over(), game.done, "{title}: the end");
}

fn compare_observations(world: &World, round: &Round, title: &str) {
    for agent in world.agents() {
        let seen = world.observe(agent);
        let name = agent.to_string();
        let messages: Vec<_> = seen.messages.iter().map(Message::as_str).collect();
        let inbox = round.inbox.get(&name).cloned().unwrap_or_default();
        assert_eq!(messages, inbox, "{title}: messages of {name}");
        if let Some(expected) = round.views.get(&name) {
            let view = seen.view.expect("a living agent sees");
            let cells: Vec<Vec<String>> =
                view.rows().map(|row| row.iter().map(ToString::to_string).collect()).collect();
            assert_eq!(&cells, expected, "{title}: view of {name}");
        }
    }
}

fn compare(world: &World, expected: &State, title: &str) {
    let seen = world.spectator_view();
    let agents: Vec<_> = seen.agents.iter().map(|agent| (agent.at.i, agent.at.j)).collect();
    assert_eq!(agents, expected.agents, "{title}: positions");
    assert_eq!(seen.score.to_bits(), expected.score.to_bits(), "{title}: score");
    assert_eq!(seen.prey.map(|at| (at.i, at.j)), expected.prey, "{title}: prey");
    let grid = seen.grid.join("\n");
    if grid.contains('B') {
        assert_eq!(seen.block.map(|at| (at.i, at.j)), expected.block, "{title}: block");
    }
    assert_eq!(seen.distance, expected.distance, "{title}: distance");
    let lights: Option<Vec<bool>> = seen.agents.iter().map(|agent| agent.light_on).collect();
    assert_eq!(lights, expected.light_on, "{title}: lights");
    let food: Option<Vec<bool>> = seen.agents.iter().map(|agent| agent.carrying_food).collect();
    assert_eq!(food, expected.carrying, "{title}: loads");
    if let Some(expected) = &expected.grid {
        assert_eq!(grid, expected.join("\n").replace('a', "A"), "{title}: grid");
    }
}

const PAPER: &str = include_str!("vectors/paper.jsonl");
const REFERENCE: &str = include_str!("vectors/reference.jsonl");

#[test]
fn recorded_games_of_the_paper_match() {
    let played = games(PAPER).inspect(|game| play(game, Solver::Flow)).count();
    assert_eq!(played, 11);
}

#[test]
fn recorded_games_of_the_public_toolkit_match() {
    let played = games(REFERENCE).inspect(|game| play(game, Solver::Flow)).count();
    assert_eq!(played, 11);
}

#[test]
fn flow_and_integer_linear_program_agree_on_every_push_of_the_recorded_games() {
    let played = games(PAPER).chain(games(REFERENCE)).inspect(|game| play(game, Solver::Both));
    assert_eq!(played.count(), 22);
}

#[test]
fn every_task_is_recorded_under_both_rule_sets() {
    for text in [PAPER, REFERENCE] {
        for task in TaskName::ALL {
            assert!(games(text).any(|game| game.config.task == task.name()), "{}", task.name());
        }
    }
}
