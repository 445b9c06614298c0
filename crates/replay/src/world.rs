//! Scenes and rounds of games that the engine plays.

use swarmbench_analysis::game::{Heard, Setup, State};
use swarmbench_analysis::journal::decisions;
use swarmbench_engine::{AgentId, Board, Body, Kind, Landmarks, Pos, World};
use swarmbench_journal::record::ActRecord;

use super::reel::{Reel, Round, Scene};

impl Scene {
    /// The scene of a world.
    #[must_use]
    pub fn of(world: &World) -> Self {
        let Landmarks { prey, block, distance } = world.landmarks();
        let loaded = world.agent_states().filter(|state| state.carrying_food == Some(true));
        let loaded = loaded.map(|state| state.agent.0).collect();
        Self { state: State::of(world), loaded, prey, block, distance }
    }
}

impl Round {
    /// The round that led to `after`, from its acts.
    pub fn of<'a>(acts: impl IntoIterator<Item = &'a ActRecord> + Clone, after: &World) -> Self {
        let number = |name: &str| AgentId::parse(name).map(|agent| agent.0);
        let to = acts
            .clone()
            .into_iter()
            .filter_map(|act| Some((number(&act.agent)?, number(act.to.as_deref()?)?)));
        let to = to.collect();
        let decisions = decisions(after.config(), acts);
        Self { decisions, has_actions: true, to, heard: Heard::all(after) }
    }
}

impl Reel {
    /// Starts at the state of a world.
    #[must_use]
    pub fn of(world: &World) -> Self {
        Self::new(Setup::of(world), Scene::of(world), world.round())
    }
}

/// The immovable cells, one text a row.
#[must_use]
pub fn ground(board: &Board) -> Vec<String> {
    let grid = board.grid();
    let symbol = |at| match board.kind_at(at) {
        Some(Kind::Wall) => 'W',
        Some(Kind::Nest) => 'N',
        Some(Kind::Food) => 'F',
        Some(Kind::Agent | Kind::Block | Kind::Prey) | None => '.',
    };
    let row = |i| (0..grid.width()).map(|j| symbol(Pos::new(i, j))).collect();
    (0..grid.height()).map(row).collect()
}

/// Cells of the block relative to its position; `None` in tasks without a block.
#[must_use]
pub fn block_cells(board: &Board) -> Option<Vec<[i32; 2]>> {
    let block: &Body = board.bodies().iter().find(|body| body.kind() == Kind::Block)?;
    let at = block.at();
    Some(block.cells().map(|cell| [cell.i - at.i, cell.j - at.j]).collect())
}
