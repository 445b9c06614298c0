//! Files of the host that are read, which may be devices, pipes, or without an end.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

/// Opens a regular file to read it. Refuses devices and pipes, which may have no end, or no beginning.
///
/// # Errors
///
/// The host's, or that the file is not regular.
pub fn open(path: &Path) -> io::Result<File> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is not a regular file"));
    }
    File::open(path)
}

/// Maximum bytes of a file that is read as one text: templates, experiments, definitions, secrets.
pub const TEXT_BYTES_MAX: u64 = 16 * 1024 * 1024;

/// Reads a file as one text, of at most [`TEXT_BYTES_MAX`].
///
/// # Errors
///
/// Those of [`open`] and [`text_of`].
pub fn read_text(path: &Path) -> io::Result<String> {
    text_of(open(path)?)
}

/// Reads one text to its end, of at most [`TEXT_BYTES_MAX`].
///
/// # Errors
///
/// The host's, or that the text is longer or not UTF-8.
pub fn text_of(from: impl io::Read) -> io::Result<String> {
    let mut text = String::new();
    let read = from.take(TEXT_BYTES_MAX + 1).read_to_string(&mut text)?;
    if read as u64 > TEXT_BYTES_MAX {
        return Err(io::Error::other(format!("it has more than {TEXT_BYTES_MAX} bytes")));
    }
    Ok(text)
}
