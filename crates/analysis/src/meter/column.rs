//! Values of rounds, and the values of the game that follow from them.

use crate::metric::{Metric, RunValue};

/// The values of a metric.
#[derive(Clone, Default)]
struct Column {
    sum: f64,
    most: Option<f64>,
    last: Option<f64>,
    rounds: u32,
    series: Vec<Option<f64>>,
}

/// A column for each metric.
pub(super) struct Table {
    columns: Vec<Column>,
    keeps_series: bool,
}

impl Table {
    pub(super) fn new(keeps_series: bool) -> Self {
        Self { columns: vec![Column::default(); Metric::ALL.len()], keeps_series }
    }

    /// Adds the value of a round.
    pub(super) fn add(&mut self, metric: Metric, value: Option<f64>) {
        self.add_to_series(metric, value);
        let column = &mut self.columns[metric as usize];
        if let Some(value) = value {
            column.sum += value;
            column.most = Some(column.most.map_or(value, |most| most.max(value)));
            column.last = Some(value);
            column.rounds += 1;
        }
    }

    /// Adds a value to the series, but not to the value of the game.
    pub(super) fn add_to_series(&mut self, metric: Metric, value: Option<f64>) {
        if self.keeps_series {
            self.columns[metric as usize].series.push(value);
        }
    }

    /// The mean over the rounds in which the metric is defined.
    pub(super) fn mean(&self, metric: Metric) -> RunValue {
        self.value(metric, |column| Some(column.sum / f64::from(column.rounds)))
    }

    pub(super) fn most(&self, metric: Metric) -> RunValue {
        self.value(metric, |column| column.most)
    }

    pub(super) fn last(&self, metric: Metric) -> RunValue {
        self.value(metric, |column| column.last)
    }

    pub(super) fn series(&self, metric: Metric) -> &[Option<f64>] {
        &self.columns[metric as usize].series
    }

    fn value(&self, metric: Metric, of: impl Fn(&Column) -> Option<f64>) -> RunValue {
        let column = &self.columns[metric as usize];
        let value = if column.rounds > 0 { of(column) } else { None };
        RunValue { value, rounds: column.rounds }
    }
}
