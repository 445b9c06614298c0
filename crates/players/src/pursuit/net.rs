//! The nets: where the swarm stands to catch a prey that runs free, and to keep every corner closed.
//!
//! A *net* is one post for each agent. While all stand on their posts, the prey's next cell depends only on its current
//! one: it runs from cell to cell until it comes around in a circle. The nets below were found by simulated annealing,
//! such that nearly every such way leads over a cell on which the agents nearby can catch the prey in one step; that
//! two or three corners are closed then, so that the next prey appears in one of them; and that they are not far from
//! where a game begins. As a prey never changes between even and odd cells (row + column), there are nets for either
//! kind: few nets catch both.
//!
//! In a *closed* net corners are traps: two walls and two agents leave no gap, and the danger there is less than
//! anywhere else, so a new prey appears there unless none of the hundred draws hits one of the corners. With four of
//! them that happens about once in three thousand rounds.
//!
//! On larger maps corners are more dangerous than the open ground in the middle, where no wall is near, so traps lie
//! there. The only net found that is closed and also catches a prey that runs free is for 30 agents on 15 × 15 cells.
//! Other games have at most a closed net, and agents leave it to catch a prey that runs free (`stance.rs`).

use swarmbench_engine::{Pos, RuleSet};

use super::close_in::post_of;
use super::quarry::Whereabouts;
use crate::Seat;

/// Base of the digits of a cell.
const BASE: u32 = 36;

/// Maximum number of cells for each agent where the swarm goes after the prey: an agent can watch that many.
const CELLS_OF_EACH: u32 = 14;

/// Maximum number of agents that plan for each other in every round.
const HUNTERS_MAX: u32 = 30;

/// The nets for a number of agents on a map of some size. A cell is its row and its column, one digit each (`a` is 10,
/// and so on). The first net of a kind is for agents that do not see the whole map.
struct Book {
    even: &'static [&'static str],
    odd: &'static [&'static str],
    closed: &'static str,
}

const OF_10: Book = Book {
    even: &["12 17 21 44 46 54 71 75 82 83", "12 17 21 44 46 64 73 75 82 84"],
    odd: &["12 21 27 38 55 57 63 67 72 74", "12 16 21 38 47 55 67 72 83 85"],
    closed: "12 17 21 28 45 54 56 65 71 82",
};

const OF_11: Book = Book {
    even: &["12 15 21 28 45 46 54 62 75 81 82", "17 21 22 28 42 55 71 75 76 82 84"],
    odd: &["12 21 27 36 47 52 53 63 74 81 85", "12 21 27 38 52 56 65 67 71 83 85"],
    closed: "12 17 21 28 42 45 54 56 65 71 82",
};

const OF_12: Book = Book {
    even: &[
        "12 22 26 28 32 37 55 71 75 76 77 82",
        "12 17 21 24 26 28 55 64 71 77 82 84",
        "12 17 21 24 26 28 45 51 54 64 66 71",
        "12 13 17 21 28 42 54 64 66 71 74 84",
        "12 17 21 28 42 46 55 58 62 66 71 82",
        "12 17 21 24 26 28 53 64 71 77 84 86",
    ],
    odd: &[
        "12 21 27 34 38 56 65 67 71 75 82 85",
        "12 14 17 21 27 55 61 72 74 76 84 86",
        "12 17 21 25 28 41 47 56 62 67 71 82",
        "12 17 21 28 41 47 55 57 63 67 71 82",
        "12 21 27 28 31 47 56 61 72 74 75 85",
        "12 17 21 25 28 36 47 56 63 67 72 74",
    ],
    closed: "12 17 21 28 33 36 55 63 71 78 82 87",
};

const OF_13: Book = Book {
    even: &["12 15 21 22 28 45 46 47 48 51 66 71 82", "12 17 22 23 24 28 55 57 66 71 75 77 82"],
    odd: &["12 21 27 34 38 45 56 67 71 72 75 82 85", "12 17 21 25 28 41 47 52 56 63 67 74 81"],
    closed: "12 17 21 28 32 36 41 55 71 78 82 84 87",
};

const OF_14: Book = Book {
    even: &[
        "12 14 17 21 24 28 46 54 56 64 66 68 71 82",
        "12 18 21 22 26 37 42 55 57 66 71 75 77 82",
    ],
    odd: &[
        "12 17 21 28 33 34 43 47 56 63 67 71 82 85",
        "12 16 17 21 28 32 43 47 56 61 63 67 74 81",
    ],
    closed: "12 14 17 21 23 28 45 54 56 64 65 71 78 82",
};

const OF_15: Book = Book {
    even: &[
        "12 14 17 21 24 28 46 54 57 66 71 72 75 77 82",
        "12 14 17 21 24 28 57 61 65 66 71 75 77 82 83",
    ],
    odd: &[
        "12 14 17 21 25 28 41 46 48 56 63 67 71 75 82",
        "12 16 21 27 31 34 37 45 65 71 73 75 76 82 85",
    ],
    closed: "12 14 17 21 23 28 45 47 54 56 61 65 72 78 81",
};

const OF_16: Book = Book {
    even: &["12 13 17 21 26 28 33 36 51 57 66 71 72 75 77 82"],
    odd: &["12 14 17 21 23 27 28 47 51 56 63 65 67 71 74 82"],
    closed: "11 13 16 17 22 28 31 41 48 57 63 66 68 71 82 84",
};

const NET_OF_30: &str =
    "17 19 1b 1c 21 22 29 34 3d 41 52 53 59 61 6a 78 87 89 8d 92 98 ac b3 bc c7 c8 d3 d7 d9 da";

const OF_30_ON_15: Book = Book { even: &[NET_OF_30], odd: &[NET_OF_30], closed: NET_OF_30 };

const LARGE_NET_OF_30: &str =
    "19 1d 28 3b 45 47 4g 5a 5c 66 67 68 7c 7e 8g 92 a2 a8 b1 b3 b7 b9 bf c8 cg dd ee f7 gb h8";

const OF_30_ON_20: Book = Book {
    even: &[LARGE_NET_OF_30],
    odd: &[
        "11 1a 23 27 31 38 4b 56 5f 72 7e 7f 7g 83 92 98 a7 a9 b8 bc cc de e7 ed f5 fg g5 g7 gf id",
    ],
    closed: LARGE_NET_OF_30,
};

/// Closed nets alone, by rows, columns and agents. Agents leave them to go after a prey that runs free.
const CLOSED: &[((u16, u16, u16), &str)] = &[
    ((8, 8, 8), "12 15 21 26 51 56 62 65"),
    ((8, 8, 12), "12 14 16 21 23 25 32 36 41 51 62 66"),
    ((10, 10, 8), "12 17 21 28 55 71 77 82"),
    ((10, 10, 9), "12 17 21 28 55 65 71 77 82"),
    ((10, 10, 20), "12 17 21 23 28 32 35 36 41 46 57 61 68 72 73 75 78 81 83 87"),
    ((10, 10, 24), "12 14 16 18 21 23 24 27 32 35 38 41 42 61 63 65 66 67 71 72 76 78 82 87"),
    ((12, 12, 8), "12 21 57 66 68 75 77 86"),
    ((12, 12, 12), "12 16 17 21 56 65 67 74 76 78 85 87"),
    ((12, 12, 16), "13 19 2a 31 33 45 54 56 65 67 76 78 87 91 a2 a9"),
    ((12, 12, 20), "12 19 21 25 2a 39 41 44 56 65 67 74 76 78 85 87 91 99 a2 aa"),
    ((12, 12, 24), "12 15 17 19 21 22 26 2a 4a 51 55 57 5a 62 64 66 68 69 71 75 77 86 a1 a2"),
    (
        (12, 12, 30),
        "11 13 19 22 24 28 2a 31 34 39 43 44 46 47 5a 66 67 68 69 77 81 83 84 87 89 92 94 98 a1 a3",
    ),
    ((15, 15, 8), "27 67 76 78 82 87 ac b7"),
    ((15, 15, 12), "1c 36 46 55 57 66 7a 8c 96 a5 a7 b6"),
    ((15, 15, 16), "3c 47 56 58 65 67 6d 76 78 81 87 8b b6 b9 d3 d7"),
    ((15, 15, 20), "46 55 57 5a 64 66 69 6b 75 7a 85 93 9a a5 a9 ab b7 ba c3 c8"),
    ((15, 15, 24), "13 17 1c 2b 2d 4d 57 5d 61 66 68 6c 75 77 79 81 86 88 91 97 a1 c8 d7 db"),
];

/// All nets for a game.
#[derive(Clone)]
pub(super) struct Nets {
    even: Vec<Vec<Pos>>,
    odd: Vec<Vec<Pos>>,
    /// The closed net, in a list of one like the other kinds.
    closed: Vec<Vec<Pos>>,
    /// Posts that are spread evenly over the map.
    pub(super) watch: Vec<Pos>,
    /// True if the agents go after a prey that runs free instead of waiting for it in a net.
    pub(super) is_hunting: bool,
}

impl Nets {
    /// The nets for a seat's game; `None` if there are none.
    pub(super) fn of(seat: &Seat) -> Option<Self> {
        let book = book(seat)?;
        let posts = 0..i32::from(seat.num_agents);
        let watch: Vec<Pos> = posts.map(|number| post_of(number, seat)).collect();
        let all = |nets: &[&str]| nets.iter().copied().map(read).collect();
        let closed = if book.closed.is_empty() { watch.clone() } else { read(book.closed) };
        // The nets were made for the flight of a prey under the rules `paper`. Under `reference` it often stays where
        // it is, so some agents have to go there.
        let is_hunting = seat.rules == RuleSet::Reference || book.even.is_empty();
        let (even, odd) = (all(book.even), all(book.odd));
        Some(Self { even, odd, closed: vec![closed], watch, is_hunting })
    }

    /// The nets for a prey, at least one.
    pub(super) fn against(&self, prey: Whereabouts) -> &[Vec<Pos>] {
        match prey {
            Whereabouts::Even => &self.even,
            Whereabouts::Odd => &self.odd,
            Whereabouts::Trapped => &self.closed,
        }
    }
}

/// The nets of a game. They may be empty if the agents are close enough to go after the prey without any; `None` if
/// they are not.
fn book(seat: &Seat) -> Option<Book> {
    let size = (seat.height, seat.width, seat.num_agents);
    Some(match size {
        (10, 10, 10) => OF_10,
        (10, 10, 11) => OF_11,
        (10, 10, 12) => OF_12,
        (10, 10, 13) => OF_13,
        (10, 10, 14) => OF_14,
        (10, 10, 15) => OF_15,
        (10, 10, 16) => OF_16,
        (15, 15, 30) => OF_30_ON_15,
        (20, 20, 30) => OF_30_ON_20,
        _ => {
            let found = CLOSED.iter().find(|(of, _)| *of == size);
            let closed = found.map_or("", |(_, net)| *net);
            if closed.is_empty() && !is_close(seat) {
                return None;
            }
            Book { even: &[], odd: &[], closed }
        }
    })
}

/// True if agents that are spread over the map nearly see all of it, and are not too many for plans in each round.
fn is_close(seat: &Seat) -> bool {
    let inside = |cells: u16| u32::from(cells.saturating_sub(2));
    let (cells, agents) = (inside(seat.height) * inside(seat.width), u32::from(seat.num_agents));
    agents <= HUNTERS_MAX && cells <= CELLS_OF_EACH * agents
}

fn read(net: &str) -> Vec<Pos> {
    let cells = net.split(' ').filter_map(|cell| i32::from_str_radix(cell, BASE).ok());
    let base = BASE.cast_signed();
    cells.map(|cell| Pos::new(cell / base, cell % base)).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use swarmbench_engine::{AgentId, Config, Kind, Settings, TaskName};

    use super::super::field::Field;
    use super::super::quarry::Quarry;
    use super::*;

    fn nets(size: i64, num_agents: i64) -> Option<Nets> {
        let (width, height) = (size, size);
        let standard = Settings::standard(TaskName::Pursuit, 1);
        let settings = Settings { num_agents, width, height, ..standard };
        Nets::of(&Seat::of(&Config::check(&settings).unwrap(), AgentId(0), 1))
    }

    /// The square maps and the swarms for which there are nets, with the least share of new preys that appear in a
    /// trap.
    fn sizes() -> impl Iterator<Item = (i32, i64, f64)> {
        let catching = (10..=16).map(|agents| (10, agents, 0.995));
        let closed = CLOSED.iter().map(|((height, _, agents), _)| {
            let is_standard = *height == 10;
            (i32::from(*height), i64::from(*agents), if is_standard { 0.995 } else { 0.7 })
        });
        catching.chain([(15, 30, 0.7), (20, 30, 0.7)]).chain(closed)
    }

    #[test]
    fn every_net_has_a_post_for_everybody() {
        for (size, num_agents, _) in sizes() {
            let nets = nets(size.into(), num_agents).expect("there are nets");
            let field = Field::new(size, size);
            for net in nets.even.iter().chain(&nets.odd).chain(&nets.closed) {
                let posts: BTreeSet<Pos> = net.iter().copied().collect();
                assert_eq!(i64::try_from(posts.len()), Ok(num_agents), "{net:?}");
                assert!(posts.iter().all(|&post| field.is_inside(post)), "{net:?}");
            }
        }
        assert!(nets(10, 1).is_none());
    }

    #[test]
    fn a_new_prey_appears_in_a_trap() {
        for (size, num_agents, least) in sizes() {
            let nets = nets(size.into(), num_agents).expect("there are nets");
            let mut field = Field::new(size, size);
            for &post in &nets.closed[0] {
                field.put(post, Some(Kind::Agent));
            }
            let share = Quarry::new(&field).share_trapped(&field);
            assert!(share > least, "{share} with {num_agents} agents on {size} x {size}");
        }
    }
}
