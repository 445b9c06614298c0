//! `POST /api/v1/runs`.

use std::collections::HashSet;

use axum::Extension;
use axum::http::HeaderMap;
use swarmbench_engine::{Config, RuleSet, Seed, SeedError, Settings, TaskName};

use super::super::answer;
use super::super::auth::Credential;
use super::super::checks::short;
use super::super::client::Client;
use super::super::idempotency::{created_before, idempotency};
use super::super::limits::Limits;
use super::super::prelude::*;
use super::Known;
use crate::hosted;
use crate::run::definition::Definition;
use crate::run::manager::{NewRun, token_holders};
use swarmbench_clock::millis;
use swarmbench_protocol::run::{
    CreatedRun, HolderRequest, HolderToken, OwnSuite, RunHolder, RunRequest, SuiteRequest,
};
use swarmbench_protocol::suite::{Suite, SuiteSettings};

/// Games of a run that are open at a time if its creator does not say.
const RUN_PARALLEL_DEFAULT: u32 = 4;

/// Start a run: a suite of games for one model, or for a team of several.
///
/// The answer has one token for all seats of all games, or one for each holder of a team, shown only once. Games are opened in the order of the plan as others
/// end. A repeat with the same `Idempotency-Key` and body returns the same run with a new token and revokes the earlier one.
#[utoipa::path(
    post,
    path = "/api/v1/runs",
    operation_id = "create_run",
    tag = "runs",
    params(("Idempotency-Key" = Option<String>, Header, description = "Any text of at most 200 characters that names this creation")),
    request_body(content = RunRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The run, with its token", body = CreatedRun),
        (status = 403, description = "`forbidden`: the token of an episode cannot create one; a server without keys is open only to programs on its own machine; the key's share of the journal is used up"),
    )
)]
pub(in super::super) async fn create_run(
    State(app): State<App>,
    caller: Caller,
    credential: Credential,
    Extension(client): Extension<Client>,
    _: Params<Nothing>,
    headers: HeaderMap,
    request: Unread,
) -> Result<Response, ApiError> {
    let creator = caller.creator(&app, client)?;
    let (request, body) = request.read::<RunRequest>(&app).await?;
    let idempotency = idempotency(&headers, creator.0.owner(), &body, &app.limits)?;
    let definition = definition(request, &app)?;
    // A repeat must find what the first one creates, also if its client hangs up.
    detached(async move {
        let _lock = app.creations.lock_key(idempotency.as_ref()).await;
        let find = |key| app.store.run_created_with(key);
        let (stored, tokens) = match created_before(idempotency.as_ref(), find).await? {
            None => {
                check_new(&definition.suite)?;
                let new = NewRun::by(creator.0, creator.1, definition);
                app.runs.create(NewRun { idempotency, credential: credential.0, ..new }).await?
            }
            Some(stored) => {
                let tokens = match token_holders(&definition) {
                    holders if holders.is_empty() => Vec::new(),
                    holders => app.new_run_tokens(stored.run, holders, credential, None).await?,
                };
                (stored, tokens)
            }
        };
        let location = format!("/api/v1/runs/{}", stored.id);
        let known = Known::of(&app, stored)?;
        let run = app.run_detail(&caller, &known, known.open_seeds(&app, &caller)).await?;
        let (mut swarm_token, mut holder_tokens) = (None, Vec::new());
        for (holder, token) in tokens {
            let token = token.reveal().to_owned();
            match holder.and_then(|number| run.run.holders.get(number as usize - 1)) {
                None => swarm_token = Some(token),
                Some(holder) => holder_tokens
                    .push(HolderToken { holder: holder.name.clone(), swarm_token: token }),
            }
        }
        Ok(answer::created(&location, CreatedRun { run, swarm_token, holder_tokens }))
    })
    .await
}

/// Validates the request; all errors are reported at once.
fn definition(request: RunRequest, app: &App) -> Result<Definition, ApiError> {
    let limits = &app.limits;
    let mut problems = Problems::default();
    let rules = request.rules.unwrap_or_else(|| Settings::default().rules);
    let has_rules = RuleSet::ALL.iter().any(|known| known.name() == rules);
    if !has_rules {
        let problem = format!("must be one of paper, reference, is {:?}", short(&rules));
        problems.refuse("rules", problem);
    }
    let suite = match request.suite {
        None => {
            problems.refuse("suite", "is missing");
            None
        }
        Some(SuiteRequest::Named(name)) => {
            let suite = Suite::built_in(&name, &rules);
            if suite.is_none() {
                let names = Suite::BUILT_IN.join(", ");
                let problem =
                    format!("must be one of {names}, or an object, is {:?}", short(&name));
                problems.refuse("suite", problem);
            }
            suite
        }
        Some(SuiteRequest::Own(own)) => own_suite(*own, &rules, app, &mut problems),
    };
    let (round_deadline, bank, idle) =
        problems.clocks(request.round_deadline_s, request.bank_s, request.idle_timeout_s);
    let suite = suite.map(|mut suite| {
        suite.settings.round_deadline_ms = round_deadline.map(millis);
        suite.settings.bank_ms = millis(bank);
        suite
    });
    let alone = [
        ("player", request.player.is_some()),
        ("temperature", request.temperature.is_some()),
        ("top_p", request.top_p.is_some()),
    ];
    for (field, _) in alone.iter().filter(|(_, is_said)| *is_said && request.holders.is_some()) {
        problems.refuse(field, "goes without `holders`, each of which has its own");
    }
    let agents = suite.as_ref().map(|suite| suite.settings.num_agents);
    let holders = request.holders.map(|holders| team(holders, agents, limits, &mut problems));
    let holders = holders.unwrap_or_default();
    if let (Some(suite), true) = (&suite, has_rules) {
        let of_holders = holders.iter().filter_map(|holder| holder.player.as_deref());
        let players: Vec<&str> = request.player.as_deref().into_iter().chain(of_holders).collect();
        check_games(suite, &players, &mut problems);
    }
    let usual = || request.player.as_ref().map(|player| format!("built-in/{player}"));
    let model = request.model.or_else(usual).unwrap_or_default();
    problems.model(limits, &model);
    problems.sampling(request.temperature, request.top_p);
    let meta = request.agent_meta.unwrap_or_default();
    problems.agent_meta(limits, &meta);
    let prompt_template = swarmbench_prompt::chosen(request.prompt_template);
    problems.template(prompt_template.as_deref());
    let parallel = request.parallel.unwrap_or(RUN_PARALLEL_DEFAULT);
    let most = limits.run_parallel_max;
    if !(1..=most).contains(&parallel) {
        problems.refuse("parallel", format!("must be from 1 to {most}, is {parallel}"));
    }
    let visibility = problems.visibility(app, request.visibility.as_deref());
    let (suite, visibility) = problems.none_or(suite.zip(visibility))?;
    Ok(Definition {
        suite,
        model,
        temperature: request.temperature,
        top_p: request.top_p,
        meta,
        prompt_template,
        prompt_revision: swarmbench_prompt::REVISION,
        player: request.player,
        holders,
        parallel,
        visibility: visibility.name().to_owned(),
        idle_timeout_ms: millis(idle),
        closes_at: None,
        own_games: false,
    })
}

/// Checks the holders of a team of `agents` agents: each agent has one holder.
fn team(
    holders: Vec<HolderRequest>,
    agents: Option<i64>,
    limits: &Limits,
    problems: &mut Problems,
) -> Vec<RunHolder> {
    let (count, most) = (holders.len(), limits.run_holders_max);
    if !(1..=most).contains(&count) {
        problems.refuse("holders", format!("must be 1 to {most} (run_holders_max), are {count}"));
        return Vec::new();
    }
    let mut team: Vec<RunHolder> = Vec::with_capacity(count);
    let mut seated = HashSet::new();
    for (place, holder) in holders.into_iter().enumerate() {
        let mut own = Problems::default();
        let holder = declared(holder, agents, limits, &mut own);
        if team.iter().any(|other| other.name == holder.name) {
            own.refuse("name", format!("{:?} is the name of two holders", short(&holder.name)));
        }
        if holder.seats.is_empty() {
            own.refuse("seats", "must name at least one agent, by its number");
        }
        let twice = holder.seats.iter().filter(|seat| !seated.insert(**seat)).min();
        own.check("seats", twice.map(|seat| format!("the agent {seat} has two holders")));
        problems.add_within(&format!("holders[{place}]"), own);
        team.push(holder);
    }
    let without = (0..agents.unwrap_or(0))
        .find(|agent| u16::try_from(*agent).is_ok_and(|agent| !seated.contains(&agent)));
    if let Some(agent) = without {
        problems.refuse("holders", format!("the agent {agent} has no holder"));
    }
    let bytes: usize = team.iter().map(|holder| holder.agent_meta.0.len()).sum();
    let most = limits.holders_meta_bytes_max;
    if bytes > most {
        let problem = format!(
            "may have {most} bytes of agent_meta together (holders_meta_bytes_max), have {bytes}"
        );
        problems.refuse("holders", problem);
    }
    team
}

/// A holder of a team of `agents` agents, checked for itself.
fn declared(
    holder: HolderRequest,
    agents: Option<i64>,
    limits: &Limits,
    problems: &mut Problems,
) -> RunHolder {
    let HolderRequest { name, seats, model, player, temperature, top_p, agent_meta } = holder;
    if model.is_some() && player.is_some() {
        problems.refuse("model", "goes without `player`, which names the player");
    }
    let usual = || player.as_ref().map(|player| format!("built-in/{player}"));
    let model = model.or_else(usual).unwrap_or_default();
    problems.model(limits, &model);
    let name = name.unwrap_or_else(|| model.clone());
    problems.text("name", &name, limits.name_chars_max);
    problems.sampling(temperature, top_p);
    let agent_meta = agent_meta.unwrap_or_default();
    problems.agent_meta(limits, &agent_meta);
    let agent =
        |seat: &i64| u16::try_from(*seat).ok().filter(|_| agents.is_none_or(|all| *seat < all));
    // The list may be long, and one wrong number tells what is wrong with it.
    let unknown = seats.iter().find(|seat| agent(seat).is_none());
    problems.check("seats", unknown.map(|seat| format!("there is no agent {seat}")));
    let mut seats: Vec<u16> = seats.iter().filter_map(agent).collect();
    seats.sort_unstable();
    let (sampling, prompt) = (None, None);
    RunHolder { name, model, seats, player, temperature, top_p, sampling, prompt, agent_meta }
}

/// Prefix of ids of competitions.
const COMPETITION_PREFIX: &str = "cmp_";

fn own_suite(own: OwnSuite, rules: &str, app: &App, problems: &mut Problems) -> Option<Suite> {
    let OwnSuite { name, tasks, seeds, settings } = own;
    problems.text("suite.name", &name, app.limits.name_chars_max);
    if Suite::BUILT_IN.contains(&name.as_str()) {
        problems.refuse("suite.name", "is that of a built-in suite; choose another");
    }
    // Suites of competitions are named by their ids; no other run may get onto their boards.
    if name.trim_start().to_lowercase().starts_with(COMPETITION_PREFIX) {
        problems.refuse("suite.name", "is like that of a competition; choose another");
    }
    let all = || TaskName::ALL.map(|task| task.name().to_owned()).to_vec();
    let tasks = tasks.unwrap_or_else(all);
    for (field, count, distinct) in [
        ("suite.tasks", tasks.len(), tasks.iter().collect::<HashSet<_>>().len()),
        ("suite.seeds", seeds.len(), seeds.iter().collect::<HashSet<_>>().len()),
    ] {
        if count == 0 {
            problems.refuse(field, "must not be empty");
        } else if distinct < count {
            problems.refuse(field, "must not name anything twice");
        }
    }
    let (games, most) = (tasks.len().saturating_mul(seeds.len()), app.limits.run_games_max);
    if games > most {
        problems.refuse(
            "suite",
            format!("must have at most {most} games (tasks × seeds), has {games}"),
        );
    }
    if seeds.iter().any(|&seed| seed < 0) {
        problems.refuse("suite.seeds", "must be from 0 to 9007199254740991");
        return None;
    }
    if games > most {
        return None;
    }
    let mut refuse = |error: SeedError| problems.refuse("suite.seeds", error.to_string());
    let seeds = (seeds.into_iter())
        .map(|seed| Seed::try_from(seed).map_err(&mut refuse).unwrap_or_default())
        .collect();
    let settings = SuiteSettings::from(&settings.unwrap_or_default().over(Settings::default()));
    Some(Suite { name, tasks, seeds, seeds_by_task: false, rules: rules.to_owned(), settings })
}

/// Checks that a suite may be played by a new run. A repeated creation gets that run, also where
/// it was created under wider limits.
fn check_new(suite: &Suite) -> Result<(), ApiError> {
    let games = suite.plan();
    let mut first_of_each = games.iter().filter(|game| Some(&game.seed) == suite.seeds.first());
    first_of_each
        .try_for_each(|game| Config::admit(&suite.settings_of(game)).map(drop))
        .map_err(|errors| ApiError::settings(errors, "suite.settings."))
}

/// Checks that every game of a suite can be played, by the built-in players that are to play it.
fn check_games(suite: &Suite, players: &[&str], problems: &mut Problems) {
    let mut seen = HashSet::new();
    for game in suite.plan() {
        if let Err(errors) = Config::check(&suite.settings_of(&game)) {
            for error in errors.0 {
                let field = match error.field {
                    "task" => "suite.tasks".to_owned(),
                    "seed" => "suite.seeds".to_owned(),
                    field => format!("suite.settings.{field}"),
                };
                if seen.insert((field.clone(), error.problem.clone())) {
                    problems.refuse(&field, error.problem);
                }
            }
        }
        let Some(task) = TaskName::parse(&game.task) else { continue };
        for problem in players.iter().filter_map(|name| hosted::player(name, task).err()) {
            if seen.insert(("player".to_owned(), problem.clone())) {
                problems.refuse("player", problem);
            }
        }
    }
}
