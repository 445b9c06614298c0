//! The OpenAPI document, and Swagger UI, whose files are part of the binary.

use std::collections::HashMap;
use std::io::{Cursor, Read};
use std::sync::{Arc, LazyLock};

use axum::extract::Path;
use axum::http::StatusCode;
use axum::http::header::{CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::response::{Html, IntoResponse, Redirect, Response};
use axum::routing::get;
use axum::{Json, Router};
use bytes::Bytes;
use utoipa::openapi::OpenApi;
use utoipa_swagger_ui_vendored::SWAGGER_UI_VENDORED;
use zip::ZipArchive;
use zip::result::ZipResult;

use super::App;

const INDEX: &str = "index.html";

/// Script that starts Swagger UI with our document.
const INITIALIZER: (&str, &[u8]) =
    ("swagger-initializer.js", include_bytes!("../../static/swagger-initializer.js"));

/// Files of Swagger UI by name, unpacked at the first request for one of them.
static FILES: LazyLock<HashMap<String, Bytes>> =
    LazyLock::new(|| unpack(SWAGGER_UI_VENDORED).expect("the archive is part of the binary"));

pub(super) fn routes(document: OpenApi) -> Router<App> {
    let document = Arc::new(document);
    Router::new()
        .route("/openapi.json", get(move || async move { Json(&*document).into_response() }))
        .route("/docs", get(page))
        .route("/docs/files", get(|| async { Redirect::to("/docs/files/") }))
        .route("/docs/files/", get(file))
        .route("/docs/files/{*rest}", get(file))
}

/// Files of the archive's folder `dist`, with our initializer.
fn unpack(archive: &[u8]) -> ZipResult<HashMap<String, Bytes>> {
    let mut archive = ZipArchive::new(Cursor::new(archive))?;
    let mut files = HashMap::new();
    for index in 0..archive.len() {
        let mut entry = archive.by_index(index)?;
        let path = entry.name()?.into_owned();
        let Some(name) = name_in_dist(&path) else { continue };
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes)?;
        files.insert(name.to_owned(), bytes.into());
    }
    let (name, bytes) = INITIALIZER;
    files.insert(name.to_owned(), Bytes::from_static(bytes));
    Ok(files)
}

/// File name within `swagger-ui-VERSION/dist/`.
fn name_in_dist(path: &str) -> Option<&str> {
    let (_, path) = path.split_once('/')?;
    path.strip_prefix("dist/").filter(|name| !name.is_empty())
}

/// Swagger UI needs inline styles, and the page's `<base>` needs `base-uri`.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
    connect-src 'self'; base-uri 'self'; form-action 'none'; frame-ancestors 'none'";

async fn page() -> impl IntoResponse {
    let page = String::from_utf8_lossy(&FILES[INDEX]);
    // File names in the page are relative to it.
    let page = page.replace("<head>", "<head><base href=\"/docs/files/\">");
    ([(CONTENT_SECURITY_POLICY, POLICY)], Html(page))
}

async fn file(name: Option<Path<String>>) -> Response {
    let name = match &name {
        None => INDEX,
        Some(Path(name)) if name == "/" => INDEX,
        Some(Path(name)) => name,
    };
    match FILES.get(name) {
        Some(bytes) => {
            let headers = [(CONTENT_TYPE, media_type(name)), (CONTENT_SECURITY_POLICY, POLICY)];
            (headers, bytes.clone()).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.') {
        Some((_, "html")) => "text/html",
        Some((_, "css")) => "text/css",
        Some((_, "js")) => "text/javascript",
        Some((_, "png")) => "image/png",
        _ => "application/octet-stream",
    }
}
