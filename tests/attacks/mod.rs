//! The attacks: strangers who take memory, time and places from the real server, and an honest entrant beside them
//! whose games must continue. See `docs/develop/attacks.md`.
//!
//! Attacks are played one after the other; the attackers are the test program once more.

mod attackers;
mod bout;
mod honest;
mod measure;
mod table;
mod wire;

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use libtest_mimic::{Failed, Trial};
use swarmbench_testkit::dice;

use self::attackers::{ATTACKERS, ATTACKS, Attack};
use self::bout::{Outcome, Setting};
use crate::PROCESSORS;

/// Duration of each attack, unless `SWARMBENCH_ATTACK_S` says otherwise.
const TIME: Duration = Duration::from_secs(2);

/// Outcomes of the attacks that were played so far.
static ROWS: Mutex<Vec<(&'static str, Outcome, Vec<String>)>> = Mutex::new(Vec::new());

/// True if this process is the attackers.
pub(crate) fn is_attackers() -> bool {
    std::env::var_os(ATTACKERS).is_some()
}

/// Entry point of the attackers' process.
pub(crate) fn attack() {
    attackers::main();
}

/// A test for each attack; elsewhere than on Linux they are ignored, as they read memory and time of the server from /proc.
pub(crate) fn tests() -> Vec<Trial> {
    let trial = |attack: &'static Attack| {
        Trial::test(format!("attacks::{}", attack.name), move || play(attack))
    };
    ATTACKS
        .iter()
        .map(|attack| trial(attack).with_ignored_flag(!cfg!(target_os = "linux")))
        .collect()
}

fn play(attack: &'static Attack) -> Result<(), Failed> {
    let _alone = PROCESSORS.write().unwrap_or_else(PoisonError::into_inner);
    let seconds = dice::number("SWARMBENCH_ATTACK_S");
    let setting = Setting {
        seed: dice::seed("attacks"),
        time: seconds.map_or(TIME, Duration::from_secs),
        is_long: seconds.is_some(),
        memory_mib: dice::number("SWARMBENCH_ATTACK_MEMORY_MIB"),
    };
    // The honest entrant and what looks after it are light; one thread leaves the others to the server.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let outcome = runtime.expect("a runtime").block_on(bout::play(attack, setting));
    let problems = table::problems(attack, &outcome, setting);
    if std::env::args().any(|word| word == "--nocapture") || !problems.is_empty() {
        println!("\n{}: {}", attack.name, attack.what);
        table::tell(&outcome, &problems);
    }
    let result = if problems.is_empty() { Ok(()) } else { Err(problems.join("; ").into()) };
    ROWS.lock().unwrap_or_else(PoisonError::into_inner).push((attack.name, outcome, problems));
    result
}

/// Shows the table of the attacks that were played.
pub(crate) fn show() {
    let rows = ROWS.lock().unwrap_or_else(PoisonError::into_inner);
    if !rows.is_empty() {
        table::show(&rows);
    }
}
