//! Target of a request: the part of its meaning that decides which server answers.

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::http::HeaderMap;
use percent_encoding::percent_decode_str;

use super::super::auth;
use super::super::prelude::*;
use super::super::routes::At;
use super::Forwarder;
use crate::cluster::route::Target;
use crate::ids::{CompetitionKey, EpisodeId, Place, TokenHash};
use crate::store::tokens::Grant;

/// One server creates all competitions, so that no two get the same id.
const NEW_COMPETITIONS: Place = Place::Competition(CompetitionKey(0));

impl Forwarder {
    /// Finds the target of a request. Any server answers for ids that do not exist.
    pub(super) async fn target(
        &self,
        app: &App,
        at: At,
        path: &str,
        headers: &HeaderMap,
    ) -> Result<Target, ApiError> {
        match at {
            At::Host | At::Anywhere => Ok(Target::Anybody),
            At::Token => self.of_token(app, headers).await,
            At::New => Ok(target_of_creation(headers)),
            At::NewCompetition => Ok(Target::Place(NEW_COMPETITIONS)),
            At::Episode | At::Fork => {
                let place = self.place_of(&EpisodeId::from_text(id_in(path).into_owned())).await?;
                let Some(place) = place else { return Ok(Target::Anybody) };
                if at == At::Fork && !self.cluster.is_unfinished(place).await? {
                    // Nobody owns the place of the parent any more, and the forks are new.
                    return Ok(target_of_creation(headers));
                }
                Ok(Target::Place(place))
            }
            At::Run => {
                let id = id_in(path);
                if let Some(run) = self.runs.get(&*id) {
                    return Ok(Target::Place(Place::Run(run)));
                }
                let Some(found) = self.store.find_run(&id).await? else {
                    return Ok(Target::Anybody);
                };
                self.runs.insert(id.into_owned(), found.run);
                Ok(Target::Place(Place::Run(found.run)))
            }
            At::Competition => {
                let id = id_in(path);
                if let Some(competition) = self.competitions.get(&*id) {
                    return Ok(Target::Place(Place::Competition(competition)));
                }
                let Some(found) = crate::competitions::find(&self.store, &id).await? else {
                    return Ok(Target::Anybody);
                };
                self.competitions.insert(id.into_owned(), found.key);
                Ok(Target::Place(Place::Competition(found.key)))
            }
        }
    }

    /// Place that is played with the token of a request.
    async fn of_token(&self, app: &App, headers: &HeaderMap) -> Result<Target, ApiError> {
        let Some(token) = auth::sent_token(headers) else { return Ok(Target::Anybody) };
        match app.tokens.grant(token).await? {
            Some(Grant::Seat { episode, .. } | Grant::Swarm { episode, .. }) => {
                let place = self.place_of(&episode).await?;
                Ok(place.map_or(Target::Anybody, Target::Place))
            }
            Some(Grant::Run { run, .. }) => Ok(Target::Place(Place::Run(run))),
            Some(Grant::Key(_)) | None => Ok(Target::Anybody),
        }
    }

    /// Place of an episode; `None` where the episode does not exist.
    async fn place_of(&self, id: &EpisodeId) -> Result<Option<Place>, ApiError> {
        if let Some(place) = self.games.get(id) {
            return Ok(Some(place));
        }
        let Some((episode, run)) = self.store.keys_of(id).await? else { return Ok(None) };
        let place = Place::of_game(episode, run);
        self.games.insert(id.clone(), place);
        Ok(Some(place))
    }
}

/// The id in the path of a route that is about one thing: `/api/v1/<things>/<id>/…`. Handlers decode ids, too: an id in another
/// encoding names the same thing.
fn id_in(path: &str) -> Cow<'_, str> {
    let id = path.split('/').filter(|part| !part.is_empty()).nth(3).unwrap_or_default();
    percent_decode_str(id).decode_utf8_lossy()
}

/// Creations with the same `Idempotency-Key` go to one server, which does them one after another.
fn target_of_creation(headers: &HeaderMap) -> Target {
    let named = headers.get("idempotency-key").map(|name| {
        let hash = TokenHash::of(&String::from_utf8_lossy(name.as_bytes()));
        let first = hash.0.first_chunk().expect("a hash is longer");
        Target::Named(u64::from_le_bytes(*first))
    });
    named.unwrap_or_else(|| Target::New(next_number()))
}

/// A different number at each call.
fn next_number() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_that_is_written_otherwise_is_the_same_one() {
        assert_eq!(id_in("/api/v1/competitions/cmp_01a/attempts"), "cmp_01a");
        assert_eq!(id_in("/api/v1/competitions/%63mp%5F01a/attempts"), "cmp_01a");
        assert_eq!(id_in("/api/v1/competitions"), "");
    }
}
