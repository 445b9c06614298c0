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
        TaskName::Transport => "A wall (W) surrounds the map, with one gap through which one gets \
            outside (*). A heavy block (B) stands in the gap. Find the block, push it out through \
            the gap together (that takes the force of five agents at once), then leave the map \
            through the gap yourselves. Every agent that gets out scores, and the more the earlier."
            .to_owned(),
        TaskName::Pursuit => "A prey (P) lives on the map. It moves up to two steps a round, away \
            from agents and walls, and cannot be pushed. Surround it: when all four cells beside it \
            (up, down, left, right) are taken by agents or walls, it is caught and you score a \
            point; a new prey then appears elsewhere. Catch as many as you can."
            .to_owned(),
        TaskName::Synchronization => format!(
            "Every agent has a light that is on or off, and the action SWITCH flips your own. When \
             all lights of all agents are in the same state, and it is not the state that scored \
             last, the team scores a point. So get all lights on, then all off, then on again, as \
             often as you can. An agent shown as $number has its light {light_marked}, one shown as a \
             plain number has it {light_plain}."
        ),
        TaskName::Foraging => format!(
            "There is a food source (F) and a nest (N), with walls (W) between them. Stand beside \
             the food to pick some up, carry it, and stand beside the nest to drop it there: each \
             load scores a point. You carry one load at a time, and picking up and dropping happen \
             by themselves. An agent shown as $number {load_marked}, one shown as a plain number \
             {load_plain}."
        ),
        TaskName::Flocking => {
            let side = config.num_agents() / 4 + 1;
            format!(
                "Form the outline of a square of {side} x {side} cells, {} agents along its edge and \
                 its inside empty. Where on the map it stands does not matter. The score is how much \
                 closer to that shape you have come, at best, than you were at the start.",
                swarmbench_engine::tasks::flocking::target(config.num_agents()).len()
            )
        }
    }
}

/// What an action does.
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
