//! A JSON schema: what it allows, and the least that it demands. It has the keywords that `responses.schema.json` uses.

use std::sync::LazyLock;

use serde_json::{Map, Value, json};

/// The Open Responses document, as far as it is used.
static RESPONSES: LazyLock<Value> =
    LazyLock::new(|| serde_json::from_str(include_str!("responses.schema.json")).expect("JSON"));

fn named(name: &str) -> &'static Value {
    let found = &RESPONSES["$defs"][name];
    assert!(found.is_object(), "the document has {name}");
    found
}

fn resolved(schema: &'static Value) -> &'static Value {
    match schema["$ref"].as_str() {
        Some(reference) => named(reference.trim_start_matches("#/$defs/")),
        None => schema,
    }
}

/// Asserts that a value is what the document says of this name.
pub(crate) fn check(name: &str, value: &Value) {
    let faults = faults(named(name), value, name);
    assert!(faults.is_empty(), "{faults:?} in {value}");
}

/// The least value of this name, with these fields.
pub(crate) fn filled(name: &str, with: &Value) -> Value {
    let mut value = least(named(name));
    let fields = value.as_object_mut().expect("an object");
    fields.extend(with.as_object().expect("fields").clone());
    check(name, &value);
    value
}

/// The least value that a schema allows.
fn least(schema: &'static Value) -> Value {
    let schema = resolved(schema);
    if let Some(value) = schema.get("const").or_else(|| schema["enum"].get(0)) {
        return value.clone();
    }
    if let Some(first) = schema["anyOf"].get(0) {
        return least(first);
    }
    match schema["type"].as_str() {
        Some("string") => json!(""),
        Some("integer") => json!(schema["minimum"].as_i64().unwrap_or(0)),
        Some("number") => json!(1.0),
        Some("boolean") => json!(false),
        Some("array") => json!([]),
        Some("object") => {
            let required = schema["required"].as_array().into_iter().flatten();
            let fields = required.map(|name| {
                let name = name.as_str().expect("a name");
                (name.to_owned(), least(&schema["properties"][name]))
            });
            Value::Object(fields.collect::<Map<_, _>>())
        }
        _ => Value::Null,
    }
}

/// Faults of a value, each with its place.
fn faults(schema: &'static Value, value: &Value, place: &str) -> Vec<String> {
    let schema = resolved(schema);
    let fault = |what: &str| vec![format!("{place} {what}, is {value}")];
    if schema.get("const").is_some_and(|only| only != value) {
        return fault("is not the constant");
    }
    if schema["enum"].as_array().is_some_and(|known| !known.contains(value)) {
        return fault("is none of the known");
    }
    if let Some(ways) = schema["anyOf"].as_array() {
        let tried: Vec<_> = ways.iter().map(|way| faults(way, value, place)).collect();
        let is_one = tried.iter().any(Vec::is_empty);
        return if is_one { Vec::new() } else { tried.concat() };
    }
    let is_of_type = match schema["type"].as_str() {
        Some("string") => value.is_string(),
        Some("integer") => value.is_i64() || value.is_u64(),
        Some("number") => value.is_number(),
        Some("boolean") => value.is_boolean(),
        Some("array") => value.is_array(),
        Some("object") => value.is_object(),
        Some("null") => value.is_null(),
        _ => true,
    };
    if !is_of_type {
        return fault(&format!("must be of type {}", schema["type"]));
    }
    if let Some(least) = schema["minimum"].as_i64()
        && value.as_i64().is_some_and(|number| number < least)
    {
        return fault(&format!("must be at least {least}"));
    }
    let mut found = Vec::new();
    for (at, item) in value.as_array().into_iter().flatten().enumerate() {
        if schema["items"].is_object() {
            found.extend(faults(&schema["items"], item, &format!("{place}[{at}]")));
        }
    }
    for name in schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str) {
        if value.get(name).is_none() {
            found.push(format!("{place} has no {name}"));
        }
    }
    for (name, field) in value.as_object().into_iter().flatten() {
        match schema["properties"].get(name) {
            Some(of) => found.extend(faults(of, field, &format!("{place}.{name}"))),
            None if schema["additionalProperties"] == false => {
                found.push(format!("{place} may not have {name}"));
            }
            None => {}
        }
    }
    found
}
