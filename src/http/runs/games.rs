//! Pages of the games of a run, in the order of its plan.

use super::super::prelude::*;
use super::Known;
use crate::store::games::StoredGame;
use crate::store::port::StoredEpisode;

/// Games of a page, where the query does not say.
const GAMES_USUAL: u32 = 50;

/// Games of a page at most.
const GAMES_MAX: u32 = 200;

/// Games of a page.
#[derive(Clone, Copy)]
pub(super) struct GamesPage {
    limit: u32,
    /// The slot behind which it begins.
    after: Option<u32>,
}

impl GamesPage {
    /// The page that a query asks for, checked.
    pub(super) fn of(limit: Option<u32>, cursor: Option<&str>) -> Result<Self, ApiError> {
        let limit = limit.unwrap_or(GAMES_USUAL);
        if !(1..=GAMES_MAX).contains(&limit) {
            let detail = format!("limit must be from 1 to {GAMES_MAX}, is {limit}");
            return Err(ApiError::new(Code::Malformed, detail));
        }
        let after = cursor.map(slot_after).transpose()?;
        Ok(Self { limit, after })
    }
}

/// The cursor behind a slot of the plan.
fn slot_cursor(slot: u32) -> String {
    format!("m{slot:x}")
}

/// The slot behind which a page begins, by its cursor.
fn slot_after(cursor: &str) -> Result<u32, ApiError> {
    let slot = cursor.strip_prefix('m').and_then(|slot| u32::from_str_radix(slot, 16).ok());
    slot.ok_or_else(|| ApiError::new(Code::Malformed, "cursor is none of this list"))
}

impl App {
    /// The games of a page that count and that the caller may read, and the cursor of the next page.
    pub(super) async fn games_page(
        &self,
        caller: &Caller,
        run: &Known,
        page: GamesPage,
        is_wanted: fn(&StoredGame) -> bool,
    ) -> Result<(Vec<StoredGame>, Option<String>), ApiError> {
        let mut games = self.store.games_of(run.stored.run).await?;
        games.retain(|game| {
            page.after.is_none_or(|after| game.slot > after)
                && is_wanted(game)
                && game.counts()
                && caller.may_read(&self.access, run.subject_of(game))
        });
        let has_more = games.len() > page.limit as usize;
        games.truncate(page.limit as usize);
        let next = games.last().filter(|_| has_more).map(|game| slot_cursor(game.slot));
        Ok((games, next))
    }

    /// Stored row of a game's episode.
    pub(super) async fn stored_game(&self, game: &StoredGame) -> Result<StoredEpisode, ApiError> {
        let stored = self.store.summary_of(game.episode).await?;
        stored.ok_or_else(|| ApiError::not_found("the episode"))
    }
}
