//! The worth of games from their journals.

use std::io::BufRead;
use std::sync::Arc;

use swarmbench_engine::physics::Solver;
use swarmbench_engine::{AgentId, Config, World};
use swarmbench_journal::record::{ActRecord, Source};
use swarmbench_journal::replay::{Fault, JournalReport, RoundFault, acts_of, verify_seen};

use crate::{Decided, Game, Kind};

/// Reads and checks a journal. Returns its game beside the report.
///
/// # Errors
/// The first fault of the journal.
pub fn game_of(journal: impl BufRead) -> Result<(JournalReport, Game), Fault> {
    let mut game: Option<Game> = None;
    let report = verify_seen(journal, None, Solver::Flow, |world, acts| match &mut game {
        None => game = Some(Game { layout: Arc::new(World::clone(world)), rounds: Vec::new() }),
        Some(game) => {
            let decided = decided(world.config(), acts).expect("the journal was checked");
            game.rounds.push(decided);
        }
    })?;
    Ok((report, game.expect("a whole journal has a layout")))
}

/// Decisions of a round in the order of agents, from their records.
///
/// # Errors
/// If a record names an agent or an act that the game does not have.
pub fn decided<'a>(
    config: &Config,
    records: impl IntoIterator<Item = &'a ActRecord> + Clone,
) -> Result<Vec<Decided>, RoundFault> {
    let acts = acts_of(config, records.clone())?;
    let mut decided: Vec<Decided> =
        acts.into_iter().map(|act| Decided { act, ..Decided::default() }).collect();
    for record in records {
        let agent = AgentId::parse(&record.agent);
        if let Some(decided) = agent.and_then(|agent| decided.get_mut(agent.index())) {
            decided.fault = match record.source {
                Source::Clock => Some(Kind::Late),
                Source::Player => (!record.valid).then_some(Kind::Invalid),
            };
        }
    }
    Ok(decided)
}
