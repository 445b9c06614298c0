//! Episodes: create, list, show, start, abort, and what spectators read.

pub(super) mod abort;
pub(super) mod agent;
pub(super) mod create;
mod created;
mod describe;
pub(super) mod events;
pub(super) mod fork;
pub(super) mod journal;
pub(super) mod list;
pub(super) mod metrics;
pub(super) mod models;
pub(super) mod repeat;
pub(super) mod replay;
pub(super) mod scores;
pub(super) mod show;
pub(super) mod start;
pub(super) mod state;
pub(super) mod verification;
pub(super) mod void;
pub(super) mod worth;

use super::App;
use super::auth::{Caller, Opened, Subject};
use super::error::{ApiError, Code};
use super::seeds::SeedPermit;
use crate::episode::Status;
use crate::episode::actor::Handle;
use crate::episode::spec::{Spec, Visibility};
use crate::ids::{CompetitionKey, EpisodeId, RunKey};
use crate::store::port::StoredEpisode;
use swarmbench_journal::record::{Fork, Record};
use swarmbench_protocol::Seconds;
use swarmbench_protocol::episode::{self as shown, EpisodeConfig, EpisodeResult, EpisodeSummary};

impl App {
    /// An episode of which the caller may read everything but the seed.
    async fn readable(&self, caller: &Caller, id: String) -> Result<Handle, ApiError> {
        let stored = self.readable_episode(caller, id).await?;
        self.episode(&stored.id).await
    }

    /// Stored row of an episode of which the caller may read the states.
    async fn readable_episode(
        &self,
        caller: &Caller,
        id: String,
    ) -> Result<StoredEpisode, ApiError> {
        let (stored, spec) = self.known_episode(caller, id).await?;
        if !caller.may_read(&self.access, self.subject(&stored, &spec)) {
            let detail = if spec.visibility == Visibility::Sealed {
                "this game is sealed: until its competition is revealed only organizers may read this"
            } else if spec.is_mixed() {
                "this episode has several seat holders: nobody may read this before its end"
            } else {
                "until the end of this episode only its creator may read this"
            };
            return Err(ApiError::new(Code::Forbidden, detail));
        }
        self.permit_of_game(caller, &stored, &spec).await?;
        Ok(stored)
    }

    /// Permit for the seed of a game, which everything that tells the seed needs.
    pub(super) async fn permit_of_game(
        &self,
        caller: &Caller,
        stored: &StoredEpisode,
        spec: &Spec,
    ) -> Result<SeedPermit, ApiError> {
        self.may_see_seed(caller, self.subject(stored, spec), stored.id.as_str()).await
    }

    /// Facts of a stored episode that decide its permissions.
    fn subject<'a>(&self, stored: &'a StoredEpisode, spec: &Spec) -> Subject<'a> {
        let is_over = Status::parse(&stored.status).is_some_and(Status::is_over);
        Subject {
            id: Some(&stored.id),
            owner: stored.owner,
            run: stored.run,
            visibility: spec.visibility,
            is_mixed: spec.is_mixed(),
            is_claimable: !spec.open_seats.is_empty(),
            is_over,
            opened: Opened::at(
                self.time_to_open(),
                stored.revealed,
                stored.own_from,
                spec.round_max(),
            ),
        }
    }

    /// An episode that the caller created.
    async fn owned(
        &self,
        caller: &Caller,
        id: String,
    ) -> Result<(Handle, StoredEpisode), ApiError> {
        caller.check_not_judge()?;
        let (stored, spec) = self.known_episode(caller, id).await?;
        if !caller.owns(self.subject(&stored, &spec)) {
            let detail = "only the creator of an episode may do this: send its swarm token, or the key with which it was created";
            return Err(ApiError::new(Code::Forbidden, detail));
        }
        Ok((self.episode(&stored.id).await?, stored))
    }

    /// The competition of which a game is a part: everybody sees there what organizers do to it.
    async fn competition_of_game(
        &self,
        run: Option<RunKey>,
    ) -> Result<Option<CompetitionKey>, ApiError> {
        Ok(match run {
            Some(run) => self.store.run(run).await?.and_then(|run| run.competition),
            None => None,
        })
    }

    /// Stored row of an episode that the caller may know of. The episode is not recovered for it.
    pub(super) async fn known_episode(
        &self,
        caller: &Caller,
        id: String,
    ) -> Result<(StoredEpisode, Spec), ApiError> {
        let unknown = || ApiError::not_found("the episode");
        let stored = self.store.find_summary(&EpisodeId::from_text(id)).await?;
        let stored = stored.ok_or_else(unknown)?;
        let spec = spec(&stored)?;
        if caller.may_know(&self.access, self.subject(&stored, &spec)) {
            Ok((stored, spec))
        } else {
            Err(unknown())
        }
    }

    /// Stored row of an episode of which the caller may read the journal.
    async fn journaled_episode(
        &self,
        caller: &Caller,
        id: String,
    ) -> Result<StoredEpisode, ApiError> {
        let (stored, spec) = self.known_episode(caller, id).await?;
        if !self.permit_of_game(caller, &stored, &spec).await?.is_granted() {
            let detail = if spec.is_mixed() {
                "a journal contains the seed and the answers of all seat holders: it can be read after the end"
            } else {
                "a journal contains the seed: until the end only the creator may read it"
            };
            return Err(ApiError::new(Code::Forbidden, detail));
        }
        Ok(stored)
    }

    /// Permit for the seed of a game in a list, and for all that was played in it.
    pub(super) fn open_permit_of_game(
        &self,
        caller: &Caller,
        stored: &StoredEpisode,
        spec: &Spec,
    ) -> SeedPermit {
        self.may_see_open_seed(caller, self.subject(stored, spec))
    }

    /// An episode as it is shown, from what is stored of it, without a sealed seed.
    async fn summary(&self, caller: &Caller, id: &EpisodeId) -> Result<EpisodeSummary, ApiError> {
        let stored = self.store.find_summary(id).await?;
        self.listed(caller, &stored.ok_or_else(|| ApiError::not_found("the episode"))?)
    }

    /// An episode of which the caller may read the states, as it is shown.
    pub(super) async fn readable_summary(
        &self,
        caller: &Caller,
        id: &str,
    ) -> Result<EpisodeSummary, ApiError> {
        let stored = self.readable_episode(caller, id.to_owned()).await?;
        self.listed(caller, &stored)
    }

    /// A stored episode as lists show it to `caller`: without a sealed seed.
    fn listed(&self, caller: &Caller, stored: &StoredEpisode) -> Result<EpisodeSummary, ApiError> {
        let spec = spec(stored)?;
        let permit = self.open_permit_of_game(caller, stored, &spec);
        self.summary_of(caller, stored, &spec, permit)
    }

    /// A stored episode as it is shown to `caller`.
    fn summary_of(
        &self,
        caller: &Caller,
        stored: &StoredEpisode,
        spec: &Spec,
        permit: SeedPermit,
    ) -> Result<EpisodeSummary, ApiError> {
        let status = Status::parse(&stored.status).ok_or_else(|| broken("an unknown status"))?;
        let may_read = caller.may_read(&self.access, self.subject(stored, spec));
        let reason = stored.reason.as_ref().filter(|_| may_read);
        let result = reason.map(|reason| EpisodeResult {
            reason: reason.clone(),
            score: stored.score,
            rounds: stored.rounds,
            journal_head: stored.head.to_string(),
        });
        Ok(EpisodeSummary {
            id: stored.id.to_string(),
            status,
            task: spec.config.task().name().to_owned(),
            model: spec.model.clone(),
            run: spec.run.clone(),
            round: stored.rounds,
            // Where rounds are private, a seat learns the score from its own observations.
            score: if may_read { stored.score } else { 0.0 },
            created_at: stored.created_at.into(),
            ended_at: stored.ended_at.map(Into::into),
            result,
            void_reason: stored.void_reason.clone(),
            fork: spec.fork.as_ref().map(|fork| shown_fork(fork, permit)),
            people: stored.has_people && (status.is_over() || !spec.is_mixed()),
            mixed: spec.is_mixed(),
            // A sealed game is read from its own routes, which note who reads it.
            curve: stored.curve.clone().filter(|_| may_read && permit.is_granted()),
            config: config(spec, permit),
        })
    }
}

/// Public fork point of an episode. The head needs a permit: with it the seed can be found by trial.
fn shown_fork(fork: &Fork, permit: SeedPermit) -> shown::Fork {
    let Fork { episode, round, head } = fork.clone();
    shown::Fork { episode, round, head: permit.show(head) }
}

/// Decisions in an open game of several holders are shown to those who oversee it alone: the holders know of each other only
/// what they see and hear.
fn may_see_decisions(app: &App, caller: &Caller, stored: &StoredEpisode) -> Result<bool, ApiError> {
    let spec = spec(stored)?;
    let subject = app.subject(stored, &spec);
    Ok(!subject.is_mixed || subject.is_over || caller.oversees(subject))
}

fn broken(problem: &str) -> ApiError {
    tracing::error!(problem, "a stored episode cannot be read");
    ApiError::new(Code::Internal, "what is stored of this episode cannot be read")
}

pub(super) fn spec(stored: &StoredEpisode) -> Result<Spec, ApiError> {
    match stored.opening.read() {
        Ok(Record::Opening(opening)) => {
            Spec::from_opening(&opening).map_err(|problem| broken(&problem))
        }
        Ok(Record::Seats(_) | Record::Round(_) | Record::End(_)) => Err(broken("no opening")),
        Err(error) => Err(broken(&error.to_string())),
    }
}

/// All settings of an episode as they are shown.
fn config(spec: &Spec, permit: SeedPermit) -> EpisodeConfig {
    let settings = spec.config.settings();
    EpisodeConfig {
        task: settings.task,
        seed: permit.show(spec.config.seed()),
        rules: settings.rules,
        round_deadline_s: spec.round_deadline.map(Seconds::of),
        bank_s: Seconds::of(spec.bank),
        start: if spec.manual_start { "manual" } else { "now" }.to_owned(),
        idle_timeout_s: Seconds::of(spec.idle_timeout),
        visibility: spec.visibility.name().to_owned(),
        model: spec.model.clone(),
        agent_meta: spec.agent_meta.clone(),
        prompt_template: spec.custom_template.then(|| spec.prompt_template.to_string()),
        open_seats: u16::try_from(spec.open_seats.len()).expect("at most 1,024 agents"),
        fill_after_s: spec.fill_after.map(Seconds::of),
        fill_with: spec.fill_with.clone(),
        player: spec.player.clone(),
        ..EpisodeConfig::from(&*spec.config)
    }
}
