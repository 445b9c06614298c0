//! The way to a place that may be far away.

use swarmbench_engine::{Direction, Pos};

use crate::chart::Chart;

/// Distance in rows or columns beyond which an agent walks straight ahead without a path search.
const FAR_STEPS: i32 = 16;

/// The first step to a goal. While the `target` beside it is far away, any step that comes nearer is taken: the ground
/// there is open, and a path search on a large map is slow.
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
