//! An honest entrant beside the attackers: it enters a competition again and again, plays every attempt to its end by
//! `/swarm/obs` and `/swarm/act`, and plays games of its own seat by seat by `/obs` and `/act`. It keeps to a pace, so
//! that the latency of its acts depends on the server and not on its own pace.

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::Deserialize;
use serde_json::{Value, json};
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval, sleep};

use crate::attacks::measure::Tally;
use crate::attacks::wire::{Request, Source, Wire, WireAnswer};

/// A seat acts this often, unless the server is slower.
const PACE: Duration = Duration::from_millis(50);

/// Interval of requests for health, each on a new connection.
const HEALTH_PACE: Duration = Duration::from_millis(100);

/// Interval of the honest side's errands beside its games.
const ERRAND_PACE: Duration = Duration::from_secs(1);

/// For how long a request is tried again before it has failed.
const PATIENCE: Duration = Duration::from_secs(30);

/// Absence of the server after which its clients give up.
const AWAY: Duration = Duration::from_mins(1);

/// Agents of each game: the standard setting.
const AGENTS: usize = 12;

/// Failures that are reported with their text.
const FAILURES_MAX: usize = 8;

const TASKS: [&str; 5] = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"];

/// Place of the honest side's games.
#[derive(Clone, Debug)]
pub(crate) struct HonestPlace {
    pub(crate) cup: String,
    /// A member's key, for games of its own.
    pub(crate) member: String,
    /// The key of who watches over the competition.
    pub(crate) organizer: String,
    pub(crate) rounds: u32,
}

/// The results of playing for a while.
#[derive(Debug, Default)]
pub(crate) struct Score {
    /// From sending an act until its receipt: by `/act`, `/act?wait` and `/swarm/act`. Acts during which the attack killed
    /// the server are not among them: their time is that of its start, which has a bound of its own.
    pub(crate) acts: [Latencies; 3],
    pub(crate) health: Latencies,
    pub(crate) begun: AtomicU32,
    pub(crate) finished: AtomicU32,
    /// Acts that came when the round was over.
    pub(crate) moves_lost: AtomicU32,
    /// Other things than playing, by name: how long they took.
    errands: Mutex<BTreeMap<&'static str, Vec<Duration>>>,
    failures: Mutex<Vec<String>>,
    pub(crate) tally: Arc<Tally>,
}

impl Score {
    fn failed(&self, what: &str, error: &dyn std::fmt::Display) {
        let mut failures = self.failures.lock().expect("nothing panics while it holds this");
        if failures.len() < FAILURES_MAX {
            failures.push(format!("{what}: {error}"));
        }
    }

    pub(crate) fn failures(&self) -> Vec<String> {
        self.failures.lock().expect("nothing panics while it holds this").clone()
    }

    pub(crate) fn spreads(&self) -> [Spread; 3] {
        [0, 1, 2].map(|kind: usize| self.acts[kind].spread())
    }

    fn took(&self, errand: &'static str, time: Duration) {
        let mut errands = self.errands.lock().expect("nothing panics while it holds this");
        errands.entry(errand).or_default().push(time);
    }

    /// The longest time of each errand.
    pub(crate) fn errands(&self) -> String {
        let errands = self.errands.lock().expect("nothing panics while it holds this");
        let longest = errands.iter().map(|(name, times)| {
            let most = times.iter().max().copied().unwrap_or_default();
            format!("{name} {} ms ({})", most.as_millis(), times.len())
        });
        longest.collect::<Vec<_>>().join(", ")
    }
}

/// An honest entrant and its games.
pub(crate) struct Honest {
    at: watch::Receiver<SocketAddr>,
    place: HonestPlace,
    entered: AtomicU64,
    /// Finished games of its own, whose journals it reads.
    games: Mutex<Vec<String>>,
    /// Invitation codes that nobody has used.
    codes: Mutex<Vec<String>>,
}

#[derive(Debug, Deserialize)]
struct Seen {
    #[serde(default)]
    episode: String,
    #[serde(default)]
    agent: String,
    round: u32,
    #[serde(default)]
    actions: Vec<String>,
    #[serde(default)]
    alive: bool,
    #[serde(default)]
    result: Option<Value>,
}

#[derive(Debug, Deserialize)]
struct Waiting {
    observations: Vec<Seen>,
    finished: bool,
}

/// Action of an agent in a round: anything, but always the same.
fn action(seen: &Seen) -> &str {
    let place =
        seen.round as usize + seen.agent.len() + seen.agent.bytes().map(usize::from).sum::<usize>();
    seen.actions.get(place % seen.actions.len().max(1)).map_or("STAY", String::as_str)
}

impl Honest {
    pub(crate) fn new(
        at: watch::Receiver<SocketAddr>,
        place: HonestPlace,
        codes: Vec<String>,
    ) -> Arc<Self> {
        let (games, codes) = (Mutex::default(), Mutex::new(codes));
        Arc::new(Self { at, place, entered: AtomicU64::new(0), games, codes })
    }

    /// Plays for a time, and then what it has begun to its end.
    pub(crate) async fn play(self: &Arc<Self>, time: Duration, score: &Arc<Score>) {
        let end = Instant::now() + time;
        let mut playing = JoinSet::new();
        for number in 0..4 {
            let (honest, score) = (Arc::clone(self), Arc::clone(score));
            playing.spawn(async move {
                match number {
                    0 => honest.attempts(end, &score).await,
                    1 => honest.seats(end, &score).await,
                    2 => honest.health(end, &score).await,
                    _ => honest.errands(end, &score).await,
                }
            });
        }
        while let Some(ended) = playing.join_next().await {
            if let Err(error) = ended {
                score.failed("playing", &error);
            }
        }
    }

    fn wire(&self, score: &Score, client: u8) -> Wire {
        let source = Source::behind_proxy(Ipv4Addr::new(192, 0, 2, client));
        Wire::new(*self.at.borrow(), source, &score.tally).keeping_all()
    }

    /// Asks until there is an answer that is not "later"; the server may be away for a while. An organizer is told that only
    /// where no connection is free: then the server does not know who asks.
    async fn ask(&self, wire: &mut Wire, request: &Request) -> io::Result<WireAnswer> {
        self.ask_again(wire, request).await.map(|(answer, _)| answer)
    }

    /// An answer as from `ask`, and whether the server was killed and started meanwhile: it may have done what it was asked for
    /// before.
    async fn ask_again(
        &self,
        wire: &mut Wire,
        request: &Request,
    ) -> io::Result<(WireAnswer, bool)> {
        let began = Instant::now();
        let mut starts = self.at.clone();
        starts.mark_unchanged();
        let was_started = || starts.has_changed().unwrap_or_default();
        let is_organizers = request.token.as_ref() == Some(&self.place.organizer);
        loop {
            wire.to = *self.at.borrow();
            let (patience, pause) = match wire.ask(request).await {
                Ok(answer)
                    if answer.is_later() && (!is_organizers || answer.is_of_connections()) =>
                {
                    let pause = answer.retry_after.unwrap_or(Duration::from_secs(1));
                    if began.elapsed() + pause > PATIENCE {
                        return Ok((answer, was_started()));
                    }
                    (PATIENCE, pause)
                }
                Ok(answer) => return Ok((answer, was_started())),
                Err(error) if began.elapsed() > AWAY => return Err(error),
                Err(_) => (AWAY, Duration::from_millis(50)),
            };
            if began.elapsed() > patience {
                return Err(io::ErrorKind::TimedOut.into());
            }
            sleep(pause).await;
        }
    }

    /// Enters, starts an attempt and plays it to its end, again and again.
    async fn attempts(&self, end: Instant, score: &Score) {
        let mut wire = self.wire(score, 1);
        loop {
            score.begun.fetch_add(1, Ordering::Relaxed);
            match self.attempt(&mut wire, score).await {
                Ok(()) => {
                    score.finished.fetch_add(1, Ordering::Relaxed);
                }
                Err(error) => {
                    score.failed("attempt", &error);
                    sleep(Duration::from_secs(1)).await;
                }
            }
            if Instant::now() >= end {
                return;
            }
        }
    }

    async fn attempt(&self, wire: &mut Wire, score: &Score) -> io::Result<()> {
        let key = self.enter(wire, score).await?;
        let path = format!("/api/v1/competitions/{}/attempts", self.place.cup);
        let began = Instant::now();
        // The server may be killed after it has started the attempt, and before it says so.
        let head = "idempotency-key: start\r\n".to_owned();
        let start = Request { head, ..Request::post(&path, &json!({})).with(&key) };
        let started: Value = self.ask(wire, &start).await?.read()?;
        score.took("start", began.elapsed());
        let token = text(&started, "/swarm_token")?;
        self.play_all(wire, score, &token).await?;
        let list: Value = self.ask(wire, &Request::get(&path).with(&key)).await?.read()?;
        let attempt = &list["items"][0];
        if attempt["status"] == "finished" && attempt["games"] == attempt["games_ended"] {
            return Ok(());
        }
        Err(io::Error::other(format!("the attempt ended so: {attempt}")))
    }

    /// Enters as somebody new; its key.
    async fn enter(&self, wire: &mut Wire, score: &Score) -> io::Result<String> {
        let path = format!("/api/v1/competitions/{}/entrants", self.place.cup);
        loop {
            let number = self.entered.fetch_add(1, Ordering::Relaxed);
            let body = json!({ "name": format!("honest {number}"), "model": "patience" });
            let began = Instant::now();
            let (entered, was_started) = self.ask_again(wire, &Request::post(&path, &body)).await?;
            // A server that was killed after it had stored the entry has taken the name, and the key is lost.
            if was_started && entered.status == 422 {
                continue;
            }
            score.took("enter", began.elapsed());
            return text(&entered.read()?, "/key");
        }
    }

    async fn play_all(&self, wire: &mut Wire, score: &Score, token: &str) -> io::Result<()> {
        let look = Request::get("/swarm/obs?wait=20&limit=1024").with(token);
        let mut pace = interval(PACE);
        pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            pace.tick().await;
            let waiting: Waiting = self.ask(wire, &look).await?.read()?;
            if waiting.finished {
                return Ok(());
            }
            if waiting.observations.is_empty() {
                continue;
            }
            let acts = waiting.observations.iter().map(|seen| {
                json!({ "episode": seen.episode, "agent": seen.agent, "round": seen.round,
                        "action": action(seen), "message": "all is well" })
            });
            let acts: Vec<_> = acts.collect();
            let act = Request::post("/swarm/act", &json!({ "acts": acts })).with(token);
            let began = Instant::now();
            let (answer, was_started) = self.ask_again(wire, &act).await?;
            if !was_started {
                score.acts[2].record([began.elapsed()]);
            }
            let receipts: Value = answer.read()?;
            let receipts = receipts["receipts"].as_array().map_or(&[][..], Vec::as_slice);
            let is_lost = |receipt: &&Value| receipt["code"] == "round_over";
            let lost = receipts.iter().filter(is_lost).count();
            score.moves_lost.fetch_add(u32::try_from(lost).unwrap_or(u32::MAX), Ordering::Relaxed);
        }
    }

    /// Plays games of its own, each seat by itself.
    async fn seats(self: &Arc<Self>, end: Instant, score: &Arc<Score>) {
        for task in TASKS.into_iter().cycle() {
            score.begun.fetch_add(1, Ordering::Relaxed);
            match self.game(task, score).await {
                Ok(episode) => {
                    score.finished.fetch_add(1, Ordering::Relaxed);
                    self.games.lock().expect("nothing panics while it holds this").push(episode);
                }
                Err(error) => {
                    score.failed("game", &error);
                    sleep(Duration::from_secs(1)).await;
                }
            }
            if Instant::now() >= end {
                return;
            }
        }
    }

    async fn game(self: &Arc<Self>, task: &str, score: &Arc<Score>) -> io::Result<String> {
        let mut wire = self.wire(score, 2);
        let body = json!({ "task": task, "num_agents": AGENTS, "max_round": self.place.rounds,
                           "model": "patience", "visibility": "public" });
        let create = Request::post("/api/v1/episodes", &body).with(&self.place.member);
        let began = Instant::now();
        let created: Value = self.ask(&mut wire, &create).await?.read()?;
        score.took("create", began.elapsed());
        let episode = text(&created, "/id")?;
        let mut seats = JoinSet::new();
        for number in 0..AGENTS {
            let token = text(&created, &format!("/seats/{number}/token"))?;
            let (honest, score) = (Arc::clone(self), Arc::clone(score));
            // Some seats wait for the next observation with the same call.
            let waits = number % 6 == 5;
            seats.spawn(async move { honest.seat(&token, waits, &score).await });
        }
        while let Some(ended) = seats.join_next().await {
            ended.map_err(io::Error::other)??;
        }
        let shown = Request::get(format!("/api/v1/episodes/{episode}"));
        let shown: Value = self.ask(&mut wire, &shown).await?.read()?;
        if shown["status"] == "finished" {
            return Ok(episode);
        }
        Err(io::Error::other(format!("the game ended so: {}", shown["status"])))
    }

    async fn seat(&self, token: &str, waits: bool, score: &Score) -> io::Result<()> {
        let mut wire = self.wire(score, 3);
        let mut pace = interval(PACE);
        pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut seen: Seen =
            self.ask(&mut wire, &Request::get("/obs").with(token)).await?.read()?;
        while seen.alive && seen.result.is_none() {
            pace.tick().await;
            let body = json!({ "round": seen.round, "action": action(&seen), "message": "here" });
            let path = if waits { "/act?wait=20" } else { "/act" };
            let act = Request::post(path, &body).with(token);
            let began = Instant::now();
            let (answer, was_started) = self.ask_again(&mut wire, &act).await?;
            if !was_started {
                score.acts[usize::from(waits)].record([began.elapsed()]);
            }
            match answer.status {
                200 => {}
                409 => {
                    score.moves_lost.fetch_add(1, Ordering::Relaxed);
                }
                status => return Err(io::Error::other(format!("{status} {}", answer.text()))),
            }
            let look = format!("/obs?after={}&wait=20", seen.round);
            loop {
                let next: Seen =
                    self.ask(&mut wire, &Request::get(&look).with(token)).await?.read()?;
                if next.round > seen.round || next.result.is_some() {
                    seen = next;
                    break;
                }
            }
        }
        Ok(())
    }

    async fn health(&self, end: Instant, score: &Score) {
        let mut pace = interval(HEALTH_PACE);
        pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut wire = self.wire(score, 4);
        while Instant::now() < end {
            pace.tick().await;
            wire.close();
            let began = Instant::now();
            wire.to = *self.at.borrow();
            // One that is not answered counts with the time that was waited for it.
            drop(wire.ask_within(&Request::get("/healthz"), Duration::from_secs(20)).await);
            score.health.record([began.elapsed()]);
        }
    }

    /// Enters as somebody of the network from which attackers enter, with an invitation code.
    async fn enter_with_code(&self, code: &str, score: &Score) -> io::Result<()> {
        let number = self.entered.fetch_add(1, Ordering::Relaxed);
        let path = format!("/api/v1/competitions/{}/entrants", self.place.cup);
        let body = json!({ "name": format!("guest {number}"), "model": "patience", "code": code });
        let mut wire =
            Wire::new(*self.at.borrow(), Source::in_site(0, 0), &score.tally).keeping_all();
        let began = Instant::now();
        let (entered, was_started) = self.ask_again(&mut wire, &Request::post(path, &body)).await?;
        // A server that was killed after it had stored the entry has used up the code.
        if was_started && entered.status == 403 {
            return Ok(());
        }
        score.took("enter with a code", began.elapsed());
        text(&entered.read()?, "/key").map(drop)
    }

    /// Errands of an honest entrant: it reads the board, its journal, an export. An organizer watches a game, and exports it.
    async fn errands(&self, end: Instant, score: &Score) {
        let mut wire = self.wire(score, 5);
        let HonestPlace { cup, organizer, .. } = &self.place;
        loop {
            let game =
                self.games.lock().expect("nothing panics while it holds this").last().cloned();
            let board = Request::get(format!("/api/v1/competitions/{cup}/board"));
            let mut errands = vec![("board", board)];
            if let Some(game) = game {
                let journal = Request::get(format!("/api/v1/episodes/{game}/journal"));
                let export = Request::get(format!("/api/v1/exports/acts.jsonl?episode={game}"));
                let events = Request::get(format!("/api/v1/episodes/{game}/events"));
                errands.extend([
                    ("organizer's export", export.clone().with(organizer)),
                    ("organizer's events", events.with(organizer)),
                    ("journal", journal),
                    ("export", export),
                ]);
            }
            for (name, request) in errands {
                wire.close();
                let began = Instant::now();
                match self.ask(&mut wire, &request).await {
                    Ok(answer) if answer.is_ok() => score.took(name, began.elapsed()),
                    Ok(answer) => score.failed(name, &answer.kind()),
                    Err(error) => score.failed(name, &error),
                }
            }
            let code = self.codes.lock().expect("nothing panics while it holds this").pop();
            if let Some(code) = code
                && let Err(error) = self.enter_with_code(&code, score).await
            {
                score.failed("an entry with a code", &error);
            }
            if Instant::now() >= end {
                return;
            }
            sleep(ERRAND_PACE).await;
        }
    }
}

/// A text in an answer.
pub(crate) fn text(value: &Value, pointer: &str) -> io::Result<String> {
    let text = value.pointer(pointer).and_then(Value::as_str);
    text.map(str::to_owned).ok_or_else(|| io::Error::other(format!("no {pointer} in {value}")))
}
