//! Players of Transport.

mod push_and_leave;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Transport, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[BuiltIn {
    name: "push-and-leave",
    tasks: &[TaskName::Transport],
    summary: "Lines up behind the block, pushes it free and out, then leaves through the gap.",
    make: push_and_leave::make,
}];
