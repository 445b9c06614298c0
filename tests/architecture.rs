//! Rules of ARCHITECTURE.md that no compiler checks: which module of the server may know which, where the large libraries are
//! named, and what the crates are built without.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The modules of the server from the lowest to the highest: each may name only those before it.
const ORDER: &[&str] = &[
    "migrations",
    "pages",
    "host",
    "ids",
    "keys",
    "cluster",
    "fair",
    "telemetry",
    "work",
    "budget",
    "store",
    "episode",
    "measure",
    "appraisal",
    "hosted",
    "run",
    "competitions",
    "standings",
    "dataset",
    "membership",
    "http",
    "server",
    "cli",
    "main",
];

/// Libraries that only some modules may name.
const ONLY_IN: &[(&str, &[&str])] = &[
    ("axum", &["http"]),
    ("hyper", &["http"]),
    ("sqlx", &["store", "migrations"]),
    ("rustix", &["host", "store", "work"]),
    ("parquet", &["dataset"]),
    ("indicatif", &["cli"]),
    // Its one home is `crates/mcp`.
    ("rmcp", &[]),
];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// All Rust files below a folder, or the file itself.
fn files(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_owned()];
    }
    let entries = fs::read_dir(path).expect("a folder of the repository");
    entries
        .flat_map(|entry| files(&entry.expect("an entry").path()))
        .filter(|file| file.extension().is_some_and(|end| end == "rs"))
        .collect()
}

/// The code of a module without its comments and its tests.
fn code(module: &str) -> String {
    let source = root().join("src");
    let file = source.join(format!("{module}.rs"));
    let path = if file.exists() { file } else { source.join(module) };
    let texts = files(&path).into_iter().map(|file| {
        let text = fs::read_to_string(&file).expect("a source file");
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
        lines.collect::<Vec<_>>().join("\n")
    });
    texts.collect::<Vec<_>>().join("\n")
}

/// The first segments of all paths that begin with `prefix`.
fn named_after<'a>(code: &'a str, prefix: &str) -> BTreeSet<&'a str> {
    code.match_indices(prefix)
        .filter(|(at, _)| !code[..*at].ends_with(|c: char| c.is_alphanumeric() || c == '_'))
        .map(|(at, _)| {
            let rest = &code[at + prefix.len()..];
            rest.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap_or_default()
        })
        .collect()
}

#[test]
fn modules_name_only_those_below_them() {
    let mut wrong = Vec::new();
    for (place, &module) in ORDER.iter().enumerate() {
        let code = code(module);
        let prefix = if module == "main" { "swarmbench::" } else { "crate::" };
        for other in named_after(&code, prefix) {
            if ORDER.contains(&other) && !ORDER[..=place].contains(&other) {
                wrong.push(format!("{module} names {other}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_module_has_its_place() {
    let known: BTreeSet<_> = ORDER.iter().map(|module| (*module).to_owned()).collect();
    let found: BTreeSet<_> = fs::read_dir(root().join("src"))
        .expect("the sources")
        .map(|entry| {
            let path = entry.expect("an entry").path();
            path.file_stem().expect("a name").to_string_lossy().into_owned()
        })
        .filter(|name| name != "lib")
        .collect();
    assert_eq!(found, known);
}

/// A load test measures the server from outside: it would share what is slow in it.
#[test]
fn a_load_test_shares_no_code_with_the_server() {
    for file in files(&root().join("crates/bench/src/load")) {
        let text = fs::read_to_string(&file).expect("a source file");
        assert!(!text.contains("swarmbench::"), "{} names the server", file.display());
    }
}

#[test]
fn libraries_stay_where_they_belong() {
    let mut wrong = Vec::new();
    for &(name, homes) in ONLY_IN {
        for &module in ORDER {
            if homes.contains(&module) {
                continue;
            }
            let code = code(module);
            for form in [format!("{name}::"), format!("use {name};")] {
                let whole = code.match_indices(&form).any(|(at, _)| {
                    !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':')
                });
                if whole {
                    wrong.push(format!("{module} names {name}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn handlers_hold_no_sql_and_no_rules() {
    let code = code("http");
    for banned in ["SELECT ", "INSERT ", "UPDATE ", ".step(", ".step_with("] {
        assert!(!code.contains(banned), "http holds {banned:?}");
    }
    for module in ["http", "server", "cli"] {
        let code = self::code(module);
        assert!(!code.contains("World::new("), "{module} lays out worlds");
    }
}

/// Machines that decide under time are driven by the simulation as they are, so they must not look at a clock themselves.
#[test]
fn machines_have_no_clock() {
    let mut machines = files(&root().join("src/cluster"));
    machines
        .extend(["lockstep.rs", "seating.rs"].map(|file| root().join("src/episode").join(file)));
    assert!(machines.len() > 5, "{machines:?}");
    for file in machines {
        let text = fs::read_to_string(&file).expect("a source file");
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        for form in [
            "Instant::now",
            "SystemTime",
            "elapsed()",
            "tokio",
            "sqlx",
            "axum",
            "hyper",
            "\nstatic ",
            "spawn(",
        ] {
            assert!(!code.contains(form), "{} has {form}", file.display());
        }
    }
}

/// Names that tell the seed of a game, or make a permit for it: each handler that has one of these is here, and asks for a permit.
const TELLS_SEEDS: &[(&str, &[&str])] = &[
    ("of_creator(", &["seeds.rs", "episodes/create.rs", "episodes/fork.rs"]),
    ("of_built_in(", &["seeds.rs", "runs/mod.rs"]),
    (".seed()", &["episodes/mod.rs"]),
    ("planned.seed", &["runs/mod.rs"]),
    ("SuiteView::of(", &["runs/mod.rs", "runs/suites.rs"]),
    ("Export::select(", &["exports/download.rs"]),
    ("store.journals(", &["competitions/export.rs"]),
    (
        "JournalReader::",
        &["episodes/journal.rs", "episodes/verification.rs", "competitions/export.rs"],
    ),
];

#[test]
fn seeds_are_told_in_few_places() {
    let http = root().join("src/http");
    let mut found = BTreeSet::new();
    for file in files(&http) {
        let text = fs::read_to_string(&file).expect("a source file");
        let name = file.strip_prefix(&http).expect("a file of it").to_string_lossy().into_owned();
        let named = TELLS_SEEDS.iter().filter(|(what, _)| text.contains(what));
        found.extend(named.map(|(what, _)| (*what, name.clone())));
    }
    let homes =
        TELLS_SEEDS.iter().flat_map(|(what, homes)| homes.iter().map(move |home| (what, home)));
    let expected: BTreeSet<_> = homes.map(|(what, home)| (*what, (*home).to_owned())).collect();
    assert_eq!(found, expected);
}

/// All crates on which one of the workspace depends.
fn tree(package: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--edges", "normal", "--prefix", "none", "--format", "{p}"])
        .args(["--package", package])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).expect("UTF-8");
    text.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

#[test]
fn the_engine_is_pure() {
    let engine = tree("swarmbench-engine");
    assert!(engine.contains("petgraph") && engine.contains("good_lp"), "{engine:?}");
    let banned = ["tokio", "axum", "hyper", "sqlx", "tracing", "time", "jiff", "chrono"];
    for name in banned {
        assert!(!engine.contains(name), "the engine depends on {name}");
    }
    for package in ["crates/engine/src", "crates/players/src"] {
        for file in files(&root().join(package)) {
            let text = fs::read_to_string(&file).expect("a source file");
            for banned in ["std::fs", "std::env", "std::net", "std::time", "std::thread", "HashMap"]
            {
                assert!(!text.contains(banned), "{} names {banned}", file.display());
            }
        }
    }
}

#[test]
fn no_crate_is_published() {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--offline", "--no-deps", "--format-version", "1"])
        .current_dir(root())
        .output()
        .expect("cargo runs");
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let packages = metadata["packages"].as_array().expect("the crates of the workspace");
    let published: Vec<_> = (packages.iter())
        .filter(|package| package["publish"] != serde_json::json!([]))
        .map(|package| &package["name"])
        .collect();
    assert!(packages.len() > 10 && published.is_empty(), "{published:?}");
}

#[test]
fn players_know_the_engine_alone() {
    let engine = tree("swarmbench-engine");
    // dyn-clone has no access to anything: it clones boxes.
    let own = ["swarmbench-players", "swarmbench-engine", "dyn-clone"];
    let beyond: Vec<_> = (tree("swarmbench-players").into_iter())
        .filter(|name| !engine.contains(name) && !own.contains(&name.as_str()))
        .collect();
    assert!(beyond.is_empty(), "{beyond:?}");
}

#[test]
fn a_client_is_built_without_a_server() {
    let client = tree("swarmbench-client");
    for server in ["swarmbench", "sqlx", "axum", "minijinja", "utoipa"] {
        assert!(!client.contains(server), "the client depends on {server}");
    }
    let commands = tree("swarmbench-commands");
    for server in ["swarmbench", "sqlx", "axum", "utoipa"] {
        assert!(!commands.contains(server), "commands depend on {server}");
    }
}

/// Names of limits in a text: literals that end as limits do. Metrics have a prefix.
fn limits_named_in(code: &str) -> BTreeSet<&str> {
    let is_name = |text: &&str| text.chars().all(|c| c.is_ascii_lowercase() || c == '_');
    let is_limit = |name: &&str| ["_max", "_min", "_percent"].iter().any(|end| name.ends_with(end));
    let names = code.split('"').filter(is_name).filter(is_limit);
    names.filter(|name| !name.starts_with("swarmbench_")).collect()
}

#[test]
fn every_limit_that_is_named_is_in_the_table() {
    let limits = swarmbench::http::limits::Limits::default().table();
    let known: BTreeSet<&str> = limits.iter().map(|(name, _)| *name).collect();
    assert_eq!(known.len(), limits.len(), "each has one row");
    let protocol = fs::read_to_string(root().join("docs/protocol.md")).expect("the contract");
    let mut wrong: Vec<String> = (known.iter())
        .filter(|name| !protocol.contains(&format!("`{name}`")))
        .map(|name| format!("docs/protocol.md has no `{name}`"))
        .collect();
    for module in ["fair", "work", "store", "episode", "hosted", "run", "http"] {
        let code = code(module);
        for name in limits_named_in(&code) {
            if !known.contains(name) {
                wrong.push(format!("{module} names {name}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The names in calls of these macros.
fn names_of_metrics(code: &str) -> BTreeSet<&str> {
    let calls = ["counter!(", "gauge!(", "histogram!("];
    let named = calls.iter().flat_map(|call| code.split(call).skip(1));
    named.filter_map(|call| call.trim_start().strip_prefix('"')?.split('"').next()).collect()
}

#[test]
fn every_metric_is_described_and_documented() {
    let telemetry = code("telemetry");
    let (_, described) = telemetry.split_once("const COUNTERS").expect("the first table");
    let documents = ["operations.md", "cluster.md"]
        .map(|page| fs::read_to_string(root().join("docs/operate").join(page)).expect("a page"));
    let all = ORDER.iter().map(|module| code(module)).collect::<Vec<_>>().concat();
    let names = names_of_metrics(&all);
    assert!(names.len() > 40, "{names:?}");
    for name in names {
        assert!(described.contains(&format!("\"{name}\"")), "{name} has no description");
        assert!(documents.iter().any(|page| page.contains(name)), "{name} is in no document");
    }
}

/// Whatever the program prints passes `crates/terminal`, which escapes what a terminal would obey; logs are written by `telemetry`.
#[test]
fn printing_has_one_place() {
    let mut wrong = Vec::new();
    for file in ["src", "crates/commands/src"].iter().flat_map(|of| files(&root().join(of))) {
        if file.ends_with("src/telemetry.rs") {
            continue;
        }
        let text = fs::read_to_string(&file).expect("a source file");
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        for form in [
            "println!",
            "print!",
            "dbg!",
            "stdout()",
            "stderr()",
            "MultiProgress::new",
            "ProgressBar::new",
        ] {
            if code.contains(form) {
                wrong.push(format!("{} has {form}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
