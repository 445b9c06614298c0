//! Boards: who did how well in a suite, and who did how well together.

pub(super) mod cross_play;
pub(super) mod leaderboard;

use axum::Json;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use super::error::{ApiError, Code};

/// In which form somebody wants a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Json,
    Csv,
}

impl Format {
    /// What the query names, or else what the header `Accept` names first; JSON where neither knows one.
    fn wanted(named: Option<&str>, headers: &HeaderMap) -> Result<Self, ApiError> {
        match named {
            Some("json") => return Ok(Self::Json),
            Some("csv") => return Ok(Self::Csv),
            Some(_) => {
                let detail = "format must be one of json, csv";
                return Err(ApiError::new(Code::Malformed, detail));
            }
            None => {}
        }
        let accepted =
            headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
        let named = accepted.flat_map(|value| value.split(',')).find_map(|range| {
            match range.split(';').next().unwrap_or_default().trim() {
                "text/csv" => Some(Self::Csv),
                "application/json" | "application/*" | "*/*" => Some(Self::Json),
                _ => None,
            }
        });
        Ok(named.unwrap_or(Self::Json))
    }

    /// An answer in this form. One that does not end the list names the next page.
    fn answer<T: Serialize>(
        self,
        page: &T,
        csv: impl FnOnce(&T) -> String,
        next: Option<String>,
    ) -> Response {
        let mut answer = match self {
            Self::Json => Json(page).into_response(),
            Self::Csv => {
                let kind = [(header::CONTENT_TYPE, "text/csv; charset=utf-8")];
                (kind, csv(page)).into_response()
            }
        };
        let headers = answer.headers_mut();
        headers.insert(header::VARY, header::HeaderValue::from_static("accept"));
        if let Some(next) = next.and_then(|next| header::HeaderValue::try_from(next).ok()) {
            headers.insert("x-next-cursor", next);
        }
        answer
    }
}
