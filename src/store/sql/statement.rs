//! A statement: its text with the placeholders `$1`, `$2`, …, and their values.

use std::borrow::Cow;
use std::fmt::Write as _;

use futures::stream::{self, BoxStream, StreamExt as _};
use sqlx::postgres::PgArguments;
use sqlx::sqlite::SqliteArguments;
use sqlx::{Arguments as _, AssertSqlSafe, Encode, Postgres, SqlSafeStr as _, SqlStr, Type};

use super::connection::{Connection, Engine};
use super::row::{FromRow, SqlRow};

/// The value of a placeholder. `NULL` has a type as well, which PostgreSQL needs.
#[derive(Clone, Debug)]
pub(in crate::store) enum Value<'q> {
    Int(Option<i64>),
    Bool(Option<bool>),
    Real(Option<f64>),
    Text(Option<Cow<'q, str>>),
    Bytes(Option<Cow<'q, [u8]>>),
}

impl Value<'_> {
    /// Borrows the value.
    pub(in crate::store) fn borrowed(&self) -> Value<'_> {
        match self {
            Self::Int(number) => Value::Int(*number),
            Self::Bool(truth) => Value::Bool(*truth),
            Self::Real(number) => Value::Real(*number),
            Self::Text(text) => Value::Text(text.as_deref().map(Cow::Borrowed)),
            Self::Bytes(bytes) => Value::Bytes(bytes.as_deref().map(Cow::Borrowed)),
        }
    }
}

/// A Rust type that can be bound to a placeholder.
pub(in crate::store) trait Bind<'q> {
    const NULL: Value<'q>;

    fn value(self) -> Value<'q>;
}

macro_rules! binds {
    ($($type:ty => $kind:ident $of:expr;)*) => {$(
        impl<'q> Bind<'q> for $type {
            const NULL: Value<'q> = Value::$kind(None);

            fn value(self) -> Value<'q> {
                Value::$kind(Some($of(self)))
            }
        }
    )*};
}

binds! {
    i64 => Int |number| number;
    u32 => Int i64::from;
    u16 => Int i64::from;
    u8 => Int i64::from;
    &'q u32 => Int |number: &u32| i64::from(*number);
    bool => Bool |truth| truth;
    f64 => Real |number| number;
    &'q str => Text Cow::Borrowed;
    &'q String => Text |text: &'q String| Cow::Borrowed(text.as_str());
    String => Text Cow::Owned;
    &'q [u8] => Bytes Cow::Borrowed;
    &'q Vec<u8> => Bytes |bytes: &'q Vec<u8>| Cow::Borrowed(bytes.as_slice());
    Vec<u8> => Bytes Cow::Owned;
}

impl<'q, T: Bind<'q>> Bind<'q> for Option<T> {
    const NULL: Value<'q> = T::NULL;

    fn value(self) -> Value<'q> {
        self.map_or(T::NULL, T::value)
    }
}

impl<'q, T> Bind<'q> for &'q Option<T>
where
    &'q T: Bind<'q>,
{
    const NULL: Value<'q> = <&'q T>::NULL;

    fn value(self) -> Value<'q> {
        self.as_ref().value()
    }
}

#[must_use = "a statement does nothing until it is executed"]
pub(in crate::store) struct Statement<'q> {
    text: SqlStr,
    values: Vec<Value<'q>>,
}

/// A statement with a static text.
pub(in crate::store) fn query<'q>(text: &'static str) -> Statement<'q> {
    Statement { text: SqlStr::from_static(text), values: Vec::new() }
}

impl<'q> Statement<'q> {
    /// A statement with a composed text, which must never contain input of clients.
    pub(in crate::store) fn of(text: String) -> Self {
        Self { text: AssertSqlSafe(text).into_sql_str(), values: Vec::new() }
    }

    /// Binds the next placeholder.
    pub(in crate::store) fn bind(mut self, value: impl Bind<'q>) -> Self {
        self.values.push(value.value());
        self
    }

    /// [`Statement::bind`] for a value of dynamic type.
    pub(in crate::store) fn bind_value(mut self, value: Value<'q>) -> Self {
        self.values.push(value);
        self
    }

    /// Returns the number of changed rows.
    pub(in crate::store) async fn execute(
        self,
        connection: &mut Connection,
    ) -> Result<u64, sqlx::Error> {
        match connection.engine() {
            Engine::Sqlite(connection) => {
                let done = self.for_sqlite()?.execute(connection).await?;
                Ok(done.rows_affected())
            }
            Engine::Postgres(connection) => {
                let done = Box::pin(self.for_postgres()?.execute(connection)).await?;
                Ok(done.rows_affected())
            }
        }
    }

    pub(in crate::store) async fn fetch_all(
        self,
        connection: &mut Connection,
    ) -> Result<Vec<SqlRow>, sqlx::Error> {
        match connection.engine() {
            Engine::Sqlite(connection) => {
                let rows = self.for_sqlite()?.fetch_all(connection).await?;
                Ok(rows.into_iter().map(SqlRow::Sqlite).collect())
            }
            Engine::Postgres(connection) => {
                let rows = Box::pin(self.for_postgres()?.fetch_all(connection)).await?;
                Ok(rows.into_iter().map(SqlRow::Postgres).collect())
            }
        }
    }

    pub(in crate::store) async fn fetch_optional(
        self,
        connection: &mut Connection,
    ) -> Result<Option<SqlRow>, sqlx::Error> {
        match connection.engine() {
            Engine::Sqlite(connection) => {
                Ok(self.for_sqlite()?.fetch_optional(connection).await?.map(SqlRow::Sqlite))
            }
            Engine::Postgres(connection) => {
                Ok(Box::pin(self.for_postgres()?.fetch_optional(connection))
                    .await?
                    .map(SqlRow::Postgres))
            }
        }
    }

    pub(in crate::store) async fn fetch_one(
        self,
        connection: &mut Connection,
    ) -> Result<SqlRow, sqlx::Error> {
        self.fetch_optional(connection).await?.ok_or(sqlx::Error::RowNotFound)
    }

    /// Converts the first row; fails without rows.
    pub(in crate::store) async fn one<T: FromRow>(
        self,
        connection: &mut Connection,
    ) -> Result<T, sqlx::Error> {
        T::from_row(&self.fetch_one(connection).await?)
    }

    /// Converts the first row, if there is one.
    pub(in crate::store) async fn optional<T: FromRow>(
        self,
        connection: &mut Connection,
    ) -> Result<Option<T>, sqlx::Error> {
        self.fetch_optional(connection).await?.as_ref().map(T::from_row).transpose()
    }

    /// Converts all rows.
    pub(in crate::store) async fn all<T: FromRow>(
        self,
        connection: &mut Connection,
    ) -> Result<Vec<T>, sqlx::Error> {
        self.fetch_all(connection).await?.iter().map(T::from_row).collect()
    }

    /// Streams rows, for answers that are too large for memory.
    pub(in crate::store) fn fetch<'c>(
        self,
        connection: &'c mut Connection,
    ) -> BoxStream<'c, Result<SqlRow, sqlx::Error>>
    where
        'q: 'c,
    {
        match connection.engine() {
            Engine::Sqlite(connection) => match self.for_sqlite() {
                Ok(query) => query.fetch(connection).map(|row| row.map(SqlRow::Sqlite)).boxed(),
                Err(error) => stream::once(async { Err(error) }).boxed(),
            },
            Engine::Postgres(connection) => match self.for_postgres() {
                Ok(query) => query.fetch(connection).map(|row| row.map(SqlRow::Postgres)).boxed(),
                Err(error) => stream::once(async { Err(error) }).boxed(),
            },
        }
    }

    fn for_sqlite(
        self,
    ) -> Result<sqlx::query::Query<'static, sqlx::Sqlite, SqliteArguments>, sqlx::Error> {
        let mut arguments = SqliteArguments::default();
        let added = self.values.into_iter().try_for_each(|value| match value {
            Value::Int(number) => arguments.add(number),
            Value::Bool(truth) => arguments.add(truth),
            Value::Real(number) => arguments.add(number),
            Value::Text(text) => arguments.add(text),
            Value::Bytes(bytes) => arguments.add(bytes),
        });
        added.map_err(sqlx::Error::Encode)?;
        Ok(sqlx::query_with(self.text, arguments))
    }

    fn for_postgres(
        self,
    ) -> Result<sqlx::query::Query<'static, Postgres, PgArguments>, sqlx::Error> {
        fn add<'t, T: Encode<'t, Postgres> + Type<Postgres>>(
            arguments: &mut PgArguments,
            value: T,
        ) -> Result<(), sqlx::error::BoxDynError> {
            arguments.add(value)
        }
        let mut arguments = PgArguments::default();
        let added = self.values.iter().try_for_each(|value| match value {
            Value::Int(number) => add(&mut arguments, number),
            Value::Bool(truth) => add(&mut arguments, truth),
            Value::Real(number) => add(&mut arguments, number),
            Value::Text(text) => add(&mut arguments, text.as_deref().map(without_nul).as_deref()),
            Value::Bytes(bytes) => add(&mut arguments, bytes.as_deref()),
        });
        added.map_err(sqlx::Error::Encode)?;
        Ok(sqlx::query_with(without_hints(self.text), arguments))
    }
}

/// Replacement of U+0000 in comparisons: U+FFFF, a noncharacter, occurs in no text.
const NUL_STAND_IN: &str = "\u{ffff}";

/// Replaces U+0000, which PostgreSQL refuses. No stored text contains it, so such a text must match nothing.
fn without_nul(text: &str) -> Cow<'_, str> {
    if text.contains('\0') { text.replace('\0', NUL_STAND_IN).into() } else { text.into() }
}

/// SQLite's hint of an index in a query.
const HINT: &str = "INDEXED BY ";

/// Removes the hints for SQLite.
fn without_hints(text: SqlStr) -> SqlStr {
    if !text.as_str().contains(HINT) {
        return text;
    }
    let mut parts = text.as_str().split(HINT);
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let name = part.find(|c: char| !(c.is_ascii_lowercase() || c == '_'));
        plain.push_str(&part[name.unwrap_or(part.len())..]);
    }
    AssertSqlSafe(plain).into_sql_str()
}

/// Composes a statement.
pub(in crate::store) struct Builder<'q> {
    text: String,
    values: Vec<Value<'q>>,
}

impl<'q> Builder<'q> {
    pub(in crate::store) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), values: Vec::new() }
    }

    /// Appends a text of the program, never input of clients.
    pub(in crate::store) fn push(&mut self, text: &str) -> &mut Self {
        self.text.push_str(text);
        self
    }

    /// Appends a placeholder and binds its value.
    pub(in crate::store) fn push_bind(&mut self, value: impl Bind<'q>) -> &mut Self {
        self.push_value(value.value())
    }

    fn push_value(&mut self, value: Value<'q>) -> &mut Self {
        self.values.push(value);
        write!(self.text, "${}", self.values.len()).expect("a String takes any text");
        self
    }

    /// Appends `(…)` with a placeholder for each value, for use after `IN`. Nothing is in an empty list.
    pub(in crate::store) fn push_list<T: Bind<'q>>(
        &mut self,
        values: impl IntoIterator<Item = T>,
    ) -> &mut Self {
        let before = self.values.len();
        self.text.push('(');
        for value in values {
            if self.values.len() > before {
                self.text.push_str(", ");
            }
            self.push_bind(value);
        }
        // PostgreSQL accepts no empty list, and nothing equals NULL.
        self.text.push_str(if self.values.len() == before { "NULL)" } else { ")" });
        self
    }

    /// Appends the rows of an `INSERT`.
    pub(in crate::store) fn push_rows<T>(
        &mut self,
        rows: impl IntoIterator<Item = T>,
        mut values: impl FnMut(&mut RowOfValues<'_, 'q>, T),
    ) -> &mut Self {
        self.text.push_str("VALUES ");
        for (place, row) in rows.into_iter().enumerate() {
            self.text.push_str(if place > 0 { ", (" } else { "(" });
            values(&mut RowOfValues { builder: self, is_first: true }, row);
            self.text.push(')');
        }
        self
    }

    pub(in crate::store) fn build(self) -> Statement<'q> {
        Statement { values: self.values, ..Statement::of(self.text) }
    }
}

pub(in crate::store) struct RowOfValues<'b, 'q> {
    builder: &'b mut Builder<'q>,
    is_first: bool,
}

impl<'q> RowOfValues<'_, 'q> {
    pub(in crate::store) fn push_bind(&mut self, value: impl Bind<'q>) -> &mut Self {
        self.push_value(value.value())
    }

    pub(in crate::store) fn push_value(&mut self, value: Value<'q>) -> &mut Self {
        if !std::mem::take(&mut self.is_first) {
            self.builder.text.push_str(", ");
        }
        self.builder.push_value(value);
        self
    }
}

/// Numbers of rows in one insert statement. Each statement costs a round trip to the database's thread, so the acts of a
/// round of up to 16 seats are one statement. Sizes are few, so that all statements stay prepared.
pub(in crate::store) const CHUNKS: [usize; 20] =
    [256, 128, 64, 32, 16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1];

/// Maximum length of a list in a query: SQLite accepts 32,766 parameters.
pub(in crate::store) const LISTED_AT_ONCE: usize = 1000;

/// Splits rows into slices with lengths of [`CHUNKS`].
pub(in crate::store) fn chunks<T>(rows: &[T]) -> impl Iterator<Item = &[T]> {
    let mut rest = rows;
    std::iter::from_fn(move || {
        let size = CHUNKS.into_iter().find(|&size| size <= rest.len())?;
        let (chunk, after) = rest.split_at(size);
        rest = after;
        Some(chunk)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_builder_numbers_its_placeholders() {
        let mut query = Builder::new("SELECT a FROM b WHERE c = ");
        query.push_bind(1_i64).push(" AND d IN ").push_list(["x", "y"]);
        let query = query.build();
        assert_eq!(query.text.as_str(), "SELECT a FROM b WHERE c = $1 AND d IN ($2, $3)");
        assert_eq!(query.values.len(), 3);
        let mut insert = Builder::new("INSERT INTO b (c, d) ");
        insert.push_rows([1_u32, 2], |row, number| {
            row.push_bind(number).push_bind(None::<&str>);
        });
        assert_eq!(insert.build().text.as_str(), "INSERT INTO b (c, d) VALUES ($1, $2), ($3, $4)");
    }

    #[test]
    fn hints_of_sqlite_are_left_out_for_postgres() {
        let plain = without_hints(SqlStr::from_static(
            "SELECT 1 FROM a x INDEXED BY a_by_b WHERE y IN (SELECT y FROM c INDEXED BY c_by_y)",
        ));
        assert_eq!(plain.as_str(), "SELECT 1 FROM a x  WHERE y IN (SELECT y FROM c )");
    }

    #[test]
    fn a_text_with_a_nul_is_compared_as_one_that_nothing_equals() {
        assert_eq!(without_nul("plain"), "plain");
        assert_eq!(without_nul("a\0b"), "a\u{ffff}b");
    }
}
