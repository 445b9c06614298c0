//! Durations of evaluations beside their endpoints, measured with the real program:
//! `cargo test --test program evaluations_take -- --ignored --nocapture`.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::bench::Bench;
use crate::llm::endpoint::{Endpoint, Reply};

/// Four games of 12 agents and 20 rounds, all seats asked at once.
const GAMES: [&str; 10] = [
    "--task",
    "Synchronization",
    "--seeds",
    "1..5",
    "--max-round",
    "20",
    "--parallel",
    "4",
    "--requests",
    "48",
];
const QUESTIONS: usize = 4 * 12 * 20;

/// The time to an answer. A refusal comes in a tenth of it.
const LATENCY: Duration = Duration::from_millis(500);

fn answer() -> Reply {
    Reply::says("ACTION: STAY").after(LATENCY)
}

fn refusal() -> Reply {
    Reply::error(429, "slow down").after(LATENCY / 10)
}

/// One evaluation: its seconds, and the refusals.
async fn measured(endpoint: &Endpoint) -> (f64, usize) {
    let bench = Bench::new();
    let args = [&GAMES[..], &["--model", "m", "--api-base", endpoint.base()]].concat();
    let begun = Instant::now();
    bench.eval(&args).await.ends(0);
    (begun.elapsed().as_secs_f64(), endpoint.seen().len() - QUESTIONS)
}

#[tokio::test]
#[ignore = "a measurement of some minutes"]
async fn evaluations_take() {
    println!("| endpoint | seconds | refusals |\n| --- | ---: | ---: |");
    // What an evaluation takes by itself.
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: STAY")).await;
    let (seconds, _) = measured(&endpoint).await;
    println!("| answers at once | {seconds:.1} | 0 |");
    for percent in [0, 1, 3, 10] {
        let random = Mutex::new(ChaCha8Rng::seed_from_u64(1));
        let endpoint = Endpoint::start(move |_, _| {
            let drawn = random.lock().expect("a lock").next_u32() % 100;
            if drawn < percent { refusal() } else { answer() }
        })
        .await;
        let (seconds, refusals) = measured(&endpoint).await;
        println!("| refuses {percent} % at random | {seconds:.1} | {refusals} |");
    }
    for a_second in [10.0, 30.0, 60.0] {
        let tokens = Mutex::new((a_second, Instant::now()));
        let endpoint = Endpoint::start(move |_, _| {
            let (tokens, at) = &mut *tokens.lock().expect("a lock");
            let now = Instant::now();
            *tokens = (*tokens + a_second * (now - *at).as_secs_f64()).min(a_second);
            *at = now;
            if *tokens < 1.0 {
                return refusal();
            }
            *tokens -= 1.0;
            answer()
        })
        .await;
        let (seconds, refusals) = measured(&endpoint).await;
        println!("| answers {a_second} a second | {seconds:.1} | {refusals} |");
    }
}
