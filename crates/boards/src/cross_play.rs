//! Cross-play: results of pairs of models, in games whose seats belonged to different holders.

use std::collections::BTreeMap;

use swarmbench_engine::TaskName;

use super::result::mean_and_deviation;

/// Setting of comparable games: task, rules and settings are equal.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Setting {
    /// Task.
    pub task: TaskName,
    /// Rule set.
    pub rules: String,
    /// All other settings that influence a game except the seed, as canonical JSON.
    pub settings: String,
}

/// A finished game of several holders.
#[derive(Clone, Debug, PartialEq)]
pub struct MixedGame {
    /// Setting of the game.
    pub setting: Setting,
    /// Final score.
    pub score: f64,
    /// Models of the holders.
    pub models: Vec<Model>,
}

/// Model of a holder.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Model {
    /// Name of the model.
    pub name: String,
    /// True if somebody besides the holder vouches for the model.
    pub vouched: bool,
    /// Holder, as the number of a key, if known.
    pub owner: Option<i64>,
}

/// Two models that played together; equal if two holders used the same one.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// Setting of the games.
    pub setting: Setting,
    /// Names of the models, sorted.
    pub models: [String; 2],
    /// True if both models are vouched for in all of the games.
    pub vouched: bool,
    /// Number of games together.
    pub games: usize,
    /// Mean score of the games.
    pub mean: f64,
    /// Population standard deviation of the scores.
    pub deviation: f64,
}

/// Games of a pair.
#[derive(Default)]
struct Met {
    scores: Vec<f64>,
    doubtful: bool,
}

/// All pairs by setting, best first. A game counts once for each pair of models in it.
#[must_use]
pub fn pairs<'a>(games: impl IntoIterator<Item = &'a MixedGame>) -> Vec<Pair> {
    let mut met: BTreeMap<(&Setting, [&str; 2]), Met> = BTreeMap::new();
    for game in games {
        let mut here: BTreeMap<[&str; 2], bool> = BTreeMap::new();
        for (place, one) in game.models.iter().enumerate() {
            for other in &game.models[place + 1..] {
                if one.owner.is_some() && one.owner == other.owner {
                    // A holder with seats of both models plays with itself.
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
            // Sorted, as a sum of floats depends on its order.
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
            // Two holders of the same model, and a third: each pair counts once.
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
