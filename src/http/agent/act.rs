//! `POST /act`: what the token's agent does in a round.

use axum::Json as JsonBody;
use axum::extract::State;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::value::RawValue;
use swarmbench_engine::{Action, AgentId, Config, Control, Message, answer};
use utoipa::IntoParams;

use super::super::App;
use super::super::auth::Seat;
use super::super::error::{ApiError, Code};
use super::super::extract::{Json, Params, wait};
use super::super::openapi::{BodyRefusals, QueryRefusals, TokenRefusals};
use super::obs::{is_past, observation};
use crate::episode::lockstep::{self, Submission};
use crate::ids::EpisodeId;
use crate::journal::record::{self, ActRecord, Source};
use crate::wire::act::{ActRequest, ActResponse, Receipt};
use crate::wire::problem::{FieldProblem, Problem};

/// How to act.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ActParams {
    /// Seconds to wait for the next observation, up to 60; it is added as `obs`.
    wait: Option<f64>,
}

/// Act: what the token's agent does in the open round.
///
/// The answer comes once the act is durable. The same act again gets the same receipt, at any time.
#[utoipa::path(
    post,
    path = "/act",
    operation_id = "post_act",
    tag = "agent",
    params(ActParams),
    request_body(content = ActRequest, description = "At most 256 KiB"),
    security(("seat" = [])),
    responses(
        (status = 200, description = "The act is durable", body = ActResponse),
        BodyRefusals,
        QueryRefusals,
        TokenRefusals,
        (status = 403, description = "`forbidden`: not a seat token", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "`round_ahead`, `already_acted`, `episode_over` or `round_over`, with the current `round`", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in super::super) async fn post_act(
    State(app): State<App>,
    seat: Seat,
    Params(params): Params<ActParams>,
    Json(request, _): Json<ActRequest>,
) -> Result<Response, ApiError> {
    let patience = wait(&app, params.wait)?;
    app.check_backlog()?;
    let Seat { handle, agent } = seat;
    let submission = submission(request, &handle.spec.config, agent)?;
    let mut outcomes = handle.submit(vec![(agent, submission)]).await;
    let given = outcomes.pop().ok_or_else(|| ApiError::new(Code::Internal, "no outcome"))??;
    let receipt = receipt(&handle.id, given);
    if params.wait.is_none() {
        return Ok(JsonBody(receipt).into_response());
    }
    let round = receipt.round;
    let snapshot = app.wait_until(&handle, patience, |snapshot| is_past(snapshot, round)).await?;
    let next = if is_past(&snapshot, round) {
        observation(&app, &handle, &snapshot, agent, false).await?
    } else {
        b"null".to_vec()
    };
    Ok(JsonBody(WithNext { receipt, obs: raw(next) }).into_response())
}

/// The same as [`ActResponse`], with an observation that is written out already.
#[derive(serde::Serialize)]
struct WithNext {
    #[serde(flatten)]
    receipt: Receipt,
    obs: Box<RawValue>,
}

/// JSON that is written out already.
pub(in super::super) fn raw(json: Vec<u8>) -> Box<RawValue> {
    let text = String::from_utf8(json).expect("JSON is text");
    RawValue::from_string(text).expect("it was written as JSON")
}

impl App {
    /// Refuses acts quickly where the writer cannot keep up.
    pub(in super::super) fn check_backlog(&self) -> Result<(), ApiError> {
        let most = self.limits.backlog_jobs_max;
        if self.store.writer().backlog() < most {
            return Ok(());
        }
        let detail = "the journal cannot keep up; send the same act again later";
        Err(ApiError::limit(Code::Overloaded, "backlog_jobs_max", most, detail)
            .retry_after(std::time::Duration::from_secs(1)))
    }
}

/// A receipt as it is written.
pub(in super::super) fn receipt(episode: &EpisodeId, given: lockstep::Receipt) -> Receipt {
    let record = given.given.record;
    Receipt {
        episode: episode.to_string(),
        agent: record.agent,
        round: given.round,
        action: record.action,
        message: record.message,
        valid: record.valid,
        duplicate: given.duplicate,
        waiting_for: given.given.waiting_for,
    }
}

/// Checks an act and makes of it what the barrier takes.
pub(in super::super) fn submission(
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
    let (act, valid) = match &request.response {
        None => (swarmbench_engine::Act { action, message, to }, true),
        Some(response) => {
            let answer = answer::parse(response, config, agent);
            (answer.act, answer.valid)
        }
    };
    let record = ActRecord {
        agent: agent.to_string(),
        source: Source::Player,
        action: act.action.map(|action| action.name().to_owned()),
        message: act.message.map(|message| message.to_string()),
        to: act.to.map(|to| to.to_string()),
        valid,
        response: request.response,
        usage: request.usage.map(|usage| record::Usage {
            prompt_tokens: usage.prompt_tokens,
            completion_tokens: usage.completion_tokens,
            latency_ms: usage.latency_ms,
        }),
        reasoning: request.reasoning,
        bank_spent_ms: 0,
    };
    Ok(Submission { round: request.round, record })
}
