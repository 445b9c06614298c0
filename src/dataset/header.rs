//! Facts about a stored episode that need no replay: its settings and the holders of its seats.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use swarmbench_boards::run::{EVALUATION, SYSTEM_MESSAGE, reads_prompts};
use swarmbench_engine::AgentId;
use swarmbench_journal::record::{HeldSeat, Opening, Record, SeatHolder, Seats};
use swarmbench_prompt::Identity;
use swarmbench_protocol::carried::Carried;

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

    /// The name of the prompt that the creator's player could ask for; of a team, the different names of its members.
    pub fn prompt(&self) -> String {
        self.prompt_name().unwrap_or_else(|| self.prompt_of(&self.opening.agent_meta))
    }

    /// The same; `None` if nobody reads prompts.
    pub fn prompt_name(&self) -> Option<String> {
        let Opening { config, agent_meta, .. } = &self.opening;
        if config.holders.is_empty() {
            let is_read = reads_prompts(&config.model, config.player.as_deref(), agent_meta);
            return is_read.then(|| self.prompt_of(agent_meta));
        }
        let readers = self.holders.iter().filter(|holder| is_reader(holder));
        let names: BTreeSet<String> =
            readers.map(|holder| self.prompt_of(&holder.agent_meta)).collect();
        (!names.is_empty()).then(|| Vec::from_iter(names).join("; "))
    }

    /// The name of the prompt of a player with these declarations.
    fn prompt_of(&self, agent_meta: &Carried) -> String {
        let Opening { config, prompt_template, prompt_revision, .. } = &self.opening;
        let template = config.custom_template.then_some(prompt_template.as_str());
        let own = Identity::of(template, *prompt_revision, agent_meta.get(SYSTEM_MESSAGE));
        own.with_harness(agent_meta.get(EVALUATION)).to_string()
    }

    /// Number of seats of each model of a team; `None` where no team plays.
    pub fn team(&self) -> Option<BTreeMap<&str, usize>> {
        let mut seats = BTreeMap::new();
        for holder in &self.opening.config.holders {
            *seats.entry(holder.model.as_str()).or_default() += holder.seats.len();
        }
        (!seats.is_empty()).then_some(seats)
    }

    /// Holders of a team, in order of their numbers; `None` where no team plays.
    pub fn team_holders(&self) -> Option<Vec<TeamSeats<'_>>> {
        let is_team = !self.opening.config.holders.is_empty();
        let holders = self.holders.iter().enumerate().map(|(place, holder)| TeamSeats {
            model: &holder.model,
            seats: self.seats.iter().filter(|seat| **seat == place).count(),
            prompt: is_reader(holder).then(|| self.prompt_of(&holder.agent_meta)),
            agent_meta: &holder.agent_meta,
        });
        is_team.then(|| holders.collect())
    }

    /// Models of all holders.
    pub fn models(&self) -> BTreeSet<&str> {
        self.holders.iter().map(|holder| holder.model.as_str()).collect()
    }
}

/// Holder of a team in the table of episodes.
#[derive(Serialize)]
pub struct TeamSeats<'a> {
    model: &'a str,
    /// Number of its seats.
    seats: usize,
    /// Name of its prompt; `None` for players that read none.
    prompt: Option<String>,
    agent_meta: &'a Carried,
}

/// True if the holder's player reads prompts.
fn is_reader(holder: &SeatHolder) -> bool {
    reads_prompts(&holder.model, holder.player.as_deref(), &holder.agent_meta)
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
