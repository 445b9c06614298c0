//! Who holds which seat, as a pure machine.
//!
//! The creator holds the seats that are not open. Open ones are claimed, in any number of claims, until
//! none is left; unclaimed seats get a built-in player in the end. A seat that has a holder keeps it.

use jiff::Timestamp;
use swarmbench_engine::AgentId;

use super::spec::Spec;
use crate::store::entries::{Held, Holder};
use swarmbench_clock::after;
use swarmbench_journal::record::{HeldSeat, Record, SeatHolder, Seats};
use swarmbench_protocol::carried::Carried;

/// What is wanted of the open seats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    Seat(AgentId),
    /// This number of open seats, any of them; at least one.
    Any(u16),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SeatTaken {
    #[error("the seat of {0} is already taken")]
    Seat(AgentId),
    /// Fewer seats are open than were wanted.
    #[error("{open} seats are open, {wanted} were asked for")]
    Few { open: u16, wanted: u16 },
}

/// Who holds which seat of an episode.
#[derive(Clone, Debug)]
pub struct Seating {
    /// In order of their numbers, from the creator on.
    holders: Vec<Holder>,
    /// By agent, the number of its holder.
    seats: Vec<Option<u32>>,
    /// When built-in players take what is open, and which.
    fill: Option<(Timestamp, String)>,
}

impl Seating {
    /// Continues a seating; none where the creator simply holds all seats. `holders` are
    /// all holders with their seats, from the creator on.
    pub fn new(spec: &Spec, created_at: Timestamp, holders: Vec<Held>) -> Option<Self> {
        if !spec.is_seated() {
            return None;
        }
        let own = |agent| if spec.open_seats.contains(&agent) { None } else { Some(0) };
        let mut seats: Vec<Option<u32>> = spec.agents().map(own).collect();
        let mut known = Vec::with_capacity(holders.len());
        for (holder, agents) in holders {
            for agent in agents {
                seats[agent.index()] = Some(holder.number);
            }
            known.push(holder);
        }
        let fill = spec.fill_after.zip(spec.fill_with.clone());
        let fill = fill.map(|(time, player)| (after(created_at, time), player));
        Some(Self { holders: known, seats, fill })
    }

    /// The seats that nobody holds.
    pub fn open(&self) -> impl Iterator<Item = AgentId> + '_ {
        (0..).map(AgentId).zip(&self.seats).filter(|(_, seat)| seat.is_none()).map(|(a, _)| a)
    }

    /// How many seats nobody holds.
    pub fn count_open(&self) -> u16 {
        u16::try_from(self.open().count()).expect("at most 1,024 agents")
    }

    /// When built-in players take what is open.
    pub fn fills_at(&self) -> Option<Timestamp> {
        let (at, _) = self.fill.as_ref()?;
        self.open().next().map(|_| *at)
    }

    /// Gives open seats to a new holder, who gets the next number; all that are wanted, or none.
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

    /// Gives what is open to a built-in player, if it is time and anything is.
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

    /// The seats that the server plays, with the name of the player.
    pub fn hosted(&self) -> Vec<(AgentId, String)> {
        let player = |holder: u32| self.holders.get(holder as usize)?.player.clone();
        let seats = (0..).map(AgentId).zip(&self.seats);
        seats.filter_map(|(agent, holder)| Some((agent, player((*holder)?)?))).collect()
    }

    /// The record of who holds which seat, once all have a holder.
    ///
    /// # Panics
    /// Where a seat has none.
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
