//! Time to compute the cost of a flock, for random layouts and for layouts that are hard to bound. One iteration
//! measures several layouts, so that a lucky one does not decide.

use criterion::{BenchmarkId, Criterion, Throughput};
use swarmbench_engine::Pos;
use swarmbench_engine::tasks::flocking::{distance, target};
use swarmbench_testkit::worlds::Dice;

const LAYOUTS: usize = 8;

/// Agents, and rows and columns of the map.
const SIZES: [(usize, usize); 6] =
    [(12, 10), (30, 16), (100, 28), (256, 46), (256, 100), (256, 256)];

/// Distinct cells drawn by `draw`.
fn cells(count: usize, mut draw: impl FnMut() -> (usize, usize)) -> Vec<Pos> {
    let mut cells: Vec<Pos> = Vec::with_capacity(count);
    while cells.len() < count {
        let (i, j) = draw();
        let length = |cells| i32::try_from(cells).expect("a map is small");
        let at = Pos::new(length(i), length(j));
        if !cells.contains(&at) {
            cells.push(at);
        }
    }
    cells
}

/// Random cells.
fn random(count: usize, size: usize, dice: &mut Dice) -> Vec<Pos> {
    cells(count, || (1 + dice.below(size - 2), 1 + dice.below(size - 2)))
}

/// A crowd in one corner.
fn corner(count: usize, _: usize, _: &mut Dice) -> Vec<Pos> {
    let side = count.isqrt() + 1;
    let mut number = 0;
    cells(count, || {
        number += 1;
        (1 + number / side, 1 + number % side)
    })
}

/// Two crowds in opposite corners.
fn crowds(count: usize, size: usize, dice: &mut Dice) -> Vec<Pos> {
    let crowd = count.isqrt();
    cells(count, || {
        let (i, j) = (1 + dice.below(crowd), 1 + dice.below(crowd));
        if dice.below(2) == 0 { (i, j) } else { (size - 1 - i, size - 1 - j) }
    })
}

/// Cells along a diagonal.
fn diagonal(count: usize, size: usize, dice: &mut Dice) -> Vec<Pos> {
    cells(count, || {
        let i = 1 + dice.below(size - 2);
        (i, (i + dice.below(7)).clamp(4, size + 1) - 3)
    })
}

/// The target, with one agent in eight elsewhere.
fn nearly_formed(count: usize, size: usize, dice: &mut Dice) -> Vec<Pos> {
    let outline = target(u16::try_from(count).expect("few"));
    let mut formed = outline.iter().map(|at| at.plus(Pos::new(2, 2)));
    cells(count, || match formed.next().filter(|_| dice.below(8) > 0) {
        Some(at) => (at.i.unsigned_abs() as usize, at.j.unsigned_abs() as usize),
        None => (1 + dice.below(size - 2), 1 + dice.below(size - 2)),
    })
}

/// The layout of greatest effort that a search among drawn layouts has found.
fn hardest() -> Vec<Pos> {
    let cell = |line: &str| {
        let (i, j) = line.split_once(' ')?;
        Some(Pos::new(i.parse().ok()?, j.parse().ok()?))
    };
    include_str!("layouts/hard_256_256.txt")
        .lines()
        .map(|line| cell(line).expect("a row and a column"))
        .collect()
}

type Layout = fn(usize, usize, &mut Dice) -> Vec<Pos>;

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let layouts: [(&str, Layout); 5] = [
        ("random", random),
        ("corner", corner),
        ("crowds", crowds),
        ("diagonal", diagonal),
        ("nearly formed", nearly_formed),
    ];
    for (name, layout) in layouts {
        let mut group = criterion.benchmark_group(format!("distance/{name}"));
        group.sample_size(10);
        group.throughput(Throughput::Elements(LAYOUTS as u64));
        for (count, size) in SIZES {
            let mut dice = Dice(27);
            let target = target(u16::try_from(count).expect("few"));
            let all: Vec<_> = (0..LAYOUTS).map(|_| layout(count, size, &mut dice)).collect();
            let id = BenchmarkId::new(count.to_string(), format!("{size}x{size}"));
            group.bench_function(id, |bencher| {
                bencher.iter(|| all.iter().map(|agents| distance(agents, &target)).sum::<i32>());
            });
        }
        group.finish();
    }
    let (layout, target) = (hardest(), target(256));
    let mut group = criterion.benchmark_group("distance/hardest");
    group.sample_size(10);
    group.bench_function(BenchmarkId::new("256", "256x256"), |bencher| {
        bencher.iter(|| distance(&layout, &target));
    });
    group.finish();
    criterion.final_summary();
}
