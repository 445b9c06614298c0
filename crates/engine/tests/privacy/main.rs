//! An observation depends on nothing that the agent may not know: two games are played in which other agents act
//! differently in hidden ways, and agents that may not know of it see the same.

use std::ops::Range;
use std::sync::Arc;

use swarmbench_engine::{Act, Action, AgentId, Config, Message, World};
use swarmbench_testkit::oracle::{self, Blind, Body, OracleGame, PlannedAct, State};
use swarmbench_testkit::worlds::Dice;

/// Number of pairs of games played.
const CASES: u64 = 2_000;

/// A game and its world.
struct Played {
    game: OracleGame,
    world: World,
}

impl Played {
    fn new(dice: &mut Dice) -> Self {
        let settings = oracle::settings(dice);
        let world = World::new(Arc::new(Config::check(&settings).expect("settings to be played")));
        let game = OracleGame { settings, states: vec![state(&world)], planned: Vec::new() };
        Self { game, world }
    }

    fn step(&mut self, planned: Vec<PlannedAct>) {
        let acts: Vec<Act> = planned.iter().map(|act| self.act(act)).collect();
        self.world.step(&acts);
        self.game.planned.push(planned);
        self.game.states.push(state(&self.world));
    }

    fn act(&self, act: &PlannedAct) -> Act {
        let id = |to: usize| AgentId(u16::try_from(to).expect("an agent's number"));
        Act {
            action: Action::parse(self.world.config().task(), act.action),
            message: act.message.as_deref().and_then(Message::new),
            to: act.to.map(id),
        }
    }
}

fn state(world: &World) -> State {
    let seen = world.spectator_view();
    let body = |agent: &swarmbench_engine::AgentState| Body {
        at: (agent.at.i.into(), agent.at.j.into()),
        alive: agent.alive,
        flag: agent.light_on.or(agent.carrying_food).unwrap_or_default(),
    };
    State {
        score: seen.score,
        grid: seen.grid.iter().map(|row| row.chars().collect()).collect(),
        agents: seen.agents.iter().map(body).collect(),
    }
}

/// Number of pairs of observations that had to be equal (`alike`), and the result.
#[derive(Debug, Default)]
struct Count {
    alike: u32,
    /// Number of these pairs in games in which something differed: at that moment, and ever.
    hidden: [u32; 2],
    /// Number of these pairs with messages or with a memory of more than one view.
    rich: u32,
    differ: u32,
}

/// Plays pairs of games, and compares the observations that the oracle says are equal.
fn compare(seeds: Range<u64>, blind: Blind) -> Count {
    let mut count = Count::default();
    for seed in seeds {
        let mut dice = Dice(seed);
        let mut one = Played::new(&mut dice);
        let first = dice.below(6);
        for _ in 0..first {
            if !one.world.is_over() {
                let planned = oracle::planned(&mut dice, &one.game);
                one.step(planned);
            }
        }
        let mut other = Played { game: one.game.clone(), world: one.world.clone() };
        let observer = dice.below(one.game.state().agents.len());
        for _ in 0..=dice.below(6) {
            if one.world.is_over() || other.world.is_over() {
                break;
            }
            let planned = oracle::planned(&mut dice, &one.game);
            let changed = oracle::changed(&mut dice, &one.game, &planned, observer);
            one.step(planned);
            other.step(changed);
            for (agent, number) in one.world.agents().zip(0..) {
                let knowledge = one.game.knowledge(number, blind);
                if knowledge != other.game.knowledge(number, blind) {
                    continue;
                }
                let seen = one.world.observe(agent);
                let is_same = seen == other.world.observe(agent);
                assert!(is_same || blind != Blind::Nothing, "seed {seed}, {agent}: {knowledge:?}");
                count.alike += 1;
                for (count, differs) in
                    count.hidden.iter_mut().zip(one.game.differs_from(&other.game))
                {
                    *count += u32::from(differs);
                }
                count.rich += u32::from(!seen.messages.is_empty() || seen.past_views.len() > 1);
                count.differ += u32::from(!is_same);
            }
        }
    }
    count
}

#[test]
fn observations_depend_on_nothing_hidden() {
    let count = compare(0..CASES, Blind::Nothing);
    // Hidden differences were frequent enough for the comparison to mean something.
    assert!(count.alike > 10_000, "{count:?}");
    let [now, ever] = count.hidden;
    assert!(now > count.alike / 4 && ever > count.alike / 2, "{count:?}");
    assert!(count.rich > count.alike / 4, "{count:?}");
    println!("{CASES} pairs: {count:?}");
}

/// Without this test, a comparison that never finds anything would look the same.
#[test]
fn an_oracle_that_overlooks_something_is_found_out() {
    for blind in [Blind::Edge, Blind::Messages, Blind::Past, Blind::Marks] {
        let found = |first: u64| compare(first..first + 50, blind).differ > 0;
        assert!((0..CASES).step_by(50).any(found), "{blind:?} was not found out");
    }
}

/// The oracle's windows equal the engine's, so its judgements apply to what agents see.
#[test]
fn windows_are_those_of_the_oracle() {
    for seed in 0..200 {
        let mut dice = Dice(seed);
        let mut played = Played::new(&mut dice);
        for round in 0..4 {
            if played.world.is_over() {
                break;
            }
            for (agent, number) in played.world.agents().zip(0..) {
                let Some(view) = played.world.observe(agent).view else { continue };
                let cells: Vec<Vec<String>> =
                    view.rows().map(|row| row.iter().map(ToString::to_string).collect()).collect();
                let corner = (view.origin.i.into(), view.origin.j.into());
                let window = played.game.window(round, number, Blind::Nothing);
                assert_eq!((round, corner, cells), window, "seed {seed}, {agent}");
            }
            let planned = oracle::planned(&mut dice, &played.game);
            played.step(planned);
        }
    }
}
