//! Pages of a replay.

use swarmbench_protocol::replay::ReplayPage;

use super::reel::{Frame, Reel, Round, Scene};

/// Rounds of a page.
pub const ROUNDS_MAX: u32 = 100;

/// Agents times rounds of a page. A page always has at least one round.
pub const AGENT_ROUNDS_MAX: u32 = 20_000;

/// Approximate bytes of a page as JSON: the round that reaches them is the last. A page always has at least one round.
pub const PAGE_BYTES_MAX: usize = 1_000_000;

/// Number of rounds of a page, for `rounds` requested ones and a number of agents.
#[must_use]
pub fn rounds_of_page(rounds: u32, agents: u32) -> u32 {
    rounds.min(ROUNDS_MAX).min(AGENT_ROUNDS_MAX / agents.max(1)).max(1)
}

/// A page that is made state by state.
pub struct PageMaker {
    reel: Reel,
    page: ReplayPage,
    bytes: usize,
}

impl PageMaker {
    /// Starts a page at the state after `from` rounds. The reel is at this state or an earlier one.
    #[must_use]
    pub fn new(reel: Reel, from: u32) -> Self {
        let metrics = reel.metrics().iter().map(|metric| (metric.name().to_owned(), Vec::new()));
        let page = ReplayPage { from, metrics: metrics.collect(), ..ReplayPage::default() };
        let mut maker = Self { reel, page, bytes: 0 };
        maker.add(maker.reel.first());
        maker
    }

    /// True if the page has [`PAGE_BYTES_MAX`].
    #[must_use]
    pub const fn is_full(&self) -> bool {
        self.bytes >= PAGE_BYTES_MAX && self.page.length > 1
    }

    /// Adds a round and the state after it. The page must not be full.
    pub fn add_round(&mut self, round: &Round, after: Scene) {
        let frame = self.reel.step(round, after);
        self.add(frame);
    }

    /// The page.
    #[must_use]
    pub fn finish(self) -> ReplayPage {
        self.page
    }

    fn add(&mut self, frame: Frame) {
        let Frame { state, values } = frame;
        if state.round < self.page.from {
            return;
        }
        for (metric, value) in self.reel.metrics().iter().zip(values) {
            let series = self.page.metrics.get_mut(metric.name()).expect("it has all of them");
            series.push(value.map(rounded));
        }
        self.bytes += state.approximate_bytes();
        self.page.states.push(state);
        self.page.length += 1;
    }
}

/// Rounds to four decimals.
#[must_use]
pub fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
