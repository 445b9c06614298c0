//! Flocking around the middle of the map.

use swarmbench_engine::{Act, Observation};

use super::outline::Outline;
use crate::chance::Chance;
use crate::chart::Chart;
use crate::{Player, Seat};

/// Every agent knows the square and the size of the map, so all agree without messages that the outline lies in the
/// middle.
#[derive(Clone)]
struct MeetInTheMiddle {
    chance: Chance,
    chart: Chart,
    outline: Outline,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(MeetInTheMiddle {
        chance: Chance::new(seat),
        chart: Chart::new(seat),
        outline: Outline::in_the_middle(seat),
    })
}

impl Player for MeetInTheMiddle {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some(here) = self.chart.look(observation) else { return Act::default() };
        let round = observation.round;
        Act::of(self.outline.fill(&self.chart, &mut self.chance, here, round))
    }
}
