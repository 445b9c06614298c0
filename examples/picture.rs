//! Draws the picture of the README: a game of Transport, played by the built-in player.
//!
//! `cargo run --example picture > docs/episode.svg`

use std::fmt::Write;
use std::sync::Arc;

use swarmbench_engine::{Config, Settings, SpectatorView, TaskName};
use swarmbench_players::default_for;
use swarmbench_players::game::Game;

const CELL: usize = 16;
const GAP: usize = 24;

fn main() {
    let task = TaskName::Transport;
    let config = Config::check(&Settings::standard(task, 27)).expect("the standard setting");
    let mut game = Game::new(Arc::new(config), default_for(task), 1);
    let mut moments = vec![game.world().spectator_view()];
    while !game.world().is_over() {
        let acts = game.decide();
        game.step(&acts);
        moments.push(game.world().spectator_view());
    }
    let last = moments.len() - 1;
    let shown = [0, last / 3, 2 * last / 3, last].map(|round| &moments[round]);
    print!("{}", picture(&shown));
}

fn picture(moments: &[&SpectatorView]) -> String {
    let side = 10 * CELL;
    let width = moments.len() * (side + GAP) + GAP;
    let height = side + 2 * GAP + 16;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"9\" text-anchor=\"middle\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
    );
    for (n, moment) in moments.iter().enumerate() {
        let left = GAP + n * (side + GAP);
        writeln!(svg, "<g transform=\"translate({left} {GAP})\">").expect("a string");
        draw(&mut svg, moment);
        writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" font-size=\"12\">round {}, score {:.2}</text>\n</g>",
            side / 2,
            side + 18,
            moment.round,
            moment.score
        )
        .expect("a string");
    }
    svg.push_str("</svg>\n");
    svg
}

fn draw(svg: &mut String, moment: &SpectatorView) {
    for (i, row) in moment.grid.iter().enumerate() {
        for (j, symbol) in row.chars().enumerate() {
            let color = match symbol {
                'W' => "#4a4a4a",
                'B' => "#c8893a",
                _ => "#f2f0ea",
            };
            writeln!(
                svg,
                "<rect x=\"{}\" y=\"{}\" width=\"{CELL}\" height=\"{CELL}\" fill=\"{color}\" stroke=\"#ffffff\"/>",
                j * CELL,
                i * CELL
            )
            .expect("a string");
        }
    }
    for state in moment.agents.iter().filter(|state| state.alive) {
        let center = |at: i32| usize::try_from(at).expect("on the map") * CELL + CELL / 2;
        let (x, y) = (center(state.at.j), center(state.at.i));
        writeln!(
            svg,
            "<circle cx=\"{x}\" cy=\"{y}\" r=\"7\" fill=\"#2f6db5\"/>\
             <text x=\"{x}\" y=\"{}\" fill=\"#ffffff\">{}</text>",
            y + 3,
            state.agent.0
        )
        .expect("a string");
    }
}
