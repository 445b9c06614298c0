//! Many clients at once: every seat acts once a round, whoever is first.

use std::sync::Arc;

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench::clock::{Entropy, SeededEntropy};
use swarmbench::players::client::Client;
use swarmbench::players::play::play;
use swarmbench::wire::episode::EpisodeRequest;
use swarmbench_engine::TaskName;
use tokio::task::JoinSet;

use crate::app::{TestApp, list};

const ROUNDS: u64 = 25;

/// A draw below `n`.
fn draw(random: &SeededEntropy, n: u8) -> u8 {
    let mut byte = [0];
    random.fill(&mut byte);
    byte[0] % n
}

/// Plays one seat; every act is sent one to three times at once, by whichever of two actions came
/// first. Returns by round how many receipts were no duplicates.
async fn play_seat(app: Arc<TestApp>, token: String, seed: u64) -> Vec<u64> {
    let random = SeededEntropy::new(seed << 32);
    let mut fresh = Vec::new();
    for round in 0..ROUNDS {
        let action = ["UP", "SWITCH"][usize::from(draw(&random, 2))];
        let act = json!({ "round": round, "action": action });
        let other = json!({ "round": round, "action": "STAY" });
        let mut sending = JoinSet::new();
        for copy in 0..=draw(&random, 3) {
            // Now and then a client contradicts itself.
            let sent = if copy > 0 && draw(&random, 4) == 0 { &other } else { &act };
            sending.spawn(app.post("/act").token(&token).json(sent).send());
        }
        let mut count = 0;
        for answer in sending.join_all().await {
            match answer.status {
                200 => count += u64::from(answer.json()["duplicate"] == false),
                409 => assert_eq!(answer.json()["code"], "already_acted", "seed {seed}"),
                status => panic!("seed {seed}: {status} {}", answer.text()),
            }
        }
        fresh.push(count);
        app.obs_after(&token, round).await;
    }
    fresh
}

#[rstest]
#[case(1)]
#[case(2)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn exactly_one_receipt_a_seat_and_round_is_no_duplicate(#[case] seed: u64) {
    let app = Arc::new(TestApp::start().await);
    let request = json!({ "task": "Synchronization", "num_agents": 12, "max_round": ROUNDS });
    let episode = app.create(request).await;
    let mut players = JoinSet::new();
    for (seat, token) in (0..).zip(episode.seats()) {
        players.spawn(play_seat(Arc::clone(&app), token.to_owned(), 100 * seed + seat));
    }
    for fresh in players.join_all().await {
        assert_eq!(fresh, vec![1; usize::try_from(ROUNDS).expect("few")], "seed {seed}");
    }
    let shown = app.show(&episode).await;
    assert_eq!((&shown["status"], &shown["round"]), (&json!("finished"), &json!(ROUNDS)));
    // Every seat has exactly one act in every round of the journal, and it is that of its receipt.
    for line in
        app.journal(&episode).await.lines().skip(1).take(usize::try_from(ROUNDS).expect("few"))
    {
        let record = serde_json::from_str::<Value>(line).expect("JSON")["record"].clone();
        let agents: Vec<Value> =
            list(&record["acts"]).iter().map(|act| act["agent"].clone()).collect();
        assert_eq!(agents, (0..12).map(|seat| json!(format!("Agent_{seat}"))).collect::<Vec<_>>());
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn many_episodes_are_played_at_once_by_the_built_in_players() {
    let app = TestApp::start().await;
    let mut playing = JoinSet::new();
    for number in 0..40_u32 {
        let client = Client::new(app.base()).expect("an address");
        let task = TaskName::ALL[number as usize % TaskName::ALL.len()];
        playing.spawn(async move {
            let request = EpisodeRequest {
                task: Some(task.name().to_owned()),
                seed: Some(i64::from(number / 10)),
                num_agents: Some(6),
                max_round: Some(8),
                ..EpisodeRequest::default()
            };
            let created = client.create_episode(&request).await.expect("created");
            let player = swarmbench_players::default_for(task);
            play(&client, &created, player, 1, |_, _| ()).await.expect("played")
        });
    }
    let summaries = playing.join_all().await;
    assert_eq!(summaries.len(), 40);
    for summary in &summaries {
        let result = summary.result.as_ref().expect("an end");
        assert!(result.rounds == 8 || result.reason == "task_done", "{summary:?}");
        // The same game has the same score, whatever else was played meanwhile.
        let twins = summaries.iter().filter(|other| {
            other.config.task == summary.config.task && other.config.seed == summary.config.seed
        });
        assert!(twins.map(|twin| twin.score.to_bits()).all(|bits| bits == summary.score.to_bits()));
    }
}
