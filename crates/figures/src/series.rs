//! Means and deviations of several games, round by round.

use swarmbench_analysis::statistics::mean_and_deviation;

/// The values of several similar games, state by state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// The mean over the games that have a value in the state.
    pub mean: Vec<Option<f64>>,
    /// The population deviation of these values.
    pub deviation: Vec<Option<f64>>,
    /// The number of these values.
    pub counts: Vec<usize>,
}

impl Band {
    /// Summarizes the series of games, with `None` where a game has no value.
    #[must_use]
    pub fn of(games: &[&[Option<f64>]]) -> Self {
        let length = games.iter().map(|game| game.len()).max().unwrap_or_default();
        let mut band = Self::default();
        for place in 0..length {
            let values = games.iter().filter_map(|game| game.get(place).copied().flatten());
            let summary = Summary::of(&values.collect::<Vec<_>>());
            band.mean.push(summary.map(|summary| summary.mean));
            band.deviation.push(summary.map(|summary| summary.deviation));
            band.counts.push(summary.map_or(0, |summary| summary.n));
        }
        band
    }

    /// The mean minus the deviation, at least 0 if the mean is.
    #[must_use]
    pub fn low(&self) -> Vec<Option<f64>> {
        let both = self.mean.iter().zip(&self.deviation);
        both.map(|(mean, deviation)| {
            let (mean, low) = ((*mean)?, (*mean)? - (*deviation)?);
            Some(if mean >= 0.0 { low.max(0.0) } else { low })
        })
        .collect()
    }

    /// The mean plus the deviation.
    #[must_use]
    pub fn high(&self) -> Vec<Option<f64>> {
        let both = self.mean.iter().zip(&self.deviation);
        both.map(|(mean, deviation)| Some((*mean)? + (*deviation)?)).collect()
    }
}

/// A summary of several values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// The mean.
    pub mean: f64,
    /// The population deviation.
    pub deviation: f64,
    /// The number of values.
    pub n: usize,
}

impl Summary {
    /// Summarizes values; `None` without any.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let (mean, deviation) = mean_and_deviation(values)?;
        Some(Self { mean, deviation, n: values.len() })
    }
}

/// The scores of a game's states do not make a score curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScoreError {
    /// The score falls, which it never does.
    #[error("the score falls in state {0}; such games are damaged, verify their journals")]
    Falls(usize),
    /// There is no state, not even a layout.
    #[error("a game without a state has no score")]
    Empty,
    /// There are more states than rounds and the layout.
    #[error("there are {states} states, but at most {rounds} rounds")]
    TooLong {
        /// The number of states.
        states: usize,
        /// The maximum number of rounds of a game.
        rounds: usize,
    },
}

/// Extends the scores of a game's states to the last round: a game that ended early keeps its last score.
///
/// # Errors
/// If the scores are not those of a game of at most this many rounds.
pub fn whole_score(scores: &[f64], rounds: usize) -> Result<Vec<Option<f64>>, ScoreError> {
    let last = *scores.last().ok_or(ScoreError::Empty)?;
    if scores.len() > rounds + 1 {
        return Err(ScoreError::TooLong { states: scores.len(), rounds });
    }
    if let Some(state) = scores.windows(2).position(|pair| pair[1] < pair[0]) {
        return Err(ScoreError::Falls(state + 1));
    }
    Ok((0..=rounds).map(|state| Some(scores.get(state).copied().unwrap_or(last))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_means_of_what_exists() {
        let games = [&[Some(1.0), None][..], &[Some(3.0), Some(5.0), Some(2.0)][..]];
        let band = Band::of(&games);
        assert_eq!(band.mean, [Some(2.0), Some(5.0), Some(2.0)]);
        assert_eq!(band.deviation, [Some(1.0), Some(0.0), Some(0.0)]);
        assert_eq!(band.counts, [2, 1, 1]);
        let wide = Band::of(&[&[Some(0.0)][..], &[Some(0.0)], &[Some(3.0)]]);
        assert_eq!(wide.low(), [Some(0.0)], "no band below 0");
    }

    #[test]
    fn scores_of_short_games_stay() {
        assert_eq!(
            whole_score(&[0.0, 2.0], 3),
            Ok(vec![Some(0.0), Some(2.0), Some(2.0), Some(2.0)])
        );
        assert_eq!(whole_score(&[0.0, 2.0, 1.0], 3), Err(ScoreError::Falls(2)));
        assert_eq!(whole_score(&[], 3), Err(ScoreError::Empty));
        assert_eq!(whole_score(&[0.0; 5], 3), Err(ScoreError::TooLong { states: 5, rounds: 3 }));
    }
}
