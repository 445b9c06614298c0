//! Suites and their names.

use swarmbench_engine::{Seed, Settings, TaskName};
use swarmbench_protocol::suite::Suite;

use super::settings::standard;

/// Characters of a suite's name.
const NAME_CHARS_MAX: usize = 100;

/// The suite of these tasks and seeds. Its name follows from its content, so that runs of the same suite are on the
/// same board. A built-in suite keeps its name.
pub(super) fn named(mut suite: Suite, tasks: &[TaskName], seeds: &[Seed]) -> Suite {
    suite.tasks = tasks.iter().map(|task| task.name().to_owned()).collect();
    suite.seeds = seeds.to_vec();
    for built_in in Suite::BUILT_IN {
        built_in.clone_into(&mut suite.name);
        if Suite::built_in(built_in, &suite.rules).as_ref() == Some(&suite) {
            return suite;
        }
    }
    let usual = standard();
    let has_all = tasks.len() >= TaskName::ALL.len();
    let mut parts = vec![if has_all { "all tasks".to_owned() } else { suite.tasks.join(" + ") }];
    if suite.seeds != usual.seeds {
        parts.push(format!("seeds {}", ranges(seeds)));
    }
    let (is, was) = (Settings::from(&suite.settings), Settings::from(&usual.settings));
    let mut names = Settings::NAMES.to_vec();
    // Existing names of suites have the size of the map before the number of agents.
    names.sort_by_key(|name| !["control", "width", "height"].contains(name));
    let changed = names.into_iter().filter(|name| is.get(name) != was.get(name));
    parts.extend(changed.filter_map(|name| Some(format!("{name} {}", is.get(name)?))));
    suite.name = parts.join(", ");
    if suite.name.chars().count() > NAME_CHARS_MAX {
        suite.name = suite.name.chars().take(NAME_CHARS_MAX - 1).chain(['…']).collect();
    }
    suite
}

/// Seeds in short, consecutive ones as a range.
#[must_use]
pub fn ranges(seeds: &[Seed]) -> String {
    let mut parts: Vec<(u64, u64)> = Vec::new();
    for seed in seeds.iter().map(|seed| seed.get()) {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == seed => *last = seed,
            _ => parts.push((seed, seed)),
        }
    }
    let texts = parts.iter().map(|&(from, last)| match last - from {
        0 => from.to_string(),
        1 => format!("{from}, {last}"),
        _ => format!("{from}..{}", last + 1),
    });
    texts.collect::<Vec<_>>().join(", ")
}
