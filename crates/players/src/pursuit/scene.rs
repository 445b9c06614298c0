//! The state of the hunt as an agent believes it to be, and the next state: the moves of all agents, given the posts,
//! and then that of the prey.

use swarmbench_engine::{Direction, Kind, Pos, RuleSet};

use super::field::Field;
use super::march::{March, Step, assign};
use super::quarry::Quarry;

/// Cost of a new prey that runs free, in rounds.
const ESCAPE: f64 = 5.0;

/// Agents in an order that only this agent uses, and the prey if its place is known.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    pub(super) agents: Vec<Pos>,
    /// Agents that will not leave their posts.
    pub(super) settled: Vec<bool>,
    pub(super) prey: Option<Pos>,
    pub(super) rules: RuleSet,
}

impl Scene {
    /// The map with the scene's agents and prey, made from the empty map `bare`.
    pub(super) fn field(&self, bare: &Field) -> Field {
        let mut field = bare.clone();
        for agent in &self.agents {
            field.put(*agent, Some(Kind::Agent));
        }
        if let Some(prey) = self.prey {
            field.put(prey, Some(Kind::Prey));
        }
        field
    }

    /// The moves of all agents: those that can catch the prey at once do so, all others go to their posts.
    pub(super) fn steps(&self, field: &Field, posts: &[Pos]) -> Vec<Step> {
        let mut march = March::new(field, &self.agents);
        let closing = self.prey.and_then(|prey| self.closing(field, prey));
        for (agent, step) in closing.into_iter().flatten() {
            march.fix(agent, step);
        }
        march.go(&assign(&self.agents, &self.settled, posts))
    }

    /// Advances the scene by a round. The prey is `None` afterwards if it was caught.
    pub(super) fn advance(&mut self, bare: &Field, steps: &[Step]) {
        for (agent, step) in self.agents.iter_mut().zip(steps) {
            if let Some(step) = step {
                *agent = agent.toward(*step);
            }
        }
        if let Some(prey) = self.prey.take() {
            let field = self.field(bare);
            self.prey = field.after_flight(self.rules, prey);
        }
    }

    /// The cost of these posts in rounds until every round catches a prey, if it is less than `limit`.
    pub(super) fn cost(&self, bare: &Field, posts: &[Pos], limit: f64) -> Option<f64> {
        let (rounds, then) = self.catch(bare, |_| posts.to_vec(), limit)?;
        let field = then.field(bare);
        let cost = f64::from(rounds) + ESCAPE * (1.0 - Quarry::new(&field).share_trapped(&field));
        (cost < limit).then_some(cost)
    }

    /// The number of rounds until the prey is caught, if less than `limit`, and the scene after that. `posts` gives the
    /// posts of each scene.
    pub(super) fn catch(
        &self,
        bare: &Field,
        posts: impl Fn(&Self) -> Vec<Pos>,
        limit: f64,
    ) -> Option<(u32, Self)> {
        let mut scene = self.clone();
        let mut rounds = 0;
        while f64::from(rounds) < limit {
            let prey = scene.prey?;
            let field = scene.field(bare);
            let is_caught = scene.closing(&field, prey).is_some();
            let steps = scene.steps(&field, &posts(&scene));
            scene.advance(bare, &steps);
            if is_caught {
                return Some((rounds, scene));
            }
            rounds += 1;
        }
        None
    }

    /// Steps that catch a prey on this cell at once: agents beside it stay, and others fill all gaps.
    pub(super) fn closing(&self, field: &Field, prey: Pos) -> Option<Vec<(usize, Step)>> {
        let gaps: Vec<Pos> = field.gaps(prey).collect();
        let mut steps = Vec::new();
        if !self.fill(&gaps, &mut steps) {
            return None;
        }
        let is_beside = |at: Pos| Direction::ALL.iter().any(|&side| prey.toward(side) == at);
        let beside = self.agents.iter().enumerate().filter(|(_, at)| is_beside(**at));
        steps.extend(beside.map(|(agent, _)| (agent, None)));
        Some(steps)
    }

    /// Finds a different agent for each of the gaps, and adds their steps.
    fn fill(&self, gaps: &[Pos], steps: &mut Vec<(usize, Step)>) -> bool {
        let Some((&gap, rest)) = gaps.split_first() else { return true };
        for step in Direction::ALL {
            let from = gap.toward(step.opposite());
            let Some(agent) = self.agents.iter().position(|&at| at == from) else { continue };
            if steps.iter().all(|(other, _)| *other != agent) {
                steps.push((agent, Some(step)));
                if self.fill(rest, steps) {
                    return true;
                }
                steps.pop();
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(agents: &[(i32, i32)], prey: (i32, i32)) -> Scene {
        Scene {
            agents: agents.iter().map(|&(i, j)| Pos::new(i, j)).collect(),
            settled: vec![false; agents.len()],
            prey: Some(Pos::new(prey.0, prey.1)),
            rules: RuleSet::Paper,
        }
    }

    #[test]
    fn a_prey_in_a_corner_is_caught_by_two_who_are_near() {
        let bare = Field::new(10, 10);
        let mut scene = scene(&[(8, 6), (6, 8)], (8, 8));
        let steps = scene.steps(&scene.field(&bare), &[Pos::new(1, 1), Pos::new(1, 2)]);
        assert_eq!(steps, [Some(Direction::Right), Some(Direction::Down)]);
        scene.advance(&bare, &steps);
        assert_eq!(scene.prey, None);
    }

    #[test]
    fn who_stands_beside_a_prey_that_is_caught_stays() {
        let bare = Field::new(10, 10);
        let scene = scene(&[(7, 8), (8, 6)], (8, 8));
        let steps = scene.steps(&scene.field(&bare), &[Pos::new(1, 1), Pos::new(1, 2)]);
        assert_eq!(steps, [None, Some(Direction::Right)]);
    }

    #[test]
    fn one_agent_fills_one_gap() {
        let scene = scene(&[(7, 7)], (8, 8));
        assert_eq!(scene.closing(&scene.field(&Field::new(10, 10)), Pos::new(8, 8)), None);
    }

    #[test]
    fn a_net_that_never_catches_has_no_cost() {
        let bare = Field::new(10, 10);
        let scene = scene(&[(1, 1)], (8, 8));
        assert_eq!(scene.cost(&bare, &[Pos::new(1, 1)], 9.0), None);
    }
}
