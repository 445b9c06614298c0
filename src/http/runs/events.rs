//! `GET /api/v1/runs/{id}/events`: the games of a run as they are opened and end, as Server-Sent Events.

use std::collections::HashMap;

use tokio::sync::watch;

use super::super::feed::{Events, Feed, feed};
use super::super::prelude::*;
use super::super::seeds::SeedPermit;
use crate::run::manager::OpenGames;
use swarmbench_protocol::run::StreamedRunEvent;

/// Watch a run (Server-Sent Events).
///
/// Each game has a `game` event when it is opened, and another when it has ended or was voided; the stream begins with the
/// games that exist already. The last event is `finished` when the run is over, with the whole run. The rounds of a game are in
/// the events of its episode.
#[utoipa::path(
    get,
    path = "/api/v1/runs/{id}/events",
    operation_id = "stream_run_events",
    tag = "runs",
    responses((status = 200, description = "Events: `game` with a RunGame as data, `finished` with a RunDetail", body = StreamedRunEvent, content_type = "text/event-stream"))
)]
pub(in super::super) async fn stream_run_events(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Events, ApiError> {
    let known = app.known_run(&caller, &id).await?;
    let seeds = known.seeds(&app, &caller).await?;
    let open_games = app.runs.follow(known.stored.run).await?;
    let (feed, events) = feed(&app, &caller)?;
    crate::telemetry::spawn(async move {
        tokio::select! {
            sent = send_events(&app, &caller, (&id, seeds), open_games, &feed) => {
                if let Err(error) = sent {
                    tracing::warn!(?error, "events of a run cannot be sent");
                }
            }
            () = feed.gone() => {}
            () = app.stop.cancelled() => {}
        }
    });
    Ok(events)
}

/// Sends the state of every game, and its changes, until the run is over. Ends early where the reader is
/// too slow.
async fn send_events(
    app: &App,
    caller: &Caller,
    (id, seeds): (&str, SeedPermit),
    mut open_games: watch::Receiver<OpenGames>,
    feed: &Feed,
) -> Result<(), ApiError> {
    let mut sent: HashMap<String, (String, bool)> = HashMap::new();
    loop {
        // Later changes are sent by the next iteration.
        let is_over = open_games.borrow_and_update().is_over;
        let known = app.known_run(caller, id).await?;
        let seeds = seeds.or(known.open_seeds(app, caller));
        let shown = app.run_detail(caller, &known, seeds).await?;
        for game in &shown.games {
            let Some(episode) = &game.episode else { continue };
            let state = (game.status.clone(), game.void_reason.is_some());
            if sent.get(episode) == Some(&state) {
                continue;
            }
            if !feed.send("game", None, game).await {
                return Ok(());
            }
            sent.insert(episode.clone(), state);
        }
        if is_over {
            feed.send("finished", None, &shown).await;
            return Ok(());
        }
        drop((known, shown));
        if open_games.changed().await.is_err() {
            return Ok(());
        }
    }
}
