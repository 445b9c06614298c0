//! The values of a state and of the round that led to it.

use super::block::Pushed;
use super::cells::Sight;
use super::counts::{Counts, ratio, real};
use super::texts::Cosines;
use crate::game::State;
use crate::metric::Metric;

/// Measures of a state and of the round that led to it.
#[derive(Default)]
pub(super) struct MeterRow {
    pub(super) counts: Counts,
    pub(super) cosines: Cosines,
    pub(super) edit_consistency: Option<f64>,
    pub(super) self_repeat: Option<f64>,
    pub(super) echo: Option<f64>,
    pub(super) sight: Sight,
    pub(super) pushed: Pushed,
    pub(super) so_far: SoFar,
}

/// Measures of any state, the layout included.
#[derive(Clone, Copy, Default)]
pub(super) struct SoFar {
    pub(super) agents: u32,
    pub(super) open_cells: u64,
    pub(super) explored: u32,
    /// Steps of all agents since the layout.
    pub(super) walked: u64,
}

/// The metrics that have a value for the layout.
const OF_LAYOUT: [Metric; 3] = [Metric::Explored, Metric::ExploredShare, Metric::PathLength];

impl SoFar {
    /// The mean length of the agents' paths.
    pub(super) fn path_length(&self) -> Option<f64> {
        ratio(self.walked, self.agents)
    }
}

impl MeterRow {
    pub(super) fn value_of_layout(&self, layout: &State, metric: Metric) -> Option<f64> {
        if OF_LAYOUT.contains(&metric) { self.value(layout, metric) } else { None }
    }

    pub(super) fn value(&self, after: &State, metric: Metric) -> Option<f64> {
        let counts = &self.counts;
        let count = |count: u32| Some(f64::from(count));
        match metric {
            Metric::QuestionShare => ratio(counts.questions, counts.messages),
            Metric::DigitShare => ratio(counts.message_digits, counts.message_chars),
            Metric::MessageLength => ratio(counts.message_chars, counts.messages),
            Metric::MessageLengthStd => counts.message_length_std(),
            Metric::Homogeneity => self.cosines.distinct,
            Metric::DirectionEntropy => counts.direction_entropy(),
            Metric::Stillness => counts.stillness(),
            Metric::DominantAction => counts.dominant_action(),
            Metric::Polarization => counts.polarization(),
            Metric::StepLength => ratio(counts.distance, counts.alive),
            Metric::KeptPairs => count(counts.kept_pairs),
            Metric::Pushes => count(counts.pushes),
            Metric::Explored => count(self.so_far.explored),

            Metric::ExploredShare => ratio(self.so_far.explored, self.so_far.open_cells),
            Metric::PathLength => self.so_far.path_length(),
            Metric::PushesStrict => count(counts.pushes_strict),
            Metric::NoActionShare => ratio(counts.no_actions, counts.alive),
            Metric::HomogeneityAll => self.cosines.all,
            Metric::EditConsistency => self.edit_consistency,
            Metric::SelfRepeat => self.self_repeat,
            Metric::Components => (counts.alive > 0).then(|| f64::from(counts.components)),
            Metric::ComponentsNorm => {
                ratio(counts.components.saturating_sub(1), counts.alive.saturating_sub(1))
            }
            Metric::Separation => self.sight.separation,
            Metric::Crowding => self.sight.crowding,
            Metric::BlockedShare => ratio(counts.blocked, counts.movers()),
            Metric::Echo => self.echo,
            Metric::PushAlignment => self.pushed.alignment,
            Metric::ForcePeak => self.pushed.force,
            Metric::LightAgreement => light_agreement(after),
            Metric::PreyFreedom => after.prey_freedom.map(f64::from),

            Metric::ExploredFinal
            | Metric::DirectionImbalance
            | Metric::DirectionImbalanceNorm
            | Metric::DirectionImbalancePooled
            | Metric::RevisitShare
            | Metric::HomogeneityIncrease
            | Metric::HomogeneitySlope
            | Metric::EditConsistencyIncrease
            | Metric::EditConsistencySlope
            | Metric::Delivered
            | Metric::UnheardShare
            | Metric::SayDo
            | Metric::TimeToFirstScore
            | Metric::TokensPerPoint => None,
        }
    }
}

/// The share of lights in the more frequent state.
fn light_agreement(state: &State) -> Option<f64> {
    let lights = || state.agents.iter().filter_map(|agent| agent.light_on);
    let (all, on) = (lights().count() as u64, lights().filter(|&on| on).count() as u64);
    (all > 0).then(|| real(on.max(all - on)) / real(all))
}
