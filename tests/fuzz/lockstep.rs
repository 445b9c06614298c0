//! The barrier, told events in any order.

use std::collections::BTreeMap;
use std::time::Duration;

use bolero::{TypeGenerator, produce};
use jiff::Timestamp;
use swarmbench::episode::lockstep::{
    Clocks, Effect, Event, Lockstep, RecordedAct, Refusal, ResumeState, Submission,
};
use swarmbench::episode::quota::Full;
use swarmbench::episode::{Ending, Status};
use swarmbench_clock::after;
use swarmbench_engine::{Act, Action, AgentId};
use swarmbench_journal::record::{Decision, Source};

use swarmbench_testkit::check;

const AGENTS: u16 = 4;

/// Longer than any game here.
const NEVER: Duration = Duration::from_secs(1_000_000);

/// Events; numbers are taken modulo what there is.
#[derive(Clone, Debug, TypeGenerator)]
enum Move {
    /// An act for this round, the one before, or the next.
    Submit {
        agent: u8,
        ahead: u8,
        action: bool,
    },
    /// Everybody from this agent on acts.
    SubmitFrom {
        agent: u8,
    },
    Pass {
        #[generator(0..60_u8)]
        tenths: u8,
        ticks: bool,
    },
    /// To the moment for which the machine asked.
    Wake,
    Start,
    Abort,
}

/// The refusal of an act without room.
const FULL: Full = Full::BytesOfEpisode(1);

/// True if the journal has room for an act: for one agent it takes one of the two actions only.
fn has_room(agent: AgentId, action: Action) -> bool {
    agent != AgentId(3) || action == Action::Up
}

/// Settings of a game.
#[derive(Clone, Debug, TypeGenerator)]
struct Setting {
    round_tenths: Option<u8>,
    bank_tenths: u8,
    idle_s: u8,
    waiting: bool,
    /// In which round which agent escapes.
    escapes: [u8; 4],
    last_round: u8,
    /// Most games never close.
    closes_tenths: Option<u8>,
}

/// The machine, and what is known of it from the outside.
struct Subject {
    machine: Lockstep,
    now: Timestamp,
    round: u32,
    alive: Vec<bool>,
    kept: BTreeMap<(u32, AgentId), RecordedAct>,
    banks: Vec<Duration>,
    /// When the open round began.
    began_at: Timestamp,
    closes_at: Option<Timestamp>,
    setting: Setting,
}

fn tenths(count: u8) -> Duration {
    Duration::from_millis(100 * u64::from(count))
}

impl Subject {
    fn new(setting: Setting) -> Self {
        let now = Timestamp::UNIX_EPOCH;
        let clocks = Clocks {
            round_deadline: setting.round_tenths.map(|count| tenths(count.max(1))),
            bank: tenths(setting.bank_tenths),
            // Every second game is abandoned soon, the others never.
            idle_timeout: match setting.idle_s {
                0..128 => Duration::from_secs(5 + u64::from(setting.idle_s)),
                128.. => NEVER,
            },
            closes_at: setting.closes_tenths.map(|count| after(now, tenths(count.max(1)))),
        };
        let closes_at = clocks.closes_at;
        let resume = ResumeState {
            waiting: setting.waiting,
            outcome: None,
            round: 0,
            alive: vec![true; AGENTS.into()],
            bank_spent: vec![Duration::ZERO; AGENTS.into()],
            recorded: Vec::new(),
            last_act_at: now,
        };
        let machine = Lockstep::new(clocks, resume, now);
        let (banks, alive) = (machine.banks(), vec![true; AGENTS.into()]);
        let kept = BTreeMap::new();
        Self { machine, now, round: 0, alive, kept, banks, began_at: now, closes_at, setting }
    }

    /// True if no round may begin at this time.
    fn is_closed(&self, at: Timestamp) -> bool {
        self.closes_at.is_some_and(|closes_at| closes_at <= at)
    }

    fn submit(&mut self, agent: AgentId, round: u32, action: Action) {
        let earlier = self.kept.get(&(round, agent)).filter(|_| round < self.round).cloned();
        let submission = Submission { round, decision: Decision::of_player(Act::of(action)) };
        let room = if has_room(agent, action) { Ok(()) } else { Err(FULL) };
        self.apply(&Event::Submit { agent, submission, earlier, room });
    }

    /// Applies an event and checks everything that must hold then.
    fn apply(&mut self, event: &Event) {
        let was = self.machine.status();
        let effects = self.machine.apply(self.now, event.clone());
        let answers = effects.iter().filter(|effect| matches!(effect, Effect::Answer(_))).count();
        assert_eq!(answers, usize::from(matches!(event, Event::Submit { .. })), "{effects:?}");
        for effect in &effects {
            match effect {
                Effect::KeepAct { agent, recorded } => {
                    assert!(self.alive[agent.index()], "an act of nobody");
                    let before = self.kept.insert((self.round, *agent), recorded.clone());
                    assert_eq!(before, None, "one act a seat and round");
                    assert_eq!(recorded.waiting_for as usize, self.missing(), "{recorded:?}");
                    let bank = self.banks[agent.index()];
                    assert!(Duration::from_millis(recorded.bank_spent_ms) <= bank);
                    let late = self.setting.round_tenths.is_some_and(|count| {
                        let time = tenths(count.max(1)) + bank;
                        self.machine
                            .opened_at()
                            .is_some_and(|opened| self.now > after(opened, time))
                    });
                    assert!(!late || recorded.decision.source == Source::Clock, "it came too late");
                }
                Effect::Answer(answer) => self.check_answer(event, answer.as_ref()),
                Effect::Resolve => {
                    assert_eq!(self.missing(), 0, "it closes when all are in");
                    assert!(!self.is_closed(self.began_at), "it began too late");
                }
                Effect::KeepStart => assert_eq!(was, Status::Waiting),
                Effect::End(ending) => {
                    // A round that runs is not cut off; one that would begin now does not.
                    let is_between =
                        was == Status::Waiting || matches!(event, Event::Resolved { .. });
                    let may_close = is_between && self.is_closed(self.now);
                    assert!(*ending != Ending::Closed || may_close, "{event:?}");
                    assert!(!was.is_over(), "it ends once");
                    assert_eq!(self.machine.status(), ending.status());
                }
                Effect::Publish => {
                    assert!(!self.is_closed(self.now), "a round begins after the closing time");
                    self.began_at = self.now;
                }
            }
        }
        assert!(!was.is_over() || self.machine.status() == was, "what is over stays so");
        let banks = self.machine.banks();
        assert!(banks.iter().zip(&self.banks).all(|(now, then)| now <= then), "banks never grow");
        self.banks = banks;
        let closes = effects.contains(&Effect::Resolve);
        let opens = matches!(event, Event::Start | Event::Resolved { .. });
        let is_open = self.machine.status() == Status::Running && !opens;
        assert!(!is_open || closes == (self.missing() == 0), "{effects:?}");
        if closes {
            self.resolve();
        }
        let is_told = matches!(event, Event::Tick) && !closes;
        let wakes_at = self.machine.wakes_at();
        assert!(!is_told || wakes_at.is_none_or(|at| at > self.now), "{wakes_at:?}");
        assert_eq!(wakes_at.is_none(), self.machine.status().is_over());
        if effects.contains(&Effect::Publish) {
            self.apply(&Event::Opened { at: self.now });
        }
    }

    /// The living seats without an act in the open round.
    fn missing(&self) -> usize {
        let living = (0..AGENTS).map(AgentId).filter(|agent| self.alive[agent.index()]);
        living.filter(|agent| !self.kept.contains_key(&(self.round, *agent))).count()
    }

    fn check_answer(
        &self,
        event: &Event,
        answer: Result<&swarmbench::episode::lockstep::Receipt, &Refusal>,
    ) {
        let Event::Submit { agent, submission, .. } = event else { panic!("an answer to nobody") };
        let kept = self.kept.get(&(submission.round, *agent));
        let kept = kept.filter(|recorded| recorded.decision.source == Source::Player);
        let same = kept.filter(|recorded| recorded.decision.act == submission.decision.act);
        match answer {
            Ok(receipt) => {
                assert_eq!(receipt.round, submission.round);
                assert_eq!(Some(&receipt.recorded), same, "the receipt is that of what was kept");
            }
            Err(refusal) => {
                assert_eq!(same, None, "the same act gets the same receipt");
                match refusal {
                    Refusal::AlreadyActed { .. } => assert!(kept.is_some()),
                    Refusal::RoundAhead { sent, round } => {
                        let waits = self.machine.status() == Status::Waiting && sent == round;
                        assert!(sent > round || waits);
                    }
                    Refusal::RoundOver { sent, round } => {
                        let clock = self
                            .kept
                            .get(&(*sent, *agent))
                            .map(|recorded| recorded.decision.source);
                        assert!(sent < round || clock == Some(Source::Clock));
                    }
                    Refusal::NoRoom { full, round } => {
                        assert_eq!((*full, *round), (FULL, submission.round));
                        assert!(!self.kept.contains_key(&(*round, *agent)), "the seat is free");
                        let action = submission.decision.act.action.expect("all have one");
                        assert!(!has_room(*agent, action));
                    }
                    Refusal::EpisodeOver { escaped: true, .. } => {
                        assert!(!self.alive[agent.index()]);
                    }
                    Refusal::EpisodeOver { escaped: false, .. } => {
                        assert!(self.machine.status().is_over());
                    }
                }
            }
        }
    }

    /// Plays the round that was closed.
    fn resolve(&mut self) {
        let living = self.alive.iter().filter(|alive| **alive).count();
        assert_eq!(self.machine.recorded().count(), living, "an act of each living seat");
        for (alive, round) in self.alive.iter_mut().zip(self.setting.escapes) {
            *alive &= u32::from(round % 16) != self.round;
        }
        for (bank, agent) in self.banks.iter_mut().zip(0..) {
            let recorded = self.kept.get(&(self.round, AgentId(agent)));
            let spent = recorded.map_or(0, |recorded| recorded.bank_spent_ms);
            *bank -= Duration::from_millis(spent);
        }
        let banks = self.banks.clone();
        self.round += 1;
        let is_done = !self.alive.contains(&true);
        let is_last = self.round > u32::from(self.setting.last_round % 32);
        let ending = match (is_done, is_last) {
            (true, _) => Some(Ending::TaskDone),
            (false, true) => Some(Ending::RoundsPlayed),
            (false, false) => None,
        };
        self.apply(&Event::Resolved { alive: self.alive.clone(), ending });
        assert_eq!(self.machine.recorded().count(), 0, "the next round begins without acts");
        assert_eq!(self.machine.banks(), banks, "what was overspent is taken from the banks");
    }

    fn play(&mut self, step: &Move) {
        match step {
            Move::Submit { agent, ahead, action } => {
                let round = (self.round + u32::from(ahead % 3)).saturating_sub(1);
                let action = if *action { Action::Up } else { Action::Down };
                self.submit(AgentId(u16::from(*agent) % AGENTS), round, action);
            }
            Move::SubmitFrom { agent } => {
                let (first, round) = (u16::from(*agent) % AGENTS, self.round);
                (first..AGENTS).for_each(|agent| self.submit(AgentId(agent), round, Action::Stay));
            }
            Move::Pass { tenths: count, ticks } => {
                self.now = after(self.now, tenths(*count));
                if *ticks {
                    self.apply(&Event::Tick);
                }
            }
            Move::Wake => {
                let soon = after(self.now, NEVER / 2);
                let wakes_at = self.machine.wakes_at().filter(|at| *at < soon);
                self.now = wakes_at.unwrap_or(self.now).max(self.now);
                self.apply(&Event::Tick);
            }
            Move::Start => self.apply(&Event::Start),
            // Most games continue.
            Move::Abort if self.now.as_second() % 16 == 15 => self.apply(&Event::Abort),
            Move::Abort => {}
        }
    }
}

#[test]
fn every_order_of_events_keeps_the_barrier() {
    let orders = (produce::<Setting>(), produce::<Vec<Move>>().with().len(0..200_usize));
    check!(4_000, orders, |(setting, moves)| {
        let mut subject = Subject::new(setting.clone());
        for step in moves {
            subject.play(step);
        }
    });
}
