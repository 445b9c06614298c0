//! Counts and measurements: requests, durations, and the resources of the server's process.

use std::collections::BTreeMap;
use std::io;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use serde::{Deserialize, Serialize};

use crate::attacks::wire::WireAnswer;

/// Ticks of `/proc/PID/stat` in a second, as Linux shows them to programs.
const TICKS_PER_S: f64 = 100.0;

/// Counts what is sent and what comes back.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    bytes_sent: AtomicU64,
    bytes_received: AtomicU64,
    kinds: Mutex<BTreeMap<String, u64>>,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Counts {
    pub(crate) bytes_sent: u64,
    pub(crate) bytes_received: u64,
    /// Answers of each status, code and limit.
    pub(crate) kinds: BTreeMap<String, u64>,
}

impl Tally {
    pub(crate) fn sent(&self, bytes: usize) {
        self.bytes_sent.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(crate) fn received(&self, bytes: usize) {
        self.bytes_received.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(crate) fn came(&self, result: Result<&WireAnswer, &io::Error>) {
        self.count(&match result {
            Ok(answer) => answer.kind(),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => "no answer in time".to_owned(),
            Err(_) => "broken".to_owned(),
        });
    }

    pub(crate) fn count(&self, kind: &str) {
        let mut kinds = self.kinds.lock().expect("nothing panics while it holds this");
        *kinds.entry(kind.to_owned()).or_default() += 1;
    }

    pub(crate) fn forget(&self) {
        self.bytes_sent.store(0, Ordering::Relaxed);
        self.bytes_received.store(0, Ordering::Relaxed);
        self.kinds.lock().expect("nothing panics while it holds this").clear();
    }

    pub(crate) fn counts(&self) -> Counts {
        Counts {
            bytes_sent: self.bytes_sent.load(Ordering::Relaxed),
            bytes_received: self.bytes_received.load(Ordering::Relaxed),
            kinds: self.kinds.lock().expect("nothing panics while it holds this").clone(),
        }
    }
}

impl Counts {
    pub(crate) fn requests(&self) -> u64 {
        self.kinds.values().sum()
    }

    /// Answers that are errors.
    pub(crate) fn refused(&self) -> u64 {
        let errors = self.kinds.iter().filter(|(kind, _)| kind.starts_with(['4', '5']));
        errors.map(|(_, count)| count).sum()
    }

    /// Answers that refuse for want of room and do not say which limit was met.
    pub(crate) fn nameless(&self) -> Vec<&String> {
        let refusals = ["503 overloaded", "413 too_large", "429 rate_limited"];
        self.kinds.keys().filter(|kind| refusals.contains(&kind.as_str())).collect()
    }

    /// The kinds, the most frequent ones first.
    pub(crate) fn shown(&self) -> String {
        let mut kinds: Vec<_> = self.kinds.iter().collect();
        kinds.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
        let shown: Vec<_> = kinds.iter().map(|(kind, count)| format!("{kind}: {count}")).collect();
        shown.join(", ")
    }
}

/// Seconds on the processors that a process has had.
pub(crate) fn cpu_s(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // The name before it may have spaces; the times of user and system are the 12th and 13th fields after it.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks: f64 = fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum();
    ticks / TICKS_PER_S
}
