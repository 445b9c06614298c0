//! Data of the shape that the public toolkit writes, made without the code under test: games of agents that act
//! at random, in batches by task, one run for each model and seed.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Value, json};
use swarmbench_engine::{Act, Action, Config, Message, Settings, TaskName, World};

/// Size of the data.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Size {
    pub(crate) tasks: usize,
    pub(crate) models: usize,
    pub(crate) seeds: usize,
    pub(crate) rounds: u32,
    /// Characters of a prompt.
    pub(crate) prompt: usize,
}

impl Size {
    pub(crate) const SMALL: Self = Self { tasks: 2, models: 2, seeds: 2, rounds: 5, prompt: 60 };
}

/// Numbers that follow from a seed: enough to let agents wander.
struct Dice(u64);

impl Dice {
    fn below(&mut self, n: usize) -> usize {
        // xorshift64*
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let drawn = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33;
        usize::try_from(drawn).expect("31 bits") % n
    }
}

/// Writes the data into a folder, which is made; returns the folders of its batches.
pub(crate) fn write(folder: &Path, size: Size) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for (number, task) in TaskName::ALL.into_iter().take(size.tasks).enumerate() {
        let batch = folder.join(format!("experiment_v{:02}", number + 1));
        std::fs::create_dir_all(&batch).expect("a folder");
        let mut index = serde_json::Map::new();
        for model in 0..size.models {
            for seed in 0..size.seeds {
                let run = model * size.seeds + seed;
                let id = format!("{}-ThreadPoolExecutor-0_{}", 1_746_000_000 + 40 * run, run % 8);
                let seed = 27 + 15 * seed as u64;
                let dice = Dice(0x9E37_79B9 + (number * 1000 + run) as u64);
                let game = play(task, seed, size, dice);
                let log = |name: &str, rows: &[Value]| {
                    let text = serde_json::to_string_pretty(rows).expect("string keys");
                    std::fs::write(batch.join(format!("{name}_log_{id}.json")), text)
                        .expect("written");
                };
                log("game", &game.states);
                log("agent", &game.acts);
                let meta = json!({
                    "model": format!("model-{model}"), "task": task.name(), "num_agents": 12,
                    "max_round": size.rounds, "width": 10, "height": 10, "seed": seed, "view_size": 5,
                });
                index.insert(id, meta);
            }
        }
        let index = serde_json::to_string(&index).expect("string keys");
        std::fs::write(batch.join("meta_log.json"), index).expect("written");
        folders.push(batch);
    }
    folders
}

struct SampleGame {
    states: Vec<Value>,
    acts: Vec<Value>,
}

fn play(task: TaskName, seed: u64, size: Size, mut dice: Dice) -> SampleGame {
    let settings = Settings {
        max_round: i64::from(size.rounds),
        rules: "reference".to_owned(),
        ..Settings::standard(task, seed)
    };
    let mut world = World::new(Arc::new(Config::check(&settings).expect("valid settings")));
    let mut time = 1_746_000_000.0;
    let mut game = SampleGame { states: vec![state(&world, task, time, &[])], acts: Vec::new() };
    let mut tokens = [0; 12];
    while !world.is_over() {
        let round = world.round();
        let (mut acts, mut said) = (Vec::new(), Vec::new());
        for agent in world.agents() {
            time += 0.01;
            let actions = Action::of_task(task);
            let action = actions[dice.below(actions.len())];
            let text = (dice.below(3) == 0)
                .then(|| format!("I am at step {round}, going {}", action.name()));
            let number = agent.index();
            tokens[number] += 20 + dice.below(200);
            let name = agent.to_string();
            if let Some(text) = &text {
                said.push(json!({ "round": round, "agent_name": name, "message": text }));
            }
            let prompt = prompt(number, round, size.prompt, &mut dice);
            let response =
                format!("Thinking about {}.\n\nACTION: {}", dice.below(1000), action.name());
            game.acts.push(json!({
                "timestamp": time, "task": task.name(), "round": round, "agent_id": name,
                "view": view(&world, number), "prompt": prompt, "response": response,
                "action": action.name(), "message": text.clone().unwrap_or_default(), "api_call_time": 0,
                "action_success": false, "total_llm_tokens": tokens[number],
            }));
            acts.push(Act { message: text.as_deref().and_then(Message::new), ..Act::of(action) });
        }
        world.step(&acts);
        game.states.push(state(&world, task, time, &said));
    }
    game
}

fn state(world: &World, task: TaskName, time: f64, said: &[Value]) -> Value {
    let seen = world.spectator_view();
    let grid: Vec<Vec<String>> =
        seen.grid.iter().map(|row| row.chars().map(String::from).collect()).collect();
    let agents: Vec<Value> = (seen.agents.iter())
        .map(|agent| json!({ "id": agent.agent.to_string(), "x": agent.at.j, "y": agent.at.i }))
        .collect();
    json!({
        "timestamp": time, "task": task.name(), "round": seen.round, "grid": grid, "agents": agents,
        "score": seen.score, "messages": said,
    })
}

/// An agent's view, as the toolkit writes it: its own number in the middle.
fn view(world: &World, own: usize) -> Option<Vec<Vec<String>>> {
    let agent = world.agents().nth(own)?;
    let view = world.observe(agent).view?;
    let cell = |cell: &swarmbench_engine::Seen| match cell.to_string() {
        text if text == "Y" => own.to_string(),
        text => text,
    };
    Some(view.rows().map(|row| row.iter().map(cell).collect()).collect())
}

/// A text of the usual length, of which half differs from act to act.
fn prompt(agent: usize, round: u32, length: usize, dice: &mut Dice) -> String {
    let mut text = format!("You are Agent_{agent}, in round {round}. ");
    while text.len() < length {
        write!(text, "Row {} is {} {}; ", dice.below(10), dice.below(12), dice.below(1000))
            .expect("text");
        text.push_str("The direction of increasing i is downward, and j grows to the right. ");
    }
    text
}
