//! Every route, in one table: its handler, which server of a cluster answers, who may ask, how urgent it is, and whether it waits.
//!
//! Method and path are those that the handler declares: a test asks every operation of the OpenAPI document for its row here.

use std::collections::HashMap;
use std::sync::LazyLock;

use axum::http::Method;
use utoipa::openapi::security::SecurityRequirement;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::{
    App, agent, audit, boards, claims, clock, competitions, episodes, exports, host, imports, keys,
    runs, servers, swarm,
};
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

/// Makes a table of routes, and the function that adds their handlers to a router.
macro_rules! routes_of {
    (
        $(#[$doc:meta])* $rows:ident, $add:ident:
        $($method:ident $path:literal => $($handler:ident)::+, $at:ident, $who:ident
            $(, $fact:ident $(($play:path))?)*;)*
    ) => {
        $(#[$doc])*
        pub(super) const $rows: &[RouteRow] =
            &[$(row(stringify!($method), $path, $at, $who)$(.$fact($($play)?))*),*];

        fn $add(router: OpenApiRouter<App>) -> OpenApiRouter<App> {
            router$(.routes(routes!($($handler)::+)))*
        }
    };
}

routes_of! {
    /// The routes by which games are played come first: they are found first.
    PLAYS, add_plays:
    GET "/obs" => agent::obs::get_obs, Token, Seat, plays(Play::Look);
    POST "/act" => agent::act::post_act, Token, Seat, plays(Play::Act);
    GET "/swarm/obs" => swarm::obs::get_swarm_obs, Token, Swarm, plays(Play::SwarmLook);
    POST "/swarm/act" => swarm::act::post_swarm_act, Token, Swarm, plays(Play::SwarmAct);
}

routes_of! {
    /// All other routes that the OpenAPI document describes.
    ROWS, add_others:
    GET "/swarm/acts" => swarm::acts::get_swarm_acts, Token, Swarm;
    GET "/api/v1/audit" => audit::list_audit, Anywhere, Key;
    POST "/api/v1/clock/confirm" => clock::confirm_clock, Anywhere, Key, urgent;
    GET "/api/v1/competitions" => competitions::list::list_competitions, Anywhere, Anyone;
    POST "/api/v1/competitions" => competitions::create::create_competition, NewCompetition, Key;
    GET "/api/v1/competitions/{id}" => competitions::show::show_competition, Anywhere, Anyone;
    PATCH "/api/v1/competitions/{id}"
        => competitions::change::change_competition, Competition, Key, urgent;
    GET "/api/v1/competitions/{id}/actions"
        => competitions::actions::list_actions, Anywhere, Anyone;
    GET "/api/v1/competitions/{id}/announcements"
        => competitions::announcements::list_announcements, Anywhere, Anyone;
    POST "/api/v1/competitions/{id}/announcements"
        => competitions::announcements::announce, Competition, Key, urgent;
    GET "/api/v1/competitions/{id}/attempts"
        => competitions::attempts::list_attempts, Anywhere, Key;
    POST "/api/v1/competitions/{id}/attempts"
        => competitions::start::start_attempt, Competition, Key, urgent;
    POST "/api/v1/competitions/{id}/attempts/{run}/void"
        => competitions::void::void_attempt, Competition, Key, urgent;
    GET "/api/v1/competitions/{id}/board" => competitions::board::show_board, Anywhere, Anyone;
    POST "/api/v1/competitions/{id}/cancel"
        => competitions::cancel::cancel_competition, Competition, Key, urgent;
    GET "/api/v1/competitions/{id}/codes" => competitions::codes::list_codes, Anywhere, Key;
    POST "/api/v1/competitions/{id}/codes" => competitions::codes::create_codes, Competition, Key;
    POST "/api/v1/competitions/{id}/codes/revoke"
        => competitions::codes::revoke_codes, Competition, Key, urgent;
    GET "/api/v1/competitions/{id}/contacts"
        => competitions::contacts::list_contacts, Anywhere, Key;
    GET "/api/v1/competitions/{id}/entrants"
        => competitions::entrants::list_entrants, Anywhere, Anyone;
    POST "/api/v1/competitions/{id}/entrants"
        => competitions::register::register_entrant, Competition, AnyoneOrKey;
    GET "/api/v1/competitions/{id}/entrants/{entrant}"
        => competitions::entrants::show_entrant, Anywhere, Key;
    PATCH "/api/v1/competitions/{id}/entrants/{entrant}"
        => competitions::change_entrant::change_entrant, Competition, Key, urgent;
    DELETE "/api/v1/competitions/{id}/entrants/{entrant}"
        => competitions::change_entrant::erase_entrant, Competition, Key;
    POST "/api/v1/competitions/{id}/entrants/{entrant}/key"
        => competitions::replace_key::replace_entrant_key, Competition, Key, urgent;
    GET "/api/v1/competitions/{id}/entrants/{entrant}/members"
        => competitions::members::list_members, Anywhere, Key;
    POST "/api/v1/competitions/{id}/entrants/{entrant}/members"
        => competitions::members::add_member, Competition, Key;
    DELETE "/api/v1/competitions/{id}/entrants/{entrant}/members/{member}"
        => competitions::members::remove_member, Competition, Key;
    POST "/api/v1/competitions/{id}/exclusions"
        => competitions::exclude::exclude_entrants, Competition, Key, urgent;
    POST "/api/v1/competitions/{id}/practice"
        => competitions::practice::start_practice, Competition, Key;
    GET "/api/v1/cross-play" => boards::cross_play::show_cross_play, Anywhere, Anyone;
    GET "/api/v1/episodes" => episodes::list::list_episodes, Anywhere, Anyone;
    POST "/api/v1/episodes" => episodes::create::create_episode, New, AnyoneOrKey;
    GET "/api/v1/episodes/{id}" => episodes::show::show_episode, Episode, Anyone;
    DELETE "/api/v1/episodes/{id}" => episodes::abort::abort_episode, Episode, NoSeat, urgent;
    GET "/api/v1/episodes/{id}/claims" => claims::list::list_claims, Episode, Anyone;
    POST "/api/v1/episodes/{id}/claims"
        => claims::create::create_claim, Episode, AnyoneOrKey, urgent;
    GET "/api/v1/episodes/{id}/events" => episodes::events::stream_events, Episode, Anyone, waits;
    POST "/api/v1/episodes/{id}/fork" => episodes::fork::fork_episode, Fork, AnyoneOrKey;
    GET "/api/v1/episodes/{id}/journal" => episodes::journal::read_journal, Episode, Anyone;
    GET "/api/v1/episodes/{id}/line" => episodes::worth::show_reference_line, Episode, Anyone;
    GET "/api/v1/episodes/{id}/metrics" => episodes::metrics::show_episode_metrics, Episode, Anyone;
    POST "/api/v1/episodes/{id}/repeat"
        => episodes::repeat::repeat_episode, Episode, NoSeat, urgent;
    GET "/api/v1/episodes/{id}/replay" => episodes::replay::show_replay, Episode, Anyone;
    GET "/api/v1/episodes/{id}/rounds/{round}/agents/{agent}"
        => episodes::agent::show_agent_round, Episode, Anyone;
    GET "/api/v1/episodes/{id}/scores" => episodes::scores::show_scores, Episode, Anyone;
    POST "/api/v1/episodes/{id}/start" => episodes::start::start_episode, Episode, NoSeat, urgent;
    GET "/api/v1/episodes/{id}/state" => episodes::state::show_state, Episode, Anyone;
    GET "/api/v1/episodes/{id}/verification"
        => episodes::verification::show_verification, Episode, Anyone;
    POST "/api/v1/episodes/{id}/void" => episodes::void::void_episode, Episode, Key, urgent;
    GET "/api/v1/episodes/{id}/worth" => episodes::worth::show_episode_worth, Episode, Anyone;
    GET "/api/v1/exports/competitions/{id}"
        => competitions::export::export_competition, Anywhere, AnyoneOrKey;
    GET "/api/v1/exports/{file}" => exports::download::download_export, Anywhere, Anyone;
    GET "/api/v1/imports" => imports::list::list_imports, Anywhere, Anyone;
    GET "/api/v1/imports/{id}" => imports::show::show_import, Anywhere, Anyone;
    GET "/api/v1/imports/{id}/metrics" => imports::metrics::show_import_metrics, Anywhere, Anyone;
    GET "/api/v1/imports/{id}/replay" => imports::replay::show_import_replay, Anywhere, Anyone;
    GET "/api/v1/imports/{id}/rounds/{round}/agents/{agent}"
        => imports::agent::show_import_agent_round, Anywhere, Anyone;
    GET "/api/v1/imports/{id}/scores" => imports::scores::show_import_scores, Anywhere, Anyone;
    GET "/api/v1/imports/{id}/state" => imports::state::show_imported_state, Anywhere, Anyone;
    GET "/api/v1/imports/{id}/worth" => imports::worth::show_import_worth, Anywhere, Anyone;
    GET "/api/v1/keys" => keys::list::list_keys, Anywhere, Key;
    POST "/api/v1/keys" => keys::create::create_key, Anywhere, Key;
    DELETE "/api/v1/keys/{id}" => keys::revoke::revoke_key, Anywhere, Key, urgent;
    GET "/api/v1/keys/self" => keys::own::show_own_key, Anywhere, Key;
    GET "/api/v1/leaderboard" => boards::leaderboard::show_leaderboard, Anywhere, Anyone;
    GET "/api/v1/models" => episodes::models::list_models, Anywhere, Anyone;
    GET "/api/v1/nodes" => servers::list_servers, Anywhere, Key;
    GET "/api/v1/runs" => runs::list::list_runs, Anywhere, Anyone;
    POST "/api/v1/runs" => runs::create::create_run, New, AnyoneOrKey;
    GET "/api/v1/runs/{id}" => runs::show::show_run, Run, NoSeat;
    DELETE "/api/v1/runs/{id}" => runs::abort::abort_run, Run, NoSeat, urgent;
    GET "/api/v1/runs/{id}/events" => runs::events::stream_run_events, Run, NoSeat, waits;
    GET "/api/v1/runs/{id}/metrics" => runs::metrics::show_run_metrics, Run, NoSeat;
    GET "/api/v1/runs/{id}/scores" => runs::scores::show_run_scores, Run, NoSeat;
    POST "/api/v1/runs/{id}/token" => runs::token::replace_run_token, Run, NoSeat, urgent;
    GET "/api/v1/suites" => runs::suites::list_suites, Anywhere, Open;
    GET "/healthz" => host::show_health, Host, Open, tells_health;
    GET "/metrics" => host::show_metrics, Host, Open, tells_health;
    GET "/readyz" => host::show_readiness, Host, Open, tells_health;
}

/// The seat's tools for language models: a look among them may wait.
const MCP: RouteRow = row("POST", "/mcp", Token, Seat).repeatable().urgent().waits();

/// Adds all routes that the OpenAPI document describes.
pub(super) fn described(router: OpenApiRouter<App>) -> OpenApiRouter<App> {
    add_others(add_plays(router))
}

/// Rows of [`ROWS`] and [`MCP`] by path.
static BY_PATH: LazyLock<matchit::Router<HashMap<&'static str, Facts>>> = LazyLock::new(|| {
    let mut paths: HashMap<&str, HashMap<&str, Facts>> = HashMap::new();
    for row in ROWS.iter().chain([&MCP]) {
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
        let rows = PLAYS.iter().chain(ROWS);
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
