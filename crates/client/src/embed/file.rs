//! Vectors in a file: a cache that spares requests, and a recording that replaces the endpoint.
//!
//! A text file of JSON lines. All but the first are vectors: the id of the embedder, the SHA-256 of the text, 32-bit floats in
//! base64, and a check sum of these three. No key, no address and no text is in it. Lines that are damaged are left out when
//! the file is read.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Error;
use super::batch::{Vector, from_base64, to_base64};
use crate::lines::{Hash, Header, Lines, Place, digest, hash};

/// The version of the format.
const VERSION: u32 = 1;

/// Vectors of a file; the memory of its index follows from it, about 100 bytes for each.
pub const VECTORS_MAX: usize = 1 << 20;

/// Hexadecimal digits of a check sum.
const SUM_DIGITS: usize = 16;

const HEADER: Header = Header { kind: "embeddings", version: VERSION };

/// A line with a vector.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct VectorLine {
    id: String,
    /// SHA-256 of the text.
    text: String,
    vector: String,
    sum: String,
}

impl VectorLine {
    fn new(id: &str, text: &str, vector: &Vector) -> Self {
        let (text, vector) = (digest(text), to_base64(vector));
        let sum = sum(id, &text, &vector);
        Self { id: id.to_owned(), text, vector, sum }
    }

    /// Reads a line that is not damaged.
    fn read(line: &[u8]) -> Option<Self> {
        let line: Self = serde_json::from_slice(line).ok()?;
        (line.sum == sum(&line.id, &line.text, &line.vector)).then_some(line)
    }

    fn hash(&self) -> Hash {
        hash(&(&self.id, &self.text))
    }
}

fn sum(id: &str, text: &str, vector: &str) -> String {
    let mut sum = digest(&format!("{id}\n{text}\n{vector}"));
    sum.truncate(SUM_DIGITS);
    sum
}

/// See the module. The vectors stay in the file, as there may be many.
#[derive(Debug)]
pub struct VectorFile {
    path: PathBuf,
    lines: Lines,
    places: HashMap<Hash, Place>,
    damaged: usize,
}

impl VectorFile {
    /// Opens or creates a file to which vectors are added, by one process at a time.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be written, is another kind of file, is in use, or has more than [`VECTORS_MAX`]
    /// vectors.
    pub fn record(path: &Path) -> Result<Self, Error> {
        Self::open(path, true)
    }

    /// Opens a file to read it only.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be read, is another kind of file, or has more than [`VECTORS_MAX`] vectors.
    pub fn play(path: &Path) -> Result<Self, Error> {
        Self::open(path, false)
    }

    fn open(path: &Path, is_recording: bool) -> Result<Self, Error> {
        let mut places = HashMap::new();
        let mut damaged = 0;
        let take = |place, line: &[u8]| {
            match VectorLine::read(line) {
                Some(line) => drop(places.insert(line.hash(), place)),
                None => damaged += 1,
            }
            if places.len() > VECTORS_MAX { Err(full()) } else { Ok(()) }
        };
        let lines = Lines::open(path, is_recording, HEADER, take)
            .map_err(|what| Error::File { path: path.to_owned(), what })?;
        if damaged > 0 {
            tracing::warn!(path = %path.display(), damaged, "damaged vectors were left out");
        }
        Ok(Self { path: path.to_owned(), lines, places, damaged })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How many damaged lines were left out when it was opened.
    #[must_use]
    pub const fn damaged(&self) -> usize {
        self.damaged
    }

    pub(super) fn find(&mut self, id: &str, text: &str) -> Result<Option<Vector>, Error> {
        let Some(place) = self.places.get(&hash(&(id, digest(text)))) else { return Ok(None) };
        let line = self.lines.read(*place).map_err(|error| self.wrong(error.to_string()))?;
        let vector = VectorLine::read(&line).and_then(|line| from_base64(&line.vector));
        vector.map(Some).ok_or_else(|| {
            self.wrong("it was changed while it was open: run the same command again".to_owned())
        })
    }

    pub(super) fn add(&mut self, id: &str, text: &str, vector: &Vector) -> Result<(), Error> {
        if self.places.len() >= VECTORS_MAX {
            return Err(self.wrong(full()));
        }
        let line = VectorLine::new(id, text, vector);
        let place = self.lines.write(&line).map_err(|error| self.wrong(error.to_string()))?;
        self.places.insert(line.hash(), place);
        Ok(())
    }

    fn wrong(&self, what: String) -> Error {
        Error::File { path: self.path.clone(), what }
    }
}

fn full() -> String {
    format!("there are more than {VECTORS_MAX}; begin another file")
}
