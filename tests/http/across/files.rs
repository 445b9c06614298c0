//! The files of a database: one server has them, others only read, and they stay where they are.

use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use swarmbench_testkit::needs;

use rstest::rstest;
use serde_json::{Value, json};
use swarmbench::store::{OpenError, Store};

use crate::app::program::{printed, swarmbench_in};
use crate::app::{Episode, TestApp};

fn beside(database: &Path, end: &str) -> PathBuf {
    let mut name = database.to_owned().into_os_string();
    name.push(end);
    name.into()
}

async fn game(app: &TestApp) -> Episode {
    let request = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 50 });
    app.create(request).await
}

/// The kinds of locks on a file, as the kernel lists them: `POSIX` ones are SQLite's, `FLOCK` is the server's.
fn locks(file: &Path) -> Vec<String> {
    let inode = format!(":{} ", fs::metadata(file).expect("a file").ino());
    let all = fs::read_to_string("/proc/locks").expect("a list");
    let mine = all.lines().filter(|line| line.contains(&inode) && !line.contains("->"));
    let mut kinds: Vec<_> =
        mine.filter_map(|line| line.split_whitespace().nth(1)).map(str::to_owned).collect();
    kinds.sort_unstable();
    kinds.dedup();
    kinds
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_path_leads_a_second_server_into_the_same_file() {
    let mut app = TestApp::start().await;
    let database = app.database();
    let folder = database.parent().expect("a folder").to_owned();
    let episode = game(&app).await;
    symlink("swarmbench.db", folder.join("symbolic.db")).expect("a link");
    fs::hard_link(&database, folder.join("hard.db")).expect("a link");
    fs::create_dir(folder.join("below")).expect("a folder");
    symlink(&folder, folder.join("below/around")).expect("a link");
    let before = locks(&database);
    for path in [
        "swarmbench.db",
        "./symbolic.db",
        "hard.db",
        "below/../hard.db",
        "below/around/swarmbench.db",
    ] {
        let output = swarmbench_in(&folder, &["key", "list", "--db", path]).await;
        let said = printed(&output);
        assert!(!output.status.success() && said.contains("in use by another process"), "{said}");
        // The same process finds it out without touching the locks that SQLite has.
        let again = Store::open(&folder.join(path)).await;
        assert!(matches!(again, Err(OpenError::InUse(_))), "{path}: {again:?}");
    }
    // Those who only read may come, and go again.
    let copy = folder.join("copy.db").display().to_string();
    let output = swarmbench_in(&folder, &["backup", &copy, "--db", "symbolic.db"]).await;
    assert!(output.status.success(), "{}", printed(&output));
    let output = swarmbench_in(&folder, &["export", "out", "--db", "swarmbench.db"]).await;
    assert!(printed(&output).contains("no games to export"), "{}", printed(&output));
    // By another hard link SQLite would not find what was written last.
    for args in
        [&["backup", "new.db", "--db", "hard.db"][..], &["export", "new", "--db", "hard.db"]]
    {
        let output = swarmbench_in(&folder, args).await;
        let said = printed(&output);
        assert!(!output.status.success() && said.contains("hard links"), "{said}");
    }
    assert!(!folder.join("hard.db-wal").exists());
    app.all_act(&episode, "SWITCH").await;
    if cfg!(target_os = "linux") {
        assert_eq!(before, ["FLOCK", "POSIX"]);
        assert_eq!(locks(&database), before, "nobody has taken SQLite's locks away");
    }
    app.stop().await;
    let linked = Store::open(&database).await;
    assert!(matches!(linked, Err(OpenError::Linked(_))), "{linked:?}");
    fs::remove_file(folder.join("hard.db")).expect("removed");
    // Now another path may have it, and what was acknowledged is in it.
    let output = swarmbench_in(&folder, &["key", "list", "--db", "symbolic.db"]).await;
    assert!(output.status.success(), "{}", printed(&output));
    assert_eq!(
        fs::metadata(beside(&database, "-wal")).map_err(|e| e.kind()).err(),
        Some(std::io::ErrorKind::NotFound)
    );
    app.start_again().await;
    assert_eq!(app.show(&episode).await["round"], 1);
}

/// Operations on the files of a running server.
#[derive(Clone, Copy, Debug)]
enum Accident {
    Removed,
    Renamed,
    Replaced,
    FolderRenamed,
}

#[needs(sqlite)]
#[rstest]
#[case(Accident::Removed, "")]
#[case(Accident::Removed, "-wal")]
#[case(Accident::Renamed, "")]
#[case(Accident::Replaced, "")]
#[case(Accident::Replaced, "-wal")]
#[case(Accident::FolderRenamed, "")]
#[tokio::test]
async fn nothing_is_acknowledged_into_files_that_are_gone(
    #[case] accident: Accident,
    #[case] end: &str,
) {
    let app = TestApp::start().await;
    let episode = game(&app).await;
    app.all_act(&episode, "SWITCH").await;
    let file = beside(&app.database(), end);
    let other = file.with_file_name("other");
    match accident {
        Accident::Removed => fs::remove_file(&file).expect("removed"),
        Accident::Renamed => fs::rename(&file, &other).expect("renamed"),
        Accident::Replaced => {
            fs::copy(&file, &other).expect("a copy");
            fs::rename(&other, &file).expect("renamed");
        }
        Accident::FolderRenamed => {
            let folder = file.parent().expect("a folder");
            fs::rename(folder, folder.with_extension("moved")).expect("renamed");
        }
    }
    let act = json!({ "round": 1, "action": "STAY" });
    app.post("/act").token(episode.seat(0)).json(&act).problem(503, "unavailable").await;
    let create: Value = json!({ "task": "Pursuit" });
    app.post("/api/v1/episodes").json(&create).problem(503, "unavailable").await;
    let problem = app.get("/readyz").problem(503, "unavailable").await;
    let detail = problem["detail"].as_str().expect("a text");
    let what = if matches!(accident, Accident::Replaced) { "replaced" } else { "removed" };
    assert!(detail.contains(what) && detail.contains("swarmbench.db"), "{detail}");
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("swarmbench_database_lost 1"), "{metrics}");
    if matches!(accident, Accident::FolderRenamed) {
        let folder = file.parent().expect("a folder");
        fs::rename(folder.with_extension("moved"), folder).expect("renamed back");
    }
}

#[needs(sqlite)]
#[tokio::test]
async fn readiness_says_so_before_anybody_acts() {
    let app = TestApp::start().await;
    let away = app.database().with_file_name("away.db");
    fs::rename(app.database(), &away).expect("renamed");
    app.get("/readyz").problem(503, "unavailable").await;
    // Nothing was written meanwhile, so it can be put back.
    fs::rename(&away, app.database()).expect("renamed");
    app.get("/readyz").ok().await;
    game(&app).await;
}

#[needs(sqlite)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_their_owner_reads_the_files() {
    let app = TestApp::start().await;
    game(&app).await;
    let database = app.database();
    let folder = database.parent().expect("a folder").to_owned();
    let output = swarmbench_in(&folder, &["backup", "copy.db", "--db", "swarmbench.db"]).await;
    assert!(output.status.success(), "{}", printed(&output));
    let copy = folder.join("copy.db");
    for file in
        ["", "-wal", "-shm", ".lock"].map(|end| beside(&database, end)).iter().chain([&copy])
    {
        let mode = fs::metadata(file).expect("a file").permissions().mode() & 0o777;
        assert_eq!(mode, 0o600, "{}", file.display());
    }
}
