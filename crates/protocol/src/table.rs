//! Lists as CSV.

use serde::Serialize;

/// List that is written as JSON or as CSV.
pub trait Table: Serialize {
    /// Item of the list.
    type Row: Serialize;

    /// Line ending of the CSV.
    const LINES_END: csv::Terminator = csv::Terminator::CRLF;

    /// Items of the list.
    fn rows(&self) -> &[Self::Row];

    /// Cursor of the next page; none on the last page.
    fn next_cursor(&self) -> Option<&str>;

    /// Names of the columns.
    fn columns(&self) -> Vec<String>;

    /// Cells of a row in these columns.
    fn record(&self, columns: &[String], row: &Self::Row) -> Vec<String>;

    /// Whole list as CSV, a row for each item.
    fn csv(&self) -> String {
        let columns = self.columns();
        let records = self.rows().iter().map(|row| self.record(&columns, row));
        write_lines(std::iter::once(columns.clone()).chain(records), Self::LINES_END)
    }

    /// Row as a line of CSV.
    fn csv_line(&self, columns: &[String], row: &Self::Row) -> String {
        write_lines([self.record(columns, row)].into_iter(), Self::LINES_END)
    }
}

/// Names of columns, from a list with spaces between them.
pub fn names(list: &'static str) -> impl Iterator<Item = String> {
    list.split_whitespace().map(str::to_owned)
}

/// Value as a cell; empty without a value.
#[must_use]
pub fn maybe<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

/// Text as a cell. Names come from strangers, and spreadsheets evaluate texts that begin like a formula: such a text gets a
/// leading apostrophe, which spreadsheets do not show.
#[must_use]
pub fn text(cell: &str) -> String {
    if cell.trim_start().starts_with(['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠'])
    {
        format!("'{cell}")
    } else {
        cell.to_owned()
    }
}

/// CSV of records below the names of their columns, with the line endings of RFC 4180.
#[must_use]
pub fn write_csv(columns: &[String], records: impl Iterator<Item = Vec<String>>) -> String {
    write_lines(std::iter::once(columns.to_vec()).chain(records), csv::Terminator::CRLF)
}

fn write_lines(records: impl Iterator<Item = Vec<String>>, end: csv::Terminator) -> String {
    let mut csv = csv::WriterBuilder::new().terminator(end).from_writer(Vec::new());
    for record in records {
        csv.write_record(record)
            .expect("memory can be written, and all records have as many cells");
    }
    let bytes = csv.into_inner().expect("memory can be written");
    String::from_utf8(bytes).expect("texts and numbers")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_spreadsheet_runs_a_name() {
        for formula in ["=1+1", "+1", "-1", "@SUM(A1)", "  =1", "\t=1", "\r=1", "＝1"] {
            assert_eq!(text(formula), format!("'{formula}"));
        }
        for name in ["gpt-4.1", "a=b", "'quoted'", "", "Ünï"] {
            assert_eq!(text(name), name);
        }
    }

    #[test]
    fn csv_holds_any_name() {
        let name = "a \"quoted\", name\nof two lines";
        let written = write_csv(
            &["x".to_owned(), "y".to_owned()],
            [vec![text(name), text("=2")]].into_iter(),
        );
        let mut reader = csv::Reader::from_reader(written.as_bytes());
        let record = reader.records().next().expect("a record").expect("well-formed");
        assert_eq!((&record[0], &record[1]), (name, "'=2"));
    }
}
