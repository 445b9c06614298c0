//! Runs: create, list, show, watch, abort, and new tokens; and the built-in suites.

pub(super) mod abort;
pub(super) mod create;
pub(super) mod events;
mod games;
pub(super) mod list;
pub(super) mod metrics;
pub(super) mod scores;
pub(super) mod show;
pub(super) mod suites;
pub(super) mod token;

use std::collections::VecDeque;
use std::time::Duration;

use serde_json::{Value, json};

use super::App;
use super::auth::{Caller, Opened, Subject};
use super::error::{ApiError, Code};
use super::seeds::SeedPermit;
use crate::competitions;
use crate::episode::spec::Visibility;
use crate::run::definition::{self, Definition};
use crate::store::games::StoredGame;
use crate::store::runs::StoredRun;
use crate::store::tokens::Seats;
use swarmbench_boards::Slot;
use swarmbench_boards::result::task_results;
use swarmbench_boards::run::NO_PROMPT;
use swarmbench_journal::Tally;
use swarmbench_protocol::Seconds;
use swarmbench_protocol::carried::Carried;
use swarmbench_protocol::run::{
    ActTally, RunDetail, RunGame, RunHolder, RunSummary, SuiteView, TaskResult,
};
use swarmbench_protocol::suite::SuiteSettings;

impl App {
    /// Detail for the audit log of an attempt that an organizer changes; empty for other runs.
    async fn detail_of_run(&self, run: &StoredRun) -> Result<Value, ApiError> {
        let Some((competition, (entry, number))) = run.competition.zip(run.attempt) else {
            return Ok(json!({}));
        };
        let found = competitions::entrants_among(&self.store, competition, &[entry]).await?;
        let entrant = found.first().map(|entrant| &entrant.entrant.id);
        Ok(json!({ "entrant": entrant, "attempt": run.replays.unwrap_or(number) }))
    }
}

/// A run of which the caller may know.
struct Known {
    stored: StoredRun,
    definition: Definition,
    plan: Vec<Slot>,
    visibility: Visibility,
    opened: Opened,
}

impl Known {
    fn of(app: &App, stored: StoredRun) -> Result<Self, ApiError> {
        let definition = definition::read(&stored)?;
        let known = Visibility::parse(&definition.visibility).zip(Slot::plan(&definition.suite));
        let (visibility, plan) = known.ok_or_else(|| {
            ApiError::new(Code::Internal, "what is stored of this run cannot be read")
        })?;
        // The end of the window as its games have it: runs of earlier versions may know one that was moved since.
        let own_from = stored.closes_at.filter(|_| definition.own_games);
        let SuiteSettings { round_deadline_ms, bank_ms, .. } = definition.suite.settings;
        let round_max =
            Duration::from_millis(round_deadline_ms.unwrap_or(0).saturating_add(bank_ms));
        let opened = Opened::at(app.time_to_open(), stored.revealed, own_from, round_max);
        Ok(Self { stored, definition, plan, visibility, opened })
    }

    /// Facts of the run that decide its permissions.
    fn subject(&self) -> Subject<'_> {
        Subject {
            id: None,
            owner: self.stored.owner,
            run: Some(self.stored.run),
            visibility: self.visibility,
            is_mixed: self.definition.is_team(),
            is_claimable: false,
            is_over: self.stored.ended_at.is_some(),
            opened: self.opened,
        }
    }

    /// Facts of one of its games that decide its permissions.
    fn subject_of<'a>(&'a self, game: &'a StoredGame) -> Subject<'a> {
        let visibility = Visibility::parse(self.definition.visibility_of_games());
        Subject {
            id: Some(&game.id),
            is_over: game.is_over(),
            visibility: visibility.unwrap_or(self.visibility),
            ..self.subject()
        }
    }

    /// Permit for all seeds, but for sealed ones in lists.
    fn open_seeds(&self, app: &App, caller: &Caller) -> SeedPermit {
        let subject = self.subject();
        let permit = app.may_see_open_seed(caller, subject);
        if caller.may_read(&app.access, subject) {
            permit.or(SeedPermit::of_built_in(&self.definition.suite))
        } else {
            permit
        }
    }

    /// Permit for all seeds.
    async fn seeds(&self, app: &App, caller: &Caller) -> Result<SeedPermit, ApiError> {
        let permit = app.may_see_seed(caller, self.subject(), &self.stored.id).await?;
        Ok(permit.or(self.open_seeds(app, caller)))
    }

    /// The run as it is shown to `caller`.
    fn summary(
        &self,
        app: &App,
        caller: &Caller,
        seeds: SeedPermit,
        games: &[StoredGame],
    ) -> RunSummary {
        let Self { stored, definition, .. } = self;
        let reads = caller.may_read(&app.access, self.subject());
        let results = self.results(games);
        let sum = |of: fn(&TaskResult) -> u32| results.iter().map(of).sum();
        let (played, planned) = (sum(|task| task.played), sum(|task| task.planned));
        let voided = sum(|task| task.voided);
        let means: Vec<f64> = results.iter().filter_map(|task| task.mean).collect();
        let total = (reads && !means.is_empty()).then(|| means.iter().sum());
        let tasks = results.into_iter().map(|result| TaskResult {
            mean: result.mean.filter(|_| reads),
            deviation: result.deviation.filter(|_| reads),
            ..result
        });
        RunSummary {
            id: stored.id.clone(),
            status: stored.status.clone(),
            suite: SuiteView::of(&definition.suite, seeds.is_granted()),
            model: definition.model.clone(),
            temperature: definition.temperature,
            top_p: definition.top_p,
            sampling: definition.further_sampling(),
            agent_meta: definition.meta.clone(),
            template_digest: definition.template_digest(),
            prompt: definition.prompt_name().unwrap_or_else(|| NO_PROMPT.to_owned()),
            player: definition.player.clone(),
            holders: self.holders(caller),
            parallel: definition.parallel,
            visibility: definition.visibility.clone(),
            idle_timeout_s: Seconds::of(std::time::Duration::from_millis(
                definition.idle_timeout_ms,
            )),
            closes_at: definition.closes_at.map(Into::into),
            attempt: stored.attempt.map(|(_, number)| number),
            void_reason: stored.void_reason.clone(),
            created_at: stored.created_at.into(),
            ended_at: stored.ended_at.map(Into::into),
            played,
            planned,
            voided,
            tasks: tasks.collect(),
            total,
            acts: tally(games),
            waits_for: app.runs.waits_for(stored.run).map(Into::into),
        }
    }

    /// Holders of the team as they are shown. Before the end a holder is not told how the others are asked, system messages
    /// included.
    fn holders(&self, caller: &Caller) -> Vec<RunHolder> {
        let is_told_all =
            self.stored.ended_at.is_some() || caller.reads_all() || caller.owns(self.subject());
        let mut holders = self.definition.shown_holders();
        for (number, holder) in (1..).zip(&mut holders) {
            if !is_told_all && *caller != Caller::Run(self.stored.run, Seats::OfTeam(number)) {
                holder.agent_meta = Carried::default();
            }
        }
        holders
    }

    /// Results of the tasks, in the order of the suite.
    fn results(&self, games: &[StoredGame]) -> Vec<TaskResult> {
        let counting = games.iter().filter(|game| game.counts());
        let is_over = self.stored.ended_at.is_some() && counting.clone().all(StoredGame::is_over);
        let ended = games.iter().filter(|game| game.is_over());
        let ended: Vec<_> = ended.filter_map(|game| game.in_plan(&self.plan)).collect();
        let results = task_results(&self.plan, &ended, is_over);
        let of = |name: &String| results.iter().find(|result| result.task.name() == name);
        let shown = self.definition.suite.tasks.iter().filter_map(of);
        shown
            .map(|result| TaskResult {
                task: result.task.name().to_owned(),
                mean: result.mean(),
                deviation: result.mean_and_deviation.map(|(_, deviation)| deviation),
                played: result.games,
                planned: result.planned,
                voided: result.voided,
            })
            .collect()
    }

    /// Games of the run for `caller`, opened or only planned.
    fn games(
        &self,
        app: &App,
        caller: &Caller,
        seeds: SeedPermit,
        games: &[StoredGame],
    ) -> Vec<RunGame> {
        let mut shown = Vec::new();
        for planned in self.definition.suite.plan() {
            let before = shown.len();
            for game in games.iter().filter(|game| game.slot == planned.slot) {
                let episode = self.subject_of(game);
                let reads = caller.may_read(&app.access, episode);
                shown.push(RunGame {
                    slot: game.slot,
                    task: planned.task.clone(),
                    seed: seeds.or(app.may_see_open_seed(caller, episode)).show(planned.seed),
                    episode: Some(game.id.to_string()),
                    status: game.status.clone(),
                    reason: game.reason.clone().filter(|_| reads),
                    round: game.rounds,
                    score: reads.then_some(game.score),
                    void_reason: game.void_reason.clone(),
                });
            }
            let is_again = shown[before..].iter().all(|game| game.void_reason.is_some());
            // A game that was voided after the end of the run is not played again.
            if shown.len() == before || (is_again && self.stored.ended_at.is_none()) {
                shown.push(RunGame {
                    slot: planned.slot,
                    task: planned.task,
                    seed: seeds.show(planned.seed),
                    episode: None,
                    status: "planned".to_owned(),
                    reason: None,
                    round: 0,
                    score: None,
                    void_reason: None,
                });
            }
        }
        fit(&mut shown, app.limits.answer_bytes_max.saturating_sub(RUN_BYTES_MAX));
        shown
    }
}

/// Bytes that a run takes at most in an answer beside its games.
const RUN_BYTES_MAX: usize = 1024 * 1024;

/// Bytes that a game takes at most in an answer, beside the reason for which it was voided.
const GAME_BYTES_MAX: usize = 512;

/// Leaves games out in whose place another was played, from the first slot on, where all would take more bytes.
/// A run has a bounded number of slots, but a game may be voided again and again.
fn fit(games: &mut Vec<RunGame>, bytes_max: usize) {
    // Written as JSON a text takes at most twice its bytes: reasons have no control characters.
    let reason = |game: &RunGame| game.void_reason.as_ref().map_or(0, |reason| 2 * reason.len());
    let bytes = |game: &RunGame| GAME_BYTES_MAX + reason(game);
    let mut over = games.iter().map(bytes).sum::<usize>().saturating_sub(bytes_max);
    let mut next: VecDeque<u32> = games.iter().map(|game| game.slot).collect();
    games.retain(|game| {
        next.pop_front();
        let stays = over == 0 || next.front() != Some(&game.slot);
        if !stays {
            over = over.saturating_sub(bytes(game));
        }
        stays
    });
}

impl App {
    /// A run of which the caller may know.
    async fn known_run(&self, caller: &Caller, id: &str) -> Result<Known, ApiError> {
        let unknown = || ApiError::not_found("the run");
        let known = Known::of(self, self.store.find_run(id).await?.ok_or_else(unknown)?)?;
        if caller.may_know(&self.access, known.subject()) { Ok(known) } else { Err(unknown()) }
    }

    /// Permit for the seeds of a run.
    pub(super) async fn permit_of_run(
        &self,
        caller: &Caller,
        stored: StoredRun,
    ) -> Result<SeedPermit, ApiError> {
        let known = Known::of(self, stored)?;
        self.may_see_seed(caller, known.subject(), &known.stored.id).await
    }

    /// The current state of a run, with its games.
    async fn run_detail(
        &self,
        caller: &Caller,
        known: &Known,
        seeds: SeedPermit,
    ) -> Result<RunDetail, ApiError> {
        let games = self.store.games_of(known.stored.run).await?;
        Ok(RunDetail {
            run: known.summary(self, caller, seeds, &games),
            games: known.games(self, caller, seeds, &games),
        })
    }
}

/// Counts of the acts in all games that count.
fn tally(games: &[StoredGame]) -> ActTally {
    let mut sum = Tally::default();
    games.iter().filter(|game| game.counts()).for_each(|game| sum.merge(&game.tally));
    #[expect(clippy::cast_precision_loss, reason = "nobody sends 2⁵³ acts")]
    let share = |part: u64, all: u64| (all > 0).then(|| part as f64 / all as f64);
    let timeout_share = share(sum.timeouts, sum.acts + sum.timeouts);
    ActTally {
        sent: sum.acts,
        invalid: sum.invalid,
        invalid_share: share(sum.invalid, sum.acts),
        failures: sum.failures,
        timeouts: sum.timeouts,
        timeout_share,
        clock_outs: sum.timeouts,
        clock_out_share: timeout_share,
        prompt_tokens: sum.prompt_tokens,
        completion_tokens: sum.completion_tokens,
        usage: sum.usage,
    }
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::TaskName;

    use super::*;
    use crate::http::limits::Limits;
    use swarmbench_engine::Seed;

    /// A game with the longest texts; its task and status are longer than any there is.
    fn game(slot: u32, void_reason: Option<String>) -> RunGame {
        RunGame {
            slot,
            task: "x".repeat(40),
            seed: Some(Seed::MAX),
            episode: Some(format!("ep_{}", "0".repeat(32))),
            status: "x".repeat(20),
            reason: Some("x".repeat(40)),
            round: u32::MAX,
            score: Some(-f64::MIN_POSITIVE / 3.0),
            void_reason,
        }
    }

    fn json_bytes(games: &[RunGame]) -> usize {
        serde_json::to_vec(games).expect("string keys").len()
    }

    #[test]
    fn the_largest_run_fits_into_an_answer() {
        let limits = Limits::default();
        assert!(TaskName::ALL.iter().all(|task| task.name().len() < 40));
        assert!(json_bytes(&[game(u32::MAX, None)]) < GAME_BYTES_MAX);
        let slots = u32::try_from(limits.run_games_max).expect("few");
        let bytes_max = limits.answer_bytes_max - RUN_BYTES_MAX;
        for reason in ["\"", "🐜"].map(|text| text.repeat(limits.reason_chars_max)) {
            // Each was voided once and played again, and the last ones count for nothing either.
            let all = |times| {
                let slots = (0..slots).flat_map(move |slot| std::iter::repeat_n(slot, times));
                slots.map(|slot| game(slot, Some(reason.clone()))).collect::<Vec<_>>()
            };
            let mut few = all(1);
            fit(&mut few, bytes_max);
            assert_eq!(few.len(), limits.run_games_max);
            let mut many = all(9);
            assert!(json_bytes(&many) > limits.answer_bytes_max);
            fit(&mut many, bytes_max);
            assert!(json_bytes(&many) <= bytes_max);
            let mut left: Vec<u32> = many.iter().map(|game| game.slot).collect();
            left.dedup();
            assert_eq!(left.len(), limits.run_games_max, "each slot has its last game");
            assert!(many.len() > limits.run_games_max, "no more are left out than has to be");
        }
    }
}
