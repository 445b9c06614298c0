//! Messages between players of the same kind: a few leading words and some numbers in plain text,
//! such as `Prey at 3 4 in round 17`.

use swarmbench_engine::{Message, Observation};

/// The numbers of every message that starts with `words` and holds exactly `N` of them. All other messages, noise
/// included, are ignored.
pub(crate) fn heard<'a, const N: usize>(
    observation: &'a Observation,
    words: &'a str,
) -> impl Iterator<Item = [i32; N]> + 'a {
    observation.messages.iter().filter_map(move |message: &Message| {
        let rest = message.as_str().strip_prefix(words)?;
        let numbers = rest.split_whitespace().filter_map(|part| part.parse().ok());
        numbers.collect::<Vec<i32>>().try_into().ok()
    })
}
