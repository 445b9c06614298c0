//! `GET /assets/{version}/…`: files that pages load. They are part of the binary, or read from a folder during development.

use std::io::Read as _;
use std::path::{Component, Path, PathBuf};

use axum::extract::{self, State};
use axum::http::header::{ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, VARY};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};

use super::super::App;
use super::super::error::ApiError;
use crate::pages::FILES;
use crate::telemetry::spawn_blocking;

/// Source of the files of pages.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// The binary.
    #[default]
    Program,
    /// A folder in place of `static/assets`: changes show when a page is reloaded.
    Folder(PathBuf),
}

/// Version in the addresses of files that come from a folder.
const FOLDER_VERSION: &str = "folder";

impl Source {
    /// Version in the addresses of all files.
    pub(super) fn version(&self) -> &str {
        match self {
            Self::Program => &FILES.version,
            Self::Folder(_) => FOLDER_VERSION,
        }
    }
}

/// A file of this program's version. Browsers may cache it forever: other content has another address.
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
            let folder = folder.clone();
            let read = move || read(&within(&folder, &name)?);
            let content = spawn_blocking(read).await.ok().flatten().ok_or_else(unknown)?;
            Ok((media_type, [(CACHE_CONTROL, "no-store")], content).into_response())
        }
    }
}

/// Maximum bytes of a file of a folder.
const FILE_BYTES_MAX: u64 = 4 * 1024 * 1024;

/// Content of a file, unless it is longer than that of any page.
fn read(path: &Path) -> Option<Vec<u8>> {
    let mut content = Vec::new();
    let mut file = std::fs::File::open(path).ok()?.take(FILE_BYTES_MAX + 1);
    let bytes = file.read_to_end(&mut content).ok()?;
    (bytes as u64 <= FILE_BYTES_MAX).then_some(content)
}

/// Path of a file in a folder; none for a name or a link that leads out of it. The folder itself may be a link, and links within it
/// are followed.
fn within(folder: &Path, name: &str) -> Option<PathBuf> {
    let is_name = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    let folder = folder.canonicalize().ok().filter(|_| is_name)?;
    let path = folder.join(name).canonicalize().ok()?;
    (path.starts_with(&folder) && path.is_file()).then_some(path)
}

/// Clients accept gzip if they name it, and not with quality 0.
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
        use std::os::unix::fs::symlink;
        let place = tempfile::tempdir().expect("a folder");
        let (folder, secret) = (place.path().join("assets"), place.path().join("secret.js"));
        std::fs::create_dir_all(folder.join("pages")).expect("a folder");
        std::fs::write(folder.join("pages/board.js"), "").expect("written");
        std::fs::write(&secret, "").expect("written");
        for (to, link) in [
            (secret.as_path(), folder.join("out.js")),
            (place.path(), folder.join("up")),
            (Path::new("pages/board.js"), folder.join("in.js")),
            (folder.as_path(), place.path().join("link")),
        ] {
            symlink(to, link).expect("a link");
        }
        let file = folder.join("pages/board.js").canonicalize().expect("a file");
        let linked = place.path().join("link");
        for (folder, name) in
            [(&folder, "pages/board.js"), (&folder, "in.js"), (&linked, "pages/board.js")]
        {
            assert_eq!(within(folder, name), Some(file.clone()), "{name}");
        }
        for bad in [
            "../secret.js",
            "pages/../../secret.js",
            "/etc/passwd",
            "out.js",
            "up/secret.js",
            "up",
            "pages",
            "none.js",
        ] {
            assert_eq!(within(&folder, bad), None, "{bad}");
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
