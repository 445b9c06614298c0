//! A run, whose next step is always drawn from the seed alone.

mod end;
mod requests;
mod several;
mod trace;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use futures::FutureExt;
use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench::cluster::Incarnation;
use swarmbench::episode::actor::Handle;
use swarmbench::episode::quota::{Caps, Quotas};
use swarmbench::episode::registry::Registry;
use swarmbench::hosted;
use swarmbench::ids::{EpisodeId, Numbers};
use swarmbench::store::entries::Entry;
use swarmbench::work::Workers;
use swarmbench_clock::Clock;
use swarmbench_testkit::worlds::Dice;
use tokio::sync::mpsc::UnboundedReceiver;

use self::several::is_played;
use self::trace::{line, told as told_as};
use crate::simulation::broken::Flaw;
use crate::simulation::checker::{Checker, Invariant, Stats, Violation};
use crate::simulation::clients::{Acts, Desk, News, RequestId, Times, Told};
use crate::simulation::cluster::{Net, Peer, Site};
use crate::simulation::database::Database;
use crate::simulation::executor::{Executor, TaskId};
use crate::simulation::journal::MemoryJournal;
use crate::simulation::number;
use crate::simulation::time::{ServerClock, SimClock};

/// An upper bound of the steps of a run.
const STEPS_MAX: usize = 20_000;

/// The maximum number of rounds of a game.
pub(crate) const ROUNDS_MAX: i64 = 20;

/// The maximum number of servers of a database.
pub(crate) const SERVERS_MAX: usize = 3;

/// The beginning of a fault in a trace.
const FAULT: &str = "does not hold: ";

/// The default number of lines of a trace shown before a fault.
const LINES: u64 = 150;

/// Longer than an idle episode stays in memory.
const UNUSED: Duration = Duration::from_secs(5 * 60 + 1);

/// The options of a run, drawn from its seed. No run contains everything, so that frequent events do not always drown
/// rare ones.
#[derive(Clone, Debug)]
pub(crate) struct Options {
    pub(crate) seed: u64,
    /// Maximum number of episodes that clients create.
    episodes: usize,
    /// Number of requests that clients send before the end.
    requests: usize,
    /// Maximum number of requests in flight.
    pending: usize,
    times: Times,
    /// True if time ever moves by minutes, so that episodes are evicted.
    long_waits: bool,
    crashes: usize,
    failures: usize,
    /// Number of single jobs that the journal refuses.
    refusals: usize,
    /// The weight of clients that go away.
    drops: usize,
    aborts: bool,
    /// True if acts are sent again, changed, too late and too early.
    strays: usize,
    /// Maximum number of jobs of a commit.
    group: usize,
    /// Maximum number of times that a read of the journal yields, before and after.
    pauses: usize,
    caps: Caps,
    /// The weight of polls, relative to other steps.
    haste: usize,
    /// True if the run ends in silence: no requests, and time passes.
    silence: bool,
    /// Number of servers that share the database; 0 for a server alone.
    servers: usize,
    /// Maximum number of abrupt stops of one of them.
    stops: usize,
    /// Maximum number of times that one of them leaves.
    leaves: usize,
    /// The errors of the servers' own clocks, in seconds.
    off_s: [i64; SERVERS_MAX],
    flaw: Option<Flaw>,
}

impl Options {
    /// Draws the options of a seed.
    pub(crate) fn draw(seed: u64, flaw: Option<Flaw>) -> Self {
        let mut dice = Dice(seed);
        let mut below = |n: usize| dice.below(n);
        let caps = Caps {
            // All clients share one key, which gets half of the episodes.
            episodes_unfinished_max: [4, 200][below(2)],
            episodes_per_key_max: [1, 100][below(2)],
            journal_bytes_per_episode_max: [4_000, 1 << 30][below(2)],
            journal_bytes_per_key_max: [8_000, 1 << 30][below(2)],
            reserved_percent: 0,
            journal_bytes_per_key_s_max: 0,
        };
        let mut options = Self {
            seed,
            refusals: 0,
            episodes: 1 + below(4),
            requests: 20 + below(100),
            pending: 1 + below(8),
            times: Times { clocked: below(3), short_idle: below(3) == 0 },
            long_waits: below(2) == 0,
            crashes: [0, 1, 3][below(3)],
            failures: [0, 0, 1, 2][below(4)],
            drops: [0, 6, 40][below(3)],
            aborts: below(3) == 0,
            strays: below(3),
            group: [1, 3, 1_000][below(3)],
            pauses: below(3),
            caps,
            haste: [1, 4, 16][below(3)],
            silence: below(2) == 0,
            servers: 0,
            stops: 0,
            leaves: 0,
            off_s: [0; SERVERS_MAX],
            flaw,
        };
        options.refusals = [0, 1, 5, 20][below(4)];
        options
    }

    /// Draws the options of a seed whose servers share the database.
    pub(crate) fn draw_several(seed: u64, flaw: Option<Flaw>) -> Self {
        let mut options = Self::draw(seed, flaw);
        let mut dice = Dice(seed.rotate_left(17));
        let mut below = |n: usize| dice.below(n);
        options.servers = 2 + below(SERVERS_MAX - 1);
        options.stops = [0, 4, 8, 16][below(4)];
        options.pauses = 1 + below(3);
        options.leaves = [0, 0, 1, 2][below(4)];
        options.off_s = std::array::from_fn(|_| [-8, -4, 0, 4, 8][below(5)]);
        // Games without a clock are given up when they are idle.
        options.long_waits = true;
        options
    }
}

/// The result of a run.
pub(crate) struct SimulationReport {
    pub(crate) options: Options,
    pub(crate) violations: Vec<Violation>,
    pub(crate) stats: Stats,
    /// All events, a line each.
    pub(crate) trace: Vec<String>,
    /// The hash of the trace and of all entries on the disk.
    pub(crate) bytes: [u8; 32],
}

impl SimulationReport {
    /// A description for debugging.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("{:#?}\n", self.options);
        // The events before the first fault; later ones may follow from it.
        let is_fault = |line: &String| line.starts_with(FAULT);
        let last = self.trace.iter().position(is_fault).map_or(self.trace.len(), |at| at + 1);
        let lines = usize::try_from(number("SWARMBENCH_LINES", LINES)).expect("some");
        for line in &self.trace[last.saturating_sub(lines)..last] {
            _ = writeln!(text, "{line}");
        }
        for Violation { invariant, what } in &self.violations {
            _ = writeln!(text, "{FAULT}{invariant:?}: {what}");
        }
        let seed = self.options.seed;
        _ = writeln!(
            text,
            "again: SWARMBENCH_SEED={seed} SWARMBENCH_SEEDS=1 cargo test --test parts simulation::{}",
            if self.options.servers > 0 { "clusters" } else { "seeds" }
        );
        text
    }
}

/// A step of a run.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// Polls a task.
    Poll,
    /// Makes jobs durable.
    Commit,
    /// Delivers the result of a job.
    Tell,
    /// Lets time pass.
    Pass,
    /// Sends a request of a client.
    Ask,
    /// Drops a client.
    Leave,
    /// Sweeps idle episodes of the server.
    Sweep,
    /// Fails a commit.
    Fail,
    /// Refuses a job.
    Refuse,
    /// Crashes the server and starts it again; one of several is started later.
    Crash,
    /// Stops a server of a cluster abruptly.
    Stop,
    /// Resumes a stopped server.
    GoOn,
    /// Lets a server accept no more requests; it leaves as soon as all its jobs are durable.
    Shut,
    /// Lets a shut server leave.
    Quit,
    /// Starts an absent server.
    Start,
}

struct SimulationRun {
    options: Options,
    dice: Dice,
    executor: Executor,
    database: Arc<Database>,
    clock: Arc<SimClock>,
    /// One server, or two with that flaw, or the present ones of several.
    servers: Vec<Server>,
    /// The slots of absent servers.
    down: Vec<i16>,
    /// The network of a cluster.
    net: Arc<Net>,
    desk: Desk,
    checker: Checker,
    pending: BTreeMap<RequestId, TaskId>,
    /// Acts that were sent, and may be sent again.
    acts: Vec<(EpisodeId, Acts)>,
    asked: RequestId,
    created: usize,
    crashes: usize,
    failures: usize,
    refusals: usize,
    stops: usize,
    leaves: usize,
    /// True if no more faults are injected.
    is_calm: bool,
    /// The registered servers, as last seen.
    known: Vec<Incarnation>,
    trace: Vec<String>,
    /// The number of faults in the trace.
    faults: usize,
}

struct Server {
    incarnation: Incarnation,
    journal: Arc<MemoryJournal>,
    registry: Registry,
    /// The server's part in the cluster, if it is in one.
    peer: Option<Arc<Peer>>,
    slot: i16,
    /// True if a commit is on its way to the database although the server is stopped.
    is_sent: bool,
    /// Episodes with seats that the server plays.
    hosted: UnboundedReceiver<Handle>,
    quotas: Arc<Quotas>,
    sweep: Option<TaskId>,
}

/// Plays a run to its end.
pub(crate) fn run(options: Options) -> SimulationReport {
    let mut run = SimulationRun::new(options);
    run.play();
    run.finish();
    run.report()
}

impl SimulationRun {
    fn new(options: Options) -> Self {
        let seed = options.seed;
        let start: Timestamp = "2026-03-01T12:00:00Z".parse().expect("a time");
        let (clock, desk) = (Arc::new(SimClock::new(start)), Desk::default());
        let mut run = Self {
            dice: Dice(seed ^ 0x5EED),
            executor: Executor::default(),
            database: Arc::default(),
            net: Arc::new(Net::new(Arc::clone(&clock), Arc::clone(&desk))),
            clock,
            servers: Vec::new(),
            down: Vec::new(),
            desk,
            checker: Checker::new(start, options.servers > 0),
            pending: BTreeMap::new(),
            acts: Vec::new(),
            asked: 0,
            created: 0,
            crashes: 0,
            failures: 0,
            refusals: 0,
            stops: 0,
            leaves: 0,
            is_calm: false,
            known: Vec::new(),
            trace: Vec::new(),
            faults: 0,
            options,
        };
        if run.is_shared() {
            (0..run.options.servers).for_each(|slot| run.start_one(slot));
        } else {
            run.start(None);
        }
        run
    }

    fn note(&mut self, line: String) {
        self.note_faults();
        self.trace.push(line);
    }

    /// Writes faults found since the last line into the trace.
    fn note_faults(&mut self) {
        for Violation { invariant, what } in &self.checker.violations[self.faults..] {
            self.trace.push(format!("{FAULT}{invariant:?}: {what}"));
        }
        self.faults = self.checker.violations.len();
    }

    const fn is_shared(&self) -> bool {
        self.options.servers > 0
    }

    /// Starts the server over the durable entries, like [`swarmbench::server`]. Its journal outlives it.
    fn start(&mut self, journal: Option<Arc<MemoryJournal>>) {
        let journal = journal.unwrap_or_else(|| Arc::new(self.journal(0, 1)));
        let count = if self.options.flaw == Some(Flaw::TwoServers) { 2 } else { 1 };
        for place in 0..count {
            // Each server numbers its episodes from the newest one, plus a distance.
            let keys = Numbers::after(self.database.tables().last_key() + 100 * place);
            let server = self.server(0, Arc::clone(&journal), keys);
            let recovery = server.registry.clone();
            let recovering = async move { drop(recovery.recover_unfinished().await) };
            self.executor.spawn(server.incarnation, recovering.boxed());
            self.servers.push(server);
        }
    }

    fn journal(&self, more: u64, incarnation: Incarnation) -> MemoryJournal {
        let (seed, Options { pauses, flaw, .. }) = (!self.options.seed, self.options.clone());
        let database = Arc::clone(&self.database);
        MemoryJournal::new(
            seed.wrapping_add(more << 40),
            pauses,
            flaw,
            database,
            incarnation,
            self.is_shared(),
        )
    }

    fn server(&mut self, slot: i16, journal: Arc<MemoryJournal>, keys: Numbers) -> Server {
        let quotas = Arc::new(Quotas::new(self.options.caps));
        for (owner, bytes) in self.database.tables().bytes_by_owner() {
            quotas.note_bytes(owner, bytes);
        }
        let clock = ServerClock {
            time: Arc::clone(&self.clock),
            flaw: self.options.flaw,
            asked: AtomicU64::new(0),
        };
        let incarnation = journal.incarnation();
        let registry = Registry::new(
            Arc::clone(&journal) as _,
            Arc::new(clock),
            Arc::clone(&quotas),
            Workers::inline(),
            self.executor.spawner(incarnation),
            0,
        );
        let registry = registry.with_numbers(keys);
        let hosted = registry.take_hosted().expect("nobody else plays");
        self.checker.began(incarnation);
        Server {
            incarnation,
            journal,
            registry,
            peer: None,
            slot,
            is_sent: false,
            hosted,
            quotas,
            sweep: None,
        }
    }

    /// Draws one of some servers; a single one needs no draw.
    fn one_of(&mut self, places: &[usize]) -> Option<usize> {
        match places {
            [] => None,
            [one] => Some(*one),
            _ => Some(places[self.dice.below(places.len())]),
        }
    }

    /// The indices of servers with a property.
    fn that(&self, is_it: impl Fn(&Server) -> bool) -> Vec<usize> {
        let places = self.servers.iter().enumerate();
        places.filter(|(_, server)| is_it(server)).map(|(place, _)| place).collect()
    }

    fn runs(&self, server: &Server) -> bool {
        !self.executor.is_stopped(server.incarnation)
    }

    /// Servers with a commit that may become durable now.
    fn writing(&self) -> Vec<usize> {
        self.that(|server| server.journal.queued() > 0 && (self.runs(server) || server.is_sent))
    }

    /// Servers with an undelivered result.
    fn untold(&self) -> Vec<usize> {
        self.that(|server| server.journal.untold() > 0 && self.runs(server))
    }

    fn failing(&self) -> Vec<usize> {
        self.that(|server| {
            server.journal.queued() > 0 && !server.journal.has_failed() && self.runs(server)
        })
    }

    fn refusing(&self) -> Vec<usize> {
        self.that(|server| server.journal.can_refuse() && self.runs(server))
    }

    fn failed(&self) -> Vec<usize> {
        self.that(|server| server.journal.has_failed())
    }

    fn stopped(&self) -> Vec<usize> {
        self.that(|server| !self.runs(server))
    }

    fn shutting(&self) -> Vec<usize> {
        self.that(|server| {
            server.peer.as_ref().is_some_and(|peer| peer.is_shut())
                && self.runs(server)
                && server.journal.queued() + server.journal.untold() == 0
        })
    }

    /// Servers that are neither stopped, failed nor leaving.
    fn well(&self) -> Vec<usize> {
        self.that(|server| {
            self.runs(server)
                && !server.journal.has_failed()
                && server.peer.as_ref().is_none_or(|peer| !peer.is_shut())
        })
    }

    /// Performs all drawn steps.
    fn play(&mut self) {
        let mut steps = 0;
        let requests = RequestId::try_from(self.options.requests).expect("a few");
        while self.asked < requests {
            steps += 1;
            if steps > STEPS_MAX * self.options.servers.max(1) {
                let what = "clients ask for no more".to_owned();
                self.checker.check(Invariant::Progress, false, || what);
                return;
            }
            let step = self.choose();
            self.step(step);
        }
        self.checker.stats.count("steps", steps);
    }

    /// Draws one of the possible steps.
    fn choose(&mut self) -> Step {
        let options = &self.options;
        let runnable = !self.executor.runnable().is_empty();
        let when = |possible: bool, weight: usize| if possible { weight } else { 0 };
        let weights = [
            (Step::Poll, when(runnable, 100 * options.haste)),
            (Step::Commit, when(!self.writing().is_empty(), 100)),
            (Step::Tell, when(!self.untold().is_empty(), 100)),
            (Step::Pass, 20),
            (Step::Ask, when(self.pending.len() < options.pending, 60)),
            (Step::Leave, when(!self.pending.is_empty(), options.drops)),
            (Step::Sweep, 10),
            (Step::Fail, when(self.failures < options.failures && !self.failing().is_empty(), 3)),
            (
                Step::Refuse,
                when(self.refusals < options.refusals && !self.refusing().is_empty(), 10),
            ),
            (
                Step::Crash,
                if self.failed().is_empty() {
                    when(self.crashes < options.crashes && !self.servers.is_empty(), 3)
                } else {
                    10
                },
            ),
            (Step::Stop, when(self.stops < options.stops && !self.well().is_empty(), 5)),
            (Step::GoOn, when(!self.stopped().is_empty(), 5)),
            (Step::Shut, when(self.leaves < options.leaves && !self.well().is_empty(), 3)),
            (Step::Quit, when(!self.shutting().is_empty(), 10)),
            (Step::Start, when(!self.down.is_empty(), 10)),
        ];
        let sum: usize = weights.iter().map(|(_, weight)| weight).sum();
        let mut drawn = self.dice.below(sum);
        if self.options.flaw == Some(Flaw::OtherChance) {
            static CHANCE: AtomicU64 = AtomicU64::new(0);
            let other = CHANCE.fetch_add(1, Ordering::Relaxed);
            drawn = (drawn + usize::try_from(other % 7).expect("less than 7")) % sum;
        }
        for (step, weight) in weights {
            if drawn < weight {
                return step;
            }
            drawn -= weight;
        }
        Step::Pass
    }

    fn step(&mut self, step: Step) {
        match step {
            Step::Poll => {
                let runnable = self.executor.runnable();
                let task = runnable[self.dice.below(runnable.len())];
                self.poll(task);
            }
            Step::Commit => {
                let Some(place) = self.one_of(&self.writing()) else { return };
                let queued = self.servers[place].journal.queued();
                let jobs = 1 + self.dice.below(queued.min(self.options.group));
                self.commit(place, jobs);
            }
            Step::Tell => {
                let Some(place) = self.one_of(&self.untold()) else { return };
                self.tell(place);
            }
            Step::Pass => {
                let by = self.time();
                self.pass(by);
            }
            Step::Ask => {
                if let Some((id, request)) = self.request() {
                    self.ask(id, request);
                }
            }
            Step::Leave => {
                let place = self.dice.below(self.pending.len());
                let (&number, &task) = self.pending.iter().nth(place).expect("one of them");
                self.note(format!("request {number} is dropped"));
                self.pending.remove(&number);
                self.executor.drop_task(task);
                self.checker.left(number);
                self.look();
            }
            Step::Sweep => self.sweep(),
            Step::Fail => {
                let Some(place) = self.one_of(&self.failing()) else { return };
                self.failures += 1;
                let journal = Arc::clone(&self.servers[place].journal);
                let jobs = journal.queued().min(self.options.group);
                let is_on_disk = self.dice.below(3) == 0;
                self.note(format!("a commit of {jobs} jobs fails, on disk: {is_on_disk}"));
                let seen = journal.fail(jobs, is_on_disk);
                self.kept(&journal, &seen);
                self.checker.stats.count("failed commits", 1);
            }
            Step::Refuse => {
                let Some(place) = self.one_of(&self.refusing()) else { return };
                self.refusals += 1;
                self.note("the next job is refused".to_owned());
                self.servers[place].journal.refuse();
                self.checker.stats.count("refused jobs", 1);
            }
            Step::Crash => {
                let failed = self.failed();
                let all = self.that(|_| true);
                let of = if failed.is_empty() { all } else { failed };
                if !self.is_shared() {
                    self.crash();
                } else if let Some(place) = self.one_of(&of) {
                    self.crash_one(place);
                }
            }
            Step::Stop => {
                if let Some(place) = self.one_of(&self.well()) {
                    self.stop(place);
                }
            }
            Step::GoOn => {
                if let Some(place) = self.one_of(&self.stopped()) {
                    self.go_on(place);
                }
            }
            Step::Shut => {
                if let Some(place) = self.one_of(&self.well()) {
                    self.shut(place);
                }
            }
            Step::Quit => {
                if let Some(place) = self.one_of(&self.shutting()) {
                    self.quit(place);
                }
            }
            Step::Start => {
                if let Some(slot) = self.down.pop() {
                    self.start_one(slot.unsigned_abs().into());
                }
            }
        }
    }

    fn poll(&mut self, task: TaskId) {
        let ended = self.executor.poll(task);
        self.note(format!("task {task} goes on{}", if ended { " and ends" } else { "" }));
        self.look();
    }

    fn commit(&mut self, place: usize, jobs: usize) {
        let server = &mut self.servers[place];
        server.is_sent = false;
        let journal = Arc::clone(&server.journal);
        let kept = journal.commit(jobs);
        self.note(format!("{jobs} jobs{} are committed", self.of(journal.incarnation())));
        self.kept(&journal, &kept);
        self.look();
    }

    /// Reports durable entries to the trace and the checker.
    fn kept(&mut self, journal: &MemoryJournal, kept: &[Entry]) {
        for entry in kept {
            self.note(format!("  {}", line(entry)));
        }
        self.checker.durable(kept);
        if self.is_shared() {
            self.check_writer(journal.incarnation(), kept);
        }
    }

    /// Names a server in a trace.
    fn of(&self, incarnation: Incarnation) -> String {
        if self.is_shared() { format!(" of server {incarnation}") } else { String::new() }
    }

    fn tell(&mut self, place: usize) {
        let server = self.servers[place].incarnation;
        let Some(finished) = self.servers[place].journal.next_result() else { return };
        let result = if finished.result.is_ok() { "durable" } else { "failed" };
        let (count, of) = (finished.entries.len(), self.of(server));
        self.note(format!("{count} entries{of} are finished to be {result}"));
        self.checker.told(server, &finished);
        self.look();
    }

    /// Draws how much time passes: often to the exact millisecond of the next waking, or one beside it.
    fn time(&mut self) -> Duration {
        let awaited: Vec<_> = self.clock.awaited();
        let hour = Duration::from_hours(1);
        let soon: Vec<_> = awaited.into_iter().filter(|&left| left < hour).collect();
        match self.dice.below(8) {
            0..=2 if !soon.is_empty() => {
                let left = soon[self.dice.below(soon.len())];
                match self.dice.below(3) {
                    0 => left.saturating_sub(Duration::from_millis(1)),
                    1 => left,
                    _ => left + Duration::from_millis(1),
                }
            }
            3 if self.options.long_waits => UNUSED,
            4 => Duration::from_millis(500 + self.dice.below(3_000) as u64),
            5 if self.is_shared() => Duration::from_millis(4_000 + self.dice.below(9_000) as u64),
            _ => Duration::from_millis(1 + self.dice.below(60) as u64),
        }
    }

    fn pass(&mut self, by: Duration) {
        self.clock.advance(by);
        self.checker.now = self.clock.now();
        self.note(format!("{by:?} pass, it is {}", self.checker.now));
        if self.is_shared() {
            self.stay_alive(by);
        }
    }

    fn sweep(&mut self) {
        for place in 0..self.servers.len() {
            let server = &self.servers[place];
            if server.sweep.is_some_and(|task| self.executor.is_alive(task)) || !self.runs(server) {
                continue;
            }
            let incarnation = server.incarnation;
            let registry = server.registry.clone();
            let task = async move { registry.sweep_idle().await };
            self.servers[place].sweep = Some(self.executor.spawn(incarnation, task.boxed()));
            let registry = &self.servers[place].registry;
            let before = registry.in_memory();
            registry.evict_unused();
            let gone = before - registry.in_memory();
            self.checker.stats.count("evictions", gone);
            let of = self.of(incarnation);
            self.note(format!("the server{of} sweeps and lets go of {gone}"));
            self.look();
        }
    }

    fn crash(&mut self) {
        self.crashes += 1;
        self.note("the server falls over".to_owned());
        let servers = std::mem::take(&mut self.servers);
        let journal = Arc::clone(&servers[0].journal);
        self.executor.crash(journal.incarnation());
        drop(servers);
        self.pending.clear();
        self.desk.lock().expect("one thread").clear();
        let found = journal.crash();
        for entry in &found {
            self.note(format!("  found: {}", line(entry)));
        }
        self.checker.crashed(&found, &self.database.tables().durable);
        self.start(Some(journal));
    }

    /// Starts the players of hosted seats.
    fn host(&mut self) {
        for server in &mut self.servers {
            while let Ok(handle) = server.hosted.try_recv() {
                let (host, permits) = (server.registry.host().clone(), hosted::permits());
                let playing = async move { drop(hosted::play(handle, &host, &permits).await) };
                self.executor.spawn(server.incarnation, playing.boxed());
            }
        }
    }

    /// Collects the effects of a step.
    fn look(&mut self) {
        self.host();
        for place in 0..self.servers.len() {
            let server = self.servers[place].incarnation;
            for entries in self.servers[place].journal.take_handed() {
                for entry in &entries {
                    self.note(format!("  handed over{}: {}", self.of(server), line(entry)));
                }
                // Decisions of an excluded server never take effect.
                if !self.is_shared() || self.database.tables().knows(server) {
                    self.checker.handed(server, &entries);
                }
            }
        }
        loop {
            let told = self.desk.lock().expect("one thread").pop_front();
            let Some(Told { number, id, server, plays, news }) = told else { break };
            match news {
                News::Arrived(acts) => {
                    let of = self.of(server);
                    self.note(format!("  request {number} is in the mailbox{of}"));
                    self.checker.arrived(server, number, &id, acts.clone());
                    self.acts.push((id, acts));
                }
                News::Seen(snapshot) => {
                    let round = snapshot.world.round();
                    let (status, head) = (snapshot.status.name(), snapshot.head);
                    self.note(format!("  request {number} sees round {round}, {status}, {head}"));
                    self.checker.seen(server, number, &snapshot);
                    self.checker.answers_for(server, &id, plays);
                }
                News::Answered(answer) => {
                    self.note(format!("  request {number} is answered: {}", told_as(&answer)));
                    self.pending.remove(&number);
                    let is_played = is_played(&answer);
                    self.checker.answered(server, number, answer);
                    self.checker.answers_for(server, &id, plays || !is_played);
                }
            }
        }
        if self.is_shared() {
            self.check_owners();
        }
    }

    fn report(mut self) -> SimulationReport {
        self.note_faults();
        let given_up = self.database.tables().given_up;
        self.checker.stats.count("games given up", given_up);
        for entry in &self.database.tables().durable {
            self.trace.push(format!("on disk: {entry:?}"));
        }
        let mut hash = Sha256::new();
        for line in &self.trace {
            hash.update(line.as_bytes());
            hash.update(b"\n");
        }
        self.trace.retain(|line| !line.starts_with("on disk: "));
        SimulationReport {
            options: self.options,
            violations: self.checker.violations,
            stats: self.checker.stats,
            trace: self.trace,
            bytes: hash.finalize().into(),
        }
    }
}
