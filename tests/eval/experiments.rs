//! Experiments from files and command lines.

use std::fs;
use std::path::Path;

use swarmbench_client::eval::experiment::{Experiment, List, ModelEntry, Numbers};
use swarmbench_client::eval::plan::{Plan, Who, no_prices, ranges};
use swarmbench_engine::Seed;

use super::bench::Bench;

fn plan(text: &str) -> Plan {
    let experiment: Experiment = toml::from_str(text).expect("an experiment");
    Plan::of(&experiment, None, &no_prices).expect("a plan")
}

fn problems(text: &str) -> String {
    match toml::from_str::<Experiment>(text) {
        Err(error) => error.to_string(),
        Ok(experiment) => {
            Plan::of(&experiment, None, &no_prices).expect_err("it is wrong").to_string()
        }
    }
}

#[test]
fn lists_multiply_and_what_comes_twice_is_one_run() {
    let plan = plan(
        r#"
        models = ["a", "b"]
        tasks = ["foraging", "Pursuit"]
        seeds = ["0..3", 2, 7]
        [settings]
        temperature = 1
        [[vary]]
        view_size = [3, 5]
        [[vary]]
        num_agents = [8, 12]
        temperature = [0.5, 1.0]
        "#,
    );
    // view 3 and 5, agents 8 twice, 12 at 0.5; 12 agents, view 5 at temperature 1 comes in both groups.
    let told = |run: &swarmbench_client::eval::plan::Planned| {
        let settings = ["view_size", "num_agents", "temperature"];
        format!(
            "{} {}",
            run.name(),
            settings.map(|axis| run.setting(axis).unwrap_or_default()).join(" ")
        )
    };
    let runs: Vec<_> = plan.runs.iter().map(told).collect();
    let of_each = ["3 12 1", "5 12 1", "5 8 0.5", "5 8 1", "5 12 0.5"];
    let expected: Vec<_> =
        ["a", "b"].iter().flat_map(|m| of_each.iter().map(move |s| format!("{m} {s}"))).collect();
    assert_eq!(runs, expected);
    assert_eq!(plan.varied, ["num_agents", "view_size", "temperature"]);
    let suite = &plan.runs[0].suite;
    assert_eq!(
        (&*suite.tasks, &*suite.seeds),
        (&["Pursuit", "Foraging"].map(str::to_owned)[..], &[0, 1, 2, 7].map(Seed::from)[..])
    );
    assert_eq!(suite.name, "Pursuit + Foraging, seeds 0..3, 7, view_size 3");
}

#[test]
fn what_is_a_built_in_suite_is_played_as_one() {
    let standard = plan("models = 'm'\nseeds = [87, 27, 42, 72, 57]\ntasks = 'all'");
    assert_eq!(standard.runs[0].suite.name, "standard");
    let quick = plan("models = 'm'\nseeds = 27\n[settings]\nmax_round = 20");
    assert_eq!(quick.runs[0].suite.name, "quick");
    let own = plan("models = 'm'\n[settings]\nnoise = 0.2\nmax_delay = 4\nmap_size = '12x9'");
    assert_eq!(own.runs[0].suite.name, "all tasks, width 12, height 9, noise 0.2, max_delay 4");
}

#[test]
fn who_plays_what_and_how_tells_runs_apart_and_nothing_else_does() {
    let identity = |text: &str| plan(text).runs[0].identity();
    let base = "models = 'm'\ntasks = 'Foraging'\nseeds = [1, 2]\n";
    let same = identity(base);
    for alike in [
        "name = 'x'\ndescription = 'y'\n",
        "parallel = 9\nrequests = 3\nbudget = 100\n",
        "api_base = 'http://127.0.0.1:1/v1'\napi_key_env = 'KEY'\n",
        "board = 'long'\nplayer_seed = 7\n",
    ] {
        assert_eq!(identity(&format!("{alike}{base}")), same, "{alike}");
    }
    for (from, to) in [
        ("[1, 2]", "[1, 3]"),
        ("Foraging", "Pursuit"),
        ("'m'", "'n'"),
        ("'m'", "{ name = 'm', model = 'n' }"),
        ("'m'", "{ name = 'm', extra = { reasoning_effort = 'low' } }"),
        ("'m'", "{ name = 'm', max_tokens = 100 }"),
        ("'m'", "{ name = 'm', temperature = 0 }"),
        ("'m'", "{ name = 'm', top_p = 0.5 }"),
    ] {
        assert_ne!(identity(&base.replace(from, to)), same, "{to}");
    }
    for settings in
        ["view_size = 3", "rules = 'reference'", "control = 'centralized'", "memory = 2"]
    {
        assert_ne!(identity(&format!("{base}[settings]\n{settings}")), same, "{settings}");
    }
    let experiment: Experiment = toml::from_str(base).expect("an experiment");
    let with_template = Plan::of(&experiment, Some("{{ agent }}"), &no_prices).expect("a plan");
    assert_ne!(with_template.runs[0].identity(), same);
    let player =
        |seed: u64| identity(&format!("players = 'random'\nseeds = 1\nplayer_seed = {seed}"));
    assert_ne!(player(1), player(2));
}

#[test]
fn all_players_play_what_they_know() {
    let all = plan("players = 'all'\nseeds = '0..20'\nboard = 'long'");
    for built_in in swarmbench_players::all() {
        let run = all.runs.iter().find(|run| run.name() == format!("built-in/{}", built_in.name));
        let tasks: Vec<_> = run.expect("it plays").tasks().collect();
        assert_eq!(tasks.len(), built_in.tasks.len(), "{}", built_in.name);
        assert!(built_in.tasks.iter().all(|task| tasks.contains(task)), "{}", built_in.name);
    }
    let own = plan("players = ['default', 'default']\ntasks = ['Foraging', 'Pursuit']");
    assert_eq!(own.runs.len(), 1);
    let Who::Player(player) = &own.runs[0].who else { panic!("a player") };
    assert_eq!(player.by_task.len(), 2);
}

#[test]
fn what_is_wrong_is_said_all_at_once_in_the_words_of_the_server() {
    for (text, expected) in [
        (
            "models = 'm'\n[settings]\nview_size = [4, 3]\nnoise = 2",
            "view_size must be odd and from 3 to 21, is 4",
        ),
        (
            "models = 'm'\n[settings]\nview_size = [4, 3]\nnoise = 2",
            "noise must be a probability from 0 to 1, is 2",
        ),
        (
            "models = 'm'\n[settings]\nnum_agents = 200",
            "num_agents must be from 1 to 25 to fit on this map of Pursuit, is 200",
        ),
        (
            "models = 'm'\n[settings]\ncontrol = 'none'",
            "control must be one of decentralized, centralized",
        ),
        (
            "models = 'm'\nseeds = '0..20'\n[settings]\ntemperature = 11",
            "temperature must be from 0 to 10, is 11",
        ),
        ("models = 'm'\ntasks = 'Chess'", "the tasks are Transport, Pursuit"),
        ("players = 'nobody'", "there is no built-in player \"nobody\""),
        (
            "players = 'map-and-carry'\ntasks = 'all'",
            "no built-in player \"map-and-carry\" plays Pursuit",
        ),
        ("tasks = 'all'", "nobody plays"),
        ("models = 'm'\nseeds = '0..1000'", "at most 1000 games"),
        ("models = 'm'\nseeds = '5..5'", "there is no number in 5..5"),
        ("models = 'm'\nseeds = '0..1000000000'", "a range has at most 1000"),
        ("models = ''", "the name of a model must be 1 to 200 characters"),
        ("models = ['m', \"n\\t\"]", "the name of a model must be 1 to 200 characters"),
        (
            "[[models]]\nname = 'm'\napi_base = 'http://127.0.0.1:1'\n\
             [[models]]\nname = 'm'\napi_base = 'http://127.0.0.1:2'",
            "two models are called \"m\"",
        ),
        (
            "[[models]]\nname = 'm'\n[[models]]\nname = 'm'\nextra = { reasoning_effort = 'low' }",
            "two models are called \"m\"",
        ),
        ("models = 'm'\nseeds = 'x'", "a range of them is like 0..20"),
        ("models = 'm'\nseeds = []", "must not be empty"),
        ("models = 'm'\nview_size = 3", "unknown field `view_size`"),
        ("models = { model = 'm' }", "missing field `name`"),
        ("models = 'm'\n[settings]\nview = 3", "unknown field `view`"),
        ("models = 'm'\n[settings]\nmap_size = '3by4'", "20x15"),
        ("models = 'm'\n[settings]\nnum_agents = 'many'", "a whole number"),
    ] {
        let said = problems(text);
        assert!(said.contains(expected), "{text}: {said}");
    }
}

#[test]
fn seeds_are_told_as_they_are_written() {
    for (seeds, told) in [
        (&[0_u32, 1, 2, 3][..], "0..4"),
        (&[27, 42, 57], "27, 42, 57"),
        (&[1, 2, 5, 7, 8, 9], "1, 2, 5, 7..10"),
        (&[], ""),
    ] {
        let seeds: Vec<Seed> = seeds.iter().copied().map(Seed::from).collect();
        assert_eq!(ranges(&seeds), told);
    }
    assert_eq!("3..=5".parse(), Ok(Numbers { from: 3, last: 5 }));
    assert_eq!(
        "9007199254740991".parse(),
        Ok(Numbers { from: 9_007_199_254_740_991, last: 9_007_199_254_740_991 })
    );
}

#[test]
fn the_command_line_wins_over_a_file() {
    let file: Experiment = toml::from_str(
        "models = ['a', 'b']\nseeds = [1]\napi_base = 'http://127.0.0.1:1'\n[settings]\nnoise = 0.1\n\
         [[vary]]\nview_size = [3, 5]\n[[vary]]\nnum_agents = [8]",
    )
    .expect("an experiment");
    let mut said =
        Experiment { models: Some(List(vec![ModelEntry::named("c")])), ..Experiment::default() };
    said.settings.view_size = vec![7];
    let plan = Plan::of(&file.with(said), None, &no_prices).expect("a plan");
    let told: Vec<_> = (plan.runs.iter())
        .map(|run| {
            ["view_size", "num_agents", "noise"]
                .map(|axis| run.setting(axis).unwrap_or_default())
                .join(" ")
        })
        .collect();
    assert_eq!(told, ["7 12 0.1", "7 8 0.1"]);
    assert!(plan.runs.iter().all(|run| run.name() == "c"));
}

/// The experiments of the paper: how many runs each has, and how many games.
#[test]
fn the_examples_are_those_of_the_paper() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/eval");
    let mut found = Vec::new();
    for file in fs::read_dir(&folder).expect("the examples") {
        let path = file.expect("a file").path();
        if path.extension().is_some_and(|end| end == "toml") {
            let plan = plan(&fs::read_to_string(&path).expect("a file"));
            let games: usize = plan.runs.iter().map(|run| run.suite.plan().len()).sum();
            let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
            found.push((name, plan.runs.len(), games));
        }
    }
    found.sort();
    let told: Vec<_> = (found.iter())
        .filter(|(name, ..)| !name.starts_with("baselines"))
        .map(|(name, runs, games)| (name.as_str(), *runs, *games))
        .collect();
    let expected = [
        // The best player of each task on twenty layouts.
        ("bounds", 1, 100),
        // One model, two games.
        ("cassette", 1, 2),
        // One model; the whole map for a commander, and the standard setting.
        ("centralized", 2, 50),
        // Thirteen models in the standard setting.
        ("main", 13, 325),
        // One model; five lengths of its memory.
        ("memory", 5, 125),
        // Thirteen models with and without noise and delay.
        ("noise", 26, 650),
        // One model in the standard setting, as the public toolkit asks.
        ("parity", 1, 25),
        // One model; temperatures 0, 0.5, 1, 1.5 and top_p 0.3, 0.7, 0.95, 1, where both have 1.
        ("sampling", 7, 175),
        // One model; two sizes of the map by two numbers of agents, three seeds.
        ("scaling", 4, 60),
        // One model; three windows and three numbers of agents, one at a time.
        ("sensitivity", 5, 125),
        // Built-in players only: a curve of thirteen teams, and three more of a set, on three seeds.
        ("teams", 16, 48),
    ];
    assert_eq!(told, expected);
}

#[tokio::test]
async fn a_dry_run_plays_nothing_and_leaves_nothing() {
    let bench = Bench::new();
    let args = ["--model", "m,n", "--seeds", "0..5", "--view-size", "3,5", "--dry-run"];
    let done = bench.eval(&args).await.ends(0);
    // 2 models × 2 windows × 5 tasks × 5 seeds, 12 agents × 100 rounds.
    done.says(&["4 runs, 100 games", "at most 120000 times", "nothing was played"]);
    assert_eq!(fs::read_dir(bench.folder.path()).expect("a folder").count(), 0);
}

#[tokio::test]
async fn errors_come_before_anything_is_played_and_say_what_to_do() {
    let bench = Bench::new();
    bench.write("x.toml", "models = 'm'\nwindow = 3\n");
    bench.write("even.toml", "models = 'm'\ntasks = 'Chess'\nsettings.view_size = 4\n");
    bench.write(
        "keyed.toml",
        "[[models]]\nname = 'm'\napi_base = 'http://127.0.0.1:1/v1'\napi_key_env = 'NOT_THERE'\n",
    );
    for (args, expected) in [
        (&["no-such.toml"][..], &["no-such.toml", "name a file"][..]),
        (&["x.toml"], &["x.toml", "unknown field `window`", "line 2"]),
        (&["even.toml"], &["even.toml:", "view_size must be odd", "there is no task \"Chess\""]),
        (&["keyed.toml"], &["NOT_THERE is not set", "--api-key-env"]),
        (&["--model", "m"], &["where is m?", "--api-base"]),
        (&["--model", "m", "--api-base", "nowhere"], &["no address of a server"]),
        (&["--player", "nobody"], &["there is no built-in player", "map-and-carry"]),
        (&["--task", "Chess", "--player", "random"], &["the tasks are"]),
        (&["--player", "random", "--view-size", "4"], &["view_size must be odd"]),
        (&[], &["--model", "--player"]),
        (
            &["--player", "random", "--server", "http://127.0.0.1:1"],
            &["`swarmbench serve` starts one"],
        ),
        (&["--player", "random", "--output", "no/such/folder.md"], &["no such folder"]),
        (&["--model", "m", "--replay", "no-such.jsonl"], &["no-such.jsonl"]),
    ] {
        bench.eval(args).await.ends(1).says(expected);
    }
    bench.eval(&["--player", "random", "--db", "x", "--server", "y"]).await.ends(2);
    bench.eval(&["--seeds", "1..x"]).await.ends(2).says(&["0..20"]);
    let help = bench.eval(&["--help"]).await.ends(0);
    help.says(&[
        "--api-base",
        "--seeds",
        "Every combination of a model",
        "Exit codes",
        "examples/eval",
    ]);
    assert!(!bench.path("swarmbench.db").exists());
}
