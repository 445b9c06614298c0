//! The latency of the pages of a large competition while its games end: the pages of everybody, of an entrant, and of
//! its organizers.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swarmbench_testkit::latencies::{Latencies, Spread};
use tokio::task::JoinSet;
use tokio::time::{MissedTickBehavior, interval};

use super::connection::{Answers, Connection, Tally, Target, request};
use super::{LoadError, float, per_second};

/// Entrants that play meanwhile.
const PLAYERS: usize = 8;

/// Rows of a page, as the server's own pages ask for them.
const ROWS: usize = 50;

/// The maximum number of rows of a page.
const ROWS_MAX: usize = 1000;

/// Pages of the maximum size that are read of each list.
const DEEP: usize = 20;

/// The settings of the measurement.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// A competition that is open and that anybody may enter.
    pub(crate) competition: String,
    /// The key of an organizer.
    pub(crate) organizer: String,
    /// Duration of the reading.
    pub(crate) reading: Duration,
    /// Concurrent readers.
    pub(crate) readers: usize,
    /// Games that should end per second.
    pub(crate) ends_per_s: f64,
}

/// One kind of page.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Line {
    /// The reader: `everybody`, `an entrant` or `an organizer`.
    pub(crate) by: &'static str,
    /// A description of the page.
    pub(crate) read: &'static str,
    /// An example of its path.
    pub(crate) path: String,
    /// The number of different requests of this kind, which are sent in turn.
    pub(crate) different: usize,
    /// Whether it is a page of a list, not the whole list in one answer.
    pub(crate) is_page: bool,
    /// Time from sending the request until the last byte of the answer.
    pub(crate) latency: Spread,
}

/// The results.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct CompetitionReport {
    /// The competition.
    pub(crate) competition: String,
    /// Concurrent readers.
    pub(crate) readers: usize,
    /// Duration of the reading, in seconds.
    pub(crate) seconds: f64,
    /// Games that ended meanwhile.
    pub(crate) ended: u64,
    /// Games that ended per second.
    pub(crate) ended_per_s: f64,
    /// Time from sending the acts of a round until their receipts.
    pub(crate) acted: Spread,
    /// One line per kind of page.
    pub(crate) lines: Vec<Line>,
    /// Outcomes of all requests of readers.
    pub(crate) reads: Answers,
    /// Outcomes of all requests of players.
    pub(crate) plays: Answers,
}

/// A kind of page during the measurement.
struct Kind {
    by: &'static str,
    read: &'static str,
    is_page: bool,
    paths: Vec<String>,
    calls: Vec<Vec<u8>>,
    latencies: Latencies,
    asked: AtomicU64,
}

/// An entrant that plays, with its key.
#[derive(Clone, Debug, Deserialize)]
struct Player {
    id: String,
    key: String,
}

/// Withdraws some entrants, as the competition may be full, and lets as many new ones play attempts one after
/// another, while all pages of the competition are read in turn: first paged lists, then whole lists.
pub(crate) async fn run(target: &Target, plan: Plan) -> Result<CompetitionReport, LoadError> {
    let reads = Arc::new(Tally::default());
    let plays = Arc::new(Tally::default());
    let setup = Setup { target, plan: &plan, connection: Connection::new(target) };
    let (players, games, kinds) = setup.make().await?;
    let playing = Arc::new(Playing::default());
    let mut at_play = JoinSet::new();
    let attempts = Attempts::new(target, &plan, games);
    for (place, player) in players.into_iter().enumerate() {
        let (attempts, plays, playing) =
            (attempts.clone(), Arc::clone(&plays), Arc::clone(&playing));
        at_play.spawn(async move { attempts.play(place, &player, &plays, &playing).await });
    }
    let (pages, whole): (Vec<_>, Vec<_>) = kinds.into_iter().partition(|kind| kind.is_page);
    let began = Instant::now();
    let mut lines = Vec::new();
    // Whole lists have megabytes, so they are read for a shorter time, and separately.
    for (kinds, reading) in [(pages, plan.reading), (whole, plan.reading / 4)] {
        lines.extend(read(target, &reads, kinds, plan.readers, reading).await);
    }
    let (ended, elapsed) = (playing.ended.load(Ordering::Relaxed), began.elapsed());
    playing.stops.store(true, Ordering::Relaxed);
    at_play.join_all().await;
    Ok(CompetitionReport {
        competition: plan.competition,
        readers: plan.readers,
        seconds: elapsed.as_secs_f64(),
        ended,
        ended_per_s: per_second(ended, elapsed),
        acted: playing.acted.spread(),
        lines,
        reads: reads.answers(),
        plays: plays.answers(),
    })
}

/// Reads all kinds in turn; each reader starts with another kind.
async fn read(
    target: &Target,
    tally: &Arc<Tally>,
    kinds: Vec<Kind>,
    readers: usize,
    reading: Duration,
) -> Vec<Line> {
    let kinds = Arc::new(kinds);
    let until = Instant::now() + reading;
    let mut tasks = JoinSet::new();
    for reader in 0..readers {
        let (kinds, tally) = (Arc::clone(&kinds), Arc::clone(tally));
        let mut connection = Connection::new(target);
        tasks.spawn(async move {
            let first = reader * kinds.len() / readers.max(1);
            for (place, kind) in kinds.iter().cycle().skip(first).enumerate() {
                // Every kind is read at least once, however slow it is.
                if place >= kinds.len() && Instant::now() >= until {
                    break;
                }
                let number = kind.asked.fetch_add(1, Ordering::Relaxed);
                let place = usize::try_from(number).unwrap_or(0) % kind.calls.len();
                let started = Instant::now();
                if connection.call(&tally, &kind.calls[place]).await {
                    kind.latencies.record([started.elapsed()]);
                }
            }
        });
    }
    tasks.join_all().await;
    let line = |kind: &Kind| Line {
        by: kind.by,
        read: kind.read,
        path: kind.paths[0].clone(),
        different: kind.paths.len(),
        is_page: kind.is_page,
        latency: kind.latencies.spread(),
    };
    kinds.iter().map(line).collect()
}

/// Discovers the pages to read, and creates the players.
struct Setup<'a> {
    target: &'a Target,
    plan: &'a Plan,
    connection: Connection,
}

impl Setup<'_> {
    async fn make(mut self) -> Result<(Vec<Player>, u32, Vec<Kind>), LoadError> {
        let cup = format!("/api/v1/competitions/{}", self.plan.competition);
        // The first read of a board computes it from all its games.
        let organizer = self.plan.organizer.clone();
        for part in ["", "&part=public"] {
            self.get(&format!("{cup}/board?limit=1{part}"), Some(&organizer)).await?;
        }
        let board = self.cursors(&format!("{cup}/board"), None).await?;
        let entrants = self.cursors(&format!("{cup}/entrants"), None).await?;
        let attempts = self.cursors(&format!("{cup}/attempts"), Some(&organizer)).await?;
        let competition = self.get(&cup, None).await?;
        let tasks = competition["suite"]["tasks"].as_array().map_or(0, Vec::len);
        let games = competition["suite"]["seeds"].as_u64().unwrap_or(0) * tasks as u64;
        let some = self.get(&format!("{cup}/entrants?limit={ROWS_MAX}"), None).await?;
        let some = some["items"].as_array().map_or(&[][..], Vec::as_slice);
        let some = some.iter().filter(|entrant| entrant["status"] == "active");
        let some = some.filter_map(|entrant| entrant["id"].as_str().map(str::to_owned));
        let some: Vec<_> = some.take(2 * PLAYERS).collect();
        let players = self.players(&cup, &some).await?;
        let runs = self.get(&format!("{cup}/attempts?limit={ROWS}"), Some(&organizer)).await?;
        let runs = runs["items"].as_array().cloned().unwrap_or_default();
        let runs: Vec<_> = runs.iter().filter_map(|item| item["run"].as_str()).collect();
        let mut kinds = Kinds { target: self.target, all: Vec::new() };
        kinds.of_everybody(&cup, &board, &entrants, &competition);
        for player in &players {
            kinds.of_entrant(&cup, player);
        }
        kinds.of_organizer(&cup, &organizer, (&some, &runs, &attempts));
        Ok((players, u32::try_from(games).unwrap_or(u32::MAX), kinds.all))
    }

    async fn get(&mut self, path: &str, key: Option<&str>) -> Result<Value, LoadError> {
        self.ask("GET", path, key, None).await
    }

    async fn ask(
        &mut self,
        method: &str,
        path: &str,
        key: Option<&str>,
        body: Option<&Value>,
    ) -> Result<Value, LoadError> {
        let failed = |why: &dyn std::fmt::Display| {
            LoadError::of("the competition cannot be measured")(&format!("{method} {path}: {why}"))
        };
        let body = body.map(Value::to_string);
        let call = request(self.target, method, path, key, body.as_deref());
        let answer = self.connection.ask(&call).await.map_err(|error| failed(&error))?;
        let body = self.connection.body();
        if !answer.is_ok() {
            return Err(failed(&String::from_utf8_lossy(body)));
        }
        serde_json::from_slice(body).map_err(|error| failed(&error))
    }

    /// The cursors of a list with pages of the maximum size.
    async fn cursors(&mut self, path: &str, key: Option<&str>) -> Result<Vec<String>, LoadError> {
        let mut cursors: Vec<String> = Vec::new();
        while cursors.len() < DEEP {
            let after = cursors.last().map_or(String::new(), |cursor| format!("&cursor={cursor}"));
            let page = self.get(&format!("{path}?limit={ROWS_MAX}{after}"), key).await?;
            let Some(next) = page["next_cursor"].as_str() else { break };
            cursors.push(next.to_owned());
        }
        Ok(cursors)
    }

    /// Withdraws entrants and enters new ones.
    async fn players(&mut self, cup: &str, others: &[String]) -> Result<Vec<Player>, LoadError> {
        let organizer = self.plan.organizer.clone();
        let mut players = Vec::new();
        for (place, other) in others.iter().take(PLAYERS).enumerate() {
            let withdrawn = json!({ "status": "withdrawn", "reason": "makes room for a player" });
            let path = format!("{cup}/entrants/{other}");
            self.ask("PATCH", &path, Some(&organizer), Some(&withdrawn)).await?;
            // Entrants of earlier measurements have names of the same form.
            let name = format!("Player {place} of {}", std::process::id());
            let entrant = json!({ "name": name, "model": "swarmbench loadtest" });
            let path = format!("{cup}/entrants");
            let entered = self.ask("POST", &path, None, Some(&entrant)).await?;
            let player = Player::deserialize(&entered);
            players.push(player.map_err(|error| LoadError::of("an entrant")(&error))?);
        }
        Ok(players)
    }
}

/// All kinds of pages found so far.
struct Kinds<'a> {
    target: &'a Target,
    all: Vec<Kind>,
}

impl Kinds<'_> {
    /// Adds pages of a kind, which may already be known with another key.
    fn add(
        &mut self,
        (by, read, is_page): (&'static str, &'static str, bool),
        key: Option<&str>,
        paths: Vec<String>,
    ) {
        let calls: Vec<_> =
            paths.iter().map(|path| request(self.target, "GET", path, key, None)).collect();
        if calls.is_empty() {
            return;
        }
        if let Some(kind) = self.all.iter_mut().find(|kind| (kind.by, kind.read) == (by, read)) {
            kind.paths.extend(paths);
            kind.calls.extend(calls);
            return;
        }
        let (latencies, asked) = (Latencies::default(), AtomicU64::new(0));
        self.all.push(Kind { by, read, is_page, paths, calls, latencies, asked });
    }

    fn of_everybody(
        &mut self,
        cup: &str,
        board: &[String],
        entrants: &[String],
        competition: &Value,
    ) {
        let all = |read| ("everybody", read, true);
        let shell = cup.trim_start_matches("/api/v1");
        let after = |list: &str, rows: usize, cursors: &[String]| -> Vec<String> {
            let page = |cursor| format!("{cup}/{list}?limit={rows}&cursor={cursor}");
            cursors.iter().map(page).collect()
        };
        self.add(all("its page"), None, vec![shell.to_owned()]);
        self.add(all("the competition"), None, vec![cup.to_owned()]);
        self.add(all("list of competitions"), None, vec!["/api/v1/competitions".to_owned()]);
        self.add(all("board: first 50"), None, vec![format!("{cup}/board?limit={ROWS}")]);
        self.add(all("board: 50 further down"), None, after("board", ROWS, board));
        self.add(all("board: 1,000 further down"), None, after("board", ROWS_MAX, board));
        let csv = format!("{cup}/board?format=csv&limit={ROWS}");
        self.add(all("board: first 50 as CSV"), None, vec![csv]);
        let categories = competition["categories"].as_array().map_or(&[][..], Vec::as_slice);
        let of = categories.iter().filter_map(Value::as_str).map(|category| {
            let category = utf8_percent_encode(category, NON_ALPHANUMERIC);
            format!("{cup}/board?limit={ROWS}&category={category}")
        });
        self.add(all("board: first 50 of a category"), None, of.collect());
        self.add(all("entrants: first 50"), None, vec![format!("{cup}/entrants?limit={ROWS}")]);
        self.add(all("entrants: 50 further down"), None, after("entrants", ROWS, entrants));
        self.add(all("entrants: 1,000 further down"), None, after("entrants", ROWS_MAX, entrants));
        self.add(all("announcements"), None, vec![format!("{cup}/announcements?limit=10")]);
        self.add(all("what organizers did"), None, vec![format!("{cup}/actions")]);
        self.add(all("list of episodes"), None, vec!["/api/v1/episodes".to_owned()]);
        self.add(all("list of runs"), None, vec!["/api/v1/runs".to_owned()]);
        let whole = |read| ("everybody", read, false);
        self.add(whole("board"), None, vec![format!("{cup}/board")]);
        self.add(whole("board as CSV"), None, vec![format!("{cup}/board?format=csv")]);
        self.add(whole("entrants"), None, vec![format!("{cup}/entrants")]);
    }

    fn of_entrant(&mut self, cup: &str, player: &Player) {
        let (key, id) = (Some(player.key.as_str()), &player.id);
        let own = |read| ("an entrant", read, true);
        self.add(own("board: first 50"), key, vec![format!("{cup}/board?limit={ROWS}")]);
        self.add(own("own entrants"), key, vec![format!("{cup}/entrants?own=true")]);
        self.add(own("own row with all attempts"), key, vec![format!("{cup}/entrants/{id}")]);
        self.add(own("members"), key, vec![format!("{cup}/entrants/{id}/members")]);
        self.add(own("own attempts"), key, vec![format!("{cup}/attempts?limit={ROWS}")]);
        self.add(own("list of runs"), key, vec!["/api/v1/runs".to_owned()]);
        self.add(own("list of episodes"), key, vec!["/api/v1/episodes".to_owned()]);
    }

    fn of_organizer(
        &mut self,
        cup: &str,
        key: &str,
        (entrants, runs, attempts): (&[String], &[&str], &[String]),
    ) {
        let key = Some(key);
        let page = |read| ("an organizer", read, true);
        self.add(page("board: first 50"), key, vec![format!("{cup}/board?limit={ROWS}")]);
        let public = format!("{cup}/board?limit={ROWS}&part=public");
        self.add(page("board of the public seeds"), key, vec![public]);
        self.add(page("attempts: first 50"), key, vec![format!("{cup}/attempts?limit={ROWS}")]);
        let after = |rows: usize| {
            attempts.iter().map(|at| format!("{cup}/attempts?limit={rows}&cursor={at}")).collect()
        };
        self.add(page("attempts: 50 further down"), key, after(ROWS));
        self.add(page("attempts: 1,000 further down"), key, after(ROWS_MAX));
        let each = |of: &dyn Fn(&String) -> String| entrants.iter().map(of).collect::<Vec<_>>();
        let with_attempts = each(&|id| format!("{cup}/entrants/{id}"));
        self.add(page("an entrant with all attempts"), key, with_attempts);
        let members = each(&|id| format!("{cup}/entrants/{id}/members"));
        self.add(page("members of a team"), key, members);
        self.add(page("invitation codes"), key, vec![format!("{cup}/codes?limit={ROWS}")]);
        self.add(page("audit log"), key, vec![format!("/api/v1/audit?limit={ROWS}")]);
        let of = |run: &&str| format!("/api/v1/runs/{run}");
        self.add(page("a run"), key, runs.iter().map(of).collect());
        let of = |run: &&str| format!("/api/v1/episodes?run={run}");
        self.add(page("games of a run"), key, runs.iter().map(of).collect());
        let whole = ("an organizer", "attempts", false);
        self.add(whole, key, vec![format!("{cup}/attempts")]);
    }
}

/// The shared state of players.
#[derive(Default)]
struct Playing {
    stops: AtomicBool,
    ended: AtomicU64,
    acted: Latencies,
}

/// The pace of players.
#[derive(Clone)]
struct Attempts {
    target: Target,
    path: String,
    /// Interval between two attempts of a player.
    every: Duration,
}

#[derive(Deserialize)]
struct Started {
    games: u64,
    swarm_token: String,
}

/// The part of an observation that is needed to act.
#[derive(Deserialize)]
struct Looked {
    observations: Vec<Seat>,
    finished: bool,
}

#[derive(Deserialize)]
struct Seat {
    episode: String,
    agent: String,
    round: u32,
}

impl Attempts {
    fn new(target: &Target, plan: &Plan, games: u32) -> Self {
        let of_one_end = Duration::from_secs_f64(float(PLAYERS as u64) / plan.ends_per_s);
        Self {
            target: target.clone(),
            path: format!("/api/v1/competitions/{}/attempts", plan.competition),
            every: of_one_end.saturating_mul(games),
        }
    }

    /// Plays attempts of one entrant at an even pace, until all are played or `stops` is set.
    async fn play(&self, place: usize, player: &Player, tally: &Tally, playing: &Playing) {
        let mut connection = Connection::new(&self.target);
        let start = request(&self.target, "POST", &self.path, Some(&player.key), Some("{}"));
        // Players start at different moments.
        tokio::time::sleep(self.every.mul_f64(float(place as u64) / float(PLAYERS as u64))).await;
        let mut ticks = interval(self.every);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        while !playing.stops.load(Ordering::Relaxed) {
            ticks.tick().await;
            if !connection.call(tally, &start).await {
                return;
            }
            let Some(Started { games, swarm_token }) = connection.read_json(tally) else { return };
            if !self.play_one(&mut connection, &swarm_token, tally, &playing.acted).await {
                return;
            }
            playing.ended.fetch_add(games, Ordering::Relaxed);
        }
    }

    /// Plays an attempt to its end; returns false if a request failed.
    async fn play_one(
        &self,
        connection: &mut Connection,
        token: &str,
        tally: &Tally,
        acted: &Latencies,
    ) -> bool {
        let look = request(&self.target, "GET", "/swarm/obs?wait=20", Some(token), None);
        loop {
            if !connection.call(tally, &look).await {
                return false;
            }
            let Some(looked) = connection.read_json::<Looked>(tally) else { return false };
            if looked.finished {
                return true;
            }
            let act = |Seat { episode, agent, round }| json!({ "episode": episode, "agent": agent, "round": round, "action": "STAY" });
            let acts: Vec<_> = looked.observations.into_iter().map(act).collect();
            if acts.is_empty() {
                // The long poll ended without news.
                continue;
            }
            let acts = json!({ "acts": acts }).to_string();
            let call = request(&self.target, "POST", "/swarm/act", Some(token), Some(&acts));
            let began = Instant::now();
            if !connection.call(tally, &call).await {
                return false;
            }
            acted.record([began.elapsed()]);
        }
    }
}
