//! All boards of a database: ended runs, grouped by comparability.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::sync::Arc;

use swarmbench_engine::{RuleSet, TaskName};
use swarmbench_protocol::import::KnownSettings;

use super::interval::Difference;
use super::rank::{Pick, PlayerRuns, RankedRow, View, difference_above, rank_players};
use super::reference::{self, Table};
use super::result::RunResult;
use super::{RowId, Slot, scale};

/// Identity of a board. Runs are comparable if they have the same suite and rules; the digest covers every setting.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BoardId {
    /// Name of the suite.
    pub suite: String,
    /// Rule set.
    pub rules: String,
    /// Digest of the suite.
    pub digest: String,
}

/// Games of a board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoardSuite {
    /// Tasks of the suite, in its order.
    pub tasks: Vec<TaskName>,
    /// Games of the suite.
    pub plan: Vec<Slot>,
    /// Settings that the games share, except clocks.
    pub settings: KnownSettings,
}

/// A game read from files, unverified.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// Model, according to the files.
    pub model: String,
    /// Task and seed.
    pub slot: Slot,
    /// Final score.
    pub score: f64,
    /// Settings as far as the files contain them.
    pub settings: KnownSettings,
}

/// Comparable runs.
#[derive(Clone, Debug, Default)]
struct Board {
    suite: BoardSuite,
    players: BTreeMap<RowId, Arc<PlayerRuns>>,
    /// True if the suite is one of the program's own.
    is_built_in: bool,
}

/// An ended run.
#[derive(Clone, Debug)]
pub struct FinishedRun {
    /// Number in the database.
    pub key: i64,
    /// Board that lists the run.
    pub board: BoardId,
    /// Games of the board.
    pub suite: BoardSuite,
    /// Result of the run.
    pub result: RunResult,
}

/// Position of a run among the boards.
#[derive(Clone, Debug)]
struct Home {
    board: Arc<BoardId>,
    row: RowId,
    run: Arc<str>,
}

/// All boards of a database.
#[derive(Clone, Debug, Default)]
pub struct Boards {
    by_id: BTreeMap<BoardId, Arc<Board>>,
    /// Positions of the runs, by their numbers in the database.
    homes: BTreeMap<i64, Home>,
    imported: Arc<[Imported]>,
}

/// Unvalidated query of a board.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Question {
    /// Suite: a name, or a name and a digest joined by `@`. Default: `standard`.
    pub suite: Option<String>,
    /// Rule set. Default: `paper`.
    pub rules: Option<String>,
    /// Restriction to one task.
    pub task: Option<String>,
    /// `total`, or the task by whose mean rows are ranked.
    pub sort: Option<String>,
    /// `best`, `last` or `mean`.
    pub pick: Option<String>,
    /// True if the rows of the paper are left out.
    pub no_reference: bool,
    /// True if the rows of people are left out.
    pub no_people: bool,
    /// True if games read from files are shown, too.
    pub imported: bool,
}

/// A refused question: the field and its allowed values.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} must be {allowed}")]
pub struct Unknown {
    /// Name of the field.
    pub field: &'static str,
    /// Allowed values.
    pub allowed: String,
}

/// A board in order.
#[derive(Clone, Debug)]
pub struct Ranked {
    /// Identity of the board.
    pub board: BoardId,
    /// View of the board.
    pub view: View,
    /// The only task that is shown, if there is one.
    pub task: Option<TaskName>,
    /// All rows, highest first.
    pub rows: Vec<RankedRow>,
}

/// Default suite.
const SUITE: &str = "standard";

/// Maximum suites that a refusal names.
const NAMED: usize = 20;

impl Boards {
    /// The boards of the built-in suites, without runs.
    #[must_use]
    pub fn new(built_in: impl IntoIterator<Item = (BoardId, BoardSuite)>) -> Self {
        let board = |(id, suite)| {
            (id, Arc::new(Board { suite, players: BTreeMap::new(), is_built_in: true }))
        };
        Self { by_id: built_in.into_iter().map(board).collect(), ..Self::default() }
    }

    /// Replaces the games read from files.
    pub fn set_imported(&mut self, games: Vec<Imported>) {
        self.imported = games.into();
    }

    /// Adds a run, replacing an earlier state of it.
    pub fn insert(&mut self, run: FinishedRun) {
        let FinishedRun { key, board: id, suite, result } = run;
        self.remove(key);
        let (row, run) = (result.row, result.run.id.as_str().into());
        let board = self.by_id.entry(id.clone()).or_default();
        let board = Arc::make_mut(board);
        board.suite = suite;
        let player = board.players.entry(row).or_default();
        Arc::make_mut(player).insert(Arc::new(result));
        self.homes.insert(key, Home { board: Arc::new(id), row, run });
    }

    /// Removes a run, if present.
    pub fn remove(&mut self, key: i64) {
        let Some(Home { board: id, row, run }) = self.homes.remove(&key) else { return };
        let Some(board) = self.by_id.get_mut(&id) else { return };
        let board = Arc::make_mut(board);
        if let Some(player) = board.players.get_mut(&row) {
            let player = Arc::make_mut(player);
            player.remove(&run);
            if player.is_empty() {
                board.players.remove(&row);
            }
        }
        if board.players.is_empty() && !board.is_built_in {
            self.by_id.remove(&*id);
        }
    }

    /// Number of runs.
    #[must_use]
    pub fn runs(&self) -> usize {
        self.homes.len()
    }

    /// The requested board in order.
    ///
    /// # Errors
    /// If the board, task, order or choice does not exist.
    pub fn ranked(&self, question: &Question) -> Result<Ranked, Unknown> {
        let (id, board) = self.find(question)?;
        let task = task_of(&board.suite.tasks, "task", question.task.as_deref())?;
        let tasks = task.map_or_else(|| board.suite.tasks.clone(), |task| vec![task]);
        let sort = match question.sort.as_deref() {
            None | Some("total") => None,
            Some(name) => {
                task_of(&tasks, "sort", Some(name)).map_err(|Unknown { field, allowed }| {
                    let allowed = allowed.replacen("one of ", "one of total, ", 1);
                    Unknown { field, allowed }
                })?
            }
        };
        let pick = match question.pick.as_deref() {
            None => Pick::default(),
            Some(name) => Pick::parse(name).ok_or_else(|| Unknown {
                field: "pick",
                allowed: one_of(Pick::ALL.into_iter().map(Pick::name)),
            })?,
        };
        // Players without games in the selection are omitted.
        let shows =
            |row: &&reference::Reference| tasks.iter().any(|task| row.task(*task).is_some());
        let has_reference = board.is_built_in && !question.no_reference;
        let references = reference::rows(&id.suite, &id.rules);
        let references = references.filter(|_| has_reference).filter(shows);
        let references = references.filter(|row| !question.no_people || row.table != Table::Humans);
        let view = View { tasks: tasks.clone(), sort, pick };
        let is_shown = |player: &&PlayerRuns| !question.no_people || !player.is_human();
        let players = board.players.values().map(|player| &**player).filter(is_shown);
        let imported = if question.imported { self.imported_to(id, board) } else { Vec::new() };
        let rows = rank_players(players, imported, references, &view);
        Ok(Ranked { board: id.clone(), view, task, rows })
    }

    /// Games from files that belong to this board's suite, by model. A missing game does not count as 0, as it may have been played
    /// elsewhere.
    fn imported_to(&self, id: &BoardId, board: &Board) -> Vec<(Arc<RunResult>, String)> {
        let mut models: BTreeMap<(&str, &str), Vec<&Imported>> = BTreeMap::new();
        let plan: BTreeSet<Slot> = board.suite.plan.iter().copied().collect();
        let fitting = self.imported.iter().filter(|game| {
            plan.contains(&game.slot) && game.settings.agrees(&board.suite.settings)
        });
        for game in fitting {
            let rules = game.settings.rules.as_deref().unwrap_or(scale::OF_TOOLKIT);
            models.entry((&game.model, rules)).or_default().push(game);
        }
        let result = |((model, rules), games): ((&str, &str), Vec<&Imported>)| {
            let games = games.into_iter().map(|game| {
                let factor = scale::factor(game.slot.task, rules, &id.rules);
                (game.slot, game.score * factor.unwrap_or(1.0))
            });
            let mut result = RunResult::imported(model, &board.suite.plan, games);
            if rules != id.rules {
                result.row = RowId::of(&[b"imported", model.as_bytes(), rules.as_bytes()]);
            }
            (Arc::new(result), rules.to_owned())
        };
        models.into_iter().map(result).collect()
    }

    fn find(&self, question: &Question) -> Result<(&BoardId, &Board), Unknown> {
        let rules = question.rules.as_deref().map_or(Some(RuleSet::Paper), RuleSet::find);
        let Some(rules) = rules.map(RuleSet::name) else {
            return Err(Unknown {
                field: "rules",
                allowed: one_of(RuleSet::ALL.map(RuleSet::name)),
            });
        };
        let asked = question.suite.as_deref().unwrap_or(SUITE);
        let of_rules = || self.by_id.iter().filter(|(id, _)| id.rules == rules);
        let named: Vec<_> = of_rules().filter(|(id, _)| id.suite == asked).collect();
        // The name itself may contain an `@`.
        let exact = || of_rules().find(|(id, _)| format!("{}@{}", id.suite, id.digest) == asked);
        // A custom suite of that name does not replace a built-in board.
        let built_in = named.iter().find(|(_, board)| board.is_built_in);
        match (built_in, &named[..]) {
            (Some((id, board)), _) | (None, [(id, board)]) => Ok((id, board)),
            (None, []) => exact().map(|(id, board)| (id, &**board)).ok_or_else(|| {
                let mut names: Vec<&str> = of_rules().map(|(id, _)| id.suite.as_str()).collect();
                names.dedup();
                let mut allowed = one_of(names);
                if asked.contains(',') {
                    allowed += ": a board has one suite, and commas are a part of its name";
                }
                Unknown { field: "suite", allowed }
            }),
            (None, [..]) => {
                let names = named.iter().map(|(id, _)| format!("{}@{}", id.suite, id.digest));
                let allowed = one_of(names);
                Err(Unknown {
                    field: "suite",
                    allowed: format!("{allowed}: there are several suites of that name"),
                })
            }
        }
    }
}

fn task_of(
    tasks: &[TaskName],
    field: &'static str,
    name: Option<&str>,
) -> Result<Option<TaskName>, Unknown> {
    let Some(name) = name else { return Ok(None) };
    let found = TaskName::find(name).filter(|task| tasks.contains(task));
    found
        .map(Some)
        .ok_or_else(|| Unknown { field, allowed: one_of(tasks.iter().map(|task| task.name())) })
}

/// Text that lists the choices.
fn one_of<T: AsRef<str>>(names: impl IntoIterator<Item = T>) -> String {
    let mut text = "one of ".to_owned();
    let mut more: usize = 0;
    for (place, name) in names.into_iter().enumerate() {
        if place >= NAMED {
            more += 1;
            continue;
        }
        let comma = if place == 0 { "" } else { ", " };
        // Names come from clients and may be long.
        let name: String = name.as_ref().chars().take(80).collect();
        _ = if name.contains(',') {
            write!(text, "{comma}{name:?}")
        } else {
            write!(text, "{comma}{name}")
        };
    }
    if more > 0 {
        _ = write!(text, " and {more} more");
    }
    text
}

impl Ranked {
    /// Lead of the nearest row above that has games over the row at this place, and that row. The paper's rows have no games, so
    /// they are skipped.
    #[must_use]
    pub fn difference(&self, place: usize) -> Option<(&RankedRow, Difference)> {
        difference_above(&self.rows, place, self.view.ranked_by())
    }

    /// Index of the row after this one, or of the first row for `None`. `place` is used if the row has left the board.
    #[must_use]
    pub fn after(&self, row: Option<(RowId, usize)>) -> usize {
        let Some((row, place)) = row else { return 0 };
        let found = self.rows.iter().position(|known| known.id() == row);
        found.map_or(place, |found| found + 1).min(self.rows.len())
    }
}
