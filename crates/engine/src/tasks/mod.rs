//! The five tasks, one file each: the layout of the map, the update after the physics of a round, the end of the task,
//! and the marks of agents.

pub mod flocking;
pub mod foraging;
pub mod pursuit;
pub mod synchronization;
pub mod transport;

use crate::act::Act;
use crate::body::{Board, Body, Kind};
use crate::config::Config;
use crate::grid::Pos;
use crate::names::TaskName;
use crate::rng::LayoutRng;

/// The state of a task beside the board.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Task {
    Transport(transport::Transport),
    Pursuit(pursuit::Pursuit),
    Synchronization(synchronization::Synchronization),
    Foraging(foraging::Foraging),
    Flocking(flocking::Flocking),
}

/// The input of a task's own stage of a round.
pub(crate) struct Stage<'a> {
    pub(crate) config: &'a Config,
    /// Rounds resolved before this one.
    pub(crate) round: u32,
    /// Agents that had left the map before the round, by agent.
    pub(crate) had_gone: &'a [bool],
    /// The acts, by agent.
    pub(crate) acts: &'a [Act],
}

/// Memory that the tasks' own stage reuses in each round.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    danger: pursuit::DangerSums,
    flocking: flocking::Scratch,
}

impl Task {
    /// The task's own update after the physics (rules: *A round*, stage 3). Returns the new score.
    pub(crate) fn update(
        &mut self,
        stage: &Stage<'_>,
        board: &mut Board,
        score: f64,
        scratch: &mut Scratch,
    ) -> f64 {
        match self {
            Self::Transport(task) => task.update(stage, board, score),
            Self::Pursuit(task) => task.update(stage, board, score, &mut scratch.danger),
            Self::Synchronization(task) => task.update(stage, score),
            Self::Foraging(task) => task.update(board, score),
            Self::Flocking(task) => task.update(stage, board, score, &mut scratch.flocking),
        }
    }

    pub(crate) fn is_done(&self, board: &Board) -> bool {
        match self {
            Self::Transport(_) => board.agents().iter().all(|agent| agent.gone),
            Self::Flocking(task) => task.is_done(),
            Self::Pursuit(_) | Self::Synchronization(_) | Self::Foraging(_) => false,
        }
    }

    /// Lights that are on, or loads of food, by agent; empty if the task has neither.
    pub(crate) fn flags(&self) -> &[bool] {
        match self {
            Self::Synchronization(task) => &task.light_on,
            Self::Foraging(task) => &task.carrying,
            Self::Transport(_) | Self::Pursuit(_) | Self::Flocking(_) => &[],
        }
    }
}

/// Draws a whole layout in the order of the rules, with all agents.
pub(crate) fn lay_out(config: &Config) -> (Board, Task) {
    let mut plan = Plan::draw(config);
    let mut rng = plan.rng;
    spread(&mut plan.board, &mut rng, config.num_agents, plan.region);
    let task = match plan.task {
        Terrain::Transport { block } => Task::Transport(transport::Transport { block }),
        Terrain::Pursuit { prey } => Task::Pursuit(pursuit::Pursuit { prey, rng, caught: None }),
        Terrain::Synchronization(task) => Task::Synchronization(task),
        Terrain::Foraging => Task::Foraging(foraging::Foraging::new(config)),
        Terrain::Flocking => Task::Flocking(flocking::Flocking::new(config, &plan.board)),
    };
    (plan.board, task)
}

/// Number of agents that fit: the cells on which `spread` can place one. It is computed without drawing the map,
/// because settings are checked for each episode of a list.
pub(crate) fn room(config: &Config) -> i64 {
    let interior = Region::interior(config);
    match config.task {
        TaskName::Transport => interior.area() - transport::cells_taken(config, interior),
        TaskName::Pursuit => pursuit::room(config),
        TaskName::Foraging => interior.area() - foraging::cells_taken(config),
        TaskName::Synchronization | TaskName::Flocking => interior.area(),
    }
}

/// A layout before its agents are placed.
pub(crate) struct Plan {
    pub(crate) board: Board,
    pub(crate) rng: LayoutRng,
    pub(crate) region: Region,
    pub(crate) task: Terrain,
}

/// The part of a layout that the first draws decide for its task.
pub(crate) enum Terrain {
    Transport { block: crate::grid::BodyId },
    Pursuit { prey: crate::grid::BodyId },
    Synchronization(synchronization::Synchronization),
    Foraging,
    Flocking,
}

impl Plan {
    fn draw(config: &Config) -> Self {
        let board = Board::new(config.height, config.width, config.num_agents.into());
        match config.task {
            TaskName::Transport => transport::plan(config, board),
            TaskName::Pursuit => pursuit::plan(config, board),
            TaskName::Synchronization => synchronization::plan(config, board),
            TaskName::Foraging => foraging::plan(config, board),
            TaskName::Flocking => flocking::plan(config, board),
        }
    }
}

/// The cells over which agents are spread, both ends included.
#[derive(Clone, Copy)]
pub(crate) struct Region {
    rows: (i32, i32),
    columns: (i32, i32),
}

impl Region {
    /// All cells inside the wall ring.
    pub(crate) const fn interior(config: &Config) -> Self {
        Self { rows: (1, config.height - 2), columns: (1, config.width - 2) }
    }

    /// Number of cells.
    pub(crate) fn area(self) -> i64 {
        let length = |(first, last): (i32, i32)| i64::from(last - first + 1);
        length(self.rows) * length(self.columns)
    }

    pub(crate) const fn contains(self, cell: Pos) -> bool {
        self.rows.0 <= cell.i
            && cell.i <= self.rows.1
            && self.columns.0 <= cell.j
            && cell.j <= self.columns.1
    }
}

/// Places each agent in order of its number: draws a column, then a row, until the cell is free
/// (rules: *Layouts*).
fn spread(board: &mut Board, rng: &mut LayoutRng, agents: u16, region: Region) {
    for agent in 0..agents.into() {
        let cell = loop {
            let j = rng.randint(region.columns.0, region.columns.1);
            let i = rng.randint(region.rows.0, region.rows.1);
            if board.grid().is_free(Pos::new(i, j)) {
                break Pos::new(i, j);
            }
        };
        board.place_agent(agent, cell);
    }
}

/// Places the wall: a ring of one cell around the map except for `gap`, and the inner walls.
fn place_wall(board: &mut Board, gap: impl Fn(Pos) -> bool, inner: impl Fn(Pos) -> bool) {
    let (height, width) = (board.grid().height(), board.grid().width());
    let on_ring =
        |cell: Pos| cell.i == 0 || cell.i == height - 1 || cell.j == 0 || cell.j == width - 1;
    let cells = (0..height).flat_map(|i| (0..width).map(move |j| Pos::new(i, j)));
    let wall = cells.filter(|&cell| if on_ring(cell) { !gap(cell) } else { inner(cell) }).collect();
    board.place(Body::of_cells(Kind::Wall, Pos::new(0, 0), wall, true));
}

/// Places a closed ring without inner walls.
fn place_ring(board: &mut Board) {
    place_wall(board, |_| false, |_| false);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::names::RuleSet;
    use crate::settings::Settings;

    /// The number of free cells of a drawn map.
    fn counted(config: &Config) -> usize {
        let Plan { board, region, .. } = Plan::draw(config);
        let cells = (region.rows.0..=region.rows.1)
            .flat_map(|i| (region.columns.0..=region.columns.1).map(move |j| Pos::new(i, j)));
        cells.filter(|&cell| board.grid().is_free(cell)).count()
    }

    #[test]
    fn room_is_what_the_drawn_map_has() {
        let sizes = [8, 9, 10, 11, 12, 13, 16, 17, 18, 19, 20, 21, 37];
        let maps = sizes.iter().flat_map(|&width| sizes.iter().map(move |&height| (width, height)));
        for (width, height) in maps.chain([(256, 8), (8, 256), (256, 256)]) {
            let seeds = if width.max(height) < 100 { 0..24 } else { 0..8 };
            for (task, seed) in
                TaskName::ALL.iter().flat_map(|t| seeds.clone().map(move |s| (t, s)))
            {
                for rules in RuleSet::ALL {
                    if rules == RuleSet::Reference && width != height {
                        continue;
                    }
                    let config = Config::check(&Settings {
                        rules: rules.name().to_owned(),
                        num_agents: 1,
                        width,
                        height,
                        ..Settings::standard(*task, seed)
                    })
                    .expect("one agent fits on every map");
                    let counted = i64::try_from(counted(&config)).expect("few cells");
                    assert_eq!(room(&config), counted, "{task:?} {width} x {height}, seed {seed}");
                }
            }
        }
    }
}
