//! Pursuit by traps in the corners.

use swarmbench_engine::{Act, Action, Observation, Pos, RuleSet, Seen, View};

use super::field::Field;
use super::march::Step;
use super::net::Nets;
use super::news::{self, Fix, News};
use super::quarry::{Quarry, Whereabouts, is_odd_cell};
use super::scene::Scene;
use super::stance::STANCES;
use crate::chart::{push, sight};
use crate::{Player, Seat};

/// Maximum cost in rounds of a net that is chosen by looking ahead.
const FORESIGHT: f64 = 9.0;

/// Number of rounds without a point, on the standard map, after which an agent no longer trusts its estimate and tries
/// the nets in turn: the score is a clock that all share. Larger maps take more rounds, as the way to a net is longer.
const LONG: u32 = 12;

/// Length of a turn in rounds where agents go after the prey: about one way across a standard map.
const TURN: u32 = 8;

/// Number of times that an agent must have refused its expected move before it counts as settled.
const STUBBORN: u32 = 3;

/// Every agent estimates what all agents know and do, and does its own part of that. It keeps a belief of all
/// positions, which messages and its view correct, and computes the joint plan of the round from it: agents that can
/// catch the prey at once do, all others go to their posts. The posts close off some cells, where new preys then
/// appear. A prey outside runs into a net by itself, or some agents leave their posts and take a stance around it.
#[derive(Clone)]
struct CornerTraps {
    agent: usize,
    rules: RuleSet,
    /// [`LONG`], adjusted to the size of the map.
    long: u32,
    /// The map without agents and prey.
    bare: Field,
    nets: Nets,
    /// The belief about the round to decide.
    news: News,
    /// The possible positions of the prey.
    quarry: Quarry,
    score: f64,
    /// The round in which the score last grew.
    scored: u32,
    /// Number of expected moves that an agent refused since it last moved, by agent.
    refusals: Vec<u32>,
    /// The posts of the last round, if they were chosen by looking ahead.
    chosen: Option<Vec<Pos>>,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let Some(nets) = Nets::of(seat) else { return without_nets(seat) };
    let (height, width) = (seat.height.into(), seat.width.into());
    Box::new(CornerTraps {
        agent: seat.agent.index(),
        rules: seat.rules,
        long: LONG.max(2 + u32::midpoint(seat.height.into(), seat.width.into())),
        bare: Field::new(height, width),
        nets,
        news: News { agents: vec![None; seat.num_agents.into()], ..News::default() },
        quarry: Quarry::first(height, width),
        score: 0.0,
        scored: 0,
        refusals: vec![0; seat.num_agents.into()],
        chosen: None,
    })
}

/// The best player of a game for which there are no nets.
fn without_nets(seat: &Seat) -> Box<dyn Player> {
    let inside = |cells: u16| u64::from(cells.saturating_sub(2));
    let (cells, agents) = (inside(seat.height) * inside(seat.width), u64::from(seat.num_agents));
    if 25 * agents >= 6 * cells {
        // In a crowd some agent mostly stands beside the prey already, and an agent that makes way lets it out.
        super::chase::make(seat)
    } else if cells >= 150 && 14 * agents < cells {
        // Agents that are so few that they do not hear each other have no use for posts.
        super::track::make(seat)
    } else {
        super::close_in::make(seat)
    }
}

/// Maximum number of rounds for a stance to catch the prey: fewer in a large swarm, as the look-ahead takes longer.
fn horizon(agents: usize) -> f64 {
    u32::try_from(80 / agents.max(1)).map_or(2.0, |rounds| f64::from(rounds.clamp(2, 6)))
}

impl Player for CornerTraps {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some((here, view)) = sight(observation).filter(|(here, _)| self.bare.is_inside(*here))
        else {
            return Act::default();
        };
        self.listen(observation);
        let before: Vec<Option<Pos>> = self.places().collect();
        self.foresee(observation.round);
        let expected: Vec<Option<Pos>> = self.places().collect();
        self.count(observation);
        self.look(observation.round, here, view);
        self.compare(observation.round, &before, &expected);
        let posts = self.posts(observation.round);
        let step = self.plan(&posts).get(self.agent).copied().flatten();
        let is_chosen = self.nets.is_hunting || self.sees_all(observation.round);
        self.chosen = is_chosen.then_some(posts);
        let message = news::write(&self.news, observation.round);
        Act { action: Some(step.map_or(Action::Stay, push)), message, to: None }
    }
}

impl CornerTraps {
    /// Takes the others' knowledge of the last round where it is newer.
    fn listen(&mut self, observation: &Observation) {
        let count = self.news.agents.len();
        for message in &observation.messages {
            let received = news::read(message.as_str(), observation.round, count);
            let Some((round, received)) = received else { continue };
            for (agent, fix) in received.agents.into_iter().enumerate() {
                if agent != self.agent {
                    self.take_newer(fix, |news| &mut news.agents[agent]);
                }
            }
            // Late news may be of a prey that was caught since.
            if round >= self.scored {
                self.take_newer(received.prey, |news| &mut news.prey);
                self.news.is_odd = self.news.is_odd.or(received.is_odd);
            }
        }
    }

    fn take_newer(&mut self, received: Option<Fix>, known: impl Fn(&mut News) -> &mut Option<Fix>) {
        let Some(received) = received.filter(|received| self.bare.is_inside(received.at)) else {
            return;
        };
        let known = known(&mut self.news);
        if known.is_none_or(|known| known.seen < received.seen) {
            *known = Some(received);
        }
    }

    /// Predicts the positions of all agents a round later, assuming that they know and do the same as this agent.
    fn foresee(&mut self, now: u32) {
        let chosen = self.chosen.take();
        let steps = self.plan(&chosen.unwrap_or_else(|| self.posts(now.saturating_sub(1))));
        let mut scene = self.scene(self.news.prey.map(|fix| fix.at));
        let field = self.scene(None).field(&self.bare);
        self.quarry.escape(|at| scene.closing(&field, at).is_none());
        let known: Vec<Step> = steps
            .iter()
            .zip(&self.news.agents)
            .filter(|(_, fix)| fix.is_some())
            .map(|(step, _)| *step)
            .collect();
        scene.advance(&self.bare, &known);
        for (fix, at) in self.news.agents.iter_mut().flatten().zip(&scene.agents) {
            fix.at = *at;
        }
        self.news.prey = self.news.prey.and_then(|fix| Some(Fix { at: scene.prey?, ..fix }));
        scene.prey = None;
        self.quarry.flee(&scene.field(&self.bare), self.rules);
    }

    /// Resets the belief about the prey after a new point, which shows every agent that there is a new prey.
    fn count(&mut self, observation: &Observation) {
        if observation.score > self.score {
            self.scored = observation.round;
            self.news.prey = None;
            self.news.is_odd = None;
            self.quarry = Quarry::new(&self.scene(None).field(&self.bare));
        }
        self.score = observation.score;
    }

    /// Records the agent's own view, which overrides all else.
    fn look(&mut self, now: u32, here: Pos, view: &View) {
        for (at, seen) in view.positions() {
            for (agent, fix) in self.news.agents.iter_mut().enumerate() {
                let is_there =
                    matches!(seen, Seen::Agent { number, .. } if usize::from(number) == agent);
                if is_there && self.bare.is_inside(at) {
                    *fix = Some(Fix { at, seen: now });
                } else if fix.is_some_and(|fix| fix.at == at) {
                    *fix = None;
                }
            }
            if seen == Seen::Prey && self.bare.is_inside(at) {
                self.news.prey = Some(Fix { at, seen: now });
            } else {
                self.news.prey = self.news.prey.filter(|fix| fix.at != at);
                self.quarry.rule_out(at);
            }
        }
        if let Some(own) = self.news.agents.get_mut(self.agent) {
            *own = Some(Fix { at: here, seen: now });
        }
        let field = self.scene(None).field(&self.bare);
        if let Some(prey) = self.news.prey {
            self.news.is_odd = field.has_gap(prey.at).then_some(is_odd_cell(prey.at));
            self.quarry = Quarry::at(prey.at);
        }
        if self.quarry.is_nowhere() {
            self.quarry = Quarry::anywhere(&field, self.news.is_odd);
        }
    }

    /// Counts agents that stayed although they were expected to make way. Such an agent knows something else, so the
    /// others must not wait for it without end.
    fn compare(&mut self, now: u32, before: &[Option<Pos>], expected: &[Option<Pos>]) {
        if now.is_multiple_of(self.long) {
            self.refusals.fill(0);
        }
        for (agent, fix) in self.news.agents.iter().enumerate() {
            let Some(at) = fix.map(|fix| fix.at) else { continue };
            if before[agent] != Some(at) {
                self.refusals[agent] = 0;
            } else if expected[agent] != Some(at) {
                self.refusals[agent] += 1;
            }
        }
    }

    /// The scene of the known agents and a prey.
    fn scene(&self, prey: Option<Pos>) -> Scene {
        let agents = self.news.agents.iter().flatten().map(|fix| fix.at).collect();
        let known = self.news.agents.iter().zip(&self.refusals).filter(|(fix, _)| fix.is_some());
        let settled = known.map(|(_, refusals)| *refusals >= STUBBORN).collect();
        Scene { agents, settled, prey, rules: self.rules }
    }

    /// The believed positions of all agents.
    fn places(&self) -> impl Iterator<Item = Option<Pos>> {
        self.news.agents.iter().map(|fix| fix.map(|fix| fix.at))
    }

    /// The scene with the prey where it was seen or most likely is.
    fn hunt(&self) -> Scene {
        self.scene(self.news.prey.map(|fix| fix.at).or(self.quarry.likely()))
    }

    /// The steps of all agents; `None` for agents of unknown position.
    fn plan(&self, posts: &[Pos]) -> Vec<Step> {
        let scene = self.hunt();
        let mut steps = scene.steps(&scene.field(&self.bare), posts).into_iter();
        self.news.agents.iter().map(|fix| fix.and_then(|_| steps.next()).flatten()).collect()
    }

    /// The nets for the most likely whereabouts of the prey.
    fn nets(&self, now: u32) -> &[Vec<Pos>] {
        let waited = now.saturating_sub(self.scored);
        self.nets.against(match self.news.is_odd {
            Some(is_odd) => Whereabouts::of(is_odd),
            None if waited < self.long => {
                self.quarry.whereabouts(&self.scene(None).field(&self.bare))
            }
            None => Whereabouts::of(waited / self.long % 2 == 1),
        })
    }

    /// The posts to take: those of the first net, which catches almost any prey, and of the next one if it did not.
    /// Only an agent that sees the whole map can compute which net catches this prey first; on news from others too
    /// many would choose differently.
    fn posts(&self, now: u32) -> Vec<Pos> {
        if self.nets.is_hunting {
            return self.hunting_posts(now);
        }
        let nets = self.nets(now);
        let turn = now.saturating_sub(self.scored) / (2 * self.long);
        let mut best = (&nets[turn as usize % nets.len()], FORESIGHT);
        if self.sees_all(now) {
            let scene = self.hunt();
            for net in nets {
                if let Some(cost) = scene.cost(&self.bare, net, best.1) {
                    best = (net, cost);
                }
            }
        }
        best.0.clone()
    }

    /// The posts of agents that go after the prey: the stance that catches it first. If nothing is caught for long, no
    /// agent sees the prey, or those who see it are not heard. So there are turns in which all look for it, and turns
    /// in which all come to the closed net, where they hear each other.
    fn hunting_posts(&self, now: u32) -> Vec<Pos> {
        let closed = &self.nets.against(Whereabouts::Trapped)[0];
        let turn = now.saturating_sub(self.scored) / TURN;
        let scene = self.hunt();
        match (turn % 3, scene.prey) {
            (0, None) | (2, _) => return closed.clone(),
            (_, None) => return self.nets.watch.clone(),
            (_, Some(_)) => {}
        }
        let usual = &STANCES[1 - turn as usize % 2];
        let mut best = (usual, horizon(self.news.agents.len()));
        for stance in &STANCES {
            let posts = |scene: &Scene| stance.posts(scene, &self.bare, closed);
            if let Some((rounds, _)) = scene.catch(&self.bare, posts, best.1) {
                best = (stance, f64::from(rounds));
            }
        }
        best.0.posts(&scene, &self.bare, closed)
    }

    /// True if the agent sees all agents and the prey in this round.
    fn sees_all(&self, now: u32) -> bool {
        let is_seen = |fix: &Option<Fix>| fix.is_some_and(|fix| fix.seen == now);
        is_seen(&self.news.prey) && self.news.agents.iter().all(is_seen)
    }
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::{AgentId, TaskName};

    use super::*;

    /// An agent of a standard game in a corner of the map, who sees nothing but empty cells.
    fn observation(round: u32, news: &News) -> Observation {
        let view =
            View { origin: Pos::new(0, 0), height: 3, width: 3, cells: vec![Seen::Empty; 9] };
        Observation {
            agent: AgentId(0),
            task: TaskName::Pursuit,
            round,
            max_round: 100,
            score: 0.0,
            position: Some(Pos::new(1, 1)),
            view: Some(view),
            light_on: None,
            carrying_food: None,
            messages: news::write(news, round).into_iter().collect(),
            history: Vec::new(),
            past_views: Vec::new(),
        }
    }

    fn seat() -> Seat {
        Seat {
            agent: AgentId(0),
            num_agents: 12,
            width: 10,
            height: 10,
            task: TaskName::Pursuit,
            rules: RuleSet::Paper,
            seed: 1,
        }
    }

    #[test]
    fn lies_in_due_form_are_survived() {
        for rules in RuleSet::ALL {
            survive_lies(&mut *make(&Seat { rules, ..seat() }));
        }
    }

    fn survive_lies(player: &mut dyn Player) {
        for round in 0..40 {
            // The lies place all agents on one cell, on the wall, far outside: with valid check characters.
            let at = [Pos::new(5, 5), Pos::new(0, 3), Pos::new(93, 93)][round as usize % 3];
            let fix = Some(Fix { at, seen: round });
            let news = News { agents: vec![fix; 12], prey: fix, is_odd: Some(true) };
            let act = player.decide(&observation(round, &news));
            assert!(act.action.is_some());
        }
    }

    #[test]
    fn who_knows_of_nobody_goes_its_way() {
        let mut player = make(&seat());
        let act = player.decide(&observation(0, &News::default()));
        assert!(matches!(act.action, Some(Action::Right | Action::Down)), "{act:?}");
        assert!(act.message.is_some());
    }
}
