//! Append-only files of JSON lines. The first line names the kind of file.
//!
//! Each line is written in one call before its content is used. A partial last line, left by a crash, is cut off when
//! the file is opened for writing, and ignored by readers.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use data_encoding::HEXLOWER;
use serde::Serialize;
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

/// Bytes of a line: far more than any answer.
const LINE_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// The value in the first line that names this program.
const NAME: &str = "swarmbench";

/// The first line of a file: `{"kind":"swarmbench","version":1}`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Header {
    pub(crate) kind: &'static str,
    pub(crate) version: u32,
}

impl Header {
    fn line(self) -> Vec<u8> {
        format!("{{\"{}\":\"{NAME}\",\"version\":{}}}\n", self.kind, self.version).into_bytes()
    }

    /// Checks that a first line, which may be cut, begins a file of this kind.
    fn check(self, line: &[u8], is_whole: bool) -> Result<(), String> {
        let fields = serde_json::from_slice::<Map<String, Value>>(line).ok();
        let version = fields
            .filter(|fields| is_whole && fields.get(self.kind).is_some_and(|name| name == NAME))
            .and_then(|fields| fields.get("version")?.as_u64());
        match version {
            Some(version) if version == u64::from(self.version) => Ok(()),
            Some(version) => Err(format!(
                "is of version {version}, and this program reads version {}",
                self.version
            )),
            None if !is_whole && self.line().starts_with(line) => Ok(()),
            None => Err("is another kind of file".to_owned()),
        }
    }
}

/// The position of a line: its first byte, and its length.
pub(crate) type LinePosition = (u64, usize);

#[derive(Debug)]
pub(crate) struct Lines {
    file: File,
    end: u64,
    /// True if a write failed: later lines might be unreadable.
    is_broken: bool,
}

impl Lines {
    /// Opens a file, or with `writes` creates it, and hands each whole line after the first to `take`. Only one
    /// process at a time can write.
    ///
    /// # Errors
    /// A fault of the file, as the end of a sentence about it.
    pub(crate) fn open(
        path: &Path,
        writes: bool,
        header: Header,
        mut take: impl FnMut(LinePosition, &[u8]) -> Result<(), String>,
    ) -> Result<Self, String> {
        let text = |error: io::Error| error.to_string();
        let mut options = OpenOptions::new();
        options.read(true).append(writes).create(writes);
        let file = options.open(path).map_err(text)?;
        if !file.metadata().map_err(text)?.is_file() {
            return Err("it is no regular file".to_owned());
        }
        if writes && matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
            return Err("another process records on it".to_owned());
        }
        let end = read(&file, header, &mut take)?;
        let mut lines = Self { file, end, is_broken: false };
        if !writes {
            return if end == 0 { Err("it is empty".to_owned()) } else { Ok(lines) };
        }
        if lines.file.metadata().map_err(text)?.len() > end {
            lines.file.set_len(end).map_err(text)?;
        }
        if end == 0 {
            lines.append(&header.line()).map_err(text)?;
        }
        Ok(lines)
    }

    /// Appends a line in one write.
    pub(crate) fn write(&mut self, line: &impl Serialize) -> io::Result<LinePosition> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        self.append(&text)
    }

    fn append(&mut self, text: &[u8]) -> io::Result<LinePosition> {
        if self.is_broken {
            return Err(io::Error::other("an earlier line could not be written"));
        }
        self.is_broken = true;
        self.file.write_all(text)?;
        self.is_broken = false;
        let from = self.end;
        self.end += text.len() as u64;
        Ok((from, text.len()))
    }

    pub(crate) fn read(&mut self, (from, length): LinePosition) -> io::Result<Vec<u8>> {
        let mut text = vec![0; length];
        self.file.seek(SeekFrom::Start(from))?;
        self.file.read_exact(&mut text)?;
        Ok(text)
    }
}

/// Reads all whole lines; returns the end of the last.
fn read(
    file: &File,
    header: Header,
    take: &mut impl FnMut(LinePosition, &[u8]) -> Result<(), String>,
) -> Result<u64, String> {
    let text = |error: io::Error| error.to_string();
    let mut reader = BufReader::new(file.try_clone().map_err(text)?);
    let mut line = Vec::new();
    let mut end = 0;
    for number in 1_u64.. {
        line.clear();
        let mut bounded = reader.by_ref().take(LINE_BYTES_MAX);
        let length = bounded.read_until(b'\n', &mut line).map_err(text)?;
        let is_whole = line.last() == Some(&b'\n');
        if number == 1 {
            header.check(&line, is_whole)?;
        }
        if !is_whole && length as u64 == LINE_BYTES_MAX {
            return Err(format!("line {number} is longer than any of such a file"));
        }
        if !is_whole {
            break;
        }
        if number > 1 {
            take((end, length), &line).map_err(|what| format!("line {number} {what}"))?;
        }
        end += length as u64;
    }
    Ok(end)
}

/// An index key of lines.
pub(crate) type Hash = [u8; 32];

pub(crate) fn hash(what: &impl Serialize) -> Hash {
    Sha256::digest(serde_json::to_vec(what).expect("texts and numbers can be written")).into()
}

/// SHA-256 of a text, in hexadecimal.
pub(crate) fn digest(text: &str) -> String {
    HEXLOWER.encode(&Sha256::digest(text))
}
