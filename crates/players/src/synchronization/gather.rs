//! Helpers of the Synchronization players that use their view: they gather in the middle of the map, since lights and
//! messages reach two cells.

use swarmbench_engine::{Action, Direction, Observation, Pos, RuleSet, Seen};

use crate::Seat;
use crate::chart::push;

/// The light of every other agent in view, by its number.
pub(super) fn lights(
    observation: &Observation,
    rules: RuleSet,
) -> impl Iterator<Item = (u16, bool)> {
    let cells = observation.view.iter().flat_map(|view| &view.cells);
    cells.filter_map(move |seen| match *seen {
        Seen::Agent { number, marked } => Some((number, marked == (rules == RuleSet::Paper))),
        _ => None,
    })
}

/// The step toward the middle of the map; `None` if it is there or other agents block the way.
pub(super) fn step(observation: &Observation, seat: &Seat) -> Option<Action> {
    let (here, view) = (observation.position?, observation.view.as_ref()?);
    let apart = |at: i32, cells: u16| i64::from(cells / 2) - i64::from(at);
    let (down, right) = (apart(here.i, seat.height), apart(here.j, seat.width));
    let vertical = if down < 0 { Direction::Up } else { Direction::Down };
    let horizontal = if right < 0 { Direction::Left } else { Direction::Right };
    let mut ways = [(down.abs(), vertical), (right.abs(), horizontal)];
    ways.sort_by_key(|(steps, _)| std::cmp::Reverse(*steps));
    let is_free = |cell: Pos| {
        let part = |at: i32, from: i32| usize::try_from(i64::from(at) - i64::from(from)).ok();
        let at = part(cell.i, view.origin.i).zip(part(cell.j, view.origin.j));
        at.is_some_and(|(row, column)| {
            column < view.width && view.cells.get(row * view.width + column) == Some(&Seen::Empty)
        })
    };
    let near = -i32::from(u16::MAX)..=i32::from(u16::MAX);
    let is_near = near.contains(&here.i) && near.contains(&here.j);
    let mut ways = ways.into_iter().filter(|(steps, _)| is_near && *steps > 0);
    ways.find(|(_, way)| is_free(here.toward(*way))).map(|(_, way)| push(way))
}

/// Switches if the light is not as wanted.
pub(super) fn turn(is_on: bool, wanted: bool) -> Action {
    if is_on == wanted { Action::Stay } else { Action::Switch }
}
