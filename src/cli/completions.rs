//! `swarmbench completions`

use clap_complete::Shell;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  \
    swarmbench completions bash > ~/.local/share/bash-completion/completions/swarmbench\n  \
    swarmbench completions zsh > ~/.zfunc/_swarmbench\n  \
    swarmbench completions fish > ~/.config/fish/completions/swarmbench.fish")]
pub(super) struct Args {
    /// The shell.
    shell: Shell,
}

#[expect(clippy::unnecessary_wraps, reason = "all commands have the same shape")]
pub(super) fn run(args: &Args, mut command: clap::Command) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "swarmbench", &mut script);
    super::output::data(&String::from_utf8_lossy(&script));
    Ok(())
}
