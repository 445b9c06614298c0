//! The similarity of the messages of a round.

use rapidfuzz::distance::levenshtein::{Args, BatchComparator, normalized_similarity};
use sha2::{Digest as _, Sha256};

use super::counts::{Said, real};
use crate::embed::Hash1;
use crate::game::Heard;

/// Distinct texts of a round that are compared with each other; also messages that are checked for echoes, and
/// received texts with which each of these is compared.
const TEXTS_MAX: usize = 64;

/// The edit similarity from which on a message is an echo.
const ECHO_SIMILARITY: f64 = 0.9;

/// Mean cosines of the messages of a round.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Cosines {
    pub(super) distinct: Option<f64>,
    pub(super) all: Option<f64>,
}

impl Cosines {
    /// Averages all unordered pairs: of distinct texts, and of messages.
    pub(super) fn of(said: &Said<'_>, embedder: &Hash1) -> Self {
        match (said.all.len(), said.distinct.len()) {
            (0 | 1, _) => Self::default(),
            (_, 1) => Self { distinct: Some(1.0), all: Some(1.0) },
            _ => Self {
                distinct: mean_cosine(said.distinct.iter().map(|&(text, _)| (text, 1)), embedder),
                all: mean_cosine(said.distinct.iter().copied(), embedder),
            },
        }
    }
}

/// The mean cosine of all pairs of texts, each text counted `times`. For vectors of length 1 it follows from the
/// length of their sum.
fn mean_cosine<'a>(texts: impl Iterator<Item = (&'a str, u32)>, embedder: &Hash1) -> Option<f64> {
    let (mut sum, mut count) = (Vec::new(), 0.0);
    for (text, times) in texts {
        let vector = embedder.vector(text)?;
        sum.resize(vector.len().max(sum.len()), 0.0);
        let times = f64::from(times);
        sum.iter_mut().zip(&*vector).for_each(|(sum, x)| *sum += times * x);
        count += times;
    }
    let square: f64 = sum.iter().map(|x| x * x).sum();
    Some(((square - count) / (count * (count - 1.0))).clamp(-1.0, 1.0))
}

/// A value of texts, and whether some were left out.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Compared {
    pub(super) value: Option<f64>,
    pub(super) sampled: bool,
}

/// The mean edit similarity of all unordered pairs of distinct texts; 1 for one text sent more than once.
pub(super) fn edit_consistency(said: &Said<'_>) -> Compared {
    if said.all.len() < 2 {
        return Compared::default();
    }
    let mut texts: Vec<&str> = said.distinct.iter().map(|&(text, _)| text).collect();
    if texts.len() == 1 {
        return Compared { value: Some(1.0), sampled: false };
    }
    let sampled = sample(&mut texts, |text| text);
    texts.sort_unstable();
    let mut sum = 0.0;
    for (place, text) in texts.iter().enumerate() {
        let comparator = BatchComparator::new(text.chars());
        let later = texts[place + 1..].iter();
        sum += later.map(|other| comparator.normalized_similarity(other.chars())).sum::<f64>();
    }
    let count = texts.len() as u64;
    Compared { value: Some(sum / real(count * (count - 1) / 2)), sampled }
}

/// The mean edit similarity of each agent's message to its previous one. Stores the new messages as the previous
/// ones.
pub(super) fn self_repeat(said: &Said<'_>, previous: &mut [Option<String>]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for &(agent, text) in &said.all {
        if let Some(before) = &previous[agent] {
            sum += normalized_similarity(before.chars(), text.chars());
            count += 1;
        }
        previous[agent] = Some(text.to_owned());
    }
    (count > 0).then(|| sum / real(count))
}

/// The share of messages that resemble one which the sender has just received from another agent. `heard` is sorted
/// by receiver.
pub(super) fn echo(said: &Said<'_>, heard: &[Heard]) -> Compared {
    let mut messages = said.all.clone();
    let mut sampled = sample(&mut messages, |(_, text)| text);
    let mut echoes = 0;
    for &(agent, text) in &messages {
        let begin = heard.partition_point(|heard| heard.receiver.index() < agent);
        let received = heard[begin..].iter().take_while(|heard| heard.receiver.index() == agent);
        let received = received.filter(|heard| !heard.is_own());
        let mut texts: Vec<&str> = received.map(|heard| &*heard.text).collect();
        texts.sort_unstable();
        texts.dedup();
        sampled |= sample(&mut texts, |text| text);
        let comparator = BatchComparator::new(text.chars());
        let args = Args::default().score_cutoff(ECHO_SIMILARITY);
        let is_like = |other: &&str| {
            comparator.normalized_similarity_with_args(other.chars(), &args).is_some()
        };
        echoes += u64::from(texts.iter().any(is_like));
    }
    let count = messages.len() as u64;
    Compared { value: (count > 0).then(|| real(echoes) / real(count)), sampled }
}

/// Keeps the [`TEXTS_MAX`] items whose texts have the smallest hashes; returns whether any were left out.
fn sample<T>(items: &mut Vec<T>, text: impl Fn(&T) -> &str) -> bool {
    if items.len() <= TEXTS_MAX {
        return false;
    }
    items.sort_by_cached_key(|item| Sha256::digest(text(item)));
    items.truncate(TEXTS_MAX);
    true
}
