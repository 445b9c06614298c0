//! Replays of journals.

use std::collections::BTreeSet;
use std::io::BufRead;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::value::RawValue;
use swarmbench_engine::physics::{Solver, SolverError};
use swarmbench_engine::{Act, AgentId, Config, RULES_REVISION, Scratch, World, answer};

use super::chain::Head;
use super::record::{
    ActRecord, End, FORMAT, NEWEST_FORMAT, Opening, Record, Round, Seats, Source, TeamHolder,
};
use crate::Tally;
use swarmbench_protocol::failure::Failure;

/// A fault of a journal.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The journal cannot be read.
    #[error("it cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// A line does not belong there.
    #[error("line {line}{at}: {problem}")]
    Line {
        /// The line, counted from 1.
        line: usize,
        /// The round or kind of the record, such as ` (round 12)`, if known.
        at: String,
        /// The fault.
        problem: String,
    },
    /// The file as a whole is not the expected one.
    #[error("{0}")]
    Whole(String),
}

/// A reason why a round cannot be replayed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RoundFault {
    /// The episode was over before this round.
    #[error("a round more than the episode has")]
    TooMany,
    /// Another round is next.
    #[error("the number of the round differs: recorded {recorded}, played again {expected}")]
    Number {
        /// The number in the journal.
        recorded: u32,
        /// The number of the next round.
        expected: u32,
    },
    /// An act is of an agent that the episode does not have.
    #[error("there is no agent {0:?}")]
    NoAgent(String),
    /// An act has names that the episode does not have.
    #[error("{0} has an unknown act")]
    UnknownAct(AgentId),
    /// The solver of the physics gave up.
    #[error(transparent)]
    Solver(#[from] SolverError),
    /// The replayed state has another digest.
    #[error("the digest of the state differs: recorded {recorded:?}, played again {played:?}")]
    Digest {
        /// The digest in the journal.
        recorded: String,
        /// The digest of the state.
        played: String,
    },
}

/// Replays an episode round by round: the only code that turns recorded acts into states.
pub struct Replayer {
    world: Arc<World>,
    solver: Solver,
    scratch: Box<Scratch>,
}

impl Replayer {
    /// Starts from a state.
    #[must_use]
    pub fn new(world: Arc<World>) -> Self {
        Self { world, solver: Solver::Flow, scratch: Box::default() }
    }

    /// The state after the last replayed round.
    #[must_use]
    pub const fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// The state after the last replayed round.
    #[must_use]
    pub fn into_world(self) -> Arc<World> {
        self.world
    }

    /// Checks that this round is the next one.
    ///
    /// # Errors
    /// If the episode is over, or another round is next.
    pub fn check(&self, round: u32) -> Result<(), RoundFault> {
        if self.world.is_over() {
            return Err(RoundFault::TooMany);
        }
        let expected = self.world.round();
        if round == expected {
            Ok(())
        } else {
            Err(RoundFault::Number { recorded: round, expected })
        }
    }

    /// Replays the next round from its acts, and compares the state with the recorded digest, if given. A state is
    /// copied only if others still share it.
    ///
    /// # Errors
    /// If another round is next, or the digest differs.
    pub fn play(
        &mut self,
        round: u32,
        acts: &[Act],
        digest: Option<&str>,
    ) -> Result<(), RoundFault> {
        self.check(round)?;
        Arc::make_mut(&mut self.world).step_with(acts, self.solver, &mut self.scratch)?;
        let Some(recorded) = digest else { return Ok(()) };
        let played = self.world.digest().to_string();
        if recorded == played {
            return Ok(());
        }
        Err(RoundFault::Digest { recorded: recorded.to_owned(), played })
    }
}

/// The result of a verified journal.
#[derive(Clone, Debug)]
pub struct JournalReport {
    /// The opening record.
    pub opening: Opening,
    /// The holders of the seats, if the journal names them.
    pub seats: Option<Seats>,
    /// The number of replayed rounds.
    pub rounds: u32,
    /// The score, recomputed.
    pub score: f64,
    /// The end record; `None` for an unfinished episode.
    pub end: Option<End>,
    /// The head of the chain after the last record.
    pub head: Head,
    /// Counts of all acts, those of an unresolved round included; for a fork, only those of its own rounds.
    pub tally: Tally,
}

/// Replays a journal file and checks every hash, digest, act and score.
///
/// `expected` is the head that the server shows for a finished episode. Without it the journal is only proven to be
/// consistent, with it to be the episode's own. `progress` is called with the current round and the maximum number of
/// rounds.
///
/// # Errors
/// The first fault, with its line.
pub fn verify(
    journal: impl BufRead,
    expected: Option<Head>,
    solver: Solver,
    mut progress: impl FnMut(u32, u32),
) -> Result<JournalReport, Fault> {
    verify_seen(journal, expected, solver, |world, _| {
        progress(world.round(), world.config().max_round());
    })
}

/// Verifies like [`verify`], and passes every state to `see` with the acts that led to it: the layout without acts,
/// then the state after each round with the act of each agent that was on the map.
///
/// # Errors
/// The first fault, with its line.
pub fn verify_seen(
    mut journal: impl BufRead,
    expected: Option<Head>,
    solver: Solver,
    mut see: impl FnMut(&World, &[ActRecord]),
) -> Result<JournalReport, Fault> {
    let mut verifier = Verifier::new(solver);
    loop {
        let mut line = Vec::new();
        if journal.read_until(b'\n', &mut line)? == 0 {
            return verifier.finish(expected);
        }
        verifier.line(&line, &mut see)?;
    }
}

/// Verifies a journal line by line.
pub struct Verifier {
    solver: Solver,
    head: Head,
    lines: usize,
    played: Option<Player>,
}

impl Verifier {
    /// Starts before the first line.
    #[must_use]
    pub const fn new(solver: Solver) -> Self {
        Self { solver, head: Head::START, lines: 0, played: None }
    }

    /// Checks the next line, its line break included. `see` gets the state and its acts, if the line leads to one.
    ///
    /// # Errors
    /// A fault of the line.
    pub fn line(
        &mut self,
        line: &[u8],
        mut see: impl FnMut(&World, &[ActRecord]),
    ) -> Result<(), Fault> {
        self.lines += 1;
        let Self { solver, head, lines, played } = self;
        let mut at = String::new();
        let parsed =
            check_line(line, head).and_then(|record| Record::parse(record).map_err(not_a_record));
        let checked = parsed.and_then(|record| match record {
            Record::Opening(opening) if played.is_none() => {
                see(played.insert(Player::new(*opening, *solver)?).world(), &[]);
                Ok(())
            }
            Record::Opening(_) => Err("a second opening".to_owned()),
            Record::Seats(seats) => {
                at.push_str(" (who holds which seat)");
                played.as_mut().ok_or("the first record is not an opening")?.seat(seats)
            }
            Record::Round(round) => {
                at = format!(" (round {})", round.round);
                let player = played.as_mut().ok_or("the first record is not an opening")?;
                player.play(&round)?;
                see(player.world(), &round.acts);
                Ok(())
            }
            Record::End(end) => {
                at.push_str(" (the end)");
                played.as_mut().ok_or("the first record is not an opening")?.finish(end)
            }
        });
        checked.map_err(|problem| Fault::Line { line: *lines, at, problem })
    }

    /// The head of the chain after the last line.
    #[must_use]
    pub const fn head(&self) -> Head {
        self.head
    }

    /// The opening; `None` before it.
    #[must_use]
    pub fn opening(&self) -> Option<&Opening> {
        self.played.as_ref().map(|player| &player.opening)
    }

    /// The state after the last valid line; `None` before the opening.
    #[must_use]
    pub fn world(&self) -> Option<&World> {
        self.played.as_ref().map(Player::world)
    }

    /// Ends the verification; see [`verify`] for `expected`.
    ///
    /// # Errors
    /// If there was no line, the rounds before a fork are incomplete, or the head differs.
    pub fn finish(self, expected: Option<Head>) -> Result<JournalReport, Fault> {
        let Self { head, played, .. } = self;
        let Some(player) = played else {
            return Err(Fault::Whole("the journal is empty".to_owned()));
        };
        let (rounds, first) = (player.world().round(), player.opening.first_round());
        if rounds < first {
            return Err(Fault::Whole(format!(
                "it continues another episode from round {first}, and has only {rounds} of the rounds before"
            )));
        }
        if let Some(expected) = expected.filter(|&expected| expected != head) {
            return Err(Fault::Whole(format!(
                "its head is {head}, not {expected}: it is consistent, but not the journal you asked for"
            )));
        }
        Ok(JournalReport {
            rounds,
            score: player.world().score(),
            opening: player.opening,
            seats: player.seats,
            end: player.end,
            head,
            tally: player.tally,
        })
    }
}

/// The bytes before the hash of a line, between hash and record, and after the record; see `RawRecord::line`.
const BEFORE_HASH: &[u8] = b"{\"hash\":\"";
const BEFORE_RECORD: &[u8] = b"\",\"record\":";
const AFTER_RECORD: &[u8] = b"}\n";

/// Hexadecimal digits of a hash.
const HASH_DIGITS: usize = 64;

/// Report of a record that cannot be read.
#[must_use]
#[expect(clippy::needless_pass_by_value, reason = "it is passed to map_err")]
pub fn not_a_record(error: serde_json::Error) -> String {
    format!("not a record: {error}")
}

/// The record of a line whose hash continues the chain; `head` becomes that of the line. The caller checks that it is one JSON
/// object.
///
/// # Errors
/// If the line has another format, or its hash does not continue the chain.
pub fn check_line<'a>(line: &'a [u8], head: &mut Head) -> Result<&'a str, String> {
    let (hash, record) = parts(line).ok_or_else(|| wrong_form(line))?;
    let linked = head.link(record);
    let mut expected = [0; HASH_DIGITS];
    data_encoding::HEXLOWER.encode_mut(&linked.0, &mut expected);
    if hash != expected {
        return Err(format!(
            "changed: the record hashes to {linked}, the line says {}",
            String::from_utf8_lossy(hash)
        ));
    }
    *head = linked;
    std::str::from_utf8(record).map_err(|error| format!("not UTF-8: {error}"))
}

/// The hash and the record of a line; `None` if the bytes around them differ from the format.
fn parts(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let (hash, rest) = line.strip_prefix(BEFORE_HASH)?.split_at_checked(HASH_DIGITS)?;
    let record = rest.strip_prefix(BEFORE_RECORD)?.strip_suffix(AFTER_RECORD)?;
    let is_object = record.starts_with(b"{") && record.ends_with(b"}");
    is_object.then_some((hash, record))
}

/// Describes the fault of a line that does not have the format.
fn wrong_form(line: &[u8]) -> String {
    /// A line with any bytes around its parts.
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Line<'a> {
        #[serde(rename = "hash")]
        _hash: &'a str,
        #[serde(borrow, rename = "record")]
        _record: &'a RawValue,
    }
    let text = match std::str::from_utf8(line) {
        Ok(text) => text,
        Err(error) => return format!("not UTF-8: {error}"),
    };
    match serde_json::from_str::<Line<'_>>(text) {
        Ok(_) => "changed: there are bytes that no journal has around its records".to_owned(),
        Err(error) => format!("not a line of a journal: {error}"),
    }
}

/// An episode during its replay.
struct Player {
    opening: Opening,
    replayer: Replayer,
    seats: Option<Seats>,
    end: Option<End>,
    tally: Tally,
}

impl Player {
    fn new(opening: Opening, solver: Solver) -> Result<Self, String> {
        if !(FORMAT..=NEWEST_FORMAT).contains(&opening.format) {
            let format = opening.format;
            return Err(format!(
                "journal format {format} is not known, only {FORMAT} and {NEWEST_FORMAT}"
            ));
        }
        if opening.rules_revision != RULES_REVISION {
            return Err(format!(
                "it was played by revision {} of the rules; this program plays {RULES_REVISION}",
                opening.rules_revision
            ));
        }
        if let Some(fork) = opening.fork.as_ref().filter(|fork| Head::parse(&fork.head).is_none()) {
            return Err(format!("{:?} is not the head of a chain", fork.head));
        }
        let config = Arc::new(opening.config.engine().map_err(|error| error.to_string())?);
        let world = Arc::new(World::new(config));
        compare("the digest of the layout", &opening.digest, &world.digest().to_string())?;
        let replayer = Replayer { world, solver, scratch: Box::default() };
        Ok(Self { opening, replayer, seats: None, end: None, tally: Tally::default() })
    }

    fn world(&self) -> &World {
        self.replayer.world()
    }

    /// True if a record must name the holders of the seats before the first round.
    fn is_seated(&self) -> bool {
        let config = &self.opening.config;
        config.is_mixed() || config.player.is_some()
    }

    fn seat(&mut self, seats: Seats) -> Result<(), String> {
        let is_before_first = self.world().round() == self.opening.first_round();
        if self.seats.is_some() || self.end.is_some() || !is_before_first {
            let what =
                "the record of seats comes once, before the first round of the episode's own";
            return Err(what.to_owned());
        }
        if !self.is_seated() {
            return Err("the creator holds all seats of this episode".to_owned());
        }
        let named: Vec<&str> = seats.seats.iter().map(|seat| seat.agent.as_str()).collect();
        let agents: Vec<String> = self.world().agents().map(|agent| agent.to_string()).collect();
        if named != agents {
            return Err(format!("seats of {} are not all, in order", short(&named)));
        }
        let numbers: Vec<u32> = seats.holders.iter().map(|holder| holder.holder).collect();
        let of_seats: BTreeSet<u32> = seats.seats.iter().map(|seat| seat.holder).collect();
        let of_seats: Vec<u32> = of_seats.into_iter().collect();
        if numbers != of_seats {
            return Err(format!(
                "the record lists the holders {numbers:?}, but seats belong to {of_seats:?}"
            ));
        }
        let config = &self.opening.config;
        if !config.holders.is_empty() {
            check_team(&config.holders, &seats)?;
            self.seats = Some(seats);
            return Ok(());
        }
        for (number, seat) in (0..).zip(&seats.seats) {
            if config.open_seats.contains(&number) == (seat.holder == 0) {
                return Err(format!("{} cannot be a seat of holder {}", seat.agent, seat.holder));
            }
        }
        for holder in &seats.holders {
            let is_known = match (holder.holder, &holder.player) {
                (0, player) => *player == config.player,
                (_, None) => true,
                (_, player) => *player == config.fill_with,
            };
            if !is_known {
                let player = &holder.player;
                return Err(format!("holder {} has another player: {player:?}", holder.holder));
            }
        }
        self.seats = Some(seats);
        Ok(())
    }

    fn play(&mut self, round: &Round) -> Result<(), String> {
        if self.end.is_some() {
            return Err("a round after the end".to_owned());
        }
        let is_own = round.round >= self.opening.first_round();
        if is_own && self.is_seated() && self.seats.is_none() {
            return Err("a round comes before the record of seats".to_owned());
        }
        self.replayer.check(round.round).map_err(|fault| fault.to_string())?;
        let config = Arc::clone(self.world().config());
        let named = round.acts.iter().map(|act| AgentId::parse(&act.agent));
        if !named.eq(living(self.world()).map(Some)) {
            let living: Vec<String> = living(self.world()).map(|agent| agent.to_string()).collect();
            let acting: Vec<&String> = round.acts.iter().map(|act| &act.agent).collect();
            return Err(format!(
                "acts of {} do not come from exactly the living agents {}",
                short(&acting),
                short(&living)
            ));
        }
        let mut acts = vec![Act::default(); config.num_agents().into()];
        for record in &round.acts {
            let (agent, act) = checked_act(record, &config)?;
            acts[agent.index()] = act;
            if is_own {
                self.tally.add(record);
            } else if !record.is_taken_over() {
                return Err(format!(
                    "the act of {agent} was taken over, and yet it has more than the act"
                ));
            }
        }
        let played = self.replayer.play(round.round, &acts, Some(&round.digest));
        played.map_err(|fault| fault.to_string())?;
        compare("the score", &round.score, &self.world().score())
    }

    fn finish(&mut self, end: End) -> Result<(), String> {
        if self.end.is_some() {
            return Err("a second end".to_owned());
        }
        let first = self.opening.first_round();
        if self.world().round() < first {
            return Err(format!(
                "it ends before round {first}, from which it continues another episode"
            ));
        }
        compare("the number of rounds", &end.rounds, &self.world().round())?;
        compare("the final score", &end.score, &self.world().score())?;
        // A layout may already solve the task, but the episode only ends for it once it is started.
        let may_wait = if self.is_seated() {
            self.seats.is_none()
        } else {
            self.opening.config.start == "manual"
        };
        let never_started = self.world().round() == first && may_wait;
        let (done, over) = (self.world().is_done(), self.world().is_over());
        let fits = match (end.status.as_str(), end.reason.as_str()) {
            ("finished", "task_done") => done,
            ("finished", "rounds_played") => over && !done,
            ("aborted", "aborted" | "closed") | ("abandoned", "idle") => !over || never_started,
            _ => false,
        };
        if !fits {
            let (status, reason) = (end.status, end.reason);
            return Err(format!("it does not end here as {status:?} by {reason:?}"));
        }
        for act in &end.open_acts {
            self.tally.add(act);
        }
        self.end = Some(end);
        Ok(())
    }
}

/// Checks that the seats have the holders that the opening declares, and no others.
fn check_team(declared: &[TeamHolder], seats: &Seats) -> Result<(), String> {
    let numbered = || (1_u32..).zip(declared);
    for (number, seat) in (0_u16..).zip(&seats.seats) {
        let holder = numbered().find(|(_, holder)| holder.seats.contains(&number));
        if holder.map(|(number, _)| number) != Some(seat.holder) {
            return Err(format!("{} cannot be a seat of holder {}", seat.agent, seat.holder));
        }
    }
    for (holder, (number, declared)) in seats.holders.iter().zip(numbered()) {
        let is_same = (holder.holder, &holder.model, &holder.player)
            == (number, &declared.model, &declared.player);
        if !is_same {
            return Err(format!("holder {number} is not {:?} of the opening", declared.name));
        }
    }
    compare("the number of holders", &seats.holders.len(), &declared.len())
}

fn compare<T: PartialEq + std::fmt::Debug>(
    what: &str,
    recorded: &T,
    played: &T,
) -> Result<(), String> {
    if recorded == played {
        return Ok(());
    }
    Err(format!("{what} differs: recorded {recorded:?}, played again {played:?}"))
}

fn short<T: std::fmt::Debug>(names: &[T]) -> String {
    match names {
        [first, .., last] if names.len() > 4 => format!("{first:?} … {last:?} ({})", names.len()),
        _ => format!("{names:?}"),
    }
}

/// The act of a record. A language model's act must follow from its answer.
fn checked_act(record: &ActRecord, config: &Config) -> Result<(AgentId, Act), String> {
    let agent = AgentId::parse(&record.agent).ok_or("an unknown agent")?;
    let act = record.act(config).ok_or_else(|| RoundFault::UnknownAct(agent).to_string())?;
    if record.source == Source::Clock && (act != Act::default() || !record.valid) {
        return Err(format!("the clock of {agent} ran out, and yet it did something"));
    }
    if record.failure.is_some() && (record.valid || record.source == Source::Clock) {
        return Err(format!("the act of {agent} counts, and yet it says why not"));
    }
    if let Some(response) = record.response.as_ref().filter(|_| record.source == Source::Player) {
        let read = answer::parse(response, config, agent);
        if read.act != act || read.is_valid() != record.valid {
            return Err(format!("the act of {agent} is not what its answer says"));
        }
        let failure = read.fault.map(|fault| Failure::of(record.failure, fault));
        if record.failure.is_some() && record.failure != failure {
            return Err(format!("the answer of {agent} is invalid for another reason"));
        }
    }
    Ok((agent, act))
}

/// The agents on the map, in the order of their numbers.
pub fn living(world: &World) -> impl Iterator<Item = AgentId> + '_ {
    world.agents().filter(|&agent| world.is_alive(agent))
}

/// The engine's acts of a round's records: one for each agent, the default for agents without a record.
///
/// # Errors
/// If a record names an unknown agent or action.
pub fn acts_of<'a>(
    config: &Config,
    records: impl IntoIterator<Item = &'a ActRecord>,
) -> Result<Vec<Act>, RoundFault> {
    let mut acts = vec![Act::default(); config.num_agents().into()];
    for record in records {
        let agent = AgentId::parse(&record.agent).filter(|agent| agent.index() < acts.len());
        let agent = agent.ok_or_else(|| RoundFault::NoAgent(record.agent.clone()))?;
        acts[agent.index()] = record.act(config).ok_or(RoundFault::UnknownAct(agent))?;
    }
    Ok(acts)
}
