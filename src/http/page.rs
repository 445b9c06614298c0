//! Pages of lists: as many items as were requested, or as many as fit into one answer.

use axum::response::Response;
use serde::Serialize;

use super::App;
use super::agent::obs::json;
use super::error::ApiError;
use super::extract::write_cursor;
use crate::fair::Permit;

/// Rows that are read at once: as much work as an async thread does in one piece.
pub(super) const ROWS_MAX: u32 = 16;

/// Rows that are read at once where each has much behind it.
pub(super) const LARGE_ROWS_MAX: u32 = 8;

/// A page that is being written, item by item.
pub(super) struct Page {
    _turn: Permit,
    body: Vec<u8>,
    items: usize,
    items_max: usize,
    bytes_max: usize,
    /// The number of the last item, or where the page begins.
    place: Option<i64>,
    is_full: bool,
    has_ended: bool,
}

impl Page {
    /// An empty page after the item with a number, of at most so many items, once it is its turn.
    pub(super) async fn new(
        app: &App,
        after: Option<i64>,
        items_max: u32,
    ) -> Result<Self, ApiError> {
        Ok(Self {
            _turn: app.large_answer().await?,
            body: b"{\"items\":[".to_vec(),
            items: 0,
            items_max: items_max as usize,
            bytes_max: app.limits.answer_bytes_max - CURSOR_BYTES_MAX,
            place: after,
            is_full: false,
            has_ended: false,
        })
    }

    /// The number after which the next rows are to be read.
    pub(super) const fn place(&self) -> Option<i64> {
        self.place
    }

    /// How many rows are to be read next, at most so many; none where the page is full or the list has
    /// ended. One row more than fits is read to know whether there is another page.
    pub(super) fn wants(&self, most: u32) -> Option<u32> {
        let left = self.items_max - self.items + 1;
        let wants = u32::try_from(left).map_or(most, |left| left.min(most));
        (!self.is_full && !self.has_ended).then_some(wants)
    }

    /// Adds the rows that were read when it wanted so many; of each its number and how it is shown.
    pub(super) fn add<R, T: Serialize>(
        &mut self,
        wanted: u32,
        rows: Vec<R>,
        mut show: impl FnMut(R) -> Result<(i64, T), ApiError>,
    ) -> Result<(), ApiError> {
        self.has_ended = rows.len() < wanted as usize;
        for row in rows {
            if self.items == self.items_max {
                self.is_full = true;
                return Ok(());
            }
            let (number, item) = show(row)?;
            let before = self.body.len();
            if self.items > 0 {
                self.body.push(b',');
            }
            serde_json::to_writer(&mut self.body, &item).expect("string keys");
            // The first item is shown whatever its size: otherwise the list would never advance.
            if self.items > 0 && self.body.len() > self.bytes_max {
                self.body.truncate(before);
                self.is_full = true;
                return Ok(());
            }
            (self.items, self.place) = (self.items + 1, Some(number));
        }
        Ok(())
    }

    /// The answer. A page that was filled names the next one.
    pub(super) fn answer(mut self) -> Response {
        let next = self.place.filter(|_| self.is_full).map(write_cursor);
        self.body.extend_from_slice(b"],\"next_cursor\":");
        serde_json::to_writer(&mut self.body, &next).expect("a text");
        self.body.push(b'}');
        json(self.body)
    }
}

/// Bytes after the items.
pub(super) const CURSOR_BYTES_MAX: usize = 64;
