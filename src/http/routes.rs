//! The facts of each route, in one table: which server of a cluster answers, who may ask, how urgent it is, and whether it waits.
//!
//! The handlers stand in [`super::router`]. A test asks every operation of the OpenAPI document for its row here.

use std::collections::HashMap;
use std::sync::LazyLock;

use axum::http::Method;
use utoipa::openapi::security::SecurityRequirement;

use crate::fair::Rank;

use At::{Anywhere, Competition, Episode, Fork, Host, New, NewCompetition, Run, Token};
use Who::{Anyone, AnyoneOrKey, Key, NoSeat, Open, Seat, Swarm};

/// Facts of a route.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facts {
    pub(super) at: At,
    pub(super) who: Who,
    /// Rank of its requests: urgent where a running game, the start of an attempt or an operator waits for the answer.
    pub(super) rank: Rank,
    /// The way by which a game is played, without the router.
    pub(super) play: Option<Play>,
    /// True if requests may wait for a round, or have a stream as their answer.
    pub(super) waits: bool,
    /// A request that was done twice has the effect of one: it only reads, or it is an act, and a repeated act gets the same
    /// receipt.
    pub(super) is_repeatable: bool,
    /// Operators read the server's health from it: it is answered however busy the background threads are.
    pub(super) is_about_health: bool,
}

/// Server of a cluster that answers a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum At {
    /// The server that receives it, even if its lease has expired: pages, documentation, and what is about this server alone.
    Host,
    /// Any server, from the database.
    Anywhere,
    /// The owner of what is played with the token.
    Token,
    /// The owner of the episode in the path.
    Episode,
    /// The owner of the episode in the path; any server that takes places where it has ended.
    Fork,
    /// The owner of the run in the path.
    Run,
    /// The owner of the competition in the path.
    Competition,
    /// Any server that takes places; the same one for the same `Idempotency-Key`.
    New,
    /// One server creates all competitions, so that no two get the same id.
    NewCompetition,
}

/// Tokens with which a route may be asked, as the OpenAPI document shows them. A test asks every operation with every kind of token,
/// and compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Who {
    /// Anybody: no token is read.
    Open,
    Seat,
    Swarm,
    Key,
    /// None, or a key.
    AnyoneOrKey,
    /// None, a swarm's token, or a key.
    NoSeat,
    /// None, or any token.
    Anyone,
}

impl Who {
    /// The tokens, for the document.
    pub(super) fn security(self) -> Vec<SecurityRequirement> {
        let names: &[&str] = match self {
            Open => &[""],
            Seat => &["seat"],
            Swarm => &["swarm"],
            Key => &["key"],
            AnyoneOrKey => &["", "key"],
            NoSeat => &["", "swarm", "key"],
            Anyone => &["", "seat", "swarm", "key"],
        };
        let requirement = |name: &&str| match *name {
            "" => SecurityRequirement::default(),
            name => SecurityRequirement::new::<_, [&str; 0], &str>(name, []),
        };
        names.iter().map(requirement).collect()
    }
}

/// The routes by which games are played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Play {
    Look,
    Act,
    SwarmLook,
    SwarmAct,
}

/// A row of the table.
pub(super) struct RouteRow {
    pub(super) method: &'static str,
    pub(super) path: &'static str,
    pub(super) facts: Facts,
}

const fn row(method: &'static str, path: &'static str, at: At, who: Who) -> RouteRow {
    let is_read = matches!(method.as_bytes(), b"GET");
    let facts = Facts {
        at,
        who,
        rank: Rank::Normal,
        play: None,
        waits: false,
        is_repeatable: is_read,
        is_about_health: false,
    };
    RouteRow { method, path, facts }
}

impl RouteRow {
    const fn plays(mut self, play: Play) -> Self {
        self.facts.play = Some(play);
        self.repeatable().urgent().waits()
    }

    const fn urgent(mut self) -> Self {
        self.facts.rank = Rank::Urgent;
        self
    }

    const fn repeatable(mut self) -> Self {
        self.facts.is_repeatable = true;
        self
    }

    const fn waits(mut self) -> Self {
        self.facts.waits = true;
        self
    }

    const fn tells_health(mut self) -> Self {
        self.facts.is_about_health = true;
        self.urgent()
    }
}

/// The routes by which games are played come first: they are found first.
pub(super) const PLAYS: [RouteRow; 4] = [
    row("GET", "/obs", Token, Seat).plays(Play::Look),
    row("POST", "/act", Token, Seat).plays(Play::Act),
    row("GET", "/swarm/obs", Token, Swarm).plays(Play::SwarmLook),
    row("POST", "/swarm/act", Token, Swarm).plays(Play::SwarmAct),
];

/// All other routes for programs.
pub(super) const ROWS: &[RouteRow] = &[
    // The seat's tools for language models: a look among them may wait.
    row("POST", "/mcp", Token, Seat).repeatable().urgent().waits(),
    row("GET", "/api/v1/audit", Anywhere, Key),
    row("POST", "/api/v1/clock/confirm", Anywhere, Key).urgent(),
    row("GET", "/api/v1/competitions", Anywhere, Anyone),
    row("POST", "/api/v1/competitions", NewCompetition, Key),
    row("GET", "/api/v1/competitions/{id}", Anywhere, Anyone),
    row("PATCH", "/api/v1/competitions/{id}", Competition, Key).urgent(),
    row("GET", "/api/v1/competitions/{id}/actions", Anywhere, Anyone),
    row("GET", "/api/v1/competitions/{id}/announcements", Anywhere, Anyone),
    row("POST", "/api/v1/competitions/{id}/announcements", Competition, Key).urgent(),
    row("GET", "/api/v1/competitions/{id}/attempts", Anywhere, Key),
    row("POST", "/api/v1/competitions/{id}/attempts", Competition, Key).urgent(),
    row("POST", "/api/v1/competitions/{id}/attempts/{run}/void", Competition, Key).urgent(),
    row("GET", "/api/v1/competitions/{id}/board", Anywhere, Anyone),
    row("POST", "/api/v1/competitions/{id}/cancel", Competition, Key).urgent(),
    row("GET", "/api/v1/competitions/{id}/codes", Anywhere, Key),
    row("POST", "/api/v1/competitions/{id}/codes", Competition, Key),
    row("POST", "/api/v1/competitions/{id}/codes/revoke", Competition, Key).urgent(),
    row("GET", "/api/v1/competitions/{id}/contacts", Anywhere, Key),
    row("GET", "/api/v1/competitions/{id}/entrants", Anywhere, Anyone),
    row("POST", "/api/v1/competitions/{id}/entrants", Competition, AnyoneOrKey),
    row("GET", "/api/v1/competitions/{id}/entrants/{entrant}", Anywhere, Key),
    row("PATCH", "/api/v1/competitions/{id}/entrants/{entrant}", Competition, Key).urgent(),
    row("DELETE", "/api/v1/competitions/{id}/entrants/{entrant}", Competition, Key),
    row("POST", "/api/v1/competitions/{id}/entrants/{entrant}/key", Competition, Key).urgent(),
    row("GET", "/api/v1/competitions/{id}/entrants/{entrant}/members", Anywhere, Key),
    row("POST", "/api/v1/competitions/{id}/entrants/{entrant}/members", Competition, Key),
    row(
        "DELETE",
        "/api/v1/competitions/{id}/entrants/{entrant}/members/{member}",
        Competition,
        Key,
    ),
    row("POST", "/api/v1/competitions/{id}/exclusions", Competition, Key).urgent(),
    row("POST", "/api/v1/competitions/{id}/practice", Competition, Key),
    row("GET", "/api/v1/cross-play", Anywhere, Anyone),
    row("GET", "/api/v1/episodes", Anywhere, Anyone),
    row("POST", "/api/v1/episodes", New, AnyoneOrKey),
    row("GET", "/api/v1/episodes/{id}", Episode, Anyone),
    row("DELETE", "/api/v1/episodes/{id}", Episode, NoSeat).urgent(),
    row("GET", "/api/v1/episodes/{id}/claims", Episode, Anyone),
    row("POST", "/api/v1/episodes/{id}/claims", Episode, AnyoneOrKey).urgent(),
    row("GET", "/api/v1/episodes/{id}/events", Episode, Anyone).waits(),
    row("POST", "/api/v1/episodes/{id}/fork", Fork, AnyoneOrKey),
    row("GET", "/api/v1/episodes/{id}/journal", Episode, Anyone),
    row("GET", "/api/v1/episodes/{id}/line", Episode, Anyone),
    row("GET", "/api/v1/episodes/{id}/metrics", Episode, Anyone),
    row("GET", "/api/v1/episodes/{id}/replay", Episode, Anyone),
    row("GET", "/api/v1/episodes/{id}/rounds/{round}/agents/{agent}", Episode, Anyone),
    row("GET", "/api/v1/episodes/{id}/scores", Episode, Anyone),
    row("POST", "/api/v1/episodes/{id}/start", Episode, NoSeat).urgent(),
    row("GET", "/api/v1/episodes/{id}/state", Episode, Anyone),
    row("GET", "/api/v1/episodes/{id}/verification", Episode, Anyone),
    row("POST", "/api/v1/episodes/{id}/void", Episode, Key).urgent(),
    row("GET", "/api/v1/episodes/{id}/worth", Episode, Anyone),
    row("GET", "/api/v1/exports/competitions/{id}", Anywhere, AnyoneOrKey),
    row("GET", "/api/v1/exports/{file}", Anywhere, Anyone),
    row("GET", "/api/v1/imports", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}/metrics", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}/replay", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}/rounds/{round}/agents/{agent}", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}/scores", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}/state", Anywhere, Anyone),
    row("GET", "/api/v1/imports/{id}/worth", Anywhere, Anyone),
    row("GET", "/api/v1/keys", Anywhere, Key),
    row("POST", "/api/v1/keys", Anywhere, Key),
    row("DELETE", "/api/v1/keys/{id}", Anywhere, Key).urgent(),
    row("GET", "/api/v1/keys/self", Anywhere, Key),
    row("GET", "/api/v1/leaderboard", Anywhere, Anyone),
    row("GET", "/api/v1/models", Anywhere, Anyone),
    row("GET", "/api/v1/nodes", Anywhere, Key),
    row("GET", "/api/v1/runs", Anywhere, Anyone),
    row("POST", "/api/v1/runs", New, AnyoneOrKey),
    row("GET", "/api/v1/runs/{id}", Run, NoSeat),
    row("DELETE", "/api/v1/runs/{id}", Run, NoSeat).urgent(),
    row("GET", "/api/v1/runs/{id}/events", Run, NoSeat).waits(),
    row("GET", "/api/v1/runs/{id}/metrics", Run, NoSeat),
    row("GET", "/api/v1/runs/{id}/scores", Run, NoSeat),
    row("POST", "/api/v1/runs/{id}/token", Run, NoSeat).urgent(),
    row("GET", "/api/v1/suites", Anywhere, Open),
    row("GET", "/healthz", Host, Open).tells_health(),
    row("GET", "/metrics", Host, Open).tells_health(),
    row("GET", "/readyz", Host, Open).tells_health(),
];

/// Rows of [`ROWS`] by path.
static BY_PATH: LazyLock<matchit::Router<HashMap<&'static str, Facts>>> = LazyLock::new(|| {
    let mut paths: HashMap<&str, HashMap<&str, Facts>> = HashMap::new();
    for row in ROWS {
        paths.entry(row.path).or_default().insert(row.method, row.facts);
    }
    let mut router = matchit::Router::new();
    for (path, methods) in paths {
        router.insert(path, methods).expect("the router of the handlers has the same paths");
    }
    router
});

impl Facts {
    /// Facts of a request's route.
    pub(super) fn of(method: &Method, path: &str) -> Self {
        let method = if method == Method::HEAD { "GET" } else { method.as_str() };
        let is_it = |row: &&RouteRow| row.path == path && row.method == method;
        if let Some(play) = PLAYS.iter().find(is_it) {
            return play.facts;
        }
        let known = BY_PATH.at(path).ok().and_then(|found| found.value.get(method).copied());
        known.unwrap_or_else(|| Self::unknown(method, path))
    }

    /// Facts of a page or a file, or of a path without a route.
    fn unknown(method: &str, path: &str) -> Self {
        let at = if path.starts_with("/api/") { Anywhere } else { Host };
        let is_repeatable = method == "GET";
        Self { is_repeatable, ..row("", "", at, Open).facts }
    }
}

#[cfg(test)]
mod tests {
    use super::super::router::routes;
    use super::*;

    #[test]
    fn every_operation_of_the_document_has_its_row() {
        let mut router = routes();
        let document = serde_json::to_value(router.get_openapi_mut()).expect("string keys");
        let mut documented: Vec<(String, String)> = Vec::new();
        for (path, item) in document["paths"].as_object().expect("paths") {
            // Each method has an object; other fields of a path are texts and lists.
            let methods = item.as_object().expect("a path").iter().filter(|(_, of)| of.is_object());
            documented.extend(methods.map(|(method, _)| (path.clone(), method.to_uppercase())));
        }
        let rows = PLAYS.iter().chain(ROWS).filter(|row| row.path != "/mcp");
        let mut rows: Vec<(String, String)> =
            rows.map(|row| (row.path.to_owned(), row.method.to_owned())).collect();
        documented.sort();
        rows.sort();
        assert_eq!(rows, documented);
    }

    #[test]
    fn a_request_finds_the_facts_of_its_route() {
        let at = |method: Method, path: &str| Facts::of(&method, path).at;
        assert_eq!(at(Method::POST, "/act"), Token);
        assert_eq!(at(Method::GET, "/act"), Host, "no such route");
        assert_eq!(at(Method::HEAD, "/api/v1/episodes/ep_1"), Episode);
        assert_eq!(at(Method::POST, "/api/v1/episodes/ep%5F1/fork"), Fork);
        assert_eq!(at(Method::GET, "/api/v1/competitions/cmp_1"), Anywhere);
        assert_eq!(at(Method::PATCH, "/api/v1/competitions/cmp_1"), Competition);
        assert_eq!(at(Method::GET, "/api/v1/nothing"), Anywhere);
        assert_eq!(at(Method::GET, "/assets/1/app.js"), Host);
        assert_eq!(Facts::of(&Method::POST, "/nothing").rank, Rank::Normal);
        assert_eq!(Facts::of(&Method::POST, "/api/v1/episodes").rank, Rank::Normal);
        assert_eq!(Facts::of(&Method::POST, "/act").rank, Rank::Urgent);
        assert!(!Facts::of(&Method::POST, "/api/v1/episodes").is_repeatable);
    }
}
