//! Detection of other programs' databases, so that nothing is written into them.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection as _};

use crate::store::copy::UNFINISHED;

/// `SQLITE_NOTADB`.
const NOT_A_DATABASE: &str = "26";

/// Whether a file is no SQLite database, or has tables but none of this program. False for unreadable files.
pub(in crate::store) async fn is_foreign(path: &Path) -> bool {
    let options =
        SqliteConnectOptions::new().filename(path).read_only(true).disable_statement_logging();
    let of_no_database = |error: &sqlx::Error| {
        error
            .as_database_error()
            .is_some_and(|error| error.code().as_deref() == Some(NOT_A_DATABASE))
    };
    let mut connection = match options.connect().await {
        Ok(connection) => connection,
        Err(error) => return of_no_database(&error),
    };
    let tables: Result<Vec<String>, _> =
        sqlx::query_scalar("SELECT name FROM sqlite_schema WHERE type = 'table'")
            .fetch_all(&mut connection)
            .await;
    // A reader loses nothing if closing fails.
    drop(connection.close().await);
    match tables {
        Ok(tables) => {
            // `copying` is the only table of a copy that has hardly begun.
            let own = ["_sqlx_migrations", "episodes", UNFINISHED];
            let is_own = |table: &String| own.contains(&table.as_str());
            !tables.is_empty() && !tables.iter().any(is_own)
        }
        Err(error) => of_no_database(&error),
    }
}
