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
        usage: request.usage,
        reasoning: request.reasoning,
    };
    Ok(Submission { round: request.round, decision })
}

#[cfg(test)]
mod tests {
    use bolero::{TypeGenerator, produce};
    use serde_json::{Map, Value, json};
    use swarmbench_engine::{Settings, TaskName};
    use swarmbench_testkit::check;

    use super::super::super::extract::{fields, read};
    use super::*;
    use swarmbench_journal::record::{ActRecord, RawRecord};
    use swarmbench_protocol::problem::Problem;

    /// Possible values of a field of a body.
    #[derive(Clone, Debug, TypeGenerator)]
    enum Held {
        Left,
        Null,
        Bool(bool),
        Small(u8),
        Number(i64),
        Unsigned(u64),
        Float(f64),
        Text(String),
        Known(#[generator(0..16_u8)] u8),
        Usage { prompt_tokens: u64, latency_ms: Option<u32>, unknown: bool },
        Nested(u8),
    }

    const KNOWN: [&str; 16] = [
        "UP",
        "SWITCH",
        "up",
        "STAY",
        "Agent_1",
        "Agent_0",
        "Agent_11",
        "Agent_12",
        "Agent_01",
        "hello",
        "ACTION: LEFT\nMSG: hi",
        "TO: 3\nMSG: x",
        "",
        " \r\n\u{2028} ",
        "refusal",
        "no_marker",
    ];

    impl Held {
        fn value(&self) -> Option<Value> {
            Some(match self {
                Self::Left => return None,
                Self::Null => Value::Null,
                Self::Bool(value) => json!(value),
                Self::Small(value) => json!(value),
                Self::Number(value) => json!(value),
                Self::Unsigned(value) => json!(value),
                Self::Float(value) => json!(value),
                Self::Text(value) => json!(value),
                Self::Known(place) => json!(KNOWN[usize::from(*place)]),
                Self::Usage { prompt_tokens, latency_ms, unknown: false } => {
                    json!({ "prompt_tokens": prompt_tokens, "latency_ms": latency_ms })
                }
                Self::Usage { .. } => json!({ "speed": 1 }),
                Self::Nested(depth) => {
                    (0..*depth).fold(json!([]), |inner, _| Value::Array(vec![inner]))
                }
            })
        }
    }

    /// A body that is an object, field by field; many are valid.
    #[derive(Clone, Debug, TypeGenerator)]
    struct Body {
        round: Held,
        good_round: bool,
        /// `Some` for a valid choice between `action` and `response`; `None` for arbitrary fields.
        good: Option<bool>,
        known: u8,
        action: Held,
        response: Held,
        rest: Option<[Held; 5]>,
        unknown: Option<bool>,
    }

    impl Body {
        fn object(&self) -> Map<String, Value> {
            let known = |texts: &[&str]| Some(json!(texts[usize::from(self.known) % texts.len()]));
            let (action, response) = match self.good {
                Some(true) => (known(&KNOWN[..4]), None),
                Some(false) => (None, self.response.value().or_else(|| known(&KNOWN))),
                None => (self.action.value(), self.response.value()),
            };
            let round = if self.good_round { Some(json!(self.known)) } else { self.round.value() };
            let rest = self.rest.as_ref().map(|rest| rest.each_ref().map(Held::value));
            let [message, to, usage, reasoning, failure] = rest.unwrap_or_default();
            let unknown = self.unknown.filter(|is_there| *is_there).map(|_| json!(1));
            let fields = fields::<ActRequest>().iter().chain(&["speed"]);
            fields
                .zip([round, action, message, to, response, usage, reasoning, failure, unknown])
                .filter_map(|(field, value)| Some(((*field).to_owned(), value?)))
                .collect()
        }
    }

    /// Passes a body as far as the barrier, like [`post_act`].
    fn take(bytes: &[u8], config: &Config, agent: AgentId) -> Result<Submission, Box<Problem>> {
        let request = read::<ActRequest>(bytes).map_err(|error| Box::new(error.problem()))?;
        submission(request, config, agent).map_err(|error| Box::new(error.problem()))
    }

    /// Checks the properties of every body.
    fn check(bytes: &[u8], config: &Config, agent: AgentId) -> Result<Submission, Box<Problem>> {
        let taken = take(bytes, config, agent);
        let value = serde_json::from_slice::<Value>(bytes);
        match &taken {
            Err(problem) => {
                let code = if value.is_ok() { "invalid" } else { "malformed" };
                assert_eq!(problem.code, code, "{problem:?}");
                let is_object = value.is_ok_and(|value| value.is_object());
                assert!(!is_object || !problem.fields.is_empty(), "it names what: {problem:?}");
            }
            Ok(Submission { round, decision }) => {
                let value = value.expect("JSON");
                assert_eq!(value["round"], *round);
                assert_eq!(decision.source, Source::Player);
                assert_ne!(value["action"].is_string(), value["response"].is_string());
                assert!(decision.valid || value["response"].is_string());
                assert_eq!(decision.response.as_deref(), value["response"].as_str());
                assert_eq!(decision.failure.is_some(), !decision.valid);
                assert_eq!(decision.reasoning.as_deref(), value["reasoning"].as_str());
                let act = &decision.act;
                if let Some(response) = &decision.response {
                    assert_eq!(answer::parse(response, config, agent).act, *act);
                } else {
                    assert_eq!(act.action.map(Action::name), value["action"].as_str());
                    assert_eq!(act.message, value["message"].as_str().and_then(Message::new));
                }
                assert!(act.to.is_none_or(|to| to != agent && to.0 < config.num_agents()));
                // The engine knows the decision from its record, and the record reads back as it was written.
                let record = RawRecord::write(&decision.record(agent, 7));
                let read: ActRecord = record.read().expect("a record");
                assert_eq!((read.agent.as_str(), read.bank_spent_ms), (&*agent.to_string(), 7));
                assert_eq!(read.decision(config).as_ref(), Some(decision));
            }
        }
        taken
    }

    fn configs() -> Vec<Config> {
        let of = |task, control: Control| {
            let control = control.name().to_owned();
            let settings = Settings { control, ..Settings::standard(task, 1) };
            Config::check(&settings).expect("standard settings")
        };
        let tasks = [TaskName::Synchronization, TaskName::Foraging];
        tasks.into_iter().flat_map(|task| Control::ALL.map(|control| of(task, control))).collect()
    }

    #[test]
    fn bodies_are_read_strictly_and_kept_as_they_came() {
        let configs = configs();
        check!(4_000, produce::<(Body, u8, bool, Option<(u16, u8)>)>(), |(
            body,
            setting,
            commands,
            broken,
        )| {
            let config = &configs[usize::from(*setting) % configs.len()];
            let agent = if *commands { AgentId::COMMANDER } else { AgentId(5) };
            let object = body.object();
            let mut bytes = serde_json::to_vec(&object).expect("string keys");
            let taken = check(&bytes, config, agent);

            // A field that is null counts as absent.
            let given = object.clone().into_iter().filter(|(_, value)| !value.is_null());
            let given = Value::Object(given.collect()).to_string();
            let same = check(given.as_bytes(), config, agent);
            let same = same.map_err(|problem| problem.code);
            assert_eq!(same, taken.map_err(|problem| problem.code));

            // An unknown field is refused by its name, unless the whole body is too deep to be read.
            let mut strange = object;
            strange.insert("Round".to_owned(), json!(1));
            let strange = Value::Object(strange).to_string();
            let problem = check(strange.as_bytes(), config, agent).expect_err("unknown");
            let named = problem.fields.first().map(|field| field.field.as_str());
            let is_deep = problem.detail.contains("recursion limit");
            assert_eq!(named, Some("Round").filter(|_| !is_deep), "{problem:?}");

            if let Some((at, byte)) = broken {
                let at = usize::from(*at) % bytes.len();
                bytes[at] = *byte;
                let _ = check(&bytes, config, agent);
                bytes.truncate(at);
                let problem = check(&bytes, config, agent).expect_err("it broke off");
                assert_eq!(problem.code, "malformed");
            }
        });
    }

    #[test]
    fn any_bytes_are_judged() {
        let configs = configs();
        check!(2_000, produce::<Vec<u8>>().with().len(0..4096_usize), |bytes| {
            let _ = check(bytes, &configs[0], AgentId::COMMANDER);
        });
    }
}
