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

#[cfg(test)]
mod tests {
    use swarmbench_engine::Action;

    use super::*;

    const START: Timestamp = Timestamp::UNIX_EPOCH;

    fn clocks(round_s: Option<u64>, bank_s: u64) -> Clocks {
        Clocks {
            round_deadline: round_s.map(Duration::from_secs),
            bank: Duration::from_secs(bank_s),
            idle_timeout: Duration::from_secs(1000),
            closes_at: None,
        }
    }

    fn new(agents: usize, clocks: Clocks) -> Lockstep {
        let resume = ResumeState {
            waiting: false,
            outcome: None,
            round: 0,
            alive: vec![true; agents],
            bank_spent: vec![Duration::ZERO; agents],
            recorded: Vec::new(),
            last_act_at: START,
        };
        Lockstep::new(clocks, resume, START)
    }

    fn sent(round: u32, action: Action) -> Submission {
        Submission { round, decision: Decision::of_player(Act::of(action)) }
    }

    fn at(seconds: u64) -> Timestamp {
        after(START, Duration::from_secs(seconds))
    }

    fn submit(
        machine: &mut Lockstep,
        now: Timestamp,
        agent: u16,
        round: u32,
        action: Action,
    ) -> Vec<Effect> {
        let (agent, submission) = (AgentId(agent), sent(round, action));
        machine.apply(now, Event::Submit { agent, submission, earlier: None, room: Ok(()) })
    }

    fn answer(effects: &[Effect]) -> Result<Receipt, Refusal> {
        let answers = effects.iter().filter_map(|effect| match effect {
            Effect::Answer(answer) => Some(answer.clone()),
            _ => None,
        });
        let answers: Vec<_> = answers.collect();
        assert_eq!(answers.len(), 1, "{effects:?}");
        answers[0].clone()
    }

    #[test]
    fn the_last_act_closes_the_round() {
        let mut machine = new(2, clocks(None, 0));
        let first = submit(&mut machine, at(1), 0, 0, Action::Up);
        assert_eq!(answer(&first).expect("taken").recorded.waiting_for, 1);
        assert!(!first.contains(&Effect::Resolve));
        let last = submit(&mut machine, at(2), 1, 0, Action::Down);
        assert_eq!(last.last(), Some(&Effect::Resolve));
        assert_eq!(machine.recorded().count(), 2);
        let next = machine.apply(at(2), Event::Resolved { alive: vec![true; 2], ending: None });
        assert_eq!(next, [Effect::Publish]);
        assert_eq!(machine.recorded().count(), 0);
    }

    #[test]
    fn refusals_come_in_the_order_of_the_contract() {
        let mut machine = new(2, clocks(None, 0));
        submit(&mut machine, at(1), 0, 0, Action::Up);
        let again = answer(&submit(&mut machine, at(2), 0, 0, Action::Up)).expect("the same act");
        assert!(again.duplicate);
        assert_eq!(again.recorded.waiting_for, 1);
        let other = answer(&submit(&mut machine, at(2), 0, 0, Action::Down));
        assert_eq!(other, Err(Refusal::AlreadyActed { sent: 0, round: 0 }));
        let ahead = answer(&submit(&mut machine, at(2), 0, 1, Action::Up));
        assert_eq!(ahead, Err(Refusal::RoundAhead { sent: 1, round: 0 }));
        submit(&mut machine, at(3), 1, 0, Action::Up);
        machine.apply(at(3), Event::Resolved { alive: vec![true, false], ending: None });
        let past = answer(&submit(&mut machine, at(4), 0, 0, Action::Up));
        assert_eq!(past, Err(Refusal::RoundOver { sent: 0, round: 1 }), "nothing is known of it");
        let escaped = answer(&submit(&mut machine, at(4), 1, 1, Action::Up));
        assert_eq!(escaped, Err(Refusal::EpisodeOver { round: 1, escaped: true }));
        machine.apply(at(5), Event::Abort);
        let over = answer(&submit(&mut machine, at(6), 0, 1, Action::Up));
        assert_eq!(over, Err(Refusal::EpisodeOver { round: 1, escaped: false }));
        let ahead = answer(&submit(&mut machine, at(6), 0, 2, Action::Up));
        assert_eq!(ahead, Err(Refusal::RoundAhead { sent: 2, round: 1 }));
    }

    #[test]
    fn an_act_without_room_costs_nothing_and_hides_no_other_answer() {
        let mut machine = new(2, clocks(None, 0));
        submit(&mut machine, at(1), 0, 0, Action::Up);
        let full = Full::BytesOfEpisode(10);
        let mut send = |agent: u16, round: u32, action: Action| {
            let (agent, submission, room) = (AgentId(agent), sent(round, action), Err(full));
            answer(&machine.apply(at(2), Event::Submit { agent, submission, earlier: None, room }))
        };
        assert!(send(0, 0, Action::Up).expect("the same act").duplicate);
        assert_eq!(send(0, 0, Action::Down), Err(Refusal::AlreadyActed { sent: 0, round: 0 }));
        assert_eq!(send(1, 1, Action::Up), Err(Refusal::RoundAhead { sent: 1, round: 0 }));
        assert_eq!(send(1, 0, Action::Up), Err(Refusal::NoRoom { full, round: 0 }));
        let receipt =
            answer(&submit(&mut machine, at(3), 1, 0, Action::Up)).expect("the seat is free");
        assert_eq!(receipt.recorded.waiting_for, 0);
    }

    #[test]
    fn acts_for_an_earlier_round_are_answered_from_their_record() {
        let mut machine = new(1, clocks(None, 0));
        submit(&mut machine, at(1), 0, 0, Action::Up);
        machine.apply(at(1), Event::Resolved { alive: vec![true], ending: None });
        let decision = Decision::of_player(Act::of(Action::Up));
        let earlier = RecordedAct::new(AgentId(0), decision, 0, 0);
        for (action, expected) in [
            (Action::Up, Ok(Receipt { round: 0, recorded: earlier.clone(), duplicate: true })),
            (Action::Down, Err(Refusal::AlreadyActed { sent: 0, round: 1 })),
        ] {
            let (submission, earlier) = (sent(0, action), Some(earlier.clone()));
            let event = Event::Submit { agent: AgentId(0), submission, earlier, room: Ok(()) };
            assert_eq!(answer(&machine.apply(at(2), event)), expected);
        }
    }

    #[test]
    fn a_clock_that_runs_out_counts_for_its_seat_alone() {
        let mut machine = new(2, clocks(Some(10), 5));
        assert_eq!(machine.wakes_at(), Some(at(15)));
        let effects = submit(&mut machine, at(12), 0, 0, Action::Up);
        assert_eq!(answer(&effects).expect("in the bank's time").recorded.bank_spent_ms, 2000);
        assert_eq!(machine.apply(at(14), Event::Tick), []);
        let effects = machine.apply(at(15), Event::Tick);
        let recorded = RecordedAct::new(AgentId(1), Decision::clock_ran_out(), 5000, 0);
        assert_eq!(effects, [Effect::KeepAct { agent: AgentId(1), recorded }, Effect::Resolve]);
        machine.apply(at(15), Event::Resolved { alive: vec![true; 2], ending: None });
        assert_eq!(machine.banks(), [Duration::from_secs(3), Duration::ZERO]);
        assert_eq!(machine.wakes_at(), Some(at(1012)), "nobody can see the round yet");
        machine.apply(at(17), Event::Opened { at: at(16) });
        assert_eq!(machine.wakes_at(), Some(at(26)), "the one without a bank is first");
        let late = submit(&mut machine, at(27), 1, 1, Action::Up);
        assert_eq!(
            answer(&late),
            Err(Refusal::RoundOver { sent: 1, round: 1 }),
            "no tick had come"
        );
        assert!(matches!(late[0], Effect::KeepAct { agent: AgentId(1), .. }));
    }

    #[test]
    fn an_act_at_its_deadline_is_in_time_though_another_clock_has_run_out() {
        let mut machine = new(2, clocks(Some(10), 1));
        submit(&mut machine, at(11), 0, 0, Action::Up);
        submit(&mut machine, at(10), 1, 0, Action::Up);
        machine.apply(at(11), Event::Resolved { alive: vec![true; 2], ending: None });
        machine.apply(at(11), Event::Opened { at: at(11) });
        assert_eq!(machine.banks(), [Duration::ZERO, Duration::from_secs(1)]);
        let effects = submit(&mut machine, at(22), 1, 1, Action::Up);
        assert!(matches!(effects[0], Effect::KeepAct { agent: AgentId(0), .. }));
        assert_eq!(answer(&effects).expect("just in time").recorded.bank_spent_ms, 1000);
    }

    /// The closing time is exact to the millisecond: an event at that time comes after it.
    #[test]
    fn the_round_that_runs_at_the_closing_time_is_the_last() {
        let closing = Clocks { closes_at: Some(at(20)), ..clocks(Some(10), 0) };
        let just_before = at(20).saturating_sub(Duration::from_millis(1)).expect("a time");
        let resolved = || Event::Resolved { alive: vec![true; 2], ending: None };
        for (resolved_at, expected) in [
            (just_before, Effect::Publish),
            (at(20), Effect::End(Ending::Closed)),
            (at(21), Effect::End(Ending::Closed)),
        ] {
            let mut machine = new(2, closing);
            submit(&mut machine, at(1), 0, 0, Action::Up);
            submit(&mut machine, at(2), 1, 0, Action::Up);
            assert_eq!(machine.apply(resolved_at, resolved()), [expected], "{resolved_at}");
        }
        // The last round has its whole clock, and a bank that goes beyond the closing time.
        let mut machine = new(2, Clocks { bank: Duration::from_secs(30), ..closing });
        submit(&mut machine, at(1), 0, 0, Action::Up);
        assert_eq!(machine.wakes_at(), Some(at(40)), "not at the closing time");
        assert_eq!(machine.apply(at(39), Event::Tick), []);
        let last = submit(&mut machine, at(40), 1, 0, Action::Up);
        assert_eq!(answer(&last).expect("in time").recorded.waiting_for, 0);
        assert_eq!(machine.apply(at(40), resolved()), [Effect::End(Ending::Closed)]);
        assert_eq!(machine.status(), Status::Aborted);
        // An episode that ends by itself was not cut short.
        let mut machine = new(1, closing);
        submit(&mut machine, at(25), 0, 0, Action::Up);
        let ending = Some(Ending::TaskDone);
        let effects = machine.apply(at(25), Event::Resolved { alive: vec![true], ending });
        assert_eq!(effects, [Effect::End(Ending::TaskDone)]);
    }

    #[test]
    fn what_waits_for_its_start_ends_at_the_closing_time() {
        let waiting = |idle_s: u64| {
            let closing = Clocks {
                closes_at: Some(at(20)),
                idle_timeout: Duration::from_secs(idle_s),
                ..clocks(Some(10), 0)
            };
            let resume = ResumeState {
                waiting: true,
                outcome: None,
                round: 0,
                alive: vec![true; 2],
                bank_spent: vec![Duration::ZERO; 2],
                recorded: Vec::new(),
                last_act_at: START,
            };
            Lockstep::new(closing, resume, START)
        };
        let mut machine = waiting(1000);
        assert_eq!((machine.wakes_at(), machine.ends_at()), (Some(at(20)), at(20)));
        assert_eq!(machine.apply(at(19), Event::Tick), []);
        assert_eq!(machine.apply(at(20), Event::Tick), [Effect::End(Ending::Closed)]);
        assert_eq!(waiting(1000).apply(at(20), Event::Start), [Effect::End(Ending::Closed)]);
        assert_eq!(waiting(1000).apply(at(19), Event::Start).len(), 2);
        // The earlier of the two counts, also when the tick comes after both.
        assert_eq!(waiting(10).apply(at(30), Event::Tick), [Effect::End(Ending::Idle)]);
        let mut machine = waiting(20);
        assert_eq!(machine.apply(at(30), Event::Tick), [Effect::End(Ending::Closed)]);
    }

    #[test]
    fn an_episode_without_acts_is_abandoned() {
        let mut machine = new(2, clocks(None, 0));
        submit(&mut machine, at(100), 0, 0, Action::Up);
        assert_eq!(machine.wakes_at(), Some(at(1100)));
        assert_eq!(machine.apply(at(1099), Event::Tick), []);
        assert_eq!(machine.apply(at(1100), Event::Tick), [Effect::End(Ending::Idle)]);
        assert_eq!(machine.status(), Status::Abandoned);
        assert_eq!(machine.wakes_at(), None);
    }
}
