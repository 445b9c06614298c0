//! Standings of a competition: which attempt counts, and the order of entrants.

use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench_boards::competition::EntrantStatus;
use swarmbench_boards::competition::definition::{Counts, Definition, TieBreak, Window};
use swarmbench_boards::competition::entrant::{Declaration, Entrant};
use swarmbench_boards::competition::standings::{self, Attempt, Part, StandingsRow};
use swarmbench_boards::{EndedGame, Slot};
use swarmbench_engine::{Seed, TaskName};
use swarmbench_journal::Tally;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::suite::SuiteSettings;

fn at(minute: i64) -> Timestamp {
    Timestamp::from_second(60 * minute).expect("a time")
}

/// Two attempts of four games.
fn definition() -> Definition {
    let window = Window { opens_at: at(10), closes_at: at(100) };
    let tasks = vec!["Synchronization".to_owned(), "Foraging".to_owned()];
    Definition::plain("a cup", tasks, 2, SuiteSettings::default(), window, 2)
}

fn standings(
    definition: &Definition,
    entrants: &[Entrant],
    attempts: &[Attempt],
) -> Vec<StandingsRow> {
    let standings = standings::standings(definition, entrants, attempts);
    standings.into_iter().map(|standing| standing.row).collect()
}

fn entrant(id: &str) -> Entrant {
    Entrant {
        id: id.to_owned(),
        name: format!("team {id}"),
        declaration: Declaration {
            model: format!("model {id}"),
            temperature: None,
            top_p: None,
            agent_meta: Carried::default(),
            prompt_template: None,
            template: None,
        },
        status: EntrantStatus::Active,
        reason: None,
        vouched: false,
        registered_at: at(0),
        category: None,
        terms: None,
        erased: false,
    }
}

/// An attempt with the same score in all its games.
fn attempt(entrant: &str, number: u32, minute: i64, score: f64) -> Attempt {
    let slot = |task, seed: u32| Slot { task, seed: seed.into() };
    let plan = [TaskName::Synchronization, TaskName::Foraging]
        .into_iter()
        .flat_map(|task| [slot(task, 1), slot(task, 2)])
        .collect::<Vec<_>>();
    let game = |slot: &Slot| EndedGame {
        slot: *slot,
        score,
        tally: Tally { acts: 10, invalid: 1, timeouts: 2, ..Tally::default() },
        voided: false,
    };
    Attempt {
        entrant: entrant.to_owned(),
        number,
        replays: None,
        run: format!("run_{entrant}{number}"),
        status: "finished".to_owned(),
        is_over: true,
        voided: false,
        created_at: at(minute),
        ended_at: Some(at(minute + 1)),
        games: plan.iter().map(game).collect(),
        plan,
    }
}

fn order(rows: &[StandingsRow]) -> Vec<(Option<u32>, &str, Option<u32>)> {
    rows.iter().map(|row| (row.rank, row.entrant.as_str(), row.attempt)).collect()
}

#[test]
fn the_attempt_that_counts_is_the_best_the_last_or_the_first() {
    let entrants = ["a", "b"].map(entrant);
    // The second attempt of b was started before its first one; both of a's are equal.
    let attempts = [
        attempt("a", 1, 10, 2.0),
        attempt("a", 2, 20, 2.0),
        attempt("b", 1, 30, 1.0),
        attempt("b", 2, 25, 3.0),
    ];
    let of = |counts| {
        let definition = Definition { counts, ..definition() };
        standings(&definition, &entrants, &attempts)
    };
    let best = of(Counts::Best);
    assert_eq!(order(&best), [(Some(1), "b", Some(2)), (Some(2), "a", Some(1))]);
    assert_eq!((best[0].total, best[0].answers), (Some(6.0), 40));
    assert_eq!(order(&of(Counts::Last)), [(Some(1), "a", Some(2)), (Some(2), "b", Some(1))]);
    assert_eq!(order(&of(Counts::First)), [(Some(1), "b", Some(2)), (Some(2), "a", Some(1))]);
}

#[test]
fn ranks_are_shared_and_disqualified_entrants_have_none() {
    let mut entrants = ["a", "b", "c", "d", "e", "f"].map(entrant);
    entrants[4].status = EntrantStatus::Disqualified;
    entrants[4].reason = Some("two accounts".to_owned());
    let attempts = [
        attempt("a", 1, 10, 1.0),
        attempt("b", 1, 10, 2.0),
        attempt("c", 1, 10, 2.0),
        attempt("d", 1, 10, 3.0),
        attempt("e", 1, 10, 9.0),
    ];
    let rows = standings(&definition(), &entrants, &attempts);
    assert_eq!(
        order(&rows),
        [
            (Some(1), "d", Some(1)),
            (Some(2), "b", Some(1)),
            (Some(2), "c", Some(1)),
            (Some(4), "a", Some(1)),
            (None, "f", None),
            (None, "e", Some(1)),
        ]
    );
    assert_eq!(rows[5].total, Some(18.0), "it is shown");
}

/// The order of equal rows is a part of published files, so it may depend only on what journal.md names.
#[test]
fn equal_rows_are_in_the_order_of_names_that_never_change() {
    let mut entrants = ["a", "b", "c", "d"].map(entrant);
    for one in &mut entrants {
        one.declaration.model = "model".to_owned();
        one.declaration.agent_meta = Carried(r#"{"system_message":"hello"}"#.into());
    }
    let name = |id: &str| {
        let mut hash = Sha256::new();
        for part in [id, "model", "", "", ""] {
            hash.update((part.len() as u64).to_be_bytes());
            hash.update(part);
        }
        hash.finalize()
    };
    let attempts = ["a", "b", "c", "d"].map(|id| attempt(id, 1, 10, 1.0));
    let rows = standings(&definition(), &entrants, &attempts);
    let ids: Vec<&str> = rows.iter().map(|row| row.entrant.as_str()).collect();
    let mut expected = ["a", "b", "c", "d"];
    expected.sort_by_key(|id| name(id));
    assert_eq!(ids, expected);
}

#[test]
fn an_abandoned_attempt_counts_and_a_voided_one_does_not() {
    let entrants = [entrant("a")];
    let mut abandoned = attempt("a", 1, 10, 4.0);
    abandoned.status = "abandoned".to_owned();
    abandoned.games.truncate(1);
    let rows = standings(&definition(), &entrants, &[abandoned.clone()]);
    // One of two games of the first task was played, none of the second.
    assert_eq!((rows[0].total, rows[0].run_status.as_deref()), (Some(2.0), Some("abandoned")));
    let voided = Attempt { voided: true, ..attempt("a", 2, 20, 9.0) };
    let running = Attempt { is_over: false, ..attempt("a", 2, 30, 9.0) };
    let rows = standings(&definition(), &entrants, &[abandoned.clone(), voided, running]);
    assert_eq!((rows[0].total, rows[0].attempts, rows[0].voided_attempts), (Some(2.0), 1, 1));
    // A single voided game is left out of its mean.
    abandoned.games[0].voided = true;
    let rows = standings(&definition(), &entrants, &[abandoned]);
    assert_eq!((rows[0].total, rows[0].voided_games), (Some(0.0), 1));
    assert_eq!(rows[0].tasks[0].planned, 1);
}

#[test]
fn public_seeds_make_one_board_and_the_others_the_final_one() {
    let definition = Definition { public_seeds: 1, ..definition() };
    let mut attempt = attempt("a", 1, 10, 1.0);
    for game in attempt.games.iter_mut().filter(|game| game.slot.seed == Seed::from(2u32)) {
        game.score = 5.0;
    }
    let of = |part| {
        let attempts = [attempt.clone().part(&definition, part)];
        let rows = standings(&definition, &[entrant("a")], &attempts);
        (rows[0].total, rows[0].tasks[0].planned, rows[0].answers)
    };
    assert_eq!(of(Part::Public), (Some(2.0), 1, 20));
    assert_eq!(of(Part::Final), (Some(10.0), 1, 20));
    let whole = self::definition();
    assert_eq!(attempt.clone().part(&whole, Part::Final), attempt);
}

#[test]
fn tie_breaks_order_equal_totals_one_after_the_other() {
    let entrants = ["a", "b", "c", "d"].map(entrant);
    let with = |id: &str, minute, invalid| {
        let mut attempt = attempt(id, 1, minute, 2.0);
        attempt.games.iter_mut().for_each(|game| game.tally.invalid = invalid);
        attempt
    };
    // Entrant d is ahead by its total, whatever its answers were.
    let mut best = with("d", 40, 9);
    best.games.iter_mut().for_each(|game| game.score = 3.0);
    let attempts = [with("a", 30, 2), with("b", 20, 1), with("c", 20, 2), best];
    let ranks = |tie_breaks: &[TieBreak]| {
        let definition = Definition { tie_breaks: tie_breaks.to_vec(), ..definition() };
        let rows = standings(&definition, &entrants, &attempts);
        rows.iter().map(|row| (row.rank, row.entrant.clone())).collect::<Vec<_>>()
    };
    let of = |ranks: [(u32, &str); 4]| ranks.map(|(rank, id)| (Some(rank), id.to_owned())).to_vec();
    assert_eq!(ranks(&[]), of([(1, "d"), (2, "a"), (2, "b"), (2, "c")]));
    assert_eq!(ranks(&[TieBreak::Invalid]), of([(1, "d"), (2, "b"), (3, "a"), (3, "c")]));
    let both = [TieBreak::Invalid, TieBreak::Earliest];
    assert_eq!(ranks(&both), of([(1, "d"), (2, "b"), (3, "c"), (4, "a")]));
    let both = [TieBreak::Earliest, TieBreak::Invalid];
    assert_eq!(ranks(&both), of([(1, "d"), (2, "b"), (3, "c"), (4, "a")]));
    assert_eq!(ranks(&[TieBreak::Earliest]), of([(1, "d"), (2, "b"), (2, "c"), (4, "a")]));
}
