//! The agents by cell, and their neighbours.

use petgraph::unionfind::UnionFind;
use swarmbench_engine::{Control, Direction, Pos};

use super::counts::{Counts, real, small};
use crate::game::{Decision, Setup, State};

/// Agents sorted by cell, row by row, so that neighbours are found without a search of all agents.
pub(super) struct Cells {
    sorted: Vec<(Pos, usize)>,
}

impl Cells {
    /// All agents of a state, escaped ones included; several may be on a cell outside the map.
    pub(super) fn of_all(state: &State) -> Self {
        Self::of(state.agents.iter().enumerate().map(|(agent, body)| (body.at, agent)))
    }

    pub(super) fn of_living(state: &State) -> Self {
        Self::of(state.living().map(|(agent, body)| (body.at, agent)))
    }

    fn of(agents: impl Iterator<Item = (Pos, usize)>) -> Self {
        let mut sorted: Vec<_> = agents.collect();
        sorted.sort_unstable();
        Self { sorted }
    }

    pub(super) fn at(&self, cell: Pos) -> impl Iterator<Item = usize> {
        let first = self.sorted.partition_point(|&(at, _)| at < cell);
        self.sorted[first..].iter().take_while(move |(at, _)| *at == cell).map(|&(_, agent)| agent)
    }

    /// Calls `visit` for each unordered pair within `reach` rows and columns of each other, with indices into
    /// `sorted`.
    fn pairs_within(&self, reach: i32, mut visit: impl FnMut(usize, usize)) {
        let mut begin = 0;
        let rows: Vec<_> = (self.sorted.chunk_by(|(a, _), (b, _)| a.i == b.i))
            .map(|row| {
                begin += row.len();
                (begin - row.len(), row)
            })
            .collect();
        for (number, &(start, row)) in rows.iter().enumerate() {
            for (a, (center, _)) in (start..).zip(row) {
                let later =
                    rows[number..].iter().take_while(|(_, row)| row[0].0.i - center.i <= reach);
                for &(start, row) in later {
                    let left = row.partition_point(|(at, _)| at.j < center.j - reach);
                    // In the same row, agents further left have already visited this one.
                    let first = (start + left).max(a + 1);
                    let near = self.sorted[first.min(start + row.len())..start + row.len()].iter();
                    let near = near.take_while(|(at, _)| at.j <= center.j + reach);
                    (first..).zip(near).for_each(|(b, _)| visit(a, b));
                }
            }
        }
    }
}

/// Measures of the graph of agents that see each other.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sight {
    pub(super) components: u32,
    pub(super) separation: Option<f64>,
    pub(super) crowding: Option<f64>,
}

impl Sight {
    /// Measures the agents on the map.
    pub(super) fn of(setup: &Setup, state: &State) -> Self {
        let cells = Cells::of_living(state);
        let agents = cells.sorted.len();
        if agents == 0 {
            return Self::default();
        }
        let mut components = agents;
        let mut groups = UnionFind::<usize>::new(agents);
        let mut forces = vec![(0.0, 0.0); agents];
        let mut crowding = 0.0;
        cells.pairs_within(setup.reach(), |a, b| {
            components -= usize::from(groups.union(a, b));
            let (from, to) = (cells.sorted[a].0, cells.sorted[b].0);
            let (down, across) = (f64::from(from.i - to.i), f64::from(from.j - to.j));
            let square = down * down + across * across;
            // Two agents on one cell, which occur only in damaged data, have no direction of force.
            if square > 0.0 {
                let force = (down / square, across / square);
                forces[a] = (forces[a].0 + force.0, forces[a].1 + force.1);
                forces[b] = (forces[b].0 - force.0, forces[b].1 - force.1);
                crowding += 2.0 / square.sqrt();
            }
        });
        let separation: f64 = forces.iter().map(|(i, j)| (i * i + j * j).sqrt()).sum();
        let mean = |sum: f64| Some(sum / real(agents as u64));
        Self {
            components: match setup.control {
                Control::Decentralized => small(components),
                Control::Centralized => 1,
            },
            separation: mean(separation),
            crowding: mean(crowding),
        }
    }
}

/// Compares the states around a round, and adds the movements of agents on the map to `counts`. Returns the number of
/// pairs of all agents, escaped ones included, that stayed neighbours.
pub(super) fn compare(
    before: &State,
    after: &State,
    decisions: &[Decision],
    counts: &mut Counts,
) -> u32 {
    let cells = Cells::of_all(before);
    let was = |agent: usize| before.agents[agent];
    let is = |agent: usize| after.agents[agent];
    let mut kept_of_all = 0;
    for (agent, body) in before.agents.iter().enumerate() {
        for direction in [Direction::Down, Direction::Right] {
            for other in cells.at(body.at.toward(direction)) {
                if distance(is(agent).at, is(other).at) == 1 {
                    let both = [was(agent), was(other), is(agent), is(other)];
                    counts.kept_pairs += u32::from(both.iter().all(|agent| agent.alive));
                    kept_of_all += 1;
                }
            }
        }
    }
    for (agent, body) in before.living() {
        let goal = is(agent).at;
        counts.distance += distance(body.at, goal);
        let Some(direction) = decisions[agent].direction() else { continue };
        counts.blocked += u32::from(!is_ahead(body.at, goal, direction));
        let next = body.at.toward(direction);
        if goal != next {
            continue;
        }
        let ahead = cells.at(next).filter(|&other| was(other).alive);
        for other in ahead.filter(|&other| is(other).at == next.toward(direction)) {
            counts.pushes += 1;
            counts.pushes_strict += u32::from(decisions[other].direction() != Some(direction));
        }
    }
    kept_of_all
}

/// True if an agent advanced in a direction, whatever its movement across it.
fn is_ahead(from: Pos, to: Pos, direction: Direction) -> bool {
    let (di, dj) = direction.offset();
    di * (to.i - from.i) + dj * (to.j - from.j) > 0
}

pub(super) fn distance(a: Pos, b: Pos) -> u32 {
    a.i.abs_diff(b.i) + a.j.abs_diff(b.j)
}
