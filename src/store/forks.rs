//! The table `forking`: forks that are written in several commits.

use sqlx::sqlite::SqliteConnection;
use sqlx::{Connection, QueryBuilder, Sqlite};

use super::rows::chunks;
use super::{Store, StoreError};
use crate::ids::{EpisodeId, EpisodeKey};

/// Notes forks whose rows come in this commit and later ones.
pub(super) async fn begin(
    connection: &mut SqliteConnection,
    episodes: &[EpisodeKey],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(episodes) {
        let mut insert = QueryBuilder::<Sqlite>::new("INSERT INTO forking (episode) ");
        insert.push_values(chunk, |mut row, episode| {
            row.push_bind(episode.0);
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

/// Notes that a fork is complete.
pub(super) async fn complete(
    connection: &mut SqliteConnection,
    episode: EpisodeKey,
) -> Result<(), sqlx::Error> {
    let query = sqlx::query("DELETE FROM forking WHERE episode = ?");
    query.bind(episode.0).execute(connection).await.map(drop)
}

/// Deletes what is left of forks that were never completed.
pub(super) async fn delete_incomplete(
    connection: &mut SqliteConnection,
) -> Result<(), sqlx::Error> {
    let any: Option<i64> = sqlx::query_scalar("SELECT episode FROM forking LIMIT 1")
        .fetch_optional(&mut *connection)
        .await?;
    if any.is_none() {
        return Ok(());
    }
    let mut transaction = connection.begin_with("BEGIN IMMEDIATE").await?;
    for statement in [
        "DELETE FROM acts WHERE episode IN (SELECT episode FROM forking)",
        "DELETE FROM rounds WHERE episode IN (SELECT episode FROM forking)",
        "DELETE FROM forking",
    ] {
        sqlx::query(statement).execute(&mut *transaction).await?;
    }
    transaction.commit().await
}

impl Store {
    /// The forks that were made together with this one, which is the first of `count`.
    pub async fn forks_made_with(
        &self,
        first: &EpisodeId,
        count: u32,
    ) -> Result<Vec<EpisodeId>, StoreError> {
        let query = sqlx::query(
            "SELECT e.id FROM episodes e JOIN episodes f ON f.id = ?
             WHERE e.key >= f.key AND e.key < f.key + ? ORDER BY e.key",
        );
        self.fetch_all(query.bind(first.as_str()).bind(count)).await
    }
}
