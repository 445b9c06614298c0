//! Axes, lines, bands, markers and legends, which all charts share.

use crate::font;
use crate::palette::{AXIS, GROUND, INK, MUTED, Marker, PAPER, RULE, Style};
use crate::scene::{Anchor, Area, Paint, Point, Scene};

/// The sizes of text.
pub(crate) const TITLE: f64 = 14.0;
pub(crate) const HEADING: f64 = 12.0;
pub(crate) const LABEL: f64 = 10.0;

/// The approximate distance between markers of a line, in pixels.
const MARKER_GAP: f64 = 40.0;

/// A linear map from numbers to coordinates.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    pub(crate) least: f64,
    pub(crate) most: f64,
    from: f64,
    to: f64,
}

impl Scale {
    /// Maps `least` to `from` and `most` to `to`. An empty range is extended.
    pub(crate) fn new((least, most): (f64, f64), from: f64, to: f64) -> Self {
        let most = if most > least { most } else { least + 1.0 };
        Self { least, most, from, to }
    }

    pub(crate) fn at(self, value: f64) -> f64 {
        (value - self.least) / (self.most - self.least) * (self.to - self.from) + self.from
    }

    /// The coordinate of a value, clamped to the scale.
    pub(crate) fn within(self, value: f64) -> f64 {
        self.at(value.clamp(self.least, self.most))
    }
}

/// A panel with two axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axes {
    pub(crate) area: Area,
    pub(crate) x: Scale,
    pub(crate) y: Scale,
}

impl Axes {
    pub(crate) fn new(area: Area, x: (f64, f64), y: (f64, f64)) -> Self {
        let x = Scale::new(x, area.x, area.right());
        Self { area, x, y: Scale::new(y, area.bottom(), area.y) }
    }

    pub(crate) fn point(&self, x: f64, y: f64) -> Point {
        (self.x.at(x), self.y.within(y))
    }

    /// Draws the axes, the lines behind the data, and the numbers of both.
    pub(crate) fn draw(&self, scene: &mut Scene, x_ticks: &[f64], y_ticks: &[f64]) {
        let Area { x, y, .. } = self.area;
        for &tick in y_ticks {
            let at = self.y.at(tick);
            scene.line((x, at), (self.area.right(), at), Paint::line(RULE, 1.0));
            scene.text((x - 5.0, at + 3.5), Anchor::End, LABEL, MUTED, &number(tick));
        }
        for &tick in x_ticks {
            let at = self.x.at(tick);
            let bottom = self.area.bottom();
            scene.line((at, bottom), (at, bottom + 4.0), Paint::line(AXIS, 1.0));
            scene.text((at, bottom + 15.0), Anchor::Middle, LABEL, MUTED, &number(tick));
        }
        let corner = (x, self.area.bottom());
        scene.path(vec![(x, y), corner, (self.area.right(), corner.1)], Paint::line(AXIS, 1.0));
    }

    /// Draws a panel without data, with the reason.
    pub(crate) fn empty(&self, scene: &mut Scene, why: &str) {
        let Area { x, y, width, height } = self.area;
        scene.rect(self.area, Paint::fill(GROUND));
        let middle = (x + width / 2.0, y + height / 2.0);
        scene.text(middle, Anchor::Middle, LABEL, MUTED, why);
    }

    /// Draws a line with gaps at missing values, and a marker now and then. `first` shifts the markers so that those
    /// of coinciding lines do not hide each other.
    pub(crate) fn line(
        &self,
        scene: &mut Scene,
        values: &[Option<f64>],
        style: Style,
        first: usize,
    ) {
        self.curve(scene, values, Paint::dashed(style.color, 1.6, style.dash));
        let across = self.x.at(1.0) - self.x.at(0.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let step = ((MARKER_GAP / across).ceil() as usize).max(1);
        for (place, value) in values.iter().enumerate() {
            let (Some(value), true) = (value, place % step == (first * 3 + step / 2) % step) else {
                continue;
            };
            marker(scene, self.point(real(place), *value), 3.2, style);
        }
    }

    /// Draws a line like [`Axes::line`], without markers.
    pub(crate) fn curve(&self, scene: &mut Scene, values: &[Option<f64>], paint: Paint) {
        for run in runs(values) {
            let points = run.iter().map(|&(x, y)| self.point(x, y)).collect();
            scene.path(points, paint);
        }
    }

    /// Draws the band between two series.
    pub(crate) fn band(
        &self,
        scene: &mut Scene,
        low: &[Option<f64>],
        high: &[Option<f64>],
        paint: Paint,
    ) {
        for (low, high) in runs(low).into_iter().zip(runs(high)) {
            let points = low.iter().chain(high.iter().rev());
            scene.path(points.map(|&(x, y)| self.point(x, y)).collect(), paint);
        }
    }
}

/// The opacity of each of several bands, such that the lines behind all of them stay visible.
pub(crate) fn opacity(bands: usize) -> f64 {
    (0.6 / real(bands.max(1))).min(0.14)
}

/// The parts of a series between gaps, as points.
fn runs(values: &[Option<f64>]) -> Vec<Vec<Point>> {
    let numbered: Vec<_> = values.iter().enumerate().collect();
    let parts = numbered.split(|(_, value)| value.is_none()).filter(|part| !part.is_empty());
    let point = |(place, value): &(usize, &Option<f64>)| value.map(|value| (real(*place), value));
    parts.map(|part| part.iter().filter_map(point).collect()).collect()
}

/// A count as a coordinate.
#[expect(clippy::cast_precision_loss, reason = "far below 2^52")]
pub(crate) fn real(count: usize) -> f64 {
    count as f64
}

/// About `count` round numbers in a range.
pub(crate) fn ticks((least, most): (f64, f64), count: usize) -> Vec<f64> {
    if most <= least {
        return vec![least];
    }
    let raw = (most - least) / real(count.max(1));
    let magnitude = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * magnitude)
        .find(|&step| step >= raw * 0.999)
        .unwrap_or(10.0 * magnitude);
    let first = (least / step - 1e-9).ceil();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    let last = ((most / step + 1e-9).floor() - first).max(0.0) as usize;
    (0..=last).map(|place| (first + real(place)) * step).collect()
}

/// The smallest range with round ends around all values and 0.
pub(crate) fn range(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (mut least, mut most) = (0.0_f64, 0.0_f64);
    for value in values.into_iter().filter(|value| value.is_finite()) {
        least = least.min(value);
        most = most.max(value);
    }
    if most <= least {
        return (least, least + 1.0);
    }
    let marks = ticks((least, most), 4);
    let step = if marks.len() > 1 { marks[1] - marks[0] } else { most - least };
    ((least / step + 1e-9).floor() * step, (most / step - 1e-9).ceil() * step)
}

/// A number as a label, with at most three decimals.
pub(crate) fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.').replace('-', "−");
    if text == "−0" { "0".to_owned() } else { text }
}

/// Draws a marker around a point.
pub(crate) fn marker(scene: &mut Scene, (x, y): Point, r: f64, style: Style) {
    let filled = Paint::fill(style.color).outlined(PAPER, 0.8);
    let line = Paint::line(style.color, 1.8);
    match style.marker {
        Marker::Circle => scene.circle((x, y), r, filled),
        Marker::Square => {
            let side = 1.8 * r;
            scene.rect(Area::new(x - side / 2.0, y - side / 2.0, side, side), filled);
        }
        Marker::Triangle => {
            scene.path(vec![(x - r, y + r * 0.8), (x, y - r * 1.1), (x + r, y + r * 0.8)], filled);
        }
        Marker::TriangleDown => {
            scene.path(vec![(x - r, y - r * 0.8), (x, y + r * 1.1), (x + r, y - r * 0.8)], filled);
        }
        Marker::Diamond => {
            let r = r * 1.2;
            scene.path(vec![(x - r, y), (x, y - r), (x + r, y), (x, y + r)], filled);
        }
        Marker::Plus => {
            scene.line((x - r, y), (x + r, y), line);
            scene.line((x, y - r), (x, y + r), line);
        }
        Marker::Cross => {
            scene.line((x - r, y - r), (x + r, y + r), line);
            scene.line((x - r, y + r), (x + r, y - r), line);
        }
        Marker::Hourglass => {
            scene
                .path(vec![(x - r, y - r), (x + r, y - r), (x - r, y + r), (x + r, y + r)], filled);
        }
    }
}

/// Draws the names of series with their lines and markers, in as many columns as fit. Returns the height.
pub(crate) fn legend(
    scene: &mut Scene,
    (x, y): Point,
    room: f64,
    entries: &[(String, Style)],
) -> f64 {
    const SIGN: f64 = 34.0;
    const ROW: f64 = 16.0;
    let widest = entries.iter().map(|(name, _)| font::width(name, LABEL)).fold(0.0, f64::max);
    let column = (widest + SIGN + 18.0).min(room);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few columns")]
    let columns = ((room / column).floor() as usize).max(1);
    for (number, (name, style)) in entries.iter().enumerate() {
        let left = x + real(number % columns) * column;
        let middle = y + real(number / columns) * ROW + ROW / 2.0;
        let line = Paint::dashed(style.color, 1.6, style.dash);
        scene.line((left, middle), (left + SIGN - 6.0, middle), line);
        marker(scene, (left + (SIGN - 6.0) / 2.0, middle), 3.2, *style);
        let look = (Anchor::Start, LABEL, INK);
        scene.text_within((left + SIGN, middle + 3.5), column - SIGN - 10.0, look, name);
    }
    real(entries.len().div_ceil(columns)) * ROW
}

/// The height that [`legend`] needs.
pub(crate) fn legend_height(room: f64, entries: &[(String, Style)]) -> f64 {
    legend(&mut Scene::new(0.0, 0.0, ""), (0.0, 0.0), room, entries)
}

/// Draws the title of a figure and its settings below; returns the vertical coordinate below both.
pub(crate) fn heading(scene: &mut Scene, title: &str, notes: &[String]) -> f64 {
    let room = scene.width - 2.0 * MARGIN;
    scene.text_within((MARGIN, 24.0), room, (Anchor::Start, TITLE, INK), title);
    let mut y = 24.0;
    for line in notes.iter().flat_map(|note| font::wrap(note, LABEL, room)) {
        y += 15.0;
        scene.text((MARGIN, y), Anchor::Start, LABEL, MUTED, &line);
    }
    y + 12.0
}

/// The height that [`heading`] needs.
pub(crate) fn heading_height(width: f64, notes: &[String]) -> f64 {
    heading(&mut Scene::new(width, 0.0, ""), "", notes)
}

/// The empty border of a figure.
pub(crate) const MARGIN: f64 = 16.0;

/// The number of games behind values, for a note: `n = 5` or `n = 3 to 5`.
pub(crate) fn counts(numbers: impl IntoIterator<Item = usize>) -> String {
    let numbers: Vec<usize> = numbers.into_iter().collect();
    match (numbers.iter().min(), numbers.iter().max()) {
        (Some(least), Some(most)) if least < most => format!("n = {least} to {most}"),
        (Some(least), _) => format!("n = {least}"),
        _ => "n = 0".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_range() {
        assert_eq!(ticks((0.0, 100.0), 5), [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(ticks((0.0, 1.0), 4), [0.0, 0.5, 1.0]);
        assert_eq!(ticks((-3.0, 3.0), 3), [-2.0, 0.0, 2.0]);
        assert_eq!(ticks((2.0, 2.0), 3), [2.0]);
        assert_eq!(range([3.7, 11.0]), (0.0, 15.0));
        assert_eq!(range([]), (0.0, 1.0));
        assert_eq!(range([-4.0, f64::NAN, 2.0]), (-4.0, 2.0));
    }

    #[test]
    fn numbers_are_short() {
        let shown: Vec<String> = [0.1 + 0.2, -2.0, -0.0001, 100.0].map(number).into();
        assert_eq!(shown, ["0.3", "−2", "0", "100"]);
    }

    #[test]
    fn lines_are_broken_where_there_is_no_value() {
        let parts = runs(&[None, Some(1.0), Some(2.0), None, Some(3.0)]);
        assert_eq!(parts, [vec![(1.0, 1.0), (2.0, 2.0)], vec![(4.0, 3.0)]]);
    }
}
