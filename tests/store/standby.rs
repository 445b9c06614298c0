//! A standby that is away: PostgreSQL has written a commit, and does not say so until the standby has it, too. Sessions that
//! wait for that are ended, as happens where a server loses patience or its connection: nothing is written twice, and nothing
//! that is stored is refused.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use swarmbench::store::Store;
use swarmbench_testkit::needs;
use swarmbench_testkit::postgres::{OwnServer, Scratch, Standby};

use super::sessions::{joined, note, noted};
use super::{Pair, Playing, SEEDS, location, missing, play};

#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn entries_of_all_kinds_are_kept_once_while_a_standby_is_away() {
    let server = OwnServer::start();
    let mut reached = BTreeMap::new();
    for seed in 0..SEEDS {
        let pair = Pair::over(Scratch::in_server(&server.url()).await).await;
        let standby = Standby::of(&pair.scratch).await;
        let playing = Playing(seed);
        play(seed, pair, Some(&standby), &mut reached).await;
        drop(playing);
    }
    assert!(reached["ok"] > 20 && reached["refused"] > 0, "{reached:?}");
    let missing = missing(&reached);
    assert!(missing.is_empty(), "no history has {missing:?}, only {reached:?}");
}

#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn a_commit_that_waits_for_a_standby_is_told_before_it_is_given_up() {
    let server = OwnServer::start();
    let scratch = Scratch::in_server(&server.url()).await;
    let standby = Standby::of(&scratch).await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    standby.set(true).await;
    let keep = || {
        let store = store.clone();
        (Instant::now(), tokio::spawn(async move { store.keep(vec![note(1)]).await }))
    };
    let (mut started, mut keeping) = keep();
    let blocked = loop {
        if keeping.is_finished() {
            // PostgreSQL had not read its settings yet.
            (started, keeping) = keep();
        }
        if let Some(blocked) = store.writer().blocked() {
            break blocked.to_string();
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
    };
    assert!(blocked.contains("a commit that waits for a standby"), "{blocked}");
    assert!(started.elapsed() < Duration::from_secs(4), "{:?}", started.elapsed());
    standby.set(false).await;
    keeping.await.expect("no panic").expect("it is confirmed");
    assert_eq!(store.writer().blocked(), None);
    store.close().await;
}

/// Servers of a cluster share the lock of the database, so an old session does not keep a new one from it.
#[needs(postgres, root)]
#[tokio::test(flavor = "multi_thread")]
async fn a_server_of_a_cluster_keeps_entries_once_while_a_standby_is_away() {
    let server = OwnServer::start();
    let scratch = Scratch::in_server(&server.url()).await;
    let standby = Standby::of(&scratch).await;
    let store = joined(&scratch, 1).await;
    for number in 0..20 {
        let kept = standby.away(store.keep(vec![note(number)])).await;
        kept.unwrap_or_else(|error| panic!("{number}: {error}"));
    }
    assert_eq!(noted(&store).await, (0..20).map(|number| (number, 1)).collect());
    assert!(!store.writer().has_failed());
    store.close().await;
}
