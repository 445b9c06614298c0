//! Rounds whose windows are written into buffers allocate nothing, whatever the agents' memory.

use allocation_counter::measure;
use swarmbench_engine::{Act, Canvas, Scratch, Settings, TaskName, World};
use swarmbench_testkit::worlds::{Dice, world};

/// Rounds of a new episode after which its state has all the memory that it needs.
const FIRST: usize = 20;
const ROUNDS: usize = 200;

/// Plays an episode twice, and counts allocations in the second run: the first brings the scratch memory to the size of
/// the hardest round. Agents act at random and send no messages.
fn count(settings: &Settings) {
    let start = world(settings);
    let mut dice = Dice(27);
    let quiet = |act: Act| Act { message: None, ..act };
    let rounds: Vec<Vec<Act>> =
        (0..ROUNDS).map(|_| dice.acts(&start).into_iter().map(quiet).collect()).collect();
    let cells = start.config().window();
    let all = cells * usize::from(start.config().num_agents());
    let (mut codes, mut numbers) = (vec![0; all], vec![0; all]);
    let (mut canvas, mut scratch) = (Canvas::default(), Scratch::default());
    let mut play = |state: &mut World, rounds: &[Vec<Act>]| {
        let mut played = 0;
        for acts in rounds {
            if state.is_over() {
                break;
            }
            canvas.draw(state);
            let out = codes.chunks_exact_mut(cells).zip(numbers.chunks_exact_mut(cells));
            for (agent, (codes, numbers)) in state.agents().zip(out) {
                canvas.write_window(agent, codes, numbers);
            }
            state.step_in(acts, &mut scratch);
            played += 1;
        }
        played
    };
    play(&mut start.clone(), &rounds);
    let mut state = start.clone();
    let (first, rest) = rounds.split_at(FIRST);
    play(&mut state, first);
    let mut played = 0;
    let counted = measure(|| played = play(&mut state, rest));
    assert!(played > 20, "{settings:?}: only {played} rounds were counted");
    assert_eq!(counted.count_total, 0, "{settings:?}: {counted:?} in {played} rounds");
}

#[test]
fn rounds_with_their_windows_allocate_nothing() {
    for task in TaskName::ALL {
        for (memory, num_agents, size) in [(0, 12, 10), (1, 12, 10), (5, 12, 10), (5, 60, 40)] {
            count(&Settings {
                memory,
                num_agents,
                width: size,
                height: size,
                max_round: 1000,
                ..Settings::standard(task, 3)
            });
        }
    }
}
