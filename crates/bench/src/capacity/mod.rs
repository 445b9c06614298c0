//! `swarmbench-bench capacity`

mod child;
mod fill;
mod measure;

#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Make a database of small games that have ended, a million by default.
    Fill(fill::Args),
    /// Measure a server on a database: its start, memory, boards, lists, look-ups, export, verification and rebuild.
    Measure(measure::Args),
}

pub(super) async fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Fill(args) => fill::run(args).await,
        Command::Measure(args) => measure::run(args).await,
    }
}
