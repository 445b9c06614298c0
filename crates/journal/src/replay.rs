//! Replays of journals.

use std::io::BufRead;
use std::sync::Arc;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{Act, AgentId, Config, RULES_REVISION, World, answer};

use super::chain::Head;
use super::record::{ActRecord, End, FORMAT, Opening, RawRecord, Record, Seats, Source};
use crate::Tally;

/// What is wrong with a journal.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// It cannot be read at all.
    #[error("it cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// A line is not what belongs there.
    #[error("line {line}{at}: {problem}")]
    Line {
        /// The line, counted from 1.
        line: usize,
        /// ` (round 12)` where the line is that of a round.
        at: String,
        /// What is wrong with it.
        problem: String,
    },
    /// The file as a whole is not the expected one.
    #[error("{0}")]
    Whole(String),
}

/// What a journal proves.
#[derive(Clone, Debug)]
pub struct Report {
    /// The opening record.
    pub opening: Opening,
    /// Who held which seat, where the journal says so.
    pub seats: Option<Seats>,
    /// How many rounds were played again.
    pub rounds: u32,
    /// The score, recomputed.
    pub score: f64,
    /// The end record; none where the episode was still running.
    pub end: Option<End>,
    /// The head of the chain.
    pub head: Head,
    /// What all its acts were, those of a round that was not resolved too.
    pub tally: Tally,
}

/// Plays a journal file again and checks every hash, digest, act and score.
///
/// `expected` is the head that the server shows for a finished episode: without it a journal only
/// proves to be consistent, with it to be that one. `progress` is called with how many rounds of how many
/// were played.
///
/// # Errors
/// The first fault, with its line.
pub fn verify(
    journal: impl BufRead,
    expected: Option<Head>,
    solver: Solver,
    mut progress: impl FnMut(u32, u32),
) -> Result<Report, Fault> {
    verify_seen(journal, expected, solver, |world| {
        progress(world.round(), world.config().max_round());
    })
}

/// The same, for somebody who looks at every state: that of the layout, and that after each round.
///
/// # Errors
/// The first fault, with its line.
pub fn verify_seen(
    mut journal: impl BufRead,
    expected: Option<Head>,
    solver: Solver,
    mut see: impl FnMut(&World),
) -> Result<Report, Fault> {
    let mut head = Head::START;
    let mut played: Option<Player> = None;
    for number in 1.. {
        let mut line = Vec::new();
        if journal.read_until(b'\n', &mut line)? == 0 {
            break;
        }
        let mut at = String::new();
        let checked = check_line(&line, &mut head).and_then(|record: Record| match record {
            Record::Opening(opening) if played.is_none() => {
                see(&played.insert(Player::new(*opening)?).world);
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
                player.play(&round, solver)?;
                see(&player.world);
                Ok(())
            }
            Record::End(end) => {
                at.push_str(" (the end)");
                played.as_mut().ok_or("the first record is not an opening")?.finish(end)
            }
        });
        checked.map_err(|problem| Fault::Line { line: number, at, problem })?;
    }
    let Some(player) = played else { return Err(Fault::Whole("the journal is empty".to_owned())) };
    if let Some(expected) = expected.filter(|&expected| expected != head) {
        return Err(Fault::Whole(format!(
            "its head is {head}, not {expected}: it is consistent, but not the journal you asked for"
        )));
    }
    Ok(Report {
        rounds: player.world.round(),
        score: player.world.score(),
        opening: player.opening,
        seats: player.seats,
        end: player.end,
        head,
        tally: player.tally,
    })
}

/// A line of a journal file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Line<'a> {
    hash: &'a str,
    #[serde(borrow)]
    record: &'a RawValue,
}

/// Checks the bytes of a line against the chain; `head` moves on to the line's own.
///
/// # Errors
/// Where it is no line of the format, or its hash is not that of the chain.
pub fn check_line<T: DeserializeOwned>(line: &[u8], head: &mut Head) -> Result<T, String> {
    let text = std::str::from_utf8(line).map_err(|error| format!("not UTF-8: {error}"))?;
    let parsed: Line<'_> =
        serde_json::from_str(text).map_err(|error| format!("not a line of a journal: {error}"))?;
    let raw = RawRecord::from_stored(parsed.record.get().to_owned()).map_err(|e| e.to_string())?;
    let linked = head.link(raw.as_str().as_bytes());
    if parsed.hash != linked.to_string() {
        return Err(format!(
            "changed: the record hashes to {linked}, the line says {}",
            parsed.hash.chars().take(64).collect::<String>()
        ));
    }
    if raw.line(linked) != text {
        return Err("changed: there are bytes that no journal has around its records".to_owned());
    }
    *head = linked;
    raw.read().map_err(|error| format!("not a record: {error}"))
}

/// An episode as it is played again.
struct Player {
    opening: Opening,
    config: Arc<Config>,
    world: World,
    seats: Option<Seats>,
    end: Option<End>,
    tally: Tally,
}

impl Player {
    fn new(opening: Opening) -> Result<Self, String> {
        if opening.format != FORMAT {
            return Err(format!("journal format {} is not known, only {FORMAT}", opening.format));
        }
        if opening.rules_revision != RULES_REVISION {
            return Err(format!(
                "it was played by revision {} of the rules; this program plays {RULES_REVISION}",
                opening.rules_revision
            ));
        }
        let config = Arc::new(opening.config.engine().map_err(|error| error.to_string())?);
        let world = World::new(Arc::clone(&config));
        compare("the digest of the layout", &opening.digest, &world.digest().to_string())?;
        Ok(Self { opening, config, world, seats: None, end: None, tally: Tally::default() })
    }

    /// Whether a record has to say who holds which seat before the first round.
    fn is_seated(&self) -> bool {
        let config = &self.opening.config;
        !config.open_seats.is_empty() || config.player.is_some()
    }

    fn seat(&mut self, seats: Seats) -> Result<(), String> {
        if self.seats.is_some() || self.end.is_some() || self.world.round() > 0 {
            return Err("who holds which seat is told once, before the first round".to_owned());
        }
        if !self.is_seated() {
            return Err("the creator holds all seats of this episode".to_owned());
        }
        let named: Vec<&str> = seats.seats.iter().map(|seat| seat.agent.as_str()).collect();
        let agents: Vec<String> = self.world.agents().map(|agent| agent.to_string()).collect();
        if named != agents {
            return Err(format!("seats of {} are not all, in order", short(&named)));
        }
        let numbers: Vec<u32> = seats.holders.iter().map(|holder| holder.holder).collect();
        let mut held: Vec<u32> = seats.seats.iter().map(|seat| seat.holder).collect();
        held.sort_unstable();
        held.dedup();
        if numbers != held {
            return Err(format!("holders {numbers:?} are told of, seats are held by {held:?}"));
        }
        let config = &self.opening.config;
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

    fn play(&mut self, round: &super::record::Round, solver: Solver) -> Result<(), String> {
        if self.end.is_some() {
            return Err("a round after the end".to_owned());
        }
        if self.is_seated() && self.seats.is_none() {
            return Err("a round before it is told who holds which seat".to_owned());
        }
        if self.world.is_over() {
            return Err("a round more than the episode has".to_owned());
        }
        compare("the number of the round", &round.round, &self.world.round())?;
        let living: Vec<String> = living(&self.world).map(|agent| agent.to_string()).collect();
        let acting: Vec<&String> = round.acts.iter().map(|act| &act.agent).collect();
        if acting != living.iter().collect::<Vec<_>>() {
            return Err(format!(
                "acts of {} do not come from exactly the living agents {}",
                short(&acting),
                short(&living)
            ));
        }
        for act in &round.acts {
            check_answer(act, &self.config)?;
            self.tally.add(act);
        }
        let acts = acts_of(&self.config, &round.acts)?;
        self.world.step_with(&acts, solver).map_err(|error| error.to_string())?;
        compare("the digest of the state", &round.digest, &self.world.digest().to_string())?;
        compare("the score", &round.score, &self.world.score())
    }

    fn finish(&mut self, end: End) -> Result<(), String> {
        if self.end.is_some() {
            return Err("a second end".to_owned());
        }
        compare("the number of rounds", &end.rounds, &self.world.round())?;
        compare("the final score", &end.score, &self.world.score())?;
        // A layout may have solved the task; that counts once the episode is started.
        let may_wait = if self.is_seated() {
            self.seats.is_none()
        } else {
            self.opening.config.start == "manual"
        };
        let never_started = self.world.round() == 0 && may_wait;
        let (done, over) = (self.world.is_done(), self.world.is_over());
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

/// The act of a language model must be what its answer says.
fn check_answer(record: &ActRecord, config: &Config) -> Result<(), String> {
    let agent = AgentId::parse(&record.agent).ok_or("an unknown agent")?;
    let act = record.act(config).ok_or_else(|| format!("{} has an unknown act", record.agent))?;
    let Some(response) = &record.response else { return Ok(()) };
    let read = answer::parse(response, config, agent);
    if record.source == Source::Player && (read.act != act || read.valid != record.valid) {
        return Err(format!("the act of {} is not what its answer says", record.agent));
    }
    Ok(())
}

/// The agents on the map, in order of their numbers.
pub fn living(world: &World) -> impl Iterator<Item = AgentId> + '_ {
    world.agents().filter(|&agent| world.is_alive(agent))
}

/// The acts of a round's records for the engine: one act for each agent, the default for those
/// without a record.
///
/// # Errors
/// Where a record names an agent or an action that the configuration does not have.
pub fn acts_of<'a>(
    config: &Config,
    records: impl IntoIterator<Item = &'a ActRecord>,
) -> Result<Vec<Act>, String> {
    let mut acts = vec![Act::default(); config.num_agents().into()];
    for record in records {
        let agent = AgentId::parse(&record.agent).filter(|agent| agent.index() < acts.len());
        let agent = agent.ok_or_else(|| format!("there is no agent {:?}", record.agent))?;
        acts[agent.index()] =
            record.act(config).ok_or_else(|| format!("{agent} has an unknown act"))?;
    }
    Ok(acts)
}
