//! Metrics as columns of boards.

use std::collections::BTreeMap;

use super::super::error::{ApiError, Code};
use crate::store::metrics::{BoardMetric, RunTask};

/// Maximum metrics of one board.
const METRICS_MAX: usize = 16;

/// Means of the requested metrics by run and task.
pub(in super::super) type Means = BTreeMap<RunTask, Vec<Option<f64>>>;

pub(in super::super) fn wanted_metrics(names: &str) -> Result<Vec<BoardMetric>, ApiError> {
    let metrics: Vec<BoardMetric> = names
        .split(',')
        .map(|name| {
            BoardMetric::all().find(|metric| metric.name() == name.trim()).ok_or_else(|| {
                let known: Vec<_> = BoardMetric::all().map(BoardMetric::name).collect();
                let detail = format!("metrics has {name:?}, which is none of {}", known.join(", "));
                ApiError::new(Code::Malformed, detail)
            })
        })
        .collect::<Result<_, _>>()?;
    if let Some(twice) =
        (1..metrics.len()).find(|&place| metrics[..place].contains(&metrics[place]))
    {
        let detail = format!("metrics names {} twice", metrics[twice].name());
        return Err(ApiError::new(Code::Malformed, detail));
    }
    if metrics.len() > METRICS_MAX {
        let detail = format!("a board shows at most {METRICS_MAX} metrics, not {}", metrics.len());
        return Err(ApiError::new(Code::Malformed, detail));
    }
    Ok(metrics)
}

/// Metrics of a run by task; `None` where no game has a value or none was measured yet.
pub(in super::super) fn of_tasks(
    run: &str,
    tasks: &[String],
    metrics: &[BoardMetric],
    means: &Means,
) -> BTreeMap<String, BTreeMap<String, Option<f64>>> {
    let of_task = |task: &String| {
        let means = means.get(&(run.to_owned(), task.clone()));
        let of = metrics.iter().enumerate().map(|(place, metric)| {
            (metric.name().to_owned(), means.and_then(|means| means[place]))
        });
        (task.clone(), of.collect())
    };
    tasks.iter().map(of_task).collect()
}
