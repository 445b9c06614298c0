//! Draws from a seed, and the settings and output of tests that draw.

use std::io::Write;
use std::time::Duration;

use crate::host::SeededEntropy;
use sha2::{Digest, Sha256};
use swarmbench_clock::Entropy;

/// The default seed of all tests that draw, fixed so that a passed test repeats its draws. `.ci/full` chooses others.
const SEED: u64 = 20_260_301;

/// The seed of this run: `SWARMBENCH_SEED`, or the default. It is shown even if output is captured.
pub fn seed(test: &str) -> u64 {
    let seed = chosen();
    tell(&format!("{test}: SWARMBENCH_SEED={seed}"));
    seed
}

/// The seed of this run, without showing it, for messages about a failure.
pub fn chosen() -> u64 {
    number("SWARMBENCH_SEED").unwrap_or(SEED)
}

/// A whole number from the environment.
pub fn number(name: &str) -> Option<u64> {
    let text = std::env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name} must be a whole number, is {text:?}")))
}

/// Writes a line to the standard error past the test harness, which would capture it.
pub fn tell(line: &str) {
    writeln!(std::io::stderr(), "{line}").expect("the standard error takes text");
}

/// Draws that follow from a seed and their purpose.
pub struct Dice(SeededEntropy);

impl Dice {
    pub fn of(seed: u64, purpose: &str) -> Self {
        let hash: [u8; 32] = Sha256::digest(format!("{seed} {purpose}")).into();
        Self(SeededEntropy::new(u64::from_le_bytes(hash[..8].try_into().expect("8 bytes"))))
    }

    pub fn below(&self, n: usize) -> usize {
        let mut bytes = [0; 4];
        self.0.fill(&mut bytes);
        u32::from_le_bytes(bytes) as usize % n
    }

    pub fn one_in(&self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub fn pick<'a, T>(&self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }

    /// A duration below `most`.
    pub fn time(&self, most: Duration) -> Duration {
        let micros = usize::try_from(most.as_micros()).expect("a short time").max(1);
        Duration::from_micros(self.below(micros) as u64)
    }
}
