//! The batch as Python calls it.

use std::sync::{Mutex, MutexGuard};

use numpy::{PyReadonlyArray1, PyReadonlyArrayDyn};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use swarmbench_engine::{Act, Action, AgentId, Message, Seed, Settings};
use swarmbench_protocol::failure::Failure;
use swarmbench_training::{
    Autoreset, Batch as Environments, BatchError, Mask, Observations, Options, Rewards, Said, Turn,
};

use crate::arrays::{Buffers, Earned};
use crate::partners::Partners;

/// The code of an act without an action.
const NO_ACTION: u8 = u8::MAX;

/// Environments, and the arrays into which they write.
struct Open {
    environments: Environments,
    codes: Vec<u8>,
    now: Option<Buffers>,
    last: Option<Buffers>,
    earned: Option<Earned>,
}

/// Environments that are stepped together: the core of `swarmseat.VecEnv`.
#[pyclass(frozen, module = "swarmseat._native")]
pub(crate) struct Batch {
    inner: Mutex<Option<Open>>,
}

/// The place of an action among those of the task or -1 for none, a message, and a commander's receiver.
type Told = (i64, Option<String>, Option<u16>);

/// A parsed answer: action, message, receiver, and the reason why it does not count.
type Read = (i64, Option<String>, Option<u16>, Option<&'static str>);

/// A decision of an agent: its number, action, message and receiver.
type Decided = (u16, i64, Option<String>, Option<u16>);

/// A message as it comes from Python: environment, agent, text, and a commander's receiver.
type Words = (usize, usize, String, Option<usize>);

#[expect(clippy::needless_pass_by_value, reason = "so that arguments are taken from Python")]
#[pymethods]
impl Batch {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "they are keyword arguments")]
    #[pyo3(signature = (
        *, task, rules, control, num_agents, width, height, view_size, memory, max_round, noise, max_delay,
        num_envs, seed, threads, observations, rewards, autoreset, mask, record, answer_reader
    ))]
    fn new(
        py: Python<'_>,
        task: String,
        rules: String,
        control: String,
        num_agents: i64,
        width: i64,
        height: i64,
        view_size: i64,
        memory: i64,
        max_round: i64,
        noise: f64,
        max_delay: i64,
        num_envs: usize,
        seed: u64,
        threads: usize,
        observations: &str,
        rewards: &str,
        autoreset: &str,
        mask: &str,
        record: bool,
        answer_reader: String,
    ) -> PyResult<Self> {
        let settings = Settings {
            task,
            rules,
            control,
            seed: 0,
            num_agents,
            width,
            height,
            view_size,
            memory,
            max_round,
            noise,
            max_delay,
            answer_reader,
        };
        let options = Options {
            environments: num_envs,
            seed,
            threads,
            observations: match observations {
                "planes" => Observations::Planes,
                "symbols" => Observations::Symbols,
                _ => Observations::None,
            },
            rewards: if rewards == "individual" { Rewards::Individual } else { Rewards::Team },
            autoreset: match autoreset {
                "same_step" => Autoreset::SameStep,
                "disabled" => Autoreset::Disabled,
                _ => Autoreset::NextStep,
            },
            mask: if mask == "moves" { Mask::Moves } else { Mask::Alive },
            record,
        };
        let environments = py.detach(|| Environments::new(&settings, options)).map_err(raised)?;
        let codes = vec![0; environments.shape().environments * environments.shape().agents];
        let inner = Open { environments, codes, now: None, last: None, earned: None };
        Ok(Self { inner: Mutex::new(Some(inner)) })
    }

    /// The sizes of all arrays.
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let guard = self.lock()?;
        let shape = get(&guard)?.environments.shape();
        let sizes = PyDict::new(py);
        sizes.set_item("envs", shape.environments)?;
        sizes.set_item("agents", shape.agents)?;
        sizes.set_item("window", shape.window)?;
        sizes.set_item("planes", shape.planes)?;
        sizes.set_item("actions", shape.actions)?;
        sizes.set_item("flag", shape.flag)?;
        Ok(sizes)
    }

    /// Sets the arrays into which everything is written from now on.
    fn bind(
        &self,
        now: &Bound<'_, PyDict>,
        last: Option<&Bound<'_, PyDict>>,
        earned: &Bound<'_, PyDict>,
    ) -> PyResult<()> {
        let mut guard = self.lock()?;
        let inner = get_mut(&mut guard)?;
        inner.now = Some(Buffers::new(now)?);
        inner.last = last.map(Buffers::new).transpose()?;
        inner.earned = Some(Earned::new(earned)?);
        Ok(())
    }

    /// Begins episodes, with these seeds or drawn ones, in all environments or those of the mask.
    fn reset(
        &self,
        py: Python<'_>,
        seeds: Option<Vec<i64>>,
        only: Option<Vec<bool>>,
    ) -> PyResult<()> {
        let mut guard = self.lock()?;
        let Open { environments, now, .. } = get_mut(&mut guard)?;
        let seeds: Vec<Seed> = (seeds.unwrap_or_default().into_iter())
            .map(|seed| Seed::try_from(seed).map_err(|error| refused(&format!("seed {error}"))))
            .collect::<PyResult<_>>()?;
        let mut now = bound(now.as_ref())?.borrow(py)?;
        let frame = now.frame()?;
        py.detach(|| environments.reset(&seeds, only.as_deref(), frame)).map_err(raised)
    }

    /// Plays a round; `actions` has one number for each agent of each environment.
    fn step(
        &self,
        py: Python<'_>,
        actions: PyReadonlyArrayDyn<'_, i64>,
        messages: Vec<Words>,
    ) -> PyResult<()> {
        let mut guard = self.lock()?;
        let Open { environments, codes, now, last, earned } = get_mut(&mut guard)?;
        let shape = environments.shape();
        let given = actions.as_slice().map_err(|_| refused("actions must be contiguous"))?;
        if given.len() != codes.len() {
            let expected = codes.len();
            return Err(refused(&format!(
                "actions must have {expected} elements, has {}",
                given.len()
            )));
        }
        for (place, (code, &action)) in codes.iter_mut().zip(given).enumerate() {
            *code = match usize::try_from(action) {
                Ok(number) if number < shape.actions => u8::try_from(number).unwrap_or(NO_ACTION),
                _ if action == -1 => NO_ACTION,
                _ => {
                    return Err(refused(&format!(
                        "environment {}, agent {}: actions are 0 to {}, or -1 for none, not {action}",
                        place / shape.agents,
                        place % shape.agents,
                        shape.actions - 1
                    )));
                }
            };
        }
        let messages = messages.into_iter().filter_map(read).collect::<PyResult<Vec<Said>>>()?;
        let mut now = bound(now.as_ref())?.borrow(py)?;
        let mut earned = bound(earned.as_ref())?.borrow(py)?;
        let mut last = last.as_ref().map(|last| last.borrow(py)).transpose()?;
        let (frame, gains) = (now.frame()?, earned.gains()?);
        let last = last.as_mut().map(super::arrays::Borrowed::frame).transpose()?;
        let turn = Turn { actions: codes, messages };
        py.detach(|| environments.step(turn, frame, gains, last)).map_err(raised)
    }

    /// Copies an environment into others.
    fn fork(&self, py: Python<'_>, from: usize, to: PyReadonlyArray1<'_, i64>) -> PyResult<()> {
        let mut guard = self.lock()?;
        let Open { environments, now, .. } = get_mut(&mut guard)?;
        let count = environments.shape().environments;
        let place = |&index: &i64| {
            let index = usize::try_from(index);
            index.map_err(|_| refused(&format!("environments are 0 to {}", count - 1)))
        };
        let to = to.as_slice().map_err(|_| refused("the environments must be contiguous"))?;
        let to: Vec<usize> = to.iter().map(place).collect::<PyResult<_>>()?;
        let mut now = bound(now.as_ref())?.borrow(py)?;
        let frame = now.frame()?;
        py.detach(|| environments.fork(from, &to, frame)).map_err(raised)
    }

    fn state<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyBytes>> {
        let guard = self.lock()?;
        let state = get(&guard)?.environments.state(index).map_err(raised)?;
        Ok(PyBytes::new(py, &state))
    }

    fn load(&self, py: Python<'_>, index: usize, state: &[u8]) -> PyResult<()> {
        let mut guard = self.lock()?;
        let Open { environments, now, .. } = get_mut(&mut guard)?;
        let mut now = bound(now.as_ref())?.borrow(py)?;
        let frame = now.frame()?;
        let state = state.to_vec();
        py.detach(|| environments.load(index, &state, frame)).map_err(raised)
    }

    fn digest(&self, index: usize) -> PyResult<String> {
        let guard = self.lock()?;
        Ok(get(&guard)?.environments.digest(index).map_err(raised)?.to_string())
    }

    fn journal<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        episode: String,
        created_at: &str,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let guard = self.lock()?;
        let created_at = created_at.parse().map_err(|_| refused("created_at is no time"))?;
        let journal = get(&guard)?.environments.journal(index, episode, created_at);
        let journal = journal.map_err(raised)?;
        Ok(PyBytes::new(py, journal.as_bytes()))
    }

    fn prompt(&self, index: usize, agent: usize, template: Option<String>) -> PyResult<String> {
        let guard = self.lock()?;
        let template = swarmbench_prompt::chosen(template);
        let template = template.as_deref().unwrap_or(swarmbench_prompt::BUILT_IN);
        get(&guard)?.environments.prompt(index, agent, template).map_err(raised)
    }

    /// Parses an answer of a language model: action, message and receiver, or the reason why it does not count.
    fn read_answer(&self, agent: usize, text: &str) -> PyResult<Read> {
        let guard = self.lock()?;
        let environments = &get(&guard)?.environments;
        let answer = environments.read_answer(agent, text).map_err(raised)?;
        let (action, message, to) = told(environments, answer.act);
        Ok((action, message, to, answer.fault.map(|fault| Failure::of(None, fault).name())))
    }

    /// Built-in players for agents of an environment whose episode has just begun.
    fn partners(&self, index: usize, names: Vec<(usize, String)>) -> PyResult<Partners> {
        let guard = self.lock()?;
        let made = get(&guard)?.environments.partners(index, &names).map_err(raised)?;
        Ok(Partners(Mutex::new(made)))
    }

    /// The decisions of the partners on the map in this round: agent, action, message and receiver.
    fn decide(&self, py: Python<'_>, index: usize, partners: &Partners) -> PyResult<Vec<Decided>> {
        let guard = self.lock()?;
        let environments = &get(&guard)?.environments;
        let decided = py.detach(|| {
            let mut partners = partners.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            environments.decide(index, &mut partners)
        });
        let decided = decided.map_err(raised)?.into_iter().map(|(agent, act)| {
            let (action, message, to) = told(environments, act);
            (agent.0, action, message, to)
        });
        Ok(decided.collect())
    }

    /// The observation as the server writes it, as JSON.
    fn sight(&self, index: usize, agent: usize) -> PyResult<String> {
        let guard = self.lock()?;
        let sight = get(&guard)?.environments.sight(index, agent).map_err(raised)?;
        Ok(serde_json::to_string(&sight).expect("a sight has string keys"))
    }

    /// The whole map in the symbols of agents.
    fn map(&self, index: usize) -> PyResult<Vec<Vec<String>>> {
        let guard = self.lock()?;
        get(&guard)?.environments.map(index).map_err(raised)
    }

    /// Environment, agent and text of all messages that were received with the current observations.
    fn heard(&self) -> PyResult<Vec<(usize, u16, String)>> {
        let guard = self.lock()?;
        let heard = get(&guard)?.environments.heard();
        Ok(heard.map(|(index, agent, text)| (index, agent.0, text.to_string())).collect())
    }

    fn close(&self) -> PyResult<()> {
        *self.lock()? = None;
        Ok(())
    }
}

impl Batch {
    fn lock(&self) -> PyResult<MutexGuard<'_, Option<Open>>> {
        // A call of another thread has let the interpreter go while it steps; waiting for it with the interpreter
        // would be a deadlock.
        match self.inner.try_lock() {
            Ok(guard) => Ok(guard),
            Err(std::sync::TryLockError::WouldBlock) => Err(PyRuntimeError::new_err(
                "another thread is stepping these environments: one call at a time",
            )),
            Err(std::sync::TryLockError::Poisoned(_)) => Err(PyRuntimeError::new_err(
                "an earlier call failed in the middle, so the environments are in no known state: make new ones",
            )),
        }
    }
}

fn told(environments: &Environments, act: Act) -> Told {
    let actions = Action::of_task(environments.config().task());
    let place = act.action.and_then(|action| actions.iter().position(|known| *known == action));
    let number = place.and_then(|place| i64::try_from(place).ok()).unwrap_or(-1);
    (number, act.message.map(|message| message.to_string()), act.to.map(|to| to.0))
}

fn get<'a>(guard: &'a MutexGuard<'_, Option<Open>>) -> PyResult<&'a Open> {
    guard.as_ref().ok_or_else(closed)
}

fn get_mut<'a>(guard: &'a mut MutexGuard<'_, Option<Open>>) -> PyResult<&'a mut Open> {
    guard.as_mut().ok_or_else(closed)
}

fn closed() -> PyErr {
    PyRuntimeError::new_err("the environments are closed")
}

fn bound<T>(arrays: Option<&T>) -> PyResult<&T> {
    arrays.ok_or_else(|| PyRuntimeError::new_err("no arrays were given"))
}

fn refused(problem: &str) -> PyErr {
    PyValueError::new_err(problem.to_owned())
}

#[expect(clippy::needless_pass_by_value, reason = "it is used with map_err")]
fn raised(error: BatchError) -> PyErr {
    match error {
        BatchError::Over(_) | BatchError::NotRecorded | BatchError::Threads(_) => {
            PyRuntimeError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

/// A message; none for an empty text.
fn read((environment, agent, text, to): Words) -> Option<PyResult<Said>> {
    let text = Message::new(&text)?;
    let number = |agent: usize| {
        u16::try_from(agent)
            .map(AgentId)
            .map_err(|_| refused(&format!("there is no agent {agent}")))
    };
    let said = || {
        let to = to.map(number).transpose()?;
        Ok(Said { environment, agent: number(agent)?, text, to })
    };
    Some(said())
}
