//! Where the swarm stands.

use swarmbench_engine::Pos;

use super::quarry::Whereabouts;
use crate::Seat;

/// Posts for every agent, one net for each parity of the prey.
pub(super) struct Nets {
    nets: [Vec<Pos>; 3],
}

/// By row, `A` is a post.
const EVEN: [&str; 8] = [
    ".A....A.", "A..A.A.A", "........", "........", "....A...", "...A....", "A.....A.", ".A.A....",
];

const ODD: [&str; 8] = [
    ".A......", "A.....A.", "...A...A", "........", ".....A..", "....A.A.", "A...A...", ".A..A...",
];

const FARM: [&str; 8] = [
    ".A....A.", "A......A", "..A..A..", "........", "....A...", "..A.....", "A......A", ".A....A.",
];

impl Nets {
    /// The nets for a seat's game, where there are some.
    pub(super) fn of(seat: &Seat) -> Option<Self> {
        if (seat.height, seat.width, seat.num_agents) != (10, 10, 12) {
            return None;
        }
        Some(Self { nets: [read(EVEN), read(ODD), read(FARM)] })
    }

    /// The posts against a prey on odd cells, or on even ones.
    pub(super) fn against(&self, prey: Whereabouts) -> &[Pos] {
        &self.nets[match prey {
            Whereabouts::Even => 0,
            Whereabouts::Odd => 1,
            Whereabouts::Trapped => 2,
        }]
    }
}

fn read(rows: [&'static str; 8]) -> Vec<Pos> {
    let row = |(i, row): (i32, &'static str)| {
        (1..).zip(row.chars()).filter(|(_, sign)| *sign == 'A').map(move |(j, _)| Pos::new(i, j))
    };
    (1..).zip(rows).flat_map(row).collect()
}
