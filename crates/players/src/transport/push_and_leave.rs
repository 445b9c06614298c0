//! Transport by a plan that every agent computes itself.

use swarmbench_engine::{Act, Action, AgentId, Direction, Observation, Pos};

use super::exit::{Exit, ExitCell, PUSHES, Sight, is_block};
use super::swarm::{News, Swarm};
use crate::assign::assign;
use crate::chance::Chance;
use crate::chart::{Chart, push};
use crate::walk::toward;
use crate::{Player, Seat};

/// Maximum number of agents in a plan; the nearest ones are in it.
const PLANNED_MAX: usize = 24;

/// Maximum distance of the possible exits from their middle for agents to gather there.
const SMALL: i32 = 6;

/// Number of agents that it takes to move the block.
const PUSHERS: usize = 5;

/// Rounds by which agents that push out may arrive later than agents that push along, where a push along and a push out
/// cannot both succeed in one round. One would do; two is better, because the second row is not needed at once.
const LATER_ROUNDS: i32 = 2;

/// Least number of free cells for plans in a crowd: with fewer, hardly any agent reaches its place.
const FREE_MIN: u32 = 22;

/// The assumed distance of an agent whose place is unknown.
const UNKNOWN_STEPS: i32 = 5;

/// Number of rounds without a move after which an agent steps aside, with a mean of [`ASIDE_ROUNDS`] rounds.
const PATIENCE_ROUNDS: u32 = 12;
const ASIDE_ROUNDS: u32 = 6;

/// Passes on its knowledge of the gap and the other agents, and finds its own place in the plan.
#[derive(Clone)]
struct PushAndLeave {
    chance: Chance,
    chart: Chart,
    seat: Seat,
    swarm: Swarm,
    exits: [Exit; 8],
    /// The exits that may be the true one, as a bit set of indices in `exits`.
    possible: u8,
    /// Number of pushes that the block has had, as far as known.
    pushes: u32,
    /// The current position, and the round since which it stands there.
    stands: Option<(Pos, u32)>,
}

/// Makes the player; where the map is too crowded for plans, `find-and-push` instead.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    if is_crowd(seat) && free_cells(seat) < FREE_MIN {
        return super::find_and_push::make(seat);
    }
    Box::new(PushAndLeave {
        chance: Chance::new(seat),
        chart: Chart::new(seat),
        seat: seat.clone(),
        swarm: Swarm::new(seat),
        exits: Exit::all(seat),
        possible: u8::MAX,
        pushes: 0,
        stands: None,
    })
}

impl Player for PushAndLeave {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        let Some(view) = &observation.view else { return Act::default() };
        let news = self.swarm.listen(observation);
        self.swarm.look(observation, here);
        self.deduce(&Sight::of(view, &self.seat), &news);
        let order = self.chance.order();
        let action = match self.exit() {
            _ if self.is_stuck(observation.round, here) => push(order[0]),
            None => self.search(here, order),
            Some(exit) if self.pushes == 0 => self.line_up(observation.round, here, exit, order),
            Some(exit) => self.leave(observation.round, here, exit, order),
        };
        let news = News { exits: self.possible, pushes: self.pushes };
        Act { action: Some(action), message: self.swarm.tell(observation.round, &news), to: None }
    }
}

impl PushAndLeave {
    /// The exit, once it is known.
    fn exit(&self) -> Option<Exit> {
        let is_known = self.possible.is_power_of_two();
        is_known.then(|| self.exits[self.possible.trailing_zeros() as usize])
    }

    /// True if the agent has stood still for long and gives way in this round.
    fn is_stuck(&mut self, round: u32, here: Pos) -> bool {
        let since = match self.stands {
            Some((at, since)) if at == here && since <= round => since,
            _ => round,
        };
        self.stands = Some((here, since));
        round - since >= PATIENCE_ROUNDS && self.chance.one_in(ASIDE_ROUNDS)
    }

    /// Drops every exit that the view contradicts, then those that others exclude. If none is left, a message was
    /// wrong, and only the view counts.
    fn deduce(&mut self, sight: &Sight<'_>, news: &[News]) {
        let fits = |exit: &Exit| (0..=PUSHES).any(|pushes| exit.explains(sight, pushes));
        let seen = (0..8).filter(|&bit| self.possible >> bit & 1 == 1 && fits(&self.exits[bit]));
        self.possible = seen.map(|bit| 1 << bit).sum();
        for News { exits, pushes } in news {
            if self.possible & exits != 0 {
                self.possible &= exits;
                self.pushes = self.pushes.max((*pushes).min(PUSHES));
            }
        }
        if self.possible == 0 {
            let seen = (0..8).filter(|&bit| fits(&self.exits[bit]));
            self.possible = seen.map(|bit| 1 << bit).sum();
        }
        let Some(exit) = self.exit() else {
            self.pushes = 0;
            return;
        };
        let mut fitting = (0..=PUSHES).filter(|&pushes| exit.explains(sight, pushes));
        let first = fitting.clone().next();
        let known = self.pushes;
        self.pushes = fitting.find(|&pushes| pushes >= known).or(first).unwrap_or(known);
    }

    /// Goes to the middle of the possible exits while they are close together, which is on the way to wherever the
    /// block is. On a large map, each agent looks for another exit.
    fn search(&self, here: Pos, order: [Direction; 4]) -> Action {
        let possible = (0..8).filter(|bit| self.possible >> bit & 1 == 1);
        let mut exits: Vec<Exit> = possible.map(|bit| self.exits[bit]).collect();
        let middle_of = |exit: &Exit| exit.cell(ExitCell { deep: 2, far: 3 });
        let count = i32::try_from(exits.len()).unwrap_or(8).max(1);
        let sum = exits.iter().map(middle_of).fold(Pos::new(0, 0), Pos::plus);
        let middle = Pos::new(sum.i / count, sum.j / count);
        let is_small = exits.iter().all(|exit| middle_of(exit).is_within(SMALL, middle));
        if !is_small {
            exits = vec![exits[self.seat.agent.index() % exits.len()]];
        } else if !here.is_within(1, middle) {
            let step = self.chart.way(here, order, 0, |cell| cell.is_within(1, middle));
            if let Some(step) = step {
                return push(step);
            }
        }
        let is_telling = |cell: Pos| {
            self.chart.is_unknown(cell) && exits.iter().any(|exit| is_block(exit.place(cell), 0))
        };
        let target = exits.first().map_or(here, middle_of);
        push(toward(&self.chart, here, target, order, 0, is_telling).unwrap_or(order[0]))
    }

    /// The known places of agents, the nearest to the corner first.
    fn team(&self, round: u32, exit: Exit) -> Vec<(AgentId, ExitCell)> {
        let mut team: Vec<_> =
            self.swarm.known(round).map(|(agent, at)| (agent, exit.place(at))).collect();
        team.sort_by_key(|(agent, place)| (place.deep + place.far, *agent));
        team.truncate(PLANNED_MAX);
        team
    }

    /// The action before the first push: the agent takes its place in the plan, and pushes from there.
    fn line_up(&self, round: u32, here: Pos, exit: Exit, order: [Direction; 4]) -> Action {
        let team = self.team(round, exit);
        let me = team.iter().position(|(agent, _)| *agent == self.seat.agent);
        let places: Vec<ExitCell> = team.iter().map(|(_, place)| *place).collect();
        let place = exit.place(here);
        if let Some(direction) = self.make_way(exit, place) {
            return push(direction);
        }
        let target = match me.map(|me| plan(exit, &places, usize::from(self.seat.num_agents))[me]) {
            Some(target) => target,
            // Too many agents are nearer. The agent comes closer, and keeps out of their way.
            None if place.deep + place.far > 2 * SMALL => ExitCell { deep: SMALL, far: SMALL },
            None => return Action::Stay,
        };
        let is_behind_along = target.deep < FRONT && target.deep == place.deep;
        if is_behind_along && place.far >= target.far {
            return push(exit.along);
        }
        if target.deep >= FRONT && target.far == place.far && target.deep <= place.deep {
            // An agent that pushes here while the block is not in front of it gets into the block's way.
            let is_blocked = is_block(ExitCell { deep: FRONT - 1, far: place.far }, 0);
            let is_there = target.deep == place.deep;
            return if is_there && !is_blocked { Action::Stay } else { push(exit.out) };
        }
        let target = exit.cell(target);
        toward(&self.chart, here, target, order, 0, |cell| cell == target)
            .map_or(Action::Stay, push)
    }

    /// The direction that takes precedence over the plan: out of the corner between block and wall; in a crowd, where
    /// no agent gets past the others, also away from that corner, and onward in the agent's lane.
    fn make_way(&self, exit: Exit, place: ExitCell) -> Option<Direction> {
        let is_taken = |deep| self.chart.is_taken(exit.cell(ExitCell { deep, far: 1 }), 1);
        let is_corner_empty = !(1..FRONT).any(|deep| deep != place.deep && is_taken(deep));
        let is_crowd = is_crowd(&self.seat);
        if place.far == 1 && (place.deep < FRONT || is_crowd && !is_corner_empty) {
            return Some(exit.out.opposite());
        }
        if is_crowd && place.deep < FRONT {
            return Some(exit.along);
        }
        (is_crowd && (2..=3).contains(&place.far)).then_some(exit.out)
    }

    /// The action once the way out is free: the agent pushes the block out and follows it. An agent beside the lanes
    /// keeps pushing along: into a lane where there is room, and two of them together push agents in that lane into the
    /// next one.
    fn leave(&self, round: u32, here: Pos, exit: Exit, order: [Direction; 4]) -> Action {
        let place = exit.place(here);
        let front = FRONT + 1 - i32::try_from(self.pushes).unwrap_or(0);
        let is_lane = |place: ExitCell| (1..=3).contains(&place.far);
        if is_lane(place) || place.deep == 0 {
            return push(exit.out);
        }
        let is_pusher = |place: ExitCell| is_lane(place) && place.deep >= front;
        let pushers =
            || self.team(round, exit).iter().filter(|(_, place)| is_pusher(*place)).count();
        if self.pushes < PUSHES && pushers() < PUSHERS {
            let is_goal = |cell: Pos| is_pusher(exit.place(cell)) && !self.chart.is_taken(cell, 1);
            let target = exit.cell(ExitCell { deep: place.deep.max(front), far: 3 });
            return toward(&self.chart, here, target, order, 1, is_goal).map_or(Action::Stay, push);
        }
        push(exit.along)
    }
}

/// Number of cells inside the walls.
fn cells(seat: &Seat) -> u32 {
    let inside = |cells: u16| u32::from(cells.saturating_sub(2));
    inside(seat.height) * inside(seat.width)
}

/// A crowded map is so full that agents cannot get past each other: about every third cell.
fn is_crowd(seat: &Seat) -> bool {
    3 * u32::from(seat.num_agents) > cells(seat)
}

/// Free cells inside the walls.
fn free_cells(seat: &Seat) -> u32 {
    cells(seat).saturating_sub(u32::from(seat.num_agents) + 9)
}

/// Depth of the first row behind the block that pushes out.
const FRONT: i32 = 4;

/// The target of every agent of a team in a swarm of `agents`.
///
/// The last agent to arrive counts, so each further step costs three times as much. Agents of unknown place are in the
/// plan, too: otherwise an agent that knows of few others would leave places empty that are needed first.
fn plan(exit: Exit, team: &[ExitCell], agents: usize) -> Vec<ExitCell> {
    let count = agents.min(PLANNED_MAX).max(team.len());
    let later = if exit.goes_along_first() { 0 } else { LATER_ROUNDS };
    let cost = |from: Option<&ExitCell>, slot: ExitCell| {
        let later = if slot.deep >= FRONT { later } else { 0 };
        let steps = from.map_or(UNKNOWN_STEPS, |from| distance(*from, slot));
        3_i64.pow((steps - later + LATER_ROUNDS).clamp(0, 16).unsigned_abs())
    };
    let mut best: Option<(i64, Vec<ExitCell>)> = None;
    for alone in 1..FRONT {
        let slots = slots(exit, count, alone);
        let rows = team.iter().map(Some).chain(std::iter::repeat(None)).take(slots.len());
        let costs: Vec<Vec<i64>> =
            rows.map(|from| slots.iter().map(|&slot| cost(from, slot)).collect()).collect();
        let chosen = assign(&costs);
        let total = costs.iter().zip(&chosen).map(|(row, &column)| row[column]).sum();
        if best.as_ref().is_none_or(|(least, _)| total < *least) {
            best = Some((total, chosen.into_iter().map(|column| slots[column]).collect()));
        }
    }
    best.map(|(_, targets)| targets).unwrap_or_default()
}

/// The places from which `agents` agents push: five that push along, in two lanes two behind each other and one in the
/// lane `alone`, then those that push out. Where a push along and a push out can both succeed in one round, the latter
/// keep to the lanes in which the block lies before them from the start.
fn slots(exit: Exit, agents: usize, alone: i32) -> Vec<ExitCell> {
    let along = (5..=6).flat_map(|far| (1..FRONT).rev().map(move |deep| ExitCell { deep, far }));
    let along = along.filter(|place| (place.deep, place.far) != (alone, 6));
    let lanes: &[i32] = if exit.goes_along_first() { &[3, 2] } else { &[3, 2, 1] };
    let out = (FRONT..).flat_map(|deep| lanes.iter().map(move |&far| ExitCell { deep, far }));
    along.chain(out).take(agents).collect()
}

/// Number of steps from a place to a slot, around the block.
fn distance(from: ExitCell, slot: ExitCell) -> i32 {
    let is_pocket = from.far <= 1 && from.deep < FRONT && slot.far >= 5;
    let detour = if is_pocket { 2 * (FRONT - from.deep.max(slot.deep)) } else { 0 };
    (from.deep - slot.deep).abs() + (from.far - slot.far).abs() + detour
}
