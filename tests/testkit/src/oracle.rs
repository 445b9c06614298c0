//! The knowledge that an agent may have, derived independently from the rules (*What an agent sees*, *Messages*,
//! *Centralized control*) and from a spectator's view; and pairs of games that differ in facts that some agents may
//! not know.
//!
//! If a delay is drawn the oracle knows only the rounds in which a message can arrive, so it includes more than an
//! agent gets. If it finds no difference between two games, an agent must not find any.

use swarmbench_engine::{Action, Control, RuleSet, Settings, TaskName};

use crate::worlds::Dice;

/// An agent in a spectator's view.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    pub at: (i64, i64),
    pub alive: bool,
    /// True if the agent's light is on, or it carries food.
    pub flag: bool,
}

/// A state in a spectator's view.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    pub score: f64,
    /// Cells by row, `A` for agents.
    pub grid: Vec<Vec<char>>,
    pub agents: Vec<Body>,
}

/// The act of an agent in a round.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PlannedAct {
    pub action: &'static str,
    pub message: Option<String>,
    pub to: Option<usize>,
}

/// A part of the rules that the oracle omits on purpose, to test that the omission is noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blind {
    Nothing,
    /// The outermost cells of a window.
    Edge,
    /// Messages of others.
    Messages,
    /// Windows of earlier rounds.
    Past,
    /// Marks of agents.
    Marks,
}

/// A played game: the state in which each round is decided, and the acts in it.
#[derive(Clone, Debug)]
pub struct OracleGame {
    pub settings: Settings,
    pub states: Vec<State>,
    pub planned: Vec<Vec<PlannedAct>>,
}

/// A window: its round, its corner and its cells.
type Window = (usize, (i64, i64), Vec<Vec<String>>);

/// The knowledge that an agent may have, for comparison.
#[derive(Debug, PartialEq)]
pub struct Knowledge {
    round: usize,
    score: f64,
    alive: bool,
    flag: bool,
    windows: Vec<Window>,
    /// Messages that may have arrived: the round of sending, the sender, the text.
    messages: Vec<(usize, usize, String)>,
    history: Vec<(usize, &'static str, Option<String>)>,
}

impl OracleGame {
    fn reach(&self) -> i64 {
        self.settings.view_size / 2
    }

    pub fn is_centralized(&self) -> bool {
        self.settings.control == Control::Centralized.name()
    }

    fn is_reference(&self) -> bool {
        self.settings.rules == RuleSet::Reference.name()
    }

    pub fn state(&self) -> &State {
        self.states.last().expect("a state")
    }

    /// True if the current state differs from the other game, and whether anything ever did.
    pub fn differs_from(&self, other: &Self) -> [bool; 2] {
        let ever = self.states != other.states || self.planned != other.planned;
        [self.state() != other.state(), ever]
    }

    /// True if one agent is within the window of another.
    pub fn is_near(&self, state: &State, one: usize, other: usize) -> bool {
        let ((i, j), (k, l)) = (state.agents[one].at, state.agents[other].at);
        (i - k).abs() <= self.reach() && (j - l).abs() <= self.reach()
    }

    /// The knowledge that an agent may have when it decides the last round.
    pub fn knowledge(&self, agent: usize, blind: Blind) -> Knowledge {
        let round = self.states.len() - 1;
        let body = &self.state().agents[agent];
        let memory = usize::try_from(self.settings.memory).expect("not negative");
        let lived = |round: &usize| self.states[*round].agents[agent].alive;
        let past = if blind == Blind::Past { 1 } else { memory.max(1) };
        let history = (round.saturating_sub(memory)..round).filter(lived).map(|round| {
            let act = &self.planned[round][agent];
            (round, act.action, act.message.clone())
        });
        Knowledge {
            round,
            score: self.state().score,
            alive: body.alive,
            flag: body.flag,
            windows: ((round + 1).saturating_sub(past)..=round)
                .filter(lived)
                .map(|round| self.window(round, agent, blind))
                .collect(),
            messages: if blind == Blind::Messages { Vec::new() } else { self.messages(agent) },
            history: history.collect(),
        }
    }

    /// The window of an agent in a round.
    pub fn window(&self, round: usize, agent: usize, blind: Blind) -> Window {
        let state = &self.states[round];
        let (i, j) = state.agents[agent].at;
        let reach = self.reach() - i64::from(blind == Blind::Edge);
        let (rows, columns) = if self.is_centralized() {
            (0..self.settings.height, 0..self.settings.width)
        } else {
            (i - reach..i + reach + 1, j - reach..j + reach + 1)
        };
        let corner = (rows.start, columns.start);
        let row =
            |i: i64| columns.clone().map(|j| self.cell(state, agent, (i, j), blind)).collect();
        (round, corner, rows.map(row).collect())
    }

    fn cell(&self, state: &State, agent: usize, at: (i64, i64), blind: Blind) -> String {
        let place = |at: i64| usize::try_from(at).ok();
        let seen = place(at.0).and_then(|i| state.grid.get(i)?.get(place(at.1)?));
        match seen {
            None => "*".to_owned(),
            Some('A') => {
                let is_there = |body: &Body| body.alive && body.at == at;
                let number = state.agents.iter().position(is_there).expect("an agent");
                if number == agent {
                    return "Y".to_owned();
                }
                let has_marks = ["Synchronization", "Foraging"].contains(&&*self.settings.task);
                let is_marked = has_marks
                    && blind != Blind::Marks
                    && state.agents[number].flag != self.is_reference();
                format!("{}{number}", if is_marked { "$" } else { "" })
            }
            Some(symbol) => symbol.to_string(),
        }
    }

    /// Messages that may have been delivered to an agent with the last round.
    fn messages(&self, agent: usize) -> Vec<(usize, usize, String)> {
        let (now, last) = (self.state(), self.states.len() - 1);
        if !now.agents[agent].alive || (self.is_centralized() && !now.agents[0].alive) {
            return Vec::new();
        }
        let late = usize::try_from(self.settings.max_delay).expect("not negative");
        let mut messages = Vec::new();
        for sent in last.saturating_sub(1 + late)..last {
            for (sender, act) in self.planned[sent].iter().enumerate() {
                let Some(text) = act.message.clone() else { continue };
                let before = &self.states[sent];
                let decisive = if self.is_reference() { now } else { before };
                if before.agents[sender].alive && self.hears(decisive, sender, act.to, agent) {
                    messages.push((sent, sender, text));
                }
            }
        }
        messages
    }

    /// True if a message reaches an agent, by the positions in a state.
    fn hears(&self, state: &State, sender: usize, to: Option<usize>, agent: usize) -> bool {
        match (self.is_centralized(), sender) {
            _ if !state.agents[agent].alive => false,
            (true, 0) => agent != 0 && to.is_none_or(|to| to == agent),
            (true, _) => agent == 0,
            (false, _) => {
                (agent != sender || self.is_reference()) && self.is_near(state, sender, agent)
            }
        }
    }
}

/// Settings of a small game of any kind.
pub fn settings(dice: &mut Dice) -> Settings {
    let one_of = |dice: &mut Dice, values: &[i64]| values[dice.below(values.len())];
    let task = TaskName::ALL[dice.below(5)];
    let rules = RuleSet::ALL[dice.below(2)];
    let control = if dice.below(4) == 0 { Control::Centralized } else { Control::Decentralized };
    let height = one_of(dice, &[8, 11, 16]);
    let width = if rules == RuleSet::Reference { height } else { one_of(dice, &[8, 13, 20]) };
    Settings {
        rules: rules.name().to_owned(),
        control: control.name().to_owned(),
        num_agents: one_of(dice, &[2, 3, 5, 8, 9]),
        width,
        height,
        view_size: one_of(dice, &[3, 3, 5, 7]),
        memory: one_of(dice, &[0, 1, 2, 3, 5]),
        max_round: 1_000,
        noise: [0.0, 0.0, 0.5, 1.0][dice.below(4)],
        max_delay: one_of(dice, &[0, 0, 1, 3]),
        ..Settings::standard(task, dice.below(1_000_000) as u64)
    }
}

/// Random acts of all agents in a round.
pub fn planned(dice: &mut Dice, game: &OracleGame) -> Vec<PlannedAct> {
    (0..game.state().agents.len()).map(|agent| act(dice, game, agent)).collect()
}

fn act(dice: &mut Dice, game: &OracleGame, agent: usize) -> PlannedAct {
    let task = TaskName::parse(&game.settings.task).expect("a task");
    let actions = Action::of_task(task);
    let agents = game.state().agents.len();
    let says = dice.below(2) == 0;
    let names = says && game.is_centralized() && agent == 0 && dice.below(2) == 0;
    PlannedAct {
        action: actions[dice.below(actions.len())].name(),
        message: says.then(|| format!("message {}", dice.below(1_000))),
        to: names.then(|| 1 + dice.below(agents - 1)),
    }
}

/// The same round in the other game: agents act differently if `observer` neither hears nor sees it at once, and
/// sometimes any agent does.
pub fn changed(
    dice: &mut Dice,
    game: &OracleGame,
    planned: &[PlannedAct],
    observer: usize,
) -> Vec<PlannedAct> {
    let anybody = dice.below(16) == 0;
    let mut changed = planned.to_vec();
    for (agent, changed) in changed.iter_mut().enumerate() {
        let other = act(dice, game, agent);
        let is_told =
            |act: &PlannedAct| act.message.is_some() && act.to.is_none_or(|to| to == observer);
        let is_hidden = match (game.is_centralized(), agent) {
            (true, 0) => !is_told(changed) && !is_told(&other),
            (true, _) => observer != 0,
            (false, _) => !game.is_near(game.state(), agent, observer),
        };
        if agent == observer || dice.below(3) == 0 || !(is_hidden || anybody) {
            continue;
        }
        if game.is_centralized() {
            // Under centralized control all agents see every action.
            *changed = PlannedAct { action: changed.action, ..other };
        } else {
            *changed = other;
        }
    }
    changed
}
