//! The running time: it stops while the process is stopped.

use std::time::Duration;

/// How often the server looks at its clock at least.
pub const BEAT: Duration = Duration::from_millis(50);

/// Where nobody looked for longer than this, the process did not run: it was stopped, or the machine was.
const STOPPED_MIN: Duration = Duration::from_millis(500);

/// For how long the running time stays stopped after that: requests that arrived meanwhile are read first.
const CATCH_UP: Duration = Duration::from_millis(250);

/// The running time, derived from a monotonic time that runs while the process is stopped.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Running {
    /// The monotonic time that is counted.
    seen: Duration,
    /// How much of it was no running time.
    lost: Duration,
}

impl Running {
    /// The running time at a monotonic time; to be asked at least every [`BEAT`].
    pub(super) fn at(&mut self, monotonic: Duration) -> Duration {
        let gap = monotonic.saturating_sub(self.seen);
        if gap > STOPPED_MIN {
            self.lost += gap + CATCH_UP;
            self.seen = monotonic + CATCH_UP;
        }
        self.seen = self.seen.max(monotonic);
        self.seen.saturating_sub(self.lost)
    }

    /// How much time was no running time.
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
    fn time_in_which_nothing_ran_is_no_time() {
        let mut running = Running::default();
        for (monotonic, expected) in [
            (50, 50),
            (100, 100),
            // A busy machine is late now and then.
            (600, 600),
            // Stopped for 6 seconds; then what came in is read first.
            (6_600, 600),
            (6_700, 600),
            (6_850, 600),
            (6_860, 610),
            (6_900, 650),
            // Stopped twice.
            (7_500, 650),
            (7_800, 700),
        ] {
            assert_eq!(running.at(ms(monotonic)), ms(expected), "at {monotonic}");
        }
        assert_eq!(running.lost(), ms(7_800 - 700));
    }
}
