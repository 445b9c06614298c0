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
            0 | 6 => Reply::says(&format!("{words}\nACTION: UP")),
            1 => Reply::error(500, &words),
            2 => Reply::text(502, words.clone()).header("x-echo", words),
            3 => Reply::error(429, &words).header("retry-after", words),
            4 => Reply::text(200, words),
            5 => Reply::says(&words).breaking(),
            7 => Reply::json(
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
    for (round, tries) in [(0, 0), (1, 5), (3, 0)] {
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

/// The host of an address is in lower case, whatever the key is, and its path has escapes for some characters.
#[tokio::test]
async fn a_key_in_a_redirection_is_left_out() {
    for (key, to, shown) in [
        (KEY.to_ascii_uppercase(), "https://KEY.example/v1", "https://[key].example/v1"),
        (format!("{KEY}{{`\""), "http://x/KEY/v1", "an address that cannot be read"),
    ] {
        let to = to.replace("KEY", &key);
        let endpoint =
            Endpoint::start(move |_, _| Reply::text(302, "").header("location", to.clone())).await;
        let mut bench = Bench::new(&endpoint);
        bench.settings.key = swarmbench_client::llm::ApiKey::new("A_KEY", Some(key));
        let stop = bench.model().answer(&question(0, 0)).await.expect_err("no answer").to_string();
        assert!(stop.contains(shown) && !stop.contains(KEY), "{stop}");
    }
}

/// Texts are cut after the key is left out of them, and the type of a body is a text of the endpoint, too.
#[tokio::test]
async fn a_key_at_a_cut_or_in_a_type_is_left_out() {
    const PART: &str = "sk-test-0123";
    for streams in [false, true] {
        let endpoint = Endpoint::start(move |_, _| {
            if !streams {
                return Reply::text(200, "hm").header("content-type", format!("text/{KEY}"));
            }
            // A text has 300 characters at most: the end would be within the key.
            let event = serde_json::json!({ "a": "x".repeat(260), "b": KEY, "type": "error" });
            Reply::text(200, format!("data: {event}\n\n"))
                .header("content-type", "text/event-stream")
        })
        .await;
        let bench = Bench::new(&endpoint);
        let stop = bench.model().answer(&question(0, 0)).await.expect_err("no answer");
        let said = stop.to_string();
        assert!(said.contains("[key]") && !said.contains(PART), "{said}");
    }
}
