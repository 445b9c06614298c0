//! Episodes to play, and the connections for them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use tokio::task::JoinSet;

use super::connection::{Connection, Tally, Target, request};
use super::{LoadError, Progress};
use swarmbench_protocol::episode::{CreatedEpisode, EpisodeRequest};

/// Seats of an episode in the standard setting.
pub(crate) const SEATS: usize = 12;

/// Concurrent connections that create and abort episodes, or open other connections.
const CREATORS: usize = 64;

/// A task in which no agent can leave and no act ends the game early, so that every seat acts in every round; there
/// is only one.
const TASK: &str = "Synchronization";

/// An episode and its tokens.
#[derive(Clone, Debug)]
pub(crate) struct LoadGame {
    /// The episode's id.
    pub(crate) id: String,
    /// The token of all seats.
    pub(crate) swarm_token: String,
    /// The token of each seat, in the order of the agents.
    pub(crate) seats: Vec<String>,
}

/// Creates `count` episodes of `agents` seats, which end after `max_round` rounds. Refused episodes are missing, and
/// counted as errors.
pub(crate) async fn create(
    target: &Target,
    tally: &Arc<Tally>,
    count: usize,
    agents: usize,
    max_round: u32,
    progress: &Progress,
) -> Vec<LoadGame> {
    // Each agent gets at least as many cells as in the standard setting.
    let side = (10..256).find(|side| side * side >= agents * 25 / 2).unwrap_or(256);
    let side = if agents <= SEATS { 10 } else { side };
    let settings = EpisodeRequest {
        task: Some(TASK.to_owned()),
        num_agents: i64::try_from(agents).ok(),
        width: i64::try_from(side).ok(),
        height: i64::try_from(side).ok(),
        max_round: Some(max_round.into()),
        model: Some("swarmbench loadtest".to_owned()),
        ..EpisodeRequest::default()
    };
    let json = serde_json::to_string(&settings).expect("string keys");
    let call = request(target, "POST", "/api/v1/episodes", target.key(), Some(&json));
    let created = for_all(target, 0..count, ("creating episodes", progress), {
        let (tally, call) = (Arc::clone(tally), Arc::new(call));
        move |mut connection, _| {
            let (tally, call) = (Arc::clone(&tally), Arc::clone(&call));
            async move {
                let mut game = None;
                if connection.call(&tally, &call).await {
                    game = connection.read_json::<CreatedEpisode>(&tally);
                }
                (connection, game)
            }
        }
    });
    let games = created.await.into_iter().map(|created| LoadGame {
        id: created.id,
        swarm_token: created.swarm_token,
        seats: created.seats.into_iter().map(|seat| seat.token).collect(),
    });
    games.collect()
}

/// The first game; without games, an error with an answer of the server.
pub(super) fn first<'a>(games: &'a [LoadGame], tally: &Tally) -> Result<&'a LoadGame, LoadError> {
    games.first().ok_or_else(|| {
        let samples = tally.answers().samples;
        LoadError::of("no episode to play")(&samples.first().map_or("none", String::as_str))
    })
}

/// Aborts unfinished episodes, so that the server can evict them.
pub(crate) async fn abort(
    target: &Target,
    tally: &Arc<Tally>,
    games: &[LoadGame],
    progress: &Progress,
) {
    let calls: Vec<_> = (games.iter())
        .map(|game| {
            let path = format!("/api/v1/episodes/{}", game.id);
            request(target, "DELETE", &path, Some(&game.swarm_token), None)
        })
        .collect();
    for_all(target, calls, ("aborting episodes", progress), {
        let tally = Arc::clone(tally);
        move |mut connection, call| {
            let tally = Arc::clone(&tally);
            async move {
                connection.call(&tally, &call).await;
                (connection, Some(()))
            }
        }
    })
    .await;
}

/// Opens connections, several at once, so that later measurements do not include the time for this.
pub(crate) async fn connect(
    target: &Target,
    count: usize,
    progress: &Progress,
) -> Result<Vec<Connection>, LoadError> {
    let opened = for_all(target, 0..count, ("opening connections", progress), {
        let target = target.clone();
        move |shared, _| {
            let mut connection = Connection::new(&target);
            async move {
                let opened = connection.open().await.map(|_| ()).map(|()| connection);
                (shared, Some(opened))
            }
        }
    });
    let opened: Result<Vec<_>, _> = opened.await.into_iter().collect();
    opened.map_err(|error| LoadError::of("a connection cannot be opened")(&error))
}

/// Calls `work` for every item, from a fixed number of tasks with a connection each.
async fn for_all<I, T, F, D>(
    target: &Target,
    items: impl IntoIterator<Item = I>,
    (what, progress): (&'static str, &Progress),
    work: F,
) -> Vec<T>
where
    I: Send + 'static,
    T: Send + 'static,
    F: Fn(Connection, I) -> D + Clone + Send + 'static,
    D: Future<Output = (Connection, Option<T>)> + Send,
{
    let mut shares: Vec<Vec<I>> = (0..CREATORS).map(|_| Vec::new()).collect();
    let mut of = 0;
    for (place, item) in items.into_iter().enumerate() {
        shares[place % CREATORS].push(item);
        of += 1;
    }
    let done = Arc::new(AtomicU64::new(0));
    let mut tasks = JoinSet::new();
    for share in shares.into_iter().filter(|share| !share.is_empty()) {
        let (work, done, progress) = (work.clone(), Arc::clone(&done), Arc::clone(progress));
        let mut connection = Connection::new(target);
        tasks.spawn(async move {
            let mut results = Vec::with_capacity(share.len());
            for item in share {
                let (after, result) = work(connection, item).await;
                connection = after;
                results.extend(result);
                progress(what, done.fetch_add(1, Ordering::Relaxed) + 1, of);
            }
            results
        });
    }
    tasks.join_all().await.into_iter().flatten().collect()
}
