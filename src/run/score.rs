//! The result of a run so far: means over seeds, their deviations, and the total. Boards, which rank runs that
//! are over, have their own way to the same numbers.

use super::suite::Suite;
use crate::board::result::mean_and_deviation;
use crate::store::runs::StoredGame;

/// What a run came to in one task.
#[derive(Clone, Debug, PartialEq)]
pub struct TaskScore {
    /// The task's name.
    pub task: String,
    /// The mean of the scores; none as long as no game has ended.
    pub mean: Option<f64>,
    /// Their population standard deviation.
    pub deviation: Option<f64>,
    /// How many games have ended and count.
    pub games: u32,
    /// How many of the plan count, ended or not.
    pub planned: u32,
    /// How many games were voided.
    pub voided: u32,
}

/// The result of a run, task by task. While it is running these are means over what has ended. When it
/// is over a game that was never played counts as 0, as it would if nobody had done anything in it; and a
/// voided game does not count at all.
#[must_use]
pub fn task_scores(suite: &Suite, games: &[StoredGame], is_over: bool) -> Vec<TaskScore> {
    let plan = suite.plan();
    let score = |task: &String| {
        let mut scores = Vec::new();
        let mut found = TaskScore {
            task: task.clone(),
            mean: None,
            deviation: None,
            games: 0,
            planned: 0,
            voided: 0,
        };
        for planned in plan.iter().filter(|game| game.task == *task) {
            let mut voided = 0;
            let mut counted = None;
            for game in games.iter().filter(|game| game.slot == planned.slot) {
                if game.counts() {
                    counted = Some(game);
                } else {
                    voided += 1;
                }
            }
            found.voided += voided;
            match counted {
                None if is_over && voided > 0 => continue,
                None if is_over => scores.push(0.0),
                Some(game) if game.is_over() => {
                    scores.push(game.score);
                    found.games += 1;
                }
                None | Some(_) => {}
            }
            found.planned += 1;
        }
        (found.mean, found.deviation) = mean_and_deviation(&scores).unzip();
        found
    };
    suite.tasks.iter().map(score).collect()
}

/// The sum of the means; none as long as there is none.
#[must_use]
pub fn total(tasks: &[TaskScore]) -> Option<f64> {
    let means: Vec<f64> = tasks.iter().filter_map(|task| task.mean).collect();
    (!means.is_empty()).then(|| means.iter().sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::{EpisodeId, EpisodeKey};
    use crate::journal::Tally;

    fn game(slot: u32, score: f64, is_over: bool, voided: bool) -> StoredGame {
        StoredGame {
            episode: EpisodeKey(0),
            id: EpisodeId::from_text("ep_".to_owned()),
            slot,
            status: String::new(),
            reason: None,
            score,
            rounds: 0,
            tally: Tally::default(),
            void_reason: voided.then(String::new),
            ended_at: is_over.then_some(jiff::Timestamp::UNIX_EPOCH),
        }
    }

    #[test]
    fn means_and_deviations_are_those_of_the_paper() {
        let suite = Suite::built_in("standard", "paper").expect("a suite");
        let scores = [9.0, 10.0, 10.0, 10.0, 9.0];
        let games: Vec<_> =
            (0..).zip(scores).map(|(slot, score)| game(slot, score, true, false)).collect();
        let tasks = task_scores(&suite, &games, false);
        let first = tasks[0].mean.zip(tasks[0].deviation).expect("there are scores");
        assert_eq!(format!("{:.2} ± {:.2}", first.0, first.1), "9.60 ± 0.49");
        assert_eq!(total(&tasks), Some(9.6));
    }

    #[test]
    fn what_was_not_played_counts_as_0_once_the_run_is_over_and_what_the_host_broke_never() {
        let suite = Suite {
            tasks: vec!["Transport".to_owned(), "Foraging".to_owned()],
            seeds: vec![1, 2, 3],
            ..Suite::built_in("standard", "paper").expect("a suite")
        };
        let games = [
            game(0, 6.0, true, false),
            game(1, 9.0, true, true),
            game(1, 3.0, true, false),
            game(2, 50.0, false, false),
            game(4, 8.0, true, true),
        ];
        let told = |is_over| {
            let tasks = task_scores(&suite, &games, is_over);
            let row = |task: &TaskScore| {
                (task.mean, task.deviation, task.games, task.planned, task.voided)
            };
            (tasks.iter().map(row).collect::<Vec<_>>(), total(&tasks))
        };
        // The running game does not count yet; the voided one will be played again.
        let running = vec![(Some(4.5), Some(1.5), 2, 3, 1), (None, None, 0, 3, 1)];
        assert_eq!(told(false), (running, Some(4.5)));
        // Two games of Foraging were never played, the third is nobody's fault but the host's.
        let over = vec![(Some(4.5), Some(1.5), 2, 3, 1), (Some(0.0), Some(0.0), 0, 2, 1)];
        assert_eq!(told(true), (over, Some(4.5)));
    }
}
