//! Health and metrics.

use serde_json::json;

use crate::app::TestApp;

#[tokio::test]
async fn a_server_says_that_it_lives_and_is_ready() {
    let app = TestApp::start().await;
    for route in ["/healthz", "/readyz"] {
        let health = app.get(route).ok().await;
        assert_eq!(health, json!({ "status": "ok", "version": env!("CARGO_PKG_VERSION") }));
    }
}

/// The sum of all series of a metric, if it has any.
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
