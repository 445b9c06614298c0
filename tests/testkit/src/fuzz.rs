//! Fuzz targets whose inputs follow from the seed of the tests. For long runs, a variable of bolero (`BOLERO_…`)
//! leaves the inputs to bolero or its fuzzer.

use std::fmt::Debug;

use crate::host::SeededEntropy;
use bolero::bolero_engine::input::Bytes;
use bolero::bolero_engine::panic::{forward_panic, set_hook};
use bolero::generator::bolero_generator::driver::Options;
use bolero::{Engine, Test};
use swarmbench_clock::Entropy as _;

use crate::dice;

/// Bytes that an input is generated from.
const INPUT_BYTES_MAX: usize = 8 * 1024;

/// Checks a number of inputs of a generator.
#[macro_export]
macro_rules! check {
    ($inputs:expr, $generator:expr, $check:expr $(,)?) => {
        if $crate::fuzz::is_bolero_asked() {
            bolero::check!().with_iterations($inputs).with_generator($generator).for_each($check);
        } else {
            let engine = $crate::fuzz::Seeded { inputs: $inputs };
            bolero::TestTarget::new(engine).with_generator($generator).for_each($check);
        }
    };
}

pub fn is_bolero_asked() -> bool {
    std::env::vars_os().any(|(name, _)| name.to_string_lossy().starts_with("BOLERO_"))
}

/// Draws inputs from the seed, and shrinks one that fails.
pub struct Seeded {
    pub inputs: usize,
}

impl<T: Test<Value: Debug>> Engine<T> for Seeded {
    type Output = ();

    fn run(self, mut test: T, options: Options) {
        let seed = dice::chosen();
        set_hook();
        for input in 0..self.inputs {
            let bytes = random_input(seed, input as u64);
            forward_panic(false);
            let Err(error) = test.test(&mut Bytes::new(&bytes, &options)) else { continue };
            let shrunk = test.shrink(bytes, None, &options);
            forward_panic(true);
            let failure = shrunk.map_or_else(|| error.to_string(), |failure| failure.to_string());
            panic!("SWARMBENCH_SEED={seed}, input {input}: {failure}");
        }
        forward_panic(true);
    }
}

/// The bytes of an input, often few.
fn random_input(seed: u64, input: u64) -> Vec<u8> {
    let entropy = SeededEntropy::new(seed.rotate_left(32) ^ input);
    let mut length = [0; 4];
    entropy.fill(&mut length);
    let [most, length] = [&length[..2], &length[2..]]
        .map(|bytes| usize::from(u16::from_le_bytes([bytes[0], bytes[1]])));
    let most = 1 + most % INPUT_BYTES_MAX;
    let mut bytes = vec![0; 1 + length % most];
    entropy.fill(&mut bytes);
    bytes
}
