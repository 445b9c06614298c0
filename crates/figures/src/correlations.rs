//! Correlations of metrics, with the score as bars, and with each other as a heat map.

use crate::chart::{HEADING, LABEL, MARGIN, Scale, counts, heading, heading_height, number, real};
use crate::font;
use crate::palette::{AXIS, Color, GROUND, INK, MUTED, PAPER, RULE};
use crate::scene::{Anchor, Area, Paint, Scene};
use crate::{Data, Figure, cell};

/// A correlation of two quantities over games.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Correlation {
    /// The coefficient, from −1 to 1; `None` where it is undefined.
    pub r: Option<f64>,
    /// The probability of one at least as large without any relation.
    pub p: Option<f64>,
    /// The interval of 95 %.
    pub interval: Option<(f64, f64)>,
    /// From how many games.
    pub n: usize,
}

impl Correlation {
    /// One star for p < 0.05, two for p < 0.01, three for p < 0.001.
    #[must_use]
    pub fn stars(&self) -> &'static str {
        match self.p {
            Some(p) if p < 0.001 => "***",
            Some(p) if p < 0.01 => "**",
            Some(p) if p < 0.05 => "*",
            _ => "",
        }
    }
}

/// Of each metric with the score, as bars in the order of their size.
#[derive(Clone, Debug, PartialEq)]
pub struct Bars {
    /// Of which games.
    pub title: String,
    /// Settings and definitions, for the reader.
    pub notes: Vec<String>,
    /// Metrics and their correlations with the score.
    pub rows: Vec<(String, Correlation)>,
}

/// Of all pairs of quantities.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatMap {
    /// Of which games.
    pub title: String,
    /// Settings and definitions, for the reader.
    pub notes: Vec<String>,
    /// The quantities.
    pub names: Vec<String>,
    /// Row by row, the pairs of each with those before it and with itself.
    pub cells: Vec<Vec<Correlation>>,
}

const STARS: &str = "* p < 0.05, ** p < 0.01, *** p < 0.001 (not corrected)";
/// The widest room for a name.
const NAME: f64 = 250.0;

fn name_room<'a>(names: impl Iterator<Item = &'a String>) -> f64 {
    names.map(|name| font::width(name, LABEL)).fold(60.0, f64::max).min(NAME)
}

impl Figure for Bars {
    fn scene(&self) -> Scene {
        const ROW: f64 = 20.0;
        let names = name_room(self.rows.iter().map(|(name, _)| name));
        let plot = 360.0;
        let width = MARGIN.mul_add(2.0, names + 10.0 + plot + 110.0);
        let notes = self.notes();
        let height = heading_height(width, &notes) + real(self.rows.len()) * ROW + 40.0;
        let mut scene = Scene::new(width, height, &self.title);
        let top = heading(&mut scene, &self.title, &notes);
        let bottom = top + real(self.rows.len()) * ROW;
        let left = MARGIN + names + 10.0;
        let scale = Scale::new((-1.0, 1.0), left, left + plot);
        for tick in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let (at, color) = (scale.at(tick), if tick == 0.0 { AXIS } else { RULE });
            scene.line((at, top), (at, bottom), Paint::line(color, 1.0));
            scene.text((at, bottom + 15.0), Anchor::Middle, LABEL, MUTED, &number(tick));
        }
        let mut rows: Vec<_> = self.rows.iter().collect();
        let size = |row: &(String, Correlation)| row.1.r.map_or(-1.0, f64::abs);
        rows.sort_by(|a, b| size(b).total_cmp(&size(a)));
        for (place, (name, correlation)) in rows.into_iter().enumerate() {
            let middle = top + (real(place) + 0.5) * ROW;
            let look = (Anchor::End, LABEL, INK);
            scene.text_within((MARGIN + names, middle + 3.5), names, look, name);
            let after = (scale.at(1.0) + 8.0, middle + 3.5);
            let Some(r) = correlation.r else {
                let text = format!("undefined, n = {}", correlation.n);
                scene.text(after, Anchor::Start, LABEL, MUTED, &text);
                continue;
            };
            let (zero, end) = (scale.at(0.0), scale.at(r));
            let bar = Area::new(zero.min(end), middle - 6.0, (end - zero).abs(), 12.0);
            let color = if r < 0.0 { Color::VERMILLION } else { Color::BLUE };
            scene.rect(bar, Paint::fill(color));
            if r < 0.0 {
                scene.hatch(bar, 6.0, Paint::line(PAPER, 1.0));
            }
            if let Some((low, high)) = correlation.interval {
                whisker(&mut scene, (scale.at(low), scale.at(high)), middle);
            }
            let sign = if r < 0.0 { "" } else { "+" };
            let r = format!("{r:.2}").replace('-', "−");
            let text = format!("{sign}{r}{}  n = {}", correlation.stars(), correlation.n);
            scene.text(after, Anchor::Start, LABEL, INK, &text);
        }
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["metric", "r", "low", "high", "p", "stars", "n"]);
        data.rows = self.rows.iter().map(|(name, of)| row(vec![name.clone()], of)).collect();
        data
    }
}

impl Bars {
    fn notes(&self) -> Vec<String> {
        let mut notes = self.notes.clone();
        notes.push(format!(
            "Pearson correlation with the final score; lines: 95 % interval; negative bars are hatched; {STARS}"
        ));
        notes
    }
}

/// An interval that is seen on any ground.
fn whisker(scene: &mut Scene, (low, high): (f64, f64), middle: f64) {
    for (color, width) in [(PAPER, 3.0), (INK, 1.2)] {
        scene.line((low, middle), (high, middle), Paint::line(color, width));
        for end in [low, high] {
            scene.line((end, middle - 3.0), (end, middle + 3.0), Paint::line(color, width));
        }
    }
}

/// A row of data: what is related, and how.
fn row(mut cells: Vec<String>, of: &Correlation) -> Vec<String> {
    cells.extend([
        cell(of.r),
        cell(of.interval.map(|(low, _)| low)),
        cell(of.interval.map(|(_, high)| high)),
        cell(of.p),
        of.stars().to_owned(),
        of.n.to_string(),
    ]);
    cells
}

impl Figure for HeatMap {
    fn scene(&self) -> Scene {
        const SIDE: f64 = 44.0;
        let names = name_room(self.names.iter());
        let count = real(self.names.len());
        let mut notes = self.notes.clone();
        let n = counts(self.cells.iter().flatten().map(|correlation| correlation.n));
        notes.push(format!("{n} games for each pair; {STARS}"));
        let width = MARGIN.mul_add(2.0, names + 10.0 + (count * SIDE).max(200.0));
        let height = heading_height(width, &notes) + count * SIDE + names + 3.0 * MARGIN;
        let mut scene = Scene::new(width, height, &self.title);
        let top = heading(&mut scene, &self.title, &notes);
        let left = MARGIN + names + 10.0;
        for (i, (name, cells)) in self.names.iter().zip(&self.cells).enumerate() {
            let y = top + real(i) * SIDE;
            let look = (Anchor::End, LABEL, INK);
            scene.text_within((left - 8.0, y + SIDE / 2.0 + 3.5), names, look, name);
            for (j, correlation) in cells.iter().enumerate() {
                let area = Area::new(left + real(j) * SIDE, y, SIDE, SIDE);
                draw_cell(&mut scene, area, correlation);
            }
            let at = (left + (real(i) + 0.5) * SIDE + 3.5, top + count * SIDE + 8.0);
            let text = font::fit(name, LABEL, names);
            scene.text_upwards(at, Anchor::End, LABEL, INK, &text);
        }
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["row", "column", "r", "low", "high", "p", "stars", "n"]);
        for (name, cells) in self.names.iter().zip(&self.cells) {
            for (other, correlation) in self.names.iter().zip(cells) {
                data.rows.push(row(vec![name.clone(), other.clone()], correlation));
            }
        }
        data
    }
}

fn draw_cell(scene: &mut Scene, area: Area, correlation: &Correlation) {
    let middle = area.x + area.width / 2.0;
    let Some(r) = correlation.r else {
        scene.rect(area, Paint::fill(GROUND).outlined(PAPER, 1.0));
        let y = area.y + area.height / 2.0 + 4.0;
        scene.text((middle, y), Anchor::Middle, HEADING, MUTED, "–");
        return;
    };
    let full = if r < 0.0 { Color::VERMILLION } else { Color::BLUE };
    let color = PAPER.mixed(full, r.abs().min(1.0));
    scene.rect(area, Paint::fill(color).outlined(PAPER, 1.0));
    let text = format!("{r:.2}").replace('-', "−");
    let ink = color.text_on();
    scene.text((middle, area.y + area.height / 2.0 + 1.0), Anchor::Middle, LABEL, ink, &text);
    let below = (middle, area.y + area.height / 2.0 + 13.0);
    scene.text(below, Anchor::Middle, LABEL, ink, correlation.stars());
}
