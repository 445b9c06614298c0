//! Decisions in words.

use swarmbench_engine::{Act, Action, AgentId, Kind as Body, Pos, TaskName, World};

use crate::Kind;

/// A decision in words, and what the reference would have done: `Agent_4 went LEFT, away from the prey; the reference goes UP`.
pub(crate) fn words(
    before: &World,
    after: &World,
    agent: AgentId,
    (did, kind): (&Act, Kind),
    reference: &Act,
) -> String {
    let name = |action: Option<Action>| action.map_or("nowhere", Action::name);
    let own = match (kind, did.action) {
        (Kind::Invalid, _) => "gave no valid answer".to_owned(),
        (Kind::Late, _) => "was too late".to_owned(),
        (Kind::Waited, _) => "stayed".to_owned(),
        (Kind::Switched, _) => "switched its light".to_owned(),
        (Kind::Blocked, action) => format!("pushed {} and was blocked", name(action)),
        (Kind::Moved, action) => {
            let way = way(before, after, agent).unwrap_or_default();
            format!("went {}{way}", name(action))
        }
    };
    let would = match reference.action {
        None | Some(Action::Stay) => "stays".to_owned(),
        Some(Action::Switch) => "switches its light".to_owned(),
        Some(action) => format!("goes {}", action.name()),
    };
    if did.action.unwrap_or(Action::Stay) == reference.action.unwrap_or(Action::Stay) {
        format!("{agent} {own}, without the message of the reference")
    } else {
        format!("{agent} {own}; the reference {would}")
    }
}

/// Direction of a move: toward the nearest object of the agent's task, or away from it.
fn way(before: &World, after: &World, agent: AgentId) -> Option<String> {
    let state = before.agent_states().nth(agent.index())?;
    let (kind, what) = match before.config().task() {
        TaskName::Pursuit => (Body::Prey, "the prey"),
        TaskName::Transport => (Body::Block, "the block"),
        TaskName::Foraging if state.carrying_food == Some(true) => (Body::Nest, "the nest"),
        TaskName::Foraging => (Body::Food, "the food"),
        TaskName::Synchronization | TaskName::Flocking => return None,
    };
    let to = after.board().agents()[agent.index()].at();
    let cells = || {
        let bodies = before.board().bodies().iter().filter(move |body| body.kind() == kind);
        bodies.flat_map(swarmbench_engine::Body::cells)
    };
    let far =
        |from: Pos| cells().map(|cell| from.i.abs_diff(cell.i) + from.j.abs_diff(cell.j)).min();
    let (was, is) = (far(state.at)?, far(to)?);
    Some(match is.cmp(&was) {
        std::cmp::Ordering::Less => format!(", toward {what}"),
        std::cmp::Ordering::Greater => format!(", away from {what}"),
        std::cmp::Ordering::Equal => String::new(),
    })
}
