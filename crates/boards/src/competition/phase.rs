//! Phases of a competition by the server's time. An event at a moment belongs to the time after it: a competition is open at
//! `opens_at` and closed at `closes_at`.

use jiff::Timestamp;

use super::definition::{BoardRule, Definition};

swarmbench_engine::named! {
    /// The phase of a competition.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Phase {
        /// Before `opens_at`.
        Announced = "announced",
        /// Attempts may be played.
        Open = "open",
        /// No round begins any more; the last ones still run.
        Closing = "closing",
        /// All games have ended, and everything is public.
        Closed = "closed",
        /// The organizer has ended the competition early; its seeds stay sealed until the time at which it would have closed.
        Cancelled = "cancelled",
    }
}

impl Phase {
    /// Phase at a time.
    #[must_use]
    pub fn at(
        definition: &Definition,
        is_revealed: bool,
        is_cancelled: bool,
        now: Timestamp,
    ) -> Self {
        if is_cancelled {
            Self::Cancelled
        } else if is_revealed {
            Self::Closed
        } else if now < definition.opens_at {
            Self::Announced
        } else if now < definition.closes_at {
            Self::Open
        } else {
            Self::Closing
        }
    }
}

/// Reason why an attempt cannot be started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotNow {
    /// The attempt does not exist.
    #[error("there are {0} attempts, counted from 1")]
    Unknown(usize),
    /// The attempt was started before.
    #[error("attempt {0} was started before")]
    Used(u32),
    /// All attempts were started.
    #[error("all {0} attempts were started")]
    UsedUp(usize),
    /// The window has not opened.
    #[error("attempt {0} opens at {1}")]
    NotOpen(u32, Timestamp),
    /// The window has closed.
    #[error("attempt {0} closed at {1}")]
    Closed(u32, Timestamp),
    /// The limit of attempts a day is used up.
    #[error(
        "{0} attempts were started today, as many as may be on one day in UTC; the next from {1} on"
    )]
    Today(u32, Timestamp),
}

/// Seconds of a day in UTC.
const DAY_S: i64 = 86_400;

/// A started attempt of an entrant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Started {
    /// Number, which determines the seeds.
    pub number: u32,
    /// Voided attempt that this spare attempt replaces.
    pub replays: Option<u32>,
    /// An organizer voided the attempt.
    pub voided: bool,
    /// Time of the start.
    pub at: Timestamp,
}

impl Started {
    /// Attempt in whose place this one counts.
    #[must_use]
    pub const fn attempt(self) -> u32 {
        match self.replays {
            Some(attempt) => attempt,
            None => self.number,
        }
    }
}

/// Attempt that is started now: the requested one, or else the first open one that was not started or was voided. A voided
/// attempt is repeated on spare seeds, and on its own seeds when all spare ones are used.
///
/// # Errors
/// Reason why no attempt can be started.
pub fn attempt(
    definition: &Definition,
    wanted: Option<u32>,
    started: &[Started],
    now: Timestamp,
) -> Result<Started, NotNow> {
    let all = definition.attempts.len();
    if let Some(most) = definition.attempts_per_day {
        let day = |at: Timestamp| at.as_second().div_euclid(DAY_S);
        let today = started.iter().filter(|one| !one.voided && day(one.at) == day(now)).count();
        if today >= most as usize {
            let tomorrow = Timestamp::from_second((day(now) + 1) * DAY_S).unwrap_or(Timestamp::MAX);
            return Err(NotNow::Today(most, tomorrow));
        }
    }
    let spare = (1..=definition.spares).map(|spare| definition.number_of_spare(spare));
    let spare = spare.clone().find(|number| started.iter().all(|one| one.number != *number));
    let check = |attempt: u32| {
        let own = definition.attempts.get((attempt as usize).wrapping_sub(1));
        let own = own.ok_or(NotNow::Unknown(all))?;
        let of_it = || started.iter().filter(|one| one.attempt() == attempt);
        if of_it().any(|one| !one.voided) {
            return Err(NotNow::Used(attempt));
        }
        let spare = spare.filter(|_| of_it().next().is_some());
        let number = spare.unwrap_or(attempt);
        let window = definition.window(number).unwrap_or(*own);
        if now >= window.closes_at {
            Err(NotNow::Closed(attempt, window.closes_at))
        } else if now < window.opens_at {
            Err(NotNow::NotOpen(attempt, window.opens_at))
        } else {
            Ok(Started { number, replays: spare.map(|_| attempt), voided: false, at: now })
        }
    };
    if let Some(wanted) = wanted {
        return check(wanted);
    }
    // The first open attempt, or else the error of the one that opens next or closed last.
    let mut later = None;
    let mut missed = None;
    for attempt in (1..).take(all) {
        match check(attempt) {
            Ok(started) => return Ok(started),
            Err(NotNow::NotOpen(attempt, at)) => {
                let first = later.get_or_insert((at, attempt));
                *first = (*first).min((at, attempt));
            }
            Err(why @ NotNow::Closed(..)) => missed = Some(why),
            Err(_) => {}
        }
    }
    match (later, missed) {
        (Some((at, attempt)), _) => Err(NotNow::NotOpen(attempt, at)),
        (None, Some(why)) => Err(why),
        (None, None) => Err(NotNow::UsedUp(all)),
    }
}

/// Part of the board that everybody but organizers sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardView {
    /// No board.
    Nothing,
    /// Ranks and totals of the attempts that are over.
    Totals,
    /// Ranks and totals of the attempts that were over before that time.
    TotalsBefore(Timestamp),
    /// The whole board.
    All,
}

/// Public part of the board.
#[must_use]
pub fn board_view(definition: &Definition, is_revealed: bool, now: Timestamp) -> BoardView {
    match (is_revealed, definition.board, definition.board_freezes_at) {
        (true, ..) => BoardView::All,
        (false, BoardRule::Hidden, _) => BoardView::Nothing,
        (false, BoardRule::Frozen, Some(at)) if at <= now => BoardView::TotalsBefore(at),
        (false, BoardRule::Public | BoardRule::Frozen, _) => BoardView::Totals,
    }
}

#[cfg(test)]
mod tests {
    use super::super::definition::Window;
    use super::super::definition::tests::{at, definition};
    use super::*;

    fn just_before(at: Timestamp) -> Timestamp {
        Timestamp::from_millisecond(at.as_millisecond() - 1).expect("a time")
    }

    fn played(number: u32) -> Started {
        Started { number, replays: None, voided: false, at: at(0) }
    }

    fn voided(number: u32) -> Started {
        Started { voided: true, ..played(number) }
    }

    #[test]
    fn what_happens_at_a_moment_happens_after_it() {
        let definition = definition();
        let phase = |now| Phase::at(&definition, false, false, now).name();
        assert_eq!(phase(just_before(at(10))), "announced");
        assert_eq!(phase(at(10)), "open");
        assert_eq!(phase(just_before(at(100))), "open");
        assert_eq!(phase(at(100)), "closing");
        assert_eq!(Phase::at(&definition, true, false, at(100)), Phase::Closed);
        assert_eq!(Phase::at(&definition, false, true, at(50)), Phase::Cancelled);
        let first = |now| attempt(&definition, Some(1), &[], now);
        assert_eq!(first(just_before(at(10))), Err(NotNow::NotOpen(1, at(10))));
        let is_first = |now| first(now).map(|started| started.number);
        assert_eq!(is_first(at(10)), Ok(1));
        assert_eq!(is_first(just_before(at(100))), Ok(1));
        assert_eq!(first(at(100)), Err(NotNow::Closed(1, at(100))));
    }

    #[test]
    fn the_next_attempt_is_the_first_that_is_open_and_left() {
        let mut definition = definition();
        let window = |from, to| Window { opens_at: at(from), closes_at: at(to) };
        definition.attempts = vec![window(10, 20), window(30, 50), window(40, 60)];
        let next = |used: &[u32], now| {
            let used: Vec<_> = used.iter().map(|&number| played(number)).collect();
            attempt(&definition, None, &used, at(now)).map(|started| started.number)
        };
        assert_eq!(next(&[], 15), Ok(1));
        assert_eq!(next(&[1], 15), Err(NotNow::NotOpen(2, at(30))));
        assert_eq!(next(&[], 25), Err(NotNow::NotOpen(2, at(30))), "the first was missed");
        assert_eq!(next(&[], 45), Ok(2));
        assert_eq!(next(&[2], 45), Ok(3));
        assert_eq!(next(&[2], 70), Err(NotNow::Closed(3, at(60))));
        assert_eq!(next(&[1, 2, 3], 45), Err(NotNow::UsedUp(3)));
        assert_eq!(attempt(&definition, Some(4), &[], at(45)), Err(NotNow::Unknown(3)));
        assert_eq!(attempt(&definition, Some(0), &[], at(45)), Err(NotNow::Unknown(3)));
        assert_eq!(attempt(&definition, Some(2), &[played(2)], at(45)), Err(NotNow::Used(2)));
    }

    #[test]
    fn as_many_attempts_are_started_on_a_day_as_may_be() {
        let mut definition = definition();
        definition.closes_at = at(3 * 24 * 60);
        definition.attempts = vec![Window { opens_at: at(10), closes_at: definition.closes_at }; 3];
        definition.attempts_per_day = Some(1);
        let next = |started: &[_], minute| attempt(&definition, None, started, at(minute));
        let first = Started { at: at(23 * 60), ..played(1) };
        assert_eq!(next(&[first], 24 * 60 - 1), Err(NotNow::Today(1, at(24 * 60))));
        assert_eq!(next(&[first], 24 * 60).map(|started| started.number), Ok(2));
        let voided = Started { voided: true, ..first };
        assert_eq!(next(&[voided], 24 * 60 - 1).map(|started| started.number), Ok(1));
    }

    #[test]
    fn what_was_voided_is_played_again_on_spare_seeds_as_long_as_there_are_some() {
        let mut definition = definition();
        definition.attempts[0].closes_at = at(20);
        let first = |definition: &_, started: &[_]| attempt(definition, Some(1), started, at(30));
        let over = Err(NotNow::Closed(1, at(20)));
        assert_eq!(first(&definition, &[voided(1)]), over, "without spares in its own window");
        definition.spares = 1;
        assert_eq!(first(&definition, &[]), over, "nothing was voided");
        let spare = Started { number: 3, replays: Some(1), voided: false, at: at(30) };
        assert_eq!(first(&definition, &[voided(1)]), Ok(spare));
        assert_eq!(attempt(&definition, None, &[voided(1)], at(30)), Ok(spare));
        assert_eq!(first(&definition, &[voided(1), spare]), Err(NotNow::Used(1)));
        let again = Started { voided: true, ..spare };
        assert_eq!(first(&definition, &[voided(1), again]), over, "the spare seeds are used up");
        assert_eq!(attempt(&definition, Some(3), &[], at(30)), Err(NotNow::Unknown(2)));
    }

    #[test]
    fn a_frozen_board_shows_what_was_over_before() {
        let mut definition = definition();
        let view = |definition: &Definition, now| board_view(definition, false, now);
        assert_eq!(view(&definition, at(50)), BoardView::Totals);
        definition.board = BoardRule::Hidden;
        assert_eq!(view(&definition, at(50)), BoardView::Nothing);
        definition.board = BoardRule::Frozen;
        definition.board_freezes_at = Some(at(80));
        assert_eq!(view(&definition, just_before(at(80))), BoardView::Totals);
        assert_eq!(view(&definition, at(80)), BoardView::TotalsBefore(at(80)));
        assert_eq!(board_view(&definition, true, at(80)), BoardView::All);
    }
}
