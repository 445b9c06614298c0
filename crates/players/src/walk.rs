//! The way to a place that may be far away.

use swarmbench_engine::{Direction, Pos};

use crate::chart::Chart;

/// From how far away an agent goes straight ahead, rows and columns taken apart.
const FAR_STEPS: i32 = 16;

/// The first step to a goal. While the `target` beside it is far away, a step that comes nearer will do:
/// the ground there is open, and on a large map it takes long to find the best way.
pub(crate) fn toward(
    chart: &Chart,
    here: Pos,
    target: Pos,
    order: [Direction; 4],
    crowd: u32,
    is_goal: impl Fn(Pos) -> bool,
) -> Option<Direction> {
    let steps = |from: Pos| (from.i - target.i).abs() + (from.j - target.j).abs();
    let is_near = here.is_within(FAR_STEPS, target);
    let mut nearer = order.into_iter().filter(|&direction| {
        let next = here.toward(direction);
        !is_near && steps(next) < steps(here) && chart.is_open(next)
    });
    let is_free = |direction: &Direction| !chart.is_taken(here.toward(*direction), 1);
    let straight = nearer.clone().find(is_free).or_else(|| nearer.next());
    straight.or_else(|| chart.way(here, order, crowd, is_goal))
}
