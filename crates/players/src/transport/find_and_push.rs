//! Transport by memory, without messages.

use swarmbench_engine::{Act, Action, Direction, Observation, Pos};

use super::exit::{Exit, ExitCell, PUSHES, Sight, is_block};
use crate::chance::Chance;
use crate::chart::{Chart, push};
use crate::walk::toward;
use crate::{Player, Seat};

/// Detour in steps that an agent in the way is worth.
const CROWD: u32 = 1;

/// Remembers the map and drops every exit that does not fit its view. Once it knows the true one it goes to the nearest
/// free cell behind the block, as all others do: they push the block free together, then walk around it to push it out.
#[derive(Clone)]
struct FindAndPush {
    chance: Chance,
    chart: Chart,
    seat: Seat,
    /// The exits that may be the true one.
    exits: Vec<Exit>,
    /// A block that was pushed along leaves the way out free.
    freed: bool,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let (chance, chart) = (Chance::new(seat), Chart::new(seat));
    let (seat, exits) = (seat.clone(), Exit::all(seat).to_vec());
    Box::new(FindAndPush { chance, chart, seat, exits, freed: false })
}

impl Player for FindAndPush {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        let Some(view) = &observation.view else { return Act::default() };
        self.exclude(&Sight::of(view, &self.seat));
        let order = self.chance.order();
        Act::of(match self.exits[..] {
            [exit] => self.work(here, exit, order),
            _ => self.search(here, order),
        })
    }
}

impl FindAndPush {
    /// Drops every exit that the view contradicts. If none is left, an earlier exclusion was wrong, and all count
    /// again.
    fn exclude(&mut self, sight: &Sight<'_>) {
        let explains = |exit: &Exit| (0..=PUSHES).any(|pushes| exit.explains(sight, pushes));
        self.exits.retain(explains);
        if self.exits.is_empty() {
            self.exits = Exit::all(&self.seat).to_vec();
        }
        match self.exits[..] {
            [exit] => self.freed |= !exit.explains(sight, 0),
            _ => self.freed = false,
        }
    }

    /// Goes to the nearest unknown cell that could belong to the block.
    fn search(&self, here: Pos, order: [Direction; 4]) -> Action {
        let is_unknown = |cell: Pos| self.chart.is_unknown(cell);
        let steps = |to: &Pos| (here.i - to.i).abs() + (here.j - to.j).abs();
        let unknown =
            self.exits.iter().flat_map(|exit| exit.block().filter(|cell| is_unknown(*cell)));
        let step = unknown.min_by_key(steps).and_then(|target| {
            let is_telling = |cell: Pos| {
                is_unknown(cell) && self.exits.iter().any(|exit| is_block(exit.place(cell), 0))
            };
            toward(&self.chart, here, target, order, CROWD, is_telling)
        });
        push(step.unwrap_or(order[0]))
    }

    /// Pushes if the agent stands in a lane, which ends at the block and later leads out; otherwise walks to one. A
    /// full lane blocks the next one: an agent in the way is pushed into it.
    fn work(&self, here: Pos, exit: Exit, order: [Direction; 4]) -> Action {
        let chart = &self.chart;
        let is_lane = |cell: Pos| match exit.place(cell) {
            ExitCell { far, .. } if self.freed => (1..=3).contains(&far),
            ExitCell { deep, far } => (1..=3).contains(&deep) && far >= 5,
        };
        if is_lane(here) {
            return push(if self.freed { exit.out } else { exit.along });
        }
        let is_goal = |cell: Pos| is_lane(cell) && !chart.is_taken(cell, 1);
        let ExitCell { deep, far } = exit.place(here);
        let beside = if self.freed {
            ExitCell { deep, far: 2 }
        } else {
            ExitCell { deep: 2, far: far.max(5) }
        };
        let target = exit.cell(beside);
        toward(chart, here, target, order, CROWD, is_goal).map_or(Action::Stay, push)
    }
}
