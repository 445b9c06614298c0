//! Messages between `corner-traps` players: all known places, in so few characters that a whole swarm fits into one
//! message.
//!
//! A message is `S`, the round, whether the prey keeps to odd cells (0, 1, or 2 if unknown), the prey, then the agents,
//! freshest news first, and two check signs, as noise may have changed any character. A number is one printable sign
//! from `!` (0) to `~` (93). A place is row, column and how many rounds ago it was seen; an agent is its number and a
//! place.

use swarmbench_engine::{Message, Pos};

/// Number of values of a sign.
const BASE: u32 = 94;

const FIRST: u32 = b'!' as u32;

const HEAD: char = 'S';

/// A position, and the round in which an agent last saw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fix {
    pub(super) at: Pos,
    pub(super) seen: u32,
}

/// The belief of an agent in a round.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct News {
    /// The last known place of each agent, by number.
    pub(super) agents: Vec<Option<Fix>>,
    pub(super) prey: Option<Fix>,
    /// True if the prey that runs free keeps to odd cells (row + column); `None` until an agent has seen it.
    pub(super) is_odd: Option<bool>,
}

/// Writes news of a round as a message; agents that do not fit are left out.
pub(super) fn write(news: &News, round: u32) -> Option<Message> {
    let mut text = String::from(HEAD);
    text.push(sign(round % BASE)?);
    text.push(sign(news.is_odd.map_or(2, u32::from))?);
    let nothing = [sign(BASE - 1)?; 3];
    text.extend(news.prey.and_then(|fix| place(fix, round)).unwrap_or(nothing));
    let mut agents: Vec<(usize, Fix)> =
        news.agents.iter().enumerate().filter_map(|(agent, fix)| Some((agent, (*fix)?))).collect();
    agents.sort_by_key(|(_, fix)| std::cmp::Reverse(fix.seen));
    for (agent, fix) in agents {
        if text.len() + 4 + 2 > Message::CHARS_MAX {
            break;
        }
        let number = u32::try_from(agent).ok().and_then(sign);
        if let (Some(number), Some(place)) = (number, place(fix, round)) {
            text.push(number);
            text.extend(place);
        }
    }
    text.extend(check(&text));
    Message::new(&text)
}

/// Reads a message of the round `now` or before; `None` if it is not a valid one.
pub(super) fn read(message: &str, now: u32, agents: usize) -> Option<(u32, News)> {
    if !message.is_ascii() || message.len() < 8 {
        return None;
    }
    let (text, end) = message.split_at(message.len() - 2);
    if !end.chars().eq(check(text)) || !text.starts_with(HEAD) {
        return None;
    }
    let values: Option<Vec<u32>> = text.chars().skip(1).map(value).collect();
    let (values, modulus) = (values?, BASE);
    let age = (now % modulus + modulus - values.first()?) % modulus;
    let round = now.checked_sub(age)?;
    let fix = |place: &[u32]| {
        let &[i, j, ago] = place else { return None };
        let at = Pos::new(i32::try_from(i).ok()?, i32::try_from(j).ok()?);
        Some(Fix { at, seen: round.checked_sub(ago)? })
    };
    let mut news = News { agents: vec![None; agents], ..News::default() };
    news.is_odd = match values.get(1)? {
        0 => Some(false),
        1 => Some(true),
        _ => None,
    };
    let prey = values.get(2..5)?;
    news.prey = if prey[2] == BASE - 1 { None } else { fix(prey) };
    for agent in values.get(5..)?.chunks_exact(4) {
        if let Some(known) = news.agents.get_mut(usize::try_from(agent[0]).ok()?) {
            *known = fix(&agent[1..]);
        }
    }
    Some((round, news))
}

/// A place in signs; `None` if it is too far away or too long ago.
fn place(fix: Fix, round: u32) -> Option<[char; 3]> {
    let number = |side: i32| u32::try_from(side).ok().and_then(sign);
    Some([number(fix.at.i)?, number(fix.at.j)?, age(fix.seen, round)?])
}

/// The number of rounds since `then` as a sign; `None` if it is too large.
fn age(then: u32, round: u32) -> Option<char> {
    round.checked_sub(then).filter(|&ago| ago < BASE - 1).and_then(sign)
}

fn sign(value: u32) -> Option<char> {
    if value < BASE { char::from_u32(FIRST + value) } else { None }
}

fn value(sign: char) -> Option<u32> {
    u32::from(sign).checked_sub(FIRST).filter(|&value| value < BASE)
}

/// Two check signs, which depend on every other sign and its place.
fn check(text: &str) -> [char; 2] {
    let sum = |weight: u32| {
        let sum = text.bytes().fold(0, |sum, byte| (sum * weight + u32::from(byte)) % BASE);
        sign(sum).unwrap_or(HEAD)
    };
    [sum(3), sum(5)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn news_of_a_whole_swarm_are_read_as_they_were_written() {
        let fix = |i, j, seen| Some(Fix { at: Pos::new(i, j), seen });
        let mut news =
            News { agents: vec![fix(3, 4, 120); 12], prey: fix(8, 1, 119), is_odd: Some(true) };
        news.agents[5] = None;
        let message = write(&news, 121).unwrap();
        assert_eq!(read(message.as_str(), 123, 12), Some((121, news)));
    }

    #[test]
    fn no_changed_sign_gets_through() {
        let news =
            News { agents: vec![Some(Fix { at: Pos::new(3, 4), seen: 5 })], ..News::default() };
        let message = write(&news, 6).unwrap();
        for place in 0..message.as_str().len() {
            let mut changed = message.as_str().as_bytes().to_vec();
            changed[place] = if changed[place] == b'z' { b'y' } else { b'z' };
            assert_eq!(read(str::from_utf8(&changed).unwrap(), 6, 1), None);
        }
    }

    #[test]
    fn as_many_agents_as_fit_are_told() {
        let news =
            News { agents: vec![Some(Fix { at: Pos::new(9, 9), seen: 7 }); 90], ..News::default() };
        let message = write(&news, 7).unwrap();
        assert!(message.as_str().len() <= Message::CHARS_MAX);
        let (_, received) = read(message.as_str(), 7, 90).unwrap();
        assert_eq!(received.agents.iter().flatten().count(), 28);
    }
}
