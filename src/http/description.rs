//! Parts of the OpenAPI document that belong to no handler: an introduction, and the errors that many routes share.

use std::fmt::Write;

use serde_json::json;
use utoipa::openapi::extensions::Extensions;
use utoipa::openapi::path::{Operation, Parameter, ParameterBuilder, ParameterIn};
use utoipa::openapi::security::{Http, HttpAuthScheme, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{
    Components, ContentBuilder, Object, ObjectBuilder, PathItem, Ref, RefOr, Required,
    ResponseBuilder, Schema, Type,
};
use utoipa::{Modify, OpenApi};

use super::error::Code;
use super::limits::Limits;
use super::routes::{PLAYS, ROWS};

/// The document without its routes.
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
        (name = "boards", description = "Leaderboards and cross-play."),
        (name = "data", description = "Many episodes in one file, and games that were read from files."),
        (name = "competitions", description = "Competitions on sealed seeds; actions of organizers."),
        (name = "keys", description = "Keys for people, made by organizers."),
        (name = "host", description = "Health of the server."),
    ),
    components(schemas(
        swarmbench_protocol::episode::EpisodeResult,
        swarmbench_protocol::episode::RoundEvent,
        swarmbench_protocol::problem::Problem,
        swarmbench_protocol::run::RunGame,
    )),
    servers((url = "/", description = "The server that gives this document.")),
    modifiers(&Rest)
)]
pub(super) struct Document;

/// Parts that attributes cannot express: the tables of errors and limits, and the tokens.
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

/// Describes the JSON in the data of an event.
fn describe_events(components: &mut Components) {
    let event = components.schemas.get_mut("StreamedEvent");
    let Some(RefOr::T(Schema::Object(event))) = event else { return };
    let Some(RefOr::T(Schema::Object(data))) = event.properties.get_mut("data") else { return };
    "application/json".clone_into(&mut data.content_media_type);
    let schemas = ["RoundEvent", "EpisodeResult"].map(|name| json!(Ref::from_schema_name(name)));
    data.extensions = Some(Extensions::from_iter([("contentSchema", json!({ "oneOf": schemas }))]));
}

/// Describes defaults of fields in words. With `default` in the schema, generated clients would treat the field as always present
/// and send it.
fn describe_defaults(components: &mut Components) {
    for schema in components.schemas.values_mut() {
        let RefOr::T(Schema::Object(schema)) = schema else { continue };
        for field in schema.properties.values_mut() {
            let (default, description) = match field {
                RefOr::T(Schema::Object(field)) => (field.default.take(), &mut field.description),
                RefOr::T(Schema::OneOf(field)) => (field.default.take(), &mut field.description),
                _ => continue,
            };
            let Some(default) = default else { continue };
            let default = default.as_str().map_or_else(|| default.to_string(), str::to_owned);
            let description = description.get_or_insert_default();
            let space = if description.is_empty() { "" } else { " " };
            write!(description, "{space}`{default}` where it is left out.")
                .expect("a string takes everything");
        }
    }
}

/// Schema of an event stream: generated clients read it as one text.
fn stream_of(event: &RefOr<Schema>) -> RefOr<Schema> {
    let mut stream = Object::with_type(Type::String);
    stream.description =
        Some("Server-Sent Events, each of the fields in `contentSchema`.".to_owned());
    "text/event-stream".clone_into(&mut stream.content_media_type);
    stream.extensions = Some(Extensions::from_iter([("contentSchema", json!(event))]));
    RefOr::T(Schema::Object(stream))
}

/// Tables of all errors and limits in Markdown.
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

/// Adds the errors that follow from a route's parameters, and the body of all errors, without replacing those that the route
/// declares. Describes streams and defaults so that generated clients handle them correctly.
pub(super) fn complete(document: &mut utoipa::openapi::OpenApi) {
    let components = document.components.get_or_insert_default();
    describe_events(components);
    describe_defaults(components);
    let schema = Ref::from_schema_name("Problem");
    let body = RefOr::T(ContentBuilder::new().schema(Some(schema)).build());
    for row in PLAYS.iter().chain(ROWS) {
        let item = document.paths.paths.get_mut(row.path);
        let operation = item.and_then(|item| operation(item, row.method));
        if let Some(operation) = operation.filter(|_| !row.facts.is_about_health) {
            operation.security = Some(row.facts.who.security());
        }
    }
    for (path, item) in &mut document.paths.paths {
        operations(item).for_each(|operation| describe_ids(path, operation));
    }
    for operation in document.paths.paths.values_mut().flat_map(operations) {
        let common = common_errors(operation);
        let responses = &mut operation.responses.responses;
        for (status, description) in common {
            let error = || ResponseBuilder::new().description(description).build().into();
            responses.entry(status.to_string()).or_insert_with(error);
        }
        for (status, response) in responses {
            let RefOr::T(response) = response else { continue };
            if status.as_str() >= "400" {
                response.content.insert("application/problem+json".to_owned(), body.clone());
            }
            if let Some(RefOr::T(stream)) = response.content.get_mut("text/event-stream") {
                stream.schema = stream.schema.as_ref().map(stream_of);
            }
        }
        // A route without a declared token needs none.
        operation.security.get_or_insert_with(|| vec![SecurityRequirement::default()]);
    }
}

/// Ids in paths: the collection before them, or none where any will do, the name of the parameter, and its description.
const IDS: [(&str, &str, &str); 8] = [
    ("competitions", "id", "The competition's id"),
    ("episodes", "id", "The episode's id"),
    ("imports", "id", "The game's id"),
    ("keys", "id", "The key's id"),
    ("runs", "id", "The run's id"),
    ("", "entrant", "The entrant's id"),
    ("", "member", "The member's id"),
    ("", "run", "The id of the attempt's run"),
];

/// Adds the ids in a path to the parameters of an operation that does not describe them itself. Parameters in the path come first, in its
/// order.
fn describe_ids(path: &str, operation: &mut Operation) {
    let mut declared = operation.parameters.take().unwrap_or_default();
    let segments: Vec<&str> = path.split('/').collect();
    let mut in_path = Vec::new();
    for (before, segment) in segments.iter().zip(segments.iter().skip(1)) {
        let Some(name) = segment.strip_prefix('{').and_then(|name| name.strip_suffix('}')) else {
            continue;
        };
        let is_it = |one: &RefOr<Parameter>| matches!(one, RefOr::T(one) if one.name == name);
        if let Some(at) = declared.iter().position(is_it) {
            in_path.push(declared.remove(at));
            continue;
        }
        let is_of = |(collection, id, _): &&(&str, &str, &str)| {
            *id == name && (collection.is_empty() || collection == before)
        };
        if let Some((_, _, description)) = IDS.iter().find(is_of) {
            let text = ObjectBuilder::new().schema_type(Type::String);
            let parameter = ParameterBuilder::new()
                .name(name)
                .parameter_in(ParameterIn::Path)
                .required(Required::True)
                .description(Some(*description))
                .schema(Some(text));
            in_path.push(parameter.build().into());
        }
    }
    in_path.append(&mut declared);
    operation.parameters = (!in_path.is_empty()).then_some(in_path);
}

fn operation<'a>(item: &'a mut PathItem, method: &str) -> Option<&'a mut Operation> {
    let PathItem { get, post, patch, delete, .. } = item;
    let found = match method {
        "GET" => get,
        "POST" => post,
        "PATCH" => patch,
        "DELETE" => delete,
        _ => return None,
    };
    found.as_mut()
}

fn operations(path: &mut PathItem) -> impl Iterator<Item = &mut Operation> {
    let PathItem { get, post, patch, delete, .. } = path;
    [get, post, patch, delete].into_iter().flatten()
}

fn common_errors(operation: &Operation) -> Vec<(u16, &'static str)> {
    let mut errors = vec![
        (429, "`rate_limited`, naming the `limit`; `Retry-After` says when to come again"),
        (503, "`overloaded` or `unavailable`; `Retry-After` says when to come again"),
    ];
    // Health and metrics declare no tokens and accept any query.
    if operation.security.is_some() {
        errors.push((400, "`malformed`: the query, or the body, cannot be read"));
    }
    let no_token = SecurityRequirement::default();
    if operation.security.iter().flatten().any(|token| *token != no_token) {
        errors.extend([
            (401, "`unauthorized`: a token is needed, or the one that came is unknown"),
            (500, "`internal`: a fault of the server, which was logged"),
        ]);
    }
    let is_in_path = |parameter: &RefOr<_>| match parameter {
        RefOr::T(Parameter { parameter_in, .. }) => *parameter_in == ParameterIn::Path,
        RefOr::Ref(_) => false,
    };
    if operation.parameters.iter().flatten().any(is_in_path) {
        errors.push((404, "`not_found`: unknown, or not for this token to know of"));
    }
    if operation.request_body.is_some() {
        errors.extend([
            (413, "`too_large`, naming the `limit`"),
            (415, "`unsupported_media_type`: not sent as `application/json`"),
            (422, "`invalid`, naming the `fields` and what is allowed; nothing was changed"),
        ]);
    }
    errors
}
