//! Built-in players, played over HTTP.

use std::collections::BTreeMap;

use serde_json::Value;
use swarmbench_boards::result::mean_and_deviation;
use swarmbench_client::eval::conduct::{Conductor, Found, News};
use swarmbench_client::eval::experiment::Experiment;
use swarmbench_client::eval::plan::{Plan, Who, no_prices};
use swarmbench_client::eval::stop_reason::StopReason;
use swarmbench_engine::{Settings, TaskName};
use swarmbench_players::game;
use tokio_util::sync::CancellationToken;

use super::bench::Bench;

/// The score of a game in the process.
fn score(name: &str, task: TaskName, settings: &Settings) -> f64 {
    let player = swarmbench_players::find(name, task).expect("it plays it");
    game::play(player, settings, 1).expect("settings that can be played").0
}

#[tokio::test]
async fn the_same_games_come_to_the_same_in_process_and_over_http() {
    let bench = Bench::new();
    let args = ["--player", "all", "--seeds", "3,4", "--max-round", "15", "--num-agents", "5"];
    let board = bench
        .board(&[&args[..], &["--map-size", "9", "--noise", "0.3", "--verify"]].concat())
        .await;
    let mut compared = 0;
    for row in board["rows"].as_array().expect("rows") {
        assert_eq!(row["verified"], true);
        let name = row["model"].as_str().and_then(|name| name.strip_prefix("built-in/"));
        for cell in row["tasks"].as_array().expect("tasks") {
            let task = TaskName::parse(cell["task"].as_str().expect("a task")).expect("a task");
            let settings = |seed| Settings {
                num_agents: 5,
                width: 9,
                height: 9,
                max_round: 15,
                noise: 0.3,
                ..Settings::standard(task, seed)
            };
            let scores = [3, 4].map(|seed| score(name.expect("a name"), task, &settings(seed)));
            let (mean, deviation) = mean_and_deviation(&scores).expect("scores");
            let least = scores[0].min(scores[1]);
            let told = (&cell["mean"], &cell["deviation"], &cell["least"], &cell["games"]);
            assert_eq!(
                told,
                (&mean.into(), &deviation.into(), &least.into(), &2.into()),
                "{name:?} {task:?}"
            );
            compared += 1;
        }
    }
    let expected: usize = swarmbench_players::all().map(|player| player.tasks.len()).sum();
    assert_eq!(compared, expected);
}

/// A player that joins a game in the middle knows what was seen before.
#[tokio::test]
async fn a_run_that_is_gone_on_with_comes_to_the_same() {
    let bench = Bench::new();
    let serving = bench.serve().await;
    let text = "players = 'default'\nseeds = [27, 42]\n[settings]\nmax_round = 40";
    let experiment: Experiment = toml::from_str(text).expect("an experiment");
    let plan = Plan::of(&experiment, None, &no_prices).expect("a plan");
    let planned = &plan.runs[0];
    let mut ids = Vec::new();
    let mut found = Vec::new();
    let mut stops = 0;
    let played = loop {
        let stop = CancellationToken::new();
        let conductor = Conductor {
            client: &serving.client,
            parallel: 3,
            again: false,
            repeats: &[],
            stop: &stop,
            stop_share: 1.0,
        };
        let mut acts = 0;
        let ended = conductor
            .conduct(planned, Vec::new(), &mut |news| match news {
                News::Begins(_, how, run) => {
                    ids.push(run.run.id.clone());
                    found.push(how.clone());
                }
                // In the middle of rounds of parallel games.
                News::Acted(..) => {
                    acts += 1;
                    if acts == 700 {
                        stop.cancel();
                    }
                }
                News::Looked(_)
                | News::Late(_)
                | News::Polled(_)
                | News::Ends(..)
                | News::Stopped => {}
            })
            .await;
        match ended {
            Ok(run) => break run,
            Err(StopReason::Requested) => stops += 1,
            Err(other) => panic!("{other}"),
        }
    };
    assert!(stops >= 3, "{stops}");
    assert!(ids.iter().all(|id| *id == ids[0]), "{ids:?}");
    assert_eq!(found[0], Found::New(None));
    // A client stopped at the last act may not learn any more that it was the last.
    let between = &found[1..found.len() - 1];
    assert!(between.iter().all(|how| *how == Found::Resumed), "{found:?}");
    let Who::Player(player) = &planned.who else { panic!("a player") };
    for game in &played.games {
        let task = TaskName::parse(&game.task).expect("a task");
        let settings = Settings {
            max_round: 40,
            ..Settings::standard(task, game.seed.expect("a seed").get())
        };
        assert_eq!(game.score, Some(score(player.by_task[&task], task, &settings)), "{game:?}");
    }
    serving.stop().await;
}

#[tokio::test]
async fn a_server_that_runs_is_joined_and_a_database_in_use_is_left_alone() {
    let bench = Bench::new();
    let serving = bench.serve().await;
    let args = ["--player", "random", "--task", "Foraging", "--seeds", "1", "--max-round", "3"];
    let joined = [&args[..], &["--server", &serving.base]].concat();
    bench.eval(&joined).await.ends(0).says(&["is new"]);
    bench.eval(&joined).await.ends(0).says(&["was played before"]);
    let other = [&joined[..], &["--noise", "0.5"]].concat();
    bench.eval(&other).await.ends(0).says(&["is new"]);
    assert_eq!(serving.runs().await.len(), 2);
    bench.eval(&args).await.ends(1).says(&["swarmbench.db is in use", "--server URL"]);
    serving.stop().await;
    // The same, now that its server is stopped.
    bench.eval(&args).await.ends(0).says(&["was played before"]);
    bench.eval(&[&args[..], &["--again"]].concat()).await.ends(0).says(&["is new"]);
    let by_task: BTreeMap<String, Value> =
        [("Foraging".to_owned(), "random".into())].into_iter().collect();
    let serving = bench.serve().await;
    let runs = serving.runs().await;
    assert_eq!(runs.len(), 3);
    assert_eq!(runs[0].run.agent_meta.values()["eval"]["players"], serde_json::json!(by_task));
    serving.stop().await;
}
