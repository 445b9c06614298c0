//! Built-in players beside a policy, as Python holds them.

use std::sync::Mutex;

use pyo3::prelude::*;

/// Built-in players of one episode. `Batch.partners` makes them, and `Batch.decide` asks them.
#[pyclass(frozen, module = "swarmseat._native")]
pub(crate) struct Partners(pub(crate) Mutex<swarmbench_training::Partners>);
