//! Worth in the shape of the wire.

use std::collections::BTreeMap;

use swarmbench_engine::{Act, Action, AgentId, Config, Scratch, TaskName, World};
use swarmbench_players::default_for;
use swarmbench_protocol::worth::{
    DearDecision, GameWorth, KindLoss, LineAgent, LineRound as SentRound, MissingPart,
    ReferenceLine, RoundLoss, SeatLoss, WorthMethod,
};

use crate::line::{LineRound, line};
use crate::words::words;
use crate::{Game, Kind, WORTH_REVISION, Worth};

/// Decisions of players that the worth of one game takes at most, on a server. A game of 16 agents and 100 rounds has fewer, each
/// seat's losses included.
pub const WORTH_DECISIONS_MAX: u64 = 1_500_000;

/// Number of decisions in an answer's list of the dearest ones.
const DEAREST: usize = 10;

/// Decisions of players that the worth of a game of `rounds` resolved rounds may take: rollouts last to the last round that the
/// settings allow.
#[must_use]
pub fn decisions_of(config: &Config, rounds: u32, with_seats: bool) -> u64 {
    let (agents, last) = (u64::from(config.num_agents()), u64::from(config.max_round()));
    let rounds = u64::from(rounds).min(last);
    // The sum of `last - t` for the states t from 0 to `rounds`.
    let rolled = (rounds + 1) * last - rounds * (rounds + 1) / 2;
    rolled.saturating_mul(agents).saturating_mul(if with_seats { agents + 1 } else { 1 })
}

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
        episode: None,
        task: task.name().to_owned(),
        rounds,
        score,
        method: method(task),
        values: None,
        losses: None,
        settled_round: None,
        accuracy: None,
        reference_is_weak: None,
        seats: None,
        kinds: None,
        dearest: None,
        missing: vec![MissingPart { part: "values".to_owned(), detail }],
    }
}

/// The worth of a game as it is sent.
#[must_use]
pub fn sent(game: &Game, worth: &Worth) -> GameWorth {
    let task = game.layout.config().task();
    let rounds = u32::try_from(game.rounds.len()).unwrap_or(u32::MAX);
    let settled = u32::try_from(worth.settled()).ok().filter(|settled| *settled <= rounds);
    let (first, last) = (worth.values[0], worth.values[game.rounds.len()]);
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
        settled_round: settled,
        accuracy: (first != 0.0).then(|| last / first),
        reference_is_weak: Some(first < worth.score),
        seats: worth.seats.as_ref().map(|seats| of_seats(game, seats)),
        kinds: worth.seats.as_ref().map(|seats| of_kinds(&worth.kinds, seats)),
        dearest: worth.seats.as_ref().map(|seats| dearest(game, worth, seats)),
        missing: Vec::new(),
        ..without(task, rounds, worth.score, String::new())
    }
}

fn of_seats(game: &Game, losses: &[Vec<f64>]) -> BTreeMap<String, SeatLoss> {
    let of = |agent: AgentId| losses.iter().map(move |round| round[agent.index()]);
    // A sum of nothing is -0.
    let lost = |agent| 0.0 + of(agent).map(|loss| loss.max(0.0)).sum::<f64>();
    let all: f64 = game.layout.agents().map(lost).sum();
    let seat = |agent: AgentId| {
        let gained = 0.0 + of(agent).map(|loss| 0.0_f64.max(-loss)).sum::<f64>();
        let share = (all > 0.0).then(|| lost(agent) / all);
        (agent.to_string(), SeatLoss { lost: lost(agent), gained, share })
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
fn dearest(game: &Game, worth: &Worth, losses: &[Vec<f64>]) -> Vec<DearDecision> {
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

/// The reference's line as it is sent.
#[must_use]
pub fn sent_line(game: &Game, round: u32, rounds: u32) -> ReferenceLine {
    let task = game.layout.config().task();
    let line = line(game, round as usize, rounds as usize);
    let agent = |(state, act): (swarmbench_engine::AgentState, &Act)| LineAgent {
        agent: state.agent.to_string(),
        action: act.action.map(Action::name).map(ToOwned::to_owned),
        at: [state.at.i, state.at.j],
        alive: state.alive,
    };
    let sent = |LineRound { acts, world }: &LineRound| SentRound {
        round: world.round() - 1,
        score: world.score(),
        agents: world.agent_states().zip(acts).map(agent).collect(),
    };
    let rounds = line.iter().map(sent).collect();
    ReferenceLine { episode: None, round, method: method(task), rounds }
}
