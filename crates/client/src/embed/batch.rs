//! One request for vectors, and what its answer says.
//!
//! Servers differ: some leave `index` out, some sort by it, some answer in base64 unasked, some write a component that is
//! no number as `null`, others as `NaN`, which JSON does not have.

use std::sync::Arc;

use data_encoding::BASE64;
use serde_json::{Map, Value, json};
use swarmbench_protocol::act::Usage;

use crate::llm::Request;
use crate::llm::completion::{self, Refusal};
use crate::llm::stop::Said;

/// A vector as the model gave it.
pub(super) type Vector = Vec<f32>;

/// What is wrong with the vector of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Flaw {
    /// Not as many vectors as texts.
    #[error("{vectors} vectors came for the {texts} texts of its request")]
    Count {
        /// Texts of the request.
        texts: usize,
        /// Vectors of the answer.
        vectors: usize,
    },
    /// The `index` of no vector is that of the text.
    #[error("the vectors of its request have wrong numbers, and none is for it")]
    Missing,
    /// It can be read neither as numbers nor as base64.
    #[error("it is neither a list of numbers nor 32-bit floats in base64")]
    Unreadable,
    /// A component is infinite or no number.
    #[error("a component is not a finite number")]
    NotFinite,
    /// All components are zero, or there are none.
    #[error("it is zero")]
    Zero,
    /// It is of another length than those before.
    #[error("it has {came} dimensions, and others have {expected}")]
    Dimensions {
        /// How long others are.
        expected: usize,
        /// How long this one is.
        came: usize,
    },
}

/// A request for the vectors of some texts.
pub(super) struct Batch<'a> {
    pub(super) texts: Vec<&'a str>,
}

/// The answer to a batch.
pub(super) enum Reply {
    Vectors {
        /// In the order of the texts; or the first flaw, and the position of its text.
        vectors: Result<Vec<Vector>, (usize, Flaw)>,
        usage: Usage,
        /// Tokens, if the endpoint reports them.
        tokens: Option<u64>,
    },
    /// The batch is too large, or a text of it too long.
    Refused { status: u16, said: Said },
}

impl Request for Batch<'_> {
    type Answer = Reply;

    fn subject(&self) -> String {
        format!("vectors of {} texts", self.texts.len())
    }

    fn fields(&self) -> Map<String, Value> {
        Map::from_iter([("input".to_owned(), json!(self.texts))])
    }

    fn parse(&self, body: &[u8]) -> Option<Value> {
        completion::parse(body).or_else(|| {
            let text = String::from_utf8_lossy(body).replace("-Infinity", "null");
            completion::parse(text.replace("Infinity", "null").replace("NaN", "null").as_bytes())
        })
    }

    fn read(&self, body: &Value) -> Option<Reply> {
        let data = body.get("data")?.as_array()?;
        let (usage, tokens) = completion::usage(&body["usage"]);
        Some(Reply::Vectors { vectors: in_order(data, self.texts.len()), usage, tokens })
    }

    /// 413 and 422 are refusals of a batch; others say 400, and llama.cpp 500.
    fn excuse(&self, status: u16, refusal: &Refusal, said: &Said) -> Option<Reply> {
        let is_size = match status {
            400 | 413 | 422 => true,
            500 => refusal.said.contains("too large"),
            _ => false,
        };
        is_size.then(|| Reply::Refused { status, said: said.clone() })
    }

    /// As reported by the endpoint, or else a fourth of the bytes.
    fn tokens(&self, reply: &Reply) -> u64 {
        let Reply::Vectors { tokens, .. } = reply else { return 0 };
        let bytes = || self.texts.iter().map(|text| text.len()).sum::<usize>().div_ceil(4);
        tokens.unwrap_or_else(|| u64::try_from(bytes()).unwrap_or(u64::MAX))
    }
}

/// The vectors in the order of the texts.
fn in_order(data: &[Value], texts: usize) -> Result<Vec<Vector>, (usize, Flaw)> {
    let mut places: Vec<Option<&Value>> = vec![None; texts];
    for (position, item) in data.iter().enumerate() {
        let index = match &item["index"] {
            Value::Null => Some(position),
            index => index.as_u64().and_then(|index| usize::try_from(index).ok()),
        };
        if let Some(place) = index.and_then(|index| places.get_mut(index)) {
            *place = Some(&item["embedding"]);
        }
    }
    let missing = places.iter().position(Option::is_none);
    if data.len() != texts {
        let flaw = Flaw::Count { texts, vectors: data.len() };
        return Err((missing.unwrap_or(0), flaw));
    }
    let read = |(at, place): (usize, Option<&Value>)| {
        place.ok_or(Flaw::Missing).and_then(floats).map_err(|flaw| (at, flaw))
    };
    places.into_iter().enumerate().map(read).collect()
}

fn floats(vector: &Value) -> Result<Vector, Flaw> {
    match vector {
        Value::Array(numbers) => numbers.iter().map(float).collect(),
        Value::String(text) => from_base64(text).ok_or(Flaw::Unreadable),
        _ => Err(Flaw::Unreadable),
    }
}

fn float(number: &Value) -> Result<f32, Flaw> {
    match number {
        Value::Null => Err(Flaw::NotFinite),
        #[expect(clippy::cast_possible_truncation, reason = "models compute with 32 bits or fewer")]
        number => number.as_f64().map(|number| number as f32).ok_or(Flaw::Unreadable),
    }
}

/// Reads 32-bit floats, the lowest byte first, in base64.
pub(super) fn from_base64(text: &str) -> Option<Vector> {
    let bytes = BASE64.decode(text.as_bytes()).ok()?;
    let (floats, rest) = bytes.as_chunks();
    rest.is_empty().then(|| floats.iter().copied().map(f32::from_le_bytes).collect())
}

/// The opposite of [`from_base64`].
pub(super) fn to_base64(vector: &Vector) -> String {
    let bytes: Vec<u8> = vector.iter().flat_map(|component| component.to_le_bytes()).collect();
    BASE64.encode(&bytes)
}

/// The vector of length 1 in the same direction.
pub(super) fn unit(vector: &Vector) -> Result<Arc<[f64]>, Flaw> {
    if !vector.iter().all(|component| component.is_finite()) {
        return Err(Flaw::NotFinite);
    }
    let components = || vector.iter().map(|component| f64::from(*component));
    let norm = components().map(|component| component * component).sum::<f64>().sqrt();
    if norm == 0.0 {
        return Err(Flaw::Zero);
    }
    Ok(components().map(|component| component / norm).collect())
}
