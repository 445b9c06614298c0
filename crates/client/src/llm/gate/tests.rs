//! Evaluations behind a gate, in simulated time: four games of 12 agents and 20 rounds, in which a round begins when all agents
//! have an answer in the previous one. 48 questions are in flight, and an answer takes half a second.

use std::pin::Pin;
use std::sync::{Arc, Mutex};

use futures::future::join_all;
use jiff::SignedDuration;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tokio::time::Instant;

use super::*;
use swarmbench_clock::until;

const GAMES: u32 = 4;
const AGENTS: u32 = 12;
const ROUNDS: u32 = 20;
const QUESTIONS: u32 = GAMES * AGENTS * ROUNDS;
const LATENCY: Duration = Duration::from_millis(500);
const RETRIES: u32 = 9;

/// Simulated time of the runtime.
struct Simulated(Instant);

impl Clock for Simulated {
    fn now(&self) -> Timestamp {
        let passed = SignedDuration::try_from(self.0.elapsed()).expect("not for ever");
        Timestamp::UNIX_EPOCH + passed
    }

    fn sleep_until(&self, at: Timestamp) -> Pin<Box<dyn Future<Output = ()> + Send>> {
        Box::pin(tokio::time::sleep(until(self.now(), at)))
    }
}

/// Requests that an endpoint refuses.
enum Refuses {
    /// A random share of the requests: this number of 2³².
    Share(u32),
    /// Requests beyond this rate per second. After a pause, a second's worth may come at once.
    Faster { a_second: f64, tokens: f64, at: Instant },
}

struct Simulation {
    clock: Simulated,
    gate: Gate,
    refuses: Mutex<(Refuses, ChaCha8Rng)>,
    refusals: Mutex<u32>,
}

impl Simulation {
    /// True if a request that arrives now is refused.
    fn refuses(&self) -> bool {
        let (refuses, random) = &mut *self.refuses.lock().expect("no panic");
        match refuses {
            Refuses::Share(share) => random.next_u32() < *share,
            Refuses::Faster { a_second, tokens, at } => {
                let now = Instant::now();
                *tokens = (*tokens + *a_second * (now - *at).as_secs_f64()).min(*a_second);
                *at = now;
                let is_empty = *tokens < 1.0;
                *tokens -= if is_empty { 0.0 } else { 1.0 };
                is_empty
            }
        }
    }

    async fn ask(&self) {
        // Pauses are the same in each run of the tests.
        let seed = self.refuses.lock().expect("no panic").1.next_u64();
        let pauses = ExponentialBuilder::default()
            .with_jitter()
            .with_jitter_seed(seed)
            .with_min_delay(Duration::from_millis(500))
            .with_max_delay(Duration::from_mins(1))
            .with_max_times(RETRIES as usize);
        let mut refusals = Refusals::default();
        loop {
            let mut pass = self.gate.pass().await;
            pass.opened(&self.clock).await;
            let is_refused = self.refuses();
            tokio::time::sleep(if is_refused { LATENCY / 5 } else { LATENCY }).await;
            if !is_refused {
                return pass.answered();
            }
            *self.refusals.lock().expect("no panic") += 1;
            let pause = pass.refused(None, &mut refusals, pauses, RETRIES, &self.clock);
            let pause = pause.expect("nothing is given up while others are answered");
            tokio::time::sleep(pause.unwrap_or_default()).await;
        }
    }

    /// Seconds until everything was answered, and the number of refusals.
    async fn play(refuses: Refuses, seed: u64) -> (f64, u32) {
        let simulation = Arc::new(Self {
            clock: Simulated(Instant::now()),
            gate: Gate::new((GAMES * AGENTS) as usize),
            refuses: Mutex::new((refuses, ChaCha8Rng::seed_from_u64(seed))),
            refusals: Mutex::new(0),
        });
        let begun = Instant::now();
        join_all((0..GAMES).map(|_| async {
            for _ in 0..ROUNDS {
                join_all((0..AGENTS).map(|_| simulation.ask())).await;
            }
        }))
        .await;
        (begun.elapsed().as_secs_f64(), *simulation.refusals.lock().expect("no panic"))
    }
}

#[tokio::test(start_paused = true)]
async fn single_refusals_slow_nobody_else_down() {
    // If only single questions paused, the four cases would take 10, 13, 17 and 33 s on average; a gate that closes at each
    // refusal takes 213 s for the last. Pauses are random, and a question that is refused often takes 15 s longer.
    for (percent, seconds) in [(0, 10.1), (1, 25.0), (3, 40.0), (10, 70.0)] {
        for seed in 0..20 {
            let share = Refuses::Share(u32::MAX / 100 * percent);
            let (took, refusals) = Simulation::play(share, seed).await;
            assert!(took < seconds, "{percent} %, seed {seed}: {took} s, {refusals} refusals");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn an_endpoint_at_its_limit_refuses_few_and_is_used_well() {
    // With one request in flight, of half a second, an endpoint with one request a second still refuses every other one.
    for (a_second, share) in [(1.0, 1.3), (3.0, 0.7), (10.0, 0.4), (30.0, 0.2), (60.0, 0.1)] {
        let limit = Refuses::Faster { a_second, tokens: a_second, at: Instant::now() };
        let (took, refusals) = Simulation::play(limit, 0).await;
        let least = f64::from(QUESTIONS) / a_second;
        let of_answers = f64::from(refusals) / f64::from(QUESTIONS);
        assert!(of_answers < share, "{a_second} a second: {refusals} refusals");
        assert!(took < 1.5 * least, "{a_second} a second: {took} s of at least {least} s");
    }
}
