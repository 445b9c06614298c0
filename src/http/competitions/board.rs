//! `GET /api/v1/competitions/{id}/board`.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use jiff::Timestamp;
use serde::{Deserialize, Serialize, Serializer};
use swarmbench_analysis::Definition as MetricDefinition;
use utoipa::IntoParams;

use super::super::boards::Format;
use super::super::boards::metrics::{Means, of_tasks, wanted_metrics};
use super::super::cache::Cached;
use super::super::extract::one_of;
use super::super::page::{cursor_by, page_limit};
use super::super::prelude::*;
use super::super::ranking::Ranking;
use crate::competitions::StoredCompetition;
use crate::competitions::standings::EntrantAttempts;
use crate::measure::method;
use crate::store::metrics::BoardMetric;
use swarmbench_boards::competition::definition::Definition;
use swarmbench_boards::competition::phase::{BoardView, board_view};
use swarmbench_boards::competition::shown;
use swarmbench_boards::competition::standings::{Part, standings_of};
use swarmbench_protocol::competition::{CompetitionBoard, CompetitionRow};
use swarmbench_protocol::failure::Failures;
use swarmbench_protocol::table::{Table, maybe, text as safe_cell};

/// Maximum rows of a page that is written on the async thread: less than a millisecond.
const ROWS_INLINE_MAX: usize = 100;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct BoardParams {
    /// Metrics that are shown for each task: names separated by commas, 16 at most. While seeds are sealed only organizers and judges see
    /// them.
    metrics: Option<String>,
    /// Category of the competition: only its entrants are shown, ranked among themselves.
    category: Option<String>,
    /// Part of the board: `public` (from the public seeds) or `final` (from all others). Before the end only organizers and
    /// judges see the final part, which is their default.
    part: Option<String>,
    /// Format: `json` or `csv`.
    #[param(example = "json")]
    format: Option<String>,
    /// Maximum number of rows, up to 1,000; as many as fit into one answer by default.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Cursor: the `next_cursor` of the previous page.
    cursor: Option<String>,
}

/// Show the board of a competition, as JSON or CSV.
///
/// While seeds are sealed, the board shows ranks and totals, or nothing, as the organizer decided; organizers and judges see all of it at
/// any time. A planned game that was not played counts as 0; a voided game does not count. All pages except the last name the
/// next one in `next_cursor` and in the header `X-Next-Cursor`.
#[utoipa::path(
    get,
    path = "/api/v1/competitions/{id}/board",
    operation_id = "show_board",
    tag = "competitions",
    params(BoardParams),
    responses(
        (status = 200, description = "The board", content(
            (CompetitionBoard = "application/json"),
            (String = "text/csv"),
        )),
        (status = 403, description = "`forbidden`: the final part before the end"),
    )
)]
pub(in super::super) async fn show_board(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<BoardParams>,
) -> Result<Response, ApiError> {
    let format = Format::named(params.format.as_deref())?.unwrap_or(Format::Json);
    let limit = match params.limit {
        None => usize::MAX,
        asked => page_limit(&app, asked, 0)? as usize,
    };
    let after = cursor_by(params.cursor.as_deref(), read_cursor)?;
    let metrics = params.metrics.as_deref().map_or(Ok(Vec::new()), wanted_metrics)?;
    let competition = app.competition(&caller, &id).await?;
    let category = params.category;
    if category.is_some()
        && let Some(problem) = competition.definition.category_problem(category.as_deref())
    {
        return Err(ApiError::new(Code::Malformed, format!("category {problem}")));
    }
    one_of("part", params.part.as_deref(), &Part::ALL.map(Part::name))?;
    let is_revealed = competition.revealed_at.is_some();
    let view = if caller.reads_all() {
        BoardView::All
    } else {
        board_view(&competition.definition, is_revealed, app.clock.wall())
    };
    let part = match (view, params.part.as_deref().and_then(Part::parse)) {
        (BoardView::All, asked) => asked.unwrap_or(Part::Final),
        (_, Some(Part::Final)) if competition.definition.public_seeds > 0 => {
            let detail = "the final part of the board is shown once the competition is closed";
            return Err(ApiError::new(Code::Forbidden, detail));
        }
        _ => Part::Public,
    };
    let (part, part_name) = match competition.definition.public_seeds {
        // Both parts are the same, and are ranked once.
        0 => (Part::Final, "all"),
        _ => (part, part.name()),
    };
    let (shows, before) = match view {
        BoardView::Nothing => ("nothing", None),
        BoardView::Totals => ("totals", None),
        BoardView::TotalsBefore(at) => ("totals", Some(at)),
        BoardView::All => ("all", None),
    };
    let start = Start { limit, after };
    // Metrics are measured after the end of a game, so their count is a part of the cache key.
    let measured = (!metrics.is_empty()).then(|| app.store.writer().changes().measured());
    let what = (part, category.clone());
    let question =
        format!("board of {id}: {view:?} {what:?} {start:?} {format:?} {metrics:?} {measured:?}");
    let bytes_max = app.limits.answer_bytes_max;
    let ranked = match view {
        BoardView::Nothing => Arc::new(Cached { of: app.rankings.results(), what: Arc::default() }),
        BoardView::Totals | BoardView::TotalsBefore(_) | BoardView::All => {
            app.ranking(competition, view, before, what).await?
        }
    };
    let of = ranked.of;
    let make = async {
        let first = ranked.what.after(start.after.as_ref());
        let means = match view {
            BoardView::All if !metrics.is_empty() => {
                let shown = ranked.what.rows.iter().skip(first).take(start.limit);
                let runs: Vec<String> = shown.filter_map(|row| row.run.clone()).collect();
                app.store.mean_metrics(&runs, &metrics).await?
            }
            _ => Means::new(),
        };
        let write = move || {
            let page = |limit| {
                let page = Shown::page(&ranked.what, (shows, before), first, limit);
                let page = page.of(part_name, category.clone());
                if view == BoardView::All { page.with_metrics(&metrics, &means) } else { page }
            };
            format.page(bytes_max, start.limit, page)
        };
        // A short page takes less time than the wait for a worker thread.
        if start.limit <= ROWS_INLINE_MAX { Ok(write()) } else { app.heavy.render(write).await }
    };
    app.answers.answer_of(question, of, Box::pin(make)).await
}

/// Requested page.
#[derive(Debug)]
struct Start {
    limit: usize,
    /// Last entrant of the previous page, and the number of rows up to it.
    after: Option<(String, usize)>,
}

/// Cursor: the number of rows up to the end of the page, and the entrant of its last row.
fn write_cursor(rows: usize, entrant: &str) -> String {
    format!("c{rows:x}-{entrant}")
}

fn read_cursor(text: &str) -> Option<(String, usize)> {
    let (rows, entrant) = text.strip_prefix('c')?.split_once('-')?;
    Some((entrant.to_owned(), usize::from_str_radix(rows, 16).ok()?))
}

impl App {
    /// Ranking of a competition in one view. All pages and both formats are made from it.
    async fn ranking(
        &self,
        competition: StoredCompetition,
        view: BoardView,
        before: Option<Timestamp>,
        (part, category): (Part, Option<String>),
    ) -> Result<Arc<Cached<Arc<Ranking>>>, ApiError> {
        let question = format!("{}: {view:?} {part:?} {category:?}", competition.id);
        let (app, competition) = (self.clone(), Arc::new(competition));
        let make = move |known: Option<Arc<Cached<Arc<Ranking>>>>| {
            let (app, competition) = (app.clone(), Arc::clone(&competition));
            let category = category.clone();
            async move {
                let of = app.rankings.results();
                let known = known.map(|known| Arc::clone(&known.what));
                let version = known.as_ref().map(|known| known.version);
                let found = app.competitions.places(&competition, part, before, version).await?;
                let what = match (found, known) {
                    (None, Some(known)) => known,
                    (found, _) => {
                        let (version, mut places) = found.unwrap_or_default();
                        if category.is_some() {
                            places.retain(|(entrant, _)| entrant.category == category);
                        }
                        let with_tasks = view == BoardView::All;
                        let rank = move || {
                            let rows = ranking(&competition.definition, &places, with_tasks);
                            Arc::new(Ranking::new(rows, version))
                        };
                        app.heavy.render(rank).await?
                    }
                };
                Ok(Cached { of, what })
            }
        };
        let stopped = self.stop.clone().cancelled_owned();
        self.rankings.followed_entry(question, make, stopped).await
    }
}

/// Rows of a board, with or without the results by task.
fn ranking(
    definition: &Definition,
    places: &[EntrantAttempts],
    with_tasks: bool,
) -> Vec<CompetitionRow> {
    let places: Vec<_> = places.iter().map(|(entrant, played)| (&**entrant, &**played)).collect();
    let entrants: HashMap<_, _> =
        places.iter().map(|(entrant, _)| (entrant.id.as_str(), *entrant)).collect();
    let rows = standings_of(definition, &places);
    let rows = rows.iter().filter_map(|row| {
        let entrant = entrants.get(row.row.entrant.as_str())?;
        Some(shown::row(row, entrant, with_tasks))
    });
    rows.collect()
}

/// Page of a board.
struct Shown<'a> {
    board: CompetitionBoard,
    /// Tasks of the whole board: CSV has the same columns on all pages.
    tasks: &'a [String],
}

impl<'a> Shown<'a> {
    fn page(
        ranking: &'a Ranking,
        (shows, frozen_at): (&str, Option<Timestamp>),
        start: usize,
        limit: usize,
    ) -> Self {
        let end = ranking.rows.len().min(start.saturating_add(limit));
        let items = ranking.rows[start..end].to_vec();
        let last = items.last().filter(|_| end < ranking.rows.len());
        let next_cursor = last.map(|row| write_cursor(end, &row.entrant.id));
        let board = CompetitionBoard {
            shows: shows.to_owned(),
            frozen_at: frozen_at.map(Into::into),
            part: String::new(),
            category: None,
            metrics: Vec::new(),
            metrics_method: None,
            items,
            next_cursor,
        };
        Self { board, tasks: &ranking.tasks }
    }

    fn of(mut self, part: &str, category: Option<String>) -> Self {
        part.clone_into(&mut self.board.part);
        self.board.category = category;
        self
    }

    /// Adds metrics to the rows with a counting attempt.
    fn with_metrics(mut self, metrics: &[BoardMetric], means: &Means) -> Self {
        if !metrics.is_empty() {
            self.board.metrics = metrics.iter().map(|metric| metric.name().to_owned()).collect();
            self.board.metrics_method = Some(method(MetricDefinition::Paper));
            for row in &mut self.board.items {
                row.metrics = row
                    .run
                    .as_ref()
                    .map_or_else(BTreeMap::new, |run| of_tasks(run, self.tasks, metrics, means));
            }
        }
        self
    }
}

impl Serialize for Shown<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.board.serialize(serializer)
    }
}

/// CSV has separate columns for each task.
impl Table for Shown<'_> {
    type Row = CompetitionRow;

    const LINES_END: csv::Terminator = csv::Terminator::Any(b'\n');

    fn rows(&self) -> &[CompetitionRow] {
        &self.board.items
    }

    fn next_cursor(&self) -> Option<&str> {
        self.board.next_cursor.as_deref()
    }

    fn columns(&self) -> Vec<String> {
        let declared = ["rank", "entrant", "name", "model", "temperature", "top_p"];
        let status = ["prompt_template", "status", "reason", "vouched", "decentralization"];
        let runs = ["attempt", "run", "run_status", "total"];
        let last =
            ["invalid_share", "timeout_share", "voided_games", "attempts", "voided_attempts"];
        let below = [
            "difference",
            "difference_low",
            "difference_high",
            "difference_pairs",
            "difference_to",
        ];
        let own = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        let task = |task: &String| {
            ["mean", "deviation", "games", "planned"].map(|column| format!("{task}_{column}"))
        };
        let tasks = self.tasks.iter().flat_map(task).collect();
        let metrics = self.tasks.iter().flat_map(|task| {
            self.board.metrics.iter().map(move |metric| format!("{task}_{metric}"))
        });
        let metrics = metrics.collect();
        let failures = Failures::columns().collect();
        [
            own(&declared),
            own(&status),
            own(&runs),
            tasks,
            own(&last),
            own(&below),
            own(&["prompt"]),
            failures,
            own(&["category", "on_spare_seeds"]),
            metrics,
        ]
        .concat()
    }

    fn record(&self, _: &[String], row: &CompetitionRow) -> Vec<String> {
        let of_metrics = self.tasks.iter().flat_map(|task| {
            let of = row.metrics.get(task);
            self.board.metrics.iter().map(move |metric| maybe(of.and_then(|of| *of.get(metric)?)))
        });
        let mut cells = cells(row, self.tasks);
        cells.push(row.entrant.prompt.clone());
        cells.extend(row.failures.cells());
        cells.push(safe_cell(row.entrant.category.as_deref().unwrap_or_default()));
        cells.push(row.on_spare_seeds.to_string());
        cells.extend(of_metrics);
        cells
    }
}

fn cells(row: &CompetitionRow, tasks: &[String]) -> Vec<String> {
    fn text<T: ToString>(value: Option<T>) -> String {
        value.map_or_else(String::new, |value| value.to_string())
    }
    let entrant = &row.entrant;
    let mut cells = vec![
        text(row.rank),
        entrant.id.clone(),
        safe_cell(&entrant.name),
        safe_cell(&entrant.model),
        text(entrant.temperature),
        text(entrant.top_p),
        text(entrant.prompt_template.clone()),
        entrant.status.clone(),
        safe_cell(entrant.reason.as_deref().unwrap_or_default()),
        entrant.vouched.to_string(),
        text(row.decentralization.clone()),
        text(row.attempt),
        text(row.run.clone()),
        text(row.run_status.clone()),
        text(row.total),
    ];
    for name in tasks {
        let task = row.tasks.iter().find(|task| task.task == *name);
        cells.extend([
            text(task.and_then(|task| task.mean)),
            text(task.and_then(|task| task.deviation)),
            text(task.map(|task| task.games)),
            text(task.map(|task| task.planned)),
        ]);
    }
    cells.extend([
        row.invalid_share.to_string(),
        row.timeout_share.to_string(),
        row.voided_games.to_string(),
        row.attempts.to_string(),
        row.voided_attempts.to_string(),
    ]);
    let difference = row.difference.as_ref();
    cells.extend([
        text(difference.map(|difference| difference.mean)),
        text(difference.and_then(|difference| difference.low)),
        text(difference.and_then(|difference| difference.high)),
        text(difference.map(|difference| difference.pairs)),
        text(difference.map(|difference| difference.to.clone())),
    ]);
    cells
}
