//! Sealed seeds of 16 random bytes each. The commitment to all of them is published when the competition is created, the bytes
//! themselves only after its end.

use sha2::{Digest, Sha256};

use swarmbench_clock::Entropy;
use swarmbench_engine::Seed;

/// Bytes of the salt, which is hashed before the seeds so that the commitment reveals nothing about them.
pub const SALT_BYTES: usize = 32;

/// Bytes of a seed.
pub const SEED_BYTES: usize = 16;

/// A sealed seed.
pub type SealedSeed = [u8; SEED_BYTES];

/// Secret of a competition. `Debug` does not show it.
#[derive(Clone, PartialEq, Eq)]
pub struct Sealed {
    /// Salt, hashed before the seeds.
    pub salt: [u8; SALT_BYTES],
    /// All seeds, attempt by attempt.
    pub seeds: Vec<SealedSeed>,
}

impl std::fmt::Debug for Sealed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Sealed(…)")
    }
}

impl Sealed {
    /// Draws a salt and this number of seeds.
    #[must_use]
    pub fn draw(seeds: usize, entropy: &dyn Entropy) -> Self {
        let mut salt = [0; SALT_BYTES];
        entropy.fill(&mut salt);
        let draw = || {
            let mut seed = [0; SEED_BYTES];
            entropy.fill(&mut seed);
            seed
        };
        let seeds = (0..seeds).map(|_| draw()).collect();
        Self { salt, seeds }
    }

    /// SHA-256 of the salt and then the seeds, in order.
    #[must_use]
    pub fn commitment(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        hash.update(self.salt);
        for seed in &self.seeds {
            hash.update(seed);
        }
        hash.finalize().into()
    }

    /// Sealed seeds of an attempt, counted from 1, if each attempt has `each` of them.
    pub fn of_attempt(&self, attempt: u32, each: u32) -> impl Iterator<Item = &SealedSeed> + Clone {
        let (attempt, each) = (attempt as usize, each as usize);
        self.seeds.iter().skip(attempt.saturating_sub(1) * each).take(each)
    }
}

/// Seed of the rules for a sealed seed: the first 8 bytes (big-endian) of the SHA-256 of the sealed seed and the name of the
/// task, shifted right by 11 to the 53 bits that the rules take. The name keeps the seed of one task from revealing that of
/// another; it is empty where all tasks are played on the same seeds.
#[must_use]
pub fn rules_seed(seed: &SealedSeed, task: &str) -> Seed {
    let hash = Sha256::new().chain_update(seed).chain_update(task).finalize();
    let first = hash.first_chunk::<8>().expect("a hash has 32 bytes");
    (u64::from_be_bytes(*first) >> 11).try_into().expect("53 bits")
}

#[cfg(test)]
mod tests {
    use super::*;
    use swarmbench_testkit::host::SeededEntropy;

    /// Expected values are from another program: `python3 -c "import hashlib; h = hashlib.sha256(bytes(range(16)));
    /// print(int.from_bytes(h.digest()[:8], 'big') >> 11)"`, and likewise for the commitment.
    #[test]
    fn seeds_and_commitment_are_those_of_another_program() {
        let seed: SealedSeed = std::array::from_fn(|byte| u8::try_from(byte).expect("small"));
        assert_eq!(rules_seed(&seed, "").get(), 6_694_623_049_201_638);
        assert_eq!(rules_seed(&[0xff; 16], "").get(), 3_193_895_295_640_266);
        assert_eq!(rules_seed(&seed, "Foraging").get(), 2_251_721_069_523_158);
        let sealed = Sealed { salt: [7; 32], seeds: vec![seed, [0xff; 16]] };
        let commitment = data_encoding::HEXLOWER.encode(&sealed.commitment());
        assert_eq!(commitment, "5e0c35c4e99c1aa7f8185d588a66fa04ec590e975eacfdf5ebf3a26a66d86a5f");
        assert_eq!(format!("{sealed:?}"), "Sealed(…)");
    }

    #[test]
    fn every_attempt_has_seeds_of_its_own() {
        let sealed = Sealed::draw(6, &SeededEntropy::new(3));
        let all: std::collections::BTreeSet<_> = sealed.seeds.iter().collect();
        assert_eq!(all.len(), 6);
        let attempts: Vec<_> = (1..=3).flat_map(|attempt| sealed.of_attempt(attempt, 2)).collect();
        assert_eq!(attempts, sealed.seeds.iter().collect::<Vec<_>>());
        assert_eq!(sealed.of_attempt(4, 2).count(), 0);
    }
}
