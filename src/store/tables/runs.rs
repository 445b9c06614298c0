//! The table `runs`.

use jiff::Timestamp;

use crate::ids::{CompetitionKey, EntryKey, RunKey, TokenHash};
use crate::keys::OwnerKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::RunRow;
use crate::store::episodes::Readable;
use crate::store::sql::{Builder, Connection, FromRow, SqlRow, get, query};

#[derive(Clone, Debug)]
pub struct StoredRun {
    pub run: RunKey,
    pub id: String,
    /// Key that created the run.
    pub owner: Option<OwnerKey>,
    /// Definition as JSON.
    pub definition: String,
    pub digest: String,
    /// `running`, or the name of the ending.
    pub status: String,
    /// Entry and attempt number, from 1, of an attempt in a competition.
    pub attempt: Option<(EntryKey, u32)>,
    /// Voided attempt that this spare attempt replaces.
    pub replays: Option<u32>,
    /// Current end of the window. Runs of earlier versions have it only if it was extended.
    pub closes_at: Option<Timestamp>,
    /// Competition of an attempt.
    pub competition: Option<CompetitionKey>,
    /// Reason of the voiding of the attempt.
    pub void_reason: Option<String>,
    /// Whether the run was sealed and is now public.
    pub revealed: bool,
    pub created_at: Timestamp,
    pub ended_at: Option<Timestamp>,
}

/// Filter of a list of runs.
#[derive(Clone, Debug, Default)]
pub struct RunFilter {
    pub status: Option<String>,
    pub model: Option<String>,
    pub suite: Option<String>,
    /// Runs that the caller may know of.
    pub readable: Readable,
}

const SELECT: &str = "
    SELECT r.key, r.id, r.owner, r.definition, r.digest, r.status, r.entry, r.attempt, r.replays,
           r.closes_at, r.voided_at, r.void_reason, r.created_at, r.ended_at,
           r.competition, r.revealed
    FROM runs r WHERE ";

/// Public runs, in the exact words of the partial indexes.
const PUBLIC: &str = "(r.visibility = 'public' OR (r.ended_at IS NOT NULL
                        AND (r.visibility <> 'sealed' OR r.revealed)))";

impl RunFilter {
    /// Column among model, suite and status that chooses the index: the one with the fewest runs, as far as is known.
    const fn leads(&self) -> Option<&'static str> {
        match self {
            Self { model: Some(_), .. } => Some("model"),
            Self { suite: Some(_), .. } => Some("suite"),
            Self { status: Some(_), .. } => Some("status"),
            Self { .. } => None,
        }
    }

    fn push<'q>(&'q self, query: &mut Builder<'q>, before: Option<RunKey>, leads: Option<&str>) {
        query.push("r.key < ").push_bind(before.map_or(i64::MAX, |run| run.0));
        for (column, value) in
            [("status", &self.status), ("model", &self.model), ("suite", &self.suite)]
        {
            if let Some(value) = value {
                query.push(" AND r.").push(column);
                // SQLite uses no index for a computed text.
                query.push(if leads == Some(column) { " = " } else { " || '' = " });
                query.push_bind(value);
            }
        }
    }

    /// Adds public runs, and those with the indexed condition `own`. Each part has its own subquery, as in a list of episodes.
    fn push_parts<'q>(
        &'q self,
        query: &mut Builder<'q>,
        (before, limit): (Option<RunKey>, u32),
        own: Option<(&str, i64)>,
    ) {
        let hint = match self.leads() {
            None => " INDEXED BY runs_public",
            Some("model") => " INDEXED BY runs_public_by_model",
            Some("status") => " INDEXED BY runs_public_by_status",
            // Runs of competitions share no suite name with others, so the index does not pass over sealed ones.
            Some(_) => " INDEXED BY runs_by_suite",
        };
        query
            .push("r.key IN (SELECT key FROM (SELECT r.key FROM runs r")
            .push(hint)
            .push(" WHERE ");
        self.push(query, before, self.leads());
        query.push(" AND ").push(PUBLIC);
        query.push(" ORDER BY r.key DESC LIMIT ").push_bind(limit).push(") AS part");
        if let Some((condition, value)) = own {
            query.push(" UNION SELECT key FROM (SELECT r.key FROM runs r WHERE ");
            self.push(query, before, None);
            query.push(" AND ").push(condition).push_bind(value);
            query.push(" ORDER BY r.key DESC LIMIT ").push_bind(limit).push(") AS part");
        }
        query.push(")");
    }
}

impl Store {
    pub async fn find_run(&self, id: &str) -> Result<Option<StoredRun>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("r.id = ").push_bind(id);
        self.fetch_optional(query.build()).await
    }

    pub async fn run(&self, run: RunKey) -> Result<Option<StoredRun>, StoreError> {
        let mut query = Builder::new(SELECT);
        query.push("r.key = ").push_bind(run.0);
        self.fetch_optional(query.build()).await
    }

    /// Lists readable runs, newest first, starting after `before`.
    pub async fn list_runs(
        &self,
        filter: &RunFilter,
        before: Option<RunKey>,
        limit: u32,
    ) -> Result<Vec<StoredRun>, StoreError> {
        let mut query = Builder::new(SELECT);
        let place = (before, limit);
        match &filter.readable {
            Readable::Public | Readable::And(_) => filter.push_parts(&mut query, place, None),
            Readable::AndOf { owner, .. } => {
                filter.push_parts(&mut query, place, Some(("r.owner = ", owner.0)));
            }
            Readable::AndOfRun(run) => {
                filter.push_parts(&mut query, place, Some(("r.key = ", run.0)));
            }
            Readable::All => filter.push(&mut query, before, filter.leads()),
            Readable::OnlyOfRun(run) => {
                filter.push(&mut query, before, None);
                query.push(" AND r.key = ").push_bind(run.0);
            }
            Readable::Only(_) | Readable::Nothing => {
                query.push("FALSE");
            }
        }
        query.push(" ORDER BY r.key DESC LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    /// Runs of a suite that a key has started since `from`, or that are still running, in order, each with whether it is
    /// running.
    pub async fn runs_of_suite(
        &self,
        owner: OwnerKey,
        suite: &str,
        from: Timestamp,
    ) -> Result<Vec<(RunKey, bool)>, StoreError> {
        let query = query(
            "SELECT key, status = 'running' FROM runs
             WHERE owner = $1 AND suite || '' = $2 AND (created_at >= $3 OR status = 'running') ORDER BY key",
        );
        let query = query.bind(owner.0).bind(suite).bind(from.as_millisecond());
        self.fetch_all(query).await
    }

    /// Running runs, and ended ones with an unfinished game, in order.
    pub async fn unfinished_runs(&self) -> Result<Vec<RunKey>, StoreError> {
        let query = query(
            "SELECT key FROM runs WHERE status = 'running'
             UNION SELECT run FROM episodes WHERE run IS NOT NULL AND ended_at IS NULL AND voided_at IS NULL
             UNION SELECT run FROM episodes INDEXED BY episodes_voided
                   WHERE run IS NOT NULL AND ended_at IS NULL AND voided_at IS NOT NULL
             ORDER BY 1",
        );
        self.fetch_all(query).await
    }

    /// Number of the newest run; 0 without runs.
    pub async fn last_run_key(&self) -> Result<i64, StoreError> {
        self.fetch_one(query("SELECT coalesce(max(key), 0) FROM runs")).await
    }

    /// Run that was created with an idempotency key, and the hash of the request's body.
    pub async fn run_created_with(
        &self,
        key: &str,
    ) -> Result<Option<(StoredRun, Vec<u8>)>, StoreError> {
        let query = query("SELECT id, idempotency_body FROM runs WHERE idempotency_key = $1");
        let row: Option<(String, Vec<u8>)> = self.fetch_optional(query.bind(key)).await?;
        let Some((id, body)) = row else { return Ok(None) };
        Ok(self.find_run(&id).await?.map(|run| (run, body)))
    }
}

impl FromRow for StoredRun {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let entry: Option<EntryKey> = get(row, "entry")?;
        Ok(Self {
            run: get(row, "key")?,
            id: get(row, "id")?,
            owner: get(row, "owner")?,
            definition: get(row, "definition")?,
            digest: get(row, "digest")?,
            status: get(row, "status")?,
            attempt: entry.zip(get(row, "attempt")?),
            replays: get(row, "replays")?,
            closes_at: get(row, "closes_at")?,
            competition: get(row, "competition")?,
            void_reason: void_reason(row)?,
            revealed: get(row, "revealed")?,
            created_at: get(row, "created_at")?,
            ended_at: get(row, "ended_at")?,
        })
    }
}

/// Reason of a voiding.
pub(in crate::store) fn void_reason(row: &SqlRow) -> Result<Option<String>, sqlx::Error> {
    let voided: Option<Timestamp> = get(row, "voided_at")?;
    let reason: Option<String> = get(row, "void_reason")?;
    Ok(voided.map(|_| reason.unwrap_or_default()))
}

pub(in crate::store) async fn open(
    connection: &mut Connection,
    row: &RunRow,
) -> Result<(), sqlx::Error> {
    query(
        "INSERT INTO runs (key, id, owner, suite, digest, definition, model, visibility, status, entry, competition,
                           attempt, replays, created_at, idempotency_key, idempotency_body, closes_at)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8, 'running', $9, (SELECT competition FROM entries WHERE key = $9), $10, $11, $12, $13, $14, $15)",
    )
    .bind(row.run.0)
    .bind(&row.id)
    .bind(row.owner.map(|owner| owner.0))
    .bind(&row.suite)
    .bind(&row.digest)
    .bind(&row.definition)
    .bind(&row.model)
    .bind(row.visibility)
    .bind(row.attempt.map(|(entry, _)| entry.0))
    .bind(row.attempt.map(|(_, number)| number))
    .bind(row.replays)
    .bind(row.at.as_millisecond())
    .bind(row.idempotency.as_ref().map(|(key, _)| key))
    .bind(row.idempotency.as_ref().map(|(_, body)| &body[..]))
    .bind(row.closes_at.map(Timestamp::as_millisecond))
    .execute(connection)
    .await?;
    Ok(())
}

pub(in crate::store) async fn end(
    connection: &mut Connection,
    run: RunKey,
    status: &str,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    query("UPDATE runs SET status = $1, ended_at = $2 WHERE key = $3 AND ended_at IS NULL")
        .bind(status)
        .bind(at.as_millisecond())
        .bind(run.0)
        .execute(connection)
        .await?;
    Ok(())
}

/// Continues a finished run; others stay as they are.
pub(in crate::store) async fn reopen(
    connection: &mut Connection,
    run: RunKey,
) -> Result<(), sqlx::Error> {
    query("UPDATE runs SET status = 'running', ended_at = NULL WHERE key = $1 AND status = 'finished'")
        .bind(run.0)
        .execute(connection)
        .await?;
    Ok(())
}

/// Extends the window of the attempts with a number; games that are already open keep their ends.
pub(in crate::store) async fn extend(
    connection: &mut Connection,
    competition: CompetitionKey,
    number: u32,
    closes_at: Timestamp,
) -> Result<(), sqlx::Error> {
    query("UPDATE runs SET closes_at = $1 WHERE attempt = $2 AND competition = $3")
        .bind(closes_at.as_millisecond())
        .bind(number)
        .bind(competition.0)
        .execute(connection)
        .await?;
    Ok(())
}

/// Voids a run; a repeat keeps the first reason.
pub(in crate::store) async fn void(
    connection: &mut Connection,
    run: RunKey,
    reason: &str,
    at: Timestamp,
) -> Result<(), sqlx::Error> {
    query("UPDATE runs SET voided_at = $1, void_reason = $2 WHERE key = $3 AND voided_at IS NULL")
        .bind(at.as_millisecond())
        .bind(reason)
        .bind(run.0)
        .execute(connection)
        .await?;
    Ok(())
}

pub(in crate::store) async fn replace_token(
    connection: &mut Connection,
    run: RunKey,
    holder: Option<u32>,
    hash: TokenHash,
) -> Result<(), sqlx::Error> {
    query("DELETE FROM tokens WHERE run = $1 AND coalesce(holder, 0) = $2")
        .bind(run.0)
        .bind(holder.unwrap_or(0))
        .execute(&mut *connection)
        .await?;
    query("INSERT INTO tokens (hash, run, holder) VALUES ($1, $2, $3)")
        .bind(&hash.0[..])
        .bind(run.0)
        .bind(holder)
        .execute(connection)
        .await?;
    Ok(())
}
