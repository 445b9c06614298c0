//! Deliberately broken parts: for every invariant at least one that breaks it. A checker that finds
//! none of them would prove nothing where it finds no fault in the server.

use swarmbench::store::entries::Entry;

use crate::simulation::checker::Invariant;

/// What is broken. It is always something around the server, whose own code is the same as ever.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Flaw {
    /// The journal reports entries as durable when it has only queued them.
    AcknowledgesEarly,
    /// The journal does not write one act in eight.
    LosesActs,
    /// A crash leaves a part of a job on the disk.
    TearsPieces,
    /// The journal finds the act of an earlier round with another number of seats to wait for.
    FindsAnotherReceipt,
    /// The journal never finds the act of an earlier round.
    ForgetsEarlierActs,
    /// A waiter for the journal does not wait for what was handed over before.
    DoesNotWait,
    /// The journal keeps another digest.
    AltersDigests,
    /// After a failed commit the journal keeps and acknowledges what comes next.
    GoesOnAfterFailure,
    /// After it refused an entry the journal keeps and acknowledges what comes next of the same episode.
    GoesOnAfterRefusal,
    /// The journal does not tell of one job in twenty.
    ForgetsToTell,
    /// The journal forgets who claimed seats.
    ForgetsClaims,
    /// The journal does not know when the last act came.
    ForgetsTheLastAct,
    /// The journal lists an unfinished episode that does not exist.
    ListsAGhost,
    /// Two servers run over one journal.
    TwoServers,
    /// Now and then the clock is 20 seconds ahead.
    ClockAhead,
    /// Now and then the clock is 20 seconds behind.
    ClockBehind,
    /// Sleeping tasks never wake.
    NeverWakes,
    /// Chance does not come from the seed alone.
    OtherChance,
    /// A commit sees first whether its server was excluded, and is written later.
    FenceWithoutLock,
    /// A take-over frees what a server had before it excludes that server.
    FreesPlacesFirst,
    /// Servers say by their own clocks when they were seen, and judge by them; these are seconds apart.
    LeaseByOwnClock,
    /// A server sees that nobody has a place, and writes later that it has it.
    TakesByAnOldView,
    /// A server answers however long ago it was seen.
    AnswersForever,
    /// A server counts for how long it answers from when it learns that it was seen, not from when it said that it lives.
    LeaseFromTheReply,
    /// A server gives games up though somebody uses them.
    GivesUpWhatIsUsed,
    /// A server does not continue what a request has taken, where nobody asks again.
    ForgetsWhatItTook,
    /// A server notes what it has taken when it may have given it back already.
    NotesPlacesLate,
}

/// Each flaw and the invariant that it breaks. `OtherChance` is not here: it breaks none of them,
/// but that a run follows from its seed.
pub(crate) const FLAWS: [(Flaw, Invariant); 17] = [
    (Flaw::AcknowledgesEarly, Invariant::Durable),
    (Flaw::LosesActs, Invariant::Barrier),
    (Flaw::TearsPieces, Invariant::Barrier),
    (Flaw::FindsAnotherReceipt, Invariant::StableReceipts),
    (Flaw::ForgetsEarlierActs, Invariant::StableReceipts),
    (Flaw::DoesNotWait, Invariant::TrueRefusals),
    (Flaw::AltersDigests, Invariant::Replay),
    (Flaw::GoesOnAfterFailure, Invariant::NoFalseAck),
    (Flaw::GoesOnAfterRefusal, Invariant::Barrier),
    (Flaw::ForgetsToTell, Invariant::Progress),
    (Flaw::ForgetsClaims, Invariant::Seats),
    (Flaw::ForgetsTheLastAct, Invariant::Idle),
    (Flaw::ListsAGhost, Invariant::Quotas),
    (Flaw::TwoServers, Invariant::OneAct),
    (Flaw::ClockAhead, Invariant::Clocks),
    (Flaw::ClockBehind, Invariant::Clocks),
    (Flaw::NeverWakes, Invariant::Progress),
];

/// The same of servers that share a database, each with the seed from which on it is looked for: some are found by few seeds.
pub(crate) const FLAWS_OF_SEVERAL: [(Flaw, Invariant, u64); 10] = [
    (Flaw::FenceWithoutLock, Invariant::OneOwner, 0),
    (Flaw::FreesPlacesFirst, Invariant::OneOwner, 0),
    (Flaw::LeaseByOwnClock, Invariant::OneOwner, 0),
    (Flaw::TakesByAnOldView, Invariant::OneOwner, 0),
    (Flaw::AnswersForever, Invariant::OneOwner, 0),
    (Flaw::AnswersForever, Invariant::Durable, 400),
    (Flaw::LeaseFromTheReply, Invariant::OneOwner, 60),
    (Flaw::GivesUpWhatIsUsed, Invariant::OneOwner, 0),
    (Flaw::NotesPlacesLate, Invariant::OneOwner, 20),
    (Flaw::ForgetsWhatItTook, Invariant::Progress, 3000),
];

impl Flaw {
    /// Faults of entries on their way to the disk.
    pub(crate) fn on_the_way_to_the_disk(self, mut entries: Vec<Entry>) -> Vec<Entry> {
        match self {
            Self::LosesActs => entries.retain(|entry| match entry {
                Entry::Act(row) => !(u32::from(row.agent.0) + row.round).is_multiple_of(8),
                _ => true,
            }),
            Self::AltersDigests => {
                for entry in &mut entries {
                    if let Entry::Round(row) = entry {
                        row.digest[0] ^= 1;
                    }
                }
            }
            _ => {}
        }
        entries
    }
}
