//! Where the swarm stands to catch a prey that runs free, and to keep every corner closed.
//!
//! A *net* is one post for each agent. While all stand on their posts, where the prey goes depends on nothing but
//! where it is: it runs from cell to cell until it comes around in a circle. The nets below were found by
//! simulated annealing, such that nearly every such way leads over a cell on which the agents nearby can catch the
//! prey in one step; that two or three corners are closed then, so that the next prey appears in one of them; and
//! that they are not far from where a game begins. As a prey never changes between even and odd cells (row +
//! column), there are nets for either kind: few nets catch both.
//!
//! In a *closed* net corners are traps: two walls and two agents leave no gap, and the danger there
//! is less than anywhere else, so that is where a new prey appears, unless none of the hundred draws hits one of
//! the corners. With four of them that happens about once in three thousand rounds.
//!
//! On larger maps corners are more dangerous than the open ground in the middle, where no wall is near, so traps lie
//! there and take four agents. A net that is closed and catches whatever runs free was found for 30 agents on 15 × 15
//! cells alone. The other nets there catch, but only about every second new prey appears in a trap.

use swarmbench_engine::{Pos, RuleSet};

use super::quarry::Whereabouts;
use crate::Seat;

/// How many values a digit of a cell can have.
const BASE: u32 = 36;

/// The nets for a number of agents on a map of some size. A cell is its row and its column, one digit each (`a` is 10,
/// and so on). The first net of a kind is for agents that do not see the whole map.
struct Book {
    even: &'static [&'static str],
    odd: &'static [&'static str],
    closed: &'static str,
}

const OF_8: Book = Book {
    even: &["12 16 21 44 46 53 64 71", "12 21 44 45 46 71 75 82"],
    odd: &["12 21 44 58 61 64 81 84", "12 21 47 58 64 71 81 83"],
    closed: "12 17 21 28 55 71 77 82",
};

const OF_9: Book = Book {
    even: &["12 16 21 44 46 54 64 71 81", "34 43 44 54 66 71 75 82 84"],
    odd: &["12 21 45 46 47 55 67 71 82", "12 21 47 51 58 64 74 81 83"],
    closed: "12 17 21 28 55 65 71 77 82",
};

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

const NET_OF_20: &str = "14 19 22 24 26 4b 66 75 77 7d 81 86 88 97 9b a1 a2 b9 d1 d7";

const OF_20_ON_15: Book = Book {
    even: &[NET_OF_20],
    odd: &["21 23 27 29 32 38 49 61 67 76 78 82 87 8b 8d 92 a9 b8 c7 c9"],
    closed: NET_OF_20,
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

/// All nets for a game.
pub(super) struct Nets {
    even: Vec<Vec<Pos>>,
    odd: Vec<Vec<Pos>>,
    closed: Vec<Vec<Pos>>,
}

impl Nets {
    /// The nets for a seat's game, where there are some.
    pub(super) fn of(seat: &Seat) -> Option<Self> {
        // These were made for the way in which a prey flees under the rules `paper`; under the others some do worse
        // than to run after it.
        let is_large = seat.height > 10 || seat.width > 10;
        if seat.rules != RuleSet::Paper && (is_large || seat.num_agents == 8) {
            return None;
        }
        let book = match (seat.height, seat.width, seat.num_agents) {
            (10, 10, 8) => OF_8,
            (10, 10, 9) => OF_9,
            (10, 10, 10) => OF_10,
            (10, 10, 11) => OF_11,
            (10, 10, 12) => OF_12,
            (10, 10, 13) => OF_13,
            (10, 10, 14) => OF_14,
            (10, 10, 15) => OF_15,
            (10, 10, 16) => OF_16,
            (15, 15, 20) => OF_20_ON_15,
            (15, 15, 30) => OF_30_ON_15,
            (20, 20, 30) => OF_30_ON_20,
            _ => return None,
        };
        let all = |nets: &[&str]| nets.iter().copied().map(read).collect();
        Some(Self { even: all(book.even), odd: all(book.odd), closed: all(&[book.closed]) })
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

    /// Sizes of maps and swarms beside the standard map.
    const LARGE: [(i32, i64); 3] = [(15, 20), (15, 30), (20, 30)];

    #[test]
    fn every_net_has_a_post_for_everybody() {
        let sizes = (8..=16).map(|agents| (10, agents)).chain(LARGE);
        for (size, num_agents) in sizes {
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
        let sizes = (8..=16).map(|agents| (10, agents, 0.995));
        for (size, num_agents, least) in
            sizes.chain(LARGE.map(|(size, agents)| (size, agents, 0.7)))
        {
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
