//! Correlations of metrics, with the score as bars, and with each other as a heat map.

use swarmbench_analysis::statistics::{Correlation, NoCorrelation, q_values, stars};

use crate::chart::{HEADING, LABEL, MARGIN, Scale, counts, heading, heading_height, number, real};
use crate::font;
use crate::palette::{AXIS, Color, GROUND, INK, MUTED, PAPER, RULE};
use crate::scene::{Anchor, Area, Paint, Scene};
use crate::{Data, Figure, cell};

/// Of two quantities over games, or why there is none.
pub type Found = Result<Correlation, NoCorrelation>;

/// Of each metric with the score, as bars in the order of their size.
#[derive(Clone, Debug, PartialEq)]
pub struct Bars {
    /// Of which games.
    pub title: String,
    /// Settings and definitions, for the reader.
    pub notes: Vec<String>,
    /// Metrics and their correlations with the score.
    pub rows: Vec<(String, Found)>,
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
    pub cells: Vec<Vec<Found>>,
}

const STARS: &str = "* p < 0.05, ** p < 0.01, *** p < 0.001";
/// Where the columns of numbers end, at the right of the bars.
const NUMBERS: [f64; 3] = [40.0, 108.0, 142.0];
/// The widest room for a name.
const NAME: f64 = 250.0;

fn name_room<'a>(names: impl Iterator<Item = &'a String>) -> f64 {
    names.map(|name| font::width(name, LABEL)).fold(60.0, f64::max).min(NAME)
}

impl Figure for Bars {
    fn scene(&self) -> Scene {
        const ROW: f64 = 20.0;
        let names = name_room(self.rows.iter().map(|(name, _)| name));
        let plot = 340.0;
        let width = MARGIN.mul_add(2.0, names + 10.0 + plot + NUMBERS[2] + 4.0);
        let notes = self.notes();
        let height = heading_height(width, &notes) + (real(self.rows.len()) + 1.0) * ROW + 40.0;
        let mut scene = Scene::new(width, height, &self.title);
        let top = heading(&mut scene, &self.title, &notes) + ROW;
        let bottom = top + real(self.rows.len()) * ROW;
        let left = MARGIN + names + 10.0;
        let scale = Scale::new((-1.0, 1.0), left, left + plot);
        for tick in [-1.0, -0.5, 0.0, 0.5, 1.0] {
            let (at, color) = (scale.at(tick), if tick == 0.0 { AXIS } else { RULE });
            scene.line((at, top), (at, bottom), Paint::line(color, 1.0));
            scene.text((at, bottom + 15.0), Anchor::Middle, LABEL, MUTED, &number(tick));
        }
        let numbers = |scene: &mut Scene, y: f64, color, texts: [&str; 3]| {
            for (place, text) in NUMBERS.iter().zip(texts) {
                let at = (scale.at(1.0) + place, y);
                scene.text(at, Anchor::End, LABEL, color, text);
            }
        };
        numbers(&mut scene, top - 6.0, MUTED, ["r", "q", "n"]);
        let mut rows = self.tested();
        let size = |row: &Tested| row.found.map_or(-1.0, |found| found.r.abs());
        rows.sort_by(|a, b| size(b).total_cmp(&size(a)));
        for (place, Tested { name, found, q }) in rows.into_iter().enumerate() {
            let middle = top + (real(place) + 0.5) * ROW;
            let look = (Anchor::End, LABEL, INK);
            scene.text_within((MARGIN + names, middle + 3.5), names, look, name);
            let found = match found {
                Ok(found) => found,
                Err(why) => {
                    let look = (Anchor::Middle, LABEL, MUTED);
                    let text = format!("undefined: {why}");
                    let width = font::width(&text, LABEL).min(plot - 8.0) + 8.0;
                    let below = Area::new(scale.at(0.0) - width / 2.0, middle - 8.0, width, 16.0);
                    scene.rect(below, Paint::fill(PAPER));
                    scene.text_within((scale.at(0.0), middle + 3.5), plot - 8.0, look, &text);
                    numbers(&mut scene, middle + 3.5, MUTED, ["–", "–", &why.n().to_string()]);
                    continue;
                }
            };
            let (zero, end) = (scale.at(0.0), scale.at(found.r));
            let bar = Area::new(zero.min(end), middle - 6.0, (end - zero).abs(), 12.0);
            let color = if found.r < 0.0 { Color::VERMILLION } else { Color::BLUE };
            scene.rect(bar, Paint::fill(color));
            if found.r < 0.0 {
                scene.hatch(bar, 6.0, Paint::line(PAPER, 1.0));
            }
            if let Some((low, high)) = found.interval {
                whisker(&mut scene, (scale.at(low), scale.at(high)), middle);
            }
            let r = signed(found.r);
            let after = (scale.at(1.0) + NUMBERS[0], middle + 3.5);
            scene.text(after, Anchor::Start, LABEL, INK, stars(found.p));
            let q = q.map_or_else(String::new, probability);
            numbers(&mut scene, middle + 3.5, INK, [&r, &q, &found.n.to_string()]);
        }
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["metric", "r", "low", "high", "p", "q", "rho", "stars", "n"]);
        data.rows = (self.tested().into_iter())
            .map(|Tested { name, found, q }| {
                let mut row = row(vec![name.clone()], found);
                row.insert(5, cell(q.map(exact)));
                row
            })
            .collect();
        data
    }
}

/// A metric, and how its correlation with the score stands among those of all metrics.
struct Tested<'a> {
    name: &'a String,
    found: &'a Found,
    q: Option<f64>,
}

impl Bars {
    fn tested(&self) -> Vec<Tested<'_>> {
        let p: Vec<Option<f64>> =
            self.rows.iter().map(|(_, found)| Some(found.as_ref().ok()?.p)).collect();
        let rows = self.rows.iter().zip(q_values(&p));
        rows.map(|((name, found), q)| Tested { name, found, q }).collect()
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = self.notes.clone();
        notes.push(format!(
            "Pearson correlation r with the final score; lines: 95 % interval; negative bars are hatched; {STARS}; \
             q: false discovery rate over these metrics; n: games"
        ));
        notes
    }
}

/// A coefficient with its sign.
fn signed(r: f64) -> String {
    format!("{r:+.2}").replace('-', "−")
}

/// All digits, with an exponent where it is small.
fn exact(p: f64) -> String {
    format!("{p:?}")
}

fn probability(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") }
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
fn row(mut cells: Vec<String>, found: &Found) -> Vec<String> {
    let (of, n) = match found {
        Ok(found) => (Some(found), found.n),
        Err(why) => (None, why.n()),
    };
    let interval = of.and_then(|of| of.interval);
    cells.extend([
        cell(of.map(|of| of.r)),
        cell(interval.map(|(low, _)| low)),
        cell(interval.map(|(_, high)| high)),
        cell(of.map(|of| exact(of.p))),
        cell(of.map(|of| of.rho)),
        cell(of.map(|of| stars(of.p))),
        n.to_string(),
    ]);
    cells
}

impl Figure for HeatMap {
    fn scene(&self) -> Scene {
        const SIDE: f64 = 44.0;
        let names = name_room(self.names.iter());
        let count = real(self.names.len());
        let mut notes = self.notes.clone();
        let n = self.cells.iter().flatten().flatten().map(|found| found.n);
        notes.push(format!(
            "Pearson correlation; {} for each pair; {STARS} (of each pair alone); –: undefined",
            counts(n)
        ));
        let width = MARGIN.mul_add(2.0, names + 10.0 + (count * SIDE).max(200.0));
        let height = heading_height(width, &notes) + count * SIDE + names + 3.0 * MARGIN;
        let mut scene = Scene::new(width, height, &self.title);
        let top = heading(&mut scene, &self.title, &notes);
        let left = MARGIN + names + 10.0;
        for (i, (name, cells)) in self.names.iter().zip(&self.cells).enumerate() {
            let y = top + real(i) * SIDE;
            let look = (Anchor::End, LABEL, INK);
            scene.text_within((left - 8.0, y + SIDE / 2.0 + 3.5), names, look, name);
            for (j, found) in cells.iter().enumerate() {
                let area = Area::new(left + real(j) * SIDE, y, SIDE, SIDE);
                draw_cell(&mut scene, area, found, i == j);
            }
            let at = (left + (real(i) + 0.5) * SIDE + 3.5, top + count * SIDE + 8.0);
            let text = font::fit(name, LABEL, names);
            scene.text_upwards(at, Anchor::End, LABEL, INK, &text);
        }
        scene
    }

    fn data(&self) -> Data {
        let mut data = Data::new(&["row", "column", "r", "low", "high", "p", "rho", "stars", "n"]);
        for (name, cells) in self.names.iter().zip(&self.cells) {
            for (other, found) in self.names.iter().zip(cells) {
                data.rows.push(row(vec![name.clone(), other.clone()], found));
            }
        }
        data
    }
}

fn draw_cell(scene: &mut Scene, area: Area, found: &Found, is_same: bool) {
    let middle = area.x + area.width / 2.0;
    let Some(found) = found.as_ref().ok().filter(|_| !is_same) else {
        scene.rect(area, Paint::fill(GROUND).outlined(PAPER, 1.0));
        if !is_same {
            let y = area.y + area.height / 2.0 + 4.0;
            scene.text((middle, y), Anchor::Middle, HEADING, MUTED, "–");
        }
        return;
    };
    let full = if found.r < 0.0 { Color::VERMILLION } else { Color::BLUE };
    let color = PAPER.mixed(full, found.r.abs());
    scene.rect(area, Paint::fill(color).outlined(PAPER, 1.0));
    let ink = color.text_on();
    let above = (middle, area.y + area.height / 2.0 + 1.0);
    scene.text(above, Anchor::Middle, LABEL, ink, &signed(found.r));
    let below = (middle, area.y + area.height / 2.0 + 13.0);
    scene.text(below, Anchor::Middle, LABEL, ink, stars(found.p));
}
