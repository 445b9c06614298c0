//! The attribute `#[needs(…)]`: a test that cannot run where it is compiled is reported as ignored, never as passed.

use std::fs;

use proc_macro::TokenStream;

/// The variable that names the store of the tests: unset for SQLite, `postgres`, or `forwarding` (PostgreSQL, and a
/// server that forwards everything in front of the one that plays). `.ci/postgres` sets it.
const ON: &str = "SWARMBENCH_TEST_ON";

/// Ignores the test below if a requirement is missing:
///
/// - `sqlite`: the tests run on SQLite; the test is about its files;
/// - `postgres`: the tests run on PostgreSQL;
/// - `own_server`: the server that receives requests plays the games itself;
/// - `root`: the test may mount file systems;
/// - `pgbouncer`: `pgbouncer` is installed.
///
/// The attribute stands above `#[test]`, `#[tokio::test]` or `#[rstest]`. The test is recompiled whenever `ON`
/// changes.
#[proc_macro_attribute]
pub fn needs(what: TokenStream, test: TokenStream) -> TokenStream {
    let what = what.to_string();
    let missing = what.split(',').map(str::trim).find(|need| !is_there(need));
    let ignored = missing.map(|need| format!("#[ignore = \"needs {need}\"]")).unwrap_or_default();
    // This makes the compiler note that the result depends on the variable.
    let noted = format!("const _: Option<&str> = option_env!(\"{ON}\");");
    let (attributes, function) = split(test);
    [parsed(&noted), attributes, parsed(&ignored), function].into_iter().collect()
}

fn parsed(text: &str) -> TokenStream {
    text.parse().expect("it is Rust")
}

/// Splits the attributes off an item: `rstest` passes those below it on to its cases.
fn split(item: TokenStream) -> (TokenStream, TokenStream) {
    let (mut attributes, mut rest) = (TokenStream::new(), item.into_iter().peekable());
    while let Some(hash) = rest.next_if(|token| token.to_string() == "#") {
        attributes.extend([hash].into_iter().chain(rest.next()));
    }
    (attributes, rest.collect())
}

fn is_there(need: &str) -> bool {
    let on = std::env::var(ON).unwrap_or_default();
    match need {
        "sqlite" => on.is_empty(),
        "postgres" => !on.is_empty(),
        "own_server" => on != "forwarding",
        "root" => fs::read_to_string("/proc/self/status")
            .is_ok_and(|status| status.lines().any(|line| line.starts_with("Uid:\t0\t"))),
        "pgbouncer" => fs::exists("/usr/sbin/pgbouncer").is_ok_and(|exists| exists),
        _ => panic!("#[needs({need})]: there is no such need"),
    }
}
