//! Facts about a stored episode that need no replay: its settings and the holders of its seats.

use std::collections::BTreeSet;

use swarmbench_boards::run::{SYSTEM_MESSAGE, reads_prompts};
use swarmbench_engine::AgentId;
use swarmbench_journal::record::{HeldSeat, Opening, Record, SeatHolder, Seats};
use swarmbench_prompt::Identity;

use crate::store::port::StoredEpisode;

pub struct Header {
    pub opening: Opening,
    /// Holders by number.
    holders: Vec<SeatHolder>,
    /// Index in `holders` of the holder of each agent.
    seats: Vec<usize>,
}

impl Header {
    pub fn read(stored: &StoredEpisode) -> Result<Self, String> {
        let Record::Opening(opening) = stored.opening.read().map_err(|error| error.to_string())?
        else {
            return Err("it has no opening".to_owned());
        };
        let seats = match &stored.seating {
            Some(record) => match record.read().map_err(|error| error.to_string())? {
                Record::Seats(seats) => seats,
                Record::Opening(_) | Record::Round(_) | Record::End(_) => {
                    return Err("its record of seats is a record of another kind".to_owned());
                }
            },
            None => all_of_the_creator(&opening),
        };
        if seats.seats.len() != usize::from(opening.config.num_agents) {
            return Err("its record of seats has another number of agents".to_owned());
        }
        let place = |number: u32| seats.holders.iter().position(|one| one.holder == number);
        let places: Option<Vec<usize>> =
            seats.seats.iter().map(|seat| place(seat.holder)).collect();
        let places = places.ok_or("a seat has a holder that is not in its record of seats")?;
        Ok(Self { opening: *opening, holders: seats.holders, seats: places })
    }

    /// The holder of an agent's seat.
    pub fn holder(&self, agent: AgentId) -> &SeatHolder {
        &self.holders[self.seats[agent.index()]]
    }

    /// Holders by seat, in order of the agents' numbers.
    pub fn by_agent(&self) -> impl Iterator<Item = &SeatHolder> {
        self.seats.iter().map(|place| &self.holders[*place])
    }

    /// Whether seats have more than one holder.
    pub fn is_mixed(&self) -> bool {
        self.holders.len() > 1
    }

    /// The identity of the prompt that the creator's player could ask for.
    pub fn prompt(&self) -> Identity {
        let Opening { config, prompt_template, prompt_revision, agent_meta, .. } = &self.opening;
        let template = config.custom_template.then_some(prompt_template.as_str());
        Identity::of(template, *prompt_revision, agent_meta.get(SYSTEM_MESSAGE))
    }

    /// The name of that prompt, if the creator's player reads prompts.
    pub fn prompt_name(&self) -> Option<String> {
        let Opening { config, agent_meta, .. } = &self.opening;
        let is_read = reads_prompts(&config.model, config.player.as_deref(), agent_meta);
        is_read.then(|| self.prompt().to_string())
    }

    /// Models of all holders.
    pub fn models(&self) -> BTreeSet<&str> {
        self.holders.iter().map(|holder| holder.model.as_str()).collect()
    }
}

/// Seats of an episode without a seating record: no seat was open to others, or the episode never began.
fn all_of_the_creator(opening: &Opening) -> Seats {
    let creator = SeatHolder {
        holder: 0,
        model: opening.config.model.clone(),
        agent_meta: opening.agent_meta.clone(),
        key: None,
        player: None,
    };
    let seat = |agent| HeldSeat { agent: AgentId(agent).to_string(), holder: 0 };
    Seats { holders: vec![creator], seats: (0..opening.config.num_agents).map(seat).collect() }
}
