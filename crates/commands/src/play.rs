//! `swarmbench play`

use std::collections::BTreeMap;

use anyhow::Context;
use comfy_table::Table;
use indicatif::{MultiProgress, ProgressBar};
use swarmbench_engine::TaskName;
use swarmbench_players::{BuiltIn, default_for, find};

use super::options::{ServerArgs, rules};
use super::output::{self, LINE_EVERY, cell, mean, progress_bar, progress_bars, table, total};
use swarmbench_client::client::Client;
use swarmbench_client::play::{play, play_run};
use swarmbench_clock::{Clock, SystemClock, until};
use swarmbench_protocol::episode::{EpisodeRequest, EpisodeSummary};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::run::{RunDetail, RunRequest, SuiteRequest};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Built-in players: `random` plays every task. Each task also has a player of its own, the default of \
    --player.\n\nWith --suite the command plays a whole run, with --run the rest of a run. It takes the run's token from \
    SWARMBENCH_RUN_TOKEN; without that the creator of the run gets a new token, and the earlier one is no longer valid."
)]
pub struct Args {
    #[command(flatten)]
    server: ServerArgs,
    /// The task: Transport, Pursuit, Synchronization, Foraging or Flocking.
    #[arg(long, value_parser = task, required_unless_present_any = ["suite", "run"])]
    task: Option<TaskName>,
    /// Play all games of a suite instead of one task: standard or quick.
    #[arg(long, conflicts_with_all = ["task", "run", "seed", "num_agents", "width", "height", "view_size", "max_round"])]
    suite: Option<String>,
    /// Play the rest of the run with this id.
    #[arg(long, conflicts_with_all = ["task", "seed", "rules", "num_agents", "width", "height", "view_size", "max_round"])]
    run: Option<String>,
    /// The token of that run.
    #[arg(long, env = "SWARMBENCH_RUN_TOKEN", hide_env_values = true, hide = true)]
    run_token: Option<String>,
    /// The number of games that are open at a time, with --suite (4).
    #[arg(long, requires = "suite")]
    parallel: Option<u32>,
    /// The name of the model that the server records. Default: built-in/PLAYER.
    #[arg(long, conflicts_with = "run")]
    model: Option<String>,
    /// The seed of the layout. Default: a random one.
    #[arg(long)]
    seed: Option<i64>,
    /// The built-in player of every seat. Default: the task's own.
    #[arg(long)]
    player: Option<String>,
    /// The seed of the players' own choices.
    #[arg(long, default_value_t = 1)]
    player_seed: u64,
    /// The rule set: paper or reference.
    #[arg(long, value_parser = rules)]
    rules: Option<String>,
    /// The number of agents (12).
    #[arg(long)]
    num_agents: Option<i64>,
    /// The width of the map, in cells (10).
    #[arg(long)]
    width: Option<i64>,
    /// The height of the map, in cells (10).
    #[arg(long)]
    height: Option<i64>,
    /// The side of an agent's window, in cells (5).
    #[arg(long)]
    view_size: Option<i64>,
    /// The maximum number of rounds of the episode (100).
    #[arg(long)]
    max_round: Option<i64>,
    /// Print the result as JSON, in the shape of the API: an episode, or with --suite and --run a run.
    #[arg(long)]
    json: bool,
}

pub fn task(name: &str) -> Result<TaskName, String> {
    let names: Vec<_> = TaskName::ALL.iter().map(|task| task.name()).collect();
    TaskName::find(name).ok_or_else(|| format!("the tasks are {}", names.join(", ")))
}

pub async fn run(args: Args) -> anyhow::Result<()> {
    let plays = |task: &TaskName| args.suite.is_some() || args.task == Some(*task);
    for task in TaskName::ALL.into_iter().filter(plays) {
        player(args.player.as_deref(), task)?;
    }
    let client = args.server.clone().client().await?;
    match args.task {
        Some(task) => play_episode(&client, args, task).await,
        None => play_suite(&client, args).await,
    }
}

async fn play_episode(client: &Client, args: Args, task: TaskName) -> anyhow::Result<()> {
    let player = player(args.player.as_deref(), task)?;
    let usual = request(task, player);
    let request = EpisodeRequest {
        model: args.model.or(usual.model.clone()),
        seed: args.seed,
        rules: args.rules,
        num_agents: args.num_agents,
        width: args.width,
        height: args.height,
        view_size: args.view_size,
        max_round: args.max_round,
        ..usual
    };
    let bar = bar(task.name(), player.name);
    let (summary, _) = play_one(client, &request, player, args.player_seed, &bar).await?;
    bar.finish();
    if args.json {
        return output::json(&summary);
    }
    out!("\n{}", scores([(player.name, &summary)].into_iter()));
    let base = client.base();
    out!("journal: curl -s {base}api/v1/episodes/{}/journal", summary.id);
    Ok(())
}

/// Plays a run, or the rest of one.
async fn play_suite(client: &Client, args: Args) -> anyhow::Result<()> {
    let name = args.player.as_deref();
    let (run, token) = match args.run {
        None => {
            let created = client
                .create_run(&RunRequest {
                    suite: args.suite.map(SuiteRequest::Named),
                    rules: args.rules,
                    model: args.model.or(Some(format!("built-in/{}", name.unwrap_or("default")))),
                    parallel: args.parallel,
                    ..RunRequest::default()
                })
                .await?;
            let token = created.swarm_token.context("the server did not give a token")?;
            let id = &created.run.run.id;
            let resume =
                format!("{id}; to resume after an interruption: swarmbench play --run {id}\n");
            if args.json {
                note!("{resume}");
            } else {
                out!("{resume}");
            }
            (created.run, token)
        }
        Some(id) => {
            let token = match args.run_token {
                Some(token) => token,
                None => client.replace_run_token(&id, None).await?.swarm_token,
            };
            (client.run(&id, Some(&token)).await?, token)
        }
    };
    let tasks = run.run.suite.tasks.iter().filter_map(|task| TaskName::parse(task));
    let players =
        tasks.map(|task| Ok((task, player(name, task)?))).collect::<anyhow::Result<_>>()?;
    let mut bars = RunBars::new(&run, name.unwrap_or("its own player"));
    let played =
        play_run(client, &run, &token, players, args.player_seed, |sight| bars.note(sight)).await?;
    bars.finish();
    if args.json {
        return output::json(&played);
    }
    out!("\n{}", results(&played));
    let (base, id) = (client.base(), &played.run.id);
    out!("{}: {base}api/v1/runs/{id}", played.run.status);
    Ok(())
}

/// Progress bars: one for each open game, and one for all.
struct RunBars {
    all: MultiProgress,
    games: BTreeMap<String, ProgressBar>,
    whole: ProgressBar,
    player: String,
}

impl RunBars {
    fn new(run: &RunDetail, player: &str) -> Self {
        let all = progress_bars();
        let whole = progress_bar("{prefix:38} {bar:30} {pos}/{len} games opened")
            .with_prefix(format!("{} ({})", run.run.suite.name, run.run.suite.rules));
        let ended =
            run.games.iter().filter(|game| !["planned", "running"].contains(&&*game.status));
        let whole = all.add(whole);
        whole.set_length(run.games.len() as u64);
        whole.set_position(ended.count() as u64);
        Self { all, games: BTreeMap::new(), whole, player: player.to_owned() }
    }

    fn note(&mut self, sight: &Sight) {
        let bar = self.games.entry(sight.episode.clone()).or_insert_with(|| {
            self.whole.inc(1);
            let bar = bar(&sight.task.name, &self.player);
            bar.set_length(sight.max_round.into());
            self.all.insert_before(&self.whole, bar)
        });
        let is_news = bar.position() != u64::from(sight.round) || sight.round == 0;
        bar.set_position(sight.round.into());
        bar.set_message(format!("score {:.2}", sight.score));
        // A bar prints nothing without a terminal, so each game prints a line.
        if bar.is_hidden() && is_news && sight.round == 0 && sight.agent == "Agent_0" {
            note!("{} is opened: {}", sight.task.name, sight.episode);
        }
        if sight.round + 1 == sight.max_round {
            bar.finish();
        }
    }

    fn finish(&self) {
        for bar in self.games.values().chain([&self.whole]) {
            bar.finish();
        }
    }
}

fn results(run: &RunDetail) -> Table {
    let mut table = table(&["task", "mean ± deviation", "games"]);
    for task in &run.run.tasks {
        let score = mean(task.mean, task.deviation);
        table.add_row([&task.task, &score, &format!("{}/{}", task.played, task.planned)]);
    }
    table.add_row([
        "total",
        &total(run.run.total),
        &format!("{}/{}", run.run.played, run.run.planned),
    ]);
    table
}

/// The named player, or the default one of a task.
pub fn player(name: Option<&str>, task: TaskName) -> anyhow::Result<&'static BuiltIn> {
    match name {
        None => Ok(default_for(task)),
        Some(name) => find(name, task).map_err(|error| anyhow::anyhow!("{error}")),
    }
}

/// An episode with standard settings for a built-in player.
pub fn request(task: TaskName, player: &BuiltIn) -> EpisodeRequest {
    EpisodeRequest {
        task: Some(task.name().to_owned()),
        model: Some(format!("built-in/{}", player.name)),
        ..EpisodeRequest::default()
    }
}

/// Creates an episode and plays it with a progress bar.
pub async fn play_one(
    client: &Client,
    request: &EpisodeRequest,
    player: &'static BuiltIn,
    player_seed: u64,
    bar: &ProgressBar,
) -> anyhow::Result<(EpisodeSummary, String)> {
    let created = client.create_episode(request).await?;
    let last = created.config.max_round;
    bar.set_length(last.into());
    // A bar shows nothing without a terminal.
    if bar.is_hidden() {
        note!("{} is opened: {}", bar.prefix(), created.id);
    }
    let mut last_line = SystemClock.now();
    let summary = play(client, &created, player, player_seed, |round, score| {
        bar.set_position(round.into());
        bar.set_message(format!("score {score:.2}"));
        let now = SystemClock.now();
        if bar.is_hidden() && until(last_line, now) >= LINE_EVERY {
            last_line = now;
            note!("{} round {round}/{last} score {score:.2}", bar.prefix());
        }
    })
    .await?;
    Ok((summary, created.swarm_token))
}

pub fn bar(task: &str, player: &str) -> ProgressBar {
    progress_bar("{prefix:38} {bar:30} round {pos:>3}/{len:3} {msg}")
        .with_prefix(format!("{task} ({player})"))
}

pub fn scores<'a>(played: impl Iterator<Item = (&'a str, &'a EpisodeSummary)>) -> Table {
    let mut table = table(&["task", "player", "seed", "rounds", "score", "end", "episode"]);
    for (player, episode) in played {
        let seed = cell(episode.config.seed);
        let end = episode.result.as_ref().map_or("", |result| &result.reason);
        table.add_row([
            episode.task.as_str(),
            player,
            &seed,
            &format!("{}/{}", episode.round, episode.config.max_round),
            &format!("{:.2}", episode.score),
            end,
            &episode.id,
        ]);
    }
    table
}
