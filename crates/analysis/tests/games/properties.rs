//! Properties of all games, and comparisons with plain versions of the definitions.

use std::collections::HashSet;

use proptest::prelude::*;
use swarmbench_analysis::game::{Decision, State};
use swarmbench_analysis::{Counts, Definition, Hash1, Metric, Metrics};
use swarmbench_engine::{Act, Action, AgentId, Message, Pos, Settings, TaskName};

use crate::played::Played;

const AGENTS: usize = 12;
const TEXTS: [&str; 8] =
    ["hold (3,4)", "hold (5,4)", "wait?", "über 5²!", "准备", "...", "hold (3,4) now", "I turn"];

prop_compose! {
    fn acts()(choices in prop::collection::vec((0..8_usize, 0..16_usize), AGENTS)) -> Vec<Act> {
        let act = |(action, text): (usize, usize)| Act {
            action: Action::ALL.get(action).copied(),
            message: TEXTS.get(text).and_then(|text| Message::new(text)),
            to: None,
        };
        choices.into_iter().map(act).collect()
    }
}

prop_compose! {
    fn game()(
        task in prop::sample::select(TaskName::ALL.to_vec()),
        rules in prop::sample::select(vec!["paper", "reference"]),
        seed in 0..1000_u64,
        view_size in prop::sample::select(vec![3, 5, 7]),
        max_delay in 0..3_i64,
        noise in prop::sample::select(vec![0.0, 0.3]),
        rounds in prop::collection::vec(acts(), 0..12),
    ) -> Played {
        let rules = rules.to_owned();
        let settings =
            Settings { rules, view_size, max_delay, noise, ..Settings::standard(task, seed) };
        let known = |mut act: Act| {
            act.action = act.action.filter(|action| Action::of_task(task).contains(action));
            act
        };
        let rounds: Vec<Vec<Act>> =
            rounds.into_iter().map(|acts| acts.into_iter().map(known).collect()).collect();
        Played::by_engine(&settings, &rounds)
    }
}

/// The same game with its agents in another order: agent `n` becomes `order[n]`.
fn renumbered(mut game: Played, order: &[usize]) -> Played {
    let number = |agent: AgentId| AgentId(u16::try_from(order[agent.index()]).expect("few agents"));
    let moved = |state: &mut State| state.agents = in_order(&state.agents, order);
    moved(&mut game.layout);
    for round in &mut game.rounds {
        moved(&mut round.after);
        round.decisions = in_order(&round.decisions, order);
        for heard in round.heard.iter_mut().flatten() {
            heard.receiver = number(heard.receiver);
            heard.sender = number(heard.sender);
        }
    }
    game
}

fn in_order<T: Clone>(items: &[T], order: &[usize]) -> Vec<T> {
    let mut moved: Vec<_> = order.iter().copied().zip(items).collect();
    moved.sort_by_key(|(number, _)| *number);
    moved.into_iter().map(|(_, item)| item.clone()).collect()
}

/// The same game on a map whose rows became columns.
fn transposed(mut game: Played) -> Played {
    std::mem::swap(&mut game.setup.height, &mut game.setup.width);
    changed(
        game,
        |at| Pos::new(at.j, at.i),
        |action| match action {
            Action::Up => Action::Left,
            Action::Left => Action::Up,
            Action::Down => Action::Right,
            Action::Right => Action::Down,
            other => other,
        },
    )
}

/// The same game, upside down.
fn mirrored(game: Played) -> Played {
    let last = game.setup.height - 1;
    changed(
        game,
        |at| Pos::new(last - at.i, at.j),
        |action| match action {
            Action::Up => Action::Down,
            Action::Down => Action::Up,
            other => other,
        },
    )
}

fn changed(mut game: Played, to: impl Fn(Pos) -> Pos, turned: impl Fn(Action) -> Action) -> Played {
    let move_all = |state: &mut State| {
        state.agents.iter_mut().for_each(|agent| agent.at = to(agent.at));
        state.block.iter_mut().for_each(|cell| *cell = to(*cell));
    };
    move_all(&mut game.layout);
    for round in &mut game.rounds {
        move_all(&mut round.after);
        round
            .decisions
            .iter_mut()
            .for_each(|decision| decision.action = decision.action.map(&turned));
    }
    game
}

/// Compares all values, and the counts after `counts`, which may merge the directions; sums may differ in their last
/// bits.
fn assert_same(
    a: &Metrics,
    b: &Metrics,
    counts: impl Fn(&Counts) -> Counts,
) -> Result<(), TestCaseError> {
    let plain = |metrics: &Metrics| metrics.counts.iter().map(&counts).collect::<Vec<_>>();
    prop_assert_eq!(plain(a), plain(b));
    for (key, run) in &a.values {
        prop_assert_eq!(run.rounds, b.values[key].rounds, "{:?}", key);
        prop_assert!(
            is_close(run.value, b.values[key].value),
            "{:?} {:?}",
            key,
            (run, b.values[key])
        );
    }
    for (key, series) in &a.series {
        let pairs = series.iter().zip(&b.series[key]);
        prop_assert!(pairs.clone().all(|(a, b)| is_close(*a, *b)), "{:?}", key);
    }
    Ok(())
}

fn is_close(a: Option<f64>, b: Option<f64>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1.0),
        (a, b) => a == b,
    }
}

/// Counts with the moves of all directions merged.
fn undirected(counts: &Counts) -> Counts {
    let moves = counts.moves_up + counts.moves_down + counts.moves_left + counts.moves_right;
    Counts { moves_up: moves, moves_down: 0, moves_left: 0, moves_right: 0, ..*counts }
}

/// The rounds of a game: the state before, the decisions, and the state after.
fn rounds(game: &Played) -> impl Iterator<Item = (&State, &[Decision], &State)> {
    let before = std::iter::once(&game.layout).chain(game.rounds.iter().map(|round| &round.after));
    before.zip(&game.rounds).map(|(before, round)| (before, &*round.decisions, &round.after))
}

/// Components, separation and crowding of a state, computed from all pairs.
fn plain_sight(state: &State, reach: i32) -> (u32, f64, f64) {
    let living: Vec<Pos> = state.agents.iter().filter(|a| a.alive).map(|a| a.at).collect();
    let mut groups: Vec<HashSet<usize>> =
        (0..living.len()).map(|agent| HashSet::from([agent])).collect();
    let (mut separation, mut crowding) = (0.0, 0.0);
    for (a, &at) in living.iter().enumerate() {
        let mut force = (0.0, 0.0);
        for (b, &other) in living.iter().enumerate().filter(|&(b, _)| a != b) {
            if at.is_within(reach, other) {
                let (i, j) = (f64::from(at.i - other.i), f64::from(at.j - other.j));
                let distance = i.hypot(j);
                force = (force.0 + i / distance.powi(2), force.1 + j / distance.powi(2));
                crowding += 1.0 / distance;
                let (with_a, rest): (Vec<_>, Vec<_>) =
                    groups.into_iter().partition(|group| group.contains(&a) || group.contains(&b));
                groups = rest;
                groups.push(with_a.into_iter().flatten().collect());
            }
        }
        separation += f64::hypot(force.0, force.1);
    }
    let count = f64::from(u32::try_from(living.len()).expect("few agents"));
    (u32::try_from(groups.len()).expect("few groups"), separation / count, crowding / count)
}

/// Pairs of agents on the map that are neighbours in both states.
fn plain_kept_pairs(before: &State, after: &State) -> u32 {
    let near = |state: &State, a: usize, b: usize| {
        let (a, b) = (state.agents[a], state.agents[b]);
        a.alive && b.alive && a.at.i.abs_diff(b.at.i) + a.at.j.abs_diff(b.at.j) == 1
    };
    let pairs = (0..AGENTS).flat_map(|a| (a + 1..AGENTS).map(move |b| (a, b)));
    pairs.map(|(a, b)| u32::from(near(before, a, b) && near(after, a, b))).sum()
}

/// The mean of a value of all unordered pairs.
fn mean_of_pairs<T>(items: &[T], value: impl Fn(&T, &T) -> f64) -> Option<f64> {
    let pairs = items
        .iter()
        .enumerate()
        .flat_map(|(a, item)| items[a + 1..].iter().map(move |b| (item, b)));
    let values: Vec<f64> = pairs.map(|(a, b)| value(a, b)).collect();
    let count = f64::from(u32::try_from(values.len()).expect("few pairs"));
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / count)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_order_of_agents_does_not_matter(
        game in game(),
        order in Just((0..AGENTS).collect::<Vec<_>>()).prop_shuffle(),
    ) {
        assert_same(&game.metrics(), &renumbered(game, &order).metrics(), |counts| *counts)?;
    }

    #[test]
    fn turning_and_mirroring_map_and_actions_does_not_matter(game in game()) {
        let metrics = game.metrics();
        assert_same(&metrics, &transposed(game.clone()).metrics(), undirected)?;
        assert_same(&metrics, &mirrored(game.clone()).metrics(), undirected)?;
        assert_same(&metrics, &mirrored(transposed(game)).metrics(), undirected)?;
    }

    #[test]
    fn counts_bound_each_other(game in game()) {
        let metrics = game.metrics();
        for pair in metrics.counts.windows(2) {
            let (before, now) = (&pair[0], &pair[1]);
            let movers = undirected(now).moves_up;
            prop_assert_eq!(now.alive, movers + now.stays + now.switches + now.no_actions);
            prop_assert!(now.pushes_strict <= now.pushes && now.pushes <= movers);
            prop_assert!(now.blocked <= movers && now.kept_pairs <= 2 * now.alive);
            prop_assert!(before.explored <= now.explored);
            prop_assert!(now.distance >= now.explored - before.explored);
            prop_assert!(now.questions <= now.messages && now.distinct_messages <= now.messages);
            prop_assert!((1..=now.alive).contains(&now.components));
        }
    }

    #[test]
    fn neighbours_are_those_that_all_pairs_give(game in game()) {
        let metrics = game.metrics();
        let series = |metric| &metrics.series[&(Definition::Paper, metric)];
        for (round, (before, _, after)) in (1..).zip(rounds(&game)) {
            let counts = metrics.counts[round];
            prop_assert_eq!(counts.kept_pairs, plain_kept_pairs(before, after));
            let (components, separation, crowding) = plain_sight(before, game.setup.view_size / 2);
            prop_assert_eq!(counts.components, components);
            prop_assert!(is_close(series(Metric::Separation)[round], Some(separation)));
            prop_assert!(is_close(series(Metric::Crowding)[round], Some(crowding)));
        }
    }

    #[test]
    fn similarities_are_means_of_pairs(game in game()) {
        let metrics = game.metrics();
        let series = |metric| &metrics.series[&(Definition::Paper, metric)];
        let embedder = Hash1::default();
        let cosine = |a: &&str, b: &&str| {
            let [a, b] = [a, b].map(|text| embedder.vector(text).expect("it has features"));
            a.iter().zip(&*b).map(|(a, b)| a * b).sum()
        };
        for (round, (before, decisions, _)) in (1..).zip(rounds(&game)) {
            let living = decisions.iter().zip(&before.agents).filter(|(_, agent)| agent.alive);
            let said: Vec<&str> = living.filter_map(|(d, _)| d.message.as_deref()).collect();
            let mut distinct = said.clone();
            distinct.sort_unstable();
            distinct.dedup();
            let same = if said.len() > 1 && distinct.len() == 1 { Some(1.0) } else { None };
            let all = mean_of_pairs(&said, cosine);
            prop_assert!(is_close(series(Metric::HomogeneityAll)[round], all));
            let cosines = mean_of_pairs(&distinct, cosine).or(same);
            prop_assert!(is_close(series(Metric::Homogeneity)[round], cosines));
            let edits = mean_of_pairs(&distinct, |a, b| strsim::normalized_levenshtein(a, b)).or(same);
            prop_assert!(is_close(series(Metric::EditConsistency)[round], edits));
        }
    }
}
