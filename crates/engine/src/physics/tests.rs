//! Small situations as drawings. Each is played as drawn and, if all push left or right, again with rows and columns
//! exchanged, with both solvers.
//!
//! `>`, `<`, `^`, `v`: an agent that pushes this way; `o`: an agent that rests; `W`: the wall;
//! `B`: a block of mass 5; `.`: nothing. Outside the drawing is free ground.

use super::{Scratch, Solver, resolve};
use crate::body::{Board, Body, Kind};
use crate::grid::{Direction, Pos};

struct Situation {
    says: &'static str,
    before: &'static [&'static str],
    after: &'static [&'static str],
}

const fn situation(
    says: &'static str,
    before: &'static [&'static str],
    after: &'static [&'static str],
) -> Situation {
    Situation { says, before, after }
}

const SITUATIONS: &[Situation] = &[
    situation("an agent moves to a free cell", &[">."], &[".>"]),
    situation("an agent at rest stays", &["o."], &["o."]),
    situation("the wall stays", &[">W."], &[">W."]),
    situation("an agent pushes one agent: 2 = 1 + 1", &[">o.."], &[".>o."]),
    situation("an agent does not push two: 2 < 1 + 1 + 1", &[">oo."], &[">oo."]),
    situation("two push two", &[">>oo."], &[".>>oo"]),
    situation("two do not push three", &[">>ooo."], &[">>ooo."]),
    situation("force passes through agents at rest", &[">>o>oo.."], &[".>>o>oo."]),
    situation("a chain that lacks force is left by those in front", &[">oo>."], &[">oo.>"]),
    situation("force comes from behind only", &["o>."], &["o.>"]),
    situation("nothing moves against the wall", &[">>>oW."], &[">>>oW."]),
    situation("pushers move behind each other", &[">>>."], &[".>>>"]),
    situation("one against one", &[".><."], &[".><."]),
    situation("two against one: a push back weighs 2", &[".>><.."], &[".>><.."]),
    situation("three against one", &[".>>><.."], &["..>>><."]),
    situation("three against two", &["..>>><<.."], &["..>>><<.."]),
    situation("left comes before right: who moves left wins the cell", &[">.<"], &["><."]),
    situation("what left has opened, right can enter", &[".<>."], &["<..>"]),
    situation("an agent leaves over the edge", &["..>"], &["..."]),
    situation("an agent is pushed over the edge", &["..>o"], &["...>"]),
    situation("who has left is pushed no more", &["<o"], &[".o"]),
    situation(
        "up comes before right: the cell is free by then",
        &[
            "..", //
            ">^",
        ],
        &[
            ".^", //
            ".>",
        ],
    ),
    situation(
        "down comes before left, so the way is closed",
        &[
            "Wv.", //
            "W.<",
        ],
        &[
            "W..", //
            "Wv<",
        ],
    ),
    situation(
        "a push across adds nothing",
        &[
            "WWWWW", //
            ">^oo.",
        ],
        &[
            "WWWWW", //
            ">^oo.",
        ],
    ),
    situation(
        "five agents push the block: 10 = 5 + 5",
        &[
            ">B.", //
            ">B.", //
            ">B.", //
            ">B.", //
            ">B.",
        ],
        &[
            ".>B", //
            ".>B", //
            ".>B", //
            ".>B", //
            ".>B",
        ],
    ),
    situation(
        "four agents do not",
        &[
            ">B.", //
            ">B.", //
            ">B.", //
            ">B.", //
            "oB.",
        ],
        &[
            ">B.", //
            ">B.", //
            ">B.", //
            ">B.", //
            "oB.",
        ],
    ),
    situation(
        "five in two rows do",
        &[
            ">>>B.", //
            ".>>B.",
        ],
        &[
            ".>>>B", //
            "..>>B",
        ],
    ),
    situation(
        "an agent in front costs a sixth",
        &[
            ">>>B..", //
            ".>>Bo.",
        ],
        &[
            ">>>B..", //
            ".>>Bo.",
        ],
    ),
    situation(
        "a sixth behind pays for it",
        &[
            ">>>B..", //
            ">>>Bo.",
        ],
        &[
            ".>>>B.", //
            ".>>>Bo",
        ],
    ),
    situation(
        "one agent against the block costs three more",
        &[
            ">>>>B<.", //
            ".>>>B..",
        ],
        &[
            ">>>>B<.", //
            ".>>>B..",
        ],
    ),
    situation(
        "eight overcome it",
        &[
            ">>>>B<.", //
            ">>>>B..",
        ],
        &[
            ".>>>>B<", //
            ".>>>>B.",
        ],
    ),
    situation(
        "a block that is held passes no force on",
        &[
            ">>>>Bo.", //
            ">>>>BW.",
        ],
        &[
            ">>>>Bo.", //
            ">>>>BW.",
        ],
    ),
    situation(
        "who pushes in front of a held block goes on alone",
        &[
            ">>>>B>.", //
            ">>>>BW.",
        ],
        &[
            ">>>>B.>", //
            ">>>>BW.",
        ],
    ),
    situation(
        "a block held through an agent stays",
        &[
            ">>>>B..", //
            ">>>>BoW",
        ],
        &[
            ">>>>B..", //
            ">>>>BoW",
        ],
    ),
    situation(
        "the agent in front of the block falls over the edge",
        &[
            ">>>>B.", //
            ">>>>Bo",
        ],
        &[
            ".>>>>B", //
            ".>>>>B",
        ],
    ),
    situation(
        "an agent in the notch moves with the block, or not at all",
        &[
            ".BBB.", //
            ".B>B.", //
            ".BBB.",
        ],
        &[
            ".BBB.", //
            ".B>B.", //
            ".BBB.",
        ],
    ),
    situation(
        "agents in the notches and behind add up: 5 + 3 = 4 + 4",
        &[
            ">BBBBB.", //
            ">B>oBB.", //
            ">BBBBB.", //
            ">B>BBB.", //
            "..BBBB.",
        ],
        &[
            ".>BBBBB", //
            ".>B>oBB", //
            ".>BBBBB", //
            ".>B>BBB", //
            "...BBBB",
        ],
    ),
    situation(
        "with one less behind the ring stays",
        &[
            ">BBBBB.", //
            ">B>oBB.", //
            ">BBBBB.", //
            "oB>BBB.", //
            "..BBBB.",
        ],
        &[
            ">BBBBB.", //
            ">B>oBB.", //
            ">BBBBB.", //
            "oB>BBB.", //
            "..BBBB.",
        ],
    ),
    situation(
        "pushes within a ring cancel out",
        &[
            ".>>BBBB.", //
            ".>>B><B.", //
            "...BBBB.",
        ],
        &[
            ".>>BBBB.", //
            ".>>B><B.", //
            "...BBBB.",
        ],
    ),
    situation(
        "a block that hangs over the edge is pushed all the same",
        &[
            ">>>>BBBB", //
            "..>BBBBB",
        ],
        &[
            ".>>>>BBB", //
            "...>BBBB",
        ],
    ),
    situation(
        "seven push the block and two in front of it",
        &[
            ">>>>B.", //
            ".>>>Bo", //
            "....Bo",
        ],
        &[
            ".>>>>B", //
            "..>>>B", //
            ".....B",
        ],
    ),
    situation(
        "but not the block and three: force is not spent twice",
        &[
            "....Bo.", //
            ">>>>Bo.", //
            ".>>>Bo.",
        ],
        &[
            "....Bo.", //
            ">>>>Bo.", //
            ".>>>Bo.",
        ],
    ),
];

#[test]
fn situations_end_as_drawn() {
    for Situation { says, before, after } in SITUATIONS {
        for solver in [Solver::Flow, Solver::Ilp] {
            let rows = |drawing: &[&str]| -> Vec<String> {
                drawing.iter().map(|&row| row.to_owned()).collect()
            };
            assert_eq!(played(&rows(before), solver), rows(after), "{says}, by {solver:?}");
            if !before.concat().contains(['^', 'v']) {
                let (before, after) = (exchanged(before), exchanged(after));
                assert_eq!(played(&before, solver), after, "{says}, exchanged, by {solver:?}");
            }
        }
    }
}

/// Exchanges rows and columns of a drawing without pushes up and down. The order of the passes stays the same: up comes
/// before down, as left comes before right.
fn exchanged(drawing: &[&str]) -> Vec<String> {
    let at = |i: usize, j: usize| match drawing[i].as_bytes()[j] {
        b'<' => '^',
        b'>' => 'v',
        other => other.into(),
    };
    (0..drawing[0].len()).map(|j| (0..drawing.len()).map(|i| at(i, j)).collect()).collect()
}

/// The drawing after one round.
fn played(drawing: &[String], solver: Solver) -> Vec<String> {
    let symbols: Vec<(Pos, char)> = (drawing.iter().zip(0..))
        .flat_map(|(row, i)| row.chars().zip(0..).map(move |(c, j)| (Pos::new(i, j), c)))
        .collect();
    let all = |kind: char| -> Vec<Pos> {
        symbols.iter().filter(|(_, c)| *c == kind).map(|(at, _)| *at).collect()
    };
    let agents: Vec<(Pos, char)> =
        symbols.iter().copied().filter(|(_, c)| "><^vo".contains(*c)).collect();
    let (last, _) = symbols[symbols.len() - 1];
    let mut board = Board::new(last.i + 1, last.j + 1, agents.len());
    for (agent, &(at, _)) in agents.iter().enumerate() {
        board.place_agent(agent, at);
    }
    if !all('W').is_empty() {
        board.place(Body::of_cells(Kind::Wall, Pos::new(0, 0), all('W'), true));
    }
    if !all('B').is_empty() {
        let block = Body::of_cells(Kind::Block, Pos::new(0, 0), all('B'), false);
        board.place(Body { mass: 5, ..block });
    }
    let wishes: Vec<_> = agents
        .iter()
        .map(|(_, c)| match c {
            '^' => Some(Direction::Up),
            'v' => Some(Direction::Down),
            '<' => Some(Direction::Left),
            '>' => Some(Direction::Right),
            _ => None,
        })
        .collect();
    resolve(&mut board, &wishes, solver, &mut Scratch::default()).expect("solved");
    let symbol = |at: Pos| match board.grid().get(at) {
        None => '.',
        Some(id) => match board.body(id).kind() {
            Kind::Wall => 'W',
            Kind::Block => 'B',
            _ => agents[id.index()].1,
        },
    };
    let row = |i| (0..=last.j).map(|j| symbol(Pos::new(i, j))).collect();
    (0..=last.i).map(row).collect()
}
