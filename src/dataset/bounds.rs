//! Limits for reading untrusted files.

use std::cell::Cell;
use std::io::{self, Read};

/// Limits of a read. Bytes are counted as they are read, as the sizes in an archive's directory are not trusted.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Files of a folder, or entries of an archive.
    pub entries_max: usize,
    /// Nested folders.
    pub folders_max: usize,
    /// Directory of an archive, which stays in memory.
    pub directory_bytes_max: u64,
    /// One unpacked file.
    pub file_bytes_max: u64,
    /// An index, which stays in memory.
    pub index_bytes_max: u64,
    /// All unpacked files together.
    pub total_bytes_max: u64,
    /// Unpacked size divided by packed size of a file in an archive, checked beyond [`RATIO_FREE_BYTES`].
    pub ratio_max: u64,
    /// Nesting of arrays and objects.
    pub depth_max: u32,
    /// JSON of one state or one act.
    pub row_bytes_max: u64,
    /// Numbers, texts, arrays and objects in one state or act: the cells of the largest map, with some room.
    pub row_values_max: u64,
    /// JSON of a run's settings, which may name a model for each agent.
    pub settings_bytes_max: u64,
    /// Numbers, texts, arrays and objects in the settings.
    pub settings_values_max: u64,
    /// A state with its packed acts, as stored.
    pub state_bytes_max: u64,
    /// All states of a game with their packed acts, as stored. One game at a time is in memory.
    pub game_bytes_max: u64,
}

/// Maximum bytes of a stored state with its packed acts. Unpacked acts may have four times as many.
pub const IMPORT_STATE_BYTES_MAX: u64 = 32 * 1024 * 1024;

/// Bytes of a file that are exempt from the ratio, as a short text may be very repetitive.
pub const RATIO_FREE_BYTES: u64 = 4 * 1024 * 1024;

impl Default for Bounds {
    fn default() -> Self {
        Self {
            entries_max: 100_000,
            folders_max: 8,
            directory_bytes_max: 64 * 1024 * 1024,
            file_bytes_max: 2 * 1024 * 1024 * 1024,
            index_bytes_max: 64 * 1024 * 1024,
            total_bytes_max: 256 * 1024 * 1024 * 1024,
            ratio_max: 500,
            depth_max: 16,
            row_bytes_max: 16 * 1024 * 1024,
            row_values_max: 1_100_000,
            settings_bytes_max: 1024 * 1024,
            settings_values_max: 8192,
            state_bytes_max: IMPORT_STATE_BYTES_MAX,
            game_bytes_max: 256 * 1024 * 1024,
        }
    }
}

impl Bounds {
    /// Bounds for an index, whose rows are settings.
    #[must_use]
    pub const fn of_index(self) -> Self {
        Self {
            file_bytes_max: self.index_bytes_max,
            row_bytes_max: self.settings_bytes_max,
            row_values_max: self.settings_values_max,
            ..self
        }
    }
}

/// A reader that fails when a bound is exceeded, before a parser sees the excess.
pub struct Bounded<'a, R> {
    file: R,
    bounds: Bounds,
    /// Size of the file in its archive.
    packed: Option<u64>,
    bytes: u64,
    /// Bytes of all files so far.
    total: &'a Cell<u64>,
    depth: u32,
    in_text: bool,
    escaped: bool,
    /// Offset of the current element of the outermost array or object, and its number of values so far.
    row: (u64, u64),
}

impl<'a, R: Read> Bounded<'a, R> {
    pub const fn new(file: R, packed: Option<u64>, bounds: Bounds, total: &'a Cell<u64>) -> Self {
        let (depth, in_text, escaped) = (0, false, false);
        Self { file, bounds, packed, bytes: 0, total, depth, in_text, escaped, row: (0, 0) }
    }

    fn count(&mut self, read: u64) -> io::Result<()> {
        let Bounds { file_bytes_max, total_bytes_max, ratio_max, .. } = self.bounds;
        self.bytes += read;
        self.total.set(self.total.get() + read);
        if self.bytes > file_bytes_max {
            return refuse(format!("it has more than {file_bytes_max} bytes "));
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

    /// Counts nesting and the values of elements. Invalid JSON is left to the parser.
    fn measure(&mut self, bytes: &[u8]) -> io::Result<()> {
        for (at, byte) in (self.bytes - bytes.len() as u64..).zip(bytes) {
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
                    self.row.1 += 1;
                    self.depth += 1;
                    if self.depth > self.bounds.depth_max {
                        let most = self.bounds.depth_max;
                        return refuse(format!(
                            "more than {most} arrays and objects are inside each other"
                        ));
                    }
                }
                b']' | b'}' => self.depth = self.depth.saturating_sub(1),
                b',' if self.depth <= 1 => {
                    self.check_row(at)?;
                    self.row = (at, 0);
                }
                b',' => self.row.1 += 1,
                _ => {}
            }
        }
        self.check_row(self.bytes)
    }

    /// Checks the current element, which ends at `at` or continues there.
    fn check_row(&self, at: u64) -> io::Result<()> {
        let Bounds { row_bytes_max, row_values_max, .. } = self.bounds;
        let (begin, values) = self.row;
        if at - begin > row_bytes_max {
            return refuse(format!("an element has more than {row_bytes_max} bytes"));
        }
        if values > row_values_max {
            return refuse(format!("an element has more than {row_values_max} values"));
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
        let mut file = Bounded::new(text.as_bytes(), packed, *bounds, &total);
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
    fn an_element_has_so_many_bytes_and_values() {
        let bounds = Bounds { row_bytes_max: 16, row_values_max: 4, ..Bounds::default() };
        assert_eq!(read("[1234567,[1,2,3],[1,2,3],\"[,,,,,\"]", None, &bounds), Ok(34));
        for (bad, problem) in [
            ("[1,[1,2,3,4,5],1]", "4 values"),
            ("{\"a\":[[[[1]]]]}", "4 values"),
            ("[1,\"0123456789abcdef\"]", "16 bytes"),
            ("\"0123456789abcdef\"", "16 bytes"),
        ] {
            let error = read(bad, None, &bounds).expect_err(bad);
            assert!(error.contains(problem), "{bad}: {error}");
        }
    }

    #[test]
    fn bytes_are_counted_as_they_come() {
        let bounds = Bounds { file_bytes_max: 10, total_bytes_max: 15, ..Bounds::default() };
        assert_eq!(read("0123456789", None, &bounds), Ok(10));
        assert!(read("0123456789x", None, &bounds).is_err());
        let (total, mut out) = (Cell::new(8), Vec::new());
        let mut file = Bounded::new(&b"01234567"[..], None, bounds, &total);
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
