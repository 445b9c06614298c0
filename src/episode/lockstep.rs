//! The barrier as a pure machine: an event and the time go in, effects come out.
//!
//! Simulation, storage and waiting happen elsewhere, so that tests cover every order of events. The rules are those of the wire
//! contract: one act per living seat and round; a repeated act gets the same receipt; a seat whose clock runs out does nothing,
//! and the others play on.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::{Act, AgentId, Config};

use super::quota::Full;
use super::status::{Ending, Outcome, Status};
use crate::store::port::StoredAct;
use swarmbench_clock::{after, millis};
use swarmbench_journal::record::{Decision, RawRecord, Source};

/// A player's act for a round.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Submission {
    pub round: u32,
    pub decision: Decision,
}

#[derive(Clone, Debug)]
pub enum Event {
    /// The creator starts a waiting episode.
    Start,
    /// The creator ends the episode.
    Abort,
    /// The layout has solved the task before any round.
    Done,
    /// A player acts.
    Submit {
        agent: AgentId,
        submission: Submission,
        /// Act of this seat in that round, if the round is over and the seat acted.
        earlier: Option<RecordedAct>,
        /// Whether the journal has room for the act.
        room: Result<(), Full>,
    },
    /// Time has passed and no message waits: everything due by now happens.
    Tick,
    /// A message came: everything due before now happens. A clock that ends exactly now has not run out, as the next message may
    /// be the act of its seat.
    Arrival,
    /// The open round was published: its clock begins, so a slow disk costs no player any time.
    Opened {
        /// Time of the publication.
        at: Timestamp,
    },
    /// The round of an [`Effect::Resolve`] was resolved.
    Resolved {
        /// Agents that are still on the map.
        alive: Vec<bool>,
        /// Reason for the end of the episode, if it has ended.
        ending: Option<Ending>,
    },
}

/// Work for the actor, to be done in order.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Answer the caller; an accepted act only once it is durable.
    Answer(Result<Receipt, Refusal>),
    /// Record that the episode was started.
    KeepStart,
    /// Record the act of a seat in the open round.
    KeepAct { agent: AgentId, recorded: RecordedAct },
    /// Resolve the round from [`Lockstep::acts`], then apply [`Event::Resolved`]: all living seats have acted or run out of time.
    Resolve,
    /// Record and publish the end.
    End(Ending),
    /// Publish the state: a round was opened.
    Publish,
}

/// An accepted act, with what its first receipt says. Clones share the texts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecordedAct {
    pub decision: Arc<Decision>,
    /// Time that the act took from the seat's bank, in milliseconds.
    pub bank_spent_ms: u64,
    /// Journal record of the act, serialized once.
    pub record: RawRecord,
    /// Number of seats that the round still waited for after this act.
    pub waiting_for: u32,
}

impl RecordedAct {
    fn new(agent: AgentId, decision: Decision, bank_spent_ms: u64, waiting_for: u32) -> Self {
        let record = RawRecord::write(&decision.record(agent, bank_spent_ms));
        Self { decision: Arc::new(decision), bank_spent_ms, record, waiting_for }
    }

    pub fn stored(act: StoredAct, config: &Config) -> Result<Self, String> {
        let StoredAct { record: act, waiting_for, .. } = act;
        let (record, bank_spent_ms) = (RawRecord::write(&act), act.bank_spent_ms);
        let unknown = format!("{} has an unknown act", act.agent);
        let decision = Arc::new(act.decision(config).ok_or(unknown)?);
        Ok(Self { decision, bank_spent_ms, record, waiting_for })
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Receipt {
    pub round: u32,
    pub recorded: RecordedAct,
    /// Whether the same act had been accepted before.
    pub duplicate: bool,
}

/// Reason to refuse an act.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    #[error("round {sent} is not open yet; the episode stands at round {round}")]
    RoundAhead { sent: u32, round: u32 },
    #[error("this seat answered round {sent} with another act, and the first one counts")]
    AlreadyActed { sent: u32, round: u32 },
    #[error("{}", if *.escaped { "this agent has escaped and no longer acts" } else { "the episode has ended" })]
    EpisodeOver {
        /// The last round.
        round: u32,
        /// True if the agent has escaped; false if the episode has ended.
        escaped: bool,
    },
    #[error("round {sent} is over for this seat; the episode stands at round {round}")]
    RoundOver { sent: u32, round: u32 },
    /// The journal's cap on text of this episode, or of its owner, was reached.
    #[error("{full}")]
    NoRoom {
        /// The cap that was reached.
        full: Full,
        round: u32,
    },
}

/// A seat in the open round.
#[derive(Clone, Debug, PartialEq, Eq)]
struct OpenSeat {
    alive: bool,
    bank: Duration,
    recorded: Option<RecordedAct>,
}

/// Time limits of rounds and of a game.
#[derive(Clone, Copy, Debug)]
pub struct Clocks {
    /// Length of a round before banks are touched.
    pub round_deadline: Option<Duration>,
    /// Time that each seat may overspend over all rounds.
    pub bank: Duration,
    /// Time without any act after which the episode is abandoned.
    pub idle_timeout: Duration,
    /// Closing time: no round begins after it, and the open round is the last.
    pub closes_at: Option<Timestamp>,
}

#[derive(Clone, Debug)]
pub struct Lockstep {
    clocks: Clocks,
    /// While set, the episode is not abandoned, however long nobody acts.
    is_held: bool,
    phase: Phase,
    round: u32,
    seats: Vec<OpenSeat>,
    /// Publication of the open round; `None` as long as nobody can see it.
    opened_at: Option<Timestamp>,
    last_act_at: Timestamp,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Waiting,
    /// Acts are accepted.
    Open,
    /// All acts are in; the round is being resolved.
    Closed,
    Over(Outcome),
}

/// State from which an episode continues. A new episode has no acts and full banks.
#[derive(Clone, Debug)]
pub struct ResumeState {
    /// Whether the episode waits for its start.
    pub waiting: bool,
    pub outcome: Option<Outcome>,
    pub round: u32,
    /// Agents that are on the map.
    pub alive: Vec<bool>,
    /// Time taken from the bank of each agent in all rounds.
    pub bank_spent: Vec<Duration>,
    /// Acts that are already recorded for the open round.
    pub recorded: Vec<(AgentId, RecordedAct)>,
    /// Time of the last act, or of the creation.
    pub last_act_at: Timestamp,
}

impl Lockstep {
    /// Continues an episode. An open round gets its full clock from `now` on, even if that had begun before.
    pub fn new(clocks: Clocks, resume: ResumeState, now: Timestamp) -> Self {
        let phase = match resume.outcome {
            Some(outcome) => Phase::Over(outcome),
            None if resume.waiting => Phase::Waiting,
            None => Phase::Open,
        };
        let seats = resume.alive.iter().zip(&resume.bank_spent);
        let mut lockstep = Self {
            clocks,
            is_held: false,
            phase,
            round: resume.round,
            seats: seats
                .map(|(&alive, &spent)| OpenSeat {
                    alive,
                    bank: clocks.bank.saturating_sub(spent),
                    recorded: None,
                })
                .collect(),
            opened_at: Some(now),
            last_act_at: resume.last_act_at,
        };
        for (agent, recorded) in resume.recorded {
            lockstep.seats[agent.index()].recorded = Some(recorded);
        }
        lockstep
    }

    /// Acts of the open round, in order of seats; the escaped have none.
    pub fn recorded(&self) -> impl Iterator<Item = &RecordedAct> {
        self.seats.iter().filter_map(|seat| seat.recorded.as_ref())
    }

    /// Acts of the open round for the engine: one per agent, the default for the escaped.
    pub fn acts(&self) -> Vec<Act> {
        let act = |recorded: &RecordedAct| recorded.decision.act.clone();
        self.seats.iter().map(|seat| seat.recorded.as_ref().map(act).unwrap_or_default()).collect()
    }

    /// Rest of the bank of each agent when the round opened.
    pub fn banks(&self) -> Vec<Duration> {
        self.seats.iter().map(|seat| seat.bank).collect()
    }

    /// Seats that have acted in the open round.
    pub fn acted(&self) -> impl Iterator<Item = AgentId> + '_ {
        (0..).map(AgentId).zip(&self.seats).filter(|(_, s)| s.recorded.is_some()).map(|(a, _)| a)
    }

    pub const fn opened_at(&self) -> Option<Timestamp> {
        self.opened_at
    }

    pub const fn round(&self) -> u32 {
        self.round
    }

    /// Updates what depends on the time of day: the closing time, and whether the episode is kept from being abandoned.
    pub fn note_time_of_day(&mut self, closes_at: Option<Timestamp>, is_held: bool) {
        self.clocks.closes_at = closes_at;
        self.is_held = is_held;
    }

    /// Whether the episode is kept from being abandoned.
    pub const fn is_held(&self) -> bool {
        self.is_held
    }

    /// Time at which the episode is abandoned unless somebody acts.
    pub fn idle_at(&self) -> Timestamp {
        if self.is_held {
            return Timestamp::MAX;
        }
        after(self.last_act_at, self.clocks.idle_timeout)
    }

    /// Time at which the episode ends without a request. A waiting episode also ends when it closes.
    pub fn ends_at(&self) -> Timestamp {
        let idle = self.idle_at();
        match (self.phase, self.clocks.closes_at) {
            (Phase::Waiting, Some(closes_at)) => idle.min(closes_at),
            _ => idle,
        }
    }

    /// Time of the last act of a player, or else of the start or the creation.
    pub const fn last_act_at(&self) -> Timestamp {
        self.last_act_at
    }

    /// Whether no more rounds begin.
    fn is_closed(&self, now: Timestamp) -> bool {
        self.clocks.closes_at.is_some_and(|at| at <= now)
    }

    pub const fn status(&self) -> Status {
        match self.phase {
            Phase::Waiting => Status::Waiting,
            Phase::Open | Phase::Closed => Status::Running,
            Phase::Over(outcome) => outcome.ending.status(),
        }
    }

    pub const fn outcome(&self) -> Option<Outcome> {
        match self.phase {
            Phase::Over(outcome) => Some(outcome),
            Phase::Waiting | Phase::Open | Phase::Closed => None,
        }
    }

    /// Time at which the next [`Event::Tick`] is due.
    pub fn wakes_at(&self) -> Option<Timestamp> {
        let idle = self.idle_at();
        match self.phase {
            Phase::Waiting => Some(self.ends_at()),
            Phase::Open => {
                let pending =
                    self.seats.iter().filter(|seat| seat.alive && seat.recorded.is_none());
                let deadlines = pending.filter_map(|seat| self.deadline(seat));
                deadlines.min().or(Some(idle)).map(|at| at.min(idle))
            }
            Phase::Closed | Phase::Over(_) => None,
        }
    }

    /// Applies an event that happened at `now`.
    pub fn apply(&mut self, now: Timestamp, event: Event) -> Vec<Effect> {
        match event {
            Event::Start => self.start(now),
            Event::Abort => self.stop(now, Ending::Aborted),
            Event::Done => self.stop(now, Ending::TaskDone),
            Event::Submit { agent, submission, earlier, room } => {
                self.submit(now, agent, submission, earlier, room)
            }
            Event::Tick => self.tick(now, |due| due <= now),
            Event::Arrival => self.tick(now, |due| due < now),
            Event::Opened { at } => {
                self.opened_at.get_or_insert(at);
                Vec::new()
            }
            Event::Resolved { alive, ending } => self.resolved(now, &alive, ending),
        }
    }

    /// Starts a waiting episode; a repeated start changes nothing.
    fn start(&mut self, now: Timestamp) -> Vec<Effect> {
        if self.phase != Phase::Waiting {
            return Vec::new();
        }
        if self.is_closed(now) {
            return self.end(now, Ending::Closed);
        }
        self.phase = Phase::Open;
        self.opened_at = None;
        self.last_act_at = now;
        vec![Effect::KeepStart, Effect::Publish]
    }

    /// Ends the episode unless it has ended.
    fn stop(&mut self, now: Timestamp, ending: Ending) -> Vec<Effect> {
        if self.outcome().is_some() {
            return Vec::new();
        }
        self.end(now, ending)
    }

    fn end(&mut self, now: Timestamp, ending: Ending) -> Vec<Effect> {
        self.phase = Phase::Over(Outcome { ending, at: now });
        vec![Effect::End(ending)]
    }

    fn submit(
        &mut self,
        now: Timestamp,
        agent: AgentId,
        submission: Submission,
        earlier: Option<RecordedAct>,
        room: Result<(), Full>,
    ) -> Vec<Effect> {
        let Submission { round: sent, decision } = submission;
        let mut effects = self.apply(now, Event::Arrival);
        let round = self.round;
        let waiting = self.phase == Phase::Waiting;
        let seat = &self.seats[agent.index()];
        let recorded = if sent == round { seat.recorded.clone() } else { earlier };
        let answered =
            recorded.as_ref().filter(|recorded| recorded.decision.source == Source::Player);
        let refusal = match answered {
            Some(recorded) if is_same(&recorded.decision, &decision) => {
                let receipt = Receipt { round: sent, recorded: recorded.clone(), duplicate: true };
                effects.push(Effect::Answer(Ok(receipt)));
                return effects;
            }
            _ if sent > round || (waiting && sent == round) => {
                Some(Refusal::RoundAhead { sent, round })
            }
            Some(_) => Some(Refusal::AlreadyActed { sent, round }),
            None if self.outcome().is_some() => {
                Some(Refusal::EpisodeOver { round, escaped: false })
            }
            None if !seat.alive => Some(Refusal::EpisodeOver { round, escaped: true }),
            None if sent < round || recorded.is_some() || self.phase == Phase::Closed => {
                Some(Refusal::RoundOver { sent, round })
            }
            None => room.err().map(|full| Refusal::NoRoom { full, round }),
        };
        if let Some(refusal) = refusal {
            effects.push(Effect::Answer(Err(refusal)));
            return effects;
        }
        let bank_spent_ms = millis(self.overspent(now).min(seat.bank));
        // The act may have waited for its turn while something else happened.
        self.last_act_at = self.last_act_at.max(now);
        let recorded = RecordedAct::new(agent, decision, bank_spent_ms, self.waiting_for() - 1);
        self.seats[agent.index()].recorded = Some(recorded.clone());
        let receipt = Receipt { round, recorded: recorded.clone(), duplicate: false };
        effects.extend([Effect::KeepAct { agent, recorded }, Effect::Answer(Ok(receipt))]);
        self.close_if_complete(&mut effects);
        effects
    }

    fn tick(&mut self, now: Timestamp, is_due: impl Fn(Timestamp) -> bool) -> Vec<Effect> {
        let mut effects = Vec::new();
        match self.phase {
            Phase::Waiting | Phase::Open => {}
            Phase::Closed | Phase::Over(_) => return effects,
        }
        let idle = self.idle_at();
        if self.phase == Phase::Waiting
            && self.clocks.closes_at.is_some_and(|at| at <= now && at <= idle)
        {
            return self.end(now, Ending::Closed);
        }
        if is_due(idle) {
            return self.end(now, Ending::Idle);
        }
        if self.phase == Phase::Open {
            for place in 0..self.seats.len() {
                let seat = &self.seats[place];
                let is_late = self.deadline(seat).is_some_and(&is_due);
                if !seat.alive || seat.recorded.is_some() || !is_late {
                    continue;
                }
                let agent = AgentId(u16::try_from(place).expect("at most 1,024 agents"));
                let (decision, spent) = (Decision::clock_ran_out(), millis(seat.bank));
                let recorded = RecordedAct::new(agent, decision, spent, self.waiting_for() - 1);
                self.seats[place].recorded = Some(recorded.clone());
                effects.push(Effect::KeepAct { agent, recorded });
            }
            if !effects.is_empty() {
                self.close_if_complete(&mut effects);
            }
        }
        effects
    }

    fn resolved(&mut self, now: Timestamp, alive: &[bool], ending: Option<Ending>) -> Vec<Effect> {
        for (seat, &alive) in self.seats.iter_mut().zip(alive) {
            if let Some(recorded) = seat.recorded.take() {
                let spent = Duration::from_millis(recorded.bank_spent_ms);
                seat.bank = seat.bank.saturating_sub(spent);
            }
            seat.alive = alive;
        }
        self.round += 1;
        self.opened_at = None;
        // An ending by the task or the last round is not cut short by the closing time.
        if let Some(ending) = ending.or_else(|| self.is_closed(now).then_some(Ending::Closed)) {
            self.end(now, ending)
        } else {
            self.phase = Phase::Open;
            vec![Effect::Publish]
        }
    }

    fn close_if_complete(&mut self, effects: &mut Vec<Effect>) {
        if self.waiting_for() == 0 {
            self.phase = Phase::Closed;
            effects.push(Effect::Resolve);
        }
    }

    /// Resolves an open round that has all its acts, after a recovery.
    pub fn close(&mut self) -> Vec<Effect> {
        let mut effects = Vec::new();
        let has_acts = self.seats.iter().any(|seat| seat.recorded.is_some());
        if self.phase == Phase::Open && has_acts {
            self.close_if_complete(&mut effects);
        }
        effects
    }

    /// Number of living seats that have not acted in the open round.
    fn waiting_for(&self) -> u32 {
        let pending =
            self.seats.iter().filter(|seat| seat.alive && seat.recorded.is_none()).count();
        u32::try_from(pending).expect("at most 1,024 agents")
    }

    /// Time by which the open round has passed its deadline.
    fn overspent(&self, now: Timestamp) -> Duration {
        let deadline = self.opened_at.zip(self.clocks.round_deadline);
        let deadline = deadline.map(|(opened_at, round)| after(opened_at, round));
        deadline.map_or(Duration::ZERO, |deadline| swarmbench_clock::until(deadline, now))
    }

    fn deadline(&self, seat: &OpenSeat) -> Option<Timestamp> {
        let (opened_at, round) = self.opened_at.zip(self.clocks.round_deadline)?;
        Some(after(opened_at, round + seat.bank))
    }
}

/// Whether two acts are the same. Usage and reasoning are not compared; the first ones are stored.
fn is_same(recorded: &Decision, sent: &Decision) -> bool {
    recorded.act == sent.act && recorded.response == sent.response
}
