//! The table `forking`: forks written in several commits.

use crate::ids::{EpisodeId, EpisodeKey};
use crate::store::sql::{Begin, Builder, Connection, chunks, query};
use crate::store::{Store, StoreError};

/// Marks forks whose rows come in this and later commits.
pub(in crate::store) async fn begin(
    connection: &mut Connection,
    episodes: &[EpisodeKey],
) -> Result<(), sqlx::Error> {
    for chunk in chunks(episodes) {
        let mut insert = Builder::new("INSERT INTO forking (episode) ");
        insert.push_rows(chunk, |row, episode| {
            row.push_bind(episode.0);
        });
        insert.build().execute(&mut *connection).await?;
    }
    Ok(())
}

/// Unmarks a complete fork.
pub(in crate::store) async fn complete(
    connection: &mut Connection,
    episode: EpisodeKey,
) -> Result<(), sqlx::Error> {
    let query = query("DELETE FROM forking WHERE episode = $1");
    query.bind(episode.0).execute(connection).await.map(drop)
}

/// Deletes the rows of incomplete forks, except those that a server is writing now.
pub(in crate::store) async fn delete_incomplete(
    connection: &mut Connection,
) -> Result<(), sqlx::Error> {
    let left = if connection.is_postgres() {
        "SELECT episode FROM forking f WHERE NOT EXISTS (SELECT 1 FROM places p WHERE p.kind = 0 AND p.key = f.episode)"
    } else {
        "SELECT episode FROM forking"
    };
    let left: Vec<i64> = query(left).all(connection).await?;
    if left.is_empty() {
        return Ok(());
    }
    let delete_all = async |connection: &mut Connection| {
        for episode in &left {
            for statement in [
                "DELETE FROM acts WHERE episode = $1",
                "DELETE FROM rounds WHERE episode = $1",
                "DELETE FROM forking WHERE episode = $1",
            ] {
                query(statement).bind(*episode).execute(connection).await?;
            }
        }
        Ok(())
    };
    connection.transaction(Begin::Write, delete_all).await
}

impl Store {
    /// The forks created by one request: `first` and the following ones, `count` in total.
    pub async fn forks_made_with(
        &self,
        first: &EpisodeId,
        count: u32,
    ) -> Result<Vec<EpisodeId>, StoreError> {
        let query = query(
            "SELECT e.id FROM episodes e JOIN episodes f ON f.id = $1
             WHERE e.key >= f.key AND e.key < f.key + $2 ORDER BY e.key",
        );
        self.fetch_all(query.bind(first.as_str()).bind(count)).await
    }
}
