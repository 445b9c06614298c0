//! The slowest decision of every built-in player, at the standard setting and on the largest maps.
//!
//! ```sh
//! cargo bench -p swarmbench-players --bench decisions -- --task Transport --player push-and-leave
//! ```
//!
//! All tasks and all their players are measured without options. The program fails if a decision takes more than 2 ms.
//! Times are thread CPU times: the time in which a decision waits for the system says nothing about the player. For the
//! same reason each game is played twice, which is the same game for deterministic players, and the faster time of each
//! decision counts.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use swarmbench_engine::{Config, Settings, TaskName, limits};
use swarmbench_players::game::LocalGame;
use swarmbench_players::{BuiltIn, of_task};

/// Number of times that each game is played.
const GAMES: usize = 2;

/// Maximum time of a decision.
const MOST: Duration = Duration::from_millis(2);

/// A setting with slow decisions.
struct Case {
    what: &'static str,
    /// Rows and columns of the map.
    size: i64,
    num_agents: i64,
    view_size: i64,
    control: &'static str,
    rounds: i64,
}

const CASES: [Case; 8] = [
    Case {
        what: "standard",
        size: 10,
        num_agents: 12,
        view_size: 5,
        control: "decentralized",
        rounds: 100,
    },
    Case {
        what: "swarm that sees all",
        size: 15,
        num_agents: 30,
        view_size: 5,
        control: "centralized",
        rounds: 100,
    },
    // A prey runs free nearly all the time.
    Case {
        what: "swarm after a prey",
        size: 20,
        num_agents: 29,
        view_size: 5,
        control: "centralized",
        rounds: 100,
    },
    Case {
        what: "largest map",
        size: 256,
        num_agents: 12,
        view_size: 5,
        control: "decentralized",
        rounds: 400,
    },
    Case {
        what: "crowd on a large map",
        size: 64,
        num_agents: 1024,
        view_size: 5,
        control: "decentralized",
        rounds: 40,
    },
    Case {
        what: "crowd on the largest map",
        size: 256,
        num_agents: 1024,
        view_size: 15,
        control: "decentralized",
        rounds: 40,
    },
    Case {
        what: "windows over the whole map",
        size: 256,
        num_agents: 256,
        view_size: 513,
        control: "decentralized",
        rounds: 12,
    },
    Case {
        what: "centralized, largest map",
        size: 256,
        num_agents: 256,
        view_size: 5,
        control: "centralized",
        rounds: 12,
    },
];

impl Case {
    fn settings(&self, task: TaskName) -> Settings {
        // The engine takes long to compute the cost of a large flock, which says nothing about the players.
        let most = if task == TaskName::Flocking { 64 } else { *limits::AGENTS.end() };
        Settings {
            control: self.control.to_owned(),
            num_agents: self.num_agents.min(most),
            width: self.size,
            height: self.size,
            view_size: self.view_size,
            memory: 0,
            max_round: self.rounds,
            ..Settings::standard(task, 1000)
        }
    }
}

/// The CPU time of this thread.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::try_from(time).expect("a thread has been running for some time")
}

/// The times of all decisions of a game.
fn play(built_in: &BuiltIn, config: &Arc<Config>) -> Vec<Duration> {
    let mut game = LocalGame::new(Arc::clone(config), built_in, 1);
    let mut times = Vec::new();
    while !game.world().is_over() {
        let acts = game.decide_by(|player, observation| {
            let start = processor_time();
            let act = player.decide(observation);
            times.push(processor_time().saturating_sub(start));
            act
        });
        game.step(&acts);
    }
    times
}

/// The fastest time of every decision over several identical games, sorted.
fn measure(built_in: &BuiltIn, settings: &Settings) -> Vec<Duration> {
    let config = Arc::new(Config::check(settings).expect("playable settings"));
    let mut best = play(built_in, &config);
    for _ in 1..GAMES {
        for (best, time) in best.iter_mut().zip(play(built_in, &config)) {
            *best = time.min(*best);
        }
    }
    best.sort_unstable();
    best
}

#[expect(clippy::disallowed_methods, reason = "what is asked for comes from the command line")]
fn main() -> ExitCode {
    let (mut task, mut player) = (None, None);
    let mut words = std::env::args().skip(1).filter(|word| word != "--bench");
    while let Some(word) = words.next() {
        match (word.as_str(), words.next()) {
            ("--task", Some(name)) => task = Some(name),
            ("--player", Some(name)) => player = Some(name),
            _ => {
                eprintln!("options: --task NAME, --player NAME");
                return ExitCode::FAILURE;
            }
        }
    }
    let is_asked = |asked: &Option<String>, name| asked.as_deref().is_none_or(|word| word == name);
    let mut slow = 0_usize;
    println!("{:16} {:22} {:28} median, 99.9 %, slowest", "task", "player", "setting");
    for of in TaskName::ALL.into_iter().filter(|of| is_asked(&task, of.name())) {
        for built_in in of_task(of).filter(|built_in| is_asked(&player, built_in.name)) {
            for case in &CASES {
                let times = measure(built_in, &case.settings(of));
                let share = |of: usize| times[(times.len() - 1) * of / 1000];
                let (name, what) = (built_in.name, case.what);
                let mark = if share(1000) > MOST { "  TOO SLOW" } else { "" };
                slow += usize::from(!mark.is_empty());
                println!(
                    "{:16} {name:22} {what:28} {:.1?}, {:.1?}, {:.1?}{mark}",
                    of.name(),
                    share(500),
                    share(999),
                    share(1000),
                );
            }
        }
    }
    if slow == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
