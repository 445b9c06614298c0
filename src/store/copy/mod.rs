//! Copies a whole database into an empty one of either engine: the way to move a server from SQLite to PostgreSQL and back.
//!
//! Nothing else uses the two databases meanwhile. A table is copied in pieces, in order of its primary key. Each piece is a
//! transaction of the target, so an interrupted copy continues after the last stored row. The table `copying` exists in the
//! target from before the first piece until everything was compared and checked; while it exists, nothing else opens the
//! target.

mod tables;

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use data_encoding::HEXLOWER;
use futures::TryStreamExt as _;
use sha2::{Digest as _, Sha256};

use super::check::{Checked, Damage, Formats, check_open};
use super::sql::{Begin, Builder, Connection, SqlRow, Statement, Value, chunks, from_row, query};
use super::{Alone, Location, OpenError, postgres};
use crate::migrations;
use tables::TABLES;

/// The progress table of an unfinished target: source, migration, and the number of copied rows for each table.
pub(super) const UNFINISHED: &str = "copying";

/// Bytes of values after which a piece ends. Two pieces are in memory at once.
const PIECE_BYTES_MAX: usize = 4 << 20;

/// Maximum rows of a piece, and rows of a table's first piece.
const PIECE_ROWS: (i64, i64) = (16_384, 512);

/// Pause and number of retries for a database in use: PostgreSQL notices the end of an interrupted copy with a delay.
const PATIENCE: (Duration, u32) = (Duration::from_millis(100), 30);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Int,
    Bool,
    Real,
    Text,
    Bytes,
}

pub(super) struct Table {
    pub(super) name: &'static str,
    /// Number of columns, from the first on, that form the primary key.
    keys: usize,
    /// Whether a database sequence assigns the key.
    is_numbered: bool,
    pub(super) columns: &'static [(&'static str, Kind)],
}

/// Errors of a copy. Each message says what to do.
#[derive(Debug, thiserror::Error)]
pub enum CopyError {
    #[error("{0} is both source and target: name two databases")]
    Same(String),
    #[error(
        "{0} is in use by another process: stop the server that has it, as what it writes meanwhile would not be copied"
    )]
    InUse(String),
    #[error("there is no database {0}: name that of the stopped server with --from")]
    Missing(PathBuf),
    #[error("there is no folder {0} for the copy: create it, or name another file with --to")]
    Folder(PathBuf),
    #[error(transparent)]
    Open(OpenError),
    #[error(
        "{target} has rows of its own, in the table {table}, and is not overwritten: name an empty database with --to (one \
         that `createdb` made, or a file that does not exist). If it is a copy that was finished before, it is whole"
    )]
    Occupied { target: String, table: &'static str },
    #[error(
        "{target} is an unfinished copy of {of}: name that with --from, or begin again with an empty database (remove the \
         file, or `dropdb` and `createdb`)"
    )]
    OfAnother { target: String, of: String },
    #[error(
        "{target} is an unfinished copy by another version of this program: continue with that one, or begin again with an \
         empty database (remove the file, or `dropdb` and `createdb`)"
    )]
    OfAnotherVersion { target: String },
    #[error(
        "the row {row} of the table {table} has a character U+0000 in one of its texts, which PostgreSQL cannot store; only an \
         imported game can have one, in a name. Nothing was copied: stay with SQLite, or delete the rows of that game from \
         imports and import_rounds, and import it again without the character"
    )]
    Nul { table: &'static str, row: String },
    #[error(
        "the table {table} of the source cannot be read; once it can be, the same command continues"
    )]
    Read { table: &'static str, source: sqlx::Error },
    #[error(
        "the table {table} of the copy cannot be written; once it can be, the same command continues"
    )]
    Write { table: &'static str, source: sqlx::Error },
    #[error("the copy {target} cannot be used; once it can be, the same command continues")]
    Target { target: String, source: sqlx::Error },
    #[error(
        "the copy differs from its source at the row {row} of the table {table}: a server wrote to the source after the copy \
         had begun. Begin again with an empty database (remove the file, or `dropdb` and `createdb`)"
    )]
    Differs { table: &'static str, row: String },
    #[error(
        "the copy is equal to its source, and damaged in {count} places, first {}: {}. `swarmbench verify --db {from}` lists \
         them; move a backup that is sound instead", first.subject, first.problem
    )]
    Damaged { from: String, count: u64, first: Box<Damage> },
}

/// Progress of a copy. The kinds of steps come in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Texts of a source table are searched for characters that the target cannot store.
    Search(&'static str),
    /// Rows in the target, and rows in total.
    Copy { table: &'static str, done: u64, of: u64 },
    /// Rows compared, and rows in total.
    Compare { table: &'static str, done: u64, of: u64 },
    /// Episodes of the copy replayed, and episodes in total.
    Check { done: u64, of: u64 },
}

/// A table with equal contents in both databases.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CopiedTable {
    pub name: &'static str,
    pub rows: u64,
    /// SHA-256 of all rows in order of the primary key; the same for both engines.
    pub digest: [u8; 32],
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Copied {
    pub tables: Vec<CopiedTable>,
    /// Result of the check of the copy, which found no damage.
    pub checked: Checked,
    /// Whether this call continued an interrupted copy.
    pub is_continued: bool,
}

impl Copied {
    pub fn rows(&self) -> u64 {
        self.tables.iter().map(|table| table.rows).sum()
    }
}

/// Copies a database, compares the copy row by row, and checks it. The target must be empty or an unfinished copy of this
/// source. Memory use is independent of the size of the database.
pub async fn copy(
    from: &Location,
    to: &Location,
    formats: &Formats,
    mut progress: impl FnMut(Step),
) -> Result<Copied, CopyError> {
    let name = name_of(from);
    let is_known = !matches!(from, Location::Unknown(_));
    if is_known && name == name_of(to) {
        return Err(CopyError::Same(name));
    }
    let mut source = patiently(async || Alone::open(from).await).await?;
    let mut target = patiently(async || Alone::take(to).await).await?;
    let copier = Copier { from: name, to: to.to_string() };
    let (reading, writing) = (&mut source.connection, &mut target.connection);
    let is_continued = copier.begin(reading, writing, &mut progress).await?;
    target.make_tables(to).await?;
    let failed = |source| CopyError::Target { target: to.to_string(), source };
    let (source, connection) = (&mut source.connection, &mut target.connection);
    for table in TABLES {
        table.copy(source, connection, &mut progress).await?;
    }
    settle(connection).await.map_err(failed)?;
    let mut tables = Vec::with_capacity(TABLES.len());
    for table in TABLES {
        tables.push(table.compare(source, connection, &mut progress).await?);
    }
    let mut check = |done, of| progress(Step::Check { done, of });
    let checked = check_open(connection, to, formats, &mut check).await?;
    if let Some(first) = checked.damages.first() {
        let count = checked.damages.len() as u64 + checked.more_damages;
        return Err(CopyError::Damaged {
            from: from.to_string(),
            count,
            first: Box::new(first.clone()),
        });
    }
    let done = Statement::of(format!("DROP TABLE {UNFINISHED}")).execute(connection).await;
    done.map_err(failed)?;
    target.close().await.map_err(failed)?;
    Ok(Copied { tables, checked, is_continued })
}

/// A location's name that is the same for every command: files have absolute paths.
fn name_of(location: &Location) -> String {
    match location {
        Location::File(path) => {
            let whole = path.canonicalize().or_else(|_| std::path::absolute(path));
            whole.unwrap_or_else(|_| path.clone()).display().to_string()
        }
        Location::Postgres(_) | Location::Unknown(_) => location.to_string(),
    }
}

async fn patiently(open: impl AsyncFn() -> Result<Alone, OpenError>) -> Result<Alone, CopyError> {
    let (pause, tries) = PATIENCE;
    for _ in 0..tries {
        match open().await {
            Err(OpenError::InUse(_)) => tokio::time::sleep(pause).await,
            opened => return opened.map_err(CopyError::from),
        }
    }
    open().await.map_err(CopyError::from)
}

impl From<OpenError> for CopyError {
    fn from(error: OpenError) -> Self {
        match error {
            OpenError::InUse(by) => Self::InUse(by),
            OpenError::Missing(path) => Self::Missing(path),
            OpenError::Folder(path) => Self::Folder(path),
            error => Self::Open(error),
        }
    }
}

/// Names of the source and the target.
struct Copier {
    from: String,
    to: String,
}

impl Copier {
    /// Creates the table [`UNFINISHED`] in an empty target; returns true if it exists already and the copy continues.
    async fn begin(
        &self,
        source: &mut Connection,
        target: &mut Connection,
        progress: &mut impl FnMut(Step),
    ) -> Result<bool, CopyError> {
        let to = || self.to.clone();
        let failed = |source| CopyError::Target { target: self.to.clone(), source };
        if let Some(Unfinished { from, version }) = unfinished(target).await.map_err(failed)? {
            if from != self.from {
                return Err(CopyError::OfAnother { target: to(), of: from });
            }
            if version != newest_version() {
                return Err(CopyError::OfAnotherVersion { target: to() });
            }
            return Ok(true);
        }
        if let Some(table) = first_with_rows(target).await.map_err(failed)? {
            return Err(CopyError::Occupied { target: to(), table });
        }
        if target.is_postgres() && !source.is_postgres() {
            for table in TABLES {
                progress(Step::Search(table.name));
                table.refuse_nul(source).await?;
            }
        }
        target
            .transaction(Begin::Write, async |target| self.mark(target).await)
            .await
            .map_err(failed)?;
        Ok(false)
    }

    async fn mark(&self, target: &mut Connection) -> Result<(), sqlx::Error> {
        let table = format!(
            "CREATE TABLE {UNFINISHED} (source text NOT NULL, version bigint NOT NULL, table_name text PRIMARY KEY,
                                        copied bigint NOT NULL)"
        );
        Statement::of(table).execute(target).await?;
        let columns = "source, version, table_name, copied";
        let mut insert = Builder::new(format!("INSERT INTO {UNFINISHED} ({columns}) "));
        insert.push_rows(TABLES, |row, table| {
            row.push_bind(&self.from)
                .push_bind(newest_version())
                .push_bind(table.name)
                .push_bind(0_i64);
        });
        insert.build().execute(target).await.map(drop)
    }
}

fn newest_version() -> i64 {
    // Both engines have the same migration numbers.
    migrations::newest(&migrations::sqlite()).expect("there are migrations")
}

/// A row of the progress table.
pub(super) struct Unfinished {
    from: String,
    version: i64,
}

from_row! {
    Unfinished { from = "source", version }
}

/// Reads the progress table of the target, if it exists.
pub(super) async fn unfinished(
    connection: &mut Connection,
) -> Result<Option<Unfinished>, sqlx::Error> {
    if !tables_of(connection).await?.iter().any(|table| table == UNFINISHED) {
        return Ok(None);
    }
    let note = Statement::of(format!("SELECT source, version FROM {UNFINISHED} LIMIT 1"));
    note.one(connection).await.map(Some)
}

/// Refuses to open the target of an unfinished copy.
pub(super) fn refuse(unfinished: Option<Unfinished>, location: &str) -> Result<(), OpenError> {
    match unfinished {
        None => Ok(()),
        Some(Unfinished { from, .. }) => {
            Err(OpenError::Incomplete { location: location.to_owned(), from })
        }
    }
}

/// [`refuse`] for an open connection.
pub(super) async fn refuse_unfinished(
    connection: &mut Connection,
    location: &Location,
) -> Result<(), OpenError> {
    let unfinished = unfinished(connection).await.map_err(|error| location.failed(error))?;
    refuse(unfinished, &location.to_string())
}

async fn tables_of(connection: &mut Connection) -> Result<Vec<String>, sqlx::Error> {
    let tables = if connection.is_postgres() {
        "SELECT CAST(tablename AS text) FROM pg_tables WHERE schemaname = current_schema()"
    } else {
        "SELECT name FROM sqlite_schema WHERE type = 'table'"
    };
    query(tables).all(connection).await
}

/// The first table that has rows, if any.
async fn first_with_rows(connection: &mut Connection) -> Result<Option<&'static str>, sqlx::Error> {
    let there = tables_of(connection).await?;
    for table in TABLES.iter().filter(|table| there.iter().any(|name| name == table.name)) {
        let row = Statement::of(format!("SELECT 1 FROM {} LIMIT 1", table.name));
        if row.fetch_optional(connection).await?.is_some() {
            return Ok(Some(table.name));
        }
    }
    Ok(None)
}

/// Sets the sequences of PostgreSQL's numbered keys, and updates the statistics of its planner.
async fn settle(target: &mut Connection) -> Result<(), sqlx::Error> {
    if !target.is_postgres() {
        return Ok(());
    }
    for Table { name, columns, is_numbered, .. } in TABLES {
        if *is_numbered {
            let (key, _) = columns[0];
            let set = format!(
                "SELECT setval(pg_get_serial_sequence('{name}', '{key}'), greatest(max({key}), 1))
                 FROM {name} HAVING max({key}) IS NOT NULL"
            );
            Statement::of(set).execute(target).await?;
        }
        Statement::of(format!("ANALYZE {name}")).execute(target).await?;
    }
    Ok(())
}

type Values = Vec<Value<'static>>;

/// Consecutive rows of a table, read at once.
struct Piece {
    rows: Vec<Values>,
    bytes: usize,
}

/// Start and size of the next piece.
struct Next {
    /// Primary key of the row before the piece; `None` at the start of the table.
    after: Option<Values>,
    rows: i64,
}

impl Next {
    fn from(after: Option<Values>) -> Self {
        let (_, first) = PIECE_ROWS;
        Self { after, rows: first }
    }

    /// Continues after a piece; `None` if it is empty. PostgreSQL sends all requested rows, so the size of the next piece is
    /// estimated from this one's bytes per row.
    fn behind(&self, piece: &Piece, keys: usize) -> Option<Self> {
        let after = piece.rows.last()?[..keys].to_vec();
        let (most, _) = PIECE_ROWS;
        let fitting = i64::try_from(PIECE_BYTES_MAX * piece.rows.len() / piece.bytes.max(1));
        let rows = fitting.unwrap_or(most).clamp(1, (self.rows * 2).min(most));
        Some(Self { after: Some(after), rows })
    }
}

impl Table {
    /// Column names, separated by commas.
    pub(super) fn names(&self) -> String {
        names(self.columns)
    }

    fn key_names(&self) -> String {
        names(&self.columns[..self.keys])
    }

    fn unreadable(&self) -> impl Fn(sqlx::Error) -> CopyError + use<> {
        let table = self.name;
        move |source| CopyError::Read { table, source }
    }

    fn unwritable(&self) -> impl Fn(sqlx::Error) -> CopyError + use<> {
        let table = self.name;
        move |source| CopyError::Write { table, source }
    }

    /// Refuses a SQLite source with a text that contains U+0000, which PostgreSQL cannot store.
    async fn refuse_nul(&self, source: &mut Connection) -> Result<(), CopyError> {
        let texts = self.columns.iter().filter(|(_, kind)| *kind == Kind::Text);
        let has_nul: Vec<_> =
            texts.map(|(name, _)| format!("instr({name}, char(0)) > 0")).collect();
        if has_nul.is_empty() {
            return Ok(());
        }
        let (keys, table, has_nul) = (self.key_names(), self.name, has_nul.join(" OR "));
        let found = Statement::of(format!("SELECT {keys} FROM {table} WHERE {has_nul} LIMIT 1"));
        let found = found.fetch_optional(source).await.map_err(self.unreadable())?;
        let Some(row) = found else { return Ok(()) };
        let row = self.values(&row, self.keys).map_err(self.unreadable())?;
        Err(CopyError::Nul { table, row: in_words(&row) })
    }

    async fn count(&self, source: &mut Connection) -> Result<u64, CopyError> {
        let count = Statement::of(format!("SELECT count(*) FROM {}", self.name));
        let count = count.one::<i64>(source).await.map_err(self.unreadable())?;
        Ok(count.unsigned_abs())
    }

    /// Copies the missing rows. The next piece is read while the current one is written.
    async fn copy(
        &self,
        source: &mut Connection,
        target: &mut Connection,
        progress: &mut impl FnMut(Step),
    ) -> Result<(), CopyError> {
        let (table, of) = (self.name, self.count(source).await?);
        let (mut done, last) = self.copied(target).await.map_err(self.unwritable())?;
        progress(Step::Copy { table, done, of });
        let mut next = Next::from(last);
        let mut piece = self.read(source, &next).await.map_err(self.unreadable())?;
        while let Some(following) = next.behind(&piece, self.keys) {
            next = following;
            let (written, read) =
                futures::join!(self.write(target, &piece.rows), self.read(source, &next));
            written.map_err(self.unwritable())?;
            done += piece.rows.len() as u64;
            progress(Step::Copy { table, done, of });
            piece = read.map_err(self.unreadable())?;
        }
        Ok(())
    }

    /// Number of rows in the target, and the primary key of the last one.
    async fn copied(&self, target: &mut Connection) -> Result<(u64, Option<Values>), sqlx::Error> {
        let note = format!("SELECT copied FROM {UNFINISHED} WHERE table_name = $1");
        let done: i64 = Statement::of(note).bind(self.name).one(target).await?;
        let (keys, name) = (self.key_names(), self.name);
        let descending = keys.replace(',', " DESC,");
        let last = format!("SELECT {keys} FROM {name} ORDER BY {descending} DESC LIMIT 1");
        let last = Statement::of(last).fetch_optional(target).await?;
        let last = last.map(|row| self.values(&row, self.keys)).transpose()?;
        Ok((done.unsigned_abs(), last))
    }

    async fn read(&self, connection: &mut Connection, next: &Next) -> Result<Piece, sqlx::Error> {
        let (columns, keys) = (self.names(), self.key_names());
        let mut text = format!("SELECT {columns} FROM {}", self.name);
        if next.after.is_some() {
            let places: Vec<_> = (1..=self.keys).map(|place| format!("${place}")).collect();
            write!(text, " WHERE ({keys}) > ({})", places.join(", "))
                .expect("a String takes any text");
        }
        let after = next.after.as_deref().unwrap_or_default();
        write!(text, " ORDER BY {keys} LIMIT ${}", after.len() + 1)
            .expect("a String takes any text");
        let bound = after
            .iter()
            .fold(Statement::of(text), |statement, value| statement.bind_value(value.clone()));
        let mut rows = bound.bind(next.rows).fetch(connection);
        let mut piece = Piece { rows: Vec::new(), bytes: 0 };
        while piece.bytes < PIECE_BYTES_MAX
            && let Some(row) = rows.try_next().await?
        {
            let row = self.values(&row, self.columns.len())?;
            piece.bytes += row.iter().map(bytes_of).sum::<usize>();
            piece.rows.push(row);
        }
        Ok(piece)
    }

    fn values(&self, row: &SqlRow, count: usize) -> Result<Values, sqlx::Error> {
        let value = |(place, (_, kind)): (usize, &(&str, Kind))| {
            Ok(match kind {
                Kind::Int => Value::Int(row.try_get(place)?),
                Kind::Bool => Value::Bool(row.try_get(place)?),
                Kind::Real => Value::Real(row.try_get(place)?),
                Kind::Text => Value::Text(row.try_get::<Option<String>>(place)?.map(Cow::Owned)),
                Kind::Bytes => Value::Bytes(row.try_get::<Option<Vec<u8>>>(place)?.map(Cow::Owned)),
            })
        };
        self.columns[..count].iter().enumerate().map(value).collect()
    }

    /// Writes rows and the progress in one transaction.
    async fn write(&self, target: &mut Connection, rows: &[Values]) -> Result<(), sqlx::Error> {
        let write = async |target: &mut Connection| {
            if target.is_postgres() {
                postgres::bulk::insert(target, self, rows).await?;
            } else {
                self.insert_in_chunks(target, rows).await?;
            }
            let note =
                format!("UPDATE {UNFINISHED} SET copied = copied + $1 WHERE table_name = $2");
            let count = i64::try_from(rows.len()).unwrap_or(i64::MAX);
            Statement::of(note).bind(count).bind(self.name).execute(target).await?;
            Ok(())
        };
        target.transaction(Begin::Write, write).await
    }

    async fn insert_in_chunks(
        &self,
        target: &mut Connection,
        rows: &[Values],
    ) -> Result<(), sqlx::Error> {
        let (name, columns) = (self.name, self.names());
        for chunk in chunks(rows) {
            let mut insert = Builder::new(format!("INSERT INTO {name} ({columns}) "));
            insert.push_rows(chunk, |row, values| {
                for value in values {
                    row.push_value(value.borrowed());
                }
            });
            insert.build().execute(target).await?;
        }
        Ok(())
    }

    /// Compares the rows of both databases.
    async fn compare(
        &self,
        source: &mut Connection,
        target: &mut Connection,
        progress: &mut impl FnMut(Step),
    ) -> Result<CopiedTable, CopyError> {
        let (table, of) = (self.name, self.count(source).await?);
        let (mut digest, mut done) = (Sha256::new(), 0);
        let (mut one, mut other) = (Vec::new(), Vec::new());
        let mut next = Next::from(None);
        loop {
            progress(Step::Compare { table, done, of });
            let (ours, theirs) = futures::join!(self.read(source, &next), self.read(target, &next));
            let ours = ours.map_err(self.unreadable())?;
            let theirs = theirs.map_err(self.unwritable())?;
            for (place, row) in ours.rows.iter().enumerate() {
                let theirs = theirs.rows.get(place);
                encode(row, &mut one);
                encode(theirs.map_or(&[], Vec::as_slice), &mut other);
                if one != other {
                    return Err(self.differs(row));
                }
                digest.update(&one);
            }
            if let Some(more) = theirs.rows.get(ours.rows.len()) {
                return Err(self.differs(more));
            }
            done += ours.rows.len() as u64;
            match next.behind(&ours, self.keys) {
                Some(following) => next = following,
                None => break,
            }
        }
        Ok(CopiedTable { name: table, rows: done, digest: digest.finalize().into() })
    }

    fn differs(&self, row: &Values) -> CopyError {
        CopyError::Differs { table: self.name, row: in_words(&row[..self.keys]) }
    }
}

fn names(columns: &[(&str, Kind)]) -> String {
    columns.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}

/// A primary key in readable form.
fn in_words(key: &[Value<'_>]) -> String {
    let word = |value: &Value<'_>| match value {
        Value::Int(Some(number)) => number.to_string(),
        Value::Text(Some(text)) => format!("{text:?}"),
        Value::Bytes(Some(bytes)) => HEXLOWER.encode(bytes),
        Value::Bool(Some(truth)) => truth.to_string(),
        Value::Real(Some(number)) => number.to_string(),
        Value::Int(None)
        | Value::Text(None)
        | Value::Bytes(None)
        | Value::Bool(None)
        | Value::Real(None) => "NULL".to_owned(),
    };
    key.iter().map(word).collect::<Vec<_>>().join(", ")
}

/// Estimated size of a value in memory.
fn bytes_of(value: &Value<'_>) -> usize {
    size_of::<Value<'_>>()
        + match value {
            Value::Text(Some(text)) => text.len(),
            Value::Bytes(Some(bytes)) => bytes.len(),
            Value::Text(None)
            | Value::Bytes(None)
            | Value::Int(_)
            | Value::Bool(_)
            | Value::Real(_) => 0,
        }
}

/// Encodes a row for hashing: kind, presence and value of each column, with the length of texts and bytes.
fn encode(row: &[Value<'_>], bytes: &mut Vec<u8>) {
    bytes.clear();
    for value in row {
        let (kind, number) = match value {
            Value::Int(number) => (b'i', number.map(i64::to_le_bytes)),
            Value::Bool(truth) => (b'b', truth.map(|truth| i64::from(truth).to_le_bytes())),
            // SQLite does not store the sign of zero.
            Value::Real(number) => {
                (b'r', number.map(|number| (number + 0.0).to_bits().to_le_bytes()))
            }
            Value::Text(text) => {
                (b't', text.as_ref().map(|text| (text.len() as u64).to_le_bytes()))
            }
            Value::Bytes(raw) => (b'y', raw.as_ref().map(|raw| (raw.len() as u64).to_le_bytes())),
        };
        bytes.extend([kind, u8::from(number.is_some())]);
        bytes.extend(number.unwrap_or_default());
        match value {
            Value::Text(Some(text)) => bytes.extend_from_slice(text.as_bytes()),
            Value::Bytes(Some(raw)) => bytes.extend_from_slice(raw),
            Value::Text(None)
            | Value::Bytes(None)
            | Value::Int(_)
            | Value::Bool(_)
            | Value::Real(_) => {}
        }
    }
}
