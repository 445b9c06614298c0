//! Flocking at the place of one agent.

use swarmbench_engine::{Act, Action, AgentId, Message, Observation, Pos};

use super::outline::Outline;
use crate::chance::Chance;
use crate::chart::Chart;
use crate::talk::heard;
use crate::{Player, Seat};

/// The leading words of all messages.
const NEWS: &str = "Square around";

/// The first agent centers the square on the cell where it stands in the first round. Agents that know the place send
/// it; the others wander until they receive it.
#[derive(Clone)]
struct FollowTheLeader {
    seat: Seat,
    chance: Chance,
    chart: Chart,
    square: Option<(Pos, Outline)>,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    let (chance, chart) = (Chance::new(seat), Chart::new(seat));
    Box::new(FollowTheLeader { seat: seat.clone(), chance, chart, square: None })
}

impl Player for FollowTheLeader {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        let received = heard(observation, NEWS).map(|[i, j]| Pos::new(i, j));
        let mut places = received.filter(|&place| self.chart.contains(place));
        let place = if self.seat.agent == AgentId(0) { Some(here) } else { places.next() };
        if let (None, Some(place)) = (&self.square, place) {
            self.square = Some((place, Outline::around(&self.seat, place)));
        }
        let Some((place, outline)) = &self.square else {
            return Act::of(self.chance.pick(&[
                Action::Up,
                Action::Down,
                Action::Left,
                Action::Right,
            ]));
        };
        let action = outline.fill(&self.chart, &mut self.chance, here, observation.round);
        let message = Message::new(&format!("{NEWS} {} {}", place.i, place.j));
        Act { action: Some(action), message, to: None }
    }
}
