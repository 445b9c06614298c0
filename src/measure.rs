//! Metrics of episodes, replayed and measured in the background after the end, or when they are first read.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use swarmbench_analysis::game::{Heard, Setup, State};
use swarmbench_analysis::journal::decisions;
use swarmbench_analysis::{Counts, Definition, Meter, Metric, Metrics, Options};
use swarmbench_boards::result::mean_and_deviation;
use swarmbench_clock::{Clock, after};
use swarmbench_engine::World;
use swarmbench_journal::record::Record;
use swarmbench_protocol::metrics::{
    GameMetrics, MetricMean, MetricSeries, MetricValue, MetricValues, MetricsMethod,
};

use crate::episode::actor::Host;
use crate::episode::replay::Rounds;
use crate::episode::replays::RecoveryError;
use crate::fair::Party;
use crate::ids::EpisodeKey;
use crate::store::entries::Entry;
use crate::store::metrics::{Measured, MetricsRow, Unmeasured, stored_method};
use crate::store::port::StoredEpisode;
use crate::store::{Store, StoreError};

/// Queued games read at once.
const QUEUED_AT_ONCE: u32 = 64;

/// Time between reads of an empty queue.
const PAUSE: Duration = Duration::from_secs(1);

/// Maximum microseconds to measure an agent's part of a round: distances, texts and their vectors.
const MICROS_OF_AN_AGENT: u64 = 20;

/// Bytes of one round's values when the values of all rounds are computed.
pub const SERIES_BYTES_OF_A_ROUND: usize =
    Metric::ALL.len() * Definition::ALL.len() * size_of::<Option<f64>>() + size_of::<Counts>();

/// Description of how values were computed, which is sent with them.
pub fn method(definition: Definition) -> MetricsMethod {
    let (embedder, metrics_revision) = stored_method();
    let (definition, embedder) = (definition.name().to_owned(), embedder.to_owned());
    MetricsMethod { definition, metrics_revision, embedder }
}

/// Values of a definition in the form that is sent.
pub fn values(measured: &Measured, definition: Definition) -> MetricValues {
    let of = measured.of_definition(definition).iter();
    of.map(|(name, &(value, rounds))| (name.clone(), MetricValue { value, rounds })).collect()
}

/// Means over the games that have a value, by task and metric.
pub fn means(games: &[GameMetrics]) -> BTreeMap<String, BTreeMap<String, MetricMean>> {
    let mut of_tasks = BTreeMap::<&String, BTreeMap<&String, Vec<f64>>>::new();
    for game in games {
        let of_task = of_tasks.entry(&game.task).or_default();
        for (metric, value) in &game.values {
            of_task.entry(metric).or_default().extend(value.value);
        }
    }
    let mean = |(metric, values): (&String, Vec<f64>)| {
        let (mean, deviation) = mean_and_deviation(&values)?;
        let games = u32::try_from(values.len()).unwrap_or(u32::MAX);
        Some((metric.clone(), MetricMean { mean, deviation, games }))
    };
    let of_tasks = of_tasks.into_iter();
    of_tasks.map(|(task, of)| (task.clone(), of.into_iter().filter_map(mean).collect())).collect()
}

/// Values of some states of a game of `rounds` rounds. The game was measured with its series at least up to these states.
pub fn series(
    metrics: &Metrics,
    definition: Definition,
    states: Range<u32>,
    rounds: u32,
) -> MetricSeries {
    let range = states.start as usize..states.end as usize;
    let of = metrics.series.iter().filter(|((of, _), _)| *of == definition);
    let values =
        of.map(|((_, metric), values)| (metric.name().to_owned(), values[range.clone()].to_vec()));
    let mut counts = BTreeMap::<_, Vec<_>>::new();
    for (state, row) in states.clone().zip(&metrics.counts[range.clone()]) {
        for (name, count) in row.columns(state == 0) {
            counts.entry(name.to_owned()).or_default().push(count);
        }
    }
    MetricSeries {
        from: states.start,
        length: states.end - states.start,
        next: (states.end <= rounds).then_some(states.end),
        counts,
        values: values.collect(),
    }
}

/// The state of an episode before its first round, from its opening.
pub fn layout_of(stored: &StoredEpisode) -> Result<Arc<World>, RecoveryError> {
    let broken = |problem| RecoveryError::Broken { episode: stored.id.to_string(), problem };
    match stored.opening.read() {
        Ok(Record::Opening(opening)) => {
            let config = opening.config.engine().map_err(|error| broken(error.to_string()))?;
            Ok(Arc::new(World::new(Arc::new(config))))
        }
        Ok(_) => Err(broken("its first record is not an opening".to_owned())),
        Err(error) => Err(broken(error.to_string())),
    }
}

/// Replays an episode up to round `to` and measures it.
pub async fn measure(
    host: &Host,
    stored: &StoredEpisode,
    to: u32,
    series: bool,
    party: Party,
) -> Result<Metrics, RecoveryError> {
    let layout = layout_of(stored)?;
    let micros = MICROS_OF_AN_AGENT * u64::from(layout.config().num_agents());
    let meter = Meter::new(Setup::of(&layout), State::of(&layout), Options::all(series));
    let rounds = Rounds::of(stored, to, ("measure", party), micros);
    let (_, meter) = rounds
        .play(host, layout, meter, |meter, acts, world| {
            let acts = acts.iter().map(|(_, act)| &act.record);
            let heard: Vec<Heard> = Heard::all(world);
            meter.round(&decisions(world.config(), acts), State::of(world), Some(&heard));
        })
        .await?;
    Ok(meter.metrics())
}

/// Measures an ended episode.
async fn measured(host: &Host, stored: &StoredEpisode) -> Result<MetricsRow, RecoveryError> {
    let party = Party::of_key(stored.owner);
    let metrics = measure(host, stored, stored.rounds, false, party).await?;
    Ok(MetricsRow::new(stored.episode, &Measured::of(&metrics)))
}

/// Measures ended games one after another, forever.
pub async fn run(store: &Store, host: &Host, clock: &dyn Clock) {
    loop {
        match measure_queued(store, host).await {
            Ok(true) => {}
            Ok(false) => clock.sleep_until(after(clock.now(), PAUSE)).await,
            Err(error) => {
                // The writer logs once that the database is away.
                if !matches!(error, RecoveryError::Journal(StoreError::Away)) {
                    tracing::warn!(%error, "games that have ended cannot be measured; trying again");
                }
                clock.sleep_until(after(clock.now(), PAUSE)).await;
            }
        }
    }
}

/// Measures the first games of the queue and stores their metrics in one commit. False if the queue is empty.
async fn measure_queued(store: &Store, host: &Host) -> Result<bool, RecoveryError> {
    // One server of a cluster works off the queue.
    if store.cluster().is_some_and(|cluster| !cluster.is_oldest()) {
        return Ok(false);
    }
    let queued = store.unmeasured(QUEUED_AT_ONCE).await?;
    let mut entries = Vec::with_capacity(queued.len());
    let mut stopped = None;
    for Unmeasured { number, episode } in queued {
        match measured_if_stored(store, host, episode).await {
            Ok(metrics) => entries.push(Entry::Measured { number: Some(number), metrics }),
            // The queue of heavy work is full, or the journal cannot be read: retried later.
            Err(error) => {
                stopped = Some(error);
                break;
            }
        }
    }
    let count = entries.len();
    if count > 0 {
        store.keep(entries).await?;
        metrics::counter!("swarmbench_games_measured_total").increment(count as u64);
    }
    stopped.map_or(Ok(count > 0), Err)
}

/// Metrics of an episode; `None` if it is not stored any more or its journal is broken.
async fn measured_if_stored(
    store: &Store,
    host: &Host,
    episode: EpisodeKey,
) -> Result<Option<Box<MetricsRow>>, RecoveryError> {
    let Some(stored) = store.summary_of(episode).await? else { return Ok(None) };
    match measured(host, &stored).await {
        Ok(row) => Ok(Some(Box::new(row))),
        Err(error @ RecoveryError::Broken { .. }) => {
            tracing::error!(%error, "a game is not measured");
            Ok(None)
        }
        Err(error) => Err(error),
    }
}
