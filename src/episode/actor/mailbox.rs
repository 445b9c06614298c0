//! Messages to an actor, and its replies.

use jiff::Timestamp;
use swarmbench_engine::AgentId;
use tokio::sync::oneshot;

use super::super::in_flight::{InFlightPermits, SEAT_ACTS_WAITING_MAX};
use super::super::lockstep::{Receipt, RecordedAct, Refusal, Submission};
use super::super::seating::{SeatTaken, Wanted};
use crate::ids::TokenHash;
use crate::store::StoreError;
use crate::store::entries::{Entry, Holder};

#[derive(Clone, Debug, thiserror::Error)]
pub enum ActError {
    /// The barrier refused the act.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Too many acts of the same seat already wait.
    #[error("the maximum of {SEAT_ACTS_WAITING_MAX} acts of this seat already wait for an answer")]
    Busy,
    #[error(transparent)]
    Journal(#[from] StoreError),
}

/// The outcomes of several acts, in their order.
pub type Outcomes = Vec<Result<Receipt, ActError>>;

#[derive(Clone, Debug, thiserror::Error)]
pub enum StartError {
    #[error("{0} of its seats are still open")]
    SeatsOpen(u16),
    #[error(transparent)]
    Journal(#[from] StoreError),
}

#[derive(Clone, Debug)]
pub struct Claim {
    /// Holder of the claimed seats; its number and time are not known yet.
    pub holder: Holder,
    pub wanted: Wanted,
    /// Hashes of as many seat tokens as there are seats wanted.
    pub seats: Vec<TokenHash>,
    pub swarm: TokenHash,
    /// Idempotency key, and hash of the body.
    pub idempotency: Option<(String, [u8; 32])>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claimed {
    /// Number of the claim in its episode.
    pub number: u32,
    /// Seats, in the order of the tokens.
    pub agents: Vec<AgentId>,
}

#[derive(Clone, Debug, thiserror::Error)]
pub enum ClaimError {
    /// The seats have holders, or were never open.
    #[error(transparent)]
    SeatTaken(#[from] SeatTaken),
    #[error("the episode has ended")]
    Over,
    #[error(transparent)]
    Journal(#[from] StoreError),
}

pub(super) enum Message {
    Submit { batch: Batch, reply: oneshot::Sender<Vec<(usize, Reply)>> },
    Start { reply: oneshot::Sender<Result<(), StartError>> },
    Abort { audit_entries: Vec<Entry>, reply: oneshot::Sender<Result<(), StoreError>> },
    Claim { claim: Box<Claim>, reply: oneshot::Sender<Result<Claimed, ClaimError>> },
}

/// Acts on their way to the actor, with their permits.
pub(super) struct Batch {
    pub(super) acts: Vec<Sent>,
    pub(super) permits: InFlightPermits,
}

/// An act in flight.
pub(super) struct Sent {
    /// Position among the acts of the call.
    pub(super) place: usize,
    pub(super) agent: AgentId,
    pub(super) submission: Submission,
    pub(super) earlier: Earlier,
}

/// Act of a seat in a round that is over.
pub(super) enum Earlier {
    /// Not looked up yet.
    Unknown,
    /// Result of the lookup.
    Found(Option<RecordedAct>),
}

pub(super) enum Reply {
    Outcome(Result<Receipt, ActError>),
    /// The round is over: the caller has to look up what the seat did then. The actor does not, as all others would wait for it.
    Late(Sent),
}

/// A message with its arrival time, so that its wait in the mailbox costs no player time.
pub(super) type Envelope = (Timestamp, Message);
