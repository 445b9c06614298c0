//! `GET /api/v1/nodes`.

use axum::Json;

use super::super::prelude::*;
use crate::cluster::Member;
use jiff::Timestamp;
use swarmbench_protocol::node::{Node, NodeList};

/// List the servers that share this database, oldest first.
#[utoipa::path(
    get,
    path = "/api/v1/nodes",
    operation_id = "list_nodes",
    tag = "host",
    responses(
        (status = 200, description = "The servers; a server that plays alone is the only item", body = NodeList),
        (status = 403, description = "`forbidden`: neither an organizer's nor a judge's key"),
    )
)]
pub(in super::super) async fn list_nodes(
    State(app): State<App>,
    _: Overseer,
    _: Params<Nothing>,
) -> Result<Json<NodeList>, ApiError> {
    let Some(cluster) = app.store.cluster() else {
        return Ok(Json(NodeList { cluster: false, items: vec![alone(&app)] }));
    };
    let members = cluster.look().await?.members;
    let items = members.into_iter().map(|member| shown(member, cluster.incarnation()));
    Ok(Json(NodeList { cluster: true, items: items.collect() }))
}

fn shown(member: Member, me: i64) -> Node {
    Node {
        id: member.incarnation,
        name: member.name,
        address: Some(member.address),
        version: member.version,
        is_this: member.incarnation == me,
        ready: member.is_ready,
        connected: member.is_connected,
        started_at: Timestamp::from_millisecond(member.joined_at_ms).unwrap_or_default().into(),
        seen_ms_ago: u64::try_from(member.seen_ms_ago).unwrap_or(0),
        clock_offset_ms: member.clock_offset_ms,
        episodes: member.episodes,
        places: member.places,
    }
}

/// Entry of a server that has the database to itself.
fn alone(app: &App) -> Node {
    let episodes = u32::try_from(app.registry.in_memory()).unwrap_or(u32::MAX);
    Node {
        id: 0,
        name: crate::host::process_name(),
        address: None,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        is_this: true,
        ready: app.ready.load(std::sync::atomic::Ordering::Acquire),
        connected: !app.store.writer().has_failed(),
        started_at: app.started_at.into(),
        seen_ms_ago: 0,
        clock_offset_ms: 0,
        episodes,
        places: u32::try_from(app.registry.unfinished()).unwrap_or(u32::MAX),
    }
}
