//! Rows of queries as values, and the queries of readers.

use std::sync::OnceLock;

use jiff::Timestamp;
use serde_json::{Map, Value};
use sqlx::error::BoxDynError;
use sqlx::query::Query;
use sqlx::sqlite::{SqliteArguments, SqliteRow};
use sqlx::{ColumnIndex, Decode, Encode, QueryBuilder, Row as _, Sqlite, Type};
use swarmbench_engine::{AgentId, Seed};

use super::entries::Secret;
use super::{Store, StoreError};
use crate::ids::{CompetitionKey, EntryKey, EpisodeId, EpisodeKey, ImportKey, RunKey, TokenHash};
use crate::keys::{OwnerKey, Role};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, RawRecord};
use swarmbench_protocol::import::ImportConfig;

pub(super) trait Column: Sized {
    type Stored: for<'r> Decode<'r, Sqlite> + Type<Sqlite>;

    fn of(stored: Self::Stored) -> Result<Self, BoxDynError>;
}

pub(super) trait FromRow: Sized {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error>;
}

/// Reads a column by its name or its number.
pub(super) fn get<T: Column>(
    row: &SqliteRow,
    column: impl ColumnIndex<SqliteRow>,
) -> Result<T, sqlx::Error> {
    T::of(row.try_get(column)?).map_err(sqlx::Error::Decode)
}

/// Rows whose columns have the names of the fields, or those that are written beside them.
macro_rules! from_row {
    (@ $field:ident) => { stringify!($field) };
    (@ $field:ident $column:literal) => { $column };
    ($($type:ident { $($field:ident $(= $column:literal)?),* $(,)? })*) => {$(
        impl super::rows::FromRow for $type {
            fn from_row(row: &sqlx::sqlite::SqliteRow) -> Result<Self, sqlx::Error> {
                Ok(Self { $($field: super::rows::get(row, from_row!(@ $field $($column)?))?),* })
            }
        }
    )*};
}
pub(super) use from_row;

macro_rules! columns {
    ($($type:ty: $stored:ty => $of:expr;)*) => {$(
        impl Column for $type {
            type Stored = $stored;

            fn of(stored: $stored) -> Result<Self, BoxDynError> {
                $of(stored)
            }
        }
    )*};
}

columns! {
    i64: i64 => Ok;
    u32: u32 => Ok;
    u16: u16 => Ok;
    bool: bool => Ok;
    f64: f64 => Ok;
    String: String => Ok;
    Vec<u8>: Vec<u8> => Ok;
    u64: i64 => |number| Ok(u64::try_from(number).unwrap_or(0));
    TokenHash: Vec<u8> => |hash: Vec<u8>| Ok(Self(hash.try_into().map_err(|_| "a hash has 32 bytes")?));
    EpisodeKey: i64 => |key| Ok(Self(key));
    RunKey: i64 => |key| Ok(Self(key));
    EntryKey: i64 => |key| Ok(Self(key));
    CompetitionKey: i64 => |key| Ok(Self(key));
    ImportKey: i64 => |key| Ok(Self(key));
    OwnerKey: i64 => |key| Ok(Self(key));
    AgentId: u16 => |agent| Ok(Self(agent));
    EpisodeId: String => |id| Ok(Self::from_text(id));
    Role: String => |role: String| Self::parse(&role).ok_or_else(|| format!("role {role:?}").into());
    Seed: i64 => |seed: i64| Ok(Self::try_from(seed)?);
    Timestamp: i64 => |millis| Ok(Self::from_millisecond(millis)?);
    [u8; 32]: Vec<u8> => |bytes: Vec<u8>| Ok(bytes.try_into().map_err(|_| "a hash has 32 bytes")?);
    Head: Vec<u8> => |bytes| <[u8; 32]>::of(bytes).map(Self);
    Secret: Vec<u8> => |bytes| Ok(Self(bytes));
    Value: String => |json: String| Ok(serde_json::from_str(&json)?);
    Map<String, Value>: String => |json: String| Ok(serde_json::from_str(&json)?);
    ActRecord: String => |json: String| Ok(serde_json::from_str(&json)?);
    ImportConfig: String => |json: String| Ok(serde_json::from_str(&json)?);
    RawRecord: String => |text| Ok(Self::from_stored(text)?);
}

impl<T: Column> Column for Option<T> {
    type Stored = Option<T::Stored>;

    fn of(stored: Self::Stored) -> Result<Self, BoxDynError> {
        stored.map(T::of).transpose()
    }
}

/// The first column.
impl<T: Column> FromRow for T {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        get(row, 0)
    }
}

/// The first columns, in order.
macro_rules! tuple {
    ($($type:ident $number:literal),*) => {
        impl<$($type: Column),*> FromRow for ($($type,)*) {
            fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
                Ok(($(get(row, $number)?,)*))
            }
        }
    };
}

tuple!(A 0, B 1);
tuple!(A 0, B 1, C 2);
tuple!(A 0, B 1, C 2, D 3);

type Select<'q> = Query<'q, Sqlite, SqliteArguments>;

impl Store {
    pub(super) async fn fetch_all<T: FromRow>(
        &self,
        query: Select<'_>,
    ) -> Result<Vec<T>, StoreError> {
        let rows = query.fetch_all(&mut *self.read().await?).await?;
        Ok(rows.iter().map(T::from_row).collect::<Result<_, _>>()?)
    }

    pub(super) async fn fetch_one<T: FromRow>(&self, query: Select<'_>) -> Result<T, StoreError> {
        Ok(T::from_row(&query.fetch_one(&mut *self.read().await?).await?)?)
    }

    pub(super) async fn fetch_optional<T: FromRow>(
        &self,
        query: Select<'_>,
    ) -> Result<Option<T>, StoreError> {
        let row = query.fetch_optional(&mut *self.read().await?).await?;
        Ok(row.as_ref().map(T::from_row).transpose()?)
    }
}

/// Rows that one statement inserts. Every statement is a way to the thread of the database and back, so that the acts of a
/// round of up to 16 seats are one, and others few; and there are few sizes, so that all statements stay prepared.
const CHUNKS: [usize; 20] =
    [256, 128, 64, 32, 16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1];

/// Prepared statements that a connection which writes keeps: all sizes of the tables into which rows are inserted in pieces,
/// and the others.
pub(super) const STATEMENTS_KEPT: usize = 256;

/// Values that one list of a query has at most: SQLite takes 32,766 parameters.
pub(super) const LISTED_AT_ONCE: usize = 1000;

/// Adds `(…)` with a parameter for each value, to stand behind `IN`. Without values nothing is in it.
pub(super) fn push_list<'q, T: Encode<'q, Sqlite> + Type<Sqlite>>(
    query: &mut QueryBuilder<Sqlite>,
    values: impl Iterator<Item = T>,
) {
    query.push("(");
    let mut list = query.separated(", ");
    let mut is_empty = true;
    for value in values {
        list.push_bind(value);
        is_empty = false;
    }
    // PostgreSQL takes no empty list, and nothing equals NULL.
    query.push(if is_empty { "NULL)" } else { ")" });
}

/// Cuts rows into pieces of few different lengths.
pub(super) fn chunks<T>(rows: &[T]) -> impl Iterator<Item = &[T]> {
    let mut rest = rows;
    std::iter::from_fn(move || {
        let size = CHUNKS.into_iter().find(|&size| size <= rest.len())?;
        let (chunk, after) = rest.split_at(size);
        rest = after;
        Some(chunk)
    })
}

/// Statements that insert rows of the journal, whose texts are made once.
pub(super) struct Insert {
    /// The table and its columns.
    into: &'static str,
    /// The places of the values of a row.
    row: &'static str,
    /// By the number of rows, as [`CHUNKS`] has them.
    statements: [OnceLock<String>; CHUNKS.len()],
}

impl Insert {
    pub(super) const fn new(into: &'static str, row: &'static str) -> Self {
        Self { into, row, statements: [const { OnceLock::new() }; CHUNKS.len()] }
    }

    /// Rows in pieces, with the statement of each.
    pub(super) fn statements<'r, T>(
        &'static self,
        rows: &'r [T],
    ) -> impl Iterator<Item = (&'r [T], &'static str)> {
        chunks(rows).map(|rows| (rows, self.statement(rows.len())))
    }

    fn statement(&'static self, rows: usize) -> &'static str {
        let size = CHUNKS.iter().position(|&size| size == rows).expect("chunks have these sizes");
        self.statements[size].get_or_init(|| {
            format!("INSERT INTO {} VALUES {}", self.into, vec![self.row; rows].join(", "))
        })
    }
}
