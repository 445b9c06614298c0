//! Every route on one page.

use axum::Router;
use axum::extract::{MatchedPath, Request, State};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::error::{ApiError, Code};
use super::{
    App, agent, audit, boards, claims, clock, competitions, description, docs, episodes, exports,
    host, imports, keys, mcp, pages, runs, servers, swarm,
};

/// Routes that the OpenAPI document describes.
pub(super) fn routes() -> OpenApiRouter<App> {
    let mut router = OpenApiRouter::with_openapi(description::Document::openapi())
        .routes(routes!(agent::obs::get_obs))
        .routes(routes!(agent::act::post_act))
        .routes(routes!(swarm::obs::get_swarm_obs))
        .routes(routes!(swarm::act::post_swarm_act))
        .routes(routes!(episodes::create::create_episode, episodes::list::list_episodes))
        .routes(routes!(episodes::models::list_models))
        .routes(routes!(episodes::show::show_episode, episodes::abort::abort_episode))
        .routes(routes!(episodes::fork::fork_episode))
        .routes(routes!(episodes::start::start_episode))
        .routes(routes!(episodes::state::show_state))
        .routes(routes!(episodes::events::stream_events))
        .routes(routes!(episodes::journal::read_journal))
        .routes(routes!(episodes::metrics::show_episode_metrics))
        .routes(routes!(episodes::worth::show_episode_worth))
        .routes(routes!(episodes::worth::show_reference_line))
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
        .routes(routes!(
            competitions::show::show_competition,
            competitions::change::change_competition
        ))
        .routes(routes!(competitions::cancel::cancel_competition))
        .routes(routes!(competitions::actions::list_actions))
        .routes(routes!(
            competitions::announcements::list_announcements,
            competitions::announcements::announce
        ))
        .routes(routes!(competitions::codes::create_codes, competitions::codes::list_codes))
        .routes(routes!(competitions::codes::revoke_codes))
        .routes(routes!(competitions::contacts::list_contacts))
        .routes(routes!(competitions::exclude::exclude_entrants))
        .routes(routes!(
            competitions::register::register_entrant,
            competitions::entrants::list_entrants
        ))
        .routes(routes!(
            competitions::entrants::show_entrant,
            competitions::change_entrant::change_entrant,
            competitions::change_entrant::erase_entrant
        ))
        .routes(routes!(competitions::replace_key::replace_entrant_key))
        .routes(routes!(competitions::members::list_members, competitions::members::add_member))
        .routes(routes!(competitions::members::remove_member))
        .routes(routes!(competitions::practice::start_practice))
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
        .routes(routes!(imports::worth::show_import_worth))
        .routes(routes!(imports::replay::show_import_replay))
        .routes(routes!(imports::agent::show_import_agent_round))
        .routes(routes!(imports::scores::show_import_scores))
        .routes(routes!(keys::create::create_key, keys::list::list_keys))
        .routes(routes!(keys::own::show_own_key))
        .routes(routes!(keys::revoke::revoke_key))
        .routes(routes!(boards::leaderboard::show_leaderboard))
        .routes(routes!(boards::cross_play::show_cross_play))
        .routes(routes!(servers::list_servers))
        .routes(routes!(host::show_health))
        .routes(routes!(host::show_readiness))
        .routes(routes!(host::show_metrics))
        .routes(routes!(clock::confirm_clock));
    description::complete(router.get_openapi_mut());
    router
}

/// All routes, including those that the document leaves out.
pub(super) fn router(app: App) -> Router {
    let (router, document) = routes().split_for_parts();
    router
        .merge(docs::routes(document))
        .merge(mcp::routes())
        .merge(pages::routes())
        .fallback(no_route)
        .method_not_allowed_fallback(no_method)
        .layer(middleware::from_fn(name_route))
        .with_state(app)
}

/// Adds the matched route to the response, for the metrics.
async fn name_route(path: Option<MatchedPath>, request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    if let Some(path) = path {
        response.extensions_mut().insert(path);
    }
    response
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
