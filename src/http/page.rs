//! Pages of lists: as many items as were requested and fit into one response; and cursors.

use axum::response::Response;
use serde::Serialize;

use super::App;
use super::answer::json;
use super::error::{ApiError, Code};
use crate::fair::Permit;
use crate::ids::EpisodeKey;
use crate::store::StoreError;

/// Rows read at once: the work that an async thread does in one piece.
pub(super) const ROWS_MAX: u32 = 16;

/// Rows read at once where each needs further queries.
pub(super) const LARGE_ROWS_MAX: u32 = 8;

/// Factor of the rows read at once with the permit of a large response: enough for a page of the default size in one query.
const PIECES_WITH_PERMIT: u32 = 4;

/// Maximum bytes of a page that is made without the permit of a large response.
const SHORT_BYTES_MAX: usize = 64 * 1024;

/// A page that is written item by item. A page read in one piece needs no permit, so it is answered while others make long ones.
pub(super) struct Page {
    app: App,
    permit: Option<Permit>,
    body: Vec<u8>,
    items: usize,
    items_max: usize,
    bytes_max: usize,
    /// First character of its cursors.
    mark: char,
    /// Number of the last item; at first, of the item before the page.
    place: Option<i64>,
    is_full: bool,
    has_ended: bool,
}

/// Rows of a page, and the episode after which a sorted list continues, if filters left the page short.
pub(super) trait Found {
    type Row;
    fn split(self) -> (Vec<Self::Row>, Option<EpisodeKey>);
}

impl<R> Found for Vec<R> {
    type Row = R;
    fn split(self) -> (Self, Option<EpisodeKey>) {
        (self, None)
    }
}

impl<R> Found for (Vec<R>, Option<EpisodeKey>) {
    type Row = R;
    fn split(self) -> Self {
        self
    }
}

impl Page {
    /// An empty page of at most `limit` items, `usual` by default.
    pub(super) fn new(
        app: &App,
        limit: Option<u32>,
        usual: u32,
        cursor: Option<&str>,
    ) -> Result<Self, ApiError> {
        let items_max = match limit {
            None => usual,
            asked => page_limit(app, asked, usual)?,
        };
        let place = read_cursor(cursor)?;
        Ok(Self {
            app: app.clone(),
            permit: None,
            body: b"{\"items\":[".to_vec(),
            items: 0,
            items_max: items_max as usize,
            bytes_max: app.limits.answer_bytes_max - CURSOR_BYTES_MAX,
            mark: NEWEST,
            place,
            is_full: false,
            has_ended: false,
        })
    }

    /// The page after `cursor` in an order whose cursors begin with `mark`: a cursor of another order names another place.
    pub(super) fn ordered(mut self, mark: char, cursor: Option<&str>) -> Result<Self, ApiError> {
        self.mark = mark;
        self.place = read_cursor_of(mark, cursor)?;
        Ok(self)
    }

    /// Fills the page and responds with it. `read` gets the number of the last item and the rows to read, based on `rows_max`;
    /// `show` returns the number of a row and its item.
    pub(super) async fn fill<V: Found, T: Serialize, F>(
        mut self,
        rows_max: u32,
        mut read: impl FnMut(Option<i64>, u32) -> F,
        mut show: impl FnMut(V::Row) -> Result<(i64, T), ApiError>,
    ) -> Result<Response, ApiError>
    where
        F: Future<Output = Result<V, StoreError>>,
    {
        if self.items_max > rows_max as usize {
            self.permit = self.app.heavy.large_answer_at_once();
        }
        loop {
            let pieces = if self.permit.is_some() { PIECES_WITH_PERMIT } else { 1 };
            let Some(wanted) = self.wants(pieces * rows_max) else { return Ok(self.answer()) };
            let (rows, seen) = read(self.place, wanted).await?.split();
            self.add(wanted, rows, &mut show)?;
            if let (Some(seen), false) = (seen, self.is_full) {
                (self.is_full, self.place) = (true, Some(seen.0));
            }
            // Short lists, and pages of the default size, are answered while others make long ones.
            let is_long = self.items_max > (PIECES_WITH_PERMIT * rows_max) as usize
                || self.body.len() > SHORT_BYTES_MAX;
            if is_long && self.items_max > rows_max as usize && self.wants(rows_max).is_some() {
                self.needs_permit().await?;
            }
        }
    }

    /// Waits for the permit of a response that is made in more than one piece.
    pub(super) async fn needs_permit(&mut self) -> Result<(), ApiError> {
        if self.permit.is_none() {
            self.permit = Some(self.app.heavy.large_answer().await?);
        }
        Ok(())
    }

    /// Number after which the next rows are read.
    pub(super) const fn place(&self) -> Option<i64> {
        self.place
    }

    /// Rows to read next, at most `most`; none if the page is full or the list has ended. One row more than fits is read, to know
    /// whether there is another page.
    fn wants(&self, most: u32) -> Option<u32> {
        let left = self.items_max - self.items + 1;
        let wants = u32::try_from(left).map_or(most, |left| left.min(most));
        (!self.is_full && !self.has_ended).then_some(wants)
    }

    /// Adds rows. Fewer than `wanted` end the list.
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
            // The first item is included whatever its size: otherwise the list would never advance.
            if self.items > 0 && self.body.len() > self.bytes_max {
                self.body.truncate(before);
                self.is_full = true;
                return Ok(());
            }
            (self.items, self.place) = (self.items + 1, Some(number));
        }
        Ok(())
    }

    /// The response. A full page names the next one.
    pub(super) fn answer(mut self) -> Response {
        let next =
            self.place.filter(|_| self.is_full).map(|place| format!("{}{place:x}", self.mark));
        self.body.extend_from_slice(b"],\"next_cursor\":");
        serde_json::to_writer(&mut self.body, &next).expect("a text");
        self.body.push(b'}');
        json(self.body)
    }
}

/// Maximum items of a page: `usual` if the query names none.
pub(super) fn page_limit(app: &App, asked: Option<u32>, usual: u32) -> Result<u32, ApiError> {
    items(app, "limit", asked.unwrap_or(usual))
}

/// Validates the number of items of the parameter `name`.
pub(super) fn items(app: &App, name: &str, asked: u32) -> Result<u32, ApiError> {
    let most = app.limits.page_items_max;
    if !(1..=most).contains(&asked) {
        let detail = format!("{name} must be from 1 to {most}, is {asked}");
        return Err(ApiError::limit(Code::Malformed, "page_items_max", most as usize, detail));
    }
    Ok(asked)
}

/// Page of a list that is shown as a whole if it fits into one answer.
#[derive(Debug, Default, serde::Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct PageParams {
    /// Maximum number of items, up to 1,000; as many as fit into one answer by default.
    #[param(minimum = 1, maximum = 1000)]
    pub(super) limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    pub(super) cursor: Option<String>,
}

impl PageParams {
    /// An empty page for these parameters.
    pub(super) fn page(&self, app: &App) -> Result<Page, ApiError> {
        Page::new(app, self.limit, u32::MAX, self.cursor.as_deref())
    }
}

/// Default number of items of a page.
pub(super) const PAGE_ITEMS_DEFAULT: u32 = 50;

/// Parameters of a list, newest first: filters, and those of its pages.
macro_rules! list_params {
    ($(#[$about:meta])* $name:ident { $($(#[$about_filter:meta])* $filter:ident,)* }) => {
        $(#[$about])*
        #[derive(Debug, Default, serde::Deserialize, utoipa::IntoParams)]
        #[serde(deny_unknown_fields)]
        #[into_params(parameter_in = Query)]
        pub(in crate::http) struct $name {
            $($(#[$about_filter])* $filter: Option<String>,)*
            /// Maximum number of items, up to 1,000; 50 by default.
            #[param(minimum = 1, maximum = 1000)]
            limit: Option<u32>,
            /// Cursor: the `next_cursor` of the previous page.
            cursor: Option<String>,
        }

        impl $name {
            /// An empty page for these parameters.
            pub(in crate::http) fn page(
                &self,
                app: &$crate::http::App,
            ) -> Result<$crate::http::page::Page, $crate::http::error::ApiError> {
                let usual = $crate::http::page::PAGE_ITEMS_DEFAULT;
                $crate::http::page::Page::new(app, self.limit, usual, self.cursor.as_deref())
            }
        }
    };
}
pub(super) use list_params;

list_params! {
    /// Page of a list, newest first.
    NewestParams {}
}

/// Start of a page of a list: after the item with this number.
pub(super) fn read_cursor(text: Option<&str>) -> Result<Option<i64>, ApiError> {
    read_cursor_of(NEWEST, text)
}

/// First character of the cursors of lists in their usual order.
const NEWEST: char = 'c';

fn read_cursor_of(mark: char, text: Option<&str>) -> Result<Option<i64>, ApiError> {
    let number = |text: &str| i64::from_str_radix(text.strip_prefix(mark)?, 16).ok();
    cursor_by(text, |text| number(text).filter(|number| *number >= 0))
}

/// Parses a cursor with `read`.
pub(super) fn cursor_by<T>(
    text: Option<&str>,
    read: impl Fn(&str) -> Option<T>,
) -> Result<Option<T>, ApiError> {
    let detail = "cursor must be the next_cursor of an earlier page in the same order";
    let read = |text| read(text).ok_or_else(|| ApiError::new(Code::Malformed, detail));
    text.map(read).transpose()
}

/// The cursor of the page after the item with this number.
pub(super) fn write_cursor(number: i64) -> String {
    format!("{NEWEST}{number:x}")
}

/// Maximum bytes after the items.
pub(super) const CURSOR_BYTES_MAX: usize = 64;
