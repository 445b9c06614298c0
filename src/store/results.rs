//! The table `results`: what boards are made of.

use sqlx::sqlite::SqliteConnection;

use crate::journal::EndRow;

/// Notes what an episode came to, in the transaction that holds its end.
pub(super) async fn add(
    connection: &mut SqliteConnection,
    row: &EndRow,
) -> Result<(), sqlx::Error> {
    let count = |number: u64| i64::try_from(number).unwrap_or(i64::MAX);
    sqlx::query(
        "INSERT OR REPLACE INTO results (episode, task, seed, score, rounds, status, acts, invalid, clock_outs,
                              prompt_tokens, completion_tokens)
         SELECT key, task, json_extract(opening, '$.config.seed'), ?, ?, status, ?, ?, ?, ?, ?
         FROM episodes WHERE key = ?",
    )
    .bind(row.score)
    .bind(row.rounds)
    .bind(count(row.tally.acts))
    .bind(count(row.tally.invalid))
    .bind(count(row.tally.clock_outs))
    .bind(count(row.tally.prompt_tokens))
    .bind(count(row.tally.completion_tokens))
    .bind(row.episode.0)
    .execute(connection)
    .await?;
    Ok(())
}
