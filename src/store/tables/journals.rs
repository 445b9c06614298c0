//! Batched reads of small journals: a query costs more than such a game.

use std::collections::{HashMap, VecDeque};

use crate::ids::{EpisodeId, EpisodeKey};
use crate::store::port::{StoredEpisode, StoredRound};
use crate::store::records::ActReader;
use crate::store::sql::{Builder, FromRow, SqlRow, get};
use crate::store::{Store, StoreError};
use swarmbench_journal::record::RawRecord;

/// Games read by one batch.
pub const GAMES_AT_ONCE: usize = 32;

/// Estimated bytes of a round in a journal, without its acts.
const ROUND_BYTES: u64 = 256;

pub struct StoredJournal {
    pub stored: StoredEpisode,
    pub rounds: Vec<StoredRound>,
    pub acts: ActReader,
    pub end: Option<RawRecord>,
}

impl Store {
    /// Reads a prefix of the given games, [`GAMES_AT_ONCE`] at most: whole journals of ended games up to `bytes_max` bytes in
    /// total, or else the first game alone with its acts unread, to be read part by part.
    pub async fn journals(
        &self,
        ids: &[EpisodeId],
        bytes_max: usize,
    ) -> Result<Vec<StoredJournal>, StoreError> {
        let ids = &ids[..ids.len().min(GAMES_AT_ONCE)];
        let mut found: HashMap<_, _> = self
            .summaries(ids)
            .await?
            .into_iter()
            .map(|stored| (stored.id.clone(), stored))
            .collect();
        let mut left = bytes_max as u64;
        let mut journals = Vec::with_capacity(ids.len());
        for id in ids {
            let missing = || StoreError::Missing(format!("{id} no longer exists").into());
            let stored = found.remove(id).ok_or_else(missing)?;
            let bytes = bytes_of(&stored).filter(|bytes| *bytes <= left);
            if bytes.is_none() && !journals.is_empty() {
                break;
            }
            let (store, key, end) = (self.clone(), stored.episode, stored.rounds + 1);
            let acts = ActReader::joined(store, key, end, stored.act_bytes);
            journals.push(StoredJournal { stored, rounds: Vec::new(), acts, end: None });
            let Some(bytes) = bytes else { return Ok(journals) };
            left -= bytes;
        }
        self.read_whole(&mut journals).await?;
        Ok(journals)
    }

    async fn read_whole(&self, journals: &mut [StoredJournal]) -> Result<(), StoreError> {
        let keys: Vec<_> = journals.iter().map(|journal| journal.stored.episode).collect();
        let place: HashMap<_, _> = keys.iter().zip(0..).map(|(key, place)| (*key, place)).collect();
        let place = |key| place.get(&key).copied().unwrap_or(0_usize);
        let text = "SELECT episode, round, digest, score, head FROM rounds WHERE episode IN ";
        let mut query = about_games(text, &keys);
        query.push(" ORDER BY episode, round");
        let rounds: Vec<(EpisodeKey, StoredRound)> = self.fetch_all(query.build()).await?;
        for (episode, round) in rounds {
            journals[place(episode)].rounds.push(round);
        }
        let text = "SELECT episode, round, string_agg(record, ',' ORDER BY agent)
                     FROM acts WHERE episode IN ";
        let mut query = about_games(text, &keys);
        query.push(" GROUP BY episode, round ORDER BY episode, round");
        let acts: Vec<(EpisodeKey, u32, String)> = self.fetch_all(query.build()).await?;
        let mut of_games = HashMap::<_, VecDeque<_>>::new();
        for (episode, round, joined) in acts {
            of_games.entry(episode).or_default().push_back((round, joined));
        }
        for journal in &mut *journals {
            journal.acts.set_read(of_games.remove(&journal.stored.episode).unwrap_or_default());
        }
        let query = about_games("SELECT key, ending FROM episodes WHERE key IN ", &keys);
        let ends: Vec<(EpisodeKey, Option<RawRecord>)> = self.fetch_all(query.build()).await?;
        for (episode, end) in ends {
            journals[place(episode)].end = end;
        }
        Ok(())
    }
}

/// Estimated size of a journal in memory; `None` for unfinished games and unknown sizes.
fn bytes_of(stored: &StoredEpisode) -> Option<u64> {
    stored.ended_at?;
    let rounds = u64::from(stored.rounds) * ROUND_BYTES;
    Some(stored.act_bytes? + stored.opening.as_str().len() as u64 + rounds)
}

/// Appends a list of games to a query.
fn about_games(query: &str, keys: &[EpisodeKey]) -> Builder<'static> {
    let mut query = Builder::new(query);
    query.push_list(keys.iter().map(|key| key.0));
    query
}

impl FromRow for (EpisodeKey, StoredRound) {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        Ok((get(row, "episode")?, StoredRound::from_row(row)?))
    }
}
