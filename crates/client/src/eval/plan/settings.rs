//! Settings that vary: the axes of an experiment, and their combinations.

use serde_json::{Value, json};
use swarmbench_engine::{RuleSet, Settings};
use swarmbench_protocol::run::OwnSettings;
use swarmbench_protocol::suite::Suite;

use crate::eval::experiment::{Axes, Experiment, MapSize};

/// The names of all settings that can vary, in the order in which they multiply.
pub fn axes() -> impl Iterator<Item = &'static str> {
    let first = ["rules", "control", "map_size"];
    let others = Settings::NAMES.iter().copied();
    let others = others.filter(|name| !["control", "width", "height"].contains(name));
    first.into_iter().chain(others).chain(["temperature", "top_p"])
}

/// The value of one of [`axes`] in a run with these rules, settings, temperature and `top_p`, if any.
pub(in crate::eval) fn value(
    axis: &str,
    rules: &str,
    settings: &Settings,
    [temperature, top_p]: [Option<f64>; 2],
) -> Option<Value> {
    let size = || MapSize { width: settings.width, height: settings.height }.to_string();
    match axis {
        "rules" => Some(json!(rules)),
        "map_size" => Some(json!(size())),
        "temperature" => temperature.map(|value| json!(value)),
        "top_p" => top_p.map(|value| json!(value)),
        name => json!(OwnSettings::from(settings)).get(name).cloned(),
    }
}

/// A setting as people write it: a text without quotes, a whole number without decimals.
#[must_use]
pub fn setting_text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        value => value.as_f64().map_or_else(|| value.to_string(), |number| number.to_string()),
    }
}

pub(super) fn standard() -> Suite {
    Suite::built_in("standard", "paper").expect("it is built in")
}

/// A suite whose tasks, seeds and name are set later, and the temperature and `top_p` of models.
pub(super) type Combination = (Suite, Option<f64>, Option<f64>);

/// All combinations of settings; `None`, before any is made, if they are more than `most`.
pub(super) fn combinations(experiment: &Experiment, most: u64) -> Option<Vec<Combination>> {
    let usual = [Axes::default()];
    let vary = if experiment.vary.is_empty() { &usual[..] } else { &experiment.vary };
    let groups = vary.iter().map(|group| group.clone().over(&experiment.settings));
    let more = |sum: u64, group: Axes| {
        let sizes = group.lists().into_values().map(|values| values.len() as u64);
        let sum = sum.saturating_add(sizes.fold(1, u64::saturating_mul));
        (sum <= most).then_some(sum)
    };
    groups.clone().try_fold(0, more)?;
    Some(groups.flat_map(|group| multiply(&group)).collect())
}

fn multiply(group: &Axes) -> Vec<Combination> {
    let lists = group.lists();
    let named = axes().filter_map(|axis| Some((axis, lists.get(axis)?)));
    named.fold(vec![(standard(), None, None)], |all, (axis, values)| {
        all.iter()
            .flat_map(|base| values.iter().map(move |value| with(base.clone(), axis, value)))
            .collect()
    })
}

/// A combination with this value on an axis.
fn with(
    (mut suite, mut temperature, mut top_p): Combination,
    axis: &str,
    value: &Value,
) -> Combination {
    let text = || value.as_str().expect("a text");
    let mut set = |asked: Value| {
        let asked: OwnSettings = serde_json::from_value(asked).expect("an axis is a setting");
        suite.settings = (&asked.over((&suite.settings).into())).into();
    };
    match axis {
        "rules" => suite.rules = RuleSet::canonical(text().to_owned()),
        "map_size" => {
            let MapSize { width, height } = text().parse().expect("the size of a map");
            set(json!({ "width": width, "height": height }));
        }
        "temperature" => temperature = value.as_f64(),
        "top_p" => top_p = value.as_f64(),
        setting => set(json!({ setting: value })),
    }
    (suite, temperature, top_p)
}
