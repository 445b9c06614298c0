//! Worth in the shape of the wire.

use std::collections::BTreeMap;

use swarmbench_engine::{Act, AgentId, Scratch, TaskName, World};
use swarmbench_players::default_for;
use swarmbench_protocol::worth::{
    DearDecision, GameWorth, KindLoss, MissingPart, RoundLoss, SeatLoss, WorthMethod,
};

use crate::words::words;
use crate::{Game, Kind, WORTH_REVISION, Worth};

/// Number of decisions in an answer's list of the dearest ones.
const DEAREST: usize = 10;

/// Method by which the worth of games of this task is computed.
#[must_use]
pub fn method(task: TaskName) -> WorthMethod {
    let reference = default_for(task).name.to_owned();
    WorthMethod { reference, worth_revision: WORTH_REVISION }
}

/// The answer without any worth, and why.
#[must_use]
pub fn without(task: TaskName, rounds: u32, score: f64, detail: String) -> GameWorth {
    GameWorth {
        task: task.name().to_owned(),
        rounds,
        score,
        method: method(task),
        missing: vec![MissingPart { part: "values".to_owned(), detail }],
        ..GameWorth::default()
    }
}

/// The worth of a game as it is sent.
#[must_use]
pub fn sent(worth: &Worth) -> GameWorth {
    let game = &worth.game;
    let task = game.layout.config().task();
    let rounds = u32::try_from(game.rounds.len()).unwrap_or(u32::MAX);
    let could_score = |state: &u32| worth.values[*state as usize] > worth.scores[*state as usize];
    let settled = (0..=rounds).rev().find(could_score).map_or(0, |last| last + 1);
    let (first, last) = (worth.values[0], worth.values[game.rounds.len()]);
    let score = worth.scores[game.rounds.len()];
    let by_agent = |losses: &Vec<f64>| {
        let named = losses.iter().zip(game.layout.agents());
        named.map(|(loss, agent)| (agent.to_string(), *loss)).collect()
    };
    let losses = worth.losses().into_iter().enumerate().map(|(round, loss)| RoundLoss {
        round: u32::try_from(round).unwrap_or(u32::MAX),
        loss,
        seats: worth.seats.as_ref().map(|seats| by_agent(&seats[round])),
    });
    GameWorth {
        losses: Some(losses.collect()),
        values: Some(worth.values.clone()),
        settled_round: (settled <= rounds).then_some(settled),
        accuracy: (first != 0.0).then(|| last / first),
        reference_is_weak: Some(first < score),
        seats: worth.seats.as_ref().map(|seats| of_seats(game, seats)),
        kinds: worth.seats.as_ref().map(|seats| of_kinds(&worth.kinds, seats)),
        dearest: worth.seats.as_ref().map(|seats| dearest(worth, seats)),
        missing: Vec::new(),
        ..without(task, rounds, score, String::new())
    }
}

fn of_seats(game: &Game, losses: &[Vec<f64>]) -> BTreeMap<String, SeatLoss> {
    let sum = |agent: AgentId, sign: f64| {
        losses.iter().fold(0.0, |sum, round| sum + (sign * round[agent.index()]).max(0.0))
    };
    let all = game.layout.agents().fold(0.0, |all, agent| all + sum(agent, 1.0));
    let seat = |agent: AgentId| {
        let (lost, gained) = (sum(agent, 1.0), sum(agent, -1.0));
        let share = (all > 0.0).then(|| lost / all);
        (agent.to_string(), SeatLoss { lost, gained, share })
    };
    game.layout.agents().map(seat).collect()
}

fn of_kinds(kinds: &[Vec<Option<Kind>>], losses: &[Vec<f64>]) -> BTreeMap<String, KindLoss> {
    let mut sums: BTreeMap<String, KindLoss> =
        Kind::ALL.iter().map(|kind| (kind.name().to_owned(), KindLoss::default())).collect();
    for (kind, loss) in kinds.iter().flatten().zip(losses.iter().flatten()) {
        if let Some(sum) = kind.and_then(|kind| sums.get_mut(kind.name())) {
            sum.decisions += 1;
            sum.lost += loss.max(0.0);
            sum.gained += 0.0_f64.max(-loss);
        }
    }
    sums
}

/// The decisions that lost most; of equal ones the earlier.
fn dearest(worth: &Worth, losses: &[Vec<f64>]) -> Vec<DearDecision> {
    let game = &worth.game;
    let mut all: Vec<(usize, AgentId, f64)> = Vec::new();
    for (round, losses) in losses.iter().enumerate() {
        let lost = game.layout.agents().zip(losses).filter(|(_, loss)| **loss > 0.0);
        all.extend(lost.map(|(agent, loss)| (round, agent, *loss)));
    }
    all.sort_by(|(_, _, a), (_, _, b)| b.total_cmp(a));
    all.truncate(DEAREST);
    let mut found = vec![None; all.len()];
    let (mut world, mut scratch) = (World::clone(&game.layout), Scratch::default());
    for (round, decided) in game.rounds.iter().enumerate() {
        let acts: Vec<Act> = decided.iter().map(|decided| decided.act.clone()).collect();
        let before = world.clone();
        world.step_in(&acts, &mut scratch);
        for (place, (_, agent, loss)) in all.iter().enumerate().filter(|(_, dear)| dear.0 == round)
        {
            let (did, reference) =
                (&acts[agent.index()], &worth.reference_acts[round][agent.index()]);
            let kind = worth.kinds[round][agent.index()].unwrap_or(Kind::Waited);
            found[place] = Some(DearDecision {
                round: u32::try_from(round).unwrap_or(u32::MAX),
                agent: agent.to_string(),
                loss: *loss,
                kind: kind.name().to_owned(),
                action: did.action.map(|action| action.name().to_owned()),
                reference_action: reference.action.map(|action| action.name().to_owned()),
                words: words(&before, &world, *agent, (did, kind), reference),
            });
        }
    }
    found.into_iter().flatten().collect()
}
