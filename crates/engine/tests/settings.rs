//! Settings that cannot be played are refused with a reason; all others can be played to the end.

use std::collections::BTreeSet;

use proptest::prelude::*;
use swarmbench_engine::{AgentId, Config, Pos, Settings, TaskName, World};
use swarmbench_testkit::worlds::{Dice, world};

/// A change to the standard settings of Transport, and the error it causes.
type SettingCase = (fn(&mut Settings), &'static str);

const REFUSED: &[SettingCase] = &[
    (|s| s.width = 7, "width must be from 8 to 256, is 7"),
    (|s| s.width = 257, "width must be from 8 to 256, is 257"),
    (|s| s.width = i64::MIN, "width must be from 8 to 256, is -9223372036854775808"),
    (|s| s.height = 7, "height must be from 8 to 256, is 7"),
    (|s| s.height = 257, "height must be from 8 to 256, is 257"),
    (|s| s.view_size = 1, "view_size must be odd and from 3 to 21, is 1"),
    (|s| s.view_size = -5, "view_size must be odd and from 3 to 21, is -5"),
    (|s| s.view_size = 6, "view_size must be odd and from 3 to 21, is 6"),
    (|s| s.view_size = 23, "view_size must be odd and from 3 to 21, is 23"),
    (|s| (s.height, s.view_size) = (20, 43), "view_size must be odd and from 3 to 41, is 43"),
    (|s| s.num_agents = 0, "num_agents must be from 1 to 1024, is 0"),
    (|s| s.num_agents = -1, "num_agents must be from 1 to 1024, is -1"),
    (|s| s.num_agents = 1025, "num_agents must be from 1 to 1024, is 1025"),
    (
        |s| s.num_agents = 56,
        "num_agents must be from 1 to 55 to fit on this map of Transport, is 56",
    ),
    (
        |s| (s.task, s.num_agents) = ("Pursuit".into(), 26),
        "num_agents must be from 1 to 25 to fit on this map of Pursuit, is 26",
    ),
    (
        |s| (s.task, s.num_agents) = ("Flocking".into(), 65),
        "num_agents must be from 1 to 64 to fit on this map of Flocking, is 65",
    ),
    (
        |s| (s.task, s.width, s.height, s.num_agents) = ("Flocking".into(), 40, 40, 257),
        "num_agents must be from 1 to 256 in Flocking, is 257",
    ),
    (|s| s.max_round = 0, "max_round must be from 1 to 100000, is 0"),
    (|s| s.max_round = 100_001, "max_round must be from 1 to 100000, is 100001"),
    (
        |s| (s.width, s.height, s.num_agents, s.max_round) = (40, 40, 101, 99_010),
        "max_round × num_agents must be at most 10000000, is 10000010",
    ),
    (|s| s.memory = -1, "memory must be from 0 to 50, is -1"),
    (|s| s.memory = 51, "memory must be from 0 to 50, is 51"),
    (
        |s| (s.width, s.view_size, s.memory) = (256, 257, 1),
        "memory × cells of a window must be at most 65536, is 66049",
    ),
    (
        |s| (s.width, s.height, s.control, s.memory) = (256, 256, "centralized".into(), 2),
        "memory × cells of a window must be at most 65536, is 131072",
    ),
    (
        |s| {
            (s.width, s.height, s.control, s.memory) = (256, 256, "centralized".into(), 1);
            s.num_agents = 65;
        },
        "memory × cells of a window × num_agents must be at most 4194304, is 4259840",
    ),
    (|s| s.noise = -0.001, "noise must be a probability from 0 to 1, is -0.001"),
    (|s| s.noise = 1.001, "noise must be a probability from 0 to 1, is 1.001"),
    (|s| s.noise = f64::NAN, "noise must be a probability from 0 to 1, is NaN"),
    (|s| s.noise = f64::INFINITY, "noise must be a probability from 0 to 1, is inf"),
    (|s| s.max_delay = -1, "max_delay must be from 0 to 100, is -1"),
    (|s| s.max_delay = 101, "max_delay must be from 0 to 100, is 101"),
    (|s| s.seed = -1, "seed must be from 0 to 9007199254740991, is -1"),
    (|s| s.seed = 1 << 53, "seed must be from 0 to 9007199254740991, is 9007199254740992"),
    (
        |s| s.task = "transport".into(),
        "task must be one of Transport, Pursuit, Synchronization, Foraging, Flocking, is \"transport\"",
    ),
    (|s| s.rules = String::new(), "rules must be one of paper, reference, is \"\""),
    (
        |s| s.control = "swarm".into(),
        "control must be one of decentralized, centralized, is \"swarm\"",
    ),
    (
        |s| (s.rules, s.width) = ("reference".into(), 12),
        "width must equal height under the rules `reference`, is 12 with height 10",
    ),
    (
        |s| (s.rules, s.width, s.memory) = ("Paper".into(), 0, 99),
        "rules must be one of paper, reference, is \"Paper\"; width must be from 8 to 256, is 0; \
         memory must be from 0 to 50, is 99",
    ),
];

/// A name, its setter, and its range.
type Number = (&'static str, fn(&mut Settings, i32), [i32; 2]);

macro_rules! numbers {
    ({} $([$(
        $(#[doc = $doc:literal])* $(#[serde $later:tt])?
        $setting:ident: $asked:ident => $checked:ident = $usual:tt in $least:tt..=$most:tt;
    )*] {})*) => {
        const NUMBERS: &[Number] = &[$($((
            stringify!($setting),
            |settings, value| settings.$setting = value.into(),
            [$least, $most],
        ),)*)*];
    };
}

swarmbench_engine::for_each_setting! { numbers, {}, {} }

/// Clients read the list's ranges in the `OpenAPI` document.
#[test]
fn the_ranges_in_the_list_of_settings_are_those_that_are_checked() {
    for &(name, set, [least, most]) in NUMBERS {
        for (value, is_allowed) in
            [(least - 1, false), (least, true), (most, true), (most + 1, false)]
        {
            let mut settings = Settings {
                width: 256,
                height: 256,
                memory: 0,
                ..Settings::standard(TaskName::Transport, 1)
            };
            set(&mut settings, value);
            let refused = Config::check(&settings).map_err(|errors| errors.0[0].field).err();
            assert_eq!(refused, (!is_allowed).then_some(name), "{name} {value}");
        }
    }
}

/// Settings that an episode created earlier may have, and a new one may not.
const REFUSED_WHEN_NEW: &[SettingCase] = &[
    (
        |s| (s.width, s.height, s.view_size, s.memory, s.num_agents) = (256, 256, 513, 0, 1024),
        "num_agents × cells of a window must be at most 1048576, is 269485056; num_agents × agents that one of \
         them reaches (at most the cells of a window) must be at most 131072, is 1048576",
    ),
    (
        |s| (s.width, s.view_size, s.memory, s.num_agents) = (256, 513, 0, 4),
        "num_agents × cells of a window must be at most 1048576, is 1052676",
    ),
    (
        |s| {
            (s.width, s.height, s.control, s.memory) = (256, 256, "centralized".into(), 0);
            s.num_agents = 17;
        },
        "num_agents × cells of a window must be at most 1048576, is 1114112",
    ),
    (
        |s| (s.width, s.height, s.view_size, s.memory, s.num_agents) = (64, 64, 21, 1, 363),
        "num_agents × agents that one of them reaches (at most the cells of a window) must be at most 131072, \
         is 131769",
    ),
    (
        |s| {
            (s.width, s.height, s.view_size, s.memory) = (64, 64, 21, 1);
            (s.num_agents, s.max_delay) = (204, 100);
        },
        "max_delay (+ 1) × num_agents × agents that one of them reaches (at most the cells of a window) must be \
         at most 4194304, is 4203216",
    ),
    (
        |s| {
            (s.width, s.height, s.view_size, s.memory) = (64, 64, 3, 50);
            (s.num_agents, s.max_delay) = (1024, 15);
        },
        "memory (+ max_delay) × num_agents must be at most 65536, is 66560",
    ),
];

const ACCEPTED: &[fn(&mut Settings)] = &[
    |s| (s.width, s.height) = (8, 8),
    |s| (s.width, s.height) = (256, 8),
    |s| (s.width, s.height) = (8, 256),
    |s| s.view_size = 3,
    |s| s.view_size = 21,
    |s| s.num_agents = 1,
    |s| s.num_agents = 55,
    |s| (s.width, s.height, s.num_agents) = (256, 256, 1024),
    |s| (s.width, s.height, s.num_agents, s.task) = (40, 40, 256, "Flocking".into()),
    |s| s.max_round = 1,
    |s| (s.num_agents, s.max_round) = (50, 100_000),
    |s| s.memory = 0,
    |s| (s.width, s.view_size, s.memory, s.num_agents) = (256, 513, 0, 3),
    |s| s.memory = 50,
    |s| {
        (s.width, s.height, s.control, s.memory) = (256, 256, "centralized".into(), 1);
        s.num_agents = 16;
    },
    |s| (s.width, s.height, s.view_size, s.memory, s.num_agents) = (64, 64, 11, 1, 1024),
    |s| (s.width, s.height, s.view_size, s.num_agents, s.max_delay) = (64, 64, 3, 455, 100),
    |s| s.noise = 1.0,
    |s| s.max_delay = 100,
    |s| s.seed = 0,
    |s| s.seed = (1 << 53) - 1,
    |s| s.rules = "reference".into(),
];

#[test]
fn each_setting_that_cannot_be_played_is_named_with_its_range() {
    for (change, says) in REFUSED {
        let mut settings = Settings::standard(TaskName::Transport, 1);
        change(&mut settings);
        let refused = Config::check(&settings).expect_err(says);
        assert_eq!(refused.to_string(), *says, "{settings:?}");
    }
}

#[test]
fn what_a_new_episode_may_not_have_is_played_on_where_it_was_created_before() {
    for (change, says) in REFUSED_WHEN_NEW {
        let mut settings = Settings::standard(TaskName::Transport, 1);
        change(&mut settings);
        let refused = Config::admit(&settings).expect_err(says);
        assert_eq!(refused.to_string(), *says, "{settings:?}");
        let mut world = world(&settings);
        world.step(&Dice(1).acts(&world));
        check_observation(&world, 0);
    }
}

/// The memory of a large map with one agent holds only the pieces in which the agent was.
#[test]
fn remembered_boards_share_what_has_not_changed() {
    let mut settings = Settings::standard(TaskName::Transport, 1);
    (settings.width, settings.height, settings.view_size) = (256, 256, 3);
    (settings.num_agents, settings.memory) = (1, 50);
    let mut world = world(&settings);
    let empty = world.approximate_bytes();
    for _ in 0..60 {
        world.step(&Dice(1).acts(&world));
    }
    let remembered = world.approximate_bytes() - empty;
    assert!(empty > 128 * 1024 && empty < 160 * 1024, "a map has 2 bytes a cell: {empty}");
    assert!(remembered < 50 * 8 * 1024, "{remembered} bytes");
}

#[test]
fn the_ends_of_each_range_can_be_played() {
    for change in ACCEPTED {
        let mut settings = Settings::standard(TaskName::Transport, 1);
        change(&mut settings);
        let config = Config::admit(&settings).unwrap_or_else(|e| panic!("{settings:?}: {e}"));
        assert_eq!(config.settings(), settings);
        let mut world = world(&settings);
        if !world.is_over() {
            let acts = Dice(1).acts(&world);
            world.step(&acts);
        }
    }
}

/// Settings of every kind; most are small, some are as large as can be.
fn settings() -> impl Strategy<Value = Settings> {
    let size = || prop_oneof![8 => 8..=14_i64, 3 => 8..=40_i64, 1 => 8..=256_i64, 1 => Just(256)];
    let names = (0..5_usize, any::<bool>(), any::<bool>());
    let agents = prop_oneof![6 => 1..=20_i64, 3 => 20..=100_i64, 1 => 1..=1024_i64];
    let view = prop_oneof![3 => 1..=4_i64, 1 => 1..=60_i64, 1 => 1..=256_i64];
    let memory = prop_oneof![3 => 0..=6_i64, 1 => 0..=50_i64];
    let noise = prop_oneof![Just(0.0), Just(0.2), Just(1.0), 0.0..=1.0];
    let delay = prop_oneof![Just(0), 0..=4_i64, 0..=100_i64];
    let seed = prop_oneof![0..1000_i64, 0..1_i64 << 53];
    let rounds = 1..=40_i64;
    (names, size(), size(), agents, view, memory, noise, delay, seed, rounds).prop_map(
        |(
            (task, reference, centralized),
            width,
            height,
            agents,
            view,
            memory,
            noise,
            delay,
            seed,
            rounds,
        )| {
            let height = if reference { width } else { height };
            let task = TaskName::ALL[task];
            // The largest settings are slow to play without optimisation.
            let max_round = if width * height > 1600 || agents > 100 { 3 } else { rounds };
            Settings {
                rules: if reference { "reference" } else { "paper" }.to_owned(),
                control: if centralized { "centralized" } else { "decentralized" }.to_owned(),
                seed,
                num_agents: if task == TaskName::Flocking { agents.min(60) } else { agents },
                width,
                height,
                view_size: (2 * view + 1).min(2 * width.max(height) + 1),
                memory,
                max_round,
                noise,
                max_delay: delay,
                ..Settings::standard(task, 0)
            }
        },
    )
}

/// Makes settings smaller, following the errors, until they can be played.
fn playable(mut settings: Settings) -> Settings {
    while let Err(refused) = Config::check(&settings) {
        for error in refused.0 {
            match error.field {
                "num_agents" => settings.num_agents /= 2,
                "memory" if settings.memory > 0 => settings.memory /= 2,
                "memory" if settings.control == "centralized" => settings.num_agents /= 2,
                "memory" => settings.view_size = settings.view_size / 4 * 2 + 1,
                field => panic!("{field} {}: {settings:?}", error.problem),
            }
        }
    }
    settings
}

/// Plays to the end; returns the digest of every round.
fn play(settings: &Settings, dice: &mut Dice) -> Vec<String> {
    let mut world = world(settings);
    let agents = world.agents().count();
    let mut digests = vec![world.digest().to_string()];
    check_state(&world);
    while !world.is_over() {
        let acts = dice.acts(&world);
        let mut copy = world.clone();
        let before = world.score();
        world.step(&acts);
        if dice.below(4) == 0 {
            copy.step(&acts);
            assert!(copy == world, "a clone goes on differently");
            assert_eq!(copy.digest(), world.digest());
        }
        assert!(world.score() >= before, "the score sinks from {before} to {}", world.score());
        assert_eq!(world.agents().count(), agents);
        check_state(&world);
        let observed = if dice.below(8) == 0 { agents.min(64) } else { 1 };
        (0..observed).for_each(|agent| check_observation(&world, agent));
        digests.push(world.digest().to_string());
    }
    assert!(world.is_done() || i64::from(world.round()) == settings.max_round);
    digests
}

/// Checks that every living agent has its own cell, and every other one is outside.
fn check_state(world: &World) {
    let seen = world.spectator_view();
    let on_map = |at: Pos| {
        let row = usize::try_from(at.i).ok().and_then(|i| seen.grid.get(i));
        row.and_then(|row| row.as_bytes().get(usize::try_from(at.j).ok()?)).copied()
    };
    let mut taken = BTreeSet::new();
    for agent in &seen.agents {
        assert_eq!(agent.alive, world.is_alive(agent.agent));
        if agent.alive {
            assert_eq!(on_map(agent.at), Some(b'A'), "{agent:?}");
            assert!(taken.insert(agent.at), "{agent:?} shares its cell");
        } else {
            assert_eq!(on_map(agent.at), None, "{agent:?}");
        }
    }
    let drawn: usize = seen.grid.iter().map(|row| row.matches('A').count()).sum();
    assert_eq!(drawn, taken.len());
}

fn check_observation(world: &World, agent: usize) {
    let agent = AgentId(u16::try_from(agent).expect("an agent's number"));
    let seen = world.observe(agent);
    assert_eq!(seen.position.is_some(), world.is_alive(agent));
    assert_eq!(seen.view.is_some(), world.is_alive(agent));
    let memory = world.config().memory();
    assert!(seen.history.len() <= memory && seen.past_views.len() <= memory.saturating_sub(1));
    assert!(seen.messages.is_sorted());
    if let Some(view) = seen.view {
        assert_eq!(view.cells.len(), view.height * view.width);
        let own: Vec<_> = view.positions().filter(|(_, seen)| seen.to_string() == "Y").collect();
        assert_eq!(own.len(), 1);
        assert_eq!(Some(own[0].0), seen.position);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(250) })]

    #[test]
    fn all_settings_can_be_played_to_the_end_and_repeated(settings in settings(), seed: u64) {
        let settings = playable(settings);
        let first = play(&settings, &mut Dice(seed));
        prop_assert_eq!(play(&settings, &mut Dice(seed)), first);
    }
}
