//! The attackers: a process of its own, with a low priority and at most half a core.
//!
//! The process reads lines: what it is to do ([`Brief`]), `go`, `at ADDRESS` when the server is somewhere else, and it stops at
//! the end of its input. It writes `ready` when it is prepared, `taken` where others are to wait for that, and in the end what it
//! counted ([`AttackReport`]).

mod boards;
mod bodies;
mod connections;
mod entries;
mod everything;
mod floods;
mod games;
mod lists;
mod looks;
mod memory;
mod readers;
mod shapes;
mod storms;
mod templates;

use std::future::Future;
use std::io::{self, BufRead, Write as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::process::{Resource, getpriority_process, getrlimit, setpriority_process, setrlimit};
use rustix::time::{ClockId, clock_gettime};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swarmbench_testkit::dice::Dice;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::sleep;

use crate::attacks::honest::text;
use crate::attacks::measure::{Counts, Tally};
use crate::attacks::wire::{Request, Source, Wire, WireAnswer};

/// The environment variable that makes the program the attackers.
pub(crate) const ATTACKERS: &str = "SWARMBENCH_ATTACKERS";

/// The share of one core that all attackers together use at most.
pub(crate) const CPU_SHARE: f64 = 0.5;

/// Interval of looks at the processor time.
const CPU_PACE: Duration = Duration::from_millis(5);

/// Maximum seconds by which the attackers may be ahead of it.
const CPU_AHEAD_S: f64 = 0.02;

/// Niceness of the attackers above the server and the honest entrant.
const NICER: i32 = 10;

/// After this time no more is prepared, where less does, too.
const PREPARATION_MAX: Duration = Duration::from_mins(2);

/// After this time the attackers end in any case.
const LIFE_MAX: Duration = Duration::from_mins(15);

/// The settings of the attackers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Brief {
    pub(crate) attack: String,
    pub(crate) at: SocketAddr,
    pub(crate) seed: u64,
    /// True if the run has time for large numbers.
    pub(crate) is_long: bool,
    pub(crate) server: u32,
    /// The competition that the honest entrant plays.
    pub(crate) cup: String,
    /// Another one, which anybody may enter, with many games at a time.
    pub(crate) open_cup: String,
    /// The key of a member who is a stranger to the honest one.
    pub(crate) member: String,
}

/// Report of the attackers at the end.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct AttackReport {
    pub(crate) counts: Counts,
    pub(crate) seconds: f64,
    pub(crate) cpu_s: f64,
    pub(crate) notes: Vec<String>,
}

type Attacking = Pin<Box<dyn Future<Output = io::Result<()>> + Send>>;

/// An attack.
pub(crate) struct Attack {
    pub(crate) name: &'static str,
    pub(crate) what: &'static str,
    run: fn(Arc<Ctx>) -> Attacking,
    /// True if the server is killed and started again in the middle of it.
    pub(crate) restarts: bool,
    /// Maximum open files of the server; as many as the host allows where it is none.
    pub(crate) files: Option<u32>,
    /// Maximum processor time of the server for each answer 201, in milliseconds; asserted in a long run.
    pub(crate) creation_ms_max: Option<f64>,
    /// `--memory-max` of its server, in MiB: little, where memory is what is attacked.
    pub(crate) memory_mib: u64,
    /// Further options of the server.
    pub(crate) options: &'static [&'static str],
    /// Minimum duration, also in a short run.
    pub(crate) least: Duration,
    /// True if the honest entrant comes when the attackers have all that they take.
    pub(crate) takes: bool,
}

macro_rules! attack {
    ($name:literal, $run:path, $what:literal) => {
        Attack {
            name: $name,
            what: $what,
            run: |ctx| Box::pin($run(ctx)),
            restarts: false,
            files: None,
            creation_ms_max: None,
            memory_mib: 1024,
            options: &[],
            least: Duration::ZERO,
            takes: false,
        }
    };
    (small $name:literal, $run:path, $what:literal) => {
        Attack { memory_mib: 256, least: Duration::from_secs(6), ..attack!($name, $run, $what) }
    };
}

/// All attacks, in the order in which they are played.
pub(crate) const ATTACKS: &[Attack] = &[
    attack!(
        "dear_prompts",
        looks::dear_prompts,
        "templates of nested loops, prompts asked for on many connections"
    ),
    attack!("big_windows", looks::big_windows, "looks at the largest windows that are admitted"),
    attack!("places", entries::places, "attempts of many entrants take all places for episodes"),
    attack!(
        "journal_flood",
        floods::journal_flood,
        "anonymous entrants write acts with 200 KB of reasoning"
    ),
    attack!("slow_readers", readers::slow_readers, "journals and exports read a byte a second"),
    attack!("board_readers", boards::board_readers, "a large board read on many connections"),
    Attack {
        files: Some(1_256),
        ..attack!(
            "connections",
            connections::connections,
            "one client behind the proxy takes all connections"
        )
    },
    attack!(
        "old_states",
        readers::old_states,
        "old states of a large game, asked for and hung up on"
    ),
    attack!(
        "worths",
        readers::worths,
        "what could still be scored in large games, asked for by many"
    ),
    attack!(
        "heavy_steps",
        games::heavy_steps,
        "games whose rounds are dear, played as fast as possible"
    ),
    attack!(
        "hosted_players",
        games::hosted_players,
        "many games with the heaviest built-in players"
    ),
    Attack {
        restarts: true,
        ..attack!(
            "restart",
            games::restart,
            "the server is killed while six heavy games with clocks run"
        )
    },
    Attack {
        creation_ms_max: Some(2.0),
        ..attack!("registration", entries::registration, "thousands of entries into a competition")
    },
    attack!(
        "one_site",
        entries::one_site,
        "an IPv6 site enters the honest one's competition as often as it may"
    ),
    attack!(
        "lists",
        lists::lists,
        "large lists, unread events, long polls, bodies sent byte by byte"
    ),
    attack!(
        small "killer_templates",
        templates::killer_templates,
        "chains and nests of all kinds in templates, sent and looked at in all ways"
    ),
    Attack {
        restarts: true,
        ..attack!(small "carried_json", memory::carried_json, "games with clocks carry much JSON, and the server is killed")
    },
    attack!(
        small "unread_acts",
        readers::unread_acts,
        "acts are sent again for answers of 6 MB, which are read at 5 KB/s"
    ),
    attack!(small "waiting_meta", memory::waiting_meta, "looks by /mcp wait with 130 KB beside their arguments"),
    attack!(small "heads", memory::heads, "requests with heads of 62 KB are held open by the thousand"),
    attack!(
        small "unfinished_bodies",
        memory::unfinished_bodies,
        "bodies as large as they may be by the thousand, whose last bytes come one by one"
    ),
    attack!(small "mcp_flood", bodies::mcp_flood, "one address sends 130 KB to /mcp without a token that opens anything"),
    attack!(small "body_flood", bodies::body_flood, "bodies full of tiny values from those who may not ask"),
    attack!(small "no_acts", bodies::no_acts, "8 MB of tiny values come as the acts of a swarm"),
    attack!(small "hang_ups", bodies::hang_ups, "entries with much JSON from those who hang up at once"),
    Attack {
        takes: true,
        ..attack!(
            "all_streams",
            readers::all_streams,
            "eight addresses take all streams of events, twenty all exports"
        )
    },
    attack!(
        "storms",
        storms::storms,
        "games, tokens and entries with templates are made as fast as possible"
    ),
    Attack {
        options: &["--episodes-max", "200"],
        takes: true,
        ..attack!(
            "many_accounts",
            entries::many_accounts,
            "many entrants take all places of the honest one's competition"
        )
    },
    attack!("everything", everything::everything, "all of these kinds at once"),
];

/// From which addresses the attackers come.
#[derive(Clone, Copy, Debug)]
enum Addresses {
    /// Each connection from its own, through the proxy.
    Many,
    /// All from one, through the proxy.
    One,
    /// From the server's own host, without a proxy.
    Host,
}

/// State that attackers share.
pub(crate) struct Ctx {
    pub(crate) brief: Brief,
    pub(crate) tally: Arc<Tally>,
    at: watch::Receiver<SocketAddr>,
    stage: Arc<watch::Sender<bool>>,
    /// Attacks that are not prepared yet.
    preparing: Arc<AtomicUsize>,
    is_prepared: AtomicBool,
    /// Resources that the attackers have taken so far.
    taken: AtomicUsize,
    notes: Arc<Mutex<Vec<String>>>,
    started: Instant,
    /// When the attack began, and what the process had had of the processors then.
    since: Arc<Mutex<(Instant, f64)>>,
}

impl Ctx {
    /// The same for one of several attacks that are played at once, each with small numbers.
    fn part(&self) -> Arc<Self> {
        Arc::new(Self {
            brief: Brief { is_long: false, ..self.brief.clone() },
            tally: Arc::clone(&self.tally),
            at: self.at.clone(),
            stage: Arc::clone(&self.stage),
            preparing: Arc::clone(&self.preparing),
            is_prepared: AtomicBool::new(false),
            taken: AtomicUsize::new(0),
            notes: Arc::clone(&self.notes),
            started: self.started,
            since: Arc::clone(&self.since),
        })
    }

    fn note(&self, note: impl Into<String>) {
        self.notes.lock().expect("nothing panics while it holds this").push(note.into());
    }

    fn dice(&self, purpose: &str) -> Dice {
        Dice::of(self.brief.seed, purpose)
    }

    /// True if time is left to prepare more.
    fn has_time(&self) -> bool {
        self.started.elapsed() < PREPARATION_MAX
    }

    /// A number for a short run and for a long one.
    fn of(&self, short: usize, long: usize) -> usize {
        if self.brief.is_long { long } else { short }
    }

    fn addresses(&self, purpose: &str) -> Addresses {
        *self.dice(&format!("addresses {purpose}")).pick(&[
            Addresses::Many,
            Addresses::One,
            Addresses::Host,
        ])
    }

    fn source(addresses: Addresses, number: usize) -> Source {
        let [.., high, low] = u32::try_from(number).unwrap_or(0).to_be_bytes();
        match addresses {
            Addresses::Many => Source::behind_proxy(Ipv4Addr::new(198, 18, high, low)),
            Addresses::One => Source::behind_proxy(Ipv4Addr::new(203, 0, 113, 9)),
            Addresses::Host => Source {
                bind: Ipv4Addr::new(127, 0, 1, u8::try_from(number % 250).unwrap_or(0) + 1),
                forwarded: None,
            },
        }
    }

    fn wire(&self, addresses: Addresses, number: usize) -> Wire {
        Wire::new(*self.at.borrow(), Self::source(addresses, number), &self.tally)
    }

    /// Waits until all who prepare something are ready and the attack begins.
    async fn go(&self) {
        let was_prepared = self.is_prepared.swap(true, Ordering::SeqCst);
        if !was_prepared && self.preparing.fetch_sub(1, Ordering::SeqCst) == 1 {
            tell("ready");
        }
        drop(self.stage.subscribe().wait_for(|begun| *begun).await);
    }

    /// Notes that one more of `all` is taken, or refused.
    fn take_one(&self, all: usize) {
        if self.taken.fetch_add(1, Ordering::SeqCst) + 1 == all {
            tell("taken");
        }
    }

    /// Asks while the server says "later", for at most half a minute.
    async fn insist(&self, wire: &mut Wire, request: &Request) -> io::Result<WireAnswer> {
        let until = Instant::now() + Duration::from_secs(30);
        loop {
            let answer = wire.ask(request).await?;
            if !answer.is_later() || Instant::now() > until {
                return Ok(answer);
            }
            sleep(answer.retry_after.unwrap_or(Duration::from_secs(1))).await;
        }
    }

    /// Creates an episode with the stranger's key; what was answered.
    async fn create(&self, body: &Value) -> io::Result<Value> {
        let mut wire = self.wire(Addresses::Many, 1).keeping_all();
        let create = Request::post("/api/v1/episodes", body).with(&self.brief.member);
        self.insist(&mut wire, &create).await?.read()
    }

    /// Enters a competition as somebody new; the key.
    async fn enter(&self, wire: &mut Wire, cup: &str, body: &Value) -> io::Result<String> {
        let enter = Request::post(format!("/api/v1/competitions/{cup}/entrants"), body);
        text(&self.insist(wire, &enter).await?.read()?, "/key")
    }

    /// Starts the attempt of an entrant; its token.
    async fn start(&self, wire: &mut Wire, cup: &str, key: &str) -> io::Result<String> {
        let path = format!("/api/v1/competitions/{cup}/attempts");
        let answer = self.insist(wire, &Request::post(path, &json!({})).with(key)).await?;
        text(&answer.read()?, "/swarm_token")
    }
}

/// Repeats something on many connections until the process ends. What fails is tried again after a moment.
async fn on_connections<F>(count: usize, each: impl Fn(usize) -> F)
where
    F: Future<Output = ()> + Send + 'static,
{
    let mut clients = JoinSet::new();
    for number in 0..count {
        clients.spawn(each(number));
    }
    while clients.join_next().await.is_some() {}
}

/// Sends a request again and again on one connection.
async fn hammer(mut wire: Wire, request: impl Fn(u64) -> Request, at: watch::Receiver<SocketAddr>) {
    for number in 0.. {
        wire.to = *at.borrow();
        let pause = match wire.ask(&request(number)).await {
            // Who attacks does not wait for as long as it is asked to.
            Ok(answer) if answer.is_later() => Duration::from_millis(100),
            Ok(_) => Duration::ZERO,
            Err(_) => Duration::from_millis(100),
        };
        sleep(pause).await;
    }
}

fn tell(line: &str) {
    let mut out = io::stdout().lock();
    drop(writeln!(out, "{line}").and_then(|()| out.flush()));
}

/// The attackers' process.
pub(crate) fn main() {
    let niceness = getpriority_process(None).expect("it can be asked") + NICER;
    setpriority_process(None, niceness).expect("a lower priority is allowed to all");
    let mut files = getrlimit(Resource::Nofile);
    files.current = files.maximum;
    setrlimit(Resource::Nofile, files).expect("as many files as the host allows");
    let mut first = String::new();
    io::stdin().lock().read_line(&mut first).expect("a brief");
    let brief: Brief = serde_json::from_str(&first).expect("a brief");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.expect("a runtime").block_on(attack(brief));
}

async fn attack(brief: Brief) {
    let attack = ATTACKS.iter().find(|attack| attack.name == brief.attack).expect("an attack");
    let (at_sender, at) = watch::channel(brief.at);
    let ctx = Arc::new(Ctx {
        brief,
        tally: Arc::default(),
        at,
        stage: Arc::new(watch::Sender::new(false)),
        preparing: Arc::new(AtomicUsize::new(1)),
        is_prepared: AtomicBool::new(false),
        taken: AtomicUsize::new(0),
        notes: Arc::default(),
        started: Instant::now(),
        since: Arc::new(Mutex::new((Instant::now(), 0.0))),
    });
    let over = listen(Arc::clone(&ctx), at_sender);
    tokio::select! {
        () = play(attack, Arc::clone(&ctx)) => {}
        _ = over => {}
        () = sleep(LIFE_MAX) => {}
        () = keep_to_share() => {}
    }
    let (began, cpu_before) = *ctx.since.lock().expect("nothing panics while it holds this");
    let report = AttackReport {
        counts: ctx.tally.counts(),
        seconds: began.elapsed().as_secs_f64(),
        cpu_s: cpu_s() - cpu_before,
        notes: ctx.notes.lock().expect("nothing panics while it holds this").clone(),
    };
    tell(&serde_json::to_string(&report).expect("string keys"));
    // Tasks that are in the middle of something are not waited for.
    std::process::exit(0);
}

/// Plays an attack until the process ends.
async fn play(attack: &Attack, ctx: Arc<Ctx>) {
    if let Err(error) = (attack.run)(Arc::clone(&ctx)).await {
        ctx.note(format!("{} gave up: {error}", attack.name));
    }
    ctx.go().await;
    std::future::pending::<()>().await;
}

/// Follows commands on the standard input, on a thread of its own; completes at its end.
fn listen(ctx: Arc<Ctx>, at: watch::Sender<SocketAddr>) -> tokio::sync::oneshot::Receiver<()> {
    let (over, is_over) = tokio::sync::oneshot::channel();
    std::thread::spawn(move || {
        for line in io::stdin().lock().lines() {
            match line.as_deref() {
                Ok("go") => {
                    ctx.tally.forget();
                    let since = (Instant::now(), cpu_s());
                    *ctx.since.lock().expect("nothing panics while it holds this") = since;
                    ctx.stage.send_replace(true);
                }
                Ok(line) => {
                    if let Some(Ok(address)) = line.strip_prefix("at ").map(str::parse) {
                        at.send_replace(address);
                    }
                }
                Err(_) => break,
            }
        }
        // Where nobody waits for it, all is over anyway.
        let _ = over.send(());
    });
    is_over
}

/// Seconds on the processors that this process has had.
fn cpu_s() -> f64 {
    Duration::try_from(clock_gettime(ClockId::ProcessCPUTime)).unwrap_or_default().as_secs_f64()
}

/// Stops the only thread whenever it has had more than its share.
async fn keep_to_share() {
    let (mut at, mut used, mut left) = (Instant::now(), cpu_s(), CPU_AHEAD_S);
    loop {
        sleep(CPU_PACE).await;
        let (at_before, used_before) = (at, used);
        (at, used) = (Instant::now(), cpu_s());
        left += at.duration_since(at_before).as_secs_f64() * CPU_SHARE - (used - used_before);
        // What was not used is not saved up.
        left = left.min(CPU_AHEAD_S);
        if left < 0.0 {
            std::thread::sleep(Duration::from_secs_f64(-left / CPU_SHARE));
        }
    }
}
