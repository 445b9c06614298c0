//! The copied tables and their columns; a test compares them with the migrations.

use super::{Kind, Table};

/// Tables in the order of copying. `by` gives the number of leading columns that form the primary key; `numbered` means that
/// a database sequence assigns it.
macro_rules! tables {
    (@ numbered) => { true };
    (@ given) => { false };
    ($($name:ident by $keys:literal $how:ident { $($column:ident: $kind:ident),* $(,)? })*) => {
        pub(super) const TABLES: &[Table] = &[$(Table {
            name: stringify!($name),
            keys: $keys,
            is_numbered: tables!(@ $how),
            columns: &[$((stringify!($column), Kind::$kind)),*],
        }),*];
    };
}

// Tables about the servers of a PostgreSQL cluster (`nodes`, `members`, `places`, `cluster`, `changes`) are not copied.
tables! {
    episodes by 1 given {
        key: Int, id: Text, opening: Text, task: Text, model: Text, visibility: Text, status: Text,
        clocked: Bool, head: Bytes, ending: Text, created_at: Int, started_at: Int, ended_at: Int,
        idempotency_key: Text, idempotency_body: Bytes, owner: Int, bytes: Int, reason: Text,
        run: Int, slot: Int, seating: Text, voided_at: Int, void_reason: Text, revealed: Bool,
        fork_of: Int, fork_round: Int, template: Int, template_at: Int, open_seats: Bool,
        own_games: Bool, score: Real, rounds: Real, seed: Real, curve: Text, people: Bool,
    }
    acts by 3 given {
        episode: Int, round: Int, agent: Int, waiting_for: Int, at: Int, record: Text, source: Int,
        brief: Text,
    }
    rounds by 2 given {
        episode: Int, round: Int, digest: Bytes, score: Real, head: Bytes, at: Int,
    }
    tokens by 1 given {
        hash: Bytes, episode: Int, agent: Int, holder: Int, run: Int,
    }
    keys by 1 numbered {
        number: Int, id: Text, hash: Bytes, role: Text, name: Text, created_at: Int,
        expires_at: Int, revoked_at: Int, acts_for: Int,
    }
    runs by 1 given {
        key: Int, id: Text, owner: Int, suite: Text, digest: Text, definition: Text, model: Text,
        visibility: Text, status: Text, entry: Int, attempt: Int, voided_at: Int, void_reason: Text,
        created_at: Int, ended_at: Int, idempotency_key: Text, idempotency_body: Bytes,
        closes_at: Int, replays: Int, competition: Int, revealed: Bool,
    }
    results by 1 given {
        episode: Int, task: Text, seed: Int, score: Real, rounds: Int, status: Text, acts: Int,
        invalid: Int, clock_outs: Int, prompt_tokens: Int, completion_tokens: Int, failures: Text,
        usage: Text,
    }
    seats by 2 given {
        episode: Int, agent: Int, holder: Int, owner: Int, model: Text, player: Text,
        claimed_at: Int,
    }
    claims by 2 given {
        episode: Int, holder: Int, owner: Int, key: Text, model: Text, agent_meta: Text,
        player: Text, claimed_at: Int, idempotency_key: Text, idempotency_body: Bytes,
    }
    competitions by 1 numbered {
        key: Int, id: Text, definition: Text, salt: Bytes, seeds: Bytes, commitment: Bytes,
        opens_at: Int, closes_at: Int, created_at: Int, revealed_at: Int, entrants: Int,
        cancelled_at: Int, cancel_reason: Text, hidden: Bool,
    }
    entries by 1 numbered {
        key: Int, id: Text, competition: Int, owner: Int, name: Text, model: Text,
        declaration: Text, template: Text, status: Text, reason: Text, vouched: Bool,
        registered_at: Int, address: Text, erased_at: Int, published: Text, category: Text,
        terms: Int, contact: Text, brief: Text, renames: Int,
    }
    invitations by 1 given {
        hash: Bytes, competition: Int, label: Text, entry: Int, created_at: Int, revoked_at: Int,
    }
    looks by 4 given {
        competition: Int, kind: Text, look: Text, written: Text,
    }
    used_names by 3 given {
        competition: Int, look: Bytes, entry: Int,
    }
    audit by 1 numbered {
        number: Int, at: Int, who: Text, action: Text, subject: Text, detail: Text,
        competition: Int, shown: Text,
    }
    imports by 1 numbered {
        key: Int, id: Text, digest: Bytes, run_id: Text, meta: Text, model: Text, task: Text,
        seed: Int, settings: Text, score: Real, rounds: Int, acts: Int, imported_at: Int,
    }
    import_rounds by 2 given {
        import: Int, round: Int, score: Real, state: Text, acts: Bytes,
    }
    metrics by 2 given {
        episode: Int, embedder: Text, revision: Int, measured: Text,
    }
    unmeasured by 1 numbered {
        number: Int, episode: Int,
    }
    forking by 1 given {
        episode: Int,
    }
    templates by 1 numbered {
        key: Int, hash: Bytes, text: Text,
    }
}

#[cfg(test)]
mod tests {
    use sqlx::sqlite::SqliteConnectOptions;
    use sqlx::{ConnectOptions as _, Row as _};

    use super::*;
    use crate::migrations;

    /// Compares with the migrations of SQLite. Another test, which needs a PostgreSQL server, compares those of PostgreSQL.
    #[tokio::test]
    async fn they_are_those_that_the_migrations_make() {
        let made = SqliteConnectOptions::new().in_memory(true).connect().await;
        let mut made = made.expect("a database");
        migrations::sqlite().run(&mut made).await.expect("the tables");
        let columns = "SELECT t.name, c.name, c.type, c.pk FROM sqlite_schema t JOIN pragma_table_info(t.name) c
                       WHERE t.type = 'table' AND t.name NOT GLOB '_sqlx*'";
        let columns = sqlx::query(columns).fetch_all(&mut made).await.expect("columns");
        let column = |row: &sqlx::sqlite::SqliteRow| -> (String, String, String, i64) {
            (row.get(0), row.get(1), row.get(2), row.get(3))
        };
        let mut made: Vec<_> = columns.iter().map(column).collect();
        let mut copied: Vec<_> = TABLES
            .iter()
            .flat_map(|table| {
                table.columns.iter().enumerate().map(|(place, (column, kind))| {
                    let kind = match kind {
                        // SQLite stores booleans as integers.
                        Kind::Int | Kind::Bool => "INTEGER",
                        Kind::Real => "REAL",
                        Kind::Text => "TEXT",
                        Kind::Bytes => "BLOB",
                    };
                    let key = if place < table.keys { place + 1 } else { 0 };
                    let key = i64::try_from(key).expect("few columns");
                    (table.name.to_owned(), (*column).to_owned(), kind.to_owned(), key)
                })
            })
            .collect();
        made.sort();
        copied.sort();
        assert_eq!(copied, made);
    }
}
