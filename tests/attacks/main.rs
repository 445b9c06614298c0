//! The attacks: strangers who take memory, time and places from the real server, and an honest entrant beside them
//! whose games must continue. See `docs/develop/attacks.md`.
//!
//! It is a program of its own and not a list of tests, because attacks must not be played at the same time, and because
//! it starts itself again as the attackers.

mod attackers;
mod bout;
#[expect(dead_code, reason = "the campaign shares it and uses other parts")]
#[path = "../support/dice.rs"]
mod dice;
mod honest;
mod measure;
#[expect(dead_code, reason = "other tests use other parts")]
#[path = "../support/postgres.rs"]
mod postgres;
#[expect(dead_code, reason = "the campaign shares it and uses other parts")]
#[path = "../support/server.rs"]
mod server;
mod table;
mod wire;

use std::process::ExitCode;
use std::time::Duration;

use attackers::{ATTACKERS, ATTACKS, Attack};
use bout::Setting;

/// How long each attack is played, where `SWARMBENCH_ATTACK_S` does not say otherwise.
const TIME: Duration = Duration::from_secs(2);

fn main() -> ExitCode {
    if std::env::var_os(ATTACKERS).is_some() {
        attackers::main();
        return ExitCode::SUCCESS;
    }
    let asked: Vec<_> = std::env::args().skip(1).collect();
    let chosen = chosen(&asked);
    if asked.iter().any(|word| word == "--list") {
        for attack in chosen {
            println!("{}: test", attack.name);
        }
        return ExitCode::SUCCESS;
    }
    if chosen.is_empty() {
        return ExitCode::SUCCESS;
    }
    if !cfg!(target_os = "linux") {
        dice::tell("attacks: NOT RUN, as they read the server's memory and time from /proc");
        return ExitCode::SUCCESS;
    }
    let seconds = dice::number("SWARMBENCH_ATTACK_S");
    let setting = Setting {
        seed: dice::seed("attacks"),
        time: seconds.map_or(TIME, Duration::from_secs),
        is_long: seconds.is_some(),
        memory_mib: dice::number("SWARMBENCH_ATTACK_MEMORY_MIB"),
    };
    // The honest entrant and what looks after it are light; one thread leaves the others to the server.
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.expect("a runtime");
    let shows_all = asked.iter().any(|word| word == "--nocapture");
    let mut rows = Vec::new();
    for attack in chosen {
        println!("\n{}: {}", attack.name, attack.what);
        let outcome = runtime.block_on(bout::play(attack, setting));
        let problems = table::problems(attack, &outcome, setting);
        if shows_all || !problems.is_empty() {
            table::tell(&outcome, &problems);
        }
        rows.push((attack.name, outcome, problems));
    }
    table::show(&rows);
    let failed: Vec<_> = rows.iter().filter(|(.., problems)| !problems.is_empty()).collect();
    if failed.is_empty() {
        return ExitCode::SUCCESS;
    }
    let names: Vec<_> = failed.iter().map(|(name, ..)| *name).collect();
    dice::tell(&format!(
        "{} of {} attacks do harm: {}; SWARMBENCH_SEED={} draws the same again",
        failed.len(),
        rows.len(),
        names.join(", "),
        setting.seed
    ));
    ExitCode::FAILURE
}

/// The attacks whose names are asked for, as `cargo test` filters tests; all where none is.
fn chosen(asked: &[String]) -> Vec<&'static Attack> {
    let is_exact = asked.iter().any(|word| word == "--exact");
    if asked.iter().any(|word| word == "--ignored") {
        return Vec::new();
    }
    // A number belongs to an option of the usual harness, such as --test-threads.
    let is_name = |word: &&String| !word.starts_with('-') && word.parse::<u64>().is_err();
    let names: Vec<_> = asked.iter().filter(is_name).collect();
    let fits = |attack: &&Attack| {
        names.is_empty()
            || names.iter().any(|name| {
                if is_exact { attack.name == **name } else { attack.name.contains(name.as_str()) }
            })
    };
    ATTACKS.iter().filter(fits).collect()
}
