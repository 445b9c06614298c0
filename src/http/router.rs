//! Every route on one page.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use axum::Router;
use axum::extract::{MatchedPath, Request, State};
use axum::http::header::X_CONTENT_TYPE_OPTIONS;
use axum::http::{HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::request_id::{
    MakeRequestId, PropagateRequestIdLayer, RequestId, SetRequestIdLayer,
};
use tower_http::set_header::SetResponseHeaderLayer;
use tower_http::trace::TraceLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::error::{ApiError, Code};
use super::{
    App, admit, agent, audit, boards, claims, clock, competitions, description, docs, episodes,
    exports, host, imports, keys, mcp, pages, runs, stream, swarm,
};

/// All routes that the OpenAPI document describes.
pub(super) fn routes() -> OpenApiRouter<App> {
    let mut router = OpenApiRouter::with_openapi(description::Document::openapi())
        .routes(routes!(agent::obs::get_obs))
        .routes(routes!(agent::act::post_act))
        .routes(routes!(swarm::obs::get_swarm_obs))
        .routes(routes!(swarm::act::post_swarm_act))
        .routes(routes!(episodes::create::create_episode, episodes::list::list_episodes))
        .routes(routes!(episodes::show::show_episode, episodes::abort::abort_episode))
        .routes(routes!(episodes::fork::fork_episode))
        .routes(routes!(episodes::start::start_episode))
        .routes(routes!(episodes::state::show_state))
        .routes(routes!(episodes::events::stream_events))
        .routes(routes!(episodes::journal::read_journal))
        .routes(routes!(episodes::metrics::show_episode_metrics))
        .routes(routes!(episodes::replay::show_replay))
        .routes(routes!(episodes::agent::show_agent_round))
        .routes(routes!(episodes::scores::show_scores))
        .routes(routes!(episodes::verification::show_verification))
        .routes(routes!(claims::create::create_claim, claims::list::list_claims))
        .routes(routes!(episodes::void::void_episode))
        .routes(routes!(runs::create::create_run, runs::list::list_runs))
        .routes(routes!(runs::show::show_run, runs::abort::abort_run))
        .routes(routes!(runs::token::replace_run_token))
        .routes(routes!(runs::events::stream_run_events))
        .routes(routes!(runs::metrics::show_run_metrics))
        .routes(routes!(runs::scores::show_run_scores))
        .routes(routes!(runs::suites::list_suites))
        .routes(routes!(
            competitions::create::create_competition,
            competitions::list::list_competitions
        ))
        .routes(routes!(competitions::show::show_competition))
        .routes(routes!(competitions::codes::create_codes))
        .routes(routes!(
            competitions::register::register_entrant,
            competitions::entrants::list_entrants
        ))
        .routes(routes!(competitions::entrants::show_entrant, competitions::change::change_entrant))
        .routes(routes!(competitions::start::start_attempt, competitions::attempts::list_attempts))
        .routes(routes!(competitions::void::void_attempt))
        .routes(routes!(competitions::board::show_board))
        .routes(routes!(competitions::export::export_competition))
        .routes(routes!(audit::list_audit))
        .routes(routes!(exports::download::download_export))
        .routes(routes!(imports::list::list_imports))
        .routes(routes!(imports::show::show_import))
        .routes(routes!(imports::state::show_imported_state))
        .routes(routes!(imports::metrics::show_import_metrics))
        .routes(routes!(imports::replay::show_import_replay))
        .routes(routes!(imports::agent::show_import_agent_round))
        .routes(routes!(imports::scores::show_import_scores))
        .routes(routes!(keys::create::create_key, keys::list::list_keys))
        .routes(routes!(keys::revoke::revoke_key))
        .routes(routes!(boards::leaderboard::show_leaderboard))
        .routes(routes!(boards::cross_play::show_cross_play))
        .routes(routes!(host::show_health))
        .routes(routes!(host::show_readiness))
        .routes(routes!(host::show_metrics))
        .routes(routes!(clock::confirm_clock));
    description::complete(router.get_openapi_mut());
    router
}

/// The whole service.
pub fn router(app: App) -> Router {
    let (router, document) = routes().split_for_parts();
    let request_id = HeaderName::from_static("x-request-id");
    let layers = ServiceBuilder::new()
        .layer(SetRequestIdLayer::new(request_id.clone(), NumberedRequests::new(app.boot)))
        .layer(TraceLayer::new_for_http().make_span_with(span).on_response(()).on_failure(()))
        .layer(PropagateRequestIdLayer::new(request_id))
        .layer(SetResponseHeaderLayer::if_not_present(
            X_CONTENT_TYPE_OPTIONS,
            HeaderValue::from_static("nosniff"),
        ))
        .layer(CatchPanicLayer::custom(panicked));
    router
        .merge(docs::routes(document))
        .merge(mcp::routes())
        .merge(pages::routes())
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(middleware::from_fn_with_state(app.registry.clone(), stream::reserve))
        .layer(middleware::from_fn(admit::check_host))
        .layer(middleware::from_fn_with_state(app.clone(), admit::admit))
        .layer(middleware::from_fn(measure))
        .layer(layers)
        .with_state(app)
}

/// Names requests by the run of the server and their number in it: drawing a name for each would ask
/// the host for randomness with every request.
#[derive(Clone)]
struct NumberedRequests {
    boot: u64,
    next: Arc<AtomicU64>,
}

impl NumberedRequests {
    fn new(boot: u64) -> Self {
        Self { boot, next: Arc::default() }
    }
}

impl MakeRequestId for NumberedRequests {
    fn make_request_id<B>(&mut self, _: &axum::http::Request<B>) -> Option<RequestId> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let name = format!("{:016x}-{number}", self.boot);
        HeaderValue::try_from(name).ok().map(RequestId::new)
    }
}

/// A span for every request, with its id; never with its headers, which hold tokens.
fn span(request: &Request) -> tracing::Span {
    let id = request.headers().get("x-request-id").and_then(|id| id.to_str().ok());
    tracing::info_span!(
        "request",
        id = id.unwrap_or_default(),
        method = %request.method(),
        path = request.uri().path(),
    )
}

/// Counts and times requests by route, and logs them.
async fn measure(path: Option<MatchedPath>, request: Request, next: Next) -> Response {
    let started = Instant::now();
    let method = known(request.method());
    let response = next.run(request).await;
    let status = response.status();
    let taken = started.elapsed();
    let route = path.as_ref().map_or("none", MatchedPath::as_str).to_owned();
    // That the server is not ready is an answer to a question, and no news.
    let is_news = status.is_server_error() && route != "/readyz";
    // Only what there is gets a name in the metrics: clients could think of any number of others.
    if path.is_some() && status != StatusCode::METHOD_NOT_ALLOWED {
        metrics::histogram!("swarmbench_http_request_seconds", "route" => route.clone())
            .record(taken);
        metrics::counter!(
            "swarmbench_http_requests_total",
            "route" => route, "method" => method, "status" => status.as_u16().to_string()
        )
        .increment(1);
    }
    if is_news {
        tracing::warn!(status = status.as_u16(), taken_us = micros(taken), "answered");
    } else {
        tracing::debug!(status = status.as_u16(), taken_us = micros(taken), "answered");
    }
    response
}

/// The name of a method that some route has.
fn known(method: &Method) -> &'static str {
    let all = [
        (Method::GET, "GET"),
        (Method::POST, "POST"),
        (Method::PATCH, "PATCH"),
        (Method::DELETE, "DELETE"),
    ];
    let found = all.into_iter().find(|(known, _)| known == method);
    found.map_or("other", |(_, name)| name)
}

fn micros(taken: std::time::Duration) -> u64 {
    u64::try_from(taken.as_micros()).unwrap_or(u64::MAX)
}

async fn no_route(State(app): State<App>, request: Request) -> Response {
    if pages::wants_page(&request) {
        return pages::Shell::not_found().response(&app);
    }
    let path: String = request.uri().path().chars().take(200).collect();
    ApiError::new(Code::NotFound, format!("there is no route {path}; see /docs")).into_response()
}

async fn no_method(request: Request) -> ApiError {
    let detail = format!("{} is not answered here; see /docs", request.method());
    ApiError::new(Code::MethodNotAllowed, detail)
}

#[expect(clippy::needless_pass_by_value, reason = "the shape that the layer calls")]
fn panicked(panic: Box<dyn std::any::Any + Send>) -> Response {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("unknown");
    tracing::error!(panic = text, "a handler panicked");
    let error = ApiError::new(Code::Internal, "the server has a fault; it was logged");
    (StatusCode::INTERNAL_SERVER_ERROR, error).into_response()
}
