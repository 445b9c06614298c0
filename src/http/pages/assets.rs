//! `GET /assets/{version}/…`: the files that pages load. They are part of the program, or in a folder while somebody works on them.

use std::path::{Component, Path, PathBuf};

use axum::extract::{self, State};
use axum::http::header::{ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, VARY};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};

use super::super::App;
use super::super::error::ApiError;
use crate::pages::FILES;

/// Where the files of pages come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// The program itself.
    #[default]
    Program,
    /// A folder in the place of `static/assets`: what is changed there shows when a page is loaded again.
    Folder(PathBuf),
}

/// Part of the addresses of files that come from a folder.
const FOLDER_VERSION: &str = "folder";

impl Source {
    /// The folder of all files in addresses.
    pub(super) fn version(&self) -> &str {
        match self {
            Self::Program => &FILES.version,
            Self::Folder(_) => FOLDER_VERSION,
        }
    }
}

/// A file of the version that this program has. Browsers may keep it: other content has another address.
pub(super) async fn asset(
    State(app): State<App>,
    extract::Path((version, name)): extract::Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let unknown = || ApiError::not_found("the file");
    if version != app.pages.version() {
        return Err(unknown());
    }
    let media_type = [(CONTENT_TYPE, media_type(&name))];
    match &app.pages {
        Source::Program => {
            let file = FILES.get(&name).ok_or_else(unknown)?;
            let cached = [(CACHE_CONTROL, "public, max-age=31536000, immutable")];
            let varies = [(VARY, "accept-encoding")];
            if accepts_gzip(&headers) {
                let encoding = [(CONTENT_ENCODING, "gzip")];
                let body = file.compressed.clone();
                Ok((media_type, cached, varies, encoding, body).into_response())
            } else {
                Ok((media_type, cached, varies, file.plain.clone()).into_response())
            }
        }
        Source::Folder(folder) => {
            let path = within(folder, &name).ok_or_else(unknown)?;
            let content = tokio::fs::read(path).await.map_err(|_| unknown())?;
            Ok((media_type, [(CACHE_CONTROL, "no-store")], content).into_response())
        }
    }
}

/// The path of a file in a folder; none for a name that leads out of it.
fn within(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = Path::new(name);
    let is_inside = name.components().all(|part| matches!(part, Component::Normal(_)));
    is_inside.then(|| folder.join(name))
}

/// Whether a client takes gzip: it is named, and not with the quality 0.
fn accepts_gzip(headers: &HeaderMap) -> bool {
    let values =
        headers.get_all(ACCEPT_ENCODING).into_iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).any(|coding| {
        let (name, parameters) = coding.split_once(';').unwrap_or((coding, ""));
        let quality = parameters.trim().strip_prefix("q=").map(str::parse::<f32>);
        name.trim().eq_ignore_ascii_case("gzip") && quality.is_none_or(|quality| quality != Ok(0.0))
    })
}

fn media_type(name: &str) -> HeaderValue {
    HeaderValue::from_static(match name.rsplit_once('.') {
        Some((_, "js" | "mjs")) => "text/javascript; charset=utf-8",
        Some((_, "css")) => "text/css; charset=utf-8",
        Some((_, "svg")) => "image/svg+xml",
        _ => "text/plain; charset=utf-8",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_do_not_lead_out_of_the_folder() {
        let folder = Path::new("/srv/assets");
        assert_eq!(within(folder, "pages/board.js"), Some(folder.join("pages/board.js")));
        for bad in ["../serve.rs", "pages/../../x", "/etc/passwd"] {
            assert_eq!(within(folder, bad), None, "{bad}");
        }
    }

    #[test]
    fn gzip_is_sent_to_clients_that_take_it() {
        let accepts = |value: &'static str| {
            accepts_gzip(&HeaderMap::from_iter([(
                ACCEPT_ENCODING,
                HeaderValue::from_static(value),
            )]))
        };
        for yes in ["gzip", "br, GZIP", "gzip;q=0.5, br"] {
            assert!(accepts(yes), "{yes}");
        }
        for no in ["", "br", "gzip;q=0", "identity"] {
            assert!(!accepts(no), "{no}");
        }
        assert!(!accepts_gzip(&HeaderMap::new()));
    }
}
