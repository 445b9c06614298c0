//! The maximum cost of a round of a new game, counted at the corners of the settings, where it is highest.
//!
//! The bounds are written here as numbers, as `docs/rules.md` promises them, and are not taken from the limits: a limit
//! that lets more through fails.

use std::sync::{Arc, LazyLock};

use swarmbench_engine::{
    Act, AgentId, Config, Control, Message, Observation, RuleSet, Settings, TaskName, World,
};
use swarmbench_testkit::corners::corners;

/// Cells of the windows of all agents.
const CELLS_MAX: usize = 1 << 20;

/// Cells that an agent sees or remembers: the widest window, and the remembered ones.
const CELLS_OF_ONE_MAX: usize = 513 * 513 + (1 << 16);

/// Cells of the windows that all agents remember.
const CELLS_OF_ALL_MAX: usize = 1 << 22;

/// Deliveries of the messages sent in one round.
const MESSAGES_MAX: usize = 1 << 17;

/// Messages under way.
const UNDER_WAY_MAX: usize = 1 << 22;

/// Texts that are remembered or under way.
const TEXTS_MAX: usize = 1 << 16;

static CORNERS: LazyLock<Vec<Settings>> = LazyLock::new(|| {
    let pairs =
        TaskName::ALL.into_iter().flat_map(|task| Control::ALL.map(|control| (task, control)));
    let all = pairs.flat_map(|(task, control)| corners(task, control));
    all.flat_map(|settings| RuleSet::ALL.map(|rules| by(rules, &settings))).collect()
});

/// The same settings with a rule set: no limit depends on it.
fn by(rules: RuleSet, settings: &Settings) -> Settings {
    let settings = Settings { rules: rules.name().to_owned(), ..settings.clone() };
    Config::admit(&settings).expect("settings of a new game");
    settings
}

fn world(settings: &Settings) -> World {
    World::new(Arc::new(Config::check(settings).expect("settings of a new game")))
}

/// Plays a round in which every agent sends a message.
fn talk(world: &mut World) {
    let message = Message::new(&"x".repeat(Message::CHARS_MAX));
    world.step(&vec![Act { message, ..Act::default() }; world.agents().count()]);
}

fn cells(seen: &Observation) -> usize {
    let past: usize = seen.past_views.iter().map(|past| past.view.cells.len()).sum();
    seen.view.as_ref().map_or(0, |view| view.cells.len()) + past
}

#[test]
fn corners_are_where_something_is_as_large_as_can_be() {
    let all = &*CORNERS;
    let most = |what: fn(&Settings) -> i64| all.iter().map(what).max();
    assert_eq!(most(|settings| settings.num_agents), Some(1024));
    assert_eq!(most(|settings| settings.view_size), Some(513));
    assert_eq!(most(|settings| settings.memory), Some(50));
    assert_eq!(most(|settings| settings.max_delay), Some(100));
    let central = |settings: &Settings| settings.control == "centralized";
    assert!(all.iter().any(|settings| central(settings) && settings.num_agents > 900));
    for task in TaskName::ALL {
        assert!(all.iter().any(|settings| settings.task == task.name() && settings.width == 256));
    }
}

#[test]
fn windows_of_a_round_have_no_more_cells_than_they_may() {
    let (mut most, mut most_of_one) = (0, 0);
    for settings in &*CORNERS {
        let config = Config::check(settings).expect("settings of a new game");
        let is = config.window() * usize::from(config.num_agents());
        assert!(is <= CELLS_MAX, "{is} cells: {settings:?}");
        let remembered = is * config.memory();
        assert!(remembered <= CELLS_OF_ALL_MAX, "{remembered} cells: {settings:?}");
        most = most.max(is);
    }
    for settings in played().filter(|settings| settings.rules == "paper") {
        let world = world(settings);
        let one = cells(&world.observe(AgentId(0)));
        assert_eq!(one, world.config().window());
        assert!(world.observation_cells(AgentId(0)) >= one, "{settings:?}");
        most_of_one = most_of_one.max(one);
    }
    assert!(most > CELLS_MAX * 99 / 100, "{most} cells: no corner comes near");
    assert_eq!(most_of_one, 513 * 513);
}

/// The corners of one task, which is played: messages, views and memory do not depend on the task.
fn played() -> impl Iterator<Item = &'static Settings> {
    CORNERS.iter().filter(|settings| settings.task == TaskName::Synchronization.name())
}

#[test]
fn what_is_said_in_a_round_reaches_no_more_than_it_may() {
    let mut most = [0; 3];
    for settings in played() {
        let mut at_once = world(&Settings { max_delay: 0, ..settings.clone() });
        talk(&mut at_once);
        let said = at_once.heard().count();
        let rounds = usize::try_from(settings.max_delay).expect("a few") + 1;
        let texts = (usize::try_from(settings.memory).expect("a few") + rounds - 1)
            * at_once.agents().count();
        assert!(said <= MESSAGES_MAX, "{said} messages: {settings:?}");
        assert!(said * rounds <= UNDER_WAY_MAX, "{} messages: {settings:?}", said * rounds);
        assert!(texts <= TEXTS_MAX, "{texts} texts: {settings:?}");
        for (most, is) in most.iter_mut().zip([said, said * rounds, texts]) {
            *most = is.max(*most);
        }
    }
    for (most, bound) in most.into_iter().zip([MESSAGES_MAX, UNDER_WAY_MAX, TEXTS_MAX]) {
        assert!(most > bound * 9 / 10, "{most} of {bound}: no corner comes near");
    }
}

#[test]
fn messages_that_are_late_do_not_pile_up() {
    let under_way = |settings: &&Settings| {
        let reached = settings.num_agents.min(settings.view_size.pow(2));
        (settings.max_delay + 1) * settings.num_agents * reached
    };
    let heard = |settings: &&Settings| {
        // All agents hear each other, wherever they are; under these rules the receivers are fixed when a message is
        // sent.
        settings.view_size >= 2 * settings.width - 1 && settings.rules == "paper"
    };
    let near = played().filter(|settings| settings.control == "decentralized").filter(heard);
    let settings = near.max_by_key(under_way).expect("a corner");
    let mut world = world(settings);
    let (mut delivered, mut under_way) = (0, 0);
    while i64::from(world.round()) <= settings.max_delay + 1 && !world.is_over() {
        talk(&mut world);
        delivered += world.heard().count();
        let rounds = usize::try_from(world.round()).expect("a few");
        let agents = world.agents().count();
        under_way = rounds * agents * (agents - 1) - delivered;
        assert!(under_way <= UNDER_WAY_MAX, "{settings:?}");
        assert!(delivered <= rounds * MESSAGES_MAX, "{settings:?}");
    }
    assert!(under_way > UNDER_WAY_MAX / 3, "{settings:?}");
}

#[test]
fn what_one_agent_sees_and_remembers_is_no_more_than_it_may_be() {
    let mut most = 0;
    let remembering = played().filter(|settings| settings.memory > 0 && settings.num_agents <= 64);
    for settings in remembering.filter(|settings| settings.rules == "paper") {
        let mut world = world(settings);
        for _ in 0..settings.memory {
            talk(&mut world);
        }
        let seen = world.observe(AgentId(0));
        assert_eq!(seen.history.len(), usize::try_from(settings.memory).expect("a few"));
        let is = cells(&seen);
        assert!(is <= CELLS_OF_ONE_MAX, "{is} cells: {settings:?}");
        let texts = seen.messages.len() + seen.history.len();
        assert!(world.observation_cells(AgentId(0)) >= is + texts, "{settings:?}");
        most = most.max(is);
    }
    assert!(most > (1 << 16) * 9 / 10, "{most} cells: no corner comes near");
}
