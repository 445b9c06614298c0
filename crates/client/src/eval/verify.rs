//! Replays every journal of a run, and compares the results with those of the server.

use futures::{StreamExt, TryStreamExt, stream};
use swarmbench_engine::TaskName;
use swarmbench_engine::physics::Solver;

use super::plan::{Planned, Who};
use crate::client::{Client, ClientError};
use swarmbench_boards::result::mean_and_deviation;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::verify;
use swarmbench_protocol::run::RunDetail;
use swarmbench_protocol::suite::PlannedGame;

/// Concurrent downloads of journals.
const AT_ONCE: usize = 4;

/// The extent of a verification.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Verified {
    /// Verified games.
    pub games: u64,
    /// Replayed rounds.
    pub rounds: u64,
}

/// A reason why a run is not verified.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// A request failed.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The run differs from the plan, or its numbers do not follow from its journals.
    #[error("{run}: {problem}")]
    Wrong {
        /// The run.
        run: String,
        /// The fault.
        problem: String,
    },
}

/// Replays all journals of a run: checks every hash, digest, act and score, that the games have the planned settings,
/// and that the means follow from them. Calls `progress` after each game.
///
/// # Errors
/// The first fault.
pub async fn verify_run(
    client: &Client,
    planned: &Planned,
    run: &RunDetail,
    progress: impl Fn(),
) -> Result<Verified, Fault> {
    let wrong = |problem: String| Fault::Wrong { run: run.run.id.clone(), problem };
    let mut counted: Vec<(PlannedGame, String)> = Vec::new();
    for game in planned.suite.plan() {
        let mut games = run.games.iter();
        let played = games.find(|of| of.slot == game.slot && of.void_reason.is_none());
        let episode = played
            .and_then(|of| of.episode.clone())
            .ok_or_else(|| wrong(format!("{} on seed {} was not played", game.task, game.seed)))?;
        counted.push((game, episode));
    }
    let games = counted.iter().map(|(game, episode)| check(client, planned, game, episode));
    let checked: Vec<(TaskName, f64, u64)> = stream::iter(games)
        .buffered(AT_ONCE)
        .map(|checked| {
            progress();
            checked.map_err(|fault| match fault {
                GameFault::Client(error) => Fault::Client(error),
                GameFault::Wrong(problem) => wrong(problem),
            })
        })
        .try_collect()
        .await?;
    for task in planned.tasks() {
        let scores: Vec<f64> =
            checked.iter().filter(|(of, ..)| *of == task).map(|(_, score, _)| *score).collect();
        let shown = run.run.tasks.iter().find(|shown| shown.task == task.name());
        let shown = shown.and_then(|shown| shown.mean.zip(shown.deviation));
        if shown != mean_and_deviation(&scores) {
            return Err(wrong(format!(
                "the server says {shown:?} for {}, and its journals say {:?}",
                task.name(),
                mean_and_deviation(&scores)
            )));
        }
    }
    Ok(Verified {
        games: checked.len() as u64,
        rounds: checked.iter().map(|(.., rounds)| rounds).sum(),
    })
}

enum GameFault {
    Client(ClientError),
    Wrong(String),
}

impl From<ClientError> for GameFault {
    fn from(error: ClientError) -> Self {
        Self::Client(error)
    }
}

/// Replays one game; returns its task, score, and number of rounds.
async fn check(
    client: &Client,
    planned: &Planned,
    game: &PlannedGame,
    episode: &str,
) -> Result<(TaskName, f64, u64), GameFault> {
    let wrong = |problem: String| GameFault::Wrong(format!("{episode}: {problem}"));
    let shown = client.episode(episode).await?;
    let Some(result) = shown.result else {
        return Err(wrong("it has not ended".to_owned()));
    };
    let head = Head::parse(&result.journal_head)
        .ok_or_else(|| wrong("the server shows no head of its journal".to_owned()))?;
    let journal = client.journal(episode, None).await?;
    let again = move || verify(&*journal, Some(head), Solver::Flow, |_, _| {});
    let report = tokio::task::spawn_blocking(again).await;
    let report = report.unwrap_or_else(|error| std::panic::resume_unwind(error.into_panic()));
    let report = report.map_err(|fault| wrong(format!("its journal does not verify: {fault}")))?;
    let config = report.opening.config.engine().map_err(|error| wrong(error.to_string()))?;
    if report.opening.episode != episode {
        return Err(wrong(format!("its journal is that of {}", report.opening.episode)));
    }
    if config.settings() != planned.suite.settings_of(game) {
        return Err(wrong(format!(
            "it was played with {:?}, and {:?} was planned",
            config.settings(),
            planned.suite.settings_of(game)
        )));
    }
    if report.opening.config.model != planned.name() {
        return Err(wrong(format!("it was played by {:?}", report.opening.config.model)));
    }
    if let Who::Team(team) = &planned.who {
        // A journal whose seats were not held as its opening says does not verify.
        let held = report.opening.config.holders.into_iter();
        let held: Vec<_> = held.map(|of| (of.name, of.model, of.seats)).collect();
        let planned = team.members.iter().map(|of| (of.name.clone(), of.shown(), of.seats.clone()));
        let planned: Vec<_> = planned.collect();
        if held != planned {
            return Err(wrong(format!("it was played by {held:?}, and {planned:?} was planned")));
        }
    }
    let shown = (shown.score, result.score, result.rounds);
    if shown != (report.score, report.score, report.rounds) {
        return Err(wrong(format!(
            "the server says {shown:?}, and played again it comes to {} in {} rounds",
            report.score, report.rounds
        )));
    }
    Ok((config.task(), report.score, report.rounds.into()))
}
