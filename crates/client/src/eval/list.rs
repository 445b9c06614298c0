//! Lists in the file of an experiment, where one value may stand for a list.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

/// One value or several.
#[derive(Clone, Debug, PartialEq)]
pub struct List<T>(pub Vec<T>);

impl<T> From<Vec<T>> for List<T> {
    fn from(values: Vec<T>) -> Self {
        Self(values)
    }
}

/// A value of a list. An implementation overrides the functions of the kinds of values that it accepts.
pub trait Item: Sized {
    /// A description of the value, for errors at the list.
    const WHAT: &'static str;

    /// A description of the value inside a list, for errors.
    const EXPECTED: &'static str = Self::WHAT;

    /// Converts an integer.
    ///
    /// # Errors
    /// If the value cannot be used; the same for the three functions below.
    fn integer<E: Error>(value: i128) -> Result<Self, E> {
        let found = format!("integer `{value}`");
        Err(E::invalid_type(Unexpected::Other(&found), &Self::EXPECTED))
    }

    #[expect(missing_docs, clippy::missing_errors_doc, reason = "as from an integer")]
    fn float<E: Error>(value: f64) -> Result<Self, E> {
        Err(E::invalid_type(Unexpected::Float(value), &Self::EXPECTED))
    }

    #[expect(missing_docs, clippy::missing_errors_doc, reason = "as from an integer")]
    fn text<E: Error>(value: &str) -> Result<Self, E> {
        Err(E::invalid_type(Unexpected::Str(value), &Self::EXPECTED))
    }

    #[expect(missing_docs, clippy::missing_errors_doc, reason = "as from an integer")]
    fn table<'de, A: MapAccess<'de>>(_: A) -> Result<Self, A::Error> {
        Err(A::Error::invalid_type(Unexpected::Map, &Self::EXPECTED))
    }
}

impl Item for String {
    const WHAT: &'static str = "a text";
    const EXPECTED: &'static str = "a string";

    fn text<E: Error>(value: &str) -> Result<Self, E> {
        Ok(value.to_owned())
    }
}

impl Item for i64 {
    const WHAT: &'static str = "a whole number";

    fn integer<E: Error>(value: i128) -> Result<Self, E> {
        value.try_into().map_err(|_| E::custom("the number is too large"))
    }
}

impl Item for f64 {
    const WHAT: &'static str = "a number";

    fn integer<E: Error>(value: i128) -> Result<Self, E> {
        #[expect(clippy::cast_precision_loss, reason = "settings are small numbers")]
        Ok(value as Self)
    }

    fn float<E: Error>(value: f64) -> Result<Self, E> {
        Ok(value)
    }
}

impl<'de, T: Item> Deserialize<'de> for List<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Reader::new(false).deserialize(deserializer).map(Self)
    }
}

/// Reads a list, or a single value of one.
struct Reader<T> {
    is_inside: bool,
    item: PhantomData<T>,
}

impl<T> Reader<T> {
    const fn new(is_inside: bool) -> Self {
        Self { is_inside, item: PhantomData }
    }
}

impl<'de, T: Item> DeserializeSeed<'de> for Reader<T> {
    type Value = Vec<T>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Vec<T>, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de, T: Item> Visitor<'de> for Reader<T> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_inside {
            f.write_str(T::EXPECTED)
        } else {
            write!(f, "{}, or a list of such", T::WHAT)
        }
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Vec<T>, E> {
        Ok(vec![T::integer(value.into())?])
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Vec<T>, E> {
        Ok(vec![T::integer(value.into())?])
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Vec<T>, E> {
        Ok(vec![T::float(value)?])
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Vec<T>, E> {
        Ok(vec![T::text(value)?])
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Vec<T>, A::Error> {
        Ok(vec![T::table(map)?])
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Vec<T>, A::Error> {
        if self.is_inside {
            return Err(A::Error::invalid_type(Unexpected::Seq, &self));
        }
        let mut all = Vec::new();
        while let Some(one) = seq.next_element_seed(Self::new(true))? {
            all.extend(one);
        }
        if all.is_empty() {
            return Err(A::Error::custom("must not be empty"));
        }
        Ok(all)
    }
}
