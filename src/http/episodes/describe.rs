//! Requests for new episodes, checked.

use std::sync::Arc;

use swarmbench_engine::{AgentId, Config, Settings, TaskName};

use super::super::checks::{random_seed, short};
use super::super::prelude::*;
use crate::episode::spec::Spec;
use crate::hosted;
use swarmbench_protocol::episode::EpisodeRequest;

/// Validates a request for a new episode; all errors are reported at once.
pub(super) fn described(request: EpisodeRequest, app: &App) -> Result<Spec, ApiError> {
    let mut problems = Problems::default();
    let usual = Settings::default();
    let settings = Settings {
        task: request.task.clone().unwrap_or_default(),
        rules: request.rules.clone().unwrap_or_else(|| usual.rules.clone()),
        seed: request.seed.unwrap_or_else(|| random_seed(app)),
        ..request.over(usual)
    };
    let checked = if request.task.is_some() {
        Config::check(&settings).map_err(|errors| {
            for error in errors.0 {
                problems.refuse(error.field, error.problem);
            }
        })
    } else {
        problems.refuse("task", "is missing");
        Err(())
    };
    let task = request.task.as_deref().and_then(TaskName::parse);
    let game =
        DescribedGame { config: checked.ok().map(Arc::new), task, agents: settings.num_agents };
    spec(request, game, problems, app)
}

/// The simulation of an episode, as far as it is known.
pub(super) struct DescribedGame {
    pub(super) config: Option<Arc<Config>>,
    pub(super) task: Option<TaskName>,
    pub(super) agents: i64,
}

/// Validates all of a request that does not touch the simulation; all errors are reported at once.
pub(super) fn spec(
    request: EpisodeRequest,
    DescribedGame { config, task, agents }: DescribedGame,
    mut problems: Problems,
    app: &App,
) -> Result<Spec, ApiError> {
    let (round_deadline, bank, idle) =
        problems.clocks(request.round_deadline_s, request.bank_s, request.idle_timeout_s);
    let fill_after = request
        .fill_after_s
        .map(|value| problems.seconds("fill_after_s", Some(value), 0.0, 0.0, 604_800.0));
    let start = request.start.as_deref().unwrap_or("now");
    if !["now", "manual"].contains(&start) {
        problems.refuse("start", format!("must be one of now, manual, is {:?}", short(start)));
    }
    let visibility = problems.visibility(app, request.visibility.as_deref());
    let open = request.open_seats.unwrap_or(0);
    if !(0..=agents).contains(&open) {
        let problem = format!("must be from 0 to the number of agents, {agents}, is {open}");
        problems.refuse("open_seats", problem);
    }
    if fill_after.is_some() && open == 0 {
        problems.refuse("fill_after_s", "goes with `open_seats`: no seat is open");
    } else if fill_after.is_some_and(|after| after >= idle) {
        problems.refuse("fill_after_s", "must be less than idle_timeout_s");
    }
    if request.fill_with.is_some() && fill_after.is_none() {
        problems.refuse("fill_with", "goes with `fill_after_s`");
    }
    if request.player.is_some() && open > 0 && open == agents {
        let problem = "has no seat to play: all are open; `fill_with` names who fills open ones";
        problems.refuse("player", problem);
    }
    let mut built_in = |field: &str, name: &str| {
        hosted::player(name, task?).map_err(|problem| problems.refuse(field, problem)).ok()
    };
    let fill_with = fill_after.and_then(|_| {
        built_in("fill_with", request.fill_with.as_deref().unwrap_or(hosted::DEFAULT_PLAYER))
    });
    let player = request.player.as_deref().and_then(|name| built_in("player", name));
    let usual = || player.as_ref().map_or("unnamed".to_owned(), |name| format!("built-in/{name}"));
    let model = request.model.unwrap_or_else(usual);
    problems.model(&app.limits, &model);
    let agent_meta = request.agent_meta.unwrap_or_default();
    problems.agent_meta(&app.limits, &agent_meta);
    let template = swarmbench_prompt::chosen(request.prompt_template);
    problems.template(template.as_deref());
    let (checked, visibility) = problems.none_or(config.zip(visibility))?;
    let agents = checked.num_agents();
    let own = agents.saturating_sub(u16::try_from(open).unwrap_or(agents));
    Ok(Spec {
        config: checked,
        round_deadline,
        bank,
        manual_start: start == "manual",
        idle_timeout: idle,
        visibility,
        model,
        agent_meta,
        custom_template: template.is_some(),
        prompt_template: template.as_deref().unwrap_or(swarmbench_prompt::BUILT_IN).into(),
        prompt_revision: swarmbench_prompt::REVISION,
        run: None,
        salt: None,
        fork: None,
        closes_at: None,
        own_games: false,
        open_seats: (own..agents).map(AgentId).collect(),
        fill_after,
        fill_with,
        player,
        holders: Vec::new(),
    })
}
