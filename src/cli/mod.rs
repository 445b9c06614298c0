//! Command line, with one file per command. Commands that need only the address of a server are in `crates/commands`.

mod backup;
mod board;
mod completions;
mod demo;
mod export;
mod games;
mod hosting;
mod import;
mod key;
mod leaderboard;
mod man;
mod metrics;
mod migrate;
mod moved;
mod no_match;
mod openapi;
mod options;
mod output;
mod serve;
mod sheet;
mod table;
mod verify;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use swarmbench_commands::{audit, clock, competition, eval, healthcheck, mcp, play, replay, worth};
use swarmbench_terminal::arguments;

/// SwarmBench measures over HTTP whether language models can act as a swarm.
#[derive(Debug, Parser)]
#[command(
    name = "swarmbench",
    version,
    about,
    long_about = "A server on which language models play SwarmBench: five tasks in a grid world where each agent \
        sees a small window and talks to its neighbours only.\n\nStart with `swarmbench demo`: it starts a \
        server, plays all five tasks over HTTP, and shows how to join.",
    after_help = "Documentation: README.md, and /docs on a running server."
)]
pub(in crate::cli) struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Start a server with a new database, play the five tasks at the same time, and show the scores.
    Demo(demo::Args),
    /// Run the server.
    Serve(serve::Args),
    /// Create, list and revoke keys.
    Key(key::Args),
    /// Create and manage competitions, and publish their results.
    Competition(Box<competition::Args>),
    /// Show the audit log: the actions of organizers.
    Audit(audit::Args),
    /// Confirm the host's clock when a server doubts its time of day.
    Clock(clock::Args),
    /// Create an episode, or a run of a whole suite, on a server and play it with built-in players.
    Play(play::Args),
    /// Let an assistant play a seat: run an MCP server, with tools for the game, over standard input and output.
    Mcp(mcp::Args),
    /// Evaluate language models or built-in players on tasks, seeds and settings; the same command resumes an evaluation.
    Eval(Box<eval::Args<hosting::Hosting>>),
    /// Replay a journal file, a competition or a whole database, and check every hash, digest, act and score.
    Verify(verify::Args),
    /// Show the leaderboard of a suite.
    Leaderboard(leaderboard::Args),
    /// Show how well models play together.
    CrossPlay(leaderboard::CrossPlayArgs),
    /// Make tables from any games: those of the paper, or others.
    Table(Box<table::Args>),
    /// Rebuild the results that boards show from the journals.
    #[command(subcommand)]
    Board(board::Command),
    /// Show metrics of what the swarm did: in an episode, a run, an imported game or a journal file.
    Metrics(metrics::Args),
    /// Show what could still be scored in each state of a game, and which decisions lost most.
    Worth(worth::Args),
    /// Copy the database of a server, even while the server runs.
    Backup(backup::Args),
    /// Move all data of a stopped server to another database: from SQLite to PostgreSQL, or back.
    Migrate(migrate::Args),
    /// Export episodes in the data format of the public toolkit, or as tables.
    Export(export::Args),
    /// Draw a game: round by round as an animated GIF, as video or as pictures, or some of its moments side by side.
    Replay(replay::Args),
    /// Import games in the data format of the public toolkit.
    Import(import::Args),
    /// Print the OpenAPI document of the server.
    Openapi(openapi::Args),
    /// Fail if a server does not answer.
    Healthcheck(healthcheck::Args),
    /// Print a script that completes commands and options in a shell.
    Completions(completions::Args),
    /// Write manual pages.
    Man(man::Args),
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    if let Some(code) = moved::answer(std::env::args_os()) {
        return code;
    }
    let cli: Cli = arguments::parse();
    let result = match cli.command {
        Command::Eval(args) => return output::code(with_runtime(eval::run(*args))),
        Command::Demo(args) => with_runtime(demo::run(args)),
        Command::Serve(args) => with_runtime(serve::run(args)),
        Command::Key(args) => with_runtime(key::run(args)),
        Command::Competition(args) => with_runtime(competition::run(*args)),
        Command::Audit(args) => with_runtime(audit::run(args)),
        Command::Worth(args) => with_runtime(worth::run(args)),
        Command::Clock(args) => with_runtime(clock::run(args)),
        Command::Play(args) => with_runtime(play::run(args)),
        Command::Mcp(args) => with_runtime(mcp::run(args)),
        Command::Verify(args) => with_runtime(verify::run(args)),
        Command::Leaderboard(args) => with_runtime(leaderboard::run(args)),
        Command::CrossPlay(args) => with_runtime(leaderboard::run_cross_play(args)),
        Command::Table(args) => with_runtime(table::run(*args)),
        Command::Board(command) => with_runtime(board::run(command)),
        Command::Metrics(args) => with_runtime(metrics::run(args)),
        Command::Backup(args) => with_runtime(backup::run(args)),
        Command::Migrate(args) => with_runtime(migrate::run(args)),
        Command::Export(args) => with_runtime(export::run(args)),
        Command::Replay(args) => with_runtime(replay::run(args, crate::pages::single_page)),
        Command::Import(args) => with_runtime(import::run(args)),
        Command::Openapi(args) => openapi::run(&args),
        Command::Healthcheck(args) => with_runtime(healthcheck::run(args)),
        Command::Completions(args) => completions::run(&args, arguments::command::<Cli>()),
        Command::Man(args) => man::run(&args, arguments::command::<Cli>()),
    };
    output::code(result.map(|()| ExitCode::SUCCESS))
}

fn with_runtime<T>(work: impl Future<Output = anyhow::Result<T>>) -> anyhow::Result<T> {
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    runtime.thread_stack_size(crate::work::STACK_BYTES).enable_all().build()?.block_on(work)
}

#[cfg(test)]
mod tests {
    use super::*;
    use arguments::{command, in_words};

    #[test]
    fn all_commands_are_well_formed() {
        command::<Cli>().debug_assert();
    }

    #[test]
    fn errors_name_what_is_expected() {
        for (args, expected) in [
            (
                &["play", "--task", "foraging", "--seed", "x"][..],
                "'--seed <SEED>': must be a whole number\n",
            ),
            (&["audit", "--limit", "-1"], "must be a whole number, 0 or more"),
            (&["audit", "--limit", "99999999999999999999"], "it is out of range"),
            (&["eval", "--noise", "much"], "must be a number"),
        ] {
            let args = [&["swarmbench"], args].concat();
            let error = command::<Cli>().try_get_matches_from(args).expect_err("it is wrong");
            let said = in_words(error).to_string();
            assert!(said.contains(expected), "{said}");
        }
        assert!(
            command::<Cli>().try_get_matches_from(["swarmbench", "demo", "--seed", "-1"]).is_ok()
        );
    }
}
