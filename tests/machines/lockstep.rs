//! The barrier: clocks, banks, and how an episode ends.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use swarmbench::episode::lockstep::{
    Clocks, Effect, Event, Lockstep, Receipt, RecordedAct, Refusal, ResumeState, Submission,
};
use swarmbench::episode::quota::Full;
use swarmbench::episode::{Ending, Status};
use swarmbench_clock::after;
use swarmbench_engine::{Act, Action, AgentId};
use swarmbench_journal::record::{Decision, RawRecord};

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
    let receipt = answer(&submit(&mut machine, at(3), 1, 0, Action::Up)).expect("the seat is free");
    assert_eq!(receipt.recorded.waiting_for, 0);
}

#[test]
fn a_clock_that_runs_out_counts_for_its_seat_alone() {
    let mut machine = new(2, clocks(Some(10), 5));
    assert_eq!(machine.wakes_at(), Some(at(15)));
    let effects = submit(&mut machine, at(12), 0, 0, Action::Up);
    assert_eq!(answer(&effects).expect("in the bank's time").recorded.bank_spent_ms, 2000);
    assert_eq!(machine.apply(at(14), Event::Tick), []);
    let effects = machine.apply(at(15), Event::Tick);
    let decision = Arc::new(Decision::clock_ran_out());
    let record = RawRecord::write(&decision.record(AgentId(1), 5000));
    let recorded = RecordedAct { decision, bank_spent_ms: 5000, record, waiting_for: 0 };
    assert_eq!(effects, [Effect::KeepAct { agent: AgentId(1), recorded }, Effect::Resolve]);
    machine.apply(at(15), Event::Resolved { alive: vec![true; 2], ending: None });
    assert_eq!(machine.banks(), [Duration::from_secs(3), Duration::ZERO]);
    assert_eq!(machine.wakes_at(), Some(at(1012)), "nobody can see the round yet");
    machine.apply(at(17), Event::Opened { at: at(16) });
    assert_eq!(machine.wakes_at(), Some(at(26)), "the one without a bank is first");
    let late = submit(&mut machine, at(27), 1, 1, Action::Up);
    assert_eq!(answer(&late), Err(Refusal::RoundOver { sent: 1, round: 1 }), "no tick had come");
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
