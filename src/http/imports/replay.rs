//! `GET /api/v1/imports/{id}/replay`.

use super::super::answer::{joined, json};
use super::super::episodes::replay::ReplayParams;
use super::super::prelude::*;
use super::super::replay_pages::{PageKey, ReplayedGame, WrittenPage};
use super::unreadable;
use crate::dataset::imported::Unreadable;
use crate::dataset::replay::{ImportPage, ground, rounds_of_import_page};
use crate::store::entries::ImportedRound;
use crate::store::imports::StoredImport;
use swarmbench_protocol::replay::{Replay, ReplayHead};
use swarmbench_replay::{PAGE_BYTES_MAX, ROUNDS_BEFORE};

/// States that are read and shown at once.
const CHUNK: u32 = 8;

/// Read the states of an imported game, a page of rounds at a time.
///
/// The states are those of an episode, but the files of a game lack the readers of messages.
#[utoipa::path(
    get,
    path = "/api/v1/imports/{id}/replay",
    operation_id = "show_import_replay",
    tag = "data",
    params(ReplayParams),
    responses(
        (status = 200, description = "The states", body = Replay),
        (status = 404, description = "`not_found`: no such game, or no such state"),
        (status = 422, description = "`invalid`: an earlier version stored more than the limit `import_state_bytes_max`"),
        (status = 503, description = "`overloaded`: too many games are being replayed"),
    )
)]
pub(in super::super) async fn show_import_replay(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<ReplayParams>,
) -> Result<Response, ApiError> {
    let stored = app.import(&caller, &id).await?;
    let (from, to) = params.range(stored.rounds, stored.settings.num_agents)?;
    let to = to.min(from.saturating_add(rounds_of_import_page(&stored)));
    let (layout, memory) = app.imported_state(&stored, 0).await?;
    let wants_ground = params.wants_ground();
    let of = stored.clone();
    let begin = app.heavy.render(move || {
        let _memory = memory;
        let page = ImportPage::new(&of, &layout, from)?;
        Ok((head(&of, &layout, wants_ground, &page)?, page))
    });
    let (head, page) = begin.await?.map_err(unreadable)?;
    let key = PageKey {
        game: ReplayedGame::Import(stored.key),
        from,
        to,
        has_decisions: stored.acts > 0,
    };
    let page =
        Box::pin(app.replay_pages.page(key, app.write_import_page(&stored, key, page))).await?;
    let next = (page.last < stored.rounds).then_some(page.last);
    Ok(json(joined(&ReplayHead { next, ..head }, &page.json)))
}

fn head(
    stored: &StoredImport,
    layout: &ImportedRound,
    wants_ground: bool,
    page: &ImportPage,
) -> Result<ReplayHead, Unreadable> {
    let settings = &stored.settings;
    Ok(ReplayHead {
        episode: stored.id.clone(),
        task: stored.task.clone(),
        rules: settings.rules.clone(),
        control: settings.control.clone(),
        status: "imported".to_owned(),
        rounds: stored.rounds,
        max_round: Some(settings.max_round),
        score: stored.score,
        width: settings.width,
        height: settings.height,
        num_agents: settings.num_agents,
        view_size: Some(settings.view_size),
        ground: wants_ground.then(|| ground(&stored.task, layout)).transpose()?,
        block_cells: page.block_cells(),
        next: None,
    })
}

impl App {
    /// Reads the states of a page.
    async fn write_import_page(
        &self,
        stored: &StoredImport,
        key: PageKey,
        mut page: ImportPage,
    ) -> Result<WrittenPage, ApiError> {
        // Memory for the page and for its JSON.
        let _memory = self.registry.room(2 * PAGE_BYTES_MAX)?;
        let _permit = self.heavy.replay().await?;
        let mut from = key.from.saturating_sub(ROUNDS_BEFORE);
        while from <= key.to {
            let to = (key.to + 1).min(from + CHUNK);
            let (rounds, memory) = self.imported_rounds(stored, from, to).await?;
            from += u32::try_from(rounds.len()).expect("a part");
            let added = self.heavy.render(move || {
                let _memory = memory;
                rounds.iter().try_for_each(|round| page.add(round)).map(|()| page)
            });
            page = added.await?.map_err(unreadable)?;
        }
        Ok(WrittenPage::of(&page.finish().map_err(unreadable)?))
    }
}
