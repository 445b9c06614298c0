//! Counts over a whole game.

use super::counts::{Counts, place, ratio, real};
use super::places::Trail;
use crate::game::{Decision, Heard, Setup, State};
use crate::metric::RunValue;

/// Sums over the rounds of a game.
pub(super) struct Totals {
    /// Move actions by agent.
    moves: Vec<[u64; 4]>,
    moving_rounds: u32,
    /// Paths by agent; empty if the agents' memory is not known.
    trails: Vec<Trail>,
    steps: u32,
    revisits: u32,
    stepping_rounds: u32,
    /// `None` as soon as a round lacks its deliveries.
    heard: Option<Received>,
    messages: u64,
    talking_rounds: u32,
    first_score: Option<u32>,
    start_score: f64,
    tokens: Option<u64>,
}

/// Delivered messages.
#[derive(Clone, Copy, Default)]
struct Received {
    /// Copies received by agents other than the sender.
    copies: u64,
    /// Messages with such a copy.
    messages: u64,
}

impl Totals {
    pub(super) fn new(setup: &Setup, layout: &State) -> Self {
        let agents = layout.agents.len();
        Self {
            moves: vec![[0; 4]; agents],
            moving_rounds: 0,
            trails: if setup.memory.is_some() {
                vec![Trail::default(); agents]
            } else {
                Vec::new()
            },
            steps: 0,
            revisits: 0,
            stepping_rounds: 0,
            heard: Some(Received::default()),
            messages: 0,
            talking_rounds: 0,
            first_score: None,
            start_score: layout.score,
            tokens: None,
        }
    }

    /// Adds the choices of the agents on the map.
    pub(super) fn acts(&mut self, state: &State, decisions: &[Decision], counts: &Counts) {
        for (agent, _) in state.living() {
            let decision = &decisions[agent];
            if let Some(direction) = decision.direction() {
                self.moves[agent][place(direction)] += 1;
            }
            if let Some(tokens) = decision.tokens {
                self.tokens = Some(self.tokens.unwrap_or(0).saturating_add(tokens));
            }
        }
        self.moving_rounds += u32::from(counts.movers() > 0);
        self.messages += u64::from(counts.messages);
        self.talking_rounds += u32::from(counts.messages > 0);
    }

    /// Adds the messages delivered with the state after the round.
    pub(super) fn heard(&mut self, heard: Option<&[Heard]>) {
        self.heard = self.heard.zip(heard).map(|(sum, heard)| sum.with(heard));
    }

    /// Adds the transition of round `round`.
    pub(super) fn moved(&mut self, setup: &Setup, round: u32, before: &State, after: &State) {
        if self.first_score.is_none() && after.score > self.start_score {
            self.first_score = Some(round + 1);
        }
        let Some(memory) = setup.memory else { return };
        let steps = self.steps;
        for (agent, body) in before.living() {
            let (from, to) = (body.at, after.agents[agent].at);
            if from != to {
                let is_revisit = self.trails[agent].step(setup, memory, round, from, to);
                self.steps += 1;
                self.revisits += u32::from(is_revisit);
            }
        }
        self.stepping_rounds += u32::from(self.steps > steps);
    }

    /// The mean imbalance of agents that chose to move.
    pub(super) fn imbalance(&self) -> RunValue {
        let values: Vec<f64> = self.moves.iter().filter_map(imbalance).collect();
        let mean = values.iter().sum::<f64>() / real(values.len() as u64);
        RunValue { value: (!values.is_empty()).then_some(mean), rounds: self.moving_rounds }
    }

    /// The imbalance of all move actions together.
    pub(super) fn imbalance_pooled(&self) -> RunValue {
        let sum = |place: usize| self.moves.iter().map(|moves| moves[place]).sum();
        RunValue { value: imbalance(&[0, 1, 2, 3].map(sum)), rounds: self.moving_rounds }
    }

    pub(super) fn revisit_share(&self) -> RunValue {
        RunValue { value: ratio(self.revisits, self.steps), rounds: self.stepping_rounds }
    }

    /// The mean number of other agents that received a message.
    pub(super) fn delivered(&self) -> RunValue {
        self.of_messages(|received| ratio(received.copies, self.messages))
    }

    /// The share of messages that no other agent received.
    pub(super) fn unheard_share(&self) -> RunValue {
        self.of_messages(|received| {
            ratio(self.messages.saturating_sub(received.messages), self.messages)
        })
    }

    /// Rounds until the score first rose.
    pub(super) fn time_to_first_score(&self) -> RunValue {
        let rounds = self.first_score.unwrap_or(0);
        RunValue { value: self.first_score.map(f64::from), rounds }
    }

    /// Tokens per point of a score after `rounds` rounds.
    pub(super) fn tokens_per_point(&self, score: f64, rounds: u32) -> RunValue {
        let tokens = self.tokens.filter(|_| score > 0.0);
        let value = tokens.map(|tokens| real(tokens) / score);
        RunValue { value, rounds: if value.is_some() { rounds } else { 0 } }
    }

    fn of_messages(&self, value: impl Fn(Received) -> Option<f64>) -> RunValue {
        let rounds = if self.heard.is_some() { self.talking_rounds } else { 0 };
        RunValue { value: self.heard.and_then(value), rounds }
    }
}

impl Received {
    /// Adds the messages of another state. All copies of a message are delivered with the same state.
    fn with(self, heard: &[Heard]) -> Self {
        let mut sent: Vec<_> = (heard.iter().filter(|heard| !heard.is_own()))
            .map(|heard| (heard.sender, heard.sent))
            .collect();
        let copies = self.copies + sent.len() as u64;
        sent.sort_unstable();
        sent.dedup();
        Self { copies, messages: self.messages + sent.len() as u64 }
    }
}

/// The Gini coefficient of counts of the four move actions, 0 to 0.75; `None` without moves.
fn imbalance(moves: &[u64; 4]) -> Option<f64> {
    let pairs = (0..4).flat_map(|a| (a + 1..4).map(move |b| (a, b)));
    let differences: u64 = pairs.map(|(a, b)| moves[a].abs_diff(moves[b])).sum();
    ratio(differences, 4 * moves.iter().sum::<u64>())
}
