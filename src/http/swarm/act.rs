//! `POST /swarm/act`: acts for several seats.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use axum::extract::Request;
use axum::response::IntoResponse;
use futures::future::join_all;
use serde::de::{IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use serde_json::value::RawValue;
use swarmbench_engine::AgentId;
use utoipa::IntoParams;

use super::super::agent::act::{receipt, submission};
use super::super::auth::Swarm;
use super::super::extract::{flag, read, read_envelope, wait};
use super::super::prelude::*;
use super::next::Acted;
use super::{Seated, Source};
use crate::episode::lockstep::Submission;
use swarmbench_protocol::act::{SwarmAct, SwarmActRequest, SwarmActResponse, SwarmReceipt};

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct SwarmActParams {
    /// Seconds to wait, up to 60, until every episode with one of these acts shows its next round or is over; the next
    /// observations of the seats are added.
    wait: Option<f64>,
    /// Whether to add the texts for a language model, with `wait`.
    #[serde(default, deserialize_with = "flag")]
    prompt: bool,
}

/// Act for several seats, and get their next observations.
///
/// Each act is accepted or refused independently; the receipts are in the order of the acts, and are sent once all accepted
/// acts are durable. With `wait` one request is a whole step.
#[utoipa::path(
    post,
    path = "/swarm/act",
    operation_id = "post_swarm_act",
    tag = "swarm",
    params(SwarmActParams),
    request_body(content = SwarmActRequest, description = "At most 8 MiB, 1,024 acts of at most 256 KiB each"),
    responses(
        (status = 200, description = "A receipt or a problem for each act", body = SwarmActResponse),
        (status = 403, description = "`forbidden`: not a swarm token"),
    )
)]
pub(in super::super) async fn post_swarm_act(
    State(app): State<App>,
    swarm: Swarm,
    Params(params): Params<SwarmActParams>,
    request: Request,
) -> Result<Response, ApiError> {
    let patience = params.wait.map(|seconds| wait(&app, Some(seconds))).transpose()?;
    if params.prompt && patience.is_none() {
        let detail =
            "prompt is for the observations that come with wait: add wait, or leave it out";
        return Err(ApiError::new(Code::Malformed, detail));
    }
    let limit = app.limits.swarm_body_bytes_max;
    let body = app.bodies.json(request, limit, "swarm_body_bytes_max").await?;
    app.check_backlog()?;
    let Envelope { acts: Acts { acts, count } } = read_envelope(body.as_ref())?;
    let most = app.limits.acts_max;
    if count > most {
        let detail = format!("{count} acts were sent, at most {most} are accepted in one request");
        return Err(ApiError::limit(Code::TooLarge, "acts_max", most, detail));
    }
    let mut source = Source::of(&app, swarm).await?;
    let mut receipts = Vec::with_capacity(acts.len());
    let mut acted = Acted::default();
    let mut acts = acts.into_iter().peekable();
    while acts.peek().is_some() {
        let mut bytes = 0;
        let piece: Vec<_> = std::iter::from_fn(|| {
            let act = acts.next_if(|act| bytes == 0 || bytes + act.get().len() <= PIECE_BYTES)?;
            bytes += act.get().len();
            Some(act)
        })
        .collect();
        let first = receipts.len();
        receipts.extend(submit_all(&app, &mut source, &piece, first, &mut acted).await?);
    }
    // The body may be large, and the wait long.
    drop(body);
    let answer = SwarmActResponse { receipts, ..SwarmActResponse::default() };
    Ok(match patience {
        Some(patience) => acted.answer(&app, &source, patience, params.prompt, answer).await,
        None => axum::Json(answer).into_response(),
    })
}

/// Bytes of acts that are on their way to the journal at once: acts of others are written between the pieces of a large body.
const PIECE_BYTES: usize = 512 * 1024;

/// Submits a piece of acts, waits until they are durable, and notes who has acted. `first` is the place of the first act in the
/// body.
async fn submit_all(
    app: &App,
    source: &mut Source,
    acts: &[Box<RawValue>],
    first: usize,
    acted: &mut Acted,
) -> Result<Vec<SwarmReceipt>, ApiError> {
    let mut receipts: Vec<Option<SwarmReceipt>> = vec![None; acts.len()];
    let mut refused: Vec<&RawValue> = Vec::new();
    let mut groups: BTreeMap<String, Result<Group, ApiError>> = BTreeMap::new();
    for (place, act) in acts.iter().enumerate() {
        if let Err(error) = take(app, source, &mut groups, place, act).await {
            receipts[place] = Some(SwarmReceipt::Problem(error.problem()));
            refused.push(act);
        }
    }
    // Episodes do not wait for each other.
    for (seated, outcomes) in join_all(groups.into_values().flatten().map(submit)).await {
        for Outcome { place, agent, receipt } in outcomes {
            acted.note(&seated, agent, &receipt, first + place);
            receipts[place] = Some(receipt);
        }
    }
    for act in refused {
        acted.note_refused(act);
    }
    let receipts = receipts.into_iter().collect::<Option<Vec<_>>>();
    receipts.ok_or_else(|| ApiError::new(Code::Internal, "an act has no outcome"))
}

/// Body of a request; each of its acts is still to be read for itself.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Envelope {
    acts: Acts,
}

/// Maximum number of acts that are kept; further ones are only counted.
const ACTS_KEPT: usize = 4096;

/// Acts of a body, and the number that came.
struct Acts {
    acts: Vec<Box<RawValue>>,
    count: usize,
}

impl<'de> Deserialize<'de> for Acts {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;
        impl<'de> Visitor<'de> for List {
            type Value = Acts;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a sequence")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Acts, A::Error> {
                let mut acts = Vec::new();
                while acts.len() < ACTS_KEPT {
                    let Some(act) = list.next_element()? else {
                        return Ok(Acts { count: acts.len(), acts });
                    };
                    acts.push(act);
                }
                let mut count = acts.len();
                while list.next_element::<IgnoredAny>()?.is_some() {
                    count += 1;
                }
                Ok(Acts { acts, count })
            }
        }
        deserializer.deserialize_seq(List)
    }
}

/// Acts for one episode, with their places in the piece.
struct Group {
    seated: Seated,
    places: Vec<usize>,
    submissions: Vec<(AgentId, Submission)>,
}

/// Checks one act and adds it to the group of its episode.
async fn take(
    app: &App,
    source: &mut Source,
    groups: &mut BTreeMap<String, Result<Group, ApiError>>,
    place: usize,
    act: &RawValue,
) -> Result<(), ApiError> {
    let limit = app.limits.body_bytes_max;
    if act.get().len() > limit {
        let detail = format!("the act has more than {limit} bytes");
        return Err(ApiError::limit(Code::TooLarge, "body_bytes_max", limit, detail));
    }
    let act: SwarmAct = read(act.get().as_bytes())?;
    let (episode, agent, act) = act.split();
    let group = match groups.entry(episode) {
        Entry::Occupied(known) => known.into_mut(),
        Entry::Vacant(new) => {
            let found = source.find(app, new.key()).await.and_then(|seated| {
                let seated = seated.ok_or_else(|| ApiError::not_found("the episode"))?;
                Ok(Group { seated, places: Vec::new(), submissions: Vec::new() })
            });
            new.insert(found)
        }
    };
    let group = group.as_mut().map_err(|error| error.clone())?;
    let config = &group.seated.handle.spec.config;
    let agent = AgentId::parse(&agent).filter(|agent| agent.0 < config.num_agents());
    let agent = agent.ok_or_else(|| ApiError::not_found("the agent"))?;
    if !group.seated.holds(agent) {
        let detail = format!("this token is not valid for the seat of {agent}");
        return Err(ApiError::new(Code::Forbidden, detail));
    }
    group.submissions.push((agent, submission(act, config, agent)?));
    group.places.push(place);
    Ok(())
}

/// Outcome of an act, which is at `place` in its piece.
struct Outcome {
    place: usize,
    agent: AgentId,
    receipt: SwarmReceipt,
}

/// Submits the acts of one episode, and waits for their outcomes.
async fn submit(group: Group) -> (Seated, Vec<Outcome>) {
    let Group { seated, places, submissions } = group;
    if submissions.is_empty() {
        return (seated, Vec::new());
    }
    let agents: Vec<AgentId> = submissions.iter().map(|(agent, _)| *agent).collect();
    let Seated { handle, .. } = &seated;
    let outcomes = handle.submit(submissions).await.into_iter().zip(agents).zip(places);
    let outcomes = outcomes.map(|((outcome, agent), place)| {
        let receipt = match outcome {
            Ok(given) => SwarmReceipt::Receipt(receipt(&handle.id, agent, given)),
            Err(error) => SwarmReceipt::Problem(ApiError::from(error).problem()),
        };
        Outcome { place, agent, receipt }
    });
    let outcomes = outcomes.collect();
    (seated, outcomes)
}
