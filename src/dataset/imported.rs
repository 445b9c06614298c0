//! Imported games: from files to the store, and back to states and acts.

use std::collections::HashSet;
use std::io::{BufRead as _, BufReader, Read, Write};

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use swarmbench_engine::{Action, TaskName};
use swarmbench_protocol::import::ImportConfig;

use super::bounds::{Bounds, IMPORT_STATE_BYTES_MAX};
use super::format::{AgentAt, AgentRow, GameRow, Meta, Said};
use crate::store::entries::{ImportRow, ImportedRound};
use crate::store::imports::ImportHash;
use swarmbench_protocol::Position;
use swarmbench_protocol::episode::{State, StateAgent};

const MODEL_CHARS_MAX: usize = 200;

/// Maximum rows or columns of a map, and of a window.
const SIDE_MAX: u32 = 1024;

const AGENTS_MAX: u32 = 1024;

const ROUNDS_MAX: u32 = 100_000;

/// Characters of an agent's name.
const NAME_CHARS_MAX: usize = 64;

/// A state as stored: each row of the grid is one text.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredState {
    timestamp: Option<f64>,
    grid: Vec<String>,
    agents: Vec<AgentAt>,
    messages: Vec<Said>,
}

/// Maximum unpacked bytes of the acts of a state.
const ACTS_BYTES_MAX: u64 = 4 * IMPORT_STATE_BYTES_MAX;

/// Checks the parts of a game as they are read, and builds its row for the store.
pub struct Builder {
    run_id: String,
    meta: Meta,
    bounds: Bounds,
    task: TaskName,
    model: String,
    rounds: Vec<ImportedRound>,
    names: Vec<String>,
    acts: u64,
    /// Agents with an act, and bytes of acts, for each round.
    acted: Vec<Acted>,
    /// Packed acts of the current round, one JSON object a line.
    open: Option<GzEncoder<Vec<u8>>>,
    open_round: u32,
    /// Bytes of all states and packed acts.
    bytes: u64,
}

/// Agents that occurred in a round, and the bytes of their acts.
#[derive(Clone, Default)]
struct Acted {
    /// One bit for each agent.
    by: Vec<u64>,
    /// Unpacked bytes.
    bytes: u64,
}

impl Builder {
    /// Starts a game without states. An error names the invalid setting.
    pub fn new(run_id: &str, meta: Meta, bounds: Bounds) -> Result<Self, String> {
        let model = model(&meta.model)?;
        let task = TaskName::parse(&meta.task)
            .ok_or_else(|| format!("the task {:?} is not known", short(&meta.task)))?;
        for (name, value, most) in [
            ("num_agents", meta.num_agents, AGENTS_MAX),
            ("max_round", meta.max_round, ROUNDS_MAX),
            ("width", meta.width, SIDE_MAX),
            ("height", meta.height, SIDE_MAX),
            ("view_size", meta.view_size, SIDE_MAX),
        ] {
            if !(1..=most).contains(&value) {
                return Err(format!("{name} must be from 1 to {most}, is {value}"));
            }
        }
        if i64::try_from(meta.seed).is_err() {
            return Err(format!("the seed {} is too large", meta.seed));
        }
        Ok(Self {
            run_id: run_id.to_owned(),
            meta,
            bounds,
            task,
            model,
            rounds: Vec::new(),
            names: Vec::new(),
            acts: 0,
            acted: Vec::new(),
            open: None,
            open_round: 0,
            bytes: 0,
        })
    }

    pub fn add_state(&mut self, row: GameRow) -> Result<(), String> {
        let expected = self.rounds.len();
        if row.round as usize != expected {
            return Err(format!("round {} stands where round {expected} was expected", row.round));
        }
        let at = |problem: String| format!("round {expected}: {problem}");
        if row.round > self.meta.max_round {
            return Err(at(format!("max_round is {}", self.meta.max_round)));
        }
        if row.task != self.meta.task {
            return Err(at(format!(
                "its task is {:?}, and {:?} in the index",
                short(&row.task),
                self.meta.task
            )));
        }
        let grid = self.grid(&row.grid).map_err(at)?;
        if self.rounds.is_empty() {
            self.names = row.agents.iter().map(|agent| agent.id.clone()).collect();
            if self.names.len() != self.meta.num_agents as usize {
                return Err(at(format!(
                    "it has {} agents, not {}",
                    self.names.len(),
                    self.meta.num_agents
                )));
            }
            if let Some(name) = self.names.iter().find(|name| !is_plain(name, NAME_CHARS_MAX)) {
                return Err(at(format!("{:?} is not the name of an agent", short(name))));
            }
            if let Some(name) = twice(&self.names) {
                return Err(at(format!("two agents have the name {name:?}")));
            }
        } else if !row.agents.iter().map(|agent| &agent.id).eq(&self.names) {
            return Err(at("its agents are not those of the rounds before it".to_owned()));
        }
        if let Some(agent) = row.agents.iter().find(|agent| !self.is_possible(agent)) {
            let (width, height) = (self.meta.width, self.meta.height);
            return Err(at(format!(
                "{} is outside of the map of {width} × {height} cells, at x {}, y {}",
                agent.id, agent.x, agent.y
            )));
        }
        if let Some(last) = self.rounds.last()
            && row.score < last.score
        {
            return Err(at(format!("the score falls from {} to {}", last.score, row.score)));
        }
        let most = self.score_max(row.round);
        if !(0.0..=most).contains(&row.score) {
            return Err(at(format!("the score must be from 0 to {most}, is {}", row.score)));
        }
        self.check_messages(&row.messages).map_err(at)?;
        let (timestamp, agents, messages) = (row.timestamp, row.agents, row.messages);
        let state = text(&StoredState { timestamp, grid, agents, messages });
        let added = state.len();
        self.rounds.push(ImportedRound { round: row.round, score: row.score, state, acts: None });
        self.count(expected, added)
    }

    /// Upper bound of the score after a number of rounds by the rules of the task, not always tight.
    fn score_max(&self, rounds: u32) -> f64 {
        let Meta { num_agents, width, height, .. } = self.meta;
        let (agents, rounds) = (f64::from(num_agents), f64::from(rounds));
        match self.task {
            TaskName::Transport => agents,
            // An agent's distance to its cell of the shape, part of which may be outside of the map, is at most this.
            TaskName::Flocking => agents * f64::from(width + height + num_agents),
            TaskName::Pursuit | TaskName::Synchronization => rounds,
            TaskName::Foraging => agents * rounds,
        }
    }

    /// Checks that each message comes from a different agent of the game.
    fn check_messages(&self, messages: &[Said]) -> Result<(), String> {
        let mut senders = Acted::default();
        for said in messages {
            let name = short(&said.agent_name);
            let number = self.names.iter().position(|known| *known == said.agent_name);
            let number = number.ok_or_else(|| format!("a message is of {name:?}, no agent"))?;
            if !senders.add(number) {
                return Err(format!("{name:?} has a second message"));
            }
        }
        Ok(())
    }

    /// Counts bytes added to a round.
    fn count(&mut self, round: usize, added: usize) -> Result<(), String> {
        let Bounds { state_bytes_max, game_bytes_max, .. } = self.bounds;
        self.bytes += added as u64;
        if self.rounds[round].bytes() > state_bytes_max {
            return Err(format!(
                "round {round} takes more than {state_bytes_max} bytes (state_bytes_max)"
            ));
        }
        if self.bytes > game_bytes_max {
            return Err(format!(
                "the game takes more than {game_bytes_max} bytes (game_bytes_max)"
            ));
        }
        Ok(())
    }

    /// Whether an agent's position is possible: on the map, or one cell outside after its escape in Transport.
    fn is_possible(&self, agent: &AgentAt) -> bool {
        let outside = i64::from(self.task == TaskName::Transport);
        let fits = |n: i32, cells: u32| (-outside..i64::from(cells) + outside).contains(&n.into());
        fits(agent.x, self.meta.width) && fits(agent.y, self.meta.height)
    }

    /// The rows of a grid as texts. Every cell must have one character.
    fn grid(&self, rows: &[Vec<String>]) -> Result<Vec<String>, String> {
        let (height, width) = (self.meta.height as usize, self.meta.width as usize);
        if rows.len() != height || rows.iter().any(|row| row.len() != width) {
            return Err(format!("the grid has not {height} rows of {width} cells"));
        }
        let one = |cell: &String| cell.chars().count() == 1 && !cell.contains(char::is_control);
        if let Some(cell) = rows.iter().flatten().find(|cell| !one(cell)) {
            return Err(format!("the cell {:?} is not one character", short(cell)));
        }
        Ok(rows.iter().map(|row| row.concat()).collect())
    }

    /// Adds an act. Acts of a round may come in any order.
    pub fn add_act(&mut self, row: &AgentRow) -> Result<(), String> {
        let at = |problem: &str| {
            format!("round {}, agent {:?}: {problem}", row.round, short(&row.agent_id))
        };
        if row.round as usize >= self.rounds.len() {
            return Err(at("there is no state of this round"));
        }
        let Some(agent) = self.names.iter().position(|name| *name == row.agent_id) else {
            return Err(at("it is no agent of this run"));
        };
        // The toolkit writes rows with empty texts for escaped agents.
        let action = row.action.as_deref().unwrap_or_default();
        if !action.is_empty() && Action::ALL.iter().all(|known| known.name() != action) {
            return Err(at(&format!("the action {:?} is not known", short(action))));
        }
        let mut line = serde_json::to_vec(row).expect("string keys");
        line.push(b'\n');
        self.acted.resize_with(self.rounds.len(), Acted::default);
        let acted = &mut self.acted[row.round as usize];
        acted.bytes += line.len() as u64;
        if !acted.add(agent) {
            return Err(at("it has a second act"));
        }
        if acted.bytes > ACTS_BYTES_MAX {
            return Err(at(&format!(
                "the acts of the round have more than {ACTS_BYTES_MAX} bytes"
            )));
        }
        if row.round != self.open_round {
            self.pack()?;
            self.open_round = row.round;
        }
        let open =
            self.open.get_or_insert_with(|| GzEncoder::new(Vec::new(), Compression::default()));
        open.write_all(&line).expect("memory takes everything");
        self.acts += 1;
        Ok(())
    }

    /// Closes the packed acts read so far, and appends them to their round.
    pub fn pack(&mut self) -> Result<(), String> {
        let Some(open) = self.open.take() else { return Ok(()) };
        let packed = open.finish().expect("memory takes everything");
        let round = self.open_round as usize;
        // Concatenated gzip members are one valid stream.
        self.rounds[round].acts.get_or_insert_default().extend(&packed);
        self.count(round, packed.len())
    }

    pub fn without_acts(&mut self) {
        self.open = None;
        self.acts = 0;
        for round in &mut self.rounds {
            round.acts = None;
        }
    }

    pub fn finish(self) -> Result<ImportRow, String> {
        let last = self.rounds.last().ok_or("it has no states")?;
        let meta = text(&self.meta);
        let mut hash = ImportHash::new(&self.run_id, &meta);
        for round in &self.rounds {
            hash.add(round.score, &round.state);
        }
        let digest = hash.finish();
        Ok(ImportRow {
            id: format!("imp_{}", data_encoding::HEXLOWER.encode(&digest[..16])),
            digest,
            score: last.score,
            resolved: last.round,
            settings: settings(&self.meta),
            run_id: self.run_id,
            model: self.model,
            task: self.meta.task,
            seed: self.meta.seed,
            meta,
            acts: self.acts,
            rounds: self.rounds,
        })
    }
}

impl Acted {
    /// Marks an agent; false if it was already marked.
    fn add(&mut self, agent: usize) -> bool {
        let (place, bit) = (agent / 64, 1 << (agent % 64));
        if self.by.len() <= place {
            self.by.resize(place + 1, 0);
        }
        let is_new = self.by[place] & bit == 0;
        self.by[place] |= bit;
        is_new
    }
}

/// The settings that decide whether games are comparable.
fn settings(meta: &Meta) -> ImportConfig {
    let word = |name: &str| {
        let word = meta.rest.get(name).and_then(Value::as_str);
        word.filter(|word| is_plain(word, NAME_CHARS_MAX)).map(str::to_owned)
    };
    let number = |name: &str| meta.rest.get(name).and_then(Value::as_i64);
    ImportConfig {
        num_agents: meta.num_agents,
        max_round: meta.max_round,
        width: meta.width,
        height: meta.height,
        view_size: meta.view_size,
        rules: word("rules"),
        control: word("control"),
        memory: number("memory"),
        noise: meta.rest.get("noise").and_then(Value::as_f64),
        max_delay: number("max_delay"),
        answer_reader: word("answer_reader"),
    }
}

/// A single name for a model or a list of models.
fn model(value: &Value) -> Result<String, String> {
    match value {
        Value::String(name) => plain_model(name).map(str::to_owned),
        Value::Array(names) => {
            let mut texts = Vec::new();
            for name in names {
                let name = name.as_str().ok_or("model has a name that is not a text")?;
                let name = plain_model(name)?;
                if !texts.contains(&name) {
                    texts.push(name);
                }
            }
            plain_model(&joined(&texts)).map(str::to_owned)
        }
        _ => Err("model is neither a name nor a list of names".to_owned()),
    }
}

fn plain_model(name: &str) -> Result<&str, String> {
    if is_plain(name, MODEL_CHARS_MAX) {
        Ok(name)
    } else {
        Err(format!("model must have 1 to {MODEL_CHARS_MAX} characters and no control characters"))
    }
}

/// All names, or the first ones and the number of those left out.
fn joined(names: &[&str]) -> String {
    let all = names.join(" + ");
    if all.chars().count() <= MODEL_CHARS_MAX {
        return all;
    }
    let shown = |most: usize| {
        let first = names[..most].iter().flat_map(|name| [name, " + "]);
        first.collect::<String>() + &format!("{} more", names.len() - most)
    };
    let fits = |text: &String| text.chars().count() <= MODEL_CHARS_MAX;
    (0..names.len()).map(shown).take_while(fits).last().expect("a number is short")
}

fn is_plain(text: &str, most: usize) -> bool {
    (1..=most).contains(&text.chars().count()) && !text.contains(char::is_control)
}

/// The beginning of a text, for error messages.
fn short(text: &str) -> String {
    text.chars().take(60).collect()
}

fn text(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("string keys")
}

/// A name that occurs twice, if any.
fn twice(names: &[String]) -> Option<&String> {
    let mut seen = HashSet::new();
    names.iter().find(|name| !seen.insert(*name))
}

/// A stored game cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// An earlier version stored a game beyond the current limits.
    #[error("{0} (import_state_bytes_max is {IMPORT_STATE_BYTES_MAX})")]
    TooLarge(String),
    #[error("{0}")]
    Broken(String),
}

impl From<String> for Unreadable {
    fn from(problem: String) -> Self {
        Self::Broken(problem)
    }
}

/// The end of the range of states, from `from` on, that are read at once. `bytes` are their stored sizes.
///
/// # Errors
/// If the state `from` is missing or too large.
pub fn fitting(from: u32, bytes: &[u64]) -> Result<u32, Unreadable> {
    let mut all = 0_u64;
    let fits = |&&bytes: &&u64| {
        all = all.saturating_add(bytes);
        all <= IMPORT_STATE_BYTES_MAX
    };
    match (bytes.iter().take_while(fits).count(), bytes.first()) {
        (0, Some(bytes)) => {
            Err(Unreadable::TooLarge(format!("state {from} was stored with {bytes} bytes")))
        }
        (0, None) => Err(format!("state {from} is missing").into()),
        (count, _) => Ok(from + u32::try_from(count).expect("states have numbers")),
    }
}

/// The settings of a stored game, in the form of its files.
pub fn meta(stored: &str) -> Result<Meta, Unreadable> {
    Ok(serde_json::from_str(stored).map_err(|error| error.to_string())?)
}

/// A stored state, in the form of the files.
pub fn game_row(task: &str, round: &ImportedRound) -> Result<GameRow, Unreadable> {
    let state: StoredState =
        serde_json::from_str(&round.state).map_err(|error| error.to_string())?;
    let cells = |row: &String| row.chars().map(String::from).collect();
    Ok(GameRow {
        timestamp: state.timestamp,
        task: task.to_owned(),
        round: round.round,
        grid: state.grid.iter().map(cells).collect(),
        agents: state.agents,
        score: round.score,
        messages: state.messages,
    })
}

/// Passes the acts of a round to `see` one by one, in the form of the files; fails if there are more acts than agents.
pub fn each_act<T: DeserializeOwned>(
    round: &ImportedRound,
    agents: u32,
    mut see: impl FnMut(T) -> Result<(), Unreadable>,
) -> Result<(), Unreadable> {
    let number = round.round;
    let Some(packed) = &round.acts else { return Ok(()) };
    let mut acts = BufReader::new(MultiGzDecoder::new(&packed[..]).take(ACTS_BYTES_MAX + 1));
    let (mut line, mut bytes) = (Vec::new(), 0);
    for act in 0.. {
        line.clear();
        bytes += acts.read_until(b'\n', &mut line).map_err(|error| error.to_string())? as u64;
        if bytes > ACTS_BYTES_MAX {
            let problem =
                format!("the acts of round {number} have more than {ACTS_BYTES_MAX} bytes");
            return Err(Unreadable::TooLarge(problem));
        }
        if line.is_empty() {
            break;
        }
        if act == agents {
            let problem = format!("round {number} has more acts than its {agents} agents");
            return Err(Unreadable::TooLarge(problem));
        }
        see(serde_json::from_slice(&line).map_err(|error| error.to_string())?)?;
    }
    Ok(())
}

/// A stored state, in the form of the API.
pub fn state(task: &str, round: &ImportedRound) -> Result<State, Unreadable> {
    let row = game_row(task, round)?;
    let cell = |at: &AgentAt| {
        let (i, j) = (usize::try_from(at.y).ok()?, usize::try_from(at.x).ok()?);
        row.grid.get(i)?.get(j)
    };
    let task = TaskName::parse(task);
    let agent = |at: &AgentAt| {
        let cell = cell(at);
        let flag = |name| {
            let is_on = cell.map(|cell| cell == "A")?;
            (task == Some(name)).then_some(is_on)
        };
        StateAgent {
            agent: at.id.clone(),
            i: at.y,
            j: at.x,
            alive: cell.is_some(),
            light_on: flag(TaskName::Synchronization),
            carrying_food: flag(TaskName::Foraging),
        }
    };
    let prey = (0..).zip(&row.grid).find_map(|(i, cells)| {
        (0..).zip(cells).find(|(_, cell)| *cell == "P").map(|(j, _)| Position { i, j })
    });
    let line = |cells: &Vec<String>| cells.concat().replace('a', "A");
    Ok(State {
        round: row.round,
        score: row.score,
        grid: row.grid.iter().map(line).collect(),
        agents: row.agents.iter().map(agent).collect(),
        prey,
        block: None,
        distance: None,
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn models_of_agents_become_one_name_of_bounded_length() {
        assert_eq!(model(&json!(["a", "b", "a"])), Ok("a + b".to_owned()));
        let long: Vec<String> =
            (0..9).map(|number| format!("{number}{}", "é".repeat(59))).collect();
        let name = model(&json!(long)).expect("a name");
        assert!(name.starts_with(&format!("{} + ", long[0])) && name.ends_with("6 more"), "{name}");
        let longest = "é".repeat(MODEL_CHARS_MAX);
        assert_eq!(model(&json!([longest, "b"])), Ok("2 more".to_owned()));
        assert!(model(&json!([longest + "é", "b"])).is_err());
    }
}
