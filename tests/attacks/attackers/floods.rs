//! Acts with as much text as they may have.

use std::fmt::Write as _;
use std::io;
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::sleep;

use super::{Ctx, on_connections};
use crate::attacks::wire::{Request, Wire};

/// Acts in one body: as many as fit.
const ACTS: usize = 36;

/// Anonymous entrants write long reasons as fast as they can.
pub(super) async fn journal_flood(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("journal_flood");
    let dice = ctx.dice("cup");
    let cups = [ctx.brief.cup.as_str(), ctx.brief.open_cup.as_str()];
    let cup = dice.pick(&cups);
    let mut tokens = Vec::new();
    for number in 0..4 {
        let mut wire = ctx.wire(addresses, number);
        let body = json!({ "name": format!("flood {number}"), "model": "much" });
        let key = ctx.enter(&mut wire, cup, &body).await?;
        tokens.push(ctx.start(&mut wire, cup, &key).await?);
    }
    let bytes = 150_000 + ctx.dice("bytes").below(60_000);
    ctx.go().await;
    on_connections(tokens.len(), |number| {
        let wire = ctx.wire(addresses, number);
        flood(wire.keeping_all(), tokens[number].clone(), bytes)
    })
    .await;
    Ok(())
}

async fn flood(mut wire: Wire, token: String, bytes: usize) {
    let reasoning = "because ".repeat(bytes / 8);
    let look = Request::get(format!("/swarm/obs?limit={ACTS}")).with(&token);
    loop {
        let Ok(seen) = wire.ask(&look).await.and_then(|answer| answer.read::<Value>()) else {
            sleep(Duration::from_millis(200)).await;
            continue;
        };
        if seen["finished"] == true {
            return;
        }
        let seats = seen["observations"].as_array().map_or(&[][..], Vec::as_slice);
        let mut body = String::from("{\"acts\":[");
        for (place, seat) in seats.iter().enumerate() {
            let comma = if place == 0 { "" } else { "," };
            write!(
                body,
                "{comma}{{\"episode\":{},\"agent\":{},\"round\":{},\"action\":\"STAY\",\"reasoning\":\"{reasoning}\"}}",
                seat["episode"], seat["agent"], seat["round"]
            )
            .expect("a string takes all text");
        }
        body.push_str("]}");
        let act = Request::post_text("/swarm/act", body);
        if seats.is_empty() || wire.ask(&act.with(&token)).await.is_err() {
            sleep(Duration::from_millis(50)).await;
        }
    }
}
