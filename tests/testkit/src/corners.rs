//! The corners of the settings of new games: at a corner no setting can be larger while the others stay.
//!
//! Limits are only asked of [`Config::admit`], so corners move with them.

use swarmbench_engine::{Config, Control, Settings, TaskName, limits};

/// A setting that makes a game more expensive.
#[derive(Clone, Copy, Debug)]
enum Axis {
    Agents,
    View,
    Memory,
    Delay,
    /// Agents that all see and hear each other, wherever they are.
    Hearers,
}

impl Axis {
    const ALL: [Self; 4] = [Self::Agents, Self::View, Self::Memory, Self::Delay];

    /// An upper bound of the steps of any setting.
    const STEPS: i64 = 1 << 11;

    /// The value of the setting, in steps from its minimum.
    fn steps(self, settings: &Settings) -> i64 {
        match self {
            Self::Agents | Self::Hearers => settings.num_agents - 1,
            Self::View => (settings.view_size - 3) / 2,
            Self::Memory => settings.memory,
            Self::Delay => settings.max_delay,
        }
    }

    /// The same settings with this one at a number of steps.
    fn at(self, settings: &Settings, steps: i64) -> Settings {
        let mut settings = settings.clone();
        match self {
            Self::Agents => settings.num_agents = 1 + steps,
            Self::View => settings.view_size = 3 + 2 * steps,
            Self::Memory => settings.memory = steps,
            Self::Delay => settings.max_delay = steps,
            Self::Hearers => {
                settings.num_agents = 1 + steps;
                settings.view_size = 2 * settings.width - 1;
            }
        }
        settings
    }

    /// The same settings with this one at the maximum that a new game may have.
    fn raised(self, settings: &Settings) -> Settings {
        let (mut some, mut too_many) = (self.steps(settings), Self::STEPS);
        while too_many - some > 1 {
            let steps = i64::midpoint(some, too_many);
            let is_admitted = Config::admit(&self.at(settings, steps)).is_ok();
            *(if is_admitted { &mut some } else { &mut too_many }) = steps;
        }
        self.at(settings, some)
    }
}

/// All permutations of some axes.
fn orders(axes: &[Axis]) -> Vec<Vec<Axis>> {
    if axes.is_empty() {
        return vec![Vec::new()];
    }
    let mut all = Vec::new();
    for first in 0..axes.len() {
        let mut rest = axes.to_vec();
        let first = rest.remove(first);
        all.extend(orders(&rest).into_iter().map(|rest| [vec![first], rest].concat()));
    }
    all
}

/// The corners of a task on some maps: from the smallest game each setting in turn is raised to its maximum, in every
/// order, until none can be raised further.
///
/// The maps are the smallest and the largest, the one that holds the most agents, and the one on which the most
/// agents all hear each other. On each map a second start has as many agents as can all hear each other.
pub fn corners(task: TaskName, control: Control) -> Vec<Settings> {
    let smallest = |size| Settings {
        task: task.name().to_owned(),
        control: control.name().to_owned(),
        num_agents: 1,
        width: size,
        height: size,
        view_size: 3,
        memory: 0,
        ..Settings::default()
    };
    let most = |axis: Axis| {
        let agents = |size: &i64| axis.raised(&smallest(*size)).num_agents;
        // `max_by_key` takes the last of several maximums: the smallest map.
        limits::SIZE.rev().max_by_key(agents).expect("a map")
    };
    let sizes =
        [*limits::SIZE.start(), most(Axis::Agents), most(Axis::Hearers), *limits::SIZE.end()];
    let mut corners: Vec<Settings> = Vec::new();
    for size in sizes {
        for start in [smallest(size), Axis::Hearers.raised(&smallest(size))] {
            for order in orders(&Axis::ALL) {
                let corner = raised(start.clone(), &order);
                if !corners.contains(&corner) {
                    corners.push(corner);
                }
            }
        }
    }
    corners
}

/// The corner at the end of an order.
fn raised(mut settings: Settings, order: &[Axis]) -> Settings {
    loop {
        let raised = order.iter().fold(settings.clone(), |some, axis| axis.raised(&some));
        if raised == settings {
            return settings;
        }
        settings = raised;
    }
}
