//! `POST /api/v1/competitions`.

use jiff::Timestamp;
use serde_json::json;
use swarmbench_engine::Settings;

use super::super::answer;
use super::super::prelude::*;
use super::shown;
use crate::competitions::new_id;
use crate::store::entries::{CompetitionRow, Entry, Secret};
use swarmbench_boards::competition::definition::{
    ATTEMPTS_MAX, Admission, BoardRule, Counts, Definition, OwnGames, TieBreak, Window,
};
use swarmbench_boards::competition::sealed::Sealed;
use swarmbench_clock::millis;
use swarmbench_protocol::competition::{
    AttemptWindow, Attempts, Competition, CompetitionRequest, SealedSettings, Terms,
};
use swarmbench_protocol::suite::SuiteSettings;

/// Create a competition on sealed seeds, which the server draws now.
///
/// The games never change; texts and ends of windows may (`PATCH`). The answer has the commitment: publish it before anybody
/// plays.
#[utoipa::path(
    post,
    path = "/api/v1/competitions",
    operation_id = "create_competition",
    tag = "competitions",
    request_body(content = CompetitionRequest, description = "At most 256 KiB"),
    responses(
        (status = 201, description = "The competition", body = Competition),
        (status = 403, description = "`forbidden`: not an organizer's key"),
    )
)]
pub(in super::super) async fn create_competition(
    State(app): State<App>,
    organizer: Organizer,
    _: Params<Nothing>,
    Json(request, _): Json<CompetitionRequest>,
) -> Result<Response, ApiError> {
    let now = app.clock.wall();
    let definition = definition(request, now)?;
    let sealed = Sealed::draw(definition.sealed_seeds(), &*app.entropy);
    let id = new_id(now, &*app.entropy);
    let commitment = sealed.commitment();
    let row = CompetitionRow {
        id: id.clone(),
        definition: serde_json::to_string(&definition).expect("a definition has string keys"),
        salt: Secret(sealed.salt.to_vec()),
        seeds: Secret(sealed.seeds.concat()),
        commitment,
        opens_at: definition.opens_at,
        closes_at: definition.closes_at,
        at: now,
    };
    let commitment = data_encoding::HEXLOWER.encode(&commitment);
    let detail = json!({ "name": definition.name, "commitment": commitment });
    let audit_entry = organizer.audit_entry(&app, "competition.create", &id, detail);
    app.store.keep(vec![Entry::AddCompetition(Box::new(row)), audit_entry]).await?;
    tracing::info!(competition = %id, commitment, "created");
    let stored = app.stored_competition(&id).await?;
    Ok(answer::created(&format!("/api/v1/competitions/{id}"), shown(&stored, now)))
}

/// Validates the request; reports all errors at once.
fn definition(request: CompetitionRequest, now: Timestamp) -> Result<Definition, ApiError> {
    let mut problems = Problems::default();
    let clocks = request.clocks.unwrap_or_default();
    let deadline_s = clocks.round_deadline_s.map(|s| s.0);
    let deadline = problems.seconds("clocks.round_deadline_s", deadline_s, 1.0, 0.05, 86_400.0);
    let bank = problems.seconds("clocks.bank_s", clocks.bank_s.map(|s| s.0), 0.0, 0.0, 604_800.0);
    let idle_s = clocks.idle_timeout_s.map(|s| s.0);
    let idle = problems.seconds("clocks.idle_timeout_s", idle_s, 86_400.0, 1.0, 31_536_000.0);
    let mut refuse = |field: &str, problem: String| problems.refuse(field, problem);
    let is_missing = || "is missing".to_owned();
    for (field, is_there) in [
        ("name", request.name.is_some()),
        ("opens_at", request.opens_at.is_some()),
        ("closes_at", request.closes_at.is_some()),
    ] {
        if !is_there {
            refuse(field, is_missing());
        }
    }
    if deadline_s.is_none() {
        refuse(
            "clocks.round_deadline_s",
            "is missing: a round that runs at the closing time could go on for ever".to_owned(),
        );
    }
    let entry = one_of(request.entry, Admission::ALL, Admission::name, "entry", &mut refuse);
    let counts = one_of(request.counts, Counts::ALL, Counts::name, "counts", &mut refuse);
    let board = one_of(request.board, BoardRule::ALL, BoardRule::name, "board", &mut refuse);
    let own_games =
        one_of(request.own_games, OwnGames::ALL, OwnGames::name, "own_games", &mut refuse);
    let mut tie_breaks = Vec::new();
    for name in request.tie_breaks.unwrap_or_default() {
        let found = one_of(Some(name), TieBreak::ALL, TieBreak::name, "tie_breaks", &mut refuse);
        tie_breaks.extend(found);
    }
    // A missing time is already reported, and replaced here. Times are stored to the millisecond.
    let whole = |at: Timestamp| Timestamp::from_millisecond(at.as_millisecond()).unwrap_or(at);
    let opens_at = whole(request.opens_at.map_or(now, Into::into));
    let closes_at = whole(request.closes_at.map_or(Timestamp::MAX, Into::into));
    let attempts = match request.attempts.unwrap_or(Attempts::Count(1)) {
        Attempts::Count(count) if count as usize > ATTEMPTS_MAX => {
            refuse("attempts", format!("must be from 1 to {ATTEMPTS_MAX}, is {count}"));
            vec![Window { opens_at, closes_at }]
        }
        Attempts::Count(count) => vec![Window { opens_at, closes_at }; count as usize],
        Attempts::Windows(windows) => windows
            .into_iter()
            .map(|AttemptWindow { opens_at: from, closes_at: to }| Window {
                opens_at: from.map_or(opens_at, |at| whole(at.into())),
                closes_at: to.map_or(closes_at, |at| whole(at.into())),
            })
            .collect(),
    };
    let suite = request.suite.unwrap_or_default();
    let all_tasks = || swarmbench_engine::TaskName::ALL.map(|task| task.name().to_owned()).to_vec();
    let definition = Definition {
        name: request.name.unwrap_or_else(|| "?".to_owned()),
        description: request.description.unwrap_or_default(),
        tasks: suite.tasks.unwrap_or_else(all_tasks),
        seeds: suite.seeds.unwrap_or(5),
        rules: suite.rules.unwrap_or_else(|| "paper".to_owned()),
        settings: settings(&suite.settings.unwrap_or_default(), millis(deadline), millis(bank)),
        idle_timeout_ms: millis(idle),
        opens_at,
        closes_at,
        entry: entry.unwrap_or(Admission::Anybody),
        attempts,
        spares: request.spares.unwrap_or(0),
        parallel: request.parallel.unwrap_or(5),
        counts: counts.unwrap_or(Counts::Best),
        board: board.unwrap_or(BoardRule::Public),
        board_freezes_at: request.board_freezes_at.map(Into::into),
        entries_per_key: request.entries_per_key.unwrap_or(1),
        attempts_per_day: request.attempts_per_day,
        public_seeds: suite.public_seeds.unwrap_or(0),
        terms: request.terms.map(|text| Terms { version: 1, text }),
        categories: request.categories.unwrap_or_default(),
        tie_breaks,
        own_games: own_games.unwrap_or_default(),
        seeds_by_task: true,
    };
    for (field, problem) in definition.problems_when_new(now) {
        problems.refuse(&field, problem);
    }
    problems.none_or(Some(definition))
}

fn settings(asked: &SealedSettings, deadline_ms: u64, bank_ms: u64) -> SuiteSettings {
    SuiteSettings {
        round_deadline_ms: Some(deadline_ms),
        bank_ms,
        ..SuiteSettings::from(&asked.over(Settings::default()))
    }
}

/// Value with the requested name, if there is a request.
fn one_of<T: Copy, const N: usize>(
    asked: Option<String>,
    all: [T; N],
    name: impl Fn(T) -> &'static str,
    field: &str,
    refuse: &mut impl FnMut(&str, String),
) -> Option<T> {
    let asked = asked?;
    let found = all.into_iter().find(|one| name(*one) == asked);
    if found.is_none() {
        let names = all.map(name).join(", ");
        let is: String = asked.chars().take(40).collect();
        refuse(field, format!("must be one of {names}, is {is:?}"));
    }
    found
}
