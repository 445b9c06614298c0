//! Order of equal totals, and boards on a part of the seeds.

use serde_json::{Value, json};
use swarmbench_boards::competition::verify::{CompetitionReport, Expected, verify};
use swarmbench_engine::physics::Solver;

use crate::app::{TestApp, list};
use crate::cup::{Cup, pass_minutes, server};

/// The file in a format, verified.
async fn file(app: &TestApp, cup: &Cup, format: u32) -> CompetitionReport {
    let path = format!("/api/v1/exports/competitions/{}?format={format}", cup.id);
    let text = app.get(&path).send().await.text();
    verify(text.as_bytes(), Expected::default(), Solver::Flow, |_| {}).expect("a true file")
}

fn totals(rows: &[Value]) -> Vec<(Option<u64>, f64)> {
    rows.iter().map(|row| (row["rank"].as_u64(), row["total"].as_f64().expect("a total"))).collect()
}

#[tokio::test]
async fn the_public_seeds_make_the_board_until_the_others_make_the_final_one() {
    let app = server().await;
    let mut suite = crate::cup::request()["suite"].clone();
    suite["public_seeds"] = json!(1);
    let cup = Cup::open_before_seeds_by_task(&app, json!({ "suite": suite, "parallel": 1 })).await;
    assert_eq!(cup.created["suite"]["public_seeds"], 1);
    let blue = cup.enter(&app, "blue").await;
    let attempt = cup.start(&app, &blue).await;
    // Lights are switched well in the first game, which has the public seed, and not at all in the second.
    for _ in 0..3 {
        attempt.act(&app, 4).await;
    }
    attempt.play(&app, 0).await;
    let own = || app.get(&cup.path("/attempts")).token(&blue.key);
    let public = list(&own().ok().await["items"])[0]["total"].as_f64().expect("a total");
    let board = |query: &'static str| app.get(&cup.path(&format!("/board{query}")));
    let shown = board("").ok().await;
    assert_eq!(shown["part"], "public");
    assert_eq!(totals(&list(&shown["items"])), [(Some(1), public)]);
    board("?part=final").problem(403, "forbidden").await;
    let organizers = board("").token(&app.organizer).ok().await;
    let last = totals(&list(&organizers["items"]))[0].1;
    assert_eq!(organizers["part"], "final");
    assert!(public > last, "{public} {last}");

    pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    let end = board("").ok().await;
    assert_eq!(
        (&end["part"], totals(&list(&end["items"]))),
        (&json!("final"), vec![(Some(1), last)])
    );
    assert_eq!(totals(&list(&board("?part=public").ok().await["items"])), [(Some(1), public)]);
    assert_eq!(list(&own().ok().await["items"])[0]["total"], last);
    assert_eq!(file(&app, &cup, 2).await.rows[0].total, Some(last));
    // Programs that know the first format only find a board on all seeds.
    assert_eq!(file(&app, &cup, 1).await.rows[0].total, Some(f64::midpoint(public, last)));
}

#[tokio::test]
async fn equal_totals_are_ordered_by_the_rules_of_the_competition() {
    let app = server().await;
    let change = json!({ "tie_breaks": ["invalid", "earliest"], "board": "public" });
    let cup = Cup::open_before_seeds_by_task(&app, change).await;
    assert_eq!(cup.created["tie_breaks"], json!(["invalid", "earliest"]));
    for name in ["blue", "red"] {
        let entrant = cup.enter(&app, name).await;
        // Neither does anything; `blue` ends a minute earlier.
        cup.start(&app, &entrant).await.play(&app, 0).await;
        pass_minutes(&app, 1).await;
    }
    let rows = cup.rows(&app, None).await;
    let names: Vec<_> = rows.iter().map(|row| row["entrant"]["name"].clone()).collect();
    assert_eq!((totals(&rows)[0].0, totals(&rows)[1].0), (Some(1), Some(2)), "{rows:?}");
    assert_eq!(totals(&rows)[0].1.to_bits(), totals(&rows)[1].1.to_bits());
    assert_eq!(names, ["blue", "red"]);
    pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    let ranks =
        |report: &CompetitionReport| report.rows.iter().map(|row| row.rank).collect::<Vec<_>>();
    assert_eq!(ranks(&file(&app, &cup, 2).await), [Some(1), Some(2)]);
    assert_eq!(ranks(&file(&app, &cup, 1).await), [Some(1), Some(1)]);
}

/// The first seeds of each task are the public ones.
#[tokio::test]
async fn each_task_has_public_seeds_of_its_own() {
    let app = server().await;
    let mut suite = crate::cup::request()["suite"].clone();
    suite["public_seeds"] = json!(1);
    let cup = Cup::open(&app, json!({ "suite": suite, "parallel": 1 })).await;
    let blue = cup.enter(&app, "blue").await;
    cup.start(&app, &blue).await.play(&app, 1).await;
    pass_minutes(&app, 60).await;
    cup.closed(&app).await;
    let row = |board: &Value| list(&board["items"])[0]["tasks"].clone();
    for part in ["public", "final"] {
        let board = app.get(&cup.path(&format!("/board?part={part}"))).ok().await;
        let planned: Vec<_> =
            list(&row(&board)).iter().map(|task| task["planned"].clone()).collect();
        assert_eq!(planned, [json!(1), json!(1)], "{board}");
    }
    assert_eq!(file(&app, &cup, 3).await.rows.len(), 1);
}
