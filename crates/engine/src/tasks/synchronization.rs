//! Synchronization: all lights on, then all off, and so on.

use super::{Plan, Region, Stage, Terrain, place_ring};
use crate::act::Action;
use crate::body::Board;
use crate::config::Config;
use crate::rng::LayoutRng;

/// The state of Synchronization beside the board (rules: *Synchronization*).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Synchronization {
    /// Lights that are on, by agent.
    pub(crate) light_on: Vec<bool>,
    /// The common state of all lights in the last round that scored.
    pub(crate) scored: Option<bool>,
}

pub(super) fn plan(config: &Config, mut board: Board) -> Plan {
    let mut rng = LayoutRng::new(config.seed.get());
    place_ring(&mut board);
    let light_on = (0..config.num_agents).map(|_| rng.randint(0, 1) == 1).collect();
    let task = Terrain::Synchronization(Synchronization { light_on, scored: None });
    Plan { board, rng, region: Region::interior(config), task }
}

impl Synchronization {
    pub(super) fn update(&mut self, stage: &Stage<'_>, score: f64) -> f64 {
        for (light, act) in self.light_on.iter_mut().zip(stage.acts) {
            *light ^= act.action == Some(Action::Switch);
        }
        let first = self.light_on[0];
        let agree = self.light_on.iter().all(|&light| light == first);
        if agree && self.scored != Some(first) {
            self.scored = Some(first);
            return score + 1.0;
        }
        score
    }
}
