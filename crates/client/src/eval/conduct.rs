//! Plays a run of a plan, or resumes it. `lanes` plays all runs of a plan.

use std::cell::RefCell;
use std::convert::Infallible;
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use futures::future::{Either, select};
use serde_json::{Value, json};
use tokio_util::sync::CancellationToken;

use super::conversation::Conversation;
use super::entry::{Entry, Next};
use super::judge::Judge;
use super::plan::{META, Planned, Who, axes, ranges, setting_text, value};
use super::stop_reason::StopReason;
use crate::client::{Client, ClientError};
use crate::drive::{DriveError, End, Note, Swarm, drive};
use crate::llm::Model;
use crate::play::{BuiltIns, GameParams};
use swarmbench_boards::run::SYSTEM_MESSAGE;
use swarmbench_clock::{Clock, SystemClock, after};
use swarmbench_engine::Settings;
use swarmbench_protocol::act::{Receipt, SwarmAct};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::observation::Observation;
use swarmbench_protocol::run::{RunDetail, RunList, RunSummary};
use swarmbench_protocol::status::RunStatus;
use swarmbench_protocol::suite::digest_of_template;

/// The interval of polls of a run's state, for progress.
const SYNC: Duration = Duration::from_secs(1);

/// The earlier state of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Found {
    /// No run of this identity existed. Contains another unfinished run of the same player, if any: its id, and its
    /// differences.
    New(Option<(String, Vec<String>)>),
    /// The run had begun, and is resumed.
    Resumed,
    /// The run was already finished.
    Finished,
}

/// A run, its earlier state, and its token if games remain to be played.
type Begun = (Found, RunDetail, Option<String>);

/// Progress events.
#[derive(Clone, Copy, Debug)]
pub enum News<'a> {
    /// A run was found or created.
    Begins(&'a Planned, &'a Found, &'a RunDetail),
    /// Seats wait for an act.
    Looked(&'a [Observation]),
    /// An act is durable.
    Acted(&'a SwarmAct, &'a Receipt),
    /// An act came after the end of its round.
    Late(&'a SwarmAct),
    /// The state of the run, polled.
    Polled(&'a RunDetail),
    /// All games of the run are over.
    Ends(&'a RunDetail),
}

/// The player of runs on a server.
pub struct Conductor<'a> {
    /// The server.
    pub client: &'a Client,
    /// Open games of a new run.
    pub parallel: u32,
    /// True if a finished run is played again.
    pub again: bool,
    /// The share of a model's answers failing in one way above which a run stops; never with 1.
    pub stop_share: f64,
    /// A token whose cancellation stops everything.
    pub stop: &'a CancellationToken,
}

impl Conductor<'_> {
    /// Creates or resumes a run and plays it to its end, with `model` if a language model plays.
    ///
    /// # Errors
    /// See [`StopReason`].
    pub async fn conduct(
        &self,
        planned: &Planned,
        model: Option<Model>,
        watch: &mut dyn FnMut(News<'_>),
    ) -> Result<RunDetail, StopReason> {
        let (found, run, token) = match &planned.entry {
            None => self.find(planned).await?,
            Some(entry) => self.attempt(entry, model.as_ref()).await?,
        };
        watch(News::Begins(planned, &found, &run));
        let Some(token) = token else { return Ok(run) };
        let judge = Arc::new(Judge::new(&planned.name(), self.stop_share));
        let ended = match (&planned.who, model) {
            (Who::Player(player), _) => {
                let (params, players) = (GameParams::of(&run), player.players());
                let mut swarm = BuiltIns::new(self.client, &token, params, player.seed, players);
                let played = self.play(&run, &token, &mut swarm, &judge, watch).await;
                played.map_err(|error| {
                    stop_reason(error, |error| StopReason::Play(error.to_string()))
                })
            }
            (Who::Model(model), None) => {
                return Err(StopReason::Play(format!(
                    "no endpoint is named for the model {}",
                    model.name
                )));
            }
            (Who::Model(_), Some(model)) => {
                let id = &run.run.id;
                let mut swarm =
                    Conversation::new(self.client, id, &token, planned, model, Arc::clone(&judge));
                let played = self.play(&run, &token, &mut swarm, &judge, watch).await;
                played.map_err(|error| stop_reason(error, |error| error))
            }
        };
        let ended = match ended {
            Err(reason) if !matches!(reason, StopReason::Client(_)) => {
                // The board shows how far it came.
                if let Ok(run) = self.client.run(&run.run.id, Some(&token)).await {
                    watch(News::Polled(&run));
                }
                return Err(reason);
            }
            ended => ended?,
        };
        let mut run = self.client.run(&run.run.id, Some(&token)).await?;
        if let Some(entry) = &planned.entry {
            entry.add_results(self.client, &mut run).await?;
        }
        watch(News::Polled(&run));
        if run.run.status != RunStatus::Finished.name() {
            if ended == End::Stopped {
                return Err(StopReason::Requested);
            }
            return Err(match &planned.entry {
                Some(entry) => entry.ended(&run.run),
                None => StopReason::Ended { id: run.run.id, status: run.run.status },
            });
        }
        watch(News::Ends(&run));
        Ok(run)
    }

    /// Drives the seats of a run, and polls its state.
    async fn play<S: Swarm>(
        &self,
        run: &RunDetail,
        token: &str,
        swarm: &mut S,
        judge: &Judge,
        watch: &mut dyn FnMut(News<'_>),
    ) -> Result<End, DriveError<S::Error>> {
        let watch = RefCell::new(watch);
        let report = |note: Note<'_>| match note {
            Note::Looked(looked) => watch.borrow_mut()(News::Looked(looked)),
            Note::Acted(act, receipt) => {
                judge.note(act, receipt);
                watch.borrow_mut()(News::Acted(act, receipt));
            }
            Note::Late(act) => watch.borrow_mut()(News::Late(act)),
        };
        let sync = async {
            loop {
                SystemClock.sleep_until(after(SystemClock.now(), SYNC)).await;
                // The driver reports failures of the server.
                if let Ok(run) = self.client.run(&run.run.id, Some(token)).await {
                    watch.borrow_mut()(News::Polled(&run));
                }
            }
        };
        let sync: std::pin::Pin<&mut dyn Future<Output = Infallible>> = std::pin::pin!(sync);
        let driving = std::pin::pin!(drive(self.client, token, swarm, self.stop, report));
        match select(driving, sync).await {
            Either::Left((ended, _)) => ended,
            Either::Right((never, _)) => match never {},
        }
    }

    /// Finds the newest running or finished run of this identity, or creates one.
    async fn find(&self, planned: &Planned) -> Result<Begun, StopReason> {
        let identity = planned.identity();
        let runs = self.runs_of(&planned.name()).await?;
        for run in &runs {
            let Some(evaluated) = own(&run.agent_meta) else { continue };
            let is_running = run.status == RunStatus::Running.name();
            let is_finished = run.status == RunStatus::Finished.name();
            if evaluated["identity"] != identity || !(is_running || is_finished) {
                continue;
            }
            if is_finished && self.again {
                break;
            }
            // Only the creator gets a new token; other runs of this identity are skipped.
            let token = match self.client.replace_run_token(&run.id).await {
                Ok(token) => token.swarm_token,
                Err(ClientError::Refused { status, .. }) if status.is_client_error() => continue,
                Err(error) => return Err(error.into()),
            };
            let run = self.client.run(&run.id, Some(&token)).await?;
            return Ok(if is_finished {
                (Found::Finished, run, None)
            } else {
                (Found::Resumed, run, Some(token))
            });
        }
        let unfinished = |run: &&RunSummary| run.status == RunStatus::Running.name();
        let evaluated = |run: &&RunSummary| run.agent_meta.get(META).is_some();
        let other = runs.iter().filter(evaluated).find(unfinished);
        let other = other.map(|run| (run.id.clone(), differences(run, planned)));
        let created = self.client.create_run(&planned.request(self.parallel)).await?;
        let token = created.swarm_token.ok_or_else(|| {
            StopReason::Play(
                "the server did not give a token for the run that it created".to_owned(),
            )
        })?;
        Ok((Found::New(other.filter(|(_, how)| !how.is_empty())), created.run, Some(token)))
    }

    /// Finds the attempt to resume, or starts one. A new attempt starts its clocks, so the model is probed first.
    async fn attempt(&self, entry: &Entry, model: Option<&Model>) -> Result<Begun, StopReason> {
        let attempts = entry.attempts(self.client).await?;
        let (found, run, token) = match entry.next(&attempts, self.again) {
            Next::Over(over) => {
                let mut run = self.client.run(&over.run, None).await?;
                entry.add_results(self.client, &mut run).await?;
                return Ok((Found::Finished, run, None));
            }
            Next::Resume(begun) => {
                let token = self.client.replace_run_token(&begun.run).await?.swarm_token;
                (Found::Resumed, begun.run.clone(), token)
            }
            Next::Start(number) => {
                if let Some(model) = model {
                    model.probe().await?;
                }
                let started = entry.start(self.client, number).await?;
                (Found::New(None), started.run, started.swarm_token)
            }
        };
        let run = self.client.run(&run, Some(&token)).await?;
        Ok((found, run, Some(token)))
    }

    /// All visible runs of a player, newest first.
    async fn runs_of(&self, model: &str) -> Result<Vec<RunSummary>, ClientError> {
        let mut runs = Vec::new();
        let mut cursor: Option<String> = None;
        loop {
            let mut query = vec![("model", model), ("limit", "200")];
            query.extend(cursor.as_deref().map(|cursor| ("cursor", cursor)));
            let page: RunList = self.client.get_with("/api/v1/runs", &query).await?;
            runs.extend(page.items);
            match page.next_cursor {
                Some(next) => cursor = Some(next),
                None => return Ok(runs),
            }
        }
    }
}

fn stop_reason<E: Display>(error: DriveError<E>, own: impl FnOnce(E) -> StopReason) -> StopReason {
    match error {
        // The token was valid a moment ago, so another call has replaced it.
        DriveError::Client(error @ ClientError::Refused { .. }) if matches!(&error, ClientError::Refused { problem, .. } if problem.code == "unauthorized") => {
            StopReason::Play(format!(
                "another call plays this run now, so the token of this one is worth nothing any more: {error}"
            ))
        }
        DriveError::Client(error) => StopReason::Client(error),
        DriveError::Refused { .. } => StopReason::Play(error.to_string()),
        DriveError::Swarm(error) => own(error),
    }
}

/// The part of `agent_meta` that an evaluation wrote.
fn own(meta: &Carried) -> Option<Value> {
    serde_json::from_str(meta.get(META)?).ok()
}

/// The differences between a run and the planned one, in words.
fn differences(run: &RunSummary, planned: &Planned) -> Vec<String> {
    let settings = Settings::from(&run.suite.settings);
    let sampling = [run.temperature, run.top_p];
    let was = |axis| value(axis, &run.suite.rules, &settings, sampling).as_ref().map(setting_text);
    let text = |value: Option<String>| value.unwrap_or_else(|| "none".to_owned());
    let mut found = Vec::new();
    let mut compare = |what: &str, was: Option<String>, is: Option<String>| {
        if was != is {
            found.push(format!("{what} {} instead of {}", text(is), text(was)));
        }
    };
    compare("tasks", Some(run.suite.tasks.join(" + ")), Some(planned.suite.tasks.join(" + ")));
    compare("seeds", run.suite.seeds.as_deref().map(ranges), Some(ranges(&planned.suite.seeds)));
    for axis in axes() {
        compare(axis, was(axis), planned.setting(axis));
    }
    let template = planned.template.as_deref().map(digest_of_template);
    compare("prompt template", run.template_digest.clone(), template);
    let is = planned.request(1).agent_meta.unwrap_or_default();
    let system = |meta: &Carried| meta.get(SYSTEM_MESSAGE).map(str::to_owned);
    compare("system message", system(&run.agent_meta), system(&is));
    let how = |meta: &Carried| {
        let mut own = own(meta).unwrap_or_default();
        if let Value::Object(own) = &mut own {
            own.remove("identity");
        }
        own
    };
    let (was, is) = (how(&run.agent_meta), how(&is));
    if was != is {
        found.push(format!("{} instead of {}", json!(is), json!(was)));
    }
    found
}
