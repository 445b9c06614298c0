//! Public views of a competition, in the shapes of the wire.

use std::collections::BTreeMap;

use jiff::Timestamp;
use sha2::{Digest, Sha256};
use swarmbench_engine::Settings;
use swarmbench_protocol::Seconds;
use swarmbench_protocol::competition::{
    AttemptWindow, Clocks, Competition, CompetitionRow, EntrantSummary, SealedSettings,
    SealedSuite, TaskMean,
};
use swarmbench_protocol::failure::Failures;

use super::definition::{Definition, Window};
use super::entrant::Entrant;
use super::phase::Phase;
use super::standings::{Standing, TaskRow};
use crate::run::NO_PROMPT;

/// Bytes of a revision: enough that consecutive ones never collide.
const REVISION_BYTES: usize = 8;

/// Public view of a competition at a moment. It includes the salt and the seeds only once they are public.
#[must_use]
pub fn competition(
    id: &str,
    definition: &Definition,
    commitment: &[u8; 32],
    created_at: Timestamp,
    state: State,
    now: Timestamp,
) -> Competition {
    let hex = |bytes: &[u8]| data_encoding::HEXLOWER.encode(bytes);
    let State { revealed, cancelled, hidden } = state;
    let (cancelled_at, cancel_reason) = cancelled.unzip();
    let (revealed_at, salt, seeds) = match revealed {
        Some(Revealed { at, salt, seeds }) => {
            let seeds = seeds.iter().map(|seed| hex(seed)).collect();
            (Some(at), Some(hex(&salt)), Some(seeds))
        }
        None => (None, None, None),
    };
    let settings = &definition.settings;
    let seconds = |ms: u64| Seconds::of(std::time::Duration::from_millis(ms));
    let window = |window: &Window| AttemptWindow {
        opens_at: Some(window.opens_at.into()),
        closes_at: Some(window.closes_at.into()),
    };
    Competition {
        id: id.to_owned(),
        name: definition.name.clone(),
        description: definition.description.clone(),
        phase: Phase::at(definition, revealed_at.is_some(), cancelled_at.is_some(), now)
            .name()
            .to_owned(),
        opens_at: definition.opens_at.into(),
        closes_at: definition.closes_at.into(),
        suite: SealedSuite {
            tasks: Some(definition.tasks.clone()),
            seeds: Some(definition.seeds),
            public_seeds: Some(definition.public_seeds),
            rules: Some(definition.rules.clone()),
            settings: Some(SealedSettings::from(&Settings::from(settings))),
        },
        clocks: Clocks {
            round_deadline_s: settings.round_deadline_ms.map(seconds),
            bank_s: Some(seconds(settings.bank_ms)),
            idle_timeout_s: Some(seconds(definition.idle_timeout_ms)),
        },
        entry: definition.entry.name().to_owned(),
        attempts: definition.attempts.iter().map(window).collect(),
        spares: definition.spares,
        parallel: definition.parallel,
        counts: definition.counts.name().to_owned(),
        board: definition.board.name().to_owned(),
        board_freezes_at: definition.board_freezes_at.map(Into::into),
        entries_per_key: definition.entries_per_key,
        attempts_per_day: definition.attempts_per_day,
        terms: definition.terms.clone(),
        categories: definition.categories.clone(),
        own_games: definition.own_games.name().to_owned(),
        seeds_by_task: definition.seeds_by_task,
        tie_breaks: definition.tie_breaks.iter().map(|rule| rule.name().to_owned()).collect(),
        commitment: hex(commitment),
        salt,
        seeds,
        created_at: created_at.into(),
        revealed_at: revealed_at.map(Into::into),
        cancelled_at: cancelled_at.map(Into::into),
        cancel_reason,
        hidden,
        revision: revision(definition, hidden),
    }
}

/// Revision of the fields that organizers may change: a digest.
#[must_use]
pub fn revision(definition: &Definition, hidden: bool) -> String {
    let written = serde_json::to_vec(&(definition, hidden)).expect("string keys");
    data_encoding::HEXLOWER.encode(&Sha256::digest(written)[..REVISION_BYTES])
}

/// Mutable state of a competition.
#[derive(Clone, Debug, Default)]
pub struct State {
    /// Published secret, after the end.
    pub revealed: Option<Revealed>,
    /// Time and reason of the cancellation, if the competition was cancelled.
    pub cancelled: Option<(Timestamp, String)>,
    /// True if lists omit the competition.
    pub hidden: bool,
}

/// Secret that is published after the end.
#[derive(Clone, Debug)]
pub struct Revealed {
    /// Time of the publication.
    pub at: Timestamp,
    /// Salt.
    pub salt: [u8; 32],
    /// Sealed seeds.
    pub seeds: Vec<[u8; 16]>,
}

impl From<&Entrant> for EntrantSummary {
    fn from(entrant: &Entrant) -> Self {
        Self {
            id: entrant.id.clone(),
            name: entrant.name.clone(),
            model: entrant.declaration.model.clone(),
            temperature: entrant.declaration.temperature,
            top_p: entrant.declaration.top_p,
            prompt_template: entrant.declaration.template_digest(),
            prompt: entrant.declaration.prompt_name().unwrap_or_else(|| NO_PROMPT.to_owned()),
            status: entrant.status.name().to_owned(),
            reason: entrant.reason.clone(),
            vouched: entrant.vouched,
            registered_at: entrant.registered_at.into(),
            category: entrant.category.clone(),
            terms: entrant.terms,
            erased: entrant.erased,
        }
    }
}

impl From<&TaskRow> for TaskMean {
    fn from(row: &TaskRow) -> Self {
        Self {
            task: row.task.clone(),
            mean: row.mean,
            deviation: row.deviation,
            games: row.games,
            planned: row.planned,
            voided: row.voided,
        }
    }
}

/// A row of the board, with or without the results by task.
#[must_use]
pub fn row(standing: &Standing, entrant: &Entrant, with_tasks: bool) -> CompetitionRow {
    let Standing { row, difference, replays } = standing;
    #[expect(clippy::cast_precision_loss, reason = "nobody makes 2⁵³ moves")]
    let share = |part: u64, whole: u64| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
    let games: u32 = row.tasks.iter().map(|task| task.games).sum();
    CompetitionRow {
        rank: row.rank,
        entrant: entrant.into(),
        attempt: replays.or(row.attempt),
        on_spare_seeds: replays.is_some(),
        run: row.run.clone(),
        run_status: row.run_status.clone(),
        tasks: if with_tasks { row.tasks.iter().map(Into::into).collect() } else { Vec::new() },
        // The total of a single game is its score, which is secret until the end.
        total: row.total.filter(|_| with_tasks || games >= 2),
        difference: difference.clone().filter(|_| with_tasks),
        invalid_share: share(row.invalid, row.answers),
        // The number of failures reveals how long games were, which is secret as long as the seeds are.
        failures: if with_tasks { row.failures } else { Failures::EMPTY },
        timeout_share: share(row.timeouts, row.answers + row.timeouts),
        clock_share: share(row.timeouts, row.answers + row.timeouts),
        voided_games: row.voided_games,
        attempts: row.attempts,
        voided_attempts: row.voided_attempts,
        decentralization: row.decentralization.clone(),
        metrics: BTreeMap::new(),
    }
}
