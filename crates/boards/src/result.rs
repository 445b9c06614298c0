//! Results of runs: mean and deviation over the seeds of each task, and the sum of the means.

use std::collections::BTreeMap;

pub use swarmbench_analysis::means::mean_and_deviation;
pub(super) use swarmbench_analysis::means::{float, mean};
use swarmbench_engine::{Seed, TaskName};
use swarmbench_journal::Tally;
use swarmbench_protocol::run::RunHolder;

use super::{EndedGame, PlayedRun, Player, RowId, Slot};

/// Results of a plan by task, in the order of [`TaskName::ALL`]. `games` are the ended ones.
///
/// Before the end of a run, means cover the games that were played. After it, a planned game that was not played counts as 0: doing
/// nothing scores about 0, and aborting a bad run must not pay. A voided game does not count, unless it was played again.
#[must_use]
pub fn task_results(plan: &[Slot], games: &[EndedGame], is_over: bool) -> Vec<TaskResult> {
    let mut slots: BTreeMap<Slot, Vec<EndedGame>> =
        plan.iter().map(|&slot| (slot, Vec::new())).collect();
    for &game in games {
        if let Some(played) = slots.get_mut(&game.slot) {
            played.push(game);
        }
    }
    let mut tasks: Vec<TaskResult> = Vec::new();
    for (slot, mut played) in slots {
        if tasks.last().is_none_or(|last| last.task != slot.task) {
            tasks.push(TaskResult::empty(slot.task));
        }
        // Sorted, so that the order of input does not matter.
        played.sort_by(|a, b| a.voided.cmp(&b.voided).then(b.score.total_cmp(&a.score)));
        tasks.last_mut().expect("one was pushed").add(slot.seed, &played, is_over);
    }
    for task in &mut tasks {
        task.finish();
    }
    tasks
}

/// Result of a run, or of several runs of a player combined, by task.
#[derive(Clone, Debug, PartialEq)]
pub struct RunResult {
    /// The run; for several, the last one with the properties that hold for all.
    pub run: PlayedRun,
    /// Row of the player.
    pub row: RowId,
    /// Results of all tasks of the suite, in the order of [`TaskName::ALL`].
    pub tasks: Vec<TaskResult>,
}

/// Results of one task.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskResult {
    /// Task.
    pub task: TaskName,
    /// Score of each seed that counts, sorted by seed.
    pub scores: Vec<(Seed, f64)>,
    /// Mean of the scores and their deviation, if there are scores.
    pub mean_and_deviation: Option<(f64, f64)>,
    /// Number of games that were played and count.
    pub games: u32,
    /// Number of planned games, without voided ones.
    pub planned: u32,
    /// Number of voided games.
    pub voided: u32,
    /// Counts of the acts in the games that count.
    pub tally: Tally,
}

impl RunResult {
    /// Approximate bytes in memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let task = |task: &TaskResult| {
            size_of::<TaskResult>() + task.scores.len() * size_of::<(Seed, f64)>()
        };
        let PlayedRun { id, player, status, prompt, answer_reader, .. } = &self.run;
        let owner = player.owner.as_ref().map_or(0, |owner| owner.id.len() + owner.name.len());
        let names: usize = [prompt, answer_reader].into_iter().flatten().map(String::len).sum();
        let holder = |holder: &RunHolder| {
            let texts = holder.name.len() + holder.model.len() + 2 * holder.seats.len();
            size_of::<RunHolder>() + texts
        };
        let team: usize = player.holders.iter().map(holder).sum();
        let texts = id.len() + status.len() + player.model.len() + owner + names + team;
        size_of::<Self>() + texts + self.tasks.iter().map(task).sum::<usize>()
    }

    /// Result of a run.
    #[must_use]
    pub fn new(run: PlayedRun, plan: &[Slot], games: &[EndedGame], is_over: bool) -> Self {
        Self { row: run.player.row(), run, tasks: task_results(plan, games, is_over) }
    }

    /// Result of a model's games read from files: the mean of repeated games, and no score for missing ones.
    pub(super) fn imported(
        model: &str,
        plan: &[Slot],
        games: impl IntoIterator<Item = (Slot, f64)>,
    ) -> Self {
        let mut slots: BTreeMap<Slot, Vec<f64>> =
            plan.iter().map(|&slot| (slot, Vec::new())).collect();
        for (slot, score) in games {
            slots.entry(slot).or_default().push(score);
        }
        let mut tasks: BTreeMap<TaskName, TaskResult> = BTreeMap::new();
        for (slot, mut scores) in slots {
            let task = tasks.entry(slot.task).or_insert_with(|| TaskResult::empty(slot.task));
            task.planned += 1;
            scores.sort_by(f64::total_cmp);
            if let Some(score) = mean(&scores) {
                task.games += 1;
                task.scores.push((slot.seed, score));
                task.finish();
            }
        }
        let player = Player { model: model.to_owned(), ..Player::default() };
        let run = PlayedRun { player, status: "imported".to_owned(), ..PlayedRun::default() };
        let row = RowId::of(&[b"imported", model.as_bytes()]);
        Self { run, row, tasks: tasks.into_values().collect() }
    }

    /// Combined result of several runs of the same player: a seed's score is its mean over the runs. `None` without runs.
    pub(super) fn together(runs: &[&Self]) -> Option<Self> {
        let last = runs.iter().max_by_key(|run| (run.run.created_at, &run.run.id))?;
        let mut run = last.run.clone();
        run.vouched = runs.iter().all(|one| one.run.vouched);
        // The row states what holds for all of its runs. `None` is the least value.
        run.decentralization = runs.iter().map(|one| one.run.decentralization).min().flatten();
        run.is_human = runs.iter().any(|one| one.run.is_human);
        let broken = runs.iter().map(|one| &one.run.status).filter(|status| *status != "finished");
        run.status = broken.max().unwrap_or(&run.status).clone();
        let mut tasks: BTreeMap<TaskName, Vec<&TaskResult>> = BTreeMap::new();
        for task in runs.iter().flat_map(|run| &run.tasks) {
            tasks.entry(task.task).or_default().push(task);
        }
        let tasks = tasks.into_iter().map(|(task, of)| TaskResult::together(task, &of)).collect();
        Some(Self { run, row: last.row, tasks })
    }

    /// Counts of the acts in all games that count.
    #[must_use]
    pub fn tally(&self) -> Tally {
        let mut sum = Tally::default();
        self.tasks.iter().for_each(|task| sum.merge(&task.tally));
        sum
    }

    /// Result of one task, if the suite has it.
    #[must_use]
    pub fn task(&self, task: TaskName) -> Option<&TaskResult> {
        self.tasks.iter().find(|result| result.task == task)
    }

    /// Sum of the means of these tasks, if none is missing.
    #[must_use]
    pub fn total(&self, tasks: &[TaskName]) -> Option<f64> {
        tasks.iter().try_fold(0.0, |sum, &task| Some(sum + self.task(task)?.mean()?))
    }
}

impl TaskResult {
    /// A result without games.
    #[must_use]
    pub fn empty(task: TaskName) -> Self {
        Self {
            task,
            scores: Vec::new(),
            mean_and_deviation: None,
            games: 0,
            planned: 0,
            voided: 0,
            tally: Tally::default(),
        }
    }

    /// Mean of the scores.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        self.mean_and_deviation.map(|(mean, _)| mean)
    }

    /// Adds a planned game and all attempts at it, sorted so that those that count come first.
    fn add(&mut self, seed: Seed, played: &[EndedGame], is_over: bool) {
        self.voided += u32::try_from(played.iter().filter(|game| game.voided).count()).unwrap_or(0);
        match played.first() {
            // All attempts were voided, so the game will be played again.
            Some(game) if game.voided => self.planned += u32::from(!is_over),
            Some(game) => {
                self.planned += 1;
                self.games += 1;
                self.tally.merge(&game.tally);
                self.scores.push((seed, game.score));
            }
            None => {
                self.planned += 1;
                if is_over {
                    self.scores.push((seed, 0.0));
                }
            }
        }
    }

    pub(super) fn of_seeds(&self) -> Vec<f64> {
        self.scores.iter().map(|&(_, score)| score).collect()
    }

    fn finish(&mut self) {
        self.mean_and_deviation = mean_and_deviation(&self.of_seeds());
    }

    fn together(task: TaskName, runs: &[&Self]) -> Self {
        let mut seeds: BTreeMap<Seed, Vec<f64>> = BTreeMap::new();
        let mut all = Self::empty(task);
        for one in runs {
            all.games += one.games;
            all.planned += one.planned;
            all.voided += one.voided;
            all.tally.merge(&one.tally);
            for &(seed, score) in &one.scores {
                seeds.entry(seed).or_default().push(score);
            }
        }
        let mean_of = |(seed, mut scores): (Seed, Vec<f64>)| {
            // Sorted, as a sum of floats depends on its order.
            scores.sort_by(f64::total_cmp);
            Some((seed, mean(&scores)?))
        };
        all.scores = seeds.into_iter().filter_map(mean_of).collect();
        all.finish();
        all
    }
}

#[cfg(test)]
mod tests {
    use super::super::rank::tests::{game, run, slots};
    use super::*;

    fn shown(result: &TaskResult) -> String {
        let (mean, deviation) = result.mean_and_deviation.expect("scores");
        format!("{mean:.2} ± {deviation:.2} {}/{}", result.games, result.planned)
    }

    #[test]
    fn the_papers_convention_by_hand() {
        let (mean, deviation) = mean_and_deviation(&[9.0, 10.0, 10.0, 10.0, 9.0]).expect("numbers");
        assert_eq!(format!("{mean:.2} ± {deviation:.2}"), "9.60 ± 0.49");
        // Squares of 0.6 twice and of 0.4 three times: 1.2 over 5 games, not over 4.
        assert!((deviation - 0.24_f64.sqrt()).abs() < 1e-15);
        assert_eq!(mean_and_deviation(&[]), None);
        assert_eq!(mean_and_deviation(&[3.5]), Some((3.5, 0.0)));
    }

    #[test]
    fn what_was_not_played_counts_as_nothing_once_the_run_is_over() {
        let plan = slots(&[TaskName::Pursuit], &[1, 2, 3, 4]);
        let games = [game(TaskName::Pursuit, 1, 8.0), game(TaskName::Pursuit, 2, 4.0)];
        let over = RunResult::new(run("a", "aborted", 1), &plan, &games, true);
        assert_eq!(shown(&over.tasks[0]), "3.00 ± 3.32 2/4");
        let going_on = RunResult::new(run("a", "running", 1), &plan, &games, false);
        assert_eq!(shown(&going_on.tasks[0]), "6.00 ± 2.00 2/4");
    }

    #[test]
    fn a_voided_game_does_not_count_unless_it_was_played_again() {
        let plan = slots(&[TaskName::Pursuit], &[1, 2]);
        let tally = Tally { invalid: 7, ..Tally::default() };
        let broken = EndedGame { voided: true, tally, ..game(TaskName::Pursuit, 1, 99.0) };
        let games = [broken, game(TaskName::Pursuit, 2, 4.0)];
        let result = RunResult::new(run("a", "finished", 1), &plan, &games, true);
        assert_eq!(shown(&result.tasks[0]), "4.00 ± 0.00 1/1");
        assert_eq!((result.tasks[0].voided, result.tasks[0].tally.invalid), (1, 1));

        let again = [broken, game(TaskName::Pursuit, 1, 2.0), game(TaskName::Pursuit, 2, 4.0)];
        let result = RunResult::new(run("a", "finished", 1), &plan, &again, true);
        assert_eq!(shown(&result.tasks[0]), "3.00 ± 1.00 2/2");
        assert_eq!(result.tasks[0].voided, 1);

        let all = [broken, EndedGame { voided: true, ..game(TaskName::Pursuit, 2, 4.0) }];
        let result = RunResult::new(run("a", "finished", 1), &plan, &all, true);
        assert_eq!((result.tasks[0].mean(), result.tasks[0].planned), (None, 0));
        assert_eq!(result.total(&[TaskName::Pursuit]), None);
    }

    #[test]
    fn the_mean_of_runs_is_taken_seed_by_seed() {
        let plan = slots(&[TaskName::Pursuit], &[1, 2]);
        let play = |id, scores: [f64; 2]| {
            let games =
                [game(TaskName::Pursuit, 1, scores[0]), game(TaskName::Pursuit, 2, scores[1])];
            RunResult::new(run(id, "finished", 1), &plan, &games, true)
        };
        let (first, second) = (play("a", [2.0, 4.0]), play("b", [4.0, 10.0]));
        let both = RunResult::together(&[&first, &second]).expect("two");
        assert_eq!(both.tasks[0].scores, [(Seed::from(1), 3.0), (Seed::from(2), 7.0)]);
        assert_eq!(shown(&both.tasks[0]), "5.00 ± 2.00 4/4");
    }

    /// Before the end of a run, missing games do not count as 0, and a voided game is still to be played.
    #[test]
    fn a_run_that_is_not_over_has_means_of_what_was_played() {
        let plan = slots(&[TaskName::Transport, TaskName::Foraging], &[1, 2, 3]);
        let games = [
            game(TaskName::Transport, 1, 6.0),
            EndedGame { voided: true, ..game(TaskName::Transport, 2, 9.0) },
            game(TaskName::Transport, 2, 3.0),
            EndedGame { voided: true, ..game(TaskName::Foraging, 2, 8.0) },
        ];
        let rows = |is_over| {
            let row = |task: &TaskResult| {
                (task.mean_and_deviation, task.games, task.planned, task.voided)
            };
            task_results(&plan, &games, is_over).iter().map(row).collect::<Vec<_>>()
        };
        assert_eq!(rows(false), [(Some((4.5, 1.5)), 2, 3, 1), (None, 0, 3, 1)]);
        let (mean, deviation) = rows(true)[0].0.expect("three scores");
        assert_eq!(format!("{mean} ± {deviation:.2}"), "3 ± 2.45");
        assert_eq!(rows(true)[1], (Some((0.0, 0.0)), 0, 2, 1));
    }
}
