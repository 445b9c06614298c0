//! Commands that have moved to another program. They are named for one release.

use std::ffi::OsString;
use std::process::ExitCode;

/// The first words of a command, and the command that has taken its place.
const MOVED: [(&str, &str); 10] = [
    ("capacity", "cargo run --release -p swarmbench-bench -- capacity …"),
    ("loadtest", "cargo run --release -p swarmbench-bench -- loadtest …"),
    ("figure trends", "swarmseat-analysis trends GAMES --out FILE"),
    (
        "figure dynamics",
        "swarmseat-analysis dynamics GAMES --where task=TASK --where model=MODEL --out FILE",
    ),
    ("figure sensitivity", "swarmseat-analysis sensitivity GAMES --where model=MODEL --out FILE"),
    ("figure board", "swarmseat-analysis scores GAMES --out FILE"),
    ("figure correlations", "swarmseat-analysis correlations GAMES --where task=TASK --out FILE"),
    ("figure frame", "swarmbench replay GAME --moments ROUND,… --picture FILE"),
    ("figure", "swarmseat-analysis --help"),
    ("correlations", "swarmseat-analysis correlations GAMES"),
];

/// Exit code of a command line that is wrong.
const WRONG_USAGE: u8 = 2;

/// Says where the command of this process has moved, if it has.
pub(super) fn answer(arguments: impl IntoIterator<Item = OsString>) -> Option<ExitCode> {
    let words: Vec<String> =
        arguments.into_iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    let is_said = |(command, _): &&(&str, &str)| {
        let mut said = words.iter().map(String::as_str);
        command.split(' ').all(|word| said.next() == Some(word))
    };
    let (command, successor) = MOVED.iter().find(is_said)?;
    let place = if successor.starts_with("swarmseat") { " to Python" } else { "" };
    note!("`swarmbench {command}` has moved{place}: {successor}");
    Some(ExitCode::from(WRONG_USAGE))
}
