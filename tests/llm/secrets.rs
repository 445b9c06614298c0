//! The key is shown nowhere: not in the log, not in an error, not on a cassette, not in an act.

use std::io;
use std::sync::Mutex;

use swarmbench_client::llm::{Cassette, ModelAnswer, Stop};

use crate::llm::endpoint::{Endpoint, Reply};
use crate::llm::{Bench, KEY, question};

/// All that this process has logged.
static LOG: Mutex<Vec<u8>> = Mutex::new(Vec::new());

struct Log;

impl io::Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        LOG.lock().expect("a lock").extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// An endpoint that shows the key wherever it can.
async fn indiscreet() -> Endpoint {
    Endpoint::start(|number, seen| {
        let shown = seen.headers["authorization"].to_str().expect("a text");
        let words = format!("You are {shown}, {shown}");
        match number {
            0 => Reply::error(500, &words),
            1 => Reply::text(502, words.clone()).header("x-echo", words),
            2 => Reply::error(429, &words).header("retry-after", words),
            3 => Reply::text(200, words),
            4 => Reply::says(&words).breaking(),
            5 => Reply::says(&format!("{words}\nACTION: UP")),
            6 => Reply::json(
                200,
                &serde_json::json!({ "choices": [{ "message": { "refusal": words, "reasoning": words } }] }),
            ),
            _ => Reply::error(401, &words),
        }
    })
    .await
}

#[tokio::test]
async fn the_key_is_nowhere() {
    let subscriber = tracing_subscriber::fmt()
        .with_max_level(tracing::Level::TRACE)
        .with_ansi(false)
        .with_writer(|| Log)
        .finish();
    // For all threads, as a connection has tasks of its own; what other tests log is searched too.
    tracing::subscriber::set_global_default(subscriber).expect("the only one");
    let endpoint = indiscreet().await;
    let bench = Bench::new(&endpoint);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    let cassette = Cassette::record(&path).expect("a cassette");
    let model = bench.model_on(Some(&cassette));
    let mut texts = Vec::new();
    for (round, tries) in [(0, 5), (1, 0)] {
        let answer = model.answer(&question(0, round)).await.expect("an answer");
        assert_eq!(answer.retries, tries);
        let ModelAnswer { response, reasoning, .. } = answer;
        texts.extend([response, reasoning.unwrap_or_default()]);
    }
    assert!(
        texts.iter().all(|text| text.is_empty() || text.contains("You are Bearer [key]")),
        "{texts:?}"
    );
    let stop = model.answer(&question(0, 2)).await.expect_err("it stops");
    assert!(matches!(stop, Stop::WrongKey { .. }), "{stop:?}");
    texts.extend([
        stop.to_string(),
        format!("{stop:?} {model:?} {cassette:?} {:?} {:?}", bench.settings, bench.allowance),
        std::fs::read_to_string(&path).expect("a file"),
    ]);
    let logged = String::from_utf8(LOG.lock().expect("a lock").clone()).expect("UTF-8");
    assert!(logged.matches("no answer: ").count() >= 5, "{logged}");
    assert!(logged.contains("500, You are Bearer [key]"), "{logged}");
    texts.push(logged);
    for text in texts {
        assert!(!text.contains(KEY), "{text}");
        assert!(!text.contains(&KEY[..10]) && !text.contains(&KEY[KEY.len() - 10..]), "{text}");
    }
}

#[tokio::test]
async fn a_key_that_is_a_common_word_changes_no_answer() {
    let endpoint = Endpoint::replies(vec![Reply::says("The cell is EMPTY.\nACTION: UP")]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.key = swarmbench_client::llm::ApiKey::new("LOCAL_KEY", Some("EMPTY".to_owned()));
    let answer = bench.model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(answer.response, "The cell is EMPTY.\nACTION: UP");
}
