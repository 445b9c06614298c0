//! Text vectors.

use std::fmt::Write as _;
use std::hash::Hasher as _;
use std::sync::Arc;

use quick_cache::sync::Cache;

use crate::characters::{is_digit, is_of_token};

/// The embedder `hash-1`: hashed words and parts of words. It needs no model and gives the same vectors on every
/// machine; `docs/evaluate/metrics.md` defines it.
///
/// Vectors of recent texts are cached.
pub struct Hash1 {
    cache: Cache<Box<str>, Option<Arc<[f64]>>>,
}

impl Hash1 {
    /// The id of the embedder, which is part of every value that depends on it.
    pub const ID: &str = "hash-1";

    /// Entries of a vector.
    pub const DIMENSIONS: usize = 1024;

    /// Cached vectors: 8 MiB.
    const VECTORS_MAX: usize = 1024;

    /// The vector of a text, of Euclidean length 1; `None` if its features cancel each other, which leaves the values
    /// of its round undefined.
    #[must_use]
    pub fn vector(&self, text: &str) -> Option<Arc<[f64]>> {
        if let Some(known) = self.cache.get(text) {
            return known;
        }
        let vector = Features::of(text).vector();
        self.cache.insert(text.into(), vector.clone());
        vector
    }
}

impl Default for Hash1 {
    fn default() -> Self {
        Self { cache: Cache::new(Self::VECTORS_MAX) }
    }
}

/// The features of a text.
struct Features {
    /// Parts of three characters, each packed into one number: the order of the numbers is that of the texts.
    parts: Vec<u64>,
    words: Vec<String>,
    /// The whole text, if it has no words.
    whole: Option<String>,
}

/// Bits of a character.
const CHAR_BITS: u32 = 21;

impl Features {
    fn of(text: &str) -> Self {
        let text = text.to_lowercase();
        let (mut parts, mut words) = (Vec::with_capacity(text.len()), Vec::new());
        let tokens = text.split(|c| !is_of_token(c)).filter(|token| !token.is_empty());
        for token in tokens {
            words.push(masked(token));
            let mut part = 0;
            for (i, c) in [' '].into_iter().chain(token.chars()).chain([' ']).enumerate() {
                part = (part << CHAR_BITS | u64::from(c)) & ((1 << (3 * CHAR_BITS)) - 1);
                if i >= 2 {
                    parts.push(part);
                }
            }
        }
        let whole = words.is_empty().then_some(text);
        parts.sort_unstable();
        words.sort_unstable();
        Self { parts, words, whole }
    }

    /// Adds all features in the order of their texts; `None` if they cancel each other.
    fn vector(&self) -> Option<Arc<[f64]>> {
        let mut vector = vec![0.0; Hash1::DIMENSIONS];
        let mut feature = String::new();
        let mut add = |feature: &str, count: usize| {
            let mut hash = fnv::FnvHasher::default();
            hash.write(feature.as_bytes());
            let hash = hash.finish();
            let sign = if hash >> 63 == 0 { 1.0 } else { -1.0 };
            let index = usize::try_from(hash % Hash1::DIMENSIONS as u64).expect("it is small");
            vector[index] += sign * weight(count);
        };
        for same in self.parts.chunk_by(|a, b| a == b) {
            feature.clear();
            feature.push_str("c:");
            feature.extend([2, 1, 0].map(|place| unpacked(same[0], place)));
            add(&feature, same.len());
        }
        if let Some(whole) = &self.whole {
            add(&format!("r:{whole}"), 1);
        }
        for same in self.words.chunk_by(|a, b| a == b) {
            feature.clear();
            let _ = write!(feature, "w:{}", same[0]);
            add(&feature, same.len());
        }
        let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        (length > 0.0).then(|| vector.iter().map(|x| x / length).collect())
    }
}

/// The weight of a feature that occurs `count` times.
fn weight(count: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "texts are short")]
    let count = count as f64;
    1.0 + count.ln()
}

/// One of the three characters of a packed part, counted from the last.
fn unpacked(part: u64, place: u32) -> char {
    let code = part >> (place * CHAR_BITS) & ((1 << CHAR_BITS) - 1);
    u32::try_from(code).ok().and_then(char::from_u32).expect("it was packed from characters")
}

/// A token with each run of digits replaced by `#`: protocols that differ only in their numbers are alike.
fn masked(token: &str) -> String {
    let mut masked = String::with_capacity(token.len());
    for c in token.chars() {
        if !is_digit(c) {
            masked.push(c);
        } else if !masked.ends_with('#') {
            masked.push('#');
        }
    }
    masked
}
