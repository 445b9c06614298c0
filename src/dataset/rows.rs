//! Reading rows of a table, from JSON Lines or Parquet. Files may come from anywhere.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use serde_json::{Map, Value};

/// Bytes of a line at most.
const LINE_BYTES_MAX: usize = 4 * 1024 * 1024;

/// The cells of a row by the names of their columns.
pub type Row = Map<String, Value>;

#[derive(Debug, thiserror::Error)]
pub enum RowsError {
    #[error(transparent)]
    Io(#[from] io::Error),
    #[error("it is damaged, or no Parquet file: {0}")]
    Parquet(#[from] parquet::errors::ParquetError),
}

/// Takes bytes and gives whole lines.
#[derive(Default)]
pub struct Splitter {
    line: Vec<u8>,
}

impl Splitter {
    /// Calls `each` with every line that these bytes complete.
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

/// Takes JSON Lines and calls `each` with every row. [`Self::finish`] is called after the last byte.
pub struct Lines<F> {
    each: F,
    splitter: Splitter,
    read: u64,
}

impl<F: FnMut(Row) -> io::Result<()>> Lines<F> {
    pub fn new(each: F) -> Self {
        Self { each, splitter: Splitter::default(), read: 0 }
    }

    /// Reads a last line that has no end.
    pub fn finish(mut self) -> io::Result<()> {
        self.write_all(b"\n")
    }
}

impl<F: FnMut(Row) -> io::Result<()>> Write for Lines<F> {
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

/// Reads a file of Parquet if its name says so, else of JSON Lines.
pub fn read(path: &Path, mut each: impl FnMut(Row) -> io::Result<()>) -> Result<(), RowsError> {
    let mut file = File::open(path)?;
    if path.extension().is_none_or(|end| end != "parquet") {
        let mut lines = Lines::new(each);
        io::copy(&mut file, &mut lines)?;
        return Ok(lines.finish()?);
    }
    for row in SerializedFileReader::new(file)?.get_row_iter(None)? {
        let cells = row?.into_columns().into_iter();
        each(cells.filter_map(|(name, field)| Some((name, value(field)?))).collect())?;
    }
    Ok(())
}

/// The kinds of values that tables have; times are left out.
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

    fn rows_of(path: &Path) -> Result<Vec<Row>, RowsError> {
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
        // The last line has no end.
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
        let long = vec![b' '; LINE_BYTES_MAX + 1];
        assert!(Splitter::default().push(&long, |_| Ok(())).is_err());
    }
}
