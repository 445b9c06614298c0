//! `swarmbench capacity`

mod child;
mod fill;
mod measure;

/// The commands about large databases.
#[derive(Debug, clap::Subcommand)]
pub(super) enum Command {
    /// Make a database of small games that have ended, by default a million.
    Fill(fill::Args),
    /// Measure a server on a database: start, memory, boards, lists, look-ups, export, verification, rebuild.
    Measure(measure::Args),
}

pub(super) async fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Fill(args) => fill::run(args).await,
        Command::Measure(args) => measure::run(args).await,
    }
}
