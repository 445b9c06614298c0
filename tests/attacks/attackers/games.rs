//! Games whose rounds are expensive: to play, to host, to recover.

use std::fmt::Write as _;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tokio::time::sleep;

use super::{Addresses, Ctx, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::{Request, Wire};

/// A large game, and who plays all of it.
pub(super) struct Large {
    pub(super) episode: String,
    token: String,
    agents: usize,
    round: usize,
    wire: Wire,
}

impl Large {
    pub(super) async fn create(
        ctx: &Ctx,
        task: &str,
        agents: usize,
        map: usize,
        deadline_s: Option<f64>,
    ) -> io::Result<Self> {
        let body = json!({ "task": task, "num_agents": agents, "width": map, "height": map, "view_size": 3,
                           "memory": 0, "max_round": 10_000, "model": "large", "visibility": "public",
                           "round_deadline_s": deadline_s });
        let created = ctx.create(&body).await?;
        Ok(Self {
            episode: text(&created, "/id")?,
            token: text(&created, "/swarm_token")?,
            agents,
            round: 0,
            wire: ctx.wire(Addresses::Many, 2),
        })
    }

    /// Plays up to `rounds` rounds in up to `time`, and returns how many it played.
    pub(super) async fn play(
        &mut self,
        ctx: &Ctx,
        rounds: usize,
        time: Duration,
    ) -> io::Result<usize> {
        let end = Instant::now() + time;
        while self.round < rounds && Instant::now() < end {
            self.step(ctx).await?;
        }
        Ok(self.round)
    }

    /// All agents act; where the round is another one by now, they act in that one next.
    async fn step(&mut self, ctx: &Ctx) -> io::Result<()> {
        self.wire.to = *ctx.at.borrow();
        let act = acts_of_all(&self.episode, self.agents, self.round, None).with(&self.token);
        let answer = self.wire.ask(&act).await?;
        if answer.is_later() {
            sleep(Duration::from_millis(100)).await;
            return Ok(());
        }
        // Of a long answer the beginning is enough: what is said of the first act.
        let told = String::from_utf8_lossy(&answer.body);
        let stands_at = told.split("\"code\":").nth(1).and_then(|problem| {
            let round = problem.split("\"round\":").nth(1)?;
            round.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
        });
        match stands_at {
            // A round that is resolved by now; one that is dear is not open yet.
            Some(round) if round > self.round => self.round = round,
            Some(_) => sleep(Duration::from_millis(10)).await,
            None => self.round += 1,
        }
        Ok(())
    }
}

/// An act for each agent, which go all ways.
pub(super) fn acts_of_all(
    episode: &str,
    agents: usize,
    round: usize,
    reasoning: Option<&str>,
) -> Request {
    let mut body = String::from("{\"acts\":[");
    for agent in 0..agents {
        let comma = if agent == 0 { "" } else { "," };
        let action = ["UP", "DOWN", "LEFT", "RIGHT", "STAY"][(agent * 7 + round * 3) % 5];
        write!(
            body,
            "{comma}{{\"episode\":\"{episode}\",\"agent\":\"Agent_{agent}\",\"round\":{round},\"action\":\"{action}\""
        )
        .expect("a string takes all text");
        if let Some(reasoning) = reasoning {
            write!(body, ",\"reasoning\":\"{reasoning}\"").expect("a string takes all text");
        }
        body.push('}');
    }
    body.push_str("]}");
    Request::post_text("/swarm/act", body)
}

/// Large games of Flocking are played as fast as the server takes acts.
pub(super) async fn heavy_steps(ctx: Arc<Ctx>) -> io::Result<()> {
    let games = ctx.of(2, 2 + ctx.dice("games").below(4));
    let agents = ctx.of(64, 256);
    ctx.note(format!("{games} games of Flocking with {agents} agents"));
    ctx.go().await;
    on_connections(games, |number| {
        let ctx = Arc::clone(&ctx);
        let map = *ctx.dice(&format!("map {number}")).pick(&[64, 128, 256]);
        async move {
            loop {
                let Ok(mut game) = Large::create(&ctx, "Flocking", agents, map, None).await else {
                    sleep(Duration::from_secs(1)).await;
                    continue;
                };
                while game.step(&ctx).await.is_ok() {}
            }
        }
    })
    .await;
    Ok(())
}

/// The server itself plays many large games.
pub(super) async fn hosted_players(ctx: Arc<Ctx>) -> io::Result<()> {
    let games = ctx.of(10, 200);
    ctx.go().await;
    let mut created = 0;
    for number in 0..games {
        let dice = ctx.dice(&format!("hosted {number}"));
        let task = *dice.pick(&["Pursuit", "Flocking", "Foraging", "Transport", "Synchronization"]);
        let map = *dice.pick(&[32, 64, 128, 256]);
        let agents = *dice.pick(&[32, 64, 128, 200]);
        let window = *dice.pick(&[9, 15, 31]);
        let body = json!({ "task": task, "num_agents": agents.min(map * map / 16), "width": map, "height": map,
                           "view_size": window, "memory": 2, "max_round": 10_000, "player": "default",
                           "visibility": "public" });
        match ctx.create(&body).await {
            Ok(_) => created += 1,
            Err(error) => ctx.note(
                format!("{task} {agents} on {map}: {error}").chars().take(200).collect::<String>(),
            ),
        }
    }
    ctx.note(format!("{created} games are hosted"));
    Ok(())
}

/// Games of the attack on a restart.
const RESTARTED: usize = 6;

/// Six heavy games with clocks, which a server recovers before it is ready.
pub(super) async fn restart(ctx: Arc<Ctx>) -> io::Result<()> {
    let agents = ctx.of(32, 256);
    let mut games = Vec::new();
    for _ in 0..RESTARTED {
        games.push(Large::create(&ctx, "Flocking", agents, 64, Some(600.0)).await?);
    }
    let mut rounds = 0;
    let time = Duration::from_secs(ctx.of(3, 60) as u64) / 6;
    for game in &mut games {
        rounds += game.play(&ctx, ctx.of(3, 12), time).await?;
    }
    ctx.note(format!("{rounds} rounds of {agents} agents were played in {RESTARTED} games"));
    ctx.go().await;
    // The games are looked at as soon as the server is back, as those who play them would.
    let paths: Vec<_> =
        games.iter().map(|game| format!("/api/v1/episodes/{}", game.episode)).collect();
    on_connections(RESTARTED, |number| {
        let (ctx, path) = (Arc::clone(&ctx), paths[number].clone());
        async move {
            let mut wire = ctx.wire(Addresses::Many, number);
            loop {
                wire.to = *ctx.at.borrow();
                drop(wire.ask(&Request::get(&path)).await);
                sleep(Duration::from_millis(100)).await;
            }
        }
    })
    .await;
    Ok(())
}

/// A look by `/mcp`, with something beside its arguments.
pub(super) fn mcp_look(wait_s: u32, meta: &str) -> Request {
    let body = format!(
        "{{\"jsonrpc\":\"2.0\",\"id\":1,\"method\":\"tools/call\",\"params\":{{\"name\":\"look\",\
         \"arguments\":{{\"wait_s\":{wait_s}}},\"_meta\":{meta}}}}}"
    );
    Request::post_text("/mcp", body)
}

/// The token of a seat whose looks wait: it has acted, and another one has not.
pub(super) async fn waiting_seat(ctx: &Ctx) -> io::Result<String> {
    let body = json!({ "task": "Synchronization", "num_agents": 2, "model": "waits", "visibility": "public" });
    let created = ctx.create(&body).await?;
    let seat = text(&created, "/seats/0/token")?;
    let act = Request::post("/act", &json!({ "round": 0, "action": "STAY" })).with(&seat);
    ctx.insist(&mut ctx.wire(Addresses::Many, 0), &act).await?.read::<Value>()?;
    Ok(seat)
}
