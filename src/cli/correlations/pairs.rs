//! Pairs of numbers, one pair per game.

use swarmbench_analysis::statistics::standardised;

use super::super::games::Games;

pub(super) type Pairs = Vec<(f64, f64)>;

/// Pairs of the games that have both numbers.
pub(super) fn pairs(games: &Games, chosen: &[usize], x: &str, y: &str) -> Pairs {
    let pair = |&game: &usize| games.number(x, game).zip(games.number(y, game));
    chosen.iter().filter_map(pair).collect()
}

/// The same pairs as deviations from the task's mean, in standard deviations, as scores of tasks have different scales. Tasks in
/// which a number is constant are left out.
pub(super) fn within_tasks(games: &Games, chosen: &[usize], x: &str, y: &str) -> Pairs {
    let of_task = |chosen: Vec<usize>| -> Pairs {
        let (x, y): (Vec<f64>, Vec<f64>) = pairs(games, &chosen, x, y).into_iter().unzip();
        let both = standardised(&x).zip(standardised(&y));
        both.map(|(x, y)| x.into_iter().zip(y).collect()).unwrap_or_default()
    };
    games.groups("task", chosen).into_values().flat_map(of_task).collect()
}
