//! What is open at which time. All times are the server's; what happens at a moment happens after it: at `opens_at`
//! it is open, at `closes_at` it is closed.

use jiff::Timestamp;

use super::definition::{BoardRule, Definition};

swarmbench_engine::named! {
    /// The phase of a competition.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Phase {
        /// It has not opened.
        Announced = "announced",
        /// Attempts may be played.
        Open = "open",
        /// No round begins any more; the last ones still run.
        Closing = "closing",
        /// All games have ended, and everything is open to all.
        Closed = "closed",
    }
}

impl Phase {
    /// The phase at a time.
    #[must_use]
    pub fn at(definition: &Definition, is_revealed: bool, now: Timestamp) -> Self {
        if is_revealed {
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

/// Why an attempt cannot be started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotNow {
    /// There is no such attempt.
    #[error("there are {0} attempts, counted from 1")]
    Unknown(usize),
    /// It was started before.
    #[error("attempt {0} was started before")]
    Used(u32),
    /// All attempts were started.
    #[error("all {0} attempts were started")]
    UsedUp(usize),
    /// Its window has not opened.
    #[error("attempt {0} opens at {1}")]
    NotOpen(u32, Timestamp),
    /// Its window has closed.
    #[error("attempt {0} closed at {1}")]
    Closed(u32, Timestamp),
}

/// The attempt that is started now: the requested one, or else the first open one that was not started. `used` are the
/// attempts that were started and not voided.
///
/// # Errors
/// Why none is.
pub fn attempt(
    definition: &Definition,
    wanted: Option<u32>,
    used: &[u32],
    now: Timestamp,
) -> Result<u32, NotNow> {
    let all = definition.attempts.len();
    let check = |attempt: u32| {
        let window = definition.window(attempt).ok_or(NotNow::Unknown(all))?;
        if used.contains(&attempt) {
            Err(NotNow::Used(attempt))
        } else if now >= window.closes_at {
            Err(NotNow::Closed(attempt, window.closes_at))
        } else if now < window.opens_at {
            Err(NotNow::NotOpen(attempt, window.opens_at))
        } else {
            Ok(attempt)
        }
    };
    if let Some(wanted) = wanted {
        return check(wanted);
    }
    // The first open one, or else the error of the one that opens next, or of the one that closed last.
    let mut later = None;
    let mut missed = None;
    for attempt in (1..).take(all) {
        match check(attempt) {
            Ok(attempt) => return Ok(attempt),
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

/// What everybody but organizers sees of the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardView {
    /// Nothing.
    Nothing,
    /// Ranks and totals of the attempts that are over.
    Totals,
    /// Ranks and totals of the attempts that were over before that time.
    TotalsBefore(Timestamp),
    /// All of it.
    All,
}

/// What of the board is open to all.
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

    #[test]
    fn what_happens_at_a_moment_happens_after_it() {
        let definition = definition();
        let phase = |now| Phase::at(&definition, false, now).name();
        assert_eq!(phase(just_before(at(10))), "announced");
        assert_eq!(phase(at(10)), "open");
        assert_eq!(phase(just_before(at(100))), "open");
        assert_eq!(phase(at(100)), "closing");
        assert_eq!(Phase::at(&definition, true, at(100)), Phase::Closed);
        let first = |now| attempt(&definition, Some(1), &[], now);
        assert_eq!(first(just_before(at(10))), Err(NotNow::NotOpen(1, at(10))));
        assert_eq!(first(at(10)), Ok(1));
        assert_eq!(first(just_before(at(100))), Ok(1));
        assert_eq!(first(at(100)), Err(NotNow::Closed(1, at(100))));
    }

    #[test]
    fn the_next_attempt_is_the_first_that_is_open_and_left() {
        let mut definition = definition();
        let window = |from, to| Window { opens_at: at(from), closes_at: at(to) };
        definition.attempts = vec![window(10, 20), window(30, 50), window(40, 60)];
        let next = |used: &[u32], now| attempt(&definition, None, used, at(now));
        assert_eq!(next(&[], 15), Ok(1));
        assert_eq!(next(&[1], 15), Err(NotNow::NotOpen(2, at(30))));
        assert_eq!(next(&[], 25), Err(NotNow::NotOpen(2, at(30))), "the first was missed");
        assert_eq!(next(&[], 45), Ok(2));
        assert_eq!(next(&[2], 45), Ok(3));
        assert_eq!(next(&[2], 70), Err(NotNow::Closed(3, at(60))));
        assert_eq!(next(&[1, 2, 3], 45), Err(NotNow::UsedUp(3)));
        assert_eq!(attempt(&definition, Some(4), &[], at(45)), Err(NotNow::Unknown(3)));
        assert_eq!(attempt(&definition, Some(0), &[], at(45)), Err(NotNow::Unknown(3)));
        assert_eq!(attempt(&definition, Some(2), &[2], at(45)), Err(NotNow::Used(2)));
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
