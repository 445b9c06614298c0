//! Times for which games stand still after a fault.

use std::collections::BTreeMap;
use std::time::Duration;

use swarmbench_testkit::dice::number;

/// Fault of the server that played, or of the database.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Killed,
    TwoKilled,
    AllKilled,
    Graceful,
    Rolling,
    StoppedShortly,
    StoppedForLong,
    CutOffShortly,
    CutOffForLong,
    SlowDatabase,
    Apart,
    SessionsEnded,
    /// From the return of the database on.
    DatabaseBack,
    /// From the return of the standby on.
    StandbyBack,
}

impl Kind {
    const fn name(self) -> &'static str {
        match self {
            Self::Killed => "killed",
            Self::TwoKilled => "two of three killed",
            Self::AllKilled => "all killed, and started again",
            Self::Graceful => "SIGTERM",
            Self::Rolling => "rolling restart",
            Self::StoppedShortly => "stopped for 3 s",
            Self::StoppedForLong => "stopped for longer than 6 s",
            Self::CutOffShortly => "cut off from the database for 3 s",
            Self::CutOffForLong => "cut off from it for longer than 6 s",
            Self::SlowDatabase => "slow database",
            Self::Apart => "cut off from other servers",
            Self::SessionsEnded => "sessions ended by the database",
            Self::DatabaseBack => "database away, after its return",
            Self::StandbyBack => "standby away, after its return",
        }
    }

    /// Limit for 99 of 100 games, where one is promised.
    const fn goal(self) -> Option<Duration> {
        match self {
            Self::Killed | Self::TwoKilled => Some(Duration::from_secs(2)),
            Self::Graceful | Self::Rolling => Some(Duration::from_secs(1)),
            Self::StoppedShortly
            | Self::StoppedForLong
            | Self::CutOffShortly
            | Self::CutOffForLong
            | Self::SlowDatabase
            | Self::Apart => Some(Duration::from_secs(10)),
            Self::AllKilled | Self::SessionsEnded | Self::DatabaseBack | Self::StandbyBack => None,
        }
    }
}

/// From a fault to the next receipt of a game, by kind of fault.
#[derive(Default)]
pub(crate) struct Times(BTreeMap<Kind, Vec<Duration>>);

impl Times {
    pub(crate) fn note(&mut self, kind: Kind, taken: Duration) {
        self.0.entry(kind).or_default().push(taken);
    }

    /// The time that so many of 100 games have kept.
    fn percentile(times: &[Duration], percent: usize) -> Duration {
        let mut sorted = times.to_vec();
        sorted.sort_unstable();
        sorted[(sorted.len() * percent).div_ceil(100).max(1) - 1]
    }

    pub(crate) fn show(&self) {
        println!(
            "\n{:<40}{:>7}{:>9}{:>9}{:>9}",
            "until the next receipt, ms", "games", "p50", "p99", "max"
        );
        for (kind, times) in &self.0 {
            let at = |percent| Self::percentile(times, percent).as_millis();
            let (name, count) = (kind.name(), times.len());
            println!("{name:<40}{count:>7}{:>9}{:>9}{:>9}", at(50), at(99), at(100));
        }
    }

    /// Compares the times with the goals, where the machine has nothing else to do: `SWARMBENCH_CLUSTER_GOALS=1`.
    pub(crate) fn check(&self) {
        if number("SWARMBENCH_CLUSTER_GOALS").unwrap_or(0) == 0 {
            return;
        }
        for (kind, times) in &self.0 {
            let found = Self::percentile(times, 99);
            let is_reached = kind.goal().is_none_or(|goal| found <= goal);
            assert!(is_reached, "{}: 99 of 100 games take {found:?} at most", kind.name());
        }
    }
}
