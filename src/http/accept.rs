//! Content negotiation by the header `Accept`.

use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::Response;

/// A type by which any file can be requested. Generated clients that do not know a file's own type ask for it.
const BYTES: &str = "application/octet-stream";

/// Bytes of a file; this type only describes them.
#[derive(utoipa::ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "a file is streamed, not made of this type")]
pub(super) struct Binary(Vec<u8>);

/// Result of `known` for the first media type in `Accept` that it knows. Weights (`q`) are ignored.
pub(super) fn first<T>(headers: &HeaderMap, known: impl Fn(&str) -> Option<T>) -> Option<T> {
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    accepted
        .flat_map(|value| value.split(','))
        .find_map(|range| known(range.split(';').next().unwrap_or_default().trim()))
}

/// Content type of a file: its own, or plain bytes where `Accept` names these first.
pub(super) fn file_type(headers: &HeaderMap, own: &'static str) -> &'static str {
    let known = |range: &str| match range {
        BYTES => Some(BYTES),
        "application/*" | "*/*" => Some(own),
        range => (range == own).then_some(own),
    };
    first(headers, known).unwrap_or(own)
}

/// Adds `Vary: accept`.
pub(super) fn by_accept(mut answer: Response) -> Response {
    answer.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    answer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_its_own_type_unless_bytes_come_first() {
        for (accept, expected) in [
            (None, "application/zip"),
            (Some("*/*"), "application/zip"),
            (Some("text/html, */*;q=0.8"), "application/zip"),
            (Some("application/octet-stream"), BYTES),
            (Some("application/zip, application/octet-stream"), "application/zip"),
            (Some("application/vnd.apache.parquet, application/octet-stream;q=0.9"), BYTES),
            (Some("text/html"), "application/zip"),
        ] {
            let mut headers = HeaderMap::new();
            if let Some(accept) = accept {
                headers.insert(header::ACCEPT, HeaderValue::from_static(accept));
            }
            assert_eq!(file_type(&headers, "application/zip"), expected, "{accept:?}");
        }
    }
}
