//! Score trends: the scores of models over a game, a panel for each task.

use crate::chart::{
    Axes, HEADING, LABEL, MARGIN, counts, heading, heading_height, legend, legend_height, opacity,
    range, real, ticks,
};
use crate::palette::{INK, MUTED, Style, style};
use crate::scene::{Anchor, Area, Paint, Scene};
use crate::series::Band;
use crate::{Data, Figure, cell};

/// The figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Trends {
    /// Settings that all games share, for the reader.
    pub notes: Vec<String>,
    /// All models, in the order of the legend. Lines refer to them by index.
    pub models: Vec<String>,
    /// A panel for each task.
    pub panels: Vec<Panel>,
}

/// The games of a task.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// The task.
    pub task: String,
    /// The maximum number of rounds of a game.
    pub rounds: usize,
    /// A line for each model that has games.
    pub lines: Vec<Line>,
}

/// The games of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// The index of the model.
    pub model: usize,
    /// The score in each state, `0..=rounds`.
    pub score: Band,
}

const PLOT: (f64, f64) = (250.0, 170.0);
/// Margins of a panel: on the left for the numbers of the axis, above for the heading, below for the axis.
const BESIDE: f64 = 48.0;
const ABOVE: f64 = 26.0;
const BELOW: f64 = 44.0;

impl Figure for Trends {
    fn scene(&self) -> Scene {
        let columns = self.panels.len().clamp(2, 3);
        let width = MARGIN.mul_add(2.0, real(columns) * (BESIDE + PLOT.0));
        let entries: Vec<(String, Style)> =
            self.models.iter().cloned().zip((0..).map(style)).collect();
        let room = width - 2.0 * MARGIN;
        let rows = real(self.panels.len().div_ceil(columns));
        let height = heading_height(width, &self.notes)
            + rows * (ABOVE + PLOT.1 + BELOW)
            + legend_height(room, &entries)
            + MARGIN;
        let mut scene = Scene::new(width, height, "Score trends");
        let top =
            heading(&mut scene, "Score by round: mean (line) ± deviation (band)", &self.notes);
        for (number, panel) in self.panels.iter().enumerate() {
            let x = MARGIN + real(number % columns) * (BESIDE + PLOT.0) + BESIDE - 8.0;
            let y = top + real(number / columns) * (ABOVE + PLOT.1 + BELOW) + ABOVE;
            panel.draw(&mut scene, Area::new(x, y, PLOT.0, PLOT.1));
        }
        let below = top + rows * (ABOVE + PLOT.1 + BELOW);
        legend(&mut scene, (MARGIN, below), room, &entries);
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["task", "model", "round", "mean", "deviation", "n"]);
        for panel in &self.panels {
            for line in &panel.lines {
                for (round, &count) in line.score.counts.iter().enumerate() {
                    data.rows.push(vec![
                        panel.task.clone(),
                        self.models[line.model].clone(),
                        round.to_string(),
                        cell(line.score.mean[round]),
                        cell(line.score.deviation[round]),
                        count.to_string(),
                    ]);
                }
            }
        }
        data
    }
}

impl Panel {
    fn draw(&self, scene: &mut Scene, area: Area) {
        let n = counts(self.lines.iter().filter_map(|line| line.score.counts.first().copied()));
        let title = format!("{}, {n}", self.task);
        scene.text((area.x, area.y - 9.0), Anchor::Start, HEADING, INK, &title);
        let values = self.lines.iter().flat_map(|line| line.score.high()).flatten();
        let (x, y) = ((0.0, real(self.rounds)), range(values));
        let axes = Axes::new(area, x, y);
        if self.lines.is_empty() {
            axes.empty(scene, "no games");
            return;
        }
        axes.draw(scene, &ticks(x, 5), &ticks(y, 4));
        let below = (area.x + area.width / 2.0, area.bottom() + 29.0);
        scene.text(below, Anchor::Middle, LABEL, MUTED, "round");
        for line in &self.lines {
            let veil = Paint::veil(style(line.model).color, opacity(self.lines.len()));
            axes.band(scene, &line.score.low(), &line.score.high(), veil);
        }
        for line in &self.lines {
            axes.line(scene, &line.score.mean, style(line.model), line.model);
        }
    }
}
