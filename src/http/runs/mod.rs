//! Runs: create, list, show, watch, abort, and new tokens; and the built-in suites.

pub(super) mod abort;
pub(super) mod create;
pub(super) mod events;
pub(super) mod list;
pub(super) mod show;
pub(super) mod suites;
pub(super) mod token;

use super::App;
use super::auth::{Caller, Subject};
use super::error::{ApiError, Code};
use crate::episode::spec::Visibility;
use crate::journal::Tally;
use crate::run::definition::Definition;
use crate::run::score::{task_scores, total};
use crate::run::suite::Suite;
use crate::store::runs::{StoredGame, StoredRun};
use crate::wire::Seconds;
use crate::wire::run::{ActTally, RunDetail, RunGame, RunSummary, SuiteView, TaskResult};

/// A run of which the caller may know.
struct Known {
    stored: StoredRun,
    definition: Definition,
    visibility: Visibility,
}

impl Known {
    fn of(stored: StoredRun) -> Result<Self, ApiError> {
        let definition = Definition::of(&stored)?;
        let visibility = definition.visibility().ok_or_else(|| {
            ApiError::new(Code::Internal, "what is stored of this run cannot be read")
        })?;
        Ok(Self { stored, definition, visibility })
    }

    /// What decides who may do what with it.
    fn subject(&self) -> Subject<'_> {
        Subject {
            id: None,
            owner: self.stored.owner,
            run: Some(self.stored.run),
            visibility: self.visibility,
            is_mixed: false,
            is_over: self.stored.ended_at.is_some(),
            is_revealed: self.stored.revealed,
        }
    }

    /// Whether the caller may know all seeds: those of built-in suites are no secret.
    fn shows_seeds(&self, app: &App, caller: &Caller) -> bool {
        let subject = self.subject();
        let suite = &self.definition.suite;
        let is_built_in = || {
            let same = Suite::built_in(&suite.name, &suite.rules);
            same.is_some_and(|same| same.seeds == suite.seeds)
        };
        let reads = caller.may_read(&app.access, subject);
        caller.owns(subject) || (reads && (subject.is_over || is_built_in()))
    }

    /// The run as it is shown to `caller`.
    fn summary(&self, app: &App, caller: &Caller, games: &[StoredGame]) -> RunSummary {
        let Self { stored, definition, .. } = self;
        let reads = caller.may_read(&app.access, self.subject());
        let scores = task_scores(&definition.suite, games, stored.ended_at.is_some());
        let sum = |of: fn(&crate::run::score::TaskScore) -> u32| scores.iter().map(of).sum();
        let (played, planned) = (sum(|task| task.games), sum(|task| task.planned));
        let voided = sum(|task| task.voided);
        let total = total(&scores).filter(|_| reads);
        let tasks = scores.into_iter().map(|score| TaskResult {
            task: score.task,
            mean: score.mean.filter(|_| reads),
            deviation: score.deviation.filter(|_| reads),
            played: score.games,
            planned: score.planned,
            voided: score.voided,
        });
        RunSummary {
            id: stored.id.clone(),
            status: stored.status.clone(),
            suite: SuiteView::of(&definition.suite, self.shows_seeds(app, caller)),
            model: definition.model.clone(),
            temperature: definition.temperature,
            top_p: definition.top_p,
            agent_meta: definition.meta.clone(),
            template_digest: definition.template_digest(),
            player: definition.player.clone(),
            parallel: definition.parallel,
            visibility: definition.visibility.clone(),
            idle_timeout_s: Seconds::of(std::time::Duration::from_millis(
                definition.idle_timeout_ms,
            )),
            closes_at: definition.closes_at,
            attempt: stored.attempt.map(|(_, number)| number),
            void_reason: stored.void_reason.clone(),
            created_at: stored.created_at,
            ended_at: stored.ended_at,
            played,
            planned,
            voided,
            tasks: tasks.collect(),
            total,
            acts: tally(games),
            waits_for: app.runs.waits_for(stored.run).map(Into::into),
        }
    }

    /// Its games as they are shown to `caller`: those that were opened, and those that were not.
    fn games(&self, app: &App, caller: &Caller, games: &[StoredGame]) -> Vec<RunGame> {
        let shows_seeds = self.shows_seeds(app, caller);
        let mut shown = Vec::new();
        for planned in self.definition.suite.plan() {
            let before = shown.len();
            for game in games.iter().filter(|game| game.slot == planned.slot) {
                let episode =
                    Subject { id: Some(&game.id), is_over: game.is_over(), ..self.subject() };
                let reads = caller.may_read(&app.access, episode);
                shown.push(RunGame {
                    slot: game.slot,
                    task: planned.task.clone(),
                    seed: (shows_seeds || (reads && game.is_over())).then_some(planned.seed),
                    episode: Some(game.id.to_string()),
                    status: game.status.clone(),
                    reason: game.reason.clone().filter(|_| reads),
                    round: game.rounds,
                    score: reads.then_some(game.score),
                    void_reason: game.void_reason.clone(),
                });
            }
            let is_again = shown[before..].iter().all(|game| game.void_reason.is_some());
            // What the host broke after the end of the run is not played again.
            if shown.len() == before || (is_again && self.stored.ended_at.is_none()) {
                shown.push(RunGame {
                    slot: planned.slot,
                    task: planned.task,
                    seed: shows_seeds.then_some(planned.seed),
                    episode: None,
                    status: "planned".to_owned(),
                    reason: None,
                    round: 0,
                    score: None,
                    void_reason: None,
                });
            }
        }
        shown
    }
}

impl App {
    /// A run of which the caller may know.
    async fn known_run(&self, caller: &Caller, id: &str) -> Result<Known, ApiError> {
        let unknown = || ApiError::not_found("the run");
        let known = Known::of(self.store.find_run(id).await?.ok_or_else(unknown)?)?;
        if caller.may_know(&self.access, known.subject()) { Ok(known) } else { Err(unknown()) }
    }

    /// A run as it stands now, with its games.
    async fn run_detail(&self, caller: &Caller, known: &Known) -> Result<RunDetail, ApiError> {
        let games = self.store.games_of(known.stored.run).await?;
        Ok(RunDetail {
            run: known.summary(self, caller, &games),
            games: known.games(self, caller, &games),
        })
    }
}

/// What the acts were of all games that count.
fn tally(games: &[StoredGame]) -> ActTally {
    let mut sum = Tally::default();
    for game in games.iter().filter(|game| game.counts()) {
        sum.acts += game.tally.acts;
        sum.invalid += game.tally.invalid;
        sum.clock_outs += game.tally.clock_outs;
        sum.prompt_tokens = sum.prompt_tokens.saturating_add(game.tally.prompt_tokens);
        sum.completion_tokens = sum.completion_tokens.saturating_add(game.tally.completion_tokens);
    }
    #[expect(clippy::cast_precision_loss, reason = "nobody sends 2⁵³ acts")]
    let share = |part: u64, all: u64| (all > 0).then(|| part as f64 / all as f64);
    ActTally {
        sent: sum.acts,
        invalid: sum.invalid,
        invalid_share: share(sum.invalid, sum.acts),
        clock_outs: sum.clock_outs,
        clock_out_share: share(sum.clock_outs, sum.acts + sum.clock_outs),
        prompt_tokens: sum.prompt_tokens,
        completion_tokens: sum.completion_tokens,
    }
}
