//! Lists of large items, and requests that are kept open by the hundred.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use serde_json::json;
use tokio::time::sleep;

use super::connections::dribbled_body;
use super::{Ctx, hammer, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::Request;

/// Lists of episodes with much told of each, streams of events that nobody reads, long polls, slow bodies.
pub(super) async fn lists(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("lists");
    let mut games = Vec::new();
    let body = json!({ "task": "Synchronization", "num_agents": 2, "model": "long", "visibility": "public",
                       "agent_meta": { "text": "m".repeat(16_000) }, "prompt_template": "t".repeat(32_000) });
    for number in 0..ctx.of(60, 1_000) {
        if number > 0 && !ctx.has_time() {
            break;
        }
        let created = ctx.create(&body).await?;
        games.push((text(&created, "/id")?, text(&created, "/seats/0/token")?));
    }
    ctx.note(format!("{} episodes", games.len()));
    ctx.go().await;
    let lists = on_connections(ctx.of(6, 20), |number| {
        let list = Request::get("/api/v1/episodes?limit=1000&model=long");
        hammer(ctx.wire(addresses, number), move |_| list.clone(), ctx.at.clone())
    });
    let polls = on_connections(ctx.of(200, 2_000), |number| {
        let (_, seat) = &games[number % games.len()];
        let poll = Request::get("/obs?after=0&wait=60&prompt=true").with(seat);
        hammer(ctx.wire(addresses, number), move |_| poll.clone(), ctx.at.clone())
    });
    let streams = on_connections(ctx.of(100, 600), |number| {
        let stream =
            Request::get(format!("/api/v1/episodes/{}/events", games[number % games.len()].0));
        let ctx = Arc::clone(&ctx);
        async move {
            loop {
                let mut wire = ctx.wire(addresses, number);
                let sent = async {
                    wire.open(Some(2_048)).await?;
                    wire.send(&stream).await
                };
                ctx.tally.count(if sent.await.is_ok() { "a stream, not read" } else { "broken" });
                sleep(Duration::from_secs(30)).await;
            }
        }
    });
    let bodies = on_connections(ctx.of(40, 200), |number| {
        let ctx = Arc::clone(&ctx);
        async move {
            loop {
                let mut wire = ctx.wire(addresses, number);
                if dribbled_body(&mut wire, &ctx.brief.cup).await.is_err() {
                    ctx.tally.count("cut");
                }
                sleep(Duration::from_millis(100)).await;
            }
        }
    });
    tokio::join!(lists, polls, streams, bodies);
    Ok(())
}
