//! `swarmbench worth`

use std::num::NonZero;
use std::thread;

use anyhow::{Context, bail};
use swarmbench_protocol::run::RunDetail;
use swarmbench_protocol::worth::GameWorth;
use swarmbench_worth::{Appraiser, DEAREST, game_of, sent};

use super::journals::Journal;
use super::options::ServerArgs;
use super::output::{self, progress_bar, set, table};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "The worth of a state is the score that the task's default built-in player reaches from there, on all seats. \
    docs/evaluate/worth.md says what that means and what it does not. It is computed on this machine, from the journal: a game of \
    12 agents takes seconds, one with the losses of all seats up to a minute.\n\nExamples:\n  \
    swarmbench worth game.jsonl                        (a journal file, without a server)\n  \
    swarmbench worth ep_0123…                          (on a server on this machine)\n  \
    swarmbench worth run_0123…                         (all games of a run)\n  \
    swarmbench worth game.jsonl --no-seats --json | jq .values"
)]
pub struct Args {
    /// A journal file, or the id of an episode or of a run.
    game: String,
    /// Leave out what each seat lost, which takes most of the time.
    #[arg(long)]
    no_seats: bool,
    /// Print JSON, in the shape of the API; of a run a list.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    server: ServerArgs,
}

pub async fn run(args: Args) -> anyhow::Result<()> {
    if args.game.starts_with("imp_") {
        bail!("{} is an imported game: its files have no state that can be played on", args.game);
    }
    if args.game.starts_with("run_") {
        return of_run(args).await;
    }
    let worth = of_game(&args, &args.game).await?;
    if args.json {
        return output::json(&worth);
    }
    show(&[worth]);
    Ok(())
}

/// The worth of a journal file, or of an episode, whose journal is downloaded.
async fn of_game(args: &Args, game: &str) -> anyhow::Result<GameWorth> {
    let journal = Journal::find(game, args.server.clone()).await?;
    let (with_seats, name) = (!args.no_seats, game.to_owned());
    let work = move || of(&journal, with_seats).with_context(|| name);
    tokio::task::spawn_blocking(work).await?
}

/// The worth of a journal's game, computed on one thread for each processor.
pub fn of(journal: &Journal, with_seats: bool) -> anyhow::Result<GameWorth> {
    let (report, game) = game_of(journal.open()?)?;
    let bar = progress_bar("{bar:30} round {pos} of {len}, {eta} left");
    let threads = thread::available_parallelism().map_or(1, NonZero::get);
    let (rounds, appraiser) = (game.rounds.len() as u64, Appraiser::new(game, with_seats));
    let worth = appraiser.finish_on(threads, |done| set(&bar, done as u64, rounds));
    bar.finish_and_clear();
    Ok(GameWorth { episode: Some(report.opening.episode), ..sent(&worth, report.end.is_some()) })
}

async fn of_run(args: Args) -> anyhow::Result<()> {
    let client = args.server.clone().client().await?;
    let path = format!("/api/v1/runs/{}", args.game);
    let run: RunDetail = client.get(&path).await?;
    let played = run.games.iter().filter(|game| game.round > 0 && game.void_reason.is_none());
    let mut games = Vec::new();
    for episode in played.filter_map(|game| game.episode.as_ref()) {
        games.push(of_game(&args, episode).await?);
    }
    if games.is_empty() {
        bail!("no game of {} has a resolved round yet", args.game);
    }
    if args.json {
        return output::json(&games);
    }
    show(&games);
    Ok(())
}

/// Prints a row for each game, the curve and the seats of a single one, and the dearest decisions of all.
fn show(games: &[GameWorth]) {
    let mut shown = table(&["game", "task", "score", "could be scored", "accuracy", "settled"]);
    let mut dearest = Vec::new();
    for worth in games {
        let name = worth.episode.as_deref().unwrap_or_default();
        let first = worth.values.as_ref().and_then(|values| values.first());
        shown.add_row([
            name.to_owned(),
            worth.task.clone(),
            number(worth.score),
            output::cell(first.map(|first| number(*first))),
            share(worth.accuracy),
            output::cell(worth.settled_round.map(|round| format!("round {round}"))),
        ]);
        let game = if games.len() > 1 { format!("{name}, ") } else { String::new() };
        for dear in worth.dearest.iter().flatten() {
            dearest.push((dear.loss, format!("{game}round {}: {}", dear.round, dear.words)));
        }
    }
    out!("{shown}");
    if let [worth] = games {
        show_curve(worth);
        show_seats(worth);
    }
    dearest.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    dearest.truncate(DEAREST);
    if !dearest.is_empty() {
        out!("\nThe dearest decisions");
    }
    for (loss, words) in dearest {
        out!("{}", output::wrapped(&format!("{words}: −{}", number(loss)), output::width().into()));
    }
}

fn show_curve(worth: &GameWorth) {
    if worth.reference_is_weak == Some(true) {
        out!("The reference is weak here: from the start it would score less than this game.");
    }
    out!("\nWorth of some states: what {} still reaches from there", worth.method.reference);
    let mut curve = table(&["round", "worth", "lost since the row above"]);
    let values = worth.values.as_deref().unwrap_or_default();
    let step = (values.len() / 10).max(1);
    let mut above: Option<f64> = None;
    for (state, value) in values.iter().enumerate() {
        if state % step == 0 || state + 1 == values.len() {
            let lost = above.map_or(String::new(), |above| number(above - value));
            curve.add_row([state.to_string(), number(*value), lost]);
            above = Some(*value);
        }
    }
    out!("{curve}");
}

fn show_seats(worth: &GameWorth) {
    let (Some(seats), Some(kinds)) = (&worth.seats, &worth.kinds) else { return };
    out!("\nLosses of seats: each decision against the reference's in its place");
    for (head, sums) in [("seat", seats), ("decisions", kinds)] {
        let mut shown = table(&[head, "number", "lost", "share", "gained"]);
        // By number: Agent_10 is after Agent_9.
        let mut named: Vec<_> = sums.iter().filter(|(_, sum)| sum.decisions > 0).collect();
        named.sort_by_key(|(name, _)| (name.len(), *name));
        for (name, sum) in named {
            let (number_of, lost) = (sum.decisions.to_string(), number(sum.lost));
            shown.add_row([name.clone(), number_of, lost, share(sum.share), number(sum.gained)]);
        }
        out!("{shown}");
    }
}

fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn share(share: Option<f64>) -> String {
    output::cell(share.map(|share| format!("{:.1} %", share * 100.0)))
}
