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
    // Few acts have a second, brief record, and each value that is bound costs something.
    static WHOLE: Insert = Insert::new(
        "acts (episode, round, agent, waiting_for, source, at, record)",
        "(?, ?, ?, ?, ?, ?, ?)",
    );
    static WITH_BRIEF: Insert = Insert::new(
        "acts (episode, round, agent, waiting_for, source, at, record, brief)",
        "(?, ?, ?, ?, ?, ?, ?, ?)",
    );
    let Engine::Sqlite(connection) = connection.engine() else {
        unreachable!("this is the writer of SQLite")
    };
    for rows in chunks(acts) {
        let has_brief = rows.iter().any(|act| act.brief.is_some());
        let insert = if has_brief { &WITH_BRIEF } else { &WHOLE };
        let mut query = sqlx::query(insert.statement(rows.len()));
        for act in rows {
            query = query
                .bind(act.episode.0)
                .bind(act.round)
                .bind(act.agent.0)
                .bind(act.waiting_for)
                .bind(source_code(act.source))
                .bind(act.at.as_millisecond())
                .bind(act.record.as_str());
            if has_brief {
                query = query.bind(act.brief.as_ref().map(RawRecord::as_str));
            }
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
    for rows in chunks(rounds) {
        let mut query = sqlx::query(INSERT.statement(rows.len()));
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

    /// The statement for this many rows, which has to be the length of a chunk.
    fn statement(&'static self, rows: usize) -> &'static str {
        let size = CHUNKS.iter().position(|&size| size == rows).expect("chunks have these sizes");
        self.statements[size].get_or_init(|| {
            format!("INSERT INTO {} VALUES {}", self.into, vec![self.row; rows].join(", "))
        })
    }
}
