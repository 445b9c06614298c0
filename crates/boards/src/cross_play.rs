//! Cross-play: the results of pairs of models, in games whose seats belonged to different holders.

use std::collections::BTreeMap;

use swarmbench_engine::TaskName;

use super::result::mean_and_deviation;

/// What may be compared with each other: games of the same task, rules and settings.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Setting {
    /// The task.
    pub task: TaskName,
    /// The rule set.
    pub rules: String,
    /// All other settings that decide a game but the seed, as canonical JSON.
    pub settings: String,
}

/// A finished game.
#[derive(Clone, Debug, PartialEq)]
pub struct MixedGame {
    /// What it may be compared with.
    pub setting: Setting,
    /// Its score.
    pub score: f64,
    /// What each holder of seats played with.
    pub models: Vec<Model>,
}

/// What a holder of seats played with.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Model {
    /// Its name.
    pub name: String,
    /// Whether somebody beside the holder vouches for the model.
    pub vouched: bool,
    /// The holder of its seats, as the number of a key, if it is known.
    pub owner: Option<i64>,
}

/// Two models that played together; the same one twice if two holders used it.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The setting of their games.
    pub setting: Setting,
    /// The models, in order of their names.
    pub models: [String; 2],
    /// Whether both models are vouched for in all of these games.
    pub vouched: bool,
    /// How many games they played together.
    pub games: usize,
    /// The mean score of these games.
    pub mean: f64,
    /// Its population standard deviation.
    pub deviation: f64,
}

/// The games of a pair.
#[derive(Default)]
struct Met {
    scores: Vec<f64>,
    doubtful: bool,
}

/// All pairs, by setting, the best first. A game counts once for each pair of models in it.
#[must_use]
pub fn pairs<'a>(games: impl IntoIterator<Item = &'a MixedGame>) -> Vec<Pair> {
    let mut met: BTreeMap<(&Setting, [&str; 2]), Met> = BTreeMap::new();
    for game in games {
        let mut here: BTreeMap<[&str; 2], bool> = BTreeMap::new();
        for (place, one) in game.models.iter().enumerate() {
            for other in &game.models[place + 1..] {
                if one.owner.is_some() && one.owner == other.owner {
                    // A holder of the seats of both plays with itself.
                    continue;
                }
                let mut names = [one.name.as_str(), other.name.as_str()];
                names.sort_unstable();
                *here.entry(names).or_insert(true) &= one.vouched && other.vouched;
            }
        }
        for (names, vouched) in here {
            let pair = met.entry((&game.setting, names)).or_default();
            pair.scores.push(game.score);
            pair.doubtful |= !vouched;
        }
    }
    let mut pairs: Vec<Pair> = (met.into_iter())
        .filter_map(|((setting, models), Met { mut scores, doubtful })| {
            // A sum of floats depends on its order.
            scores.sort_by(f64::total_cmp);
            let (mean, deviation) = mean_and_deviation(&scores)?;
            let (setting, models) = (setting.clone(), models.map(str::to_owned));
            let games = scores.len();
            Some(Pair { setting, models, vouched: !doubtful, games, mean, deviation })
        })
        .collect();
    pairs.sort_by(|a, b| a.setting.cmp(&b.setting).then(b.mean.total_cmp(&a.mean)));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setting(task: TaskName, settings: &str) -> Setting {
        Setting { task, rules: "paper".to_owned(), settings: settings.to_owned() }
    }

    fn game(settings: &str, score: f64, models: &[&str]) -> MixedGame {
        let model =
            |name: &&str| Model { name: (*name).to_owned(), vouched: *name != "z", owner: None };
        let models = models.iter().map(model).collect();
        MixedGame { setting: setting(TaskName::Foraging, settings), score, models }
    }

    fn shown(games: &[MixedGame]) -> Vec<String> {
        let show = |pair: &Pair| {
            let Pair { setting, models: [a, b], vouched, games, mean, deviation } = pair;
            let mark = if *vouched { "" } else { "?" };
            format!("{} {a}+{b}{mark}: {mean} ± {deviation} in {games}", setting.settings)
        };
        pairs(games).iter().map(show).collect()
    }

    #[test]
    fn pairs_by_hand() {
        let mut games = vec![
            game("s", 2.0, &["x", "y"]),
            game("s", 4.0, &["y", "x", "z"]),
            // Two holders of the same model, and a third: each pair once.
            game("s", 9.0, &["x", "z", "x"]),
            game("t", 1.0, &["x", "y"]),
            game("t", 7.0, &["alone"]),
        ];
        let expected = [
            "s x+x: 9 ± 0 in 1",
            "s x+z?: 6.5 ± 2.5 in 2",
            "s y+z?: 4 ± 0 in 1",
            "s x+y: 3 ± 1 in 2",
            "t x+y: 1 ± 0 in 1",
        ];
        assert_eq!(shown(&games), expected);
        games.reverse();
        assert_eq!(shown(&games), expected);
        assert_eq!(pairs(&[]), []);
    }
}
