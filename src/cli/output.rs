//! The exit codes of servers.

use std::process::ExitCode;

pub(super) use swarmbench_commands::output::*;

use crate::server::StartError;

/// Exit code of a server that must be restarted (`EX_TEMPFAIL` of sysexits).
const START_AGAIN: u8 = 75;

/// Prints the error of a command, if any, and returns the exit code of the process.
pub(super) fn code(result: anyhow::Result<ExitCode>) -> ExitCode {
    let refused = result.as_ref().err().and_then(|error| error.downcast_ref::<StartError>());
    let again =
        matches!(refused, Some(StartError::Excluded | StartError::Fault(_) | StartError::ClockOff));
    let code = swarmbench_terminal::code(result, hint);
    if again { ExitCode::from(START_AGAIN) } else { code }
}
