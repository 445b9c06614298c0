//! Pursuit by calling out the prey and closing in on it.

use swarmbench_engine::{Act, Action, Direction, Message, Observation, Pos, Seen};

use crate::chance::Chance;
use crate::chart::{Chart, push, waypoint};
use crate::talk::heard;
use crate::walk::toward;
use crate::{Player, Seat};

/// Number of rounds for which a sighting of the prey counts. Two rounds are needed to hear of it at second hand; an
/// older sighting draws all agents to a place that the prey has left, and then no agent sees it.
const FRESH_ROUNDS: u32 = 2;

/// Detour in steps that an agent in the way is worth.
const CROWD: u32 = 4;

/// Walks to the nearest free cell beside the prey while it knows where the prey is, and sends that place. Otherwise it
/// goes back to its post; the posts are spread evenly over the map, so that some agent sees the prey wherever it flees.
#[derive(Clone)]
struct CloseIn {
    chance: Chance,
    chart: Chart,
    post: Pos,
    /// The last sighting of the prey.
    prey: Option<Sighting>,
}

#[derive(Clone, Copy)]
struct Sighting {
    round: u32,
    at: Pos,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let (chance, chart) = (Chance::new(seat), Chart::new(seat));
    Box::new(CloseIn { chance, chart, post: post(seat), prey: None })
}

/// The middle of the agent's share of the map, which is cut into about as many rows as columns.
fn post(seat: &Seat) -> Pos {
    post_of(i32::from(seat.agent.0), seat)
}

/// The middle of the share of the agent of that number.
pub(super) fn post_of(number: i32, seat: &Seat) -> Pos {
    let agents = i32::from(seat.num_agents).max(1);
    let rows = agents.isqrt();
    let columns = (agents + rows - 1) / rows;
    let number = number % agents;
    let middle =
        |share: i32, of: i32, cells: u16| 1 + (2 * share + 1) * (i32::from(cells) - 2) / (2 * of);
    let (row, column) = (number / columns, number % columns);
    Pos::new(middle(row, rows, seat.height), middle(column, columns, seat.width))
}

impl Player for CloseIn {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        self.locate(observation);
        let order = self.chance.order();
        let action = match self.prey {
            Some(prey) => self.approach(here, prey.at, order),
            None => self.watch(here, order),
        };
        let message = self.prey.and_then(|Sighting { round, at }| {
            Message::new(&format!("Prey at {} {} in round {round}", at.i, at.j))
        });
        Act { action: Some(action), message, to: None }
    }
}

impl CloseIn {
    /// Keeps the latest of the visible, the heard and the known sighting.
    fn locate(&mut self, observation: &Observation) {
        let now = observation.round;
        let view = observation.view.iter().flat_map(swarmbench_engine::View::positions);
        for (at, seen) in view {
            let was_there = self.prey.is_some_and(|prey| prey.at == at);
            if seen == Seen::Prey {
                self.prey = Some(Sighting { round: now, at });
            } else if was_there {
                self.prey = None;
            }
        }
        for [i, j, round] in heard(observation, "Prey at") {
            let (at, round) = (Pos::new(i, j), u32::try_from(round).unwrap_or(0));
            let is_news = round < now && self.prey.is_none_or(|prey| prey.round < round);
            if is_news && self.chart.contains(at) {
                self.prey = Some(Sighting { round, at });
            }
        }
        self.prey = self.prey.filter(|prey| now.saturating_sub(prey.round) <= FRESH_ROUNDS);
    }

    /// Goes to the nearest free cell beside the prey and holds it.
    fn approach(&self, here: Pos, prey: Pos, order: [Direction; 4]) -> Action {
        let chart = &self.chart;
        let beside = Direction::ALL.map(|side| prey.toward(side));
        let is_goal = |cell: Pos| beside.contains(&cell) && !chart.is_taken(cell, 1);
        if is_goal(here) {
            return Action::Stay;
        }
        // If all are occupied no search is needed.
        let is_free = beside.into_iter().any(is_goal);
        let way = is_free.then(|| toward(chart, here, prey, order, CROWD, is_goal));
        push(way.flatten().unwrap_or(order[0]))
    }

    /// Goes to its post, or next to it where another agent is in the way.
    fn watch(&self, here: Pos, order: [Direction; 4]) -> Action {
        let is_near = here.is_within(1, self.post);
        if here == self.post || is_near && self.chart.is_taken(self.post, 1) {
            return Action::Stay;
        }
        let goal = waypoint(here, self.post);
        if !self.chart.is_open(goal) {
            return push(order[0]);
        }
        push(self.chart.way(here, order, CROWD, |cell| cell == goal).unwrap_or(order[0]))
    }
}
