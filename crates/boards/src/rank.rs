//! Grouping of runs into rows, and ranks of rows.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use swarmbench_engine::TaskName;

use super::RowId;
use super::interval::{Difference, difference};
use super::reference::{self, Reference};
use super::result::RunResult;

swarmbench_engine::named! {
    /// Choice of a player's run for its row.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub enum Pick {
        /// The highest ranked run; of equal ones the first.
        #[default]
        Best = "best",
        /// The run that was started last.
        Last = "last",
        /// All runs: a seed's score is its mean over them.
        Mean = "mean",
    }
}

/// Tasks and order of a board.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct View {
    /// Shown tasks.
    pub tasks: Vec<TaskName>,
    /// Task by whose mean rows are ranked; `None` for the total of the shown tasks.
    pub sort: Option<TaskName>,
    /// Choice of a player's run.
    pub pick: Pick,
}

impl View {
    /// Tasks whose means are summed for the rank.
    #[must_use]
    pub fn ranked_by(&self) -> &[TaskName] {
        self.sort.as_ref().map_or(&self.tasks, std::slice::from_ref)
    }

    /// Order of two runs by rank: `Less` if `a` ranks higher.
    #[must_use]
    pub fn compare(&self, a: &RunResult, b: &RunResult) -> Ordering {
        let value = |run: &RunResult| Value::of(run.total(self.ranked_by()));
        value(a).cmp(&value(b))
    }
}

/// A row of a board.
#[derive(Clone, Debug)]
pub struct RankedRow {
    /// Rank with gaps, such as 1, 2, 2, 4: equal values share a rank, which is one more than the number of better rows. `None`
    /// without a value.
    pub rank: Option<u32>,
    /// Value that decides the rank, if no mean is missing.
    pub value: Option<f64>,
    /// Origin and content of the row.
    pub source: Source,
}

/// Origin of a row.
#[derive(Clone, Debug)]
pub enum Source {
    /// Runs of one player.
    Runs {
        /// Result that is shown: one run, or all of them combined.
        shown: Arc<RunResult>,
        /// Number of the player's runs on this board.
        runs: usize,
    },
    /// Games of one model read from files, at the scale of the board, and the rules by which they were played.
    Imported(Arc<RunResult>, String),
    /// A row of the paper.
    Reference(&'static Reference),
}

impl RankedRow {
    /// Id of the row.
    #[must_use]
    pub fn id(&self) -> RowId {
        match &self.source {
            Source::Runs { shown, .. } | Source::Imported(shown, _) => shown.row,
            Source::Reference(reference) => reference.id,
        }
    }

    /// Result that is shown, if it was played here.
    #[must_use]
    pub fn shown(&self) -> Option<&Arc<RunResult>> {
        match &self.source {
            Source::Runs { shown, .. } => Some(shown),
            Source::Imported(..) | Source::Reference(_) => None,
        }
    }

    /// Sum of the means of these tasks, if none is missing.
    #[must_use]
    pub fn total(&self, tasks: &[TaskName]) -> Option<f64> {
        match &self.source {
            Source::Runs { shown, .. } | Source::Imported(shown, _) => shown.total(tasks),
            Source::Reference(reference) => reference.total(tasks),
        }
    }

    /// Rules by which the row was played, on a board with the rules `board`.
    #[must_use]
    pub fn rules<'a>(&'a self, board: &'a str) -> &'a str {
        match &self.source {
            Source::Runs { .. } => board,
            Source::Imported(_, rules) => rules,
            Source::Reference(_) => reference::RULES,
        }
    }

    fn name(&self) -> &str {
        match &self.source {
            Source::Runs { shown, .. } | Source::Imported(shown, _) => &shown.run.player.model,
            Source::Reference(reference) => &reference.name,
        }
    }
}

/// Runs of one player.
#[derive(Clone, Debug, Default)]
pub struct PlayerRuns {
    /// Runs in the order of their starts.
    runs: Vec<Arc<RunResult>>,
    /// All runs combined, computed on the first request.
    together: OnceLock<Arc<RunResult>>,
}

impl PlayerRuns {
    /// True if people played one of the runs.
    #[must_use]
    pub fn is_human(&self) -> bool {
        self.runs.iter().any(|run| run.run.is_human)
    }

    /// Adds a run.
    pub fn insert(&mut self, run: Arc<RunResult>) {
        let order = |run: &RunResult| (run.run.created_at, run.run.id.clone());
        let place = self.runs.partition_point(|earlier| order(earlier) < order(&run));
        self.runs.insert(place, run);
        self.together.take();
    }

    /// Removes a run.
    pub fn remove(&mut self, id: &str) {
        self.runs.retain(|run| run.run.id != id);
        self.together.take();
    }

    /// True if no runs are left.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Source of the player's row, if there are runs.
    fn pick(&self, view: &View) -> Option<Source> {
        let last = self.runs.last()?;
        let shown = match view.pick {
            _ if self.runs.len() == 1 => last,
            Pick::Best => self.runs.iter().min_by(|a, b| view.compare(a, b))?,
            Pick::Last => last,
            Pick::Mean => self.together.get_or_init(|| {
                let runs: Vec<&RunResult> = self.runs.iter().map(|run| &**run).collect();
                RunResult::together(&runs).map_or_else(|| Arc::clone(last), Arc::new)
            }),
        };
        Some(Source::Runs { shown: Arc::clone(shown), runs: self.runs.len() })
    }
}

/// Rows of a board, highest first.
#[must_use]
pub fn rank(
    runs: &[Arc<RunResult>],
    references: impl IntoIterator<Item = &'static Reference>,
    view: &View,
) -> Vec<RankedRow> {
    let mut players: BTreeMap<RowId, PlayerRuns> = BTreeMap::new();
    for run in runs {
        players.entry(run.row).or_default().insert(Arc::clone(run));
    }
    rank_players(players.values(), Vec::new(), references, view)
}

/// [`rank`], for runs grouped by player, and with games from files.
#[must_use]
pub fn rank_players<'a>(
    players: impl IntoIterator<Item = &'a PlayerRuns>,
    imported: Vec<(Arc<RunResult>, String)>,
    references: impl IntoIterator<Item = &'static Reference>,
    view: &View,
) -> Vec<RankedRow> {
    let sources = players.into_iter().filter_map(|player| player.pick(view));
    let imported = imported.into_iter().map(|(shown, rules)| Source::Imported(shown, rules));
    let references = references.into_iter().map(Source::Reference);
    let mut rows: Vec<RankedRow> = (sources.chain(imported).chain(references))
        .map(|source| {
            let mut row = RankedRow { rank: None, value: None, source };
            row.value = row.total(view.ranked_by());
            row
        })
        .collect();
    rows.sort_by_cached_key(|row| {
        let is_elsewhere = row.shown().is_none();
        (Value::of(row.value), is_elsewhere, row.name().to_owned(), row.id())
    });
    let mut above: Option<(Value, u32)> = None;
    for (place, row) in (1..).zip(&mut rows) {
        let value = Value::of(row.value);
        if row.value.is_some() {
            let rank = above.filter(|&(same, _)| same == value).map_or(place, |(_, rank)| rank);
            above = Some((value, rank));
            row.rank = Some(rank);
        }
    }
    rows
}

/// Lead of the nearest row above that was played here over the row at this place, and that row.
#[must_use]
pub fn difference_above<'a>(
    rows: &'a [RankedRow],
    place: usize,
    tasks: &[TaskName],
) -> Option<(&'a RankedRow, Difference)> {
    let shown = rows.get(place)?.shown()?;
    let mut above = rows[..place].iter().rev();
    let (row, above) = above.find_map(|row| row.shown().map(|run| (row, run)))?;
    Some((row, difference(above, shown, tasks)?))
}

/// Value by which rows are ranked: highest first, missing values last. Values that differ by less than the rounding errors of sums
/// are equal: 0.1 + 0.2 is no better than 0.3.
#[derive(Clone, Copy, Debug)]
struct Value(Option<f64>);

impl Value {
    fn of(value: Option<f64>) -> Self {
        Self(value.map(|value| (value * 1e9).round() + 0.0))
    }
}

impl PartialEq for Value {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Value {}

impl PartialOrd for Value {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Value {
    fn cmp(&self, other: &Self) -> Ordering {
        match (self.0, other.0) {
            (Some(a), Some(b)) => b.total_cmp(&a),
            (a, b) => b.is_some().cmp(&a.is_some()),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use jiff::Timestamp;
    use proptest::prelude::*;

    use super::super::reference::REFERENCES;
    use super::super::result::TaskResult;
    use super::super::{Decentralization, EndedGame, Owner, PlayedRun, Player, Slot};
    use super::*;
    use swarmbench_engine::Seed;
    use swarmbench_journal::Tally;
    use swarmbench_prompt::Identity;

    pub(in super::super) fn player(model: &str) -> Player {
        Player {
            owner: Some(Owner { id: "key_1".to_owned(), name: "alice".to_owned() }),
            model: model.to_owned(),
            temperature: Some(1.0),
            top_p: None,
            sampling: None,
            prompt: Identity::default(),
            holders: Vec::new(),
        }
    }

    pub(in super::super) fn run(id: &str, status: &str, second: i64) -> PlayedRun {
        PlayedRun {
            id: id.to_owned(),
            player: player("a model"),
            status: status.to_owned(),
            created_at: Timestamp::from_second(second).expect("a time"),
            vouched: true,
            decentralization: Some(Decentralization::Declared),
            is_human: false,
            prompt: None,
            answer_reader: None,
        }
    }

    pub(in super::super) fn slots(tasks: &[TaskName], seeds: &[u32]) -> Vec<Slot> {
        let of = |&task| seeds.iter().map(move |&seed| Slot { task, seed: seed.into() });
        tasks.iter().flat_map(of).collect()
    }

    pub(in super::super) fn game(task: TaskName, seed: impl Into<Seed>, score: f64) -> EndedGame {
        EndedGame {
            slot: Slot { task, seed: seed.into() },
            score,
            tally: Tally {
                acts: 10,
                invalid: 1,
                timeouts: 2,
                prompt_tokens: 1000,
                completion_tokens: 50,
                ..Tally::default()
            },
            voided: false,
        }
    }

    const TASKS: [TaskName; 2] = [TaskName::Pursuit, TaskName::Flocking];

    fn view(pick: Pick) -> View {
        View { tasks: TASKS.to_vec(), sort: None, pick }
    }

    /// A finished run with scores of both tasks on two seeds.
    fn played(model: &str, id: &str, second: i64, scores: [f64; 4]) -> Arc<RunResult> {
        let run = PlayedRun { player: player(model), ..run(id, "finished", second) };
        let plan = slots(&TASKS, &[1, 2]);
        let games = plan.iter().zip(scores).map(|(slot, score)| game(slot.task, slot.seed, score));
        Arc::new(RunResult::new(run, &plan, &games.collect::<Vec<_>>(), true))
    }

    fn shown(rows: &[RankedRow]) -> Vec<(Option<u32>, String, Option<f64>)> {
        rows.iter().map(|row| (row.rank, row.name().to_owned(), row.value)).collect()
    }

    #[test]
    fn rows_of_the_same_value_share_a_rank() {
        let runs = [
            played("d", "4", 0, [1.0, 1.0, 1.0, 1.0]),
            played("b", "2", 0, [0.1, 0.1, 0.2, 0.2]),
            played("c", "3", 0, [0.3, 0.3, 0.0, 0.0]),
            played("e", "5", 0, [0.0; 4]),
        ];
        let ranks: Vec<_> = shown(&rank(&runs, [], &view(Pick::Best)))
            .into_iter()
            .map(|(rank, name, _)| (rank.expect("a rank"), name))
            .collect();
        // As floats, 0.1 + 0.2 is not 0.3.
        let expected = [(1, "d"), (2, "b"), (2, "c"), (4, "e")];
        assert_eq!(ranks, expected.map(|(rank, name)| (rank, name.to_owned())));
    }

    #[test]
    fn best_last_and_mean_are_what_they_say() {
        let runs = [
            played("a", "first", 1, [1.0, 1.0, 0.0, 0.0]),
            played("a", "second", 2, [6.0, 6.0, 2.0, 4.0]),
            played("a", "third", 3, [2.0, 2.0, 1.0, 5.0]),
        ];
        let of = |pick| match rank(&runs, [], &view(pick)).remove(0) {
            RankedRow { source: Source::Runs { shown, runs }, value, .. } => {
                (shown.run.id.clone(), runs, value)
            }
            row => panic!("{row:?}"),
        };
        assert_eq!(of(Pick::Best), ("second".to_owned(), 3, Some(9.0)));
        assert_eq!(of(Pick::Last), ("third".to_owned(), 3, Some(5.0)));
        assert_eq!(of(Pick::Mean), ("third".to_owned(), 3, Some(5.0)));
    }

    #[test]
    fn players_are_told_apart_by_all_that_they_declare() {
        let same = player("a");
        let with = |prompt| Player { prompt, ..same.clone() };
        let others = [
            player("b"),
            Player { owner: None, ..same.clone() },
            Player {
                owner: Some(Owner { id: "key_2".into(), name: "alice".into() }),
                ..same.clone()
            },
            Player { temperature: None, ..same.clone() },
            Player { sampling: Some("effort low".to_owned()), ..same.clone() },
            Player { top_p: Some(1.0), temperature: None, ..same.clone() },
            with(Identity { template: Some("u".to_owned()), ..Identity::default() }),
            with(Identity { revision: Some(2), ..Identity::default() }),
            with(Identity { revision: Some(3), ..Identity::default() }),
            with(Identity { system: Some("u".to_owned()), ..Identity::default() }),
        ];
        let mut ids: Vec<_> = others.iter().chain([&same]).map(Player::row).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), others.len() + 1);
        let renamed = Owner { id: "key_1".into(), name: "somebody".into() };
        assert_eq!(Player { owner: Some(renamed), ..same.clone() }.row(), same.row());
        assert_eq!(RowId::parse(&same.row().to_string()), Some(same.row()));
    }

    #[test]
    fn a_model_stands_between_the_rows_of_the_paper() {
        // 20.5 is between gpt-4.1 (20.10) and claude-3.7-sonnet (25.70).
        let run = run("r", "finished", 0);
        let plan = slots(&TaskName::ALL, &[27, 42]);
        let games: Vec<_> = plan.iter().map(|slot| game(slot.task, slot.seed, 4.1)).collect();
        let runs = [Arc::new(RunResult::new(run, &plan, &games, true))];
        let view = View { tasks: TaskName::ALL.to_vec(), sort: None, pick: Pick::Best };
        let rows = rank(&runs, REFERENCES.iter(), &view);
        let names: Vec<_> = rows.iter().take(5).map(RankedRow::name).collect();
        let above = ["gemini-2.0-flash", "o4-mini", "claude-3.7-sonnet"];
        assert_eq!(names, [&above[..], &["a model", "gpt-4.1"]].concat());
        assert_eq!(rows[3].rank, Some(4));
        // A player of only some tasks has no total, and comes last without a rank.
        assert_eq!(rows.len(), 1 + 29);
        assert!(rows[14..].iter().all(|row| row.rank.is_none() && row.value.is_none()));
        // Ranked by one task, such players have a rank.
        let view = View { sort: Some(TaskName::Synchronization), ..view };
        let rows = rank(&runs, REFERENCES.iter(), &view);
        assert_eq!((rows[0].name(), rows[0].value), ("human players", Some(41.95)));
        assert_eq!(rows.iter().filter(|row| row.rank.is_some()).count(), 1 + 13 + 3 + 1);
    }

    /// A run of a model: its start, and for each game the score and whether the host broke it, if it was played.
    type SomeRun = (u8, i64, Vec<Option<(f64, bool)>>);

    /// Random runs of some models.
    fn some_runs() -> impl Strategy<Value = Vec<SomeRun>> {
        let score =
            prop_oneof![(0..20_i32).prop_map(|tenths| f64::from(tenths) / 10.0), -5.0..50.0_f64,];
        let game = proptest::option::weighted(0.9, (score, proptest::bool::weighted(0.1)));
        let run = (0..5_u8, 0..4_i64, proptest::collection::vec(game, 6));
        proptest::collection::vec(run, 1..12)
    }

    fn results(runs: &[SomeRun]) -> Vec<Arc<RunResult>> {
        let plan = slots(&TASKS, &[1, 2, 3]);
        let result = |(number, (model, second, games)): (usize, &SomeRun)| {
            let status = if games.iter().all(Option::is_some) { "finished" } else { "aborted" };
            let mut run = run(&format!("run_{number}"), status, *second);
            run.player = player(&model.to_string());
            let games: Vec<EndedGame> = (plan.iter().zip(games))
                .filter_map(|(slot, played)| {
                    let (score, voided) = (*played)?;
                    Some(EndedGame { voided, ..game(slot.task, slot.seed, score) })
                })
                .collect();
            Arc::new(RunResult::new(run, &plan, &games, true))
        };
        runs.iter().enumerate().map(result).collect()
    }

    proptest! {
        #[test]
        fn a_board_does_not_depend_on_the_order_of_its_runs(
            runs in some_runs(),
            turn in 0..12_usize,
            pick in proptest::sample::select(&Pick::ALL[..]),
        ) {
            let mut runs = results(&runs);
            let show = |rows: &[RankedRow]| {
                let view = view(pick);
                let pairs = rows.iter().zip(rows.iter().skip(1)).map(|(above, row)| {
                    difference(above.shown()?, row.shown()?, view.ranked_by())
                });
                // Bit-exact, as `Debug` output of floats can be parsed back.
                format!("{rows:?} {:?}", pairs.collect::<Vec<_>>())
            };
            let first = show(&rank(&runs, [], &view(pick)));
            let turn = turn % runs.len();
            runs.rotate_left(turn);
            runs.reverse();
            prop_assert_eq!(show(&rank(&runs, [], &view(pick))), first);
        }

        #[test]
        fn ranks_count_who_is_better_and_totals_are_sums(
            runs in some_runs(),
            pick in proptest::sample::select(&Pick::ALL[..]),
        ) {
            let rows = rank(&results(&runs), [], &view(pick));
            for row in &rows {
                let Some(value) = row.value else {
                    prop_assert_eq!(row.rank, None);
                    continue;
                };
                let better = |other: &&RankedRow| other.value.is_some_and(|other| other > value + 2e-9);
                prop_assert_eq!(row.rank, Some(u32::try_from(rows.iter().filter(better).count())? + 1));
                let means = row.shown().expect("a run").tasks.iter().map(TaskResult::mean);
                let sum: f64 = means.map(|mean| mean.expect("a mean")).sum();
                prop_assert!((sum - value).abs() < 1e-9);
            }
            // Rows without a value come last.
            let ranked: Vec<bool> = rows.iter().map(|row| row.rank.is_some()).collect();
            prop_assert!(ranked.is_sorted_by(|a, b| a >= b));
        }

        #[test]
        fn the_best_run_is_no_worse_than_any_other_choice(runs in some_runs()) {
            let runs = results(&runs);
            let best = rank(&runs, [], &view(Pick::Best));
            for pick in [Pick::Last, Pick::Mean] {
                for row in rank(&runs, [], &view(pick)) {
                    let same = best.iter().find(|best| best.id() == row.id()).expect("the same players");
                    // With voided games, the mean may cover other seeds than the best run.
                    let comparable = runs.iter().filter(|run| run.row == row.id()).all(|run| {
                        run.tasks.iter().all(|task| task.planned == 3)
                    });
                    if comparable {
                        prop_assert!(same.value.expect("a total") >= row.value.expect("a total") - 1e-9);
                    }
                }
            }
        }
    }
}
