//! Measures games from their journals.

use std::io::BufRead;

use swarmbench_engine::physics::Solver;
use swarmbench_engine::{Action, AgentId, Config};
use swarmbench_journal::record::{ActRecord, Source};
use swarmbench_journal::replay::{Fault, JournalReport, verify_seen};

use crate::game::{Decision, Heard, Setup, State};
use crate::meter::{Meter, Metrics, Options};

/// Replays and checks a journal, and measures its game. Calls `progress` with the current round and the maximum
/// number of rounds.
///
/// # Errors
/// The first fault of the journal.
pub fn measure(
    journal: impl BufRead,
    options: Options,
    mut progress: impl FnMut(u32, u32),
) -> Result<(JournalReport, Metrics), Fault> {
    let mut meter: Option<Meter> = None;
    let report = verify_seen(journal, None, Solver::Flow, |world, acts| {
        progress(world.round(), world.config().max_round());
        let state = State::of(world);
        match &mut meter {
            None => meter = Some(Meter::new(Setup::of(world), state, options)),
            Some(meter) => {
                let decisions = decisions(world.config(), acts);
                meter.round(&decisions, state, Some(&Heard::all(world)));
            }
        }
    })?;
    let metrics = meter.as_ref().map(Meter::metrics).expect("a whole journal has a layout");
    Ok((report, metrics))
}

/// The decisions of a round in the order of agents; the default for agents without a record.
///
/// The journal of the records must have been checked: unknown agents and actions are skipped.
#[must_use]
pub fn decisions<'a>(
    config: &Config,
    acts: impl IntoIterator<Item = &'a ActRecord>,
) -> Vec<Decision> {
    let mut decisions = vec![Decision::default(); config.num_agents().into()];
    for act in acts {
        let agent = AgentId::parse(&act.agent);
        if let Some(decision) = agent.and_then(|agent| decisions.get_mut(agent.index())) {
            *decision = self::decision(config, act);
        }
    }
    decisions
}

fn decision(config: &Config, act: &ActRecord) -> Decision {
    let usage = act.usage.as_deref().copied().unwrap_or_default();
    let tokens = [usage.prompt_tokens, usage.completion_tokens];
    Decision {
        action: act.action.as_deref().and_then(|name| Action::parse(config.task(), name)),
        message: act.message.clone(),
        invalid: !act.valid,
        timeout: act.source == Source::Clock,
        // Players may report any number, so the sum saturates.
        tokens: tokens.into_iter().flatten().reduce(u64::saturating_add),
    }
}
