//! Randomness: the generator of the layouts, and named streams for everything else.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

/// The Mersenne Twister as `CPython`'s `random.Random(seed)` uses it, so that a seed gives the same layout as in the
/// public toolkit (rules: *Random numbers*).
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct LayoutRng {
    twister: Box<rand_mt::Mt>,
    drawn: u64,
}

impl LayoutRng {
    /// Seeds by the 32-bit little-endian limbs of `seed`, as `CPython` does.
    #[must_use]
    pub(crate) fn new(seed: u64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "the limbs of the seed are meant")]
        let limbs = [seed as u32, (seed >> 32) as u32];
        let key = if limbs[1] == 0 { &limbs[..1] } else { &limbs[..] };
        Self { twister: Box::new(rand_mt::Mt::new_with_key(key.iter().copied())), drawn: 0 }
    }

    /// The next `bits` (1 to 32) random bits.
    pub(crate) fn getrandbits(&mut self, bits: u32) -> u32 {
        self.drawn += 1;
        self.twister.next_u32() >> (32 - bits)
    }

    /// A number in `0..n`; draws even if `n` is 1.
    pub(crate) fn below(&mut self, n: u32) -> u32 {
        let bits = u32::BITS - n.leading_zeros();
        loop {
            let value = self.getrandbits(bits);
            if value < n {
                return value;
            }
        }
    }

    /// A number in `low..=high`.
    pub(crate) fn randint(&mut self, low: i32, high: i32) -> i32 {
        low + i32::try_from(self.below((high - low + 1).unsigned_abs())).expect("a map is small")
    }

    /// Draws one of the two values.
    pub(crate) fn choice(&mut self, of: [i32; 2]) -> i32 {
        of[self.below(2) as usize]
    }

    /// Number of 32-bit outputs drawn so far; with the seed this is the generator's whole state.
    #[must_use]
    pub(crate) const fn draw_count(&self) -> u64 {
        self.drawn
    }
}

/// A generator for one named purpose, independent of every other and of the order of calls.
pub(crate) struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream that belongs to (seed, purpose, key).
    pub(crate) fn new(seed: u64, purpose: &str, key: &[u32]) -> Self {
        let mut hash = Sha256::new();
        hash.update(seed.to_le_bytes());
        hash.update(purpose.as_bytes());
        for part in key {
            hash.update(part.to_le_bytes());
        }
        Self(ChaCha8Rng::from_seed(hash.finalize().into()))
    }

    /// True with the given probability.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        #[expect(clippy::cast_precision_loss, reason = "53 bits fit a double exactly")]
        let unit = (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        unit < probability
    }

    /// A number in `0..n`, every one equally likely.
    pub(crate) fn below(&mut self, n: u32) -> u32 {
        let excess = u32::MAX - u32::MAX % n;
        loop {
            let value = self.0.next_u32();
            if value < excess {
                return value % n;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The outputs are those that the rules name for seed 42, and those of `CPython` for other key lengths.
    #[test]
    fn matches_cpython() {
        let mut rng = LayoutRng::new(42);
        let first = [rng.getrandbits(32), rng.getrandbits(32), rng.getrandbits(32)];
        assert_eq!(first, [2_746_317_213, 478_163_327, 107_420_369]);
        assert_eq!(LayoutRng::new(0).getrandbits(32), 3_626_764_237);
        assert_eq!(LayoutRng::new((1 << 53) - 1).getrandbits(32), EXPECT_LARGE);
        let mut rng = LayoutRng::new(7);
        let draws: Vec<i32> = (0..8).map(|_| rng.randint(1, 8)).collect();
        assert_eq!(draws, EXPECT_RANDINT);
    }

    const EXPECT_LARGE: u32 = 404_802_386;
    const EXPECT_RANDINT: [i32; 8] = [6, 3, 7, 1, 2, 2, 6, 1];

    #[test]
    fn streams_differ_by_every_part_of_their_key() {
        let first = |seed, purpose: &str, key: &[u32]| Stream::new(seed, purpose, key).0.next_u64();
        let base = first(1, "noise", &[1, 2, 3]);
        assert_eq!(base, first(1, "noise", &[1, 2, 3]));
        assert_ne!(base, first(2, "noise", &[1, 2, 3]));
        assert_ne!(base, first(1, "delay", &[1, 2, 3]));
        assert_ne!(base, first(1, "noise", &[1, 3, 2]));
    }
}
