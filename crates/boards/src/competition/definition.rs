//! Decisions of an organizer when a competition is created; [`change`](super::change) changes some of them later.

use std::fmt::Display;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use swarmbench_engine::{Config, Seed, SettingErrors, Settings, TaskName};

use super::entrant::Declaration;
use super::sealed::{Sealed, rules_seed};
use crate::run;
use swarmbench_protocol::competition::Terms;
use swarmbench_protocol::status::Visibility;
use swarmbench_protocol::suite::{Suite, SuiteSettings};

/// Maximum characters of a competition's name.
pub const NAME_CHARS_MAX: usize = 100;

/// Maximum characters of a description.
pub const DESCRIPTION_CHARS_MAX: usize = 10_000;

/// Maximum characters of terms.
pub const TERMS_CHARS_MAX: usize = 20_000;

/// Maximum categories of entrants.
pub const CATEGORIES_MAX: usize = 20;

/// Maximum characters of a category.
pub const CATEGORY_CHARS_MAX: usize = 40;

/// Maximum attempts of an entrant.
pub const ATTEMPTS_MAX: usize = 100;

/// Maximum sealed seeds of an attempt.
pub const SEEDS_MAX: u32 = 100;

/// Maximum open games of an attempt.
pub const PARALLEL_MAX: u32 = 100;

/// Maximum entrants of one key.
pub const ENTRIES_PER_KEY_MAX: u32 = 100;

/// Definition of a competition; stored as JSON, and a part of its export.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Name of the competition.
    pub name: String,
    /// Description for entrants.
    pub description: String,
    /// Names of the tasks in the order of play.
    pub tasks: Vec<String>,
    /// Sealed seeds of an attempt; every task is played once on each.
    pub seeds: u32,
    /// Number of public seeds: the first ones of an attempt make the board before the end, the others the final board. With 0
    /// all seeds make both.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub public_seeds: u32,
    /// Rule set.
    pub rules: String,
    /// Settings of all games, including clocks.
    pub settings: SuiteSettings,
    /// Milliseconds without an act after which a game ends as abandoned.
    pub idle_timeout_ms: u64,
    /// Time from which attempts can be started, each in its own window.
    pub opens_at: Timestamp,
    /// End: no round begins at or after this time.
    pub closes_at: Timestamp,
    /// Admission of entrants.
    pub entry: Admission,
    /// Windows of the attempts; the first attempt has the number 1.
    pub attempts: Vec<Window>,
    /// Attempts on other seeds that an entrant has in place of voided ones. Their numbers follow those of the attempts, and
    /// each may be played as long as the competition is open.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub spares: u32,
    /// Maximum open games of an attempt.
    pub parallel: u32,
    /// Choice of the attempt that counts.
    pub counts: Counts,
    /// Part of the board that is public before the end.
    pub board: BoardRule,
    /// Time from which a frozen board does not change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_freezes_at: Option<Timestamp>,
    /// Maximum entrants of one key.
    pub entries_per_key: u32,
    /// Maximum attempts that an entrant may start on one day in UTC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attempts_per_day: Option<u32>,
    /// Terms that entrants accept when they enter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terms: Option<Terms>,
    /// Categories; each entrant is in exactly one, if there are any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub categories: Vec<String>,
    /// Time from which entrants read their own games.
    #[serde(default, skip_serializing_if = "OwnGames::is_sealed")]
    pub own_games: OwnGames,
    /// Tie-breaks between equal totals, in the order in which they apply.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tie_breaks: Vec<TieBreak>,
    /// True if each task has seeds of its own. False in older competitions, where one ended game reveals the seeds of all
    /// tasks.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub seeds_by_task: bool,
}

swarmbench_engine::named! {
    /// Admission to a competition.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Admission {
        /// Anybody.
        Anybody = "anybody",
        /// Holders of an invitation code.
        Codes = "codes",
    }
}

/// Window of an attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Earliest start of the attempt.
    pub opens_at: Timestamp,
    /// End: no round of the attempt begins at or after this time.
    pub closes_at: Timestamp,
}

swarmbench_engine::named! {
    /// Choice of an entrant's counting attempt among those that are over and were not voided.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Counts {
        /// The attempt with the highest total; of equal ones the one that was started first.
        Best = "best",
        /// The attempt that was started last.
        Last = "last",
        /// The attempt that was started first.
        First = "first",
    }
}

swarmbench_engine::named! {
    /// Part of the board that is public before the end.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum BoardRule {
        /// Ranks and totals.
        Public = "public",
        /// No board.
        Hidden = "hidden",
        /// Ranks and totals of the attempts that were over before `board_freezes_at`.
        Frozen = "frozen",
    }
}

swarmbench_engine::named! {
    /// Time from which entrants read states, journals and scores of their own games.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum OwnGames {
        /// After the end of the competition, when everybody may.
        #[default]
        Sealed = "sealed",
        /// After the end of a game.
        Ended = "ended",
    }
}

impl OwnGames {
    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
    fn is_sealed(&self) -> bool {
        *self == Self::Sealed
    }
}

swarmbench_engine::named! {
    /// Tie-break between equal totals.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum TieBreak {
        /// The smaller share of invalid answers ranks higher.
        Invalid = "invalid",
        /// The smaller share of timed-out moves ranks higher.
        Timeouts = "timeouts",
        /// Fewer attempts, without voided ones, rank higher.
        Attempts = "attempts",
        /// The counting attempt that ended earlier ranks higher.
        Earliest = "earliest",
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
const fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// Name of the suite of practice runs for the competition `id`.
#[must_use]
pub fn practice_suite(id: &str) -> String {
    format!("practice for {id}")
}

/// Refused field, and the reason.
pub type Problem = (String, String);

type Check = fn(&Settings) -> Result<Config, SettingErrors>;

impl Definition {
    /// A competition without special rules: anybody enters, each attempt is open all the time, the best one counts, and the board
    /// is public.
    #[must_use]
    pub fn plain(
        name: &str,
        tasks: Vec<String>,
        seeds: u32,
        settings: SuiteSettings,
        window: Window,
        attempts: usize,
    ) -> Self {
        Self {
            name: name.to_owned(),
            description: String::new(),
            tasks,
            seeds,
            public_seeds: 0,
            rules: "paper".to_owned(),
            settings,
            idle_timeout_ms: 3_600_000,
            opens_at: window.opens_at,
            closes_at: window.closes_at,
            entry: Admission::Anybody,
            attempts: vec![window; attempts],
            spares: 0,
            parallel: 5,
            counts: Counts::Best,
            board: BoardRule::Public,
            board_freezes_at: None,
            entries_per_key: 1,
            attempts_per_day: None,
            terms: None,
            categories: Vec::new(),
            own_games: OwnGames::Sealed,
            tie_breaks: Vec::new(),
            seeds_by_task: true,
        }
    }

    /// Problems of the definition at this time.
    #[must_use]
    pub fn problems(&self, now: Timestamp) -> Vec<Problem> {
        self.problems_of(now, Config::check)
    }

    /// Problems of a new definition. Games of competitions that were announced under older limits may be larger.
    #[must_use]
    pub fn problems_when_new(&self, now: Timestamp) -> Vec<Problem> {
        self.problems_of(now, Config::admit)
    }

    fn problems_of(&self, now: Timestamp, check: Check) -> Vec<Problem> {
        let mut problems = Vec::new();
        let mut refuse = |field: &str, problem: String| problems.push((field.to_owned(), problem));
        if let Err(problem) = swarmbench_protocol::names::check(&self.name, NAME_CHARS_MAX) {
            refuse("name", problem);
        }
        if self.description.chars().count() > DESCRIPTION_CHARS_MAX
            || !swarmbench_protocol::names::is_plain_text(&self.description)
        {
            let most = DESCRIPTION_CHARS_MAX;
            refuse("description", format!("must be at most {most} characters of plain text"));
        }
        if self.closes_at <= self.opens_at {
            refuse("closes_at", format!("must be after opens_at, which is {}", self.opens_at));
        } else if self.closes_at <= now {
            refuse("closes_at", format!("must be in the future; it is {now}"));
        }
        check_count("parallel", self.parallel, PARALLEL_MAX, &mut refuse);
        check_count("entries_per_key", self.entries_per_key, ENTRIES_PER_KEY_MAX, &mut refuse);
        if let Some(most) = self.attempts_per_day {
            let all = u32::try_from(ATTEMPTS_MAX).unwrap_or(u32::MAX);
            check_count("attempts_per_day", most, all, &mut refuse);
        }
        self.check_texts(&mut refuse);
        self.check_board(&mut refuse);
        self.check_attempts(&mut refuse);
        self.check_suite(check, &mut refuse);
        problems
    }

    fn check_texts(&self, refuse: &mut impl FnMut(&str, String)) {
        let is_plain = swarmbench_protocol::names::is_plain_text;
        if let Some(Terms { text, .. }) = &self.terms
            && !((1..=TERMS_CHARS_MAX).contains(&text.chars().count()) && is_plain(text))
        {
            refuse("terms", format!("must be 1 to {TERMS_CHARS_MAX} characters of plain text"));
        }
        if self.categories.len() > CATEGORIES_MAX {
            refuse("categories", format!("must be at most {CATEGORIES_MAX}"));
        }
        for (place, category) in self.categories.iter().enumerate() {
            let field = format!("categories[{place}]");
            if let Err(problem) = swarmbench_protocol::names::check(category, CATEGORY_CHARS_MAX) {
                refuse(&field, problem);
            } else if self.categories[..place].contains(category) {
                refuse(&field, "is there twice".to_owned());
            }
        }
        let is_repeated = |place: usize| self.tie_breaks[..place].contains(&self.tie_breaks[place]);
        if (1..self.tie_breaks.len()).any(is_repeated) {
            refuse("tie_breaks", "must name each rule at most once".to_owned());
        }
    }

    fn check_board(&self, refuse: &mut impl FnMut(&str, String)) {
        let inside = |at: Timestamp| self.opens_at <= at && at <= self.closes_at;
        match (self.board, self.board_freezes_at) {
            (BoardRule::Frozen, None) => {
                refuse("board_freezes_at", "is missing: when does the board freeze?".to_owned());
            }
            (BoardRule::Frozen, Some(at)) if !inside(at) => {
                refuse("board_freezes_at", "must lie from opens_at to closes_at".to_owned());
            }
            (BoardRule::Public | BoardRule::Hidden, Some(_)) => {
                refuse("board_freezes_at", "belongs to board = \"frozen\" only".to_owned());
            }
            _ => {}
        }
        if self.public_seeds >= self.seeds.max(1) {
            let problem = format!("must be less than seeds, which is {}", self.seeds);
            refuse("suite.public_seeds", problem);
        }
        let seeds = if self.public_seeds == 0 { self.seeds } else { self.public_seeds };
        if self.board != BoardRule::Hidden && self.tasks.len() * (seeds as usize) < 2 {
            refuse(
                "board",
                "must be hidden where an attempt has one game: its total would be the score of a sealed game"
                    .to_owned(),
            );
        }
    }

    fn check_attempts(&self, refuse: &mut impl FnMut(&str, String)) {
        check_count("attempts", self.attempts.len(), ATTEMPTS_MAX, refuse);
        let most = ATTEMPTS_MAX.saturating_sub(self.attempts.len());
        if self.spares as usize > most && self.attempts.len() <= ATTEMPTS_MAX {
            let is = self.spares;
            refuse(
                "spares",
                format!(
                    "must be at most {most}, is {is}: there are at most {ATTEMPTS_MAX} attempts with the spare ones"
                ),
            );
        }
        for (place, window) in self.attempts.iter().enumerate() {
            let mut refuse = |field: &str, problem: &str| {
                refuse(&format!("attempts[{place}].{field}"), problem.to_owned());
            };
            if window.opens_at < self.opens_at {
                refuse("opens_at", "must not be before opens_at of the competition");
            }
            if window.closes_at > self.closes_at {
                refuse("closes_at", "must not be after closes_at of the competition");
            }
            // A competition that ends before it opens was refused above.
            if window.closes_at <= window.opens_at && self.opens_at < self.closes_at {
                refuse("closes_at", "must be after its opens_at");
            }
        }
    }

    fn check_suite(&self, check: Check, refuse: &mut impl FnMut(&str, String)) {
        check_count("suite.seeds", self.seeds, SEEDS_MAX, refuse);
        let names: Vec<_> = TaskName::ALL.iter().map(|task| task.name()).collect();
        let unknown = self.tasks.iter().find(|task| TaskName::parse(task).is_none());
        let is_repeated =
            (1..self.tasks.len()).any(|place| self.tasks[..place].contains(&self.tasks[place]));
        if self.tasks.is_empty() || is_repeated || unknown.is_some() {
            let names = names.join(", ");
            refuse("suite.tasks", format!("must name some of {names}, each at most once"));
            return;
        }
        let mut found: Vec<Problem> = Vec::new();
        for error in self.tasks.iter().filter_map(|task| check(&self.settings_of(task)).err()) {
            for error in error.0 {
                let field = match error.field {
                    "rules" => "suite.rules".to_owned(),
                    field => format!("suite.settings.{field}"),
                };
                let problem = (field, error.problem);
                if !found.contains(&problem) {
                    found.push(problem);
                }
            }
        }
        for (field, problem) in found {
            refuse(&field, problem);
        }
    }

    /// Settings of a game of a task, without its seed.
    fn settings_of(&self, task: &str) -> Settings {
        Settings {
            task: task.to_owned(),
            rules: self.rules.clone(),
            ..Settings::from(&self.settings)
        }
    }

    /// Problem of an entrant's category, if there is one.
    #[must_use]
    pub fn category_problem(&self, category: Option<&str>) -> Option<String> {
        let all = self.categories.join(", ");
        match category {
            Some(_) if self.categories.is_empty() => {
                Some("is not needed here: this competition has no categories".to_owned())
            }
            Some(category) if !self.categories.iter().any(|one| one == category) => {
                Some(format!("must be one of {all}"))
            }
            None if !self.categories.is_empty() => {
                Some(format!("is missing: this competition has the categories {all}"))
            }
            _ => None,
        }
    }

    /// Problem of the accepted version of the terms, if there is one.
    #[must_use]
    pub fn terms_problem(&self, accepted: Option<u32>) -> Option<String> {
        match (accepted, self.terms.as_ref().map(|terms| terms.version)) {
            (Some(_), None) => Some("is not needed here: this competition has no terms".to_owned()),
            (None, Some(newest)) => Some(format!(
                "is missing: read `terms` of the competition, and accept them with {newest}, their version"
            )),
            (Some(version), Some(newest)) if version != newest => {
                Some(format!("must be {newest}, the version of the terms now; read them again"))
            }
            _ => None,
        }
    }

    /// Number of games of an attempt.
    #[must_use]
    pub fn games(&self) -> usize {
        self.tasks.len() * self.seeds as usize
    }

    /// Number of sealed seeds, including those of the spare attempts.
    #[must_use]
    pub fn sealed_seeds(&self) -> usize {
        (self.attempts.len() + self.spares as usize) * self.seeds as usize
    }

    /// Window of an attempt, counted from 1. Windows of spare attempts cover the whole competition.
    #[must_use]
    pub fn window(&self, attempt: u32) -> Option<Window> {
        let place = (attempt as usize).checked_sub(1)?;
        let whole = Window { opens_at: self.opens_at, closes_at: self.closes_at };
        let spare = self.spare(attempt).map(|_| whole);
        self.attempts.get(place).copied().or(spare)
    }

    /// Number of a spare attempt among the spare ones, from 1; `None` for other attempts.
    #[must_use]
    pub fn spare(&self, attempt: u32) -> Option<u32> {
        let spare = attempt.checked_sub(u32::try_from(self.attempts.len()).ok()?)?;
        (1..=self.spares).contains(&spare).then_some(spare)
    }

    /// Attempt number of a spare attempt, both counted from 1.
    #[must_use]
    pub fn number_of_spare(&self, spare: u32) -> u32 {
        u32::try_from(self.attempts.len()).unwrap_or(u32::MAX).saturating_add(spare)
    }

    /// Suite of an attempt, counted from 1, of the competition `id`.
    #[must_use]
    pub fn suite(&self, id: &str, sealed: &Sealed, attempt: u32) -> Suite {
        let of_attempt = sealed.of_attempt(attempt, self.seeds);
        let seeds = if self.seeds_by_task {
            let of_task = |task| of_attempt.clone().map(move |seed| rules_seed(seed, task));
            self.tasks.iter().flat_map(|task| of_task(task.as_str())).collect()
        } else {
            of_attempt.map(|seed| rules_seed(seed, "")).collect()
        };
        Suite { seeds_by_task: self.seeds_by_task, ..self.suite_on(id, seeds) }
    }

    /// Suite of all tasks on the same seeds.
    fn suite_on(&self, id: &str, seeds: Vec<Seed>) -> Suite {
        Suite {
            name: id.to_owned(),
            tasks: self.tasks.clone(),
            seeds,
            seeds_by_task: false,
            rules: self.rules.clone(),
            settings: self.settings.clone(),
        }
    }

    /// Run of an attempt, counted from 1, with this declaration. `None` if the competition has fewer attempts.
    #[must_use]
    pub fn run(
        &self,
        id: &str,
        declaration: &Declaration,
        attempt: u32,
        sealed: &Sealed,
    ) -> Option<run::Definition> {
        let window = self.window(attempt)?;
        let suite = self.suite(id, sealed, attempt);
        Some(run::Definition {
            closes_at: Some(window.closes_at),
            ..self.run_of(declaration, suite)
        })
    }

    /// Sealed run of a suite.
    fn run_of(&self, declaration: &Declaration, suite: Suite) -> run::Definition {
        run::Definition {
            suite,
            model: declaration.model.clone(),
            temperature: declaration.temperature,
            top_p: declaration.top_p,
            meta: declaration.agent_meta.clone(),
            prompt_template: declaration.prompt_template.clone(),
            prompt_revision: swarmbench_prompt::REVISION,
            player: None,
            holders: Vec::new(),
            parallel: self.parallel,
            visibility: Visibility::Sealed.name().to_owned(),
            idle_timeout_ms: self.idle_timeout_ms,
            closes_at: None,
            own_games: self.own_games == OwnGames::Ended,
        }
    }

    /// Practice run: on open seeds, with the settings of the competition `id`. Practice counts nowhere in the competition.
    #[must_use]
    pub fn practice(
        &self,
        id: &str,
        declaration: &Declaration,
        tasks: Vec<String>,
        seeds: Vec<Seed>,
    ) -> run::Definition {
        let suite = Suite { name: practice_suite(id), tasks, ..self.suite_on(id, seeds) };
        run::Definition {
            visibility: Visibility::Owner.name().to_owned(),
            closes_at: Some(self.closes_at),
            ..self.run_of(declaration, suite)
        }
    }

    /// Tasks in the order of the board.
    #[must_use]
    pub fn tasks(&self) -> Vec<TaskName> {
        TaskName::ALL
            .into_iter()
            .filter(|task| self.tasks.iter().any(|t| t == task.name()))
            .collect()
    }
}

fn check_count<T: Copy + Display + PartialOrd + From<u8>>(
    field: &str,
    count: T,
    most: T,
    refuse: &mut impl FnMut(&str, String),
) {
    if !(T::from(1)..=most).contains(&count) {
        refuse(field, format!("must be from 1 to {most}, is {count}"));
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn at(minute: i64) -> Timestamp {
        Timestamp::from_second(60 * minute).expect("a time")
    }

    /// Opens at minute 10 and closes at minute 100; two attempts of four games.
    pub(crate) fn definition() -> Definition {
        let window = Window { opens_at: at(10), closes_at: at(100) };
        let tasks = vec!["Synchronization".to_owned(), "Foraging".to_owned()];
        let settings = SuiteSettings {
            round_deadline_ms: Some(10_000),
            num_agents: 2,
            max_round: 3,
            ..SuiteSettings::default()
        };
        Definition { parallel: 2, ..Definition::plain("a cup", tasks, 2, settings, window, 2) }
    }

    type Change<'a> = &'a dyn Fn(&mut Definition);

    /// Games of an announced competition are checked by the wider limits under which it was announced.
    #[test]
    fn games_of_a_new_competition_are_limited_further_than_those_of_an_old_one() {
        let mut large = definition();
        let settings = &mut large.settings;
        (settings.width, settings.height, settings.view_size) = (256, 256, 513);
        (settings.num_agents, settings.memory) = (1024, 0);
        assert_eq!(large.problems(at(0)), []);
        assert_eq!(large.problems_when_new(at(0))[0].0, "suite.settings.num_agents");
        assert_eq!(definition().problems_when_new(at(0)), []);
    }

    #[test]
    fn spare_attempts_follow_the_others_and_are_open_for_the_whole_time() {
        let mut definition = definition();
        definition.attempts[1].closes_at = at(50);
        assert_eq!((definition.sealed_seeds(), definition.window(3)), (4, None));
        definition.spares = 2;
        assert_eq!(definition.problems(at(0)), []);
        assert_eq!(definition.sealed_seeds(), 8);
        let whole = Some(Window { opens_at: at(10), closes_at: at(100) });
        let windows = [0, 2, 3, 4, 5].map(|number| definition.window(number));
        assert_eq!(windows, [None, definition.attempts.last().copied(), whole, whole, None]);
        assert_eq!(
            [2, 3, 4, 5].map(|number| definition.spare(number)),
            [None, Some(1), Some(2), None]
        );
        assert_eq!(definition.number_of_spare(2), 4);
    }

    #[test]
    fn whatever_is_wrong_is_named_and_all_of_it_at_once() {
        assert_eq!(definition().problems(at(0)), []);
        let fields = |change: &dyn Fn(&mut Definition)| {
            let mut changed = definition();
            change(&mut changed);
            changed.problems(at(0)).into_iter().map(|(field, _)| field).collect::<Vec<_>>()
        };
        let one: [(Change<'_>, &str); 21] = [
            (&|d| d.name = String::new(), "name"),
            (&|d| d.name = "a\u{7}".to_owned(), "name"),
            (&|d| d.description = "\u{1b}[31m".to_owned(), "description"),
            (&|d| d.parallel = 0, "parallel"),
            (&|d| d.entries_per_key = 0, "entries_per_key"),
            (&|d| d.board = BoardRule::Frozen, "board_freezes_at"),
            (&|d| d.board_freezes_at = Some(at(20)), "board_freezes_at"),
            (&|d| d.attempts = Vec::new(), "attempts"),
            (&|d| d.spares = 99, "spares"),
            (&|d| d.attempts[1].opens_at = at(9), "attempts[1].opens_at"),
            (&|d| d.attempts[1].closes_at = at(101), "attempts[1].closes_at"),
            (&|d| d.attempts[0].closes_at = at(10), "attempts[0].closes_at"),
            (&|d| d.seeds = 0, "suite.seeds"),
            (&|d| d.seeds = 101, "suite.seeds"),
            (&|d| d.tasks = Vec::new(), "suite.tasks"),
            (&|d| d.tasks[1] = d.tasks[0].clone(), "suite.tasks"),
            (&|d| d.tasks[1] = "Chess".to_owned(), "suite.tasks"),
            (&|d| d.rules = "mine".to_owned(), "suite.rules"),
            (&|d| d.settings.width = 3, "suite.settings.width"),
            (&|d| d.settings.noise = 2.0, "suite.settings.noise"),
            (&|d| d.settings.num_agents = 0, "suite.settings.num_agents"),
        ];
        for (change, field) in one {
            assert!(fields(change).contains(&field.to_owned()), "{field}: {:?}", fields(change));
        }
        let late = |d: &mut Definition| {
            d.closes_at = at(5);
            d.opens_at = at(5);
        };
        assert!(fields(&late).contains(&"closes_at".to_owned()));
        assert_eq!(definition().problems(at(100))[0].0, "closes_at", "it has closed");
        assert_eq!(definition().problems(at(99)), [], "it may be open already");
        // The score of a single game would be on the board.
        let single = |d: &mut Definition| {
            d.seeds = 1;
            d.tasks.truncate(1);
        };
        assert_eq!(fields(&single), ["board"]);
        let many = |d: &mut Definition| {
            d.name = String::new();
            d.seeds = 0;
            d.settings.width = 0;
        };
        assert_eq!(fields(&many), ["name", "board", "suite.seeds", "suite.settings.width"]);
    }
}
