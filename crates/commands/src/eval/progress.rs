//! Progress of an evaluation: on a terminal a bar for each game and one for all; otherwise a line when a run begins, when a game
//! ends, and every [`LINE_EVERY`].

use std::collections::BTreeMap;
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar};
use jiff::Timestamp;

use super::attempt;
use crate::output::{LINE_EVERY, note_width, progress_bar, progress_bars};
use swarmbench_client::eval::conduct::{Found, News};
use swarmbench_client::eval::plan::{Plan, Planned};
use swarmbench_client::eval::report::short;
use swarmbench_client::llm::Model;
use swarmbench_clock::{Clock, SystemClock, until};
use swarmbench_protocol::act::{Receipt, SwarmAct};
use swarmbench_protocol::failure::Failures;
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::run::{RunDetail, RunGame};

/// Minimum width of a terminal that shows a bar, in columns.
const WIDE_COLUMNS: u16 = 120;

/// Templates of the line for all games and of the line for one game. Longer text is cut, as a line that wraps could not be redrawn
/// in place.
const WIDE: (&str, &str) = (
    "{prefix:34!} {bar:24} {percent:>3} % {wide_msg}",
    "  {prefix:32!} {bar:24} {pos:>3}/{len:3} {wide_msg}",
);
const NARROW: (&str, &str) =
    ("{prefix:22!} {percent:>3} % {wide_msg}", "  {prefix:18!} {pos:>3}/{len:3} {wide_msg}");

/// Maximum open games that a line without a terminal names.
const GAMES_NAMED_MAX: usize = 3;

/// Maximum characters of the cause of retries.
const CAUSE_CHARS_MAX: usize = 160;

/// Template for one game when several models play and bars do not fit: with the name of the model.
const NARROW_WITH_MODEL: &str = "  {prefix:30!} {pos:>3}/{len:3} {wide_msg}";

pub(super) struct Progress<'a> {
    models: &'a [Vec<Model>],
    /// Address of the server.
    base: &'a str,
    bars: MultiProgress,
    total: ProgressBar,
    games: BTreeMap<String, GameProgress>,
    begun: Timestamp,
    last_line: Timestamp,
    /// Rounds of the plan, and how many of them are done.
    rounds: Rounds,
    /// Runs in progress, by their numbers in the plan.
    runs: BTreeMap<usize, RunProgress>,
    /// Number of runs in the plan.
    of: usize,
    /// Whether several runs may be played at the same time.
    is_several: bool,
    /// Counts of answers of this call that did not count, by reason.
    failures: Failures,
    /// Tokens of prompts and of answers behind the acts of this call that count.
    counted: [u64; 2],
    /// Acts that arrived after their round.
    late: u64,
}

/// A run in progress.
struct RunProgress {
    id: String,
    name: String,
    /// Rounds that need not be played any more.
    rounds: u64,
}

/// Rounds of all planned games. An ended game has no rounds left, however few it took.
#[derive(Clone, Copy, Debug, Default)]
struct Rounds {
    planned: u64,
    /// Rounds of the runs that are over.
    over: u64,
    /// Rounds that were done before this call.
    before: u64,
}

struct GameProgress {
    /// Number of its run.
    run: usize,
    bar: ProgressBar,
    name: String,
    round: u32,
    /// First round that was seen, and its time.
    since: (u32, Timestamp),
    max_round: u32,
    score: f64,
    /// Whether its last score is hidden.
    is_sealed: bool,
    prompt_tokens: u64,
    completion_tokens: u64,
    failures: Failures,
    is_over: bool,
}

impl<'a> Progress<'a> {
    pub(super) fn new(
        plan: &Plan,
        models: &'a [Vec<Model>],
        base: &'a str,
        is_several: bool,
    ) -> Self {
        let bars = progress_bars();
        let planned = plan.runs.iter().map(Planned::rounds_max).sum();
        let total = bars.add(progress_bar(if is_wide() { WIDE.0 } else { NARROW.0 }));
        total.set_length(planned);
        let now = SystemClock.now();
        Self {
            models,
            base,
            bars,
            total,
            games: BTreeMap::new(),
            begun: now,
            last_line: now,
            rounds: Rounds { planned, ..Rounds::default() },
            runs: BTreeMap::new(),
            of: plan.runs.len(),
            is_several,
            failures: Failures::EMPTY,
            counted: [0; 2],
            late: 0,
        }
    }

    pub(super) fn note(&mut self, number: usize, news: News<'_>) {
        match news {
            News::Begins(planned, found, run) => self.begin(number, planned, found, run),
            News::Looked(looked) => {
                for seen in looked {
                    self.look(number, &seen.sight);
                }
            }
            News::Acted(act, receipt) => self.act(number, act, receipt),
            News::Late(_) => self.late += 1,
            News::Polled(run) => self.stand(number, run),
            News::Ends(run) => self.end(number, run),
            News::Stopped => self.leave(number),
        }
    }

    pub(super) fn finish(&self) {
        for game in self.games.values() {
            game.bar.finish_and_clear();
        }
        self.total.finish_and_clear();
    }

    fn say(&self, line: &str) {
        // A line above bars goes to the terminal that has them; otherwise it is printed as usual.
        if self.bars.is_hidden() || self.bars.println(line).is_err() {
            note!("{line}");
        }
    }

    fn begin(&mut self, number: usize, planned: &Planned, found: &Found, run: &RunDetail) {
        let id = &run.run.id;
        let how = match found {
            Found::Finished => format!("{id} was played before"),
            Found::Resumed => {
                let (played, planned) = (run.run.played, run.run.planned);
                let parallel = run.run.parallel;
                format!("{id} resumes: {played} of {planned} games were played, {parallel} at once")
            }
            Found::Repeats(games) => format!(
                "{id} plays again what is kept beside it and counts no more: {}",
                games.join(", ")
            ),
            Found::New(None) => format!("{id} is new"),
            Found::New(Some((other, how))) => {
                format!("{id} is new; the unfinished {other} is another: {}", how.join(", "))
            }
        };
        let name = planned.name();
        let of = self.of;
        self.say(&match &planned.entry {
            Some(entry) => attempt::begun(entry, found, run),
            None => format!("run {} of {of}: {name}, {}: {how}", number + 1, planned.suite.name),
        });
        let rounds = done(run);
        self.rounds.before += rounds;
        self.runs.insert(number, RunProgress { id: id.clone(), name, rounds });
        if *found == Found::Finished {
            self.leave(number);
        } else {
            self.stand(number, run);
        }
        self.tell();
    }

    /// Removes a run that is over, with its games.
    fn leave(&mut self, number: usize) {
        self.rounds.over += self.runs.remove(&number).map_or(0, |run| run.rounds);
        self.games.retain(|_, game| {
            let stays = game.run != number;
            if !stays {
                game.bar.finish_and_clear();
            }
            stays
        });
    }

    /// Rounds that need not be played any more.
    fn done(&self) -> u64 {
        self.rounds.over + self.runs.values().map(|run| run.rounds).sum::<u64>()
    }

    /// Name of a game, with its player if several play.
    fn name_of(&self, number: usize, game: String) -> String {
        match self.runs.get(&number).filter(|_| self.is_several) {
            Some(run) => format!("{game} {}", run.name),
            None => game,
        }
    }

    fn game(
        &mut self,
        number: usize,
        episode: &str,
        task: &str,
        max_round: u32,
        round: u32,
    ) -> &mut GameProgress {
        let name = self.name_of(number, task.to_owned());
        let narrow = if self.is_several { NARROW_WITH_MODEL } else { NARROW.1 };
        let (bars, total) = (&self.bars, &self.total);
        self.games.entry(episode.to_owned()).or_insert_with(|| {
            let bar = progress_bar(if is_wide() { WIDE.1 } else { narrow });
            let bar = bar.with_prefix(name.clone());
            bar.set_length(max_round.into());
            GameProgress {
                run: number,
                bar: bars.insert_before(total, bar),
                name,
                round,
                since: (round, SystemClock.now()),
                max_round,
                score: 0.0,
                is_sealed: false,
                prompt_tokens: 0,
                completion_tokens: 0,
                failures: Failures::EMPTY,
                is_over: false,
            }
        })
    }

    fn look(&mut self, number: usize, sight: &Sight) {
        let Sight { episode, task, max_round, round, .. } = sight;
        let game = self.game(number, episode, &task.name, *max_round, *round);
        if game.round != sight.round || sight.round == 0 {
            game.round = sight.round;
            game.score = sight.score;
            game.tell();
        }
    }

    fn act(&mut self, number: usize, act: &SwarmAct, receipt: &Receipt) {
        let Some(game) = self.games.get_mut(&act.episode) else { return };
        let usage = act.usage.unwrap_or_default();
        let tokens = [usage.prompt_tokens.unwrap_or(0), usage.completion_tokens.unwrap_or(0)];
        let count = |sum: &mut u64, place: usize| *sum = sum.saturating_add(tokens[place]);
        count(&mut game.prompt_tokens, 0);
        count(&mut game.completion_tokens, 1);
        if !receipt.duplicate {
            (0..).zip(&mut self.counted).for_each(|(place, sum)| count(sum, place));
        }
        if let Some(failure) = receipt.failure {
            game.failures.count(failure);
            self.failures.count(failure);
        }
        if receipt.waiting_for == 0 {
            game.tell();
            if let Some(run) = self.runs.get_mut(&number) {
                run.rounds += 1;
            }
            self.tell();
        }
    }

    /// Takes over the server's state of all games of a run.
    fn stand(&mut self, number: usize, run: &RunDetail) {
        if let Some(known) = self.runs.get_mut(&number) {
            known.rounds = done(run);
        }
        let max_round = u32::try_from(run.run.suite.settings.max_round).unwrap_or(u32::MAX);
        for game in &run.games {
            let Some(episode) = &game.episode else { continue };
            if game.status == "running" || self.games.contains_key(episode) {
                let place = || format!(" #{}", game.slot + 1);
                let seed = game.seed.map_or_else(place, |seed| format!(" {seed}"));
                let name = self.name_of(number, format!("{}{seed}", game.task));
                let known = self.game(number, episode, &game.task, max_round, game.round);
                known.name = name;
                known.bar.set_prefix(known.name.clone());
                if is_over(game) && !known.is_over {
                    known.is_over = true;
                    known.round = game.round;
                    match game.score {
                        Some(score) => known.score = score,
                        None => known.is_sealed = true,
                    }
                    let line = format!(
                        "  {} ended after {} rounds: {}",
                        known.name,
                        known.round,
                        known.shown()
                    );
                    known.bar.finish_and_clear();
                    self.say(&line);
                }
            }
        }
        self.tell();
    }

    fn end(&mut self, number: usize, run: &RunDetail) {
        let result = run.run.tasks.iter().filter_map(|task| {
            Some(format!("{} {:.2} ± {:.2}", task.task, task.mean?, task.deviation?))
        });
        let line = result.collect::<Vec<_>>().join(", ");
        self.say(&format!("{}: {line}", run.run.model));
        self.leave(number);
        self.tell();
    }

    /// Waste of this call: tokens whose acts do not count, and requests whose tokens are unknown.
    pub(super) fn in_vain(&self) -> Vec<String> {
        let mut bought = [0_u64; 2];
        let (mut time_outs, mut dropped, mut odd_costs) = (0, 0, 0);
        for spent in self.models.iter().flatten().map(Model::spent) {
            let reported = [spent.prompt_tokens, spent.completion_tokens];
            for (sum, (asked, replayed)) in
                bought.iter_mut().zip(reported.into_iter().zip(spent.replayed_tokens))
            {
                *sum = sum.saturating_add(asked).saturating_add(replayed);
            }
            time_outs += spent.troubles.time_outs;
            dropped += spent.dropped;
            odd_costs += spent.odd_costs;
        }
        let [tokens_in, tokens_out] =
            [0, 1].map(|place| bought[place].saturating_sub(self.counted[place]));
        let mut lines = Vec::new();
        if tokens_in > 0 || tokens_out > 0 || self.late > 0 {
            let late = match self.late {
                0 => String::new(),
                late => format!("; {late} answers came when their round was over"),
            };
            lines.push(format!(
                "tokens of answers that no act was made of: {}+{}{late}",
                short(tokens_in),
                short(tokens_out)
            ));
        }
        if odd_costs > 0 {
            lines.push(format!(
                "answers with a reported cost that cannot be (negative, above 1,000 dollars, or no number), which was ignored, or a \
                 cost above what their prompt and limit of tokens allow by the price: {odd_costs}"
            ));
        }
        let unknown = [(time_outs, "timed out"), (dropped, "were not waited for")];
        let unknown: Vec<_> = (unknown.iter().filter(|(count, _)| *count > 0))
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        if !unknown.is_empty() {
            lines.push(format!(
                "requests that the endpoint may charge for, and that are asked again: {}",
                unknown.join(", ")
            ));
        }
        lines
    }

    /// Updates the bar of all games, or prints a line.
    fn tell(&mut self) {
        self.total.set_position(self.done());
        self.total.set_prefix(self.which());
        let now = SystemClock.now();
        let line = self.pace(now);
        self.total.set_message(line.clone());
        if self.bars.is_hidden() && until(self.last_line, now) >= LINE_EVERY {
            self.last_line = now;
            let (done, planned) = (self.done(), self.rounds.planned);
            note!("{}: {done} of {planned} rounds, {line}{}", self.which(), self.place());
        }
    }

    /// The open games and their rounds, and where to watch them, for a line without a terminal.
    fn place(&self) -> String {
        let open: Vec<_> = self.games.values().filter(|game| !game.is_over).collect();
        let mut parts: Vec<String> = (open.iter().take(GAMES_NAMED_MAX))
            .map(|game| format!("{} in round {} of {}", game.name, game.round, game.max_round))
            .collect();
        if open.len() > GAMES_NAMED_MAX {
            parts.push(format!("{} more games", open.len() - GAMES_NAMED_MAX));
        }
        let watched = self.runs.values().map(|run| format!("{}/runs/{}", self.base, run.id));
        parts.extend(watched);
        let parts = parts.join(", ");
        if parts.is_empty() { parts } else { format!("; {parts}") }
    }

    /// The last cause of failed requests of a run in progress that no answer has followed, if there is any.
    fn cause(&self) -> Option<String> {
        let playing = self.runs.keys().filter_map(|number| self.models.get(*number));
        let cause = playing.flatten().find_map(Model::trouble)?;
        Some(match cause.char_indices().nth(CAUSE_CHARS_MAX) {
            Some((end, _)) => format!("{}…", &cause[..end]),
            None => cause,
        })
    }

    /// Names of the runs in progress.
    fn which(&self) -> String {
        let of = self.of;
        let mut runs = self.runs.iter();
        match (runs.next(), runs.next()) {
            (None, _) => format!("{of} runs"),
            (Some((number, run)), None) => format!("{}/{of} {}", number + 1, run.name),
            (Some(_), Some(_)) => format!("{} of {of} runs", self.runs.len()),
        }
    }

    fn pace(&self, now: Timestamp) -> String {
        let mut parts = Vec::new();
        let asked = self.models.iter().flatten().map(Model::spent);
        let (mut tokens_in, mut tokens_out, mut flying, mut retries) = (0, 0, 0, 0);
        for spent in asked {
            tokens_in += spent.prompt_tokens;
            tokens_out += spent.completion_tokens;
            flying += spent.in_flight;
            retries += spent.retries;
        }
        if self.models.iter().any(|models| !models.is_empty()) {
            parts.push(format!("{}+{} tokens", short(tokens_in), short(tokens_out)));
            parts.push(format!("{flying} asked"));
        }
        if let Some(cause) = self.cause() {
            parts.push(format!("{retries} retries, last: {cause}"));
        } else if retries > 0 {
            parts.push(format!("{retries} retries"));
        }
        if !self.failures.is_empty() {
            parts.push(format!("did not count: {}", self.failures.words()));
        }
        let played = self.done().saturating_sub(self.rounds.before);
        let left = self.rounds.planned.saturating_sub(self.done());
        parts.extend(time_left(until(self.begun, now), played, left));
        parts.join(", ")
    }
}

impl GameProgress {
    fn shown(&self) -> String {
        let before = if self.is_sealed { " before the last round" } else { "" };
        let mut parts = vec![format!("score {:.2}{before}", self.score)];
        if self.prompt_tokens > 0 || self.completion_tokens > 0 {
            let (read, said) = (short(self.prompt_tokens), short(self.completion_tokens));
            parts.push(format!("{read}+{said} tokens"));
        }
        if !self.failures.is_empty() {
            parts.push(format!("did not count: {}", self.failures.words()));
        }
        parts.join(", ")
    }

    fn tell(&self) {
        self.bar.set_position(self.round.into());
        let (from, since) = self.since;
        let left = u64::from(self.max_round.saturating_sub(self.round));
        let played = u64::from(self.round.saturating_sub(from));
        let left = time_left(until(since, SystemClock.now()), played, left);
        let parts: Vec<String> = std::iter::once(self.shown()).chain(left).collect();
        self.bar.set_message(parts.join(", "));
    }
}

fn is_over(game: &RunGame) -> bool {
    !["planned", "running"].contains(&game.status.as_str())
}

/// Rounds of a run that need not be played any more.
fn done(run: &RunDetail) -> u64 {
    let max_round = u64::try_from(run.run.suite.settings.max_round).unwrap_or(0);
    let counted = run.games.iter().filter(|game| game.void_reason.is_none());
    counted.map(|game| if is_over(game) { max_round } else { game.round.into() }).sum()
}

/// Estimated time left at the speed so far; none without a basis for an estimate.
fn time_left(passed: Duration, played: u64, left: u64) -> Option<String> {
    let (Ok(played), Ok(left)) = (u32::try_from(played), u32::try_from(left)) else { return None };
    if played == 0 || left == 0 {
        return None;
    }
    let left = (passed / played).saturating_mul(left);
    Some(match left.as_secs() {
        seconds @ 0..100 => format!("{seconds} s left"),
        seconds @ 100..6000 => format!("{} min left", seconds.div_ceil(60)),
        seconds => {
            format!("{:.1} h left", f64::from(u32::try_from(seconds).unwrap_or(u32::MAX)) / 3600.0)
        }
    })
}

fn is_wide() -> bool {
    note_width().is_none_or(|columns| columns >= WIDE_COLUMNS)
}

/// A bar with a count.
pub(super) fn plain_bar(prefix: &str, all: u64, what: &str) -> ProgressBar {
    let bar = progress_bar(&format!("{{prefix:34}} {{bar:24}} {{pos}}/{{len}} {what}"));
    bar.set_length(all);
    bar.with_prefix(prefix.to_owned())
}
