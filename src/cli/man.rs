//! `swarmbench man`

use std::path::PathBuf;

use anyhow::Context;

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  swarmbench man ~/.local/share/man/man1 && man swarmbench-eval")]
pub(super) struct Args {
    /// The folder to write the pages into, one page per command. It is created if it does not exist.
    folder: PathBuf,
}

pub(super) fn run(args: &Args, command: clap::Command) -> anyhow::Result<()> {
    let folder = &args.folder;
    std::fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
    clap_mangen::generate_to(command, folder).with_context(|| format!("{}", folder.display()))
}
