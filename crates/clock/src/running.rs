//! The running time: it stops while the process is stopped.

use std::time::Duration;

/// The longest interval between two reads of the server's clock.
pub const BEAT: Duration = Duration::from_millis(50);

/// Interval without a read of the clock beyond which the process or the machine counts as stopped.
const STOPPED_MIN: Duration = Duration::from_millis(500);

/// Time for which the running time stays stopped after that, until requests that arrived meanwhile are read.
const CATCH_UP: Duration = Duration::from_millis(250);

/// The running time, derived from a monotonic time that also runs while the process is stopped.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Running {
    /// The monotonic time up to which the running time is known.
    seen: Duration,
    /// Total time for which the running time did not advance.
    lost: Duration,
}

impl Running {
    /// The running time at a monotonic time; to be called at least every [`BEAT`].
    pub(super) fn at(&mut self, monotonic: Duration) -> Duration {
        let gap = monotonic.saturating_sub(self.seen);
        if gap > STOPPED_MIN {
            self.lost += gap + CATCH_UP;
            self.seen = monotonic + CATCH_UP;
        }
        self.seen = self.seen.max(monotonic);
        self.seen.saturating_sub(self.lost)
    }

    /// Total time for which the running time did not advance.
    pub(super) const fn lost(&self) -> Duration {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn the_running_time_stops_with_the_process() {
        let mut running = Running::default();
        for (monotonic, expected) in [
            (50, 50),
            (100, 100),
            // A busy machine is sometimes late.
            (600, 600),
            // A stop for 6 seconds, and until requests are read.
            (6_600, 600),
            (6_700, 600),
            (6_850, 600),
            (6_860, 610),
            (6_900, 650),
            // A second stop.
            (7_500, 650),
            (7_800, 700),
        ] {
            assert_eq!(running.at(ms(monotonic)), ms(expected), "at {monotonic}");
        }
        assert_eq!(running.lost(), ms(7_800 - 700));
    }
}
