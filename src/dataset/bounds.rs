//! Limits for reading untrusted files.

use std::cell::Cell;
use std::io::{self, Read};

/// What is read at most. Bytes are counted as they are read: the sizes in an archive's directory are not trusted.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Files of a folder, or entries of an archive.
    pub entries_max: usize,
    /// Nested folders.
    pub folders_max: usize,
    /// Of one file, unpacked.
    pub file_bytes_max: u64,
    /// Of all files, unpacked.
    pub total_bytes_max: u64,
    /// Unpacked size divided by packed size of a file in an archive, checked beyond [`RATIO_FREE_BYTES`].
    pub ratio_max: u64,
    /// Nested arrays and objects.
    pub depth_max: u32,
}

/// The first bytes of a file are exempt from the ratio: a short text may be very repetitive.
pub const RATIO_FREE_BYTES: u64 = 4 * 1024 * 1024;

impl Default for Bounds {
    fn default() -> Self {
        Self {
            entries_max: 100_000,
            folders_max: 8,
            file_bytes_max: 2 * 1024 * 1024 * 1024,
            total_bytes_max: 256 * 1024 * 1024 * 1024,
            ratio_max: 500,
            depth_max: 16,
        }
    }
}

/// A file that is read within bounds. Reading beyond them fails.
pub struct Bounded<'a, R> {
    file: R,
    bounds: &'a Bounds,
    /// Its size in its archive.
    packed: Option<u64>,
    bytes: u64,
    /// Bytes of all files so far.
    total: &'a Cell<u64>,
    depth: u32,
    in_text: bool,
    escaped: bool,
}

impl<'a, R: Read> Bounded<'a, R> {
    pub const fn new(
        file: R,
        packed: Option<u64>,
        bounds: &'a Bounds,
        total: &'a Cell<u64>,
    ) -> Self {
        Self { file, bounds, packed, bytes: 0, total, depth: 0, in_text: false, escaped: false }
    }

    fn count(&mut self, read: u64) -> io::Result<()> {
        let Bounds { file_bytes_max, total_bytes_max, ratio_max, .. } = *self.bounds;
        self.bytes += read;
        self.total.set(self.total.get() + read);
        if self.bytes > file_bytes_max {
            return refuse(format!("it has more than {file_bytes_max} bytes"));
        }
        if self.total.get() > total_bytes_max {
            return refuse(format!("all files together have more than {total_bytes_max} bytes"));
        }
        if let Some(packed) = self.packed
            && self.bytes > RATIO_FREE_BYTES
            && self.bytes / ratio_max > packed
        {
            return refuse(format!("it is more than {ratio_max} times as large as in the archive"));
        }
        Ok(())
    }

    /// Counts the nested arrays and objects; invalid JSON is found by the parser.
    fn measure(&mut self, bytes: &[u8]) -> io::Result<()> {
        for byte in bytes {
            if self.in_text {
                match byte {
                    _ if self.escaped => self.escaped = false,
                    b'\\' => self.escaped = true,
                    b'"' => self.in_text = false,
                    _ => {}
                }
                continue;
            }
            match byte {
                b'"' => self.in_text = true,
                b'[' | b'{' => {
                    self.depth += 1;
                    if self.depth > self.bounds.depth_max {
                        let most = self.bounds.depth_max;
                        return refuse(format!(
                            "more than {most} arrays and objects are inside each other"
                        ));
                    }
                }
                b']' | b'}' => self.depth = self.depth.saturating_sub(1),
                _ => {}
            }
        }
        Ok(())
    }
}

fn refuse(problem: String) -> io::Result<()> {
    Err(io::Error::other(problem))
}

impl<R: Read> Read for Bounded<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer)?;
        self.count(read as u64)?;
        self.measure(&buffer[..read])?;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, packed: Option<u64>, bounds: &Bounds) -> Result<usize, String> {
        let total = Cell::new(0);
        let mut out = Vec::new();
        let mut file = Bounded::new(text.as_bytes(), packed, bounds, &total);
        file.read_to_end(&mut out).map_err(|error| error.to_string())
    }

    #[test]
    fn depth_is_counted_outside_of_texts() {
        let bounds = Bounds { depth_max: 2, ..Bounds::default() };
        assert_eq!(read(r#"[{"a": "[[[[{{{{\"[[["}, {"b": 1}]"#, None, &bounds), Ok(34));
        assert!(
            read("[[[]]]", None, &bounds).is_err_and(|problem| problem.contains("more than 2"))
        );
        assert!(read(&"[".repeat(1 << 20), None, &bounds).is_err());
    }

    #[test]
    fn bytes_are_counted_as_they_come() {
        let bounds = Bounds { file_bytes_max: 10, total_bytes_max: 15, ..Bounds::default() };
        assert_eq!(read("0123456789", None, &bounds), Ok(10));
        assert!(read("0123456789x", None, &bounds).is_err());
        let (total, mut out) = (Cell::new(8), Vec::new());
        let mut file = Bounded::new(&b"01234567"[..], None, &bounds, &total);
        let error = file.read_to_end(&mut out).expect_err("too much").to_string();
        assert!(error.contains("together"), "{error}");
    }

    #[test]
    fn what_grows_too_much_is_refused() {
        let bounds = Bounds { ratio_max: 10, ..Bounds::default() };
        let large = " ".repeat(usize::try_from(RATIO_FREE_BYTES).expect("small") + 1);
        assert!(
            read(&large, Some(1000), &bounds).is_err_and(|problem| problem.contains("10 times"))
        );
        assert!(read(&large, Some(RATIO_FREE_BYTES / 10), &bounds).is_ok());
        assert!(read(&large, None, &bounds).is_ok());
        assert!(read(&large[1..], Some(1), &bounds).is_ok());
    }
}
