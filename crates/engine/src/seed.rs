//! Seeds of layouts.

use std::fmt;

/// The seed of a layout: a whole number from 0 to 2⁵³ − 1, which every JSON reader reads exactly. It converts to all
/// number types that have room for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "u64", into = "u64")
)]
pub struct Seed(u64);

/// A number outside the range of seeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be from 0 to {max}, is {0}", max = Seed::MAX)]
pub struct SeedError(i128);

impl Seed {
    /// The largest seed.
    pub const MAX: Self = Self((1 << 53) - 1);

    /// The number.
    #[must_use]
    pub const fn get(self) -> u64 {
        self.0
    }
}

impl fmt::Display for Seed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl From<u32> for Seed {
    fn from(seed: u32) -> Self {
        Self(seed.into())
    }
}

impl TryFrom<u64> for Seed {
    type Error = SeedError;

    fn try_from(seed: u64) -> Result<Self, SeedError> {
        if seed > Self::MAX.0 { Err(SeedError(seed.into())) } else { Ok(Self(seed)) }
    }
}

impl TryFrom<i64> for Seed {
    type Error = SeedError;

    fn try_from(seed: i64) -> Result<Self, SeedError> {
        u64::try_from(seed).map_err(|_| SeedError(seed.into())).and_then(Self::try_from)
    }
}

impl From<Seed> for u64 {
    fn from(seed: Seed) -> Self {
        seed.0
    }
}

impl From<Seed> for i64 {
    fn from(seed: Seed) -> Self {
        seed.0.cast_signed()
    }
}
