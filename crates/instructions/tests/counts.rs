//! The comparison of counts with the committed ones: its results and messages.

#[path = "../src/counts.rs"]
mod counts;

use counts::Counts;

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
    assert_eq!(Counts::read(&text), Ok(counts));
    let error = Counts::read("rust = 1").expect_err("it is not a version");
    assert!(error.contains(".ci/instructions --accept"), "{error}");
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
        assert!(text.contains(expected) && text.contains(".ci/instructions --accept"), "{text}");
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
