//! Batches: their results do not depend on how they are stepped, and errors change nothing.

use std::io::BufReader;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swarmbench_engine::physics::Solver;
use swarmbench_engine::{Act, Action, AgentId, Config, Message, Seed, Settings, TaskName, World};
use swarmbench_journal::replay::verify;
use swarmbench_training::{
    Arrays, Autoreset, Batch, BatchError, Mask, Observations, Options, Rewards, Said, Turn,
};

const ENVIRONMENTS: usize = 70;

fn settings(task: TaskName) -> Settings {
    Settings { memory: 0, max_round: 12, ..Settings::standard(task, 0) }
}

fn options() -> Options {
    Options { environments: ENVIRONMENTS, seed: 5, ..Options::default() }
}

/// Actions of all agents at random; one in eight does nothing.
fn turn(batch: &Batch, random: &mut ChaCha8Rng) -> Vec<u8> {
    let shape = batch.shape();
    let mut draw = |count: usize| random.next_u32() as usize % count;
    let mut code = || match draw(8) {
        0 => u8::MAX,
        _ => u8::try_from(draw(shape.actions)).expect("few actions"),
    };
    (0..shape.environments * shape.agents).map(|_| code()).collect()
}

fn play(batch: &mut Batch, rounds: usize, mut see: impl FnMut(&Arrays, &[u8])) {
    let mut arrays = Arrays::new(&batch.shape());
    batch.reset(&[], None, arrays.frame()).expect("a reset");
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..rounds {
        let actions = turn(batch, &mut random);
        let (frame, gains) = arrays.parts();
        batch
            .step(Turn { actions: &actions, messages: Vec::new() }, frame, gains, None)
            .expect("a step");
        see(&arrays, &actions);
    }
}

#[test]
fn threads_change_nothing() {
    for task in TaskName::ALL {
        for rewards in [Rewards::Team, Rewards::Individual] {
            let written = |threads: usize| {
                let options = Options { threads, rewards, ..options() };
                let mut batch = Batch::new(&settings(task), options).expect("a batch");
                let mut all = Vec::new();
                play(&mut batch, 30, |arrays, _| all.push(arrays.clone()));
                all
            };
            let alone = written(1);
            assert!(alone.iter().any(|arrays| arrays.terminated.contains(&true)));
            for threads in [2, 3, 7] {
                assert_eq!(written(threads), alone, "{task:?}, {threads} threads");
            }
        }
    }
}

/// The engine itself plays the same acts on the same seeds.
#[test]
fn environments_play_the_game_of_their_seed() {
    for task in TaskName::ALL {
        let options = Options {
            environments: 3,
            seed: 9,
            rewards: Rewards::Individual,
            ..Options::default()
        };
        let mut batch = Batch::new(&settings(task), options).expect("a batch");
        let shape = batch.shape();
        let mut arrays = Arrays::new(&shape);
        let seeds = [27, 3, 1 << 40].map(|seed: u64| Seed::try_from(seed).expect("a seed"));
        batch.reset(&seeds, None, arrays.frame()).expect("a reset");
        let mut worlds = seeds.map(|seed| {
            let settings = Settings { seed: seed.into(), ..settings(task) };
            World::new(std::sync::Arc::new(Config::check(&settings).expect("checked")))
        });
        let mut random = ChaCha8Rng::seed_from_u64(2);
        for _ in 0..12 {
            let actions = turn(&batch, &mut random);
            let (frame, gains) = arrays.parts();
            batch
                .step(Turn { actions: &actions, messages: Vec::new() }, frame, gains, None)
                .expect("a step");
            for (index, (world, codes)) in
                worlds.iter_mut().zip(actions.chunks(shape.agents)).enumerate()
            {
                let action = |code: &u8| Action::of_task(task).get(usize::from(*code)).copied();
                let acts: Vec<Act> = codes
                    .iter()
                    .map(|code| Act { action: action(code), message: None, to: None })
                    .collect();
                let before = world.score();
                world.step(&acts);
                assert_eq!(batch.digest(index).expect("it is there"), world.digest());
                compare(world, &arrays, index, shape.agents, shape.cells());
                let gained = world.score() - before;
                assert!((f64::from(arrays.team_reward[index]) - gained).abs() < 1e-5);
                let row = &arrays.rewards[index * shape.agents..(index + 1) * shape.agents];
                if matches!(task, TaskName::Foraging | TaskName::Transport | TaskName::Pursuit) {
                    let sum: f64 = row.iter().map(|&reward| f64::from(reward)).sum();
                    assert!((sum - gained).abs() < 1e-5, "{task:?}: {row:?} of {gained}");
                }
            }
        }
    }
}

fn compare(world: &World, arrays: &Arrays, index: usize, agents: usize, cells: usize) {
    for agent in world.agents() {
        let seat = index * agents + agent.index();
        let seen = world.observe(agent);
        let position = seen.position.map_or([-1, -1], |at| [at.i, at.j]);
        assert_eq!(arrays.position[seat * 2..seat * 2 + 2], position);
        let planes = &arrays.view[seat * cells * 10..(seat + 1) * cells * 10];
        for cell in 0..cells {
            let code = seen.view.as_ref().map_or(1, |view| view.cells[cell].code());
            for channel in 0..10_u8 {
                let plane = planes[usize::from(channel) * cells + cell];
                assert_eq!(plane, u8::from(code == channel));
            }
        }
        let flag = seen.light_on.or(seen.carrying_food);
        assert_eq!(arrays.flag.get(seat).copied(), flag.map(u8::from));
        assert_eq!(arrays.alive[seat], seen.position.is_some() && !world.is_over());
    }
}

#[test]
fn episodes_follow_each_other_as_asked() {
    let task = TaskName::Synchronization;
    let same = Options { autoreset: Autoreset::SameStep, ..options() };
    let mut batch = Batch::new(&settings(task), same).expect("a batch");
    let mut arrays = Arrays::new(&batch.shape());
    let mut last = Arrays::new(&batch.shape());
    batch.reset(&[], None, arrays.frame()).expect("a reset");
    let stay = vec![4; ENVIRONMENTS * 12];
    let first = arrays.seed.clone();
    for round in 1..=12 {
        let (frame, gains) = arrays.parts();
        let turn = Turn { actions: &stay, messages: Vec::new() };
        batch.step(turn, frame, gains, Some(last.frame())).expect("a step");
        assert_eq!(arrays.terminated, vec![round == 12; ENVIRONMENTS]);
    }
    assert_eq!((arrays.round[0], last.round[0]), (0, 12));
    assert_eq!(last.seed, first);
    assert_ne!(arrays.seed, first);

    let mut batch = Batch::new(&settings(task), options()).expect("a batch");
    batch.reset(&[], None, arrays.frame()).expect("a reset");
    assert_eq!(arrays.seed, first, "the seeds follow from the batch's");
    let step = |batch: &mut Batch, arrays: &mut Arrays| {
        let (frame, gains) = arrays.parts();
        batch.step(Turn { actions: &stay, messages: Vec::new() }, frame, gains, None)
    };
    for _ in 0..12 {
        step(&mut batch, &mut arrays).expect("a step");
    }
    assert_eq!((arrays.round[0], arrays.terminated[0]), (12, true));
    assert_eq!(arrays.alive, vec![false; ENVIRONMENTS * 12]);
    step(&mut batch, &mut arrays).expect("a step");
    assert_eq!((arrays.round[0], arrays.terminated[0], arrays.team_reward[0]), (0, false, 0.0));

    let none = Options { autoreset: Autoreset::Disabled, ..options() };
    let mut batch = Batch::new(&settings(task), none).expect("a batch");
    for _ in 0..12 {
        step(&mut batch, &mut arrays).expect("a step");
    }
    let digest = batch.digest(3).expect("it is there");
    assert!(matches!(step(&mut batch, &mut arrays), Err(BatchError::Over(0))));
    assert_eq!(batch.digest(3).expect("it is there"), digest);
    let mut only = vec![true; ENVIRONMENTS];
    only[3] = false;
    batch.reset(&[], Some(&only), arrays.frame()).expect("a reset");
    assert_eq!((arrays.round[2], arrays.round[3]), (0, 12));
    assert!(matches!(step(&mut batch, &mut arrays), Err(BatchError::Over(3))));
}

#[test]
fn forks_states_and_journals_are_the_same_game() {
    for task in TaskName::ALL {
        let mut batch = Batch::new(&settings(task), options()).expect("a batch");
        let shape = batch.shape();
        let mut arrays = Arrays::new(&shape);
        batch.reset(&[], None, arrays.frame()).expect("a reset");
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for round in 0..7 {
            let actions = turn(&batch, &mut random);
            let text = Message::new(&format!("round {round}")).expect("a text");
            let said = Said { environment: 40, agent: AgentId(5), text, to: None };
            let (frame, gains) = arrays.parts();
            batch
                .step(Turn { actions: &actions, messages: vec![said] }, frame, gains, None)
                .expect("a step");
        }
        let state = batch.state(40).expect("a state");
        let digest = batch.digest(40).expect("a digest");
        batch.fork(40, &[0, 69], arrays.frame()).expect("a fork");
        batch.load(1, &state, arrays.frame()).expect("it is loaded");
        for index in [0, 1, 69] {
            assert_eq!(batch.digest(index).expect("a digest"), digest);
        }
        // The same acts lead to the same states, whatever else is played.
        let own = turn(&batch, &mut random)[..12].to_vec();
        for _ in 0..5 {
            let actions = own.repeat(ENVIRONMENTS);
            let (frame, gains) = arrays.parts();
            batch
                .step(Turn { actions: &actions, messages: Vec::new() }, frame, gains, None)
                .expect("a step");
        }
        let digest = batch.digest(40).expect("a digest");
        for index in [0, 1, 69] {
            assert_eq!(batch.digest(index).expect("a digest"), digest);
        }
        let journal = batch.journal(69, "ep_1".to_owned(), jiff::Timestamp::UNIX_EPOCH);
        let journal = journal.expect("acts are recorded");
        let report = verify(BufReader::new(journal.as_bytes()), None, Solver::Both, |_, _| ());
        let report = report.expect("it is consistent");
        assert_eq!(report.rounds, 12);
        assert_eq!(report.end.map(|end| end.status), Some("finished".to_owned()));
    }
}

#[test]
fn what_is_wrong_is_named_and_changes_nothing() {
    let mut batch = Batch::new(&settings(TaskName::Foraging), options()).expect("a batch");
    let mut arrays = Arrays::new(&batch.shape());
    batch.reset(&[], None, arrays.frame()).expect("a reset");
    let before = batch.digest(0).expect("a digest");
    let mut actions = vec![0; ENVIRONMENTS * 12];
    let mut step = |batch: &mut Batch, actions: &[u8], messages: Vec<Said>| {
        let (frame, gains) = arrays.parts();
        batch.step(Turn { actions, messages }, frame, gains, None).expect_err("refused").to_string()
    };
    assert_eq!(
        step(&mut batch, &actions[1..], Vec::new()),
        "actions must have 840 elements, has 839"
    );
    actions[839] = 5;
    let refused = step(&mut batch, &actions, Vec::new());
    assert_eq!(refused, "environment 69, agent 11: actions are 0 to 4, or -1 for none, not 5");
    actions[839] = 0;
    let text = Message::new("hello").expect("a text");
    let said = Said { environment: 70, agent: AgentId(0), text, to: None };
    let refused = step(&mut batch, &actions, vec![said.clone()]);
    assert_eq!(refused, "there is no environment 70: this batch has the environments 0 to 69");
    let refused =
        step(&mut batch, &actions, vec![Said { environment: 0, agent: AgentId(12), ..said }]);
    assert_eq!(refused, "there is no agent 12: these games have the agents 0 to 11");
    let load = |batch: &mut Batch, state: &[u8]| {
        let mut arrays = Arrays::new(&batch.shape());
        batch.load(0, state, arrays.frame()).expect_err("refused").to_string()
    };
    assert!(load(&mut batch, b"nothing").starts_with("these are not the bytes of a state"));
    let other = Settings { num_agents: 5, ..settings(TaskName::Foraging) };
    let other = Batch::new(&other, Options::default()).expect("a batch").state(0).expect("a state");
    let refused = load(&mut batch, &other);
    assert_eq!(refused, "it is of a game with other settings: num_agents is 5 there and 12 here");
    let own = String::from_utf8(batch.state(0).expect("a state")).expect("a text");
    for (from, to, says) in [
        (r#""acts":[]"#, r#""acts":["aaaaaaaaaaaz"]"#, "an action is not one of the task"),
        (r#""acts":[]"#, r#""acts":["aa"]"#, "a round has not one act of each agent"),
        (
            r#""said":[]"#,
            r#""said":[{"round":0,"agent":12,"text":"a"}]"#,
            "a message is not one of the game",
        ),
        (r#""rules_revision":1"#, r#""rules_revision":7"#, "revision 7 of the rules"),
    ] {
        let refused = load(&mut batch, own.replace(from, to).as_bytes());
        assert!(refused.contains(says), "{refused}");
    }
    assert_eq!(batch.digest(0).expect("a digest"), before);
    let none = Options { environments: 0, ..Options::default() };
    let refused = Batch::new(&settings(TaskName::Foraging), none).expect_err("refused").to_string();
    assert_eq!(refused, "num_envs must be from 1 to 1048576, is 0");
}

#[test]
fn the_hint_shows_walls_that_an_agent_sees() {
    let options = Options { mask: Mask::Moves, observations: Observations::Symbols, ..options() };
    let mut batch = Batch::new(&settings(TaskName::Foraging), options).expect("a batch");
    let shape = batch.shape();
    let mut hidden = 0;
    play(&mut batch, 20, |arrays, _| {
        for (seat, mask) in arrays.action_mask.chunks(shape.actions).enumerate() {
            let view = &arrays.view[seat * 25..(seat + 1) * 25];
            let fixed = |cell: usize| [2, 5, 6].contains(&view[cell]);
            let allowed = [7, 17, 11, 13].map(|cell| arrays.alive[seat] && !fixed(cell));
            assert_eq!(mask[..4], allowed);
            assert_eq!(mask[4], arrays.alive[seat]);
            hidden += mask.iter().filter(|allowed| !**allowed).count();
        }
    });
    assert!(hidden > 0);
}
