//! After any interruption the same command resumes.

use std::collections::BTreeMap;
use std::process::{Command, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};

use super::bench::{Bench, Running};
use crate::llm::endpoint::{Endpoint, Reply};

const GAME: [&str; 8] =
    ["--task", "Synchronization", "--num-agents", "2", "--max-round", "4", "--seeds", "1..5"];

fn args<'a>(endpoint: &'a Endpoint, more: &[&'a str]) -> Vec<&'a str> {
    [&["--model", "m", "--api-base", endpoint.base()], &GAME[..], more].concat()
}

/// An endpoint that answers so often, and then leaves everybody waiting.
async fn answers(count: usize, text: &'static str) -> Endpoint {
    Endpoint::start(move |number, _| {
        let reply = Reply::says(text);
        if number < count { reply } else { reply.held_until(1) }
    })
    .await
}

/// Acts by their answers: those before the interruption and those after it.
async fn acts_by_answer(bench: &Bench) -> (usize, usize) {
    let serving = bench.serve().await;
    let run = serving.run().await;
    assert_eq!(run.run.status, "finished");
    let mut episodes: Vec<_> = run.games.iter().filter_map(|game| game.episode.clone()).collect();
    episodes.sort();
    episodes.dedup();
    assert_eq!((run.games.len(), episodes.len()), (4, 4));
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for (_, act) in serving.acts(&run).await {
        *counts.entry(act["response"].as_str().expect("a text").to_owned()).or_default() += 1;
    }
    serving.stop().await;
    let count = |text: &str| counts.get(text).copied().unwrap_or(0);
    assert_eq!(
        counts.values().sum::<usize>(),
        count("ACTION: STAY before") + count("ACTION: STAY after")
    );
    (count("ACTION: STAY before"), count("ACTION: STAY after"))
}

/// So long a program is watched that is to wait.
const WHILE: Duration = Duration::from_millis(500);

/// All acts of all games: four seeds, four rounds, two agents.
const ALL: usize = 32;

/// Killed without notice, twice.
#[tokio::test]
async fn after_a_kill_no_game_starts_over_and_nothing_acknowledged_is_asked_again() {
    let bench = Bench::new();
    let mut answered = 0;
    let mut runs = Vec::new();
    for answers_now in [9, 5] {
        let endpoint = answers(answers_now, "ACTION: STAY before").await;
        // One question at a time: the next is asked when the answer to the one before it has come.
        let running = bench.start(&args(&endpoint, &["--requests", "1", "--parallel", "1"]));
        endpoint.has_seen(answers_now + 1).await;
        running.signal(Signal::KILL);
        let done = running.end().await;
        assert_eq!(done.code(), None);
        answered += answers_now;
        let id = done.err.split_whitespace().find(|word| word.starts_with("run_"));
        runs.push(id.expect("an id").to_owned());
    }
    assert_eq!(runs[0], runs[1]);
    let endpoint = answers(usize::MAX, "ACTION: STAY after").await;
    let done = bench.eval(&args(&endpoint, &["--parallel", "1", "--verify"])).await.ends(0);
    done.says(&["resumes", &runs[0], "verified: 4 games"]);
    let (before, after) = acts_by_answer(&bench).await;
    // Of the round that was open at a kill the two acts may not have been kept yet, and are asked for again.
    assert!((answered - 2 * 2..=answered).contains(&before), "{before} of {answered}");
    assert_eq!((before + after, endpoint.seen().len()), (ALL, after));
    // Once more: nothing is asked.
    let done = bench.eval(&args(&endpoint, &[])).await.ends(0);
    done.says(&["was played before"]);
    assert_eq!(endpoint.seen().len(), after);
}

/// Interrupted: what was answered is sent, and nothing is lost.
#[tokio::test]
async fn an_interruption_loses_nothing_that_was_answered() {
    let bench = Bench::new();
    let endpoint = answers(7, "ACTION: STAY before").await;
    let running = bench.start(&args(&endpoint, &["--requests", "1"]));
    endpoint.has_seen(8).await;
    running.signal(Signal::INT);
    // The eighth is in flight, and paid for: it is waited for.
    let running = running.until_it_says("no more questions are asked").await;
    endpoint.release();
    running.end().await.ends(130).says(&[
        "no more questions are asked. Waiting for the answers to 1, at most 600 s",
        "run the same command again to resume",
        "of 4 games were played",
    ]);
    assert_eq!(endpoint.seen().len(), 8);
    let other = answers(usize::MAX, "ACTION: STAY after").await;
    bench.eval(&args(&other, &[])).await.ends(0).says(&["resumes"]);
    let (before, after) = acts_by_answer(&bench).await;
    assert_eq!((before, after), (8, ALL - 8));
    assert_eq!(other.seen().len(), after);
}

/// Interrupted twice: nothing is waited for.
#[tokio::test]
async fn a_second_interruption_stops_at_once() {
    let bench = Bench::new();
    let endpoint = answers(7, "ACTION: STAY before").await;
    let running = bench.start(&args(&endpoint, &["--requests", "1"]));
    endpoint.has_seen(8).await;
    let interrupt = running.interrupter();
    let mut ended = std::pin::pin!(running.end());
    let done = loop {
        interrupt();
        tokio::select! {
            done = &mut ended => break done,
            () = tokio::time::sleep(WHILE) => {}
        }
    };
    done.ends(130);
    let other = answers(usize::MAX, "ACTION: STAY after").await;
    bench.eval(&args(&other, &[])).await.ends(0).says(&["resumes"]);
    let (before, after) = acts_by_answer(&bench).await;
    assert_eq!((before, after), (7, ALL - 7));
}

/// A run that differs in anything that matters is another run, and the command says so.
#[tokio::test]
async fn another_definition_is_another_run() {
    let bench = Bench::new();
    let endpoint = answers(3, "ACTION: STAY before").await;
    let running = bench.start(&args(&endpoint, &["--temperature", "1", "--requests", "1"]));
    endpoint.has_seen(4).await;
    running.signal(Signal::INT);
    endpoint.release();
    running.end().await.ends(130);
    let other = answers(usize::MAX, "ACTION: STAY after").await;
    let done = bench.eval(&args(&other, &["--temperature", "0.5"])).await.ends(0);
    done.says(&["is new; the unfinished run_", "is another: temperature 0.5 instead of 1"]);
    assert_eq!(other.seen().len(), ALL);
    // How much is done at once is no difference.
    let more = ["--temperature", "1", "--requests", "2", "--budget", "1000000", "--timeout", "60"];
    bench.eval(&args(&other, &more)).await.ends(0).says(&["resumes"]);
    // One more may have been asked before the signal came.
    assert_eq!(other.seen().len(), ALL + ALL - endpoint.seen().len());
}

/// A full disk is reported, and the same command resumes once there is space. Here no file may become much larger than the
/// database is before its first game.
#[cfg(unix)]
#[tokio::test]
async fn a_full_disk_is_reported_and_with_more_space_it_resumes() {
    let bench = Bench::new();
    let game = ["--player", "random", "--task", "Foraging", "--seeds", "0..3", "--max-round", "60"];
    let (within, whole) =
        (bench.command(&game), bench.command(&[&game[..], &["--verify"]].concat()));
    let another =
        ["--player", "random", "--task", "Foraging", "--seeds", "9..10", "--max-round", "1"];
    Running::of(bench.command(&another)).end().await.ends(0);
    let size = std::fs::metadata(bench.path("swarmbench.db")).expect("the database").len();
    // In blocks of 512 bytes. What comes before the games takes some 100, and the games several thousand.
    let limit = size / 512 + 400;
    let mut limited = Command::new("sh");
    limited.args(["-c", &format!(r#"trap "" XFSZ; ulimit -f {limit}; exec "$0" "$@""#)]);
    limited.arg(within.get_program()).args(within.get_args()).current_dir(bench.folder.path());
    limited.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let told = ["a commit failed", "0 of 3 games", "run the same command again to resume"];
    Running::of(limited).end().await.ends(1).says(&told);
    Running::of(whole).end().await.ends(0).says(&["resumes", "verified: 3 games"]);
}

/// A stream of which half has come is no answer, whenever the program is killed.
#[tokio::test]
async fn after_a_kill_in_the_middle_of_streams_no_half_answer_is_an_act() {
    fn stream() -> Reply {
        let choice = |delta: Value, finish: Value| json!({ "choices": [{ "delta": delta, "finish_reason": finish }] });
        Reply::events(&[
            choice(json!({ "content": "ACTION: SWITCH, no, " }), Value::Null),
            choice(json!({ "content": "rather\nACTION: STAY after" }), Value::Null),
            choice(json!({}), json!("stop")),
            json!("[DONE]"),
        ])
    }
    let bench = Bench::new();
    let endpoint =
        Endpoint::start(|number, _| if number < 3 { stream().stalling() } else { stream() }).await;
    let args = args(&endpoint, &["--stream", "--parallel", "1"]);
    for stalled in [2, 3] {
        let running = bench.start(&args);
        endpoint.has_seen(stalled).await;
        tokio::time::sleep(WHILE).await;
        running.signal(Signal::KILL);
        running.end().await;
    }
    bench.eval(&args).await.ends(0);
    let serving = bench.serve().await;
    let run = serving.run().await;
    let acts = serving.acts(&run).await;
    assert_eq!(acts.len(), ALL);
    for (_, act) in acts {
        assert_eq!(act["response"], "ACTION: SWITCH, no, rather\nACTION: STAY after", "{act}");
        assert!(act["usage"]["first_token_ms"].is_u64(), "{act}");
    }
    serving.stop().await;
}
