//! A seat that floods the server delays only itself.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};

use serde_json::{Value, json};
use tokio::task::JoinSet;

use crate::app::{TestApp, list};

const ROUNDS: u64 = 15;

/// Clients of the seat that floods.
const FLOODERS: usize = 32;

fn act(round: u64) -> Value {
    json!({ "round": round, "action": "SWITCH" })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_flood_of_one_seat_is_refused_to_that_seat_alone() {
    let app = Arc::new(TestApp::start().await);
    let request = json!({ "task": "Synchronization", "num_agents": 3, "max_round": ROUNDS + 10 });
    let episode = Arc::new(app.create(request).await);
    for round in 0..10 {
        assert_eq!(app.all_act(&episode, "SWITCH").await, round);
    }
    let stop = Arc::new(AtomicBool::new(false));
    let counts: Arc<[AtomicUsize; 2]> = Arc::default();
    let open = Arc::new(AtomicU64::new(10));
    let mut flood = JoinSet::new();
    for number in 0..FLOODERS {
        let (app, episode) = (Arc::clone(&app), Arc::clone(&episode));
        let (stop, counts, open) = (Arc::clone(&stop), Arc::clone(&counts), Arc::clone(&open));
        flood.spawn(async move {
            // Acts that were sent before, those of the open round, and some to come.
            for sent in number as u64.. {
                let open = open.load(Ordering::Relaxed);
                let round = [sent % 10, sent % 10, open, open + 1][(sent % 4) as usize];
                let answer = app.post("/act").token(episode.seat(0)).json(&act(round)).send().await;
                match answer.status {
                    200 | 409 => counts[0].fetch_add(1, Ordering::Relaxed),
                    503 => {
                        let problem = answer.json();
                        assert_eq!(problem["code"], "overloaded", "{problem}");
                        assert_eq!(
                            problem["limit"],
                            json!({ "name": "seat_acts_waiting_max", "value": 16 })
                        );
                        counts[1].fetch_add(1, Ordering::Relaxed)
                    }
                    status => panic!("{status} {}", answer.text()),
                };
                if stop.load(Ordering::Relaxed) {
                    break;
                }
            }
        });
    }
    // The others play; what the flooding seat sends for the open round is among all the rest.
    for round in 10..ROUNDS + 10 {
        open.store(round, Ordering::Relaxed);
        for seat in [1, 2] {
            app.act(episode.seat(seat), &act(round)).await;
        }
        app.obs_after(episode.seat(1), round).await;
        // Old acts of the others are confirmed meanwhile.
        assert_eq!(app.act(episode.seat(1), &act(round - 5)).await["duplicate"], true);
    }
    stop.store(true, Ordering::Relaxed);
    while let Some(done) = flood.join_next().await {
        done.expect("no surprise");
    }
    let [answered, refused] = [&counts[0], &counts[1]].map(|count| count.load(Ordering::Relaxed));
    assert!(answered > 0 && refused > 0, "{answered} answered, {refused} refused");
}

#[tokio::test]
async fn one_call_may_hold_1024_acts_of_one_seat() {
    let app = TestApp::start().await;
    let request = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 5 });
    let episode = app.create(request).await;
    app.all_act(&episode, "SWITCH").await;
    let agent = json!("Agent_0");
    let acts: Vec<Value> = (0..1024).map(|n| episode.act(&agent, n % 2, "SWITCH")).collect();
    let receipts = app.swarm_act(&episode, &acts).await;
    assert_eq!(receipts.len(), 1024);
    let duplicates = receipts.iter().filter(|receipt| receipt["duplicate"] == true).count();
    assert_eq!(duplicates, 1023, "all but the first of the open round");
    // Many seats in one call are each asked for themselves.
    let request = json!({
        "task": "Synchronization", "num_agents": 1024, "width": 64, "height": 64, "max_round": 2,
    });
    let crowd = app.create(request).await;
    let seen = app.swarm_obs(&crowd).await;
    let acts: Vec<Value> = seen.iter().map(|seen| crowd.act(&seen["agent"], 0, "STAY")).collect();
    let receipts = app.swarm_act(&crowd, &acts).await;
    assert!(receipts.iter().all(|receipt| receipt["duplicate"] == false));
    assert_eq!(list(&json!(receipts)).len(), 1024);
}
