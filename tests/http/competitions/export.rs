//! The published file of a competition verifies, and every change of it is found.

use std::path::Path;
use std::process::Command;

use reqwest::Method;
use serde_json::{Value, json};
use swarmbench_boards::competition::export::{Line, Writer};
use swarmbench_boards::competition::sealed::Sealed;
use swarmbench_boards::competition::verify::{CompetitionReport, Expected, Fault, verify};
use swarmbench_boards::competition::{EntrantStatus, definition::Counts};
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;

use crate::cup::{Attempt, Cup, Entrant, server};

/// The export of a closed competition of two entrants: `blue` has two attempts, of which the second counts, `red` one
/// that was voided and one that counts; and of `green`, who was disqualified.
async fn published() -> (String, Value) {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let mut entrants: Vec<Entrant> = Vec::new();
    for name in ["blue", "red", "green"] {
        entrants.push(cup.enter(&app, name).await);
    }
    cup.start(&app, &entrants[0]).await.play(&app, 0).await;
    cup.start(&app, &entrants[0]).await.play(&app, 4).await;
    let broken = cup.start(&app, &entrants[1]).await;
    broken.act(&app, 4).await;
    cup.void(&app, &broken, "a power cut").await;
    cup.start(&app, &entrants[1]).await.play(&app, 2).await;
    cup.start(&app, &entrants[2]).await.play(&app, 4).await;
    let reason = json!({ "status": "disqualified", "reason": "two entrants of one team" });
    cup.change(&app, &entrants[2], reason).await;
    let path = format!("/api/v1/exports/competitions/{}", cup.id);
    app.get(&path).problem(403, "forbidden").await;
    crate::cup::pass_minutes(&app, 60).await;
    let shown = cup.closed(&app).await;
    let rows = cup.rows(&app, None).await;
    (cup.export(&app).await, json!({ "shown": shown, "rows": rows }))
}

fn check(file: &str, expected: Expected) -> Result<CompetitionReport, Fault> {
    verify(file.as_bytes(), expected, Solver::Flow, |_| {})
}

/// The file in pieces: its records, and the journal after each.
#[derive(Clone)]
struct File(Vec<(Line, Vec<String>)>);

impl File {
    fn read(text: &str) -> Self {
        let mut lines = text.lines();
        let mut pieces = Vec::new();
        while let Some(line) = lines.next() {
            let line: Value = serde_json::from_str(line).expect("JSON");
            let record = Line::parse(&line["record"].to_string()).expect("a record");
            let count = if let Line::Episode(header) = &record { header.lines } else { 0 };
            let journal = (0..count).map(|_| lines.next().expect("a line").to_owned()).collect();
            pieces.push((record, journal));
        }
        Self(pieces)
    }

    /// The file with a chain that fits.
    fn write(&self) -> String {
        let mut writer = Writer::default();
        let mut text = String::new();
        for (record, journal) in &self.0 {
            text.push_str(&writer.line(record));
            for line in journal {
                text.push_str(line);
                text.push('\n');
            }
        }
        text
    }

    /// Records are changed, and the chain is made to fit.
    fn forged(&self, mut change: impl FnMut(&mut Line)) -> String {
        let mut forged = self.clone();
        for (record, _) in &mut forged.0 {
            change(record);
        }
        forged.write()
    }

    fn places(&self, is: impl Fn(&Line) -> bool) -> Vec<usize> {
        let all = self.0.iter().enumerate().filter(|(_, (record, _))| is(record));
        all.map(|(place, _)| place).collect()
    }
}

fn refused(file: &str, says: &str) {
    match check(file, Expected::default()) {
        Ok(_) => panic!("nobody sees it: {says}"),
        Err(fault) => assert!(fault.to_string().contains(says), "{says:?}: {fault}"),
    }
}

#[tokio::test]
async fn what_is_published_verifies_and_shows_the_board() {
    let (file, shown) = published().await;
    let report = check(&file, Expected::default()).expect("it is true");
    assert_eq!((report.entrants.len(), report.attempts, report.episodes), (3, 5, 16));
    assert_eq!(report.rounds, 16 * 3);
    let totals = |rows: &[Value]| -> Vec<(Value, Value)> {
        rows.iter().map(|row| (row["rank"].clone(), row["total"].clone())).collect()
    };
    let rows: Vec<Value> =
        report.rows.iter().map(|row| json!({ "rank": row.rank, "total": row.total })).collect();
    let board = crate::app::list(&shown["rows"]);
    assert_eq!(totals(&rows), totals(&board));
    assert_eq!(board[2]["entrant"]["name"], "green");
    let commitment = shown["shown"]["commitment"].as_str().expect("a text");
    assert_eq!(report.competition.commitment, commitment);
    let hex = |text: &str| Head::parse(text).expect("32 bytes");
    let Head(commitment) = hex(commitment);
    let known = Expected { commitment: Some(commitment), head: Some(report.head) };
    check(&file, known).expect("it is the one that was published");
    let other = Expected { commitment: Some([1; 32]), head: None };
    let fault = check(&file, other).expect_err("others were published").to_string();
    assert!(fault.contains("the published commitment is 0101"), "{fault}");
    let other = Expected { commitment: None, head: Some(Head([1; 32])) };
    let fault = check(&file, other).expect_err("another file was published").to_string();
    assert!(fault.contains("not the file that was published"), "{fault}");
}

#[tokio::test]
async fn a_byte_that_is_changed_anywhere_is_found() {
    let (file, _) = published().await;
    let bytes = file.as_bytes();
    let step = bytes.len() / 150;
    let mut places: Vec<usize> = (0..bytes.len()).step_by(step).collect();
    // The last bytes of lines, and their ends.
    let ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at);
    places.extend(ends.step_by(7).flat_map(|at| [at - 1, at]));
    let mut named = 0;
    for place in &places {
        let mut changed = bytes.to_vec();
        changed[*place] ^= 1;
        let fault = verify(&changed[..], Expected::default(), Solver::Flow, |_| {});
        let fault = fault.expect_err("one byte is another").to_string();
        let line = bytes[..*place].split(|byte| *byte == b'\n').count();
        named += usize::from(fault.starts_with(&format!("line {line} ")));
    }
    // An end of a line that is gone makes one line of two, which is told of the second one's beginning.
    assert!(named * 10 > places.len() * 9, "{named} of {}", places.len());
    // What is cut off, and what is added.
    for cut in [1, step, bytes.len() / 2, bytes.len() - 1] {
        let fault = verify(&bytes[..bytes.len() - cut], Expected::default(), Solver::Flow, |_| {});
        fault.expect_err("something is missing");
    }
    refused(&format!("{file}{}", file.lines().next().expect("a line")), "line");
    refused("", "empty");
}

#[expect(clippy::too_many_lines, reason = "a list of forgeries")]
#[tokio::test]
async fn every_forgery_is_found_though_its_chain_fits() {
    let (text, _) = published().await;
    let file = File::read(&text);
    assert_eq!(file.write(), text, "pieces make the whole again");
    let episodes = file.places(|line| matches!(line, Line::Episode(_)));
    let attempts = file.places(|line| matches!(line, Line::Attempt(_)));

    // A game that is missing, and two in each other's place.
    let mut forged = file.clone();
    forged.0.remove(episodes[2]);
    refused(&forged.write(), "is in its place");
    let mut forged = file.clone();
    forged.0.remove(episodes[15]);
    refused(&forged.write(), "is missing");
    let mut forged = file.clone();
    forged.0.swap(episodes[0], episodes[1]);
    refused(&forged.write(), "is in its place");
    // The attempt names them in each other's place, too: then their seeds are wrong.
    let mut forged = file.clone();
    let (first, second) = (episodes[0], episodes[1]);
    forged.0.swap(first, second);
    for (place, slot) in [(first, 0), (second, 1)] {
        let Line::Episode(header) = &mut forged.0[place].0 else { panic!("no episode") };
        header.slot = slot;
    }
    let Line::Attempt(attempt) = &mut forged.0[attempts[0]].0 else { panic!("no attempt") };
    let ids: Vec<String> = attempt.games.iter().map(|game| game.episode.clone()).collect();
    attempt.games[0].episode = ids[1].clone();
    attempt.games[1].episode = ids[0].clone();
    refused(&forged.write(), "the sealed seed of its place");
    // A game of somebody else who played on the same seed.
    let mut forged = file.clone();
    let (own, other) = (episodes[0], episodes[8]);
    let (header, journal) = file.0[other].clone();
    let Line::Episode(mut header) = header else { panic!("no episode") };
    header.slot = 0;
    let id = header.episode.clone();
    forged.0[own] = (Line::Episode(header), journal);
    let Line::Attempt(attempt) = &mut forged.0[attempts[0]].0 else { panic!("no attempt") };
    attempt.games[0].episode = id;
    refused(&forged.write(), "not to the run");
    // The same game twice.
    let mut forged = file.clone();
    let Line::Attempt(attempt) = &mut forged.0[attempts[0]].0 else { panic!("no attempt") };
    let game = attempt.games[0].clone();
    attempt.games.insert(1, game);
    refused(&forged.write(), "the attempt has game 0 twice");

    // Another act in a journal, whose own chain is made to fit.
    let mut forged = file.clone();
    let place = episodes[4];
    let mut head = Head::START;
    let mut changed = false;
    for line in &mut forged.0[place].1 {
        let start = line.find("\"record\":").expect("a record") + "\"record\":".len();
        let mut record = line[start..line.len() - 1].to_owned();
        if !changed && record.contains("\"SWITCH\"") {
            record = record.replacen("\"SWITCH\"", "\"UP\"", 1);
            changed = true;
        }
        head = head.link(record.as_bytes());
        *line = format!("{{\"hash\":\"{head}\",\"record\":{record}}}");
    }
    assert!(changed, "nobody switched");
    let Line::Episode(header) = &mut forged.0[place].0 else { panic!("no episode") };
    header.head = head.to_string();
    refused(&forged.write(), "differs");

    // Seeds, salt, commitment.
    let competition =
        |change: &dyn Fn(&mut swarmbench_boards::competition::export::Competition)| {
            file.forged(|line| {
                if let Line::Competition(competition) = line {
                    change(competition);
                }
            })
        };
    refused(&competition(&|c| c.seeds.swap(0, 1)), "salt and seeds hash to");
    refused(&competition(&|c| c.salt = "00".repeat(32)), "salt and seeds hash to");
    refused(&competition(&|c| c.commitment = "00".repeat(32)), "the commitment is 0000");
    refused(&competition(&|c| drop(c.seeds.pop())), "there are 3 sealed seeds");
    // A seed that was exchanged with a commitment that fits.
    let exchanged = competition(&|c| {
        let bytes = |text: &str| data_encoding::HEXLOWER.decode(text.as_bytes()).expect("hex");
        c.seeds[0] = "ab".repeat(16);
        let seeds = c.seeds.iter().map(|seed| bytes(seed).try_into().expect("16 bytes"));
        let salt = bytes(&c.salt).try_into().expect("32 bytes");
        let sealed = Sealed { salt, seeds: seeds.collect() };
        c.commitment = data_encoding::HEXLOWER.encode(&sealed.commitment());
    });
    refused(&exchanged, "the sealed seed of its place");
    // The rules of the game.
    refused(&competition(&|c| c.definition.settings.num_agents = 4), "setting num_agents");
    refused(&competition(&|c| c.definition.settings.bank_ms = 1), "setting bank_ms");
    refused(&competition(&|c| c.definition.rules = "reference".to_owned()), "setting rules");
    let earlier: jiff::Timestamp = "2026-03-01T12:59:00Z".parse().expect("a time");
    refused(&competition(&|c| c.definition.attempts[0].closes_at = earlier), "setting closes_at");
    let later: jiff::Timestamp = "2026-03-01T12:30:00Z".parse().expect("a time");
    refused(&competition(&|c| c.definition.attempts[0].opens_at = later), "it was started at");
    refused(&competition(&|c| c.definition.counts = Counts::First), "row 1:");
    refused(&competition(&|c| c.definition.name = String::new()), "name must be");

    // Attempts and entrants.
    let attempt =
        |number: usize, change: &dyn Fn(&mut swarmbench_boards::competition::export::Attempt)| {
            let mut forged = file.clone();
            let Line::Attempt(attempt) = &mut forged.0[attempts[number]].0 else { panic!("none") };
            change(attempt);
            forged.write()
        };
    refused(&attempt(0, &|a| a.attempt = 2), "the sealed seed of its place");
    refused(&attempt(0, &|a| a.attempt = 3), "fewer attempts");
    refused(&attempt(1, &|a| a.attempt = 1), "it was played twice");
    refused(&attempt(0, &|a| a.entrant = "ent_0".to_owned()), "no such entrant");
    refused(&attempt(2, &|a| a.voided = None), "it was played twice");
    // One that counted is said to be broken, and its games are left out.
    let mut forged = file.clone();
    forged.0.drain(attempts[1] + 1..attempts[2]);
    let Line::Attempt(gone) = &mut forged.0[attempts[1]].0 else { panic!("no attempt") };
    gone.voided = Some("a power cut".to_owned());
    gone.games.clear();
    refused(&forged.write(), "no action says so");
    // One that did not count is left out altogether.
    let mut forged = file.clone();
    forged.0.drain(attempts[0]..attempts[1]);
    refused(&forged.write(), "row ");
    let entrant =
        |name: &str, change: &dyn Fn(&mut swarmbench_boards::competition::entrant::Entrant)| {
            file.forged(|line| {
                if let Line::Entrant(entrant) = line
                    && entrant.name == name
                {
                    change(entrant);
                }
            })
        };
    refused(&entrant("blue", &|e| e.declaration.model = "better".to_owned()), "setting model");
    refused(
        &entrant("blue", &|e| e.declaration.temperature = Some(1.0)),
        "not the one that the entrant declared",
    );
    refused(&entrant("green", &|e| e.status = EntrantStatus::Active), "row ");
    refused(&entrant("red", &|e| e.status = EntrantStatus::Disqualified), "row ");
    let mut forged = file.clone();
    let place = forged.places(|line| matches!(line, Line::Entrant(_)))[0];
    let again = forged.0[place].clone();
    forged.0.insert(place, again);
    refused(&forged.write(), "it is there twice");

    // The board.
    let board =
        |change: &dyn Fn(&mut Vec<swarmbench_boards::competition::standings::StandingsRow>)| {
            file.forged(|line| {
                if let Line::Board(board) = line {
                    change(&mut board.rows);
                }
            })
        };
    refused(&board(&|rows| rows[0].total = Some(1e6)), "row 1: total is 1000000.0");
    refused(&board(&|rows| rows[1].rank = Some(1)), "row 2: rank is 1");
    refused(&board(&|rows| rows[0].tasks[1].mean = Some(0.5)), "row 1: tasks");
    refused(&board(&|rows| rows.swap(0, 1)), "row 1:");
    refused(&board(&|rows| drop(rows.pop())), "it has 2 rows, recomputed 3");
    refused(
        &board(&|rows| rows[0].decentralization = Some("enforced".to_owned())),
        "decentralization",
    );

    // What nobody can tell who has the file alone: somebody was left out with all that is known of them. It is
    // another file, with another head.
    let honest = check(&text, Expected::default()).expect("it is true").head;
    let mut forged = file.clone();
    let green = attempts[4];
    let end = forged.places(|line| matches!(line, Line::Board(_)))[0];
    forged.0.drain(green..end);
    forged.0.retain(|(line, _)| !matches!(line, Line::Entrant(entrant) if entrant.name == "green"));
    for (line, _) in &mut forged.0 {
        match line {
            Line::Board(board) => drop(board.rows.pop()),
            Line::End(end) => end.episodes -= 4,
            _ => {}
        }
    }
    let forged = forged.write();
    assert_eq!(check(&forged, Expected::default()).expect("consistent").entrants.len(), 2);
    check(&forged, Expected { commitment: None, head: Some(honest) }).expect_err("another file");
}

/// Verdict on a file by the program that was written from the documents; the error if it refuses the file.
fn example(file: &str) -> Result<String, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cup.jsonl");
    std::fs::write(&path, file).expect("a file");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let run = Command::new("python3")
        .arg(root.join("examples/verify_competition.py"))
        .arg(path)
        .output()
        .expect("python3");
    let said = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if run.status.success() { Ok(said(&run.stdout)) } else { Err(said(&run.stderr)) }
}

/// All seats of all open games answer with a text that names no action, and then with one that does.
async fn answer_badly(app: &crate::app::TestApp, attempt: &Attempt) {
    for response in ["I refuse", "", "ACTION: STAY"] {
        let seen = attempt.look(app).await;
        let act = |seen: &Value| {
            json!({
                "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"], "response": response,
            })
        };
        let acts: Vec<Value> = crate::app::list(&seen["observations"]).iter().map(act).collect();
        let body = json!({ "acts": acts });
        app.post("/swarm/act").token(&attempt.swarm).json(&body).ok().await;
    }
}

#[tokio::test]
async fn a_program_that_was_written_from_the_documents_checks_all_that_a_file_may_have() {
    let app = server().await;
    let mut suite = crate::cup::request()["suite"].clone();
    suite["public_seeds"] = json!(1);
    let cup = Cup::open(
        &app,
        json!({
            "suite": suite, "parallel": 4, "spares": 1, "attempts_per_day": 5, "terms": "one entrant for each team",
            "categories": ["models", "people"], "own_games": "ended",
            "tie_breaks": ["invalid", "timeouts", "attempts", "earliest"],
        }),
    )
    .await;
    let change =
        |change: Value| app.call(Method::PATCH, &cup.path("")).token(&app.organizer).json(&change);
    change(json!({ "closes_at": "2026-03-01T13:30:00Z" })).ok().await;
    let mut attempts = Vec::new();
    for (name, category) in [("blue", "models"), ("red", "people"), ("green", "models")] {
        // One model, and a system message: nothing but the name of the row orders what is equal.
        let entry = json!({
            "name": name, "model": "m", "category": category, "accepts_terms": 1,
            "agent_meta": { "system_message": "You are one of many." },
        });
        let made = app.post(&cup.path("/entrants")).json(&entry).ok().await;
        let text = |field: &str| made[field].as_str().expect("a text").to_owned();
        let entrant = Entrant { id: text("id"), key: text("key") };
        attempts.push((cup.start(&app, &entrant).await, entrant));
    }
    // Two play alike, but for a game and its invalid answers.
    answer_badly(&app, &attempts[0].0).await;
    attempts[0].0.play(&app, 0).await;
    attempts[1].0.play(&app, 0).await;
    cup.void(&app, &attempts[1].0, "a power cut").await;
    cup.start(&app, &attempts[1].1).await.play(&app, 0).await;
    change(json!({ "terms": "logs are published" })).ok().await;
    attempts[2].0.play(&app, 0).await;
    crate::cup::pass_minutes(&app, 90).await;
    cup.closed(&app).await;
    let file = cup.export(&app).await;
    check(&file, Expected::default()).expect("it is true");
    let said = example(&file).unwrap_or_else(|problem| panic!("{problem}"));
    let names: Vec<&str> = said.lines().take(3).filter_map(|line| line.split(' ').nth(1)).collect();
    let rows = cup.rows(&app, None).await;
    let shown: Vec<_> = rows.iter().map(|row| row["entrant"]["name"].as_str()).collect();
    assert_eq!(shown, names.iter().map(|name| Some(*name)).collect::<Vec<_>>(), "{said}");
    assert_eq!(names[2], "blue", "it has invalid answers");
    for older in [1, 2] {
        let path = format!("/api/v1/exports/competitions/{}?format={older}", cup.id);
        let problem = app.get(&path).problem(422, "invalid").await;
        let detail = problem["detail"].as_str().expect("a text");
        assert!(detail.contains("seeds of its own"), "{detail}");
    }

    // It finds what is changed in a file whose hashes fit.
    let known = File::read(&file);
    for (says, change) in FORGERIES {
        let problem = example(&known.forged(change)).expect_err(says);
        assert!(problem.contains(says), "{says}: {problem}");
    }
}

/// A forgery, and what the program says of it.
type Forgery = (&'static str, fn(&mut Line));

const FORGERIES: [Forgery; 5] = [
    ("seeds_by_task", |line| {
        if let Line::Competition(competition) = line {
            competition.format = 2;
        }
    }),
    ("row", |line| {
        if let Line::Competition(competition) = line {
            competition.definition.tie_breaks.clear();
        }
    }),
    ("row", |line| {
        if let Line::Competition(competition) = line {
            competition.definition.public_seeds = 0;
        }
    }),
    ("category", |line| {
        if let Line::Entrant(entrant) = line {
            entrant.category = None;
        }
    }),
    ("terms", |line| {
        if let Line::Entrant(entrant) = line {
            entrant.terms = Some(3);
        }
    }),
];

#[tokio::test]
async fn windows_are_stored_to_the_millisecond_as_games_have_them() {
    let app = server().await;
    let windows = json!([{ "closes_at": "2026-03-01T12:40:00.852271Z" }]);
    let cup = Cup::open(&app, json!({ "attempts": windows })).await;
    assert_eq!(cup.created["attempts"][0]["closes_at"], "2026-03-01T12:40:00.852Z");
    let attempt = cup.start(&app, &cup.enter(&app, "blue").await).await;
    attempt.play(&app, 1).await;
    crate::cup::pass_minutes(&app, 90).await;
    cup.closed(&app).await;
    check(&cup.export(&app).await, Expected::default()).expect("it is true");
}

#[tokio::test]
async fn what_decides_nothing_leaves_a_published_file_as_it_is() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let blue = cup.enter(&app, "blue").await;
    cup.start(&app, &blue).await.play(&app, 1).await;
    cup.change(&app, &blue, json!({ "contact": "ada@example.org" })).await;
    let actions = app.get(&cup.path("/actions")).ok().await;
    assert!(crate::app::list(&actions["items"]).is_empty(), "{actions}");
    let log = app.get("/api/v1/audit").token(&app.organizer).ok().await;
    assert_eq!(log["items"][0]["action"], "entrant.change", "organizers see it");
    crate::cup::pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    let published = cup.export(&app).await;
    for change in [
        json!({ "contact": "eve@example.org" }),
        json!({ "vouched": false }),
        json!({ "status": "active" }),
        json!({ "vouched": true }),
        json!({ "vouched": false }),
        json!({ "vouched": true, "status": "active" }),
    ] {
        let changed = cup.change(&app, &blue, change.clone()).await;
        let vouched = change.get("vouched").unwrap_or(&json!(false)).clone();
        assert_eq!(changed["vouched"], vouched);
        assert_eq!(cup.export(&app).await, published, "{change}");
    }
    let actions = app.get(&cup.path("/actions")).ok().await;
    assert_eq!(crate::app::list(&actions["items"]).len(), 3, "{actions}");

    let change = json!({ "status": "disqualified", "reason": "two teams", "vouched": false });
    cup.change(&app, &blue, change).await;
    let decided = cup.export(&app).await;
    assert_ne!(decided, published);
    assert_eq!(check(&decided, Expected::default()).expect("it is true").actions.len(), 1);
    example(&decided).unwrap_or_else(|problem| panic!("{problem}"));
    cup.change(&app, &blue, json!({ "status": "disqualified", "reason": "two teams" })).await;
    assert_eq!(cup.export(&app).await, decided);
}

#[tokio::test]
async fn the_file_of_an_older_competition_has_the_format_that_it_needs() {
    for (change, usual) in [(json!({}), 1), (json!({ "spares": 1 }), 2)] {
        let app = server().await;
        let cup = Cup::open_before_seeds_by_task(&app, change).await;
        assert_eq!(cup.show(&app).await["seeds_by_task"], false);
        let attempt = cup.start(&app, &cup.enter(&app, "blue").await).await;
        attempt.play(&app, 1).await;
        crate::cup::pass_minutes(&app, 90).await;
        cup.closed(&app).await;
        for asked in [None, Some(1), Some(2)] {
            let query = asked.map_or(String::new(), |format: u32| format!("?format={format}"));
            let path = format!("/api/v1/exports/competitions/{}{query}", cup.id);
            let file = app.get(&path).send().await.text();
            let report = check(&file, Expected::default()).expect("it is true");
            assert_eq!(report.competition.format, asked.unwrap_or(usual));
            assert!(!file.contains("seeds_by_task"));
            example(&file).unwrap_or_else(|problem| panic!("{problem}"));
            // Organizers export a hidden one.
            let hide = app.call(Method::PATCH, &cup.path("")).token(&app.organizer);
            hide.json(&json!({ "hidden": true, "reason": "a test" })).ok().await;
            let later = app.get(&path).token(&app.organizer).send().await.text();
            assert_eq!(later, file, "its head was published");
            let show = app.call(Method::PATCH, &cup.path("")).token(&app.organizer);
            show.json(&json!({ "hidden": false, "reason": "a test" })).ok().await;
        }
    }
}
