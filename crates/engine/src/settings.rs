//! Settings as they are sent, unchecked; `check.rs` makes a [`Config`](crate::Config) of them.

use crate::names::{AnswerReader, Control, RuleSet, TaskName};

/// The numeric settings of a game, in the order in which suites and journals have them. Every struct with fields for
/// them is generated from this list.
///
/// A line gives the name, the type of the unchecked `=>` of the checked value, the default, and the range
/// (`Config::check` has the rules that depend on other settings). A setting that is added later has the default 0 and
/// `#[serde(default, skip_serializing_if = "…")]`: old journals and suites do not have it, and keep their bytes.
///
/// The macro calls `$then!` with `$input` and the list. `$inner` stands after `max_round`, where some structs have
/// other fields.
#[macro_export]
macro_rules! for_each_setting {
    ($then:path, $input:tt, $inner:tt) => {
        $then! { $input
            [
                /// Number of agents.
                num_agents: i64 => u16 = 12 in 1..=1024;
                /// Columns of the map.
                width: i64 => i64 = 10 in 8..=256;
                /// Rows of the map.
                height: i64 => i64 = 10 in 8..=256;
                /// Rows and columns of an agent's window; odd, 3 to 2 · size + 1.
                view_size: i64 => i64 = 5 in 3..=513;
                /// Number of past rounds that an agent remembers.
                memory: i64 => i64 = 5 in 0..=50;
                /// Number of rounds after which the episode ends.
                max_round: i64 => u32 = 100 in 1..=100_000;
            ] $inner
            [
                /// The probability with which a delivered message is corrupted.
                noise: f64 => f64 = 0.0 in 0..=1;
                /// The maximum delay of a message, in rounds.
                max_delay: i64 => i64 = 0 in 0..=100;
            ] {}
        }
    };
}

macro_rules! define_settings {
    ({} $([$(
        $(#[doc = $doc:literal])* $(#[serde $later:tt])?
        $setting:ident: $asked:ident => $checked:ident = $usual:tt in $least:tt..=$most:tt;
    )*] {})*) => {
        /// The requested settings of an episode; unchecked.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Settings {
            /// The name of the task, such as `Transport`.
            pub task: String,
            /// The name of the rule set, `paper` or `reference`.
            pub rules: String,
            /// The name of the control, `decentralized` or `centralized`.
            pub control: String,
            /// The seed of the layout, 0 to 2⁵³ − 1.
            pub seed: i64,
            $($($(#[doc = $doc])* pub $setting: $asked,)*)*
            /// The reader of language models' answers, `last-marker`, `first-marker` or `json`.
            pub answer_reader: String,
        }

        impl Default for Settings {
            fn default() -> Self {
                Self {
                    task: String::new(),
                    rules: RuleSet::Paper.name().to_owned(),
                    control: Control::Decentralized.name().to_owned(),
                    seed: 0,
                    $($($setting: $usual,)*)*
                    answer_reader: AnswerReader::usual(),
                }
            }
        }

        impl Settings {
            /// The names of all settings but task, rules and seed, in order.
            pub const NAMES: &[&str] = &["control", $($(stringify!($setting),)*)* "answer_reader"];

            /// The value of the setting with one of [`Self::NAMES`], as text.
            #[must_use]
            pub fn get(&self, name: &str) -> Option<String> {
                match name {
                    "control" => Some(self.control.clone()),
                    $($(stringify!($setting) => Some(self.$setting.to_string()),)*)*
                    "answer_reader" => Some(self.answer_reader.clone()),
                    _ => None,
                }
            }
        }
    };
}

for_each_setting! { define_settings, {}, {} }

impl Settings {
    /// The paper's standard setting for a task: 12 agents on 10 × 10 cells, windows of 5 × 5,
    /// 100 rounds, a memory of 5, decentralized, no noise, no delay.
    #[must_use]
    pub fn standard(task: TaskName, seed: u64) -> Self {
        Self {
            task: task.name().to_owned(),
            seed: i64::try_from(seed).unwrap_or(i64::MAX),
            ..Self::default()
        }
    }
}
