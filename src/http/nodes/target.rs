//! What a request is about, as far as it matters which server answers it.

use std::borrow::Cow;

use axum::http::{HeaderMap, Method, header};
use percent_encoding::percent_decode_str;

use super::super::auth;
use super::super::front::is_of_a_player;
use super::super::prelude::*;
use super::Nodes;
use crate::ids::{CompetitionKey, EpisodeId, Place, TokenHash};
use crate::store::tokens::Grant;

/// What a request is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// Any server answers it from the database, or does it.
    Anybody,
    /// What is played, or changed, at a place.
    Place(Place),
    /// Something that does not exist yet, and that must not be made twice: the number follows from its name.
    Named(u64),
    /// Something else that does not exist yet: a server that takes work makes it.
    New,
}

/// New competitions are made in one place, so that no two get the same id.
const NEW_COMPETITIONS: Place = Place::Competition(CompetitionKey(0));

impl Nodes {
    /// What a request is about. What does not exist is answered by anybody.
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
                    // Nobody plays the parent any more, and the forks are new.
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

    /// What is played with the token of a request.
    async fn of_token(&self, app: &App, headers: &HeaderMap) -> Result<Target, ApiError> {
        let value = headers.get(header::AUTHORIZATION);
        let Some(token) =
            value.and_then(|value| value.to_str().ok()).and_then(|value| auth::bearer(value).ok())
        else {
            // The handler says what is wrong.
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

    /// Where an episode is played.
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

/// What the path of a request names.
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
        // As the handlers read it: an id that is written otherwise names the same thing.
        let id = parts.next().map(|part| percent_decode_str(part).decode_utf8_lossy());
        Some(Self { collection, id, action: parts.next() })
    }
}

/// Creations with the same `Idempotency-Key` are done by the same server, one after the other.
fn of_name(headers: &HeaderMap) -> Target {
    headers.get("idempotency-key").map_or(Target::New, |name| {
        let hash = TokenHash::of(&String::from_utf8_lossy(name.as_bytes()));
        let first = hash.0.first_chunk().expect("a hash is longer");
        Target::Named(u64::from_le_bytes(*first))
    })
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
