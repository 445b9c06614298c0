//! Health, metrics, the OpenAPI document and its page.

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::{TestApp, list};

#[tokio::test]
async fn a_server_says_that_it_lives_and_is_ready() {
    let app = TestApp::start().await;
    for route in ["/healthz", "/readyz"] {
        let health = app.get(route).ok().await;
        assert_eq!(health, json!({ "status": "ok", "version": env!("CARGO_PKG_VERSION") }));
    }
}

/// The sum of all series of a metric; none where it has no series.
fn total(metrics: &str, name: &str) -> Option<f64> {
    let series = metrics
        .lines()
        .filter(|line| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(['{', ' '])));
    let value = |line: &str| line.rsplit(' ').next()?.parse::<f64>().ok();
    series.map(value).reduce(|sum, value| Some(sum? + value?)).flatten()
}

#[tokio::test]
async fn metrics_count_what_happens() {
    let app = TestApp::start().await;
    let metrics = || async {
        let answer = app.get("/metrics").send().await;
        assert_eq!(answer.header("content-type"), "text/plain; version=0.0.4");
        answer.text()
    };
    // Other tests count in the same process, so numbers may grow faster, but never less.
    let before = metrics().await;
    let request = json!({ "task": "Synchronization", "num_agents": 2, "max_round": 2 });
    let episode = app.create(request).await;
    let invalid = json!({ "round": 0, "response": "?" });
    app.act(episode.seat(0), &invalid).await;
    let other = json!({ "round": 0, "action": "UP" });
    app.post("/act").token(episode.seat(0)).json(&other).problem(409, "already_acted").await;
    app.all_act(&episode, "STAY").await;
    app.all_act(&episode, "STAY").await;
    let after = metrics().await;
    let growth = [
        ("swarmbench_episodes_created_total", 1.0),
        ("swarmbench_episodes_ended_total", 1.0),
        ("swarmbench_rounds_total", 2.0),
        ("swarmbench_acts_total", 4.0),
        ("swarmbench_act_refusals_total", 1.0),
        ("swarmbench_commits_total", 4.0),
        ("swarmbench_commit_entries_total", 7.0),
        ("swarmbench_http_requests_total", 7.0),
        ("swarmbench_http_request_seconds_count", 7.0),
        ("swarmbench_commit_seconds_count", 4.0),
    ];
    for (name, least) in growth {
        let grown = total(&after, name).unwrap_or(0.0) - total(&before, name).unwrap_or(0.0);
        assert!(grown >= least, "{name} grew by {grown}, not by {least} or more");
    }
    for gauge in ["swarmbench_episodes_unfinished", "swarmbench_connections"] {
        assert!(total(&after, gauge).is_some(), "{gauge}");
    }
    for kind in ["valid", "invalid"] {
        assert!(after.contains(&format!("swarmbench_acts_total{{kind=\"{kind}\"}}")), "{kind}");
    }
    // Every metric is described.
    let names = after.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split(' ').next());
    for name in names {
        assert!(after.contains(&format!("# HELP {name} ")), "{name} is not described");
    }
    assert!(!after.contains(&episode.id), "ids are no labels");
}

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

#[tokio::test]
async fn the_page_of_the_document_needs_no_other_host() {
    let app = TestApp::start().await;
    let page = app.get("/docs").send().await;
    assert_eq!((page.status, page.header("content-type")), (200, "text/html; charset=utf-8"));
    let page = page.text();
    let mut files = 0;
    // The files are named relative to a base on this server.
    let (_, base) = page.split_once("<base href=\"").expect("a base");
    let (base, links) = base.split_once('"').expect("a value");
    assert!(base.starts_with("/docs/"), "{base}");
    let links = ["src=\"", "href=\""].into_iter().flat_map(|name| links.split(name).skip(1));
    for link in links {
        let target = link.split('"').next().expect("a value");
        assert!(!target.starts_with('/') && !target.contains(':'), "{target}");
        let target = &format!("{base}{}", target.trim_start_matches("./"));
        let file = app.get(target).send().await;
        let media_type = match target.rsplit('.').next() {
            Some("css") => "text/css",
            Some("js") => "text/javascript",
            _ => "image/png",
        };
        assert_eq!((file.status, file.header("content-type")), (200, media_type), "{target}");
        if target.ends_with("initializer.js") {
            let script = file.text();
            assert!(script.contains("/openapi.json") && !script.contains("http"), "{script}");
        }
        files += 1;
    }
    assert!(files >= 4, "{page}");
    assert!(!page.contains("//"), "{page}");
    assert_eq!(app.get("/docs/files/nothing.js").send().await.status, 404);
}

#[tokio::test]
async fn every_answer_has_the_id_of_its_request() {
    let app = TestApp::start().await;
    let mut ids = Vec::new();
    for route in ["/healthz", "/obs", "/nowhere", "/docs"] {
        let answer = app.get(route).send().await;
        let id = answer.header("x-request-id").to_owned();
        assert!(id.len() >= 16, "{route}: {id:?}");
        ids.push(id);
    }
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), 4);
    let answer = app.get("/healthz").header("x-request-id", "mine-7").send().await;
    assert_eq!(answer.header("x-request-id"), "mine-7");
}

#[tokio::test]
async fn the_front_page_needs_no_other_host_and_trusts_no_names() {
    let app = TestApp::start().await;
    let page = app.get("/").send().await;
    assert_eq!((page.status, page.header("content-type")), (200, "text/html; charset=utf-8"));
    let page = page.text();
    for link in page.split("href=\"").skip(1) {
        let target = link.split('"').next().expect("a value");
        assert_eq!(app.get(target).send().await.status, 200, "{target}");
    }
    // What creators have named is set as text, never as markup.
    for banned in ["http:", "https:", "innerHTML", "document.write"] {
        assert!(!page.contains(banned), "{banned}");
    }
}

#[tokio::test]
async fn clients_do_not_name_what_is_counted() {
    let app = TestApp::start().await;
    for path in ["/healthz", "/nowhere", "/obs"] {
        for method in ["BREW", "PUT", "TRACE"] {
            let method = method.parse().expect("a method");
            app.call(method, path).send().await;
        }
    }
    app.get("/healthz").ok().await;
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("route=\"/healthz\",method=\"GET\""), "{metrics}");
    for thought_up in ["BREW", "PUT", "nowhere", "route=\"none\""] {
        assert!(!metrics.contains(thought_up), "{thought_up}: {metrics}");
    }
}
