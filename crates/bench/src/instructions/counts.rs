//! The committed counts, and their comparison with new ones. No files and no processes: text in, text out.

use std::collections::BTreeMap;
use std::fmt;

use anyhow::Context;
use serde::Deserialize;

/// Counts, and the compiler and processor that they belong to.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Counts {
    /// The version of the compiler.
    pub(crate) rust: String,
    /// The kind of processor, as valgrind shows it to programs.
    pub(crate) machine: String,
    /// Instructions of one run of each benchmark.
    pub(crate) instructions: BTreeMap<String, u64>,
}

/// The tolerated difference of a count, in per cent. Counts of one program differ by at most half of it; the rest is
/// for changes outside a benchmark that move its code.
fn tolerance_percent(benchmark: &str) -> f64 {
    if benchmark.ends_with("board") { 5.0 } else { 3.0 }
}

/// The command that accepts new counts.
const ACCEPT: &str = ".ci/instructions --accept";

impl Counts {
    /// Reads the file of counts.
    pub(crate) fn read(text: &str) -> anyhow::Result<Self> {
        toml::from_str(text).with_context(|| {
            format!("the committed counts cannot be read; `{ACCEPT}` writes them anew")
        })
    }

    /// Compares these committed counts with new ones.
    pub(crate) fn compare(self, now: &Self) -> Comparison {
        let mut lines = Vec::new();
        for (benchmark, &instructions) in &now.instructions {
            let before = self.instructions.get(benchmark).copied();
            lines.push(Line { benchmark: benchmark.clone(), before, now: Some(instructions) });
        }
        for (benchmark, &instructions) in &self.instructions {
            if !now.instructions.contains_key(benchmark) {
                let benchmark = benchmark.clone();
                lines.push(Line { benchmark, before: Some(instructions), now: None });
            }
        }
        let mut differences = Vec::new();
        for (what, before, now) in
            [("Rust", self.rust, &now.rust), ("a processor", self.machine, &now.machine)]
        {
            if before != *now {
                differences.push(format!("{what} {before}, and here is {now}"));
            }
        }
        Comparison { lines, differences }
    }
}

/// Writes the file of counts.
impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "# Instructions of one run of each benchmark: docs/develop/performance.md.")?;
        writeln!(f, "# `{ACCEPT}` writes this file.")?;
        writeln!(f, "rust = {:?}\nmachine = {:?}\n\n[instructions]", self.rust, self.machine)?;
        for (benchmark, instructions) in &self.instructions {
            writeln!(f, "{benchmark} = {}", grouped(*instructions, '_'))?;
        }
        Ok(())
    }
}

/// A benchmark's counts before and now; a new benchmark has no count before, a removed one none now.
#[derive(Debug)]
struct Line {
    benchmark: String,
    before: Option<u64>,
    now: Option<u64>,
}

impl Line {
    /// A complaint about a benchmark, with advice.
    fn complaint(&self) -> Option<String> {
        let Self { benchmark, before, now } = self;
        match (*before, *now) {
            (Some(before), Some(now)) => {
                let percent = percent(before, now);
                let (before, shown) = (grouped(before, ','), grouped(now, ','));
                let change = format!("{before} instructions before, {shown} now ({percent:+.1} %)");
                let tolerance = tolerance_percent(benchmark);
                if percent > tolerance {
                    Some(format!(
                        "{benchmark} is slower: {change}. Make it as fast as it was, or accept it with `{ACCEPT}` and \
                         write the reason into the commit."
                    ))
                } else if percent < -tolerance {
                    Some(format!(
                        "{benchmark} is faster: {change}. Run `{ACCEPT}` and commit the better number, so that it is \
                         guarded."
                    ))
                } else {
                    None
                }
            }
            (None, _) => Some(format!("{benchmark} has no committed number: run `{ACCEPT}`.")),
            (Some(_), None) => Some(format!(
                "{benchmark} has a committed number and is not counted: run `{ACCEPT}`."
            )),
        }
    }
}

/// The outcome.
#[derive(Debug)]
pub(crate) struct Comparison {
    lines: Vec<Line>,
    /// Differences of compiler or processor, which make the counts incomparable.
    differences: Vec<String>,
}

impl Comparison {
    /// True if nothing has to be done. Counts of another compiler or processor always pass.
    pub(crate) fn passes(&self) -> bool {
        !self.differences.is_empty() || self.lines.iter().all(|line| line.complaint().is_none())
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<22} {:>12} {:>12} {:>8}", "benchmark", "committed", "now", "")?;
        let shown =
            |count: Option<u64>| count.map_or_else(|| "-".to_owned(), |count| grouped(count, ','));
        for Line { benchmark, before, now } in &self.lines {
            let change =
                before.zip(*now).map(|(before, now)| format!("{:+.2} %", percent(before, now)));
            let change = change.unwrap_or_default();
            writeln!(f, "{benchmark:<22} {:>12} {:>12} {change:>8}", shown(*before), shown(*now))?;
        }
        let complaints = self.lines.iter().filter_map(Line::complaint);
        if self.differences.is_empty() {
            return complaints.into_iter().try_for_each(|complaint| write!(f, "\n{complaint}"));
        }
        for difference in &self.differences {
            write!(f, "\nThe committed counts belong to {difference}.")?;
        }
        write!(f, "\nSo they are compared for information only.")
    }
}

/// The difference to an earlier number, in per cent.
#[expect(clippy::cast_precision_loss, reason = "no count comes near 2⁵³")]
pub(crate) fn percent(before: u64, now: u64) -> f64 {
    (now as f64 / before.max(1) as f64 - 1.0) * 100.0
}

/// A number with its digits in groups of three.
fn grouped(number: u64, separator: char) -> String {
    let digits = number.to_string();
    let mut grouped = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            grouped.push(separator);
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(look: u64, act: u64) -> Counts {
        let text = format!(
            "rust = \"1.95.0\"\nmachine = \"x86_64-linux with AVX2\"\n[instructions]\nlook = {look}\nact = {act}\n"
        );
        Counts::read(&text).expect("counts")
    }

    #[test]
    fn the_file_is_read_as_it_is_written() {
        let counts = counts(1_234_567, 999);
        let text = counts.to_string();
        assert!(text.contains("look = 1_234_567\n") && text.contains("act = 999\n"), "{text}");
        assert_eq!(Counts::read(&text).expect("it is read"), counts);
        let error = Counts::read("rust = 1").expect_err("it is not a version");
        assert!(error.to_string().contains(".ci/instructions --accept"), "{error}");
    }

    #[test]
    fn small_differences_pass() {
        for (look, act) in [(100_000, 50_000), (102_900, 50_000), (97_100, 51_400)] {
            let comparison = counts(100_000, 50_000).compare(&counts(look, act));
            assert!(comparison.passes(), "{comparison}");
            assert!(!comparison.to_string().contains("--accept"), "{comparison}");
        }
    }

    #[test]
    fn what_is_slower_or_faster_is_named_with_both_numbers_and_what_to_do() {
        for (look, expected) in [
            (103_100, "look is slower: 100,000 instructions before, 103,100 now (+3.1 %)"),
            (96_900, "look is faster: 100,000 instructions before, 96,900 now (-3.1 %)"),
        ] {
            let comparison = counts(100_000, 50_000).compare(&counts(look, 50_000));
            assert!(!comparison.passes());
            let text = comparison.to_string();
            assert!(
                text.contains(expected) && text.contains(".ci/instructions --accept"),
                "{text}"
            );
            assert!(!text.contains("act is"), "{text}");
        }
    }

    #[test]
    fn new_and_removed_benchmarks_have_to_be_committed() {
        let both = counts(100_000, 50_000);
        let mut one = both.clone();
        one.instructions.remove("act");
        for (before, now, expected) in [
            (one.clone(), both.clone(), "act has no committed number"),
            (both, one, "act has a committed number and is not counted"),
        ] {
            let comparison = before.compare(&now);
            assert!(!comparison.passes());
            assert!(comparison.to_string().contains(expected), "{comparison}");
        }
    }

    #[test]
    fn counts_of_another_compiler_or_processor_are_only_shown() {
        let before = counts(100_000, 50_000);
        let mut now = counts(200_000, 50_000);
        now.rust = "1.97.0".to_owned();
        let comparison = before.clone().compare(&now);
        assert!(comparison.passes());
        let text = comparison.to_string();
        assert!(text.contains("belong to Rust 1.95.0, and here is 1.97.0"), "{text}");
        assert!(text.contains("+100.00 %") && text.contains("for information only"), "{text}");
        now.rust.clone_from(&before.rust);
        now.machine = "aarch64-linux".to_owned();
        assert!(before.compare(&now).passes());
    }
}
