//! Templates that are small, and deep where they are read.

use std::io;
use std::sync::Arc;

use serde_json::{Value, json};

use super::games::mcp_look;
use super::shapes::{PARTS, TEMPLATES};
use super::{Addresses, Ctx, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::{Request, Wire};

/// Bytes that a template may have.
const TEMPLATE_BYTES_MAX: usize = 32 * 1024;

/// Connections on which templates are sent.
const SENDERS: usize = 4;

/// Chains and nests of all kinds and sizes come with entries, games, runs and forks; those that are taken are looked at in
/// all ways.
pub(super) async fn killer_templates(ctx: Arc<Ctx>) -> io::Result<()> {
    let parent = ctx.create(&game("x")).await?;
    let parent = text(&parent, "/id")?;
    let templates: Vec<_> = (TEMPLATES.iter())
        .flat_map(|shape| PARTS.map(|parts| shape.of(parts, TEMPLATE_BYTES_MAX)))
        .collect();
    let templates: Arc<[String]> = templates.into();
    let all = |again: usize| {
        let (ctx, templates, parent) = (Arc::clone(&ctx), Arc::clone(&templates), parent.clone());
        on_connections(SENDERS, move |number| {
            let (ctx, templates) = (Arc::clone(&ctx), Arc::clone(&templates));
            let parent = parent.clone();
            async move {
                let mut wire = ctx.wire(Addresses::Many, number).keeping_all();
                for (place, template) in templates.iter().enumerate().skip(number).step_by(SENDERS)
                {
                    wire.source = Ctx::source(Addresses::Many, again * templates.len() + place);
                    for creation in creations(&ctx, &parent, place, again, template) {
                        // A refusal is what is hoped for.
                        drop(created_and_seen(&ctx, &mut wire, &creation).await);
                    }
                }
            }
        })
    };
    all(0).await;
    ctx.note(format!("{} templates", templates.len()));
    ctx.go().await;
    for again in 1.. {
        all(again).await;
    }
    Ok(())
}

fn game(template: &str) -> Value {
    json!({ "task": "Synchronization", "num_agents": 1, "max_round": 1, "visibility": "public", "model": "deep",
            "prompt_template": template })
}

/// All requests that bring a template.
fn creations(ctx: &Ctx, parent: &str, place: usize, again: usize, template: &str) -> [Request; 4] {
    let enter = format!("/api/v1/competitions/{}/entrants", ctx.brief.open_cup);
    let name = format!("deep {again} {place}");
    let suite = json!({ "name": "deep", "seeds": [1], "tasks": ["Synchronization"], "settings": { "num_agents": 1 } });
    let entry = json!({ "name": name, "model": "deep", "prompt_template": template });
    let run = json!({ "suite": suite, "model": "deep", "prompt_template": template });
    let fork = json!({ "round": 0, "model": "deep", "prompt_template": template });
    let member = &ctx.brief.member;
    [
        Request::post(enter, &entry),
        Request::post("/api/v1/episodes", &game(template)).with(member),
        Request::post("/api/v1/runs", &run).with(member),
        Request::post(format!("/api/v1/episodes/{parent}/fork"), &fork).with(member),
    ]
}

/// Sends a creation and looks at what it made, if it made something.
async fn created_and_seen(ctx: &Ctx, wire: &mut Wire, creation: &Request) -> io::Result<()> {
    let mut created: Value = ctx.insist(wire, creation).await?.read()?;
    if let Ok(key) = text(&created, "/key") {
        created = json!({ "swarm_token": ctx.start(wire, &ctx.brief.open_cup, &key).await? });
    }
    let created = created.pointer("/episodes/0").unwrap_or(&created);
    let swarm = text(created, "/swarm_token")?;
    wire.ask(&Request::get("/swarm/obs?prompt=true&limit=1").with(&swarm)).await?;
    if let Ok(seat) = text(created, "/seats/0/token") {
        wire.ask(&Request::get("/obs?prompt=true").with(&seat)).await?;
        wire.ask(&mcp_look(0, "{}").with(&seat)).await?;
        let game = text(created, "/id")?;
        let act = format!("/api/v1/episodes/{game}/rounds/0/agents/Agent_0");
        wire.ask(&Request::get(act).with(&swarm)).await?;
        wire.ask(
            &Request { method: "DELETE", ..Request::get(format!("/api/v1/episodes/{game}")) }
                .with(&swarm),
        )
        .await?;
        wire.ask(&Request::get(format!("/api/v1/exports/dataset.zip?episode={game}"))).await?;
    }
    Ok(())
}
