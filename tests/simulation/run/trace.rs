//! Entries, requests and answers as lines of a trace.

use swarmbench::store::entries::Entry;
use swarmbench_engine::AgentId;

use crate::simulation::clients::{Request, SimAnswer};

/// The line of an entry.
pub(super) fn line(entry: &Entry) -> String {
    match entry {
        Entry::Open(row) => format!("{} is opened: {}", row.id, row.record.as_str()),
        Entry::Start { episode, at } => format!("{} is started at {at}", episode.0),
        Entry::Act(row) => format!(
            "{} round {} {} at {}, {} to come: {:.120}",
            row.episode.0,
            row.round,
            row.agent,
            row.at,
            row.waiting_for,
            row.record.as_str()
        ),
        Entry::Round(row) => {
            format!("{} round {} resolved: {}", row.episode.0, row.round, row.head)
        }
        Entry::End(row) => format!("{} ends at {}: {}", row.episode.0, row.at, row.record.as_str()),
        Entry::Claim(row) => format!(
            "{} {:?} are claimed by {}, {:?}",
            row.episode.0, row.agents, row.holder.number, row.holder.player
        ),
        Entry::Seat(row) => format!("{} is seated: {}", row.episode.0, row.record.as_str()),
        _ => "not of an episode".to_owned(),
    }
}

/// The line of a request.
pub(super) fn asked(request: &Request) -> String {
    match request {
        Request::Create(spec, owner) => format!("create {:?} of {owner:?}", spec.config.settings()),
        Request::Send(acts) => {
            let brief = |(agent, act): &(AgentId, swarmbench::episode::lockstep::Submission)| {
                format!("{agent} round {} {:?}", act.round, act.decision.act.action)
            };
            format!("send {:?}", acts.iter().map(brief).collect::<Vec<_>>())
        }
        other => format!("{other:?}"),
    }
}

/// The line of an answer.
pub(super) fn told(answer: &SimAnswer) -> String {
    match answer {
        SimAnswer::Created(result) => format!("created {result:?}"),
        SimAnswer::Nothing => "no such episode".to_owned(),
        SimAnswer::NotTakenUp(error) => format!("not taken up: {error}"),
        SimAnswer::Looked => "looked".to_owned(),
        SimAnswer::Away => "no server answers".to_owned(),
        SimAnswer::Acted(_, outcomes, _) => {
            let brief = outcomes.iter().map(|outcome| match outcome {
                Ok(receipt) => format!(
                    "round {} {} to come, again: {}",
                    receipt.round, receipt.recorded.waiting_for, receipt.duplicate
                ),
                Err(error) => error.to_string(),
            });
            format!("{:?}", brief.collect::<Vec<_>>())
        }
        SimAnswer::Claimed(wanted, result) => format!("claimed {wanted:?}: {result:?}"),
        SimAnswer::Started(result) => format!("started {result:?}"),
        SimAnswer::Aborted(result) => format!("aborted {result:?}"),
        SimAnswer::State(round, result) => format!("state after {round}: {}", result.is_ok()),
    }
}
