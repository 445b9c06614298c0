//! Faults of the real program: the campaign (kills, stops, disks and databases that fail, a cluster) and the attacks.
//! The tests take minutes, so `cargo test` leaves them out, and `.ci/full` names them: `cargo test --test faults`.
//!
//! The program has a main of its own, as it starts itself again as the attackers, and as some tests are ignored by what
//! the host has.

mod attacks;
mod campaign;

use std::process::ExitCode;
use std::sync::RwLock;

use libtest_mimic::Arguments;

/// The processors: an attack has them for itself, tests of the campaign share them.
static PROCESSORS: RwLock<()> = RwLock::new(());

fn main() -> ExitCode {
    if attacks::is_attackers() {
        attacks::attack();
        return ExitCode::SUCCESS;
    }
    let mut tests = campaign::tests();
    tests.extend(attacks::tests());
    let conclusion = libtest_mimic::run(&Arguments::from_args(), tests);
    attacks::show();
    conclusion.exit_code()
}
