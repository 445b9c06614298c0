//! Metrics of exported and imported games.

use serde::Deserialize;
use swarmbench_analysis::game::{Agent, Decision, Heard, Setup, State};
use swarmbench_analysis::journal::decisions;
use swarmbench_analysis::{Definition, Meter, Metric, Metrics, Options, RunValue};
use swarmbench_engine::{Action, Control, Direction, Pos, TaskName, World};

use super::format::GameRow;
use super::game::{DatasetGame, Turn};
use super::imported::{self, Unreadable};
use crate::store::entries::ImportedRound;
use crate::store::imports::StoredImport;

/// Symbols of fixed cells on a grid: walls, nest and food.
const FIXED: [&str; 3] = ["W", "N", "F"];

/// A meter for a game before its first round.
pub fn meter(layout: &World) -> Meter {
    Meter::new(Setup::of(layout), State::of(layout), Options::all(false))
}

/// Adds the last played round of a game.
pub fn add(meter: &mut Meter, game: &DatasetGame, turn: &Turn) {
    let world = game.world();
    let acts = turn.acts.iter().map(|act| &act.record);
    meter.round(&decisions(world.config(), acts), State::of(world), Some(&Heard::all(world)));
}

/// Measures an imported game state by state.
pub struct ImportMeter {
    setup: Setup,
    task: TaskName,
    options: Options,
    meter: Option<Meter>,
    /// Decisions in the last state.
    decided: Vec<Decision>,
}

impl ImportMeter {
    /// # Errors
    /// For games of an unknown task.
    pub fn new(stored: &StoredImport, series: bool) -> Result<Self, Unreadable> {
        let setup = setup(stored)?;
        let options = Options::all(series);
        Ok(Self { task: setup.task, setup, options, meter: None, decided: Vec::new() })
    }

    /// Adds the next state with its decisions.
    ///
    /// # Errors
    /// If the state or its acts cannot be read.
    pub fn add(&mut self, round: &ImportedRound) -> Result<(), Unreadable> {
        let row = imported::game_row(self.task.name(), round)?;
        let state = state(self.task, &row);
        let decided = decisions_of(self.task, round, &row, &state)?;
        let before = std::mem::replace(&mut self.decided, decided);
        if let Some(meter) = &mut self.meter {
            meter.round(&before, state, None);
        } else {
            let is_open = |cell: &&String| !FIXED.contains(&cell.as_str());
            let open_cells = row.grid.iter().flatten().filter(is_open).count();
            let setup = Setup { open_cells, ..self.setup.clone() };
            self.meter = Some(Meter::new(setup, state, self.options));
        }
        Ok(())
    }

    /// # Errors
    /// Without states.
    pub fn finish(self) -> Result<Metrics, Unreadable> {
        let no_states = || "it has no states".to_owned();
        let mut metrics = self.meter.ok_or_else(no_states)?.metrics();
        // The files do not distinguish an agent that stays from one without an action.
        let untold = (Definition::Paper, Metric::NoActionShare);
        metrics.values.insert(untold, RunValue::default());
        if let Some(series) = metrics.series.get_mut(&untold) {
            series.fill(None);
        }
        Ok(metrics)
    }
}

/// The setup of an imported game. The number of open cells is left to the layout.
///
/// # Errors
/// For games of an unknown task.
pub(super) fn setup(stored: &StoredImport) -> Result<Setup, Unreadable> {
    let settings = &stored.settings;
    let task = TaskName::parse(&stored.task);
    let task = task.ok_or_else(|| format!("there is no task {:?}", stored.task))?;
    let size = |cells: u32| i32::try_from(cells).unwrap_or(i32::MAX);
    // The toolkit knows no other control.
    let control = settings.control.as_deref().and_then(Control::parse);
    Ok(Setup {
        task,
        control: control.unwrap_or(Control::Decentralized),
        height: size(settings.height),
        width: size(settings.width),
        view_size: size(settings.view_size),
        memory: settings.memory.and_then(|rounds| u32::try_from(rounds).ok()),
        open_cells: 0,
    })
}

/// The fields of an act that matter for decisions.
#[derive(Deserialize)]
struct DecidedRow {
    agent_id: String,
    action: Option<String>,
    message: Option<String>,
}

/// The decisions in a state of the files, in order of its agents.
pub(super) fn decisions_of(
    task: TaskName,
    round: &ImportedRound,
    row: &GameRow,
    state: &State,
) -> Result<Vec<Decision>, Unreadable> {
    let mut decided = vec![Decision::default(); row.agents.len()];
    let agents = u32::try_from(row.agents.len()).unwrap_or(u32::MAX);
    imported::each_act(round, agents, |act: DecidedRow| {
        let agent = row.agents.iter().position(|agent| agent.id == act.agent_id);
        let agent = agent.ok_or_else(|| format!("there is no agent {:?}", act.agent_id))?;
        // The toolkit still writes rows for escaped agents.
        if state.agents[agent].alive {
            decided[agent] = Decision {
                action: act.action.as_deref().and_then(|name| Action::parse(task, name)),
                message: act.message.filter(|text| !text.is_empty()),
                ..Decision::default()
            };
        }
        Ok(())
    })?;
    Ok(decided)
}

/// The part of a state that metrics need.
pub(super) fn state(task: TaskName, row: &GameRow) -> State {
    let cell = |at: Pos| {
        let (i, j) = (usize::try_from(at.i).ok()?, usize::try_from(at.j).ok()?);
        Some(row.grid.get(i)?.get(j)?.as_str())
    };
    let positions = || {
        (0..).zip(&row.grid).flat_map(|(i, cells)| {
            (0..).zip(cells).map(move |(j, cell)| (Pos::new(i, j), cell.as_str()))
        })
    };
    let of = |symbol: &'static str| {
        positions().filter(move |(_, cell)| *cell == symbol).map(|(at, _)| at)
    };
    let agents = row.agents.iter().map(|agent| {
        let at = Pos::new(agent.y, agent.x);
        let own = cell(at);
        let light_on = (task == TaskName::Synchronization).then_some(own == Some("A"));
        Agent { at, alive: own.is_some(), light_on }
    });
    let freedom = |prey: Pos| {
        let free = Direction::ALL.map(|way| cell(prey.toward(way)) == Some("."));
        free.into_iter().map(u32::from).sum()
    };
    State {
        score: row.score,
        agents: agents.collect(),
        block: of("B").collect(),
        prey_freedom: of("P").next().map(freedom),
    }
}
