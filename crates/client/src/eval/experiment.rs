//! An experiment: lists of models, tasks, seeds and settings, as in its file.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};

use crate::llm::Api;

pub use super::list::{Item, List};
pub use super::system::SystemMessage;

/// An experiment, from a file or the command line. Every field has a default; the command line overrides the file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Experiment {
    /// The name of the experiment.
    pub name: Option<String>,
    /// The purpose of the experiment.
    pub description: Option<String>,
    /// The tasks; `all` for all five. By default models play all, and built-in players those that they can play.
    pub tasks: Option<List<String>>,
    /// Seeds and ranges of seeds; by default those of the paper.
    pub seeds: Option<List<Seeds>>,
    /// Language models.
    pub models: Option<List<ModelEntry>>,
    /// Built-in players: their names, `default` for the best of each task, `all` for all.
    pub players: Option<List<String>>,
    /// The seed of built-in players' own choices; 1 by default.
    pub player_seed: Option<u64>,
    /// The endpoint of models that name none.
    pub api_base: Option<String>,
    /// The environment variable with the key of that endpoint.
    pub api_key_env: Option<String>,
    /// The interface of that endpoint.
    pub api: Option<Api>,
    /// Further headers for that endpoint, by name; `$NAME` is an environment variable.
    pub headers: Option<BTreeMap<String, String>>,
    /// The maximum number of tokens of an answer, for models that set none.
    pub max_tokens: Option<u64>,
    /// Further fields of each request, for models that set none.
    pub extra: Option<Map<String, Value>>,
    /// The system message of models that set none.
    pub system: Option<SystemMessage>,
    /// A file with a prompt template, or the name `toolkit`.
    pub prompt_template: Option<PathBuf>,
    /// The settings of all games.
    pub settings: Axes,
    /// Groups of settings: each overrides `settings`.
    pub vary: Vec<Axes>,
    /// Games that are open at a time.
    pub parallel: Option<u32>,
    /// Concurrent requests to each endpoint.
    pub requests: Option<u32>,
    /// Models of one endpoint that play at the same time.
    pub models_at_once: Option<u32>,
    /// The token budget.
    pub budget: Option<u64>,
    /// The share of answers failing in one way above which a run stops; 1 for never.
    pub stop_share: Option<f64>,
    /// The price of tokens, for models that name none.
    pub price: Option<Price>,
    /// The shape of the board.
    pub board: Option<Shape>,
}

/// Lists of settings, which multiply. The default is the standard setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, clap::Args)]
#[serde(default, deny_unknown_fields)]
pub struct Axes {
    /// The rule sets: paper or reference (paper).
    #[arg(long, value_delimiter = ',')]
    #[serde(deserialize_with = "list")]
    pub rules: Vec<String>,
    /// The control of agents: decentralized or centralized (decentralized).
    #[arg(long, value_delimiter = ',')]
    #[serde(deserialize_with = "list")]
    pub control: Vec<String>,
    /// The size of the map, in cells: 15 is 15 × 15, 20x15 is 20 columns and 15 rows (10).
    #[arg(long, value_delimiter = ',', value_name = "SIZE")]
    #[serde(deserialize_with = "list")]
    pub map_size: Vec<MapSize>,
    /// The number of agents (12).
    #[arg(long, value_delimiter = ',', value_name = "N")]
    #[serde(deserialize_with = "list")]
    pub num_agents: Vec<i64>,
    /// The side of an agent's window, in cells (5).
    #[arg(long, value_delimiter = ',', value_name = "CELLS")]
    #[serde(deserialize_with = "list")]
    pub view_size: Vec<i64>,
    /// The number of earlier rounds that an agent remembers (5).
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
    /// The reader of answers: last-marker or first-marker (last-marker).
    #[arg(long, value_delimiter = ',', value_name = "READER")]
    #[serde(deserialize_with = "list")]
    pub answer_reader: Vec<String>,
    /// The sampling temperature of models.
    #[arg(skip)]
    #[serde(deserialize_with = "list")]
    pub temperature: Vec<f64>,
    /// The nucleus of sampling of models.
    #[arg(skip)]
    #[serde(deserialize_with = "list")]
    pub top_p: Vec<f64>,
}

impl Axes {
    /// Fills axes without values from `base`.
    #[must_use]
    pub fn over(self, base: &Self) -> Self {
        let mut all = base.lists();
        all.extend(self.lists());
        Self::deserialize(json!(all)).expect("these are lists of axes")
    }

    /// The lists that are not empty, by axis.
    #[must_use]
    pub fn lists(&self) -> BTreeMap<String, Vec<Value>> {
        let mut lists: BTreeMap<_, Vec<Value>> =
            serde_json::from_value(json!(self)).expect("every axis is a list");
        lists.retain(|_, values| !values.is_empty());
        lists
    }
}

impl Experiment {
    /// Reads an experiment from the text of its file.
    ///
    /// # Errors
    ///
    /// The text is no TOML, or has other fields or values than an experiment.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        toml::from_str(text)
    }

    /// The experiment overridden by options of the command line, which also override groups of settings. Options that
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
            api: said.api.or(self.api),
            headers: said.headers.or(self.headers),
            max_tokens: said.max_tokens.or(self.max_tokens),
            extra: said.extra.or(self.extra),
            system: said.system.or(self.system),
            prompt_template: said.prompt_template.or(self.prompt_template),
            vary: (self.vary.into_iter()).map(|group| said.settings.clone().over(&group)).collect(),
            settings: said.settings.over(&self.settings),
            parallel: said.parallel.or(self.parallel),
            requests: said.requests.or(self.requests),
            models_at_once: said.models_at_once.or(self.models_at_once),
            budget: said.budget.or(self.budget),
            stop_share: said.stop_share.or(self.stop_share),
            price: said.price.or(self.price),
            board: said.board.or(self.board),
        }
    }
}

/// The shape of the printed board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// A row for each run, a column for each task.
    #[default]
    Wide,
    /// A row for each run and task, with the lowest and the highest score.
    Long,
}

/// A model.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelEntry {
    /// The name on boards.
    pub name: String,
    /// The name at the endpoint, if that is another.
    pub model: Option<String>,
    /// The endpoint.
    pub api_base: Option<String>,
    /// The environment variable with the key of that endpoint.
    pub api_key_env: Option<String>,
    /// The interface of that endpoint.
    pub api: Option<Api>,
    /// Further headers for that endpoint, by name; `$NAME` is an environment variable.
    pub headers: Option<BTreeMap<String, String>>,
    /// Concurrent requests to this model, beside those to other models of the endpoint.
    pub requests: Option<u32>,
    /// The temperature, which overrides the settings.
    pub temperature: Option<f64>,
    /// The nucleus of sampling, which overrides the settings.
    pub top_p: Option<f64>,
    /// The maximum number of tokens of an answer.
    pub max_tokens: Option<u64>,
    /// Further fields of each request.
    pub extra: Option<Map<String, Value>>,
    /// The system message.
    pub system: Option<SystemMessage>,
    /// The price of its tokens.
    pub price: Option<Price>,
}

/// A price of tokens, in any currency.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Price {
    /// The price of a million tokens of prompts.
    pub input: f64,
    /// The price of a million tokens of answers.
    pub output: f64,
}

impl Price {
    /// The cost of these tokens.
    #[must_use]
    pub fn of(&self, prompt_tokens: u64, completion_tokens: u64) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "prices are rounded anyway")]
        let cost = |tokens: u64, price: f64| tokens as f64 * price / 1e6;
        cost(prompt_tokens, self.input) + cost(completion_tokens, self.output)
    }

    /// True if both prices are finite and at least 0.
    #[must_use]
    pub fn is_sane(&self) -> bool {
        [self.input, self.output].iter().all(|price| price.is_finite() && *price >= 0.0)
    }
}

impl FromStr for Price {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once(',').and_then(|(input, output)| {
            Some(Self { input: input.trim().parse().ok()?, output: output.trim().parse().ok()? })
        });
        numbers.filter(Self::is_sane).ok_or_else(|| {
            "a price is two numbers, of a million tokens of prompts and of answers, like 0.15,0.6".to_owned()
        })
    }
}

impl ModelEntry {
    /// A model with the same name on boards and at the endpoint.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }
}

fn list<'de, D: Deserializer<'de>, T: Item>(deserializer: D) -> Result<Vec<T>, D::Error> {
    List::deserialize(deserializer).map(|List(values)| values)
}

/// A range of seeds, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seeds {
    /// The first.
    pub from: u64,
    /// The last.
    pub last: u64,
}

/// Seeds of one range: no run has more games.
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

impl Item for Seeds {
    const WHAT: &'static str = "a seed or a range of them like \"0..20\"";
    const EXPECTED: &'static str = "a whole number or a text";

    fn integer<E: Error>(value: i128) -> Result<Self, E> {
        Self::text(&value.to_string())
    }

    fn text<E: Error>(value: &str) -> Result<Self, E> {
        value.parse().map_err(E::custom)
    }
}

/// The size of a map.
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

impl Item for MapSize {
    const WHAT: &'static str = "the size of a map like 15 or \"20x15\"";
    const EXPECTED: &'static str = "a whole number or a text";

    fn integer<E: Error>(value: i128) -> Result<Self, E> {
        Self::text(&value.to_string())
    }

    fn text<E: Error>(value: &str) -> Result<Self, E> {
        value.parse().map_err(E::custom)
    }
}

impl Item for ModelEntry {
    const WHAT: &'static str = "the name of a model, or a table about it";

    fn text<E: Error>(name: &str) -> Result<Self, E> {
        Ok(Self::named(name))
    }

    fn table<'de, A: MapAccess<'de>>(map: A) -> Result<Self, A::Error> {
        let entry = Self::deserialize(MapAccessDeserializer::new(map))?;
        if entry.name.is_empty() {
            return Err(A::Error::missing_field("name"));
        }
        Ok(entry)
    }
}
