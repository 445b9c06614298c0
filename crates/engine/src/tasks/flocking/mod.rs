//! Flocking: form the outline of a square, anywhere on the map.

mod cost;

use super::{Plan, Region, Stage, Terrain, place_ring};
use crate::body::Board;
use crate::config::Config;
use crate::grid::Pos;
use crate::names::RuleSet;
use crate::rng::LayoutRng;

pub use cost::distance;

/// The seed of every layout under the rules `reference`.
const REFERENCE_SEED: u64 = 42;

/// The state of Flocking beside the board (rules: *Flocking*).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Flocking {
    target: Vec<Pos>,
    /// The cost of the layout.
    initial: f64,
    /// The cost of the current placement.
    pub(crate) current: f64,
}

pub(super) fn plan(config: &Config, mut board: Board) -> Plan {
    let seed = match config.rules {
        RuleSet::Paper => config.seed.get(),
        RuleSet::Reference => REFERENCE_SEED,
    };
    place_ring(&mut board);
    let rng = LayoutRng::new(seed);
    Plan { board, rng, region: Region::interior(config), task: Terrain::Flocking }
}

/// The cells of the outline of the square that `agents` agents are to form; its side is a quarter
/// of their number (rounded down) and one.
#[must_use]
pub fn target(agents: u16) -> Vec<Pos> {
    let last = i32::from(agents / 4);
    let square = (0..=last).flat_map(|i| (0..=last).map(move |j| Pos::new(i, j)));
    square.filter(|cell| [0, last].contains(&cell.i) || [0, last].contains(&cell.j)).collect()
}

impl Flocking {
    pub(super) fn new(config: &Config, board: &Board) -> Self {
        let target = target(config.num_agents);
        let initial = cost_of(config, board, &target);
        Self { target, initial, current: initial }
    }

    pub(super) fn update(&mut self, stage: &Stage<'_>, board: &Board, score: f64) -> f64 {
        self.current = cost_of(stage.config, board, &self.target);
        score.max(self.initial - self.current)
    }

    pub(super) fn is_done(&self) -> bool {
        self.current == 0.0
    }
}

/// The cost of the current placement, in the units of the rule set.
fn cost_of(config: &Config, board: &Board, target: &[Pos]) -> f64 {
    let agents: Vec<Pos> = board.agents().iter().map(|agent| agent.at).collect();
    let steps = f64::from(distance(&agents, target));
    match config.rules {
        RuleSet::Paper => steps / 2.0,
        RuleSet::Reference => steps,
    }
}
