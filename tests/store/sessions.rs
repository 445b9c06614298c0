//! Features of PostgreSQL alone: other servers, sessions that end, and a database that another server takes over.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use swarmbench_testkit::needs;

use futures::future::join_all;
use jiff::Timestamp;
use sqlx::Connection as _;
use sqlx::postgres::PgConnection;
use swarmbench::cluster::Death;
use swarmbench::ids::{EntryKey, EpisodeKey};
use swarmbench::store::entries::{ActRow, AuditRow, Entry, RoundRow};
use swarmbench::store::port::EpisodeStore as _;
use swarmbench::store::{Beat, Joining, OpenError, Store};
use swarmbench_engine::AgentId;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{Decision, RawRecord, Source};
use swarmbench_testkit::postgres::Scratch;

use crate::store::{location, scratch};

/// Longer than anything takes, so that a test that hangs fails.
const PATIENCE: Duration = Duration::from_secs(50);

/// Batches that are written while sessions end.
const BATCHES: u32 = 300;

/// Sessions that end meanwhile, at least: a busy machine writes all batches before so many have ended.
const SESSIONS_ENDED_MIN: usize = 4;

/// An act and the round that it resolves.
fn rows(round: u32) -> Vec<Entry> {
    let (episode, at) = (EpisodeKey(1), Timestamp::UNIX_EPOCH);
    let record = RawRecord::write(&Decision::clock_ran_out().record(AgentId(0), 0));
    let (agent, source) = (AgentId(0), Source::Clock);
    let act = ActRow { episode, round, agent, waiting_for: 0, source, at, record, brief: None };
    let (digest, head) = ([0; 32], Head([0; 32]));
    vec![Entry::Act(act), Entry::Round(RoundRow { episode, round, digest, score: 0.5, head, at })]
}

/// A row that nothing keeps from being there twice.
pub(super) fn note(number: u32) -> Entry {
    Entry::Audit(Box::new(AuditRow {
        at: Timestamp::UNIX_EPOCH,
        who: "local".to_owned(),
        action: "test.note",
        subject: number.to_string(),
        detail: serde_json::Value::Null,
        shown: None,
    }))
}

/// Ends all sessions that write; how many there were.
async fn end_writers(other: &mut PgConnection) -> usize {
    let ended: Vec<bool> = sqlx::query_scalar(
        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity
         WHERE application_name LIKE 'swarmbench/%' AND datname = current_database()",
    )
    .fetch_all(other)
    .await
    .expect("the sessions end");
    ended.len()
}

/// Notes of each number.
pub(super) async fn noted(store: &Store) -> BTreeMap<u32, usize> {
    let mut noted = BTreeMap::new();
    for entry in store.audit(None, u32::MAX).await.expect("read") {
        *noted.entry(entry.subject.parse().expect("a number")).or_default() += 1;
    }
    noted
}

#[needs(postgres)]
#[tokio::test]
async fn one_server_has_a_database_and_others_only_read_it() {
    let scratch = scratch().await;
    let first = Store::open(location(&scratch)).await.expect("it opens");
    first.keep(vec![note(1)]).await.expect("kept");
    match Store::open(location(&scratch)).await {
        Err(OpenError::InUse(by)) => {
            assert!(by.contains("process"), "{by} says which process has it");
            assert!(!by.contains(scratch.url()), "{by} has no password");
        }
        other => panic!("it is {other:?}"),
    }
    let reader = Store::open_to_read(location(&scratch)).await.expect("it opens");
    first.keep(vec![note(2)]).await.expect("kept");
    assert_eq!(noted(&reader).await, BTreeMap::from([(1, 1), (2, 1)]));
    assert!(reader.keep(vec![note(3)]).await.is_err(), "it only reads");
    reader.close().await;
    first.close().await;
    let second = Store::open(location(&scratch)).await.expect("it is free");
    second.keep(vec![note(4)]).await.expect("kept");
    assert_eq!(noted(&second).await, BTreeMap::from([(1, 1), (2, 1), (4, 1)]));
    second.close().await;
}

#[needs(postgres)]
#[tokio::test]
async fn a_database_without_tables_is_not_read() {
    let scratch = scratch().await;
    assert!(Store::open_to_read(location(&scratch)).await.is_err());
}

#[needs(postgres)]
#[tokio::test]
async fn a_session_that_ends_between_batches_is_a_pause() {
    let scratch = scratch().await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    let mut other = scratch.connect().await;
    for number in 0..6 {
        assert_eq!(end_writers(&mut other).await, 1, "there is one session that writes");
        let mut batch = vec![note(number)];
        if number % 2 == 0 {
            store.keep(rows(number)).await.expect("kept");
            assert_eq!(end_writers(&mut other).await, 1);
        } else {
            batch.extend(rows(number));
        }
        store.keep(batch).await.expect("kept");
    }
    assert_eq!(noted(&store).await, (0..6).map(|number| (number, 1)).collect());
    let rounds = store.rounds(EpisodeKey(1), 0, 10).await.expect("read");
    assert_eq!(rounds.len(), 6);
    assert!(!store.writer().has_failed() && store.writer().blocked().is_none());
    store.close().await;
}

#[needs(postgres)]
#[tokio::test(flavor = "multi_thread")]
async fn sessions_that_end_during_batches_lose_and_double_nothing() {
    let scratch = scratch().await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    let mut other = scratch.connect().await;
    let is_done = Arc::new(AtomicBool::new(false));
    let ended = Arc::new(AtomicUsize::new(0));
    let (seen, count) = (Arc::clone(&is_done), Arc::clone(&ended));
    let killer = tokio::spawn(async move {
        for pause_ms in (1..).map(|number| number * 7 % 40) {
            if seen.load(Ordering::Relaxed) {
                break;
            }
            count.fetch_add(end_writers(&mut other).await, Ordering::Relaxed);
            // Of different lengths, so that a session ends in all stages of a commit.
            tokio::time::sleep(Duration::from_millis(pause_ms)).await;
        }
        drop(other.close().await);
    });
    let write = async {
        let mut number = 0;
        while number < BATCHES || ended.load(Ordering::Relaxed) < SESSIONS_ENDED_MIN {
            // Several at once, of which some are acts and rounds alone.
            let mut batches = Vec::new();
            for _ in 0..=number % 4 {
                let mut batch = rows(number);
                if number % 3 != 0 {
                    batch.push(note(number));
                }
                batches.push(store.keep(batch));
                number += 1;
            }
            for kept in join_all(batches).await {
                kept.expect("it is kept, however long it takes");
            }
        }
        number
    };
    let written = tokio::time::timeout(PATIENCE, write).await.expect("it ends");
    is_done.store(true, Ordering::Relaxed);
    killer.await.expect("no panic");
    let expected = (0..written).filter(|number| number % 3 != 0).map(|number| (number, 1));
    assert_eq!(noted(&store).await, expected.collect());
    let rounds = store.rounds(EpisodeKey(1), 0, u32::MAX).await.expect("read");
    let rounds: Vec<_> = rounds.into_iter().map(|round| round.round).collect();
    assert_eq!(rounds, (0..written).collect::<Vec<_>>());
    let acts = store.acts(EpisodeKey(1), 0, u32::MAX).await.expect("read");
    assert_eq!(acts.len(), rounds.len());
    assert!(!store.writer().has_failed());
    store.close().await;
}

#[needs(postgres)]
#[tokio::test]
async fn an_entry_about_a_row_that_is_not_there_is_refused_alone() {
    let scratch = scratch().await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    let (entry, name) = (EntryKey(7), "nobody".to_owned());
    let rename = Entry::RenameEntrant { entry, name, by_itself: true };
    let jobs = [vec![note(1)], vec![note(2), rename], vec![note(3)]];
    let started = Instant::now();
    let kept = join_all(jobs.map(|job| store.keep(job))).await;
    assert_eq!(kept.iter().map(Result::is_ok).collect::<Vec<_>>(), [true, false, true]);
    assert!(started.elapsed() < PATIENCE / 2, "it is not tried again");
    assert_eq!(noted(&store).await, BTreeMap::from([(1, 1), (3, 1)]));
    store.close().await;
}

#[needs(postgres)]
#[tokio::test]
async fn a_server_whose_database_was_taken_over_writes_nothing_more() {
    for only_rows in [false, true] {
        let scratch = scratch().await;
        let store = Store::open(location(&scratch)).await.expect("it opens");
        let batch = |number| if only_rows { rows(number) } else { vec![note(number)] };
        store.keep(batch(0)).await.expect("kept");
        let mut other = scratch.connect().await;
        sqlx::query("DELETE FROM nodes").execute(&mut other).await.expect("taken over");
        let later: Vec<_> = (1..20).map(|number| store.keep(batch(number))).collect();
        let later = tokio::time::timeout(PATIENCE, join_all(later)).await.expect("they end");
        assert!(later.iter().all(Result::is_err), "{later:?}");
        assert!(store.writer().has_failed(), "for good");
        assert!(store.keep(batch(20)).await.is_err());
        assert!(store.keep(Vec::new()).await.is_err(), "nobody knows what is durable");
        // What was acknowledged is still there, and can be read.
        let found = if only_rows {
            store.rounds(EpisodeKey(1), 0, u32::MAX).await.expect("read").len()
        } else {
            noted(&store).await.len()
        };
        assert_eq!(found, 1);
        other.close().await.expect("it closes");
        store.close().await;
    }
}

/// The database was restored from a backup, or a standby without the last commits took over.
#[needs(postgres)]
#[tokio::test]
async fn a_server_whose_commits_are_lost_gives_its_games_to_others_where_there_are_some() {
    for has_joined in [false, true] {
        let scratch = scratch().await;
        let store = if has_joined {
            joined(&scratch, 1).await
        } else {
            Store::open(location(&scratch)).await.expect("it opens")
        };
        store.keep(vec![note(1)]).await.expect("kept");
        let mut other = scratch.connect().await;
        let lose = sqlx::query("UPDATE nodes SET committed = committed - 1");
        lose.execute(&mut other).await.expect("a commit is lost");
        let kept = tokio::time::timeout(PATIENCE, store.keep(vec![note(2)])).await;
        assert!(kept.expect("it ends").is_err());
        assert!(store.writer().has_failed(), "nothing more is acknowledged");
        assert_eq!(store.writer().excluded().is_cancelled(), has_joined);
        let fault = store.writer().fault();
        assert_eq!(fault.is_some_and(|why| why.contains("were acknowledged")), has_joined);
        other.close().await.expect("it closes");
        store.close().await;
    }
}

#[needs(postgres)]
#[tokio::test]
async fn a_server_notices_a_takeover_while_it_writes_nothing() {
    let scratch = scratch().await;
    let store = Store::open(location(&scratch)).await.expect("it opens");
    let mut other = scratch.connect().await;
    // Its session ends, and another server has the database before it connects again.
    end_writers(&mut other).await;
    sqlx::query("DELETE FROM nodes").execute(&mut other).await.expect("taken over");
    let failed = tokio::time::timeout(PATIENCE, store.writer().failed().cancelled()).await;
    assert!(failed.is_ok() && store.writer().has_failed());
    other.close().await.expect("it closes");
    store.close().await;
}

#[needs(postgres)]
#[tokio::test]
async fn a_server_that_lost_its_session_is_excluded_by_the_next() {
    let scratch = scratch().await;
    let first = Store::open(location(&scratch)).await.expect("it opens");
    first.keep(vec![note(1)]).await.expect("kept");
    let mut other = scratch.connect().await;
    // Until the first has noticed it, and has connected again, the next may take the database.
    let second = loop {
        end_writers(&mut other).await;
        match Store::open(location(&scratch)).await {
            Ok(second) => break second,
            Err(OpenError::InUse(_)) => {}
            Err(error) => panic!("{error}"),
        }
    };
    let refused = tokio::time::timeout(PATIENCE, first.keep(vec![note(2)])).await;
    assert!(refused.expect("it ends").is_err() && first.writer().has_failed());
    second.keep(vec![note(3)]).await.expect("kept");
    assert_eq!(noted(&second).await, BTreeMap::from([(1, 1), (3, 1)]));
    first.close().await;
    second.keep(vec![note(4)]).await.expect("the first has closed nothing of the second");
    second.close().await;
    other.close().await.expect("it closes");
}

/// A server of a cluster on a database, which shows others only by hand that it lives.
pub(super) async fn joined(scratch: &Scratch, port: u16) -> Store {
    let joining = Joining {
        address: format!("127.0.0.1:{port}"),
        secret: Arc::from(&b"the secret of the tests"[..]),
        forwards_only: false,
        routing_name: None,
        host_ms: swarmbench::membership::host_ms,
    };
    Store::join(location(scratch), &joining).await.expect("it joins")
}

async fn beat(store: &Store) {
    let beat = Beat { is_ready: true, episodes: 0 };
    let cluster = store.cluster().expect("it has joined");
    cluster.beat(beat, swarmbench::membership::host_ms).await.expect("the database answers");
}

/// A connection that is cut alone, and a session that is lost, look like the end of a process.
#[needs(postgres)]
#[tokio::test]
async fn a_server_that_was_just_seen_is_not_taken_for_dead() {
    let scratch = scratch().await;
    let (one, other) = (joined(&scratch, 1).await, joined(&scratch, 2).await);
    let number = one.cluster().expect("it has joined").incarnation();
    let cluster = other.cluster().expect("it has joined");
    beat(&one).await;
    assert!(!cluster.exclude(number, Death::Seen).await.expect("asked"), "it was seen just now");
    // The host's clock, as the database's decides; much longer than a beat may be late.
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(cluster.exclude(number, Death::Seen).await.expect("asked"), "its beat is late");
    for store in [one, other] {
        store.close().await;
    }
}

#[needs(postgres)]
#[tokio::test]
async fn a_beat_takes_the_lock_that_an_old_session_had() {
    let scratch = scratch().await;
    let (one, other) = (joined(&scratch, 1).await, joined(&scratch, 2).await);
    let number = one.cluster().expect("it has joined").incarnation();
    let connected = || other.cluster().expect("it has joined").is_connected(number);
    // As PostgreSQL keeps a session whose connection broke without a word.
    let mut old = scratch.connect().await;
    let taken: bool =
        sqlx::query_scalar("SELECT pg_try_advisory_lock(1400332658, CAST($1 AS integer))")
            .bind(number)
            .fetch_one(&mut old)
            .await
            .expect("it is free");
    assert!(taken);
    beat(&one).await;
    old.close().await.expect("it closes");
    while connected().await.expect("asked") {
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    beat(&one).await;
    assert!(connected().await.expect("asked"), "it has the lock now");
    for store in [one, other] {
        store.close().await;
    }
}
