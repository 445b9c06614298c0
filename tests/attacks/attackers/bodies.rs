//! Bodies that are dear to read, from those who may not even ask.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use serde_json::json;
use tokio::time::sleep;

use super::games::mcp_look;
use super::shapes::{JSON, unknown_fields};
use super::{Addresses, Ctx, hammer, on_connections};
use crate::attacks::wire::Request;

/// Bytes of a body that is just light, and of one that is large.
const LIGHT_BYTES: usize = 130_000;
const LARGE_BYTES: usize = 250_000;

/// A token that opens nothing.
const UNKNOWN: &str = "swarm_0000000000000000000000000000000000000000000000000000";

/// One address sends requests to `/mcp` without a token, or with one that opens nothing.
pub(super) async fn mcp_flood(ctx: Arc<Ctx>) -> io::Result<()> {
    let look = mcp_look(0, &JSON[0].of(usize::MAX, LIGHT_BYTES));
    ctx.go().await;
    on_connections(ctx.of(100, 300), |number| {
        let look = if number % 2 == 0 { look.clone() } else { look.clone().with(UNKNOWN) };
        hammer(ctx.wire(Addresses::One, number), move |_| look.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}

/// Bodies without a token, or to what does not exist: tiny values, unknown fields, as much as a swarm may send.
pub(super) async fn body_flood(ctx: Arc<Ctx>) -> io::Result<()> {
    let entrants = |cup: &str| format!("/api/v1/competitions/{cup}/entrants");
    let values = |bytes| JSON[0].of(usize::MAX, bytes);
    let swarm = Request::post_text("/swarm/act", " ".repeat(8 * 1024 * 1024 - 1));
    let requests = [
        Request::post_text(entrants("NOPE"), values(LIGHT_BYTES)),
        Request::post_text("/api/v1/episodes", values(LIGHT_BYTES)),
        Request::post_text(entrants(&ctx.brief.cup), unknown_fields(14_000)),
        Request::post_text("/api/v1/runs", unknown_fields(14_000)),
        Request::post_text(entrants("NOPE"), values(LARGE_BYTES)),
        Request::post_text(entrants(&ctx.brief.cup), unknown_fields(26_000)),
        swarm.with(UNKNOWN),
    ];
    let addresses = ctx.addresses("body_flood");
    ctx.go().await;
    on_connections(ctx.of(210, 700), |number| {
        let request = requests[number % requests.len()].clone();
        hammer(ctx.wire(addresses, number), move |_| request.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}

/// Entrants send acts that are none: as much as a swarm may send, of tiny values.
pub(super) async fn no_acts(ctx: Arc<Ctx>) -> io::Result<()> {
    let mut tokens = Vec::new();
    for number in 0..4 {
        let mut wire = ctx.wire(Addresses::Many, number);
        let body = json!({ "name": format!("no acts {number}"), "model": "much" });
        let key = ctx.enter(&mut wire, &ctx.brief.cup, &body).await?;
        tokens.push(ctx.start(&mut wire, &ctx.brief.cup, &key).await?);
    }
    let acts = Request::post_text("/swarm/act", JSON[0].of(usize::MAX, 8_000_000));
    ctx.go().await;
    on_connections(16, |number| {
        let acts = acts.clone().with(&tokens[number % tokens.len()]);
        hammer(ctx.wire(Addresses::Many, number), move |_| acts.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}

/// Entries with as much as they may have, and erasures, from those who hang up at once.
pub(super) async fn hang_ups(ctx: Arc<Ctx>) -> io::Result<()> {
    let meta = JSON[0].of(usize::MAX, 16 * 1024);
    let template = "x".repeat(32 * 1024);
    let entrants = format!("/api/v1/competitions/{}/entrants", ctx.brief.cup);
    let erase = Request { method: "DELETE", ..Request::get(format!("{entrants}/nobody")) };
    ctx.go().await;
    on_connections(64, |number| {
        let (ctx, meta, template) = (Arc::clone(&ctx), meta.clone(), template.clone());
        let (entrants, erase) = (entrants.clone(), erase.clone());
        async move {
            for again in 0.. {
                // After a hundred entries they are refused, once their turn has come.
                let mut wire = ctx.wire(Addresses::Many, number % 32);
                let body = format!(
                    "{{\"name\":\"gone {number} {again}\",\"model\":\"gone\",\"agent_meta\":{meta},\"prompt_template\":\"{template}\"}}"
                );
                let enter = Request::post_text(&*entrants, body);
                let is_sent = wire.send(if again % 2 == 0 { &enter } else { &erase }).await;
                ctx.tally.count(if is_sent.is_ok() { "sent, and hung up" } else { "broken" });
                sleep(Duration::from_millis(5)).await;
            }
        }
    })
    .await;
    Ok(())
}
