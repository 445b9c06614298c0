//! The tables `acts` and `rounds`, and the store's implementation of [`EpisodeStore`].

use std::collections::{BTreeSet, VecDeque};

use futures::FutureExt;
use jiff::Timestamp;
use swarmbench_engine::AgentId;

use crate::ids::{CompetitionKey, EpisodeId, EpisodeKey, Place, RunKey};
use crate::keys::OwnerKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::entries::{Entry, Held};
use crate::store::port::{
    Committed, EpisodeStore, Reply, RoundActs, StoredAct, StoredEpisode, StoredRound, Unfinished,
};
use crate::store::sql::{Builder, FromRow, LISTED_AT_ONCE, SqlRow, from_row, get, query};
use swarmbench_journal::record::{ActRecord, RawRecord};

/// Bytes of records parsed before the task yields its thread.
const PIECE_BYTES: u64 = 128 * 1024;

/// Acts without texts parsed before the task yields its thread.
const ACTS_OF_A_PIECE: usize = 512;

/// Acts considered for one part.
const ACTS_OF_A_PART_MAX: u32 = 4096;

/// Round and seat of an act.
pub type ActPlace = (u32, AgentId);

/// Consecutive acts of an episode.
#[derive(Debug, Default)]
pub struct ActsPart {
    /// Round and record of each act, or the joined records of several acts of a round.
    pub acts: Vec<(u32, String)>,
    /// First act of the next part, if there is one.
    pub next: Option<ActPlace>,
}

/// Reads the acts of an episode in order, with one part of them in memory.
pub struct ActReader {
    store: Store,
    episode: EpisodeKey,
    end: u32,
    read: VecDeque<(u32, String)>,
    /// First unread act, if there is one.
    unread: Option<ActPlace>,
    /// Whether the records of a round are joined by commas.
    is_joined: bool,
    /// Bytes of all acts of the episode, if known.
    bytes: Option<u64>,
}

impl ActReader {
    /// A reader of the rounds before `end`, act by act.
    pub fn new(store: Store, episode: EpisodeKey, end: u32) -> Self {
        let unread = Some((0, AgentId(0)));
        Self { store, episode, end, read: VecDeque::new(), unread, is_joined: false, bytes: None }
    }

    /// A reader that joins the records of a round by commas where they fit into a part: a row of the database costs more than
    /// the act in it. `bytes` is the size of all acts, if known.
    pub fn joined(store: Store, episode: EpisodeKey, end: u32, bytes: Option<u64>) -> Self {
        Self { is_joined: true, bytes, ..Self::new(store, episode, end) }
    }

    /// Supplies all acts of the episode, joined by round.
    pub(in crate::store) fn set_read(&mut self, acts: VecDeque<(u32, String)>) {
        (self.read, self.unread) = (acts, None);
    }

    /// The next record, or joined records, if of a round up to `round`. Reads about `bytes_max` bytes at once.
    pub async fn next_of(
        &mut self,
        round: u32,
        bytes_max: usize,
    ) -> Result<Option<String>, StoreError> {
        if let Some(from) = self.unread.filter(|_| self.read.is_empty()) {
            let (store, episode, end) = (&self.store, self.episode, self.end);
            let fits = self.bytes.is_some_and(|bytes| bytes <= bytes_max as u64);
            let part = if self.is_joined && fits {
                ActsPart { acts: store.joined_rounds(episode, from, end - 1).await?, next: None }
            } else if self.is_joined {
                store.rounds_part(episode, from, end, bytes_max).await?
            } else {
                store.acts_part(episode, from, end, bytes_max).await?
            };
            self.read = part.acts.into();
            self.unread = part.next;
        }
        Ok(self.read.pop_front_if(|(of, _)| *of <= round).map(|(_, record)| record))
    }
}

impl Store {
    /// Acts from `from` on in rounds before `end`: as many as fit into `bytes_max` bytes, but at least one.
    pub async fn acts_part(
        &self,
        episode: EpisodeKey,
        from: ActPlace,
        end: u32,
        bytes_max: usize,
    ) -> Result<ActsPart, StoreError> {
        let (last, next) = self.part_end(episode, from, end, bytes_max).await?;
        let Some(last) = last else { return Ok(ActsPart::default()) };
        let query = query(
            "SELECT round, record FROM acts
             WHERE episode = $1 AND (round, agent) >= ($2, $3) AND (round, agent) <= ($4, $5)
             ORDER BY round, agent",
        );
        let query = query.bind(episode.0).bind(from.0).bind(from.1.0).bind(last.0).bind(last.1.0);
        Ok(ActsPart { acts: self.fetch_all(query).await?, next })
    }

    /// [`Store::acts_part`] in whole rounds with joined records; falls back to single acts if the next round does not fit.
    async fn rounds_part(
        &self,
        episode: EpisodeKey,
        from: ActPlace,
        end: u32,
        bytes_max: usize,
    ) -> Result<ActsPart, StoreError> {
        let query = query(
            "SELECT round, count(*), CAST(sum(octet_length(record)) AS BIGINT) FROM (
                 SELECT round, record FROM acts WHERE episode = $1 AND (round, agent) >= ($2, $3) AND round < $4
                 ORDER BY round, agent LIMIT $5) AS part
             GROUP BY round ORDER BY round",
        );
        let query = query.bind(episode.0).bind(from.0).bind(from.1.0).bind(end);
        let rounds: Vec<(u32, u32, u64)> = self.fetch_all(query.bind(ACTS_OF_A_PART_MAX)).await?;
        let acts: u32 = rounds.iter().map(|(_, count, _)| count).sum();
        let is_cut = acts == ACTS_OF_A_PART_MAX;
        // The last round may have more acts.
        let whole = rounds.len() - usize::from(is_cut);
        let mut sum = 0;
        let fitting = rounds[..whole].iter().take_while(|(_, _, bytes)| {
            sum += bytes;
            sum <= bytes_max as u64
        });
        let fitting = fitting.count();
        let Some(&(last, ..)) = rounds[..fitting].last() else {
            return self.acts_part(episode, from, end, bytes_max).await;
        };
        let next = (is_cut || fitting < rounds.len()).then_some((last + 1, AgentId(0)));
        Ok(ActsPart { acts: self.joined_rounds(episode, from, last).await?, next })
    }

    /// Acts from `from` up to the round `last`, with the records of each round joined by commas.
    async fn joined_rounds(
        &self,
        episode: EpisodeKey,
        from: ActPlace,
        last: u32,
    ) -> Result<Vec<(u32, String)>, StoreError> {
        let query = query(
            "SELECT round, string_agg(record, ',' ORDER BY agent) FROM acts
             WHERE episode = $1 AND (round, agent) >= ($2, $3) AND round <= $4 GROUP BY round ORDER BY round",
        );
        self.fetch_all(query.bind(episode.0).bind(from.0).bind(from.1.0).bind(last)).await
    }

    /// The last act of a part and the first of the next one, found without reading the records.
    async fn part_end(
        &self,
        episode: EpisodeKey,
        from: ActPlace,
        end: u32,
        bytes_max: usize,
    ) -> Result<(Option<ActPlace>, Option<ActPlace>), StoreError> {
        let query = query(
            "SELECT round, agent, octet_length(record) FROM acts
             WHERE episode = $1 AND (round, agent) >= ($2, $3) AND round < $4
             ORDER BY round, agent LIMIT $5",
        );
        let query = query.bind(episode.0).bind(from.0).bind(from.1.0).bind(end);
        let acts: Vec<(u32, AgentId, u64)> =
            self.fetch_all(query.bind(ACTS_OF_A_PART_MAX + 1)).await?;
        let (mut last, mut sum) = (None, 0);
        for (number, (round, agent, bytes)) in (0..).zip(acts) {
            let place = (round, agent);
            sum += bytes;
            let fits = sum <= bytes_max as u64 && number < ACTS_OF_A_PART_MAX;
            if last.is_some() && !fits {
                return Ok((last, Some(place)));
            }
            last = Some(place);
        }
        Ok((last, None))
    }

    /// Size in bytes of an episode's end record, and the record itself if it has at most `bytes_max` bytes; `None` before the
    /// end.
    pub async fn end_record(
        &self,
        episode: EpisodeKey,
        bytes_max: usize,
    ) -> Result<Option<(usize, Option<RawRecord>)>, StoreError> {
        let query = query(
            "SELECT octet_length(ending), CASE WHEN octet_length(ending) <= $1 THEN ending END
             FROM episodes WHERE key = $2",
        );
        let query = query.bind(i64::try_from(bytes_max).unwrap_or(i64::MAX)).bind(episode.0);
        let (bytes, record): (Option<u64>, _) = self.fetch_one(query).await?;
        Ok(bytes.map(|bytes| (usize::try_from(bytes).unwrap_or(usize::MAX), record)))
    }

    /// The resolved rounds `from..to` without acts.
    pub async fn resolved(
        &self,
        episode: EpisodeKey,
        from: u32,
        to: u32,
    ) -> Result<Vec<StoredRound>, StoreError> {
        let query = query(
            "SELECT round, digest, score, head FROM rounds
             WHERE episode = $1 AND round >= $2 AND round < $3 ORDER BY round",
        );
        self.fetch_all(query.bind(episode.0).bind(from).bind(to)).await
    }
}

impl Store {
    /// A seat's complete act in a round, with its time.
    pub async fn timed_act(
        &self,
        episode: EpisodeKey,
        round: u32,
        agent: AgentId,
    ) -> Result<Option<TimedAct>, StoreError> {
        let query =
            query("SELECT record, at FROM acts WHERE episode = $1 AND round = $2 AND agent = $3");
        self.fetch_optional(query.bind(episode.0).bind(round).bind(agent.0)).await
    }

    /// Scores after given numbers of rounds (each at least 1), in ascending order of rounds.
    pub async fn scores_after(
        &self,
        episode: EpisodeKey,
        rounds: &[u32],
    ) -> Result<Vec<f64>, StoreError> {
        let last: BTreeSet<u32> = rounds.iter().map(|rounds| rounds - 1).collect();
        let last: Vec<u32> = last.into_iter().collect();
        let mut scores = Vec::with_capacity(last.len());
        for some in last.chunks(LISTED_AT_ONCE) {
            let mut query = Builder::new("SELECT score FROM rounds WHERE episode = ");
            query.push_bind(episode.0).push(" AND round IN ");
            query.push_list(some.iter().copied());
            query.push(" ORDER BY round");
            scores.extend(self.fetch_all::<f64>(query.build()).await?);
        }
        Ok(scores)
    }
}

#[derive(Clone, Debug)]
pub struct TimedAct {
    pub record: ActRecord,
    pub at: Timestamp,
}

from_row! {
    TimedAct { record, at }
    StoredRound { round, digest, score, head }
}

impl FromRow for (AgentId, StoredAct) {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let record = get(row, "record")?;
        let act =
            StoredAct { record, bytes: get(row, "bytes")?, waiting_for: get(row, "waiting_for")? };
        Ok((get(row, "agent")?, act))
    }
}

/// Parses a line "agent `waiting_for` bytes record", where `bytes` is the size of the complete record. The texts of models are
/// dropped from the record.
fn act_of_line(line: &str) -> Option<(AgentId, StoredAct)> {
    let mut parts = line.splitn(4, ' ');
    let mut number = || parts.next()?.parse::<u64>().ok();
    let (agent, waiting_for, bytes) = (number()?, number()?, number()?);
    let record = serde_json::from_str::<ActRecord>(parts.next()?).ok()?.without_texts();
    let waiting_for = waiting_for.try_into().ok()?;
    Some((AgentId(agent.try_into().ok()?), StoredAct { record, bytes, waiting_for }))
}

impl EpisodeStore for Store {
    fn append(&self, entries: Vec<Entry>, committed: Committed) {
        Self::append(self, entries, committed);
    }

    fn keep(&self, entries: Vec<Entry>) -> Reply<'_, ()> {
        Self::keep(self, entries)
    }

    fn recovered(&self, episode: EpisodeKey) {
        self.writer().recovered(episode);
    }

    fn has(&self, place: Place) -> bool {
        self.cluster().is_none_or(|cluster| cluster.places().has(place))
    }

    fn take(&self, place: Place) -> Reply<'_, bool> {
        self.take_place(place).boxed()
    }

    fn episode(&self, id: EpisodeId) -> Reply<'_, Option<StoredEpisode>> {
        async move { self.find_episode(&id).await }.boxed()
    }

    fn unfinished(&self) -> Reply<'_, Vec<Unfinished>> {
        self.unfinished_episodes().boxed()
    }

    fn holders(&self, episode: EpisodeKey) -> Reply<'_, Vec<Held>> {
        self.read_holders(episode).boxed()
    }

    fn entrant(&self, run: RunKey) -> Reply<'_, Option<(CompetitionKey, OwnerKey)>> {
        async move {
            let text =
                concat!("SELECT ", competition_of_run!(), ", r.owner FROM runs r WHERE r.key = $1");
            let found: Option<(Option<_>, Option<_>)> =
                self.fetch_optional(query(text).bind(run.0)).await?;
            Ok(found.and_then(|(competition, owner)| competition.zip(owner)))
        }
        .boxed()
    }

    fn key_id(&self, owner: OwnerKey) -> Reply<'_, Option<String>> {
        self.read_key_id(owner).boxed()
    }

    fn acts(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<(u32, RoundActs)>> {
        async move {
            // One row for each round: a row costs more than the acts in it. Records contain no line breaks.
            let query = query(
                "SELECT round, string_agg(agent || ' ' || waiting_for || ' ' || octet_length(record) || ' '
                                          || coalesce(brief, record), $1)
                 FROM acts WHERE episode = $2 AND round >= $3 AND round < $4 GROUP BY round ORDER BY round",
            );
            let query = query.bind("\n").bind(episode.0).bind(from).bind(to);
            let read: Vec<(u32, String)> = self.fetch_all(query).await?;
            let (mut rounds, mut unpaused) = (Vec::with_capacity(read.len()), 0);
            for (round, lines) in read {
                if unpaused > ACTS_OF_A_PIECE {
                    unpaused = 0;
                    tokio::task::yield_now().await;
                }
                let acts = lines.lines().map(act_of_line).collect::<Option<RoundActs>>();
                let broken = || StoreError::broken(format!("an act of round {round} cannot be read"));
                let mut acts = acts.ok_or_else(broken)?;
                acts.sort_unstable_by_key(|(agent, _)| *agent);
                unpaused += acts.len();
                rounds.push((round, acts));
            }
            Ok(rounds)
        }
        .boxed()
    }

    fn round_acts(&self, episode: EpisodeKey, round: u32) -> Reply<'_, RoundActs> {
        async move {
            let rows = query(
                "SELECT round, agent, waiting_for, octet_length(record) AS bytes, record FROM acts
             WHERE episode = $1 AND round = $2 ORDER BY agent",
            )
            .bind(episode.0)
            .bind(round)
            .fetch_all(&mut *self.read().await?)
            .await?;
            let mut acts = RoundActs::with_capacity(rows.len());
            let mut unpaused = 0;
            for row in rows {
                if unpaused > PIECE_BYTES {
                    unpaused = 0;
                    tokio::task::yield_now().await;
                }
                let (agent, act) = <(AgentId, StoredAct)>::from_row(&row)?;
                unpaused += act.bytes;
                acts.push((agent, act));
            }
            Ok(acts)
        }
        .boxed()
    }

    fn act(&self, episode: EpisodeKey, round: u32, agent: AgentId) -> Reply<'_, Option<StoredAct>> {
        async move {
            let query = query(
                "SELECT agent, waiting_for, octet_length(record) AS bytes, record FROM acts
             WHERE episode = $1 AND round = $2 AND agent = $3",
            );
            let found =
                self.fetch_optional(query.bind(episode.0).bind(round).bind(agent.0)).await?;
            Ok(found.map(|(_, act): (AgentId, StoredAct)| act))
        }
        .boxed()
    }

    fn rounds(&self, episode: EpisodeKey, from: u32, to: u32) -> Reply<'_, Vec<StoredRound>> {
        self.resolved(episode, from, to).boxed()
    }
}
