//! Templates made by `examples/prompts/from_toolkit.py` render the same bytes as the code of a checkout. The checkout
//! is a stand-in for the public toolkit; `SWARMBENCH_TOOLKIT` names a real one.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use serde_json::{Value, json};
use swarmbench_engine::{Act, Action, AgentId, Config, Message, Settings, TaskName, World};
use swarmbench_prompt::{check, render, tasks};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn checkout() -> PathBuf {
    let stand_in = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/toolkit");
    std::env::var_os("SWARMBENCH_TOOLKIT").map_or(stand_in, PathBuf::from)
}

/// Observations of agents in several rounds of a game, each with a message and sometimes no action.
fn sights(task: TaskName) -> (Config, Vec<Sight>) {
    let rules = "reference".to_owned();
    let config = Config::check(&Settings { rules, ..Settings::standard(task, 27) });
    let config = config.expect("valid settings");
    let mut world = World::new(Arc::new(config.clone()));
    let mut seen = Vec::new();
    for round in 0..9_u16 {
        for agent in [0, 5, 11] {
            let observation = world.observe(AgentId(agent));
            let description = tasks::description(&config);
            seen.push(Sight::of(
                &observation,
                "ep_1".to_owned(),
                description,
                Status::Running,
                None,
            ));
        }
        let act = |agent: u16| {
            let action = Action::of_task(task).get(usize::from((agent + round) % 7)).copied();
            let said = !(round + agent).is_multiple_of(3);
            let message =
                said.then(|| Message::new(&format!("I am {agent} {{{{ x }}}}"))).flatten();
            Act { action, message, to: None }
        };
        world.step(&(0..config.num_agents()).map(act).collect::<Vec<_>>());
    }
    (config, seen)
}

/// An observation for `prompts.py`.
fn shown(task: TaskName, sight: &Sight, config: &Config) -> Value {
    let half = i32::try_from(config.settings().view_size / 2).expect("a small window");
    let view = |origin: swarmbench_protocol::Position, cells: Value| json!({ "at": [origin.i + half, origin.j + half], "cells": cells });
    let now = sight.view.as_ref().expect("nobody escapes so early");
    let past = sight.past_views.iter().rev();
    let mut views: Vec<Value> =
        past.map(|view_of| view(view_of.origin, json!(view_of.cells))).collect();
    views.push(view(now.origin, json!(now.cells)));
    let history: Vec<_> = sight.history.iter().rev().collect();
    json!({
        "task": task.name(), "agent": sight.agent, "round": sight.round, "score": sight.score, "views": views,
        "history": history, "messages": sight.messages, "light_on": sight.light_on,
        "carrying_food": sight.carrying_food, "shape": "A A A A\nA . . A\nA . . A\nA A A A",
    })
}

fn python(arguments: &[&Path], input: &str) -> String {
    let mut child = Command::new("python3")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3 runs");
    child.stdin.take().expect("a pipe").write_all(input.as_bytes()).expect("it reads");
    let output = child.wait_with_output().expect("it ends");
    assert!(output.status.success());
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn templates_of_a_checkout_say_what_its_code_says() {
    let folder = std::env::temp_dir().join(format!("swarmbench-templates-{}", std::process::id()));
    let made =
        python(&[&root().join("examples/prompts/from_toolkit.py"), &checkout(), &folder], "");
    assert!(made.starts_with("5 templates"), "{made}");
    for task in TaskName::ALL {
        let (config, seen) = sights(task);
        let asked: Vec<Value> = seen.iter().map(|sight| shown(task, sight, &config)).collect();
        let driver = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/toolkit/prompts.py");
        let expected = python(&[&driver, &checkout()], &json!(asked).to_string());
        let expected: Vec<String> = serde_json::from_str(&expected).expect("texts");
        for name in [task.name(), "all"] {
            let template = std::fs::read_to_string(folder.join(format!("{name}.j2")));
            let template = template.expect("it was written");
            assert_eq!(check(&template), Ok(()), "{name}");
            for (sight, expected) in seen.iter().zip(&expected) {
                let prompt = render(&template, sight, &config);
                assert_eq!(prompt.as_ref(), Ok(expected), "{name}, round {}", sight.round);
            }
        }
    }
    let system = std::fs::read_to_string(folder.join("system.txt")).expect("it was written");
    assert!(system.starts_with("You"), "{system}");
    std::fs::remove_dir_all(&folder).expect("it is ours");
}
