//! Deliberate flaws, at least one for every invariant. If the checker missed them, its silence about the server would
//! prove nothing.

use swarmbench::store::entries::Entry;

use crate::simulation::checker::Invariant;

/// A flaw, always in the simulated surroundings of the server, whose own code is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Flaw {
    /// The journal reports entries as durable as soon as they are queued.
    AcknowledgesEarly,
    /// The journal drops one act in eight.
    LosesActs,
    /// A crash leaves a part of a job on the disk.
    TearsPieces,
    /// The journal returns the act of an earlier round with a wrong number of waiting seats.
    FindsAnotherReceipt,
    /// The journal never finds the act of an earlier round.
    ForgetsEarlierActs,
    /// A wait for the journal does not wait for earlier jobs.
    DoesNotWait,
    /// The journal stores another digest.
    AltersDigests,
    /// After a failed commit the journal stores and acknowledges later jobs.
    GoesOnAfterFailure,
    /// After a refused job the journal stores and acknowledges later jobs of the same episode.
    GoesOnAfterRefusal,
    /// The journal never reports one job in twenty.
    ForgetsToTell,
    /// The journal forgets who claimed seats.
    ForgetsClaims,
    /// The journal does not know the time of the last act.
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
    /// Randomness does not come from the seed alone.
    OtherChance,
    /// A commit checks first whether its server was excluded, and is written later.
    FenceWithoutLock,
    /// A take-over frees the places of a server before it excludes that server.
    FreesPlacesFirst,
    /// Servers use their own clocks for leases; these clocks are seconds apart.
    LeaseByOwnClock,
    /// A server sees that a place has no owner, and writes later that it owns the place.
    TakesByAnOldView,
    /// A server answers even after its lease has ended.
    AnswersForever,
    /// A server counts its lease from the reply to its beat, not from the time at which it sent the beat.
    LeaseFromTheReply,
    /// A server gives up games in use.
    GivesUpWhatIsUsed,
    /// A server does not continue a place that a request has taken, unless another request comes.
    ForgetsWhatItTook,
    /// A server records a taken place when it may already have given it back.
    NotesPlacesLate,
}

/// Each flaw with the invariant that it breaks. `OtherChance` is missing, as it only breaks that a run follows from
/// its seed.
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

/// The flaws of servers that share a database, each with the first seed of the search: few seeds reveal some of them.
pub(crate) const FLAWS_OF_SEVERAL: [(Flaw, Invariant, u64); 10] = [
    (Flaw::FenceWithoutLock, Invariant::OneOwner, 0),
    (Flaw::FreesPlacesFirst, Invariant::OneOwner, 0),
    (Flaw::LeaseByOwnClock, Invariant::OneOwner, 0),
    (Flaw::TakesByAnOldView, Invariant::OneOwner, 0),
    (Flaw::AnswersForever, Invariant::OneOwner, 0),
    (Flaw::AnswersForever, Invariant::Durable, 400),
    (Flaw::LeaseFromTheReply, Invariant::OneOwner, 60),
    (Flaw::GivesUpWhatIsUsed, Invariant::OneOwner, 0),
    (Flaw::NotesPlacesLate, Invariant::OneOwner, 200),
    (Flaw::ForgetsWhatItTook, Invariant::Progress, 2400),
];

impl Flaw {
    /// Applies the flaws of entries on their way to the disk.
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
