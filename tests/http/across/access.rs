//! Every route × every kind of token, from the OpenAPI document itself: a new route has to say here
//! who may use it.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use reqwest::Method;
use serde_json::{Value, json};

use crate::app::mcp::{result, tool_call};
use crate::app::{DOCUMENT, Episode, HttpAnswer, TestApp};
use crate::cup::{Attempt, Cup};

/// A kind of token, with what it stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    None,
    NoToken,
    BadChecksum,
    NoBearer,
    Seat,
    OtherSeat,
    SeatElsewhere,
    FinishedSeat,
    ReplacedSeat,
    Swarm,
    SwarmElsewhere,
    ReplacedSwarm,
    Run,
    RunElsewhere,
    ReplacedRun,
    ClaimedSeat,
    ClaimedSwarm,
    Owner,
    Member,
    ExpiredKey,
    RevokedKey,
    Entrant,
    Organizer,
}

use Kind::{
    BadChecksum, ClaimedSeat, ClaimedSwarm, Entrant, ExpiredKey, FinishedSeat, Member, NoBearer,
    NoToken, Organizer, OtherSeat, Owner, ReplacedRun, ReplacedSeat, ReplacedSwarm, RevokedKey,
    Run, RunElsewhere, Seat, SeatElsewhere, Swarm, SwarmElsewhere,
};

const KINDS: [Kind; 23] = [
    Kind::None,
    NoToken,
    BadChecksum,
    NoBearer,
    Seat,
    OtherSeat,
    SeatElsewhere,
    FinishedSeat,
    ReplacedSeat,
    Swarm,
    SwarmElsewhere,
    ReplacedSwarm,
    Run,
    RunElsewhere,
    ReplacedRun,
    ClaimedSeat,
    ClaimedSwarm,
    Owner,
    Member,
    ExpiredKey,
    RevokedKey,
    Entrant,
    Organizer,
];

impl Kind {
    /// Sent, and worth nothing.
    fn is_worthless(self) -> bool {
        matches!(
            self,
            NoToken
                | BadChecksum
                | NoBearer
                | ReplacedSeat
                | ReplacedSwarm
                | ReplacedRun
                | ExpiredKey
                | RevokedKey
        )
    }

    fn is_seat(self) -> bool {
        matches!(self, Seat | OtherSeat | SeatElsewhere | FinishedSeat | ClaimedSeat)
    }

    fn is_swarm(self) -> bool {
        matches!(self, Swarm | SwarmElsewhere | Run | RunElsewhere | ClaimedSwarm)
    }

    fn is_key(self) -> bool {
        matches!(self, Owner | Member | Entrant | Organizer)
    }

    /// True if the caller has the rights of the episode's creator.
    fn owns(self) -> bool {
        matches!(self, Swarm | Run | Owner | Organizer)
    }

    /// True if the caller has the rights of the run's creator.
    fn owns_run(self) -> bool {
        matches!(self, Run | Owner | Organizer)
    }

    /// The name of such a token in the OpenAPI document; empty for none, and `None` for what is worth nothing.
    fn scheme(self) -> Option<&'static str> {
        match self {
            Kind::None => Some(""),
            _ if self.is_seat() => Some("seat"),
            _ if self.is_swarm() => Some("swarm"),
            _ if self.is_key() => Some("key"),
            _ => None,
        }
    }
}

/// The episode that is asked for, and the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stage {
    visibility: &'static str,
    ended: bool,
    private: bool,
    /// True if somebody else holds a seat, too.
    mixed: bool,
}

/// Operations that ask for no token, and look at none.
const OPEN: [&str; 4] = ["show_health", "show_readiness", "show_metrics", "list_suites"];

impl Stage {
    /// True if a token is sent in this stage. Worthless ones are refused before the stage is looked at, so one stage of a
    /// public and one of a private server are enough.
    fn asks(self, kind: Kind) -> bool {
        // A run has no seats for others.
        let is_first = !self.mixed && !self.ended && (self.private || self.visibility == "owner");
        !(self.mixed && kind == Run) && (is_first || !kind.is_worthless())
    }
}

/// The status of the refusal, if the route refuses the token.
fn refusal(operation: &str, kind: Kind, stage: Stage) -> Option<u16> {
    // A seat claimed elsewhere gives no rights here.
    let claimed = stage.mixed && matches!(kind, ClaimedSeat | ClaimedSwarm);
    // A creator who plays with others sees no more than they do.
    let oversees = || kind == Organizer || (kind.owns() && !stage.mixed);
    let reads = || {
        let anyone = stage.visibility == "public" || stage.ended;
        let known = kind.is_key() || claimed || matches!(kind, Seat | OtherSeat | Swarm | Run);
        oversees() || (anyone && (!stage.private || known))
    };
    let invited = stage.mixed && kind.is_key();
    let knows = || reads() || kind.owns() || claimed || invited || matches!(kind, Seat | OtherSeat);
    // Callers who may know of a run may read it, too: only an attempt in a competition is known and not read.
    let reads_run = || {
        let anyone = stage.visibility == "public" || stage.ended;
        kind.owns_run() || (anyone && (!stage.private || kind.is_key()))
    };
    if OPEN.contains(&operation) {
        return None;
    }
    if kind.is_worthless() {
        return Some(401);
    }
    match operation {
        "get_obs" | "post_act" => match kind {
            Kind::None => Some(401),
            _ if kind.is_seat() => None,
            _ => Some(403),
        },
        "get_swarm_obs" | "post_swarm_act" => match kind {
            Kind::None => Some(401),
            _ if kind.is_swarm() => None,
            _ => Some(403),
        },
        "get_swarm_acts" => refusal_of_own_acts(kind, claimed),
        "create_episode" | "create_run" => match kind {
            Kind::None => Some(401),
            // It is for attempts in competitions.
            Entrant => Some(403),
            _ if kind.is_key() => None,
            _ => Some(403),
        },
        // What may not be read is left out.
        "list_episodes" | "list_models" | "list_runs" | "download_export" | "list_imports" => None,
        // No game was imported here; who reads one is tested in `exports.rs`.
        "show_import"
        | "show_imported_state"
        | "show_import_metrics"
        | "show_import_worth"
        | "show_import_replay"
        | "show_import_agent_round"
        | "show_import_scores" => Some(404),
        "show_run" | "stream_run_events" | "show_run_metrics" | "show_run_scores" => {
            (!reads_run()).then_some(404)
        }
        "abort_run" | "replace_run_token" => match () {
            () if !reads_run() => Some(404),
            () if !kind.owns_run() => Some(403),
            () => None,
        },
        "show_leaderboard" | "show_cross_play" => match kind {
            _ if !stage.private || kind.is_key() => None,
            Kind::None => Some(401),
            _ => Some(403),
        },
        "show_episode" | "list_claims" => (!knows()).then_some(404),
        "create_claim" => match kind {
            Kind::None => Some(401),
            // It is for attempts in competitions.
            Entrant => Some(403),
            _ if kind.is_key() => (!knows()).then_some(404),
            _ => Some(403),
        },
        "show_state" | "show_episode_metrics" | "show_replay" | "show_scores" | "stream_events" => {
            match () {
                () if !knows() => Some(404),
                () if !reads() => Some(403),
                () => None,
            }
        }
        "fork_episode" => match kind {
            Kind::None => Some(401),
            // It is for attempts in competitions.
            Entrant => Some(403),
            _ if !kind.is_key() => Some(403),
            _ if !knows() => Some(404),
            _ if !(stage.ended || (oversees() && !stage.mixed)) => Some(403),
            _ => None,
        },
        "read_journal" | "show_agent_round" | "show_verification" => match () {
            () if !knows() => Some(404),
            () if !reads() || !(stage.ended || oversees()) => Some(403),
            () => None,
        },
        "show_episode_worth" | "show_reference_line" => match () {
            () if !knows() => Some(404),
            () if !reads() || !(stage.ended || (oversees() && !stage.mixed)) => Some(403),
            () => None,
        },
        "start_episode" | "abort_episode" | "repeat_episode" => match () {
            () if !knows() => Some(404),
            () if !kind.owns() => Some(403),
            () => None,
        },
        "show_own_key" => keys_alone(kind),
        "create_key" | "list_keys" | "revoke_key" | "void_episode" | "list_audit"
        | "list_nodes" | "confirm_clock" => organizers_alone(kind),
        of_competitions => refusal_in_competitions(of_competitions, kind, stage),
    }
}

/// The same of the own earlier acts of a seat.
fn refusal_of_own_acts(kind: Kind, claimed: bool) -> Option<u16> {
    match kind {
        Kind::None => Some(401),
        SwarmElsewhere | RunElsewhere => Some(404),
        ClaimedSwarm if !claimed => Some(404),
        _ if kind.is_swarm() => None,
        _ => Some(403),
    }
}

/// The same of the routes of competitions.
fn refusal_in_competitions(operation: &str, kind: Kind, stage: Stage) -> Option<u16> {
    match operation {
        "create_competition"
        | "change_competition"
        | "cancel_competition"
        | "announce"
        | "create_codes"
        | "list_codes"
        | "list_contacts"
        | "revoke_codes"
        | "exclude_entrants"
        | "void_attempt"
        | "replace_entrant_key"
        // Here it is that of another; who erases itself is tested in `competitions/entrant.rs`.
        | "erase_entrant" => organizers_alone(kind),
        "list_competitions" | "show_competition" | "list_entrants" | "show_board"
        | "list_actions" | "list_announcements" => (stage.private && kind == Kind::None).then_some(401),
        "register_entrant" => match kind {
            Kind::None => None,
            _ if kind.is_key() => None,
            _ => Some(403),
        },
        "start_attempt" | "start_practice" => match kind {
            Kind::None => Some(401),
            Entrant => None,
            _ => Some(403),
        },
        "show_entrant" | "change_entrant" | "list_members" | "add_member" | "remove_member" => match kind {
            Kind::None => Some(401),
            Entrant | Organizer => None,
            _ => Some(403),
        },
        "list_attempts" => keys_alone(kind),
        "export_competition" => match kind {
            Kind::None if stage.private => Some(401),
            Organizer => None,
            _ => Some(403),
        },
        new => panic!("{new} is a new route: say here who may use it"),
    }
}

fn keys_alone(kind: Kind) -> Option<u16> {
    match kind {
        Kind::None => Some(401),
        _ if kind.is_key() => None,
        _ => Some(403),
    }
}

fn organizers_alone(kind: Kind) -> Option<u16> {
    match kind {
        Kind::None => Some(401),
        Organizer => None,
        _ => Some(403),
    }
}

/// An operation of the OpenAPI document.
struct Operation {
    method: Method,
    path: String,
    id: String,
    responses: Value,
    /// The kinds of tokens with which it may be asked, as [`Kind::scheme`] names them.
    tokens: Vec<String>,
}

fn operations() -> Vec<Operation> {
    let mut all = Vec::new();
    for (path, item) in DOCUMENT["paths"].as_object().expect("paths") {
        for (method, operation) in item.as_object().expect("operations") {
            let one_of = operation["security"].as_array().expect("kinds of tokens");
            let token = |one: &Value| one.as_object()?.keys().next().cloned();
            all.push(Operation {
                method: method.to_uppercase().parse().expect("a method"),
                path: path.clone(),
                id: operation["operationId"].as_str().expect("an id").to_owned(),
                responses: operation["responses"].clone(),
                tokens: one_of.iter().map(|one| token(one).unwrap_or_default()).collect(),
            });
        }
    }
    assert!(all.len() >= 18, "{}", all.len());
    all
}

/// A server with tokens of all kinds.
struct World {
    app: TestApp,
    owner: String,
    member: String,
    expired: String,
    revoked: String,
    elsewhere: Episode,
    /// A claim in an episode without requests.
    claimed: Value,
    finished: Episode,
    replaced: Episode,
    cup: Cup,
    entrant: crate::cup::Entrant,
    /// Another member of the entrant's team.
    teammate: String,
    attempt: Attempt,
    /// Counts names that nobody else has.
    names: AtomicU64,
    run_elsewhere: String,
    replaced_run: String,
    /// Places of requests that are refused: these change nothing, so all of a stage have the same.
    refused: Mutex<Vec<(Stage, Wanted, AccessScene)>>,
}

/// Parts of a place that a request needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Wanted {
    /// The path names a run.
    is_of_run: bool,
    /// The token is that of a run.
    by_run: bool,
}

/// An episode in its stage, a claim of one of its seats, and a run.
#[derive(Clone, Debug)]
struct AccessScene {
    episode: Episode,
    claimed: Value,
    run: Value,
}

fn request(visibility: &str) -> Value {
    json!({ "task": "Synchronization", "num_agents": 3, "visibility": visibility })
}

/// A run with one game.
fn run_request(visibility: &str) -> Value {
    let suite = json!({
        "name": "one game", "tasks": ["Synchronization"], "seeds": [1], "settings": { "num_agents": 3 },
    });
    json!({ "suite": suite, "model": "a model", "visibility": visibility })
}

/// The same with one seat for somebody else.
fn mixed(visibility: &str) -> Value {
    let mut request = request(visibility);
    request["open_seats"] = json!(1);
    request
}

async fn create(app: &TestApp, key: &str, request: &Value) -> Value {
    app.post("/api/v1/episodes").token(key).json(request).ok().await
}

async fn claim(app: &TestApp, key: &str, episode: &Episode) -> Value {
    app.post(&episode.path("/claims")).token(key).json(&json!({})).ok().await
}

impl World {
    async fn run(&self, visibility: &str) -> Value {
        let call = self.app.post("/api/v1/runs").token(&self.owner);
        call.json(&run_request(visibility)).ok().await
    }

    async fn new(private: bool) -> Self {
        let builder = TestApp::builder().manual_clock().keys();
        let app = builder.access(|access| access.private = private).start().await;
        let (owner, _) = app.key(json!({ "name": "owner" })).await;
        let (member, _) = app.key(json!({ "name": "member" })).await;
        let ends = json!({ "name": "expired", "expires_at": "2026-03-01T12:00:01Z" });
        let (expired, _) = app.key(ends).await;
        let (revoked, id) = app.key(json!({ "name": "revoked" })).await;
        for key in [&expired, &revoked] {
            app.get("/api/v1/episodes").token(key).ok().await;
        }
        app.pass(std::time::Duration::from_secs(1));
        app.delete(&format!("/api/v1/keys/{id}")).token(&app.organizer).ok().await;
        let elsewhere = app.create_with(&member, request("owner")).await;
        let open = Episode::of(&create(&app, &owner, &mixed("owner")).await);
        let claimed = claim(&app, &member, &open).await;
        let finished = app.create_with(&member, request("owner")).await;
        app.delete(&finished.path("")).token(&member).ok().await;
        let create = || {
            let call = app.post("/api/v1/episodes").token(&owner).json(&request("owner"));
            call.header("Idempotency-Key", "once")
        };
        let replaced = Episode::of(&create().ok().await);
        // The tokens are known and remembered before they are replaced.
        app.obs(replaced.seat(0)).await;
        app.swarm_obs(&replaced).await;
        create().ok().await;
        let cup = Cup::with(
            &app,
            json!({ "opens_at": "2026-03-01T12:00:00Z", "attempts": 100, "entries_per_key": 100 }),
        );
        let cup = cup.await;
        let entrant = cup.enter(&app, "a team").await;
        let attempt = cup.start(&app, &entrant).await;
        let names = AtomicU64::new(0);
        let create = || app.post("/api/v1/runs").token(&member).json(&run_request("owner"));
        let token = |run: &Value| run["swarm_token"].as_str().expect("a token").to_owned();
        let run_elsewhere = token(&create().ok().await);
        let run = create().ok().await;
        let replaced_run = token(&run);
        app.get("/swarm/obs").token(&replaced_run).ok().await;
        let path = format!("/api/v1/runs/{}/token", run["id"].as_str().expect("an id"));
        app.post(&path).token(&member).ok().await;
        let team = cup.path(&format!("/entrants/{}/members", entrant.id));
        let added = app.post(&team).token(&entrant.key).json(&json!({ "name": "somebody" }));
        let teammate = added.ok().await["id"].as_str().expect("an id").to_owned();
        Self {
            app,
            owner,
            member,
            expired,
            revoked,
            elsewhere,
            claimed,
            finished,
            replaced,
            cup,
            entrant,
            teammate,
            attempt,
            names,
            run_elsewhere,
            replaced_run,
            refused: Mutex::default(),
        }
    }

    /// The value of the header `Authorization`.
    fn header(&self, kind: Kind, episode: &Episode, claimed: &Value) -> Option<String> {
        let token = match kind {
            Kind::None => return None,
            NoBearer => return Some(format!("Basic {}", episode.seat(0))),
            NoToken => "nonsense",
            BadChecksum => {
                let seat = episode.seat(0);
                let last = if seat.ends_with('a') { 'b' } else { 'a' };
                return Some(format!("Bearer {}{last}", &seat[..seat.len() - 1]));
            }
            Seat => episode.seat(0),
            OtherSeat => episode.seat(1),
            SeatElsewhere => self.elsewhere.seat(0),
            FinishedSeat => self.finished.seat(0),
            ReplacedSeat => self.replaced.seat(0),
            // Of a game of a run it is the run's.
            Swarm | Run => &episode.swarm,
            SwarmElsewhere => &self.elsewhere.swarm,
            ReplacedSwarm => &self.replaced.swarm,
            RunElsewhere => &self.run_elsewhere,
            ReplacedRun => &self.replaced_run,
            ClaimedSeat => claimed["seats"][0]["token"].as_str().expect("a token"),
            ClaimedSwarm => claimed["swarm_token"].as_str().expect("a token"),
            Owner => &self.owner,
            Member => &self.member,
            ExpiredKey => &self.expired,
            RevokedKey => &self.revoked,
            Entrant => &self.entrant.key,
            Organizer => &self.app.organizer,
        };
        Some(format!("Bearer {token}"))
    }

    /// A new place.
    async fn new_place(&self, stage: Stage, wanted: Wanted) -> AccessScene {
        let Wanted { is_of_run, by_run } = wanted;
        let run = if is_of_run || by_run { self.run(stage.visibility).await } else { json!(null) };
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        let request = if stage.mixed { mixed } else { request };
        let created = create(&self.app, &self.owner, &request(stage.visibility)).await;
        let mut episode = Episode::of(&created);
        if by_run && !stage.mixed {
            episode.id = text(&run["games"][0]["episode"]);
            episode.swarm = text(&run["swarm_token"]);
        }
        let claimed = if stage.mixed {
            claim(&self.app, &self.member, &episode).await
        } else {
            self.claimed.clone()
        };
        if stage.ended {
            self.app.delete(&episode.path("")).token(&self.owner).ok().await;
            if is_of_run {
                let path = format!("/api/v1/runs/{}", text(&run["id"]));
                let ended = self.app.delete(&path).token(&self.owner).send().await;
                assert!([200, 409].contains(&ended.status), "{}", ended.text());
            }
        }
        AccessScene { episode, claimed, run }
    }

    async fn place(&self, stage: Stage, wanted: Wanted, is_refused: bool) -> AccessScene {
        let known = self.refused.lock().expect("no panics").iter().find_map(|(of, what, place)| {
            (is_refused && (*of, *what) == (stage, wanted)).then(|| place.clone())
        });
        if let Some(place) = known {
            return place;
        }
        let place = self.new_place(stage, wanted).await;
        if is_refused {
            self.refused.lock().expect("no panics").push((stage, wanted, place.clone()));
        }
        place
    }

    /// Asks as somebody would who is entitled to.
    async fn ask(
        &self,
        (method, path, operation): (&Method, &str, &str),
        kind: Kind,
        stage: Stage,
        is_refused: bool,
    ) -> HttpAnswer {
        let is_of_run = path.starts_with("/api/v1/runs/{id}");
        let wanted = Wanted { is_of_run, by_run: kind == Run };
        let AccessScene { episode, claimed, run } = self.place(stage, wanted, is_refused).await;
        let text = |value: &Value| value.as_str().expect("a text").to_owned();
        let id = match operation {
            "revoke_key" => self.app.key(json!({ "name": "to be revoked" })).await.1,
            "cancel_competition" => Cup::with(&self.app, json!({})).await.id,
            _ if path.contains("/competitions") => self.cup.id.clone(),
            _ if is_of_run => text(&run["id"]),
            _ => episode.id.clone(),
        };
        let entrant = match operation {
            // It would be gone for what follows.
            "erase_entrant" | "replace_entrant_key" if matches!(kind, Entrant | Organizer) => {
                let number = self.names.fetch_add(1, Ordering::Relaxed);
                self.cup.enter(&self.app, &format!("somebody {number}")).await.id
            }
            _ => self.entrant.id.clone(),
        };
        let path = path.replace("{id}", &id).replace("{entrant}", &entrant);
        let path = path.replace("{member}", &self.teammate);
        let path = path.replace("{run}", &self.attempt.run).replace("{file}", "acts.jsonl");
        let path = path.replace("{round}", "0").replace("{agent}", "Agent_0");
        let path = if operation == "get_swarm_acts" {
            let is_claimed = kind == ClaimedSwarm && stage.mixed;
            let own =
                if is_claimed { text(&claimed["seats"][0]["agent"]) } else { "Agent_0".to_owned() };
            format!("{path}?episode={}&agent={own}", episode.id)
        } else {
            path
        };
        let mut call = self.app.call(method.clone(), &path);
        if let Some(header) = self.header(kind, &episode, &claimed) {
            call = call.header("authorization", &header);
        }
        call = match operation {
            "post_act" => call.json(&json!({ "round": 0, "action": "STAY" })),
            "the tool look" => call.json(&tool_call("look", &json!({}))),
            "the tool act" => {
                let act = json!({ "round": 0, "action": "STAY", "wait_s": 0 });
                call.json(&tool_call("act", &act))
            }
            "post_swarm_act" => {
                call.json(&json!({ "acts": [episode.act(&json!("Agent_2"), 0, "STAY")] }))
            }
            "create_episode" => call.json(&request("owner")),
            "create_claim" | "change_competition" => call.json(&json!({})),
            "fork_episode" => call.json(&json!({ "round": 0 })),
            "create_key" => call.json(&json!({ "name": "somebody" })),
            "create_competition" => call.json(&crate::cup::request()),
            "create_codes" => call.json(&json!({ "labels": ["somebody"] })),
            "add_member" => {
                let number = self.names.fetch_add(1, Ordering::Relaxed);
                call.json(&json!({ "name": format!("somebody {number}") }))
            }
            "register_entrant" => {
                let number = self.names.fetch_add(1, Ordering::Relaxed);
                call.json(&json!({ "name": format!("somebody {number}"), "model": "m" }))
            }
            "change_entrant" => {
                call.json(&if kind == Organizer { json!({ "vouched": true }) } else { json!({}) })
            }
            "revoke_codes" => {
                let path = self.cup.path("/codes");
                let labels = json!({ "labels": ["nobody"] });
                self.app.post(&path).token(&self.app.organizer).json(&labels).ok().await;
                call.json(&labels)
            }
            "announce" => call.json(&json!({ "text": "news" })),
            "exclude_entrants" => call.json(&json!({ "name": "nobody-*" })),
            "start_attempt" | "start_practice" => call.json(&json!({ "entrant": self.entrant.id })),
            "void_attempt" => call.json(&json!({ "reason": "a power cut" })),
            "create_run" => call.json(&run_request("owner")),
            "void_episode" | "repeat_episode" | "cancel_competition" => {
                call.json(&json!({ "reason": "a test" }))
            }
            _ => call,
        };
        if ["stream_events", "stream_run_events"].contains(&operation) {
            // What is streamed does not end before the episode.
            return HttpAnswer::without_body(&call.open().await);
        }
        let answer = call.send().await;
        let elsewhere = [SwarmElsewhere, RunElsewhere].contains(&kind)
            || (kind == ClaimedSwarm && !stage.mixed);
        if operation == "post_swarm_act" && elsewhere {
            // It is good for its own episodes only.
            assert_eq!(answer.json()["receipts"][0]["code"], "not_found");
        }
        answer
    }
}

async fn check_all(private: bool, mixed: bool, stages: &[(&'static str, bool)]) {
    let world = World::new(private).await;
    let mut refused = 0;
    for (visibility, ended) in stages.iter().copied() {
        let stage = Stage { visibility, ended, private, mixed };
        for Operation { method, path, id: operation, responses, .. } in operations() {
            for kind in KINDS.into_iter().filter(|kind| stage.asks(*kind)) {
                let refused_with = refusal(&operation, kind, stage);
                let route = (&method, path.as_str(), operation.as_str());
                let answer = world.ask(route, kind, stage, refused_with.is_some()).await;
                let what = || format!("{operation} with {kind:?} in {stage:?}: {}", answer.text());
                if let Some(expected) = refused_with {
                    assert_eq!(answer.status, expected, "{}", what());
                    refused += 1;
                } else {
                    let good = (200..300).contains(&answer.status) || answer.status == 409;
                    assert!(good, "{} {}", answer.status, what());
                }
                let documented = responses.get(answer.status.to_string()).is_some();
                assert!(documented, "{} is not documented: {}", answer.status, what());
            }
        }
    }
    assert!(refused > 100, "{refused}");
}

/// The tools of `/mcp` are refused to whom `/obs` and `/act` are.
async fn check_tools(private: bool, mixed: bool, stages: &[(&'static str, bool)]) {
    let world = World::new(private).await;
    for (visibility, ended) in stages.iter().copied() {
        let stage = Stage { visibility, ended, private, mixed };
        for (tool, operation) in [("the tool look", "get_obs"), ("the tool act", "post_act")] {
            for kind in KINDS.into_iter().filter(|kind| stage.asks(*kind)) {
                let refused_with = refusal(operation, kind, stage);
                let route = (&Method::POST, "/mcp", tool);
                let answer = world.ask(route, kind, stage, refused_with.is_some()).await;
                let result = result(&answer);
                let status = result["structuredContent"]["status"].as_u64();
                if let Some(expected) = refused_with {
                    assert_eq!(status, Some(expected.into()), "{tool} with {kind:?} in {stage:?}");
                } else {
                    let good = result["isError"] == false || status == Some(409);
                    assert!(good, "{tool} with {kind:?} in {stage:?}: {result}");
                }
            }
        }
    }
}

/// The stages in which every operation is asked with every kind of token, below.
const STAGES: [Stage; 7] = {
    const fn stage(visibility: &'static str, ended: bool, private: bool, mixed: bool) -> Stage {
        Stage { visibility, ended, private, mixed }
    }
    [
        stage("owner", false, false, false),
        stage("public", false, false, false),
        stage("owner", true, false, false),
        stage("owner", false, false, true),
        stage("public", false, false, true),
        stage("public", false, true, false),
        stage("owner", true, true, false),
    ]
};

/// A kind of token that the document names is accepted in some stage; any other is worth no more than no token.
#[test]
fn the_document_names_the_tokens_of_each_operation() {
    for Operation { id, tokens, .. } in operations() {
        let is_answered = |kind, stage| refusal(&id, kind, stage).is_none();
        for name in tokens.iter().filter(|name| !name.is_empty()) {
            let mut kinds = KINDS.into_iter().filter(|kind| kind.scheme() == Some(name));
            let is_accepted = |kind| {
                STAGES.iter().any(|stage| !matches!(refusal(&id, kind, *stage), Some(401 | 403)))
            };
            assert!(kinds.any(is_accepted), "{id} accepts no {name}");
        }
        let is_named = |kind: &Kind| tokens.iter().any(|name| kind.scheme() == Some(name));
        for kind in KINDS.into_iter().filter(|kind| !is_named(kind)) {
            let gains =
                |stage: &&Stage| is_answered(kind, **stage) && !is_answered(Kind::None, **stage);
            let gained = STAGES.iter().find(gains);
            assert!(gained.is_none(), "{id} is answered with {kind:?} in {gained:?}");
        }
        let needs_one = STAGES.iter().all(|stage| refusal(&id, Kind::None, *stage) == Some(401));
        assert!(is_named(&Kind::None) || needs_one, "{id} is answered without a token");
        assert_eq!(tokens == [""], OPEN.contains(&id.as_str()), "{id}");
    }
}

/// A server without keys asks for no token where the document names requests without one.
#[tokio::test]
async fn requests_without_a_token() {
    let app = TestApp::start().await;
    for Operation { method, path, id, tokens, .. } in operations() {
        if tokens.iter().any(String::is_empty) {
            let path = path.replace("{round}", "0").replace(['{', '}'], "");
            let answer = app.call(method, &path).send().await;
            assert_ne!(answer.status, 401, "{id}: {}", answer.text());
        }
    }
}

#[tokio::test]
async fn tools_of_mcp() {
    check_tools(false, false, &[("owner", false), ("public", false), ("owner", true)]).await;
    check_tools(false, true, &[("owner", false)]).await;
    check_tools(true, false, &[("public", false), ("owner", true)]).await;
}

#[tokio::test]
async fn running_episodes_of_their_owner() {
    check_all(false, false, &[("owner", false)]).await;
}

#[tokio::test]
async fn running_public_episodes() {
    check_all(false, false, &[("public", false)]).await;
}

#[tokio::test]
async fn episodes_that_have_ended() {
    check_all(false, false, &[("owner", true)]).await;
}

#[tokio::test]
async fn running_episodes_of_several_holders() {
    check_all(false, true, &[("owner", false), ("public", false)]).await;
}

#[tokio::test]
async fn a_private_server() {
    check_all(true, false, &[("public", false), ("owner", true)]).await;
}

/// Answers of a route depend on the caller, too.
#[tokio::test]
async fn lists_and_seeds_are_shown_to_those_who_may_read_them() {
    let world = World::new(false).await;
    let episode = world.app.create_with(&world.owner, request("owner")).await;
    for kind in KINDS.into_iter().filter(|kind| !kind.is_worthless() && *kind != Run) {
        let ask = |path: &str| {
            let call = world.app.get(path);
            match world.header(kind, &episode, &world.claimed) {
                Some(header) => call.header("authorization", &header),
                None => call,
            }
        };
        let items = ask("/api/v1/episodes?limit=1000").ok().await["items"].clone();
        let listed = crate::app::list(&items).iter().any(|item| item["id"] == episode.id.as_str());
        assert_eq!(listed, kind.owns(), "{kind:?}");
        let shown = ask(&episode.path("")).send().await;
        if shown.status == 200 {
            assert_eq!(shown.json()["config"]["seed"].is_u64(), kind.owns(), "{kind:?}");
        }
    }
}
