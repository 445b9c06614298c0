//! `swarmseat._native`: a batch of environments that writes into arrays which Python owns.
//!
//! Only what has to be native is here. Names, defaults, spaces and documentation are in `swarmseat.native`, in Python.

mod arrays;
mod batch;
mod partners;

use std::sync::Arc;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use swarmbench_engine::{Act, Action, Canvas, Config, Scratch, Settings, TaskName, World};

/// The module.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("CHANNELS", swarmbench_training::CHANNELS)?;
    module.add("RULES_REVISION", swarmbench_engine::RULES_REVISION)?;
    module.add_function(wrap_pyfunction!(play_engine, module)?)?;
    module.add_class::<partners::Partners>()?;
    module.add_class::<batch::Batch>()
}

/// Plays rounds with the engine alone, and writes the windows of all agents as symbols: the baseline of a batch in
/// `bindings/python/bench.py`. Environments are played in turns, as in a batch.
#[pyfunction]
fn play_engine(py: Python<'_>, task: &str, environments: u32, rounds: u32) -> PyResult<()> {
    let task = TaskName::parse(task).ok_or_else(|| PyValueError::new_err("an unknown task"))?;
    py.detach(|| {
        let lay_out = |seed: u32| {
            let settings = Settings { memory: 0, ..Settings::standard(task, seed.into()) };
            World::new(Arc::new(Config::check(&settings).expect("the standard setting")))
        };
        let mut worlds: Vec<World> = (0..environments).map(lay_out).collect();
        let (mut canvas, mut scratch) = (Canvas::default(), Scratch::default());
        let (mut codes, mut numbers) = ([0; 25], [0; 25]);
        let actions = Action::of_task(task);
        let mut random = 27_u32;
        let mut acts = vec![Act::default(); 12];
        for _ in 0..rounds {
            for (world, seed) in worlds.iter_mut().zip(0..) {
                if world.is_over() {
                    *world = lay_out(seed);
                }
                for act in &mut acts {
                    // Good enough to walk about, and cheap beside a round.
                    random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    *act = Act::of(actions[(random >> 16) as usize % actions.len()]);
                }
                world.step_in(&acts, &mut scratch);
                canvas.draw(world);
                for agent in world.agents() {
                    canvas.write_window(agent, &mut codes, &mut numbers);
                    std::hint::black_box((&codes, &numbers));
                }
            }
        }
    });
    Ok(())
}
