//! A bound on the bytes that a template reads of its input.
//!
//! Fuel counts instructions, and one instruction may read the whole observation: compare two windows, look for a word
//! in a table, make a text upper case. So every value that a template reads is counted by its size, and beyond a limit
//! no more values are returned.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use minijinja::value::{Enumerator, Kwargs, Object, ObjectRepr, StringInput, ValueKind};
use minijinja::{Environment, Error, ErrorKind, Value, filters};

/// Bytes that a template may read, repeated reads included, before it fails; an item counts as [`ITEM_BYTES`].
pub(super) const READ_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// Cost of reading an item of a list or a field, in addition to its text.
const ITEM_BYTES: u64 = 64;

/// Cost of a call of the filters `round` and `int`: `round` may write a number with a thousand digits.
const ROUND_BYTES: u64 = 2048;

/// The remaining part of [`READ_BYTES_MAX`].
#[derive(Debug)]
pub(super) struct Work {
    left: AtomicU64,
    is_over: AtomicBool,
}

impl Work {
    pub(super) fn new() -> Arc<Self> {
        Arc::new(Self { left: AtomicU64::new(READ_BYTES_MAX), is_over: AtomicBool::new(false) })
    }

    /// True if the template tried to read more than the limit.
    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    fn read(&self, bytes: u64) -> Result<(), Error> {
        // Only one thread renders, but values have to be `Sync`.
        match self.left.load(Ordering::Relaxed).checked_sub(bytes) {
            Some(left) if !self.is_over() => {
                self.left.store(left, Ordering::Relaxed);
                Ok(())
            }
            _ => {
                self.is_over.store(true, Ordering::Relaxed);
                Err(Error::new(ErrorKind::OutOfFuel, "the template reads too much"))
            }
        }
    }

    fn read_text(&self, value: &Value) -> Result<(), Error> {
        self.read(ITEM_BYTES + value.as_str().map_or(0, str::len) as u64)
    }
}

/// A value whose parts are counted when they are read.
pub(super) fn counted(value: Value, work: &Arc<Work>) -> Value {
    if let Err(error) = work.read_text(&value) {
        return error.into();
    }
    match value.kind() {
        ValueKind::Map | ValueKind::Seq | ValueKind::Iterable => {
            Value::from_object(Counted { inner: value, work: Arc::clone(work) })
        }
        _ => value,
    }
}

#[derive(Debug)]
struct Counted {
    inner: Value,
    work: Arc<Work>,
}

impl Object for Counted {
    fn repr(self: &Arc<Self>) -> ObjectRepr {
        match self.inner.kind() {
            ValueKind::Map => ObjectRepr::Map,
            _ => ObjectRepr::Seq,
        }
    }

    fn get_value(self: &Arc<Self>, key: &Value) -> Option<Value> {
        let value = self.inner.get_item(key).ok().filter(|value| !value.is_undefined())?;
        Some(counted(value, &self.work))
    }

    fn enumerate(self: &Arc<Self>) -> Enumerator {
        match (self.enumerator_len(), self.repr()) {
            (None | Some(0), _) => Enumerator::Empty,
            (Some(items), ObjectRepr::Seq) => Enumerator::Seq(items),
            _ => {
                let keys = self.inner.try_iter();
                keys.map_or(Enumerator::Empty, |keys| Enumerator::Values(keys.collect()))
            }
        }
    }

    fn enumerator_len(self: &Arc<Self>) -> Option<usize> {
        if self.work.is_over() { Some(0) } else { self.inner.len() }
    }
}

/// Counts the reads of filters, which read whole texts and can be chained in one expression.
pub(super) fn count_filters(environment: &mut Environment<'static>, work: &Arc<Work>) {
    let of = Arc::clone;
    let counts = of(work);
    environment.add_filter("upper", move |text: StringInput<'_>| {
        counts.read(ITEM_BYTES + text.as_str().len() as u64).map(|()| filters::upper(text))
    });
    let counts = of(work);
    environment.add_filter("lower", move |text: StringInput<'_>| {
        counts.read(ITEM_BYTES + text.as_str().len() as u64).map(|()| filters::lower(text))
    });
    let counts = of(work);
    environment.add_filter("trim", move |text: StringInput<'_>, chars: Option<Cow<'_, str>>| {
        counts.read(ITEM_BYTES + text.as_str().len() as u64).map(|()| filters::trim(text, chars))
    });
    let counts = of(work);
    environment.add_filter("length", move |value: Value| {
        counts.read_text(&value).and_then(|()| filters::length(&value))
    });
    let counts = of(work);
    environment.add_filter(
        "round",
        move |value: Value, precision: Option<i32>, method: Option<&str>, more: Kwargs| {
            counts.read(ROUND_BYTES).and_then(|()| filters::round(value, precision, method, more))
        },
    );
    let counts = of(work);
    environment
        .add_filter("int", move |number: f64| counts.read(ROUND_BYTES).map(|()| whole(number)));
}

/// A number without its decimal places; the nearest `i64` if it is out of range.
#[expect(clippy::cast_possible_truncation, reason = "it is at the ends of the range then")]
const fn whole(number: f64) -> i64 {
    number.trunc() as i64
}
