//! Plays the runs of a plan: those of different endpoints side by side, and at each endpoint a limited number of
//! models at once. The runs of one player are played one after another, in the order of the plan.

use std::cell::{Cell, RefCell};

use futures::StreamExt;
use futures::stream;

use super::conduct::{Conductor, News};
use super::plan::Plan;
use super::stop_reason::{Reach, StopReason};
use crate::llm::Model;

/// Endpoints in use at the same time; others begin as soon as one is done.
const LANES_MAX: usize = 16;

/// The runs at one endpoint, or of all built-in players: each player with the indices of its runs.
#[derive(Debug, PartialEq, Eq)]
struct Lane {
    server: Option<String>,
    players: Vec<(String, Vec<usize>)>,
}

/// The lanes of a plan, in the order of their first runs.
fn lanes(plan: &Plan, models: &[Vec<Model>]) -> Vec<Lane> {
    let mut lanes: Vec<Lane> = Vec::new();
    for (number, planned) in plan.runs.iter().enumerate() {
        // A team plays at the endpoint of its first model; all share the limits of their endpoints.
        let server = models[number].first().map(Model::server);
        let at = lanes.iter().position(|lane| lane.server == server).unwrap_or_else(|| {
            lanes.push(Lane { server, players: Vec::new() });
            lanes.len() - 1
        });
        let (players, name) = (&mut lanes[at].players, planned.name());
        match players.iter_mut().find(|(known, _)| *known == name) {
            Some((_, runs)) => runs.push(number),
            None => players.push((name, vec![number])),
        }
    }
    lanes
}

/// The maximum number of runs of a plan that are played at the same time.
#[must_use]
pub fn runs_at_once(plan: &Plan, models: &[Vec<Model>], models_at_once: usize) -> usize {
    let lanes = lanes(plan, models);
    lanes.iter().take(LANES_MAX).map(|lane| lane.players.len().min(models_at_once)).sum()
}

impl Conductor<'_> {
    /// Plays all runs of a plan, `models_at_once` at each endpoint. A failure ends the runs of its player; a failure
    /// of the endpoint also begins no further model there; a failure of everything begins no further run at all. Runs
    /// that have begun are played to their end. `watch` gets the index of each run. Returns the failures by the
    /// indices of their runs.
    pub async fn conduct_all(
        &self,
        plan: &Plan,
        models: &[Vec<Model>],
        models_at_once: usize,
        watch: &mut dyn FnMut(usize, News<'_>),
    ) -> Vec<(usize, StopReason)> {
        let watch = RefCell::new(watch);
        let failures = RefCell::new(Vec::new());
        let is_over = Cell::new(false);
        let (watch, failures, is_over) = (&watch, &failures, &is_over);
        let of_player = async |runs: Vec<usize>, is_closed: &Cell<bool>| {
            for number in runs {
                if is_over.get() || is_closed.get() || self.stop.is_cancelled() {
                    return;
                }
                let ended = self
                    .conduct(&plan.runs[number], models[number].clone(), &mut |news| {
                        watch.borrow_mut()(number, news);
                    })
                    .await;
                if let Err(reason) = ended {
                    watch.borrow_mut()(number, News::Stopped);
                    match reason.reach() {
                        Reach::Player => {}
                        Reach::Endpoint => is_closed.set(true),
                        Reach::All => is_over.set(true),
                    }
                    failures.borrow_mut().push((number, reason));
                    return;
                }
            }
        };
        let of_lane = async |lane: Lane| {
            let is_closed = Cell::new(false);
            let players = lane.players.into_iter().map(|(_, runs)| of_player(runs, &is_closed));
            stream::iter(players).buffer_unordered(models_at_once.max(1)).collect::<()>().await;
        };
        let lanes = lanes(plan, models).into_iter().map(of_lane);
        stream::iter(lanes).buffer_unordered(LANES_MAX).collect::<()>().await;
        let mut failures = failures.take();
        failures.sort_by_key(|(number, _)| *number);
        for (number, reason) in &mut failures {
            // Answers that were in flight when the run failed have been paid for meanwhile, and by all runs together.
            if let (StopReason::Budget { spent, .. }, Some(model)) =
                (reason, models[*number].first())
            {
                *spent = model.spent_of_budget();
            }
        }
        failures
    }
}
