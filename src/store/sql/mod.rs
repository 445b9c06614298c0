//! Statements that both engines understand, and rows as values. The texts of all queries are in the common subset of SQLite
//! and PostgreSQL; what differs (types of parameters and columns, transactions) is here.

mod connection;
mod row;
mod statement;

pub(super) use connection::{Begin, Connection, Engine};
pub(super) use row::{FromRow, Row, from_row, get};
pub(super) use statement::{Builder, CHUNKS, LISTED_AT_ONCE, Statement, Value, chunks, query};
