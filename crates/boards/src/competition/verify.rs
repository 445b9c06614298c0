//! Verification of the file of a competition: the commitment fits the seeds, every game that counts was played on the seed,
//! with the settings and in the time of its place in the plan, every journal replays to its score, and the board follows from
//! them.
//!
//! A file alone cannot prove that it is the published one: compare its commitment with the one that was published with the
//! announcement, and its head with the organizer's.

use std::collections::{HashMap, HashSet, VecDeque};
use std::io::BufRead;
use std::sync::Arc;

use jiff::Timestamp;
use serde_json::Value;
use swarmbench_engine::TaskName;
use swarmbench_engine::physics::Solver;

use super::change::Changed;
use super::definition::{Definition, Window};
use super::entrant::Entrant;
use super::export::{self, AFTER_END, Decided, FIRST_FORMAT, FORMAT, Line, VOID, later_field};
use super::replays::{Replays, Waiting};
use super::sealed::{SALT_BYTES, SEED_BYTES, Sealed};
use super::standings::{Attempt, Part, StandingsRow, standings};
use crate::run::Definition as RunDefinition;
use crate::{EndedGame, Slot};
use swarmbench_journal::Tally;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::{self, JournalReport, check_line, not_a_record};
use swarmbench_protocol::status::RunStatus;
use swarmbench_protocol::suite::PlannedGame;

/// First format in which the status of an attempt must fit the ends of its games, and in which each voided attempt has an
/// action.
const FIRST_FORMAT_WITH_CHECKED_ATTEMPTS: u32 = 2;

/// Reason of the end of a game that ran when its attempt closed.
const CLOSED: &str = "closed";

/// Fault of a file.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The file cannot be read.
    #[error("it cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// A line is invalid or not in its place.
    #[error("line {line} ({place}): {problem}")]
    Line {
        /// Number of the line, from 1.
        line: usize,
        /// Record of the line.
        place: String,
        /// Problem.
        problem: String,
    },
    /// The file as a whole is not the expected one.
    #[error("{0}")]
    Whole(String),
}

/// Verified content of a file.
#[derive(Clone, Debug)]
pub struct CompetitionReport {
    /// First record.
    pub competition: export::Competition,
    /// Actions of organizers.
    pub actions: Vec<export::Action>,
    /// Entrants.
    pub entrants: Vec<Entrant>,
    /// Number of started attempts.
    pub attempts: usize,
    /// Number of replayed games.
    pub episodes: usize,
    /// Number of replayed rounds.
    pub rounds: u64,
    /// Recomputed board.
    pub rows: Vec<StandingsRow>,
    /// Head of the file's chain.
    pub head: Head,
}

/// Facts that were published outside the file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Expected {
    /// Commitment from the announcement of the competition.
    pub commitment: Option<[u8; 32]>,
    /// Head of the file's chain, as published by the organizer.
    pub head: Option<Head>,
}

/// Verifies the file of a competition. `progress` is called with the number of lines that were read. As many threads as the
/// machine has processors replay journals.
///
/// # Errors
/// First fault, with its line.
pub fn verify(
    file: impl BufRead,
    expected: Expected,
    solver: Solver,
    progress: impl FnMut(usize),
) -> Result<CompetitionReport, Fault> {
    let reader = Reader {
        file,
        head: Head::START,
        format: FORMAT,
        number: 0,
        place: "the beginning".to_owned(),
        progress,
    };
    Replays::run(solver, |replays| read(reader, expected, replays))
}

fn read<R: BufRead, P: FnMut(usize)>(
    mut reader: Reader<R, P>,
    expected: Expected,
    replays: &Replays,
) -> Result<CompetitionReport, Fault> {
    let competition = match reader.next()? {
        Some(Line::Competition(competition)) => *competition,
        Some(_) => return Err(reader.wrong("the first record is not a competition")),
        None => return Err(Fault::Whole("the file is empty".to_owned())),
    };
    "the competition".clone_into(&mut reader.place);
    let sealed = check_competition(&competition, expected).map_err(|what| reader.wrong(what))?;
    let mut checker = Checker::new(competition, sealed, replays);
    let read = checker.rest(&mut reader);
    // A fault in an earlier game comes first.
    checker.settle(0)?;
    let rows = read?;
    "the board".clone_into(&mut reader.place);
    let attempts = checker.attempts.len();
    let rows = checker.board(rows).map_err(|what| reader.wrong(what))?;
    "the end".clone_into(&mut reader.place);
    match reader.next()? {
        Some(Line::End(end)) if end.episodes == checker.episodes => {}
        Some(Line::End(_)) => return Err(reader.wrong("it counts other games than the file has")),
        Some(_) => return Err(reader.wrong("after the board comes the end only")),
        None => return Err(reader.wrong("the file ends here: its end is missing")),
    }
    let head = reader.head;
    if reader.next()?.is_some() {
        return Err(reader.wrong("there is something after the end"));
    }
    if let Some(expected) = expected.head.filter(|&expected| expected != head) {
        return Err(Fault::Whole(format!(
            "its head is {head}, not {expected}: it is consistent, but not the file that was published"
        )));
    }
    let Checker { competition, actions, entrants, episodes, rounds, .. } = checker;
    Ok(CompetitionReport { competition, actions, entrants, attempts, episodes, rounds, rows, head })
}

/// Reader of records, which follows their chain.
struct Reader<R, P> {
    file: R,
    head: Head,
    /// Format of the file, known after its first record.
    format: u32,
    /// Number of the last line that was read.
    number: usize,
    /// Record of that line.
    place: String,
    progress: P,
}

impl<R: BufRead, P: FnMut(usize)> Reader<R, P> {
    fn next(&mut self) -> Result<Option<Line>, Fault> {
        let mut line = Vec::new();
        if self.file.read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        self.number += 1;
        (self.progress)(self.number);
        let after = format!("after {}", self.place);
        let record = check_line(&line, &mut self.head).and_then(|text| {
            let record = Line::parse(text).map_err(not_a_record)?;
            if let Line::Competition(competition) = &record {
                self.format = competition.format;
            }
            match later_field(text, self.format).filter(|_| self.format < FORMAT) {
                Some(problem) => Err(problem),
                None => Ok(record),
            }
        });
        let wrong = |problem| Fault::Line { line: self.number, place: after, problem };
        record.map(Some).map_err(wrong)
    }

    fn wrong(&self, problem: impl Into<String>) -> Fault {
        Fault::Line { line: self.number, place: self.place.clone(), problem: problem.into() }
    }

    /// Begins to replay the following journal of `lines` lines. A large journal is replayed before this returns.
    fn journal(
        &mut self,
        lines: usize,
        head: Head,
        replays: &Replays,
    ) -> Result<(JournalPosition, Waiting), Fault> {
        let place = JournalPosition { before: self.number, lines, what: self.place.clone() };
        let waiting = replays.begin(&mut self.file, lines, head)?;
        self.number += lines - waiting.left;
        (self.progress)(self.number);
        Ok((place, waiting))
    }
}

/// Place of a game's journal in the file.
struct JournalPosition {
    /// Number of the line before the journal.
    before: usize,
    lines: usize,
    what: String,
}

impl JournalPosition {
    fn wrong(&self, left: usize, problem: impl Into<String>) -> Fault {
        let line = self.before + self.lines - left;
        Fault::Line { line, place: self.what.clone(), problem: problem.into() }
    }

    /// Fault of the file for a fault of the journal.
    fn fault(&self, left: usize, fault: replay::Fault) -> Fault {
        match fault {
            replay::Fault::Io(error) => Fault::Io(error),
            replay::Fault::Line { line, at, problem } => Fault::Line {
                line: self.before + line,
                place: format!("{}, its journal{at}", self.what),
                problem,
            },
            replay::Fault::Whole(problem) => self.wrong(left, problem),
        }
    }
}

fn check_competition(
    competition: &export::Competition,
    expected: Expected,
) -> Result<Sealed, String> {
    let export::Competition { format, definition, commitment, salt, seeds, .. } = competition;
    if !(FIRST_FORMAT..=FORMAT).contains(format) {
        return Err(format!("format {format} is not known, only {FIRST_FORMAT} to {FORMAT}"));
    }
    let problems = definition.problems(competition.created_at);
    if let Some((field, problem)) = problems.first() {
        return Err(format!("{field} {problem}"));
    }
    let hex = |text: &String| data_encoding::HEXLOWER.decode(text.as_bytes()).ok();
    let salt: Option<[u8; SALT_BYTES]> = hex(salt).and_then(|bytes| bytes.try_into().ok());
    let salt = salt.ok_or("the salt is not 32 bytes in hexadecimal")?;
    let seed = |text| -> Option<[u8; SEED_BYTES]> { hex(text)?.try_into().ok() };
    let read: Option<Vec<_>> = seeds.iter().map(seed).collect();
    let seeds = read.ok_or("a sealed seed is not 16 bytes in hexadecimal")?;
    if seeds.len() != definition.sealed_seeds() {
        return Err(format!(
            "there are {} sealed seeds, and the attempts take {}",
            seeds.len(),
            definition.sealed_seeds()
        ));
    }
    let sealed = Sealed { salt, seeds };
    let found = sealed.commitment();
    let show = |bytes: &[u8; 32]| data_encoding::HEXLOWER.encode(bytes);
    if competition.revealed_at.is_some_and(|at| at < definition.closes_at) {
        return Err(format!(
            "it says that it was revealed before it closed, at {}",
            definition.closes_at
        ));
    }
    if *commitment != show(&found) {
        return Err(format!(
            "the commitment is {commitment}, but salt and seeds hash to {}",
            show(&found)
        ));
    }
    if let Some(published) = expected.commitment.filter(|published| *published != found) {
        return Err(format!(
            "salt and seeds hash to {}, but the published commitment is {}: they are others",
            show(&found),
            show(&published)
        ));
    }
    Ok(sealed)
}

/// Records that were read so far.
struct Checker<'a> {
    competition: export::Competition,
    sealed: Sealed,
    actions: Vec<export::Action>,
    /// Changes of the definition, with their times.
    changes: Vec<(Timestamp, Vec<Changed>)>,
    entrants: Vec<Entrant>,
    /// Index of each entrant, by id.
    entrant_of: HashMap<String, usize>,
    attempts: Vec<Attempt>,
    /// Runs of all attempts.
    runs: HashSet<String>,
    /// Runs that organizers voided, with the reasons.
    voids: HashSet<(String, String)>,
    /// Attempts that were not voided, as index of the entrant and attempt number; `voided` has those that were.
    played: HashSet<(usize, u32)>,
    voided: HashSet<(usize, u32)>,
    /// Spare attempts, voided or not, as index of the entrant and attempt number.
    spares: HashSet<(usize, u32)>,
    episodes: usize,
    rounds: u64,
    replays: &'a Replays,
    /// Games that are being replayed, in the order of the file.
    pending: VecDeque<Pending>,
}

/// A game that is being replayed, and the facts by which it is checked.
struct Pending {
    waiting: Waiting,
    place: JournalPosition,
    published: Arc<export::Attempt>,
    /// Index of the attempt, and of the game in the attempt.
    attempt: usize,
    game: usize,
    run: Arc<RunDefinition>,
    window: Window,
    ends: Arc<Ends>,
    planned: PlannedGame,
}

/// Ends that a window has had, each with the time from which it was known.
type Ends = Vec<(Timestamp, Timestamp)>;

impl<'a> Checker<'a> {
    fn new(competition: export::Competition, sealed: Sealed, replays: &'a Replays) -> Self {
        Self {
            competition,
            sealed,
            actions: Vec::new(),
            changes: Vec::new(),
            entrants: Vec::new(),
            entrant_of: HashMap::new(),
            attempts: Vec::new(),
            runs: HashSet::new(),
            voids: HashSet::new(),
            played: HashSet::new(),
            voided: HashSet::new(),
            spares: HashSet::new(),
            episodes: 0,
            rounds: 0,
            replays,
            pending: VecDeque::new(),
        }
    }

    fn definition(&self) -> &Definition {
        &self.competition.definition
    }

    /// Reads entrants and attempts up to the board, and returns the board.
    fn rest<R: BufRead, P: FnMut(usize)>(
        &mut self,
        reader: &mut Reader<R, P>,
    ) -> Result<Vec<StandingsRow>, Fault> {
        loop {
            match reader.next()? {
                Some(Line::Action(action)) => {
                    reader.place = format!("the action {} at {}", action.action, action.at);
                    self.action(action).map_err(|what| reader.wrong(what))?;
                }
                Some(Line::Entrant(entrant)) => {
                    reader.place = format!("the entrant {}", entrant.id);
                    self.entrant(entrant).map_err(|what| reader.wrong(what))?;
                }
                Some(Line::Attempt(attempt)) => self.attempt(reader, &Arc::new(attempt))?,
                Some(Line::Board(board)) => {
                    self.check_changes().map_err(|what| reader.wrong(what))?;
                    return Ok(board.rows);
                }
                Some(Line::Competition(_) | Line::Episode(_) | Line::End(_)) => {
                    return Err(reader.wrong("this record does not belong here"));
                }
                None => return Err(reader.wrong("the file ends here: the board is missing")),
            }
        }
    }

    fn action(&mut self, action: export::Action) -> Result<(), String> {
        if self.competition.format == FIRST_FORMAT {
            return Err(format!("format {FIRST_FORMAT} has none"));
        }
        if !self.entrants.is_empty() || !self.attempts.is_empty() {
            return Err("actions come before all entrants".to_owned());
        }
        let is_late = self.competition.revealed_at.is_some_and(|at| at <= action.at);
        if self.competition.format >= FORMAT
            && is_late
            && !AFTER_END.contains(&action.action.as_str())
        {
            return Err("it was done after the end, and is no part of a file".to_owned());
        }
        let Decided { changes, reason } = action.decided()?;
        let changed = changes.unwrap_or_default();
        for change in &changed {
            let shortened = change.field.ends_with("closes_at")
                && change.to.as_str().and_then(|at| at.parse::<Timestamp>().ok())
                    < change.from.as_str().and_then(|at| at.parse::<Timestamp>().ok());
            if shortened {
                return Err(format!("it shortened {}", change.field));
            }
        }
        if !changed.is_empty() {
            self.changes.push((action.at, changed));
        }
        if action.action == VOID
            && let Some(reason) = reason
        {
            self.voids.insert((action.subject.clone(), reason));
        }
        self.actions.push(action);
        Ok(())
    }

    /// Checks that each change continues the one before, and that the last change of a field is the value in the definition.
    fn check_changes(&self) -> Result<(), String> {
        let definition = serde_json::to_value(self.definition()).unwrap_or_default();
        let mut now: HashMap<&str, &Value> = HashMap::new();
        for changed in self.changes.iter().flat_map(|(_, changed)| changed) {
            let Changed { field, from, to } = changed;
            if now.insert(field, to).is_some_and(|before| before != from) {
                return Err(format!("a change of {field} begins with {from}, which it was not"));
            }
        }
        for (field, to) in now {
            let path = format!("/{}", field.replace('[', "/").replace("].", "/"));
            if definition.pointer(&path).is_some_and(|is| is != to) {
                return Err(format!("the last change of {field} is to {to}, which it is not"));
            }
        }
        Ok(())
    }

    fn entrant(&mut self, entrant: Entrant) -> Result<(), String> {
        if !self.attempts.is_empty() {
            return Err("entrants come before all attempts".to_owned());
        }
        // Servers never accept such a name.
        if entrant.name.chars().any(char::is_control) {
            return Err("its name has control characters".to_owned());
        }
        let categories = &self.definition().categories;
        match &entrant.category {
            Some(category) if !categories.contains(category) => {
                return Err(format!("its category {category:?} is not one of the competition"));
            }
            None if !categories.is_empty() => return Err("it has no category".to_owned()),
            _ => {}
        }
        let newest = self.definition().terms.as_ref().map_or(0, |terms| terms.version);
        if entrant.terms.is_some_and(|version| version > newest) {
            return Err(format!("it accepted terms that are newer than version {newest}"));
        }
        if self.entrant_of.insert(entrant.id.clone(), self.entrants.len()).is_some() {
            return Err("it is there twice".to_owned());
        }
        self.entrants.push(entrant);
        Ok(())
    }

    fn attempt<R: BufRead, P: FnMut(usize)>(
        &mut self,
        reader: &mut Reader<R, P>,
        published: &Arc<export::Attempt>,
    ) -> Result<(), Fault> {
        let place = format!("attempt {} of {}", published.attempt, published.entrant);
        reader.place.clone_from(&place);
        let (window, run) = self.place(published).map_err(|what| reader.wrong(what))?;
        let run = Arc::new(run);
        let ends = Arc::new(self.definition().ends(published.attempt, &self.changes));
        let plan = run.suite.plan();
        self.status(published, plan.len()).map_err(|what| reader.wrong(what))?;
        check_void(self.competition.format, published, &self.voids)
            .map_err(|what| reader.wrong(what))?;
        let slots = plan.iter().map(|game| Slot {
            task: TaskName::parse(&game.task).expect("the definition was checked"),
            seed: game.seed,
        });
        let number = self.attempts.len();
        self.attempts.push(Attempt {
            entrant: published.entrant.clone(),
            number: published.attempt,
            replays: published.replays,
            run: published.run.clone(),
            status: published.status.clone(),
            is_over: published.status != "running",
            voided: published.voided.is_some(),
            created_at: published.created_at,
            ended_at: published.ended_at,
            plan: slots.collect(),
            games: Vec::new(),
        });
        let mut played = HashSet::new();
        for (place_in_attempt, game) in published.games.iter().enumerate() {
            let planned = plan.get(game.slot as usize);
            let planned =
                planned.ok_or_else(|| reader.wrong("it has a game that its plan does not have"))?;
            let attempt = &mut self.attempts[number];
            let slot = attempt.plan[game.slot as usize];
            // The result is known after the replay.
            let unknown = EndedGame {
                slot,
                score: 0.0,
                tally: Tally::default(),
                voided: game.voided.is_some(),
            };
            attempt.games.push(unknown);
            if game.voided.is_some() {
                continue;
            }
            if !played.insert(game.slot) {
                return Err(reader.wrong(format!("the attempt has game {} twice", game.slot)));
            }
            let Some(Line::Episode(header)) = reader.next()? else {
                return Err(reader.wrong(format!("episode {} is missing", game.episode)));
            };
            reader.place = format!("{place}, game {}, {}", game.slot, game.episode);
            if header.episode != game.episode || header.slot != game.slot {
                return Err(reader.wrong(format!("episode {} is in its place", header.episode)));
            }
            let head =
                Head::parse(&header.head).ok_or_else(|| reader.wrong("its head is not a hash"))?;
            let (place, waiting) = reader.journal(header.lines, head, self.replays)?;
            self.pending.push_back(Pending {
                waiting,
                place,
                published: Arc::clone(published),
                game: place_in_attempt,
                attempt: number,
                run: Arc::clone(&run),
                window,
                ends: Arc::clone(&ends),
                planned: planned.clone(),
            });
            self.settle(self.replays.pending_max())?;
        }
        reader.place = place;
        Ok(())
    }

    /// Takes results of replays, in the order of the file, until at most `most` games are pending.
    fn settle(&mut self, most: usize) -> Result<(), Fault> {
        while self.pending.len() > most
            && let Some(pending) = self.pending.pop_front()
        {
            self.settle_one(pending)?;
        }
        Ok(())
    }

    fn settle_one(&mut self, pending: Pending) -> Result<(), Fault> {
        let Pending { waiting, place, published, attempt, game, run, window, ends, planned } =
            pending;
        let left = waiting.left;
        let played = waiting.played().map_err(|fault| place.fault(left, fault))?;
        if left > 0 {
            let problem = format!("the file ends here: {left} lines are missing");
            return Err(place.wrong(left, problem));
        }
        let known = &mut self.attempts[attempt].games[game];
        let game = &published.games[game];
        let (published, planned) = (&published, &planned);
        let format = self.competition.format;
        let check = GameCheck { format, published, game, run: &run, window, ends: &ends, planned };
        Self::check_game(&check, &played).map_err(|what| place.wrong(0, what))?;
        self.episodes += 1;
        self.rounds += u64::from(played.rounds);
        known.score = played.score;
        known.tally = played.tally;
        Ok(())
    }

    /// Checks that the number of games of an attempt of `planned` games fits its status.
    fn status(&self, published: &export::Attempt, planned: usize) -> Result<(), String> {
        let named = RunStatus::parse(&published.status);
        let status =
            named.ok_or_else(|| format!("its status {:?} is unknown", published.status))?;
        if status == RunStatus::Running && self.competition.revealed_at.is_some() {
            return Err("it is still running, but the competition is over".to_owned());
        }
        if published.voided.is_some() && !published.games.is_empty() {
            return Err("it was voided, but lists games".to_owned());
        }
        let slots: HashSet<u32> = published.games.iter().map(|game| game.slot).collect();
        if status == RunStatus::Finished && published.voided.is_none() && slots.len() < planned {
            return Err(format!("it is finished with {} of {planned} games", slots.len()));
        }
        Ok(())
    }

    /// Window and run of an attempt.
    fn place(&mut self, published: &export::Attempt) -> Result<(Window, RunDefinition), String> {
        let definition = &self.competition.definition;
        let number = *self.entrant_of.get(&published.entrant).ok_or("there is no such entrant")?;
        let window = definition.window(published.attempt);
        let window = window.ok_or("the competition has fewer attempts")?;
        if let Some(replayed) = published.replays {
            let spare = definition.spare(published.attempt);
            spare.ok_or("it plays another attempt again, and is no spare one")?;
            if !self.voided.contains(&(number, replayed)) {
                return Err(format!(
                    "it plays attempt {replayed} again, which was not voided before"
                ));
            }
            if !self.spares.insert((number, published.attempt)) {
                return Err("its spare seeds were used before".to_owned());
            }
        } else if definition.spare(published.attempt).is_some() {
            return Err("it is a spare one, and plays no voided attempt again".to_owned());
        }
        let place = (number, published.replays.unwrap_or(published.attempt));
        if published.voided.is_some() {
            self.voided.insert(place);
        } else if !self.played.insert(place) {
            return Err("it was played twice".to_owned());
        }
        if !self.runs.insert(published.run.clone()) {
            return Err(format!("its run {} is there twice", published.run));
        }
        check_time("it was started", published.created_at, window)?;
        let id = &self.competition.id;
        let declaration = &self.entrants[number].declaration;
        let run = definition.run(id, declaration, published.attempt, &self.sealed);
        Ok((window, run.ok_or("the competition has fewer attempts")?))
    }

    /// Checks that a replayed game belongs in its place.
    fn check_game(check: &GameCheck<'_>, played: &JournalReport) -> Result<(), String> {
        let GameCheck { format, published, game, run, window, ends, planned } = *check;
        let opening = &played.opening;
        if opening.episode != game.episode {
            return Err(format!("its journal is that of {}", opening.episode));
        }
        if opening.run.as_ref() != Some(&published.run) {
            return Err(format!(
                "it belongs to {:?}, not to the run {}",
                opening.run, published.run
            ));
        }
        if let Some(fork) = &opening.fork {
            return Err(format!("it is a fork of {}, and forks do not count", fork.episode));
        }
        if opening.config.seed != planned.seed {
            return Err(format!(
                "its seed is {}, but the sealed seed of its place is {}",
                opening.config.seed, planned.seed
            ));
        }
        // A game keeps the end of its window that was known when it was opened.
        let known = ends.iter().filter(|(from, _)| *from <= opening.created_at);
        let known: Vec<Option<Timestamp>> = known.map(|(_, end)| Some(*end)).collect();
        let mut expected = run.recorded(planned).map_err(|error| error.to_string())?;
        expected.closes_at = known
            .iter()
            .copied()
            .find(|end| *end == opening.config.closes_at)
            .unwrap_or_else(|| known.last().copied().flatten());
        differs("setting", &opening.config, &expected)?;
        if opening.agent_meta != run.agent_meta() {
            return Err("its player is not the one that the entrant declared".to_owned());
        }
        // The built-in template may have changed since the game.
        if run.prompt_template.as_ref().is_some_and(|own| *own != opening.prompt_template) {
            return Err("it has another prompt template than the entrant declared".to_owned());
        }
        check_time("it was created", opening.created_at, window)?;
        let Some(end) = &played.end else { return Err("its journal has no end".to_owned()) };
        check_ending(format, &published.status, &end.reason, opening.config.closes_at, ends)
    }

    /// Board as it follows from the games.
    fn board(&mut self, published: Vec<StandingsRow>) -> Result<Vec<StandingsRow>, String> {
        let attempts = std::mem::take(&mut self.attempts).into_iter();
        let definition = self.definition();
        let attempts: Vec<_> =
            attempts.map(|attempt| attempt.part(definition, Part::Final)).collect();
        let standings = standings(definition, &self.entrants, &attempts);
        let rows: Vec<StandingsRow> = standings.into_iter().map(|standing| standing.row).collect();
        for (place, (published, row)) in (1..).zip(published.iter().zip(&rows)) {
            differs(&format!("row {place}:"), published, row)?;
        }
        if published.len() != rows.len() {
            return Err(format!("it has {} rows, recomputed {}", published.len(), rows.len()));
        }
        Ok(published)
    }
}

/// A game, and the requirements of its place.
#[derive(Clone, Copy)]
struct GameCheck<'a> {
    format: u32,
    published: &'a export::Attempt,
    game: &'a export::ExportedGame,
    run: &'a RunDefinition,
    window: Window,
    ends: &'a Ends,
    planned: &'a PlannedGame,
}

/// Checks that an action voided a voided attempt, for the same reason.
fn check_void(
    format: u32,
    published: &export::Attempt,
    voids: &HashSet<(String, String)>,
) -> Result<(), String> {
    let Some(reason) = &published.voided else { return Ok(()) };
    if format < FIRST_FORMAT_WITH_CHECKED_ATTEMPTS
        || voids.contains(&(published.run.clone(), reason.clone()))
    {
        return Ok(());
    }
    Err(format!("it was voided ({reason}), but no action says so"))
}

/// Checks that no game of a finished attempt was cut off by the end of its window. A game that closed before the window was
/// extended does count as played.
fn check_ending(
    format: u32,
    status: &str,
    reason: &str,
    closes_at: Option<Timestamp>,
    ends: &Ends,
) -> Result<(), String> {
    let was_extended = || ends.last().is_some_and(|(_, end)| closes_at < Some(*end));
    if format < FIRST_FORMAT_WITH_CHECKED_ATTEMPTS
        || status != RunStatus::Finished.name()
        || reason != CLOSED
        || was_extended()
    {
        return Ok(());
    }
    Err("it closed with the window of its attempt, and the attempt is finished".to_owned())
}

/// Checks that a time is within the window. The order of times is not checked, as the clock may have been set back.
fn check_time(what: &str, at: Timestamp, window: Window) -> Result<(), String> {
    let Window { opens_at: from, closes_at: before } = window;
    if from <= at && at < before {
        return Ok(());
    }
    Err(format!("{what} at {at}, and may only be from {from} until {before}"))
}

/// Names the first field in which two objects differ.
fn differs<T: serde::Serialize>(what: &str, published: &T, expected: &T) -> Result<(), String> {
    let fields = |of: &T| match serde_json::to_value(of) {
        Ok(Value::Object(fields)) => fields,
        _ => serde_json::Map::new(),
    };
    let (published, expected) = (fields(published), fields(expected));
    for name in published.keys().chain(expected.keys()) {
        let (published, expected) = (published.get(name), expected.get(name));
        if published != expected {
            let show = |value: Option<&Value>| value.map_or("missing".to_owned(), Value::to_string);
            let (published, expected) = (show(published), show(expected));
            return Err(format!("{what} {name} is {published}, and should be {expected}"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use swarmbench_journal::record::RawRecord;

    use super::super::definition::tests::{at, definition};
    use super::super::export::{CHANGE, RECORD_BYTES_MAX};
    use super::*;

    const BEFORE: u32 = FIRST_FORMAT_WITH_CHECKED_ATTEMPTS - 1;
    const NOW: u32 = FIRST_FORMAT_WITH_CHECKED_ATTEMPTS;

    #[test]
    fn a_voided_attempt_has_its_action() {
        let mut attempt = attempt();
        attempt["status"] = json!("aborted");
        attempt["voided"] = json!("a power cut");
        let void = |run: &str, reason: &str| {
            action(20, VOID, &json!({ "attempt": 1, "reason": reason }).to_string())
                .replace("run_1", run)
        };
        for (format, action, says) in [
            (NOW, Some(void("run_1", "a power cut")), NO_BOARD),
            (NOW, Some(void("run_2", "a power cut")), "no action says so"),
            (NOW, Some(void("run_1", "a bad score")), "no action says so"),
            (NOW, None, "attempt 1 of ent_1"),
            // Files of the first format have no actions.
            (BEFORE, None, NO_BOARD),
        ] {
            let mut records = vec![competition(format).to_string()];
            records.extend(action);
            records.extend([entrant("blue").to_string(), attempt.to_string()]);
            let found = fault(&records);
            assert!(found.contains(says), "{says}: {found}");
        }
    }

    #[test]
    fn no_game_of_a_finished_attempt_has_closed_with_its_window() {
        let extended = vec![(Timestamp::MIN, at(50)), (at(45), at(100))];
        let check = |format, status, reason, closes_at| {
            check_ending(format, status, reason, Some(at(closes_at)), &extended)
        };
        check(NOW, "finished", CLOSED, 100).expect_err("the attempt has closed, too");
        assert_eq!(check(BEFORE, "finished", CLOSED, 100), Ok(()), "earlier files stay true");
        assert_eq!(check(NOW, "closed", CLOSED, 100), Ok(()));
        assert_eq!(check(NOW, "finished", "rounds_played", 100), Ok(()));
        assert_eq!(
            check(NOW, "finished", CLOSED, 50),
            Ok(()),
            "the window was extended afterwards"
        );
    }

    /// First record of a valid file.
    fn competition(format: u32) -> Value {
        let definition = Definition { seeds_by_task: false, ..definition() };
        let seeds = vec![[0; SEED_BYTES]; definition.sealed_seeds()];
        let sealed = Sealed { salt: [0; SALT_BYTES], seeds };
        let hex = |bytes: &[u8]| data_encoding::HEXLOWER.encode(bytes);
        json!({
            "kind": "competition", "format": format, "id": "cmp_1", "definition": definition, "created_at": at(0),
            "revealed_at": at(100), "commitment": hex(&sealed.commitment()), "salt": hex(&sealed.salt),
            "seeds": sealed.seeds.iter().map(|seed| hex(seed)).collect::<Vec<_>>(),
        })
    }

    fn action(minute: i64, name: &str, detail: &str) -> String {
        let at = json!(at(minute));
        format!(
            r#"{{"kind":"action","at":{at},"action":"{name}","subject":"run_1","detail":{detail}}}"#
        )
    }

    fn entrant(name: &str) -> Value {
        json!({
            "kind": "entrant", "id": "ent_1", "name": name, "model": "m", "status": "active", "vouched": false,
            "registered_at": at(5),
        })
    }

    fn attempt() -> Value {
        json!({
            "kind": "attempt", "entrant": "ent_1", "attempt": 1, "run": "run_1", "status": "closed", "created_at": at(15),
            "ended_at": at(100), "games": [],
        })
    }

    /// Fault of a file of these records.
    fn fault(records: &[String]) -> String {
        let (mut head, mut file) = (Head::START, String::new());
        for record in records {
            head = head.link(record.as_bytes());
            file += &RawRecord::from_stored(record.clone()).expect("JSON").line(head);
        }
        let verified = verify(file.as_bytes(), Expected::default(), Solver::Flow, |_| {});
        verified.expect_err("it has no end").to_string()
    }

    /// Fault of all valid files of these tests: they end before the board.
    const NO_BOARD: &str = "the board is missing";

    #[test]
    fn a_field_of_a_later_format_is_refused_in_an_older_file() {
        let values = json!({
            "spares": 0, "attempts_per_day": 3, "public_seeds": 1, "tie_breaks": ["earliest"], "own_games": "ended",
            "terms": { "version": 1, "text": "x" }, "categories": [], "seeds_by_task": false,
        });
        for (of, field, first) in export::LATER_FIELDS {
            for format in FIRST_FORMAT..=FORMAT {
                let mut records = [competition(format), entrant("blue"), attempt()];
                // The entrant has accepted no terms.
                let value = if of == "entrant" { Value::Null } else { values[field].clone() };
                match of {
                    "definition" => records[0]["definition"][field] = value,
                    "entrant" => records[1][field] = value,
                    _ => records[2][field] = value,
                }
                let found = fault(&records.map(|record| record.to_string()));
                let says = if format < first { "needs format" } else { NO_BOARD };
                assert!(found.contains(says), "{of}.{field} in {format}: {found}");
            }
        }
    }

    #[test]
    fn a_field_that_is_always_there_is_not_left_out() {
        let row = json!({
            "rank": null, "entrant": "ent_1", "attempt": null, "run": null, "run_status": null, "tasks": [], "total": null,
            "answers": 0, "invalid": 0, "timeouts": 0, "voided_games": 0, "attempts": 0, "voided_attempts": 0,
            "decentralization": null,
        });
        let board = json!({ "kind": "board", "rows": [row] });
        let whole = [competition(FORMAT), entrant("blue"), attempt(), board];
        let left_out = [
            (0, "", "revealed_at"),
            (2, "", "ended_at"),
            (3, "/rows/0", "rank"),
            (3, "/rows/0", "total"),
            (3, "/rows/0", "decentralization"),
        ];
        for (place, object, field) in left_out {
            let mut records = whole.clone();
            let of = records[place].pointer_mut(object).and_then(Value::as_object_mut);
            of.expect("an object").remove(field);
            let found = fault(&records.map(|record| record.to_string()));
            assert!(found.contains(&format!("missing field `{field}`")), "{field}: {found}");
        }
    }

    #[test]
    fn an_action_is_one_that_a_file_may_have() {
        let check = |format, action: String, says: &str| {
            let found = fault(&[competition(format).to_string(), action]);
            assert!(found.contains(says), "{says}: {found}");
        };
        let change = r#"{"field":"name","from":"a","to":"a cup"}"#;
        let changes = format!(r#"{{"changes":[{change}]}}"#);
        check(FORMAT, action(50, CHANGE, &changes), NO_BOARD);
        check(2, action(100, CHANGE, &changes), NO_BOARD);
        check(FORMAT, action(100, "entrants.exclude", "{}"), NO_BOARD);
        for late in [CHANGE, export::CANCEL, "competition.announce", "entrant.erase", "something"] {
            check(FORMAT, action(100, late, &changes), "done after the end");
        }
        check(FORMAT, action(50, "something", "[]"), "no object");
        check(FORMAT, action(50, CHANGE, "{}"), "no changes");
        let twice = [
            format!(r#"{{"changes":[],"changes":[{change}]}}"#),
            changes.replace(r#""to":"#, r#""to":"b","to":"#),
        ];
        for twice in twice {
            check(FORMAT, action(50, CHANGE, &twice), "duplicate field");
        }
        check(FORMAT, action(50, VOID, r#"{"reason":"a","reason":"b"}"#), "duplicate field");
        let numbers = format!(r#"{{"n":[{}0]}}"#, "0,".repeat(RECORD_BYTES_MAX / 2));
        check(FORMAT, action(50, "something", &numbers), "RECORD_BYTES_MAX");
    }

    #[test]
    fn a_name_that_acts_on_a_terminal_is_refused() {
        for (name, says) in [("blue", NO_BOARD), ("\u{1b}[2Jblue", "control characters")] {
            let found = fault(&[competition(1).to_string(), entrant(name).to_string()]);
            assert!(found.contains(says), "{found}");
        }
    }
}
