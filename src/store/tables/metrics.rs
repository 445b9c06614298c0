//! The tables `metrics` and `unmeasured`: metrics of ended games, and the queue of games to be measured.

use std::collections::{BTreeMap, BTreeSet};

use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use swarmbench_analysis::{Definition, Hash1, METRICS_REVISION, Metric, Metrics};

use swarmbench_protocol::worth::GameWorth;
use swarmbench_worth::WORTH_REVISION;

use crate::ids::EpisodeKey;
use crate::store::sql::{Builder, Connection, LISTED_AT_ONCE, from_row, query};
use crate::store::{Store, StoreError};

/// Length of the queue. Games that end while it is full are measured when their metrics are first read.
pub const UNMEASURED_MAX: i64 = 65_536;

/// Games whose values are read by one query.
const GAMES_AT_ONCE: usize = 256;

#[derive(Clone, Debug)]
pub struct MetricsRow {
    pub episode: EpisodeKey,
    pub embedder: String,
    pub revision: u32,
    /// [`Measured`] as JSON.
    pub measured: String,
}

/// The embedder and the metrics revision of stored values.
pub fn stored_method() -> (&'static str, u32) {
    (Hash1::ID, METRICS_REVISION)
}

/// True if a row has a worth in place of metrics, of a known revision.
pub(in crate::store) fn is_worth(embedder: &str, revision: u32) -> bool {
    [WORTH, ACCURACY]
        .iter()
        .any(|(name, newest)| *name == embedder && (1..=*newest).contains(&revision))
}

/// What stored worths have in place of an embedder, and their revision: `GameWorth` as JSON.
const WORTH: (&str, u32) = ("worth", WORTH_REVISION);

/// What has the accuracy of a worth alone in place of an embedder: boards need no more of it.
const ACCURACY: (&str, u32) = ("worth.accuracy", WORTH_REVISION);

/// A value of games of which boards show means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardMetric {
    Metric(Metric),
    /// Accuracy of the games whose worth is stored.
    Accuracy,
}

impl BoardMetric {
    pub fn all() -> impl Iterator<Item = Self> {
        Metric::ALL.into_iter().map(Self::Metric).chain([Self::Accuracy])
    }

    pub const fn name(self) -> &'static str {
        match self {
            Self::Metric(metric) => metric.name(),
            Self::Accuracy => "accuracy",
        }
    }

    /// What computed the value, and the revision.
    fn method(self) -> (&'static str, u32) {
        match self {
            Self::Metric(_) => stored_method(),
            Self::Accuracy => ACCURACY,
        }
    }
}

/// The stored values of a game: by metric name, the value and the number of rounds behind it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    sampled: bool,
    paper: BTreeMap<String, (Option<f64>, u32)>,
    toolkit: BTreeMap<String, (Option<f64>, u32)>,
}

impl Measured {
    pub fn of(metrics: &Metrics) -> Self {
        let of = |wanted: Definition| {
            let values = metrics.values.iter().filter(|((definition, _), _)| *definition == wanted);
            values
                .map(|((_, metric), of)| (metric.name().to_owned(), (of.value, of.rounds)))
                .collect()
        };
        let (paper, toolkit) = (of(Definition::Paper), of(Definition::Toolkit));
        Self { sampled: metrics.sampled, paper, toolkit }
    }

    /// # Errors
    /// If the text was not written by this revision.
    pub fn read(stored: &str) -> Result<Self, StoreError> {
        serde_json::from_str(stored).map_err(unreadable)
    }

    /// Whether comparisons of texts were sampled.
    pub const fn sampled(&self) -> bool {
        self.sampled
    }

    /// A metric's value and the number of rounds behind it.
    pub fn value(&self, definition: Definition, metric: Metric) -> (Option<f64>, u32) {
        self.of_definition(definition).get(metric.name()).copied().unwrap_or_default()
    }

    pub const fn of_definition(
        &self,
        definition: Definition,
    ) -> &BTreeMap<String, (Option<f64>, u32)> {
        match definition {
            Definition::Paper => &self.paper,
            Definition::Toolkit => &self.toolkit,
        }
    }
}

#[expect(clippy::needless_pass_by_value, reason = "it maps errors")]
fn unreadable(error: serde_json::Error) -> StoreError {
    StoreError::broken(format!("metrics of a game: {error}"))
}

impl MetricsRow {
    pub fn new(episode: EpisodeKey, measured: &Measured) -> Self {
        let (embedder, revision) = stored_method();
        let (embedder, measured) = (embedder.to_owned(), serde_json::to_string(measured));
        Self { episode, embedder, revision, measured: measured.expect("string keys") }
    }

    /// A worth, and its accuracy alone.
    pub fn of_worth(episode: EpisodeKey, worth: &GameWorth) -> [Self; 2] {
        let row = |(embedder, revision): (&str, u32), measured: serde_json::Result<String>| Self {
            episode,
            embedder: embedder.to_owned(),
            revision,
            measured: measured.expect("string keys"),
        };
        let accuracy = serde_json::json!({"accuracy": worth.accuracy});
        [row(WORTH, serde_json::to_string(worth)), row(ACCURACY, Ok(accuracy.to_string()))]
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Unmeasured {
    /// Position in the queue.
    pub number: i64,
    pub episode: EpisodeKey,
}

/// Ids of a run and a task.
pub type RunTask = (String, String);

/// Queues an ended game, in the transaction of its end.
pub(in crate::store) async fn queue(
    connection: &mut Connection,
    episode: EpisodeKey,
) -> Result<(), sqlx::Error> {
    // Numbers are nearly consecutive, so the first and the last give about the length of the queue.
    query(
        "INSERT INTO unmeasured (episode)
         SELECT CAST($1 AS BIGINT) WHERE coalesce((SELECT max(number) FROM unmeasured)
                               - (SELECT min(number) FROM unmeasured), 0) < $2",
    )
    .bind(episode.0)
    .bind(UNMEASURED_MAX)
    .execute(connection)
    .await?;
    Ok(())
}

pub(in crate::store) async fn add(
    connection: &mut Connection,
    row: &MetricsRow,
) -> Result<(), sqlx::Error> {
    query(
        "INSERT INTO metrics (episode, embedder, revision, measured) VALUES ($1, $2, $3, $4)
         ON CONFLICT (episode, embedder) DO UPDATE SET revision = excluded.revision, measured = excluded.measured",
    )
    .bind(row.episode.0)
    .bind(&row.embedder)
    .bind(row.revision)
    .bind(&row.measured)
    .execute(connection)
    .await?;
    Ok(())
}

pub(in crate::store) async fn dequeue(
    connection: &mut Connection,
    number: i64,
) -> Result<(), sqlx::Error> {
    let query = query("DELETE FROM unmeasured WHERE number = $1").bind(number);
    query.execute(connection).await.map(drop)
}

impl Store {
    /// The longest queued games.
    pub async fn unmeasured(&self, limit: u32) -> Result<Vec<Unmeasured>, StoreError> {
        let query = query("SELECT number, episode FROM unmeasured ORDER BY number LIMIT $1");
        self.fetch_all(query.bind(limit)).await
    }

    /// The stored metrics of a game for this embedder and revision.
    pub async fn metrics_of(
        &self,
        episode: EpisodeKey,
        (embedder, revision): (&str, u32),
    ) -> Result<Option<String>, StoreError> {
        let query = query(
            "SELECT measured FROM metrics WHERE episode = $1 AND embedder = $2 AND revision = $3",
        );
        self.fetch_optional(query.bind(episode.0).bind(embedder).bind(revision)).await
    }

    /// The stored worth of a game, which has ended.
    pub async fn worth_of(&self, episode: EpisodeKey) -> Result<Option<GameWorth>, StoreError> {
        let found = self.metrics_of(episode, WORTH).await?;
        Ok(found.and_then(|worth| serde_json::from_str(&worth).ok()))
    }

    /// Means of metrics of the definition `paper` over the games of each run and task, voided games excluded; `None` where no
    /// game has a stored value, and of accuracies where one game's worth is not stored.
    pub async fn mean_metrics(
        &self,
        runs: &[String],
        metrics: &[BoardMetric],
    ) -> Result<BTreeMap<RunTask, Vec<Option<f64>>>, StoreError> {
        let mut games = Vec::new();
        for some in runs.chunks(LISTED_AT_ONCE) {
            let mut query = Builder::new(
                "SELECT r.id, e.task, e.key FROM runs r JOIN episodes e ON e.run = r.key
                 WHERE e.voided_at IS NULL AND r.id IN ",
            );
            query.push_list(some.iter());
            games.extend(self.fetch_all::<(String, String, EpisodeKey)>(query.build()).await?);
        }
        // Sorted by number, as a sum of floats depends on its order.
        games.sort_unstable_by_key(|(.., episode)| *episode);
        let (mut means, mut unknown) = (BTreeMap::new(), BTreeSet::new());
        let methods: BTreeSet<_> = metrics.iter().map(|metric| metric.method()).collect();
        for some in games.chunks(GAMES_AT_ONCE) {
            let mut query = Builder::new("SELECT episode, embedder, measured FROM metrics WHERE (");
            for (place, (embedder, revision)) in methods.iter().enumerate() {
                query.push(if place == 0 { "(embedder = " } else { " OR (embedder = " });
                query.push_bind(*embedder).push(" AND revision = ").push_bind(*revision).push(")");
            }
            query.push(") AND episode IN ");
            query.push_list(some.iter().map(|(.., episode)| episode.0));
            query.push(" ORDER BY episode");
            let read: Vec<(EpisodeKey, String, String)> = self.fetch_all(query.build()).await?;
            let known: BTreeSet<EpisodeKey> =
                read.iter().filter(|row| row.1 == ACCURACY.0).map(|row| row.0).collect();
            let others = some.iter().filter(|(.., episode)| !known.contains(episode));
            unknown.extend(others.map(|(run, task, _)| (run.clone(), task.clone())));
            for (episode, _, measured) in read {
                let place = some.binary_search_by_key(&episode, |(.., episode)| *episode);
                let Ok(place) = place else { continue };
                let (run, task, _) = &some[place];
                let of = means.entry((run.clone(), task.clone()));
                let sums: &mut Vec<Sum> = of.or_insert_with(|| vec![Sum::default(); metrics.len()]);
                let values = BoardValues::read(&measured)?;
                for (sum, metric) in sums.iter_mut().zip(metrics) {
                    if let Some(value) = values.of(*metric) {
                        sum.add(value);
                    }
                }
            }
            tokio::task::yield_now().await;
        }
        // A mean over some games alone would be one over those that somebody chose.
        let mean = |of: &RunTask, (sum, metric): (&Sum, &BoardMetric)| {
            sum.mean().filter(|_| *metric != BoardMetric::Accuracy || !unknown.contains(of))
        };
        let means = means.into_iter().map(|(of, sums): (RunTask, Vec<Sum>)| {
            let means = sums.iter().zip(metrics).map(|sum| mean(&of, sum)).collect();
            (of, means)
        });
        Ok(means.collect())
    }
}

/// The subset of [`Measured`] for the definition `paper`, or an accuracy.
#[derive(Deserialize)]
struct BoardValues<'a> {
    #[serde(borrow, default)]
    paper: BTreeMap<&'a str, (Option<f64>, IgnoredAny)>,
    accuracy: Option<f64>,
}

impl<'a> BoardValues<'a> {
    fn of(&self, metric: BoardMetric) -> Option<f64> {
        match metric {
            BoardMetric::Metric(metric) => self.paper.get(metric.name())?.0,
            BoardMetric::Accuracy => self.accuracy,
        }
    }

    fn read(stored: &'a str) -> Result<Self, StoreError> {
        serde_json::from_str(stored).map_err(unreadable)
    }
}

/// A compensated sum of floats (Neumaier), so that means equal those of SQLite's `avg`.
#[derive(Clone, Debug, Default)]
struct Sum {
    rounded: f64,
    lost: f64,
    count: u32,
}

impl Sum {
    fn add(&mut self, value: f64) {
        let next = self.rounded + value;
        self.lost += if self.rounded.abs() > value.abs() {
            (self.rounded - next) + value
        } else {
            (value - next) + self.rounded
        };
        self.rounded = next;
        self.count += 1;
    }

    /// `None` without values.
    fn mean(&self) -> Option<f64> {
        let sum = if self.lost.is_finite() { self.rounded + self.lost } else { self.rounded };
        (self.count > 0).then(|| sum / f64::from(self.count))
    }
}

from_row! {
    Unmeasured { number, episode }
}
