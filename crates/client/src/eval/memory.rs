//! What seats remember beyond their prompts: earlier rounds of their dialogue, and notes. The server has all of it in the acts,
//! so after a kill the program reads the acts and asks the same questions.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Mutex;

use serde_json::{Value, json};
use swarmbench_protocol::act::{Harness, SeatAct, SwarmAct};
use swarmbench_protocol::observation::Sight;

use super::harness::HarnessPlan;
use crate::client::{Client, ClientError};
use crate::recent::Recent;

/// An earlier round of a seat's dialogue.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Turn {
    /// The server's prompt.
    prompt: String,
    /// The answer; `None` until the act is durable.
    response: Option<String>,
    /// Items of the answer with its encrypted reasoning, which only this process has.
    items: Vec<Value>,
}

/// Memory of a seat at the beginning of a round.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Recalled {
    pub(super) turns: BTreeMap<u32, Turn>,
    pub(super) scratchpad: String,
}

#[derive(Default)]
struct Seat {
    /// The round before which everything is known.
    known: u32,
    recalled: Recalled,
}

/// The memory of all seats of a token. Games that were seen long ago are forgotten, and read again.
pub(super) struct Memory {
    client: Client,
    token: String,
    history: u32,
    has_notes: bool,
    seats: Mutex<Recent<HashMap<String, Seat>>>,
}

impl Memory {
    pub(super) fn new(client: &Client, token: &str, harness: HarnessPlan) -> Self {
        let (client, token) = (client.clone(), token.to_owned());
        let [history, notes, _] = harness.numbers();
        Self { client, token, history, has_notes: notes > 0, seats: Mutex::default() }
    }

    /// True if seats remember nothing beyond their prompts.
    fn is_empty(&self) -> bool {
        self.history == 0 && !self.has_notes
    }

    fn seat<T>(&self, episode: &str, agent: &str, see: impl FnOnce(&mut Seat) -> T) -> T {
        let mut seats = self.seats.lock().expect("nothing panics while it holds this");
        see(seats.of(episode, HashMap::new).entry(agent.to_owned()).or_default())
    }

    /// What the seat of an observation remembers. It is read from the server unless the act of the round before is known to be
    /// durable.
    pub(super) async fn recall(&self, sight: &Sight) -> Result<Recalled, ClientError> {
        let Sight { episode, agent, round, .. } = sight;
        if self.is_empty() || *round == 0 {
            return Ok(Recalled::default());
        }
        let (known_until, known) =
            self.seat(episode, agent, |seat| (seat.known, seat.recalled.clone()));
        if known_until == *round {
            return Ok(known);
        }
        let mut recalled = Recalled::default();
        if self.has_notes {
            // The clock may have acted in all rounds that are not known.
            let last = self.acts(sight, known_until, false, true).await?.pop();
            recalled.scratchpad = match last {
                Some(last) => last.act.harness.and_then(|kept| kept.scratchpad).unwrap_or_default(),
                None => known.scratchpad,
            };
        }
        if self.history > 0 {
            let oldest = round.saturating_sub(self.history);
            for SeatAct { round, prompt, act } in self.acts(sight, oldest, true, false).await? {
                let Some(prompt) = prompt else { continue };
                let items = known.turns.get(&round).map(|turn| turn.items.clone());
                let items = items.unwrap_or_default();
                recalled.turns.insert(round, Turn { prompt, response: act.response, items });
            }
        }
        let kept = Seat { known: *round, recalled: recalled.clone() };
        self.seat(episode, agent, |seat| *seat = kept);
        Ok(recalled)
    }

    /// Answers of the seat from the round `oldest` on, oldest first; of `is_last` the last one alone.
    async fn acts(
        &self,
        sight: &Sight,
        oldest: u32,
        prompt: bool,
        is_last: bool,
    ) -> Result<Vec<SeatAct>, ClientError> {
        let Sight { episode, agent, round, .. } = sight;
        let (mut answers, mut before) = (VecDeque::new(), *round);
        while before > oldest && (!is_last || answers.is_empty()) {
            let rounds = oldest.max(before.saturating_sub(Harness::ROUNDS_MAX.into()))..before;
            let page = self.client.swarm_acts(&self.token, episode, agent, rounds, prompt).await?;
            let Some(first) = page.acts.first() else { break };
            before = first.round;
            for past in page.acts.into_iter().rev().filter(|past| past.act.response.is_some()) {
                answers.push_front(past);
            }
        }
        Ok(answers.into())
    }

    /// Notes the question of a round, whose act is yet to be sent.
    pub(super) fn asked(&self, sight: &Sight, prompt: String, items: Vec<Value>) {
        let turn = Turn { prompt, response: None, items };
        if self.history > 0 {
            self.seat(&sight.episode, &sight.agent, |seat| {
                seat.recalled.turns.insert(sight.round, turn)
            });
        }
    }

    /// Notes a durable act, as it was stored. An act that came too late is never noted, so the next round is read from the server.
    pub(super) fn acted(&self, act: &SwarmAct) {
        if self.is_empty() {
            return;
        }
        self.seat(&act.episode, &act.agent, |seat| {
            if seat.known != act.round {
                return;
            }
            seat.known = act.round + 1;
            let Recalled { turns, scratchpad } = &mut seat.recalled;
            let kept = act.harness.as_ref().and_then(|kept| kept.scratchpad.clone());
            *scratchpad = kept.unwrap_or_default();
            if let Some(turn) = turns.get_mut(&act.round) {
                turn.response.clone_from(&act.response);
            }
            let oldest = (act.round + 1).saturating_sub(self.history);
            turns.retain(|round, turn| *round >= oldest && turn.response.is_some());
        });
    }
}

impl Recalled {
    /// The items before a prompt of `round`, the rounds in them, and those with encrypted reasoning.
    pub(super) fn dialogue(&self, round: u32, history: u32) -> (Vec<Value>, Vec<u32>, Vec<u32>) {
        let (mut items, mut rounds, mut carried) = (Vec::new(), Vec::new(), Vec::new());
        for (&past, turn) in self.turns.range(round.saturating_sub(history)..round) {
            let Some(response) = &turn.response else { continue };
            rounds.push(past);
            items.push(message("user", &turn.prompt));
            if turn.items.is_empty() {
                items.push(message("assistant", response));
            } else {
                carried.push(past);
                items.extend(turn.items.iter().cloned());
            }
        }
        (items, rounds, carried)
    }
}

/// A message before a prompt, in the form that all interfaces have. Some refuse messages without a text.
pub(super) fn message(role: &str, text: &str) -> Value {
    let text = if text.trim().is_empty() { "(no answer)" } else { text };
    json!({ "role": role, "content": text })
}
