//! Flocking: form the outline of a square, anywhere on the map.

mod assignment;
mod cells;
mod cost;
mod field;
mod lines;
mod meetings;

use std::sync::Arc;

use super::{Plan, Region, Stage, Terrain, place_ring};
use crate::body::Board;
use crate::config::Config;
use crate::grid::Pos;
use crate::names::RuleSet;
use crate::rng::LayoutRng;

use cells::Shape;
pub use cost::distance;
use cost::{Known, Search};

/// The seed of every layout under the rules `reference`.
const REFERENCE_SEED: u64 = 42;

/// The state of Flocking beside the board (rules: *Flocking*).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Flocking {
    target: Arc<Shape>,
    /// The cost of the layout.
    initial: f64,
    /// The cost of the current placement.
    pub(crate) current: f64,
    /// The search state of this cost: a good start for the next round.
    known: Known,
}

/// Memory that the cost reuses in each round.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    agents: Vec<Pos>,
    search: Search,
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
        let target = Arc::new(Shape::new(&target(config.num_agents)));
        let mut task = Self { target, initial: 0.0, current: 0.0, known: Known::default() };
        task.measure(config, board, &mut Scratch::default());
        Self { initial: task.current, ..task }
    }

    pub(super) fn update(
        &mut self,
        stage: &Stage<'_>,
        board: &Board,
        score: f64,
        scratch: &mut Scratch,
    ) -> f64 {
        self.measure(stage.config, board, scratch);
        score.max(self.initial - self.current)
    }

    /// Finds the cost of the current placement, in the units of the rule set.
    fn measure(&mut self, config: &Config, board: &Board, scratch: &mut Scratch) {
        let Scratch { agents, search } = scratch;
        agents.clear();
        agents.extend(board.agents().iter().map(|agent| agent.at));
        let steps = f64::from(search.least(&self.target, agents, &mut self.known));
        self.current = match config.rules {
            RuleSet::Paper => steps / 2.0,
            RuleSet::Reference => steps,
        };
    }

    pub(super) fn is_done(&self) -> bool {
        self.current == 0.0
    }
}
