//! One run: which step is next, drawn from the seed alone.

mod end;
mod requests;
mod trace;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures::FutureExt;
use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench::episode::actor::Handle;
use swarmbench::episode::quota::{Caps, Quotas};
use swarmbench::episode::registry::Registry;
use swarmbench::hosted;
use swarmbench::ids::EpisodeId;
use swarmbench::work::Workers;
use swarmbench_clock::Clock;
use tokio::sync::mpsc::UnboundedReceiver;

use self::trace::{line, told};
use crate::broken::Flaw;
use crate::checker::{Checker, Invariant, Stats, Violation};
use crate::clients::{Acts, Desk, News, RequestId, Times};
use crate::dice::Dice;
use crate::executor::{Executor, TaskId};
use crate::journal::MemoryJournal;
use crate::time::{ServerClock, SimClock};

/// More steps than any run takes.
const STEPS_MAX: usize = 20_000;

/// No game has more rounds.
pub(crate) const ROUNDS_MAX: i64 = 20;

/// How a fault begins in a trace.
const FAULT: &str = "does not hold: ";

/// Lines of a trace that are shown before a fault.
const LINES: usize = 150;

/// Longer than an idle episode stays in memory.
const UNUSED: Duration = Duration::from_secs(5 * 60 + 1);

/// What a run is, drawn from its seed: not everything happens in every run, so that what happens
/// rarely is not always drowned by what happens often.
#[derive(Clone, Debug)]
pub(crate) struct Options {
    pub(crate) seed: u64,
    /// Episodes that clients create, at most.
    episodes: usize,
    /// Requests that clients send before the end.
    requests: usize,
    /// Requests that wait at once, at most.
    pending: usize,
    times: Times,
    /// Whether the time ever moves by minutes, so that episodes leave the memory.
    long_waits: bool,
    crashes: usize,
    failures: usize,
    /// Jobs that the journal refuses though it keeps the others.
    refusals: usize,
    /// How often clients go away.
    drops: usize,
    aborts: bool,
    /// Whether acts are sent again, changed, too late and too early.
    strays: usize,
    /// Jobs of a commit, at most.
    group: usize,
    /// How often a read of the journal lets others go first, at most, before and after.
    pauses: usize,
    caps: Caps,
    /// How much more often than anything else a task is polled.
    haste: usize,
    /// Whether the run ends idle: no requests, and time passes.
    silence: bool,
    flaw: Option<Flaw>,
}

impl Options {
    /// The options that belong to a seed.
    pub(crate) fn draw(seed: u64, flaw: Option<Flaw>) -> Self {
        let mut dice = Dice(seed);
        let mut below = |n: usize| dice.below(n);
        let caps = Caps {
            episodes_unfinished_max: [2, 100][below(2)],
            episodes_per_key_max: [1, 100][below(2)],
            journal_bytes_per_episode_max: [4_000, 1 << 30][below(2)],
            journal_bytes_per_key_max: [8_000, 1 << 30][below(2)],
            // All clients share one key: a single key may open all episodes.
            episodes_reserved_percent: 0,
            episodes_of_free_percent_max: 10_000,
            journal_bytes_per_competition_max: 1 << 30,
            journal_bytes_per_key_s_max: 0,
            journal_bytes_per_competition_s_max: 0,
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
            flaw,
        };
        options.refusals = [0, 1, 5, 20][below(4)];
        options
    }
}

/// What a run came to.
pub(crate) struct Report {
    pub(crate) options: Options,
    pub(crate) violations: Vec<Violation>,
    pub(crate) stats: Stats,
    /// Everything that happened, a line each.
    pub(crate) trace: Vec<String>,
    /// The hash of the trace and of all that was on the disk.
    pub(crate) bytes: [u8; 32],
}

impl Report {
    /// What somebody needs who is to find out why.
    pub(crate) fn text(&self) -> String {
        let mut text = format!("{:#?}\n", self.options);
        // What led to the first fault; what came after it may follow from it.
        let is_fault = |line: &String| line.starts_with(FAULT);
        let last = self.trace.iter().position(is_fault).map_or(self.trace.len(), |at| at + 1);
        for line in &self.trace[last.saturating_sub(LINES)..last] {
            _ = writeln!(text, "{line}");
        }
        for Violation { invariant, what } in &self.violations {
            _ = writeln!(text, "{FAULT}{invariant:?}: {what}");
        }
        let seed = self.options.seed;
        _ = writeln!(
            text,
            "again: SWARMBENCH_SEED={seed} SWARMBENCH_SEEDS=1 cargo test --test simulation seeds"
        );
        text
    }
}

/// A step of a run.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// A task is polled.
    Poll,
    /// Jobs become durable.
    Commit,
    /// The result of a job is delivered.
    Tell,
    /// Time passes.
    Pass,
    /// A client sends a request.
    Ask,
    /// A client goes away.
    Leave,
    /// The server sweeps idle episodes.
    Sweep,
    /// A commit fails.
    Fail,
    /// The journal refuses a job.
    Refuse,
    /// The server falls over and is started again.
    Crash,
}

struct Run {
    options: Options,
    dice: Dice,
    executor: Executor,
    journal: Arc<MemoryJournal>,
    clock: Arc<SimClock>,
    /// One server, or two where that is the flaw.
    servers: Vec<Server>,
    desk: Desk,
    checker: Checker,
    pending: BTreeMap<RequestId, TaskId>,
    /// Acts that were sent, to be sent again.
    acts: Vec<(EpisodeId, Acts)>,
    asked: RequestId,
    created: usize,
    crashes: usize,
    failures: usize,
    refusals: usize,
    trace: Vec<String>,
    /// How many faults are in the trace.
    faults: usize,
}

struct Server {
    registry: Registry,
    /// Episodes of which the server plays seats.
    hosted: UnboundedReceiver<Handle>,
    quotas: Arc<Quotas>,
    sweep: Option<TaskId>,
}

/// Plays a run to its end.
pub(crate) fn run(options: Options) -> Report {
    let mut run = Run::new(options);
    run.play();
    run.finish();
    run.report()
}

impl Run {
    fn new(options: Options) -> Self {
        let seed = options.seed;
        let start: Timestamp = "2026-03-01T12:00:00Z".parse().expect("a time");
        let flaw = options.flaw;
        let mut run = Self {
            dice: Dice(seed ^ 0x5EED),
            executor: Executor::default(),
            journal: Arc::new(MemoryJournal::new(!seed, options.pauses, flaw)),
            clock: Arc::new(SimClock::new(start)),
            servers: Vec::new(),
            desk: Arc::new(Mutex::default()),
            checker: Checker::new(start),
            pending: BTreeMap::new(),
            acts: Vec::new(),
            asked: 0,
            created: 0,
            crashes: 0,
            failures: 0,
            refusals: 0,
            trace: Vec::new(),
            faults: 0,
            options,
        };
        run.start();
        run
    }

    fn note(&mut self, line: String) {
        self.note_faults();
        self.trace.push(line);
    }

    /// Writes down what was found since the last line.
    fn note_faults(&mut self) {
        for Violation { invariant, what } in &self.checker.violations[self.faults..] {
            self.trace.push(format!("{FAULT}{invariant:?}: {what}"));
        }
        self.faults = self.checker.violations.len();
    }

    /// Starts the server over what is durable, as [`swarmbench::server`] does.
    fn start(&mut self) {
        let count = if self.options.flaw == Some(Flaw::TwoServers) { 2 } else { 1 };
        self.servers = (0..count).map(|place| self.server(100 * place)).collect();
    }

    /// One that counts its episodes from the newest, and `keys` more, on.
    fn server(&mut self, keys: i64) -> Server {
        let quotas = Arc::new(Quotas::new(self.options.caps));
        for (owner, bytes) in self.journal.bytes_by_owner() {
            quotas.note_bytes(owner, bytes);
        }
        let clock = ServerClock {
            time: Arc::clone(&self.clock),
            flaw: self.options.flaw,
            asked: AtomicU64::new(0),
        };
        let registry = Registry::new(
            Arc::clone(&self.journal) as _,
            Arc::new(clock),
            Arc::clone(&quotas),
            Workers::inline(),
            self.executor.spawner(),
            self.journal.last_key() + keys,
        );
        let recovery = registry.clone();
        self.executor.spawn(async move { drop(recovery.recover_unfinished().await) }.boxed());
        let hosted = registry.take_hosted().expect("nobody else plays");
        Server { registry, hosted, quotas, sweep: None }
    }

    /// All steps that are drawn.
    fn play(&mut self) {
        let mut steps = 0;
        let requests = RequestId::try_from(self.options.requests).expect("a few");
        while self.asked < requests {
            steps += 1;
            if steps > STEPS_MAX {
                let what = "clients ask for no more".to_owned();
                self.checker.check(Invariant::Progress, false, || what);
                return;
            }
            let step = self.choose();
            self.step(step);
        }
        self.checker.stats.count("steps", steps);
    }

    /// Draws a step from those that are possible.
    fn choose(&mut self) -> Step {
        let options = &self.options;
        let runnable = !self.executor.runnable().is_empty();
        let when = |possible: bool, weight: usize| if possible { weight } else { 0 };
        let weights = [
            (Step::Poll, when(runnable, 100 * options.haste)),
            (Step::Commit, when(self.journal.queued() > 0, 100)),
            (Step::Tell, when(self.journal.untold() > 0, 100)),
            (Step::Pass, 20),
            (Step::Ask, when(self.pending.len() < options.pending, 60)),
            (Step::Leave, when(!self.pending.is_empty(), options.drops)),
            (Step::Sweep, 10),
            (
                Step::Fail,
                when(
                    self.failures < options.failures
                        && self.journal.queued() > 0
                        && !self.journal.has_failed(),
                    3,
                ),
            ),
            (Step::Refuse, when(self.refusals < options.refusals && self.journal.can_refuse(), 10)),
            (
                Step::Crash,
                if self.journal.has_failed() {
                    10
                } else {
                    when(self.crashes < options.crashes, 3)
                },
            ),
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
                let jobs = 1 + self.dice.below(self.journal.queued().min(self.options.group));
                self.commit(jobs);
            }
            Step::Tell => self.tell(),
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
                self.failures += 1;
                let jobs = self.journal.queued().min(self.options.group);
                let is_on_disk = self.dice.below(3) == 0;
                self.note(format!("a commit of {jobs} jobs fails, on disk: {is_on_disk}"));
                self.journal.fail(jobs, is_on_disk);
                self.checker.stats.count("failed commits", 1);
            }
            Step::Refuse => {
                self.refusals += 1;
                self.note("the next job is refused".to_owned());
                self.journal.refuse();
                self.checker.stats.count("refused jobs", 1);
            }
            Step::Crash => self.crash(),
        }
    }

    fn poll(&mut self, task: TaskId) {
        let ended = self.executor.poll(task);
        self.note(format!("task {task} goes on{}", if ended { " and ends" } else { "" }));
        self.look();
    }

    fn commit(&mut self, jobs: usize) {
        let kept = self.journal.commit(jobs);
        self.note(format!("{jobs} jobs are committed"));
        for entry in &kept {
            self.note(format!("  {}", line(entry)));
        }
        self.checker.durable(&kept);
    }

    fn tell(&mut self) {
        let Some(finished) = self.journal.next_result() else { return };
        let result = if finished.result.is_ok() { "durable" } else { "failed" };
        self.note(format!("{} entries are finished to be {result}", finished.entries.len()));
        self.checker.told(&finished);
        self.look();
    }

    /// How long nothing happens: often to the millisecond until somebody wakes.
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
            _ => Duration::from_millis(1 + self.dice.below(60) as u64),
        }
    }

    fn pass(&mut self, by: Duration) {
        self.clock.advance(by);
        self.checker.now = self.clock.now();
        self.note(format!("{by:?} pass, it is {}", self.checker.now));
    }

    fn sweep(&mut self) {
        for place in 0..self.servers.len() {
            let server = &self.servers[place];
            if server.sweep.is_some_and(|task| self.executor.is_alive(task)) {
                continue;
            }
            let registry = server.registry.clone();
            let task = async move { registry.sweep_idle().await };
            self.servers[place].sweep = Some(self.executor.spawn(task.boxed()));
            let registry = &self.servers[place].registry;
            let before = registry.in_memory();
            registry.evict_unused();
            let gone = before - registry.in_memory();
            self.checker.stats.count("evictions", gone);
            self.note(format!("the server sweeps and lets go of {gone}"));
            self.look();
        }
    }

    fn crash(&mut self) {
        self.crashes += 1;
        self.note("the server falls over".to_owned());
        self.executor.crash();
        self.servers.clear();
        self.pending.clear();
        self.desk.lock().expect("one thread").clear();
        let found = self.journal.crash();
        for entry in &found {
            self.note(format!("  found: {}", line(entry)));
        }
        self.checker.crashed(&found, &self.journal.durable());
        self.start();
    }

    /// Starts the players of hosted seats.
    fn host(&mut self) {
        for server in &mut self.servers {
            while let Ok(handle) = server.hosted.try_recv() {
                let (host, permits) = (server.registry.host().clone(), hosted::permits());
                let playing = async move { drop(hosted::play(handle, &host, &permits).await) };
                self.executor.spawn(playing.boxed());
            }
        }
    }

    /// Takes what the step has led to.
    fn look(&mut self) {
        self.host();
        for entries in self.journal.take_handed() {
            for entry in &entries {
                self.note(format!("  handed over: {}", line(entry)));
            }
            self.checker.handed(&entries);
        }
        loop {
            let Some((number, news)) = self.desk.lock().expect("one thread").pop_front() else {
                return;
            };
            match news {
                News::Arrived(acts) => {
                    self.note(format!("  request {number} is in the mailbox"));
                    if let Some(id) = self.checker.id_of(number) {
                        self.acts.push((id, acts.clone()));
                    }
                    self.checker.arrived(number, acts);
                }
                News::Seen(snapshot) => {
                    let round = snapshot.world.round();
                    let (status, head) = (snapshot.status.name(), snapshot.head);
                    self.note(format!("  request {number} sees round {round}, {status}, {head}"));
                    self.checker.seen(number, &snapshot);
                }
                News::Answered(answer) => {
                    self.note(format!("  request {number} is answered: {}", told(&answer)));
                    self.pending.remove(&number);
                    self.checker.answered(number, answer);
                }
            }
        }
    }

    fn report(mut self) -> Report {
        self.note_faults();
        for entry in self.journal.durable() {
            self.trace.push(format!("on disk: {entry:?}"));
        }
        let mut hash = Sha256::new();
        for line in &self.trace {
            hash.update(line.as_bytes());
            hash.update(b"\n");
        }
        self.trace.retain(|line| !line.starts_with("on disk: "));
        Report {
            options: self.options,
            violations: self.checker.violations,
            stats: self.checker.stats,
            trace: self.trace,
            bytes: hash.finalize().into(),
        }
    }
}
