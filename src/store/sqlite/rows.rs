//! Chunked inserts of a group's acts and rounds: sizes are few, and each statement's text is composed once.

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
    // Few acts have a second, brief record, and each bound value costs time.
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

/// Insert statements of a table, for each size of [`CHUNKS`].
struct Insert {
    into: &'static str,
    /// Placeholders of a row's values.
    row: &'static str,
    /// Texts by number of rows, in the order of [`CHUNKS`].
    statements: [OnceLock<String>; CHUNKS.len()],
}

impl Insert {
    const fn new(into: &'static str, row: &'static str) -> Self {
        Self { into, row, statements: [const { OnceLock::new() }; CHUNKS.len()] }
    }

    /// The statement for a number of rows, which must be a length of [`CHUNKS`].
    fn statement(&'static self, rows: usize) -> &'static str {
        let size = CHUNKS.iter().position(|&size| size == rows).expect("chunks have these sizes");
        self.statements[size].get_or_init(|| {
            format!("INSERT INTO {} VALUES {}", self.into, vec![self.row; rows].join(", "))
        })
    }
}
