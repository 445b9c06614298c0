//! The table `runs`.

use jiff::Timestamp;
use sqlx::sqlite::SqliteConnection;

use crate::ids::TokenHash;
use crate::journal::{RunKey, RunRow};

pub(super) async fn open(
    connection: &mut SqliteConnection,
    row: &RunRow,
) -> Result<(), sqlx::Error> {
    sqlx::query(
        "INSERT INTO runs (key, id, owner, suite, digest, definition, model, status, entry, attempt,
                           created_at, idempotency_key, idempotency_body)
         VALUES (?, ?, ?, ?, ?, ?, ?, 'running', ?, ?, ?, ?, ?)",
    )
    .bind(row.run.0)
    .bind(&row.id)
    .bind(row.owner.map(|owner| owner.0))
    .bind(&row.suite)
    .bind(&row.digest)
    .bind(&row.definition)
    .bind(&row.model)
    .bind(row.attempt.map(|(entry, _)| entry.0))
    .bind(row.attempt.map(|(_, number)| number))
    .bind(row.at.as_millisecond())
    .bind(row.idempotency.as_ref().map(|(key, _)| key))
    .bind(row.idempotency.as_ref().map(|(_, body)| &body[..]))
    .execute(&mut *connection)
    .await?;
    match row.token {
        Some(hash) => add_token(connection, row.run, hash).await,
        None => Ok(()),
    }
}

pub(super) async fn end(
    connection: &mut SqliteConnection,
    run: RunKey,
    status: &str,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE runs SET status = ?, ended_at = ? WHERE key = ? AND ended_at IS NULL")
        .bind(status)
        .bind(at.as_millisecond())
        .bind(run.0)
        .execute(connection)
        .await?;
    Ok(())
}

pub(super) async fn replace_token(
    connection: &mut SqliteConnection,
    run: RunKey,
    hash: TokenHash,
) -> Result<(), sqlx::Error> {
    sqlx::query("DELETE FROM tokens WHERE run = ?").bind(run.0).execute(&mut *connection).await?;
    add_token(connection, run, hash).await
}

async fn add_token(
    connection: &mut SqliteConnection,
    run: RunKey,
    hash: TokenHash,
) -> Result<(), sqlx::Error> {
    sqlx::query("INSERT INTO tokens (hash, run) VALUES (?, ?)")
        .bind(&hash.0[..])
        .bind(run.0)
        .execute(connection)
        .await?;
    Ok(())
}
