//! A competition for one test, and what organizers and entrants do with it.

use std::time::Duration;

use serde_json::{Value, json};

use crate::app::{TestApp, list, number};

/// A competition as it was created.
pub(crate) struct Cup {
    pub(crate) id: String,
    pub(crate) created: Value,
}

/// Entrant of a competition.
pub(crate) struct Entrant {
    pub(crate) id: String,
    pub(crate) key: String,
}

/// An attempt that was started.
pub(crate) struct Attempt {
    pub(crate) run: String,
    pub(crate) swarm: String,
    pub(crate) number: u64,
}

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

/// Opens at 12:10 and closes at 13:00, as the clock of a test begins at noon: two attempts of two tasks on two seeds.
pub(crate) fn request() -> Value {
    json!({
        "name": "a cup", "opens_at": "2026-03-01T12:10:00Z", "closes_at": "2026-03-01T13:00:00Z",
        "suite": {
            "tasks": ["Synchronization", "Pursuit"], "seeds": 2,
            "settings": { "num_agents": 3, "max_round": 3 },
        },
        "clocks": { "round_deadline_s": 10, "idle_timeout_s": 7200 },
        "attempts": 2, "parallel": 2,
    })
}

/// A server with keys, whose time passes only by hand.
pub(crate) async fn server() -> TestApp {
    TestApp::builder().manual_clock().keys().start().await
}

pub(crate) async fn pass_minutes(app: &TestApp, minutes: u64) {
    app.pass(Duration::from_mins(minutes));
}

impl Cup {
    /// One like [`request`], with some fields changed.
    pub(crate) async fn with(app: &TestApp, change: Value) -> Self {
        let mut request = request();
        for (field, value) in change.as_object().expect("fields") {
            request[field] = value.clone();
        }
        let call = app.post("/api/v1/competitions").token(&app.organizer).json(&request);
        let created = call.ok().await;
        Self { id: text(&created["id"]), created }
    }

    /// One that is open.
    pub(crate) async fn open(app: &TestApp, change: Value) -> Self {
        let cup = Self::with(app, change).await;
        pass_minutes(app, 10).await;
        cup
    }

    /// One that is open, as servers created it before each task had seeds of its own.
    pub(crate) async fn open_before_seeds_by_task(app: &TestApp, change: Value) -> Self {
        let cup = Self::with(app, change).await;
        app.tamper(
            r#"UPDATE competitions SET definition = replace(definition, ',"seeds_by_task":true', '')"#,
        )
        .await;
        pass_minutes(app, 10).await;
        cup
    }

    pub(crate) fn path(&self, rest: &str) -> String {
        format!("/api/v1/competitions/{}{rest}", self.id)
    }

    pub(crate) async fn show(&self, app: &TestApp) -> Value {
        app.get(&self.path("")).ok().await
    }

    /// Registers somebody without a key.
    pub(crate) async fn enter(&self, app: &TestApp, name: &str) -> Entrant {
        let entry = json!({ "name": name, "model": format!("model of {name}") });
        let made = app.post(&self.path("/entrants")).json(&entry).ok().await;
        Entrant { id: text(&made["id"]), key: text(&made["key"]) }
    }

    /// Starts the next attempt.
    pub(crate) async fn start(&self, app: &TestApp, entrant: &Entrant) -> Attempt {
        let call = app.post(&self.path("/attempts")).token(&entrant.key).json(&json!({}));
        Attempt::of(&call.ok().await)
    }

    /// An organizer decides about an entrant.
    pub(crate) async fn change(&self, app: &TestApp, entrant: &Entrant, change: Value) -> Value {
        let path = self.path(&format!("/entrants/{}", entrant.id));
        let call = app.call(reqwest::Method::PATCH, &path).token(&app.organizer);
        call.json(&change).ok().await
    }

    pub(crate) async fn void(&self, app: &TestApp, attempt: &Attempt, reason: &str) -> Value {
        let path = self.path(&format!("/attempts/{}/void", attempt.run));
        app.post(&path).token(&app.organizer).json(&json!({ "reason": reason })).ok().await
    }

    /// The rows of the board for somebody with this token, or with none.
    pub(crate) async fn rows(&self, app: &TestApp, token: Option<&str>) -> Vec<Value> {
        let call = app.get(&self.path("/board"));
        let call = match token {
            Some(token) => call.token(token),
            None => call,
        };
        list(&call.ok().await["items"])
    }

    /// Asks until it is open to all.
    pub(crate) async fn closed(&self, app: &TestApp) -> Value {
        for _ in 0..10_000 {
            let shown = self.show(app).await;
            if shown["phase"] == "closed" {
                return shown;
            }
            app.pass(Duration::from_millis(100));
        }
        panic!("it is not closed: {}", self.show(app).await);
    }

    /// The export as anybody reads it.
    pub(crate) async fn export(&self, app: &TestApp) -> String {
        let path = format!("/api/v1/exports/competitions/{}", self.id);
        let answer = app.get(&path).send().await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.text()
    }
}

impl Attempt {
    pub(crate) fn of(started: &Value) -> Self {
        Self {
            run: text(&started["run"]),
            swarm: text(&started["swarm_token"]),
            number: number(&started["attempt"]),
        }
    }

    /// The observations that wait for an act.
    pub(crate) async fn look(&self, app: &TestApp) -> Value {
        app.get("/swarm/obs?limit=1024&wait=5").token(&self.swarm).ok().await
    }

    /// All seats of all open games act once: they play well in so many rounds, and do nothing then.
    pub(crate) async fn act(&self, app: &TestApp, skill: u64) -> bool {
        let seen = self.look(app).await;
        let act = |seen: &Value| {
            let (task, round) = (text(&seen["task"]["name"]), number(&seen["round"]));
            // All lights on, all off, and so on: each change scores.
            let is_wrong = seen["light_on"] != (round % 2 == 0);
            let switches = task == "Synchronization" && is_wrong && round < skill;
            json!({
                "episode": seen["episode"], "agent": seen["agent"], "round": seen["round"],
                "action": if switches { "SWITCH" } else { "STAY" },
            })
        };
        let acts: Vec<Value> = list(&seen["observations"]).iter().map(act).collect();
        if !acts.is_empty() {
            let body = json!({ "acts": acts });
            app.post("/swarm/act").token(&self.swarm).json(&body).ok().await;
        }
        seen["finished"] != true
    }

    /// Plays all games to their end.
    pub(crate) async fn play(&self, app: &TestApp, skill: u64) {
        for _ in 0..1_000 {
            if !self.act(app, skill).await {
                return;
            }
        }
        panic!("it does not end");
    }

    /// Episodes of the attempt, as an organizer sees each.
    pub(crate) async fn episodes(&self, app: &TestApp) -> Vec<Value> {
        let all = app.get("/api/v1/episodes?limit=1000").token(&app.organizer).ok().await;
        let mut own = Vec::new();
        for episode in list(&all["items"]) {
            if episode["run"] == self.run.as_str() {
                let path = format!("/api/v1/episodes/{}", text(&episode["id"]));
                own.push(app.get(&path).token(&app.organizer).ok().await);
            }
        }
        own
    }
}
