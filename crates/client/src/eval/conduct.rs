//! Plays a run of a plan, or resumes it. `lanes` plays all runs of a plan.

use std::cell::RefCell;
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

use futures::future::{Either, join_all, select};
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
use crate::play::{BuiltIns, GameParams, PlayerError};
use swarmbench_boards::run::SYSTEM_MESSAGE;
use swarmbench_clock::{Clock, SystemClock, after};
use swarmbench_engine::{Seed, Settings, TaskName};
use swarmbench_protocol::act::{Receipt, SwarmAct};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::observation::Observation;
use swarmbench_protocol::run::{RunDetail, RunList, RunSummary};
use swarmbench_protocol::status::RunStatus;
use swarmbench_protocol::suite::{PlannedGame, digest_of_template};

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
    /// Games of the run are played again. Contains the earlier ones, which are kept: task, seed, id and score.
    Repeats(Vec<String>),
}

/// A run, its earlier state, and the tokens of its players if games remain to be played: one, or one for each model of a team.
type Begun = (Found, RunDetail, Option<Vec<String>>);

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
    /// The run stopped before.
    Stopped,
}

/// The player of runs on a server.
pub struct Conductor<'a> {
    /// The server.
    pub client: &'a Client,
    /// Open games of a new run.
    pub parallel: u32,
    /// True if a finished run is played again.
    pub again: bool,
    /// Games, by task and seed, that are played again if they have ended.
    pub repeats: &'a [(TaskName, Seed)],
    /// The share of a model's answers failing in one way above which a run stops; never with 1.
    pub stop_share: f64,
    /// A token whose cancellation stops everything.
    pub stop: &'a CancellationToken,
}

impl Conductor<'_> {
    /// Creates or resumes a run and plays it to its end, with the language models that play in it, in the order of the plan.
    ///
    /// # Errors
    /// See [`StopReason`].
    pub async fn conduct(
        &self,
        planned: &Planned,
        models: Vec<Model>,
        watch: &mut dyn FnMut(News<'_>),
    ) -> Result<RunDetail, StopReason> {
        let (found, run, tokens) = match &planned.entry {
            None => self.find(planned).await?,
            Some(entry) => self.attempt(entry, models.first()).await?,
        };
        watch(News::Begins(planned, &found, &run));
        let Some(tokens) = tokens else { return Ok(run) };
        let reader = tokens.first().map(String::as_str);
        let ended = match self.play(planned, &run, &tokens, models, watch).await {
            Err(reason) if !matches!(reason, StopReason::Client(_)) => {
                // The board shows how far it came.
                if let Ok(run) = self.client.run(&run.run.id, reader).await {
                    watch(News::Polled(&run));
                }
                return Err(reason);
            }
            ended => ended?,
        };
        let mut run = self.client.run(&run.run.id, reader).await?;
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
    async fn play(
        &self,
        planned: &Planned,
        run: &RunDetail,
        tokens: &[String],
        models: Vec<Model>,
        watch: &mut dyn FnMut(News<'_>),
    ) -> Result<End, StopReason> {
        let watch = &RefCell::new(watch);
        let sync = async {
            loop {
                SystemClock.sleep_until(after(SystemClock.now(), SYNC)).await;
                let run =
                    match self.client.run(&run.run.id, tokens.first().map(String::as_str)).await {
                        Ok(run) => run,
                        Err(error) if tokens.is_empty() => return Err(error.into()),
                        // The driver reports failures of the server.
                        Err(_) => continue,
                    };
                watch.borrow_mut()(News::Polled(&run));
                // Nothing drives a run that the server plays alone.
                if tokens.is_empty() && run.run.status != RunStatus::Running.name() {
                    return Ok(End::Over);
                }
            }
        };
        let sync: std::pin::Pin<&mut dyn Future<Output = Result<End, StopReason>>> =
            std::pin::pin!(sync);
        let driving = std::pin::pin!(async {
            match (&planned.who, tokens.first()) {
                (Who::Player(player), Some(token)) => {
                    let (params, players) = (GameParams::of(run), player.players());
                    let mut swarm = BuiltIns::new(self.client, token, params, player.seed, players);
                    let judge = Judge::new(&planned.name(), self.stop_share);
                    let driven = self.drive(token, &mut swarm, &judge, self.stop, watch).await;
                    let failed = |error: PlayerError| StopReason::Play(error.to_string());
                    driven.map_err(|error| stop_reason(error, failed))
                }
                (_, Some(_)) => self.drive_models(planned, run, tokens, models, watch).await,
                (_, None) => {
                    self.stop.cancelled().await;
                    Ok(End::Stopped)
                }
            }
        });
        match select(driving, sync).await {
            Either::Left((ended, _)) | Either::Right((ended, _)) => ended,
        }
    }

    /// Drives the seats of each model with its token. When one stops, the others do: they would wait for its seats for ever.
    async fn drive_models(
        &self,
        planned: &Planned,
        run: &RunDetail,
        tokens: &[String],
        models: Vec<Model>,
        watch: &RefCell<&mut dyn FnMut(News<'_>)>,
    ) -> Result<End, StopReason> {
        let plans = planned.models();
        if models.len() != plans.len() || tokens.len() != plans.len() {
            let names: Vec<_> = plans.iter().map(|(model, _)| model.name.as_str()).collect();
            let problem = format!("no endpoint is named for the model {}", names.join(", "));
            return Err(StopReason::Play(problem));
        }
        let stop = self.stop.child_token();
        let driven =
            plans.iter().zip(tokens).zip(models).map(async |(((plan, _), token), model)| {
                let judge = Arc::new(Judge::new(&plan.name, self.stop_share));
                let mut swarm = Conversation::new(
                    self.client,
                    (&run.run.id, token),
                    (planned, plan),
                    model,
                    Arc::clone(&judge),
                );
                let driven = self.drive(token, &mut swarm, &judge, &stop, watch).await;
                if !matches!(driven, Ok(End::Over)) {
                    stop.cancel();
                }
                driven.map_err(|error| stop_reason(error, |error| error))
            });
        let ended: Vec<End> = join_all(driven).await.into_iter().collect::<Result<_, _>>()?;
        Ok(if ended.contains(&End::Stopped) { End::Stopped } else { End::Over })
    }

    /// Drives the seats of a token.
    async fn drive<S: Swarm>(
        &self,
        token: &str,
        swarm: &mut S,
        judge: &Judge,
        stop: &CancellationToken,
        watch: &RefCell<&mut dyn FnMut(News<'_>)>,
    ) -> Result<End, DriveError<S::Error>> {
        let report = |note: Note<'_>| match note {
            Note::Looked(looked) => watch.borrow_mut()(News::Looked(looked)),
            Note::Acted(act, receipt) => {
                judge.note(act, receipt);
                watch.borrow_mut()(News::Acted(act, receipt));
            }
            Note::Late(act) => watch.borrow_mut()(News::Late(act)),
        };
        drive(self.client, token, swarm, stop, report).await
    }

    /// Finds the newest running or finished run of this identity, or creates one.
    async fn find(&self, planned: &Planned) -> Result<Begun, StopReason> {
        let identity = planned.identity();
        let games = planned.suite.plan();
        let lacks = |(task, seed): &&(TaskName, Seed)| {
            !games.iter().any(|game| game.task == task.name() && game.seed == *seed)
        };
        let missing = self.repeats.iter().find(lacks);
        let runs = self.runs_of(&planned.name()).await?;
        for run in &runs {
            let Some(evaluated) = own(&run.agent_meta) else { continue };
            let is_running = run.status == RunStatus::Running.name();
            let is_finished = run.status == RunStatus::Finished.name();
            let is_over = !(is_running || is_finished);
            if evaluated["identity"] != identity || is_over || missing.is_some() {
                continue;
            }
            if is_finished && self.again {
                break;
            }
            // Only the creator gets a new token; other runs of this identity are skipped.
            let tokens = match self.tokens(planned, &run.id).await {
                Ok(tokens) => tokens,
                Err(ClientError::Refused { status, .. }) if status.is_client_error() => continue,
                Err(error) => return Err(error.into()),
            };
            // The server plays a team of built-in players, which has no token.
            let first = tokens.first().map(String::as_str);
            let run = self.client.run(&run.id, first).await?;
            let is_team = matches!(planned.who, Who::Team(_));
            // A team belongs to the key of its creator, and not to one of its holders.
            let owner = first.filter(|_| !is_team || !self.client.has_key());
            let repeated = self.repeat_games(&games, &run, owner).await?;
            if !repeated.is_empty() {
                let run = self.client.run(&run.run.id, first).await?;
                return Ok((Found::Repeats(repeated), run, Some(tokens)));
            }
            return Ok(if is_finished {
                (Found::Finished, run, None)
            } else {
                (Found::Resumed, run, Some(tokens))
            });
        }
        if let Some((task, seed)) = missing.or(self.repeats.first()) {
            return Err(StopReason::Play(format!(
                "no run of {} as it is asked here has a game {}/{seed} to play again: name the tasks, seeds and settings of the run \
                 that has it, or leave out --replay-game",
                planned.name(),
                task.name()
            )));
        }
        let unfinished = |run: &&RunSummary| run.status == RunStatus::Running.name();
        let evaluated = |run: &&RunSummary| run.agent_meta.get(META).is_some();
        let other = runs.iter().filter(evaluated).find(unfinished);
        let other = other.map(|run| (run.id.clone(), differences(run, planned)));
        let created = self.client.create_run(&planned.request(self.parallel)).await?;
        let of_holders = created.holder_tokens.into_iter().map(|token| token.swarm_token);
        let tokens: Vec<String> = created.swarm_token.into_iter().chain(of_holders).collect();
        if tokens.len() != token_holders(planned).len() {
            return Err(StopReason::Play(
                "the server did not give a token for the run that it created".to_owned(),
            ));
        }
        Ok((Found::New(other.filter(|(_, how)| !how.is_empty())), created.run, Some(tokens)))
    }

    /// New tokens of a run: one, or one for each model of a team.
    async fn tokens(&self, planned: &Planned, run: &str) -> Result<Vec<String>, ClientError> {
        let mut tokens = Vec::new();
        for holder in token_holders(planned) {
            tokens.push(self.client.replace_run_token(run, holder).await?.swarm_token);
        }
        Ok(tokens)
    }

    /// Has the ended ones among [`Conductor::repeats`] played again. Games that are open, or not played yet, need no second game:
    /// an earlier call may have been interrupted. Returns the earlier games in words.
    async fn repeat_games(
        &self,
        planned: &[PlannedGame],
        run: &RunDetail,
        token: Option<&str>,
    ) -> Result<Vec<String>, ClientError> {
        let mut repeated = Vec::new();
        for game in run.games.iter().filter(|game| game.void_reason.is_none()) {
            // Holders of a team are not told the seeds.
            let is_asked = |of: &&PlannedGame| {
                let is_it =
                    |(task, seed): &(TaskName, Seed)| task.name() == of.task && *seed == of.seed;
                of.slot == game.slot && self.repeats.iter().any(is_it)
            };
            let is_over = !["planned", "running", "waiting"].contains(&game.status.as_str());
            let asked = planned.iter().find(is_asked).zip(game.episode.as_ref());
            let Some((of, id)) = asked.filter(|_| is_over) else { continue };
            self.client.repeat_episode(id, "asked for with --replay-game", token).await?;
            let score = game.score.map_or_else(String::new, |score| format!(", score {score:.2}"));
            repeated.push(format!("{} {} ({id}{score})", of.task, of.seed));
        }
        Ok(repeated)
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
                let token = self.client.replace_run_token(&begun.run, None).await?.swarm_token;
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
        Ok((found, run, Some(vec![token])))
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

/// Receivers of a run's tokens: its only player, or the models of a team by their names in it.
fn token_holders(planned: &Planned) -> Vec<Option<&str>> {
    match &planned.who {
        Who::Model(_) | Who::Player(_) => vec![None],
        Who::Team(team) => team.models().map(|(member, _)| Some(member.name.as_str())).collect(),
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
    // Holders of a team are not told the seeds.
    if let Some(seeds) = &run.suite.seeds {
        compare("seeds", Some(ranges(seeds)), Some(ranges(&planned.suite.seeds)));
    }
    for axis in axes() {
        compare(axis, was(axis), planned.setting(axis));
    }
    if let Who::Team(team) = &planned.who {
        let shown = |(name, seats): (&String, &Vec<u16>)| format!("{name} {seats:?}");
        let was: Vec<_> = run.holders.iter().map(|of| shown((&of.name, &of.seats))).collect();
        let is: Vec<_> = team.members.iter().map(|of| shown((&of.name, &of.seats))).collect();
        compare("seats", Some(was.join(" ")), Some(is.join(" ")));
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
