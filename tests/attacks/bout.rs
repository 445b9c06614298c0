//! One attack: a server of its own, the honest entrant alone, and then the same beside the attackers.

use std::io::{self, BufRead, BufReader, Write as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use swarmbench_clock::{Clock, SystemClock, after};
use swarmbench_testkit::latencies::Spread;
use swarmbench_testkit::program::{Server, Site, program};
use tokio::sync::{mpsc, watch};
use tokio::time::{sleep, timeout};

use crate::attacks::attackers::{ATTACKERS, Attack, AttackReport, Brief};
use crate::attacks::honest::{Honest, HonestPlace, Score, text};
use crate::attacks::measure::cpu_s;
use crate::attacks::wire::{Request, Source, Wire};

/// Address space that a server gets beside twice its memory, in MiB: stacks of its threads, and what the allocator and the
/// database reserve and do not use. An attack on memory ends the server and not the host.
const SPACE_RESERVE_MIB: u64 = 2 * 1024;

/// Invitation codes that the honest side has, of which it uses one every second.
const CODES: usize = 50;

/// Maximum time of the attackers' preparation.
const PREPARATION_MAX: Duration = Duration::from_mins(4);

/// Maximum time for begun work after the end.
const FINISH_MAX: Duration = Duration::from_secs(90);

/// Duration of the attacks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Setting {
    pub(crate) seed: u64,
    pub(crate) time: Duration,
    /// Times are asserted, and numbers are large.
    pub(crate) is_long: bool,
    /// `--memory-max` of all servers, where it is not what each attack says.
    pub(crate) memory_mib: Option<u64>,
}

impl Setting {
    /// `--memory-max` of the server that is attacked, in MiB.
    pub(crate) fn memory_mib(&self, attack: &Attack) -> u64 {
        self.memory_mib.unwrap_or(attack.memory_mib)
    }
}

/// The results of playing for a while, in numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct Phase {
    pub(crate) acts: [Spread; 3],
    pub(crate) health: Spread,
    pub(crate) begun: u32,
    pub(crate) finished: u32,
    pub(crate) moves_lost: u32,
    pub(crate) failures: Vec<String>,
    pub(crate) errands: String,
    pub(crate) answers: String,
    pub(crate) seconds: f64,
    pub(crate) server_cpu_s: f64,
}

/// The result of an attack.
#[derive(Debug, Default)]
pub(crate) struct Outcome {
    pub(crate) alone: Phase,
    pub(crate) beside: Phase,
    pub(crate) attackers: AttackReport,
    pub(crate) memory_peak_mib: u64,
    /// The same of the server that was started again, alone.
    pub(crate) memory_again_mib: u64,
    /// Exit of a server that ended by itself.
    pub(crate) died: Option<String>,
    /// Time until the server was ready again.
    pub(crate) ready_again: Option<Duration>,
    /// Complaints in the log.
    pub(crate) faults: Vec<String>,
    /// Reason why the attack was not played.
    pub(crate) not_played: Option<String>,
}

/// Plays an attack.
pub(crate) async fn play(attack: &Attack, setting: Setting) -> Outcome {
    let mut outcome = Outcome::default();
    let site = Site::new();
    let mut bout = match Bout::open(&site, attack, setting).await {
        Ok(bout) => bout,
        Err(error) => {
            outcome.not_played = Some(error.to_string());
            return outcome;
        }
    };
    if let Err(error) = bout.play(&mut outcome).await {
        outcome.not_played = Some(error.to_string());
    }
    outcome.attackers = bout.attackers.stop().await.unwrap_or_default();
    let peak = bout.server.memory_peak_mib().max(bout.peak);
    match outcome.ready_again {
        Some(_) => outcome.memory_again_mib = peak,
        None => outcome.memory_peak_mib = peak,
    }
    let is_fault = |line: &String| line.contains(" ERROR ") || line.contains("panicked");
    outcome.faults.extend(bout.server.kill().into_iter().filter(is_fault));
    outcome
}

struct Bout<'a> {
    site: &'a Site,
    /// The most memory that the running server has had resident, in MiB.
    peak: u64,
    attack: &'a Attack,
    setting: Setting,
    server: Server,
    at: watch::Sender<SocketAddr>,
    honest: Arc<Honest>,
    attackers: Attackers,
}

impl<'a> Bout<'a> {
    async fn open(site: &'a Site, attack: &'a Attack, setting: Setting) -> io::Result<Self> {
        let organizer = organizer(site)?;
        let server = start(site, attack, setting);
        let at = address(site, server.run).await?;
        let mut wire =
            Wire::new(at, Source::behind_proxy(Ipv4Addr::new(192, 0, 2, 250)), &Arc::default());
        let rounds = if setting.is_long { 100 } else { 20 };
        let cup = competition(&mut wire, &organizer, "cup", 5, 1, rounds).await?;
        let open_cup = competition(&mut wire, &organizer, "open cup", 64, 13, 100).await?;
        let member = member(&mut wire, &organizer, "honest").await?;
        let (sender, receiver) = watch::channel(at);
        let brief = Brief {
            attack: attack.name.to_owned(),
            at,
            seed: setting.seed,
            is_long: setting.is_long,
            server: server.pid(),
            cup: cup.clone(),
            open_cup,
            member: self::member(&mut wire, &organizer, "stranger").await?,
        };
        let codes = codes(&mut wire, &organizer, &cup).await?;
        let honest = Honest::new(receiver, HonestPlace { cup, member, organizer, rounds }, codes);
        let attackers = Attackers::start(&brief)?;
        Ok(Self { site, peak: 0, attack, setting, server, at: sender, honest, attackers })
    }

    async fn play(&mut self, outcome: &mut Outcome) -> io::Result<()> {
        tokio::select! {
            ready = self.attackers.say_that("ready", PREPARATION_MAX) => ready?,
            status = end(&mut self.server, &mut self.peak) => {
                outcome.died = Some(format!("while the attack was prepared: {status}"));
                return Ok(());
            }
        }
        let alone = self.setting.time / if self.setting.is_long { 3 } else { 2 };
        outcome.alone = self.phase(alone, false, outcome).await;
        if outcome.died.is_none() {
            self.attackers.say("go")?;
            if self.attack.takes {
                tokio::select! {
                    taken = self.attackers.say_that("taken", FINISH_MAX) => taken?,
                    status = end(&mut self.server, &mut self.peak) => {
                        outcome.died = Some(status.to_string());
                        return Ok(());
                    }
                }
            }
            let time = self.setting.time.max(self.attack.least);
            outcome.beside = self.phase(time, true, outcome).await;
        }
        Ok(())
    }

    /// The honest entrant plays for a time.
    async fn phase(&mut self, time: Duration, is_attacked: bool, outcome: &mut Outcome) -> Phase {
        let score = Arc::<Score>::default();
        let (began, cpu_before) = (Instant::now(), cpu_s(self.server.pid()));
        let (honest, playing) = (Arc::clone(&self.honest), Arc::clone(&score));
        let mut playing = tokio::spawn(async move { honest.play(time, &playing).await });
        let mut cpu = 0.0;
        if is_attacked && self.attack.restarts {
            sleep(time / 3).await;
            cpu = cpu_s(self.server.pid()) - cpu_before;
            if let Err(error) = self.restart(outcome).await {
                outcome.not_played = Some(error.to_string());
            }
        }
        let limit = time + FINISH_MAX;
        let finished = tokio::select! {
            finished = timeout(limit.saturating_sub(began.elapsed()), &mut playing) => finished.is_ok(),
            status = end(&mut self.server, &mut self.peak) => {
                outcome.died = Some(status.to_string());
                false
            }
        };
        playing.abort();
        let mut phase = shown(&score);
        if !finished && outcome.died.is_none() {
            let most = limit.as_secs();
            phase.failures.push(format!("games and errands were not done after {most} s"));
        }
        phase.seconds = began.elapsed().as_secs_f64();
        let cpu_now = cpu_s(self.server.pid());
        // After a restart the process is another one.
        phase.server_cpu_s = if cpu > 0.0 { cpu + cpu_now } else { cpu_now - cpu_before };
        phase
    }

    /// Kills the server and starts it again.
    async fn restart(&mut self, outcome: &mut Outcome) -> io::Result<()> {
        if let Some(status) = self.server.exit() {
            outcome.died = Some(status.to_string());
            return Ok(());
        }
        outcome.memory_peak_mib = self.server.memory_peak_mib().max(self.peak);
        self.peak = 0;
        self.server.end();
        let began = Instant::now();
        self.server = start(self.site, self.attack, self.setting);
        let listening = address(self.site, self.server.run);
        let at = tokio::select! {
            at = listening => at?,
            status = end(&mut self.server, &mut self.peak) => {
                outcome.died = Some(format!("when it was started again: {status}"));
                return Ok(());
            }
        };
        self.at.send_replace(at);
        self.attackers.say(&format!("at {at}"))?;
        let mut wire = Wire::new(at, Source::HOST, &Arc::default());
        while !wire.ask(&Request::get("/readyz")).await.is_ok_and(|answer| answer.is_ok()) {
            if let Some(status) = self.server.exit() {
                outcome.died = Some(format!("when it was started again: {status}"));
                return Ok(());
            }
            sleep(Duration::from_millis(1)).await;
        }
        outcome.ready_again = Some(began.elapsed());
        Ok(())
    }
}

/// Waits until the process has ended by itself, and notes the memory that it takes.
async fn end(server: &mut Server, peak: &mut u64) -> ExitStatus {
    loop {
        *peak = server.memory_peak_mib().max(*peak);
        if let Some(status) = server.exit() {
            return status;
        }
        sleep(Duration::from_millis(50)).await;
    }
}

/// The report of a score.
fn shown(score: &Score) -> Phase {
    use std::sync::atomic::Ordering::Relaxed;
    Phase {
        acts: score.spreads(),
        health: score.health.spread(),
        begun: score.begun.load(Relaxed),
        finished: score.finished.load(Relaxed),
        moves_lost: score.moves_lost.load(Relaxed),
        failures: score.failures(),
        errands: score.errands(),
        answers: score.tally.counts().shown(),
        ..Phase::default()
    }
}

/// Starts a server with the memory of an attack, and as much address space as `docs/operate/operations.md` promises.
fn start(site: &Site, attack: &Attack, setting: Setting) -> Server {
    let memory_mib = setting.memory_mib(attack);
    let kib = (2 * memory_mib + SPACE_RESERVE_MIB) * 1024;
    let files = attack.files.map_or_else(String::new, |files| format!("ulimit -n {files}; "));
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {kib}; {files}exec \"$0\" \"$@\"")]).arg(program());
    command.env("RUST_LOG", "warn,swarmbench::cli=info");
    command.env("SWARMBENCH_MEMORY_MAX", format!("{memory_mib}MiB"));
    site.start_by(command, &[&["--trusted-proxy", "127.0.0.1/32"], attack.options].concat())
}

async fn address(site: &Site, run: u64) -> io::Result<SocketAddr> {
    let base = site.door.after(run - 1).await.base;
    base.trim_start_matches("http://").parse().map_err(io::Error::other)
}

/// An organizer's key, made before the server starts.
fn organizer(site: &Site) -> io::Result<String> {
    let mut command = Command::new(program());
    command.args(["key", "create", "--name", "organizer", "--role", "organizer", "--db"]);
    let output = command.arg(site.db()).output()?;
    let key = String::from_utf8(output.stdout).map_err(io::Error::other)?;
    if !output.status.success() {
        return Err(io::Error::other(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    Ok(key.trim().to_owned())
}

async fn member(wire: &mut Wire, organizer: &str, name: &str) -> io::Result<String> {
    let create = Request::post("/api/v1/keys", &json!({ "name": name, "role": "member" }));
    let created: Value = wire.ask(&create.with(organizer)).await?.read()?;
    text(&created, "/secret")
}

/// Invitation codes of a competition.
async fn codes(wire: &mut Wire, organizer: &str, cup: &str) -> io::Result<Vec<String>> {
    let labels: Vec<_> = (0..CODES).map(|number| format!("guest {number}")).collect();
    let path = format!("/api/v1/competitions/{cup}/codes");
    let make = Request::post(path, &json!({ "labels": labels })).with(organizer);
    let made: Value = wire.ask(&make).await?.read()?;
    (0..CODES).map(|number| text(&made, &format!("/items/{number}/code"))).collect()
}

async fn competition(
    wire: &mut Wire,
    organizer: &str,
    name: &str,
    parallel: u32,
    seeds: u32,
    rounds: u32,
) -> io::Result<String> {
    let now = SystemClock.now();
    let closes_at = after(now, Duration::from_hours(24));
    let body = json!({ "name": name, "opens_at": now, "closes_at": closes_at, "entry": "anybody", "parallel": parallel,
                       "suite": { "seeds": seeds, "settings": { "max_round": rounds } },
                       "clocks": { "round_deadline_s": 20 } });
    let create = Request::post("/api/v1/competitions", &body).with(organizer);
    text(&wire.ask(&create).await?.read()?, "/id")
}

/// The attackers' process.
struct Attackers {
    child: Child,
    input: Option<ChildStdin>,
    lines: mpsc::UnboundedReceiver<String>,
}

impl Attackers {
    fn start(brief: &Brief) -> io::Result<Self> {
        let mut command = Command::new(std::env::current_exe()?);
        command.env(ATTACKERS, "1").stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.spawn()?;
        let output = BufReader::new(child.stdout.take().expect("it is piped"));
        let (sender, lines) = mpsc::unbounded_channel();
        std::thread::spawn(move || {
            let mut lines = output.lines().map_while(Result::ok);
            lines.all(|line| sender.send(line).is_ok());
        });
        let input = child.stdin.take();
        let mut attackers = Self { child, input, lines };
        attackers.say(&serde_json::to_string(brief).map_err(io::Error::other)?)?;
        Ok(attackers)
    }

    fn say(&mut self, line: &str) -> io::Result<()> {
        let input = self.input.as_mut().ok_or(io::ErrorKind::BrokenPipe)?;
        writeln!(input, "{line}")?;
        input.flush()
    }

    /// Waits until they say a word.
    async fn say_that(&mut self, word: &str, most: Duration) -> io::Result<()> {
        match timeout(most, self.lines.recv()).await {
            Ok(Some(line)) if line == word => Ok(()),
            Ok(line) => Err(io::Error::other(format!("the attackers say {line:?}"))),
            Err(_) => Err(io::Error::other(format!("the attackers are not {word} in time"))),
        }
    }

    /// Lets them end; what they counted.
    async fn stop(&mut self) -> Option<AttackReport> {
        self.input = None;
        let told = timeout(Duration::from_secs(20), async {
            while let Some(line) = self.lines.recv().await {
                if let Ok(report) = serde_json::from_str(&line) {
                    return Some(report);
                }
            }
            None
        });
        told.await.ok().flatten()
    }
}

impl Drop for Attackers {
    fn drop(&mut self) {
        // Both fail only where it has ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
