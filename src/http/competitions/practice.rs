//! `POST /api/v1/competitions/{id}/practice`.

use std::collections::HashSet;
use std::time::Duration;

use jiff::SignedDuration;
use swarmbench_engine::Seed;

use super::super::answer;
use super::super::auth::Credential;
use super::super::checks::random_seed;
use super::super::prelude::*;
use super::super::runs::token::only_token;
use super::check_open;
use super::start::{check_active, entrant};
use crate::competitions::StoredCompetition;
use crate::episode::quota::Purpose;
use crate::fair::Party;
use crate::run::RunStatus;
use crate::run::manager::NewRun;
use swarmbench_boards::competition::definition::practice_suite;
use swarmbench_protocol::competition::{PracticeRequest, StartedPractice};

/// Maximum seeds of a practice run.
const SEEDS_MAX: usize = 10;

const DAY: Duration = Duration::from_hours(24);

/// Play for practice: the tasks and settings of the competition on open seeds, with the entrant's key.
///
/// Practice never counts in the competition. It is possible from the announcement until the competition closes, beside
/// attempts. An earlier practice run that is still running ends. The entrant reads all of the run; its games are open to all
/// once they have ended, like those of other runs.
#[utoipa::path(
    post,
    path = "/api/v1/competitions/{id}/practice",
    operation_id = "start_practice",
    tag = "competitions",
    request_body(content = Option<PracticeRequest>, description = "At most 256 KiB; an empty body plays all tasks on one drawn seed"),
    responses(
        (status = 201, description = "The run, with its swarm token", body = StartedPractice),
        (status = 403, description = "`forbidden`: not the key of an entrant; the entrant was withdrawn or disqualified; the maximum number of practice runs was started within 24 hours"),
        (status = 409, description = "`closed`: the competition has closed or was cancelled"),
    )
)]
pub(in super::super) async fn start_practice(
    State(app): State<App>,
    caller: Caller,
    Credential(credential): Credential,
    Id(id): Id,
    _: Params<Nothing>,
    OptionalJson(request, _): OptionalJson<PracticeRequest>,
) -> Result<Response, ApiError> {
    caller.check_not_judge()?;
    let owner = caller.needs_key()?.number;
    let competition = app.competition(&caller, &id).await?;
    let found = entrant(&app, &competition, owner, request.entrant.as_deref()).await?;
    check_active(&found)?;
    let (tasks, seeds) = checked(&app, &competition, request)?;
    // The party is the competition if the key was made for it.
    let party = Party::current();
    // A detached task completes the start even if the client hangs up. The lock admits one start per key at a time.
    detached(async move {
        let owner = found.owner;
        let _lock = app.creations.lock(&format!("practice of {}", owner.0)).await;
        let now = app.clock.wall();
        check_open(&competition, now)?;
        let found = app.entrant(&competition, &found.entrant.id).await?;
        check_active(&found)?;
        let from =
            now.checked_sub(SignedDuration::try_from(DAY).unwrap_or_default()).unwrap_or(now);
        let earlier =
            app.store.runs_of_suite(owner, &practice_suite(&competition.id), from).await?;
        let most = app.limits.practice_runs_per_day_max;
        if earlier.len() >= most {
            let detail = format!("{most} practice runs were started in 24 hours, the maximum");
            return Err(ApiError::limit(
                Code::Forbidden,
                "practice_runs_per_day_max",
                most,
                detail,
            ));
        }
        for (run, _) in earlier.into_iter().filter(|(_, is_running)| *is_running) {
            app.runs.end(run, RunStatus::Aborted).await?;
        }
        let shown = seeds.iter().map(|seed| seed.get()).collect();
        let declaration = &found.entrant.declaration;
        let definition =
            competition.definition.practice(&competition.id, declaration, tasks, seeds);
        let games = definition.suite.plan().len();
        let new = NewRun { credential, ..NewRun::by(party, Purpose::Usual, definition) };
        let (run, tokens) = app.runs.create(new).await?;
        app.check_not_excluded(&competition, &found, run.run).await?;
        let token = only_token(tokens)?;
        let body = StartedPractice {
            entrant: found.entrant.id,
            run: run.id,
            seeds: shown,
            games,
            closes_at: competition.definition.closes_at.into(),
            swarm_token: token.reveal().to_owned(),
        };
        Ok(answer::created(&format!("/api/v1/runs/{}", body.run), &body))
    })
    .await
}

/// Tasks and seeds of the run; reports all errors at once.
fn checked(
    app: &App,
    competition: &StoredCompetition,
    request: PracticeRequest,
) -> Result<(Vec<String>, Vec<Seed>), ApiError> {
    let mut problems = Problems::default();
    let all = &competition.definition.tasks;
    let tasks = request.tasks.unwrap_or_else(|| all.clone());
    let is_distinct = tasks.iter().collect::<HashSet<_>>().len() == tasks.len();
    if tasks.is_empty() || !is_distinct || tasks.iter().any(|task| !all.contains(task)) {
        let names = all.join(", ");
        problems.refuse("tasks", format!("must name some of {names}, each at most once"));
    }
    let asked = request.seeds.unwrap_or_else(|| vec![random_seed(app)]);
    let is_distinct = asked.iter().collect::<HashSet<_>>().len() == asked.len();
    if !(1..=SEEDS_MAX).contains(&asked.len()) || !is_distinct {
        problems.refuse("seeds", format!("must be 1 to {SEEDS_MAX} different ones"));
    }
    let mut seeds = Vec::new();
    for seed in asked.into_iter().take(SEEDS_MAX) {
        match Seed::try_from(seed) {
            Ok(seed) => seeds.push(seed),
            Err(error) => problems.refuse("seeds", error.to_string()),
        }
    }
    problems.none_or(Some((tasks, seeds)))
}
