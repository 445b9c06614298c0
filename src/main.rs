//! The command line of swarmbench; see [`swarmbench::cli`].

/// mimalloc, as the host's allocator took a third of the processor's time with thousands of connections.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    swarmbench::cli::main()
}
