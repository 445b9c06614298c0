//! Statements for both engines, and conversion of rows to values. All queries use the common subset of SQLite and PostgreSQL;
//! this module covers the differences: types of parameters and columns, and transactions.

mod connection;
mod row;
mod statement;

pub(super) use connection::{Begin, Connection, Engine};
pub(super) use row::{FromRow, SqlRow, from_row, get};
pub(super) use statement::{Builder, CHUNKS, LISTED_AT_ONCE, Statement, Value, chunks, query};
