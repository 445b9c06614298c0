//! Built-in players at some seats of an environment.

use swarmbench_engine::answer::Fault;
use swarmbench_engine::{Action, AgentId, Control, Message, Settings, TaskName};
use swarmbench_players::{Seat, default_for, of_task};
use swarmbench_training::{Arrays, Batch, BatchError, Options, Said, Turn};

fn batch(settings: &Settings) -> (Batch, Arrays) {
    let batch = Batch::new(settings, Options { seed: 5, ..Options::default() }).expect("a game");
    let arrays = Arrays::new(&batch.shape());
    (batch, arrays)
}

fn begin(batch: &mut Batch, arrays: &mut Arrays, seed: u32) {
    batch.reset(&[seed.into()], None, arrays.frame()).expect("a layout");
}

/// Plays a round in which partners act, and all other agents do nothing.
fn play(batch: &mut Batch, arrays: &mut Arrays, acts: Vec<(AgentId, swarmbench_engine::Act)>) {
    let known = Action::of_task(batch.config().task());
    let mut codes = vec![u8::MAX; batch.shape().agents];
    let mut messages = Vec::new();
    for (agent, act) in acts {
        let place = known.iter().position(|action| Some(*action) == act.action);
        codes[agent.index()] = u8::try_from(place.expect("partners act")).expect("few actions");
        messages.extend(act.message.map(|text| Said { environment: 0, agent, text, to: act.to }));
    }
    let (frame, gains) = arrays.parts();
    batch.step(Turn { actions: &codes, messages }, frame, gains, None).expect("a round");
}

/// The best players alone score about as much as in the tables of the baselines.
#[test]
fn partners_play_well() {
    for (task, least) in [(TaskName::Synchronization, 90.0), (TaskName::Transport, 9.0)] {
        let (mut batch, mut arrays) = batch(&Settings::standard(task, 0));
        begin(&mut batch, &mut arrays, 27);
        let names: Vec<_> = (0..12).map(|agent| (agent, "default".to_owned())).collect();
        let mut partners = batch.partners(0, &names).expect("players");
        for _ in 0..100 {
            if batch.sight(0, 0).expect("an agent").status
                != swarmbench_protocol::status::Status::Running
            {
                break;
            }
            let acts = batch.decide(0, &mut partners).expect("decisions");
            play(&mut batch, &mut arrays, acts);
        }
        let score = batch.sight(0, 0).expect("an agent").score;
        assert!(score >= least, "{task:?} {score}");
    }
}

/// Partners at some seats decide the same as players made for those seats alone.
#[test]
fn some_seats_are_played() {
    let settings = Settings { num_agents: 5, ..Settings::standard(TaskName::Pursuit, 0) };
    let (mut batch, mut arrays) = batch(&settings);
    begin(&mut batch, &mut arrays, 42);
    let names = [(1, "random".to_owned()), (4, "default".to_owned())];
    let mut partners = batch.partners(0, &names).expect("players");
    assert!(format!("{partners:?}").contains("agents: [1, 4]"), "{partners:?}");
    let settings = Settings { seed: 42, ..settings };
    let config = std::sync::Arc::new(swarmbench_engine::Config::check(&settings).expect("a game"));
    let mut world = swarmbench_engine::World::new(config.clone());
    let random = of_task(TaskName::Pursuit).last().expect("random");
    let mut alone = [
        (AgentId(1), random.make(&Seat::hosted(&config, AgentId(1), &[]))),
        (AgentId(4), default_for(TaskName::Pursuit).make(&Seat::hosted(&config, AgentId(4), &[]))),
    ];
    for _ in 0..20 {
        let acts = batch.decide(0, &mut partners).expect("decisions");
        assert_eq!(acts.len(), 2);
        let mut all = vec![swarmbench_engine::Act::default(); 5];
        for ((agent, player), (asked, act)) in alone.iter_mut().zip(&acts) {
            assert_eq!(agent, asked);
            assert_eq!(&player.decide(&world.observe(*agent)), act);
            all[agent.index()] = act.clone();
        }
        world.step(&all);
        play(&mut batch, &mut arrays, acts);
        assert_eq!(batch.digest(0).expect("an environment"), world.digest());
    }
}

#[test]
fn partners_that_cannot_play_are_refused() {
    let (mut batch, mut arrays) = batch(&Settings::standard(TaskName::Foraging, 0));
    begin(&mut batch, &mut arrays, 1);
    let named = |agent, name: &str| vec![(agent, name.to_owned())];
    let refused = batch.partners(0, &named(0, "corner-traps")).expect_err("a player of Pursuit");
    assert!(refused.to_string().contains("plays Foraging, only"), "{refused}");
    assert!(matches!(
        batch.partners(0, &named(12, "default")),
        Err(BatchError::NoAgent { agent: 12, count: 12 })
    ));
    assert!(matches!(batch.partners(1, &[]), Err(BatchError::NoEnvironment { .. })));
    let mut partners = batch.partners(0, &named(0, "default")).expect("a player");
    let acts = batch.decide(0, &mut partners).expect("decisions");
    // A second call in a round fails.
    assert!(matches!(batch.decide(0, &mut partners), Err(BatchError::Partners(_))));
    play(&mut batch, &mut arrays, acts);
    // Players cannot join in the middle of an episode.
    assert!(matches!(batch.partners(0, &named(0, "default")), Err(BatchError::Partners(_))));
    assert_eq!(batch.decide(0, &mut partners).expect("decisions").len(), 1);
    // Players of one episode cannot play the next.
    begin(&mut batch, &mut arrays, 2);
    let mut partners = batch.partners(0, &named(0, "default")).expect("a player");
    begin(&mut batch, &mut arrays, 3);
    assert!(matches!(batch.decide(0, &mut partners), Err(BatchError::Partners(_))));
}

#[test]
fn answers_are_read_by_the_rules_of_the_game() {
    let settings = Settings {
        control: Control::Centralized.name().to_owned(),
        answer_reader: "first-marker".to_owned(),
        ..Settings::standard(TaskName::Foraging, 0)
    };
    let (batch, _) = batch(&settings);
    let answer =
        batch.read_answer(0, "I say Action: UP\nACTION: DOWN\nMSG: go\nTO: 3").expect("an agent");
    assert_eq!(answer.act.action, Some(Action::Up));
    assert_eq!(answer.act.message, Message::new("go"));
    assert_eq!(answer.act.to, Some(AgentId(3)));
    assert_eq!(batch.read_answer(1, "TO: 3\nACTION: UP").expect("an agent").act.to, None);
    assert_eq!(
        batch.read_answer(1, "ACTION: FLY").expect("an agent").fault,
        Some(Fault::UnknownAction)
    );
    assert!(matches!(batch.read_answer(12, ""), Err(BatchError::NoAgent { .. })));
}
