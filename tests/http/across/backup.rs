//! Backups: made by another process while the server runs, and restored.

use std::path::Path;
use std::process::Output;
use std::sync::Arc;
use swarmbench_testkit::needs;

use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::task::JoinHandle;

use crate::app::program::{swarmbench, text};
use crate::app::{Episode, TestApp, number, verified};

/// Runs `swarmbench backup` as its user does.
async fn backup(db: &Path, file: &Path) -> Output {
    let [db, file] = [db, file].map(Path::as_os_str);
    swarmbench(&["backup".as_ref(), "--db".as_ref(), db, file]).await
}

/// Message of a refused backup.
async fn refusal(db: &Path, file: &Path) -> String {
    let output = backup(db, file).await;
    assert!(!output.status.success(), "{}", text(&output.stdout));
    text(&output.stderr)
}

/// The files in a folder, by name.
fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let name = |entry: std::io::Result<std::fs::DirEntry>| entry.expect("an entry").file_name();
    let mut names: Vec<_> = entries.map(|entry| text(name(entry).as_encoded_bytes())).collect();
    names.sort();
    names
}

/// Client that plays an episode of one agent without a break.
struct Player {
    episode: Episode,
    /// The receipts that have come, by round.
    receipts: watch::Receiver<Vec<Value>>,
    stop: watch::Sender<bool>,
    task: JoinHandle<()>,
}

impl Player {
    async fn start(app: &Arc<TestApp>) -> Self {
        let request = json!({ "task": "Synchronization", "num_agents": 1, "max_round": 100_000 });
        let episode = app.create(request).await;
        let (tell, receipts) = watch::channel(Vec::new());
        let (stop, stopped) = watch::channel(false);
        let (app, playing) = (Arc::clone(app), episode.clone());
        let task = tokio::spawn(async move {
            for round in 0.. {
                if *stopped.borrow() {
                    return;
                }
                let receipt = app.act(playing.seat(0), &act(round)).await;
                tell.send_modify(|receipts: &mut Vec<_>| receipts.push(receipt));
            }
        });
        Self { episode, receipts, stop, task }
    }

    /// Waits for more acknowledged acts.
    async fn plays(&mut self, more: usize) {
        let enough = self.receipts.borrow().len() + more;
        let played = self.receipts.wait_for(|receipts| receipts.len() >= enough).await;
        drop(played.expect("it plays on"));
    }
}

/// The act for a round; no two are alike.
fn act(round: usize) -> Value {
    json!({ "round": round, "action": "SWITCH", "message": format!("round {round}") })
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_was_acknowledged_before_a_backup_is_in_it_and_the_game_goes_on() {
    let mut app = Arc::new(TestApp::start().await);
    // An episode that has ended, and one in which somebody has acted in an open round.
    let request = json!({ "task": "Synchronization", "seed": 2, "num_agents": 2, "max_round": 2 });
    let (over, open) = (app.create(request.clone()).await, app.create(request).await);
    app.all_act(&over, "SWITCH").await;
    app.all_act(&over, "STAY").await;
    let given = app.act(open.seat(1), &act(0)).await;
    let mut players = Vec::new();
    for _ in 0..4 {
        players.push(Player::start(&app).await);
    }
    for player in &mut players {
        player.plays(20).await;
    }
    let acknowledged: Vec<Vec<Value>> =
        players.iter().map(|player| player.receipts.borrow().clone()).collect();

    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("backup.db");
    let output = backup(&app.database(), &file).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(files(folder.path()), ["backup.db"]);
    for player in &mut players {
        player.plays(5).await;
        player.stop.send(true).expect("it listens");
        (&mut player.task).await.expect("no panic");
    }

    let restored = app.restored(file).await;
    for path in ["", "/state", "/journal"] {
        let here = app.get(&over.path(path)).send().await.text();
        assert_eq!(restored.get(&over.path(path)).send().await.text(), here);
    }
    let again = restored.act(open.seat(1), &act(0)).await;
    assert_eq!((&again["duplicate"], &again["waiting_for"]), (&json!(true), &given["waiting_for"]));
    restored.act(open.seat(0), &act(0)).await;
    assert_eq!(restored.state(&open).await["round"], 1);

    for (player, receipts) in players.iter().zip(acknowledged) {
        let (episode, token) = (&player.episode, player.episode.seat(0));
        for (round, receipt) in receipts.into_iter().enumerate() {
            let mut repeated = restored.act(token, &act(round)).await;
            assert_eq!(repeated["duplicate"], true, "round {round}: {repeated}");
            repeated["duplicate"] = json!(false);
            assert_eq!(repeated, receipt);
        }
        let journal = restored.journal(episode).await;
        assert!(app.journal(episode).await.starts_with(&journal));
        let report = verified(&journal);
        let round = number(&restored.obs(token).await["round"]);
        assert_eq!(u64::from(report.rounds), round);
        let next = usize::try_from(round).expect("few rounds");
        assert_eq!(restored.act(token, &act(next)).await["duplicate"], false);
        assert_eq!(restored.obs(token).await["round"], round + 1);
    }
    Arc::get_mut(&mut app).expect("the players are gone").stop().await;
}

#[needs(sqlite)]
#[tokio::test]
async fn a_backup_says_what_it_holds_and_replaces_only_what_was_broken_off() {
    let mut app = TestApp::start().await;
    let request = json!({ "task": "Synchronization", "seed": 2, "num_agents": 3, "max_round": 9 });
    let episode = app.create(request).await;
    app.all_act(&episode, "SWITCH").await;
    app.act(episode.seat(2), &act(1)).await;
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("backup.db");
    for name in ["backup.db.partial", "backup.db.partial-journal"] {
        std::fs::write(folder.path().join(name), "broken off").expect("written");
    }

    let output = backup(&app.database(), &file).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(said.contains("1 episodes, 4 acts, 1 rounds"), "{said}");
    let restore = format!("copy {} to {}", file.display(), app.database().display());
    assert!(said.contains(&restore), "{said}");
    assert_eq!(files(folder.path()), ["backup.db"]);

    let before = std::fs::read(&file).expect("the backup");
    assert!(refusal(&app.database(), &file).await.contains("name another file"));
    assert_eq!(std::fs::read(&file).expect("the backup"), before);
    assert_eq!(files(folder.path()), ["backup.db"]);

    // No server has to run for it.
    app.stop().await;
    let second = folder.path().join("second.db");
    let output = backup(&app.database(), &second).await;
    assert!(output.status.success(), "{}", text(&output.stderr));
    app.start_again().await;
    let restored = app.restored(second).await;
    assert_eq!(restored.journal(&episode).await, app.journal(&episode).await);
    assert_eq!(restored.act(episode.seat(2), &act(1)).await["duplicate"], true);
}

#[needs(sqlite)]
#[tokio::test]
async fn only_a_database_is_backed_up() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let said = refusal(&path("no-such.db"), &path("backup.db")).await;
    assert!(said.contains("no-such.db") && said.contains("--db"), "{said}");
    assert_eq!(files(folder.path()), [""; 0]);

    std::fs::write(path("letter.txt"), "Dear reader, this is no database.\n".repeat(100))
        .expect("written");
    let said = refusal(&path("letter.txt"), &path("backup.db")).await;
    assert!(said.contains("letter.txt"), "{said}");
    // A database, but not one of a server.
    std::fs::write(path("empty.db"), "").expect("written");
    let said = refusal(&path("empty.db"), &path("backup.db")).await;
    assert!(said.contains("episodes"), "{said}");
    assert!(!path("backup.db").exists());
}
