//! Readers of what is large or dear: journals, exports and receipts a few bytes a second, and states of rounds long ago.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use serde_json::json;
use tokio::time::sleep;

use super::games::{Large, acts_of_all};
use super::{Addresses, Ctx, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::Request;

/// Bytes that the host takes for a reader that does not read; it makes it a little more.
const WINDOW_BYTES: usize = 2_048;

/// A game with much text, whose journal has 14 MB in a long run.
async fn much_text(ctx: &Ctx, addresses: Addresses) -> io::Result<String> {
    let (agents, rounds) = (12, ctx.of(4, 6));
    let body = json!({ "task": "Synchronization", "num_agents": agents, "max_round": rounds, "model": "much",
                       "visibility": "public" });
    let created = ctx.create(&body).await?;
    let (episode, token) = (text(&created, "/id")?, text(&created, "/swarm_token")?);
    let mut wire = ctx.wire(addresses, 0);
    let reasoning = "because ".repeat(22_000);
    for round in 0..rounds {
        let act = acts_of_all(&episode, agents, round, Some(&reasoning)).with(&token);
        ctx.insist(&mut wire, &act).await?;
    }
    Ok(episode)
}

/// After so many refusals an attacker has tried.
const REFUSALS: usize = 5;

/// Journals and exports of a game with much text are read a byte a second.
pub(super) async fn slow_readers(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("slow_readers");
    let episode = much_text(&ctx, addresses).await?;
    ctx.go().await;
    on_connections(ctx.of(48, 120), |number| {
        let paths = [
            format!("/api/v1/episodes/{episode}/journal"),
            format!("/api/v1/exports/acts.jsonl?episode={episode}"),
            format!("/api/v1/episodes/{episode}/journal"),
            format!("/api/v1/exports/dataset.zip?episode={episode}"),
        ];
        let path = ctx.dice(&format!("reader {number}")).pick(&paths).clone();
        read_slowly(Arc::clone(&ctx), addresses, number, (Request::get(path), 1), || ())
    })
    .await;
    Ok(())
}

/// Asks for something and reads so much of it a second, again and again; `tried` is called when an answer begins, or was
/// refused a few times.
async fn read_slowly(
    ctx: Arc<Ctx>,
    addresses: Addresses,
    number: usize,
    (request, bytes_per_s): (Request, usize),
    tried: impl FnOnce(),
) {
    let (mut tried, mut refused) = (Some(tried), 0);
    loop {
        let mut wire = ctx.wire(addresses, number);
        let read = async {
            wire.open(Some(WINDOW_BYTES.max(bytes_per_s / 2))).await?;
            wire.send(&request).await?;
            let is_ok = wire.is_ok().await?;
            refused += usize::from(!is_ok);
            if is_ok || refused == REFUSALS {
                tried.take().into_iter().for_each(|tried| tried());
            }
            ctx.tally.count(if is_ok { "read slowly" } else { "refused" });
            let mut is_open = is_ok;
            while is_open {
                let mut left = bytes_per_s;
                while left > 0 && is_open {
                    let read = wire.read_some(left).await?;
                    (left, is_open) = (left - read, read > 0);
                }
                sleep(Duration::from_secs(1)).await;
            }
            io::Result::Ok(())
        };
        if read.await.is_err() {
            ctx.tally.count("cut");
        }
        sleep(Duration::from_millis(200)).await;
    }
}

/// Seats of a game whose prompts make an answer of 6 MB.
const TALKATIVE: usize = 200;

/// Bytes a second of a reader that is a little faster than the slowest that is not cut off.
const SLOW_BYTES_PER_S: usize = 5_000;

/// The acts of a round are sent again and again, each time with the next prompts of all seats as the answer, which is hardly read.
pub(super) async fn unread_acts(ctx: Arc<Ctx>) -> io::Result<()> {
    let body = json!({ "task": "Synchronization", "num_agents": TALKATIVE, "width": 32, "height": 32, "memory": 0,
                       "max_round": 3, "prompt_template": "x".repeat(32 * 1024) });
    let create = Request::post("/api/v1/episodes", &body).with(&ctx.brief.member);
    let created = ctx.insist(&mut ctx.wire(Addresses::Many, 0), &create).await?.read()?;
    let (episode, token) = (text(&created, "/id")?, text(&created, "/swarm_token")?);
    let mut act = acts_of_all(&episode, TALKATIVE, 0, None).with(&token);
    act.path.push_str("?wait=1&prompt=true");
    ctx.insist(&mut ctx.wire(Addresses::Many, 0), &act).await?;
    ctx.go().await;
    on_connections(ctx.of(200, 400), |number| {
        let request = (act.clone(), SLOW_BYTES_PER_S);
        read_slowly(Arc::clone(&ctx), Addresses::Many, number, request, || ())
    })
    .await;
    Ok(())
}

/// Addresses that take all streams of events together.
const WATCHERS: usize = 8;

/// Bytes a second that a reader takes who is not cut off: the host buffers some MB for a reader, and asks for more when a
/// third of them is taken.
const BYTES_PER_S: usize = 150_000;

/// More streams of events, and more exports, than there may be.
const STREAMS: usize = 4_200;
const EXPORTS: usize = 20;

/// Eight addresses take all streams of events, and twenty others all exports.
pub(super) async fn all_streams(ctx: Arc<Ctx>) -> io::Result<()> {
    let much = much_text(&ctx, Addresses::Many).await?;
    let body = json!({ "task": "Synchronization", "num_agents": 2, "model": "watched", "visibility": "public" });
    let watched = text(&ctx.create(&body).await?, "/id")?;
    ctx.go().await;
    on_connections(EXPORTS + STREAMS, |number| {
        let (address, path) = match number.checked_sub(EXPORTS) {
            None => (WATCHERS + number, format!("/api/v1/exports/acts.jsonl?episode={much}")),
            Some(number) => (number % WATCHERS, format!("/api/v1/episodes/{watched}/events")),
        };
        let of = Arc::clone(&ctx);
        let tried = move || of.take_one(EXPORTS + STREAMS);
        let request = (Request::get(path), BYTES_PER_S);
        read_slowly(Arc::clone(&ctx), Addresses::Many, address, request, tried)
    })
    .await;
    Ok(())
}

/// States of early rounds of a large game are asked for by many who do not wait for them.
pub(super) async fn old_states(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("old_states");
    let agents = ctx.of(64, 256);
    let mut game = Large::create(&ctx, "Flocking", agents, ctx.of(32, 64), None).await?;
    let rounds = game.play(&ctx, ctx.of(6, 31), Duration::from_mins(1)).await?;
    ctx.note(format!("{rounds} rounds of {agents} agents were played"));
    ctx.go().await;
    on_connections(ctx.of(10, 60), |number| {
        let (ctx, episode) = (Arc::clone(&ctx), game.episode.clone());
        async move {
            for again in 0.. {
                let dice = ctx.dice(&format!("state {number} {again}"));
                let round = rounds.saturating_sub(dice.below(4));
                let look = Request::get(format!("/api/v1/episodes/{episode}/state?round={round}"));
                let patience = Duration::from_millis(50) + dice.time(Duration::from_secs(2));
                let mut wire = ctx.wire(addresses, number);
                drop(wire.ask_within(&look, patience).await);
                sleep(Duration::from_millis(20)).await;
            }
        }
    })
    .await;
    Ok(())
}

/// Worths of games with as much to compute as they may have, each asked for by many who may not wait for it.
pub(super) async fn worths(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("worths");
    let body = json!({ "task": "Pursuit", "num_agents": 16, "max_round": 100, "player": "random", "visibility": "public" });
    let mut games = Vec::new();
    for _ in 0..ctx.of(6, 32) {
        games.push(text(&ctx.create(&body).await?, "/id")?);
    }
    let mut wire = ctx.wire(addresses, 0).keeping_all();
    for game in &games {
        let look = Request::get(format!("/api/v1/episodes/{game}"));
        while ctx.has_time() && text(&wire.ask(&look).await?.read()?, "/status")? == "running" {
            sleep(Duration::from_millis(100)).await;
        }
    }
    ctx.note(format!("{} games of 16 agents were played", games.len()));
    // Rollouts of a minute each, and players who remember 67 million cells.
    for (agents, rounds, side) in [(1024, 1400, 64), (1024, 25, 256), (300, 300, 128)] {
        let body = json!({ "task": "Foraging", "num_agents": agents, "max_round": rounds, "width": side, "height": side, "visibility": "public" });
        games.push(text(&ctx.create(&body).await?, "/id")?);
    }
    let games = Arc::new(games);
    ctx.go().await;
    on_connections(ctx.of(16, 64), |number| {
        let (ctx, games) = (Arc::clone(&ctx), Arc::clone(&games));
        async move {
            for again in 0.. {
                let dice = ctx.dice(&format!("worth {number} {again}"));
                let game = dice.pick(&games).clone();
                let what = *dice.pick(&["worth", "worth", "worth?seats=false", "line?rounds=100"]);
                let patience = Duration::from_secs(1) + dice.time(Duration::from_mins(1));
                let mut wire = ctx.wire(addresses, number);
                let mut ask = Request::get(format!("/api/v1/episodes/{game}/{what}"));
                // Their creator alone may ask for the games that are not over.
                if number % 2 == 0 {
                    ask = ask.with(&ctx.brief.member);
                }
                drop(wire.ask_within(&ask, patience).await);
                sleep(Duration::from_millis(20)).await;
            }
        }
    })
    .await;
    Ok(())
}
