//! `GET /api/v1/episodes/{id}/replay`.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use serde::Deserialize;
use swarmbench_engine::World;
use utoipa::IntoParams;

use super::super::answer::{joined, json};
use super::super::extract::optional_flag;
use super::super::prelude::*;
use super::super::replay_pages::{PageKey, ReplayedGame, WrittenPage};
use crate::episode::Snapshot;
use crate::episode::actor::Handle;
use crate::episode::replay::{Rounds, state_at};
use crate::fair::Party;
use crate::store::port::RoundActs;
use swarmbench_protocol::replay::{Replay, ReplayHead, ReplayPage, ReplayState};
use swarmbench_replay::{
    PAGE_BYTES_MAX, PageMaker, ROUNDS_BEFORE, ROUNDS_MAX, Reel, Round, Scene, block_cells, ground,
    rounds_of_page,
};

/// Microseconds for which an agent's part of a state is made, at most.
const MICROS_OF_AN_AGENT: u64 = 10;

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in super::super) struct ReplayParams {
    /// First state; by default 0, the layout.
    pub(in super::super) from: Option<u32>,
    /// Number of rounds after it, up to 100, which is also the default. Pages of games of many agents have fewer.
    #[param(minimum = 1, maximum = 100)]
    rounds: Option<u32>,
    /// Whether to add the cells that never change; true by default.
    #[serde(default, deserialize_with = "optional_flag")]
    ground: Option<bool>,
}

impl ReplayParams {
    /// The first state and the last one that a page may have, of a game with these rounds and agents.
    pub(in super::super) fn range(&self, newest: u32, agents: u32) -> Result<(u32, u32), ApiError> {
        let rounds = self.rounds.unwrap_or(ROUNDS_MAX);
        if !(1..=ROUNDS_MAX).contains(&rounds) {
            let detail = format!("rounds must be from 1 to {ROUNDS_MAX}, is {rounds}");
            let most = ROUNDS_MAX as usize;
            return Err(ApiError::limit(Code::Malformed, "replay_rounds_max", most, detail));
        }
        let from = self.from.unwrap_or(0);
        if from > newest {
            let detail = format!("the game has {newest} resolved rounds, and no state {from}");
            return Err(ApiError::new(Code::NotFound, detail).at_round(newest));
        }
        Ok((from, newest.min(from.saturating_add(rounds_of_page(rounds, agents)))))
    }

    pub(in super::super) fn wants_ground(&self) -> bool {
        self.ground != Some(false)
    }
}

/// Read the states of an episode, a page of rounds at a time.
///
/// A page has positions, decisions, messages with their readers, and metrics of each round. While several holders play,
/// decisions are left out. Pages overlap by one state; the open round is never shown.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/replay",
    operation_id = "show_replay",
    tag = "episodes",
    params(ReplayParams),
    responses(
        (status = 200, description = "The states", body = Replay),
        (status = 403, description = "`forbidden`: only the creator may read them before the end"),
        (status = 404, description = "`not_found`: no such episode, or the round has not come yet"),
        (status = 503, description = "`overloaded`: too many episodes are being replayed"),
    )
)]
pub(in super::super) async fn show_replay(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Params(params): Params<ReplayParams>,
) -> Result<Response, ApiError> {
    let stored = app.readable_episode(&caller, id).await?;
    let has_decisions = super::may_see_decisions(&app, &caller, &stored)?;
    let handle = app.episode(&stored.id).await?;
    let snapshot = handle.snapshot();
    let newest = snapshot.world.round();
    let agents = snapshot.world.config().num_agents().into();
    let (from, to) = params.range(newest, agents)?;
    let key = PageKey { game: ReplayedGame::Episode(handle.key), from, to, has_decisions };
    let page = Box::pin(app.replay_pages.page(key, app.write_page(&handle, key))).await?;
    let next = (page.last < newest).then_some(page.last);
    Ok(json(joined(&head(&handle, &snapshot, params.wants_ground(), next), &page.json)))
}

fn head(handle: &Handle, snapshot: &Snapshot, with_ground: bool, next: Option<u32>) -> ReplayHead {
    let (world, config) = (&snapshot.world, &handle.spec.config);
    let settings = config.settings();
    let size = |cells: i64| u32::try_from(cells).expect("a checked setting");
    ReplayHead {
        episode: handle.id.to_string(),
        task: settings.task,
        rules: Some(settings.rules),
        control: Some(settings.control),
        status: snapshot.status.name().to_owned(),
        rounds: world.round(),
        max_round: Some(config.max_round()),
        score: world.score(),
        width: size(settings.width),
        height: size(settings.height),
        num_agents: config.num_agents().into(),
        view_size: Some(size(settings.view_size)),
        ground: with_ground.then(|| ground(world.board())),
        block_cells: block_cells(world.board()),
        next,
    }
}

/// The last states of a page, and the page.
struct Filming {
    page: PageMaker,
    worlds: VecDeque<Arc<World>>,
}

impl Filming {
    fn see(&mut self, acts: &RoundActs, world: &Arc<World>) {
        if self.page.is_full() {
            return;
        }
        let acts = acts.iter().map(|(_, act)| &act.record);
        self.page.add_round(&Round::of(acts, world), Scene::of(world));
        if self.worlds.len() > ROUNDS_BEFORE as usize {
            self.worlds.pop_front();
        }
        self.worlds.push_back(Arc::clone(world));
    }
}

impl App {
    /// Replays the rounds of a page.
    async fn write_page(&self, handle: &Handle, key: PageKey) -> Result<WrittenPage, ApiError> {
        let host = self.registry.host();
        // The page, and the same as JSON.
        let _memory = self.registry.room(2 * PAGE_BYTES_MAX)?;
        let _permit = self.heavy.replay().await?;
        let begin = key.from.saturating_sub(ROUNDS_BEFORE);
        let world = state_at(host, handle, begin, None).await?;
        let rounds = Rounds {
            id: &handle.id,
            key: handle.key,
            to: key.to,
            checked: false,
            work: ("replay", Party::current()),
            see_micros: MICROS_OF_AN_AGENT * u64::from(handle.spec.config.num_agents()),
        };
        let page = PageMaker::new(Reel::of(&world), key.from);
        let filming = Filming { page, worlds: VecDeque::from([Arc::clone(&world)]) };
        let (_, Filming { page, worlds }) = rounds.play(host, world, filming, Filming::see).await?;
        if let Some(world) = worlds.front() {
            // The next page begins with it.
            host.replays.keep((handle.key, world.round()), world);
        }
        let mut page = page.finish();
        if !key.has_decisions {
            page = without_decisions(page);
        }
        Ok(WrittenPage::of(&page))
    }
}

/// The page with the states alone.
fn without_decisions(page: ReplayPage) -> ReplayPage {
    let states = page.states.into_iter().map(ReplayState::without_decisions).collect();
    ReplayPage { metrics: BTreeMap::new(), states, ..page }
}
