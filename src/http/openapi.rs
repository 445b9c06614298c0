//! The OpenAPI document: made from the handlers, committed, and compared by a test.

use std::fmt::Write;

use utoipa::openapi::security::{Http, HttpAuthScheme, SecurityScheme};
use utoipa::{Modify, OpenApi};

use super::error::Code;
use super::limits::Limits;

/// What is not said at a handler.
#[derive(OpenApi)]
#[openapi(
    info(
        title = "swarmbench",
        description = "A server on which language models play SwarmBench: agents look (`GET /obs`) and act (`POST /act`); when all have acted the round is resolved, scored and journaled.\n\nErrors are `application/problem+json` with a stable `code`. Tokens go in `Authorization: Bearer …`. Bodies are `application/json`, at most 256 KiB (8 MiB for `/swarm/act`).",
        license(name = "MIT", identifier = "MIT"),
    ),
    tags(
        (name = "agent", description = "One agent of one episode: two calls and a seat token."),
        (name = "swarm", description = "Several seats in one call, with a swarm token."),
        (name = "episodes", description = "Create, watch and end episodes."),
        (name = "runs", description = "Suites of games for one model: start, watch and end runs."),
        (name = "boards", description = "Who did how well."),
        (name = "data", description = "Many episodes in one file, and games that were read from files."),
        (name = "competitions", description = "Competitions on sealed seeds; what organizers did."),
        (name = "keys", description = "Keys for people, made by organizers."),
        (name = "host", description = "How the server does."),
    ),
    components(schemas(
        crate::wire::episode::EpisodeResult,
        crate::wire::episode::RoundEvent,
        crate::wire::problem::Problem,
        crate::wire::run::RunGame,
    )),
    modifiers(&Rest)
)]
pub(super) struct Document;

/// What cannot be said in an attribute: the tables of errors and limits, and the tokens.
struct Rest;

impl Modify for Rest {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let description = document.info.description.get_or_insert_default();
        description.push_str(&tables());
        let components = document.components.get_or_insert_default();
        for (name, description) in [
            ("seat", "A seat token: one agent of one episode."),
            (
                "swarm",
                "A swarm token: all seats of the creator of an episode, or of a run, and its holder stands where the creator does; or the seats of one claim.",
            ),
            (
                "key",
                "The key of a person: the episodes created with it are the holder's. An organizer's key opens everything.",
            ),
        ] {
            let mut scheme = Http::new(HttpAuthScheme::Bearer);
            scheme.description = Some(description.to_owned());
            components.add_security_scheme(name, SecurityScheme::Http(scheme));
        }
    }
}

/// All errors and all limits, in Markdown.
fn tables() -> String {
    let mut text = "\n\n## Errors\n\n| status | code | |\n| --- | --- | --- |\n".to_owned();
    for code in Code::ALL {
        let (name, status, title) = code.row();
        writeln!(text, "| {status} | `{name}` | {title} |").expect("a string takes everything");
    }
    text.push_str(
        "\n## Limits\n\nThe unit is part of the name.\n\n| limit | value |\n| --- | ---: |\n",
    );
    for (name, value) in Limits::default().table() {
        writeln!(text, "| `{name}` | {value} |").expect("a string takes everything");
    }
    text
}

/// The document, as it is committed and served.
///
/// # Panics
/// Never: the document has string keys.
#[must_use]
pub fn document() -> String {
    let mut text = super::router::routes().to_openapi().to_pretty_json().expect("string keys");
    text.push('\n');
    text
}
