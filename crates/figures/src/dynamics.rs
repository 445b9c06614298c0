//! Group dynamics of a model in a task, in four panels: score, messages, choices, positions.

use swarmbench_analysis::metric::Panel as Group;

use crate::chart::{
    Axes, HEADING, LABEL, MARGIN, heading, heading_height, legend, legend_height, number, opacity,
    range, real, ticks,
};
use crate::palette::{INK, MUTED, Style, style};
use crate::scene::{Anchor, Area, Paint, Scene};
use crate::series::Band;
use crate::{Data, Figure, cell};

/// The figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Dynamics {
    /// The title: the model and the task.
    pub title: String,
    /// Settings and definitions, for the reader.
    pub notes: Vec<String>,
    /// The number of games.
    pub games: usize,
    /// The maximum number of rounds of a game.
    pub rounds: usize,
    /// The score.
    pub score: Curve,
    /// The metrics, in the order of the legends.
    pub metrics: Vec<(Group, Curve)>,
}

/// A quantity in each state of games.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The name of the quantity.
    pub name: String,
    /// The divisor of drawn values.
    pub divisor: f64,
    /// The mean and deviation over all games.
    pub band: Band,
    /// The values of the game with the highest final score.
    pub best: Vec<Option<f64>>,
}

const PLOT: (f64, f64) = (360.0, 190.0);
const BESIDE: f64 = 48.0;
const ABOVE: f64 = 26.0;
const BELOW: f64 = 38.0;
const GAP: f64 = 14.0;

impl Figure for Dynamics {
    fn scene(&self) -> Scene {
        let width = MARGIN.mul_add(2.0, 2.0 * (BESIDE + PLOT.0));
        let panels = self.panels();
        let heights = panels.each_ref().map(|(_, curves)| {
            ABOVE + PLOT.1 + BELOW + legend_height(PLOT.0, &entries(curves)) + GAP
        });
        let rows = [heights[0].max(heights[1]), heights[2].max(heights[3])];
        let mut notes = self.notes.clone();
        let (n, what) = (self.games, "solid: the game with the highest final score");
        notes.push(format!("n = {n}; {what}; dashed: mean of all games; band: mean ± deviation"));
        let height = heading_height(width, &notes) + rows[0] + rows[1];
        let mut scene = Scene::new(width, height, &self.title);
        let top = heading(&mut scene, &self.title, &notes);
        for (place, (name, curves)) in panels.iter().enumerate() {
            let x = MARGIN + BESIDE - 8.0 + real(place % 2) * (BESIDE + PLOT.0);
            let y = top + ABOVE + if place < 2 { 0.0 } else { rows[0] };
            self.panel(&mut scene, Area::new(x, y, PLOT.0, PLOT.1), name, curves);
        }
        scene
    }

    fn data(&self) -> Data {
        let columns = ["panel", "metric", "divisor", "round", "best", "mean", "deviation", "n"];
        let mut data = Data::new(&columns);
        for (panel, curves) in self.panels() {
            for curve in curves {
                for (round, &count) in curve.band.counts.iter().enumerate() {
                    data.rows.push(vec![
                        panel.to_owned(),
                        curve.name.clone(),
                        curve.divisor.to_string(),
                        round.to_string(),
                        cell(curve.best.get(round).copied().flatten()),
                        cell(curve.band.mean[round]),
                        cell(curve.band.deviation[round]),
                        count.to_string(),
                    ]);
                }
            }
        }
        data
    }
}

impl Dynamics {
    fn panels(&self) -> [(&'static str, Vec<&Curve>); 4] {
        let of = |group| {
            let metrics = self.metrics.iter().filter(move |(panel, _)| *panel == group);
            metrics.map(|(_, curve)| curve).collect()
        };
        [
            ("a  Score", vec![&self.score]),
            ("b  Messages", of(Group::Messages)),
            ("c  Choices", of(Group::Choices)),
            ("d  Positions", of(Group::Positions)),
        ]
    }

    fn panel(&self, scene: &mut Scene, area: Area, name: &str, curves: &[&Curve]) {
        scene.text((area.x, area.y - 9.0), Anchor::Start, HEADING, INK, name);
        let drawn: Vec<Drawn> = curves.iter().map(|curve| Drawn::of(curve)).collect();
        let values = drawn.iter().flat_map(|curve| curve.high.iter().chain(&curve.best));
        let (x, y) = ((0.0, real(self.rounds)), range(values.copied().flatten()));
        let axes = Axes::new(area, x, y);
        legend(scene, (area.x, area.bottom() + BELOW), area.width, &entries(curves));
        if drawn.iter().all(|curve| curve.mean.iter().all(Option::is_none)) {
            axes.empty(scene, "no values");
            return;
        }
        axes.draw(scene, &ticks(x, 5), &ticks(y, 4));
        let below = (area.x + area.width / 2.0, area.bottom() + 29.0);
        scene.text(below, Anchor::Middle, LABEL, MUTED, "round");
        for (number, curve) in drawn.iter().enumerate() {
            let veil = Paint::veil(style(number).color, opacity(drawn.len()));
            axes.band(scene, &curve.low, &curve.high, veil);
        }
        for (number, curve) in drawn.iter().enumerate() {
            let style = style(number);
            axes.curve(scene, &curve.mean, Paint::dashed(style.color, 1.2, &[5.0, 3.0]));
            axes.line(scene, &curve.best, Style { dash: &[], ..style }, number);
        }
    }
}

/// The values of a curve, divided by its divisor.
struct Drawn {
    mean: Vec<Option<f64>>,
    low: Vec<Option<f64>>,
    high: Vec<Option<f64>>,
    best: Vec<Option<f64>>,
}

impl Drawn {
    fn of(curve: &Curve) -> Self {
        let divided = |values: Vec<Option<f64>>| {
            values.into_iter().map(|value| Some(value? / curve.divisor)).collect()
        };
        Self {
            mean: divided(curve.band.mean.clone()),
            low: divided(curve.band.low()),
            high: divided(curve.band.high()),
            best: divided(curve.best.clone()),
        }
    }
}

#[expect(clippy::float_cmp, reason = "the divisor of what is not divided is exactly 1")]
fn entries(curves: &[&Curve]) -> Vec<(String, Style)> {
    let name = |curve: &Curve| {
        if curve.divisor == 1.0 {
            curve.name.clone()
        } else {
            format!("{} ÷ {}", curve.name, number(curve.divisor))
        }
    };
    let styles = (0..).map(|number| Style { dash: &[], ..style(number) });
    curves.iter().map(|curve| name(curve)).zip(styles).collect()
}
