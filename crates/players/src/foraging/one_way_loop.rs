//! Foraging in a loop that all agents walk in the same direction.

use swarmbench_engine::{Act, Action, Direction, Message, Observation, Pos, RuleSet, Seen, View};

use super::layout::{Lane, Layout};
use super::traffic::{Roads, Traffic, Walker};
use crate::chance::Chance;
use crate::chart::{push, sight, within};
use crate::talk::heard;
use crate::{Player, Seat};

/// Number of rounds without a move after which an agent assumes that others see things differently.
const PATIENCE_ROUNDS: u32 = 3;

/// Distance in rows and columns within which agents are foreseen: the maximum reach of roads.
const FORESIGHT: i32 = 16;

/// The leading words of all messages.
const NEWS: &str = "Food and nest at";

/// Knows all maps that the rules can lay out, so a few sightings or messages identify the map. Loaded agents keep to
/// one lane and empty ones to another, and every agent foresees where the agents in view go.
#[derive(Clone)]
struct OneWayLoop {
    seat: Seat,
    chance: Chance,
    /// The maps that fit everything seen so far.
    layouts: Vec<Layout>,
    /// The map in the last message of another agent.
    received: Option<Layout>,
    roads: Option<(Layout, Roads)>,
    /// Position in the previous round, and the number of rounds without a move.
    before: Option<Pos>,
    standing: u32,
}

/// Makes the player.
pub(crate) fn make(seat: &Seat) -> Box<dyn Player> {
    Box::new(OneWayLoop {
        seat: seat.clone(),
        chance: Chance::new(seat),
        layouts: Layout::all(seat),
        received: None,
        roads: None,
        before: None,
        standing: 0,
    })
}

impl Player for OneWayLoop {
    fn decide(&mut self, observation: &Observation) -> Act {
        let Some((here, view)) = sight(observation) else { return Act::default() };
        self.layouts.retain(|layout| layout.fits(here, view));
        for [i, j, k, l] in heard(observation, NEWS) {
            let squares = (Pos::new(i, j), Pos::new(k, l));
            let is_received = |layout: &&Layout| (layout.food, layout.nest) == squares;
            self.received = self.layouts.iter().find(is_received).copied().or(self.received);
        }
        let Some((layout, is_sure)) = self.layout(here) else { return Act::default() };
        let step = self.step(&layout, here, view, observation);
        let Pos { i: k, j: l } = layout.nest;
        let news = format!("{NEWS} {} {} {k} {l}", layout.food.i, layout.food.j);
        let message = if is_sure { Message::new(&news) } else { None };
        Act { action: Some(step.map_or(Action::Stay, push)), message, to: None }
    }
}

impl OneWayLoop {
    /// The most likely map and whether it is certain; of several candidates, the one whose food is nearest.
    fn layout(&self, here: Pos) -> Option<(Layout, bool)> {
        let received = self.received.filter(|received| self.layouts.contains(received));
        let apart = |layout: &Layout| layout.apart(here, layout.food, Lane::Both);
        let nearest = || self.layouts.iter().copied().min_by_key(apart);
        let layout = received.or_else(nearest)?;
        Some((layout, received.is_some() || self.layouts.len() == 1))
    }

    fn step(
        &mut self,
        layout: &Layout,
        here: Pos,
        view: &View,
        observation: &Observation,
    ) -> Option<Direction> {
        let fits = |(known, roads): &(Layout, Roads)| known == layout && roads.reach(here);
        let known = self.roads.take().filter(fits);
        let (_, roads) =
            self.roads.insert(known.unwrap_or_else(|| (*layout, Roads::new(layout, here))));
        let at = roads.cell(here)?;
        let loaded = observation.carrying_food == Some(true);
        let carriers = carriers(&self.seat);
        let walker = |number: u16, at, loaded| {
            let idle = u32::from(number) >= carriers;
            Walker { number, at, loaded, idle }
        };
        let mut walkers = vec![walker(self.seat.agent.0, at, loaded)];
        let is_loaded = |marked: bool| marked == (self.seat.rules == RuleSet::Paper);
        for (at, seen) in within(view, here, FORESIGHT) {
            if let Seen::Agent { number, marked } = seen
                && let Some(at) = roads.cell(at)
                && walkers[0].at != at
            {
                walkers.push(walker(number, at, is_loaded(marked)));
            }
        }
        let traffic = Traffic::new(roads, &walkers);
        self.standing = if self.before.replace(here) == Some(here) { self.standing + 1 } else { 0 };
        if self.standing >= PATIENCE_ROUNDS && !walkers[0].idle && self.chance.one_in(2) {
            let is_free =
                |side: &Direction| roads.toward(at, *side).is_some_and(|to| !traffic.is_taken(to));
            return self.chance.order().into_iter().find(is_free);
        }
        let left = observation.max_round.saturating_sub(observation.round);
        let turn = usize::try_from(observation.round).unwrap_or(0);
        traffic.decide(i32::try_from(left).unwrap_or(i32::MAX), turn)
    }
}

/// The number of agents that walk the loop; those with the lowest numbers do. In a crowd the others only make room, as
/// a full loop comes to a standstill.
fn carriers(seat: &Seat) -> u32 {
    let inside = |cells: u16| u32::from(cells.saturating_sub(2));
    let (cells, agents) = (inside(seat.height) * inside(seat.width), u32::from(seat.num_agents));
    // Up to a third of the cells all agents can walk; in a crowd two sevenths deliver most.
    if agents <= cells / 3 { agents } else { cells * 2 / 7 }
}
