//! `swarmbench eval`

mod asking;
mod attempt;
mod estimate;
mod hosting;
mod progress;
mod showing;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, anyhow, ensure};
use tokio_util::sync::CancellationToken;

use asking::Asking;
use attempt::Attempt;
pub use hosting::{Hosted, Hosting, Opened};
use progress::Progress;
use showing::Showing;

use swarmbench_client::client::{Client, ClientError};
use swarmbench_client::eval::conduct::{Conductor, News};
use swarmbench_client::eval::experiment::{Axes, Experiment, List, ModelEntry, Numbers};
use swarmbench_client::eval::judge::STOP_SHARE;
use swarmbench_client::eval::lanes::runs_at_once;
use swarmbench_client::eval::plan::{ModelPlan, Plan, Planned};
use swarmbench_client::eval::report::{ExperimentReport, Played, SentActs};
use swarmbench_client::eval::stop_reason::{Reach, StopReason};
use swarmbench_client::eval::verify::{Fault, verify_run};
use swarmbench_client::llm::Model;
use swarmbench_clock::{Clock, SystemClock, after};
use swarmbench_engine::{Seed, TaskName};
use swarmbench_protocol::run::RunDetail;

/// Exit code when something must be fixed first.
const FAILED: u8 = 1;

/// Exit code when the evaluation stopped and the same command resumes it.
const STOPPED: u8 = 3;

/// Exit code when it was interrupted and the same command resumes it.
const INTERRUPTED: u8 = 130;

/// Default number of concurrent games.
const PARALLEL: u32 = 4;

/// Default number of concurrent requests to an endpoint.
const REQUESTS: u32 = 16;

/// Default number of models of one endpoint that play at the same time.
const MODELS_AT_ONCE: u32 = 1;

/// Interval between messages about pending answers after an interruption.
const WAITING_EVERY: Duration = Duration::from_secs(10);

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Every combination of a model (or player) and settings is a run on a server. Every seat is a conversation of its \
        own: each round the model sees the server's prompt for that seat and nothing else. Whatever stops an evaluation, the \
        same command resumes it; completed games are shown, not played again.\n\n\
        Examples:\n  \
        swarmbench eval --task all --seeds 27,42,57,72,87 --model gpt-4o --api-base https://api.openai.com/v1\n  \
        swarmbench eval --task Foraging --seeds 0..5 --model llama3.1:8b,qwen3:8b --api-base http://127.0.0.1:11434/v1\n  \
        swarmbench eval --player default --seeds 0..20 --verify\n  \
        swarmbench eval examples/eval/noise.toml --model my-model --api-base http://127.0.0.1:8000/v1 --dry-run\n  \
        swarmbench eval --attempt cmp_… --model my-model --api-base http://127.0.0.1:8000/v1 --server https://cup.example\n\n\
        The key of an endpoint comes from an environment variable: OPENAI_API_KEY, or the variable that --api-key-env names. The \
        key is stored nowhere. Values of a list are separated by commas, or the option is repeated.\n\n\
        Exit codes: 0, everything was played; 1, something has to be fixed first; 2, the command line is wrong; 3, the evaluation \
        stopped and the same command resumes it (a budget, answers that mostly fail, an endpoint or a server that does not \
        answer); 130, the evaluation was interrupted and the same command resumes it.\n\n\
        docs/evaluate/eval.md says more, and examples/eval has the experiments of the paper."
)]
pub struct Args<H: clap::Args> {
    #[command(flatten)]
    asked: Asked,
    #[command(flatten, next_help_heading = "Server")]
    hosting: H,
    #[command(flatten)]
    ending: Ending,
}

#[derive(Debug, clap::Args)]
struct Asked {
    /// An experiment as a TOML file; options on the command line override it.
    file: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Games")]
    games: Games,
    #[command(flatten, next_help_heading = "Players")]
    who: WhoArgs,
    #[command(flatten, next_help_heading = "Attempts in competitions")]
    attempt: Attempt,
    #[command(flatten, next_help_heading = "Requests to models")]
    asking: Asking,
}

#[derive(Debug, clap::Args)]
struct Ending {
    #[command(flatten, next_help_heading = "Output")]
    showing: Showing,
    /// Play nothing: show the games that would be played, the maximum number of requests to models, and an estimate of their
    /// tokens and cost.
    #[arg(long)]
    dry_run: bool,
    /// Play completed runs again; with --attempt, play the next attempt.
    #[arg(long)]
    again: bool,
    /// Play this ended game of a run again, such as Transport/27; may be repeated. The earlier game is kept, counts no more, and
    /// is named with the run.
    #[arg(long, value_name = "TASK/SEED", value_delimiter = ',', conflicts_with_all = ["again", "competition"])]
    replay_game: Vec<GameChoice>,
    /// Replay all journals at the end, and fail if anything differs from the server's reports.
    #[arg(long)]
    verify: bool,
}

#[derive(Debug, clap::Args)]
struct Games {
    /// The tasks: Transport, Pursuit, Synchronization, Foraging, Flocking, or all (all).
    #[arg(long = "task", alias = "tasks", value_delimiter = ',', value_name = "TASK")]
    task: Vec<String>,
    /// The seeds, or ranges of seeds such as 0..20 for 0 to 19 (27,42,57,72,87).
    #[arg(long, alias = "seed", value_delimiter = ',')]
    seeds: Vec<Numbers>,
    #[command(flatten)]
    settings: Axes,
    /// The prompt template for models, instead of the server's own: a file, or the name toolkit or static-first
    /// (docs/play/prompts.md).
    #[arg(long, value_name = "FILE|NAME")]
    prompt_template: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
struct WhoArgs {
    /// The language models, by the names that their endpoint has for them.
    #[arg(long = "model", alias = "models", value_delimiter = ',', value_name = "MODEL")]
    model: Vec<String>,
    /// The built-in players: names (docs/evaluate/baselines.md), default for the best of each task, or all.
    #[arg(long = "player", alias = "players", value_delimiter = ',', value_name = "NAME")]
    player: Vec<String>,
    /// The seed of built-in players' own choices (1).
    #[arg(long)]
    player_seed: Option<u64>,
}

/// A game of a run.
#[derive(Clone, Debug)]
struct GameChoice(TaskName, Seed);

impl FromStr for GameChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let game = text.split_once('/').and_then(|(task, seed)| {
            Some(Self(TaskName::find(task)?, Seed::try_from(seed.parse::<u64>().ok()?).ok()?))
        });
        game.ok_or_else(|| "a game is a task and a seed, such as Transport/27".to_owned())
    }
}

fn taken<T>(values: &mut Vec<T>) -> Option<List<T>> {
    list(std::mem::take(values))
}

fn list<T>(values: Vec<T>) -> Option<List<T>> {
    (!values.is_empty()).then_some(List(values))
}

/// An evaluation, as the command line describes it.
struct Evaluation<'h> {
    asked: Asked,
    hosting: &'h dyn Hosting,
    ending: Ending,
}

impl Evaluation<'_> {
    /// Settings from the command line.
    fn said(&mut self) -> Experiment {
        let Games { task, seeds, settings, prompt_template } = &mut self.asked.games;
        let models = std::mem::take(&mut self.asked.who.model);
        Experiment {
            tasks: taken(task),
            seeds: taken(seeds),
            models: list(models.iter().map(|name| ModelEntry::named(name)).collect()),
            players: taken(&mut self.asked.who.player),
            player_seed: self.asked.who.player_seed,
            prompt_template: prompt_template.take(),
            settings: Axes {
                temperature: std::mem::take(&mut self.asked.asking.temperature),
                top_p: std::mem::take(&mut self.asked.asking.top_p),
                ..std::mem::take(settings)
            },
            parallel: self.hosting.parallel(),
            board: self.ending.showing.board.map(Into::into),
            ..self.asked.asking.said()
        }
    }

    /// The whole experiment, and its prompt template if it names one: the text or a name.
    fn experiment(&mut self) -> anyhow::Result<(Experiment, Option<String>)> {
        let mut said = self.said();
        read_systems(&mut said, Path::new(""))?;
        let read = self.asked.file.as_deref().map(read).transpose()?;
        self.asked.attempt.check(&said, read.as_ref())?;
        let mut experiment = match read {
            None => said,
            Some(read) => read.with(said),
        };
        let template = experiment.prompt_template.take();
        let template = template.map(|path| {
            if is_name(&path) {
                return Ok(path.display().to_string());
            }
            swarmbench_clock::files::read_text(&path).with_context(|| {
                format!(
                    "the prompt template {}: a file, or the name toolkit or static-first",
                    path.display()
                )
            })
        });
        Ok((experiment, template.transpose()?))
    }

    /// The plan; for an attempt also the server, which was asked what is played.
    async fn plan(
        &mut self,
        stop: &CancellationToken,
    ) -> anyhow::Result<(Experiment, Plan, Option<Client>)> {
        let (experiment, template) = self.experiment()?;
        let list = self.asked.asking.price_list()?;
        let prices = |model: &ModelPlan| {
            list.as_ref().map_or(Ok(None), |list| self.asked.asking.price(list, model))
        };
        let (plan, joined) = if self.asked.attempt.competition.is_some() {
            ensure!(
                !self.ending.verify,
                "the journals of an attempt are sealed until its competition has closed, so leave out --verify; then \
                 `swarmbench verify --competition` checks its export"
            );
            ensure!(
                !self.asked.asking.is_replay(),
                "an attempt is played by the declared model and not by a recording, so leave out --replay"
            );
            self.hosting.check_attempt()?;
            let (client, _) = self.hosting.open(stop).await?;
            let entry = self.asked.attempt.entry(&client).await?;
            (Plan::of_attempt(&experiment, template.as_deref(), &prices, entry), Some(client))
        } else {
            let template = swarmbench_prompt::chosen(template);
            let checked = template.as_deref().map(swarmbench_prompt::check).transpose();
            checked.context("the prompt template")?;
            (Plan::of(&experiment, template.as_deref(), &prices), None)
        };
        let plan = plan.map_err(|wrong| match &self.asked.file {
            Some(file) => anyhow!("{}:\n       {wrong}", file.display()),
            None => anyhow!(wrong),
        })?;
        let plan = if self.asked.asking.is_replay() { plan.replayed() } else { plan };
        Ok((experiment, plan, joined))
    }
}

/// Whether this is the name of a template instead of a file.
fn is_name(template: &Path) -> bool {
    let named = swarmbench_prompt::NAMED.iter().map(|(name, _)| *name);
    named.chain(["default"]).any(|name| template.as_os_str() == name)
}

/// Reads system messages that are in files, given as `@` and a path. Relative paths are in `folder`.
fn read_systems(experiment: &mut Experiment, folder: &Path) -> anyhow::Result<()> {
    let models = experiment.models.iter_mut().flat_map(|List(models)| models);
    let of_models = models.filter_map(|model| model.system.as_mut());
    for system in of_models.chain(experiment.system.as_mut()) {
        for text in system.texts_mut() {
            if let Some(path) = text.strip_prefix('@') {
                let path = folder.join(path);
                let read = swarmbench_clock::files::read_text(&path);
                *text = read.with_context(|| format!("the system message {}", path.display()))?;
            }
        }
    }
    Ok(())
}

/// Reads an experiment. The paths in it are relative to its folder.
fn read(file: &Path) -> anyhow::Result<Experiment> {
    let shown = file.display();
    let text = swarmbench_clock::files::read_text(file)
        .with_context(|| format!("{shown}: name a file that describes an experiment"))?;
    let mut experiment =
        Experiment::from_toml(&text).map_err(|error| anyhow!("{shown}: {error}"))?;
    let beside = |path: PathBuf| file.parent().map(|folder| folder.join(&path)).unwrap_or(path);
    experiment.prompt_template =
        (experiment.prompt_template).map(|path| if is_name(&path) { path } else { beside(path) });
    read_systems(&mut experiment, file.parent().unwrap_or(Path::new("")))?;
    if experiment.name.is_none() {
        experiment.name = file.file_stem().map(|name| name.to_string_lossy().into_owned());
    }
    Ok(experiment)
}

pub async fn run<H: Hosting + clap::Args>(args: Args<H>) -> anyhow::Result<ExitCode> {
    let Args { asked, hosting, ending } = args;
    evaluate(Evaluation { asked, hosting: &hosting, ending }).await
}

async fn evaluate(mut evaluation: Evaluation<'_>) -> anyhow::Result<ExitCode> {
    evaluation.asked.asking.check()?;
    let stop = CancellationToken::new();
    let (experiment, plan, joined) = evaluation.plan(&stop).await?;
    attempt::warn(&plan);
    let Evaluation { asked, hosting, ending } = &evaluation;
    if ending.dry_run {
        let cassette = asked.asking.recording()?;
        let recorded = |model: &ModelPlan| asked.asking.recorded(cassette.as_ref(), model);
        ending.showing.dry_run(&plan, &recorded)?;
        return Ok(ExitCode::SUCCESS);
    }
    ending.showing.check()?;
    let repeats: Vec<_> =
        ending.replay_game.iter().map(|GameChoice(task, seed)| (*task, *seed)).collect();
    let models = asked.asking.models(&experiment, &plan, &stop)?;
    stop_when_asked(stop.clone(), models.clone());
    let (client, hosted) = match joined {
        Some(client) => (client, None),
        None => hosting.open(&stop).await?,
    };
    let parallel = experiment.parallel.unwrap_or(PARALLEL);
    let stop_share = experiment.stop_share.unwrap_or(STOP_SHARE);
    let conductor = Conductor {
        client: &client,
        parallel,
        again: ending.again,
        repeats: &repeats,
        stop: &stop,
        stop_share,
    };
    let models_at_once = experiment.models_at_once.unwrap_or(MODELS_AT_ONCE);
    let models_at_once = usize::try_from(models_at_once).unwrap_or(usize::MAX);
    let ended = play(&conductor, &plan, &models, models_at_once, &evaluation).await;
    if let Some(hosted) = hosted {
        hosted.close().await?;
    }
    ended
}

/// Plays all runs of a plan and shows the results.
async fn play(
    conductor: &Conductor<'_>,
    plan: &Plan,
    models: &[Vec<Model>],
    models_at_once: usize,
    Evaluation { hosting, ending, .. }: &Evaluation<'_>,
) -> anyhow::Result<ExitCode> {
    let is_several = runs_at_once(plan, models, models_at_once) > 1;
    let base = conductor.client.base().as_str().trim_end_matches('/');
    let mut progress = Progress::new(plan, models, base, is_several);
    let mut last: BTreeMap<usize, RunDetail> = BTreeMap::new();
    let mut sent: BTreeMap<usize, SentActs> = BTreeMap::new();
    let watch = &mut |number: usize, news: News<'_>| {
        if let News::Begins(.., run) | News::Polled(run) | News::Ends(run) = news {
            last.insert(number, run.clone());
        }
        if let News::Acted(act, receipt) = news {
            sent.entry(number).or_default().note(act, receipt);
        }
        progress.note(number, news);
    };
    let failures = conductor.conduct_all(plan, models, models_at_once, watch).await;
    progress.finish();
    for line in progress.in_vain() {
        note!("{line}");
    }
    let mut played: Vec<Played> = (last.into_iter())
        .map(|(number, run)| Played {
            planned: plan.runs[number].clone(),
            run,
            sent: sent.remove(&number).unwrap_or_default(),
            verified: false,
        })
        .collect();
    let is_whole = failures.is_empty() && !conductor.stop.is_cancelled();
    if is_whole && ending.verify {
        verify_all(conductor.client, plan, &mut played).await?;
    }
    let report = ExperimentReport::of(plan, &played);
    ending.showing.show(plan, &report, is_whole)?;
    if is_whole {
        ending.showing.tell_more(plan, &played, &hosting.place());
        return Ok(ExitCode::SUCCESS);
    }
    Ok(tell(&failures, plan, &played))
}

/// Prints why the evaluation stopped and how to resume.
fn tell(failures: &[(usize, StopReason)], plan: &Plan, played: &[Played]) -> ExitCode {
    let all: usize = plan.runs.iter().map(Planned::games).sum();
    let done: u32 = played.iter().map(|played| played.run.run.played).sum();
    let left = format!("{done} of {all} games were played");
    let names: BTreeSet<String> = plan.runs.iter().map(Planned::name).collect();
    let mut told = BTreeSet::new();
    let mut must_fix = false;
    let mut is_over = false;
    for (number, reason) in failures {
        if matches!(reason, StopReason::Requested) {
            continue;
        }
        must_fix |= !reason.can_resume();
        is_over |= matches!(reason, StopReason::NotStarted(_) | StopReason::AttemptOver(_));
        let is_keyless = matches!(
            reason,
            StopReason::Client(ClientError::Refused { problem, .. }) if problem.code == "unauthorized"
        );
        let hint = if is_keyless { "; give it with --key or SWARMBENCH_KEY" } else { "" };
        let head = if reason.can_resume() { "stopped" } else { "error" };
        // A reason that ends everything is the same for all runs.
        let of = match reason.reach() {
            Reach::Player | Reach::Endpoint if names.len() > 1 => {
                format!("{}: ", plan.runs[*number].name())
            }
            Reach::Player | Reach::Endpoint | Reach::All => String::new(),
        };
        let line = format!("{head}: {of}{reason}{hint}");
        if told.insert(line.clone()) {
            note!("{line}");
        }
    }
    if is_over {
        return ExitCode::from(FAILED);
    }
    attempt::tell_clocks(plan, played, failures);
    if must_fix {
        note!("{left}; fix that, then run the same command again to resume");
        ExitCode::from(FAILED)
    } else if told.is_empty() {
        note!("stopped: {left}; run the same command again to resume");
        ExitCode::from(INTERRUPTED)
    } else {
        note!("{left}; run the same command again to resume");
        ExitCode::from(STOPPED)
    }
}

async fn verify_all(client: &Client, plan: &Plan, played: &mut [Played]) -> anyhow::Result<()> {
    let games: u64 = plan.runs.iter().map(|run| run.suite.plan().len() as u64).sum();
    let bar = progress::plain_bar("verifying", games, "games");
    let (mut count, mut rounds) = (0, 0);
    for Played { planned, run, verified, .. } in played {
        let checked = verify_run(client, planned, run, || bar.inc(1)).await;
        let checked = checked.map_err(|fault| {
            let what = match &fault {
                Fault::Client(_) => "the games that were played could not be read again",
                Fault::Wrong { .. } => "the games that were played do not verify",
            };
            anyhow!(fault).context(what)
        })?;
        *verified = true;
        count += checked.games;
        rounds += checked.rounds;
    }
    bar.finish_and_clear();
    note!("verified: {count} games, {rounds} rounds played again, every hash, act and score");
    Ok(())
}

/// Stops on the first signal: no request begins any more, and those in flight are awaited. A second signal ends the process at
/// once.
fn stop_when_asked(stop: CancellationToken, models: Vec<Vec<Model>>) {
    let first = crate::stop::asked_to_stop();
    tokio::spawn(async move {
        first.await;
        let second = crate::stop::asked_to_stop();
        stop.cancel();
        let in_flight =
            || models.iter().flatten().map(|model| model.spent().in_flight).sum::<u64>();
        let longest = models.iter().flatten().map(Model::timeout).max().unwrap_or_default();
        match in_flight() {
            0 => note!("stopping: acts that were decided are sent. Ctrl-C again stops at once"),
            asked => note!(
                "stopping: no more questions are asked. Waiting for the answers to {asked}, at most {} s; their acts are \
                 sent. Ctrl-C again stops at once, and these answers are lost",
                longest.as_secs()
            ),
        }
        let mut second = std::pin::pin!(second);
        loop {
            tokio::select! {
                () = &mut second => std::process::exit(INTERRUPTED.into()),
                () = SystemClock.sleep_until(after(SystemClock.now(), WAITING_EVERY)) => {}
            }
            // On a terminal the bar of all games shows this.
            if !super::output::is_watched() {
                note!("stopping: waiting for {} answers", in_flight());
            }
        }
    });
}
