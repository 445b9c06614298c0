//! All boards of a database: what a question finds, and what it is refused.

use jiff::Timestamp;
use swarmbench_boards::collection::{BoardId, BoardSuite, Boards, FinishedRun, Imported, Question};
use swarmbench_boards::rank::{RankedRow, Source};
use swarmbench_boards::result::RunResult;
use swarmbench_boards::{EndedGame, PlayedRun, Player, Slot};
use swarmbench_engine::TaskName;
use swarmbench_journal::Tally;
use swarmbench_protocol::import::KnownSettings;

fn board(suite: &str, rules: &str, digest: &str) -> BoardId {
    let [suite, rules, digest] = [suite, rules, digest].map(str::to_owned);
    BoardId { suite, rules, digest }
}

fn boards() -> Boards {
    let of = |task| [27_u32, 42].map(|seed| Slot { task, seed: seed.into() });
    let plan = TaskName::ALL.into_iter().flat_map(of).collect();
    let settings = KnownSettings {
        num_agents: Some(12),
        memory: Some(5),
        rules: Some("paper".to_owned()),
        ..KnownSettings::default()
    };
    let suite = BoardSuite { tasks: TaskName::ALL.to_vec(), plan, settings };
    let standard = |rules: &str| {
        let mut suite = suite.clone();
        suite.settings.rules = Some(rules.to_owned());
        (board("standard", rules, "d"), suite)
    };
    Boards::new([standard("paper"), standard("reference")])
}

/// A finished run with one game of Pursuit.
fn over(key: i64, board: BoardId, score: f64) -> FinishedRun {
    let slot = Slot { task: TaskName::Pursuit, seed: 1.into() };
    let game = EndedGame {
        slot,
        score,
        tally: Tally {
            acts: 10,
            invalid: 1,
            timeouts: 2,
            prompt_tokens: 1000,
            completion_tokens: 50,
            ..Tally::default()
        },
        voided: false,
    };
    let run = PlayedRun {
        id: key.to_string(),
        player: Player { model: "a model".to_owned(), ..Player::default() },
        status: "finished".to_owned(),
        created_at: Timestamp::from_second(key).expect("a time"),
        vouched: true,
        ..PlayedRun::default()
    };
    let result = RunResult::new(run, &[slot], &[game], true);
    let suite = BoardSuite { tasks: vec![TaskName::Pursuit], ..BoardSuite::default() };
    FinishedRun { key, board, suite, result }
}

fn asked(suite: &str) -> Question {
    Question { suite: Some(suite.to_owned()), ..Question::default() }
}

#[test]
fn runs_of_other_settings_are_never_on_one_board() {
    let mut boards = boards();
    boards.insert(over(1, board("mine", "paper", "a"), 1.0));
    boards.insert(over(2, board("mine", "reference", "b"), 2.0));
    let values = |boards: &Boards, question: &Question| {
        let ranked = boards.ranked(question).expect("a board");
        ranked.rows.iter().map(|row| row.value).collect::<Vec<_>>()
    };
    assert_eq!(values(&boards, &asked("mine")), [Some(1.0)]);
    let reference = Question { rules: Some("reference".to_owned()), ..asked("mine") };
    assert_eq!(values(&boards, &reference), [Some(2.0)]);

    boards.insert(over(3, board("mine", "paper", "c"), 3.0));
    let refused = boards.ranked(&asked("mine")).expect_err("two of that name").to_string();
    assert_eq!(
        refused,
        "suite must be one of mine@a, mine@c: there are several suites of that name"
    );
    assert_eq!(values(&boards, &asked("mine@c")), [Some(3.0)]);

    // A run that moves leaves its old board, and an empty board disappears.
    boards.insert(over(3, board("mine", "paper", "a"), 4.0));
    assert_eq!((values(&boards, &asked("mine")), boards.runs()), (vec![Some(4.0)], 3));
    for key in 1..=3 {
        boards.remove(key);
    }
    let refused = boards.ranked(&asked("mine")).expect_err("the board is empty").to_string();
    assert_eq!(refused, "suite must be one of standard");
}

#[test]
fn what_is_unknown_is_refused_with_what_is_allowed() {
    let boards = boards();
    let refusal = |question: Question| boards.ranked(&question).expect_err("unknown").to_string();
    let some = |text: &str| Some(text.to_owned());
    for (question, expected) in [
        (
            Question { rules: some("chess"), ..Question::default() },
            "rules must be one of paper, reference",
        ),
        (
            Question { pick: some("worst"), ..Question::default() },
            "pick must be one of best, last, mean",
        ),
        (
            Question { task: some("chess"), ..Question::default() },
            "task must be one of Transport, Pursuit, Synchronization, Foraging, Flocking",
        ),
        (
            Question { task: some("Pursuit"), sort: some("Flocking"), ..Question::default() },
            "sort must be one of total, Pursuit",
        ),
    ] {
        assert_eq!(refusal(question), expected);
    }
}

#[test]
fn the_paper_is_on_the_boards_of_its_suite_and_can_be_switched_off() {
    let boards = boards();
    let rows = |question: Question| boards.ranked(&question).expect("a board").rows.len();
    assert_eq!(rows(Question::default()), 13);
    assert_eq!(rows(Question { rules: Some("reference".to_owned()), ..Question::default() }), 13);
    assert_eq!(rows(Question { no_reference: true, ..Question::default() }), 0);
    assert_eq!(rows(Question { task: Some("Pursuit".to_owned()), ..Question::default() }), 13);
    let mut others = boards.clone();
    others.insert(over(1, board("standard", "paper", "other"), 1.0));
    let question = asked("standard@other");
    assert_eq!(others.ranked(&question).expect("a board").rows.len(), 1);
    assert_eq!(others.ranked(&asked("standard")).expect("a board").rows.len(), 13);
}

#[test]
fn games_from_files_are_shown_where_they_are_asked_for_and_fit() {
    let mut boards = boards();
    let game = |model: &str, task, seed: u32, score, settings: &KnownSettings| Imported {
        model: model.to_owned(),
        slot: Slot { task, seed: seed.into() },
        score,
        settings: settings.clone(),
    };
    let known_settings = KnownSettings { num_agents: Some(12), ..KnownSettings::default() };
    let other = KnownSettings { memory: Some(3), ..known_settings.clone() };
    let reference = KnownSettings { rules: Some("reference".to_owned()), ..known_settings.clone() };
    boards.set_imported(vec![
        game("a", TaskName::Pursuit, 27, 4.0, &known_settings),
        // A repeated game: the mean of both counts.
        game("a", TaskName::Pursuit, 27, 8.0, &known_settings),
        game("a", TaskName::Pursuit, 42, 10.0, &known_settings),
        // A game outside the suite, and one with other settings.
        game("a", TaskName::Pursuit, 99, 50.0, &known_settings),
        game("a", TaskName::Pursuit, 42, 50.0, &other),
        game("b", TaskName::Flocking, 27, 1.0, &reference),
        game("c", TaskName::Flocking, 27, 12.0, &known_settings),
    ]);
    let shown = |imported, rules: &str| {
        let question = Question {
            imported,
            rules: Some(rules.to_owned()),
            no_reference: true,
            ..Question::default()
        };
        let ranked = boards.ranked(&question).expect("a board");
        let show = |row: &RankedRow| {
            let Source::Imported(result, rules) = &row.source else { panic!("{row:?}") };
            let task = result.tasks.iter().find(|task| task.games > 0).expect("a game");
            assert_eq!((row.rank, row.shown()), (None, None), "not all tasks, and no run");
            format!(
                "{} {rules} {:?} {}/{}",
                result.run.player.model,
                task.mean(),
                task.games,
                task.planned
            )
        };
        ranked.rows.iter().map(show).collect::<Vec<_>>()
    };
    assert_eq!(shown(true, "paper"), ["a reference Some(8.0) 2/2", "c reference Some(6.0) 1/2"]);
    // Games that do not name their rules are from the toolkit, whose Flocking costs twice as much as the paper's.
    let reference =
        ["a reference Some(8.0) 2/2", "b reference Some(1.0) 1/2", "c reference Some(12.0) 1/2"];
    assert_eq!(shown(true, "reference"), reference);
    assert!(shown(false, "paper").is_empty());
}
