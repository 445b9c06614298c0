//! Measures a game round by round.

mod block;
mod cells;
mod column;
mod convergence;
mod counts;
mod places;
mod row;
mod says;
mod texts;
mod toolkit;
mod totals;

use std::collections::BTreeMap;

pub use counts::Counts;

use crate::embed::Hash1;
use crate::game::{Decision, Heard, Setup, State};
use crate::metric::{Definition, Metric, RunValue};
use block::Pushed;
use cells::Sight;
use column::Table;
use convergence::Trend;
use counts::{Said, small};
use places::Explored;
use row::{MeterRow, SoFar};
use says::Promises;
use texts::Cosines;
use toolkit::Toolkit;
use totals::Totals;

/// Optional computations, by default none. Metrics that are left out have no value, from 0 rounds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Return the values of all rounds, not only those of the game.
    pub series: bool,
    /// Compare text vectors ([`Metric::Homogeneity`] and metrics that follow from it).
    pub vectors: bool,
    /// Compare texts character by character ([`Metric::EditConsistency`] and metrics that follow from it,
    /// [`Metric::SelfRepeat`], [`Metric::Echo`]).
    pub edits: bool,
}

impl Options {
    /// All metrics; `series` as in the field.
    #[must_use]
    pub const fn all(series: bool) -> Self {
        Self { series, vectors: true, edits: true }
    }
}

/// The measurements of a game.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    /// Resolved rounds.
    pub rounds: u32,
    /// True if a comparison left texts out because a round had too many.
    pub sampled: bool,
    /// The values of the game by definition and metric, for all metrics of each definition.
    pub values: BTreeMap<(Definition, Metric), RunValue>,
    /// The whole numbers of each state, `0..=rounds`; empty unless [`Options::series`].
    pub counts: Vec<Counts>,
    /// The values of each state (`paper`) or frame (`toolkit`), `0..=rounds`, for metrics of rounds; empty unless
    /// [`Options::series`].
    pub series: BTreeMap<(Definition, Metric), Vec<Option<f64>>>,
}

impl Metrics {
    /// The value of the game; none if the definition does not have the metric.
    #[must_use]
    pub fn value(&self, definition: Definition, metric: Metric) -> RunValue {
        self.values.get(&(definition, metric)).copied().unwrap_or_default()
    }
}

/// The measurement of a game, round by round.
pub struct Meter {
    setup: Setup,
    state: State,
    options: Options,
    embedder: Hash1,
    rounds: u32,
    counts: Vec<Counts>,
    /// The counts of the current state.
    newest: Counts,
    /// The values of the current state.
    values: [Option<f64>; Metric::ALL.len()],
    table: Table,
    toolkit: Toolkit,
    totals: Totals,
    promises: Promises,
    explored: Explored,
    walked: u64,
    homogeneity: Trend,
    edit_consistency: Trend,
    /// The last message of each agent. Empty unless texts are compared.
    said: Vec<Option<String>>,
    /// The messages delivered with the current state, sorted by receiver; `None` for the layout, if they are not
    /// known, and unless texts are compared.
    heard: Option<Vec<Heard>>,
    sampled: bool,
}

impl Meter {
    /// Begins a game with its layout.
    #[must_use]
    pub fn new(setup: Setup, layout: State, options: Options) -> Self {
        let agents = layout.agents.len();
        let mut meter = Self {
            toolkit: Toolkit::new(&setup, &layout, options.series),
            totals: Totals::new(&setup, &layout),
            promises: Promises::new(agents),
            table: Table::new(options.series),
            explored: Explored::default(),
            rounds: 0,
            counts: Vec::new(),
            newest: Counts::default(),
            values: [None; Metric::ALL.len()],
            walked: 0,
            homogeneity: Trend::default(),
            edit_consistency: Trend::default(),
            said: if options.edits { vec![None; agents] } else { Vec::new() },
            heard: None,
            sampled: false,
            setup,
            state: layout,
            options,
            embedder: Hash1::default(),
        };
        meter.explore();
        let counts = Counts { explored: meter.explored.cells, ..Counts::default() };
        let row = MeterRow { counts, so_far: meter.so_far(), ..MeterRow::default() };
        meter.values = Metric::ALL.map(|metric| row.value_of_layout(&meter.state, metric));
        for (metric, value) in Metric::ALL.into_iter().zip(meter.values) {
            meter.table.add_to_series(metric, value);
        }
        meter.keep(counts);
        meter
    }

    /// Adds a round: the decision of each agent in the order of their numbers, the state after it, and the messages
    /// delivered with that state; `None` if an imported game does not contain them.
    ///
    /// # Panics
    /// If there is not one decision for each agent, or if the number of agents changes.
    pub fn round(&mut self, decisions: &[Decision], after: State, heard: Option<&[Heard]>) {
        assert_eq!(decisions.len(), self.state.agents.len(), "one decision for each agent");
        assert_eq!(after.agents.len(), self.state.agents.len(), "agents stay in the list");
        let said = Said::of(&self.state, decisions);
        let mut row = self.row(decisions, &said);
        self.toolkit.decided(&self.state, row.counts, &said, row.cosines);
        let kept = cells::compare(&self.state, &after, decisions, &mut row.counts);
        self.totals.acts(&self.state, decisions, &row.counts);
        self.totals.heard(heard);
        self.totals.moved(&self.setup, self.rounds, &self.state, &after);
        self.promises.round(decisions, &said);
        self.walked += u64::from(row.counts.distance);
        self.toolkit.moved(&self.setup, &after, self.walked, kept, row.counts.pushes);
        self.state = after;
        self.explore();
        row.counts.explored = self.explored.cells;
        row.so_far = self.so_far();
        self.values = Metric::ALL.map(|metric| row.value(&self.state, metric));
        for (metric, value) in Metric::ALL.into_iter().zip(self.values) {
            self.table.add(metric, value);
        }
        self.homogeneity.add(self.rounds, row.cosines.distinct);
        self.edit_consistency.add(self.rounds, row.edit_consistency);
        self.keep(row.counts);
        self.heard = heard.filter(|_| self.options.edits).map(|heard| {
            let mut heard = heard.to_vec();
            heard.sort_by_key(|heard| heard.receiver);
            heard
        });
        self.rounds += 1;
    }

    /// The whole numbers of the current state, and the values by [`Definition::Paper`] of metrics of rounds, in the
    /// order of [`Metric::ALL`].
    #[must_use]
    pub const fn now(&self) -> (&Counts, &[Option<f64>; Metric::ALL.len()]) {
        (&self.newest, &self.values)
    }

    /// The counts and values so far, as if the game ended now.
    #[must_use]
    pub fn metrics(&self) -> Metrics {
        let paper = Metric::ALL.map(|metric| (Definition::Paper, metric));
        let toolkit = toolkit::metrics().map(|metric| (Definition::Toolkit, metric));
        let keys: Vec<_> = paper.into_iter().chain(toolkit).collect();
        let with_series = keys.iter().filter(|(_, metric)| metric.about().by_round);
        let with_series = with_series.filter(|_| self.options.series);
        Metrics {
            rounds: self.rounds,
            sampled: self.sampled,
            series: with_series.map(|&key| (key, self.series(key))).collect(),
            values: keys.into_iter().map(|key| (key, self.value(key))).collect(),
            counts: self.counts.clone(),
        }
    }

    /// The measures that follow from the decisions in the current state.
    fn row(&mut self, decisions: &[Decision], said: &Said<'_>) -> MeterRow {
        let mut row = MeterRow {
            counts: Counts::of_acts(&self.state, decisions, said),
            sight: Sight::of(&self.setup, &self.state),
            pushed: Pushed::of(&self.setup, &self.state, decisions),
            ..MeterRow::default()
        };
        row.counts.components = row.sight.components;
        if self.options.vectors {
            row.cosines = Cosines::of(said, &self.embedder);
        }
        if self.options.edits {
            let edits = texts::edit_consistency(said);
            let echo = self.heard.as_ref().map(|heard| texts::echo(said, heard));
            let echo = echo.unwrap_or_default();
            self.sampled |= edits.sampled || echo.sampled;
            row.edit_consistency = edits.value;
            row.echo = echo.value;
            row.self_repeat = texts::self_repeat(said, &mut self.said);
        }
        row
    }

    fn explore(&mut self) {
        for (_, agent) in self.state.living() {
            if self.setup.contains(agent.at) {
                self.explored.visit(&self.setup, agent.at);
            }
        }
    }

    fn so_far(&self) -> SoFar {
        SoFar {
            agents: small(self.state.agents.len()),
            open_cells: self.setup.open_cells as u64,
            explored: self.explored.cells,
            walked: self.walked,
        }
    }

    fn keep(&mut self, counts: Counts) {
        self.newest = counts;
        if self.options.series {
            self.counts.push(counts);
        }
    }

    fn series(&self, (definition, metric): (Definition, Metric)) -> Vec<Option<f64>> {
        match definition {
            Definition::Paper => self.table.series(metric).to_vec(),
            Definition::Toolkit => self.toolkit.series(&self.state, metric),
        }
    }

    fn value(&self, (definition, metric): (Definition, Metric)) -> RunValue {
        match definition {
            Definition::Paper => self.paper_value(metric),
            Definition::Toolkit => self.toolkit.value_of_game(metric, self.rounds),
        }
    }

    fn paper_value(&self, metric: Metric) -> RunValue {
        match metric {
            Metric::QuestionShare
            | Metric::DigitShare
            | Metric::MessageLength
            | Metric::MessageLengthStd
            | Metric::Homogeneity
            | Metric::DirectionEntropy
            | Metric::Stillness
            | Metric::DominantAction
            | Metric::Polarization
            | Metric::StepLength
            | Metric::Explored
            | Metric::KeptPairs
            | Metric::Pushes
            | Metric::PushesStrict
            | Metric::ExploredShare
            | Metric::NoActionShare
            | Metric::HomogeneityAll
            | Metric::EditConsistency
            | Metric::SelfRepeat
            | Metric::Components
            | Metric::ComponentsNorm
            | Metric::Separation
            | Metric::Crowding
            | Metric::BlockedShare
            | Metric::Echo
            | Metric::PushAlignment
            | Metric::LightAgreement
            | Metric::PreyFreedom => self.table.mean(metric),
            Metric::ForcePeak => self.table.most(metric),
            Metric::PathLength => self.table.last(metric),
            Metric::ExploredFinal => self.table.last(Metric::Explored),
            Metric::DirectionImbalance => self.totals.imbalance(),
            Metric::DirectionImbalanceNorm => {
                let RunValue { value, rounds } = self.totals.imbalance();
                RunValue { value: value.map(|value| value * 4.0 / 3.0), rounds }
            }
            Metric::DirectionImbalancePooled => self.totals.imbalance_pooled(),
            Metric::RevisitShare => self.totals.revisit_share(),
            Metric::HomogeneityIncrease => self.homogeneity.increase(),
            Metric::HomogeneitySlope => self.homogeneity.slope(self.rounds),
            Metric::EditConsistencyIncrease => self.edit_consistency.increase(),
            Metric::EditConsistencySlope => self.edit_consistency.slope(self.rounds),
            Metric::Delivered => self.totals.delivered(),
            Metric::UnheardShare => self.totals.unheard_share(),
            Metric::SayDo => self.promises.value(),
            Metric::TimeToFirstScore => self.totals.time_to_first_score(),
            Metric::TokensPerPoint => self.totals.tokens_per_point(self.state.score, self.rounds),
        }
    }
}
