//! A round, as a short list of stages (rules: *A round*).

use std::sync::Arc;

use crate::act::{Act, AgentId};
use crate::grid::Direction;
use crate::physics::{self, Solver, SolverError};
use crate::tasks::Stage;
use crate::world::{Moment, World};

impl World {
    /// Resolves one round: `acts[n]` is what agent `n` decided, "no action, no message" by default.
    /// What an escaped agent decides is ignored.
    ///
    /// # Panics
    /// Where the episode is over, or `acts` does not have one entry for each agent.
    pub fn step(&mut self, acts: &[Act]) {
        self.step_with(acts, Solver::Flow).expect("the flow cannot fail");
    }

    /// The same with a choice of the solver that finds who moves.
    ///
    /// # Errors
    /// See [`Solver::movers`]; the world is then as it was.
    ///
    /// # Panics
    /// As [`World::step`].
    pub fn step_with(&mut self, acts: &[Act], solver: Solver) -> Result<(), SolverError> {
        assert!(!self.is_over(), "an episode that is over has no more rounds");
        assert_eq!(acts.len(), self.board.agents().len(), "one act for each agent");

        let acts = self.fix_acts(acts);
        let mut board = self.board.clone();
        physics::resolve(&mut board, &wishes(&acts), solver)?;
        let before = std::mem::replace(&mut self.board, board);
        self.mail.post(&self.config, &before, self.round, &acts);
        let flags = self.task.flags().to_vec();
        let stage = Stage { config: &self.config, round: self.round, before: &before, acts: &acts };
        self.score = self.task.update(&stage, &mut self.board, self.score);
        self.remember(Moment::new(self.round, before, &self.board, flags, acts));
        self.round += 1;
        self.mail.deliver(&self.config, &self.board, self.round);
        Ok(())
    }

    /// Stage 1: what every agent does is fixed; those who have escaped do nothing.
    fn fix_acts(&self, acts: &[Act]) -> Vec<Act> {
        let agents = self.agents();
        let fix = |(agent, act): (AgentId, &Act)| {
            if self.is_alive(agent) { act.clone() } else { Act::default() }
        };
        agents.zip(acts).map(fix).collect()
    }

    fn remember(&mut self, moment: Moment) {
        self.past.truncate(self.config.memory.saturating_sub(1));
        if self.config.memory > 0 {
            self.past.push_front(Arc::new(moment));
        }
    }
}

/// In which direction each agent pushes.
fn wishes(acts: &[Act]) -> Vec<Option<Direction>> {
    acts.iter().map(|act| act.action.and_then(crate::act::Action::direction)).collect()
}
