//! The tables `acts` and `rounds`, and the store as what keeps journals.

use futures::FutureExt;
use futures::future::BoxFuture;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;
use swarmbench_engine::AgentId;

use super::episodes::{hash, head};
use super::{Store, failure};
use crate::ids::EpisodeId;
use crate::journal::record::RawRecord;
use crate::journal::{
    Committed, Entry, EpisodeKey, Held, Journal, JournalError, RoundActs, StoredAct, StoredEpisode,
    StoredRound, Unfinished,
};
use crate::keys::OwnerKey;

impl Store {
    async fn read_acts(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<(u32, RoundActs)>, JournalError> {
        let rows = sqlx::query(
            "SELECT round, agent, waiting_for, record FROM acts
             WHERE episode = ? AND round >= ? AND round < ? ORDER BY round, agent",
        )
        .bind(episode.0)
        .bind(from)
        .bind(to)
        .fetch_all(&self.readers)
        .await
        .map_err(failure)?;
        let mut rounds: Vec<(u32, RoundActs)> = Vec::new();
        for row in &rows {
            let (round, agent) = position(row).map_err(failure)?;
            let act = act(row).map_err(failure)?;
            match rounds.last_mut() {
                Some((last, acts)) if *last == round => acts.push((agent, act)),
                _ => rounds.push((round, vec![(agent, act)])),
            }
        }
        Ok(rounds)
    }

    async fn read_act(
        &self,
        episode: EpisodeKey,
        round: u32,
        agent: AgentId,
    ) -> Result<Option<StoredAct>, JournalError> {
        let row = sqlx::query(
            "SELECT waiting_for, record FROM acts WHERE episode = ? AND round = ? AND agent = ?",
        )
        .bind(episode.0)
        .bind(round)
        .bind(agent.0)
        .fetch_optional(&self.readers)
        .await
        .map_err(failure)?;
        row.map(|row| act(&row)).transpose().map_err(failure)
    }

    async fn read_rounds(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<StoredRound>, JournalError> {
        let rows = sqlx::query(
            "SELECT round, digest, score, head FROM rounds
             WHERE episode = ? AND round >= ? AND round < ? ORDER BY round",
        )
        .bind(episode.0)
        .bind(from)
        .bind(to)
        .fetch_all(&self.readers)
        .await
        .map_err(failure)?;
        let round = |row: &SqliteRow| {
            Ok(StoredRound {
                round: row.try_get("round")?,
                digest: hash(&row.try_get::<Vec<u8>, _>("digest")?)?,
                score: row.try_get("score")?,
                head: head(&row.try_get::<Vec<u8>, _>("head")?)?,
            })
        };
        rows.iter().map(round).collect::<Result<_, _>>().map_err(failure)
    }
}

fn position(row: &SqliteRow) -> Result<(u32, AgentId), sqlx::Error> {
    Ok((row.try_get("round")?, AgentId(row.try_get("agent")?)))
}

fn act(row: &SqliteRow) -> Result<StoredAct, sqlx::Error> {
    let decode = |error: serde_json::Error| sqlx::Error::Decode(error.into());
    let raw = RawRecord::from_stored(row.try_get("record")?).map_err(decode)?;
    let record = raw.read().map_err(decode)?;
    Ok(StoredAct { record, raw, waiting_for: row.try_get("waiting_for")? })
}

impl Journal for Store {
    fn append(&self, entries: Vec<Entry>, committed: Committed) {
        Self::append(self, entries, committed);
    }

    fn recovered(&self, episode: EpisodeKey) {
        self.writer().recovered(episode);
    }

    fn episode(&self, id: EpisodeId) -> BoxFuture<'_, Result<Option<StoredEpisode>, JournalError>> {
        async move { self.find_episode(&id).await }.boxed()
    }

    fn unfinished(&self) -> BoxFuture<'_, Result<Vec<Unfinished>, JournalError>> {
        self.unfinished_episodes().boxed()
    }

    fn holders(&self, episode: EpisodeKey) -> BoxFuture<'_, Result<Vec<Held>, JournalError>> {
        self.read_holders(episode).boxed()
    }

    fn key_id(&self, owner: OwnerKey) -> BoxFuture<'_, Result<Option<String>, JournalError>> {
        self.read_key_id(owner).boxed()
    }

    fn acts(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> BoxFuture<'_, Result<Vec<(u32, RoundActs)>, JournalError>> {
        self.read_acts(episode, from, to).boxed()
    }

    fn act(
        &self,
        episode: EpisodeKey,
        round: u32,
        agent: AgentId,
    ) -> BoxFuture<'_, Result<Option<StoredAct>, JournalError>> {
        self.read_act(episode, round, agent).boxed()
    }

    fn rounds(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> BoxFuture<'_, Result<Vec<StoredRound>, JournalError>> {
        self.read_rounds(episode, from, to).boxed()
    }
}
