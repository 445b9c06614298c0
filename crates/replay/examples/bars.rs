//! Bars, each beside its limit: `bars TITLE < ROWS > FILE.svg`.
//!
//! A row is `GROUP⇥LABEL⇥VALUE⇥LIMIT⇥TEXT`. Rows of a group share a heading and a scale; a row without a limit is
//! only a bar. `.ci/perf` makes the chart of the load test with it.

use std::io::Read as _;
use std::process::ExitCode;

use swarmbench_replay::draw::palette::{Color, INK, MUTED, PAPER, RULE};
use swarmbench_replay::draw::scene::{Anchor, Area, Paint, Scene};
use swarmbench_replay::draw::svg;

const WIDTH: f64 = 760.0;
const MARGIN: f64 = 16.0;
/// The coordinates where bars begin, and where the longest ends.
const BARS: (f64, f64) = (190.0, 650.0);
const ROW: f64 = 20.0;
const HEADING: f64 = 34.0;
const TITLE: f64 = 48.0;

#[derive(Debug)]
struct Row {
    group: String,
    label: String,
    value: f64,
    limit: Option<f64>,
    text: String,
}

fn read(line: &str) -> Option<Row> {
    let parts: Vec<_> = line.split('\t').collect();
    let &[group, label, value, limit, text] = parts.as_slice() else { return None };
    let limit = if limit.is_empty() { None } else { Some(limit.parse().ok()?) };
    let value = value.parse().ok()?;
    Some(Row {
        group: group.to_owned(),
        label: label.to_owned(),
        value,
        limit,
        text: text.to_owned(),
    })
}

fn draw(title: &str, rows: &[Row]) -> Scene {
    let groups: Vec<&[Row]> = rows.chunk_by(|one, other| one.group == other.group).collect();
    let lines: usize = groups.iter().map(|group| group.len()).sum();
    let height = TITLE + HEADING * float(groups.len()) + ROW * float(lines) + MARGIN;
    let mut scene = Scene::new(WIDTH, height, title);
    scene.rect(Area::new(0.0, 0.0, scene.width, scene.height), Paint::fill(PAPER));
    scene.text((MARGIN, 26.0), Anchor::Start, 16.0, INK, title);
    scene.text(
        (MARGIN, 43.0),
        Anchor::Start,
        11.0,
        MUTED,
        "filled: measured; grey: what the machine could do in the same run",
    );
    let mut top = TITLE;
    for group in groups {
        scene.text((MARGIN, top + 24.0), Anchor::Start, 12.0, INK, &group[0].group);
        top += HEADING;
        let most =
            group.iter().map(|row| row.value.max(row.limit.unwrap_or(0.0))).fold(1.0, f64::max);
        let length = |value: f64| value / most * (BARS.1 - BARS.0);
        for row in group {
            let middle = top + ROW / 2.0;
            let style = (Anchor::End, 11.0, INK);
            scene.text_within(
                (BARS.0 - 8.0, middle + 4.0),
                BARS.0 - MARGIN - 8.0,
                style,
                &row.label,
            );
            if let Some(limit) = row.limit {
                scene.rect(
                    Area::new(BARS.0, top + 2.0, length(limit), ROW - 4.0),
                    Paint::fill(RULE),
                );
            }
            scene.rect(
                Area::new(BARS.0, top + 4.0, length(row.value), ROW - 8.0),
                Paint::fill(Color::BLUE),
            );
            let end = BARS.0 + length(row.value.max(row.limit.unwrap_or(0.0)));
            scene.text((end + 6.0, middle + 4.0), Anchor::Start, 11.0, INK, &row.text);
            top += ROW;
        }
    }
    scene
}

/// A count as a float.
#[expect(clippy::cast_precision_loss, reason = "a chart has few rows")]
const fn float(count: usize) -> f64 {
    count as f64
}

fn main() -> ExitCode {
    let mut text = String::new();
    let title = std::env::args().nth(1);
    let (Some(title), Ok(_)) = (title, std::io::stdin().read_to_string(&mut text)) else {
        eprintln!(
            "usage: bars TITLE < ROWS > FILE.svg; a row is GROUP, LABEL, VALUE, LIMIT and TEXT with tabs between"
        );
        return ExitCode::FAILURE;
    };
    let mut rows = Vec::new();
    for line in text.lines() {
        let Some(row) = read(line) else {
            eprintln!("{line:?} is not GROUP, LABEL, VALUE, LIMIT and TEXT with tabs between");
            return ExitCode::FAILURE;
        };
        rows.push(row);
    }
    print!("{}", svg(&draw(&title, &rows)));
    ExitCode::SUCCESS
}
