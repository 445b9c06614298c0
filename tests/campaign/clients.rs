//! Clients that play, whatever happens to the server: they ask again until somebody answers, and compare
//! every answer with the ledger.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use reqwest::{Method, RequestBuilder};
use serde::de::DeserializeOwned;
use swarmbench_engine::AgentId;
use swarmbench_protocol::act::{
    ActRequest, ActResponse, Receipt, SwarmAct, SwarmActRequest, SwarmActResponse,
    SwarmObsResponse, SwarmReceipt,
};
use swarmbench_protocol::episode::{EpisodeSummary, State};
use swarmbench_protocol::observation::Observation;
use swarmbench_protocol::problem::Problem;
use swarmbench_testkit::dice::Dice;
use swarmbench_testkit::program::{Address, Door, PATIENCE};
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};

use crate::campaign::doors::{Doors, Servers, Tried};
use crate::campaign::ledger::{Holder, Known, Ledger, Played};
use crate::campaign::plan::{By, CampaignGame};

/// Seconds that a long poll waits at the only server, and at one of several: there nobody tells a client that the server does not
/// answer.
const WAIT_S: u32 = 20;
const WAIT_OF_SEVERAL_S: u32 = 2;

/// Maximum time of an answer of a server of a cluster, beyond the `wait` of the request; then another one is asked.
const ANSWER_PATIENCE: Duration = Duration::from_millis(1500);

/// Pause before a client asks a server again that has refused it.
const PAUSE: Duration = Duration::from_millis(10);

/// Acknowledged acts of a seat that are sent again after a restart.
const SAMPLE: usize = 3;

/// Counts for the table at the end.
#[derive(Default)]
pub(crate) struct Counts {
    pub(crate) acknowledged: AtomicU64,
    pub(crate) came_late: AtomicU64,
    pub(crate) lost_and_kept: AtomicU64,
    pub(crate) lost_and_not_kept: AtomicU64,
    pub(crate) confirmed: AtomicU64,
    pub(crate) creations_repeated: AtomicU64,
    pub(crate) states_compared: AtomicU64,
    pub(crate) checked_after_restart: AtomicU64,
    /// Answers of a cluster that nobody waited for any more, by kind.
    pub(crate) late_answers: AtomicU64,
    pub(crate) late_unavailable: AtomicU64,
    pub(crate) late_broken: AtomicU64,
    /// Refusals by a server of a cluster that was unavailable.
    pub(crate) unavailable: AtomicU64,
}

pub(crate) fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Ordering::SeqCst);
}

/// All clients of a campaign.
pub(crate) struct Clients {
    seed: u64,
    http: reqwest::Client,
    servers: Servers,
    pub(crate) ledger: Ledger,
    pub(crate) counts: Counts,
    /// Acts that were sent and acknowledged.
    pub(crate) sent: watch::Sender<u64>,
    pub(crate) acknowledged: watch::Sender<u64>,
    /// Last run in which each client found everything in order.
    checked: watch::Sender<BTreeMap<u64, u64>>,
    next_client: AtomicU64,
    next_game: AtomicU64,
    /// No new games are begun.
    closing: AtomicBool,
    /// The disk of this run may fail.
    faulty: AtomicU64,
    /// In this run a client was told that acts are not taken any more.
    failed: AtomicU64,
    /// The server may say for a while that it is unavailable, and continues later.
    pauses: AtomicBool,
    /// Requests that a server of a cluster has not answered in time; what it answers must be right all the same.
    late: Mutex<Vec<(Asked, JoinHandle<Whole>)>>,
}

/// The status and the body of an answer.
type Whole = Result<(u16, Vec<u8>), reqwest::Error>;

/// A request, as far as its answer can be compared with what was known when it was sent.
struct Asked {
    path: String,
    who: Option<Holder>,
    known: Vec<(AgentId, Known)>,
    /// The round and the seat of each act.
    acts: Vec<(AgentId, u32)>,
}

/// A whole answer.
pub(crate) struct ClientAnswer {
    pub(crate) status: u16,
    body: Vec<u8>,
    run: u64,
    /// When the request was sent that was answered.
    sent: Instant,
    /// True if an earlier answer to the same request may have been lost.
    lost: bool,
    /// True if the run had already refused an act when this was sent.
    after_failure: bool,
}

impl ClientAnswer {
    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(crate) fn read<T: DeserializeOwned>(&self) -> T {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|error| panic!("{error}: {} {}", self.status, self.text()))
    }

    fn ok<T: DeserializeOwned>(&self) -> T {
        assert_eq!(self.status, 200, "{}", self.text());
        self.read()
    }
}

/// A request that was not answered.
struct Broken {
    tried: Tried,
    /// True if the server may have got it.
    lost: bool,
}

impl Clients {
    pub(crate) fn new(seed: u64, door: Arc<Door>) -> Arc<Self> {
        Self::of(seed, Servers::One(door))
    }

    /// Clients of a cluster, of which they ask any.
    pub(crate) fn of_several(seed: u64, doors: Arc<Doors>) -> Arc<Self> {
        let clients = Self::of(seed, Servers::Any(doors));
        clients.expect_pauses();
        clients
    }

    fn of(seed: u64, servers: Servers) -> Arc<Self> {
        let http = reqwest::Client::builder()
            .timeout(PATIENCE)
            // Less than the time after which the server closes a connection that nobody uses.
            .pool_idle_timeout(Duration::from_secs(4));
        Arc::new(Self {
            seed,
            http: http.build().expect("a client"),
            servers,
            ledger: Ledger::default(),
            counts: Counts::default(),
            sent: watch::Sender::default(),
            acknowledged: watch::Sender::default(),
            checked: watch::Sender::default(),
            next_client: AtomicU64::new(0),
            next_game: AtomicU64::new(0),
            closing: AtomicBool::new(false),
            faulty: AtomicU64::new(0),
            failed: AtomicU64::new(0),
            pauses: AtomicBool::new(false),
            late: Mutex::default(),
        })
    }

    /// Starts tables at which one game after another is played.
    pub(crate) fn sit_down(self: &Arc<Self>, tables: usize) -> JoinSet<()> {
        let mut sitting = JoinSet::new();
        for _ in 0..tables {
            let clients = Arc::clone(self);
            sitting.spawn(async move {
                while !clients.closing.load(Ordering::SeqCst) {
                    let number = clients.next_game.fetch_add(1, Ordering::SeqCst);
                    clients.play(CampaignGame::new(clients.seed, number)).await;
                }
            });
        }
        sitting
    }

    /// Lets all games that have begun be played to their end.
    pub(crate) async fn finish(&self, mut tables: JoinSet<()>) {
        self.closing.store(true, Ordering::SeqCst);
        while let Some(ended) = tables.join_next().await {
            ended.unwrap_or_else(|error| std::panic::resume_unwind(error.into_panic()));
        }
    }

    /// Says that the disk of a run may fail from now on.
    pub(crate) fn expect_failure(&self, run: u64) {
        self.faulty.store(run, Ordering::SeqCst);
    }

    /// Waits until every client has found everything in order in a run.
    pub(crate) async fn all_checked(&self, run: u64) {
        let mut checked = self.checked.subscribe();
        let all = checked.wait_for(|clients| clients.values().all(|&last| last >= run));
        let found = tokio::time::timeout(PATIENCE, all).await.map(drop);
        assert!(found.is_ok(), "clients hang in run {run}: {:?}", *self.checked.borrow());
    }

    /// Waits until something was counted that often more.
    pub(crate) async fn further(&self, counter: &watch::Sender<u64>, more: usize) {
        let mut counter = counter.subscribe();
        let goal = *counter.borrow() + more as u64;
        let reached = counter.wait_for(|&count| count >= goal);
        let reached = tokio::time::timeout(PATIENCE, reached).await.map(drop);
        assert!(reached.is_ok(), "nobody plays any more");
    }

    /// Notes the last run in which a client found all in order; none for a client that goes.
    fn note_check(&self, client: u64, run: Option<u64>) {
        self.checked.send_modify(|checked| match run {
            Some(run) => {
                checked.insert(client, run);
            }
            None => {
                checked.remove(&client);
            }
        });
    }

    async fn play(self: &Arc<Self>, game: CampaignGame) {
        let key = format!("{}-{}", self.seed, game.number);
        let answer = self
            .ask(|http, base| {
                let call = http.post(format!("{base}/api/v1/episodes"));
                call.header("Idempotency-Key", &key).json(&game.request)
            })
            .await;
        assert_eq!(answer.status, 201, "{}", answer.text());
        if answer.lost {
            count(&self.counts.creations_repeated);
        }
        let played = self.ledger.open(game, answer.read());
        if played.game.is_started_by_hand() {
            let path = format!("/api/v1/episodes/{}/start", played.created.id);
            let answer = self.call(Method::POST, &path, &played.created.swarm_token).await;
            // Its clock may have run through all rounds while the answer to the first call was held.
            let is_over = answer.lost && answer.status == 409 && played.game.is_clocked();
            if is_over {
                assert_eq!(answer.read::<Problem>().code, "episode_over", "{}", answer.text());
            } else {
                answer.ok::<EpisodeSummary>();
            }
        }
        let mut players = JoinSet::new();
        match played.game.by {
            By::Seats => {
                for agent in played.agents() {
                    players.spawn(Arc::clone(self).play_seat(Arc::clone(&played), agent));
                }
            }
            By::Swarm => drop(players.spawn(Arc::clone(self).play_swarm(Arc::clone(&played)))),
        }
        players.join_all().await;
        let summary = self.summary(&played).await;
        played.ended(&summary.result.expect("it has ended"));
    }

    pub(crate) async fn summary(&self, played: &Played) -> EpisodeSummary {
        let path = format!("/api/v1/episodes/{}", played.created.id);
        self.call(Method::GET, &path, &played.created.swarm_token).await.ok()
    }

    async fn play_seat(self: Arc<Self>, played: Arc<Played>, agent: AgentId) {
        let mut client = Client::new(&self);
        let mut seen = client.look(&played, agent).await;
        while seen.sight.result.is_none() && seen.sight.alive {
            client.check_after_restart(&played, &[agent]).await;
            let round = seen.sight.round;
            if !seen.moment.acted && !self.leaves_out(&played, agent, round) {
                self.think(&played, agent, round).await;
                if let Some(next) = client.act(&played, agent, round).await {
                    seen = next;
                    continue;
                }
            }
            seen = client.look_after(&played, agent, round).await;
        }
    }

    async fn play_swarm(self: Arc<Self>, played: Arc<Played>) {
        let mut client = Client::new(&self);
        let agents: Vec<AgentId> = played.agents().collect();
        let mut cursor: Option<String> = None;
        loop {
            let known: Vec<_> = agents.iter().map(|&agent| played.known(agent)).collect();
            let token = &played.created.swarm_token;
            let poll = |http: &reqwest::Client, base: &str| {
                let call = http.get(format!("{base}/swarm/obs")).bearer_auth(token);
                let call = call.query(&[("wait", self.wait_s())]);
                cursor.iter().fold(call, |call, cursor| call.query(&[("after", cursor)]))
            };
            let answer = client.poll(&played, &agents, poll).await;
            let look: SwarmObsResponse = answer.ok();
            if look.finished {
                return;
            }
            cursor = Some(look.cursor);
            let mut acts = Vec::new();
            for seen in &look.observations {
                let agent = AgentId::parse(&seen.sight.agent).expect("an agent");
                assert!(!seen.moment.acted, "{}: {agent} does not wait", played.name());
                played.seen(agent, known[agent.index()], seen);
                let round = seen.sight.round;
                if !self.leaves_out(&played, agent, round) {
                    acts.push((agent, played.game.act(agent, round)));
                }
            }
            client.check_after_restart(&played, &agents).await;
            if let Some((agent, act)) = acts.first() {
                self.think(&played, *agent, act.round).await;
            }
            client.act_for_all(&played, acts).await;
        }
    }

    fn wait_s(&self) -> u32 {
        match self.servers {
            Servers::One(_) => WAIT_S,
            Servers::Any(_) => WAIT_OF_SEVERAL_S,
        }
    }

    /// True if a seat lets its clock run out. When all is about to end everybody hurries.
    fn leaves_out(&self, played: &Played, agent: AgentId, round: u32) -> bool {
        !self.closing.load(Ordering::SeqCst) && played.game.is_left_out(agent, round)
    }

    async fn think(&self, played: &Played, agent: AgentId, round: u32) {
        if !self.closing.load(Ordering::SeqCst) {
            tokio::time::sleep(played.game.thinks(agent, round)).await;
        }
    }

    /// One request with a token and no body.
    pub(crate) async fn call(&self, method: Method, path: &str, token: &str) -> ClientAnswer {
        self.ask(|http, base| {
            http.request(method.clone(), format!("{base}{path}")).bearer_auth(token)
        })
        .await
    }

    /// One request without a token.
    pub(crate) async fn read(&self, path: &str) -> ClientAnswer {
        self.ask(|http, base| http.get(format!("{base}{path}"))).await
    }

    /// Asks the server that runs now, once.
    pub(crate) async fn get_once(&self, path: &str) -> (u16, String) {
        let base = self.servers.one().after(0).await.base;
        self.once(self.http.get(format!("{base}{path}"))).await
    }

    /// Tells the server that runs now, once; without a token where it is empty.
    pub(crate) async fn post_once(
        &self,
        path: &str,
        token: &str,
        body: &serde_json::Value,
    ) -> (u16, String) {
        let base = self.servers.one().after(0).await.base;
        let call = self.http.post(format!("{base}{path}")).json(body);
        self.once(if token.is_empty() { call } else { call.bearer_auth(token) }).await
    }

    async fn once(&self, call: RequestBuilder) -> (u16, String) {
        let (status, body) = whole(call).await.expect("an answer");
        (status, String::from_utf8(body).expect("UTF-8"))
    }

    /// Asks until there is an answer, over as many runs of the server as it takes.
    async fn ask(&self, fill: impl Fn(&reqwest::Client, &str) -> RequestBuilder) -> ClientAnswer {
        let (mut tried, mut lost) = (Tried::default(), false);
        loop {
            match self.attempt(tried, &fill).await {
                Ok(answer) => return ClientAnswer { lost, ..answer },
                Err(broken) => {
                    tried = broken.tried;
                    lost |= broken.lost;
                }
            }
        }
    }

    /// Asks the first run after the one that was tried once, or a server of a cluster. A run that nobody ended must answer.
    async fn attempt(
        &self,
        tried: Tried,
        fill: impl Fn(&reqwest::Client, &str) -> RequestBuilder,
    ) -> Result<ClientAnswer, Broken> {
        let door = match &self.servers {
            Servers::One(door) => door,
            Servers::Any(doors) => return self.attempt_at_any(doors, tried, fill).await,
        };
        let Address { base, run } = door.after(tried.run).await;
        let after_failure = self.failed.load(Ordering::SeqCst) == run;
        let sent = Instant::now();
        match whole(fill(&self.http, &base)).await {
            Ok((503, body)) => {
                self.is_unavailable(run, &String::from_utf8_lossy(&body));
                self.pause(run).await;
                Err(Broken { tried, lost: true })
            }
            Ok((status, body)) => {
                Ok(ClientAnswer { status, body, run, sent, lost: false, after_failure })
            }
            Err(error) => {
                assert!(door.has_ended(run), "run {run} does not answer: {error:?}");
                let tried = Tried { run, server: None };
                Err(Broken { tried, lost: !error.is_connect() })
            }
        }
    }

    /// Asks a server of a cluster once. One that takes too long may have been stopped: somebody else is asked then, and what it
    /// answers later is looked at in the end.
    async fn attempt_at_any(
        &self,
        doors: &Doors,
        tried: Tried,
        fill: impl Fn(&reqwest::Client, &str) -> RequestBuilder,
    ) -> Result<ClientAnswer, Broken> {
        let (server, Address { base, run: run_of_server }) = doors.any(tried).await;
        let (run, tried) = (doors.epoch(), Tried { run: 0, server: Some(server) });
        let call = fill(&self.http, &base);
        let request = call.try_clone().expect("it has no stream").build().expect("a request");
        let waits = request.url().query_pairs().any(|(name, _)| name == "wait");
        let wait = if waits { u64::from(WAIT_OF_SEVERAL_S) } else { 0 };
        let asked = Asked::of(&self.ledger, &request);
        let sent = Instant::now();
        let mut answering = tokio::spawn(whole(call));
        // A repeated creation has other tokens and revokes those before: where the first were done after it, the client would have
        // tokens of nothing.
        let is_creation = asked.path == "/api/v1/episodes" && asked.who.is_none();
        let patience = ANSWER_PATIENCE + Duration::from_secs(wait);
        let patience = if is_creation { PATIENCE * 2 } else { patience };
        let Ok(answered) = tokio::time::timeout(patience, &mut answering).await else {
            self.late.lock().expect("no failure yet").push((asked, answering));
            return Err(Broken { tried, lost: true });
        };
        match answered.expect("it does not panic") {
            Ok((503, body)) => {
                self.is_unavailable(run, &String::from_utf8_lossy(&body));
                count(&self.counts.unavailable);
                self.pause(run).await;
                Err(Broken { tried, lost: true })
            }
            Ok((status, body)) => {
                Ok(ClientAnswer { status, body, run, sent, lost: false, after_failure: false })
            }
            Err(error) => {
                let may_break = doors.may_break(server, run_of_server);
                assert!(may_break, "server {server} does not answer: {error:?}");
                self.pause(run).await;
                Err(Broken { tried, lost: !error.is_connect() })
            }
        }
    }

    /// Compares what servers have answered when nobody waited any more with what is known: it must be right all the same.
    pub(crate) async fn judge_late_answers(&self) {
        let late = std::mem::take(&mut *self.late.lock().expect("no failure yet"));
        for (asked, answering) in late {
            let answer = tokio::time::timeout(PATIENCE * 2, answering).await;
            match answer.expect("a request ends").expect("it does not panic") {
                Ok((503, _)) => count(&self.counts.late_unavailable),
                Ok((status, body)) => {
                    count(&self.counts.late_answers);
                    asked.compare(status, &body);
                }
                Err(_) => count(&self.counts.late_broken),
            }
        }
    }

    /// True if the disk of a run may fail.
    fn is_faulty(&self, run: u64) -> bool {
        self.faulty.load(Ordering::SeqCst) == run
    }

    /// Notes that a run does not take acts any more, which is fine where its disk may fail.
    fn is_unavailable(&self, run: u64, told: &str) {
        if self.pauses.load(Ordering::SeqCst) {
            assert!(told.contains("\"unavailable\"") || told.contains("\"overloaded\""), "{told}");
            return;
        }
        assert!(self.is_faulty(run), "run {run} is not available: {told}");
        assert!(told.contains("\"unavailable\""), "{told}");
        self.failed.store(run, Ordering::SeqCst);
    }

    /// From now on the server may be unavailable for a while, and continues later.
    pub(crate) fn expect_pauses(&self) {
        self.pauses.store(true, Ordering::SeqCst);
    }

    async fn pause(&self, run: u64) {
        let is_open = match &self.servers {
            // Another run may come before the time is up.
            Servers::One(door) => door.is_open(run),
            Servers::Any(_) => true,
        };
        if is_open {
            tokio::time::sleep(PAUSE).await;
        }
    }

    /// Sends an acknowledged act again, by either route: the receipt must be the first one.
    pub(crate) async fn confirm(&self, played: &Played, agent: AgentId, act: &ActRequest, by: By) {
        // Neither of these is part of what makes an act the same.
        let act = ActRequest { usage: None, reasoning: None, ..act.clone() };
        let receipt = match by {
            By::Seats => {
                let token = played.token(agent);
                let answer = self.post_act(token, &act, None).await;
                let receipt: Receipt = answer.ok();
                receipt
            }
            By::Swarm => {
                let act = SwarmAct::of(played.created.id.clone(), agent.to_string(), act);
                loop {
                    let (answer, mut receipts) = self.post_acts(played, vec![act.clone()]).await;
                    match receipts.pop().expect("one receipt") {
                        SwarmReceipt::Receipt(receipt) => break receipt,
                        SwarmReceipt::Problem(problem) => self.refused(&answer, &problem).await,
                    }
                }
            }
        };
        let is_new = played.acknowledged(agent, &receipt, true);
        assert!(!is_new, "it was acknowledged before");
        count(&self.counts.confirmed);
    }

    async fn post_act(&self, token: &str, act: &ActRequest, wait: Option<u32>) -> ClientAnswer {
        self.ask(|http, base| {
            let call = http.post(format!("{base}/act")).bearer_auth(token).json(act);
            wait.iter().fold(call, |call, wait| call.query(&[("wait", wait)]))
        })
        .await
    }

    async fn post_acts(
        &self,
        played: &Played,
        acts: Vec<SwarmAct>,
    ) -> (ClientAnswer, Vec<SwarmReceipt>) {
        let (body, token) = (SwarmActRequest { acts }, &played.created.swarm_token);
        let answer = self
            .ask(|http, base| http.post(format!("{base}/swarm/act")).bearer_auth(token).json(&body))
            .await;
        let SwarmActResponse { receipts, .. } = answer.ok();
        assert_eq!(receipts.len(), body.acts.len());
        (answer, receipts)
    }

    /// One of several acts was not taken because the journal cannot be used.
    async fn refused(&self, answer: &ClientAnswer, problem: &Problem) {
        assert_eq!(problem.status, 503, "{problem:?}");
        self.is_unavailable(answer.run, &format!("{:?}", problem.code));
        self.pause(answer.run).await;
    }

    /// Notes a receipt that a client waited for.
    fn receive(&self, played: &Played, agent: AgentId, answer: &ClientAnswer, receipt: &Receipt) {
        let counts = &self.counts;
        assert!(
            receipt.duplicate || !answer.after_failure,
            "{}: acknowledged after a failed commit: {receipt:?}",
            played.name()
        );
        // A server of a cluster may have sent it again by itself.
        let lost = answer.lost || matches!(self.servers, Servers::Any(_)) && receipt.duplicate;
        assert!(played.acknowledged(agent, receipt, lost), "it was received before");
        if lost {
            count(if receipt.duplicate {
                &counts.lost_and_kept
            } else {
                &counts.lost_and_not_kept
            });
        }
        count(&counts.acknowledged);
        played.note_receipt(answer.sent);
        self.acknowledged.send_modify(|count| *count += 1);
    }
}

impl Asked {
    fn of(ledger: &Ledger, request: &reqwest::Request) -> Self {
        let token = request.headers().get("authorization").and_then(|value| value.to_str().ok());
        let token = token.and_then(|value| value.strip_prefix("Bearer "));
        let who = token.and_then(|token| ledger.by_token(token));
        let path = request.url().path().to_owned();
        let known = match &who {
            Some((played, Some(agent))) => vec![(*agent, played.known(*agent))],
            Some((played, None)) => {
                played.agents().map(|agent| (agent, played.known(agent))).collect()
            }
            None => Vec::new(),
        };
        let body = request.body().and_then(reqwest::Body::as_bytes).unwrap_or_default();
        let acts = match (path.as_str(), &who) {
            ("/act", Some((_, Some(agent)))) => {
                let act: ActRequest = serde_json::from_slice(body).expect("an act");
                vec![(*agent, act.round)]
            }
            ("/swarm/act", _) => {
                let acts: SwarmActRequest = serde_json::from_slice(body).expect("acts");
                let agent = |act: &SwarmAct| AgentId::parse(&act.agent).expect("an agent");
                acts.acts.iter().map(|act| (agent(act), act.round)).collect()
            }
            _ => Vec::new(),
        };
        Self { path, who, known, acts }
    }

    /// Compares an answer with what was known when it was asked for, and with what is known now.
    fn compare(&self, status: u16, body: &[u8]) {
        let Some((played, agent)) = &self.who else { return };
        let text = String::from_utf8_lossy(body);
        let name = played.name();
        let refused = |(agent, round): (AgentId, u32), problem: &Problem| {
            if problem.status == 409 {
                played.refused_after_all(agent, round, &problem.code);
            } else {
                assert_eq!(problem.status, 503, "{name}: {agent} in {round}: {problem:?}");
            }
        };
        let seen = |seen: &Observation| {
            let agent = AgentId::parse(&seen.sight.agent).expect("an agent");
            let known = self.known.iter().find(|(known, _)| *known == agent).expect("a seat");
            played.seen(agent, known.1, seen);
        };
        match (self.path.as_str(), status) {
            ("/obs", 200) => seen(&serde_json::from_slice(body).expect("an observation")),
            ("/swarm/obs", 200) => {
                let look: SwarmObsResponse = serde_json::from_slice(body).expect("observations");
                look.observations.iter().for_each(seen);
            }
            ("/act", 200) => {
                let answer: ActResponse = serde_json::from_slice(body).expect("a receipt");
                played.came_after_all(&answer.receipt);
                answer.obs.iter().for_each(seen);
            }
            ("/act", 409) => {
                refused(self.acts[0], &serde_json::from_slice(body).expect("a problem"));
            }
            ("/swarm/act", 200) => {
                let answer: SwarmActResponse = serde_json::from_slice(body).expect("receipts");
                for (place, receipt) in self.acts.iter().zip(&answer.receipts) {
                    match receipt {
                        SwarmReceipt::Receipt(receipt) => played.came_after_all(receipt),
                        SwarmReceipt::Problem(problem) => refused(*place, problem),
                    }
                }
            }
            (_, 200..300) => {}
            // A start that was held until all had been played.
            (path, 409) if path.ends_with("/start") => {
                let problem: Problem = serde_json::from_slice(body).expect("a problem");
                assert_eq!(problem.code, "episode_over", "{name}: {text}");
                assert!(played.has_ended(), "{name}: {text}");
            }
            (path, status) => panic!("{name} {agent:?}: {path} answered {status}: {text}"),
        }
    }
}

/// Sends a request and reads the whole answer.
async fn whole(call: RequestBuilder) -> Whole {
    let response = call.send().await?;
    let status = response.status().as_u16();
    Ok((status, response.bytes().await?.to_vec()))
}

/// One client: it notices when it talks to another run of the server.
struct Client<'a> {
    clients: &'a Clients,
    number: u64,
    /// The run that answered last.
    run: u64,
    /// The last run in which everything was in order.
    checked: u64,
}

impl<'a> Client<'a> {
    fn new(clients: &'a Clients) -> Self {
        let number = clients.next_client.fetch_add(1, Ordering::SeqCst);
        clients.note_check(number, Some(0));
        Self { clients, number, run: 0, checked: 0 }
    }

    /// The observation of a seat.
    async fn look(&mut self, played: &Played, agent: AgentId) -> Observation {
        let known = played.known(agent);
        let answer = self.clients.call(Method::GET, "/obs", played.token(agent)).await;
        self.run = answer.run;
        let seen = answer.ok();
        played.seen(agent, known, &seen);
        seen
    }

    /// The observation of a seat after a round.
    async fn look_after(&mut self, played: &Played, agent: AgentId, round: u32) -> Observation {
        let known = played.known(agent);
        let poll = |http: &reqwest::Client, base: &str| {
            let call = http.get(format!("{base}/obs")).bearer_auth(played.token(agent));
            call.query(&[("after", round), ("wait", self.clients.wait_s())])
        };
        let seen = self.poll(played, &[agent], poll).await.ok();
        played.seen(agent, known, &seen);
        seen
    }

    /// A long poll. Where the server ends meanwhile, the next one is looked over before it is asked again.
    async fn poll(
        &mut self,
        played: &Played,
        agents: &[AgentId],
        fill: impl Fn(&reqwest::Client, &str) -> RequestBuilder,
    ) -> ClientAnswer {
        let mut tried = Tried::default();
        loop {
            match self.clients.attempt(tried, &fill).await {
                Ok(answer) => {
                    self.run = answer.run;
                    return answer;
                }
                Err(broken) => {
                    tried = broken.tried;
                    self.run = self.clients.servers.run_after(tried).await;
                    self.check_after_restart(played, agents).await;
                }
            }
        }
    }

    /// Acts for a seat until that is acknowledged or too late; the next observation, if it came too.
    async fn act(&mut self, played: &Played, agent: AgentId, round: u32) -> Option<Observation> {
        let clients = self.clients;
        let act = played.game.act(agent, round);
        let wait = played.game.waits_with_the_act(agent, round).then_some(clients.wait_s());
        played.will_send(agent, &act);
        clients.sent.send_modify(|count| *count += 1);
        let known = played.known(agent);
        let answer = clients.post_act(played.token(agent), &act, wait).await;
        self.run = answer.run;
        if answer.status == 409 {
            assert!(!answer.after_failure, "refused by what was not kept: {}", answer.text());
            played.refused(agent, round, &answer.read::<Problem>().code);
            count(&clients.counts.came_late);
            return None;
        }
        let ActResponse { receipt, obs } = answer.ok();
        clients.receive(played, agent, &answer, &receipt);
        if let Some(next) = &obs {
            assert!(next.sight.round > round || next.sight.result.is_some());
            played.seen(agent, known, next);
        }
        obs
    }

    /// Acts for several seats until all that is acknowledged or too late.
    async fn act_for_all(&mut self, played: &Played, mut acts: Vec<(AgentId, ActRequest)>) {
        let clients = self.clients;
        for (agent, act) in &acts {
            played.will_send(*agent, act);
        }
        let mut lost = false;
        while !acts.is_empty() {
            clients.sent.send_modify(|count| *count += 1);
            let id = &played.created.id;
            let sent = acts
                .iter()
                .map(|(agent, act)| SwarmAct::of(id.clone(), agent.to_string(), act.clone()));
            let (mut answer, receipts) = clients.post_acts(played, sent.collect()).await;
            self.run = answer.run;
            answer.lost |= lost;
            let mut again = Vec::new();
            let mut refusal = None;
            for ((agent, act), receipt) in acts.into_iter().zip(receipts) {
                match receipt {
                    SwarmReceipt::Receipt(receipt) => {
                        clients.receive(played, agent, &answer, &receipt);
                    }
                    SwarmReceipt::Problem(problem) if problem.status == 409 => {
                        assert!(!answer.after_failure, "refused by what was not kept: {problem:?}");
                        played.refused(agent, act.round, &problem.code);
                        count(&clients.counts.came_late);
                    }
                    SwarmReceipt::Problem(problem) => {
                        again.push((agent, act));
                        refusal = Some(problem);
                    }
                }
            }
            if let Some(problem) = refusal {
                lost = true;
                clients.refused(&answer, &problem).await;
            }
            acts = again;
        }
    }

    /// Checks at another run of the server: everything must be as it was, and acknowledged acts are confirmed, those
    /// of this episode and those of one that has ended.
    async fn check_after_restart(&mut self, played: &Played, agents: &[AgentId]) {
        while self.checked < self.run {
            let run = self.run;
            let clients = self.clients;
            let purpose = format!("check {run} {} {:?}", played.game.number, agents[0]);
            let dice = Dice::of(clients.seed, &purpose);
            let agent = *dice.pick(agents);
            self.look(played, agent).await;
            if played.game.by == By::Swarm {
                self.look_for_all(played).await;
            }
            self.sample(played, agent, &dice).await;
            self.compare_states(played, &dice).await;
            if let Some(ended) = clients.ledger.ended(&dice) {
                let agent = *dice.pick(&ended.agents().collect::<Vec<_>>());
                self.look(&ended, agent).await;
                self.sample(&ended, agent, &dice).await;
            }
            self.checked = run;
            count(&clients.counts.checked_after_restart);
            clients.note_check(self.number, Some(run));
        }
    }

    /// The observations that wait for an act: none of a seat whose act was acknowledged.
    async fn look_for_all(&mut self, played: &Played) {
        let known: Vec<_> = played.agents().map(|agent| played.known(agent)).collect();
        let token = &played.created.swarm_token;
        let answer = self.clients.call(Method::GET, "/swarm/obs?limit=1024", token).await;
        self.run = answer.run;
        for seen in answer.ok::<SwarmObsResponse>().observations {
            let agent = AgentId::parse(&seen.sight.agent).expect("an agent");
            assert!(!seen.moment.acted, "{}: {agent} does not wait", played.name());
            played.seen(agent, known[agent.index()], &seen);
        }
    }

    /// Confirms the newest acknowledged act of a seat and some older ones.
    async fn sample(&self, played: &Played, agent: AgentId, dice: &Dice) {
        let acts = played.acknowledged_acts(agent);
        let newest = acts.iter().next_back();
        let older = (0..SAMPLE - 1).filter(|_| !acts.is_empty()).map(|_| dice.pick(&acts));
        for act in newest.into_iter().chain(older) {
            let by = *dice.pick(&[By::Seats, By::Swarm]);
            self.clients.confirm(played, agent, act, by).await;
        }
    }

    /// Looks at the state of the newest round that is known, and again at one that was seen before.
    async fn compare_states(&self, played: &Played, dice: &Dice) {
        let newest = played.stands_at();
        for round in [played.seen_state(dice), Some(newest)].into_iter().flatten() {
            let path = format!("/api/v1/episodes/{}/state?round={round}", played.created.id);
            let token = &played.created.swarm_token;
            let state: State = self.clients.call(Method::GET, &path, token).await.ok();
            assert_eq!(state.round, round);
            played.saw_state(&state);
            count(&self.clients.counts.states_compared);
        }
    }
}

impl Drop for Client<'_> {
    fn drop(&mut self) {
        self.clients.note_check(self.number, None);
    }
}

/// Does something while others play; ends with them where they find a fault.
pub(crate) async fn while_playing<T>(tables: &mut JoinSet<()>, work: impl Future<Output = T>) -> T {
    tokio::select! {
        done = work => done,
        ended = tables.join_next() => match ended {
            Some(Err(error)) => std::panic::resume_unwind(error.into_panic()),
            Some(Ok(())) | None => panic!("nobody plays any more"),
        },
    }
}
