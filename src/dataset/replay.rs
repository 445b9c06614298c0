//! Replay pages of imported games.

use swarmbench_analysis::game::Setup;
use swarmbench_engine::{Pos, TaskName};
use swarmbench_replay::{PageMaker, Reel, Round, Scene};

use super::format::GameRow;
use super::imported::{self, Unreadable};
use super::measure::{decisions_of, setup, state};
use crate::store::entries::ImportedRound;
use crate::store::imports::StoredImport;

/// Maximum cells of all states of a page. A page always has at least one round.
pub const IMPORT_CELLS_MAX: u32 = 4 * 1024 * 1024;

/// Maximum number of states read for a page.
#[must_use]
pub fn rounds_of_import_page(stored: &StoredImport) -> u32 {
    let cells = stored.settings.width.saturating_mul(stored.settings.height);
    (IMPORT_CELLS_MAX / cells.max(1)).max(1)
}

/// Builds a page of an imported game.
pub struct ImportPage {
    task: TaskName,
    setup: Setup,
    from: u32,
    /// Cells of the block relative to its position.
    block: Vec<Pos>,
    page: Option<PageMaker>,
    /// Decisions in the last state.
    decided: Round,
}

impl ImportPage {
    /// Starts a page at the state `from`. `layout` is the first state of the game.
    pub fn new(
        stored: &StoredImport,
        layout: &ImportedRound,
        from: u32,
    ) -> Result<Self, Unreadable> {
        let setup = setup(stored)?;
        let row = imported::game_row(setup.task.name(), layout)?;
        let block = shape(&cells_of(&row, "B"));
        Ok(Self { task: setup.task, setup, from, block, page: None, decided: Round::default() })
    }

    /// Cells of the block relative to its position; `None` in tasks without a block.
    #[must_use]
    pub fn block_cells(&self) -> Option<Vec<[i32; 2]>> {
        let cells = self.block.iter().map(|cell| [cell.i, cell.j]).collect();
        Some(cells).filter(|_| !self.block.is_empty())
    }

    /// Adds the next state unless the page is full.
    pub fn add(&mut self, round: &ImportedRound) -> Result<(), Unreadable> {
        if self.page.as_ref().is_some_and(PageMaker::is_full) {
            return Ok(());
        }
        let row = imported::game_row(self.task.name(), round)?;
        let scene = self.scene(&row);
        let decisions = decisions_of(self.task, round, &row, &scene.state)?;
        let has_actions = round.acts.is_some();
        let decided = Round { decisions, has_actions, ..Round::default() };
        let mut before = std::mem::replace(&mut self.decided, decided);
        match &mut self.page {
            None => {
                let reel = Reel::new(self.setup.clone(), scene, round.round);
                self.page = Some(PageMaker::new(reel, self.from));
            }
            Some(page) => {
                if !before.has_actions {
                    add_messages(&mut before, &row);
                }
                page.add_round(&before, scene);
            }
        }
        Ok(())
    }

    pub fn finish(self) -> Result<swarmbench_protocol::replay::ReplayPage, Unreadable> {
        Ok(self.page.ok_or_else(|| "it has no states".to_owned())?.finish())
    }

    fn scene(&self, row: &GameRow) -> Scene {
        let state = state(self.task, row);
        let is_loaded = |at: Pos| self.task == TaskName::Foraging && cell(row, at) == Some("A");
        let loaded = (0..).zip(&state.agents).filter(|(_, agent)| is_loaded(agent.at));
        let loaded = loaded.map(|(number, _)| number).collect();
        let block = self.block_position(&state.block);
        Scene { loaded, prey: cells_of(row, "P").first().copied(), block, distance: None, state }
    }

    /// Position of the block from its visible cells; the rest may be outside of the map.
    fn block_position(&self, visible: &[Pos]) -> Option<Pos> {
        let first = visible.first()?;
        let lies_at = |at: &Pos| {
            let cells = self.block.iter().map(|cell| Pos::new(at.i + cell.i, at.j + cell.j));
            cells.filter(|&cell| self.contains(cell)).eq(visible.iter().copied())
        };
        self.block.iter().map(|cell| Pos::new(first.i - cell.i, first.j - cell.j)).find(lies_at)
    }

    const fn contains(&self, cell: Pos) -> bool {
        0 <= cell.i && cell.i < self.setup.height && 0 <= cell.j && cell.j < self.setup.width
    }
}

/// Adds the messages of a game without acts, which are in the state after the round.
fn add_messages(round: &mut Round, after: &GameRow) {
    for said in after.messages.iter().filter(|said| !said.message.is_empty()) {
        let agent = after.agents.iter().position(|agent| agent.id == said.agent_name);
        if let Some(decision) = agent.and_then(|agent| round.decisions.get_mut(agent)) {
            decision.message = Some(said.message.clone());
        }
    }
}

/// The immovable cells, one text a row.
pub fn ground(task: &str, round: &ImportedRound) -> Result<Vec<String>, Unreadable> {
    let row = imported::game_row(task, round)?;
    let symbol = |cell: &String| match cell.as_str() {
        fixed @ ("W" | "N" | "F") => fixed.to_owned(),
        _ => ".".to_owned(),
    };
    Ok(row.grid.iter().map(|cells| cells.iter().map(symbol).collect()).collect())
}

/// Cells relative to their bounding box.
fn shape(cells: &[Pos]) -> Vec<Pos> {
    let top = cells.iter().map(|cell| cell.i).min().unwrap_or_default();
    let left = cells.iter().map(|cell| cell.j).min().unwrap_or_default();
    cells.iter().map(|cell| Pos::new(cell.i - top, cell.j - left)).collect()
}

fn cell(row: &GameRow, at: Pos) -> Option<&str> {
    let (i, j) = (usize::try_from(at.i).ok()?, usize::try_from(at.j).ok()?);
    Some(row.grid.get(i)?.get(j)?.as_str())
}

/// Positions of a symbol, row by row.
fn cells_of(row: &GameRow, symbol: &str) -> Vec<Pos> {
    let rows = (0..).zip(&row.grid);
    let cells = rows.flat_map(|(i, cells)| {
        (0..).zip(cells).filter(|(_, cell)| *cell == symbol).map(move |(j, _)| Pos::new(i, j))
    });
    cells.collect()
}
