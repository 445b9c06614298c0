//! Players of Flocking.

mod drift_together;
mod follow_the_leader;
mod meet_in_the_middle;
mod outline;
mod walk_to_own_cell;

use swarmbench_engine::TaskName;

use crate::BuiltIn;

/// The players of Flocking, the best one first.
pub(crate) static PLAYERS: &[BuiltIn] = &[
    BuiltIn {
        name: "meet-in-the-middle",
        tasks: &[TaskName::Flocking],
        summary: "Fills the outline of the square in the middle of the map, nearest free cell first.",
        make: meet_in_the_middle::make,
    },
    BuiltIn {
        name: "follow-the-leader",
        tasks: &[TaskName::Flocking],
        summary: "Fills the outline around the first agent, whose place all pass on.",
        make: follow_the_leader::make,
    },
    BuiltIn {
        name: "walk-to-own-cell",
        tasks: &[TaskName::Flocking],
        summary: "Walks to a cell of the outline in the middle that is its own by number.",
        make: walk_to_own_cell::make,
    },
    BuiltIn {
        name: "drift-together",
        tasks: &[TaskName::Flocking],
        summary: "Steps toward the middle of the agents in view.",
        make: drift_together::make,
    },
];

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use swarmbench_engine::*;
    #[test]
    fn finish() {
        let n: i64 = std::env::var("N").map_or(12, |n| n.parse().unwrap());
        let w: i64 = std::env::var("W").map_or(10, |n| n.parse().unwrap());
        let h: i64 = std::env::var("H").map_or(w, |n| n.parse().unwrap());
        let count: u64 = std::env::var("C").map_or(200, |n| n.parse().unwrap());
        let name = std::env::var("P").unwrap_or("meet-in-the-middle".into());
        let mut left = Vec::new();
        let mut rounds = Vec::new();
        let (mut score, mut initial) = (0.0, 0.0);
        for seed in 1000..1000 + count {
            let settings = Settings {
                num_agents: n,
                width: w,
                height: h,
                ..Settings::standard(TaskName::Flocking, seed)
            };
            let config = Arc::new(Config::check(&settings).unwrap());
            let mut game = crate::game::Game::new(
                config,
                crate::find(&name, TaskName::Flocking).unwrap(),
                seed,
            );
            initial += game.world().spectacle().distance.unwrap();
            while !game.world().is_over() {
                let acts = game.decide();
                game.step(&acts);
            }
            score += game.world().score();
            if std::env::var("SHOW").is_ok() && !game.world().is_done() {
                for row in game.world().spectacle().grid {
                    println!("N {row}");
                }
            }
            if game.world().is_done() {
                rounds.push(game.world().round());
            } else {
                left.push((seed, game.world().spectacle().distance.unwrap()));
            }
        }
        rounds.sort();
        println!(
            "N {n} {w}x{h}: initial {:.2} score {:.2}, {} unfinished {:?} rounds max {:?} median {:?}",
            initial / count as f64,
            score / count as f64,
            left.len(),
            &left[..left.len().min(6)],
            rounds.last(),
            rounds.get(rounds.len() / 2)
        );
    }
}
