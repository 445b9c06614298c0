//! The descriptions of the tasks for agents.

use swarmbench_engine::{Action, Config, RuleSet, TaskName};

/// The goal of the task, with the symbols that only this task has.
#[must_use]
pub fn description(config: &Config) -> String {
    // The rule sets mark opposite states with the same sign.
    let (light_marked, light_plain, load_marked, load_plain) = match config.rules() {
        RuleSet::Paper => ("on", "off", "carries food", "carries none"),
        RuleSet::Reference => ("off", "on", "carries no food", "carries food"),
    };
    match config.task() {
        TaskName::Transport => {
            "A wall (W) surrounds the map, with one gap that leads outside (*). \
            A heavy block (B) fills the gap. Find the block, push it out through the gap together \
            (that takes the force of five agents at once), then leave the map through the gap \
            yourselves. Every agent that leaves scores: the earlier it leaves, the more it scores."
                .to_owned()
        }
        TaskName::Pursuit => {
            let pushed = match config.rules() {
                RuleSet::Paper => "It cannot be pushed.",
                RuleSet::Reference => {
                    "The first prey weighs 1 and can be pushed; those that come after it cannot be pushed."
                }
            };
            format!(
                "A prey (P) lives on the map. It moves up to two steps a round, away from agents and \
                 walls. {pushed} Surround it: when all four cells beside it (up, down, left, right) are \
                 taken by agents or walls, it is caught and you score a point; a new prey then appears \
                 elsewhere. Catch as many as you can."
            )
        }
        TaskName::Synchronization => format!(
            "Every agent has a light that is on or off, and the action SWITCH flips your own. When \
             all lights of all agents are in the same state, and it is not the state that scored \
             last, the team scores a point. So get all lights on, then all off, then on again, as \
             often as you can. An agent shown as $number has its light {light_marked}, one shown as a \
             plain number has it {light_plain}."
        ),
        TaskName::Foraging => format!(
            "There is a food source (F) and a nest (N). On most maps walls (W) between them make a \
             maze; there is always a way around each wall. Stand beside the food to pick some up, \
             carry it, and stand beside the nest to drop it there: each load scores a point. The food \
             never runs out. You carry one load at a time, and picking up and dropping happen by \
             themselves. An agent shown as $number {load_marked}, one shown as a plain number \
             {load_plain}."
        ),
        TaskName::Flocking => flocking(config.num_agents()),
    }
}

/// The side of the square, and the number of agents that it needs.
fn square(num_agents: u16) -> (u16, usize) {
    (num_agents / 4 + 1, swarmbench_engine::tasks::flocking::target(num_agents).len())
}

fn flocking(num_agents: u16) -> String {
    let (side, agents) = square(num_agents);
    let shape = match side {
        1 => "The target shape is a single cell with one agent on it.".to_owned(),
        2 => "Form a square of 2 x 2 cells with 4 agents.".to_owned(),
        _ => format!(
            "Form the outline of a square of {side} x {side} cells: {agents} agents stand along its \
             edge, and its inside is empty."
        ),
    };
    let surplus = match usize::from(num_agents) - agents {
        0 => "",
        1 => " One agent is not needed for it, and may stand anywhere.",
        more => &format!(" {more} agents are not needed for it, and may stand anywhere."),
    };
    format!(
        "{shape}{surplus} Where on the map the shape stands does not matter. The score is how much \
         closer to it the agents have come than they were at the start, at their best moment so far."
    )
}

/// The target shape of Flocking: rows of `A`, an agent, and `.`; no rows in other tasks.
#[cfg(feature = "render")]
pub(super) fn target(config: &Config) -> Vec<Vec<&'static str>> {
    if config.task() != TaskName::Flocking {
        return Vec::new();
    }
    let (side, _) = square(config.num_agents());
    let is_edge = |place: u16| place == 0 || place + 1 == side;
    let cell = |i, j| if is_edge(i) || is_edge(j) { "A" } else { "." };
    (0..side).map(|i| (0..side).map(|j| cell(i, j)).collect()).collect()
}

/// The meaning of an action.
#[must_use]
pub const fn meaning(action: Action) -> &'static str {
    match action {
        Action::Up => "move or push up",
        Action::Down => "move or push down",
        Action::Left => "move or push left",
        Action::Right => "move or push right",
        Action::Stay => "stay where you are",
        Action::Switch => "flip your light",
    }
}
