//! Ownership of places: a server takes and releases them, and its exclusion frees them.

use std::collections::HashSet;
use std::time::Duration;

use sqlx::postgres::PgArguments;
use sqlx::{Arguments as _, Row as _};

use super::{Cluster, Purpose};
use crate::cluster::Incarnation;
use crate::ids::{EpisodeKey, Place, RunKey};
use crate::store::StoreError;
use crate::store::entries::Entry;
use crate::store::sql::{Connection, Engine, query};

/// Pause before a retry while the database is away.
const PAUSE: Duration = Duration::from_millis(500);

/// Places in one statement.
const PLACES_AT_ONCE: usize = 1000;

impl Cluster {
    /// [`Places::keeper`](crate::cluster::Places::keeper), as far as this server knows.
    pub fn keeper(&self, place: Place) -> Option<Incarnation> {
        self.places.keeper(place, self.incarnation, &self.servers())
    }

    /// Notes the places taken by committed entries.
    pub(in crate::store) fn note(&self, entries: &[Entry]) {
        if entries.iter().any(|entry| taken_by(entry).is_some()) {
            self.places.gained(entries.iter().filter_map(taken_by));
        }
    }

    /// Whether a place has unfinished work. Always true for competitions, which can be changed even after their end.
    pub async fn is_unfinished(&self, place: Place) -> Result<bool, StoreError> {
        let (text, key) = match place {
            Place::Game(EpisodeKey(key)) => {
                ("SELECT EXISTS (SELECT 1 FROM episodes WHERE key = $1 AND ended_at IS NULL)", key)
            }
            Place::Run(RunKey(key)) => (
                "SELECT EXISTS (SELECT 1 FROM runs WHERE key = $1 AND ended_at IS NULL)
                     OR EXISTS (SELECT 1 FROM episodes WHERE run = $1 AND ended_at IS NULL)",
                key,
            ),
            Place::Competition(_) => return Ok(true),
        };
        self.on(&self.takes, Purpose::Takes, async |connection| {
            query(text).bind(key).one(connection).await
        })
        .await
    }

    /// Takes the free ones among some places; returns the owner of each, in any order.
    pub async fn take(&self, wanted: &[Place]) -> Result<Vec<(Place, Incarnation)>, StoreError> {
        // Noted first, as the caller may be gone when the statement is done.
        self.places.note_taken(wanted.iter().copied());
        self.take_noted(wanted).await
    }

    /// [`Cluster::take`] for a caller that resumes the places itself.
    pub async fn take_noted(
        &self,
        wanted: &[Place],
    ) -> Result<Vec<(Place, Incarnation)>, StoreError> {
        let mut owners = Vec::with_capacity(wanted.len());
        let mut missing = wanted.to_vec();
        // A fixed order, so that two servers do not deadlock.
        missing.sort_unstable();
        while !missing.is_empty() {
            let some: Vec<Place> = missing.drain(..missing.len().min(PLACES_AT_ONCE)).collect();
            let found = self
                .on(&self.takes, Purpose::Takes, async |connection| {
                    let found = take(connection, &some, self.incarnation).await?;
                    // Under the lock of the connection, so that the map changes in the order of the statements.
                    let own = found.iter().filter(|(_, owner)| *owner == self.incarnation);
                    self.places.confirmed(own.map(|(place, _)| *place));
                    Ok(found)
                })
                .await?;
            let known: HashSet<Place> = found.iter().map(|(place, _)| *place).collect();
            // Rows missing in the answer were inserted by another server at the same moment.
            missing.extend(some.into_iter().filter(|place| !known.contains(place)));
            owners.extend(found);
        }
        Ok(owners)
    }

    /// Releases places after [`Places::leave`](crate::cluster::Places::leave), once nothing is written there any more. If an answer is lost, the outcome is
    /// unknown: this server retries until it is known, and plays nothing there meanwhile.
    pub async fn release(&self, places: &[Place]) -> Result<(), StoreError> {
        for some in places.chunks(PLACES_AT_ONCE) {
            let rows = self.own_rows_when_back(some).await?;
            let takings: Vec<i64> = rows.into_iter().map(|(_, taking)| taking).collect();
            let mut is_sure = true;
            while let Err(error) = self.delete(&takings, some).await {
                if !matches!(error, StoreError::Away) {
                    return Err(error);
                }
                is_sure = false;
                tokio::time::sleep(PAUSE).await;
            }
            if !is_sure {
                // A lost attempt may have released a place that a request took again before the last attempt.
                let again = self.own_rows_when_back(some).await?;
                let again = again.into_iter().map(|(place, _)| place);
                self.places.note_taken(again.clone());
                self.places.gained(again);
            }
        }
        Ok(())
    }

    /// [`Cluster::own_rows`], retried while the database is away.
    async fn own_rows_when_back(&self, places: &[Place]) -> Result<Vec<(Place, i64)>, StoreError> {
        loop {
            match self.own_rows(places).await {
                Err(StoreError::Away) => tokio::time::sleep(PAUSE).await,
                answered => return answered,
            }
        }
    }

    /// The places among some that this server owns, with the numbers of their rows.
    async fn own_rows(&self, places: &[Place]) -> Result<Vec<(Place, i64)>, StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let (kinds, keys) = columns(places);
            let mut arguments = PgArguments::default();
            arguments.add(kinds).map_err(sqlx::Error::Encode)?;
            arguments.add(keys).map_err(sqlx::Error::Encode)?;
            arguments.add(self.incarnation).map_err(sqlx::Error::Encode)?;
            let Engine::Postgres(connection) = connection.engine() else {
                unreachable!("it is of PostgreSQL")
            };
            let rows = sqlx::query_with(
                "SELECT p.kind, p.key, p.taking FROM places p JOIN unnest($1::smallint[], $2::bigint[]) AS w (kind, key)
                     ON p.kind = w.kind AND p.key = w.key WHERE p.owner = $3",
                arguments,
            );
            let rows = rows.fetch_all(connection).await?;
            let own = rows.iter().map(|row| {
                let (kind, key, taking): (i16, i64, i64) =
                    (row.try_get(0)?, row.try_get(1)?, row.try_get(2)?);
                Ok(Place::from_numbers(kind, key).map(|place| (place, taking)))
            });
            own.filter_map(Result::transpose).collect()
        })
        .await
    }

    async fn delete(&self, takings: &[i64], places: &[Place]) -> Result<(), StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let mut arguments = PgArguments::default();
            arguments.add(takings.to_vec()).map_err(sqlx::Error::Encode)?;
            let Engine::Postgres(connection) = connection.engine() else {
                unreachable!("it is of PostgreSQL")
            };
            let delete =
                sqlx::query_with("DELETE FROM places WHERE taking = ANY($1::bigint[])", arguments);
            delete.execute(connection).await?;
            self.places.lost(places.iter().copied());
            Ok(())
        })
        .await
    }

    /// Releases all places of ended games and runs.
    pub async fn release_ended(&self) -> Result<(), StoreError> {
        self
            .on(&self.takes, Purpose::Takes, async |connection| {
                let delete = query(
                    "DELETE FROM places p WHERE p.owner = $1 AND (
                         p.kind = 0 AND EXISTS (SELECT 1 FROM episodes e WHERE e.key = p.key AND e.ended_at IS NOT NULL)
                         OR p.kind = 1
                             AND EXISTS (SELECT 1 FROM runs r WHERE r.key = p.key AND r.ended_at IS NOT NULL)
                             AND NOT EXISTS (SELECT 1 FROM episodes e WHERE e.run = p.key AND e.ended_at IS NULL))
                     RETURNING CAST(p.kind AS bigint), p.key",
                );
                let ended: Vec<(i64, i64)> = delete.bind(self.incarnation).all(connection).await?;
                self.places.lost(ended.into_iter().filter_map(place_of));
                Ok(())
            })
            .await
    }

    /// The owner of a place.
    pub async fn owner(&self, place: Place) -> Result<Option<i64>, StoreError> {
        let (kind, key) = place.numbers();
        self.on(&self.takes, Purpose::Takes, async |connection| {
            let owner = query("SELECT owner FROM places WHERE kind = $1 AND key = $2");
            owner.bind(i64::from(kind)).bind(key).optional(connection).await
        })
        .await
    }

    /// Unfinished games and runs without an owner.
    pub async fn unowned(&self) -> Result<Vec<Place>, StoreError> {
        let rows: Vec<(i64, i64)> = self
            .on(&self.takes, Purpose::Takes, async |connection| {
                let rows = query(
                    "SELECT CAST(0 AS bigint), e.key FROM episodes e
                     WHERE e.status IN ('waiting', 'running') AND e.run IS NULL
                         AND NOT EXISTS (SELECT 1 FROM places p WHERE p.kind = 0 AND p.key = e.key)
                     UNION ALL
                     SELECT 1, u.key FROM (
                         SELECT key FROM runs WHERE status = 'running'
                         UNION
                         SELECT run FROM episodes WHERE run IS NOT NULL AND status IN ('waiting', 'running')) u
                     WHERE NOT EXISTS (SELECT 1 FROM places p WHERE p.kind = 1 AND p.key = u.key)",
                );
                rows.all(connection).await
            })
            .await?;
        Ok(rows.into_iter().filter_map(place_of).collect())
    }

    /// Deletes incomplete forks of dead servers.
    pub async fn delete_incomplete_forks(&self) -> Result<(), StoreError> {
        self.on(&self.takes, Purpose::Takes, async |connection| {
            crate::store::forks::delete_incomplete(connection).await
        })
        .await
    }
}

fn place_of((kind, key): (i64, i64)) -> Option<Place> {
    Place::from_numbers(i16::try_from(kind).ok()?, key)
}

fn columns(places: &[Place]) -> (Vec<i16>, Vec<i64>) {
    places.iter().map(|place| place.numbers()).unzip()
}

pub(super) async fn take(
    connection: &mut Connection,
    wanted: &[Place],
    owner: i64,
) -> Result<Vec<(Place, i64)>, sqlx::Error> {
    let (kinds, keys) = columns(wanted);
    let mut arguments = PgArguments::default();
    arguments.add(kinds).map_err(sqlx::Error::Encode)?;
    arguments.add(keys).map_err(sqlx::Error::Encode)?;
    arguments.add(owner).map_err(sqlx::Error::Encode)?;
    let Engine::Postgres(connection) = connection.engine() else {
        unreachable!("it is of PostgreSQL")
    };
    let rows = sqlx::query_with(
        "WITH wanted AS (SELECT kind, key FROM unnest($1::smallint[], $2::bigint[]) AS t (kind, key)),
              taken AS (INSERT INTO places (kind, key, owner) SELECT kind, key, $3 FROM wanted ORDER BY kind, key
                        ON CONFLICT DO NOTHING RETURNING kind, key, owner)
         SELECT kind, key, owner FROM taken
         UNION ALL SELECT p.kind, p.key, p.owner FROM places p JOIN wanted w ON w.kind = p.kind AND w.key = p.key",
        arguments,
    );
    let rows = rows.fetch_all(connection).await?;
    let owners = rows.iter().map(|row| {
        let (kind, key, owner): (i16, i64, i64) =
            (row.try_get(0)?, row.try_get(1)?, row.try_get(2)?);
        Ok(Place::from_numbers(kind, key).map(|place| (place, owner)))
    });
    owners.filter_map(Result::transpose).collect()
}

/// The place that an entry creates, owned by the writing server.
pub(super) fn taken_by(entry: &Entry) -> Option<Place> {
    match entry {
        Entry::Open(row) if row.run.is_none() => Some(Place::Game(row.episode)),
        _ => None,
    }
}
