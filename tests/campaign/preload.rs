//! Libraries that are loaded into the server by `LD_PRELOAD`, so that the program under test is the unchanged one.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Compiles one of the C files beside this one.
pub(crate) fn library(source: &str, folder: &Path) -> PathBuf {
    let library = folder.join(source).with_extension("so");
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/campaign");
    let compiled = Command::new(compiler)
        .args(["-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-O1", "-o"])
        .arg(&library)
        .arg(sources.join(source))
        .arg("-ldl")
        .status()
        .expect("there is a C compiler, as SQLite needs one too");
    assert!(compiled.success());
    library
}
