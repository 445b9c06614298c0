//! The latency of boards, lists and look-ups on a server with many episodes.

use std::sync::Arc;
use std::time::Instant;

use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::{Deserialize, Serialize};
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::task::JoinSet;

use super::LoadError;
use super::connection::{Answers, Connection, Tally, Target, request};

/// Episodes, runs and cursors that are known before the measurement, so that requests differ.
const SAMPLES_MAX: usize = 1000;

/// Suites whose boards are read.
const SUITES_MAX: usize = 4;

/// Pages that are followed to get cursors.
const PAGES: usize = 20;

/// One kind of request.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Line {
    /// A description of the request.
    pub(crate) read: &'static str,
    /// An example of its path.
    pub(crate) path: String,
    /// The number of different requests of this kind, which are sent in turn.
    pub(crate) different: usize,
    /// The first answer to each of them, by one client: rows are read from the disk, and boards are computed.
    pub(crate) first: Spread,
    /// Later answers.
    pub(crate) latency: Spread,
}

/// The results.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ReadsReport {
    /// Requests of each kind.
    pub(crate) requests: usize,
    /// Concurrent clients.
    pub(crate) clients: usize,
    /// One line per kind of request.
    pub(crate) lines: Vec<Line>,
    /// Outcomes of all requests.
    pub(crate) answers: Answers,
}

/// The fields of a list that are read.
#[derive(Deserialize)]
struct Page {
    items: Vec<Item>,
    next_cursor: Option<String>,
}

#[derive(Clone, Deserialize)]
struct Item {
    #[serde(default)]
    id: Option<String>,
    #[serde(default)]
    model: Option<String>,
    #[serde(default)]
    task: Option<String>,
    #[serde(default)]
    suite: Option<Suite>,
}

#[derive(Clone, Deserialize)]
struct Suite {
    /// Suites of competitions have no name.
    #[serde(default)]
    name: String,
}

/// Items of a list, and the cursors of its pages.
#[derive(Default)]
struct Listed {
    items: Vec<Item>,
    cursors: Vec<String>,
}

impl Listed {
    fn ids(&self) -> Vec<&str> {
        self.items.iter().filter_map(|item| item.id.as_deref()).take(SAMPLES_MAX).collect()
    }

    /// The different values of a field, escaped for a query.
    fn all(&self, field: impl Fn(&Item) -> Option<&String>) -> Vec<String> {
        let mut all: Vec<&str> = self.items.iter().filter_map(field).map(String::as_str).collect();
        all.sort_unstable();
        all.dedup();
        all.truncate(SAMPLES_MAX);
        all.into_iter()
            .map(|value| utf8_percent_encode(value, NON_ALPHANUMERIC).to_string())
            .collect()
    }
}

/// Sends `requests` requests of each kind, `clients` at once.
pub(crate) async fn run(
    target: &Target,
    requests: usize,
    clients: usize,
) -> Result<ReadsReport, LoadError> {
    let tally = Arc::new(Tally::default());
    let episodes = listed(target, &tally, "/api/v1/episodes?status=finished&limit=200").await;
    if episodes.items.is_empty() {
        let samples = tally.answers().samples;
        let why = samples.first().map_or("the server has no finished episode", String::as_str);
        return Err(LoadError::of("nothing to read")(&why));
    }
    let runs = listed(target, &tally, "/api/v1/runs?limit=50").await;
    let cups = listed(target, &tally, "/api/v1/competitions?limit=50").await;
    let mut lines = Vec::new();
    for (read, paths) in kinds(&episodes, &runs, &cups) {
        if !paths.is_empty() {
            lines.push(line(target, &tally, read, paths, (requests, clients)).await);
        }
    }
    Ok(ReadsReport { requests, clients, lines, answers: tally.answers() })
}

/// The kinds of requests, each with different requests.
fn kinds(episodes: &Listed, runs: &Listed, cups: &Listed) -> Vec<(&'static str, Vec<String>)> {
    let each = |values: Vec<&str>, path: &dyn Fn(&str) -> String| {
        values.into_iter().map(path).collect::<Vec<_>>()
    };
    let models = episodes.all(|item| item.model.as_ref());
    let tasks = episodes.all(|item| item.task.as_ref());
    let mut suites = runs
        .all(|item| item.suite.as_ref().map(|suite| &suite.name).filter(|name| !name.is_empty()));
    suites.truncate(SUITES_MAX);
    let boards = suites.iter().flat_map(|suite| {
        let of = move |more: &str| format!("/api/v1/leaderboard?suite={suite}{more}");
        // Boards are not read by task, as a suite may have only some tasks.
        ["", "&pick=mean", "&pick=last"].map(of)
    });
    let model_and_task = models.iter().zip(tasks.iter().cycle());
    vec![
        ("leaderboard", boards.collect()),
        ("list of episodes", vec!["/api/v1/episodes".to_owned()]),
        (
            "its further pages",
            each(strs(&episodes.cursors), &|cursor| {
                format!("/api/v1/episodes?status=finished&cursor={cursor}")
            }),
        ),
        ("list by task", each(strs(&tasks), &|task| format!("/api/v1/episodes?task={task}"))),
        ("list by model", each(strs(&models), &|model| format!("/api/v1/episodes?model={model}"))),
        (
            "by model, task and status",
            model_and_task
                .map(|(model, task)| {
                    format!("/api/v1/episodes?status=finished&model={model}&task={task}")
                })
                .collect(),
        ),
        ("list of unfinished", vec!["/api/v1/episodes?status=running".to_owned()]),
        ("list of runs", vec!["/api/v1/runs".to_owned()]),
        ("games of a run", each(runs.ids(), &|run| format!("/api/v1/episodes?run={run}"))),
        ("an episode", each(episodes.ids(), &|id| format!("/api/v1/episodes/{id}"))),
        ("a run", each(runs.ids(), &|id| format!("/api/v1/runs/{id}"))),
        ("its scores", each(episodes.ids(), &|id| format!("/api/v1/episodes/{id}/scores"))),
        ("a competition", each(cups.ids(), &|id| format!("/api/v1/competitions/{id}"))),
        ("its board", each(cups.ids(), &|id| format!("/api/v1/competitions/{id}/board"))),
        (
            "50 rows of its board",
            each(cups.ids(), &|id| format!("/api/v1/competitions/{id}/board?limit=50")),
        ),
        ("its entrants", each(cups.ids(), &|id| format!("/api/v1/competitions/{id}/entrants"))),
    ]
}

fn strs(values: &[String]) -> Vec<&str> {
    values.iter().map(String::as_str).collect()
}

/// The first pages of a list.
async fn listed(target: &Target, tally: &Tally, path: &str) -> Listed {
    let mut connection = Connection::new(target);
    let mut listed = Listed::default();
    for _ in 0..PAGES {
        let cursor =
            listed.cursors.last().map_or(String::new(), |cursor| format!("&cursor={cursor}"));
        let call = request(target, "GET", &format!("{path}{cursor}"), target.key(), None);
        if !connection.call(tally, &call).await {
            break;
        }
        let Some(page) = connection.read_json::<Page>(tally) else { break };
        listed.items.extend(page.items);
        let Some(next) = page.next_cursor else { break };
        listed.cursors.push(next);
    }
    listed
}

async fn line(
    target: &Target,
    tally: &Arc<Tally>,
    read: &'static str,
    paths: Vec<String>,
    (requests, clients): (usize, usize),
) -> Line {
    let calls: Arc<Vec<_>> = Arc::new(
        paths.iter().map(|path| request(target, "GET", path, target.key(), None)).collect(),
    );
    let first = Latencies::default();
    let mut connection = Connection::new(target);
    for call in calls.iter() {
        let started = Instant::now();
        if connection.call(tally, call).await {
            first.record([started.elapsed()]);
        }
    }
    let latencies = Arc::new(Latencies::default());
    let mut tasks = JoinSet::new();
    for client in 0..clients {
        let (calls, tally, latencies) =
            (Arc::clone(&calls), Arc::clone(tally), Arc::clone(&latencies));
        let mut connection = Connection::new(target);
        tasks.spawn(async move {
            for number in (client..requests).step_by(clients) {
                let started = Instant::now();
                if connection.call(&tally, &calls[number % calls.len()]).await {
                    latencies.record([started.elapsed()]);
                }
            }
        });
    }
    tasks.join_all().await;
    let path = paths.into_iter().next().unwrap_or_default();
    Line { read, path, different: calls.len(), first: first.spread(), latency: latencies.spread() }
}
