//! Standings: the counting attempt of each entrant, and the ranking.
//!
//! Attempts count once they are over, whatever their end; voided ones do not count. [`mod@crate::rank`] defines the value of an
//! attempt and the equality of totals; the tie-breaks of the definition order equal totals.

use std::cmp::Ordering;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_journal::Tally;
use swarmbench_prompt::Identity;
use swarmbench_protocol::board::RowDifference;
use swarmbench_protocol::failure::Failures;

use super::EntrantStatus;
use super::definition::{Counts, Definition, TieBreak};
use super::entrant::Entrant;
use crate::page::row_difference;
use crate::rank::{Pick, RankedRow, View, difference_above, rank};
use crate::result::RunResult;
use crate::run::is_human;
use crate::{Decentralization, EndedGame, Owner, PlayedRun, Player, Slot};

/// An attempt, with the games that have ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Attempt {
    /// Id of the entrant.
    pub entrant: String,
    /// Number, from 1.
    pub number: u32,
    /// Voided attempt that this spare attempt replaces.
    pub replays: Option<u32>,
    /// Public id of the run.
    pub run: String,
    /// Name of the run's status.
    pub status: String,
    /// True if the attempt and all of its games have ended.
    pub is_over: bool,
    /// True if the whole attempt was voided.
    pub voided: bool,
    /// Start of the attempt.
    pub created_at: Timestamp,
    /// End of the attempt.
    pub ended_at: Option<Timestamp>,
    /// Planned games.
    pub plan: Vec<Slot>,
    /// Ended games.
    pub games: Vec<EndedGame>,
}

swarmbench_engine::named! {
    /// Part of an attempt's seeds that makes a board.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum Part {
        /// The first seeds, as many as the definition says; all, if it says none.
        Public = "public",
        /// All other seeds.
        Final = "final",
    }
}

impl Attempt {
    /// The games of the attempt that were planned and played on the seeds of a part.
    #[must_use]
    pub fn part(mut self, definition: &Definition, part: Part) -> Self {
        if definition.public_seeds > 0 {
            // The plan lists the seeds of one task after another.
            let public: BTreeSet<Slot> = (0..definition.seeds)
                .cycle()
                .zip(&self.plan)
                .filter(|(place, _)| *place < definition.public_seeds)
                .map(|(_, slot)| *slot)
                .collect();
            let is_in = |slot: &Slot| public.contains(slot) == (part == Part::Public);
            self.plan.retain(is_in);
            self.games.retain(|game| is_in(&game.slot));
        }
        self
    }
}

/// A row of the board, with fields that are not in a published file.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// The row.
    pub row: StandingsRow,
    /// Distance below the nearest row above; `None` for the first row, and for entrants without a rank.
    pub difference: Option<RowDifference>,
    /// Voided attempt in whose place the counting one was played.
    pub replays: Option<u32>,
}

/// A row of the board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StandingsRow {
    /// Rank with gaps, such as 1, 2, 2, 4. `None` without a counting attempt, and for entrants that withdrew or were
    /// disqualified.
    #[serde(deserialize_with = "Option::deserialize")]
    pub rank: Option<u32>,
    /// Id of the entrant.
    pub entrant: String,
    /// Number of the counting attempt, if there is one.
    #[serde(deserialize_with = "Option::deserialize")]
    pub attempt: Option<u32>,
    /// Run of that attempt.
    #[serde(deserialize_with = "Option::deserialize")]
    pub run: Option<String>,
    /// Status of the run.
    #[serde(deserialize_with = "Option::deserialize")]
    pub run_status: Option<String>,
    /// Results in every task of the competition.
    pub tasks: Vec<TaskRow>,
    /// Sum of the means, if an attempt counts.
    #[serde(deserialize_with = "Option::deserialize")]
    pub total: Option<f64>,
    /// Answers of players in the games that count.
    pub answers: u64,
    /// Invalid answers among them.
    pub invalid: u64,
    /// Invalid answers by reason. Games of earlier versions do not record it.
    #[serde(default, skip_serializing_if = "Failures::is_empty")]
    pub failures: Failures,
    /// Moves that timed out.
    pub timeouts: u64,
    /// Voided games of the attempt.
    pub voided_games: u32,
    /// Attempts that are over and were not voided.
    pub attempts: u32,
    /// Voided attempts.
    pub voided_attempts: u32,
    /// `declared` or `enforced`; `None` under centralized control.
    #[serde(deserialize_with = "Option::deserialize")]
    pub decentralization: Option<String>,
}

/// Result of an attempt in a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskRow {
    /// The task.
    pub task: String,
    /// Mean of the scores.
    #[serde(deserialize_with = "Option::deserialize")]
    pub mean: Option<f64>,
    /// Population standard deviation of the scores.
    #[serde(deserialize_with = "Option::deserialize")]
    pub deviation: Option<f64>,
    /// Number of games that were played and count.
    pub games: u32,
    /// Number of planned games, without voided ones.
    pub planned: u32,
    /// Number of voided games.
    pub voided: u32,
}

/// Evidence that each seat decides for itself, which an entrant only declares: it has all seats of its games, so it can pool
/// their observations.
#[must_use]
pub fn decentralization(control: &str) -> Option<Decentralization> {
    (control == "decentralized").then_some(Decentralization::Declared)
}

/// Result of an attempt.
#[must_use]
pub fn result(definition: &Definition, entrant: &Entrant, attempt: &Attempt) -> RunResult {
    let declaration = &entrant.declaration;
    // The prompt revision is left out of the identity: rows that are equal otherwise are ordered by the identity of the player,
    // and the order in a published file must follow journal.md, the same in every version of the program.
    let prompt = Identity { template: declaration.template_digest(), ..Identity::default() };
    let run = PlayedRun {
        id: attempt.run.clone(),
        player: Player {
            owner: Some(Owner { id: entrant.id.clone(), name: entrant.name.clone() }),
            model: declaration.model.clone(),
            temperature: declaration.temperature,
            top_p: declaration.top_p,
            sampling: None,
            prompt,
            holders: Vec::new(),
        },
        status: attempt.status.clone(),
        created_at: attempt.created_at,
        vouched: entrant.vouched,
        decentralization: decentralization(&definition.settings.control),
        is_human: is_human(&declaration.agent_meta),
        prompt: declaration.prompt_name(),
        answer_reader: Some(definition.settings.answer_reader.clone()),
    };
    RunResult::new(run, &attempt.plan, &attempt.games, attempt.is_over)
}

/// Result of an attempt in each task of the competition.
#[must_use]
pub fn tasks_of(definition: &Definition, result: &RunResult) -> Vec<TaskRow> {
    let rows = definition.tasks().into_iter().filter_map(|task| result.task(task));
    rows.map(|of| TaskRow {
        task: of.task.name().to_owned(),
        mean: of.mean(),
        deviation: of.mean_and_deviation.map(|(_, deviation)| deviation),
        games: of.games,
        planned: of.planned,
        voided: of.voided,
    })
    .collect()
}

/// Attempts of an entrant, reduced to what the board shows: the counting attempt, and their numbers.
///
/// Attempts may be added in any order. The memory is that of one result, whatever their number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Played {
    counting: Option<Counting>,
    /// Attempts that are over and were not voided.
    over: u32,
    voided: u32,
    /// Attempts that were started and not voided.
    started: u32,
}

/// Counting attempt.
#[derive(Clone, Debug, PartialEq)]
struct Counting {
    result: Arc<RunResult>,
    number: u32,
    replays: Option<u32>,
    ended_at: Option<Timestamp>,
}

impl Played {
    /// Adds an attempt of the entrant. Each attempt may be added once only.
    pub fn add(&mut self, definition: &Definition, entrant: &Entrant, attempt: &Attempt) {
        if attempt.voided {
            self.voided += 1;
            return;
        }
        self.started += 1;
        if !attempt.is_over {
            return;
        }
        self.over += 1;
        let started = (attempt.created_at, attempt.run.as_str());
        let before = self.counting.as_ref().map(|one| {
            let run = &one.result.run;
            (started.cmp(&(run.created_at, run.id.as_str())), &one.result)
        });
        let may_count = |order: Ordering| match definition.counts {
            Counts::First => order.is_lt(),
            Counts::Last => order.is_gt(),
            Counts::Best => true,
        };
        if before.is_some_and(|(order, _)| !may_count(order)) {
            return;
        }
        let result = Arc::new(result(definition, entrant, attempt));
        if let Some((order, counting)) = before
            && definition.counts == Counts::Best
            && view(definition).compare(&result, counting).then(order).is_ge()
        {
            return;
        }
        let Attempt { number, replays, ended_at, .. } = *attempt;
        self.counting = Some(Counting { result, number, replays, ended_at });
    }

    /// Approximate bytes in memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let of = self.counting.as_ref().map_or(0, |one| one.result.bytes());
        size_of::<Self>() + of
    }

    fn result(&self) -> Option<&Arc<RunResult>> {
        self.counting.as_ref().map(|one| &one.result)
    }
}

/// View of the board of counting attempts.
fn view(definition: &Definition) -> View {
    // Each entrant has one run here, which was chosen before.
    View { tasks: definition.tasks(), sort: None, pick: Pick::Best }
}

/// The board of a competition: entrants with a rank in its order, then those without a counting attempt, then those who
/// withdrew or were disqualified.
#[must_use]
pub fn standings(
    definition: &Definition,
    entrants: &[Entrant],
    attempts: &[Attempt],
) -> Vec<Standing> {
    let places: HashMap<&str, usize> =
        entrants.iter().enumerate().map(|(place, entrant)| (entrant.id.as_str(), place)).collect();
    let mut played = vec![Played::default(); entrants.len()];
    for attempt in attempts {
        if let Some(&place) = places.get(attempt.entrant.as_str()) {
            played[place].add(definition, &entrants[place], attempt);
        }
    }
    let all: Vec<_> = entrants.iter().zip(&played).collect();
    standings_of(definition, &all)
}

/// [`standings`], for entrants with their attempts.
#[must_use]
pub fn standings_of(definition: &Definition, entrants: &[(&Entrant, &Played)]) -> Vec<Standing> {
    let view = view(definition);
    let is_active = |(entrant, _): &&(&Entrant, &Played)| entrant.status == EntrantStatus::Active;
    let (active, gone): (Vec<_>, Vec<_>) =
        entrants.iter().copied().partition(|one| is_active(&one));
    let runs: Vec<_> =
        active.iter().filter_map(|(_, played)| played.result().map(Arc::clone)).collect();
    let mut ranked = rank(&runs, [], &view);
    let by_id: HashMap<&str, (&Entrant, &Played)> =
        active.iter().map(|&of| (of.0.id.as_str(), of)).collect();
    let entrant_of = |row: &RankedRow| {
        let owner = row.shown()?.run.player.owner.as_ref()?;
        by_id.get(owner.id.as_str()).copied()
    };
    if !definition.tie_breaks.is_empty() {
        let facts = |of: &RankedRow| Facts::of(of, entrant_of(of).map(|(_, played)| played));
        break_ties(&mut ranked, &definition.tie_breaks, facts);
    }
    let mut rows: Vec<Standing> = Vec::with_capacity(entrants.len());
    for (place, of) in ranked.iter().enumerate() {
        let above = difference_above(&ranked, place, &view.tasks);
        let difference =
            above.and_then(|(to, of)| Some(row_difference(entrant_of(to)?.0.id.clone(), of)));
        rows.extend(entrant_of(of).map(|one| {
            let rank = of.rank;
            Standing { difference, ..standing(definition, &view, rank, one) }
        }));
    }
    let without = active.into_iter().filter(|(_, played)| played.counting.is_none());
    rows.extend(without.chain(gone).map(|one| standing(definition, &view, None, one)));
    rows
}

/// Values that tie-breaks compare.
struct Facts {
    tally: Tally,
    attempts: u32,
    ended_at: Option<Timestamp>,
}

impl Facts {
    fn of(ranked: &RankedRow, played: Option<&Played>) -> Self {
        Self {
            tally: ranked.shown().map(|shown| shown.tally()).unwrap_or_default(),
            attempts: played.map_or(0, |played| played.started),
            ended_at: played.and_then(|played| played.counting.as_ref()?.ended_at),
        }
    }

    /// Order of two entrants with equal totals by these rules: `Less` if `self` ranks higher.
    fn compare(&self, other: &Self, rules: &[TieBreak]) -> Ordering {
        // Shares are compared without rounding; 0 of 0 is 0.
        let share = |part: u64, whole: u64, other: u64, other_whole: u64| {
            let times = |part: u64, whole: u64| u128::from(part) * u128::from(whole.max(1));
            times(part, other_whole).cmp(&times(other, whole))
        };
        let (own, others) = (&self.tally, &other.tally);
        let of = |rule: &TieBreak| match rule {
            TieBreak::Invalid => share(own.invalid, own.acts, others.invalid, others.acts),
            TieBreak::Timeouts => {
                let moves = |of: &Tally| of.acts + of.timeouts;
                share(own.timeouts, moves(own), others.timeouts, moves(others))
            }
            TieBreak::Attempts => self.attempts.cmp(&other.attempts),
            TieBreak::Earliest => {
                let ended = |of: &Self| of.ended_at.unwrap_or(Timestamp::MAX);
                ended(self).cmp(&ended(other))
            }
        };
        rules.iter().map(of).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    }
}

/// Orders rows that share a rank by these rules; rows that are equal in all of them still share one.
fn break_ties(rows: &mut [RankedRow], rules: &[TieBreak], facts: impl Fn(&RankedRow) -> Facts) {
    for tied in rows.chunk_by_mut(|a, b| a.rank.is_some() && a.rank == b.rank) {
        let Some(first) = tied[0].rank.filter(|_| tied.len() > 1) else { continue };
        let mut with_facts: Vec<(Facts, RankedRow)> =
            tied.iter().map(|row| (facts(row), row.clone())).collect();
        with_facts.sort_by(|(a, _), (b, _)| a.compare(b, rules));
        let mut rank = first;
        for place in 0..with_facts.len() {
            let (before, from_here) = with_facts.split_at_mut(place);
            let (of, row) = &mut from_here[0];
            if before.last().is_some_and(|(above, _)| above.compare(of, rules).is_ne()) {
                rank = first + u32::try_from(place).unwrap_or(u32::MAX);
            }
            row.rank = Some(rank);
        }
        for (row, (_, sorted)) in tied.iter_mut().zip(with_facts) {
            *row = sorted;
        }
    }
}

fn standing(
    definition: &Definition,
    view: &View,
    rank: Option<u32>,
    (entrant, played): (&Entrant, &Played),
) -> Standing {
    let shown = played.result();
    let tally = shown.map(|shown| shown.tally()).unwrap_or_default();
    let voided = shown.map_or(0, |shown| shown.tasks.iter().map(|task| task.voided).sum());
    let row = StandingsRow {
        rank,
        entrant: entrant.id.clone(),
        attempt: played.counting.as_ref().map(|one| one.number),
        run: shown.map(|shown| shown.run.id.clone()),
        run_status: shown.map(|shown| shown.run.status.clone()),
        tasks: shown.map_or(Vec::new(), |shown| tasks_of(definition, shown)),
        total: shown.and_then(|shown| shown.total(&view.tasks)),
        answers: tally.acts,
        invalid: tally.invalid,
        failures: tally.failures,
        timeouts: tally.timeouts,
        voided_games: voided,
        attempts: played.over,
        voided_attempts: played.voided,
        decentralization: decentralization(&definition.settings.control)
            .map(|how| how.name().to_owned()),
    };
    let replays = played.counting.as_ref().and_then(|one| one.replays);
    Standing { row, difference: None, replays }
}
