//! The table `episodes`.

use jiff::Timestamp;
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite};

use super::{Store, failure};
use crate::ids::EpisodeId;
use crate::journal::chain::Head;
use crate::journal::record::RawRecord;
use crate::journal::{CompetitionKey, EpisodeKey, JournalError, RunKey, StoredEpisode, Unfinished};
use crate::keys::OwnerKey;

/// What a list of episodes is filtered by.
#[derive(Clone, Debug, Default)]
pub struct Filter {
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    pub status: Option<String>,
    /// A task's name.
    pub task: Option<String>,
    /// A model's name.
    pub model: Option<String>,
    /// A run.
    pub run: Option<RunKey>,
    /// Which of them the caller may read.
    pub readable: Readable,
}

/// Which episodes somebody may read.
#[derive(Clone, Debug, Default)]
pub enum Readable {
    /// All.
    All,
    /// Those that anyone may read now.
    #[default]
    Public,
    /// Those that anyone may read now, and this one.
    And(EpisodeId),
    /// Those that anyone may read now, those that were created with this key, and those of which seats
    /// may be claimed.
    AndOf(OwnerKey),
    /// Those that anyone may read now, and those of this run.
    AndOfRun(RunKey),
    /// Those of this run alone.
    OnlyOfRun(RunKey),
    /// This one alone.
    Only(EpisodeId),
    /// None.
    Nothing,
}

/// Which part of an episode is read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Detail {
    /// What is shown of it.
    Summary,
    /// Also the end record, and when the last act came, for which its acts have to be looked through.
    All,
}

/// The end record. A large one is returned without its open acts, and its text is not read for that: they are among
/// the acts of the episode.
const END: &str = "
    CASE WHEN octet_length(e.ending) > 65536
         THEN json_object('kind', 'end', 'status', e.status, 'reason', e.reason,
                          'rounds', coalesce(r.round + 1, 0), 'score', coalesce(r.score, 0.0),
                          'open_acts', json_array())
         ELSE e.ending END AS ending, ";

/// Asks for episodes; the caller adds a condition.
fn select(detail: Detail) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new(
        "SELECT e.key, e.id, e.owner, e.run, e.revealed, e.opening, e.seating, e.status, e.reason, e.created_at, e.ended_at,
                CASE WHEN e.voided_at IS NULL THEN NULL ELSE coalesce(e.void_reason, '') END AS void_reason,
                CASE WHEN e.ended_at IS NULL THEN coalesce(r.head, e.head) ELSE e.head END AS head,
                coalesce(r.round + 1, 0) AS rounds, coalesce(r.score, 0.0) AS score, ",
    );
    match detail {
        Detail::Summary => query.push("e.created_at AS newest_at, NULL AS ending, NULL"),
        Detail::All => query.push(NEWEST_AT).push(" AS newest_at, ").push(END).push(LAST_ACT_AT),
    };
    query.push(
        " AS last_act_at FROM episodes e
          LEFT JOIN rounds r ON r.episode = e.key
              AND r.round = (SELECT max(round) FROM rounds WHERE episode = e.key)
          WHERE ",
    );
    query
}

/// Where it waits and has, or had, open seats: every holder of a key may claim one.
const CLAIMABLE: &str = "(e.status = 'waiting' AND e.visibility <> 'sealed'
                          AND json_extract(e.opening, '$.config.open_seats') IS NOT NULL)";

/// When the newest record came.
const NEWEST_AT: &str = "
    max(e.created_at, coalesce(e.started_at, 0), coalesce(r.at, 0), coalesce(e.ended_at, 0),
        coalesce((SELECT max(a.at) FROM acts a
                  WHERE a.episode = e.key AND a.round >= coalesce(r.round, 0)), 0))";

/// The last act of a player, or else the manual start: a clock that runs out is no act.
const LAST_ACT_AT: &str = "
    coalesce((SELECT a.at FROM acts a
              WHERE a.episode = e.key AND json_extract(a.record, '$.source') = 'player'
              ORDER BY a.round DESC, a.at DESC LIMIT 1),
             e.started_at)";

impl Store {
    /// Finds an episode by its public id.
    ///
    /// # Errors
    /// Where the database cannot be read; so for all functions here.
    pub async fn find_episode(
        &self,
        id: &EpisodeId,
    ) -> Result<Option<StoredEpisode>, JournalError> {
        self.find(id, Detail::All).await
    }

    /// What is shown of an episode: all but its end record and when its last act came.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn find_summary(
        &self,
        id: &EpisodeId,
    ) -> Result<Option<StoredEpisode>, JournalError> {
        self.find(id, Detail::Summary).await
    }

    async fn find(
        &self,
        id: &EpisodeId,
        detail: Detail,
    ) -> Result<Option<StoredEpisode>, JournalError> {
        let mut query = select(detail);
        query.push("e.id = ").push_bind(id.as_str());
        let row = query.build().fetch_optional(&mut *self.read().await?).await.map_err(failure)?;
        row.map(|row| episode(&row)).transpose()
    }

    /// Lists episodes that may be read, newest first, from the one after `before` on.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn list_episodes(
        &self,
        filter: &Filter,
        before: Option<EpisodeKey>,
        limit: u32,
    ) -> Result<Vec<StoredEpisode>, JournalError> {
        let mut query = select(Detail::Summary);
        query.push("e.key < ").push_bind(before.map_or(i64::MAX, |key| key.0));
        for (column, value) in
            [("status", &filter.status), ("task", &filter.task), ("model", &filter.model)]
        {
            if let Some(value) = value {
                query.push(" AND e.").push(column).push(" = ").push_bind(value);
            }
        }
        if let Some(run) = filter.run {
            query.push(" AND e.run = ").push_bind(run.0);
        }
        let public = "(e.visibility = 'public' OR (e.ended_at IS NOT NULL
                        AND (e.visibility <> 'sealed' OR e.revealed)))";
        match &filter.readable {
            Readable::All => &mut query,
            Readable::Public => query.push(" AND ").push(public),
            Readable::And(id) => {
                query.push(" AND (").push(public).push(" OR e.id = ");
                query.push_bind(id.as_str()).push(")")
            }
            Readable::AndOf(owner) => {
                query
                    .push(" AND (")
                    .push(public)
                    .push(" OR (e.visibility <> 'sealed' AND e.owner = ")
                    .push_bind(owner.0)
                    .push(") OR ")
                    .push(CLAIMABLE);
                query.push(")")
            }
            Readable::AndOfRun(run) => {
                query
                    .push(" AND (")
                    .push(public)
                    .push(" OR (e.visibility <> 'sealed' AND e.run = ");
                query.push_bind(run.0).push("))")
            }
            Readable::OnlyOfRun(run) => {
                query.push(" AND (e.visibility <> 'sealed' OR e.revealed) AND e.run = ");
                query.push_bind(run.0)
            }
            Readable::Only(id) => query.push(" AND e.id = ").push_bind(id.as_str()),
            Readable::Nothing => query.push(" AND 0"),
        };
        query.push(" ORDER BY e.key DESC LIMIT ").push_bind(limit);
        let rows = query.build().fetch_all(&mut *self.read().await?).await.map_err(failure)?;
        rows.iter().map(episode).collect()
    }

    /// All episodes that have not ended, those with a round clock first.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn unfinished_episodes(&self) -> Result<Vec<Unfinished>, JournalError> {
        let rows = sqlx::query(
            "SELECT key, id, owner, clocked, iif(clocked, json_extract(opening, '$.config'), NULL),
                    iif(clocked, (SELECT max(round) + 1 FROM rounds WHERE episode = key), NULL)
             FROM episodes WHERE status IN ('waiting', 'running') ORDER BY clocked DESC, key",
        )
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let read = |row: &SqliteRow| {
            Ok(Unfinished {
                episode: EpisodeKey(row.try_get(0)?),
                id: EpisodeId::from_text(row.try_get(1)?),
                owner: row.try_get::<Option<i64>, _>(2)?.map(OwnerKey),
                clocked: row.try_get(3)?,
                // Settings that cannot be read are reported by the recovery of the episode.
                played: (row.try_get::<Option<String>, _>(4)?)
                    .and_then(|config| serde_json::from_str(&config).ok())
                    .zip(Some(row.try_get::<Option<u32>, _>(5)?.unwrap_or(0))),
            })
        };
        rows.iter().map(read).collect::<Result<_, _>>().map_err(failure)
    }

    /// How many bytes the acts of all episodes of each key take.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn bytes_by_owner(&self) -> Result<Vec<(OwnerKey, u64)>, JournalError> {
        let rows = sqlx::query(
            "SELECT owner, sum(bytes) FROM (
                 SELECT owner, bytes FROM episodes WHERE owner IS NOT NULL AND bytes IS NOT NULL
                 UNION ALL
                 SELECT e.owner, octet_length(a.record) FROM episodes e JOIN acts a ON a.episode = e.key
                 WHERE e.status IN ('waiting', 'running') AND e.owner IS NOT NULL)
             GROUP BY owner",
        )
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let read = |row: &SqliteRow| {
            let bytes: i64 = row.try_get(1)?;
            Ok((OwnerKey(row.try_get(0)?), u64::try_from(bytes).unwrap_or(0)))
        };
        rows.iter().map(read).collect::<Result<_, _>>().map_err(failure)
    }

    /// The episodes that have not ended, each with its key and its competition, if any.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn accounts(
        &self,
    ) -> Result<Vec<(EpisodeKey, Option<OwnerKey>, Option<CompetitionKey>)>, JournalError> {
        let rows = sqlx::query(
            "SELECT e.key, e.owner, n.competition
             FROM episodes e LEFT JOIN runs r ON r.key = e.run LEFT JOIN entries n ON n.key = r.entry
             WHERE e.status IN ('waiting', 'running')",
        )
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let read = |row: &SqliteRow| {
            let owner = row.try_get::<Option<i64>, _>(1)?.map(OwnerKey);
            let competition = row.try_get::<Option<i64>, _>(2)?.map(CompetitionKey);
            Ok((EpisodeKey(row.try_get(0)?), owner, competition))
        };
        rows.iter().map(read).collect::<Result<_, _>>().map_err(failure)
    }

    /// How many bytes the acts of all episodes of each competition take that is not open to all yet.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn bytes_by_competition(&self) -> Result<Vec<(CompetitionKey, u64)>, JournalError> {
        let rows = sqlx::query(
            "SELECT competition, sum(bytes) FROM (
                 SELECT n.competition, coalesce(e.bytes, (
                            SELECT sum(octet_length(a.record)) FROM acts a WHERE a.episode = e.key)) AS bytes
                 FROM competitions c JOIN entries n ON n.competition = c.key
                 JOIN runs r ON r.entry = n.key JOIN episodes e ON e.run = r.key
                 WHERE c.revealed_at IS NULL)
             GROUP BY competition",
        )
        .fetch_all(&mut *self.read().await?)
        .await
        .map_err(failure)?;
        let read = |row: &SqliteRow| {
            let bytes = row.try_get::<Option<i64>, _>(1)?.unwrap_or(0);
            Ok((CompetitionKey(row.try_get(0)?), u64::try_from(bytes).unwrap_or(0)))
        };
        rows.iter().map(read).collect::<Result<_, _>>().map_err(failure)
    }

    /// The number of the newest episode, 0 where there is none.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn last_key(&self) -> Result<i64, JournalError> {
        sqlx::query("SELECT coalesce(max(key), 0) FROM episodes")
            .fetch_one(&mut *self.read().await?)
            .await
            .and_then(|row| row.try_get(0))
            .map_err(failure)
    }

    /// The episode that was created with an idempotency key, and the hash of the body sent then.
    ///
    /// # Errors
    /// Where the database cannot be read.
    pub async fn created_with(
        &self,
        key: &str,
    ) -> Result<Option<(EpisodeId, Vec<u8>)>, JournalError> {
        let row =
            sqlx::query("SELECT id, idempotency_body FROM episodes WHERE idempotency_key = ?")
                .bind(key)
                .fetch_optional(&mut *self.read().await?)
                .await
                .map_err(failure)?;
        let read = |row: SqliteRow| {
            Ok((EpisodeId::from_text(row.try_get(0)?), row.try_get::<Vec<u8>, _>(1)?))
        };
        row.map(read).transpose().map_err(failure)
    }
}

fn episode(row: &SqliteRow) -> Result<StoredEpisode, JournalError> {
    let read = || -> Result<StoredEpisode, sqlx::Error> {
        let raw = |text: String| {
            RawRecord::from_stored(text).map_err(|error| sqlx::Error::Decode(error.into()))
        };
        Ok(StoredEpisode {
            episode: EpisodeKey(row.try_get("key")?),
            id: EpisodeId::from_text(row.try_get("id")?),
            owner: row.try_get::<Option<i64>, _>("owner")?.map(OwnerKey),
            run: row.try_get::<Option<i64>, _>("run")?.map(RunKey),
            revealed: row.try_get("revealed")?,
            opening: raw(row.try_get("opening")?)?,
            seating: row.try_get::<Option<String>, _>("seating")?.map(raw).transpose()?,
            status: row.try_get("status")?,
            reason: row.try_get("reason")?,
            end: row.try_get::<Option<String>, _>("ending")?.map(raw).transpose()?,
            head: head(&row.try_get::<Vec<u8>, _>("head")?)?,
            rounds: row.try_get("rounds")?,
            score: row.try_get("score")?,
            created_at: time(row.try_get("created_at")?)?,
            newest_at: time(row.try_get("newest_at")?)?,
            last_act_at: row.try_get::<Option<i64>, _>("last_act_at")?.map(time).transpose()?,
            ended_at: row.try_get::<Option<i64>, _>("ended_at")?.map(time).transpose()?,
            void_reason: row.try_get("void_reason")?,
        })
    };
    read().map_err(failure)
}

/// A stored hash of 32 bytes.
pub(super) fn hash(bytes: &[u8]) -> Result<[u8; 32], sqlx::Error> {
    bytes.try_into().map_err(|_| sqlx::Error::Decode("a hash has 32 bytes".into()))
}

/// A stored head of a chain.
pub(super) fn head(bytes: &[u8]) -> Result<Head, sqlx::Error> {
    hash(bytes).map(Head)
}

/// A stored time.
pub(super) fn time(millis: i64) -> Result<Timestamp, sqlx::Error> {
    Timestamp::from_millisecond(millis).map_err(|error| sqlx::Error::Decode(error.into()))
}
