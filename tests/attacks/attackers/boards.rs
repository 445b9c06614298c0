//! Large boards.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::json;

use super::{Addresses, Ctx, hammer, on_connections};
use crate::attacks::wire::Request;

/// Connections on which they enter.
const ENTERING: usize = 16;

/// Entrants of a competition with many of them are read on many connections.
pub(super) async fn board_readers(ctx: Arc<Ctx>) -> io::Result<()> {
    let cup = ctx.brief.open_cup.clone();
    let entrants = ctx.of(60, 2_000);
    let entered = Arc::new(AtomicUsize::new(0));
    on_connections(ENTERING, |number| {
        let (ctx, cup, entered) = (Arc::clone(&ctx), cup.clone(), Arc::clone(&entered));
        async move {
            let mut wire = ctx.wire(Addresses::Many, number);
            for entrant in (number..entrants).step_by(ENTERING).take_while(|_| ctx.has_time()) {
                // An entry a second from one address is nothing to be refused.
                wire.source = Ctx::source(Addresses::Many, entrant);
                let body = json!({ "name": format!("reader {entrant}"), "model": "many" });
                if ctx.enter(&mut wire, &cup, &body).await.is_ok() {
                    entered.fetch_add(1, Ordering::SeqCst);
                }
            }
        }
    })
    .await;
    let addresses = ctx.addresses("board_readers");
    ctx.note(format!("{} entrants", entered.load(Ordering::SeqCst)));
    ctx.go().await;
    on_connections(ctx.of(30, 100), |number| {
        let paths = [
            format!("/api/v1/competitions/{cup}/board"),
            format!("/api/v1/competitions/{cup}/board?format=csv"),
            format!("/api/v1/competitions/{cup}/entrants"),
            "/api/v1/leaderboard?limit=1000".to_owned(),
        ];
        let read = Request::get(ctx.dice(&format!("reader {number}")).pick(&paths).clone());
        hammer(ctx.wire(addresses, number), move |_| read.clone(), ctx.at.clone())
    })
    .await;
    Ok(())
}
