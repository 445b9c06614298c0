//! Conversion of result rows to values.

use jiff::Timestamp;
use serde_json::Value;
use sqlx::error::BoxDynError;
use sqlx::postgres::PgRow;
use sqlx::sqlite::SqliteRow;
use sqlx::{ColumnIndex, Row as _};
use swarmbench_engine::{AgentId, Seed};

use super::super::entries::Secret;
use crate::ids::{CompetitionKey, EntryKey, EpisodeId, EpisodeKey, ImportKey, RunKey, TokenHash};
use crate::keys::{OwnerKey, Role};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, RawRecord};
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::import::ImportConfig;

pub(in crate::store) enum SqlRow {
    Sqlite(SqliteRow),
    Postgres(PgRow),
}

impl SqlRow {
    /// Reads a column by name or number.
    pub(in crate::store) fn try_get<T: Column>(
        &self,
        column: impl Index,
    ) -> Result<T, sqlx::Error> {
        get(self, column)
    }

    /// Borrows the text of a column.
    pub(in crate::store) fn text(&self, column: impl Index) -> Result<&str, sqlx::Error> {
        match self {
            Self::Sqlite(row) => row.try_get(column),
            Self::Postgres(row) => row.try_get(column),
        }
    }
}

/// A column's name, or its number from 0.
pub(in crate::store) trait Index:
    ColumnIndex<SqliteRow> + ColumnIndex<PgRow>
{
}

impl<T: ColumnIndex<SqliteRow> + ColumnIndex<PgRow>> Index for T {}

/// A type that both engines store directly.
pub(in crate::store) trait Stored: Sized {
    fn read(row: &SqlRow, column: impl Index) -> Result<Self, sqlx::Error>;
}

macro_rules! stored {
    ($($type:ty),*) => {$(
        impl Stored for Option<$type> {
            fn read(row: &SqlRow, column: impl Index) -> Result<Self, sqlx::Error> {
                match row {
                    SqlRow::Sqlite(row) => row.try_get(column),
                    SqlRow::Postgres(row) => row.try_get(column),
                }
            }
        }

        impl Stored for $type {
            fn read(row: &SqlRow, column: impl Index) -> Result<Self, sqlx::Error> {
                match row {
                    SqlRow::Sqlite(row) => row.try_get(column),
                    SqlRow::Postgres(row) => row.try_get(column),
                }
            }
        }
    )*};
}

stored!(bool, f64, String, Vec<u8>);

/// Columns of PostgreSQL have integers of two, four or eight bytes; SQLite has one integer type.
impl Stored for Option<i64> {
    fn read(row: &SqlRow, column: impl Index) -> Result<Self, sqlx::Error> {
        match row {
            SqlRow::Sqlite(row) => row.try_get(column),
            SqlRow::Postgres(row) => row.try_get_unchecked(column),
        }
    }
}

impl Stored for i64 {
    fn read(row: &SqlRow, column: impl Index) -> Result<Self, sqlx::Error> {
        match row {
            SqlRow::Sqlite(row) => row.try_get(column),
            SqlRow::Postgres(row) => row.try_get_unchecked(column),
        }
    }
}

/// A type converted from a stored one.
pub(in crate::store) trait Column: Sized {
    type Stored: Stored;

    fn of(stored: Self::Stored) -> Result<Self, BoxDynError>;
}

pub(in crate::store) trait FromRow: Sized {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error>;
}

/// Reads and converts a column by name or number.
pub(in crate::store) fn get<T: Column>(row: &SqlRow, column: impl Index) -> Result<T, sqlx::Error> {
    T::of(T::Stored::read(row, column)?).map_err(sqlx::Error::Decode)
}

/// Implements `FromRow` for structs: columns have the names of the fields unless another name is given.
macro_rules! from_row {
    (@ $field:ident) => { stringify!($field) };
    (@ $field:ident $column:literal) => { $column };
    ($($type:ident { $($field:ident $(= $column:literal)?),* $(,)? })*) => {$(
        impl crate::store::sql::FromRow for $type {
            fn from_row(row: &crate::store::sql::SqlRow) -> Result<Self, sqlx::Error> {
                Ok(Self { $($field: crate::store::sql::get(row, from_row!(@ $field $($column)?))?),* })
            }
        }
    )*};
}
pub(in crate::store) use from_row;

macro_rules! columns {
    ($($type:ty: $stored:ty => $of:expr;)*) => {$(
        impl Column for $type {
            type Stored = $stored;

            fn of(stored: $stored) -> Result<Self, BoxDynError> {
                $of(stored)
            }
        }

        impl Column for Option<$type> {
            type Stored = Option<$stored>;

            fn of(stored: Self::Stored) -> Result<Self, BoxDynError> {
                stored.map(<$type as Column>::of).transpose()
            }
        }
    )*};
}

columns! {
    i64: i64 => Ok;
    u32: i64 => |number| Ok(u32::try_from(number)?);
    u16: i64 => |number| Ok(u16::try_from(number)?);
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
    AgentId: i64 => |agent| Ok(Self(u16::try_from(agent)?));
    EpisodeId: String => |id| Ok(Self::from_text(id));
    Role: String => |role: String| Self::parse(&role).ok_or_else(|| format!("role {role:?}").into());
    Seed: i64 => |seed: i64| Ok(Self::try_from(seed)?);
    Timestamp: i64 => |millis| Ok(Self::from_millisecond(millis)?);
    [u8; 32]: Vec<u8> => |bytes: Vec<u8>| Ok(bytes.try_into().map_err(|_| "a hash has 32 bytes")?);
    Head: Vec<u8> => |bytes| <[u8; 32]>::of(bytes).map(Self);
    Secret: Vec<u8> => |bytes| Ok(Self(bytes));
    Value: String => |json: String| Ok(serde_json::from_str(&json)?);
    Carried: String => |json: String| Ok(serde_json::from_str(&json)?);
    ActRecord: String => |json: String| Ok(serde_json::from_str(&json)?);
    ImportConfig: String => |json: String| Ok(serde_json::from_str(&json)?);
    RawRecord: String => |text| Ok(Self::from_stored(text)?);
}

/// Reads the first column.
impl<T: Column> FromRow for T {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        get(row, 0)
    }
}

/// Reads the first columns, in order.
macro_rules! tuple {
    ($($type:ident $number:literal),*) => {
        impl<$($type: Column),*> FromRow for ($($type,)*) {
            fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
                Ok(($(get(row, $number)?,)*))
            }
        }
    };
}

tuple!(A 0, B 1);
tuple!(A 0, B 1, C 2);
tuple!(A 0, B 1, C 2, D 3);
