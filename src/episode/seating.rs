//! Assignment of seats to holders, as a pure machine.
//!
//! The creator holds the seats that are not open. Claims, any number of them, take open seats until none is left; a built-in
//! player gets unclaimed seats in the end. A seat that has a holder keeps it.

use jiff::Timestamp;
use swarmbench_engine::AgentId;

use super::spec::{Spec, shared};
use crate::store::entries::{Held, Holder};
use swarmbench_clock::after;
use swarmbench_journal::record::{HeldSeat, Record, SeatHolder, Seats};
use swarmbench_protocol::carried::Carried;

/// Open seats that a claim asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    Seat(AgentId),
    /// A number of open seats, at least one; the server chooses which.
    Any(u16),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SeatTaken {
    #[error("the seat of {0} is already taken")]
    Seat(AgentId),
    #[error("{open} seats are open, {wanted} were asked for")]
    Few { open: u16, wanted: u16 },
}

/// Holders of the seats of an episode.
#[derive(Clone, Debug)]
pub struct Seating {
    /// Holders by number; the creator is 0.
    holders: Vec<Holder>,
    /// Number of the holder of each agent.
    seats: Vec<Option<u32>>,
    /// Time at which a built-in player takes the open seats, and the player's name.
    fill: Option<(Timestamp, String)>,
}

impl Seating {
    /// Continues a seating; `None` where the creator holds all seats. `holders` lists all holders with their seats, the creator
    /// first.
    pub fn new(spec: &Spec, created_at: Timestamp, holders: Vec<Held>) -> Option<Self> {
        if !spec.is_seated() {
            return None;
        }
        let is_given =
            |agent: AgentId| spec.open_seats.contains(&agent) || !spec.holders.is_empty();
        let own = |agent| if is_given(agent) { None } else { Some(0) };
        let mut seats: Vec<Option<u32>> = spec.agents().map(own).collect();
        let mut known = Vec::with_capacity(holders.len());
        for (mut holder, agents) in holders {
            // All games of a run declare the same of its team.
            if !spec.holders.is_empty() {
                holder.agent_meta = Carried(shared(&holder.agent_meta.0));
            }
            for agent in agents {
                seats[agent.index()] = Some(holder.number);
            }
            known.push(holder);
        }
        let fill = spec.fill_after.zip(spec.fill_with.clone());
        let fill = fill.map(|(time, player)| (after(created_at, time), player));
        Some(Self { holders: known, seats, fill })
    }

    /// Seats without a holder.
    pub fn open(&self) -> impl Iterator<Item = AgentId> + '_ {
        (0..).map(AgentId).zip(&self.seats).filter(|(_, seat)| seat.is_none()).map(|(a, _)| a)
    }

    pub fn count_open(&self) -> u16 {
        u16::try_from(self.open().count()).expect("at most 1,024 agents")
    }

    /// Time at which a built-in player takes the open seats; `None` once no seat is open.
    pub fn fills_at(&self) -> Option<Timestamp> {
        let (at, _) = self.fill.as_ref()?;
        self.open().next().map(|_| *at)
    }

    /// Gives open seats to a new holder, who gets the next number: all that are wanted, or none.
    pub fn claim(
        &mut self,
        wanted: Wanted,
        holder: Holder,
    ) -> Result<(Holder, Vec<AgentId>), SeatTaken> {
        let agents: Vec<AgentId> = match wanted {
            Wanted::Seat(agent) => match self.seats.get(agent.index()) {
                Some(None) => vec![agent],
                Some(Some(_)) | None => return Err(SeatTaken::Seat(agent)),
            },
            Wanted::Any(wanted) => {
                let open = self.count_open();
                if open < wanted {
                    return Err(SeatTaken::Few { open, wanted });
                }
                self.open().take(wanted.into()).collect()
            }
        };
        Ok(self.give(agents, holder))
    }

    /// Gives the open seats, if any, to a built-in player once it is time.
    pub fn fill(&mut self, now: Timestamp) -> Option<(Holder, Vec<AgentId>)> {
        self.fills_at().filter(|&at| at <= now)?;
        let (_, player) = self.fill.clone()?;
        let holder = Holder {
            number: 0,
            owner: None,
            key: None,
            model: format!("built-in/{player}"),
            agent_meta: Carried::default(),
            player: Some(player),
            at: now,
        };
        let agents = self.open().collect();
        Some(self.give(agents, holder))
    }

    fn give(&mut self, agents: Vec<AgentId>, holder: Holder) -> (Holder, Vec<AgentId>) {
        let number = u32::try_from(self.holders.len()).expect("not more than seats");
        let holder = Holder { number, ..holder };
        for agent in &agents {
            self.seats[agent.index()] = Some(number);
        }
        self.holders.push(holder.clone());
        (holder, agents)
    }

    /// Seats that the server plays, with the name of the player.
    pub fn hosted(&self) -> Vec<(AgentId, String)> {
        let player = |holder: u32| self.holders.get(holder as usize)?.player.clone();
        let seats = (0..).map(AgentId).zip(&self.seats);
        seats.filter_map(|(agent, holder)| Some((agent, player((*holder)?)?))).collect()
    }

    /// Record of the holders of all seats.
    ///
    /// # Panics
    /// If a seat has no holder.
    pub fn record(&self) -> Record {
        let holds = |number: u32| self.seats.contains(&Some(number));
        let holders = self.holders.iter().filter(|holder| holds(holder.number));
        let seats = (0..).map(AgentId).zip(&self.seats);
        Record::Seats(Seats {
            holders: holders
                .map(|holder| SeatHolder {
                    holder: holder.number,
                    model: holder.model.clone(),
                    agent_meta: holder.agent_meta.clone(),
                    key: holder.key.clone(),
                    player: holder.player.clone(),
                })
                .collect(),
            seats: seats
                .map(|(agent, holder)| HeldSeat {
                    agent: agent.to_string(),
                    holder: holder.expect("an episode starts when all seats have holders"),
                })
                .collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use swarmbench_engine::{Config, Settings, TaskName};

    use super::*;
    use crate::episode::spec::Visibility;

    const START: Timestamp = Timestamp::UNIX_EPOCH;

    fn spec(open: std::ops::Range<u16>) -> Spec {
        let settings =
            Settings { num_agents: 4, ..Settings::standard(TaskName::Synchronization, 1) };
        Spec {
            config: Arc::new(Config::check(&settings).expect("good settings")),
            round_deadline: None,
            bank: Duration::ZERO,
            manual_start: false,
            idle_timeout: Duration::from_mins(10),
            visibility: Visibility::Owner,
            model: "m".to_owned(),
            agent_meta: Carried::default(),
            prompt_template: "".into(),
            prompt_revision: swarmbench_prompt::REVISION,
            custom_template: false,
            run: None,
            salt: None,
            fork: None,
            closes_at: None,
            own_games: false,
            open_seats: open.map(AgentId).collect(),
            fill_after: Some(Duration::from_secs(5)),
            fill_with: Some("random".to_owned()),
            player: None,
            holders: Vec::new(),
        }
    }

    fn holder(model: &str) -> Holder {
        Holder {
            number: 0,
            owner: None,
            key: None,
            model: model.to_owned(),
            agent_meta: Carried::default(),
            player: None,
            at: START,
        }
    }

    fn fresh() -> Seating {
        let creator = (holder("creator"), vec![AgentId(0)]);
        Seating::new(&spec(1..4), START, vec![creator]).expect("it has open seats")
    }

    fn numbers(agents: &[AgentId]) -> Vec<u16> {
        agents.iter().map(|agent| agent.0).collect()
    }

    #[test]
    fn a_seat_has_one_holder_and_the_rest_is_filled_in_time() {
        let mut seating = fresh();
        let (first, agents) = seating.claim(Wanted::Seat(AgentId(2)), holder("a")).expect("open");
        assert_eq!((first.number, numbers(&agents)), (1, vec![2]));
        for taken in [0, 2, 4] {
            let refused = seating.claim(Wanted::Seat(AgentId(taken)), holder("b"));
            assert_eq!(refused.map(|_| ()), Err(SeatTaken::Seat(AgentId(taken))));
        }
        let refused = seating.claim(Wanted::Any(3), holder("b")).map(|_| ());
        assert_eq!(refused, Err(SeatTaken::Few { open: 2, wanted: 3 }));
        let (second, agents) = seating.claim(Wanted::Any(1), holder("b")).expect("open");
        assert_eq!((second.number, numbers(&agents)), (2, vec![1]));
        let due = seating.fills_at().expect("one is open");
        assert_eq!(due, after(START, Duration::from_secs(5)));
        assert!(seating.fill(START).is_none(), "too early");
        let (server, agents) = seating.fill(due).expect("in time");
        assert_eq!((server.number, numbers(&agents)), (3, vec![3]));
        assert_eq!(seating.hosted(), [(AgentId(3), "random".to_owned())]);
        assert_eq!((seating.fills_at(), seating.count_open()), (None, 0));
        let Record::Seats(record) = seating.record() else { panic!("another record") };
        assert_eq!(record.seats.iter().map(|seat| seat.holder).collect::<Vec<_>>(), [0, 2, 1, 3]);
        assert_eq!(record.holders.len(), 4);
    }

    #[test]
    fn it_continues_from_its_holders() {
        let mut seating = fresh();
        let mut holders = vec![(holder("creator"), vec![AgentId(0)])];
        holders.push(seating.claim(Wanted::Any(2), holder("a")).expect("open"));
        let mut again = Seating::new(&spec(1..4), START, holders).expect("it has open seats");
        assert_eq!(again.open().collect::<Vec<_>>(), [AgentId(3)]);
        let one = seating.claim(Wanted::Any(1), holder("b")).expect("open");
        assert_eq!(again.claim(Wanted::Any(1), holder("b")).expect("open"), one);
        let bytes =
            |seating: &Seating| swarmbench_journal::record::RawRecord::write(&seating.record());
        assert_eq!(again.count_open(), 0);
        assert_eq!(bytes(&again).as_str(), bytes(&seating).as_str());
    }

    #[test]
    fn a_creator_of_all_seats_needs_no_seating() {
        assert!(Seating::new(&spec(0..0), START, Vec::new()).is_none());
        let hosted = Spec { player: Some("random".to_owned()), ..spec(0..0) };
        let creator = Holder { player: hosted.player.clone(), ..holder("m") };
        let seating = Seating::new(&hosted, START, vec![(creator, Vec::new())]).expect("hosted");
        assert_eq!(seating.hosted().len(), 4);
        assert_eq!(seating.count_open(), 0);
    }
}
