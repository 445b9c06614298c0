//! Boards: leaderboards and cross-play.

pub(super) mod cross_play;
pub(super) mod leaderboard;
pub(super) mod metrics;

use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};

use super::App;
use super::accept;
use super::error::{ApiError, Code};
use super::page::{CURSOR_BYTES_MAX, PAGE_ITEMS_DEFAULT, page_limit};
use swarmbench_protocol::table::Table;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Json,
    Csv,
}

impl Format {
    /// The format that the query names, else the first known one in `Accept`, else JSON.
    fn wanted(named: Option<&str>, headers: &HeaderMap) -> Result<Self, ApiError> {
        if let Some(format) = Self::named(named)? {
            return Ok(format);
        }
        let known = |range: &str| match range {
            "text/csv" => Some(Self::Csv),
            "application/json" | "application/*" | "*/*" => Some(Self::Json),
            _ => None,
        };
        Ok(accept::first(headers, known).unwrap_or(Self::Json))
    }

    pub(super) fn named(name: Option<&str>) -> Result<Option<Self>, ApiError> {
        match name {
            None => Ok(None),
            Some("json") => Ok(Some(Self::Json)),
            Some("csv") => Ok(Some(Self::Csv)),
            Some(_) => Err(ApiError::new(Code::Malformed, "format must be one of json, csv")),
        }
    }

    /// Maximum rows of a page: the default for CSV is larger.
    fn page_limit(self, app: &App, asked: Option<u32>) -> Result<usize, ApiError> {
        let usual = match self {
            Self::Json => PAGE_ITEMS_DEFAULT,
            Self::Csv => app.limits.page_items_max,
        };
        Ok(page_limit(app, asked, usual)? as usize)
    }

    /// A response with a page of at most `limit` rows, made by `page`; fewer if they exceed `bytes_max`.
    pub(super) fn page<T: Table>(
        self,
        bytes_max: usize,
        limit: usize,
        page: impl Fn(usize) -> T,
    ) -> Response {
        let made = page(limit);
        let written = self.written(&made);
        if written.len() <= bytes_max {
            return self.answer(&made, written);
        }
        let made = page(self.fitting(&made, written.len(), bytes_max));
        self.answer(&made, self.written(&made))
    }

    fn written<T: Table>(self, page: &T) -> Vec<u8> {
        match self {
            Self::Json => serde_json::to_vec(page).expect("string keys"),
            Self::Csv => page.csv().into_bytes(),
        }
    }

    /// Rows of a page of `bytes` bytes that fit into `bytes_max`: at least one, or a list would never advance.
    fn fitting<T: Table>(self, page: &T, bytes: usize, bytes_max: usize) -> usize {
        let (rows, columns) = (page.rows(), page.columns());
        let size = |row: &T::Row| match self {
            Self::Json => serde_json::to_vec(row).expect("string keys").len() + 1,
            Self::Csv => page.csv_line(&columns, row).len(),
        };
        let mut left = bytes + CURSOR_BYTES_MAX;
        let without = rows.iter().rev().take_while(|row| {
            let is_over = left > bytes_max;
            if is_over {
                left = left.saturating_sub(size(row));
            }
            is_over
        });
        rows.len().saturating_sub(without.count()).max(1)
    }

    /// A response in this format. A page that does not end the list names the next one.
    fn answer<T: Table>(self, page: &T, body: Vec<u8>) -> Response {
        let kind = match self {
            Self::Json => "application/json",
            Self::Csv => "text/csv; charset=utf-8",
        };
        let mut answer = ([(header::CONTENT_TYPE, kind)], body).into_response();
        if let Some(next) = page.next_cursor().and_then(|next| HeaderValue::try_from(next).ok()) {
            answer.headers_mut().insert("x-next-cursor", next);
        }
        answer
    }
}
