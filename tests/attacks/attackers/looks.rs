//! Answers that are dear to make: prompts by heavy templates, and observations with large windows.

use std::io;
use std::sync::Arc;

use serde_json::json;

use super::{Ctx, hammer, on_connections};
use crate::attacks::honest::text;
use crate::attacks::wire::Request;

/// Bytes of text within the innermost loop of a template: up to 1 MiB in all, and less, for servers that allow less.
const TEXT_BYTES: [usize; 3] = [4_700, 500, 60];

fn template(bytes: usize, over: &str) -> String {
    let text = "x".repeat(bytes);
    let begin = |name: &str, list: &str| format!("{{% for {name} in {list} %}}");
    let loops = [begin("a", over), begin("b", "actions"), begin("c", "actions")].concat();
    format!("{loops}{text}{}", "{% endfor %}".repeat(3))
}

/// Entrants with legal templates of three nested loops ask for all their prompts.
pub(super) async fn dear_prompts(ctx: Arc<Ctx>) -> io::Result<()> {
    let addresses = ctx.addresses("dear_prompts");
    let mut tokens = Vec::new();
    for (number, bytes) in TEXT_BYTES.into_iter().enumerate() {
        let mut wire = ctx.wire(addresses, number);
        let over = *ctx.dice(&format!("loop {number}")).pick(&["actions", "views[0].cells"]);
        let mut keys = Vec::new();
        for (shape, over) in [over, "actions"].into_iter().enumerate() {
            let body = json!({ "name": format!("prompts {number} {shape}"), "model": "loops",
                               "prompt_template": template(bytes, over) });
            match ctx.enter(&mut wire, &ctx.brief.cup, &body).await {
                Ok(key) => keys.push(key),
                Err(error) => ctx.note(format!("a template of {bytes} bytes: {error}")),
            }
        }
        for key in keys {
            tokens.push(ctx.start(&mut wire, &ctx.brief.cup, &key).await?);
        }
    }
    if tokens.is_empty() {
        return Err(io::Error::other("no template is taken"));
    }
    ctx.go().await;
    on_connections(ctx.of(20, 300), |number| {
        let token = &tokens[number % tokens.len()];
        let path = *ctx.dice(&format!("path {number}")).pick(&[
            "/swarm/obs?prompt=true&limit=1024",
            "/swarm/obs?prompt=true&limit=1024",
            "/swarm/obs?prompt=true&limit=60&wait=5",
        ]);
        let look = Request::get(path).with(token);
        hammer(ctx.wire(addresses, number), move |_| look.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}

/// Agents, window and map: from far beyond what is sensible to what any server should take.
const WINDOWS: [(u32, u32, u32); 8] = [
    (1_024, 513, 256),
    (1_024, 101, 256),
    (256, 513, 256),
    (15, 257, 256),
    (1_024, 31, 256),
    (256, 63, 128),
    (64, 31, 64),
    (12, 5, 10),
];

/// The largest windows that the server admits, without memory and with some, looked at by single seats and by all.
pub(super) async fn big_windows(ctx: Arc<Ctx>) -> io::Result<()> {
    let mut games = Vec::new();
    let memory = *ctx.dice("memory").pick(&[1, 2, 4]);
    for (memory, control) in [(0, "decentralized"), (0, "centralized"), (memory, "decentralized")] {
        for (agents, window, map) in WINDOWS {
            let body = json!({ "task": "Synchronization", "num_agents": agents, "width": map, "height": map,
                               "view_size": window, "memory": memory, "control": control, "model": "windows",
                               "visibility": "public" });
            match ctx.create(&body).await {
                Ok(created) => {
                    ctx.note(format!(
                        "admitted: {agents} agents, window {window}, map {map}, memory {memory}, {control}"
                    ));
                    games
                        .push((text(&created, "/swarm_token")?, text(&created, "/seats/0/token")?));
                    break;
                }
                Err(error) if error.to_string().starts_with("422") => {}
                Err(error) => return Err(error),
            }
        }
    }
    if games.is_empty() {
        return Err(io::Error::other("no window is admitted"));
    }
    ctx.go().await;
    let addresses = ctx.addresses("big_windows");
    on_connections(ctx.of(4, 12), |number| {
        let (swarm, seat) = &games[number % games.len()];
        let look = match number % 3 {
            0 => Request::get("/swarm/obs?limit=1024").with(swarm),
            1 => Request::get("/swarm/obs").with(swarm),
            _ => Request::get("/obs?prompt=true").with(seat),
        };
        hammer(ctx.wire(addresses, number), move |_| look.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}
