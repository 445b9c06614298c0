//! Specification of an episode beyond its simulation: clocks, readers, players.

use std::collections::HashSet;
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Duration;

use jiff::Timestamp;
use swarmbench_engine::{AgentId, Config, RULES_REVISION, World};

use crate::ids::EpisodeId;
use swarmbench_clock::millis;
use swarmbench_journal::record::{self, FORMAT, Fork, Opening, RecordedConfig, TeamHolder};
use swarmbench_protocol::carried::Carried;
pub use swarmbench_protocol::status::Visibility;

/// A checked specification of an episode.
#[derive(Clone, Debug)]
pub struct Spec {
    pub config: Arc<Config>,
    /// Length of a round before banks are touched; `None` without a clock.
    pub round_deadline: Option<Duration>,
    /// Time that each seat may overspend over all rounds.
    pub bank: Duration,
    /// Whether the episode waits for a manual start.
    pub manual_start: bool,
    /// Time without any act after which the episode is abandoned.
    pub idle_timeout: Duration,
    /// Readers of the episode before its end.
    pub visibility: Visibility,
    pub model: String,
    /// Anything else that is declared of the player.
    pub agent_meta: Carried,
    pub prompt_template: Arc<str>,
    /// Revision of the program's own words in prompts, at the creation of the episode.
    pub prompt_revision: u32,
    /// Whether the template is the episode's own.
    pub custom_template: bool,
    /// Public id of the episode's run.
    pub run: Option<String>,
    /// Random digits in the opening of a sealed episode.
    pub salt: Option<String>,
    /// State of another episode from which this one continues.
    pub fork: Option<Fork>,
    /// Time from which no new round begins.
    pub closes_at: Option<Timestamp>,
    /// Whether its owner may read it once it has ended, even while it is sealed; not in the journal.
    pub own_games: bool,
    pub open_seats: Vec<AgentId>,
    /// Time after which a built-in player takes the open seats that nobody claimed.
    pub fill_after: Option<Duration>,
    /// Name of that built-in player.
    pub fill_with: Option<String>,
    /// Name of the built-in player that the server hosts on the creator's seats.
    pub player: Option<String>,
    /// Holders of a team, which has all seats from the creation on; holder 1 is the first.
    pub holders: Vec<TeamHolder>,
}

impl Spec {
    /// Whether boards count the episode: it belongs to a run, or several holders play it, and it is no fork.
    pub fn counts(&self) -> bool {
        (self.run.is_some() || self.is_mixed()) && self.fork.is_none()
    }

    /// First round that is played in the episode itself; a fork took over the earlier ones.
    pub fn first_round(&self) -> u32 {
        self.fork.as_ref().map_or(0, |fork| fork.round)
    }

    pub fn agents(&self) -> impl Iterator<Item = AgentId> + use<> {
        (0..self.config.num_agents()).map(AgentId)
    }

    /// Whether the creator plays for this agent: its seat was not open, no team has it, and the server does not play it.
    pub fn is_creators(&self, agent: AgentId) -> bool {
        self.player.is_none() && self.holders.is_empty() && !self.open_seats.contains(&agent)
    }

    /// Whether holder `number` of a team plays for this agent.
    pub fn is_of_team_holder(&self, number: u32, agent: AgentId) -> bool {
        let holder = (number as usize).checked_sub(1).and_then(|place| self.holders.get(place));
        holder.is_some_and(|holder| holder.player.is_none() && holder.seats.contains(&agent.0))
    }

    /// Whether several holders have seats.
    pub fn is_mixed(&self) -> bool {
        !self.open_seats.is_empty() || !self.holders.is_empty()
    }

    /// Whether the server may play seats.
    pub fn may_be_hosted(&self) -> bool {
        let is_hosted = |holder: &TeamHolder| holder.player.is_some();
        self.player.is_some() || self.fill_after.is_some() || self.holders.iter().any(is_hosted)
    }

    /// Whether the server plays all seats: no client waits for rounds.
    pub fn is_all_hosted(&self) -> bool {
        let is_hosted = |holder: &TeamHolder| holder.player.is_some();
        match self.holders.as_slice() {
            [] => self.player.is_some() && !self.is_mixed(),
            holders => holders.iter().all(is_hosted),
        }
    }

    /// Maximum number of seats that the server plays.
    pub fn hosted_max(&self) -> usize {
        if !self.holders.is_empty() {
            let hosted = self.holders.iter().filter(|holder| holder.player.is_some());
            return hosted.map(|holder| holder.seats.len()).sum();
        }
        let open = self.open_seats.len();
        let own = usize::from(self.config.num_agents()) - open;
        let filled = if self.fill_after.is_some() { open } else { 0 };
        filled + if self.player.is_some() { own } else { 0 }
    }

    /// Whether the journal records the holders of seats.
    pub fn is_seated(&self) -> bool {
        self.is_mixed() || self.player.is_some()
    }

    /// Whether the episode waits for something before its first round.
    pub fn begins_waiting(&self) -> bool {
        self.manual_start || !self.open_seats.is_empty()
    }

    /// Whether the episode advances without requests: a clock runs, or the server plays.
    pub fn advances_by_itself(&self) -> bool {
        self.round_deadline.is_some() || self.may_be_hosted()
    }

    /// The longest that a round with a clock takes.
    pub fn round_max(&self) -> Duration {
        self.round_deadline.unwrap_or_default().saturating_add(self.bank)
    }

    /// Settings, as the opening record has them.
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
            holders: self.holders.clone(),
            ..RecordedConfig::of(&self.config)
        }
    }

    /// Opening record of an episode whose layout is `world`.
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

    /// Reads a specification from an opening record.
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

    /// Specification with these settings, of an episode that belongs to no run and is no fork.
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
            holders: config.holders.clone(),
        })
    }
}

/// Interns texts that games share: what is declared of their players, and the template of their prompts.
pub(super) fn shared(text: &str) -> Arc<str> {
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

    /// Games of a run, also after a recovery, share one copy of what they have in common.
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
