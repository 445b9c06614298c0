//! `swarmbench play`

use comfy_table::{Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use swarmbench_engine::TaskName;
use swarmbench_players::{BuiltIn, default_for, find};

use crate::players::client::Client;
use crate::players::play::play;
use crate::wire::episode::{EpisodeRequest, EpisodeSummary};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Built-in players: `random` plays every task; each task has one of its own, \
    which is used where none is named."
)]
pub(super) struct Args {
    /// The address of the server.
    #[arg(long, env = "SWARMBENCH_SERVER", default_value = "http://127.0.0.1:8080")]
    server: String,
    /// Your key, where the server asks for one.
    #[arg(long, env = "SWARMBENCH_KEY", hide_env_values = true)]
    key: Option<String>,
    /// The task: Transport, Pursuit, Synchronization, Foraging or Flocking.
    #[arg(long, value_parser = task)]
    task: TaskName,
    /// The seed of the layout; drawn at random where it is left out.
    #[arg(long)]
    seed: Option<i64>,
    /// The built-in player for every seat.
    #[arg(long)]
    player: Option<String>,
    /// The seed of the players' own choices.
    #[arg(long, default_value_t = 1)]
    player_seed: u64,
    /// The rule set: paper or reference.
    #[arg(long)]
    rules: Option<String>,
    /// How many agents play (12).
    #[arg(long)]
    num_agents: Option<i64>,
    /// Columns of the map (10).
    #[arg(long)]
    width: Option<i64>,
    /// Rows of the map (10).
    #[arg(long)]
    height: Option<i64>,
    /// Rows and columns of an agent's window (5).
    #[arg(long)]
    view_size: Option<i64>,
    /// After how many rounds the episode ends (100).
    #[arg(long)]
    max_round: Option<i64>,
}

pub(super) fn task(name: &str) -> Result<TaskName, String> {
    let names: Vec<_> = TaskName::ALL.iter().map(|task| task.name()).collect();
    (TaskName::ALL.into_iter())
        .find(|task| task.name().eq_ignore_ascii_case(name))
        .ok_or_else(|| format!("the tasks are {}", names.join(", ")))
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    let player = player(args.player.as_deref(), args.task)?;
    let mut client = Client::new(&args.server)?;
    if let Some(key) = args.key {
        client = client.with_key(key);
    }
    // Once a game goes on, a server that is away for a moment is waited for; here it is not.
    client.health().await?;
    let request = EpisodeRequest {
        seed: args.seed,
        rules: args.rules,
        num_agents: args.num_agents,
        width: args.width,
        height: args.height,
        view_size: args.view_size,
        max_round: args.max_round,
        ..request(args.task, player)
    };
    let bar = bar(args.task.name(), player.name);
    let (summary, _) = play_one(&client, &request, player, args.player_seed, &bar).await?;
    bar.finish();
    println!("\n{}", scores([(player.name, &summary)].into_iter()));
    let base = client.base();
    println!("journal: curl -s {base}api/v1/episodes/{}/journal", summary.id);
    Ok(())
}

/// The player of this name, or the one that a task has of its own.
pub(super) fn player(name: Option<&str>, task: TaskName) -> anyhow::Result<&'static BuiltIn> {
    match name {
        None => Ok(default_for(task)),
        Some(name) => find(name, task).map_err(|error| anyhow::anyhow!("{error}")),
    }
}

/// An episode of the standard setting for a built-in player.
pub(super) fn request(task: TaskName, player: &BuiltIn) -> EpisodeRequest {
    EpisodeRequest {
        task: Some(task.name().to_owned()),
        model: Some(format!("built-in/{}", player.name)),
        ..EpisodeRequest::default()
    }
}

/// Creates an episode and plays it, with a progress bar.
pub(super) async fn play_one(
    client: &Client,
    request: &EpisodeRequest,
    player: &BuiltIn,
    player_seed: u64,
    bar: &ProgressBar,
) -> anyhow::Result<(EpisodeSummary, String)> {
    let created = client.create_episode(request).await?;
    let last = created.config.max_round;
    bar.set_length(last.into());
    let mut told = None;
    let summary = play(client, &created, player, player_seed, |round, score| {
        bar.set_position(round.into());
        bar.set_message(format!("score {score:.2}"));
        // Where there is no terminal a bar shows nothing, so a line does.
        if bar.is_hidden() && told.replace(round) != Some(round) {
            eprintln!("{} round {round}/{last} score {score:.2}", bar.prefix());
        }
    })
    .await?;
    Ok((summary, created.swarm_token))
}

/// A progress bar for one episode.
pub(super) fn bar(task: &str, player: &str) -> ProgressBar {
    let style = "{prefix:38} {bar:30} round {pos:>3}/{len:3} {msg}";
    ProgressBar::new(0)
        .with_style(ProgressStyle::with_template(style).expect("a valid template"))
        .with_prefix(format!("{task} ({player})"))
}

/// A table with these headings.
pub(super) fn table(headings: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED);
    if headings.iter().any(|heading| !heading.is_empty()) {
        table.set_header(headings);
    }
    table
}

/// The scores of episodes as a table.
pub(super) fn scores<'a>(played: impl Iterator<Item = (&'a str, &'a EpisodeSummary)>) -> Table {
    let mut table = table(&["task", "player", "seed", "rounds", "score", "end", "episode"]);
    for (player, episode) in played {
        let seed = episode.config.seed.map_or_else(String::new, |seed| seed.to_string());
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
