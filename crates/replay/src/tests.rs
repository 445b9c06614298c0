use std::sync::Arc;

use swarmbench_engine::{
    Act, Action, AgentId, Config, Direction, Message, Settings, TaskName, World,
};
use swarmbench_journal::record::{ActRecord, Decision as Decided};
use swarmbench_protocol::replay::ReplayMark;

use super::reel::{is_blocked, is_pushed};
use super::*;

fn world(change: impl FnOnce(&mut Settings)) -> World {
    let mut settings = Settings::standard(TaskName::Synchronization, 3);
    change(&mut settings);
    World::new(Arc::new(Config::check(&settings).expect("good settings")))
}

/// Steps a world and returns the records of the acts.
fn step(world: &mut World, acts: Vec<Act>) -> Vec<ActRecord> {
    world.step(&acts);
    let record = |(agent, act)| Decided::of_player(act).record(AgentId(agent), 0);
    (0..).zip(acts).map(record).collect()
}

fn says(text: &str) -> Act {
    Act { message: Message::new(text), ..Act::default() }
}

/// The frames of a game with given acts for each round.
fn frames(world: &mut World, rounds: Vec<Vec<Act>>) -> Vec<Frame> {
    let mut reel = Reel::of(world);
    let mut frames = vec![reel.first()];
    for acts in rounds {
        let records = step(world, acts);
        frames.push(reel.step(&Round::of(&records, world), Scene::of(world)));
    }
    frames
}

#[test]
fn an_agent_is_blocked_where_it_did_not_get_on_and_pushed_where_it_went_another_way() {
    let (up, right) = (Some(Direction::Up), Some(Direction::Right));
    for (chosen, way, blocked, pushed) in [
        (up, (-1, 0), false, false),
        (up, (0, 0), true, false),
        (up, (1, 0), true, true),
        (up, (0, 1), true, true),
        (up, (-1, 1), false, true),
        (right, (0, 1), false, false),
        (None, (0, 0), false, false),
        (None, (1, 0), false, true),
    ] {
        let found = (is_blocked(chosen, way), is_pushed(chosen, way));
        assert_eq!(found, (blocked, pushed), "{chosen:?} {way:?}");
    }
}

#[test]
fn marks_say_where_a_swarm_falls_silent_and_where_it_agrees() {
    let mut world = world(|settings| settings.num_agents = 3);
    let quiet = || vec![Act::default(); 3];
    let same = || vec![says("go"), says("go"), Act::default()];
    let differ = || vec![says("go"), says("stay"), Act::default()];
    let one = || vec![says("go"), Act::default(), Act::default()];
    let rounds = vec![quiet(), same(), same(), quiet(), quiet(), one(), differ(), same()];
    let marks: Vec<_> =
        frames(&mut world, rounds).into_iter().map(|frame| frame.state.marks).collect();
    let (silence, convergence) = (vec![ReplayMark::Silence], vec![ReplayMark::Convergence]);
    let none = Vec::new;
    let expected =
        [none(), none(), convergence.clone(), none(), silence, none(), none(), none(), convergence];
    assert_eq!(marks, expected);
}

#[test]
fn a_page_has_fewer_rounds_of_many_agents_and_one_at_least() {
    for (rounds, agents, expected) in [
        (100, 12, 100),
        (7, 12, 7),
        (100, 200, 100),
        (100, 201, 99),
        (100, 1024, 19),
        (100, 0, 100),
    ] {
        assert_eq!(rounds_of_page(rounds, agents), expected, "{rounds} {agents}");
    }
    assert_eq!(rounds_of_page(100, AGENT_ROUNDS_MAX + 1), 1);
}

#[test]
fn a_page_ends_with_the_round_that_fills_it() {
    let mut world = world(|settings| {
        (settings.num_agents, settings.width, settings.height) = (500, 40, 40);
        (settings.view_size, settings.max_round) = (3, 100);
    });
    let mut page = PageMaker::new(Reel::of(&world), 0);
    let mut rounds = 0;
    while !page.is_full() {
        let acts = (0..500).map(|agent| says(&format!("{rounds} {agent} {}", "é".repeat(110))));
        let records = step(&mut world, acts.collect());
        page.add_round(&Round::of(&records, &world), Scene::of(&world));
        rounds += 1;
    }
    let page = page.finish();
    assert!((1..40).contains(&rounds) && page.length == rounds + 1, "{rounds}");
    assert!(page.metrics.values().all(|values| values.len() == page.states.len()));
    let bytes = serde_json::to_vec(&page).expect("JSON").len();
    // The estimate of bytes is about right.
    assert!((PAGE_BYTES_MAX * 3 / 4..PAGE_BYTES_MAX * 3 / 2).contains(&bytes), "{bytes}");
}

/// Pages begin in the middle of a game, so values must not depend on what was before.
#[test]
fn a_page_has_the_same_states_and_values_wherever_it_begins() {
    for task in TaskName::ALL {
        let mut world = world(|settings| {
            *settings = Settings::standard(task, 5);
        });
        let agents = usize::from(world.config().num_agents());
        let actions = Action::of_task(task);
        let act = |round: usize, agent: usize| Act {
            action: actions
                .get((round * 7 + agent * agent + 3 * agent) % (actions.len() + 1))
                .copied(),
            message: (round * agent % 3 == 1).then(|| Message::new("left 4?")).flatten(),
            to: None,
        };
        let mut worlds = vec![world.clone()];
        let mut records = Vec::new();
        for round in 0..12 {
            records.push(step(&mut world, (0..agents).map(|agent| act(round, agent)).collect()));
            worlds.push(world.clone());
        }
        let page = |from: u32| {
            let begin = from.saturating_sub(ROUNDS_BEFORE) as usize;
            let mut page = PageMaker::new(Reel::of(&worlds[begin]), from);
            for round in begin..12 {
                let (acts, after) = (&records[round], &worlds[round + 1]);
                page.add_round(&Round::of(acts, after), Scene::of(after));
            }
            page.finish()
        };
        let whole = page(0);
        assert_eq!(whole.length, 13);
        for from in 1..=12 {
            let part = page(from);
            assert_eq!(part.states, whole.states[from as usize..], "{} {from}", task.name());
            for (name, values) in &part.metrics {
                assert_eq!(*values, whole.metrics[name][from as usize..], "{name} {from}");
            }
        }
        // Metrics of this task have values.
        for (name, values) in whole.metrics {
            assert!(values[0].is_none(), "{name}");
            let is_rare = matches!(name.as_str(), "push_alignment");
            assert!(is_rare || values.iter().any(Option::is_some), "{name} in {}", task.name());
        }
    }
}
