//! Measures SwarmBench. The program is not shipped.
//!
//! - [`loadtest`]: a running server under load ([`load`]), beside bare programs.
//! - [`capacity`]: a large database, made by [`fill`], and the server on it.
//! - [`boards`]: the leaderboard of a [`server`] in this process.
//! - [`instructions`]: counts of instructions, compared with the committed ones in `counts.toml`.

#[macro_use]
extern crate swarmbench_terminal;

mod boards;
mod capacity;
mod fill;
mod instructions;
mod load;
mod loadtest;
mod report;
mod server;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use swarmbench_terminal::arguments;

/// The allocator of the server's program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Measures a server of SwarmBench, and the machine beside it.
#[derive(Debug, Parser)]
#[command(name = "swarmbench-bench", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Load test your own server, and compare it with minimal programs on the same machine.
    Loadtest(Box<loadtest::Args>),
    /// Make a large database, and measure a server on it.
    #[command(subcommand)]
    Capacity(capacity::Command),
    /// Measure how fast the leaderboard is read, alone and while runs end.
    Boards(boards::Args),
    /// Count the instructions of what a server does most, and compare them with the committed counts.
    Instructions(instructions::Args),
}

fn main() -> ExitCode {
    let cli: Cli = arguments::parse();
    let result = match cli.command {
        Command::Loadtest(args) => with_runtime(loadtest::run(*args)),
        Command::Capacity(command) => with_runtime(capacity::run(command)),
        Command::Boards(args) => with_runtime(boards::run(args)),
        Command::Instructions(args) => instructions::run(&args),
    };
    swarmbench_terminal::code(result, |_| "")
}

fn with_runtime(work: impl Future<Output = anyhow::Result<()>>) -> anyhow::Result<ExitCode> {
    // The provider of TLS, which reqwest asks for though no connection here has TLS.
    drop(rustls::crypto::ring::default_provider().install_default());
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    let stack = swarmbench::work::STACK_BYTES;
    runtime.thread_stack_size(stack).enable_all().build()?.block_on(work)?;
    Ok(ExitCode::SUCCESS)
}
