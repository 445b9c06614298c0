//! The program, run as its user runs it.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use tokio::task::spawn_blocking;

pub(crate) async fn swarmbench<S: AsRef<OsStr>>(args: &[S]) -> Output {
    swarmbench_in(Path::new("."), args).await
}

/// Paths in its arguments are relative to `folder`.
pub(crate) async fn swarmbench_in<S: AsRef<OsStr>>(folder: &Path, args: &[S]) -> Output {
    let mut command = Command::new(swarmbench_testkit::program::program());
    command.args(args).current_dir(folder).stdin(Stdio::null());
    spawn_blocking(move || command.output()).await.expect("no panic").expect("the binary runs")
}

/// All that it printed.
pub(crate) fn printed(output: &Output) -> String {
    text(&output.stdout) + &text(&output.stderr)
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
