//! JSON of others that the program only stores and forwards: kept as text, as a tree of values takes up to eighty times as much
//! memory.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};
use serde_json::value::RawValue;
use serde_json::{Map, Value, json};

/// JSON object of somebody else in the form of journals: without spaces, the members of every object sorted by name, and only
/// the last of several members with the same name. Clones share the text.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Carried(pub Arc<str>);

impl Carried {
    /// Whether the object has no members.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        &*self.0 == "{}"
    }

    /// Nesting depth of objects and lists, the outer object included.
    #[must_use]
    pub fn depth(&self) -> usize {
        let (mut depth, mut most) = (0_usize, 0);
        scan(self.0.as_bytes(), |byte| {
            match byte {
                b'{' | b'[' => depth += 1,
                b'}' | b']' => depth -= 1,
                _ => {}
            }
            most = most.max(depth);
        });
        most
    }

    /// Text of a member's value.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&str> {
        let mut found = None;
        self.each(|member, value| found = if member == name { Some(value) } else { found });
        found
    }

    /// Calls `see` with the name and the text of the value of every member.
    pub fn each<'a>(&'a self, see: impl FnMut(&str, &'a str)) {
        struct Members<F>(F);
        impl<'de, F: FnMut(&str, &'de str)> Visitor<'de> for Members<F> {
            type Value = ();

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a map")
            }

            fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
                while let Some((name, value)) = map.next_entry::<String, &'de RawValue>()? {
                    (self.0)(&name, value.get());
                }
                Ok(())
            }
        }
        let mut json = serde_json::Deserializer::from_str(&self.0);
        json.deserialize_map(Members(see)).expect("it is the text of an object");
    }

    /// Copy with these numbers as members; they replace members of the same names. `None` leaves a member as it is.
    #[must_use]
    pub fn with(&self, numbers: &[(&str, Option<f64>)]) -> Self {
        let numbers = numbers.iter().filter_map(|(name, number)| Some((name, (*number)?)));
        let numbers = numbers.map(|(name, number)| format!("{}:{}", json!(name), json!(number)));
        let own = self.0[1..self.0.len() - 1].to_owned();
        let members = [own].into_iter().chain(numbers).filter(|member| !member.is_empty());
        let text = format!("{{{}}}", members.collect::<Vec<_>>().join(","));
        serde_json::from_str(&text).expect("it is the text of an object")
    }

    /// Parsed values, for programs that read what they wrote themselves.
    #[must_use]
    pub fn values(&self) -> Map<String, Value> {
        serde_json::from_str(&self.0).unwrap_or_default()
    }
}

impl Default for Carried {
    fn default() -> Self {
        Self("{}".into())
    }
}

impl From<Map<String, Value>> for Carried {
    fn from(values: Map<String, Value>) -> Self {
        Self(Value::Object(values).to_string().into())
    }
}

impl Serialize for Carried {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let raw: &RawValue = serde_json::from_str(&self.0).map_err(serde::ser::Error::custom)?;
        raw.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Carried {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut text = Vec::new();
        deserializer.deserialize_map(Copying(&mut text))?;
        let text = String::from_utf8(text).map_err(Error::custom)?;
        Ok(Self(text.into()))
    }
}

/// Approximate number of values and names in a JSON text: each begins the text, or follows a comma, a colon or a bracket.
#[must_use]
pub fn count_values(json: &[u8]) -> usize {
    let mut count = 1;
    scan(json, |byte| count += usize::from(matches!(byte, b',' | b':' | b'[' | b'{')));
    count
}

/// Calls `see` with every byte of a JSON text outside of strings.
fn scan(json: &[u8], mut see: impl FnMut(u8)) {
    let (mut is_text, mut is_escaped) = (false, false);
    for &byte in json {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = true,
            b'"' => is_text = !is_text,
            _ if is_text => {}
            _ => see(byte),
        }
    }
}

/// Checks that a text is JSON, and returns the object if it is one.
///
/// # Errors
/// The text is not JSON.
pub fn any_json(json: &[u8]) -> Result<Option<Carried>, serde_json::Error> {
    let mut text = Vec::new();
    let mut json = serde_json::Deserializer::from_slice(json);
    Copying(&mut text).deserialize(&mut json)?;
    json.end()?;
    let text = String::from_utf8(text).map_err(Error::custom)?;
    Ok(text.starts_with('{').then(|| Carried(text.into())))
}

/// Appends any value to a text. `serde_json` rejects values that are nested too deep.
struct Copying<'a>(&'a mut Vec<u8>);

impl Copying<'_> {
    fn write<E: Error>(self, value: impl Serialize) -> Result<(), E> {
        serde_json::to_writer(self.0, &value).map_err(E::custom)
    }
}

impl<'de> DeserializeSeed<'de> for Copying<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Copying<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Objects are the only kind that is asked for by name, so this message concerns them alone.
        f.write_str("a map")
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        self.write(())
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<(), E> {
        self.write(value)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<(), E> {
        self.write(value)
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<(), E> {
        self.write(value)
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<(), E> {
        self.write(value)
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<(), E> {
        self.write(value)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        self.0.push(b'[');
        while list.next_element_seed(Copying(self.0))?.is_some() {
            self.0.push(b',');
        }
        self.0.pop_if(|last| *last == b',');
        self.0.push(b']');
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        self.0.push(b'{');
        let (mut members, mut names) = (Vec::new(), String::new());
        while let Some(name) = map.next_key::<String>()? {
            let (named, begins) = (names.len(), self.0.len());
            names.push_str(&name);
            Copying(self.0).write(&name)?;
            self.0.push(b':');
            map.next_value_seed(Copying(self.0))?;
            self.0.push(b',');
            members.push(Member { name: named..names.len(), text: begins..self.0.len() });
        }
        if !members.is_sorted_by(|one, next| names[one.name.clone()] < names[next.name.clone()]) {
            sort(self.0, &mut members, &names);
        }
        self.0.pop_if(|last| *last == b',');
        self.0.push(b'}');
        Ok(())
    }
}

/// Ranges of a member: of its name among all names, and of its text in the output.
struct Member {
    name: Range<usize>,
    text: Range<usize>,
}

/// Sorts the members at the end of a text, and removes those that a later member of the same name replaces.
fn sort(text: &mut Vec<u8>, members: &mut [Member], names: &str) {
    let begins = members.first().map_or(text.len(), |first| first.text.start);
    let written = text.split_off(begins);
    members.sort_by(|one, other| names[one.name.clone()].cmp(&names[other.name.clone()]));
    for same in members.chunk_by(|one, next| names[one.name.clone()] == names[next.name.clone()]) {
        let last = same.last().expect("a chunk is not empty");
        text.extend(&written[last.text.start - begins..last.text.end - begins]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_carried_takes_a_small_multiple_of_its_bytes() {
        for (part, most) in [(r#"{"":0}"#, 4), ("[]", 4), ("0", 4), (r#""\u0001""#, 4)] {
            let list = format!(r#"{{"x":[{}]}}"#, vec![part; 16_000 / part.len()].join(","));
            check(&list, most);
        }
        // Objects take more, as the positions of their members are kept until they are sorted.
        let names = |name: &dyn Fn(usize) -> String| {
            let members: Vec<_> = (0..2000).map(|place| format!("{:?}:0", name(place))).collect();
            format!("{{{}}}", members.join(","))
        };
        for name in
            [&(|_| String::new()) as &dyn Fn(usize) -> String, &|place| (9999 - place).to_string()]
        {
            check(&names(name), 24);
        }
    }

    /// Reads the text with a peak of at most `most` times its bytes, and a result that is no larger than the text.
    fn check(json: &str, most: u64) {
        let mut read = None;
        let counted = allocation_counter::measure(|| {
            read = Some(serde_json::from_str::<Carried>(json).expect("an object"));
        });
        let bytes = json.len() as u64;
        assert!(counted.bytes_max <= most * bytes, "{counted:?} for {bytes} bytes: {json:.40}");
        assert!(
            u64::try_from(counted.bytes_current).is_ok_and(|kept| kept <= bytes + 64),
            "{counted:?} for {bytes} bytes: {json:.40}"
        );
    }

    #[test]
    fn members_are_found_and_numbers_are_put_in() {
        let read = |json: &str| serde_json::from_str::<Carried>(json).expect("an object");
        let meta = read(r#"{"top_p": "x", "b": {"c": [1, "}"]}, "b": [{}]}"#);
        assert_eq!(&*meta.0, r#"{"b":[{}],"top_p":"x"}"#);
        assert_eq!((meta.get("b"), meta.get("c"), meta.depth()), (Some("[{}]"), None, 3));
        let with = meta.with(&[("temperature", None), ("top_p", Some(1.0))]);
        assert_eq!(&*with.0, r#"{"b":[{}],"top_p":1.0}"#);
        assert_eq!(Carried::default().with(&[("top_p", Some(0.5))]), read(r#"{"top_p":0.5}"#));
        assert_eq!(read(r#"{"[": "{\"[["}"#).depth(), 1);
    }
}
