//! Sensitivity: the final score by the number of agents and by the extent of their view.

use crate::chart::{
    Axes, HEADING, LABEL, MARGIN, counts, heading, heading_height, legend, legend_height, marker,
    number, range, real, ticks,
};
use crate::palette::{INK, MUTED, PAPER, Style, style};
use crate::scene::{Anchor, Area, Paint, Scene};
use crate::series::Summary;
use crate::{Data, Figure};

/// The figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensitivity {
    /// Settings that all games share, for the reader.
    pub notes: Vec<String>,
    /// The label of the horizontal axis, such as the number of agents.
    pub across: String,
    /// The name of the setting that the lines differ in, such as the size of a window.
    pub line: String,
    /// All values of `line`, in the order of the legend. Points refer to them by index.
    pub values: Vec<f64>,
    /// A panel for each task.
    pub panels: Vec<(String, Vec<Point>)>,
}

/// The games of one setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The index of its line's value.
    pub line: usize,
    /// The position on the horizontal axis.
    pub across: f64,
    /// The final scores.
    pub score: Summary,
}

const PLOT: (f64, f64) = (240.0, 170.0);
const BESIDE: f64 = 48.0;
const ABOVE: f64 = 26.0;
const BELOW: f64 = 44.0;

impl Figure for Sensitivity {
    fn scene(&self) -> Scene {
        let columns = self.panels.len().clamp(2, 3);
        let width = MARGIN.mul_add(2.0, real(columns) * (BESIDE + PLOT.0));
        let names = self.values.iter().map(|value| format!("{} = {}", self.line, number(*value)));
        let entries: Vec<(String, Style)> = names.zip((0..).map(style)).collect();
        let room = width - 2.0 * MARGIN;
        let rows = real(self.panels.len().div_ceil(columns));
        let height = heading_height(width, &self.notes)
            + rows * (ABOVE + PLOT.1 + BELOW)
            + legend_height(room, &entries)
            + MARGIN;
        let mut scene = Scene::new(width, height, "Sensitivity of the score");
        let top = heading(&mut scene, "Final score: mean ± deviation", &self.notes);
        for (number, (task, points)) in self.panels.iter().enumerate() {
            let x = MARGIN + real(number % columns) * (BESIDE + PLOT.0) + BESIDE - 8.0;
            let y = top + real(number / columns) * (ABOVE + PLOT.1 + BELOW) + ABOVE;
            self.panel(&mut scene, Area::new(x, y, PLOT.0, PLOT.1), task, points);
        }
        let below = top + rows * (ABOVE + PLOT.1 + BELOW);
        legend(&mut scene, (MARGIN, below), room, &entries);
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["task", "line", "across", "mean", "deviation", "n"]);
        for (task, points) in &self.panels {
            for point in points {
                data.rows.push(vec![
                    task.clone(),
                    self.values[point.line].to_string(),
                    point.across.to_string(),
                    point.score.mean.to_string(),
                    point.score.deviation.to_string(),
                    point.score.n.to_string(),
                ]);
            }
        }
        data
    }
}

impl Sensitivity {
    /// All positions on the horizontal axis, sorted.
    fn places(&self) -> Vec<f64> {
        let all = self.panels.iter().flat_map(|(_, points)| points);
        let mut places: Vec<f64> = all.map(|point| point.across).collect();
        places.sort_by(f64::total_cmp);
        places.dedup();
        places
    }

    fn panel(&self, scene: &mut Scene, area: Area, task: &str, points: &[Point]) {
        let n = counts(points.iter().map(|point| point.score.n));
        let title = format!("{task}, {n}");
        scene.text((area.x, area.y - 9.0), Anchor::Start, HEADING, INK, &title);
        let places = self.places();
        let (least, most) = match places.as_slice() {
            [] => (0.0, 1.0),
            [first, .., last] => (*first, *last),
            [only] => (only - 1.0, only + 1.0),
        };
        let border = (most - least) * 0.12;
        let high = points.iter().map(|point| point.score.mean + point.score.deviation);
        let y = range(high);
        let axes = Axes::new(area, (least - border, most + border), y);
        let marks = if places.len() > 8 { ticks((least, most), 5) } else { places };
        if points.is_empty() {
            axes.empty(scene, "no games");
            return;
        }
        axes.draw(scene, &marks, &ticks(y, 4));
        let below = (area.x + area.width / 2.0, area.bottom() + 29.0);
        scene.text(below, Anchor::Middle, LABEL, MUTED, &self.across);
        // Lines are shifted by a few pixels, so that bars at the same position are distinguishable.
        let apart = (24.0 / real(self.values.len().max(1))).min(5.0);
        for line in 0..self.values.len() {
            let mut points: Vec<_> = points.iter().filter(|point| point.line == line).collect();
            points.sort_by(|a, b| a.across.total_cmp(&b.across));
            let style = style(line);
            let shift = (real(line) - (real(self.values.len()) - 1.0) / 2.0) * apart;
            let at = |point: &Point, score| {
                let (x, y) = axes.point(point.across, score);
                (x + shift, y)
            };
            let through = points.iter().map(|point| at(point, point.score.mean)).collect();
            scene.path(through, Paint::dashed(style.color, 1.6, style.dash));
            for point in points {
                let Summary { mean, deviation, .. } = point.score;
                let low = if mean >= 0.0 { (mean - deviation).max(0.0) } else { mean - deviation };
                let ends = [low, mean + deviation].map(|score| at(point, score));
                scene.line(ends[0], ends[1], Paint::line(style.color, 1.2));
                for (x, y) in ends {
                    scene.line((x - 3.0, y), (x + 3.0, y), Paint::line(style.color, 1.2));
                }
                let middle = at(point, mean);
                scene.circle(middle, 4.6, Paint::fill(PAPER));
                marker(scene, middle, 3.4, style);
            }
        }
    }
}
