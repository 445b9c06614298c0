//! Worth in the shape of the wire.

use std::collections::BTreeMap;

use swarmbench_engine::{Act, AgentId, Scratch, TaskName, World};
use swarmbench_players::default_for;
use swarmbench_protocol::worth::{
    DearDecision, GameWorth, LossSum, MissingPart, RoundLoss, WorthMethod,
};

use crate::words::words;
use crate::{Kind, WORTH_REVISION, Worth};

/// Number of decisions in an answer's list of the dearest ones.
pub const DEAREST: usize = 10;

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

/// The worth of a game as it is sent. Nothing more can be scored in a game that has ended, also where the rules would let it go on.
#[must_use]
pub fn sent(worth: &Worth, has_ended: bool) -> GameWorth {
    let game = &worth.game;
    let task = game.layout.config().task();
    let rounds = u32::try_from(game.rounds.len()).unwrap_or(u32::MAX);
    let could_score = |state: &u32| worth.values[*state as usize] > worth.scores[*state as usize];
    let settled = (0..=rounds).rev().find(could_score).map_or(0, |last| last + 1);
    let score = worth.scores[game.rounds.len()];
    let first = worth.values[0];
    let reached = if has_ended { score } else { worth.values[game.rounds.len()] };
    let by_agent = |losses: &Vec<f64>| {
        let named = losses.iter().zip(game.layout.agents());
        named.map(|(loss, agent)| (agent.to_string(), *loss)).collect()
    };
    let losses = (0..).zip(worth.values.windows(2)).map(|(round, values)| RoundLoss {
        round,
        loss: values[0] - values[1],
        seats: worth.seats.as_ref().map(|seats| by_agent(&seats[round as usize])),
    });
    let mut sent = GameWorth {
        losses: Some(losses.collect()),
        values: Some(worth.values.clone()),
        settled_round: (settled <= rounds).then_some(settled),
        accuracy: (first != 0.0).then(|| reached / first),
        reference_is_weak: Some(first < score),
        missing: Vec::new(),
        ..without(task, rounds, score, String::new())
    };
    if let Some(seats) = &worth.seats {
        let lost = lost(worth, seats);
        let agents = game.layout.agents().map(|agent| agent.to_string());
        sent.seats = Some(sums(agents, lost.iter().map(|of| (of.1.to_string(), of.3))));
        let kinds = Kind::ALL.map(|kind| kind.name().to_owned()).into_iter();
        sent.kinds = Some(sums(kinds, lost.iter().map(|of| (of.2.name().to_owned(), of.3))));
        sent.dearest = Some(dearest(worth, lost));
    }
    sent
}

/// Round, agent, kind and loss of each decision.
fn lost(worth: &Worth, seats: &[Vec<f64>]) -> Vec<(usize, AgentId, Kind, f64)> {
    let mut lost = Vec::new();
    for (round, (kinds, losses)) in worth.kinds.iter().zip(seats).enumerate() {
        for (agent, (kind, loss)) in worth.game.layout.agents().zip(kinds.iter().zip(losses)) {
            lost.extend(kind.map(|kind| (round, agent, kind, *loss)));
        }
    }
    lost
}

/// Sums of losses by name: all `names`, and those of decisions.
fn sums(
    names: impl Iterator<Item = String>,
    decisions: impl Iterator<Item = (String, f64)>,
) -> BTreeMap<String, LossSum> {
    let mut sums: BTreeMap<_, _> = names.map(|name| (name, LossSum::default())).collect();
    for (name, loss) in decisions {
        let sum = sums.entry(name).or_default();
        sum.decisions += 1;
        sum.lost += loss.max(0.0);
        sum.gained += 0.0_f64.max(-loss);
    }
    let all: f64 = sums.values().map(|sum| sum.lost).sum();
    for sum in sums.values_mut() {
        sum.share = (all > 0.0).then(|| sum.lost / all);
    }
    sums
}

/// The decisions that lost most; of equal ones the earlier.
fn dearest(worth: &Worth, mut lost: Vec<(usize, AgentId, Kind, f64)>) -> Vec<DearDecision> {
    lost.retain(|(.., loss)| *loss > 0.0);
    lost.sort_by(|(.., a), (.., b)| b.total_cmp(a));
    lost.truncate(DEAREST);
    let mut found = vec![None; lost.len()];
    let (mut world, mut scratch) = (World::clone(&worth.game.layout), Scratch::default());
    for (round, decided) in worth.game.rounds.iter().enumerate() {
        let acts: Vec<Act> = decided.iter().map(|decided| decided.act.clone()).collect();
        let before = world.clone();
        world.step_in(&acts, &mut scratch);
        for (place, (_, agent, kind, loss)) in
            lost.iter().enumerate().filter(|(_, dear)| dear.0 == round)
        {
            let did = &acts[agent.index()];
            let reference = &worth.reference_acts[round][agent.index()];
            found[place] = Some(DearDecision {
                round: before.round(),
                agent: agent.to_string(),
                loss: *loss,
                kind: kind.name().to_owned(),
                action: did.action.map(|action| action.name().to_owned()),
                reference_action: reference.action.map(|action| action.name().to_owned()),
                words: words(&before, &world, *agent, (did, *kind), reference),
            });
        }
    }
    found.into_iter().flatten().collect()
}
