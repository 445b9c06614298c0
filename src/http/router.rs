//! The router: routes of the OpenAPI document, pages and documentation.

use axum::Router;
use axum::extract::{MatchedPath, Request, State};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;

use super::error::{ApiError, Code};
use super::{App, description, docs, mcp, pages, routes};

/// Routes that the OpenAPI document describes.
pub(super) fn routes() -> OpenApiRouter<App> {
    let document = OpenApiRouter::with_openapi(description::Document::openapi());
    let mut router = routes::described(document);
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
