//! A round as a sequence of stages (rules: *A round*).

use std::cell::RefCell;
use std::sync::Arc;

use crate::act::{Act, Action};
use crate::grid::Direction;
use crate::physics::{self, Solver, SolverError};
use crate::tasks::{self, Stage};
use crate::world::{Moment, World};

/// Memory that rounds reuse: once as many rounds were played as agents remember, a round without messages allocates
/// nothing. It has no state: any world may use it after any other.
#[derive(Debug, Default)]
pub struct Scratch {
    wishes: Vec<Option<Direction>>,
    had_gone: Vec<bool>,
    physics: physics::Scratch,
    tasks: tasks::Scratch,
}

thread_local! {
    /// The scratch memory of [`World::step`].
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

impl World {
    /// Resolves one round: `acts[n]` is the act of agent `n`. Acts of escaped agents are ignored.
    ///
    /// # Panics
    /// Panics if the episode is over, or `acts` does not have one entry for each agent.
    pub fn step(&mut self, acts: &[Act]) {
        SCRATCH.with_borrow_mut(|scratch| self.step_in(acts, scratch));
    }

    /// Resolves one round with reused memory.
    ///
    /// # Panics
    /// Panics like [`World::step`].
    pub fn step_in(&mut self, acts: &[Act], scratch: &mut Scratch) {
        self.advance(acts, Solver::Flow, scratch).expect("the flow cannot fail");
    }

    /// Resolves one round with the given solver for the physics.
    ///
    /// # Errors
    /// See [`Solver::movers`]; the world is unchanged after an error.
    ///
    /// # Panics
    /// Panics like [`World::step`].
    pub fn step_with(
        &mut self,
        acts: &[Act],
        solver: Solver,
        scratch: &mut Scratch,
    ) -> Result<(), SolverError> {
        if solver == Solver::Flow {
            self.step_in(acts, scratch);
            return Ok(());
        }
        let mut next = self.clone();
        next.advance(acts, solver, scratch)?;
        *self = next;
        Ok(())
    }

    /// Plays a round. After an error the world is unusable.
    fn advance(
        &mut self,
        acts: &[Act],
        solver: Solver,
        scratch: &mut Scratch,
    ) -> Result<(), SolverError> {
        assert!(!self.is_over(), "an episode that is over has no more rounds");
        assert_eq!(acts.len(), self.board.agents().len(), "one act for each agent");

        let remembered = (self.config.memory > 0).then(|| self.remember(acts));
        self.mail.post(&self.config, &self.board, self.round, acts);

        let Scratch { wishes, had_gone, physics, tasks } = scratch;
        let agents = self.board.agents();
        wishes.clear();
        wishes.extend(
            agents
                .iter()
                .zip(acts)
                .map(|(agent, act)| act.action.filter(|_| !agent.gone).and_then(Action::direction)),
        );
        had_gone.clear();
        had_gone.extend(agents.iter().map(|agent| agent.gone));

        physics::resolve(&mut self.board, wishes, solver, physics)?;
        let stage = Stage { config: &self.config, round: self.round, had_gone, acts };
        self.score = self.task.update(&stage, &mut self.board, self.score, tasks);
        if let Some(mut moment) = remembered {
            if let Some(moment) = Arc::get_mut(&mut moment) {
                moment.settle(&self.board);
            }
            self.past.push_front(moment);
        }
        self.round += 1;
        self.mail.deliver(&self.config, &self.board, self.round);
        Ok(())
    }

    /// The moment that agents will remember of the round: the current board, and their acts; escaped agents do nothing.
    /// The new moment replaces the oldest remembered one, and reuses its memory unless a clone of the world shares it.
    fn remember(&mut self, acts: &[Act]) -> Arc<Moment> {
        let agents = self.board.agents().iter().zip(acts);
        let fixed =
            agents.map(|(agent, act)| if agent.gone { Act::default() } else { act.clone() });
        let oldest =
            self.past.len().checked_sub(self.config.memory).and_then(|_| self.past.pop_back());
        if let Some(mut oldest) = oldest
            && let Some(moment) = Arc::get_mut(&mut oldest)
        {
            moment.round = self.round;
            moment.flags.clear();
            moment.flags.extend_from_slice(self.task.flags());
            moment.acts.clear();
            moment.acts.extend(fixed);
            self.board.replace(&mut moment.board);
            return oldest;
        }
        Arc::new(Moment {
            round: self.round,
            flags: self.task.flags().to_vec(),
            acts: fixed.collect(),
            board: self.board.clone(),
            bytes: 0,
        })
    }
}
