//! Creations by the thousand.

use std::io;
use std::sync::Arc;

use serde_json::{Value, json};

use super::shapes::TEMPLATES;
use super::{Addresses, Ctx, hammer, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::Request;

/// Games that end at once, new tokens for the same game and the same run, entries with templates that are long to read.
pub(super) async fn storms(ctx: Arc<Ctx>) -> io::Result<()> {
    let member = ctx.brief.member.clone();
    let game = json!({ "task": "Synchronization", "num_agents": 12, "model": "storm", "player": "default", "max_round": 1 });
    let run = json!({ "suite": "quick", "model": "storm", "parallel": 1 });
    let mut wire = ctx.wire(Addresses::One, 0).keeping_all();
    let started = ctx.insist(&mut wire, &Request::post("/api/v1/runs", &run).with(&member)).await?;
    let run = text(&started.read::<Value>()?, "/id")?;
    let same = json!({ "task": "Synchronization", "num_agents": 1_024, "width": 64, "height": 64, "model": "same" });
    let same = Request {
        head: "idempotency-key: same\r\n".to_owned(),
        ..Request::post("/api/v1/episodes", &same)
    };
    let token = Request { method: "POST", ..Request::get(format!("/api/v1/runs/{run}/token")) };
    let requests = [Request::post("/api/v1/episodes", &game), same, token]
        .map(|request| request.with(&member));
    let template = TEMPLATES.last().map(|shape| shape.of(usize::MAX, 32 * 1024));
    let enter = format!("/api/v1/competitions/{}/entrants", ctx.brief.open_cup);
    ctx.go().await;
    on_connections(ctx.of(12, 40), |number| {
        let (request, template) = (requests.get(number % 4).cloned(), template.clone());
        let enter = enter.clone();
        let entry = move |again| {
            let body = json!({ "name": format!("storm {number} {again}"), "model": "storm", "prompt_template": template });
            request.clone().unwrap_or_else(|| Request::post(&*enter, &body))
        };
        // An address may enter a hundred times an hour: the host itself may always.
        hammer(ctx.wire(Addresses::Host, number), entry, ctx.at.clone())
    })
    .await;
    Ok(())
}
