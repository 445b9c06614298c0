//! Pursuit by traps in the corners.

use swarmbench_engine::{Act, Direction, Kind, Observation, Pos, RuleSet, Seen, View};

use super::field::Field;
use super::march::{March, Step, assign};
use super::net::Nets;
use super::news::{self, Fix, News};
use super::quarry::{Quarry, Whereabouts, is_odd_cell};
use crate::chart::{Chart, push};
use crate::{Player, Seat};

struct CornerTraps {
    agent: usize,
    rules: RuleSet,
    chart: Chart,
    bare: Field,
    nets: Nets,
    /// What it believed in its last round.
    news: News,
    /// Where the prey may be.
    quarry: Quarry,
    score: f64,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let Some(nets) = Nets::of(seat) else { return super::close_in::make(seat) };
    let news = News { agents: vec![None; usize::from(seat.num_agents)], prey: None, is_odd: None };
    Box::new(CornerTraps {
        agent: seat.agent.index(),
        rules: seat.rules,
        chart: Chart::new(seat),
        bare: Field::new(seat.height.into(), seat.width.into()),
        nets,
        news,
        score: 0.0,
        quarry: Quarry::first(seat.height.into(), seat.width.into()),
    })
}

impl Player for CornerTraps {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        self.listen(observation);
        self.foresee();
        self.see(observation, here);
        let steps = self.plan();
        let step = steps.get(self.agent).copied().flatten();
        let message = news::write(&self.news, observation.round);
        Act { action: Some(step.map_or(swarmbench_engine::Action::Stay, push)), message, to: None }
    }
}

impl CornerTraps {
    /// Takes what others knew in the last round, where it is newer.
    fn listen(&mut self, observation: &Observation) {
        let count = self.news.agents.len();
        for message in &observation.messages {
            let Some((_, told)) = news::read(message.as_str(), observation.round, count) else {
                continue;
            };
            for (agent, fix) in told.agents.into_iter().enumerate() {
                if agent != self.agent {
                    take_newer(&mut self.news.agents[agent], fix);
                }
            }
            take_newer(&mut self.news.prey, told.prey);
            self.news.is_odd = self.news.is_odd.or(told.is_odd);
        }
    }

    /// Moves everybody to where they must be a round later.
    fn foresee(&mut self) {
        let steps = self.plan();
        let places: Vec<Pos> = self.news.agents.iter().flatten().map(|fix| fix.at).collect();
        let field = self.field(None);
        self.quarry.escape(|at| close(&field, &places, at).is_none());
        for (fix, step) in self.news.agents.iter_mut().zip(steps) {
            if let (Some(fix), Some(step)) = (fix.as_mut(), step) {
                fix.at = fix.at.toward(step);
            }
        }
        let field = self.field(None);
        if let Some(prey) = self.news.prey {
            let next = field.after_flight(self.rules, prey.at);
            self.news.prey = next.map(|at| Fix { at, ..prey });
        }
        self.quarry.flee(&field, self.rules);
    }

    /// What it sees with own eyes counts more than anything.
    fn see(&mut self, observation: &Observation, here: Pos) {
        let now = observation.round;
        if observation.score > self.score {
            self.news.prey = None;
            self.news.is_odd = None;
            self.quarry = Quarry::new(&self.field(None));
        }
        self.score = observation.score;
        for (at, seen) in observation.view.iter().flat_map(View::positions) {
            for (agent, fix) in self.news.agents.iter_mut().enumerate() {
                let is_there =
                    matches!(seen, Seen::Agent { number, .. } if usize::from(number) == agent);
                if is_there {
                    *fix = Some(Fix { at, seen: now });
                } else if fix.is_some_and(|fix| fix.at == at) {
                    *fix = None;
                }
            }
            if seen == Seen::Prey {
                self.news.prey = Some(Fix { at, seen: now });
            } else if self.news.prey.is_some_and(|fix| fix.at == at) {
                self.news.prey = None;
            }
            if seen != Seen::Prey {
                self.quarry.rule_out(at);
            }
        }
        if let Some(own) = self.news.agents.get_mut(self.agent) {
            *own = Some(Fix { at: here, seen: now });
        }
        if let Some(prey) = self.news.prey {
            let is_free = self.field(None).gaps(prey.at).next().is_some();
            self.news.is_odd = is_free.then_some(is_odd_cell(prey.at));
            self.quarry = Quarry::at(prey.at);
        }
        if self.quarry.is_nowhere() {
            self.quarry = Quarry::anywhere(&self.field(None), self.news.is_odd);
        }
    }

    fn field(&self, prey: Option<Pos>) -> Field {
        let mut field = self.bare.clone();
        for fix in self.news.agents.iter().flatten() {
            field.put(fix.at, Some(Kind::Agent));
        }
        if let Some(prey) = prey {
            field.put(prey, Some(Kind::Prey));
        }
        field
    }

    /// What all agents do, as far as it is known where they are.
    fn plan(&self) -> Vec<Step> {
        let prey = self.news.prey.map(|fix| fix.at).or(self.quarry.likely());
        let field = self.field(prey);
        let known: Vec<usize> =
            (0..self.news.agents.len()).filter(|&a| self.news.agents[a].is_some()).collect();
        let places: Vec<Pos> = self.news.agents.iter().flatten().map(|fix| fix.at).collect();
        let mut march = March::new(&field, &places);
        if let Some(prey) = prey {
            if let Some(closing) = close(&field, &places, prey) {
                for (agent, step) in closing {
                    march.fix(agent, step);
                }
            }
        }
        let whereabouts = match self.news.is_odd {
            Some(true) => Whereabouts::Odd,
            Some(false) => Whereabouts::Even,
            None => self.quarry.whereabouts(&field),
        };
        let goals = assign(&places, self.nets.against(whereabouts));
        let steps = march.go(&goals);
        let mut all = vec![None; self.news.agents.len()];
        for (agent, step) in known.into_iter().zip(steps) {
            all[agent] = step;
        }
        all
    }
}

/// Steps with which the prey is caught at once: everybody beside it stays, and all gaps are filled by others.
fn close(field: &Field, agents: &[Pos], prey: Pos) -> Option<Vec<(usize, Step)>> {
    let gaps: Vec<Pos> = field.gaps(prey).collect();
    let mut steps = Vec::new();
    if !fill(&gaps, agents, &mut steps) {
        return None;
    }
    for (agent, at) in agents.iter().enumerate() {
        if Direction::ALL.iter().any(|&side| prey.toward(side) == *at) {
            steps.push((agent, None));
        }
    }
    Some(steps)
}

fn fill(gaps: &[Pos], agents: &[Pos], steps: &mut Vec<(usize, Step)>) -> bool {
    let Some((&gap, rest)) = gaps.split_first() else { return true };
    for step in Direction::ALL {
        let from = gap.toward(step.opposite());
        let Some(agent) = agents.iter().position(|&at| at == from) else { continue };
        if steps.iter().all(|(other, _)| *other != agent) {
            steps.push((agent, Some(step)));
            if fill(rest, agents, steps) {
                return true;
            }
            steps.pop();
        }
    }
    false
}

fn take_newer(known: &mut Option<Fix>, told: Option<Fix>) {
    if let Some(told) = told {
        if known.is_none_or(|known| known.seen < told.seen) {
            *known = Some(told);
        }
    }
}
