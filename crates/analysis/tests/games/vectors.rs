//! The embedder `hash-1`, compared with values of an independent program that follows its definition.

use swarmbench_analysis::Hash1;

fn cosine(a: &str, b: &str) -> f64 {
    let embedder = Hash1::default();
    let of = |text| embedder.vector(text).expect("its features do not cancel");
    of(a).iter().zip(&*of(b)).map(|(a, b)| a * b).sum()
}

#[test]
fn cosines_are_those_of_another_program() {
    for (a, b, expected) in [
        ("hold (3,4)", "hold (12,4)", 0.856_303_157_009_812_4),
        ("hold (3,4)", "Hold the line 3 4 3", 0.758_678_349_832_964),
        ("über 5² — ok?", "ÜBER 6² ok", 0.9),
        ("准备 推 右边", "准备 推 左边", 0.5),
        ("!!!", "!!!", 1.0),
        ("!!!", "...", 0.0),
        ("move UP now", "move DOWN now", 0.694_365_074_829_413_7),
    ] {
        let own = cosine(a, b);
        assert!((own - expected).abs() < 1e-12, "{a:?} {b:?}: {own}");
    }
}

#[test]
fn entries_are_those_of_another_program() {
    let vector = Hash1::default().vector("Push UP, agents 3 and 12!").expect("it has features");
    let entries: Vec<_> = vector.iter().copied().enumerate().filter(|&(_, x)| x != 0.0).collect();
    assert_eq!((vector.len(), entries.len()), (1024, 23));
    let expected = [(34, 0.200_535_150_759_921_5), (96, 0.200_535_150_759_921_5)];
    for (own, expected) in entries.iter().zip(expected) {
        assert!(own.0 == expected.0 && (own.1 - expected.1).abs() < 1e-15, "{own:?}");
    }
    let length: f64 = vector.iter().map(|x| x * x).sum();
    assert!((length - 1.0).abs() < 1e-12);
}

#[test]
fn texts_that_differ_in_case_have_the_same_vector() {
    let embedder = Hash1::default();
    assert_eq!(embedder.vector("ÉTAT 12"), embedder.vector("état 12"));
    assert_ne!(embedder.vector("etat 12"), embedder.vector("état 12"));
}
