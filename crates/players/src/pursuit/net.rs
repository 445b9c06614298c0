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

use swarmbench_engine::Pos;

use super::quarry::Whereabouts;
use crate::Seat;

/// The nets for a number of agents on a map of 10 × 10. A cell is its row and its column, one digit each. The
/// first net of a kind is the one for whoever does not see the whole map.
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

/// All nets for a game.
pub(super) struct Nets {
    even: Vec<Vec<Pos>>,
    odd: Vec<Vec<Pos>>,
    closed: Vec<Vec<Pos>>,
}

impl Nets {
    /// The nets for a seat's game, where there are some.
    pub(super) fn of(seat: &Seat) -> Option<Self> {
        if (seat.height, seat.width) != (10, 10) {
            return None;
        }
        let book = match seat.num_agents {
            8 => OF_8,
            9 => OF_9,
            10 => OF_10,
            11 => OF_11,
            12 => OF_12,
            13 => OF_13,
            14 => OF_14,
            15 => OF_15,
            16 => OF_16,
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
    let cells = net.split(' ').filter_map(|cell| cell.parse::<i32>().ok());
    cells.map(|cell| Pos::new(cell / 10, cell % 10)).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use swarmbench_engine::{AgentId, Config, Kind, Settings, TaskName};

    use super::super::field::Field;
    use super::super::quarry::Quarry;
    use super::*;

    fn nets(num_agents: i64) -> Option<Nets> {
        let settings = Settings { num_agents, ..Settings::standard(TaskName::Pursuit, 1) };
        Nets::of(&Seat::of(&Config::check(&settings).unwrap(), AgentId(0), 1))
    }

    #[test]
    fn every_net_has_a_post_for_everybody() {
        for num_agents in 8..=16 {
            let Some(nets) = nets(num_agents) else { continue };
            for net in nets.even.iter().chain(&nets.odd).chain(&nets.closed) {
                let posts: BTreeSet<Pos> = net.iter().copied().collect();
                assert_eq!(i64::try_from(posts.len()), Ok(num_agents), "{net:?}");
                assert!(posts.iter().all(|&post| Field::new(10, 10).is_inside(post)), "{net:?}");
            }
        }
        assert!(nets(12).is_some());
        assert!(nets(1).is_none());
    }

    #[test]
    fn a_new_prey_appears_in_a_trap() {
        for num_agents in 8..=16 {
            let Some(nets) = nets(num_agents) else { continue };
            let mut field = Field::new(10, 10);
            for &post in &nets.closed[0] {
                field.put(post, Some(Kind::Agent));
            }
            let share = Quarry::new(&field).share_trapped(&field);
            assert!(share > 0.995, "{share} with {num_agents} agents");
        }
    }
}
