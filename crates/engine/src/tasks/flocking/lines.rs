//! Lower bounds from matchings on a line.

use wide::i32x8;

/// Number of translations processed together.
const LANES: usize = 8;

/// The least cost along one axis for every translation along it.
#[derive(Debug, Default)]
pub(super) struct Line {
    first: i32,
    bounds: Vec<i32>,
    many: Vec<i32>,
    costs: Vec<i32x8>,
}

impl Line {
    /// Finds the cheapest matching of all the `few`, moved by each translation, to some of the `many`;
    /// the few are sorted.
    ///
    /// The best matching keeps the order, so with `spare` points more on one side, point k goes to one of the points
    /// k to k + spare.
    pub(super) fn set(&mut self, few: &[i32], many: impl Iterator<Item = i32>) {
        let Self { first, bounds, many: to, costs } = self;
        let from = few;
        to.clear();
        to.extend(many);
        to.sort_unstable();
        let spare = to.len() - from.len();
        *first = to[0] - from[from.len() - 1];
        let last = to[to.len() - 1] - from[0];
        bounds.clear();
        let mut by = i32x8::from([0, 1, 2, 3, 4, 5, 6, 7]) + i32x8::splat(*first);
        for _ in (*first..=last).step_by(LANES) {
            // `costs[s]`: the points so far are matched and at most s of the many were passed over.
            costs.clear();
            costs.resize(spare + 1, i32x8::ZERO);
            for (k, &point) in from.iter().enumerate() {
                let at = i32x8::splat(point) + by;
                let mut least = i32x8::splat(i32::MAX);
                for (cost, &other) in costs.iter_mut().zip(&to[k..]) {
                    least = least.min(*cost + (at - i32x8::splat(other)).abs());
                    *cost = least;
                }
            }
            bounds.extend(costs[spare].to_array());
            by += i32x8::splat(8);
        }
        bounds.truncate(
            usize::try_from(last - *first + 1).expect("the last is not before the first"),
        );
    }

    /// The bound of a translation; `None` if it brings none of the few onto one of the many.
    pub(super) fn bound(&self, by: i32) -> Option<i32> {
        self.bounds.get(usize::try_from(by - self.first).ok()?).copied()
    }

    /// All translations with their bounds.
    pub(super) fn bounds(&self) -> impl Iterator<Item = (i32, i32)> + Clone {
        (self.first..).zip(self.bounds.iter().copied())
    }

    /// The least of all bounds.
    pub(super) fn least(&self) -> i32 {
        self.bounds.iter().copied().min().expect("neither is empty")
    }
}
