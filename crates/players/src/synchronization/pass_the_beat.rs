//! Synchronization by a beat that agents pass on in messages.

use swarmbench_engine::{Act, Message, Observation};

use super::gather::{step, turn};
use crate::talk::heard;
use crate::{Player, Seat};

/// Maximum number of messages read in a round.
const MESSAGES_MAX: usize = 64;

/// Every agent has a beat, on one round and off the next, and sends in every round the leader of its beat and the next
/// state of its light. An agent that hears the beat of a lower number adopts it. So the beat of the lowest number
/// spreads two cells a round, and from then on no agent has to hear or see anything: each counts by itself. The number
/// of the round is not used. An agent that has not heard the lowest number goes to the middle.
#[derive(Clone)]
struct PassTheBeat {
    seat: Seat,
    /// The agent whose beat it follows.
    leader: i32,
    /// The state of its light after this round.
    wanted: Option<bool>,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(PassTheBeat { seat: seat.clone(), leader: seat.agent.0.into(), wanted: None })
}

impl Player for PassTheBeat {
    fn decide(&mut self, observation: &Observation) -> Act {
        let (Some(_), Some(is_on)) = (observation.position, observation.light_on) else {
            return Act::default();
        };
        // Messages tell the light of the round before; in this round all lights become the opposite.
        let mut wanted = self.wanted.map_or(!is_on, |wanted| !wanted);
        let said = heard(observation, "Beat of").take(MESSAGES_MAX);
        let said = said.filter(|[leader, beat]| *leader >= 0 && (0..=1).contains(beat));
        let mut votes = (i32::MAX, 0_i32);
        for [leader, beat] in said {
            if leader < votes.0 {
                votes = (leader, 0);
            }
            if leader == votes.0 {
                votes.1 += if beat == 0 { 1 } else { -1 };
            }
        }
        let (leader, vote) = votes;
        // If messages disagree about the beat of a leader, noise has changed some, and the majority is right.
        if leader < self.leader || leader == self.leader && leader != i32::from(self.seat.agent.0) {
            self.leader = leader;
            wanted = if vote == 0 { wanted } else { vote > 0 };
        }
        self.wanted = Some(wanted);
        let message = Message::new(&format!("Beat of {} {}", self.leader, u8::from(wanted)));
        // The lowest goes to the middle, too, where the others look for it.
        let is_led = self.leader == 0 && self.seat.agent.0 != 0;
        let step = if is_led { None } else { step(observation, &self.seat) };
        let action = step.unwrap_or_else(|| turn(is_on, wanted));
        Act { action: Some(action), message, to: None }
    }
}
