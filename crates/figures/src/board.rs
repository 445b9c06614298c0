//! A board as bars: a row for each model, a panel for each task.

use crate::chart::{
    HEADING, LABEL, MARGIN, Scale, heading, heading_height, number, range, real, ticks,
};
use crate::font;
use crate::palette::{AXIS, INK, MUTED, PAPER, RULE, style};
use crate::scene::{Anchor, Area, Paint, Scene};
use crate::{Data, Figure, cell};

/// The figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Board {
    /// The title.
    pub title: String,
    /// Settings that all games share, for the reader.
    pub notes: Vec<String>,
    /// The tasks, from left to right.
    pub tasks: Vec<String>,
    /// The models, from top to bottom.
    pub rows: Vec<Row>,
}

/// A model.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The name.
    pub model: String,
    /// Whether the numbers are published ones, not results of games on this server.
    pub reference: bool,
    /// The scores, in the order of the tasks; `None` without games.
    pub scores: Vec<Option<Score>>,
}

/// The games of a model in a task.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// The mean of the final scores.
    pub mean: f64,
    /// The population deviation of the final scores.
    pub deviation: Option<f64>,
    /// The number of games; `None` if it was not published.
    pub n: Option<usize>,
}

const ROW: f64 = 26.0;
const PLOT: f64 = 180.0;
/// The part of a panel's width for the numbers.
const NUMBERS: f64 = 86.0;
const GAP: f64 = 14.0;
const NAME: f64 = 240.0;

impl Figure for Board {
    fn scene(&self) -> Scene {
        let names = self.rows.iter().map(|row| font::width(&row.model, LABEL));
        let names = names.fold(60.0, f64::max).min(NAME);
        let width = MARGIN.mul_add(2.0, names + 6.0 + real(self.tasks.len().max(2)) * (GAP + PLOT));
        let notes = self.notes();
        let body = real(self.rows.len()) * ROW;
        let height = heading_height(width, &notes) + 24.0 + body + 30.0 + MARGIN;
        let mut scene = Scene::new(width, height, &self.title);
        let top = heading(&mut scene, &self.title, &notes) + 24.0;
        for (place, row) in self.rows.iter().enumerate() {
            let at = (MARGIN, top + (real(place) + 0.5) * ROW + 3.5);
            scene.text_within(at, names, (Anchor::Start, LABEL, INK), &row.model);
        }
        for (number, task) in self.tasks.iter().enumerate() {
            let x = MARGIN + names + 6.0 + GAP + real(number) * (GAP + PLOT);
            self.panel(&mut scene, Area::new(x, top, PLOT, body), number, task);
        }
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["model", "reference", "task", "mean", "deviation", "n"]);
        for row in &self.rows {
            for (task, score) in self.tasks.iter().zip(&row.scores) {
                data.rows.push(vec![
                    row.model.clone(),
                    row.reference.to_string(),
                    task.clone(),
                    cell(score.map(|score| score.mean)),
                    cell(score.and_then(|score| score.deviation)),
                    cell(score.and_then(|score| score.n)),
                ]);
            }
        }
        data
    }
}

impl Board {
    fn notes(&self) -> Vec<String> {
        let mut notes = self.notes.clone();
        notes.push("Mean final score ± deviation, (n) games; –: no games".to_owned());
        if self.rows.iter().any(|row| row.reference) {
            notes.push("Hatched: published numbers, not games on this server".to_owned());
        }
        notes
    }

    fn panel(&self, scene: &mut Scene, area: Area, task: usize, name: &str) {
        scene.text_within((area.x, area.y - 8.0), PLOT, (Anchor::Start, HEADING, INK), name);
        let score = |row: &Row| row.scores.get(task).copied().flatten();
        let ends = self.rows.iter().filter_map(score);
        let reach = range(ends.map(|score| score.mean + score.deviation.unwrap_or(0.0)));
        let scale = Scale::new(reach, area.x, area.right() - NUMBERS);
        for tick in ticks(reach, 3) {
            let at = scale.at(tick);
            scene.line((at, area.y), (at, area.bottom()), Paint::line(RULE, 1.0));
            let below = (at, area.bottom() + 15.0);
            scene.text(below, Anchor::Middle, LABEL, MUTED, &number(tick));
        }
        for (place, row) in self.rows.iter().enumerate() {
            let middle = area.y + (real(place) + 0.5) * ROW;
            let Some(Score { mean, deviation, n }) = score(row) else {
                scene.text((area.x + 5.0, middle + 3.5), Anchor::Start, LABEL, MUTED, "–");
                continue;
            };
            let (zero, end) = (scale.within(0.0), scale.at(mean));
            let bar = Area::new(zero.min(end), middle - 7.0, (end - zero).abs(), 14.0);
            scene.rect(bar, Paint::fill(style(place).color));
            if row.reference {
                scene.hatch(bar, 6.0, Paint::line(PAPER, 1.2));
            }
            if let Some(deviation) = deviation {
                let ends = [mean - deviation, mean + deviation].map(|score| scale.within(score));
                for (color, width) in [(PAPER, 3.0), (INK, 1.2)] {
                    scene.line((ends[0], middle), (ends[1], middle), Paint::line(color, width));
                }
            }
            let spread = deviation.map_or_else(String::new, |of| format!("±{of:.2}"));
            let n = n.map_or_else(String::new, |n| format!(" ({n})"));
            let text = format!("{mean:.2}{spread}{n}").replace('-', "−");
            let after = (scale.at(scale.most) + 6.0, middle + 3.5);
            scene.text(after, Anchor::Start, LABEL - 1.0, INK, &text);
        }
        scene.line((area.x, area.y), (area.x, area.bottom()), Paint::line(AXIS, 1.0));
    }
}
