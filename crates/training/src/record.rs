//! Acts of an episode, and their products: states that can be loaded elsewhere, and journals.

use serde::{Deserialize, Serialize};
use swarmbench_engine::{
    Act, AgentId, Config, Message, RULES_REVISION, Scratch, SettingErrors, World,
};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{
    Decision, End, FORMAT, Opening, RawRecord, Record, RecordedConfig, Round,
};

use swarmbench_protocol::carried::Carried;

use crate::environment::action;

/// The acts of an episode so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Recording {
    /// Codes of actions, round by round, of all agents.
    codes: Vec<u8>,
    /// The messages, in order.
    said: Vec<Words>,
}

/// A message of an agent.
#[derive(Clone, Debug, PartialEq)]
struct Words {
    round: u32,
    agent: AgentId,
    text: Message,
    to: Option<AgentId>,
}

/// A state that cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The bytes are not a state.
    #[error("these are not the bytes of a state: {0}")]
    Format(#[from] serde_json::Error),
    /// The state was made under another revision of the rules.
    #[error("it was made under revision {made} of the rules, and this is revision {here}")]
    Revision {
        /// The revision under which it was made.
        made: u32,
        /// The revision of this engine.
        here: u32,
    },
    /// The settings cannot be played.
    #[error("its settings cannot be played: {0}")]
    Settings(#[from] SettingErrors),
    /// The state is of a game with other settings than the batch.
    #[error("it is of a game with other settings: {0}")]
    OtherGame(String),
    /// The acts are not valid.
    #[error("its acts are not those of a game: {0}")]
    Acts(&'static str),
}

/// A state as it is stored: the settings, and all acts that led to it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stored {
    rules_revision: u32,
    config: RecordedConfig,
    /// The indices of the agents' actions among those of the task, by round, as letters; `-` is no action.
    acts: Vec<String>,
    said: Vec<StoredWords>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredWords {
    round: u32,
    agent: u16,
    text: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    to: Option<u16>,
}

impl Recording {
    pub(crate) fn clear(&mut self) {
        self.codes.clear();
        self.said.clear();
    }

    pub(crate) fn add(&mut self, round: u32, codes: &[u8], acts: &[Act]) {
        self.codes.extend_from_slice(codes);
        for (act, agent) in acts.iter().zip((0..).map(AgentId)) {
            if let Some(text) = &act.message {
                self.said.push(Words { round, agent, text: text.clone(), to: act.to });
            }
        }
    }

    /// The acts of each round.
    fn rounds<'a>(&'a self, config: &'a Config) -> impl Iterator<Item = (u32, Vec<Act>)> + 'a {
        let task = config.task();
        let mut said = self.said.iter().peekable();
        let rounds = self.codes.chunks_exact(config.num_agents().into()).zip(0..);
        rounds.map(move |(codes, round)| {
            let acts = codes.iter().map(|&code| Act {
                action: action(task, code),
                message: None,
                to: None,
            });
            let mut acts: Vec<Act> = acts.collect();
            while let Some(words) = said.next_if(|words| words.round == round) {
                let act = &mut acts[words.agent.index()];
                (act.message, act.to) = (Some(words.text.clone()), words.to);
            }
            (round, acts)
        })
    }

    /// The state as bytes.
    pub(crate) fn to_bytes(&self, config: &Config) -> Vec<u8> {
        let letter = |&code: &u8| if code < 26 { char::from(b'a' + code) } else { '-' };
        let stored = Stored {
            rules_revision: RULES_REVISION,
            config: RecordedConfig::of(config),
            acts: (self.codes.chunks_exact(config.num_agents().into()))
                .map(|codes| codes.iter().map(letter).collect())
                .collect(),
            said: (self.said.iter())
                .map(|words| StoredWords {
                    round: words.round,
                    agent: words.agent.0,
                    text: words.text.to_string(),
                    to: words.to.map(|to| to.0),
                })
                .collect(),
        };
        serde_json::to_vec(&stored).expect("a state has string keys")
    }

    /// Reads bytes back: the settings, and the acts round by round with their codes.
    pub(crate) fn read(bytes: &[u8]) -> Result<(Config, Self), StateError> {
        let stored: Stored = serde_json::from_slice(bytes)?;
        if stored.rules_revision != RULES_REVISION {
            let (made, here) = (stored.rules_revision, RULES_REVISION);
            return Err(StateError::Revision { made, here });
        }
        let config = stored.config.engine()?;
        let agents = usize::from(config.num_agents());
        let limit = usize::try_from(config.max_round()).unwrap_or(usize::MAX);
        if stored.acts.len() > limit {
            return Err(StateError::Acts("there are more rounds than the game has"));
        }
        let mut recording = Self::default();
        for letters in &stored.acts {
            if letters.len() != agents {
                return Err(StateError::Acts("a round has not one act of each agent"));
            }
            for letter in letters.bytes() {
                let code = if letter == b'-' { u8::MAX } else { letter.wrapping_sub(b'a') };
                if code != u8::MAX && action(config.task(), code).is_none() {
                    return Err(StateError::Acts("an action is not one of the task"));
                }
                recording.codes.push(code);
            }
        }
        for words in stored.said {
            let known = |agent: u16| usize::from(agent) < agents;
            let in_order = recording
                .said
                .last()
                .is_none_or(|last| (last.round, last.agent.0) < (words.round, words.agent));
            let text = Message::new(&words.text).filter(|text| text.as_str() == words.text);
            let to = words.to.map(AgentId);
            match text {
                Some(text) if in_order && known(words.agent) && words.to.is_none_or(known) => {
                    let agent = AgentId(words.agent);
                    recording.said.push(Words { round: words.round, agent, text, to });
                }
                _ => return Err(StateError::Acts("a message is not one of the game")),
            }
        }
        Ok((config, recording))
    }

    /// Plays the acts from the layout of their seed.
    pub(crate) fn play(&self, config: &std::sync::Arc<Config>) -> Result<World, StateError> {
        let mut world = World::new(config.clone());
        let mut scratch = Scratch::default();
        for (_, acts) in self.rounds(config) {
            if world.is_over() {
                return Err(StateError::Acts("there are acts after the end"));
            }
            world.step_in(&acts, &mut scratch);
        }
        Ok(world)
    }

    /// The journal of the episode, as a file that `swarmbench verify` reads.
    pub(crate) fn journal(
        &self,
        config: &std::sync::Arc<Config>,
        episode: String,
        created_at: jiff::Timestamp,
        prompt_template: &str,
    ) -> String {
        let mut world = World::new(config.clone());
        let mut file = File { text: String::new(), head: Head::START };
        file.add(&Record::Opening(Box::new(Opening {
            format: FORMAT,
            episode,
            rules_revision: RULES_REVISION,
            created_at,
            config: RecordedConfig {
                idle_timeout_ms: IDLE_TIMEOUT_MS,
                visibility: "public".to_owned(),
                model: "in process".to_owned(),
                ..RecordedConfig::of(config)
            },
            agent_meta: Carried::default(),
            prompt_template: prompt_template.to_owned(),
            prompt_revision: swarmbench_prompt::REVISION,
            digest: world.digest().to_string(),
            run: None,
            salt: None,
            fork: None,
        })));
        let mut scratch = Scratch::default();
        for (round, acts) in self.rounds(config) {
            let living = world.agents().zip(&acts).filter(|(agent, _)| world.is_alive(*agent));
            let records = living
                .map(|(agent, act)| Decision::of_player(act.clone()).record(agent, 0))
                .collect();
            world.step_in(&acts, &mut scratch);
            file.add(&Record::Round(Round {
                round,
                acts: records,
                digest: world.digest().to_string(),
                score: world.score(),
            }));
        }
        if world.is_over() {
            let reason = if world.is_done() { "task_done" } else { "rounds_played" };
            file.add(&Record::End(End {
                status: "finished".to_owned(),
                reason: reason.to_owned(),
                rounds: world.round(),
                score: world.score(),
                open_acts: Vec::new(),
            }));
        }
        file.text
    }
}

/// The default idle timeout of hosted episodes.
const IDLE_TIMEOUT_MS: u64 = 86_400_000;

/// A writer of a journal file.
struct File {
    text: String,
    head: Head,
}

impl File {
    fn add(&mut self, record: &Record) {
        let raw = RawRecord::write(record);
        self.head = self.head.link(raw.as_str().as_bytes());
        self.text.push_str(&raw.line(self.head));
    }
}
