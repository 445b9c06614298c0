//! Reads rows of a table from JSON Lines or Parquet. The files are untrusted.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use serde_json::{Map, Value};
use swarmbench_clock::files;

/// Maximum bytes of a line.
const LINE_BYTES_MAX: usize = 4 * 1024 * 1024;

/// Cells by column names.
pub type DatasetRow = Map<String, Value>;

#[derive(Debug, thiserror::Error)]
pub enum RowsError {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error("it is damaged, or no Parquet file: {0}")]
    Parquet(#[from] parquet::errors::ParquetError),
    #[error(
        "its columns are nested, or of other kinds than texts, numbers, truth values and times"
    )]
    Nested,
}

/// Splits a stream of bytes into lines.
#[derive(Default)]
pub struct Splitter {
    line: Vec<u8>,
}

impl Splitter {
    /// Calls `each` for every line completed by these bytes.
    pub fn push(
        &mut self,
        bytes: &[u8],
        mut each: impl FnMut(&[u8]) -> io::Result<()>,
    ) -> io::Result<()> {
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            if self.line.len() + piece.len() > LINE_BYTES_MAX {
                return Err(io::Error::other(format!(
                    "a row has more than {LINE_BYTES_MAX} bytes"
                )));
            }
            self.line.extend_from_slice(piece);
            if piece.ends_with(b"\n") {
                each(&self.line)?;
                self.line.clear();
            }
        }
        Ok(())
    }
}

/// A writer that parses JSON Lines and calls `each` for every row. [`Self::finish`] must follow the last byte.
pub struct Lines<F> {
    each: F,
    splitter: Splitter,
    read: u64,
}

impl<F: FnMut(DatasetRow) -> io::Result<()>> Lines<F> {
    pub fn new(each: F) -> Self {
        Self { each, splitter: Splitter::default(), read: 0 }
    }

    /// Parses a last line without a line break.
    pub fn finish(mut self) -> io::Result<()> {
        self.write_all(b"\n")
    }
}

impl<F: FnMut(DatasetRow) -> io::Result<()>> Write for Lines<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Self { each, splitter, read } = self;
        splitter.push(bytes, |line| {
            *read += 1;
            if line.trim_ascii().is_empty() {
                return Ok(());
            }
            let row = serde_json::from_slice(line);
            each(row.map_err(|error| {
                io::Error::other(format!("line {read} is damaged, or no JSON object: {error}"))
            })?)
        })?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Reads Parquet if the file name ends so, else JSON Lines.
pub fn read(
    path: &Path,
    mut each: impl FnMut(DatasetRow) -> io::Result<()>,
) -> Result<(), RowsError> {
    let mut file = files::open(path)?;
    if path.extension().is_none_or(|end| end != "parquet") {
        let mut lines = Lines::new(each);
        io::copy(&mut file, &mut lines)?;
        return Ok(lines.finish()?);
    }
    let footer = footer(&mut file)?;
    if !footer.is_empty() && !is_flat(&footer) {
        return Err(RowsError::Nested);
    }
    for row in SerializedFileReader::new(file)?.get_row_iter(None)? {
        let cells = row?.into_columns().into_iter();
        each(cells.filter_map(|(name, field)| Some((name, value(field)?))).collect())?;
    }
    Ok(())
}

/// The metadata at the end of a Parquet file; empty if not found.
fn footer(file: &mut File) -> io::Result<Vec<u8>> {
    let mut tail = [0; 8];
    let end = file.seek(SeekFrom::End(-8))?;
    file.read_exact(&mut tail)?;
    let [bytes @ .., b'P', b'A', b'R', b'1'] = tail else { return Ok(Vec::new()) };
    let bytes = u64::from(u32::from_le_bytes(bytes));
    file.seek(SeekFrom::Start(end.saturating_sub(bytes)))?;
    let mut footer = Vec::new();
    file.take(bytes).read_to_end(&mut footer).map(|_| footer)
}

/// Whether the metadata begins with a flat schema, as those of tables are. The library parses nested schemas recursively, as
/// deep as the file says.
fn is_flat(footer: &[u8]) -> bool {
    let mut thrift = Thrift(footer);
    let of_schema = |thrift: &mut Thrift<'_>| {
        (thrift.byte()? == 0x15).then_some(())?;
        thrift.number()?;
        (thrift.byte()? == 0x19).then_some(())?;
        let elements = match thrift.byte()? {
            0xfc => thrift.number()?,
            header if header & 0x0f == 0x0c => u64::from(header >> 4),
            _ => return None,
        };
        (0..elements).try_for_each(|place| thrift.element(if place == 0 { elements } else { 0 }))
    };
    of_schema(&mut thrift).is_some()
}

/// A parser for the subset of Thrift's compact protocol that flat schemas use.
struct Thrift<'a>(&'a [u8]);

impl Thrift<'_> {
    fn byte(&mut self) -> Option<u8> {
        self.0.split_off_first().copied()
    }

    fn number(&mut self) -> Option<u64> {
        let mut number = 0;
        for shift in (0..63).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(number);
            }
        }
        None
    }

    /// Parses an element of a schema. Fields must have the right types, which the library does not check.
    fn element(&mut self, children_max: u64) -> Option<()> {
        let mut field = 0;
        loop {
            let header = self.byte()?;
            field += header >> 4;
            match (field, header & 0x0f) {
                _ if header == 0 => return Some(()),
                _ if header < 0x10 => return None,
                (4, 8) => {
                    let bytes = usize::try_from(self.number()?).ok()?;
                    self.0.split_off(..bytes)?;
                }
                (5, 5) => (self.number()? / 2 <= children_max).then_some(())?,
                (1..=9, 5) => drop(self.number()?),
                (10, 12) => self.kind()?,
                _ => return None,
            }
        }
    }

    /// Parses a logical type: a text, or a time of any unit.
    fn kind(&mut self) -> Option<()> {
        let ([0x1c, 0, 0, rest @ ..]
        | [0x8c, 0x11 | 0x12, 0x1c, 0x1c | 0x2c | 0x3c, 0, 0, 0, 0, rest @ ..]) = self.0
        else {
            return None;
        };
        self.0 = rest;
        Some(())
    }
}

/// Converts values of tables to JSON; times are left out.
fn value(field: Field) -> Option<Value> {
    match field {
        Field::Null => Some(Value::Null),
        Field::Bool(flag) => Some(flag.into()),
        Field::Int(number) => Some(number.into()),
        Field::Long(number) => Some(number.into()),
        Field::Double(number) => Some(number.into()),
        Field::Str(text) => Some(text.into()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::columns::Table;
    use super::super::tables::{Cell, Column, Kind, Named};
    use super::*;

    const COLUMNS: &[Column] = &[
        ("model", Kind::Text),
        ("seed", Kind::Whole),
        ("score", Kind::Real),
        ("mixed", Kind::Flag),
    ];

    fn rows_of(path: &Path) -> Result<Vec<DatasetRow>, RowsError> {
        let mut rows = Vec::new();
        read(path, |row| {
            rows.push(row);
            Ok(())
        })?;
        Ok(rows)
    }

    #[test]
    fn both_formats_give_the_same_rows() {
        let folder = tempfile::tempdir().expect("a folder");
        let rows = [
            vec!["a\nb".into(), 3_i64.into(), 0.5.into(), false.into()],
            vec![Cell::Missing, (-1_i64).into(), Cell::Missing, true.into()],
        ];
        let (lines, parquet) = (folder.path().join("t.jsonl"), folder.path().join("t.parquet"));
        let text: Vec<String> =
            rows.iter().map(|row| json!(Named(COLUMNS, row)).to_string()).collect();
        // The last line has no line break.
        std::fs::write(&lines, text.join("\n")).expect("written");
        let file = File::create(&parquet).expect("created");
        let mut table = Table::new(file, "episodes", COLUMNS).expect("a table");
        for row in rows {
            table.add(row).expect("a row");
        }
        table.finish().expect("written");

        let of_lines = rows_of(&lines).expect("lines");
        assert_eq!(of_lines[0]["model"], "a\nb");
        assert_eq!(of_lines, rows_of(&parquet).expect("Parquet"));
    }

    #[test]
    fn damaged_files_say_where() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, content, expected) in [
            ("cut.jsonl", "{\"a\":1}\n\n{\"a\":", "line 3 is damaged"),
            ("list.jsonl", "[1]\n", "line 1 is damaged, or no JSON object"),
            ("cut.parquet", "PAR1 and so on", "it is damaged, or no Parquet file"),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).expect("written");
            let error = rows_of(&path).expect_err("it is damaged").to_string();
            assert!(error.contains(expected), "{name}: {error}");
        }
        // Nested as deep as there are elements; each element claims one or two billion children.
        for children in [&[0x02][..], &[0xfe, 0xff, 0xff, 0xff, 0x0f]] {
            let element = [&[0x35, 2, 0x18, 1, b'a', 0x15], children, &[0]].concat();
            let schema =
                [&[0x15, 2, 0x19, 0xfc, 0xa0, 0x8d, 0x06], &*element.repeat(100_000)].concat();
            let bytes = u32::try_from(schema.len()).expect("few").to_le_bytes();
            let path = folder.path().join("deep.parquet");
            std::fs::write(&path, [b"PAR1", &*schema, &bytes, b"PAR1"].concat()).expect("written");
            let error = rows_of(&path).expect_err("it is nested").to_string();
            assert!(error.contains("nested"), "{error}");
        }
        let long = vec![b' '; LINE_BYTES_MAX + 1];
        assert!(Splitter::default().push(&long, |_| Ok(())).is_err());
    }
}
