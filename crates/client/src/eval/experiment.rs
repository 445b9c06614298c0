//! An experiment: lists of models, tasks, seeds and settings, as a file has them.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::path::PathBuf;
use std::str::FromStr;

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Error, IntoDeserializer, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};

/// An experiment, as a file of it or a command line tells it. What is left out has a default, and what both tell is as
/// the command line has it.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Experiment {
    /// What it is called.
    pub name: Option<String>,
    /// What it is for.
    pub description: Option<String>,
    /// The tasks; `all` for all five. Left out, built-in players play those that they know, and models all.
    pub tasks: Option<List<String>>,
    /// The seeds, and ranges of them; those of the paper where they are left out.
    pub seeds: Option<List<Seeds>>,
    /// Language models.
    pub models: Option<List<ModelEntry>>,
    /// Built-in players: their names, `default` for the best of each task, `all` for all.
    pub players: Option<List<String>>,
    /// The seed of built-in players' own choices; 1 where it is left out.
    pub player_seed: Option<u64>,
    /// Where the models are, as far as they do not say it themselves.
    pub api_base: Option<String>,
    /// The environment variable with the key for that place.
    pub api_key_env: Option<String>,
    /// How many tokens an answer may have, as far as models do not say it themselves.
    pub max_tokens: Option<u64>,
    /// What else is sent with each question, as far as models do not say it themselves.
    pub extra: Option<Map<String, Value>>,
    /// A file with a prompt template.
    pub prompt_template: Option<PathBuf>,
    /// The settings of all games.
    pub settings: Axes,
    /// Settings in groups: each takes the place of what `settings` says.
    pub vary: Vec<Axes>,
    /// Games at once.
    pub parallel: Option<u32>,
    /// Questions to models at once.
    pub requests: Option<u32>,
    /// How many tokens may be spent before it stops.
    pub budget: Option<u64>,
    /// The shape of the board.
    pub board: Option<Shape>,
}

/// Lists of settings, which multiply. What is left out is as in the standard setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(default, deny_unknown_fields)]
pub struct Axes {
    /// Rule sets: paper, reference (paper).
    #[arg(long, value_delimiter = ',')]
    #[serde(deserialize_with = "list")]
    pub rules: Vec<String>,
    /// decentralized, centralized (decentralized).
    #[arg(long, value_delimiter = ',')]
    #[serde(deserialize_with = "list")]
    pub control: Vec<String>,
    /// Cells of a map: 15 is 15 × 15, 20x15 is 20 columns and 15 rows (10).
    #[arg(long, value_delimiter = ',', value_name = "SIZE")]
    #[serde(deserialize_with = "list")]
    pub map_size: Vec<MapSize>,
    /// How many agents play (12).
    #[arg(long, value_delimiter = ',', value_name = "N")]
    #[serde(deserialize_with = "list")]
    pub num_agents: Vec<i64>,
    /// Rows and columns of an agent's window (5).
    #[arg(long, value_delimiter = ',', value_name = "CELLS")]
    #[serde(deserialize_with = "list")]
    pub view_size: Vec<i64>,
    /// How many earlier rounds an agent remembers (5).
    #[arg(long, value_delimiter = ',', value_name = "ROUNDS")]
    #[serde(deserialize_with = "list")]
    pub memory: Vec<i64>,
    /// The maximum number of rounds of a game (100).
    #[arg(long, value_delimiter = ',', value_name = "ROUNDS")]
    #[serde(deserialize_with = "list")]
    pub max_round: Vec<i64>,
    /// The probability with which a message is corrupted (0).
    #[arg(long, value_delimiter = ',', value_name = "PROBABILITY")]
    #[serde(deserialize_with = "list")]
    pub noise: Vec<f64>,
    /// The maximum delay of a message, in rounds (0).
    #[arg(long, value_delimiter = ',', value_name = "ROUNDS")]
    #[serde(deserialize_with = "list")]
    pub max_delay: Vec<i64>,
    /// Of models alone.
    #[arg(skip)]
    #[serde(deserialize_with = "list")]
    pub temperature: Vec<f64>,
    /// Of models alone.
    #[arg(skip)]
    #[serde(deserialize_with = "list")]
    pub top_p: Vec<f64>,
}

impl Axes {
    /// These, and what they leave out as in `base`.
    #[must_use]
    pub fn over(self, base: &Self) -> Self {
        let mut all = base.lists();
        all.extend(self.lists());
        Self::deserialize(json!(all)).expect("these are lists of axes")
    }

    /// The lists that are given, by the names of their axes.
    #[must_use]
    pub fn lists(&self) -> BTreeMap<String, Vec<Value>> {
        let mut lists: BTreeMap<_, Vec<Value>> =
            serde_json::from_value(json!(self)).expect("every axis is a list");
        lists.retain(|_, values| !values.is_empty());
        lists
    }
}

impl Experiment {
    /// The experiment with the options of the command line: they override its file, also groups of settings. Options that
    /// name players replace all players of the file.
    #[must_use]
    pub fn with(self, said: Self) -> Self {
        let says_who = said.models.is_some() || said.players.is_some();
        let (models, players) =
            if says_who { (said.models, said.players) } else { (self.models, self.players) };
        Self {
            name: said.name.or(self.name),
            description: said.description.or(self.description),
            tasks: said.tasks.or(self.tasks),
            seeds: said.seeds.or(self.seeds),
            models,
            players,
            player_seed: said.player_seed.or(self.player_seed),
            api_base: said.api_base.or(self.api_base),
            api_key_env: said.api_key_env.or(self.api_key_env),
            max_tokens: said.max_tokens.or(self.max_tokens),
            extra: said.extra.or(self.extra),
            prompt_template: said.prompt_template.or(self.prompt_template),
            vary: (self.vary.into_iter()).map(|group| said.settings.clone().over(&group)).collect(),
            settings: said.settings.over(&self.settings),
            parallel: said.parallel.or(self.parallel),
            requests: said.requests.or(self.requests),
            budget: said.budget.or(self.budget),
            board: said.board.or(self.board),
        }
    }
}

/// The shape of the board that is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A row for each run, a column for each task.
    #[default]
    Wide,
    /// A row for each run and task, with the least and the most.
    Long,
}

/// A model.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelEntry {
    /// The name on boards.
    pub name: String,
    /// What the endpoint calls it, where that is something else.
    pub model: Option<String>,
    /// Where it is.
    pub api_base: Option<String>,
    /// The environment variable with the key for that place.
    pub api_key_env: Option<String>,
    /// Its temperature, whatever the settings say.
    pub temperature: Option<f64>,
    /// Its nucleus of sampling, whatever the settings say.
    pub top_p: Option<f64>,
    /// How many tokens an answer may have.
    pub max_tokens: Option<u64>,
    /// What else is sent with each question.
    pub extra: Option<Map<String, Value>>,
}

impl ModelEntry {
    /// A model that the endpoint calls by its name on boards.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }
}

/// One value or several.
#[derive(Clone, Debug, PartialEq)]
pub struct List<T>(pub Vec<T>);

impl<T> From<Vec<T>> for List<T> {
    fn from(values: Vec<T>) -> Self {
        Self(values)
    }
}

impl<'de, T: Item<'de>> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct OneOrMany<T>(PhantomData<T>);
        impl<'de, T: Item<'de>> Visitor<'de> for OneOrMany<T> {
            type Value = List<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}, or a list of such", T::WHAT)
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<List<T>, E> {
                one(value)
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<List<T>, E> {
                one(value)
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<List<T>, E> {
                one(value)
            }

            fn visit_str<E: Error>(self, value: &str) -> Result<List<T>, E> {
                one(value)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<List<T>, A::Error> {
                T::read(MapAccessDeserializer::new(map)).map(|value| List(vec![value]))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<List<T>, A::Error> {
                let all: Vec<Read<T>> = Vec::deserialize(SeqAccessDeserializer::new(seq))?;
                if all.is_empty() {
                    return Err(A::Error::custom("must not be empty"));
                }
                Ok(List(all.into_iter().map(|Read(value)| value).collect()))
            }
        }
        fn one<'de, T: Item<'de>, E: Error>(
            value: impl IntoDeserializer<'de, E>,
        ) -> Result<List<T>, E> {
            T::read(value.into_deserializer()).map(|value| List(vec![value]))
        }
        deserializer.deserialize_any(OneOrMany(PhantomData))
    }
}

fn list<'de, D: Deserializer<'de>, T: Item<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    List::deserialize(deserializer).map(|List(values)| values)
}

/// What a list may be of.
pub trait Item<'de>: Sized {
    /// What is expected.
    const WHAT: &'static str;

    /// Reads one.
    ///
    /// # Errors
    /// Where it is something else.
    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error>;
}

struct Read<T>(T);

impl<'de, T: Item<'de>> Deserialize<'de> for Read<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        T::read(deserializer).map(Self)
    }
}

impl<'de> Item<'de> for String {
    const WHAT: &'static str = "a text";

    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::deserialize(deserializer)
    }
}

impl<'de> Item<'de> for i64 {
    const WHAT: &'static str = "a whole number";

    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Whole;
        impl Visitor<'_> for Whole {
            type Value = i64;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(i64::WHAT)
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<i64, E> {
                Ok(value)
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<i64, E> {
                i64::try_from(value).map_err(|_| E::custom("the number is too large"))
            }
        }
        deserializer.deserialize_any(Whole)
    }
}

impl<'de> Item<'de> for f64 {
    const WHAT: &'static str = "a number";

    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Number;
        impl Visitor<'_> for Number {
            type Value = f64;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(f64::WHAT)
            }

            fn visit_i64<E: Error>(self, value: i64) -> Result<f64, E> {
                #[expect(clippy::cast_precision_loss, reason = "settings are small numbers")]
                Ok(value as f64)
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<f64, E> {
                #[expect(clippy::cast_precision_loss, reason = "settings are small numbers")]
                Ok(value as f64)
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<f64, E> {
                Ok(value)
            }
        }
        deserializer.deserialize_any(Number)
    }
}

/// What is written as a number, or as a text that tells more.
struct NumberOrText<T>(PhantomData<T>);

impl<T: FromStr<Err = String>> Visitor<'_> for NumberOrText<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a whole number or a text")
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<T, E> {
        self.visit_str(&value.to_string())
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<T, E> {
        self.visit_str(&value.to_string())
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<T, E> {
        value.parse().map_err(E::custom)
    }
}

/// One seed, or all from the first number on and below the second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seeds {
    /// The first.
    pub from: u64,
    /// The last.
    pub last: u64,
}

/// Seeds in one range; a run has fewer games.
const SEEDS_MAX: u64 = 1000;

impl FromStr for Seeds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            text.trim().parse::<u64>().map_err(|_| {
                "a seed is a number from 0 to 9007199254740991, a range of them is like 0..20"
                    .to_owned()
            })
        };
        let Some((from, to)) = text.split_once("..") else {
            let seed = number(text)?;
            return Ok(Self { from: seed, last: seed });
        };
        let from = number(from)?;
        let end = match to.strip_prefix('=') {
            Some(last) => number(last)?.saturating_add(1),
            None => number(to)?,
        };
        match end.checked_sub(from) {
            None | Some(0) => {
                Err(format!("there is no seed in {text}; 0..20 are the seeds 0 to 19"))
            }
            Some(1..=SEEDS_MAX) => Ok(Self { from, last: end - 1 }),
            Some(count) => {
                Err(format!("{text} are {count} seeds; a run has at most {SEEDS_MAX} games"))
            }
        }
    }
}

impl<'de> Item<'de> for Seeds {
    const WHAT: &'static str = "a seed or a range of them like \"0..20\"";

    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NumberOrText(PhantomData))
    }
}

/// Columns and rows of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapSize {
    /// Columns.
    pub width: i64,
    /// Rows.
    pub height: i64,
}

impl FromStr for MapSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            text.trim()
                .parse::<i64>()
                .map_err(|_| "a map is as large as 15, for 15 × 15 cells, or 20x15".to_owned())
        };
        let (width, height) = text.split_once(['x', '×']).unwrap_or((text, text));
        Ok(Self { width: number(width)?, height: number(height)? })
    }
}

impl fmt::Display for MapSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

impl Serialize for MapSize {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Item<'de> for MapSize {
    const WHAT: &'static str = "the size of a map like 15 or \"20x15\"";

    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NumberOrText(PhantomData))
    }
}

impl<'de> Item<'de> for ModelEntry {
    const WHAT: &'static str = "the name of a model, or a table about it";

    fn read<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = ModelEntry;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(ModelEntry::WHAT)
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<ModelEntry, E> {
                Ok(ModelEntry::named(name))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<ModelEntry, A::Error> {
                let entry = ModelEntry::deserialize(MapAccessDeserializer::new(map))?;
                if entry.name.is_empty() {
                    return Err(A::Error::missing_field("name"));
                }
                Ok(entry)
            }
        }
        deserializer.deserialize_any(Either)
    }
}
