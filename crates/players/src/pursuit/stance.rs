//! Stances: how agents stand around a prey that runs free where no net waits for it. The prey knows how many agents are
//! near, not where they are: it runs between them if there are fewer than elsewhere. So four agents with a way in
//! between them catch it when it comes, possibly only if they wait a move or two ahead of it.

use swarmbench_engine::Pos;

use super::field::Field;
use super::scene::Scene;

/// Positions of four agents around one of the prey's next cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stance {
    /// Offsets from the prey's cell in rows and columns.
    around: [(i32, i32); 4],
    /// Number of moves of the prey until it reaches that cell.
    ahead: u32,
}

const BESIDE: [(i32, i32); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];
const ACROSS: [(i32, i32); 4] = [(-1, -1), (1, 1), (1, -1), (-1, 1)];
const AWAY: [(i32, i32); 4] = [(-2, 0), (2, 0), (0, -2), (0, 2)];

/// All stances that are tried. If none catches the prey soon, the first two are taken in turn.
pub(super) const STANCES: [Stance; 7] = [
    Stance { around: BESIDE, ahead: 0 },
    Stance { around: BESIDE, ahead: 1 },
    Stance { around: BESIDE, ahead: 2 },
    Stance { around: ACROSS, ahead: 0 },
    Stance { around: ACROSS, ahead: 1 },
    Stance { around: ACROSS, ahead: 2 },
    Stance { around: AWAY, ahead: 0 },
];

impl Stance {
    /// The posts of a net, with those nearest to the prey moved to this stance.
    pub(super) fn posts(&self, scene: &Scene, bare: &Field, net: &[Pos]) -> Vec<Pos> {
        let Some(cell) = self.cell(scene, bare) else { return net.to_vec() };
        let around = self.around.map(|(i, j)| Pos::new(cell.i + i, cell.j + j));
        let around: Vec<Pos> = around.into_iter().filter(|&post| bare.is_inside(post)).collect();
        let mut posts: Vec<Pos> =
            net.iter().copied().filter(|post| !around.contains(post)).collect();
        // The nearest posts come first and are dropped.
        posts.sort_by_key(|post| (post.i - cell.i).pow(2) + (post.j - cell.j).pow(2));
        let kept = net.len().saturating_sub(around.len());
        posts.drain(..posts.len().saturating_sub(kept));
        posts.extend(around);
        posts
    }

    /// The cell that the prey will have reached if no agent moves.
    fn cell(&self, scene: &Scene, bare: &Field) -> Option<Pos> {
        let still = Scene { prey: None, ..scene.clone() }.field(bare);
        let flee = |at, _| still.after_flight(scene.rules, at).unwrap_or(at);
        scene.prey.map(|prey| (0..self.ahead).fold(prey, flee))
    }
}
