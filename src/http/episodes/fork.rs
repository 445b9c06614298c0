//! `POST /api/v1/episodes/{id}/fork`.

use std::sync::Arc;

use axum::Extension;
use axum::http::HeaderMap;

use super::super::answer;
use super::super::client::Client;
use super::super::idempotency::{Idempotency, created_before, idempotency};
use super::super::prelude::*;
use super::super::seeds::SeedPermit;
use super::created::{Shown, Tokens, created_episode};
use super::describe::{DescribedGame, spec as checked_spec};
use super::shown_fork;
use crate::episode::past::Past;
use crate::episode::quota::Purpose;
use crate::episode::registry::Creation;
use crate::episode::spec::{Spec, Visibility};
use crate::fair::Party;
use crate::ids::EpisodeId;
use crate::store::StoreError;
use crate::store::port::StoredEpisode;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{Fork, RawRecord};
use swarmbench_protocol::episode::{CreatedForks, EpisodeRequest, ForkRequest};

/// Bytes of an act that is taken over, in memory.
const ACT_BYTES: usize = 512;

/// Fork an episode: play on from one of its rounds.
///
/// The request makes one or several new episodes that begin with the state of this one before round `round`, all or none.
/// Whoever may create episodes and may read the journal now may fork; sealed games can be forked after the reveal, games of
/// several holders after their end. The journal of a fork has the acts of the rounds before, without the answers of models.
/// Forks never count on boards. The tokens are shown only once. A repeat with the same `Idempotency-Key` and body returns the
/// same forks with new tokens and revokes the earlier ones.
#[utoipa::path(
    post,
    path = "/api/v1/episodes/{id}/fork",
    operation_id = "fork_episode",
    tag = "episodes",
    params(
        ("id" = String, Path, description = "The id of the episode that is continued"),
        ("Idempotency-Key" = Option<String>, Header, description = "Any text of at most 200 characters that names this creation"),
    ),
    request_body(content = ForkRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The forks, with their tokens", body = CreatedForks),
        (status = 403, description = "`forbidden`: the token of an episode cannot create one; the caller may not read the journal now; the game is sealed, or has several holders and has not ended; the key's share of the journal is used up"),
    )
)]
pub(in super::super) async fn fork_episode(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    Extension(client): Extension<Client>,
    _: Params<Nothing>,
    headers: HeaderMap,
    request: Unread,
) -> Result<Response, ApiError> {
    let creator = caller.creator(&app, client)?;
    let (stored, parent, parents) = app.forkable(&caller, id, "it can be forked").await?;
    let (request, body) = request.read::<ForkRequest>(&app).await?;
    let named = [b"fork ", stored.id.as_str().as_bytes(), b" ", body.as_ref()].concat();
    let idempotency = idempotency(&headers, creator.0.owner(), named, &app.limits)?;
    let plan = Plan::new(request, stored, &parent, &app)?;
    let permit = SeedPermit::of_creator(&caller, &plan.spec);
    // A repeat must find what the first one creates, also if its client hangs up.
    detached(async move {
        let _lock = app.creations.lock_key(idempotency.as_ref()).await;
        let find = |key| app.store.created_with(key);
        let (fork, made) = match created_before(idempotency.as_ref(), find).await? {
            None => plan.create(&app, creator, idempotency).await?,
            Some(first) => plan.replace_tokens(&app, first).await?,
        };
        let made = made.iter().map(|(shown, tokens)| created_episode(shown, tokens, permit));
        let forks = CreatedForks { fork: shown_fork(&fork, parents), episodes: made.collect() };
        Ok(answer::created(&format!("/api/v1/episodes?fork_of={}", forks.fork.episode), forks))
    })
    .await
}

impl App {
    /// An episode that the caller may fork now, with the permit to show its seed. A refusal says when `it` is possible.
    pub(super) async fn forkable(
        &self,
        caller: &Caller,
        id: String,
        it: &str,
    ) -> Result<(StoredEpisode, Spec, SeedPermit), ApiError> {
        let (stored, spec) = self.known_episode(caller, id).await?;
        let permit = self.open_permit_of_game(caller, &stored, &spec);
        let is_over = stored.ended_at.is_some();
        let detail = match spec.visibility {
            Visibility::Sealed if !stored.revealed => {
                format!("this game is sealed: {it} once its competition is revealed")
            }
            _ if spec.is_mixed() && !is_over => {
                format!("this episode has several seat holders: {it} after its end")
            }
            _ if !permit.is_granted() => format!(
                "all that was played, and its seed, are in what this shows: until the end of this episode {it} only by its creator"
            ),
            _ => return Ok((stored, spec, permit)),
        };
        Err(ApiError::new(Code::Forbidden, detail))
    }
}

/// Forks that are to be made of an episode.
struct Plan {
    parent: StoredEpisode,
    round: u32,
    count: u32,
    /// Description of each fork, but for its place in the parent.
    spec: Spec,
}

type Made = Vec<(Shown, Tokens)>;

impl Plan {
    /// Validates the request; all errors are reported at once.
    fn new(
        request: ForkRequest,
        stored: StoredEpisode,
        parent: &Spec,
        app: &App,
    ) -> Result<Self, ApiError> {
        let limits = &app.limits;
        let mut problems = Problems::default();
        let resolved = stored.rounds.min(limits.fork_rounds_max);
        let round = match request.round {
            Some(round) => u32::try_from(round).ok().filter(|round| *round <= resolved),
            None => None,
        };
        match request.round {
            None => problems.refuse("round", "is missing: how many rounds are taken over"),
            Some(asked) if round.is_none() => problems.refuse(
                "round",
                if resolved < stored.rounds {
                    format!("must be from 0 to fork_rounds_max, {resolved}, is {asked}")
                } else {
                    format!(
                        "must be from 0 to the rounds that were resolved, {resolved}, is {asked}"
                    )
                },
            ),
            Some(_) => {}
        }
        let asked = request.count.unwrap_or(1);
        let count =
            u32::try_from(asked).ok().filter(|count| (1..=limits.fork_count_max).contains(count));
        if count.is_none() {
            let most = limits.fork_count_max;
            problems
                .refuse("count", format!("must be from 1 to fork_count_max, {most}, is {asked}"));
        }
        let agents = u64::from(parent.config.num_agents());
        let (seats, acts) = (
            agents * u64::from(count.unwrap_or(0)),
            agents * u64::from(count.unwrap_or(0)) * u64::from(round.unwrap_or(0)),
        );
        for (name, most, is) in [
            ("fork_seats_max", limits.fork_seats_max, seats),
            ("fork_acts_max", limits.fork_acts_max, acts),
        ] {
            if is > most {
                let what = if name == "fork_seats_max" { "seats" } else { "acts" };
                let problem = format!(
                    "together the forks would have {is} {what}, more than {name}, {most}; make fewer at once"
                );
                problems.refuse("count", problem);
            }
        }
        let usual = Some(parent.visibility).filter(|visibility| *visibility != Visibility::Sealed);
        let has_template = request.prompt_template.is_some();
        let request = EpisodeRequest {
            visibility: request.visibility.or_else(|| usual.map(|usual| usual.name().to_owned())),
            round_deadline_s: request.round_deadline_s,
            bank_s: request.bank_s,
            start: request.start,
            idle_timeout_s: request.idle_timeout_s,
            model: request.model,
            agent_meta: request.agent_meta,
            prompt_template: request.prompt_template,
            open_seats: request.open_seats,
            fill_after_s: request.fill_after_s,
            fill_with: request.fill_with,
            player: request.player,
            ..EpisodeRequest::default()
        };
        let game = DescribedGame {
            config: Some(Arc::clone(&parent.config)),
            task: Some(parent.config.task()),
            agents: parent.config.num_agents().into(),
        };
        let mut spec = checked_spec(request, game, problems, app)?;
        if !has_template {
            spec.prompt_template = Arc::clone(&parent.prompt_template);
            spec.custom_template = parent.custom_template;
            spec.prompt_revision = parent.prompt_revision;
        }
        let (round, count) = (round.unwrap_or(0), count.unwrap_or(1));
        Ok(Self { parent: stored, round, count, spec })
    }

    async fn create(
        mut self,
        app: &App,
        (party, purpose): (Party, Purpose),
        mut idempotency: Option<Idempotency>,
    ) -> Result<(Fork, Made), ApiError> {
        self.spec.config.check_new().map_err(|errors| ApiError::settings(errors, ""))?;
        app.check_disk()?;
        let acts = self.round as usize * usize::from(self.spec.config.num_agents());
        let _memory = app.registry.room(acts * ACT_BYTES)?;
        let permit = app.heavy.replay().await?;
        let config = Arc::clone(&self.spec.config);
        let past = Past::read(app.registry.host(), &self.parent, config, self.round).await?;
        drop(permit);
        if past.is_over() {
            let problem = format!(
                "must be less than {}: the game is over then; play on from an earlier one",
                self.round
            );
            let mut problems = Problems::default();
            problems.refuse("round", problem);
            return problems.none_or(None);
        }
        let fork = self.fork(app).await?;
        self.spec.fork = Some(fork.clone());
        let all_tokens: Vec<Tokens> =
            (0..self.count).map(|_| Tokens::new(app, &self.spec)).collect();
        let creation = |tokens: &Tokens| Creation {
            id: EpisodeId::new(app.clock.wall(), &*app.entropy),
            party,
            purpose,
            run: None,
            spec: self.spec.clone(),
            holder_metas: Vec::new(),
            tokens: tokens.rows(),
            // The first one is found by it, and the others follow.
            idempotency: idempotency.take(),
        };
        let creations = all_tokens.iter().map(creation).collect();
        let handles = app.registry.fork(creations, self.parent.episode, past).await?;
        Ok((fork, handles.iter().map(Shown::of).zip(all_tokens).collect()))
    }

    async fn replace_tokens(self, app: &App, first: EpisodeId) -> Result<(Fork, Made), ApiError> {
        let mut forks = Vec::new();
        for id in app.store.forks_made_with(&first, self.count).await? {
            forks.push(Shown::find(app, &id).await?);
        }
        let tokens = Tokens::replaced(app, &forks).await?;
        let fork = self.fork(app).await?;
        Ok((fork, forks.into_iter().zip(tokens).collect()))
    }

    /// The place of the forks in their parent.
    async fn fork(&self, app: &App) -> Result<Fork, ApiError> {
        let Self { parent, round, .. } = self;
        let link = |head: Head, raw: &RawRecord| head.link(raw.as_str().as_bytes());
        let before = match round.checked_sub(1) {
            None => link(Head::START, &parent.opening),
            Some(last) => {
                let rows = app.store.resolved(parent.episode, last, *round).await?;
                let missing =
                    || StoreError::broken(format!("round {last} of {} is missing", parent.id));
                rows.first().ok_or_else(missing)?.head
            }
        };
        let seating = parent.seating.as_ref().filter(|_| *round == parent.first_round);
        let head = seating.map_or(before, |raw| link(before, raw));
        Ok(Fork { episode: parent.id.to_string(), round: *round, head: head.to_string() })
    }
}
