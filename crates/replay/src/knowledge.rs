//! An agent's knowledge before a round, and its act.

use swarmbench_engine::{AgentId, Delivery, World};
use swarmbench_journal::record::{ActRecord, Source};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::replay::{AgentRound, InboxMessage, ShownAct};
use swarmbench_protocol::time::Timestamp;

/// Assembles the view of an agent's round. `prompt` is the text for a language model, or the reason why there is none.
#[must_use]
pub fn agent_round(
    sight: Sight,
    inbox: Vec<InboxMessage>,
    prompt: Option<Result<String, String>>,
    act: Option<ShownAct>,
) -> AgentRound {
    let (prompt, prompt_problem) = match prompt {
        None => (None, None),
        Some(Ok(prompt)) => (Some(prompt), None),
        Some(Err(problem)) => (None, Some(problem)),
    };
    AgentRound {
        episode: sight.episode.clone(),
        round: sight.round,
        agent: sight.agent.clone(),
        observation: Some(sight),
        inbox: Some(inbox),
        prompt,
        prompt_problem,
        act,
    }
}

/// The messages that an agent reads with a state. `original` returns the message that a sender sent in a round.
pub fn inbox(
    world: &World,
    agent: AgentId,
    original: impl Fn(u32, AgentId) -> Option<String>,
) -> Vec<InboxMessage> {
    let message = |heard: Delivery<'_>| InboxMessage {
        from: heard.sender.to_string(),
        sent: heard.sent,
        text: heard.text.to_string(),
        original: original(heard.sent, heard.sender)
            .filter(|original| original != heard.text.as_str()),
    };
    world.heard().filter(|heard| heard.receiver == agent).map(message).collect()
}

/// The public form of an act.
#[must_use]
pub fn shown_act(record: ActRecord, at: Option<Timestamp>) -> ShownAct {
    let source = match record.source {
        Source::Player => "player",
        Source::Clock => "clock",
    };
    ShownAct {
        source: Some(source.to_owned()),
        action: record.action,
        message: record.message,
        to: record.to,
        valid: Some(record.valid),
        failure: record.failure,
        response: record.response,
        reasoning: record.reasoning,
        usage: record.usage.map(|usage| *usage),
        harness: record.harness,
        bank_spent_ms: Some(record.bank_spent_ms).filter(|&spent| spent > 0),
        at,
    }
}
