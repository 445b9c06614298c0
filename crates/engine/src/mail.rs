//! The receivers of messages, and their rounds of delivery (rules: *Messages*, *Centralized control*).

use crate::act::{Act, AgentId};
use crate::body::{Board, Kind};
use crate::config::Config;
use crate::grid::Pos;
use crate::message::Message;
use crate::names::{Control, RuleSet};
use crate::rng::Stream;

/// A message under way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PendingMessage {
    /// The round whose observations deliver the message.
    pub(crate) due: u32,
    /// The round in which it was sent.
    pub(crate) sent: u32,
    pub(crate) sender: AgentId,
    pub(crate) text: Message,
    pub(crate) audience: Audience,
}

/// The receivers of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Audience {
    /// The agents that were fixed when the message was sent.
    Decided(Vec<AgentId>),
    /// The agents that are present at delivery; only the one that the commander named, if any.
    Open { to: Option<AgentId> },
}

/// A delivered message as its receiver reads it. The order is the order in the observation: by text.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Received {
    pub(crate) text: Message,
    /// The round in which it was sent.
    pub(crate) sent: u32,
    pub(crate) sender: AgentId,
}

/// A message that was delivered with the current observations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delivery<'a> {
    /// The agent that reads the message.
    pub receiver: AgentId,
    /// The agent that sent the message; may be the receiver itself (rules `reference`). The receiver does not see this.
    pub sender: AgentId,
    /// The round in which it was sent.
    pub sent: u32,
    /// The text as the receiver reads it, after noise.
    pub text: &'a Message,
}

/// All messages under way, and those delivered with the current observations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mail {
    pub(crate) pending: Vec<PendingMessage>,
    /// The delivered messages of each agent, sorted.
    pub(crate) inbox: Vec<Vec<Received>>,
}

impl Mail {
    pub(crate) fn new(agents: usize) -> Self {
        Self { pending: Vec::new(), inbox: vec![Vec::new(); agents] }
    }

    /// The messages delivered with the current observations, by receiver.
    pub(crate) fn deliveries(&self) -> impl Iterator<Item = Delivery<'_>> {
        (0..).map(AgentId).zip(&self.inbox).flat_map(|(receiver, inbox)| {
            inbox.iter().map(move |received| Delivery {
                receiver,
                sender: received.sender,
                sent: received.sent,
                text: &received.text,
            })
        })
    }

    /// Number of deliveries with the current observations.
    pub(crate) fn delivered(&self) -> usize {
        self.inbox.iter().map(Vec::len).sum()
    }

    /// Approximate memory in bytes. Copies of a message share its text, unless there is noise.
    pub(crate) fn bytes(&self, config: &Config) -> usize {
        let pending = self.pending.iter().map(|message| {
            let receivers = match &message.audience {
                Audience::Decided(receivers) => size_of_val(&**receivers),
                Audience::Open { .. } => 0,
            };
            size_of::<PendingMessage>() + message.text.bytes() + receivers
        });
        let received = self.delivered();
        let texts = if config.noise > 0.0 { received } else { received.min(self.inbox.len()) };
        pending.sum::<usize>()
            + size_of_val(&*self.inbox)
            + received * size_of::<Received>()
            + texts * 2 * Message::CHARS_MAX
    }

    /// Accepts the messages of round `round`, sent from the positions on `board`.
    pub(crate) fn post(&mut self, config: &Config, board: &Board, round: u32, acts: &[Act]) {
        for ((act, body), number) in acts.iter().zip(board.agents()).zip(0..) {
            let Some(text) = act.message.clone() else { continue };
            if body.gone {
                continue;
            }
            let sender = AgentId(number);
            let commands = config.control == Control::Centralized && sender == AgentId::COMMANDER;
            let to = act.to.filter(|_| commands);
            let audience = match config.rules {
                RuleSet::Paper => Audience::Decided(audience(config, board, sender, to)),
                RuleSet::Reference => Audience::Open { to },
            };
            let late = match config.max_delay {
                0 => 0,
                most => {
                    let key = [round, u32::from(number)];
                    Stream::new(config.seed.get(), "delay", &key).below(most + 1)
                }
            };
            self.pending.push(PendingMessage {
                due: round + 1 + late,
                sent: round,
                sender,
                text,
                audience,
            });
        }
    }

    /// Delivers the messages that are due with the observations of round `round` to living agents.
    pub(crate) fn deliver(&mut self, config: &Config, board: &Board, round: u32) {
        for inbox in &mut self.inbox {
            inbox.clear();
        }
        let silenced = config.control == Control::Centralized
            && board.agents()[AgentId::COMMANDER.index()].gone;
        let inbox = &mut self.inbox;
        self.pending.retain(|message| {
            if message.due > round {
                return true;
            }
            let open;
            let receivers = match &message.audience {
                Audience::Decided(receivers) => receivers,
                Audience::Open { to } => {
                    open = audience(config, board, message.sender, *to);
                    &open
                }
            };
            for &receiver in receivers {
                if !silenced && !board.agents()[receiver.index()].gone {
                    inbox[receiver.index()].push(Received {
                        text: corrupt(config, message, receiver),
                        sent: message.sent,
                        sender: message.sender,
                    });
                }
            }
            false
        });
        for inbox in inbox {
            inbox.sort_unstable();
        }
    }
}

/// The living agents that a message of `sender` reaches from the positions on `board`.
fn audience(config: &Config, board: &Board, sender: AgentId, to: Option<AgentId>) -> Vec<AgentId> {
    let living = |id: &AgentId| board.agents().get(id.index()).is_some_and(|body| !body.gone);
    let others = |id: &AgentId| *id != sender;
    match config.control {
        Control::Centralized if sender != AgentId::COMMANDER => {
            Some(AgentId::COMMANDER).into_iter().filter(living).collect()
        }
        Control::Centralized => match to {
            Some(to) => Some(to).into_iter().filter(others).filter(living).collect(),
            None => (0..config.num_agents).map(AgentId).filter(others).filter(living).collect(),
        },
        Control::Decentralized => {
            let mut near = neighbours(config.reach(), board, board.agents()[sender.index()].at);
            if config.rules == RuleSet::Paper {
                near.retain(others);
            }
            near
        }
    }
}

/// The living agents within `reach` rows and columns of a cell, in order of their numbers: looks
/// through the cells or through the agents, whichever are fewer.
fn neighbours(reach: i32, board: &Board, center: Pos) -> Vec<AgentId> {
    let grid = board.grid();
    let rows = (center.i - reach).max(0)..(center.i + reach + 1).min(grid.height());
    let columns = (center.j - reach).max(0)..(center.j + reach + 1).min(grid.width());
    if rows.len() * columns.len() < board.agents().len() {
        let cells = rows.flat_map(|i| columns.clone().map(move |j| Pos::new(i, j)));
        let bodies = cells.filter_map(|cell| grid.get(cell));
        let mut near: Vec<AgentId> = bodies
            .filter(|&id| board.body(id).kind() == Kind::Agent)
            .map(|id| AgentId(id.0))
            .collect();
        near.sort_unstable();
        near
    } else {
        (board.agents().iter().zip(0..))
            .filter(|(agent, _)| !agent.gone && agent.at.is_within(reach, center))
            .map(|(_, number)| AgentId(number))
            .collect()
    }
}

/// The copy of a message that a receiver reads: noise may have replaced some characters.
fn corrupt(config: &Config, message: &PendingMessage, receiver: AgentId) -> Message {
    if config.noise <= 0.0 {
        return message.text.clone();
    }
    let key = [message.sent, u32::from(message.sender.0), u32::from(receiver.0)];
    let mut noise = Stream::new(config.seed.get(), "noise", &key);
    if !noise.chance(config.noise) {
        return message.text.clone();
    }
    let replace = |c: char| if noise.below(2) == 1 { printable(noise.below(95)) } else { c };
    message.text.with_chars(replace)
}

/// The `n`-th printable ASCII character, counted from the space.
fn printable(n: u32) -> char {
    char::from_u32(0x20 + n).expect("an ASCII character")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_trimmed_line() {
        let text = |raw: &str| Message::new(raw).map(|message| message.to_string());
        assert_eq!(text(""), None);
        assert_eq!(text(" \r\n\t\u{2028} "), None);
        assert_eq!(text(" a\r\nb\nc\rd\u{0}e\u{2029}f ").as_deref(), Some("a b c d e f"));
        assert_eq!(text("\r\n\r\na\n\nb").as_deref(), Some("a  b"));
    }

    #[test]
    fn a_message_is_cut_by_characters_after_trimming() {
        let full = "é".repeat(120);
        let message = |raw: &str| Message::new(raw).expect("not empty").to_string();
        assert_eq!(message(&full), full);
        assert_eq!(message(&format!("  {full}\n")), full);
        assert_eq!(message(&format!("{full}x")), format!("{full}..."));
    }
}
