//! Definition file of a competition: TOML with the fields of the request.

use std::path::Path;

use anyhow::{Context, anyhow, bail};

use swarmbench_clock::files::{read_text, text_of};

/// Reads a TOML file as the JSON of the request: the same fields, and times as strings.
pub(super) fn read(file: &Path) -> anyhow::Result<serde_json::Value> {
    let name = file.display();
    let text = if file.as_os_str() == "-" { text_of(std::io::stdin()) } else { read_text(file) };
    let text = text.with_context(|| format!("{name} cannot be read"))?;
    let read: toml::Table = toml::from_str(&text).map_err(|error| anyhow!("{name}: {error}"))?;
    json(toml::Value::Table(read)).with_context(|| format!("{name} is not like JSON"))
}

fn json(value: toml::Value) -> anyhow::Result<serde_json::Value> {
    Ok(match value {
        toml::Value::String(text) => text.into(),
        toml::Value::Integer(number) => number.into(),
        toml::Value::Float(number) => match serde_json::Number::from_f64(number) {
            Some(number) => number.into(),
            None => bail!("{number} is not a number in JSON"),
        },
        toml::Value::Boolean(value) => value.into(),
        toml::Value::Datetime(at) if at.offset.is_none() => {
            bail!("the time {at} needs an offset, like 2027-03-01T12:00:00Z")
        }
        toml::Value::Datetime(at) => at.to_string().into(),
        toml::Value::Array(values) => values.into_iter().map(json).collect::<Result<_, _>>()?,
        toml::Value::Table(fields) => {
            let fields = fields.into_iter().map(|(name, value)| Ok((name, json(value)?)));
            serde_json::Value::Object(fields.collect::<anyhow::Result<_>>()?)
        }
    })
}
