//! Memory for little: heads and bodies that are held open, and JSON that is carried along.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use serde_json::json;
use tokio::time::sleep;

use super::games::{mcp_look, waiting_seat};
use super::shapes::JSON;
use super::{Addresses, Ctx, hammer, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::{Request, Wire};

/// Bytes that `agent_meta` may have.
const META_BYTES_MAX: usize = 16 * 1024;

/// Bytes of a body that is handled on the threads on which games run.
const LIGHT_BODY_BYTES_MAX: usize = 128 * 1024;

/// Bytes of a body that needs no memory of its own.
const SHORT_BODY_BYTES: usize = 8 * 1024;

/// Bytes of the headers of a request, of which a connection's buffer takes no more.
const HEAD_BYTES: usize = 62_000;

/// Connections on which games are made.
const MAKERS: usize = 8;

/// Claims of seats in one game, each with JSON of its own.
const CLAIMS: usize = 50;

/// Entries, games with clocks and claims of their seats carry JSON of all shapes; a server that starts again meets all of them at once.
pub(super) async fn carried_json(ctx: Arc<Ctx>) -> io::Result<()> {
    let made = Arc::new(AtomicUsize::new(0));
    let (entrants, games) = (ctx.of(40, 200), ctx.of(200, 600));
    on_connections(MAKERS, |number| {
        let (ctx, made) = (Arc::clone(&ctx), Arc::clone(&made));
        async move {
            let mut wire = ctx.wire(Addresses::Many, number);
            for one in (number..entrants + games).step_by(MAKERS).take_while(|_| ctx.has_time()) {
                // Most of them have the shape that takes the most.
                let shape = if one % 2 == 0 { 0 } else { one / 2 % JSON.len() };
                let parts = if shape + 1 == JSON.len() { 120 } else { META_BYTES_MAX };
                let meta = JSON[shape].of(parts, META_BYTES_MAX);
                wire.source = Ctx::source(Addresses::Many, one);
                let is_made = if one < entrants {
                    let body = format!("{{\"name\":\"much {one}\",\"model\":\"much\",\"agent_meta\":{meta}}}");
                    enter_and_start(&ctx, &mut wire, body).await
                } else {
                    let body = format!(
                        "{{\"task\":\"Synchronization\",\"num_agents\":2,\"round_deadline_s\":600,\"agent_meta\":{meta}}}"
                    );
                    let create = Request::post_text("/api/v1/episodes", body).with(&ctx.brief.member);
                    ctx.insist(&mut wire, &create).await.is_ok_and(|answer| answer.is_ok())
                };
                made.fetch_add(usize::from(is_made), Ordering::SeqCst);
            }
        }
    })
    .await;
    let open = json!({ "task": "Synchronization", "num_agents": CLAIMS, "open_seats": CLAIMS, "width": 32, "height": 32,
                       "round_deadline_s": 600 });
    let game = text(&ctx.create(&open).await?, "/id")?;
    let meta = JSON[0].of(usize::MAX, META_BYTES_MAX);
    let claim = format!("{{\"model\":\"much\",\"agent_meta\":{meta}}}");
    let claim = Request::post_text(format!("/api/v1/episodes/{game}/claims"), claim);
    let claim = claim.with(&ctx.brief.member);
    let mut wire = ctx.wire(Addresses::Many, 0);
    for _ in 0..CLAIMS {
        made.fetch_add(usize::from(ctx.insist(&mut wire, &claim).await?.is_ok()), Ordering::SeqCst);
    }
    ctx.note(format!("{} entrants, games and claims were made", made.load(Ordering::SeqCst)));
    ctx.go().await;
    on_connections(MAKERS, |number| {
        let list = Request::get("/api/v1/episodes?limit=1000").with(&ctx.brief.member);
        hammer(ctx.wire(Addresses::Many, number), move |_| list.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}

async fn enter_and_start(ctx: &Ctx, wire: &mut Wire, body: String) -> bool {
    let cup = &ctx.brief.cup;
    let enter = Request::post_text(format!("/api/v1/competitions/{cup}/entrants"), body);
    let entered = ctx.insist(wire, &enter).await.and_then(|answer| answer.read());
    let entered: serde_json::Value = entered.unwrap_or_default();
    match entered["key"].as_str() {
        Some(key) => ctx.start(wire, cup, key).await.is_ok(),
        None => false,
    }
}

/// Looks by `/mcp` wait, each with as much beside its arguments as a body may have, or a short one, or with a long id.
pub(super) async fn waiting_meta(ctx: Arc<Ctx>) -> io::Result<()> {
    let seat = waiting_seat(&ctx).await?;
    let look = mcp_look(0, "{}").with(&seat);
    ctx.wire(Addresses::Many, 0).ask(&look).await?.read::<serde_json::Value>()?;
    ctx.go().await;
    on_connections(1_200, |number| {
        let bytes = if number % 4 == 0 { LIGHT_BODY_BYTES_MAX } else { SHORT_BODY_BYTES };
        let meta = JSON[number / 4 % 2].of(usize::MAX, bytes - 300);
        let mut look = mcp_look(45, &meta).with(&seat);
        if number % 8 == 1 {
            // The id comes back with the answer.
            let id = format!("\"{}\"", "x".repeat(LIGHT_BODY_BYTES_MAX - 400));
            look = mcp_look(45, "{}").with(&seat);
            look.body = look.body.map(|body| body.replacen("\"id\":1", &format!("\"id\":{id}"), 1));
        }
        hammer(ctx.wire(Addresses::Many, number), move |_| look.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}

/// Requests with heads as large as they may be, held open: by waiting for an answer, or without their last line.
pub(super) async fn heads(ctx: Arc<Ctx>) -> io::Result<()> {
    let seat = waiting_seat(&ctx).await?;
    let one = format!("x-one: {}\r\n", "x".repeat(HEAD_BYTES));
    let many: Vec<_> =
        (0..90).map(|number| format!("x-{number}: {}\r\n", "x".repeat(680))).collect();
    let lines = [one, many.concat()];
    let addresses = ctx.of(64, 256);
    ctx.go().await;
    on_connections(9_000, |number| {
        let (ctx, seat) = (Arc::clone(&ctx), seat.clone());
        let head = &lines[number % lines.len()];
        // Some of them are as long as a server may take that takes less.
        let head = if number % 3 == 0 { shortened(head) } else { head.clone() };
        async move {
            loop {
                let mut wire = ctx.wire(Addresses::Many, number % addresses);
                let look = Request { head: head.clone(), ..Request::get("/obs?after=0&wait=60") };
                let bytes = look.with(&seat).bytes(wire.source);
                // One in four does not end.
                let sent = bytes.len() - if number % 4 == 3 { 2 } else { 0 };
                hold(&ctx, &mut wire, &bytes[..sent]).await;
            }
        }
    })
    .await;
    Ok(())
}

/// A quarter of the bytes of some headers, in as many lines.
fn shortened(head: &str) -> String {
    head.lines().flat_map(|line| [&line[..line.len() / 4], "\r\n"]).collect()
}

/// Sends bytes and waits until something comes, or the connection is closed.
async fn hold(ctx: &Ctx, wire: &mut Wire, bytes: &[u8]) {
    let is_sent = wire.send_bytes(bytes).await.is_ok();
    let is_held = is_sent && wire.read_some(1).await.is_ok_and(|read| read > 0);
    ctx.tally.count(if is_held { "answered" } else { "cut" });
    // Connecting again and again is another attack.
    sleep(Duration::from_secs(2)).await;
}

/// Bytes of a body without a token, and of the acts of a swarm.
const ANONYMOUS_BODY_BYTES_MAX: usize = 64 * 1024;
const SWARM_BODY_BYTES_MAX: usize = 8 * 1024 * 1024;

/// Bodies as large as they may be, with and without a token, of which the last bytes come one by one.
pub(super) async fn unfinished_bodies(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = *ctx.dice("addresses").pick(&[1, 4, 32]);
    ctx.note(format!("{addresses} addresses"));
    let cup = &ctx.brief.cup;
    let mut wire = ctx.wire(Addresses::Many, 0);
    let key = ctx.enter(&mut wire, cup, &json!({ "name": "unfinished", "model": "much" })).await?;
    let token = ctx.start(&mut wire, cup, &key).await?;
    let enter = Request::get(format!("/api/v1/competitions/{cup}/entrants"));
    let act = Request::get("/swarm/act").with(&token);
    ctx.go().await;
    on_connections(ctx.of(2_400, 4_000), |number| {
        let ctx = Arc::clone(&ctx);
        let (request, length) = match number {
            _ if number % 2 == 0 => (&enter, ANONYMOUS_BODY_BYTES_MAX),
            _ if number % 64 == 1 => (&act, SWARM_BODY_BYTES_MAX),
            _ => (&act, LIGHT_BODY_BYTES_MAX + number / 2 % 2),
        };
        let request = request.clone();
        async move {
            loop {
                let mut wire = ctx.wire(Addresses::Many, number % addresses);
                if unfinished(&mut wire, &request, length, number % 3 == 0).await.is_err() {
                    ctx.tally.count("cut");
                }
                sleep(Duration::from_millis(200)).await;
            }
        }
    })
    .await;
    Ok(())
}

async fn unfinished(
    wire: &mut Wire,
    request: &Request,
    length: usize,
    is_chunked: bool,
) -> io::Result<()> {
    let about_length = if is_chunked {
        "transfer-encoding: chunked".to_owned()
    } else {
        format!("content-length: {length}")
    };
    let head = format!("content-type: application/json\r\n{about_length}\r\n");
    let whole = Request { method: "POST", head, ..request.clone() };
    wire.send_bytes(&whole.bytes(wire.source)).await?;
    if is_chunked {
        wire.send_bytes(format!("{length:x}\r\n").as_bytes()).await?;
    }
    wire.send_bytes(&vec![b' '; length - 100]).await?;
    for _ in 0..99 {
        wire.send_bytes(b" ").await?;
        sleep(Duration::from_secs(1)).await;
    }
    Ok(())
}
