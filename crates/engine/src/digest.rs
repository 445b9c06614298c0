//! The canonical bytes of a state, and their hash.
//!
//! Two worlds of one configuration have the same digest exactly if they behave the same from here
//! on. All integers are little-endian; lists are preceded by their length.

use sha2::{Digest as _, Sha256};

use crate::body::Board;
use crate::mail::Audience;
use crate::message::Message;
use crate::tasks::Task;
use crate::world::World;

/// SHA-256 of a state's canonical bytes.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Digest(pub [u8; 32]);

impl std::fmt::Display for Digest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl std::fmt::Debug for Digest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

impl World {
    /// The digest of the current state. History that no longer matters (the memory of the agents) is not part of it.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut bytes = Bytes(Vec::with_capacity(512));
        bytes.u32(self.round);
        bytes.f64(self.score);
        bytes.board(&self.board);
        match &self.task {
            Task::Transport(_) => bytes.u8(0),
            Task::Pursuit(task) => {
                bytes.u8(1);
                bytes.u64(task.rng.draw_count());
                bytes.u8(self.board.body(task.prey).fixed.into());
            }
            Task::Synchronization(task) => {
                bytes.u8(2);
                task.light_on.iter().for_each(|&light| bytes.u8(light.into()));
                bytes.u8(task.scored.map_or(2, u8::from));
            }
            Task::Foraging(task) => {
                bytes.u8(3);
                task.carrying.iter().for_each(|&food| bytes.u8(food.into()));
            }
            Task::Flocking(task) => {
                bytes.u8(4);
                bytes.f64(task.current);
            }
        }
        for inbox in &self.mail.inbox {
            bytes.length(inbox.len());
            for received in inbox {
                bytes.text(&received.text);
            }
        }
        bytes.length(self.mail.pending.len());
        for message in &self.mail.pending {
            bytes.u32(message.sent);
            bytes.u32(message.due);
            bytes.u16(message.sender.0);
            bytes.text(&message.text);
            match &message.audience {
                Audience::Decided(receivers) => {
                    bytes.u8(0);
                    bytes.length(receivers.len());
                    for receiver in receivers {
                        bytes.u16(receiver.0);
                    }
                }
                Audience::Open { to } => {
                    bytes.u8(1);
                    bytes.u16(to.map_or(u16::MAX, |to| to.0));
                }
            }
        }
        Digest(Sha256::digest(&bytes.0).into())
    }
}

/// A writer of canonical bytes.
struct Bytes(Vec<u8>);

impl Bytes {
    fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    fn u16(&mut self, value: u16) {
        self.0.extend(value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    fn length(&mut self, value: usize) {
        self.u32(u32::try_from(value).expect("lists are short"));
    }

    fn text(&mut self, message: &Message) {
        self.length(message.as_str().len());
        self.0.extend(message.as_str().bytes());
    }

    /// Writes the positions of all movable bodies; fixed ones follow from the configuration.
    fn board(&mut self, board: &Board) {
        for body in board.bodies() {
            if body.fixed && body.kind != crate::body::Kind::Prey {
                continue;
            }
            self.0.extend(body.at.i.to_le_bytes());
            self.0.extend(body.at.j.to_le_bytes());
            self.u8(body.gone.into());
        }
    }
}
