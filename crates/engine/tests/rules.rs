//! Details of the rules that the recorded games may not cover.

#![expect(clippy::float_cmp, reason = "scores are exact")]

use rand_mt::Mt;
use swarmbench_engine::tasks::flocking;
use swarmbench_engine::{
    Act, Action, AgentId, Message, Pos, Seen, Settings, SpectatorView, TaskName, World,
};
use swarmbench_testkit::worlds::{Dice, world};

fn of(task: TaskName) -> Settings {
    Settings::standard(task, 7)
}

fn agent(number: usize) -> AgentId {
    AgentId(u16::try_from(number).expect("an agent's number"))
}

/// The cells of one symbol.
fn cells(grid: &[String], symbol: char) -> Vec<Pos> {
    let cells = grid
        .iter()
        .zip(0..)
        .flat_map(|(row, i)| row.chars().zip(0..).map(move |(seen, j)| (seen, Pos::new(i, j))));
    cells.filter(|(seen, _)| *seen == symbol).map(|(_, at)| at).collect()
}

// --- Layouts ---

/// An independent generator of layouts, written from the rules.
struct Draws(Mt);

impl Draws {
    /// For seeds below 2³².
    fn new(seed: u32) -> Self {
        Self(Mt::new_with_key([seed]))
    }

    fn randint(&mut self, low: i32, high: i32) -> i32 {
        let n = u32::try_from(high - low + 1).expect("not empty");
        let bits = u32::BITS - n.leading_zeros();
        loop {
            let value = self.0.next_u32() >> (32 - bits);
            if value < n {
                return low + i32::try_from(value).expect("small");
            }
        }
    }
}

/// Shape, top-left row and column, each with whether it counts from the last one, and the side of the ring with the
/// gap, for a map of any size: the table of the rules.
type Variant = (&'static [&'static str], (i32, bool), (i32, bool), char);

const TRANSPORT: [Variant; 8] = [
    (&["BBB..", "BBB..", "BBB..", ".BBBB"], (4, true), (5, true), 'd'),
    (&["..BBB", "..BBB", "..BBB", "BBBB."], (4, true), (0, false), 'd'),
    (&["...B", "...B", "BBBB", "BBBB", "BBB."], (0, false), (4, true), 'r'),
    (&["BBB.", "BBBB", "BBBB", "...B", "...B"], (5, true), (4, true), 'r'),
    (&["B...", "B...", "BBBB", "BBBB", ".BBB"], (0, false), (0, false), 'l'),
    (&[".BBB", "BBBB", "BBBB", "B...", "B..."], (5, true), (0, false), 'l'),
    (&["BBBB.", "..BBB", "..BBB", "..BBB"], (0, false), (0, false), 'u'),
    (&[".BBBB", "BBB..", "BBB..", "BBB.."], (0, false), (5, true), 'u'),
];

#[test]
fn transport_is_laid_out_by_the_table() {
    let mut met = [false; 8];
    for (height, width) in [(10, 10), (8, 8), (9, 17), (20, 8)] {
        for seed in 0..40 {
            let variant = usize::try_from(Draws::new(seed).randint(0, 7)).expect("not negative");
            met[variant] = true;
            let (shape, (up, from_last_row), (left, from_last_column), side) = TRANSPORT[variant];
            let top = if from_last_row { height - up } else { 0 };
            let left = if from_last_column { width - left } else { 0 };
            let (last_row, last_column) = (height - 1, width - 1);
            let is_gap = |i: i32, j: i32| match side {
                'u' | 'd' => {
                    i == (if side == 'd' { last_row } else { 0 })
                        && (if from_last_column { j >= width - 4 } else { j < 4 })
                }
                _ => {
                    j == (if side == 'r' { last_column } else { 0 })
                        && (if from_last_row { i >= height - 4 } else { i < 4 })
                }
            };
            let expected = (0..height).map(|i| {
                let cell = |j: i32| {
                    let row = usize::try_from(i - top).ok().and_then(|i| shape.get(i));
                    let part = usize::try_from(j - left).ok().and_then(|j| row?.as_bytes().get(j));
                    let on_ring = i == 0 || j == 0 || i == last_row || j == last_column;
                    match part {
                        Some(b'B') => 'B',
                        _ if on_ring && !is_gap(i, j) => 'W',
                        _ => '.',
                    }
                };
                (0..width).map(cell).collect::<String>()
            });
            let settings = Settings {
                height: height.into(),
                width: width.into(),
                num_agents: 3,
                ..Settings::standard(TaskName::Transport, seed.into())
            };
            let seen = world(&settings).spectator_view();
            let grid: Vec<_> = seen.grid.iter().map(|row| row.replace('A', ".")).collect();
            assert_eq!(grid, expected.collect::<Vec<_>>(), "variant {variant}, {height} × {width}");
            assert_eq!(seen.block, Some(Pos::new(top, left)));
        }
    }
    assert_eq!(met, [true; 8]);
}

#[test]
fn agents_are_spread_column_first_over_free_cells() {
    for seed in 0..20 {
        let mut draws = Draws::new(seed);
        let lights: Vec<_> = (0..30).map(|_| Some(draws.randint(0, 1) == 1)).collect();
        let mut expected: Vec<Pos> = Vec::new();
        while expected.len() < 30 {
            let j = draws.randint(1, 12);
            let i = draws.randint(1, 7);
            if !expected.contains(&Pos::new(i, j)) {
                expected.push(Pos::new(i, j));
            }
        }
        let settings = Settings {
            num_agents: 30,
            height: 9,
            width: 14,
            ..Settings::standard(TaskName::Synchronization, seed.into())
        };
        let agents = world(&settings).spectator_view().agents;
        assert_eq!(agents.iter().map(|agent| agent.at).collect::<Vec<_>>(), expected);
        assert_eq!(agents.iter().map(|agent| agent.light_on).collect::<Vec<_>>(), lights);
    }
}

#[test]
fn foraging_is_laid_out_on_maps_of_every_size() {
    for (height, width) in [
        (8, 8),
        (9, 9),
        (10, 10),
        (12, 12),
        (13, 13),
        (17, 17),
        (8, 30),
        (30, 8),
        (21, 14),
        (16, 25),
    ] {
        for seed in 0..24 {
            let mut draws = Draws::new(seed);
            let mut food = Pos::new([1, height - 3][usize::from(draws.randint(0, 1) == 1)], 0);
            food.j = [1, width - 3][usize::from(draws.randint(0, 1) == 1)];
            let mut nest = Pos::new(
                if food.i == 1 { height - 3 } else { 1 },
                if food.j == 1 { width - 3 } else { 1 },
            );
            let in_columns = draws.randint(0, 1) == 1;
            let (across, along) = if in_columns { (width, height) } else { (height, width) };
            let lines: Vec<i32> = (4..across - 4).step_by(4).collect();
            match (lines.len() % 2, in_columns) {
                (1, false) => (nest.j, food.j) = (1, 1),
                (1, true) => (nest.i, food.i) = (1, 1),
                _ => {}
            }
            let mut inner = Vec::new();
            for (n, &line) in lines.iter().enumerate() {
                let covered = if n % 2 == 0 {
                    0..along - along.div_euclid(3) - i32::from(along % 3 > 0) + 1
                } else {
                    along / 3..along
                };
                inner.extend(
                    covered.map(|k| if in_columns { Pos::new(k, line) } else { Pos::new(line, k) }),
                );
            }
            let expected: Vec<String> = (0..height)
                .map(|i| {
                    let cell = |j: i32| {
                        let at = Pos::new(i, j);
                        let within = |from: Pos| {
                            (0..2).contains(&(i - from.i)) && (0..2).contains(&(j - from.j))
                        };
                        let on_ring = i == 0 || j == 0 || i == height - 1 || j == width - 1;
                        match () {
                            () if within(nest) => 'N',
                            () if within(food) => 'F',
                            () if on_ring || inner.contains(&at) => 'W',
                            () => '.',
                        }
                    };
                    (0..width).map(cell).collect()
                })
                .collect();
            let settings = Settings {
                height: height.into(),
                width: width.into(),
                num_agents: 2,
                ..Settings::standard(TaskName::Foraging, seed.into())
            };
            let seen = world(&settings).spectator_view();
            let grid: Vec<_> = seen.grid.iter().map(|row| row.replace('A', ".")).collect();
            assert_eq!(grid, expected, "seed {seed}, {height} × {width}");
        }
    }
}

#[test]
fn flocking_has_one_layout_under_the_rules_of_the_public_toolkit() {
    let agents = |rules: &str, seed| {
        let settings =
            Settings { rules: rules.to_owned(), ..Settings::standard(TaskName::Flocking, seed) };
        world(&settings).spectator_view()
    };
    let base = agents("paper", 42);
    for seed in [0, 1, 42, 1 << 40] {
        assert_eq!(agents("reference", seed).agents, base.agents);
        let doubled = base.distance.map(|distance| 2.0 * distance);
        assert_eq!(agents("reference", seed).distance, doubled);
    }
    assert_ne!(agents("paper", 1).agents, base.agents);
}

#[test]
fn the_target_is_the_outline_of_a_square() {
    let drawn = |agents: u16| -> Vec<String> {
        let target = flocking::target(agents);
        let side = 1 + target.iter().map(|at| at.i).max().expect("not empty");
        let symbol = |i, j| if target.contains(&Pos::new(i, j)) { 'x' } else { '.' };
        (0..side).map(|i| (0..side).map(|j| symbol(i, j)).collect()).collect()
    };
    assert_eq!(drawn(1), ["x"]);
    assert_eq!(drawn(3), ["x"]);
    assert_eq!(drawn(4), ["xx", "xx"]);
    assert_eq!(drawn(11), ["xxx", "x.x", "xxx"]);
    assert_eq!(drawn(12), ["xxxx", "x..x", "x..x", "xxxx"]);
    assert_eq!(flocking::target(256).len(), 256);
}

#[test]
fn a_flock_that_is_formed_at_the_start_is_done_at_the_start() {
    for num_agents in 1..=3 {
        let world = world(&Settings { num_agents, ..of(TaskName::Flocking) });
        assert!(world.is_done() && world.is_over());
        assert_eq!((world.round(), world.score()), (0, 0.0));
    }
}

// --- Pursuit ---

/// Agents + walls × 0.9 in rows i − 4 … i + 3 and columns j − 4 … j + 3.
fn danger((agents, walls): &(Vec<Pos>, Vec<Pos>), at: Pos) -> f64 {
    let near =
        |cell: &&Pos| (-4..=3).contains(&(cell.i - at.i)) && (-4..=3).contains(&(cell.j - at.j));
    let count = |cells: &[Pos]| u32::try_from(cells.iter().filter(near).count()).expect("few");
    f64::from(count(agents)) + f64::from(count(walls)) * 0.9
}

/// Random play in crowds, so that preys are caught: every new prey is drawn by the generator of the layout at its
/// current state, and every other one moves by the rules.
#[test]
fn preys_move_and_come_back_by_the_rules() {
    const STEPS: [(i32, i32); 4] = [(0, 1), (0, -1), (1, 0), (-1, 0)];
    let mut caught = 0;
    for (seed, height, width, num_agents) in
        [(1, 8, 8, 24), (2, 8, 8, 20), (3, 8, 9, 24), (4, 9, 8, 22), (5, 8, 8, 25), (6, 12, 10, 30)]
    {
        let (rows, columns) = (height, width);
        let settings = Settings {
            height: height.into(),
            width: width.into(),
            num_agents,
            max_round: 150,
            memory: 0,
            ..Settings::standard(TaskName::Pursuit, u64::from(seed))
        };
        let mut world = world(&settings);
        let mut draws = Draws::new(seed);
        let first = Pos::new(
            draws.randint(rows / 2 + 1, rows - 2),
            draws.randint(columns / 2 + 1, columns - 2),
        );
        assert_eq!(world.spectator_view().prey, Some(first));
        let mut placed = Vec::new();
        while placed.len() < usize::try_from(num_agents).expect("positive") {
            let j = draws.randint(1, (columns / 2).max(5));
            let i = draws.randint(1, (rows / 2).max(5));
            if Pos::new(i, j) != first && !placed.contains(&Pos::new(i, j)) {
                placed.push(Pos::new(i, j));
            }
        }
        let mut dice = Dice(u64::from(seed));
        while !world.is_over() {
            let acts = dice.acts(&world);
            let before: SpectatorView = world.spectator_view();
            world.step(&acts);
            let after = world.spectator_view();
            let prey = before.prey.expect("there is one");
            // The board on which the prey decided: the current one, with the prey where it was.
            let grid: Vec<String> = after.grid.iter().map(|row| row.replace('P', ".")).collect();
            let feared = (cells(&grid, 'A'), cells(&grid, 'W'));
            let symbol = |at: Pos| {
                let (i, j) = (
                    usize::try_from(at.i).expect("inside"),
                    usize::try_from(at.j).expect("inside"),
                );
                grid[i].as_bytes()[j]
            };
            let open = |at: Pos| symbol(at) == b'.' && at != prey;
            let beside = |at: Pos, (i, j): (i32, i32)| Pos::new(at.i + i, at.j + j);
            let expected = if STEPS.iter().all(|&step| !open(beside(prey, step))) {
                caught += 1;
                assert_eq!(after.score, before.score + 1.0);
                let mut best: Option<(f64, Pos)> = None;
                let mut counted = 0;
                while counted < rows * columns {
                    let at = Pos::new(draws.randint(1, rows - 2), draws.randint(1, columns - 2));
                    if symbol(at) == b'.' {
                        counted += 1;
                        let danger = danger(&feared, at);
                        if best.is_none_or(|(least, _)| danger < least) {
                            best = Some((danger, at));
                        }
                    }
                }
                best.map(|(_, at)| at)
            } else {
                assert_eq!(after.score, before.score);
                let mut best: Option<(f64, Pos)> = None;
                for first in STEPS {
                    for second in STEPS {
                        let middle = beside(prey, first);
                        let end = beside(middle, second);
                        if open(middle) && open(end) {
                            let danger = danger(&feared, end);
                            if best.is_none_or(|(least, _)| danger < least) {
                                best = Some((danger, end));
                            }
                        }
                    }
                }
                Some(best.map_or(prey, |(_, end)| end))
            };
            assert_eq!(after.prey, expected, "seed {seed}, round {}", before.round);
        }
    }
    assert!(caught > 20, "only {caught} preys were caught");
}

// --- Messages ---

/// Plays one round in which these agents send these texts, each to a single agent if one is named.
fn say(world: &mut World, texts: &[(usize, &str, Option<usize>)]) {
    let mut acts = vec![Act::default(); world.agents().count()];
    for &(from, text, to) in texts {
        acts[from] = Act { action: None, message: Message::new(text), to: to.map(agent) };
    }
    world.step(&acts);
}

/// The same decisions without messages.
fn silent(acts: Vec<Act>) -> Vec<Act> {
    acts.into_iter().map(|act| Act { message: None, ..act }).collect()
}

fn heard(world: &World, by: usize) -> Vec<String> {
    world.observe(agent(by)).messages.iter().map(ToString::to_string).collect()
}

/// The agents to which a message was delivered.
fn hearers(world: &World) -> Vec<usize> {
    (0..world.agents().count()).filter(|&by| !heard(world, by).is_empty()).collect()
}

/// The agents within `reach` rows and columns of one, itself included.
fn near(world: &World, center: usize, reach: i32) -> Vec<usize> {
    let agents = world.spectator_view().agents;
    let at = agents[center].at;
    (0..agents.len()).filter(|&other| agents[other].at.is_within(reach, at)).collect()
}

#[test]
fn messages_reach_neighbours_one_round_later() {
    let mut world = world(&of(TaskName::Synchronization));
    for round in 0..12 {
        let mut expected = near(&world, round, 2);
        expected.retain(|&other| other != round);
        say(&mut world, &[(round, "hello", Some(0))]);
        assert_eq!(hearers(&world), expected);
        say(&mut world, &[]);
        assert_eq!(hearers(&world), [0; 0]);
    }
}

#[test]
fn messages_are_sorted_by_text_and_repeats_are_kept() {
    let mut world =
        world(&Settings { num_agents: 40, view_size: 21, ..of(TaskName::Synchronization) });
    say(
        &mut world,
        &[(3, "b", None), (1, "é", None), (2, "a", None), (0, "b", None), (9, "B", None)],
    );
    assert_eq!(heard(&world, 30), ["B", "a", "b", "b", "é"]);
    assert_eq!(heard(&world, 3), ["B", "a", "b", "é"]);
}

/// An agent walks away from a crowd while it sends: `paper` takes the agents near its old cell, `reference` those near
/// its new one, and itself.
#[test]
fn the_audience_is_fixed_when_a_message_is_sent_or_when_it_is_delivered() {
    for rules in ["paper", "reference"] {
        for seed in 0..30 {
            let settings = Settings {
                rules: rules.to_owned(),
                num_agents: 8,
                view_size: 3,
                ..Settings::standard(TaskName::Synchronization, seed)
            };
            let mut world = world(&settings);
            let before = near(&world, 0, 1);
            let mut acts = silent(Dice(seed).acts(&world));
            acts[0].message = Message::new("hello");
            world.step(&acts);
            let expected: Vec<_> = match rules {
                "paper" => before.into_iter().filter(|&other| other != 0).collect(),
                _ => near(&world, 0, 1),
            };
            assert_eq!(hearers(&world), expected, "{rules}, seed {seed}");
        }
    }
}

#[test]
fn a_late_message_keeps_its_audience_or_finds_a_new_one() {
    for rules in ["paper", "reference"] {
        let mut late = [0; 7];
        for seed in 0..60 {
            let settings = Settings {
                rules: rules.to_owned(),
                max_delay: 4,
                view_size: 5,
                ..Settings::standard(TaskName::Synchronization, seed)
            };
            let mut world = world(&settings);
            let mut sent_to = near(&world, 5, 2);
            sent_to.retain(|&other| other != 5);
            let mut dice = Dice(seed);
            let mut deliveries = 0;
            for (round, count) in late.iter_mut().enumerate() {
                let mut acts = silent(dice.acts(&world));
                if round == 0 {
                    acts[5].message = Message::new("hello");
                }
                world.step(&acts);
                let hearers = hearers(&world);
                if !hearers.is_empty() {
                    *count += 1;
                    deliveries += 1;
                    let now = near(&world, 5, 2);
                    assert_eq!(hearers, if rules == "paper" { sent_to.clone() } else { now });
                }
            }
            assert_eq!(deliveries, usize::from(rules == "reference" || !sent_to.is_empty()));
        }
        assert!(late[..5].iter().all(|&count| count > 0) && late[5..] == [0, 0], "{late:?}");
    }
}

/// Each copy is corrupted independently, and about half of its characters are replaced.
#[test]
fn noise_replaces_characters_of_single_copies() {
    let settings = Settings {
        num_agents: 60,
        view_size: 21,
        noise: 0.5,
        max_round: 5,
        ..of(TaskName::Synchronization)
    };
    let text = "你".repeat(100);
    let mut world = world(&settings);
    say(&mut world, &[(0, &text, None)]);
    let copies: Vec<String> = (1..60).flat_map(|by| heard(&world, by)).collect();
    assert_eq!(copies.len(), 59);
    let corrupted: Vec<_> = copies.iter().filter(|copy| **copy != text).collect();
    assert!((15..45).contains(&corrupted.len()), "{}", corrupted.len());
    for copy in &corrupted {
        assert_eq!(copy.chars().count(), 100);
        assert!(copy.chars().all(|c| c == '你' || c == ' ' || c.is_ascii_graphic()), "{copy}");
        let kept = copy.chars().filter(|&c| c == '你').count();
        assert!((25..75).contains(&kept), "{copy}");
    }
    assert!(corrupted.windows(2).any(|pair| pair[0] != pair[1]));
}

#[test]
fn under_centralized_control_all_see_the_map_and_talk_through_the_commander() {
    for rules in ["paper", "reference"] {
        let settings = Settings {
            rules: rules.to_owned(),
            control: "centralized".to_owned(),
            view_size: 3,
            ..of(TaskName::Foraging)
        };
        let mut world = world(&settings);
        for by in 0..12 {
            let seen = world.observe(agent(by));
            let view = seen.view.expect("it lives");
            assert_eq!((view.origin, view.height, view.width), (Pos::new(0, 0), 10, 10));
            let own = view.positions().find(|(_, seen)| *seen == Seen::Yourself);
            assert_eq!(own.map(|(at, _)| at), seen.position);
        }
        say(&mut world, &[(0, "to all", None)]);
        assert_eq!(hearers(&world), (1..12).collect::<Vec<_>>());
        say(&mut world, &[(0, "to one", Some(7))]);
        assert_eq!(hearers(&world), [7]);
        say(&mut world, &[(4, "to the commander", Some(7)), (5, "and this", None)]);
        assert_eq!(hearers(&world), [0]);
        assert_eq!(heard(&world, 0), ["and this", "to the commander"]);
    }
}

#[test]
fn only_a_commander_can_name_a_receiver() {
    for (rules, control) in [
        ("paper", "decentralized"),
        ("paper", "centralized"),
        ("reference", "decentralized"),
        ("reference", "centralized"),
    ] {
        let settings = Settings {
            rules: rules.to_owned(),
            control: control.to_owned(),
            max_delay: 3,
            ..of(TaskName::Synchronization)
        };
        let (mut named, mut unnamed) = (world(&settings), world(&settings));
        say(&mut named, &[(4, "hello", Some(9)), (5, "hi", Some(4))]);
        say(&mut unnamed, &[(4, "hello", None), (5, "hi", None)]);
        assert_eq!(hearers(&named), hearers(&unnamed));
        assert_eq!(named.digest(), unnamed.digest(), "{rules}, {control}");
    }
}

/// Random play in Transport with a changing wind: away from the corner in which the block lies and back to it. In the
/// end the block is out, and agents follow.
struct Rush {
    winds: [Action; 4],
    dice: Dice,
}

impl Rush {
    fn new(world: &World, seed: u64) -> Self {
        let block = world.spectator_view().block.expect("a task with a block");
        let (toward_row, away_from_row) =
            if block.i > 0 { (Action::Down, Action::Up) } else { (Action::Up, Action::Down) };
        let (toward_column, away_from_column) =
            if block.j > 0 { (Action::Right, Action::Left) } else { (Action::Left, Action::Right) };
        let winds = [away_from_row, away_from_column, toward_row, toward_column];
        Self { winds, dice: Dice(seed) }
    }

    /// Decisions without messages.
    fn acts(&mut self, world: &World) -> Vec<Act> {
        if world.round().is_multiple_of(24) && self.dice.below(2) == 0 {
            self.winds.swap(0, 1);
            self.winds.swap(2, 3);
        }
        let mut acts = self.dice.acts(world);
        let wind = self.winds[world.round() as usize / 6 % 4];
        for act in &mut acts {
            let follows = self.dice.below(8) > 0;
            *act = Act { action: if follows { Some(wind) } else { act.action }, ..Act::default() };
        }
        acts
    }
}

/// Random play until an agent for which `wanted` holds has escaped while others have not.
fn escape(settings: &Settings, wanted: impl Fn(usize) -> bool) -> (World, usize) {
    for seed in 0..200 {
        let mut world = world(&Settings { seed, ..settings.clone() });
        let mut rush = Rush::new(&world, u64::try_from(seed).expect("not negative"));
        while !world.is_over() {
            let acts = rush.acts(&world);
            world.step(&acts);
            let gone = world.agents().filter(|&one| !world.is_alive(one)).map(AgentId::index);
            if let Some(gone) = gone.into_iter().find(|&one| wanted(one)) {
                return (world, gone);
            }
        }
    }
    panic!("nobody escaped");
}

fn crowd() -> Settings {
    Settings { num_agents: 24, max_round: 300, ..of(TaskName::Transport) }
}

#[test]
fn who_has_escaped_sees_hears_and_does_nothing() {
    for rules in ["paper", "reference"] {
        let settings = Settings { rules: rules.to_owned(), view_size: 21, memory: 50, ..crowd() };
        let (mut world, gone) = escape(&settings, |_| true);
        let lived = world.round();
        let at = world.spectator_view().agents[gone].at;
        for _ in 0..3 {
            let mut acts = vec![Act::default(); 24];
            acts[gone] = Act { message: Message::new("from outside"), ..Act::of(Action::Up) };
            let other = world.agents().find(|&one| world.is_alive(one)).expect("one is left");
            acts[other.index()].message = Message::new("from inside");
            world.step(&acts);
            let seen = world.observe(agent(gone));
            assert_eq!((seen.position, seen.view, seen.messages.len()), (None, None, 0));
            assert!(seen.history.iter().all(|past| past.round < lived));
            assert_eq!(world.spectator_view().agents[gone].at, at);
            let all: Vec<_> = (0..24).flat_map(|by| heard(&world, by)).collect();
            assert!(!all.is_empty() && all.iter().all(|text| text == "from inside"), "{all:?}");
        }
    }
}

/// A last message, sent in the round of the escape, reaches the agents near the old cell or (`reference`) near the cell
/// outside.
#[test]
fn a_last_message_is_delivered() {
    for rules in ["paper", "reference"] {
        let settings = Settings { rules: rules.to_owned(), memory: 0, ..crowd() };
        let mut met = 0;
        for seed in 0..60 {
            let mut world = world(&Settings { seed, ..settings.clone() });
            let mut rush = Rush::new(&world, u64::try_from(seed).expect("not negative"));
            while !world.is_over() {
                let mut acts = rush.acts(&world);
                // A rehearsal finds the agents that escape.
                let mut rehearsal = world.clone();
                rehearsal.step(&acts);
                let leaving =
                    world.agents().find(|&one| world.is_alive(one) && !rehearsal.is_alive(one));
                if let Some(leaving) = leaving {
                    let before = near(&world, leaving.index(), 2);
                    acts[leaving.index()].message = Message::new("farewell");
                    world.step(&acts);
                    let mut expected =
                        if rules == "paper" { before } else { near(&world, leaving.index(), 2) };
                    expected.retain(|&other| world.is_alive(agent(other)));
                    assert_eq!(hearers(&world), expected, "{rules}, seed {seed}");
                    met += usize::from(!expected.is_empty());
                    break;
                }
                world = rehearsal;
            }
        }
        assert!(met > 5, "{rules}: {met}");
    }
}

#[test]
fn a_commander_that_has_escaped_ends_all_messages() {
    for rules in ["paper", "reference"] {
        let settings =
            Settings { rules: rules.to_owned(), control: "centralized".to_owned(), ..crowd() };
        let (mut world, _) = escape(&settings, |one| one == 0);
        say(&mut world, &[(0, "on", None), (1, "anybody?", None), (2, "hello", Some(1))]);
        assert_eq!(hearers(&world), [0; 0]);
    }
}

#[test]
fn what_a_commander_said_before_it_escaped_is_lost_with_it() {
    let settings = Settings { control: "centralized".to_owned(), memory: 0, ..crowd() };
    let mut met = false;
    for seed in 0..10 {
        let mut world = world(&Settings { seed, ..settings.clone() });
        let mut rush = Rush::new(&world, u64::try_from(seed).expect("not negative"));
        while !world.is_over() && world.is_alive(AgentId::COMMANDER) {
            let mut acts = rush.acts(&world);
            acts[0].message = Message::new("follow me");
            world.step(&acts);
            if world.is_alive(AgentId::COMMANDER) {
                assert!(!hearers(&world).is_empty());
            } else {
                assert_eq!(hearers(&world), [0; 0]);
                met = true;
            }
        }
    }
    assert!(met);
}

// --- Memory and marks ---

#[test]
fn an_agent_remembers_as_many_rounds_as_it_was_given() {
    for memory in [0, 1, 2, 5] {
        let mut world = world(&Settings { memory, max_round: 8, ..of(TaskName::Synchronization) });
        let mut dice = Dice(1);
        let (mut acts, mut views) = (Vec::new(), Vec::new());
        while !world.is_over() {
            let seen = world.observe(AgentId(4));
            let most = usize::try_from(memory).expect("not negative");
            let expected: Vec<_> = acts.iter().rev().take(most).cloned().collect();
            let history: Vec<_> =
                seen.history.into_iter().map(|past| (past.round, past.act)).collect();
            assert_eq!(history, expected, "memory {memory}");
            let expected: Vec<_> =
                views.iter().rev().take(most.saturating_sub(1)).cloned().collect();
            let past: Vec<_> =
                seen.past_views.into_iter().map(|past| (past.round, past.view)).collect();
            assert_eq!(past, expected, "memory {memory}");
            views.push((world.round(), seen.view.expect("it lives")));
            let round = dice.acts(&world);
            acts.push((world.round(), round[4].clone()));
            world.step(&round);
        }
    }
}

#[test]
fn a_mark_is_a_light_that_is_on_or_under_reference_off() {
    for (rules, on) in [("paper", true), ("reference", false)] {
        let settings =
            Settings { rules: rules.to_owned(), view_size: 21, ..of(TaskName::Synchronization) };
        let world = world(&settings);
        let lights: Vec<_> =
            world.spectator_view().agents.iter().map(|agent| agent.light_on).collect();
        let view = world.observe(AgentId(3)).view.expect("it lives");
        let mut met = 0;
        for seen in &view.cells {
            if let Seen::Agent { number, marked } = seen {
                assert_eq!(lights[usize::from(*number)], Some(*marked == on));
                met += 1;
            }
        }
        assert_eq!(met, 11);
    }
}

// --- Scores ---

#[test]
fn escaping_early_scores_more() {
    let mut met = 0;
    for seed in 0..30 {
        let mut world = world(&Settings { seed, memory: 0, ..crowd() });
        let mut rush = Rush::new(&world, 1);
        let mut expected = 0.0;
        while !world.is_over() {
            let before: Vec<_> = world.agents().filter(|&one| world.is_alive(one)).collect();
            let left = f64::from(300 - world.round()) / 300.0;
            let acts = rush.acts(&world);
            world.step(&acts);
            for _ in before.into_iter().filter(|&one| !world.is_alive(one)) {
                expected += left;
                met += 1;
            }
            assert_eq!(world.score().to_bits(), expected.to_bits());
        }
    }
    assert!(met > 10, "only {met} escaped");
}

#[test]
fn lights_score_each_time_all_change_to_the_other_state() {
    let mut world = world(&Settings { num_agents: 3, ..of(TaskName::Synchronization) });
    let lights = |world: &World| -> Vec<bool> {
        world.spectator_view().agents.iter().filter_map(|agent| agent.light_on).collect()
    };
    let set = |world: &mut World, on: bool| {
        let switch = |light| if light == on { Act::default() } else { Act::of(Action::Switch) };
        let acts: Vec<_> = lights(world).into_iter().map(switch).collect();
        world.step(&acts);
        world.score()
    };
    assert_eq!(set(&mut world, false), 1.0);
    assert_eq!(set(&mut world, false), 1.0);
    assert_eq!(set(&mut world, true), 2.0);
    let acts = [Act::of(Action::Switch), Act::default(), Act::default()];
    world.step(&acts);
    assert_eq!(set(&mut world, true), 2.0, "all on scored last");
    assert_eq!(set(&mut world, false), 3.0);
}
