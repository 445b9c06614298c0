//! Times of worths on one core, as a table: games of `random` in the standard setting.
//!
//! ```sh
//! cargo bench -p swarmbench-worth --bench worth          # the layouts 0 to 2 of each task
//! ```

#![expect(clippy::print_stdout, reason = "it prints a table")]

use std::sync::Arc;
use std::time::Instant;

use swarmbench_engine::{Act, Action, Config, Settings, TaskName, World};
use swarmbench_players::{Seat, find};
use swarmbench_worth::{Appraiser, Decided, Game};

/// Layouts of each task.
const SEEDS: u64 = 3;

fn main() {
    println!("| task | reference | curve, s | longest | with the losses of seats, s | longest |");
    println!("| --- | --- | ---: | ---: | ---: | ---: |");
    for task in TaskName::ALL {
        let times = |with_seats| {
            let mut times: Vec<f64> = (0..SEEDS)
                .map(|seed| {
                    let game = game(task, seed);
                    let begun = Instant::now();
                    std::hint::black_box(Appraiser::new(game, with_seats).finish_on(1, |_| {}));
                    begun.elapsed().as_secs_f64()
                })
                .collect();
            times.sort_by(f64::total_cmp);
            (times[times.len() / 2], times[times.len() - 1])
        };
        let ((curve, longest), (seats, seats_longest)) = (times(false), times(true));
        let reference = swarmbench_players::default_for(task).name;
        println!(
            "| {} | `{reference}` | {curve:.2} | {longest:.2} | {seats:.1} | {seats_longest:.1} |",
            task.name()
        );
    }
}

/// A whole game of `random`.
fn game(task: TaskName, seed: u64) -> Game {
    let settings = Settings::standard(task, seed);
    let layout = Arc::new(World::new(Arc::new(Config::check(&settings).expect("good settings"))));
    let random = find("random", task).expect("it plays all tasks");
    let seat = |agent| random.make(&Seat::hosted(layout.config(), agent, b""));
    let mut players: Vec<_> = layout.agents().map(seat).collect();
    let (mut world, mut rounds) = (World::clone(&layout), Vec::new());
    while !world.is_over() {
        let decided = world.agents().zip(&mut players).map(|(agent, player)| {
            if world.is_alive(agent) {
                player.decide(&world.observe(agent))
            } else {
                Act::default()
            }
        });
        let mut acts: Vec<Act> = decided.collect();
        for act in &mut acts {
            act.action.get_or_insert(Action::Stay);
        }
        world.step(&acts);
        rounds.push(acts.into_iter().map(|act| Decided { act, ..Decided::default() }).collect());
    }
    Game { layout, rounds }
}
