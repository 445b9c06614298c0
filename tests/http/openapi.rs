//! The OpenAPI document.

use reqwest::Method;
use serde_json::Value;

use crate::app::{TestApp, list};

#[tokio::test]
async fn the_document_is_the_committed_one() {
    let committed = include_str!("../../openapi/openapi.json");
    let made = swarmbench::http::openapi::document();
    assert!(
        made == committed,
        "openapi/openapi.json is old: run `swarmbench openapi` and commit it"
    );
    let app = TestApp::start().await;
    let served = app.get("/openapi.json").ok().await;
    assert_eq!(served, serde_json::from_str::<Value>(committed).expect("JSON"));
}

#[test]
fn no_field_of_a_schema_has_a_default_but_its_description_says_it() {
    let document: Value =
        serde_json::from_str(&swarmbench::http::openapi::document()).expect("JSON");
    let schemas = document["components"]["schemas"].as_object().expect("schemas");
    let fields = schemas.values().filter_map(|schema| schema["properties"].as_object()).flatten();
    for (name, field) in fields {
        assert!(field.get("default").is_none(), "{name}");
    }
    let width = &schemas["EpisodeRequest"]["properties"]["width"]["description"];
    assert_eq!(width, "Columns of the map. `10` where it is left out.");
}

/// Every operation of the document: its method, its path and what is said of it.
fn operations() -> Vec<(Method, String, Value)> {
    let document: Value =
        serde_json::from_str(&swarmbench::http::openapi::document()).expect("JSON");
    let mut operations = Vec::new();
    for (path, item) in document["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("operations") {
            let method = method.to_uppercase().parse().expect("a method");
            operations.push((method, path.clone(), operation.clone()));
        }
    }
    assert!(operations.len() >= 15, "{}", operations.len());
    operations
}

#[tokio::test]
async fn every_documented_route_is_there_and_its_answer_is_documented() {
    let app = TestApp::start().await;
    for (method, path, operation) in operations() {
        let answer = app.call(method.clone(), &path.replace("{id}", "ep_none")).send().await;
        let text = answer.text();
        assert!(!text.contains("there is no route"), "{method} {path}: {text}");
        let response = &operation["responses"][answer.status.to_string()];
        assert!(response.is_object(), "{method} {path} answers {} {text}", answer.status);
        if answer.status >= 400 {
            let code = format!("`{}`", answer.json()["code"].as_str().expect("a code"));
            let said = response["description"].as_str().expect("a description");
            assert!(said.contains(&code), "{method} {path}: {code} is not in {said:?}");
        }
    }
}

#[tokio::test]
async fn the_document_says_what_every_operation_is() {
    let mut ids = Vec::new();
    for (method, path, operation) in operations() {
        for member in ["operationId", "summary"] {
            assert!(
                operation[member].as_str().is_some_and(|text| !text.is_empty()),
                "{method} {path}"
            );
        }
        assert_eq!(list(&operation["tags"]).len(), 1, "{method} {path}");
        ids.push(operation["operationId"].to_string());
        for (status, response) in operation["responses"].as_object().expect("responses") {
            let said = response["description"].as_str().unwrap_or_default();
            assert!(!said.is_empty(), "{method} {path} {status}");
            if status.as_str() >= "400" {
                let content = response["content"].as_object().expect("content");
                assert!(
                    content.contains_key("application/problem+json"),
                    "{method} {path} {status}"
                );
            }
        }
    }
    let count = ids.len();
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), count, "every operation has an id of its own");
}
