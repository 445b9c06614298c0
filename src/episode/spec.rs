//! What an episode is, beyond its simulation: clocks, who may read it, who plays.

use std::collections::HashSet;
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::{AgentId, Config, RULES_REVISION, World};

use crate::ids::EpisodeId;
use swarmbench_clock::millis;
use swarmbench_journal::record::{self, FORMAT, Fork, Opening, RecordedConfig};
use swarmbench_protocol::carried::Carried;
pub use swarmbench_protocol::status::Visibility;

/// A checked description of an episode.
#[derive(Clone, Debug)]
pub struct Spec {
    pub config: Arc<Config>,
    /// How long a round lasts for a seat before its bank is touched; none without a clock.
    pub round_deadline: Option<Duration>,
    /// What a seat may overspend in all rounds together.
    pub bank: Duration,
    /// Whether it waits for a manual start.
    pub manual_start: bool,
    /// After how long without any act it ends as abandoned.
    pub idle_timeout: Duration,
    /// Who reads it before the end.
    pub visibility: Visibility,
    pub model: String,
    /// What else is known of who plays.
    pub agent_meta: Carried,
    pub prompt_template: Arc<str>,
    /// The revision of the program's own words in prompts when it was created.
    pub prompt_revision: u32,
    /// Whether the template is the episode's own.
    pub custom_template: bool,
    /// The public id of the run to which it belongs.
    pub run: Option<String>,
    /// Random digits in the opening of a sealed episode.
    pub salt: Option<String>,
    /// From which state of another episode it continues.
    pub fork: Option<Fork>,
    /// From then on no new round begins.
    pub closes_at: Option<Timestamp>,
    /// Whether its owner reads it once it has ended, also while it is sealed; no part of the journal.
    pub own_games: bool,
    pub open_seats: Vec<AgentId>,
    /// After how long built-in players take the open seats that nobody claimed.
    pub fill_after: Option<Duration>,
    /// Which built-in player takes them.
    pub fill_with: Option<String>,
    /// The built-in player that the server hosts on the creator's seats.
    pub player: Option<String>,
}

impl Spec {
    /// Whether boards count the episode: it belongs to a run, or several holders play it, and it is no fork.
    pub fn counts(&self) -> bool {
        (self.run.is_some() || self.is_mixed()) && self.fork.is_none()
    }

    /// The first round that is decided in the episode itself; a fork took over those before.
    pub fn first_round(&self) -> u32 {
        self.fork.as_ref().map_or(0, |fork| fork.round)
    }

    pub fn agents(&self) -> impl Iterator<Item = AgentId> + use<> {
        (0..self.config.num_agents()).map(AgentId)
    }

    /// Whether its creator plays for this agent: its seat was not open, and the server does not play it.
    pub fn is_creators(&self, agent: AgentId) -> bool {
        self.player.is_none() && !self.open_seats.contains(&agent)
    }

    /// Whether its seats belong to several holders.
    pub fn is_mixed(&self) -> bool {
        !self.open_seats.is_empty()
    }

    /// Whether the server may play seats of it.
    pub fn may_be_hosted(&self) -> bool {
        self.player.is_some() || self.fill_after.is_some()
    }

    /// Whether the server plays all seats: no client waits for its rounds.
    pub fn is_all_hosted(&self) -> bool {
        self.player.is_some() && !self.is_mixed()
    }

    /// How many seats the server plays at most.
    pub fn hosted_max(&self) -> usize {
        let open = self.open_seats.len();
        let own = usize::from(self.config.num_agents()) - open;
        let filled = if self.fill_after.is_some() { open } else { 0 };
        filled + if self.player.is_some() { own } else { 0 }
    }

    /// Whether its journal says who holds which seat.
    pub fn is_seated(&self) -> bool {
        self.is_mixed() || self.player.is_some()
    }

    /// Whether it waits for something before its first round.
    pub fn begins_waiting(&self) -> bool {
        self.manual_start || self.is_mixed()
    }

    /// Whether it advances without requests: a clock runs, or the server plays.
    pub fn advances_by_itself(&self) -> bool {
        self.round_deadline.is_some() || self.may_be_hosted()
    }

    /// All settings, as the opening record has them.
    pub fn recorded(&self) -> RecordedConfig {
        RecordedConfig {
            round_deadline_ms: self.round_deadline.map(millis),
            bank_ms: millis(self.bank),
            start: if self.manual_start { "manual" } else { "now" }.to_owned(),
            idle_timeout_ms: millis(self.idle_timeout),
            visibility: self.visibility.name().to_owned(),
            model: self.model.clone(),
            custom_template: self.custom_template,
            closes_at: self.closes_at,
            open_seats: self.open_seats.iter().map(|agent| agent.0).collect(),
            fill_after_ms: self.fill_after.map(millis),
            fill_with: self.fill_with.clone(),
            player: self.player.clone(),
            ..RecordedConfig::of(&self.config)
        }
    }

    /// The opening record of an episode that is laid out as `world`.
    pub fn opening(&self, id: &EpisodeId, created_at: Timestamp, world: &World) -> record::Record {
        record::Record::Opening(Box::new(Opening {
            format: FORMAT,
            episode: id.to_string(),
            rules_revision: RULES_REVISION,
            created_at,
            config: self.recorded(),
            agent_meta: self.agent_meta.clone(),
            prompt_template: self.prompt_template.to_string(),
            prompt_revision: self.prompt_revision,
            digest: world.digest().to_string(),
            run: self.run.clone(),
            salt: self.salt.clone(),
            fork: self.fork.clone(),
        }))
    }

    /// Reads an episode's description back from its opening record.
    pub fn from_opening(opening: &Opening) -> Result<Self, String> {
        if opening.rules_revision != RULES_REVISION {
            return Err(format!("rules revision {} is not played here", opening.rules_revision));
        }
        Ok(Self {
            run: opening.run.clone(),
            salt: opening.salt.clone(),
            fork: opening.fork.clone(),
            prompt_revision: opening.prompt_revision,
            ..Self::of(&opening.config, &opening.agent_meta, &opening.prompt_template)?
        })
    }

    /// An episode of its own by these settings.
    pub fn of(
        config: &RecordedConfig,
        agent_meta: &Carried,
        prompt_template: &str,
    ) -> Result<Self, String> {
        let visibility = Visibility::parse(&config.visibility);
        Ok(Self {
            config: Arc::new(config.engine().map_err(|error| error.to_string())?),
            round_deadline: config.round_deadline_ms.map(Duration::from_millis),
            bank: Duration::from_millis(config.bank_ms),
            manual_start: config.start == "manual",
            idle_timeout: Duration::from_millis(config.idle_timeout_ms),
            visibility: visibility.ok_or_else(|| format!("visibility {:?}", config.visibility))?,
            model: config.model.clone(),
            agent_meta: Carried(shared(&agent_meta.0)),
            prompt_template: shared(prompt_template),
            prompt_revision: swarmbench_prompt::REVISION,
            custom_template: config.custom_template,
            run: None,
            salt: None,
            fork: None,
            closes_at: config.closes_at,
            own_games: false,
            open_seats: config.open_seats.iter().map(|&agent| AgentId(agent)).collect(),
            fill_after: config.fill_after_ms.map(Duration::from_millis),
            fill_with: config.fill_with.clone(),
            player: config.player.clone(),
        })
    }
}

/// The one copy of a text that games have in common: what is declared of their player, and the template of their prompts.
fn shared(text: &str) -> Arc<str> {
    static TEXTS: LazyLock<Mutex<HashSet<Arc<str>>>> = LazyLock::new(Mutex::default);
    let mut texts = TEXTS.lock().expect("nothing panics while it holds this");
    if let Some(known) = texts.get(text) {
        return Arc::clone(known);
    }
    if texts.len() == texts.capacity() {
        texts.retain(|text| Arc::strong_count(text) > 1);
        let kept = texts.len();
        texts.reserve(kept + 1);
    }
    let text = Arc::from(text);
    texts.insert(Arc::clone(&text));
    text
}

#[cfg(test)]
mod tests {
    use allocation_counter::measure;
    use swarmbench_engine::{Settings, TaskName};

    use super::*;

    /// Games of a run, and those that are recovered after a restart, have one copy of what they have in common.
    #[test]
    fn games_keep_what_is_declared_of_their_player_once_and_as_text() {
        let meta = format!(r#"{{"x":[{}]}}"#, vec![r#"{"":0}"#; 1990].join(","));
        let settings = Settings::standard(TaskName::Foraging, 1);
        let config = RecordedConfig::of(&Config::check(&settings).expect("good settings"));
        let config = RecordedConfig { visibility: "public".to_owned(), ..config };
        let template = "t".repeat(32_000);
        let meta: Carried = serde_json::from_str(&meta).expect("an object");
        let spec = Spec::of(&config, &meta, &template).expect("a good spec");
        let world = World::new(Arc::clone(&spec.config));
        let id = EpisodeId::from_text("ep_1".to_owned());
        let opening = spec.opening(&id, Timestamp::UNIX_EPOCH, &world);
        let opening = serde_json::to_string(&opening).expect("string keys");
        let mut recovered = Vec::with_capacity(100);
        let counted = measure(|| {
            for _ in 0..100 {
                let Ok(record::Record::Opening(opening)) = record::Record::parse(&opening) else {
                    return;
                };
                recovered.extend(Spec::from_opening(&opening));
            }
        });
        assert_eq!(recovered.len(), 100);
        assert!(
            recovered
                .iter()
                .all(|spec| Arc::ptr_eq(&spec.agent_meta.0, &recovered[0].agent_meta.0))
        );
        assert!(counted.bytes_max < 300_000, "{counted:?}");
    }
}
