//! The command line of swarmbench; see [`swarmbench::cli`].

fn main() -> std::process::ExitCode {
    swarmbench::cli::main()
}
