//! An agent's knowledge of the others, and its messages about them.

use swarmbench_engine::{AgentId, Message, Observation, Pos, Seen, limits};

use crate::Seat;

/// The first word of every message; numbers follow: the round, the possible exits as bits, the pushes that the block
/// has had, then sightings.
const WORD: &str = "Swarm";

/// Number of rounds for which a sighting counts.
const AGE_MAX: u32 = 6;

/// Maximum number of messages read in a round; a window over the whole map brings a thousand.
const MESSAGES_MAX: usize = 32;

/// The last sighting of every agent.
#[derive(Clone)]
pub(super) struct Swarm {
    height: i64,
    width: i64,
    seen: Vec<Option<Sighting>>,
}

#[derive(Clone, Copy)]
struct Sighting {
    at: Pos,
    round: u32,
}

/// The content of a message besides sightings.
pub(super) struct News {
    pub(super) exits: u8,
    pub(super) pushes: u32,
}

impl Swarm {
    pub(super) fn new(seat: &Seat) -> Self {
        let most = u16::try_from(*limits::AGENTS.end()).unwrap_or(u16::MAX);
        let agents = usize::from(seat.num_agents.min(most));
        let side = |cells: u16| i64::from(cells).clamp(1, *limits::SIZE.end());
        Self { height: side(seat.height), width: side(seat.width), seen: vec![None; agents] }
    }

    /// Records all agents in view, and forgets agents that are no longer where they were seen.
    pub(super) fn look(&mut self, observation: &Observation, here: Pos) {
        let Some(view) = &observation.view else { return };
        let round = observation.round;
        let last = |from: i32, cells: usize| i64::from(from) + i64::try_from(cells).unwrap_or(0);
        let (rows, columns) = (last(view.origin.i, view.height), last(view.origin.j, view.width));
        for seen in &mut self.seen {
            let is_in_view = seen.is_some_and(|Sighting { at, .. }| {
                (i64::from(view.origin.i)..rows).contains(&i64::from(at.i))
                    && (i64::from(view.origin.j)..columns).contains(&i64::from(at.j))
            });
            if is_in_view {
                *seen = None;
            }
        }
        for (row, i) in view.rows().zip(i64::from(view.origin.i)..) {
            for (&seen, j) in row.iter().zip(i64::from(view.origin.j)..) {
                if let Seen::Agent { number, .. } = seen
                    && let (Ok(i), Ok(j)) = (i32::try_from(i), i32::try_from(j))
                {
                    self.note(number.into(), Sighting { at: Pos::new(i, j), round });
                }
            }
        }
        self.note(observation.agent.index(), Sighting { at: here, round });
    }

    fn note(&mut self, agent: usize, sighting: Sighting) {
        if let Some(seen) = self.seen.get_mut(agent)
            && seen.is_none_or(|seen| seen.round < sighting.round)
        {
            *seen = Some(sighting);
        }
    }

    /// Agents whose place is known, in the order of their numbers.
    pub(super) fn known(&self, round: u32) -> impl Iterator<Item = (AgentId, Pos)> + '_ {
        self.seen.iter().zip(0..).filter_map(move |(seen, number)| {
            let seen = (*seen)?;
            (round.saturating_sub(seen.round) <= AGE_MAX).then_some((AgentId(number), seen.at))
        })
    }

    /// Writes this agent's message; the freshest sightings that fit are in it.
    pub(super) fn tell(&self, round: u32, news: &News) -> Option<Message> {
        let mut text = format!("{WORD} {round} {} {}", news.exits, news.pushes);
        let mut fresh: Vec<_> = (self.seen.iter().zip(0_i64..))
            .filter_map(|(seen, number)| {
                Some((round.saturating_sub((*seen)?.round), number, (*seen)?.at))
            })
            .filter(|&(age, ..)| age <= AGE_MAX)
            .collect();
        fresh.sort_unstable_by_key(|&(age, number, _)| (age, number));
        let agents = i64::try_from(self.seen.len()).unwrap_or(1);
        for (age, number, at) in fresh.into_iter().take(Message::CHARS_MAX) {
            let (age, i, j) = (i64::from(age), i64::from(at.i), i64::from(at.j));
            let entry =
                format!(" {}", ((age * agents + number) * self.height + i) * self.width + j);
            if text.len() + entry.len() > Message::CHARS_MAX {
                break;
            }
            text.push_str(&entry);
        }
        Message::new(&text)
    }

    /// Reads the others' messages: records their sightings and returns their news.
    pub(super) fn listen(&mut self, observation: &Observation) -> Vec<News> {
        let mut news = Vec::new();
        for message in observation.messages.iter().take(MESSAGES_MAX) {
            let Some(rest) = message.as_str().strip_prefix(WORD) else { continue };
            let numbers: Result<Vec<i64>, _> = rest.split_whitespace().map(str::parse).collect();
            let Ok([round, exits, pushes, sightings @ ..]) = numbers.as_deref() else { continue };
            let (Ok(round), Ok(exits), Ok(pushes)) =
                (u32::try_from(*round), u8::try_from(*exits), u32::try_from(*pushes))
            else {
                continue;
            };
            if round >= observation.round {
                continue;
            }
            news.push(News { exits, pushes });
            for &code in sightings {
                self.hear(round, code);
            }
        }
        news
    }

    /// Records a sighting of a message that was sent in `round`.
    fn hear(&mut self, round: u32, code: i64) {
        let agents = i64::try_from(self.seen.len()).unwrap_or(1).max(1);
        let part = |value: i64| i32::try_from(value).ok();
        let (rest, j) = (code.div_euclid(self.width), part(code.rem_euclid(self.width)));
        let (rest, i) = (rest.div_euclid(self.height), part(rest.rem_euclid(self.height)));
        let (age, number) = (rest.div_euclid(agents), usize::try_from(rest.rem_euclid(agents)));
        let age = u32::try_from(age).ok().filter(|&age| age <= AGE_MAX);
        if let (Some(i), Some(j), Ok(number), Some(age)) = (i, j, number, age)
            && let Some(round) = round.checked_sub(age)
        {
            self.note(number, Sighting { at: Pos::new(i, j), round });
        }
    }
}
