//! A player's own randomness, which depends on its seat alone.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench_engine::Direction;

use crate::Seat;

/// A generator of random choices.
#[derive(Clone)]
pub(crate) struct Chance(ChaCha8Rng);

impl Chance {
    /// The generator of a seat. Seats that share a seed still differ by their agents.
    pub(crate) fn new(seat: &Seat) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seat.seed);
        rng.set_stream(seat.agent.0.into());
        Self(rng)
    }

    /// One of the items of a list that is not empty, every one equally likely.
    pub(crate) fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(u32::try_from(items.len()).expect("a short list")) as usize]
    }

    /// True once in `n` times on average.
    pub(crate) fn one_in(&mut self, n: u32) -> bool {
        self.below(n) == 0
    }

    /// The four directions in a random order.
    pub(crate) fn order(&mut self) -> [Direction; 4] {
        let mut order = Direction::ALL;
        for last in (1..4_u32).rev() {
            order.swap(last as usize, self.below(last + 1) as usize);
        }
        order
    }

    /// A number in `0..n`, every one equally likely.
    fn below(&mut self, n: u32) -> u32 {
        let excess = u32::MAX - u32::MAX % n;
        loop {
            let value = self.0.next_u32();
            if value < excess {
                return value % n;
            }
        }
    }
}
