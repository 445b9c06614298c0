//! The translations that bring some of the few onto one of the many.

use super::cells::{Cells, Step};

/// A flag for every translation between the two corners: whether some cells meet.
#[derive(Debug, Default)]
pub(super) struct Meetings {
    /// The last row and column of the few: the farthest move back.
    back: Step,
    /// The last row and column of the many.
    last: Step,
    meet: Vec<bool>,
    places: Vec<usize>,
}

impl Meetings {
    pub(super) fn set(&mut self, few: &Cells, many: &Cells) {
        (self.back, self.last) = (few.last, many.last);
        let last = self.place(self.last);
        self.meet.clear();
        self.meet.resize(last + 1, false);
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        places.extend(many.all.iter().map(|&cell| self.place(cell)));
        let origin = self.place((0, 0));
        for &(i, j) in &few.all {
            let before = self.place((i, j)) - origin;
            for place in &places {
                self.meet[place - before] = true;
            }
        }
        self.places = places;
    }

    /// True if a translation, back by at most the extent of the few, brings some of the few onto one of the many.
    pub(super) fn has(&self, by: Step) -> bool {
        self.meet[self.place(by)]
    }

    /// The translation if it brings some of the few onto one of the many.
    pub(super) fn near(&self, by: (i32, i32)) -> Option<Step> {
        let (i, j) = (i16::try_from(by.0).ok()?, i16::try_from(by.1).ok()?);
        let is_inside =
            (-self.back.0..=self.last.0).contains(&i) && (-self.back.1..=self.last.1).contains(&j);
        (is_inside && self.has((i, j))).then_some((i, j))
    }

    fn place(&self, (i, j): Step) -> usize {
        let stride = usize::from((self.back.1 + self.last.1).unsigned_abs()) + 1;
        let inside = |at: i16| usize::from(at.unsigned_abs());
        inside(i + self.back.0) * stride + inside(j + self.back.1)
    }
}
