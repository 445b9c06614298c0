//! All kinds of attacks at once.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use tokio::task::JoinSet;

use super::{ATTACKS, Attacking, Ctx, play};

/// Attacks that say nothing beside others: these begin the server anew, or count its files.
const APART: [&str; 3] = ["everything", "restart", "connections"];

/// All attacks that can be played at once, with the numbers of a short run; together they still have half a core.
pub(super) fn everything(ctx: Arc<Ctx>) -> Attacking {
    Box::pin(async move {
        let together: Vec<_> =
            ATTACKS.iter().filter(|attack| !APART.contains(&attack.name)).collect();
        // Each of them is waited for, and this one is not.
        ctx.preparing.fetch_add(together.len() - 1, Ordering::SeqCst);
        ctx.is_prepared.store(true, Ordering::SeqCst);
        let mut playing = JoinSet::new();
        for attack in together {
            playing.spawn(play(attack, ctx.part()));
        }
        playing.join_all().await;
        Ok(())
    })
}
