//! Acts and rounds of a group, in statements of few sizes whose texts are made once.

use std::sync::OnceLock;

use crate::store::entries::{ActRow, RoundRow, source_code};
use crate::store::sql::{CHUNKS, Connection, Engine, chunks};
use swarmbench_journal::record::RawRecord;

pub(in crate::store) async fn insert(
    connection: &mut Connection,
    acts: &[&ActRow],
    rounds: &[&RoundRow],
) -> Result<(), sqlx::Error> {
    insert_acts(connection, acts).await?;
    insert_rounds(connection, rounds).await
}

async fn insert_acts(connection: &mut Connection, acts: &[&ActRow]) -> Result<(), sqlx::Error> {
    static INSERT: Insert = Insert::new(
        "acts (episode, round, agent, waiting_for, source, at, record, brief)",
        "(?, ?, ?, ?, ?, ?, ?, ?)",
    );
    let Engine::Sqlite(connection) = connection.engine() else {
        unreachable!("this is the writer of SQLite")
    };
    for (rows, statement) in INSERT.statements(acts) {
        let mut query = sqlx::query(statement);
        for act in rows {
            query = query
                .bind(act.episode.0)
                .bind(act.round)
                .bind(act.agent.0)
                .bind(act.waiting_for)
                .bind(source_code(act.source))
                .bind(act.at.as_millisecond())
                .bind(act.record.as_str())
                .bind(act.brief.as_ref().map(RawRecord::as_str));
        }
        query.execute(&mut *connection).await?;
    }
    Ok(())
}

async fn insert_rounds(
    connection: &mut Connection,
    rounds: &[&RoundRow],
) -> Result<(), sqlx::Error> {
    static INSERT: Insert =
        Insert::new("rounds (episode, round, digest, score, head, at)", "(?, ?, ?, ?, ?, ?)");
    let Engine::Sqlite(connection) = connection.engine() else {
        unreachable!("this is the writer of SQLite")
    };
    for (rows, statement) in INSERT.statements(rounds) {
        let mut query = sqlx::query(statement);
        for round in rows {
            query = query
                .bind(round.episode.0)
                .bind(round.round)
                .bind(&round.digest[..])
                .bind(round.score)
                .bind(&round.head.0[..])
                .bind(round.at.as_millisecond());
        }
        query.execute(&mut *connection).await?;
    }
    Ok(())
}

/// Statements that insert rows of the journal, whose texts are made once.
struct Insert {
    /// The table and its columns.
    into: &'static str,
    /// The places of the values of a row.
    row: &'static str,
    /// By the number of rows, as [`CHUNKS`] has them.
    statements: [OnceLock<String>; CHUNKS.len()],
}

impl Insert {
    const fn new(into: &'static str, row: &'static str) -> Self {
        Self { into, row, statements: [const { OnceLock::new() }; CHUNKS.len()] }
    }

    /// Rows in pieces, with the statement of each.
    fn statements<'r, T>(
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
