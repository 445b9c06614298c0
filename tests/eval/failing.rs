//! Answers that do not count: how they are shown, and when a run stops for them.

use std::sync::Arc;

use serde_json::{Value, json};
use swarmbench_client::eval::conduct::{Conductor, News};
use swarmbench_client::eval::experiment::Experiment;
use swarmbench_client::eval::plan::{Plan, no_prices};
use swarmbench_client::llm::{Allowance, ApiKey, Model, Settings};
use swarmbench_clock::SystemClock;
use tokio_util::sync::CancellationToken;

use super::bench::Bench;
use crate::llm::endpoint::{Endpoint, Reply, completion};

/// Two games of 2 agents and 40 rounds: 160 answers.
const GAME: [&str; 8] =
    ["--task", "Synchronization", "--num-agents", "2", "--max-round", "40", "--seeds", "1..3"];

fn args<'a>(endpoint: &'a Endpoint, more: &[&'a str]) -> Vec<&'a str> {
    [&["--model", "m", "--api-base", endpoint.base()], &GAME[..], more].concat()
}

#[tokio::test]
async fn a_run_whose_answers_mostly_fail_in_one_way_stops_and_resumes() {
    let bench = Bench::new();
    let cut = json!({ "content": "I think that" });
    let endpoint = Endpoint::start(move |_, _| Reply::json(200, &completion(&cut, "length"))).await;
    let done = bench.eval(&args(&endpoint, &[])).await.ends(3);
    done.says(&[
        "answers of m,",
        "were cut at the token limit: raise --max-tokens",
        "\"I think that\"",
        "--stop-share off",
        "run the same command again to resume",
    ]);
    // Those that were asked when the verdict came are used.
    let asked = endpoint.seen().len();
    assert!((96..=128).contains(&asked), "{asked}");
    let done = bench.eval(&args(&endpoint, &["--stop-share", "off"])).await.ends(0);
    done.says(&["resumes", "m: 160 of 160 answers did not count: 160 cut at the token limit"]);
    assert_eq!(endpoint.seen().len(), 160, "nothing was asked twice");
}

#[tokio::test]
async fn every_reason_is_counted_apart() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|number, seen| {
        let (message, finish) = match number % 10 {
            0 => (json!({ "refusal": "No." }), "stop"),
            1 => (json!({ "content": "" }), "content_filter"),
            2 => (json!({ "content": "I" }), "length"),
            3 => (json!({ "tool_calls": [{}] }), "tool_calls"),
            4 => (json!({ "reasoning": "Hm." }), "stop"),
            5 => (json!({ "content": "" }), "stop"),
            6 => (json!({ "content": "up!" }), "stop"),
            7 => (json!({ "content": "ACTION: FLY" }), "stop"),
            // The limit was reached, and the answer is there.
            8 => (json!({ "content": "ACTION: STAY\nMSG: I wi" }), "length"),
            _ => (json!({ "content": "ACTION: STAY" }), "stop"),
        };
        assert!(!seen.prompt().is_empty());
        Reply::json(200, &completion(&message, finish))
    })
    .await;
    let one_by_one = ["--requests", "1", "--price", "1,2"];
    let done =
        bench.eval(&args(&endpoint, &[&one_by_one[..], &["--format", "json"]].concat())).await;
    let done = done.ends(0);
    let report: Value = serde_json::from_str(&done.out).expect("JSON");
    let row = &report["rows"][0];
    let expected = json!({
        "refusal": 16, "content_filter": 16, "truncated": 16, "tool_call": 16, "reasoning_only": 16, "empty": 16,
        "no_marker": 16, "unknown_action": 16,
    });
    assert_eq!(row["acts"]["failures"], expected);
    assert_eq!(row["acts"]["invalid"], 128);
    // 160 answers of 10 and 5 tokens.
    assert_eq!(row["cost"], (1600.0 + 2.0 * 800.0) / 1e6);
    let again = args(&endpoint, &["--format", "csv", "--price", "1,2"]);
    let done = bench.eval(&again).await.ends(0);
    let mut lines = done.out.lines();
    let columns: Vec<_> = lines.next().expect("columns").split(',').collect();
    let cells: Vec<_> = lines.next().expect("a row").split(',').collect();
    // The list of seeds has a comma; what is looked for stands behind it.
    let from_end = |name: &str| columns.iter().rev().position(|column| *column == name);
    let cell = |name: &str| cells[cells.len() - 1 - from_end(name).expect(name)];
    assert_eq!((cell("run_failed_refusal"), cell("run_failed_rejected")), ("16", "0"));
    assert_eq!(cell("run_cost"), "0.0032");
    bench.eval(&args(&endpoint, &[])).await.ends(0).says(&["m: 128 of 160 answers did not count:"]);
    // Each act says why.
    let serving = bench.serve().await;
    let run = serving.run().await;
    for (_, act) in serving.acts(&run).await {
        assert_eq!(act["failure"].is_null(), act["valid"] == true, "{act}");
    }
    serving.stop().await;
}

#[tokio::test]
async fn a_rejected_question_blocks_no_run() {
    let bench = Bench::new();
    let endpoint = Endpoint::start(|_, seen| {
        if seen.prompt().contains("You are Agent_1") {
            Reply::error(400, "This prompt is longer than the context.")
        } else {
            Reply::says("ACTION: STAY")
        }
    })
    .await;
    let few = args(&endpoint, &["--max-round", "4"]);
    let few: Vec<_> = few.into_iter().filter(|arg| *arg != "40").collect();
    let at = few.iter().position(|arg| *arg == "--max-round").expect("it is there");
    let few = [&few[..at], &few[at + 1..]].concat();
    let done = bench.eval(&few).await.ends(0);
    done.says(&["m: 8 of 16 answers did not count: 8 rejected by the endpoint"]);
}

#[tokio::test]
async fn a_dry_run_estimates_tokens_and_cost() {
    let bench = Bench::new();
    let game = ["--model", "m", "--task", "Foraging", "--seeds", "0..2", "--dry-run"];
    let done = bench.eval(&game).await.ends(0);
    done.says(&["tokens in", "estimate:", "4 bytes a token", "nothing was played"]);
    let done = bench.eval(&[&game[..], &["--price", "2,10"]].concat()).await.ends(0);
    // 2400 questions of 100 tokens an answer, and prompts of 500 to 2500 tokens.
    let cost = done.out.split("which cost ").nth(1).and_then(|rest| rest.split_whitespace().next());
    let cost: f64 = cost.expect("a cost").parse().expect("a number");
    assert!((2.4 + 2.4..2.4 + 12.0).contains(&cost), "{cost}");
    bench.eval(&[&game[..], &["--price", "cheap"]].concat()).await.ends(2).says(&["0.15,0.6"]);
    bench.eval(&[&game[..], &["--stop-share", "2"]].concat()).await.ends(2).says(&["or off"]);
}

/// Otherwise what failed in it would be told as the trouble of the runs that go on.
#[tokio::test]
async fn a_run_that_stops_is_no_longer_in_progress() {
    let bench = Bench::new();
    let serving = bench.serve().await;
    let endpoint = Endpoint::start(|_, _| Reply::error(404, "no such model")).await;
    let text =
        "tasks = 'Foraging'\nseeds = 1\nmodels = 'm'\n[settings]\nnum_agents = 1\nmax_round = 1";
    let plan = Plan::of(&Experiment::from_toml(text).expect("an experiment"), None, &no_prices);
    let settings = Settings::new("m", endpoint.base(), ApiKey::new("NO_KEY", None));
    let allowance = Allowance::new(1, None, Arc::new(SystemClock));
    let model = Model::new(settings, &allowance, None).expect("good settings");
    let conductor = Conductor {
        client: &serving.client,
        parallel: 1,
        again: false,
        repeats: &[],
        stop_share: 1.0,
        stop: &CancellationToken::new(),
    };
    let mut told = Vec::new();
    let watch = &mut |number, news: News<'_>| told.push((number, matches!(news, News::Stopped)));
    let plan = plan.expect("a plan");
    let failures = conductor.conduct_all(&plan, &[vec![model]], 1, watch).await;
    assert_eq!((failures.len(), told.last()), (1, Some(&(0, true))));
    serving.stop().await;
}
