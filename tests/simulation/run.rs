//! One run: which step is next, drawn from the seed alone.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures::FutureExt;
use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench::clock::Clock;
use swarmbench::episode::actor::Handle;
use swarmbench::episode::quota::{Caps, Purpose, Quotas};
use swarmbench::episode::registry::Registry;
use swarmbench::episode::seating::Wanted;
use swarmbench::fair::Party;
use swarmbench::hosted;
use swarmbench::ids::{EpisodeId, EpisodeKey};
use swarmbench::keys::OwnerKey;
use swarmbench::store::entries::Entry;
use swarmbench::work::Workers;
use swarmbench_engine::AgentId;
use tokio::sync::mpsc::UnboundedReceiver;

use crate::broken::Flaw;
use crate::checker::{Checker, Episode, Invariant, Stats, Violation};
use crate::clients::{
    Acts, Answer, Desk, News, Request, RequestId, Times, act, again, serve, spec,
};
use crate::dice::Dice;
use crate::executor::{Executor, TaskId};
use crate::journal::MemoryJournal;
use crate::time::{ServerClock, SimClock};

/// No run takes so many steps.
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
                let (host, turns) = (server.registry.host().clone(), hosted::turns());
                let playing = async move { drop(hosted::play(handle, &host, &turns).await) };
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

    fn ask(&mut self, id: EpisodeId, request: Request) {
        self.asked += 1;
        let number = self.asked;
        self.note(format!("request {number} for {id}: {}", asked(&request)));
        self.checker.sent(number, &id, &request);
        let place = self.dice.below(self.servers.len());
        let registry = self.servers[place].registry.clone();
        let (clock, desk) = (Arc::clone(&self.clock), Arc::clone(&self.desk));
        let task = serve(registry, clock, desk, number, id, request);
        let task = self.executor.spawn(task.boxed());
        self.pending.insert(number, task);
    }

    /// Draws what a client asks for.
    fn request(&mut self) -> Option<(EpisodeId, Request)> {
        let dice = &mut self.dice;
        let known: Vec<&Episode> = self.checker.episodes.values().collect();
        if known.is_empty() || (self.created < self.options.episodes && dice.below(4) == 0) {
            self.created += 1;
            let id = EpisodeId::from_text(format!("ep_{}", self.created));
            let owner = (dice.below(2) == 0).then_some(OwnerKey(1));
            let spec = spec(dice, self.options.times, self.clock.now());
            return Some((id, Request::Create(Box::new(spec), owner)));
        }
        // Most requests are for episodes that are played.
        let live: Vec<&Episode> = known.iter().copied().filter(|e| e.end.is_none()).collect();
        let of = if live.is_empty() || dice.below(8) == 0 { &known } else { &live };
        let episode = of[dice.below(of.len())];
        let (id, round) = (episode.id.clone(), episode.world.round());
        let mut seats: Vec<AgentId> = episode.world.agents().collect();
        let one = AgentId(u16::try_from(dice.below(seats.len())).expect("few"));
        if episode.spec.is_mixed() && episode.waiting && dice.below(2) == 0 {
            let some = u16::try_from(1 + dice.below(2)).expect("few");
            let wanted = if dice.below(2) == 0 { Wanted::Seat(one) } else { Wanted::Any(some) };
            return Some((id, Request::Claim(wanted)));
        }
        // Nobody has tokens of seats that are open, or that the server plays.
        seats.retain(|agent| episode.is_clients(*agent));
        if seats.is_empty() {
            seats.push(one);
            return Some((id, Request::Look));
        }
        let one = seats[dice.below(seats.len())];
        let strays = self.options.strays * 10;
        let weights = [30, 10, strays, strays, 4, 3, 2, if self.options.aborts { 2 } else { 0 }];
        let mut drawn = dice.below(weights.iter().sum());
        let kind = weights.iter().position(|&weight| {
            let is_it = drawn < weight;
            drawn = drawn.saturating_sub(weight);
            is_it
        });
        let request = match kind.expect("one of them") {
            0 => Request::Turn(vec![one], dice.below(1 << 30) as u64),
            1 => Request::Turn(seats, dice.below(1 << 30) as u64),
            2 if !self.acts.is_empty() => {
                // The same again, or another act for the same seat and round.
                let (id, acts) = &self.acts[dice.below(self.acts.len())];
                let config = self.checker.episode(id).map(|e| Arc::clone(&e.spec.config))?;
                let changed = dice.below(3) == 0;
                let acts = (acts.iter())
                    .map(|(agent, sent)| {
                        let changes = changed && dice.below(2) == 0;
                        let next = if changes {
                            act(dice, &config, *agent, sent.round)
                        } else {
                            again(dice, sent)
                        };
                        (*agent, next)
                    })
                    .collect();
                return Some((id.clone(), Request::Send(acts)));
            }
            2 | 3 => {
                // Any seats, too early or too late.
                let count = 1 + dice.below(3);
                let acts = (0..count).map(|_| {
                    let agent = seats[dice.below(seats.len())];
                    let round =
                        (round + 2).saturating_sub(u32::try_from(dice.below(5)).expect("few"));
                    (agent, act(dice, &episode.spec.config, agent, round))
                });
                Request::Send(acts.collect())
            }
            4 => Request::Wait(round),
            5 if episode.waiting => Request::Start,
            5 if episode.spec.is_mixed() => Request::Claim(Wanted::Any(1)),
            5 => Request::Look,
            6 => Request::State(u32::try_from(dice.below(round as usize + 1)).expect("a round")),
            _ => Request::Abort,
        };
        let request = if episode.waiting && dice.below(4) == 0 { Request::Start } else { request };
        Some((id, request))
    }

    // ---- the end of a run

    /// Everything is done that can be done without time and clients.
    fn settle(&mut self) {
        for _ in 0..STEPS_MAX {
            if let Some(&task) = self.executor.runnable().first() {
                self.poll(task);
            } else if self.journal.untold() > 0 {
                self.tell();
            } else if self.journal.queued() > 0 {
                self.commit(self.journal.queued());
            } else {
                return;
            }
        }
        self.checker.check(Invariant::Progress, false, || "the server does not rest".to_owned());
    }

    /// Nothing goes wrong any more: every episode comes to its end, by play or by silence.
    fn finish(&mut self) {
        if self.journal.has_failed() {
            self.crash();
        }
        self.settle();
        // An episode that failed twice at once is left alone for a while.
        self.pass(Duration::from_secs(1));
        if self.options.silence {
            self.fall_silent();
        } else {
            self.play_on();
        }
        for (id, ..) in self.unfinished() {
            self.checker.check(Invariant::Progress, false, || format!("{id} has not ended"));
        }
        self.send_again();
        self.leave_memory();
        let disk = self.journal.durable();
        self.checker.ended(&disk);
    }

    fn unfinished(&self) -> Vec<(EpisodeId, bool, Vec<AgentId>)> {
        let open = self.checker.episodes.values().filter(|episode| episode.end.is_none());
        let seats = |e: &Episode| e.world.agents().filter(|agent| e.is_clients(*agent)).collect();
        open.map(|e| (e.id.clone(), e.waiting, seats(e))).collect()
    }

    /// Clients play all that is unfinished to its end.
    fn play_on(&mut self) {
        // A round each time, or nearly: an act that is too long for its episode is not taken.
        for _ in 0..3 * ROUNDS_MAX {
            for (id, waiting, seats) in self.unfinished() {
                if waiting {
                    let open = self.checker.episode(&id).map_or(0, Episode::count_open);
                    if open > 0 {
                        self.ask(id.clone(), Request::Claim(Wanted::Any(open)));
                        self.settle();
                    }
                    self.ask(id.clone(), Request::Start);
                    self.settle();
                }
                let seed = self.dice.below(1 << 30) as u64;
                self.ask(id.clone(), Request::Turn(seats, seed));
                self.settle();
                self.ask_for_the_escaped(id);
                self.settle();
            }
        }
    }

    /// The player of an agent that is gone tries to continue.
    fn ask_for_the_escaped(&mut self, id: EpisodeId) {
        let Some(episode) = self.checker.episode(&id) else { return };
        let round = episode.world.round();
        let gone = (episode.world.agents())
            .filter(|&agent| !episode.world.is_alive(agent) && episode.is_clients(agent));
        let acts: Acts = gone
            .map(|agent| (agent, act(&mut self.dice, &episode.spec.config, agent, round)))
            .collect();
        if !acts.is_empty() {
            self.ask(id, Request::Send(acts));
        }
    }

    /// The last clients go away half-way. Then there are no requests, and hours pass.
    fn fall_silent(&mut self) {
        if self.options.crashes > 0 {
            self.crash();
            let hours = [0, 1, 3][self.dice.below(3)];
            self.pass(UNUSED + Duration::from_hours(hours));
        }
        for (id, ..) in self.unfinished() {
            self.ask(id, Request::Look);
        }
        while !self.pending.is_empty() {
            if self.dice.below(3) == 0 {
                self.step(Step::Leave);
            } else if !self.executor.runnable().is_empty() {
                self.step(Step::Poll);
            } else if self.journal.untold() > 0 {
                self.tell();
            } else if self.journal.queued() > 0 {
                self.step(Step::Commit);
            }
        }
        for _ in 0..40 {
            self.pass(Duration::from_mins(10));
            self.settle();
            self.sweep();
            self.settle();
        }
    }

    /// Acts that were acknowledged are acknowledged for ever.
    fn send_again(&mut self) {
        let receipts = self.checker.receipts();
        for (id, acts) in std::mem::take(&mut self.acts) {
            let known = (acts.into_iter())
                .filter(|(agent, act)| receipts.contains(&(id.clone(), act.round, *agent)));
            let acts: Acts = known.collect();
            if !acts.is_empty() {
                // One after the other: of those that come at once a seat gets some refused.
                self.ask(id, Request::Send(acts));
                self.settle();
            }
        }
    }

    /// What has ended leaves the memory and is counted no more.
    fn leave_memory(&mut self) {
        for _ in 0..2 {
            self.pass(UNUSED);
            self.sweep();
            self.settle();
        }
        let tasks = self.executor.len();
        let what = || format!("{tasks} tasks go on for nobody");
        self.checker.check(Invariant::Progress, tasks == 0, what);
        for Server { registry, quotas, .. } in &self.servers {
            let (held, unfinished) = (registry.in_memory(), registry.unfinished());
            let what = || format!("{held} episodes are in memory, {unfinished} are counted");
            self.checker.check(Invariant::Quotas, held + unfinished == 0, what);
            // All places of the owner are free.
            let caps = self.options.caps;
            let most = caps.episodes_per_key_max.min(caps.episodes_unfinished_max);
            let bytes: u64 = self.journal.bytes_by_owner().iter().map(|(_, bytes)| bytes).sum();
            if bytes < caps.journal_bytes_per_key_max {
                let places = 2_000..2_000 + i64::try_from(most).expect("few");
                let party = Party::of_key(Some(OwnerKey(1)));
                let refused = places
                    .map(|key| quotas.admit(EpisodeKey(key), party, Purpose::Usual))
                    .find_map(Result::err);
                let what = || format!("no place is left: {refused:?}");
                self.checker.check(Invariant::Quotas, refused.is_none(), what);
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

/// An entry in a line of the trace.
fn line(entry: &Entry) -> String {
    match entry {
        Entry::Open(row) => format!("{} is opened: {}", row.id, row.record.as_str()),
        Entry::Start { episode, at } => format!("{} is started at {at}", episode.0),
        Entry::Act(row) => format!(
            "{} round {} {} at {}, {} to come: {:.120}",
            row.episode.0,
            row.round,
            row.agent,
            row.at,
            row.waiting_for,
            row.record.as_str()
        ),
        Entry::Round(row) => {
            format!("{} round {} resolved: {}", row.episode.0, row.round, row.head)
        }
        Entry::End(row) => format!("{} ends at {}: {}", row.episode.0, row.at, row.record.as_str()),
        Entry::Claim(row) => format!(
            "{} {:?} are claimed by {}, {:?}",
            row.episode.0, row.agents, row.holder.number, row.holder.player
        ),
        Entry::Seat(row) => format!("{} is seated: {}", row.episode.0, row.record.as_str()),
        _ => "not of an episode".to_owned(),
    }
}

/// A request in a line of the trace.
fn asked(request: &Request) -> String {
    match request {
        Request::Create(spec, owner) => format!("create {:?} of {owner:?}", spec.config.settings()),
        Request::Send(acts) => {
            let brief = |(agent, act): &(AgentId, swarmbench::episode::lockstep::Submission)| {
                format!("{agent} round {} {:?}", act.round, act.record.action)
            };
            format!("send {:?}", acts.iter().map(brief).collect::<Vec<_>>())
        }
        other => format!("{other:?}"),
    }
}

/// An answer in a line of the trace.
fn told(answer: &Answer) -> String {
    match answer {
        Answer::Created(result) => format!("created {result:?}"),
        Answer::Nothing => "no such episode".to_owned(),
        Answer::NotTakenUp(error) => format!("not taken up: {error}"),
        Answer::Looked => "looked".to_owned(),
        Answer::Acted(_, outcomes, _) => {
            let brief = outcomes.iter().map(|outcome| match outcome {
                Ok(receipt) => format!(
                    "round {} {} to come, again: {}",
                    receipt.round, receipt.recorded.waiting_for, receipt.duplicate
                ),
                Err(error) => error.to_string(),
            });
            format!("{:?}", brief.collect::<Vec<_>>())
        }
        Answer::Claimed(wanted, result) => format!("claimed {wanted:?}: {result:?}"),
        Answer::Started(result) => format!("started {result:?}"),
        Answer::Aborted(result) => format!("aborted {result:?}"),
        Answer::State(round, result) => format!("state after {round}: {}", result.is_ok()),
    }
}
