//! No game and no observation makes a player panic.

use std::sync::Arc;

use proptest::prelude::*;
use swarmbench_engine::{
    Act, Action, AgentId, Config, Control, Message, Observation, Pos, RuleSet, Seen, Settings,
    TaskName, View,
};
use swarmbench_players::game::LocalGame;
use swarmbench_players::{Seat, all, of_task};

/// Checks the rules for every act.
fn check(task: TaskName, act: &Act) {
    let known = Action::of_task(task);
    assert!(act.action.is_none_or(|action| known.contains(&action)), "{act:?}");
    let length = act.message.as_ref().map_or(0, |message| message.as_str().chars().count());
    assert!(length <= Message::CHARS_MAX, "{act:?}");
}

fn task() -> impl Strategy<Value = TaskName> {
    prop::sample::select(&TaskName::ALL)
}

fn rules() -> impl Strategy<Value = RuleSet> {
    prop::sample::select(&RuleSet::ALL)
}

prop_compose! {
    /// Settings of any kind that can be played, of a moderate size.
    fn settings()(
        (task, rules) in (task(), rules()),
        control in prop::sample::select(&Control::ALL),
        seed in 0..1000_i64,
        num_agents in 1..40_i64,
        // Some players have plans for the standard map only.
        (width, height) in prop_oneof![1 => Just((10, 10)), 3 => (8..20_i64, 8..20_i64)],
        reach in 1..9_i64,
        memory in 0..6_i64,
        noise in prop::sample::select(&[0.0, 0.2, 1.0]),
        max_delay in 0..4_i64,
    ) -> Settings {
        let height = if rules == RuleSet::Reference { width } else { height };
        Settings {
            rules: rules.name().to_owned(),
            control: control.name().to_owned(),
            seed,
            num_agents,
            width,
            height,
            view_size: 2 * reach + 1,
            memory,
            max_round: 25,
            noise,
            max_delay,
            ..Settings::standard(task, 0)
        }
    }
}

fn seen() -> impl Strategy<Value = Seen> {
    prop_oneof![
        8 => Just(Seen::Empty),
        1 => prop::sample::select(&[
            Seen::Outside, Seen::Wall, Seen::Nest, Seen::Food, Seen::Block, Seen::Prey, Seen::Yourself,
        ]),
        1 => (any::<u16>(), any::<bool>()).prop_map(|(number, marked)| Seen::Agent { number, marked }),
    ]
}

/// Coordinates mostly on a small map or just outside, sometimes anywhere.
fn number() -> impl Strategy<Value = i32> {
    prop_oneof![8 => -2..14, 1 => any::<i32>(), 1 => Just(i32::MIN), 1 => Just(i32::MAX)]
}

fn pos() -> impl Strategy<Value = Pos> {
    (number(), number()).prop_map(|(i, j)| Pos::new(i, j))
}

/// The words with which players' messages begin. A player that reads messages adds its own here.
const WORDS: [&str; 9] = [
    "Prey at",
    "Food at",
    "Nest at",
    "Food and nest at",
    "Square around",
    "Swarm",
    "Beat of",
    "Gap at",
    "?",
];

/// Messages of known words with numbers that mean little or are almost numbers, or of noise.
fn message() -> impl Strategy<Value = Message> {
    let part = prop_oneof![
        12 => number().prop_map(|number| number.to_string()),
        2 => (0..100_000_i64).prop_map(|number| number.to_string()),
        1 => any::<i64>().prop_map(|number| number.to_string()),
        1 => prop::sample::select(&["in", "round", "-", "1e9", "99999999999999999999", "٣", "+1"])
            .prop_map(str::to_owned),
    ];
    let parts = prop::collection::vec(part, 0..12).prop_map(|parts| parts.join(" "));
    let plausible = (prop::sample::select(&WORDS), parts).prop_map(|(words, parts)| {
        Message::new(&format!("{words} {parts}")).expect("it has words")
    });
    let noise = "[ -~]{1,120}".prop_filter_map("all spaces", |text| Message::new(&text));
    prop_oneof![9 => plausible, 1 => noise]
}

prop_compose! {
    /// A window whose parts need not fit together.
    fn view()(
        origin in pos(),
        (height, width) in (0..12_usize, 0..12_usize),
        cells in prop::collection::vec(seen(), 0..150),
    ) -> View {
        View { origin, height, width, cells }
    }
}

prop_compose! {
    /// Observations that no world shows.
    fn observation()(
        task in task(),
        round in prop_oneof![0..100_u32, any::<u32>()],
        position in prop::option::weighted(0.9, pos()),
        view in prop::option::weighted(0.9, view()),
        light_on in any::<Option<bool>>(),
        carrying_food in any::<Option<bool>>(),
        messages in prop::collection::vec(message(), 0..6),
    ) -> Observation {
        Observation {
            agent: AgentId(0),
            task,
            round,
            max_round: 100,
            score: f64::NAN,
            position,
            view,
            light_on,
            carrying_food,
            messages,
            history: Vec::new(),
            past_views: Vec::new(),
        }
    }
}

prop_compose! {
    fn seat()(
        agent in any::<u16>(),
        num_agents in prop_oneof![0..20_u16, any::<u16>()],
        width in prop_oneof![9 => 0..14_u16, 1 => any::<u16>()],
        height in prop_oneof![9 => 0..14_u16, 1 => any::<u16>()],
        (task, rules) in (task(), rules()),
        seed in any::<u64>(),
    ) -> Seat {
        Seat { agent: AgentId(agent), num_agents, width, height, task, rules, seed }
    }
}

/// Runs fewer cases than usual, as each plays several games; `PROPTEST_CASES` raises the number. There is no file of
/// failures: a failure prints its case.
fn config() -> ProptestConfig {
    let mut config = ProptestConfig::default();
    config.cases = (config.cases / 16).saturating_mul(3).max(1);
    config.failure_persistence = None;
    config
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn any_game_can_be_played(settings in settings(), seed in any::<u64>()) {
        let config = Config::check(&settings);
        prop_assume!(config.is_ok());
        let config = Arc::new(config.expect("it was checked"));
        let task = config.task();
        for built_in in of_task(task) {
            let mut game = LocalGame::new(Arc::clone(&config), built_in, seed);
            while !game.world().is_over() {
                let acts = game.decide();
                for act in &acts {
                    check(task, act);
                }
                game.step(&acts);
            }
        }
    }

    #[test]
    fn hostile_messages_are_survived(
        settings in settings(),
        seed in any::<u64>(),
        lies in prop::collection::vec(message(), 1..20),
    ) {
        let config = Config::check(&settings);
        prop_assume!(config.is_ok());
        let config = Arc::new(config.expect("it was checked"));
        let task = config.task();
        for built_in in of_task(task) {
            let mut game = LocalGame::new(Arc::clone(&config), built_in, seed);
            let mut lies = lies.iter().cycle();
            while !game.world().is_over() {
                let acts = game.decide_by(|player, observation| {
                    let mut observation = observation.clone();
                    if observation.position.is_some() {
                        observation.messages.extend(lies.by_ref().take(3).cloned());
                        observation.messages.sort_unstable();
                    }
                    player.decide(&observation)
                });
                for act in &acts {
                    check(task, act);
                }
                game.step(&acts);
            }
        }
    }

    #[test]
    fn any_observation_is_survived(
        seat in seat(),
        observations in prop::collection::vec(observation(), 1..8),
    ) {
        for built_in in all() {
            let mut player = built_in.make(&seat);
            for observation in &observations {
                let act = player.decide(observation);
                if observation.position.is_none() {
                    prop_assert_eq!(&act, &Act::default());
                }
                check(TaskName::Synchronization, &act);
            }
        }
    }
}
