//! Arrays of Python's, borrowed for one call.

use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadwriteArray, PyReadwriteArrayDyn};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use swarmbench_training::{Frame, Gains};

/// The arrays into which a batch writes.
pub(crate) struct Buffers {
    view: Py<PyArrayDyn<u8>>,
    agents: Py<PyArrayDyn<i16>>,
    position: Py<PyArrayDyn<i32>>,
    round: Py<PyArrayDyn<i32>>,
    score: Py<PyArrayDyn<f32>>,
    flag: Py<PyArrayDyn<u8>>,
    alive: Py<PyArrayDyn<bool>>,
    action_mask: Py<PyArrayDyn<bool>>,
    seed: Py<PyArrayDyn<i64>>,
}

/// The arrays of rewards into which a batch writes.
pub(crate) struct Earned {
    rewards: Py<PyArrayDyn<f32>>,
    team_reward: Py<PyArrayDyn<f32>>,
    terminated: Py<PyArrayDyn<bool>>,
    agent_done: Py<PyArrayDyn<bool>>,
}

/// The array of that name. Arrays are made in `swarmseat.native`, so only a mistake there leads to these errors.
fn array<T: Element>(arrays: &Bound<'_, PyDict>, name: &str) -> PyResult<Py<PyArrayDyn<T>>> {
    let found = arrays.get_item(name)?.ok_or_else(|| PyKeyError::new_err(name.to_owned()))?;
    let typed = found.cast_into::<PyArrayDyn<T>>();
    typed.map(Bound::unbind).map_err(|_| PyValueError::new_err(format!("{name} has another type")))
}

impl Buffers {
    pub(crate) fn new(arrays: &Bound<'_, PyDict>) -> PyResult<Self> {
        Ok(Self {
            view: array(arrays, "view")?,
            agents: array(arrays, "agents")?,
            position: array(arrays, "position")?,
            round: array(arrays, "round")?,
            score: array(arrays, "score")?,
            flag: array(arrays, "flag")?,
            alive: array(arrays, "alive")?,
            action_mask: array(arrays, "action_mask")?,
            seed: array(arrays, "seed")?,
        })
    }

    pub(crate) fn borrow<'py>(&self, py: Python<'py>) -> PyResult<Borrowed<'py>> {
        Ok(Borrowed {
            view: borrow(py, &self.view)?,
            agents: borrow(py, &self.agents)?,
            position: borrow(py, &self.position)?,
            round: borrow(py, &self.round)?,
            score: borrow(py, &self.score)?,
            flag: borrow(py, &self.flag)?,
            alive: borrow(py, &self.alive)?,
            action_mask: borrow(py, &self.action_mask)?,
            seed: borrow(py, &self.seed)?,
        })
    }
}

impl Earned {
    pub(crate) fn new(arrays: &Bound<'_, PyDict>) -> PyResult<Self> {
        Ok(Self {
            rewards: array(arrays, "rewards")?,
            team_reward: array(arrays, "team_reward")?,
            terminated: array(arrays, "terminated")?,
            agent_done: array(arrays, "agent_done")?,
        })
    }

    pub(crate) fn borrow<'py>(&self, py: Python<'py>) -> PyResult<BorrowedEarned<'py>> {
        Ok(BorrowedEarned {
            rewards: borrow(py, &self.rewards)?,
            team_reward: borrow(py, &self.team_reward)?,
            terminated: borrow(py, &self.terminated)?,
            agent_done: borrow(py, &self.agent_done)?,
        })
    }
}

fn borrow<'py, T: Element>(
    py: Python<'py>,
    array: &Py<PyArrayDyn<T>>,
) -> PyResult<PyReadwriteArrayDyn<'py, T>> {
    let array = array.bind(py);
    array.try_readwrite().map_err(|_| {
        PyValueError::new_err(
            "an array of the environments is used by another call at the same time",
        )
    })
}

/// Borrowed arrays, which are returned when this is dropped.
pub(crate) struct Borrowed<'py> {
    view: PyReadwriteArrayDyn<'py, u8>,
    agents: PyReadwriteArrayDyn<'py, i16>,
    position: PyReadwriteArrayDyn<'py, i32>,
    round: PyReadwriteArrayDyn<'py, i32>,
    score: PyReadwriteArrayDyn<'py, f32>,
    flag: PyReadwriteArrayDyn<'py, u8>,
    alive: PyReadwriteArrayDyn<'py, bool>,
    action_mask: PyReadwriteArrayDyn<'py, bool>,
    seed: PyReadwriteArrayDyn<'py, i64>,
}

impl Borrowed<'_> {
    pub(crate) fn frame(&mut self) -> PyResult<Frame<'_>> {
        Ok(Frame {
            view: slice(&mut self.view)?,
            numbers: slice(&mut self.agents)?,
            position: slice(&mut self.position)?,
            round: slice(&mut self.round)?,
            score: slice(&mut self.score)?,
            flag: slice(&mut self.flag)?,
            alive: slice(&mut self.alive)?,
            action_mask: slice(&mut self.action_mask)?,
            seed: slice(&mut self.seed)?,
        })
    }
}

pub(crate) struct BorrowedEarned<'py> {
    rewards: PyReadwriteArrayDyn<'py, f32>,
    team_reward: PyReadwriteArrayDyn<'py, f32>,
    terminated: PyReadwriteArrayDyn<'py, bool>,
    agent_done: PyReadwriteArrayDyn<'py, bool>,
}

impl BorrowedEarned<'_> {
    pub(crate) fn gains(&mut self) -> PyResult<Gains<'_>> {
        Ok(Gains {
            rewards: slice(&mut self.rewards)?,
            team_reward: slice(&mut self.team_reward)?,
            terminated: slice(&mut self.terminated)?,
            agent_done: slice(&mut self.agent_done)?,
        })
    }
}

fn slice<'a, T: Element>(
    array: &'a mut PyReadwriteArray<'_, T, numpy::IxDyn>,
) -> PyResult<&'a mut [T]> {
    array.as_slice_mut().map_err(|_| PyValueError::new_err("the arrays must be contiguous"))
}
