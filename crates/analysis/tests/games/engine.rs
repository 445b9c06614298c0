//! Conversion of games of the engine.

use std::sync::Arc;

use swarmbench_analysis::game::{Decision, Setup, State};
use swarmbench_analysis::journal::decisions;
use swarmbench_engine::{Action, Config, Pos, Settings, TaskName, World};
use swarmbench_journal::record::{ActRecord, Source, Usage};

fn layouts() -> impl Iterator<Item = World> {
    TaskName::ALL.into_iter().flat_map(|task| (0..20).map(move |seed| layout(task, seed)))
}

fn layout(task: TaskName, seed: u64) -> World {
    let config = Config::check(&Settings::standard(task, seed)).expect("the standard is allowed");
    World::new(Arc::new(config))
}

/// The cells of the map that show one of these symbols, row by row.
fn cells_of(world: &World, symbols: &str) -> Vec<Pos> {
    let cells = (0..).zip(world.spectator_view().grid).flat_map(|(i, row)| {
        let row: Vec<char> = row.chars().collect();
        (0..).zip(row).map(move |(j, symbol)| (Pos::new(i, j), symbol))
    });
    cells.filter(|&(_, symbol)| symbols.contains(symbol)).map(|(cell, _)| cell).collect()
}

#[test]
fn open_cells_are_those_without_wall_nest_and_food() {
    for world in layouts() {
        let setup = Setup::of(&world);
        assert_eq!(setup.open_cells, cells_of(&world, ".ABP").len());
        assert_eq!((setup.height, setup.width, setup.view_size), (10, 10, 5));
    }
}

#[test]
fn block_and_prey_are_where_the_map_shows_them() {
    for world in layouts() {
        let state = State::of(&world);
        let mut block = state.block;
        block.sort_unstable();
        assert_eq!(block, cells_of(&world, "B"));
        let free = |prey: &Pos| {
            let near = |cell: &&Pos| cell.i.abs_diff(prey.i) + cell.j.abs_diff(prey.j) == 1;
            u32::try_from(cells_of(&world, ".").iter().filter(near).count()).expect("at most 4")
        };
        assert_eq!(state.prey_freedom, cells_of(&world, "P").first().map(free));
    }
}

#[test]
fn decisions_are_in_order_of_agents_also_where_some_left() {
    let record = |agent: &str, action: &str| ActRecord {
        agent: agent.to_owned(),
        source: Source::Player,
        action: Some(action.to_owned()),
        message: None,
        to: None,
        valid: true,
        failure: None,
        response: None,
        usage: None,
        reasoning: None,
        harness: None,
        bank_spent_ms: 0,
    };
    let usage = Usage { prompt_tokens: Some(7), completion_tokens: Some(5), ..Usage::default() };
    let acts = [
        ActRecord {
            message: Some("hi".to_owned()),
            usage: Some(Box::new(usage)),
            ..record("Agent_1", "UP")
        },
        ActRecord { source: Source::Clock, action: None, ..record("Agent_3", "") },
        ActRecord { valid: false, action: None, ..record("Agent_4", "") },
    ];
    let decided = decisions(layout(TaskName::Transport, 27).config(), &acts);
    let up = Decision {
        action: Some(Action::Up),
        message: Some("hi".to_owned()),
        tokens: Some(12),
        ..Decision::default()
    };
    assert_eq!(decided.len(), 12);
    assert_eq!(decided[1], up);
    assert_eq!(decided[3], Decision { timeout: true, ..Decision::default() });
    assert_eq!(decided[4], Decision { invalid: true, ..Decision::default() });
    assert!([0, 2, 5, 11].iter().all(|&agent| decided[agent] == Decision::default()));
}
