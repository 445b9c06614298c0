//! The table `episodes`.

use jiff::Timestamp;
use serde::Deserialize;

use crate::ids::{CompetitionKey, EpisodeId, EpisodeKey, Place, RunKey};
use crate::keys::OwnerKey;
use crate::store::Store;
use crate::store::StoreError;
use crate::store::port::{StoredEpisode, Unfinished};
use crate::store::sql::{Builder, Connection, FromRow, LISTED_AT_ONCE, SqlRow, get, query};
use crate::store::templates::{listed_opening, opening};
use swarmbench_journal::record::{End, RawRecord, RecordedConfig, end_record};

/// Filter of a list of episodes.
#[derive(Clone, Debug, Default)]
pub struct Filter {
    /// `waiting`, `running`, `finished`, `aborted` or `abandoned`.
    pub status: Option<String>,
    pub task: Option<String>,
    /// Model of the creator.
    pub model: Option<String>,
    /// Model that held a seat. Before an episode starts only the creator's counts.
    pub played_by: Option<String>,
    /// Whether the seats had several holders.
    pub mixed: Option<bool>,
    pub run: Option<RunKey>,
    /// Public id of the episode that was forked.
    pub fork_of: Option<String>,
    /// Whether the episodes are forks.
    pub forks: Option<bool>,
    /// Restriction to episodes in which people take part. Those of an open episode with several holders are secret.
    pub people: bool,
    /// Episodes that the caller may read.
    pub readable: Readable,
}

impl Filter {
    /// Column among status, task and model that chooses the index: the one with the fewest episodes, as far as is known. SQLite
    /// alone would choose an index with many episodes and scan all of them to find a few.
    fn leads(&self) -> Option<&'static str> {
        let is_unfinished = matches!(self.status.as_deref(), Some("waiting" | "running"));
        if self.run.is_some() || self.fork_of.is_some() {
            None
        } else if is_unfinished {
            Some("status")
        } else if self.model.is_some() {
            Some("model")
        } else if self.task.is_some() {
            Some("task")
        } else {
            Some("status")
        }
    }

    /// Parts of the list, each of which has an index in the order of the list. With an OR condition the query would scan all
    /// sealed games of a large competition. `None` if the index of another column finds the few episodes.
    fn parts(&self) -> Option<Vec<Part<'_>>> {
        if self.run.is_some() || self.fork_of.is_some() {
            return None;
        }
        match &self.readable {
            Readable::Public => Some(vec![Part::Public]),
            Readable::And(id) => Some(vec![Part::Public, Part::Episode(id)]),
            Readable::AndOf { owner, at } => {
                Some(vec![Part::Public, Part::Own(*owner, *at), Part::Claimable])
            }
            Readable::AndOfRun(run) => Some(vec![Part::Public, Part::OfRun(*run)]),
            Readable::All | Readable::OnlyOfRun(_) | Readable::Only(_) | Readable::Nothing => None,
        }
    }

    /// Adds all conditions except readability. The column `leads` is looked up in an index.
    fn push<'q>(
        &'q self,
        query: &mut Builder<'q>,
        order: Order,
        before: Option<EpisodeKey>,
        leads: Option<&str>,
    ) {
        let (sign, _) = order.signs();
        let start = if order.is_ascending { -1 } else { i64::MAX };
        query.push("e.key").push(sign).push_bind(before.map_or(start, |key| key.0));
        for (column, value) in
            [("status", &self.status), ("task", &self.task), ("model", &self.model)]
        {
            if let Some(value) = value {
                query.push(" AND e.").push(column);
                // SQLite uses no index for a computed text.
                query.push(if leads == Some(column) { " = " } else { " || '' = " });
                query.push_bind(value);
            }
        }
        if let Some(model) = &self.played_by {
            query.push(" AND CASE WHEN ").push(IS_SEATED);
            query
                .push(" THEN EXISTS (SELECT 1 FROM seats s WHERE s.episode = e.key AND s.model = ");
            query.push_bind(model).push(") ELSE e.model = ").push_bind(model).push(" END");
        }
        if let Some(mixed) = self.mixed {
            query.push(" AND ").push(IS_MIXED).push(" = ").push_bind(mixed);
        }
        if self.people {
            query.push(
                " AND e.people AND (e.ended_at IS NOT NULL OR NOT coalesce(e.open_seats, FALSE))",
            );
        }
        if let Some(run) = self.run {
            query.push(" AND e.run = ").push_bind(run.0);
        }
        if let Some(parent) = &self.fork_of {
            query.push(" AND e.fork_of = (SELECT key FROM episodes WHERE id = ");
            query.push_bind(parent).push(")");
        }
        if let Some(forks) = self.forks {
            query.push(" AND (e.fork_of IS NOT NULL) = ").push_bind(forks);
        }
    }

    /// Adds readability as one condition.
    fn push_readable<'q>(&'q self, query: &mut Builder<'q>) {
        match &self.readable {
            Readable::All => {}
            Readable::Public => {
                query.push(" AND ").push(PUBLIC);
            }
            Readable::And(id) => {
                query.push(" AND (").push(PUBLIC).push(" OR e.id = ");
                query.push_bind(id.as_str()).push(")");
            }
            Readable::AndOf { owner, at } => {
                query.push(" AND (").push(PUBLIC).push(" OR ");
                Part::Own(*owner, *at).push(query);
                query.push(" OR ").push(CLAIMABLE).push(")");
            }
            Readable::AndOfRun(run) => {
                query.push(" AND (").push(PUBLIC).push(" OR ");
                Part::OfRun(*run).push(query);
                query.push(")");
            }
            Readable::OnlyOfRun(run) => {
                query.push(" AND (e.visibility <> 'sealed' OR e.revealed) AND e.run = ");
                query.push_bind(run.0);
            }
            Readable::Only(id) => {
                query.push(" AND e.id = ").push_bind(id.as_str());
            }
            Readable::Nothing => {
                query.push(" AND FALSE");
            }
        }
    }

    /// True if an index finds few episodes: those of a run, forks of an episode, or those that a token may read.
    const fn is_of_few(&self) -> bool {
        self.run.is_some()
            || self.fork_of.is_some()
            || matches!(
                self.readable,
                Readable::OnlyOfRun(_) | Readable::Only(_) | Readable::Nothing
            )
    }

    /// Adds the source of a sorted list, its condition, and the place after which it begins.
    fn push_sorted<'q>(
        &'q self,
        query: &mut Builder<'q>,
        by: SortKey,
        sign: &str,
        after: Option<SortedPlace>,
    ) {
        let SortKey(_, condition, index) = by;
        if self.is_of_few() {
            query.push(" WHERE e.key IN (SELECT e.key FROM episodes e WHERE ");
            self.push(query, Order::default(), None, None);
            self.push_readable(query);
            Order::default().push_end(query, SCANNED_MAX);
            query.push(") AND ");
        } else {
            query.push(index).push(" WHERE ");
        }
        query.push(PUBLIC).push(" AND ").push(condition);
        if let Some(after) = after {
            by.push_comparison(query, sign, after);
        }
    }

    /// Filter of an export for forks: by default forks are left out, as games with the same beginning are not independent. All
    /// episodes if forks are requested, or one episode is named.
    pub fn of_forks(wanted: bool, is_named: bool) -> Option<bool> {
        if wanted || is_named { None } else { Some(false) }
    }
}

/// Order of a list of episodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Order {
    /// Value of ended episodes; `None` for the order of creation.
    pub by: Option<SortKey>,
    /// Whether the list begins with the lowest value, or the oldest episode.
    pub is_ascending: bool,
}

/// Value by which public episodes are sorted, before their time of creation; the condition of those that have it; and the hint of
/// their index, which has the columns of all filters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SortKey(Option<&'static str>, &'static str, &'static str);

impl SortKey {
    pub const SCORE: Self =
        Self(Some("e.score"), "e.score IS NOT NULL", " INDEXED BY episodes_public_by_score");
    pub const ROUNDS: Self =
        Self(Some("e.rounds"), "e.rounds IS NOT NULL", " INDEXED BY episodes_public_by_rounds");
    pub const SEED: Self =
        Self(Some("e.seed"), "e.seed IS NOT NULL", " INDEXED BY episodes_public_by_seed");
    /// No value, of those in which people take part.
    const PEOPLE: Self = Self(None, "e.people", " INDEXED BY episodes_public_people");

    /// Selects places.
    fn places(self) -> Builder<'static> {
        let value = self.0.unwrap_or("CAST(NULL AS DOUBLE PRECISION)");
        Builder::new(format!("SELECT {value}, e.created_at, e.key FROM episodes e"))
    }

    /// Adds a comparison with a place, by values: SQLite finds the place among equal values in the index only by these.
    fn push_comparison(self, query: &mut Builder<'_>, sign: &str, (value, at, key): SortedPlace) {
        query.push(" AND (");
        if let Some(column) = self.0 {
            query.push(column).push(", ");
        }
        query.push("e.created_at, e.key)").push(sign).push("(");
        if let Some(value) = value {
            query.push_bind(value).push(", ");
        }
        query.push_bind(at).push(", ").push_bind(key).push(")");
    }
}

/// Place in a sorted list: a value if the list has one, a time of creation, and a key.
type SortedPlace = (Option<f64>, i64, i64);

impl Order {
    const fn signs(self) -> (&'static str, &'static str) {
        if self.is_ascending { (" > ", " ASC") } else { (" < ", " DESC") }
    }

    /// Adds `ORDER BY` and `LIMIT`.
    fn push_end(self, query: &mut Builder<'_>, limit: u32) {
        let (_, direction) = self.signs();
        query.push(" ORDER BY ");
        if let Some(SortKey(value, ..)) = self.by {
            for column in value.into_iter().chain(["e.created_at"]) {
                query.push(column).push(direction).push(", ");
            }
        }
        query.push("e.key").push(direction).push(" LIMIT ").push_bind(limit);
    }
}

/// Entries of an index that are read for one piece of a sorted list: it costs as much whatever its filters are, and however many
/// episodes there are. Of a run or an episode with forks, as many are sorted.
const SCANNED_MAX: u32 = 16_384;

/// Episodes that a caller may read.
#[derive(Clone, Debug, Default)]
pub enum Readable {
    All,
    /// Public episodes.
    #[default]
    Public,
    /// Public episodes, and this one.
    And(EpisodeId),
    /// Public episodes, those that were created with this key, and those with claimable seats. Sealed episodes of the key are
    /// included once the windows of their attempts have closed.
    AndOf {
        owner: OwnerKey,
        /// Time by which windows have closed.
        at: Timestamp,
    },
    /// Public episodes, and those of this run.
    AndOfRun(RunKey),
    /// Episodes of this run alone.
    OnlyOfRun(RunKey),
    /// This episode alone.
    Only(EpisodeId),
    Nothing,
}

/// Part of a list.
enum Part<'a> {
    /// Public episodes.
    Public,
    /// Episodes of a key that it may read at a time.
    Own(OwnerKey, Timestamp),
    Claimable,
    OfRun(RunKey),
    Episode(&'a EpisodeId),
}

/// Public episodes, in the exact words of the partial indexes.
const PUBLIC: &str = "(e.visibility = 'public' OR (e.ended_at IS NOT NULL
                        AND (e.visibility <> 'sealed' OR e.revealed)))";

impl<'q> Part<'q> {
    fn push(&self, query: &mut Builder<'q>) {
        match self {
            Self::Public => {
                query.push(PUBLIC);
            }
            Self::Own(owner, at) => {
                query
                    .push("((e.visibility <> 'sealed' OR (e.own_games AND e.ended_at IS NOT NULL AND EXISTS (
                               SELECT 1 FROM runs o WHERE o.key = e.run AND o.closes_at <= ")
                    .push_bind(at.as_millisecond())
                    .push("))) AND e.owner = ")
                    .push_bind(owner.0)
                    .push(")");
            }
            Self::Claimable => {
                query.push(CLAIMABLE);
            }
            Self::OfRun(run) => {
                query.push("(e.visibility <> 'sealed' AND e.run = ").push_bind(run.0).push(")");
            }
            Self::Episode(id) => {
                query.push("e.id = ").push_bind(id.as_str());
            }
        }
    }

    /// Column of the filter that is looked up in an index.
    fn leads(&self, filter: &Filter) -> Option<&'static str> {
        match self {
            Self::Public => filter.leads(),
            Self::Own(..) | Self::Claimable | Self::OfRun(_) | Self::Episode(_) => None,
        }
    }

    /// Index, where SQLite might choose another.
    fn hint(&self, filter: &Filter) -> &'static str {
        match self {
            Self::Public => match filter.leads() {
                Some("status") if filter.status.is_some() => {
                    " INDEXED BY episodes_public_by_status"
                }
                Some("task") => " INDEXED BY episodes_public_by_task",
                Some("model") => " INDEXED BY episodes_public_by_model",
                _ => " INDEXED BY episodes_public",
            },
            Self::Own(..) => " INDEXED BY episodes_by_owner",
            Self::Claimable | Self::OfRun(_) | Self::Episode(_) => "",
        }
    }
}

/// Columns of an episode that are read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Detail {
    /// Columns of lists: without the text of a built-in prompt template.
    Listed,
    /// Columns of lists, and the curve.
    ListedWithCurve,
    /// All columns except the end record and the time of the last act.
    Summary,
    /// All columns. The time of the last act costs a scan of the acts.
    All,
}

/// End record. The text of a large one is not read: it is rebuilt without its open acts, which are among the acts of the
/// episode.
const END: &str = "
    CASE WHEN octet_length(e.ending) <= 65536 THEN e.ending END AS \"end\",
    coalesce(octet_length(e.ending) > 65536, FALSE) AS has_large_end, ";

/// End record unless it is long. It has the number of rounds and the score, so that a list reads no rounds of ended episodes,
/// each of which is on a page of its own.
const SHORT_END: &str = "CASE WHEN octet_length(e.ending) <= 1024 THEN e.ending END";

/// Curve unless it is longer than any that this program writes.
const SHORT_CURVE: &str = "CASE WHEN octet_length(e.curve) <= 1024 THEN e.curve END AS curve";

const NO_CURVE: &str = "CAST(NULL AS TEXT) AS curve";

/// Query of episodes; the caller adds a condition.
fn select(detail: Detail) -> Builder<'static> {
    let mut query = Builder::new(
        "SELECT e.key AS episode, e.id, e.owner, e.run, e.revealed,
                CASE WHEN e.own_games THEN (SELECT o.closes_at FROM runs o WHERE o.key = e.run) END AS own_from, ",
    );
    let is_listed = matches!(detail, Detail::Listed | Detail::ListedWithCurve);
    query.push(if is_listed { listed_opening!() } else { opening!() });
    query.push(
        ", e.people, coalesce(e.fork_round, 0) AS first_round, e.seating, e.status, e.reason, e.created_at, e.ended_at, e.bytes,
                CASE WHEN e.voided_at IS NULL THEN NULL ELSE coalesce(e.void_reason, '') END AS void_reason,
                CASE WHEN e.ended_at IS NULL AND r.round >= coalesce(e.fork_round, 0) THEN r.head ELSE e.head END AS head,
                coalesce(r.round + 1, 0) AS rounds, coalesce(r.score, 0.0) AS score, ",
    );
    match detail {
        Detail::Listed | Detail::ListedWithCurve | Detail::Summary => query
            .push("CAST(NULL AS TEXT) AS \"end\", FALSE AS has_large_end, CAST(NULL AS BIGINT) AS last_act_at, ")
            .push(NO_TIMES)
            .push(SHORT_END)
            .push(" AS short_end, ")
            .push(if detail == Detail::ListedWithCurve { SHORT_CURVE } else { NO_CURVE }),
        Detail::All => query
            .push(END)
            .push(LAST_ACT_AT)
            .push(" AS last_act_at, ")
            .push(TIMES)
            .push("CAST(NULL AS TEXT) AS short_end, ")
            .push(NO_CURVE),
    };
    query.push(
        " FROM episodes e
          LEFT JOIN rounds r ON r.episode = e.key
              AND r.round = (SELECT max(round) FROM rounds WHERE episode = e.key)",
    );
    if detail != Detail::All {
        query.push(" AND (").push(SHORT_END).push(") IS NULL");
    }
    query.push(" WHERE ");
    query
}

/// Condition: the episode waits and has, or had, open seats. Every holder of a key may claim one.
const CLAIMABLE: &str = "(e.status = 'waiting' AND e.visibility <> 'sealed'
                          AND coalesce(e.open_seats, FALSE))";

/// Condition: the record of seats names their holders. It has the rows of the table `seats`; without rows the creator holds all
/// seats, for a hosted player.
const IS_SEATED: &str =
    "(e.seating IS NOT NULL AND EXISTS (SELECT 1 FROM seats s WHERE s.episode = e.key))";

/// Condition: the record of seats names several holders.
const IS_MIXED: &str = "
    (e.seating IS NOT NULL
     AND coalesce((SELECT min(s.holder) < max(s.holder) FROM seats s WHERE s.episode = e.key), FALSE))";

/// Times of records, of which the newest is wanted.
const TIMES: &str = "
    e.started_at, e.ended_at AS over_at, r.at AS round_at,
    (SELECT max(a.at) FROM acts a WHERE a.episode = e.key AND a.round >= coalesce(r.round, 0)) AS act_at, ";

const NO_TIMES: &str = "
    CAST(NULL AS BIGINT) AS started_at, CAST(NULL AS BIGINT) AS over_at, CAST(NULL AS BIGINT) AS round_at,
    CAST(NULL AS BIGINT) AS act_at, ";

/// Time of the last act of a player, or else of the manual start; the expiry of a clock is no act. Acts of early versions have
/// their source only in the record, where quotes inside a text are escaped.
const LAST_ACT_AT: &str = "
    coalesce((SELECT a.at FROM acts a
              WHERE a.episode = e.key
                AND coalesce(a.source, CASE WHEN a.record LIKE '%\"source\":\"player\"%' THEN 0 ELSE 1 END) = 0
              ORDER BY a.round DESC, a.at DESC LIMIT 1),
             e.started_at)";

/// Parties that unfinished episodes are charged to.
const ACCOUNTS: &str = concat!(
    "SELECT e.key, e.owner, ",
    competition_of_run!(),
    " FROM episodes e LEFT JOIN runs r ON r.key = e.run WHERE e.status IN ('waiting', 'running')"
);

/// Unfinished episodes; a condition or an order follows.
const UNFINISHED: &str = "SELECT key, id, owner, run, clocked, CASE WHEN clocked THEN opening END AS opening,
            CASE WHEN clocked THEN (SELECT max(round) + 1 FROM rounds WHERE episode = key) END AS rounds
     FROM episodes WHERE status IN ('waiting', 'running')";

impl Store {
    pub async fn find_episode(&self, id: &EpisodeId) -> Result<Option<StoredEpisode>, StoreError> {
        self.find(id, Detail::All).await
    }

    /// An episode without its end record and the time of its last act.
    pub async fn find_summary(&self, id: &EpisodeId) -> Result<Option<StoredEpisode>, StoreError> {
        self.find(id, Detail::Summary).await
    }

    /// Keys of an episode and of its run.
    pub async fn keys_of(
        &self,
        id: &EpisodeId,
    ) -> Result<Option<(EpisodeKey, Option<RunKey>)>, StoreError> {
        self.fetch_optional(query("SELECT key, run FROM episodes WHERE id = $1").bind(id.as_str()))
            .await
    }

    /// [`Store::find_summary`] of several episodes, in any order.
    pub(in crate::store) async fn summaries(
        &self,
        ids: &[EpisodeId],
    ) -> Result<Vec<StoredEpisode>, StoreError> {
        let mut query = select(Detail::Summary);
        query.push("e.id IN ");
        query.push_list(ids.iter().map(EpisodeId::as_str));
        self.fetch_all(query.build()).await
    }

    /// [`Store::find_summary`] by key.
    pub async fn summary_of(&self, key: EpisodeKey) -> Result<Option<StoredEpisode>, StoreError> {
        let mut query = select(Detail::Summary);
        query.push("e.key = ").push_bind(key.0);
        self.fetch_optional(query.build()).await
    }

    async fn find(
        &self,
        id: &EpisodeId,
        detail: Detail,
    ) -> Result<Option<StoredEpisode>, StoreError> {
        let mut query = select(detail);
        query.push("e.id = ").push_bind(id.as_str());
        self.fetch_optional(query.build()).await
    }

    /// Lists readable episodes, newest first, starting after `before`.
    pub async fn list_episodes(
        &self,
        filter: &Filter,
        before: Option<EpisodeKey>,
        limit: u32,
    ) -> Result<Vec<StoredEpisode>, StoreError> {
        self.list(Detail::Summary, filter, Order::default(), before, limit).await
    }

    /// Lists episodes in an order, without the text of a built-in prompt template in the openings, with or without their curves. Sorted
    /// by a value, the list has only ended public episodes, and of people only public ones; where filters leave it short, the second
    /// result is the last episode that was looked at.
    pub async fn list_episodes_without_templates(
        &self,
        filter: &Filter,
        order: Order,
        has_curves: bool,
        after: Option<EpisodeKey>,
        limit: u32,
    ) -> Result<(Vec<StoredEpisode>, Option<EpisodeKey>), StoreError> {
        let detail = if has_curves { Detail::ListedWithCurve } else { Detail::Listed };
        let of_people = (filter.people && !filter.is_of_few()).then_some(SortKey::PEOPLE);
        let Some(by) = order.by.or(of_people) else {
            return Ok((self.list(detail, filter, order, after, limit).await?, None));
        };
        let order = Order { by: Some(by), ..order };
        let (sign, _) = order.signs();
        let after = match after {
            None => None,
            Some(after) => {
                // The place of an episode that the list does not have would tell its seed.
                let mut query = by.places();
                query.push(" WHERE e.key = ").push_bind(after.0).push(" AND ").push(PUBLIC);
                query.push(" AND ").push(by.1);
                filter.push_readable(&mut query);
                let place: Option<SortedPlace> = self.fetch_optional(query.build()).await?;
                let Some(place) = place else { return Ok((Vec::new(), None)) };
                Some(place)
            }
        };
        let mut last: Option<SortedPlace> = None;
        if !filter.is_of_few() {
            let mut query = by.places();
            filter.push_sorted(&mut query, by, sign, after);
            order.push_end(&mut query, 1);
            query.push(" OFFSET ").push_bind(SCANNED_MAX - 1);
            last = self.fetch_optional(query.build()).await?;
        }
        let mut query = select(detail);
        query.push("e.key IN (SELECT key FROM (SELECT e.key FROM episodes e");
        filter.push_sorted(&mut query, by, sign, after);
        if let Some(last) = last {
            by.push_comparison(&mut query, if order.is_ascending { " <= " } else { " >= " }, last);
        }
        query.push(" AND ");
        filter.push(&mut query, Order::default(), None, None);
        filter.push_readable(&mut query);
        order.push_end(&mut query, limit);
        query.push(") AS part)");
        order.push_end(&mut query, limit);
        let found: Vec<StoredEpisode> = self.fetch_all(query.build()).await?;
        let is_short = found.len() < limit as usize;
        Ok((found, last.filter(|_| is_short).map(|(.., key)| EpisodeKey(key))))
    }

    /// Models of public episodes after a name, in order. Each is looked up in the index: other episodes of a model are not read.
    pub async fn public_models(&self, after: &str, limit: u32) -> Result<Vec<String>, StoreError> {
        let next = |query: &mut Builder<'_>| {
            query
                .push("SELECT (SELECT e.model FROM episodes e INDEXED BY episodes_public_by_model");
            query.push(" WHERE ").push(PUBLIC).push(" AND e.model > ");
        };
        let mut query = Builder::new("WITH RECURSIVE found (model) AS (");
        next(&mut query);
        query.push_bind(after).push(" ORDER BY e.model LIMIT 1) UNION ALL ");
        next(&mut query);
        query.push(
            "found.model ORDER BY e.model LIMIT 1) FROM found WHERE found.model IS NOT NULL)",
        );
        query.push(" SELECT model FROM found WHERE model IS NOT NULL LIMIT ").push_bind(limit);
        self.fetch_all(query.build()).await
    }

    async fn list(
        &self,
        detail: Detail,
        filter: &Filter,
        order: Order,
        before: Option<EpisodeKey>,
        limit: u32,
    ) -> Result<Vec<StoredEpisode>, StoreError> {
        let mut query = select(detail);
        match filter.parts() {
            None => {
                filter.push(&mut query, order, before, filter.leads());
                filter.push_readable(&mut query);
            }
            Some(parts) => {
                query.push("e.key IN (");
                for (place, part) in parts.iter().enumerate() {
                    let union = if place == 0 { "" } else { " UNION " };
                    query.push(union).push("SELECT key FROM (SELECT e.key FROM episodes e");
                    query.push(part.hint(filter)).push(" WHERE ");
                    filter.push(&mut query, order, before, part.leads(filter));
                    query.push(" AND ");
                    part.push(&mut query);
                    order.push_end(&mut query, limit);
                    // PostgreSQL requires a name of the subquery.
                    query.push(") AS part");
                }
                query.push(")");
            }
        }
        order.push_end(&mut query, limit);
        self.fetch_all(query.build()).await
    }

    /// Unfinished episodes, clocked ones first.
    pub async fn unfinished_episodes(&self) -> Result<Vec<Unfinished>, StoreError> {
        let mut query = Builder::new(UNFINISHED);
        query.push(" ORDER BY clocked DESC, key");
        self.fetch_all(query.build()).await
    }

    /// [`Store::unfinished_episodes`] of these places.
    pub async fn unfinished_at(&self, places: &[Place]) -> Result<Vec<Unfinished>, StoreError> {
        let mut unfinished = Vec::new();
        let games = places.iter().filter_map(|place| match place {
            Place::Game(key) => Some(key.0),
            Place::Run(_) | Place::Competition(_) => None,
        });
        let runs = places.iter().filter_map(|place| match place {
            Place::Run(key) => Some(key.0),
            Place::Game(_) | Place::Competition(_) => None,
        });
        let (games, runs): (Vec<i64>, Vec<i64>) = (games.collect(), runs.collect());
        for (column, keys) in [(" AND key IN ", games), (" AND run IN ", runs)] {
            for chunk in keys.chunks(LISTED_AT_ONCE) {
                let mut query = Builder::new(UNFINISHED);
                query.push(column).push_list(chunk.iter().copied());
                unfinished.extend(self.fetch_all::<Unfinished>(query.build()).await?);
            }
        }
        unfinished.sort_by_key(|episode| (!episode.clocked, episode.episode));
        Ok(unfinished)
    }

    /// Bytes of the acts of all episodes, by key.
    pub async fn bytes_by_owner(&self) -> Result<Vec<(OwnerKey, u64)>, StoreError> {
        let query = query(
            "SELECT owner, CAST(sum(bytes) AS BIGINT) FROM (
                 SELECT owner, bytes FROM episodes WHERE owner IS NOT NULL AND bytes IS NOT NULL
                 UNION ALL
                 SELECT e.owner, octet_length(a.record) FROM episodes e JOIN acts a ON a.episode = e.key
                 WHERE e.status IN ('waiting', 'running') AND e.owner IS NOT NULL) AS kept
             GROUP BY owner",
        );
        self.fetch_all(query).await
    }

    /// Unfinished episodes with their keys and competitions.
    pub async fn accounts(
        &self,
    ) -> Result<Vec<(EpisodeKey, Option<OwnerKey>, Option<CompetitionKey>)>, StoreError> {
        self.fetch_all(query(ACCOUNTS)).await
    }

    /// [`Store::accounts`] of these episodes.
    pub async fn accounts_of(
        &self,
        episodes: &[EpisodeKey],
    ) -> Result<Vec<(EpisodeKey, Option<OwnerKey>, Option<CompetitionKey>)>, StoreError> {
        let mut accounts = Vec::with_capacity(episodes.len());
        for chunk in episodes.chunks(LISTED_AT_ONCE) {
            let mut query = Builder::new(ACCOUNTS);
            query.push(" AND e.key IN ").push_list(chunk.iter().map(|episode| episode.0));
            accounts.extend(self.fetch_all::<(_, _, _)>(query.build()).await?);
        }
        Ok(accounts)
    }

    /// Bytes of the acts of all episodes, by competition that is not public yet. The joins start at the few competitions:
    /// SQLite would start at all episodes.
    pub async fn bytes_by_competition(&self) -> Result<Vec<(CompetitionKey, u64)>, StoreError> {
        let query = query(
            "SELECT competition, CAST(coalesce(sum(bytes), 0) AS BIGINT) FROM (
                 SELECT n.competition, coalesce(e.bytes, (
                            SELECT CAST(sum(octet_length(a.record)) AS BIGINT)
                            FROM acts a WHERE a.episode = e.key)) AS bytes
                 FROM competitions c CROSS JOIN entries n CROSS JOIN runs r CROSS JOIN episodes e
                 WHERE c.revealed_at IS NULL AND n.competition = c.key AND r.entry = n.key AND e.run = r.key) AS kept
             GROUP BY competition",
        );
        self.fetch_all(query).await
    }

    /// Number of the newest episode; 0 without episodes.
    pub async fn last_key(&self) -> Result<i64, StoreError> {
        self.fetch_one(query("SELECT coalesce(max(key), 0) FROM episodes")).await
    }

    /// Episode that was created with an idempotency key, and the hash of the request's body.
    pub async fn created_with(
        &self,
        key: &str,
    ) -> Result<Option<(EpisodeId, Vec<u8>)>, StoreError> {
        let query = query("SELECT id, idempotency_body FROM episodes WHERE idempotency_key = $1");
        self.fetch_optional(query.bind(key)).await
    }
}

impl FromRow for StoredEpisode {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        let (mut rounds, mut score) = (get(row, "rounds")?, get(row, "score")?);
        if let Some(end) = get::<Option<RawRecord>>(row, "short_end")? {
            let end: Standing = end.read().map_err(|error| sqlx::Error::Decode(error.into()))?;
            // A layout may have a score, but none is shown before the first round.
            (rounds, score) = (end.rounds, if end.rounds > 0 { end.score } else { 0.0 });
        }
        let (status, reason): (String, Option<String>) = (get(row, "status")?, get(row, "reason")?);
        let end = if get(row, "has_large_end")? {
            Some(end_without_acts(&status, reason.as_deref(), rounds, score))
        } else {
            get(row, "end")?
        };
        let created_at = get(row, "created_at")?;
        let mut newest_at = created_at;
        for column in ["started_at", "over_at", "round_at", "act_at"] {
            newest_at =
                get::<Option<Timestamp>>(row, column)?.map_or(newest_at, |at| at.max(newest_at));
        }
        Ok(Self {
            episode: get(row, "episode")?,
            id: get(row, "id")?,
            owner: get(row, "owner")?,
            run: get(row, "run")?,
            revealed: get(row, "revealed")?,
            own_from: get(row, "own_from")?,
            opening: get(row, "opening")?,
            first_round: get(row, "first_round")?,
            seating: get(row, "seating")?,
            status,
            reason,
            end,
            head: get(row, "head")?,
            act_bytes: get(row, "bytes")?,
            rounds,
            score,
            has_people: get(row, "people")?,
            curve: get::<Option<String>>(row, "curve")?
                .and_then(|text| serde_json::from_str(&text).ok()),
            created_at,
            newest_at,
            last_act_at: get(row, "last_act_at")?,
            ended_at: get(row, "ended_at")?,
            void_reason: get(row, "void_reason")?,
        })
    }
}

/// Points of the curve of an ended episode: the first is 0, the last is the score.
const CURVE_POINTS: u32 = 32;

/// Stores the curves of ended episodes with their rounds, which lists show: rows of `rounds` are each on a page of their own.
pub(in crate::store) async fn add_curves(
    connection: &mut Connection,
    ended: &[(EpisodeKey, u32)],
) -> Result<(), sqlx::Error> {
    for &(episode, rounds) in ended {
        add_curve(connection, episode, rounds).await?;
    }
    Ok(())
}

async fn add_curve(
    connection: &mut Connection,
    episode: EpisodeKey,
    rounds: u32,
) -> Result<(), sqlx::Error> {
    let scores = curve(connection, episode, rounds).await?;
    query("UPDATE episodes SET curve = $1 WHERE key = $2")
        .bind(serde_json::to_string(&scores).expect("numbers"))
        .bind(episode.0)
        .execute(connection)
        .await?;
    Ok(())
}

/// Scores of an episode in equal steps of its rounds.
pub(in crate::store) async fn curve(
    connection: &mut Connection,
    episode: EpisodeKey,
    rounds: u32,
) -> Result<Vec<f64>, sqlx::Error> {
    let every = rounds.div_ceil(CURVE_POINTS - 2).max(1);
    let mut scores = vec![0.0];
    let mut points = Builder::new("SELECT score FROM rounds WHERE episode = ");
    points.push_bind(episode.0).push(" AND round IN ");
    let after = (1..=rounds).filter(|after| after.is_multiple_of(every) || *after == rounds);
    points.push_list(after.map(|after| after - 1));
    points.push(" ORDER BY round");
    for row in points.build().fetch_all(connection).await? {
        scores.push(row.try_get(0)?);
    }
    Ok(scores)
}

/// End record without the acts of the open round.
fn end_without_acts(status: &str, reason: Option<&str>, rounds: u32, score: f64) -> RawRecord {
    let (status, reason) = (status.to_owned(), reason.unwrap_or_default().to_owned());
    end_record(End { status, reason, rounds, score, open_acts: Vec::new() })
}

/// Fields of an end record about the rounds.
#[derive(Deserialize)]
struct Standing {
    rounds: u32,
    score: f64,
}

/// Field of an opening with the settings.
#[derive(Deserialize)]
struct Configured {
    config: RecordedConfig,
}

impl FromRow for Unfinished {
    fn from_row(row: &SqlRow) -> Result<Self, sqlx::Error> {
        // Unreadable settings are reported by the recovery of the episode.
        let config = get::<Option<String>>(row, "opening")?
            .and_then(|opening| serde_json::from_str(&opening).ok())
            .map(|Configured { config }| config);
        let rounds = get::<Option<u32>>(row, "rounds")?.unwrap_or(0);
        Ok(Self {
            episode: get(row, "key")?,
            id: get(row, "id")?,
            owner: get(row, "owner")?,
            run: get(row, "run")?,
            clocked: get(row, "clocked")?,
            played: config.map(|config| (config, rounds)),
        })
    }
}
