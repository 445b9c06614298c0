//! Vectors of texts: asked in batches, kept in a file, played from it.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};

use data_encoding::BASE64;
use serde_json::{Value, json};
use swarmbench_analysis::Embedder;
use swarmbench_client::embed::{BATCH_TEXTS_MAX, Embeddings, Error, Flaw, VectorFile, Vectors};
use swarmbench_client::llm::Stop;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use crate::Bench;
use crate::endpoint::{Endpoint, Reply, Seen};
use crate::game::fake_model;
use crate::time::Leaps;

/// The texts of a request.
fn sent(seen: &Seen) -> Vec<String> {
    serde_json::from_value(seen.body["input"].clone()).expect("texts")
}

/// A good answer, with the items of `data` as a test wants them.
fn answer(seen: &Seen, shape: impl Fn(usize, &[f32]) -> Value) -> Value {
    let vectors = sent(seen).iter().map(|text| fake_model::vector(text)).collect::<Vec<_>>();
    let data: Vec<_> = vectors.iter().enumerate().map(|(at, vector)| shape(at, vector)).collect();
    json!({ "object": "list", "data": data, "usage": { "prompt_tokens": 7, "total_tokens": 7 } })
}

fn numbered(index: usize, vector: &[f32]) -> Value {
    json!({ "object": "embedding", "index": index, "embedding": vector })
}

fn good(seen: &Seen) -> Reply {
    Reply::json(200, &answer(seen, numbered))
}

fn texts(count: usize) -> Vec<String> {
    (0..count).map(|number| format!("hold slot {number}")).collect()
}

fn embeddings(bench: &Bench, file: Option<VectorFile>) -> Embeddings {
    Embeddings::new(bench.settings.clone(), &bench.allowance, file).expect("good settings")
}

async fn ask(embeddings: &Embeddings, texts: &[String]) -> Result<Vectors, Error> {
    embeddings.vectors(texts.to_vec(), |_, _| {}, &CancellationToken::new()).await
}

/// Compares vectors with those of the fake model.
fn check(vectors: &Vectors, texts: &[String]) {
    for text in texts {
        let vector = vectors.vector(text).expect("a vector");
        let raw: Vec<f64> = fake_model::vector(text).into_iter().map(f64::from).collect();
        let norm = raw.iter().map(|component| component * component).sum::<f64>().sqrt();
        assert_eq!(vector.len(), raw.len());
        for (unit, raw) in vector.iter().zip(raw) {
            assert!((unit * norm - raw).abs() < 1e-12, "{text}");
        }
    }
}

#[tokio::test]
async fn different_texts_are_asked_once_in_batches() {
    let first =
        Endpoint::start(|number, seen| good(seen).held_until(usize::from(number < 4))).await;
    let bench = Bench::with(&first, Leaps::leaping(), 16, None);
    let embeddings = Arc::new(embeddings(&bench, None));
    let all = texts(5 * BATCH_TEXTS_MAX + 3);
    let seen = Arc::new(Mutex::new(Vec::new()));
    let asked = tokio::spawn({
        let (embeddings, all, seen) = (embeddings.clone(), all.clone(), seen.clone());
        async move {
            let repeated = all.iter().chain(&all).cloned();
            let progress = |done, of| seen.lock().expect("a lock").push((done, of));
            embeddings.vectors(repeated, progress, &CancellationToken::new()).await
        }
    });
    first.has_seen(4).await;
    first.release();
    let vectors = asked.await.expect("no panic").expect("vectors");
    check(&vectors, &all);
    assert_eq!(vectors.id(), "endpoint:swarm-1");
    assert_eq!(vectors.vector("never asked"), None);
    let requests = first.seen();
    let came: Vec<_> = requests.iter().flat_map(sent).collect();
    assert_eq!((requests.len(), came.len()), (6, all.len()));
    assert_eq!(came.into_iter().collect::<BTreeSet<_>>(), all.iter().cloned().collect());
    assert_eq!(first.most_at_once(), 4);
    for request in requests {
        assert_eq!(request.uri.path(), "/v1/embeddings");
        assert_eq!(request.headers["authorization"], format!("Bearer {}", crate::KEY));
        let input = &request.body["input"];
        assert_eq!(request.body, json!({ "model": "swarm-1", "input": input }));
    }
    let progress = seen.lock().expect("a lock").clone();
    assert_eq!((progress[0], progress.last()), ((0, all.len()), Some(&(all.len(), all.len()))));
    assert!(progress.is_sorted() && progress.len() == 7, "{progress:?}");
    let spent = embeddings.spent();
    assert_eq!((spent.requests, spent.answers, spent.prompt_tokens), (6, 6, 42));
    assert_eq!(bench.allowance.spent(), 42);
}

#[tokio::test]
async fn the_offline_model_gives_vectors() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = listener.local_addr().expect("an address");
    let server = tokio::spawn(async move { axum::serve(listener, fake_model::router()).await });
    let nobody = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&nobody);
    bench.settings.api_base = format!("http://{address}/v1");
    let all = texts(40);
    check(&ask(&embeddings(&bench, None), &all).await.expect("vectors"), &all);
    server.abort();
}

#[tokio::test]
async fn answers_of_all_servers_are_read() {
    type Shape = fn(&Seen) -> Value;
    let shapes: [(&str, Shape); 5] = [
        ("another order", |seen| {
            let mut value = answer(seen, numbered);
            value["data"].as_array_mut().expect("a list").reverse();
            value
        }),
        ("no index", |seen| answer(seen, |_, vector| json!({ "embedding": vector }))),
        ("base64", |seen| {
            answer(seen, |index, vector| {
                let bytes: Vec<u8> = vector.iter().flat_map(|x| x.to_le_bytes()).collect();
                json!({ "index": index, "embedding": BASE64.encode(&bytes) })
            })
        }),
        ("64 bits", |seen| {
            let wide = |vector: &[f32]| vector.iter().map(|x| f64::from(*x)).collect::<Vec<_>>();
            answer(seen, |index, vector| json!({ "index": index, "embedding": wide(vector) }))
        }),
        ("no usage", |seen| json!({ "data": answer(seen, numbered)["data"] })),
    ];
    for (name, shape) in shapes {
        let endpoint = Endpoint::start(move |_, seen| Reply::json(200, &shape(seen))).await;
        let bench = Bench::new(&endpoint);
        let embeddings = embeddings(&bench, None);
        let all = texts(3);
        check(&ask(&embeddings, &all).await.expect(name), &all);
        let unmetered = u64::from(name == "no usage");
        assert_eq!(embeddings.spent().unmetered, unmetered, "{name}");
        // Without usage, four bytes are a token: three texts of 11 bytes.
        assert_eq!(bench.allowance.spent(), if unmetered == 1 { 9 } else { 7 }, "{name}");
    }
}

#[tokio::test]
async fn a_vector_that_cannot_be_compared_is_an_error_with_the_number_of_its_text() {
    type Spoil = fn(&mut Vec<Value>);
    let cases: [(&str, Spoil, usize, Flaw); 10] = [
        ("one too few", |data| drop(data.remove(1)), 2, Flaw::Count { texts: 3, vectors: 2 }),
        ("none", Vec::clear, 1, Flaw::Count { texts: 3, vectors: 0 }),
        (
            "one too many",
            |data| data.push(data[0].clone()),
            1,
            Flaw::Count { texts: 3, vectors: 4 },
        ),
        ("twice the same index", |data| data[2]["index"] = json!(1), 3, Flaw::Missing),
        ("no such index", |data| data[0]["index"] = json!(-1), 1, Flaw::Missing),
        ("null", |data| data[1]["embedding"][3] = Value::Null, 2, Flaw::NotFinite),
        ("too large", |data| data[1]["embedding"][3] = json!(1e39), 2, Flaw::NotFinite),
        ("zero", |data| data[2]["embedding"] = json!([0.0, 0.0]), 3, Flaw::Zero),
        ("words", |data| data[2]["embedding"] = json!("not base64!"), 3, Flaw::Unreadable),
        (
            "another length",
            |data| data[1]["embedding"] = json!([1.0]),
            2,
            Flaw::Dimensions { expected: 64, came: 1 },
        ),
    ];
    for (name, spoil, number, flaw) in cases {
        let endpoint = Endpoint::start(move |_, seen| {
            let mut value = answer(seen, numbered);
            spoil(value["data"].as_array_mut().expect("a list"));
            Reply::json(200, &value)
        })
        .await;
        let bench = Bench::new(&endpoint);
        let error = ask(&embeddings(&bench, None), &texts(3)).await.expect_err(name);
        let model = "swarm-1".to_owned();
        assert_eq!(error, Error::Vector { model, text: number, of: 3, flaw }, "{name}");
        assert!(error.to_string().contains(&format!("text {number} of 3")), "{error}");
        assert_eq!(endpoint.seen().len(), 1, "{name}: it would say the same again");
    }
}

#[tokio::test]
async fn components_that_json_does_not_have_are_not_finite() {
    for component in ["NaN", "Infinity", "-Infinity"] {
        let body = format!("{{\"data\": [{{\"index\": 0, \"embedding\": [1.0, {component}]}}]}}");
        let endpoint = Endpoint::start(move |_, _| Reply::text(200, body.clone())).await;
        let bench = Bench::new(&endpoint);
        let error = ask(&embeddings(&bench, None), &texts(1)).await.expect_err("no vector");
        assert!(matches!(error, Error::Vector { flaw: Flaw::NotFinite, .. }), "{error}");
    }
}

#[tokio::test]
async fn a_batch_that_is_too_large_is_halved() {
    for (status, words) in [
        (400, "batch size is invalid"),
        (413, "length limit exceeded"),
        (422, "batch size 32 > maximum allowed batch size 5"),
        (500, "input is too large to process"),
    ] {
        let endpoint = Endpoint::start(move |_, seen| match sent(seen).len() {
            0..=5 => good(seen),
            _ => Reply::error(status, words),
        })
        .await;
        let bench = Bench::new(&endpoint);
        let embeddings = embeddings(&bench, None);
        let all = texts(BATCH_TEXTS_MAX + 8);
        let (first, later) = all.split_at(BATCH_TEXTS_MAX);
        for texts in [first, later] {
            check(&ask(&embeddings, texts).await.expect("vectors"), texts);
        }
        let sizes: Vec<_> = endpoint.seen().iter().map(|seen| sent(seen).len()).collect();
        // What was learned from the first texts holds for later ones.
        assert_eq!(sizes, [vec![32, 16, 8], vec![4; 10]].concat(), "{status}");
        assert_eq!(bench.clock.pauses(), []);
    }
}

#[tokio::test]
async fn a_text_that_is_refused_alone_is_named() {
    let endpoint = Endpoint::start(|_, seen| match sent(seen) {
        texts if texts.iter().any(|text| text == "hold slot 6") => {
            Reply::error(422, "must have less than 512 tokens")
        }
        _ => good(seen),
    })
    .await;
    let bench = Bench::new(&endpoint);
    let embeddings = embeddings(&bench, None);
    let error = ask(&embeddings, &texts(10)).await.expect_err("it is too long");
    assert!(matches!(error, Error::Refused { text: 7, of: 10, status: 422, .. }), "{error}");
    for words in ["text 7 of 10", "--auto-truncate", "less than 512 tokens", "/v1/embeddings"] {
        assert!(error.to_string().contains(words), "{error}");
    }
    // It is the fault of the text, so others still have their vectors.
    ask(&embeddings, &texts(6)).await.expect("vectors");
}

#[tokio::test]
async fn what_may_pass_is_tried_again() {
    let wait = || Reply::error(429, "slow down").header("retry-after", "7");
    for (name, reply, pause) in [
        ("load", wait(), Some(7.0)),
        ("server", Reply::error(500, "oops"), None),
        ("half", Reply::text(200, "{\"data\": [{\"embedding\": [0.1, 0.2"), None),
        ("hang-up", Reply::text(200, "{\"data\": []}").breaking(), None),
        ("chat", Reply::says("ACTION: UP"), None),
    ] {
        let reply = Mutex::new(Some(reply));
        let next =
            move |seen: &Seen| reply.lock().expect("a lock").take().unwrap_or_else(|| good(seen));
        let endpoint = Endpoint::start(move |_, seen| next(seen)).await;
        let bench = Bench::new(&endpoint);
        let embeddings = embeddings(&bench, None);
        check(&ask(&embeddings, &texts(2)).await.expect(name), &texts(2));
        let pauses: Vec<_> =
            bench.clock.pauses().iter().map(std::time::Duration::as_secs_f64).collect();
        assert!(pauses.len() == 1 && (0.5..=7.0).contains(&pauses[0]), "{name}: {pauses:?}");
        assert!(pause.is_none_or(|pause| pauses == [pause]), "{name}: {pauses:?}");
        assert_eq!((endpoint.seen().len(), embeddings.spent().retries), (2, 1), "{name}");
    }
}

#[tokio::test]
async fn a_stop_names_the_options_of_the_embedder() {
    let later = Reply::error(429, "daily limit").header("retry-after", "7200");
    let away = Reply::text(307, "").header("location", "http://127.0.0.1:1/v1/embeddings");
    for (reply, words) in [
        (Reply::error(401, "no"), "--embedder-key-env"),
        (away, "name it with --embedder-url"),
        (later, "run the same command again then"),
        (Reply::error(404, "no model swarm-1"), "/v1/models lists the models"),
        (Reply::error(424, "`swarm-1` is not an embedding model"), "not an embedding model"),
    ] {
        let endpoint = Endpoint::replies(vec![reply]).await;
        let bench = Bench::new(&endpoint);
        let embeddings = embeddings(&bench, None);
        let error = ask(&embeddings, &texts(1)).await.expect_err("it stops");
        let text = error.to_string();
        assert!(text.contains(words) && !text.contains("--patience"), "{text}");
        assert_eq!(ask(&embeddings, &texts(1)).await, Err(error), "it stops for ever");
        assert_eq!(endpoint.seen().len(), 1);
    }
}

#[tokio::test]
async fn settings_that_the_id_does_not_name_are_refused() {
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.extra.insert("dimensions".to_owned(), json!(8));
    let error = Embeddings::new(bench.settings, &bench.allowance, None).expect_err("refused");
    assert!(matches!(&error, Stop::Settings(text) if text.contains("dimensions")), "{error}");
}

/// Asks for texts once, and keeps their vectors in a file.
async fn recorded(path: &Path, all: &[String]) -> Vectors {
    let endpoint = Endpoint::start(|_, seen| good(seen)).await;
    let bench = Bench::new(&endpoint);
    let embeddings = embeddings(&bench, Some(VectorFile::record(path).expect("a file")));
    let vectors = ask(&embeddings, all).await.expect("vectors");
    let requests = endpoint.seen().len();
    assert_eq!(ask(&embeddings, all).await.expect("vectors"), vectors);
    assert_eq!(endpoint.seen().len(), requests, "no text is asked for twice");
    vectors
}

fn played(model: &str, path: &Path) -> Embeddings {
    Embeddings::played(model.to_owned(), VectorFile::play(path).expect("a file"))
}

#[tokio::test]
async fn a_recording_replaces_the_endpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vectors.jsonl");
    let all = texts(50);
    let vectors = recorded(&path, &all).await;
    let file = fs::read_to_string(&path).expect("a file");
    assert_eq!(file.lines().next(), Some(r#"{"embeddings":"swarmbench","version":1}"#));
    assert_eq!(file.lines().count(), 51);
    assert!(!file.contains("hold slot") && !file.contains("127.0.0.1"));
    // The same bits, in whichever order.
    let embeddings = played("swarm-1", &path);
    let reversed: Vec<_> = all.iter().rev().cloned().collect();
    assert_eq!(ask(&embeddings, &reversed).await.expect("vectors"), vectors);
    assert_eq!(embeddings.spent(), swarmbench_client::llm::Spent::default());
    let error = ask(&embeddings, &texts(52)).await.expect_err("two are not there");
    assert!(matches!(error, Error::NotRecorded { text: 51, of: 52, .. }), "{error}");
    let error = ask(&played("swarm-2", &path), &all).await.expect_err("another model");
    assert!(matches!(&error, Error::NotRecorded { text: 1, model, .. } if model == "swarm-2"));
    assert_eq!(fs::read_to_string(&path).expect("a file"), file, "a player writes nothing");
}

#[tokio::test]
async fn a_cache_is_filled_up_and_shared_by_models() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vectors.jsonl");
    recorded(&path, &texts(40)).await;
    let endpoint = Endpoint::start(|_, seen| good(seen)).await;
    let mut bench = Bench::new(&endpoint);
    for (model, requests) in [("swarm-1", 1), ("swarm-2", 3), ("swarm-2", 3)] {
        model.clone_into(&mut bench.settings.model);
        let embeddings = embeddings(&bench, Some(VectorFile::record(&path).expect("a file")));
        check(&ask(&embeddings, &texts(42)).await.expect("vectors"), &texts(42));
        assert_eq!(endpoint.seen().len(), requests, "{model}");
    }
    assert_eq!(sent(&endpoint.seen()[0]), texts(42)[40..]);
}

#[tokio::test]
async fn damaged_vectors_are_left_out_and_asked_for_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vectors.jsonl");
    let all = texts(5);
    let vectors = recorded(&path, &all).await;
    let whole = fs::read_to_string(&path).expect("a file");
    let lines: Vec<&str> = whole.lines().collect();
    let replaced = |number: usize, line: &str| {
        let mut lines: Vec<_> = lines.iter().map(ToString::to_string).collect();
        line.clone_into(&mut lines[number]);
        lines.join("\n") + "\n"
    };
    let other = lines[2].replace("\"vector\":\"A", "\"vector\":\"B");
    assert_ne!(other, lines[2]);
    for (name, text, damaged, lost) in [
        ("cut", whole[..whole.len() - 9].to_owned(), 0, 4),
        ("another vector", replaced(2, &other), 1, 1),
        ("nonsense", replaced(3, "nonsense"), 1, 2),
        ("nothing", replaced(1, ""), 1, 0),
    ] {
        fs::write(&path, text).expect("it is written");
        let error = ask(&played("swarm-1", &path), &all).await.expect_err(name);
        assert!(matches!(error, Error::NotRecorded { text, .. } if text == lost + 1), "{error}");
        let endpoint = Endpoint::start(|_, seen| good(seen)).await;
        let bench = Bench::new(&endpoint);
        let file = VectorFile::record(&path).expect("a file");
        assert_eq!(file.damaged(), damaged, "{name}");
        assert_eq!(ask(&embeddings(&bench, Some(file)), &all).await.expect(name), vectors);
        let asked: Vec<_> = endpoint.seen().iter().flat_map(sent).collect();
        assert_eq!(asked, [all[lost].clone()], "{name}");
        assert_eq!(ask(&played("swarm-1", &path), &all).await.expect(name), vectors);
    }
}

#[tokio::test]
async fn other_files_are_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("notes");
    for (text, words) in [
        ("my notes", "is another kind of file"),
        ("{\"cassette\":\"swarmbench\",\"version\":1}\n", "is another kind of file"),
        ("{\"embeddings\":\"swarmbench\",\"version\":2}\n", "is of version 2"),
    ] {
        fs::write(&path, text).expect("it is written");
        for opened in [VectorFile::record(&path), VectorFile::play(&path)] {
            let error = opened.expect_err("it is not taken").to_string();
            assert!(error.contains(words) && error.contains("notes"), "{error}");
        }
        assert_eq!(fs::read_to_string(&path).expect("a file"), text);
    }
}

#[tokio::test]
async fn vectors_that_need_too_much_memory_are_refused_before_they_are_asked_for() {
    const LONG: usize = 200_000;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vectors.jsonl");
    let endpoint = Endpoint::start(|_, seen| {
        Reply::json(200, &answer(seen, |_, _| json!({ "embedding": vec![1; LONG] })))
    })
    .await;
    let bench = Bench::new(&endpoint);
    let embeddings = embeddings(&bench, Some(VectorFile::record(&path).expect("a file")));
    ask(&embeddings, &texts(1)).await.expect("a vector");
    let error = ask(&embeddings, &texts(700)).await.expect_err("700 times 1.6 MB");
    assert_eq!(error, Error::TooMany { texts: 700, dimensions: LONG });
    assert_eq!(endpoint.seen().len(), 1);
}

#[tokio::test]
async fn what_came_before_it_was_cancelled_is_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("vectors.jsonl");
    let endpoint = Endpoint::start(|number, seen| good(seen).held_until(number)).await;
    let bench = Bench::with(&endpoint, Leaps::leaping(), 1, None);
    let embeddings = embeddings(&bench, Some(VectorFile::record(&path).expect("a file")));
    let all = texts(2 * BATCH_TEXTS_MAX);
    let cancel = CancellationToken::new();
    let progress = |done, _| {
        if done == BATCH_TEXTS_MAX {
            cancel.cancel();
        }
    };
    let asked = embeddings.vectors(all.clone(), progress, &cancel);
    let ended = tokio::time::timeout(crate::endpoint::PATIENCE, asked).await.expect("it ends");
    assert_eq!(ended, Err(Error::Cancelled));
    assert_eq!(embeddings.spent().in_flight, 0);
    let first = &all[..BATCH_TEXTS_MAX];
    check(&ask(&played("swarm-1", &path), first).await.expect("vectors"), first);
    let cancelled = embeddings.vectors(all, |_, _| {}, &cancel).await;
    assert_eq!(cancelled, Err(Error::Cancelled));
}

/// The program measures a journal with a model, keeps the vectors, and measures it again without the endpoint.
#[tokio::test(flavor = "multi_thread")]
async fn a_journal_is_measured_with_a_model_and_again_from_its_recording() {
    let endpoint = Endpoint::start(|_, seen| good(seen)).await;
    let place = tempfile::tempdir().expect("a folder");
    let vectors = place.path().join("vectors.jsonl").display().to_string();
    let journal =
        concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/1/noise-and-delay-paper.jsonl");
    let metrics = async |more: &[&str]| {
        let first = ["metrics", journal, "--format", "json"];
        let mut program = Command::new(env!("CARGO_BIN_EXE_swarmbench"));
        program.args(first).args(more).env_remove("OPENAI_API_KEY");
        let output = tokio::task::spawn_blocking(move || program.output()).await;
        let output = output.expect("no panic").expect("it runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<Value>(&output.stdout).expect("JSON")
    };
    let model = ["--embedder", "endpoint:swarm-1"];
    let url = endpoint.base().to_owned();
    let asked =
        metrics(&[&model[..], &["--embedder-url", &url, "--embedder-record", &vectors]].concat())
            .await;
    let requests = endpoint.seen().len();
    assert!(requests > 0);
    let played = metrics(&[&model[..], &["--embedder-play", &vectors]].concat()).await;
    assert_eq!((&played, endpoint.seen().len()), (&asked, requests));
    let hashed = metrics(&[]).await;
    assert_eq!(
        (&asked["embedder"], &hashed["embedder"]),
        (&json!("endpoint:swarm-1"), &json!("hash-1"))
    );
    for (metric, value) in hashed["values"].as_object().expect("values") {
        let of_vectors =
            swarmbench_analysis::Metric::parse(metric).expect("a metric").about().of_vectors;
        assert_eq!(of_vectors, &asked["values"][metric] != value, "{metric}");
    }
}
