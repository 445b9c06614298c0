//! Built-in suites, and the digests that tell suites apart.

use std::collections::BTreeSet;

use serde_json::json;

use super::{create, look, small, text, with};
use crate::app::{TestApp, list};

#[tokio::test]
async fn a_built_in_suite_is_what_its_definition_says() {
    let app = TestApp::start().await;
    let suites = list(&app.get("/api/v1/suites").ok().await["items"]);
    let names: Vec<_> =
        suites.iter().map(|suite| (text(suite, "name"), text(suite, "rules"))).collect();
    let pairs = |name| [(name, "paper"), (name, "reference")];
    assert_eq!(names, [pairs("standard"), pairs("quick"), pairs("baselines")].concat());
    let digests: BTreeSet<_> = suites.iter().map(|suite| text(suite, "digest")).collect();
    assert_eq!(digests.len(), 6);
    assert_eq!(suites[0]["seeds"], json!([27, 42, 57, 72, 87]));
    assert_eq!((&suites[0]["games"], &suites[2]["games"]), (&json!(25), &json!(5)));
    assert_eq!(suites[4]["seeds"], json!((0..20).collect::<Vec<_>>()));
    for (suite, rounds) in [(&suites[0], 100), (&suites[2], 20), (&suites[4], 100)] {
        assert_eq!(suite["settings"]["max_round"], rounds);
        assert_eq!(list(&suite["tasks"]).len(), 5);
    }

    let request = json!({
        "suite": "quick", "rules": "reference", "model": "a model", "temperature": 0.5, "top_p": 0.9,
        "agent_meta": { "prompting": "short" }, "prompt_template": "{{ round }}", "parallel": 2,
    });
    let run = create(&app, request).await;
    assert_eq!(run.created["suite"], suites[3]);
    let told = ["temperature", "top_p", "agent_meta"].map(|field| &run.created[field]);
    assert_eq!(told, [&json!(0.5), &json!(0.9), &json!({ "prompting": "short" })]);
    assert_eq!(text(&run.created, "template_digest").len(), 12);
    let first = &run.created["games"][0];
    let episode = app.get(&format!("/api/v1/episodes/{}", text(first, "episode"))).ok().await;
    let meta = json!({ "prompting": "short", "temperature": 0.5, "top_p": 0.9 });
    assert_eq!(episode["config"]["agent_meta"], meta);
    assert_eq!(episode["config"]["prompt_template"], "{{ round }}");
    for (field, value) in [("seed", json!(27)), ("max_round", json!(20)), ("num_agents", json!(12))]
    {
        assert_eq!(episode["config"][field], value);
    }
    assert_eq!(episode["config"]["rules"], "reference");
}

#[tokio::test]
async fn clocks_make_another_suite() {
    let app = TestApp::start().await;
    let clocks = json!({ "suite": "quick", "round_deadline_s": 30, "bank_s": 60 });
    let run = create(&app, with(small(), &clocks)).await;
    let suites = list(&app.get("/api/v1/suites").ok().await["items"]);
    assert_eq!(run.created["suite"]["name"], "quick");
    assert_ne!(run.created["suite"]["digest"], suites[2]["digest"]);
    assert_eq!(run.created["suite"]["settings"]["round_deadline_s"], 30);
    assert!(look(&app, &run, "").await["observations"][0]["deadline"].is_string());
}
