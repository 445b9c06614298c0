//! Replay of a stored episode, round by round.

use std::sync::Arc;

use jiff::Timestamp;
use serde_json::{Map, json};
use swarmbench_engine::{
    Action, AgentId, AgentState, AnswerReader, Config, Digest, Observation, RuleSet, Seen, World,
};

use super::format::{AgentAt, AgentRow, GameRow, Meta, Said};
use super::header::Header;
use crate::store::exports::LoggedRound;
use crate::store::port::StoredEpisode;
use swarmbench_journal::record::ActRecord;
use swarmbench_journal::replay::{Replayer, RoundFault, acts_of};
use swarmbench_prompt::tasks;
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

pub struct DatasetGame {
    pub header: Header,
    config: Arc<Config>,
    description: String,
    replayer: Replayer,
    began_at: Timestamp,
    /// Tokens of the answers of each agent so far, if any were reported.
    tokens: Vec<Option<u64>>,
}

/// A replayed round.
pub struct Turn {
    pub round: u32,
    /// State before the round.
    pub before: Arc<World>,
    /// Acts by number of the agent.
    pub acts: Vec<GameAct>,
    /// Time of the round's resolution.
    pub at: Timestamp,
}

pub struct GameAct {
    pub agent: AgentId,
    pub at: Timestamp,
    pub record: ActRecord,
    /// Whether the action had an effect; see `took_effect`.
    pub took_effect: bool,
    /// Total tokens of the agent's answers up to this one, if any were reported.
    pub tokens: Option<u64>,
}

impl GameAct {
    /// A copy with the complete record.
    #[must_use]
    pub fn with(&self, record: ActRecord) -> Self {
        let Self { agent, at, took_effect, tokens, .. } = *self;
        Self { agent, at, record, took_effect, tokens }
    }
}

impl DatasetGame {
    pub fn new(stored: &StoredEpisode) -> Result<Self, String> {
        let header = Header::read(stored)?;
        let config = header.opening.config.engine().map_err(|error| error.to_string())?;
        let config = Arc::new(config);
        Ok(Self {
            description: tasks::description(&config),
            replayer: Replayer::new(Arc::new(World::new(Arc::clone(&config)))),
            began_at: stored.created_at,
            tokens: vec![None; config.num_agents().into()],
            header,
            config,
        })
    }

    /// The current state.
    pub fn world(&self) -> &World {
        self.replayer.world()
    }

    /// Plays the next round; fails if the state's digest differs from the recorded one.
    pub fn play(&mut self, round: LoggedRound) -> Result<Turn, String> {
        let at = |fault: RoundFault| format!("round {}: {fault}", round.round);
        let before = Arc::clone(self.replayer.world());
        let acts = acts_of(&self.config, round.acts.iter().map(|act| &act.record)).map_err(at)?;
        let digest = Digest(round.digest).to_string();
        self.replayer.play(round.round, &acts, Some(&digest)).map_err(at)?;
        let from: Vec<AgentState> = before.agent_states().collect();
        let to: Vec<AgentState> = self.world().agent_states().collect();
        let acts = round.acts.into_iter().map(|act| {
            let own = act.agent.index();
            if let Some(used) = act.record.usage.as_ref().and_then(|usage| usage.completion_tokens)
            {
                let tokens = &mut self.tokens[own];
                *tokens = Some(tokens.unwrap_or(0).saturating_add(used));
            }
            GameAct {
                took_effect: took_effect(acts[own].action, &from[own], &to[own]),
                tokens: self.tokens[own],
                agent: act.agent,
                at: act.at,
                record: act.record,
            }
        });
        Ok(Turn { round: round.round, acts: acts.collect(), before, at: round.at })
    }

    /// The window that an agent saw when it decided a round; `None` once it has escaped.
    pub fn view(&self, turn: &Turn, agent: AgentId) -> Option<Vec<Vec<String>>> {
        view(&turn.before.observe(agent), self.config.rules())
    }

    /// The episode's entry in the index.
    pub fn meta(&self, status: &str) -> Meta {
        let Header { opening, .. } = &self.header;
        let config = &opening.config;
        let size = |cells: i64| u32::try_from(cells).unwrap_or(u32::MAX);
        let mut rest = vec![
            ("rules", json!(config.rules)),
            ("control", json!(config.control)),
            ("memory", json!(config.memory)),
            ("noise", json!(config.noise)),
            ("max_delay", json!(config.max_delay)),
            ("status", json!(status)),
        ];
        // A newer setting is written only if the game uses it: an export must stay the same, so that it is imported only
        // once.
        if !AnswerReader::is_usual(&config.answer_reader) {
            rest.push(("answer_reader", json!(config.answer_reader)));
        }
        if opening.prompt_revision > 1 {
            rest.push(("prompt", json!(self.header.prompt())));
        }
        if let Some(run) = &opening.run {
            rest.push(("run", json!(run)));
        }
        // Games with one holder keep the original fields: an export must stay the same, so that it is imported only once.
        if self.header.is_mixed() {
            let holders: Vec<u32> = self.header.by_agent().map(|holder| holder.holder).collect();
            rest.extend([("mixed", json!(true)), ("holders", json!(holders))]);
        }
        let models: Vec<&str> = self.header.by_agent().map(|holder| &*holder.model).collect();
        Meta {
            model: if self.header.models().len() == 1 { json!(models[0]) } else { json!(models) },
            task: config.task.clone(),
            num_agents: config.num_agents.into(),
            max_round: config.max_round,
            width: size(config.width),
            height: size(config.height),
            seed: config.seed.get(),
            view_size: size(config.view_size),
            rest: rest
                .into_iter()
                .map(|(name, value)| (name.to_owned(), value))
                .collect::<Map<_, _>>(),
        }
    }

    pub fn layout(&self) -> GameRow {
        self.row(self.began_at, Vec::new())
    }

    /// The state after `turn`, which must be the last played round.
    pub fn after(&self, turn: &Turn) -> GameRow {
        let said = turn.acts.iter().filter_map(|act| {
            Some(Said {
                round: turn.round,
                agent_name: act.agent.to_string(),
                message: act.record.message.clone()?,
            })
        });
        self.row(turn.at, said.collect())
    }

    fn row(&self, at: Timestamp, messages: Vec<Said>) -> GameRow {
        let seen = self.world().spectator_view();
        let at_of = |agent: &AgentState| AgentAt {
            id: agent.agent.to_string(),
            x: agent.at.j,
            y: agent.at.i,
        };
        GameRow {
            timestamp: Some(seconds(at)),
            task: self.config.task().name().to_owned(),
            round: seen.round,
            grid: grid(self.world()),
            agents: seen.agents.iter().map(at_of).collect(),
            score: seen.score,
            messages,
        }
    }

    /// A row of the file of acts for an act of the last played round.
    pub fn act(&self, turn: &Turn, act: &GameAct) -> AgentRow {
        let seen = turn.before.observe(act.agent);
        let record = &act.record;
        let holder = self.header.holder(act.agent);
        let latency = record.usage.as_ref().and_then(|usage| usage.latency_ms);
        #[expect(clippy::cast_precision_loss, reason = "no answer takes thousands of years")]
        let seconds_of = |millis: u64| millis as f64 / 1000.0;
        AgentRow {
            timestamp: Some(seconds(act.at)),
            task: self.config.task().name().to_owned(),
            round: turn.round,
            agent_id: act.agent.to_string(),
            view: view(&seen, self.config.rules()),
            prompt: self.prompt(&seen),
            response: Some(record.response.clone().unwrap_or_default()),
            action: Some(record.action.clone().unwrap_or_else(|| Action::Stay.name().to_owned())),
            message: Some(record.message.clone().unwrap_or_default()),
            api_call_time: latency.map(seconds_of),
            action_success: Some(act.took_effect),
            total_llm_tokens: act.tokens,
            failure: record.failure,
            model: Some(holder.model.clone()),
            holder: Some(holder.holder),
            player: holder.player.clone(),
        }
    }

    /// The agent's prompt; `None` if its template fails.
    fn prompt(&self, seen: &Observation) -> Option<String> {
        let sight = Sight::of(
            seen,
            self.header.opening.episode.clone(),
            self.description.clone(),
            Status::Running,
            None,
        );
        swarmbench_prompt::render(&self.header.opening.prompt_template, &sight, &self.config).ok()
    }
}

/// Whether an action had an effect: moves if the agent got somewhere in their direction, `SWITCH` always, `STAY` and a
/// missing action never.
fn took_effect(action: Option<Action>, from: &AgentState, to: &AgentState) -> bool {
    match action.map(|action| (action, action.direction())) {
        Some((_, Some(direction))) => {
            let (di, dj) = direction.offset();
            di * (to.at.i - from.at.i) + dj * (to.at.j - from.at.j) > 0
        }
        Some((Action::Switch, None)) => true,
        Some(_) | None => false,
    }
}

/// Seconds since 1970.
fn seconds(at: Timestamp) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "milliseconds fit for a hundred thousand years")]
    let millis = at.as_millisecond() as f64;
    millis / 1000.0
}

/// The whole map with one character a cell. `A` is an agent, or `a` if its light is off or it carries no food.
pub fn grid(world: &World) -> Vec<Vec<String>> {
    let seen = world.spectator_view();
    let mut grid: Vec<Vec<String>> =
        seen.grid.iter().map(|row| row.chars().map(String::from).collect()).collect();
    for agent in seen.agents.iter().filter(|agent| agent.alive) {
        if agent.light_on.or(agent.carrying_food) == Some(false) {
            let place = |n: i32| usize::try_from(n).ok();
            let cell = place(agent.at.i).zip(place(agent.at.j));
            let cell = cell.and_then(|(i, j)| grid.get_mut(i)?.get_mut(j));
            if let Some(cell) = cell {
                "a".clone_into(cell);
            }
        }
    }
    grid
}

/// An agent's window. Its own cell has its own number, marked as the cells of other agents are.
fn view(seen: &Observation, rules: RuleSet) -> Option<Vec<Vec<String>>> {
    let flag = seen.light_on.or(seen.carrying_food);
    let marked = flag.is_some_and(|flag| match rules {
        RuleSet::Paper => flag,
        RuleSet::Reference => !flag,
    });
    let own = Seen::Agent { number: seen.agent.0, marked };
    let cell = |cell: &Seen| match cell {
        Seen::Yourself => own.to_string(),
        other => other.to_string(),
    };
    let view = seen.view.as_ref()?;
    Some(view.rows().map(|row| row.iter().map(cell).collect()).collect())
}
