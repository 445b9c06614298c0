//! A page that contains a game and opens without a server.

use std::collections::{BTreeMap, VecDeque};
use std::ops::RangeInclusive;

use anyhow::{anyhow, ensure};
use serde_json::{Value, json};
use swarmbench_engine::{AgentId, World};
use swarmbench_journal::record::ActRecord;
use swarmbench_prompt::tasks;
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::replay::{AgentRound, Replay, ReplayHead, ReplayPage, ReplayState};
use swarmbench_protocol::status::Status;
use swarmbench_protocol::worth::GameWorth;
use swarmbench_replay::{
    Reel, Round, Scene, agent_round, block_cells, ground, inbox, rounded, shown_act,
};

use super::SinglePage;
use crate::journals::Outline;

/// Maximum bytes of a game in a page, as browsers open larger pages slowly.
const PAGE_GAME_BYTES_MAX: usize = 64 << 20;

/// Builder of a page. Gets every state of the game in order.
pub(super) struct GamePage {
    outline: Outline,
    wanted: RangeInclusive<u32>,
    with_prompts: bool,
    worth: Option<GameWorth>,
    single_page: SinglePage,
    begun: Option<Begun>,
    /// Data common to all wanted states.
    page: ReplayPage,
    states: Vec<ReplayState>,
    /// Observations and acts, by round and agent.
    acts: BTreeMap<String, Value>,
    bytes: usize,
}

/// The game up to its newest state.
struct Begun {
    reel: Reel,
    /// State before the newest round, in which the round was decided.
    before: World,
    /// Messages of the last rounds as sent: noise may change and delay may postpone their delivery.
    said: VecDeque<Vec<(AgentId, String)>>,
}

impl GamePage {
    pub(super) fn new(
        outline: Outline,
        wanted: RangeInclusive<u32>,
        with_prompts: bool,
        worth: Option<GameWorth>,
        single_page: SinglePage,
    ) -> Self {
        let page = ReplayPage { from: *wanted.start(), ..ReplayPage::default() };
        Self {
            outline,
            wanted,
            with_prompts,
            worth,
            single_page,
            begun: None,
            page,
            states: Vec::new(),
            acts: BTreeMap::new(),
            bytes: 0,
        }
    }

    /// Adds the state after a round, with the round's acts. The layout comes first, without acts.
    pub(super) fn add(&mut self, world: &World, acts: &[ActRecord]) -> anyhow::Result<()> {
        let Some(mut begun) = self.begun.take() else {
            let reel = Reel::of(world);
            let first = reel.first();
            self.keep(&reel, first.state, first.values);
            self.begun = Some(Begun { reel, before: world.clone(), said: VecDeque::new() });
            return Ok(());
        };
        if self.wanted.contains(&begun.before.round()) && world.round() <= *self.wanted.end() {
            self.add_acts(&begun, acts)?;
        }
        let frame = begun.reel.step(&Round::of(acts, world), Scene::of(world));
        self.keep(&begun.reel, frame.state, frame.values);
        begun.remember(acts, world);
        self.begun = Some(begun);
        ensure!(
            self.bytes <= PAGE_GAME_BYTES_MAX,
            "the game takes more than the limit page_game_bytes_max = {PAGE_GAME_BYTES_MAX}: select rounds with \
             --rounds{}",
            if self.with_prompts { ", or leave out --prompts" } else { "" }
        );
        Ok(())
    }

    fn keep(&mut self, reel: &Reel, state: ReplayState, values: Vec<Option<f64>>) {
        if !self.wanted.contains(&state.round) {
            return;
        }
        for (metric, value) in reel.metrics().iter().zip(values) {
            let series = self.page.metrics.entry(metric.name().to_owned()).or_default();
            series.push(value.map(rounded));
        }
        self.bytes += state.approximate_bytes();
        self.page.length += 1;
        self.states.push(state);
    }

    fn add_acts(&mut self, begun: &Begun, acts: &[ActRecord]) -> anyhow::Result<()> {
        let world = &begun.before;
        for act in acts {
            let agent = AgentId::parse(&act.agent).ok_or_else(|| anyhow!("an unknown agent"))?;
            let known = self.known(begun, agent, act.clone());
            let written = serde_json::to_value(&known)?;
            self.bytes += written.to_string().len();
            self.acts.insert(format!("{}/{}", world.round(), agent.0), written);
        }
        Ok(())
    }

    /// Observation of an agent before a round, and its act in the round.
    fn known(&self, begun: &Begun, agent: AgentId, act: ActRecord) -> AgentRound {
        let (opening, world) = (&self.outline.opening, &begun.before);
        let config = world.config();
        let (id, description) = (opening.episode.clone(), tasks::description(config));
        let sight = Sight::of(&world.observe(agent), id, description, Status::Running, None);
        let prompt = self.with_prompts.then(|| {
            swarmbench_prompt::render(&opening.prompt_template, &sight, config)
                .map_err(|problem| problem.to_string())
        });
        let original = |sent, sender| begun.said(sent, sender);
        let inbox = inbox(world, agent, original);
        agent_round(sight, inbox, prompt, Some(shown_act(act, None)))
    }

    /// The finished page.
    pub(super) fn finish(self) -> anyhow::Result<String> {
        let Self { outline, wanted, worth, single_page, page, states, acts, begun, .. } = self;
        let last = begun.ok_or_else(|| anyhow!("the journal has no layout"))?.before;
        let config = &outline.opening.config;
        let end = outline.end.as_ref();
        let (status, reason) =
            end.map_or(("running", None), |end| (end.status.as_str(), Some(end.reason.as_str())));
        let size = |cells: i64| u32::try_from(cells).unwrap_or_default();
        let head = ReplayHead {
            episode: outline.opening.episode.clone(),
            task: config.task.clone(),
            rules: Some(config.rules.clone()),
            control: Some(config.control.clone()),
            status: status.to_owned(),
            rounds: *wanted.end(),
            max_round: Some(last.config().max_round()),
            score: states.last().map_or(0.0, |state| state.score),
            width: size(config.width),
            height: size(config.height),
            num_agents: last.config().num_agents().into(),
            view_size: Some(size(config.view_size)),
            ground: Some(ground(last.board())),
            block_cells: block_cells(last.board()),
            next: None,
        };
        let summary = json!({
            "id": outline.opening.episode,
            "task": config.task,
            "model": config.model,
            "status": status,
            "run": outline.opening.run,
            "created_at": outline.opening.created_at,
            "config": config,
            "result": reason.map(|reason| {
                json!({ "reason": reason, "rounds": outline.last(), "score": outline.scores.last() })
            }),
        });
        let title = format!("{} · {}", config.task, config.model);
        let scores: Vec<f64> = std::iter::once(0.0).chain(outline.scores).collect();
        Ok(single_page(
            &title,
            &json!({
                "head": Replay { head, page },
                "states": states,
                "acts": acts,
                "scores": { "every": 1, "scores": scores },
                "summary": summary,
                "worth": worth,
            }),
        ))
    }
}

impl Begun {
    /// Records the messages of a round and the state after it.
    fn remember(&mut self, acts: &[ActRecord], world: &World) {
        let said = |act: &ActRecord| Some((AgentId::parse(&act.agent)?, act.message.clone()?));
        self.said.push_back(acts.iter().filter_map(said).collect());
        let delay = usize::try_from(world.config().settings().max_delay).unwrap_or_default();
        if self.said.len() > delay + 1 {
            self.said.pop_front();
        }
        self.before.clone_from(world);
    }

    /// Message of an agent in a round, if it is still remembered.
    fn said(&self, sent: u32, sender: AgentId) -> Option<String> {
        let age = self.before.round().checked_sub(sent)? as usize;
        let round = self.said.get(self.said.len().checked_sub(age)?)?;
        round.iter().find(|(agent, _)| *agent == sender).map(|(_, text)| text.clone())
    }
}
