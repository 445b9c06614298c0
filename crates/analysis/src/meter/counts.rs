//! The whole numbers of a round, and values that follow from them.

use swarmbench_engine::{Action, Direction};

use crate::characters::{is_digit, is_toolkit_digit};
use crate::game::{Decision, State};

/// Defines the counts with their names.
macro_rules! counts {
    ($($name:ident: $type:ty,)*) => {
        /// The whole numbers of a state and of the round that led to it. The layout has only `explored`; its other
        /// counts are 0.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[expect(missing_docs, reason = "defined in docs/evaluate/metrics.md")]
        pub struct Counts {
            $(pub $name: $type,)*
        }

        impl Counts {
            /// The names of all counts, in order.
            pub const NAMES: [&str; [$(stringify!($name)),*].len()] = [$(stringify!($name)),*];

            /// All counts with their names, in order; `None` for those that the layout does not have.
            #[must_use]
            pub fn columns(&self, is_layout: bool) -> [(&'static str, Option<u64>); Self::NAMES.len()] {
                let has = |name| !is_layout || name == "explored";
                [$((
                    stringify!($name),
                    Some(u64::from(self.$name)).filter(|_| has(stringify!($name))),
                )),*]
            }
        }
    };
}

counts! {
    alive: u32,
    moves_up: u32,
    moves_down: u32,
    moves_left: u32,
    moves_right: u32,
    stays: u32,
    switches: u32,
    no_actions: u32,
    invalid: u32,
    timeouts: u32,
    messages: u32,
    distinct_messages: u32,
    questions: u32,
    message_chars: u64,
    message_digits: u64,
    message_chars_squared: u64,
    distance: u32,
    explored: u32,
    kept_pairs: u32,
    pushes: u32,
    pushes_strict: u32,
    blocked: u32,
    components: u32,
}

impl Counts {
    /// Counts the choices and messages of the agents on the map; all other counts are 0.
    pub(super) fn of_acts(state: &State, decisions: &[Decision], said: &Said<'_>) -> Self {
        let mut counts = Self::default();
        for decision in state.living().map(|(agent, _)| &decisions[agent]) {
            counts.alive += 1;
            counts.invalid += u32::from(decision.invalid);
            counts.timeouts += u32::from(decision.timeout);
            *match decision.action {
                Some(Action::Up) => &mut counts.moves_up,
                Some(Action::Down) => &mut counts.moves_down,
                Some(Action::Left) => &mut counts.moves_left,
                Some(Action::Right) => &mut counts.moves_right,
                Some(Action::Stay) => &mut counts.stays,
                Some(Action::Switch) => &mut counts.switches,
                None => &mut counts.no_actions,
            } += 1;
        }
        for &(_, text) in &said.all {
            let chars = text.chars().count() as u64;
            counts.messages += 1;
            counts.questions += u32::from(text.contains('?'));
            counts.message_chars += chars;
            counts.message_chars_squared += chars * chars;
        }
        counts.message_digits = said.chars_that(is_digit);
        counts.distinct_messages = small(said.distinct.len());
        counts
    }

    /// The toolkit's counts of choices and messages: an agent that has escaped is logged as staying, and more
    /// characters are digits.
    pub(super) fn of_toolkit(self, state: &State, said: &Said<'_>) -> Self {
        let agents = small(state.agents.len());
        Self {
            alive: agents,
            no_actions: self.no_actions + (agents - self.alive),
            message_digits: said.chars_that(is_toolkit_digit),
            ..self
        }
    }

    /// Move actions, in order of [`Direction::ALL`].
    const fn moves(&self) -> [u32; 4] {
        [self.moves_up, self.moves_down, self.moves_left, self.moves_right]
    }

    /// Agents that chose to move.
    pub(super) fn movers(&self) -> u32 {
        self.moves().iter().sum()
    }

    /// Agents that chose neither to move nor to switch.
    #[must_use]
    pub const fn still(&self) -> u32 {
        self.stays + self.no_actions
    }

    /// Agents that did not choose to switch.
    fn coordinated(&self) -> u32 {
        self.movers() + self.still()
    }

    pub(super) fn direction_entropy(&self) -> Option<f64> {
        let movers = f64::from(self.movers());
        let chosen = self.moves().into_iter().filter(|&count| count > 0).map(f64::from);
        (movers > 0.0).then(|| chosen.map(|count| count / movers * (movers / count).log2()).sum())
    }

    pub(super) fn stillness(&self) -> Option<f64> {
        ratio(self.still(), self.alive)
    }

    pub(super) fn dominant_action(&self) -> Option<f64> {
        let most = self.moves().into_iter().fold(self.still(), u32::max);
        ratio(most, self.coordinated())
    }

    pub(super) fn polarization(&self) -> Option<f64> {
        let across = f64::from(self.moves_right) - f64::from(self.moves_left);
        let down = f64::from(self.moves_down) - f64::from(self.moves_up);
        let coordinated = f64::from(self.coordinated());
        (coordinated > 0.0).then(|| (across * across + down * down).sqrt() / coordinated)
    }

    pub(super) fn message_length_std(&self) -> Option<f64> {
        let messages = u64::from(self.messages);
        let spread =
            messages * self.message_chars_squared - self.message_chars * self.message_chars;
        (messages > 0).then(|| real(spread).sqrt() / real(messages))
    }
}

/// The messages of a round.
pub(super) struct Said<'a> {
    /// Each message with the index of its sender.
    pub(super) all: Vec<(usize, &'a str)>,
    /// The distinct texts, sorted, with the number of messages of each.
    pub(super) distinct: Vec<(&'a str, u32)>,
}

impl<'a> Said<'a> {
    /// The messages of the agents on the map.
    pub(super) fn of(state: &State, decisions: &'a [Decision]) -> Self {
        let of = |agent: usize| decisions[agent].message.as_deref().filter(|text| !text.is_empty());
        let all: Vec<_> =
            state.living().filter_map(|(agent, _)| Some((agent, of(agent)?))).collect();
        let mut texts: Vec<&str> = all.iter().map(|&(_, text)| text).collect();
        texts.sort_unstable();
        let distinct = texts.chunk_by(|a, b| a == b).map(|same| (same[0], small(same.len())));
        Self { distinct: distinct.collect(), all }
    }

    fn chars_that(&self, are: fn(char) -> bool) -> u64 {
        let of = |text: &str| text.chars().filter(|&c| are(c)).count() as u64;
        self.all.iter().map(|(_, text)| of(text)).sum()
    }
}

/// The index of a direction in [`Direction::ALL`].
pub(super) const fn place(direction: Direction) -> usize {
    match direction {
        Direction::Up => 0,
        Direction::Down => 1,
        Direction::Left => 2,
        Direction::Right => 3,
    }
}

/// `part / whole`; `None` if the whole is 0.
pub(super) fn ratio(part: impl Into<u64>, whole: impl Into<u64>) -> Option<f64> {
    let whole = whole.into();
    (whole > 0).then(|| real(part.into()) / real(whole))
}

/// A count as a real number.
#[expect(clippy::cast_precision_loss, reason = "counts of a game are far below 2^53")]
pub(super) const fn real(count: u64) -> f64 {
    count as f64
}

/// A number of agents, messages or cells.
pub(super) fn small(count: usize) -> u32 {
    u32::try_from(count).expect("a game has few agents and cells")
}
