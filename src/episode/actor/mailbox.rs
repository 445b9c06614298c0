//! What an actor is asked to do, and its replies.

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
    /// By the rules of the barrier.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Too many acts of the same seat wait already.
    #[error("the maximum of {SEAT_ACTS_WAITING_MAX} acts of this seat already wait for an answer")]
    Busy,
    /// It could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

/// The outcomes of several acts, in their order.
pub type Outcomes = Vec<Result<Receipt, ActError>>;

#[derive(Clone, Debug, thiserror::Error)]
pub enum StartError {
    /// It cannot begin yet.
    #[error("{0} of its seats are still open")]
    SeatsOpen(u16),
    /// It could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

#[derive(Clone, Debug)]
pub struct Claim {
    /// Who claims them; the number and the time are not known yet.
    pub holder: Holder,
    pub wanted: Wanted,
    /// The hashes of as many seat tokens as there are seats wanted.
    pub seats: Vec<TokenHash>,
    pub swarm: TokenHash,
    /// The key by which a repeated claim finds it, and the hash of the body.
    pub idempotency: Option<(String, [u8; 32])>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claimed {
    /// The number of the claim in its episode.
    pub number: u32,
    /// The seats, in the order of the tokens.
    pub agents: Vec<AgentId>,
}

#[derive(Clone, Debug, thiserror::Error)]
pub enum ClaimError {
    /// The seats have holders, or there never were open ones.
    #[error(transparent)]
    SeatTaken(#[from] SeatTaken),
    /// The episode has ended.
    #[error("the episode has ended")]
    Over,
    /// It could not be stored.
    #[error(transparent)]
    Journal(#[from] StoreError),
}

/// What an actor is asked to do.
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
    /// Its place among the acts of the call.
    pub(super) place: usize,
    pub(super) agent: AgentId,
    pub(super) submission: Submission,
    pub(super) earlier: Earlier,
}

/// What a seat did in a round that is over.
pub(super) enum Earlier {
    /// Not looked up yet.
    Unknown,
    /// The result of the lookup.
    Found(Option<RecordedAct>),
}

pub(super) enum Reply {
    Outcome(Result<Receipt, ActError>),
    /// Its round is over: the caller has to look up what the seat did then. The actor does not, as all
    /// others would wait for it.
    Late(Sent),
}

/// A message with its arrival time: its wait in the mailbox costs no player time.
pub(super) type Envelope = (Timestamp, Message);
