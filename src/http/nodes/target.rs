//! Target of a request: the part of its meaning that decides which server answers.

use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};

use axum::http::{HeaderMap, Method, header};
use percent_encoding::percent_decode_str;

use super::super::auth;
use super::super::front::is_of_a_player;
use super::super::prelude::*;
use super::Nodes;
use crate::cluster::route::Target;
use crate::ids::{CompetitionKey, EpisodeId, Place, TokenHash};
use crate::store::tokens::Grant;

/// One server creates all competitions, so that no two get the same id.
const NEW_COMPETITIONS: Place = Place::Competition(CompetitionKey(0));

impl Nodes {
    /// Finds the target of a request. Any server answers for ids that do not exist.
    pub(super) async fn target(
        &self,
        app: &App,
        method: &Method,
        path: &str,
        headers: &HeaderMap,
    ) -> Result<Target, ApiError> {
        if is_of_a_player(path) || path == "/mcp" {
            return self.of_token(app, headers).await;
        }
        let Some(Subject { collection, id, action }) = Subject::of(path) else {
            return Ok(Target::Anybody);
        };
        match (collection, id.as_deref()) {
            ("episodes" | "runs", None) if method == Method::POST => Ok(of_name(headers)),
            ("episodes", Some(id)) => {
                let place = self.place_of(&EpisodeId::from_text(id.to_owned())).await?;
                let Some(place) = place else { return Ok(Target::Anybody) };
                if action == Some("fork") && !self.cluster.is_unfinished(place).await? {
                    // Nobody owns the place of the parent any more, and the forks are new.
                    return Ok(of_name(headers));
                }
                Ok(Target::Place(place))
            }
            ("runs", Some(id)) => {
                if let Some(run) = self.runs.get(id) {
                    return Ok(Target::Place(Place::Run(run)));
                }
                let Some(found) = self.store.find_run(id).await? else {
                    return Ok(Target::Anybody);
                };
                self.runs.insert(id.to_owned(), found.run);
                Ok(Target::Place(Place::Run(found.run)))
            }
            ("competitions", None) if method == Method::POST => Ok(Target::Place(NEW_COMPETITIONS)),
            ("competitions", Some(id)) if *method != Method::GET && *method != Method::HEAD => {
                if let Some(competition) = self.competitions.get(id) {
                    return Ok(Target::Place(Place::Competition(competition)));
                }
                let Some(found) = crate::competitions::find(&self.store, id).await? else {
                    return Ok(Target::Anybody);
                };
                self.competitions.insert(id.to_owned(), found.key);
                Ok(Target::Place(Place::Competition(found.key)))
            }
            _ => Ok(Target::Anybody),
        }
    }

    /// Place that is played with the token of a request.
    async fn of_token(&self, app: &App, headers: &HeaderMap) -> Result<Target, ApiError> {
        let value = headers.get(header::AUTHORIZATION);
        let Some(token) =
            value.and_then(|value| value.to_str().ok()).and_then(|value| auth::bearer(value).ok())
        else {
            // The handler reports what is wrong.
            return Ok(Target::Anybody);
        };
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

/// Collection, id and action in the path of a request.
#[derive(Debug, PartialEq, Eq)]
struct Subject<'a> {
    collection: &'a str,
    id: Option<Cow<'a, str>>,
    action: Option<&'a str>,
}

impl<'a> Subject<'a> {
    fn of(path: &'a str) -> Option<Self> {
        let mut parts = path.strip_prefix("/api/v1/")?.split('/').filter(|part| !part.is_empty());
        let collection = parts.next()?;
        // Handlers decode ids, too: an id in another encoding names the same resource.
        let id = parts.next().map(|part| percent_decode_str(part).decode_utf8_lossy());
        Some(Self { collection, id, action: parts.next() })
    }
}

/// Creations with the same `Idempotency-Key` go to one server, which does them one after another.
fn of_name(headers: &HeaderMap) -> Target {
    let named = headers.get("idempotency-key").map(|name| {
        let hash = TokenHash::of(&String::from_utf8_lossy(name.as_bytes()));
        let first = hash.0.first_chunk().expect("a hash is longer");
        Target::Named(u64::from_le_bytes(*first))
    });
    named.unwrap_or_else(|| Target::New(drawn()))
}

/// A different number at each call.
fn drawn() -> u64 {
    static DRAWN: AtomicU64 = AtomicU64::new(0);
    DRAWN.fetch_add(1, Ordering::Relaxed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_that_is_written_otherwise_is_the_same_one() {
        let usual = Subject::of("/api/v1/competitions/cmp_01a/attempts");
        let id = Some(Cow::Borrowed("cmp_01a"));
        let expected = Subject { collection: "competitions", id, action: Some("attempts") };
        assert_eq!(usual, Some(expected));
        assert_eq!(Subject::of("/api/v1/competitions/%63mp%5F01a/attempts"), usual);
        assert_eq!(Subject::of("/docs"), None);
    }
}
