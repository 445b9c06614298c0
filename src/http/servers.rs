//! `GET /api/v1/nodes`.

use axum::Json;

use super::prelude::*;
use crate::cluster::ServerRow;
use jiff::Timestamp;
use swarmbench_protocol::server::{Server, ServerList};

/// List the servers that share this database, oldest first.
#[utoipa::path(
    get,
    path = "/api/v1/nodes",
    operation_id = "list_nodes",
    tag = "host",
    responses(
        (status = 200, description = "The servers; a server that plays alone is the only item", body = ServerList),
        (status = 403, description = "`forbidden`: neither an organizer's nor a judge's key"),
    )
)]
pub(super) async fn list_servers(
    State(app): State<App>,
    _: Overseer,
    _: Params<Nothing>,
) -> Result<Json<ServerList>, ApiError> {
    let Some(cluster) = app.store.cluster() else {
        return Ok(Json(ServerList { cluster: false, items: vec![alone(&app)] }));
    };
    let servers = cluster.snapshot().await?.servers;
    let items = servers.into_iter().map(|row| shown(row, cluster.incarnation()));
    Ok(Json(ServerList { cluster: true, items: items.collect() }))
}

fn shown(row: ServerRow, me: i64) -> Server {
    Server {
        id: row.incarnation,
        name: row.name,
        address: Some(row.address),
        version: row.version,
        is_this: row.incarnation == me,
        ready: row.is_ready,
        connected: row.is_connected,
        started_at: Timestamp::from_millisecond(row.joined_at_ms).unwrap_or_default().into(),
        seen_ms_ago: u64::try_from(row.seen_ms_ago).unwrap_or(0),
        clock_offset_ms: row.clock_offset_ms,
        episodes: row.episodes,
        places: row.places,
    }
}

/// Entry of a server that has the database to itself.
fn alone(app: &App) -> Server {
    let episodes = u32::try_from(app.registry.in_memory()).unwrap_or(u32::MAX);
    Server {
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
