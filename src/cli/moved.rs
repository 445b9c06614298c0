//! Commands that have moved to another program. Each answers for one release with its new place.

use std::ffi::OsString;
use std::process::ExitCode;

/// Name of a command, and the command that does its work.
const MOVED: [(&str, &str); 2] = [
    ("capacity", "cargo run --release -p swarmbench-bench -- capacity …"),
    ("loadtest", "cargo run --release -p swarmbench-bench -- loadtest …"),
];

/// Exit code of a command line that cannot be parsed, as clap has it.
const USAGE: u8 = 2;

/// Answers a command that has moved.
pub(super) fn answer(command: Option<OsString>) -> Option<ExitCode> {
    let command = command?;
    let (name, successor) = MOVED.iter().find(|(name, _)| command == *name)?;
    note!("`swarmbench {name}` has moved: {successor}");
    Some(ExitCode::from(USAGE))
}
