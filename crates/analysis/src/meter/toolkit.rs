//! The frames of the public toolkit: the decisions of a round, and the transition to the state in which they were made.

use super::column::Table;
use super::counts::{Counts, Said};
use super::places::Explored;
use super::row::{MeterRow, SoFar};
use super::texts::Cosines;
use crate::game::{Setup, State};
use crate::metric::{Metric, RunValue};

/// The frames of a game.
pub(super) struct Toolkit {
    table: Table,
    explored: Explored,
    walked: u64,
    /// The transition that led to the newest frame, whose decisions are not known yet.
    next: Counts,
}

impl Toolkit {
    pub(super) fn new(setup: &Setup, layout: &State, keeps_series: bool) -> Self {
        let (table, explored) = (Table::new(keeps_series), Explored::default());
        let mut frames = Self { table, explored, walked: 0, next: Counts::default() };
        frames.see(setup, layout);
        frames
    }

    /// Adds the decisions in a state, which complete its frame.
    pub(super) fn decided(
        &mut self,
        state: &State,
        counts: Counts,
        said: &Said<'_>,
        cosines: Cosines,
    ) {
        let Counts { explored, kept_pairs, pushes, .. } = self.next;
        let counts = Counts { explored, kept_pairs, pushes, ..counts.of_toolkit(state, said) };
        for metric in metrics() {
            self.table.add(metric, self.value(state, counts, cosines, metric));
        }
    }

    /// Adds the state after that round.
    pub(super) fn moved(
        &mut self,
        setup: &Setup,
        after: &State,
        walked: u64,
        kept: u32,
        pushes: u32,
    ) {
        self.walked = walked;
        self.next = Counts { kept_pairs: kept, pushes, ..Counts::default() };
        self.see(setup, after);
    }

    /// The mean over all frames but the last; undefined, not 0, if the value of a frame is missing.
    pub(super) fn value_of_game(&self, metric: Metric, rounds: u32) -> RunValue {
        let mean = self.table.mean(metric);
        RunValue { value: mean.value.filter(|_| mean.rounds == rounds), ..mean }
    }

    /// The values of all frames; the last frame has no decisions.
    pub(super) fn series(&self, state: &State, metric: Metric) -> Vec<Option<f64>> {
        let last = self.value(state, self.next, Cosines::default(), metric);
        self.table.series(metric).iter().copied().chain([last]).collect()
    }

    fn see(&mut self, setup: &Setup, state: &State) {
        for agent in &state.agents {
            self.explored.visit(setup, agent.at);
        }
        self.next.explored = self.explored.cells_anywhere();
    }

    fn value(
        &self,
        state: &State,
        counts: Counts,
        cosines: Cosines,
        metric: Metric,
    ) -> Option<f64> {
        let agents = super::counts::small(state.agents.len());
        let so_far =
            SoFar { agents, explored: counts.explored, walked: self.walked, open_cells: 0 };
        match metric {
            Metric::StepLength => so_far.path_length(),
            Metric::Homogeneity if counts.distinct_messages >= 2 => cosines.distinct,
            Metric::Homogeneity => Some(0.0),
            _ => {
                let row = MeterRow { counts, so_far, ..MeterRow::default() };
                Some(row.value(state, metric).unwrap_or(0.0))
            }
        }
    }
}

/// The metrics that the toolkit computes.
pub(super) fn metrics() -> impl Iterator<Item = Metric> {
    Metric::ALL.into_iter().filter(|metric| metric.about().of_paper)
}
