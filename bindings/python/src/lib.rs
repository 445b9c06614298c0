//! `swarmbench._native`: a batch of environments that writes into arrays which Python owns.
//!
//! Only what has to be native is here. Names, defaults, spaces and documentation are in `swarmbench.native`, in Python.

mod arrays;
mod batch;

use pyo3::prelude::*;

/// The module.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("CHANNELS", swarmbench_training::CHANNELS)?;
    module.add("RULES_REVISION", swarmbench_engine::RULES_REVISION)?;
    module.add_class::<batch::Batch>()
}
