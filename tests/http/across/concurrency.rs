//! Many clients at once: every seat acts once a round, in any order.

use std::sync::Arc;

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench_client::client::Client;
use swarmbench_client::play::play;
use swarmbench_clock::Entropy;
use swarmbench_engine::TaskName;
use swarmbench_protocol::episode::EpisodeRequest;
use swarmbench_testkit::host::SeededEntropy;
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

/// A request whose client hangs up after `others` further requests were answered, wherever the server is with it by then.
async fn hang_up(app: &TestApp, call: crate::app::Call, others: usize) {
    let answered = async {
        for _ in 0..others {
            app.get("/api/v1/competitions").send().await;
        }
    };
    tokio::select! {
        biased;
        _ = call.open() => {}
        () = answered => {}
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_creation_that_was_given_up_is_found_by_its_repeat() {
    let app = TestApp::start().await;
    let large = json!({ "task": "Pursuit", "num_agents": 600, "width": 128, "height": 128 });
    for number in 0..12 {
        let key = format!("creation {number}");
        let create = || app.post("/api/v1/episodes").header("Idempotency-Key", &key).json(&large);
        hang_up(&app, create(), 1 + number % 3).await;
        let episode = create().ok().await;
        assert_eq!(create().ok().await["id"], episode["id"]);
    }
    // Every creation was made once, and none did the journal any harm.
    let listed = app.get("/api/v1/episodes?limit=100").ok().await;
    assert_eq!(crate::app::list(&listed["items"]).len(), 12);
    app.get("/readyz").ok().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_is_revoked_though_the_organizer_hangs_up() {
    let app = TestApp::builder().keys().start().await;
    let (mut number, mut revoked) = (0_usize, 0);
    // The organizer is more and more patient, until some keys were revoked.
    while number < 30 || revoked < 3 {
        number += 1;
        let (secret, id) = app.key(json!({ "name": format!("team {number}") })).await;
        app.get("/api/v1/episodes").token(&secret).ok().await;
        let path = format!("/api/v1/keys/{id}");
        hang_up(&app, app.delete(&path).token(&app.organizer), number.div_ceil(10)).await;
        let listed = app.get("/api/v1/keys").token(&app.organizer).ok().await;
        let listed = crate::app::list(&listed["items"]);
        let key = listed.iter().find(|key| key["id"] == id.as_str()).expect("the key");
        if key["state"] == "revoked" {
            revoked += 1;
            // The server may still be about to forget it, but not for long.
            let mut left = 1000;
            while app.get("/api/v1/episodes").token(&secret).send().await.status != 401 {
                left -= 1;
                assert!(left > 0, "a revoked key is good");
            }
        }
    }
}
