//! `POST /act`: what the token's agent does in a round.

use std::time::Duration;

use serde::Deserialize;
use swarmbench_engine::{Act, Action, AgentId, Config, Control, Message, answer};
use utoipa::IntoParams;

use super::super::answer::{json, small, with_field};
use super::super::auth::TokenSeat;
use super::super::extract::wait;
use super::super::prelude::*;
use super::super::stream::Short;
use super::obs::is_past;
use super::observation::{ObservationRequest, observation};
use crate::episode::lockstep::{self, Submission};
use crate::ids::EpisodeId;
use swarmbench_journal::record::{Decision, Source};
use swarmbench_protocol::act::{ActRequest, ActResponse, Receipt};
use swarmbench_protocol::failure::Failure;
use swarmbench_protocol::problem::FieldProblem;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ActParams {
    /// Seconds to wait for the next observation, up to 60; it is added as `obs`.
    wait: Option<f64>,
}

/// Act in the open round, for the token's agent.
///
/// The answer is sent once the act is durable. A repeat of the same act gets the same receipt, at any time.
#[utoipa::path(
    post,
    path = "/act",
    operation_id = "post_act",
    tag = "agent",
    params(ActParams),
    request_body(content = ActRequest, description = "At most 256 KiB"),
    responses(
        (status = 200, description = "The act is durable", body = ActResponse),
        (status = 403, description = "`forbidden`: not a seat token"),
        (status = 409, description = "`round_ahead`, `already_acted`, `episode_over` or `round_over`, with the current `round`"),
    )
)]
pub(in super::super) async fn post_act(
    State(app): State<App>,
    seat: TokenSeat,
    Params(params): Params<ActParams>,
    Json(request, body): Json<ActRequest>,
) -> Result<Response, ApiError> {
    let patience = wait(&app, params.wait)?;
    let receipt = submit(&app, &seat, request).await?;
    // The body may be large, and the wait long.
    drop(body);
    if params.wait.is_none() {
        return Ok(small(&receipt));
    }
    let next = Box::pin(next_observation(&app, &seat, receipt.round, patience)).await;
    let response = json(with_field(&receipt, "obs", &next));
    Ok(Short::of(response, || with_field(&receipt, "obs", b"null")))
}

/// Observation of a seat once the round is past `round`; `null` if that does not happen in time. Never fails, as the act is
/// durable: the receipt is sent even if the limit of waiting requests is reached, or no thread or memory is free for the observation.
async fn next_observation(app: &App, seat: &TokenSeat, round: u32, patience: Duration) -> Vec<u8> {
    let TokenSeat { handle, agent } = seat;
    let waited = app.waits.until(handle, patience, |snapshot| is_past(snapshot, round)).await;
    let next = match waited.ok().filter(|snapshot| is_past(snapshot, round)) {
        Some(snapshot) => {
            observation(app, ObservationRequest::now(app, handle, &snapshot, *agent), false).await
        }
        None => Ok(b"null".to_vec()),
    };
    next.unwrap_or_else(|_| b"null".to_vec())
}

/// Submits an act for a seat; returns once the act is durable.
pub(in super::super) async fn submit(
    app: &App,
    seat: &TokenSeat,
    request: ActRequest,
) -> Result<Receipt, ApiError> {
    app.check_backlog()?;
    let TokenSeat { handle, agent } = seat;
    let submission = submission(request, &handle.spec.config, *agent)?;
    let mut outcomes = handle.submit(vec![(*agent, submission)]).await;
    let given = outcomes.pop().ok_or_else(|| ApiError::new(Code::Internal, "no outcome"))??;
    Ok(receipt(&handle.id, *agent, given))
}

impl App {
    /// Refuses acts quickly while the writer cannot keep up.
    pub(in super::super) fn check_backlog(&self) -> Result<(), ApiError> {
        let most = self.limits.backlog_bytes_max;
        if self.store.writer().backlog_bytes() < most {
            return Ok(());
        }
        let detail = "the journal cannot keep up; send the same act again later";
        Err(ApiError::limit(Code::Overloaded, "backlog_bytes_max", most, detail)
            .retry_after(std::time::Duration::from_secs(1)))
    }
}

pub(in super::super) fn receipt(
    episode: &EpisodeId,
    agent: AgentId,
    receipt: lockstep::Receipt,
) -> Receipt {
    let lockstep::Receipt { round, recorded, duplicate } = receipt;
    let Decision { act, valid, failure, .. } = &*recorded.decision;
    Receipt {
        episode: episode.to_string(),
        agent: agent.to_string(),
        round,
        action: act.action.map(|action| action.name().to_owned()),
        message: act.message.as_ref().map(ToString::to_string),
        valid: *valid,
        failure: *failure,
        duplicate,
        waiting_for: recorded.waiting_for,
    }
}

/// Validates an act, and converts it to a submission.
pub fn submission(
    request: ActRequest,
    config: &Config,
    agent: AgentId,
) -> Result<Submission, ApiError> {
    let mut problems = Vec::new();
    let mut refuse = |field: &str, problem: String| {
        problems.push(FieldProblem { field: field.to_owned(), problem });
    };
    match (&request.action, &request.response) {
        (Some(_), Some(_)) => {
            refuse("response", "and `action` exclude each other: send exactly one".to_owned());
        }
        (None, None) => {
            refuse("action", "or `response` is needed: send exactly one".to_owned());
        }
        (None, Some(_)) => {
            for (field, is_sent) in
                [("message", request.message.is_some()), ("to", request.to.is_some())]
            {
                if is_sent {
                    refuse(field, "goes with `action`; a `response` holds its own".to_owned());
                }
            }
        }
        (Some(_), None) => {}
    }
    match request.failure {
        Some(_) if request.response.is_none() => {
            refuse("failure", "goes with `response`, the answer of a language model".to_owned());
        }
        Some(failure) if !failure.is_of_client() => {
            let problem = "follows from the text of `response`: leave it out";
            refuse("failure", format!("{failure} {problem}"));
        }
        _ => {}
    }
    if let Some(harness) = &request.harness {
        if request.response.is_none() {
            refuse("harness", "goes with `response`, the answer of a language model".to_owned());
        }
        if let Some((field, problem)) = harness.fault(request.round) {
            refuse(field, problem);
        }
    }
    let action = request.action.as_deref().and_then(|name| {
        let action = Action::parse(config.task(), name);
        if action.is_none() {
            let known: Vec<_> = Action::of_task(config.task()).iter().map(|a| a.name()).collect();
            let shown: String = name.chars().take(40).collect();
            refuse("action", format!("must be one of {}, is {shown:?}", known.join(", ")));
        }
        action
    });
    let to = request.to.as_deref().filter(|_| request.action.is_some()).and_then(|name| {
        if config.control() != Control::Centralized || agent != AgentId::COMMANDER {
            refuse("to", "is for the commander under centralized control alone".to_owned());
            return None;
        }
        let to = AgentId::parse(name).filter(|to| to.0 < config.num_agents() && *to != agent);
        if to.is_none() {
            let last = config.num_agents() - 1;
            let shown: String = name.chars().take(40).collect();
            refuse("to", format!("must be one of Agent_1 to Agent_{last}, is {shown:?}"));
        }
        to
    });
    if !problems.is_empty() {
        return Err(ApiError::fields(problems));
    }
    let message = request.message.as_deref().and_then(Message::new);
    let (act, fault) = match &request.response {
        None => (Act { action, message, to }, None),
        Some(response) => {
            let answer = answer::parse(response, config, agent);
            (answer.act, answer.fault)
        }
    };
    let decision = Decision {
        source: Source::Player,
        act,
        valid: fault.is_none(),
        failure: fault.map(|fault| Failure::of(request.failure, fault)),
        response: request.response,
        usage: request.usage.map(Box::new),
        reasoning: request.reasoning,
        harness: request.harness,
    };
    Ok(Submission { round: request.round, decision })
}
