//! Connections: as many as there are, and slow ones.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::sleep;

use super::{Addresses, Ctx, on_connections};
use crate::attacks::wire::{Request, Wire};

/// Bytes of a body of which only a few come.
const BODY_BYTES: usize = 10_000;

/// One client behind the trusted proxy opens connections until there are none left, and keeps each by one means or
/// another: idle after an answer, waiting for nothing, sending a body byte by byte.
pub(super) async fn connections(ctx: Arc<Ctx>) -> io::Result<()> {
    ctx.go().await;
    on_connections(ctx.of(1_100, 1_500), |number| {
        let ctx = Arc::clone(&ctx);
        async move {
            // They come one after the other.
            sleep(Duration::from_millis(number as u64)).await;
            loop {
                let mut wire = ctx.wire(Addresses::One, number);
                // Making answers is not what is attacked here, so few ask for large ones.
                let kept = match number % 20 {
                    0 => unread(&mut wire).await,
                    1..8 => dribbled_body(&mut wire, &ctx.brief.cup).await,
                    _ => idle(&mut wire).await,
                };
                if kept.is_err() {
                    ctx.tally.count("cut");
                }
                sleep(Duration::from_millis(200)).await;
            }
        }
    })
    .await;
    Ok(())
}

async fn idle(wire: &mut Wire) -> io::Result<()> {
    loop {
        let answer = wire.ask(&Request::get("/healthz")).await?;
        sleep(if answer.is_ok() { Duration::from_secs(20) } else { Duration::from_secs(1) }).await;
    }
}

/// An entry whose body comes a byte now and then.
pub(super) async fn dribbled_body(wire: &mut Wire, cup: &str) -> io::Result<()> {
    let path = format!("/api/v1/competitions/{cup}/entrants");
    let bytes = Request::post_text(path, " ".repeat(BODY_BYTES)).bytes(wire.source);
    let (head, body) = bytes.split_at(bytes.len() - BODY_BYTES);
    wire.send_bytes(head).await?;
    for byte in body.chunks(1) {
        wire.send_bytes(byte).await?;
        sleep(Duration::from_millis(500)).await;
    }
    Ok(())
}

async fn unread(wire: &mut Wire) -> io::Result<()> {
    wire.open(Some(2_048)).await?;
    loop {
        wire.send(&Request::get("/openapi.json")).await?;
        sleep(Duration::from_secs(4)).await;
    }
}
