//! Announced moves, and whether agents make them.

use swarmbench_engine::{Action, Direction};

use super::counts::{Said, ratio};
use crate::game::Decision;
use crate::metric::RunValue;

/// Messages that name one direction, and the later moves of their senders.
pub(super) struct Promises {
    /// Direction that the last message of each agent named, unless it moved that way at once.
    open: Vec<Option<Direction>>,
    made: u32,
    kept: u32,
    rounds: u32,
}

impl Promises {
    pub(super) fn new(agents: usize) -> Self {
        Self { open: vec![None; agents], made: 0, kept: 0, rounds: 0 }
    }

    /// Adds a round.
    pub(super) fn round(&mut self, decisions: &[Decision], said: &Said<'_>) {
        for (open, decision) in self.open.iter_mut().zip(decisions) {
            let promise = open.take();
            self.kept += u32::from(promise.is_some() && promise == decision.direction());
        }
        let before = self.made;
        for &(agent, text) in &said.all {
            let Some(direction) = direction_named(text) else { continue };
            self.made += 1;
            if decisions[agent].direction() == Some(direction) {
                self.kept += 1;
            } else {
                self.open[agent] = Some(direction);
            }
        }
        self.rounds += u32::from(self.made > before);
    }

    /// The share of announced moves that were made.
    pub(super) fn value(&self) -> RunValue {
        RunValue { value: ratio(self.kept, self.made), rounds: self.rounds }
    }
}

/// The only direction that a text names by separate words.
fn direction_named(text: &str) -> Option<Direction> {
    let words = text.split(|c: char| !c.is_alphanumeric());
    let action = |word: &str| Action::ALL.into_iter().find(|a| word.eq_ignore_ascii_case(a.name()));
    let mut named = words.filter_map(|word| action(word)?.direction());
    let first = named.next()?;
    named.all(|other| other == first).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_names_a_direction_by_one_word_of_its_own() {
        for (text, expected) in [
            ("go Up!", Some(Direction::Up)),
            ("LEFT, then left again", Some(Direction::Left)),
            ("up or down?", None),
            ("upwards", None),
            ("STAY", None),
            ("", None),
        ] {
            assert_eq!(direction_named(text), expected, "{text:?}");
        }
    }
}
