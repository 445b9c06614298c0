//! The journal of an episode, and what its hashes prove.

use rstest::rstest;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::{Fault, JournalReport, verify};

use super::{finish, request};
use crate::app::{Episode, TestApp, verified};

fn check(journal: &[u8], head: Option<Head>) -> Result<JournalReport, Fault> {
    verify(journal, head, Solver::Flow, |_, _| ())
}

/// A finished episode with all kinds of acts, and its journal.
async fn played(app: &TestApp) -> (Episode, String) {
    let episode = app.create(request(3, 4)).await;
    app.all_act(&episode, "SWITCH").await;
    let answers = [
        json!({ "round": 1, "response": "ACTION: UP\nMSG: grüße", "reasoning": "\"\\\u{1F41D}" }),
        json!({ "round": 1, "response": "none", "usage": { "latency_ms": 5 } }),
        json!({ "round": 1, "action": "SWITCH", "message": "on" }),
    ];
    for (token, answer) in episode.seats().zip(&answers) {
        app.act(token, answer).await;
    }
    finish(app, &episode).await;
    let journal = app.journal(&episode).await;
    (episode, journal)
}

#[tokio::test]
async fn its_lines_are_chained_by_their_hashes() {
    let app = TestApp::start().await;
    let (episode, journal) = played(&app).await;
    let kinds = ["opening", "round", "round", "round", "round", "end"];
    assert_eq!(journal.lines().count(), kinds.len());
    let mut head = [0_u8; 32];
    for (line, kind) in journal.lines().zip(kinds) {
        let parsed: Value = serde_json::from_str(line).expect("JSON");
        assert_eq!(parsed["record"]["kind"], kind);
        // `{"hash":"…","record":` and 64 digits stand before a record, `}` after it.
        let record = &line[r#"{"hash":"","record":"#.len() + 64..line.len() - 1];
        head = Sha256::new().chain_update(head).chain_update(record).finalize().into();
        assert_eq!(parsed["hash"], Head(head).to_string());
    }
    let shown = app.show(&episode).await;
    assert_eq!(shown["result"]["journal_head"], Head(head).to_string());
    let report = check(journal.as_bytes(), Some(Head(head))).expect("it plays again");
    assert_eq!(json!(report.score), shown["score"]);
    assert_eq!(report.opening.episode, episode.id);
    assert_eq!(report.opening.rules_revision, swarmbench_engine::RULES_REVISION);
    assert_eq!(report.opening.prompt_template, swarmbench_prompt::BUILT_IN);
}

#[tokio::test]
async fn that_of_a_running_episode_is_its_beginning() {
    let app = TestApp::start().await;
    let episode = app.create(request(2, 3)).await;
    let mut beginnings = vec![app.journal(&episode).await];
    for _ in 0..3 {
        app.all_act(&episode, "SWITCH").await;
        beginnings.push(app.journal(&episode).await);
    }
    let whole = beginnings.pop().expect("four");
    for (beginning, rounds) in beginnings.iter().zip(0..) {
        assert_eq!(beginning.lines().count(), 1 + rounds);
        assert!(whole.starts_with(beginning.as_str()));
        let report = verified(beginning);
        assert_eq!((report.rounds as usize, report.end.is_none()), (rounds, true));
        // It is consistent, but not the whole: the head tells.
        let head = verified(&whole).head;
        assert!(matches!(check(beginning.as_bytes(), Some(head)), Err(Fault::Whole(_))));
    }
    assert_eq!(whole.lines().count(), 5);
}

#[rstest]
#[case::lowest_bit(0x01, 3)]
#[case::case_bit(0x20, 5)]
#[case::not_ascii(0x80, 11)]
#[tokio::test]
async fn a_changed_byte_is_found_in_its_line(#[case] flip: u8, #[case] stride: usize) {
    let app = TestApp::start().await;
    let (_, journal) = played(&app).await;
    let journal = journal.into_bytes();
    for place in (0..journal.len()).step_by(stride) {
        let mut changed = journal.clone();
        changed[place] ^= flip;
        let expected = journal[..place].split(|&byte| byte == b'\n').count();
        match check(&changed, None) {
            Err(Fault::Line { line, .. }) => assert_eq!(line, expected, "byte {place}"),
            other => panic!("byte {place} of line {expected}: {other:?}"),
        }
    }
}

#[tokio::test]
async fn lines_that_are_gone_doubled_or_swapped_are_found() {
    let app = TestApp::start().await;
    let (_, journal) = played(&app).await;
    let lines: Vec<&str> = journal.lines().collect();
    let joined = |lines: &[&str]| lines.join("\n") + "\n";
    assert_eq!(joined(&lines), journal);
    for place in 0..lines.len() - 1 {
        let mut gone = lines.clone();
        gone.remove(place);
        let mut doubled = lines.clone();
        doubled.insert(place, lines[place]);
        let mut swapped = lines.clone();
        swapped.swap(place, place + 1);
        let unfinished = journal[..journal.len() - 1].to_owned();
        for changed in [joined(&gone), joined(&doubled), joined(&swapped), unfinished] {
            assert!(matches!(check(changed.as_bytes(), None), Err(Fault::Line { .. })));
        }
    }
}
