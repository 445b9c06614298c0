//! An experiment: lists of models, tasks, seeds and settings, as in its file.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};

pub use crate::llm::Price;
use crate::llm::{Api, Budget};

pub use super::harness::{AnswerShape, HarnessPlan};
pub use super::list::{Item, List};
pub use super::system::SystemMessage;

/// Defines a table of a file with the settings of models after its own fields.
macro_rules! with_model_settings {
    ($(#[$meta:meta])* pub struct $name:ident { $($own:tt)* }) => {
        with_model_settings! {
            @ $(#[$meta])* $name { $($own)* }
            /// The endpoint.
            api_base: String,
            /// The environment variable with the key of that endpoint.
            api_key_env: String,
            /// The interface of that endpoint.
            api: Api,
            /// Further headers for that endpoint, by name; `$NAME` is an environment variable.
            headers: BTreeMap<String, String>,
            /// The maximum number of tokens of an answer.
            max_tokens: u64,
            /// The same limit by its newer name.
            max_completion_tokens: u64,
            /// The effort of the reasoning.
            effort: String,
            /// The tokens of reasoning.
            thinking_budget: u64,
            /// The summary of the reasoning.
            reasoning_summary: String,
            /// True if streams are asked for.
            stream: bool,
            /// Further fields of each request.
            extra: Map<String, Value>,
            /// The system message.
            system: SystemMessage,
            /// The price of tokens.
            price: Price,
        }
    };
    (@ $(#[$meta:meta])* $name:ident { $($own:tt)* } $($(#[$doc:meta])* $setting:ident: $type:ty,)*) => {
        $(#[$meta])*
        pub struct $name {
            $($own)*
            $($(#[$doc])* pub $setting: Option<$type>,)*
            /// The harness.
            pub harness: HarnessPlan,
        }

        impl $name {
            /// Takes the settings of models that are left out from `base`.
            pub(super) fn fill(&mut self, base: &Experiment) {
                let limits = (self.max_tokens, self.max_completion_tokens);
                $(if self.$setting.is_none() {
                    self.$setting.clone_from(&base.$setting);
                })*
                if limits != (None, None) {
                    // The two limits are one.
                    (self.max_tokens, self.max_completion_tokens) = limits;
                }
                self.harness = self.harness.over(&base.harness);
            }
        }
    };
}

with_model_settings! {
    /// An experiment, from a file or the command line. Every field has a default; the command line overrides the file. Its
    /// settings of models are for those that leave them out.
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
        pub seeds: Option<List<Numbers>>,
        /// Language models.
        pub models: Option<List<ModelEntry>>,
        /// Built-in players: their names, `default` for the best of each task, `all` for all.
        pub players: Option<List<String>>,
        /// Teams: several players on the seats of one swarm. Models that a team names do not play alone.
        pub teams: Vec<TeamEntry>,
        /// The seed of built-in players' own choices; 1 by default.
        pub player_seed: Option<u64>,
        /// A file with a prompt template, or the name `toolkit` or `static-first`.
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
        /// The budget of tokens or of money.
        pub budget: Option<Budget>,
        /// The share of answers failing in one way above which a run stops; 1 for never.
        pub stop_share: Option<f64>,
        /// The shape of the board.
        pub board: Option<Shape>,
    }
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
    /// The reader of answers: last-marker, first-marker or json (last-marker).
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
    pub fn with(self, mut said: Self) -> Self {
        said.fill(&self);
        let says_who = said.models.is_some() || said.players.is_some();
        let (models, players, teams) = if says_who {
            (said.models, said.players, said.teams)
        } else {
            (self.models, self.players, self.teams)
        };
        Self {
            name: said.name.or(self.name),
            description: said.description.or(self.description),
            tasks: said.tasks.or(self.tasks),
            seeds: said.seeds.or(self.seeds),
            models,
            players,
            teams,
            player_seed: said.player_seed.or(self.player_seed),
            prompt_template: said.prompt_template.or(self.prompt_template),
            vary: (self.vary.into_iter()).map(|group| said.settings.clone().over(&group)).collect(),
            settings: said.settings.over(&self.settings),
            parallel: said.parallel.or(self.parallel),
            requests: said.requests.or(self.requests),
            models_at_once: said.models_at_once.or(self.models_at_once),
            budget: said.budget.or(self.budget),
            stop_share: said.stop_share.or(self.stop_share),
            board: said.board.or(self.board),
            ..said
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

with_model_settings! {
    /// A model. Settings that it leaves out are those of the experiment.
    #[derive(Clone, Debug, Default, PartialEq, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    pub struct ModelEntry {
        /// The name on boards.
        pub name: String,
        /// The name at the endpoint, if that is another.
        pub model: Option<String>,
        /// Concurrent requests to this model, beside those to other models of the endpoint.
        pub requests: Option<u32>,
        /// The temperature, which overrides the settings.
        pub temperature: Option<f64>,
        /// The nucleus of sampling, which overrides the settings.
        pub top_p: Option<f64>,
    }
}

/// A team, or a set of teams: one of `members`, `substitute` and `focal`. A player is named like a model, as `built-in/NAME`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TeamEntry {
    /// The name on boards, of a team with `members`; it follows from these by default.
    pub name: Option<String>,
    /// Who plays which seats.
    pub members: Vec<MemberEntry>,
    /// A team for each number of seats in which one player is replaced by another.
    pub substitute: Option<Substitute>,
    /// A team of each focal model with each background, and each background alone.
    pub focal: Option<Focal>,
}

/// A member of a team: a model or a built-in player.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MemberEntry {
    /// The name within the team; that of the player by default.
    pub name: Option<String>,
    /// One of `models`, by its name.
    pub model: Option<String>,
    /// A built-in player, which the server plays; `default` is that of each task.
    pub player: Option<String>,
    /// The numbers of its seats.
    pub seats: List<Numbers>,
}

/// The replacement of one player by another, seat by seat.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Substitute {
    /// The player that is replaced.
    pub of: String,
    /// The player that replaces it.
    pub by: String,
    /// Numbers of replaced seats; from 0 to all by default.
    pub k: Option<List<Numbers>>,
}

/// Focal models, each of which plays some seats in the swarms of others.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Focal {
    /// The focal models.
    pub models: List<String>,
    /// The models that play the other seats.
    pub backgrounds: List<String>,
    /// The number of seats of a focal model.
    pub seats: u16,
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

/// A range of seeds or of seats, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Numbers {
    /// The first.
    pub from: u64,
    /// The last.
    pub last: u64,
}

/// Maximum numbers of a range: no run has more games.
const NUMBERS_MAX: u64 = 1000;

impl FromStr for Numbers {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |text: &str| {
            text.trim().parse::<u64>().map_err(|_| {
                "a number is from 0 to 9007199254740991, and a range of them is like 0..20"
                    .to_owned()
            })
        };
        let Some((from, to)) = text.split_once("..") else {
            let only = number(text)?;
            return Ok(Self { from: only, last: only });
        };
        let from = number(from)?;
        let end = match to.strip_prefix('=') {
            Some(last) => number(last)?.saturating_add(1),
            None => number(to)?,
        };
        match end.checked_sub(from) {
            None | Some(0) => {
                Err(format!("there is no number in {text}; 0..20 are the numbers 0 to 19"))
            }
            Some(1..=NUMBERS_MAX) => Ok(Self { from, last: end - 1 }),
            Some(count) => {
                Err(format!("{text} are {count} numbers; a range has at most {NUMBERS_MAX}"))
            }
        }
    }
}

impl Item for Numbers {
    const WHAT: &'static str = "a number or a range of them like \"0..20\", which is 0 to 19";
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
