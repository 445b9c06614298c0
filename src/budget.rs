//! The memory that all worlds and all answers may take together: `memory_bytes_max`.
//!
//! Whoever makes something large reserves its bytes first and gives them back by dropping the [`Reservation`].
//! What is small always passes, so that running games finish however full the server is.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What has at most so many bytes passes also where the budget is used up.
pub const SMALL_BYTES: usize = 64 * 1024;

/// The budget is used up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "all worlds and answers together may take {most} bytes of memory, and no more of that is free"
)]
pub struct NoMemory {
    /// The limit, in bytes.
    pub most: usize,
}

/// Bytes that may be used, and how many are.
#[derive(Debug)]
pub struct Budget {
    used: AtomicUsize,
    most: usize,
}

impl Budget {
    /// A budget of `most` bytes.
    #[must_use]
    pub fn new(most: usize) -> Arc<Self> {
        Arc::new(Self { used: AtomicUsize::new(0), most })
    }

    /// A budget that is never used up.
    #[must_use]
    pub fn unlimited() -> Arc<Self> {
        Self::new(usize::MAX)
    }

    /// Reserves bytes where they are free.
    ///
    /// # Errors
    /// Where they are not.
    pub fn reserve(self: &Arc<Self>, bytes: usize) -> Result<Reservation, NoMemory> {
        self.reserve_below(self.most, bytes)
    }

    /// Reserves bytes where no more than `most` are used then: for what must leave some to others.
    ///
    /// # Errors
    /// Where more would be used.
    pub fn reserve_below(
        self: &Arc<Self>,
        most: usize,
        bytes: usize,
    ) -> Result<Reservation, NoMemory> {
        let add = |used: usize| used.checked_add(bytes).filter(|sum| *sum <= most);
        match self.used.try_update(Ordering::AcqRel, Ordering::Acquire, add) {
            Ok(_) => Ok(Reservation { budget: Arc::clone(self), bytes: AtomicUsize::new(bytes) }),
            Err(_) => Err(NoMemory { most: self.most }),
        }
    }

    /// Reserves bytes, free or not.
    #[must_use]
    pub fn take(self: &Arc<Self>, bytes: usize) -> Reservation {
        self.used.fetch_add(bytes, Ordering::AcqRel);
        Reservation { budget: Arc::clone(self), bytes: AtomicUsize::new(bytes) }
    }

    /// How many bytes are reserved.
    #[must_use]
    pub fn used(&self) -> usize {
        self.used.load(Ordering::Acquire)
    }

    /// The limit, in bytes.
    #[must_use]
    pub const fn most(&self) -> usize {
        self.most
    }
}

/// Bytes that are reserved until this is dropped.
#[derive(Debug)]
pub struct Reservation {
    budget: Arc<Budget>,
    bytes: AtomicUsize,
}

impl Reservation {
    /// From now on it is so many bytes, free or not: what exists already cannot be refused.
    pub fn resize(&self, bytes: usize) {
        let before = self.bytes.swap(bytes, Ordering::AcqRel);
        if bytes >= before {
            self.budget.used.fetch_add(bytes - before, Ordering::AcqRel);
        } else {
            self.budget.used.fetch_sub(before - bytes, Ordering::AcqRel);
        }
    }

    /// How many bytes it is.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes.load(Ordering::Acquire)
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.budget.used.fetch_sub(*self.bytes.get_mut(), Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_reserved_is_free_again_when_it_is_dropped() {
        let budget = Budget::new(100);
        let first = budget.reserve(60).expect("free");
        assert_eq!(budget.reserve(41).err(), Some(NoMemory { most: 100 }));
        let second = budget.reserve(40).expect("free");
        drop(first);
        assert_eq!(budget.used(), 40);
        second.resize(90);
        assert_eq!((budget.used(), second.bytes()), (90, 90));
        second.resize(10);
        let beyond = budget.take(200);
        assert_eq!(budget.used(), 210);
        assert_eq!(budget.reserve(1).err(), Some(NoMemory { most: 100 }));
        drop((second, beyond));
        assert_eq!(budget.used(), 0);
    }

    #[test]
    fn a_sum_that_is_too_large_for_a_number_does_not_fit() {
        let budget = Budget::new(usize::MAX - 1);
        let _some = budget.reserve(10).expect("free");
        assert!(budget.reserve(usize::MAX).is_err());
    }
}
