//! Both engines have the same tables, columns and indexes.

use std::collections::{BTreeMap, BTreeSet};
use swarmbench_testkit::needs;

use sqlx::postgres::PgConnection;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _};
use swarmbench::store::Store;

use crate::store::{location, scratch};

/// The tables that only PostgreSQL has.
const OWN: [&str; 5] = ["changes", "cluster", "members", "nodes", "places"];

/// The table of the migrations themselves, which each driver makes.
const MIGRATIONS: &str = "_sqlx_migrations";

/// Columns that are integers in SQLite, and truths in PostgreSQL.
const TRUTHS: [(&str, &str); 8] = [
    ("competitions", "hidden"),
    ("entries", "vouched"),
    ("episodes", "clocked"),
    ("episodes", "open_seats"),
    ("episodes", "own_games"),
    ("episodes", "people"),
    ("episodes", "revealed"),
    ("runs", "revealed"),
];

/// Integers of two bytes in PostgreSQL: seats, of which an episode has few.
const SMALL: [(&str, &str); 5] = [
    ("acts", "agent"),
    ("acts", "source"),
    ("acts", "waiting_for"),
    ("seats", "agent"),
    ("tokens", "agent"),
];

/// Integers of four bytes in PostgreSQL: numbers of rounds, games, attempts, holders and versions.
const MIDDLE: [(&str, &str); 14] = [
    ("acts", "round"),
    ("claims", "holder"),
    ("entries", "terms"),
    ("episodes", "fork_round"),
    ("episodes", "slot"),
    ("import_rounds", "round"),
    ("imports", "rounds"),
    ("metrics", "revision"),
    ("results", "rounds"),
    ("rounds", "round"),
    ("runs", "attempt"),
    ("runs", "replays"),
    ("seats", "holder"),
    ("tokens", "holder"),
];

/// A column: its table, its name, its kind in PostgreSQL, and whether it may be empty.
type Column = (String, String, String, bool);

/// An index: its name, its table, its columns in order, and whether it has a condition.
type Index = (String, String, String, bool);

#[derive(Debug, Default)]
struct Schema {
    columns: BTreeSet<Column>,
    indexes: BTreeSet<Index>,
    /// Tables, and columns that have each value once.
    unique: BTreeSet<(String, String)>,
}

fn kind_in_postgres(table: &str, column: &str, kind: &str) -> String {
    let has = |columns: &[(&str, &str)]| columns.contains(&(table, column));
    match kind {
        "INTEGER" if has(&TRUTHS) => "boolean",
        "INTEGER" if has(&SMALL) => "smallint",
        "INTEGER" if has(&MIDDLE) => "integer",
        "INTEGER" => "bigint",
        "TEXT" => "text",
        "BLOB" => "bytea",
        "REAL" => "double precision",
        other => panic!("{table}.{column} is {other}"),
    }
    .to_owned()
}

async fn of_sqlite(database: &mut SqliteConnection) -> Schema {
    let mut schema = Schema::default();
    let columns: Vec<(String, String, String, bool, i64)> = sqlx::query_as(
        "SELECT t.name, c.name, c.type, c.\"notnull\", c.pk FROM sqlite_schema t, pragma_table_info(t.name) c
         WHERE t.type = 'table' ORDER BY t.name, c.pk",
    )
    .fetch_all(&mut *database)
    .await
    .expect("the columns");
    let mut primary = BTreeMap::<String, Vec<String>>::new();
    for (table, column, kind, is_full, place) in columns {
        if table == MIGRATIONS {
            continue;
        }
        if place > 0 {
            primary.entry(table.clone()).or_default().push(column.clone());
        }
        let kind = kind_in_postgres(&table, &column, &kind);
        schema.columns.insert((table, column, kind, !is_full && place == 0));
    }
    schema.unique.extend(primary.into_iter().map(|(table, columns)| (table, columns.join(", "))));
    let indexes: Vec<(String, String, String, bool, String)> = sqlx::query_as(
        "SELECT t.name, i.name, i.origin, i.partial,
                (SELECT group_concat(name, ', ' ORDER BY seqno) FROM pragma_index_info(i.name))
         FROM sqlite_schema t, pragma_index_list(t.name) i WHERE t.type = 'table'",
    )
    .fetch_all(database)
    .await
    .expect("the indexes");
    for (table, name, origin, is_partial, columns) in indexes {
        if table == MIGRATIONS {
            continue;
        }
        match origin.as_str() {
            "c" => drop(schema.indexes.insert((name, table, columns, is_partial))),
            // Primary keys are among the columns already.
            "u" => drop(schema.unique.insert((table, columns))),
            "pk" => {}
            other => panic!("{name} is {other}"),
        }
    }
    schema
}

async fn of_postgres(database: &mut PgConnection) -> Schema {
    let columns: Vec<(String, String, String, bool, Option<String>)> = sqlx::query_as(
        "SELECT table_name::text, column_name::text, data_type::text, is_nullable = 'YES', collation_name::text
         FROM information_schema.columns WHERE table_schema = current_schema()",
    )
    .fetch_all(&mut *database)
    .await
    .expect("the columns");
    let mut schema = Schema::default();
    for (table, column, kind, may_be_empty, collation) in columns {
        if table == MIGRATIONS || OWN.contains(&table.as_str()) {
            continue;
        }
        if kind == "text" {
            assert_eq!(collation.as_deref(), Some("C"), "{table}.{column} is compared by bytes");
        }
        schema.columns.insert((table, column, kind, may_be_empty));
    }
    let indexes: Vec<(String, String, bool, bool, String)> = sqlx::query_as(
        "SELECT t.relname::text, i.relname::text, x.indisunique, x.indpred IS NOT NULL,
                (SELECT string_agg(a.attname, ', ' ORDER BY k.place)
                 FROM unnest(x.indkey) WITH ORDINALITY AS k (number, place)
                 JOIN pg_attribute a ON a.attrelid = t.oid AND a.attnum = k.number)
         FROM pg_index x JOIN pg_class i ON i.oid = x.indexrelid JOIN pg_class t ON t.oid = x.indrelid
         WHERE t.relnamespace = current_schema()::regnamespace",
    )
    .fetch_all(database)
    .await
    .expect("the indexes");
    for (table, name, is_unique, is_partial, columns) in indexes {
        if table == MIGRATIONS || OWN.contains(&table.as_str()) {
            continue;
        }
        if is_unique {
            schema.unique.insert((table, columns));
        } else {
            schema.indexes.insert((name, table, columns, is_partial));
        }
    }
    schema
}

fn assert_same<T: Ord + std::fmt::Debug>(what: &str, sqlite: &BTreeSet<T>, postgres: &BTreeSet<T>) {
    let only_sqlite: Vec<_> = sqlite.difference(postgres).collect();
    let only_postgres: Vec<_> = postgres.difference(sqlite).collect();
    assert!(
        only_sqlite.is_empty() && only_postgres.is_empty(),
        "{what} of SQLite alone: {only_sqlite:?}, of PostgreSQL alone: {only_postgres:?}"
    );
    assert!(!sqlite.is_empty(), "no {what} were found");
}

#[needs(postgres)]
#[tokio::test]
async fn both_engines_have_the_same_tables() {
    let scratch = scratch().await;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.db");
    Store::open(&path).await.expect("it opens").close().await;
    Store::open(location(&scratch)).await.expect("it opens").close().await;
    let mut file = SqliteConnectOptions::new().filename(&path).connect().await.expect("it opens");
    let sqlite = of_sqlite(&mut file).await;
    file.close().await.expect("it closes");
    let mut server = scratch.connect().await;
    let postgres = of_postgres(&mut server).await;
    server.close().await.expect("it closes");
    assert_same("columns", &sqlite.columns, &postgres.columns);
    assert_same("indexes", &sqlite.indexes, &postgres.indexes);
    assert_same("unique columns", &sqlite.unique, &postgres.unique);
}
