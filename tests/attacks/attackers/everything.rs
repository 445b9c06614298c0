//! All kinds of attacks at once.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use tokio::task::JoinSet;

use super::{ATTACKS, Attack, Attacking, Ctx, play};

/// True if an attack says nothing beside others: it needs a server of its own, or the memory of one.
fn is_apart(attack: &Attack) -> bool {
    let has_own_server = attack.restarts || attack.files.is_some() || !attack.options.is_empty();
    has_own_server || attack.takes || !attack.least.is_zero() || attack.name == "everything"
}

/// All attacks that can be played at once, with the numbers of a short run; together they still have half a core.
pub(super) fn everything(ctx: Arc<Ctx>) -> Attacking {
    Box::pin(async move {
        let together: Vec<_> = ATTACKS.iter().filter(|attack| !is_apart(attack)).collect();
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
