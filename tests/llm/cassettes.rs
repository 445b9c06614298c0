//! Answers in a file.

use std::fs;
use std::path::Path;
use swarmbench_testkit::needs;

use serde_json::{Value, json};
use swarmbench_client::llm::{Cassette, Failure, Model, ModelAnswer, Question, Stop};
use tempfile::TempDir;

use crate::llm::endpoint::{Endpoint, Reply, completion};
use crate::llm::{Bench, KEY, ask, question};

const ROUNDS: u32 = 3;
const SEATS: u32 = 4;

/// An endpoint that says something else each time, and now and then fails as models do.
async fn moody() -> Endpoint {
    Endpoint::start(|number, _| match number % 4 {
        0 => Reply::says(&format!("ACTION: UP\nMSG: \"{number}\" ü\u{1}")),
        1 => Reply::json(200, &completion(&json!({ "refusal": "No." }), "stop")),
        2 => Reply::json(200, &completion(&json!({ "content": "A", "reasoning": "hm" }), "length")),
        _ => Reply::json(200, &json!({ "choices": [] })),
    })
    .await
}

fn questions() -> Vec<Question> {
    (0..ROUNDS).flat_map(|round| (0..SEATS).map(move |agent| question(agent, round))).collect()
}

async fn answers(model: &Model) -> Vec<ModelAnswer> {
    let mut answers = Vec::new();
    for question in questions() {
        answers.push(model.answer(&question).await.expect("an answer"));
    }
    answers
}

fn open(path: &Path) -> Cassette {
    Cassette::record(path).expect("a cassette")
}

fn lines(path: &Path) -> Vec<Value> {
    let text = fs::read_to_string(path).expect("a file");
    text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

struct Recorded {
    folder: TempDir,
    bench: Bench,
    answers: Vec<ModelAnswer>,
}

impl Recorded {
    /// A cassette with all answers; the endpoint is gone.
    async fn new() -> Self {
        let endpoint = moody().await;
        let bench = Bench::new(&endpoint);
        let folder = tempfile::tempdir().expect("a folder");
        let cassette = open(&folder.path().join("cassette.jsonl"));
        let model = bench.model_on(Some(&cassette));
        let answers = answers(&model).await;
        assert_eq!(endpoint.seen().len(), 12);
        assert_eq!(cassette.answers(), 12);
        Self { folder, bench, answers }
    }

    fn path(&self) -> std::path::PathBuf {
        self.folder.path().join("cassette.jsonl")
    }

    fn replay(&self) -> Model {
        let cassette = Cassette::replay(&self.path()).expect("a cassette");
        assert!(cassette.is_replay());
        self.bench.model_on(Some(&cassette))
    }
}

#[tokio::test]
async fn a_recording_is_played_again_without_the_endpoint() {
    let recorded = Recorded::new().await;
    let model = recorded.replay();
    assert_eq!(answers(&model).await, recorded.answers);
    let failures: Vec<_> = recorded.answers.iter().filter_map(|answer| answer.failure).collect();
    assert!(failures.contains(&Failure::Refusal) && failures.contains(&Failure::Empty));
    let spent = model.spent();
    assert_eq!((spent.requests, spent.replayed, spent.prompt_tokens), (0, 12, 0));
    assert_eq!(spent.failures.total(), 9);
    // It needs no key, no address that answers, and no budget.
    let again = answers(&recorded.replay()).await;
    assert_eq!(again, recorded.answers);
}

#[tokio::test]
async fn the_file_is_lines_that_say_what_they_are() {
    let recorded = Recorded::new().await;
    let lines = lines(&recorded.path());
    assert_eq!(lines.len(), 1 + 1 + 12);
    assert_eq!(lines[0], json!({ "cassette": "swarmbench", "version": 1 }));
    assert_eq!(lines[1], json!({ "voice": 0, "body": { "model": "swarm-1" } }));
    assert_eq!(
        lines[3],
        json!({
            "voice": 0,
            "game": "Transport/27",
            "agent": "Agent_1",
            "round": 0,
            "prompt": "7c71c7a5d7defeb18cebfdcb89cea151dd6cc8646a0f5233b61f7e50ad96c9ed",
            "answer": {
                "response": "",
                "usage": { "prompt_tokens": 10, "completion_tokens": 5, "latency_ms": 0 },
                "reasoning": "[refusal] No.",
                "failure": "refusal",
            },
        })
    );
    let text = fs::read_to_string(recorded.path()).expect("a file");
    assert!(!text.contains(KEY) && !text.contains("127.0.0.1"));
}

#[tokio::test]
async fn an_interrupted_recording_pays_for_no_answer_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    let endpoint = moody().await;
    let bench = Bench::new(&endpoint);
    let asked = questions();
    let mut first = Vec::new();
    {
        let model = bench.model_on(Some(&open(&path)));
        for question in &asked[..5] {
            first.push(model.answer(question).await.expect("an answer"));
        }
    }
    // It is killed while it writes the next line.
    let whole = fs::read(&path).expect("a file");
    for cut in [0, 1, 17, 60] {
        let mut torn = whole.clone();
        torn.extend_from_slice(
            &br#"{"voice":0,"game":"Transport/27","agent":"Agent_1","round":1,"prompt":"#[..cut],
        );
        fs::write(&path, &torn).expect("it is written");
        let replay = Cassette::replay(&path).expect("a cassette");
        assert_eq!(replay.answers(), 5);
        assert_eq!(fs::read(&path).expect("a file"), torn, "who only reads changes nothing");
        drop(open(&path));
        assert_eq!(fs::read(&path).expect("a file"), whole);
    }
    let model = bench.model_on(Some(&open(&path)));
    let all = answers(&model).await;
    assert_eq!(all[..5], first);
    assert_eq!(endpoint.seen().len(), 12, "no question was asked twice");
    assert_eq!((model.spent().replayed, model.spent().answers), (5, 7));
    drop(model);
    endpoint.release();
    assert_eq!(
        answers(&bench.model_on(Some(&Cassette::replay(&path).expect("it is whole")))).await,
        all
    );
}

#[tokio::test]
async fn a_first_line_that_is_torn_is_written_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    for cut in [0, 1, 20] {
        fs::write(&path, &br#"{"cassette":"swarmbench","version":1}"#[..cut])
            .expect("it is written");
        drop(open(&path));
        assert_eq!(lines(&path), [json!({ "cassette": "swarmbench", "version": 1 })]);
        fs::remove_file(&path).expect("it is there");
    }
}

#[tokio::test]
async fn a_game_that_goes_another_way_is_not_made_up() {
    let recorded = Recorded::new().await;
    let why = async |question: Question| {
        let stop = recorded.replay().answer(&question).await.expect_err("it is not there");
        let Stop::NotOnCassette { ref why, .. } = stop else { panic!("{stop:?}") };
        let text = stop.to_string();
        assert!(text.contains(&question.game) && text.contains("cassette.jsonl"), "{text}");
        assert!(
            text.contains(&format!("{} in round {}", question.agent, question.round)),
            "{text}"
        );
        why.clone()
    };
    let asked = question(1, 1);
    let other = Question { prompt: "Something else".to_owned(), ..asked.clone() };
    assert!(why(other).await.contains("the game has gone another way"));
    assert!(why(question(1, ROUNDS)).await.contains("the recording ends before this"));
    let other = Question { game: "Transport/28".to_owned(), ..asked };
    assert!(why(other).await.contains("no game of this name"));
    // Another temperature is another model.
    let cassette = Cassette::replay(&recorded.path()).expect("a cassette");
    let mut bench = Bench { settings: recorded.bench.settings.clone(), ..recorded.bench };
    bench.settings.sampling.temperature = Some(0.5);
    let stop =
        bench.model_on(Some(&cassette)).answer(&question(0, 0)).await.expect_err("no answer");
    let text = stop.to_string();
    assert!(
        text.contains(r#"{"model":"swarm-1","temperature":0.5}, but of {"model":"swarm-1"}"#),
        "{text}"
    );
}

#[tokio::test]
async fn a_recording_takes_up_what_is_new_beside_what_it_has() {
    let recorded = Recorded::new().await;
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::new(&endpoint);
    let asked = question(1, 1);
    let other = Question { prompt: "Something else".to_owned(), ..asked.clone() };
    let old = {
        let cassette = open(&recorded.path());
        let model = bench.model_on(Some(&cassette));
        assert_eq!(model.answer(&other).await.expect("an answer").response, "ACTION: UP");
        // Another model is recorded on the same cassette.
        bench.settings.model = "swarm-2".to_owned();
        let second = bench.model_on(Some(&cassette));
        assert_eq!(second.answer(&asked).await.expect("an answer").response, "ACTION: UP");
        assert_eq!(endpoint.seen().len(), 2);
        model.answer(&asked).await.expect("an answer")
    };
    assert_eq!(old, recorded.answers[5]);
    let model = recorded.replay();
    assert_eq!(answers(&model).await, recorded.answers);
    assert_eq!(model.answer(&other).await.expect("an answer").response, "ACTION: UP");
    let cassette = Cassette::replay(&recorded.path()).expect("a cassette");
    assert_eq!(
        bench.model_on(Some(&cassette)).answer(&asked).await.expect("one").response,
        "ACTION: UP"
    );
    assert_eq!(endpoint.seen().len(), 2);
}

#[tokio::test]
async fn many_ask_at_once_and_every_answer_is_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    let endpoint = moody().await;
    let bench = Bench::with(&endpoint, crate::llm::time::Leaps::leaping(), 16, None);
    let model = bench.model_on(Some(&open(&path)));
    let asked: Vec<_> = questions().into_iter().map(|question| ask(&model, question)).collect();
    let mut given = Vec::new();
    for asked in asked {
        given.push(asked.await.expect("no panic").expect("an answer"));
    }
    let replay = Cassette::replay(&path).expect("a cassette");
    assert_eq!(answers(&bench.model_on(Some(&replay))).await, given);
}

#[tokio::test]
async fn other_files_are_left_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("notes");
    let header = r#"{"cassette":"swarmbench","version":1}"#;
    let voice = r#"{"voice":0,"body":{}}"#;
    for (text, words) in [
        ("my notes".to_owned(), "is another kind of file"),
        ("{\"cassette\":\"rock\",\"version\":1}\n".to_owned(), "is another kind of file"),
        ("{\"a\": 1}\n{}\n".to_owned(), "is another kind of file"),
        (header.replace('1', "2") + "\n", "is of version 2, and this program reads version 1"),
        (format!("{header}\n{voice}\nnonsense\n{voice}\n"), "line 3 is not one of a cassette"),
        (format!("{header}\n{voice}\n{voice}\n"), "line 3 names a model that is not there"),
        (
            format!(
                "{header}\n{}\n",
                json!({ "voice": 0, "game": "", "agent": "", "round": 0, "prompt": "", "answer": { "response": "" } })
            ),
            "line 2 names a model that is not there",
        ),
    ] {
        fs::write(&path, &text).expect("it is written");
        for opened in [Cassette::record(&path), Cassette::replay(&path)] {
            let Err(stop @ Stop::Cassette { .. }) = opened else { panic!("{text:?} is taken") };
            assert!(stop.to_string().contains(words), "{stop}");
        }
        assert_eq!(fs::read_to_string(&path).expect("a file"), text);
    }
}

#[tokio::test]
async fn a_cassette_that_cannot_be_used_says_why() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cassette.jsonl");
    let stop = Cassette::replay(&path).expect_err("it is not there");
    assert!(stop.to_string().contains("cassette.jsonl: No such file"), "{stop}");
    fs::write(&path, "").expect("it is written");
    let stop = Cassette::replay(&path).expect_err("it is empty");
    assert!(stop.to_string().contains("it is empty"), "{stop}");
    let stop = Cassette::record(Path::new("/dev/full")).expect_err("it is a device");
    assert!(stop.to_string().contains("no regular file"), "{stop}");
    let stop = Cassette::record(folder.path()).expect_err("it is a folder");
    assert!(stop.to_string().contains("directory"), "{stop}");
    let _first = open(&path);
    let stop = Cassette::record(&path).expect_err("it is in use");
    assert!(stop.to_string().contains("another process records on it"), "{stop}");
    Cassette::replay(&path).expect("who only reads may do so meanwhile");
}

/// A disk that is full is a small file system of its own, which needs Linux and the right to mount one.
#[cfg(target_os = "linux")]
#[needs(root)]
#[tokio::test]
async fn an_answer_that_cannot_be_kept_stops_and_a_larger_disk_goes_on() {
    use rustix::mount::{MountFlags, UnmountFlags, mount, mount_remount, unmount};

    struct Mounted(TempDir);

    impl Drop for Mounted {
        fn drop(&mut self) {
            if let Err(error) = unmount(self.0.path(), UnmountFlags::DETACH) {
                eprintln!("{} stays mounted: {error}", self.0.path().display());
            }
        }
    }

    let folder = tempfile::tempdir().expect("a folder");
    mount("tmpfs", folder.path(), "tmpfs", MountFlags::empty(), c"size=16k")
        .expect("root may mount");
    let folder = Mounted(folder);
    let path = folder.0.path().join("cassette.jsonl");
    let endpoint =
        Endpoint::start(|_, _| Reply::says(&format!("{}\nACTION: UP", "x".repeat(3000)))).await;
    let bench = Bench::new(&endpoint);
    let mut kept = 0;
    {
        let cassette = open(&path);
        let model = bench.model_on(Some(&cassette));
        let stop = loop {
            match model.answer(&question(0, kept)).await {
                Ok(_) => kept += 1,
                Err(stop) => break stop,
            }
        };
        assert!(kept > 0 && stop.to_string().contains("No space left"), "{stop}");
        assert_eq!(model.answer(&question(0, 0)).await.expect("it is there").retries, 0);
        assert_eq!(model.answer(&question(0, kept)).await, Err(stop));
        // Nothing is written after what is torn.
        bench.model_on(Some(&cassette)).answer(&question(0, kept)).await.expect_err("no room");
        assert_eq!(cassette.answers(), kept as usize);
    }
    let before = endpoint.seen().len();
    mount_remount(folder.0.path(), MountFlags::empty(), "size=1m").expect("it can grow");
    let model = bench.model_on(Some(&open(&path)));
    for round in 0..=kept {
        model.answer(&question(0, round)).await.expect("an answer");
    }
    assert_eq!(endpoint.seen().len(), before + 1);
    assert_eq!(Cassette::replay(&path).expect("it is whole").answers(), kept as usize + 1);
}
