//! Bulk inserts with one array for each column: the statement is the same for any number of rows.

use sqlx::Arguments as _;
use sqlx::error::BoxDynError;
use sqlx::postgres::PgArguments;
use sqlx::{AssertSqlSafe, SqlSafeStr as _};

use crate::store::copy::{Kind, Table};
use crate::store::sql::{Connection, Engine, Value};

/// Inserts rows in the open transaction.
pub(in crate::store) async fn insert(
    connection: &mut Connection,
    table: &Table,
    rows: &[Vec<Value<'static>>],
) -> Result<(), sqlx::Error> {
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("arrays are for PostgreSQL")
    };
    let mut arguments = PgArguments::default();
    let mut arrays = Vec::with_capacity(table.columns.len());
    for (place, (_, kind)) in table.columns.iter().enumerate() {
        let column = rows.iter().map(|row| &row[place]);
        add(&mut arguments, *kind, column).map_err(sqlx::Error::Encode)?;
        arrays.push(format!("${}::{}[]", place + 1, type_of(*kind)));
    }
    let text = format!(
        "INSERT INTO {} ({}) SELECT * FROM unnest({})",
        table.name,
        table.names(),
        arrays.join(", ")
    );
    sqlx::query_with(AssertSqlSafe(text).into_sql_str(), arguments).execute(connection).await?;
    Ok(())
}

/// The widest type of a kind. PostgreSQL refuses numbers that the column cannot hold.
const fn type_of(kind: Kind) -> &'static str {
    match kind {
        Kind::Int => "bigint",
        Kind::Bool => "boolean",
        Kind::Real => "double precision",
        Kind::Text => "text",
        Kind::Bytes => "bytea",
    }
}

fn add<'v>(
    arguments: &mut PgArguments,
    kind: Kind,
    column: impl Iterator<Item = &'v Value<'static>>,
) -> Result<(), BoxDynError> {
    macro_rules! array {
        ($variant:ident, $of:expr) => {{
            let of = |value: &'v Value<'static>| match value {
                Value::$variant(value) => $of(value),
                _ => unreachable!("a column has values of one kind"),
            };
            arguments.add(column.map(of).collect::<Vec<_>>())
        }};
    }
    match kind {
        Kind::Int => array!(Int, |number: &Option<i64>| *number),
        Kind::Bool => array!(Bool, |truth: &Option<bool>| *truth),
        Kind::Real => array!(Real, |number: &Option<f64>| *number),
        Kind::Text => array!(Text, Option::as_deref),
        Kind::Bytes => array!(Bytes, Option::as_deref),
    }
}
