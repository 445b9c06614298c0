//! The joint moves of a swarm that knows all places: the assignment of posts, and steps that never block each other, so
//! that every agent can predict the places of all.

use swarmbench_engine::tasks::pursuit::Ground;
use swarmbench_engine::{Direction, Pos};

use super::field::Field;
use crate::assign::assign as cheapest;

/// The step of an agent; `None` if it stays or its position is unknown.
pub(super) type Step = Option<Direction>;

/// Value of leaving a settled agent on its post: more than any way across a map costs.
const SETTLED: i64 = 1 << 20;

/// Assigns every agent a post of its own with the least sum of squared distances: squares even out the distances, as
/// the last agent to arrive counts. A settled agent keeps the post on which it stands. Agents beyond the number of
/// posts get none.
pub(super) fn assign(agents: &[Pos], settled: &[bool], posts: &[Pos]) -> Vec<Option<Pos>> {
    let cost = |agent: usize, post: usize| {
        let (from, to) = (agents[agent], posts[post]);
        if from == to && settled.get(agent) == Some(&true) {
            return -SETTLED;
        }
        let distance = i64::from((from.i - to.i).abs()) + i64::from((from.j - to.j).abs());
        distance * distance
    };
    let count = agents.len().min(posts.len());
    let row = |agent| (0..posts.len()).map(|post| cost(agent, post)).collect();
    let chosen = cheapest(&(0..count).map(row).collect::<Vec<Vec<i64>>>());
    (0..agents.len()).map(|agent| chosen.get(agent).map(|&post| posts[post])).collect()
}

/// Steps of all agents, found one agent after the other.
pub(super) struct March<'a> {
    field: &'a Field,
    agents: &'a [Pos],
    steps: Vec<Plan>,
    /// Cells that are occupied after the round.
    taken: Vec<Pos>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Plan {
    Open,
    /// The decision waits for that of another agent.
    Asked,
    Fixed(Step),
}

impl<'a> March<'a> {
    /// A march of agents on a field that contains them and the prey.
    pub(super) fn new(field: &'a Field, agents: &'a [Pos]) -> Self {
        Self { field, agents, steps: vec![Plan::Open; agents.len()], taken: Vec::new() }
    }

    /// Fixes the step of an agent.
    pub(super) fn fix(&mut self, agent: usize, step: Step) {
        let at = self.agents[agent];
        self.taken.push(step.map_or(at, |step| at.toward(step)));
        self.steps[agent] = Plan::Fixed(step);
    }

    /// Lets all other agents go toward their goals, those with the longest way first.
    pub(super) fn go(mut self, goals: &[Option<Pos>]) -> Vec<Step> {
        let mut order: Vec<usize> = (0..self.agents.len()).collect();
        let length = |agent: usize| {
            let at = self.agents[agent];
            goals[agent].map_or(0, |goal| (goal.i - at.i).abs() + (goal.j - at.j).abs())
        };
        order.sort_by_key(|&agent| std::cmp::Reverse(length(agent)));
        for agent in order {
            self.decide(agent, goals);
        }
        let step = |plan: &Plan| match *plan {
            Plan::Fixed(step) => step,
            Plan::Open | Plan::Asked => None,
        };
        self.steps.iter().map(step).collect()
    }

    fn decide(&mut self, agent: usize, goals: &[Option<Pos>]) {
        if self.steps[agent] != Plan::Open {
            return;
        }
        self.steps[agent] = Plan::Asked;
        let at = self.agents[agent];
        let steps = goals[agent].map_or([None; 2], |goal| steps_toward(at, goal));
        let step = steps.into_iter().flatten().find(|&step| self.can_go(agent, step, goals));
        self.fix(agent, step);
    }

    /// True if the agent gets to the next cell without touching another. Passes of the physics follow one another, so a
    /// cell is free in time if the agent on it leaves in an earlier pass, or in the same direction.
    fn can_go(&mut self, agent: usize, step: Direction, goals: &[Option<Pos>]) -> bool {
        let to = self.agents[agent].toward(step);
        if self.taken.contains(&to) {
            return false;
        }
        if self.field.is_free(to) {
            return true;
        }
        let Some(other) = self.agents.iter().position(|&at| at == to) else { return false };
        self.decide(other, goals);
        let Plan::Fixed(Some(leaves)) = self.steps[other] else { return false };
        let pass = |direction| Direction::ALL.iter().position(|&other| other == direction);
        !self.taken.contains(&to) && (leaves == step || pass(leaves) < pass(step))
    }
}

/// The steps that bring an agent nearer to its goal, the one along the longer side first.
fn steps_toward(at: Pos, goal: Pos) -> [Step; 2] {
    let (down, right) = (goal.i - at.i, goal.j - at.j);
    let vertical = match down.signum() {
        1 => Some(Direction::Down),
        -1 => Some(Direction::Up),
        _ => None,
    };
    let horizontal = match right.signum() {
        1 => Some(Direction::Right),
        -1 => Some(Direction::Left),
        _ => None,
    };
    if down.abs() > right.abs() { [vertical, horizontal] } else { [horizontal, vertical] }
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::Kind;

    use super::*;

    /// The steps of agents on a map of 10 × 10 with nothing else on it.
    fn march(agents: &[(i32, i32)], goals: &[(i32, i32)]) -> Vec<Step> {
        let pos =
            |cells: &[(i32, i32)]| cells.iter().map(|&(i, j)| Pos::new(i, j)).collect::<Vec<_>>();
        let (agents, goals) = (pos(agents), pos(goals));
        let mut field = Field::new(10, 10);
        for at in &agents {
            field.put(*at, Some(Kind::Agent));
        }
        March::new(&field, &agents).go(&goals.into_iter().map(Some).collect::<Vec<_>>())
    }

    #[test]
    fn the_way_is_shared_out_evenly() {
        let posts = [Pos::new(1, 3), Pos::new(1, 5)];
        let agents = [Pos::new(1, 3), Pos::new(1, 1)];
        assert_eq!(assign(&agents, &[false; 2], &posts), [Some(posts[1]), Some(posts[0])]);
        assert_eq!(assign(&agents, &[true, false], &posts), [Some(posts[0]), Some(posts[1])]);
        assert_eq!(assign(&[], &[], &posts), []);
        let more = [Pos::new(1, 3), Pos::new(1, 5), Pos::new(1, 7)];
        assert_eq!(assign(&more, &[false; 3], &posts)[2], None);
    }

    #[test]
    fn a_row_moves_on_together() {
        let steps = march(&[(1, 1), (1, 2), (1, 3)], &[(1, 4), (1, 5), (1, 6)]);
        assert_eq!(steps, [Some(Direction::Right); 3]);
    }

    #[test]
    fn nobody_enters_a_cell_that_is_left_in_a_later_pass() {
        // The pass down comes before the pass right, so the upper agent would push the lower one.
        let steps = march(&[(1, 1), (2, 1)], &[(4, 1), (2, 4)]);
        assert_eq!(steps, [None, Some(Direction::Right)]);
        // The pass up comes before the pass right.
        let steps = march(&[(2, 1), (2, 2)], &[(2, 5), (1, 2)]);
        assert_eq!(steps, [Some(Direction::Right), Some(Direction::Up)]);
    }

    #[test]
    fn two_do_not_enter_the_same_cell_nor_change_places() {
        let steps = march(&[(1, 1), (1, 3)], &[(1, 3), (1, 1)]);
        assert_eq!(steps.iter().flatten().count(), 1);
        assert_eq!(march(&[(1, 1), (1, 2)], &[(1, 2), (1, 1)]), [None, None]);
    }
}
