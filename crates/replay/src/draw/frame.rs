//! Frames of a game: the map with the agents' choices, and beside it the score, counts, messages and windows.
//!
//! Frame `s` shows state `s` with the choices of round `s` and the messages sent in it. The last state has neither.

use swarmbench_analysis::Counts;
use swarmbench_engine::{Act, Action, Direction, Seen, View, World};

use super::font;
use super::palette::{AXIS, Color, GROUND, INK, MUTED, PAPER, RULE};
use super::scale::{HEADING, LABEL, MARGIN, Scale, TITLE, number, range, real};
use super::scene::{Anchor, Area, Paint, Point, Scene};

/// The longest side of a frame of a replay, in pixels.
pub const FRAME_SIDE_MAX: f64 = 4096.0;

/// The maximum number of lines of messages below a map.
pub const MESSAGE_LINES_MAX: usize = 24;

/// A state of a game, and the decisions in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Moment {
    /// The number of resolved rounds.
    pub round: u32,
    /// The score so far.
    pub score: f64,
    /// Rows of the map, a character for each cell, `A` for agents.
    pub grid: Vec<String>,
    /// All agents in the order of their numbers.
    pub agents: Vec<Agent>,
    /// The messages sent in this round.
    pub messages: Vec<Said>,
    /// The counts of this round; `None` in the last state.
    pub counts: Option<Counts>,
    /// The window of each agent on the map, if asked for.
    pub windows: Vec<(u16, View)>,
}

/// An agent in a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agent {
    /// The number of the agent.
    pub number: u16,
    /// The row and the column; `None` once the agent has escaped.
    pub at: Option<(i32, i32)>,
    /// True if the agent's light is on (Synchronization).
    pub light_on: Option<bool>,
    /// True if the agent carries food (Foraging).
    pub carries: bool,
    /// The choice; `None` in the last state and for an agent that has escaped.
    pub choice: Option<Choice>,
}

/// The choice of an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choice {
    /// No action: the agent only spoke, its answer could not be read, or its clock expired.
    Nothing,
    /// To stay.
    Stay,
    /// To switch its light.
    Switch,
    /// To move.
    Move {
        /// The chosen direction.
        toward: Direction,
        /// True if the agent did not advance in that direction.
        blocked: bool,
    },
}

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    /// The number of the agent that sent it.
    pub from: u16,
    /// The number of the only receiver, if there is one.
    pub to: Option<u16>,
    /// The text.
    pub text: String,
}

impl Moment {
    /// A state before its decisions, with the agents' windows if `windows` is set.
    #[must_use]
    pub fn of(world: &World, windows: bool) -> Self {
        let view = world.spectator_view();
        let agents = view.agents.iter().map(|state| Agent {
            number: state.agent.0,
            at: state.alive.then_some((state.at.i, state.at.j)),
            light_on: state.light_on,
            carries: state.carrying_food == Some(true),
            choice: None,
        });
        let seen = |agent| world.observe(agent).view;
        let living = world.agents().filter(|&agent| windows && world.is_alive(agent));
        Self {
            round: view.round,
            score: view.score,
            agents: agents.collect(),
            messages: Vec::new(),
            counts: None,
            windows: living.filter_map(|agent| Some((agent.0, seen(agent)?))).collect(),
            grid: view.grid,
        }
    }

    /// Adds the decisions: the acts by the numbers of the agents, the state after them, and the counts of that state.
    pub fn decided(&mut self, acts: &[(u16, Act)], after: &World, counts: Counts) {
        self.counts = Some(counts);
        let states: Vec<_> = after.agent_states().collect();
        for (number, act) in acts {
            let place = usize::from(*number);
            if let (Some(agent), Some(state)) = (self.agents.get_mut(place), states.get(place)) {
                let to = (state.at.i, state.at.j);
                agent.choice = agent.at.map(|from| Choice::of(act.action, from, to));
            }
            if let Some(message) = &act.message {
                self.messages.push(Said {
                    from: *number,
                    to: act.to.map(|to| to.0),
                    text: message.as_str().to_owned(),
                });
            }
        }
    }
}

impl Choice {
    fn of(action: Option<Action>, from: (i32, i32), to: (i32, i32)) -> Self {
        match action {
            None => Self::Nothing,
            Some(Action::Stay) => Self::Stay,
            Some(Action::Switch) => Self::Switch,
            Some(action @ (Action::Up | Action::Down | Action::Left | Action::Right)) => {
                let toward = action.direction().expect("a move has a direction");
                let (i, j) = toward.offset();
                // A push may carry an agent further or aside; any advance in its direction counts as a move.
                let blocked = (to.0 - from.0) * i + (to.1 - from.1) * j <= 0;
                Self::Move { toward, blocked }
            }
        }
    }
}

/// Rows and columns of a map.
pub(super) fn size(moment: &Moment) -> (usize, usize) {
    (moment.grid.len(), moment.grid.first().map_or(0, |row| row.chars().count()))
}

/// Wraps messages into lines of a width, at most [`MESSAGE_LINES_MAX`].
pub(super) fn message_lines(messages: &[Said], room: f64) -> Vec<String> {
    let mut lines = Vec::new();
    for (shown, said) in messages.iter().enumerate() {
        let to = said.to.map_or_else(String::new, |to| format!(" to {to}"));
        let text =
            swarmbench_protocol::names::printable(&format!("{}{to}: {}", said.from, said.text));
        let wrapped = font::wrap(&text, LABEL, room);
        if lines.len() + wrapped.len() >= MESSAGE_LINES_MAX && shown + 1 < messages.len() {
            lines.push(format!("… and {} more messages", messages.len() - shown));
            return lines;
        }
        lines.extend(wrapped);
    }
    lines
}

/// Facts that all frames of a replay share.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// The task.
    pub task: String,
    /// The name of the player.
    pub model: String,
    /// Rows and columns of the map.
    pub map: (usize, usize),
    /// The number of agents.
    pub agents: usize,
    /// Rows and columns of a window.
    pub window: (usize, usize),
    /// The maximum number of rounds.
    pub max_round: u32,
    /// The range of the scores of the game, 0 included.
    pub scores: (f64, f64),
}

/// Options of the frames of a replay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shown {
    /// Pixels along a side of a cell; by default the map gets a side of about 400 pixels.
    pub cell: Option<u16>,
    /// True if messages stand below the map.
    pub messages: bool,
    /// True if the windows of all agents stand below the map.
    pub views: bool,
    /// True if a frame ends below its last message. Otherwise all frames have the same size, as a film requires.
    pub cut: bool,
}

/// A frame would be too large.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "a frame of {width:.0} × {height:.0} pixels has a side longer than the limit frame_side_max = {FRAME_SIDE_MAX:.0}: \
     take a smaller --scale, or leave out --views and --messages"
)]
pub struct TooLarge {
    width: f64,
    height: f64,
}

/// Lays out the frames of a replay.
#[derive(Clone, Debug)]
pub struct Layout {
    stage: Stage,
    shown: Shown,
    cell: f64,
    map: Area,
    views: Area,
    messages: Area,
    width: f64,
    height: f64,
    past: Past,
}

/// The data of the curves: all states so far.
#[derive(Clone, Debug, Default)]
struct Past {
    first: u32,
    scores: Vec<f64>,
    counts: Vec<Counts>,
}

/// The small panels below the score.
const PANELS: [&str; 3] = ["Messages", "Standing still", "Pushes"];

const fn of_panels(counts: &Counts) -> [u32; 3] {
    [counts.messages, counts.still(), counts.pushes]
}

const SIDE: f64 = 236.0;
/// The height of everything beside the map.
const SIDE_HEIGHT: f64 = 344.0;
const LINE: f64 = 14.0;
const VIEW_GAP: f64 = 8.0;

impl Layout {
    /// Lays out all frames of a replay.
    ///
    /// # Errors
    /// If a frame would have a side longer than [`FRAME_SIDE_MAX`].
    pub fn new(stage: Stage, shown: Shown) -> Result<Self, TooLarge> {
        let (rows, columns) = stage.map;
        let fitting = (400.0 / real(rows.max(columns).max(1))).floor().clamp(4.0, 32.0);
        let cell = shown.cell.map_or(fitting, f64::from);
        let map = Area::new(MARGIN, MARGIN, real(columns) * cell, real(rows) * cell);
        let width = map.right() + MARGIN + SIDE + MARGIN;
        let room = width - 2.0 * MARGIN;
        let mut bottom = map.bottom().max(MARGIN + SIDE_HEIGHT) + MARGIN;
        let mut below = |height: f64| {
            let area = Area::new(MARGIN, bottom, room, height);
            bottom += if height > 0.0 { height + MARGIN } else { 0.0 };
            area
        };
        let mut views = 0.0;
        if shown.views {
            let (across, _, high) = view_grid(&stage, room);
            views = real(stage.agents.div_ceil(across)) * high;
        }
        let views = below(views);
        let lines = (2 * stage.agents).min(MESSAGE_LINES_MAX);
        let messages = below(if shown.messages { real(lines) * LINE } else { 0.0 });
        let height = bottom;
        if width > FRAME_SIDE_MAX || height > FRAME_SIDE_MAX {
            return Err(TooLarge { width, height });
        }
        let past = Past::default();
        Ok(Self { stage, shown, cell, map, views, messages, width, height, past })
    }

    /// The number of pixels of a frame.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limited sides")]
    pub fn pixels(&self) -> u64 {
        (self.width * self.height) as u64
    }

    /// Adds a state to the curves without drawing a frame.
    pub fn skip(&mut self, moment: &Moment) {
        self.past.add(moment);
    }

    /// Draws the next frame.
    pub fn frame(&mut self, moment: &Moment) -> Scene {
        self.past.add(moment);
        let Stage { task, model, .. } = &self.stage;
        let title = format!("{task}, {model}, round {}", moment.round);
        let mut scene = Scene::new(self.width, self.height, &title);
        draw_map(&mut scene, (self.map.x, self.map.y), self.cell, moment);
        self.beside(&mut scene, moment);
        if self.shown.views {
            self.draw_views(&mut scene, moment);
        }
        if self.shown.messages {
            let lines = message_lines(&moment.messages, self.messages.width);
            if self.shown.cut {
                let end = if lines.is_empty() { 0.0 } else { real(lines.len()) * LINE + MARGIN };
                scene.height = self.messages.y + end;
            }
            for (number, line) in lines.iter().enumerate() {
                let at = (self.messages.x, self.messages.y + (real(number) + 0.8) * LINE);
                scene.text(at, Anchor::Start, LABEL, INK, line);
            }
        }
        scene
    }

    fn beside(&self, scene: &mut Scene, moment: &Moment) {
        let x = self.map.right() + MARGIN;
        let mut y = MARGIN + 12.0;
        let Stage { task, model, agents, max_round, scores, .. } = &self.stage;
        scene.text_within((x, y), SIDE, (Anchor::Start, TITLE, INK), task);
        y += 17.0;
        scene.text_within((x, y), SIDE, (Anchor::Start, HEADING, MUTED), model);
        y += 22.0;
        let on_map = moment.agents.iter().filter(|agent| agent.at.is_some()).count();
        let left = agents - on_map.min(*agents);
        let round = format!("Round {} of {max_round}", moment.round);
        scene.text((x, y), Anchor::Start, HEADING, INK, &round);
        let left = if left > 0 {
            format!("{on_map} agents, {left} left")
        } else {
            format!("{on_map} agents")
        };
        scene.text((x + SIDE, y), Anchor::End, LABEL, MUTED, &left);
        y += 14.0;
        let mut panel = |name: &str, now: &str, values: &[f64], range, height| {
            y += 14.0;
            scene.text((x, y), Anchor::Start, LABEL, MUTED, name);
            scene.text((x + SIDE, y), Anchor::End, HEADING, INK, now);
            let area = Area::new(x, (y + 5.0).round(), SIDE, height);
            curve(scene, area, values, (self.past.first, *max_round), range);
            y += height + 8.0;
        };
        let range = range([scores.0, scores.1]);
        panel("Score", &number(moment.score), &self.past.scores, range, 84.0);
        for (place, name) in PANELS.into_iter().enumerate() {
            let values: Vec<f64> = (self.past.counts.iter())
                .map(|counts| f64::from(of_panels(counts)[place]))
                .collect();
            let now = moment.counts.map(|counts| of_panels(&counts)[place].to_string());
            panel(name, now.as_deref().unwrap_or("–"), &values, (0.0, real(*agents)), 34.0);
        }
    }

    fn draw_views(&self, scene: &mut Scene, moment: &Moment) {
        let (across, wide, high) = view_grid(&self.stage, self.views.width);
        let cell = view_cell(&self.stage);
        for (number, view) in &moment.windows {
            let place = usize::from(*number);
            let x = self.views.x + real(place % across) * wide;
            let y = self.views.y + real(place / across) * high;
            scene.text((x, y + 10.0), Anchor::Start, LABEL, INK, &number.to_string());
            for (i, row) in view.rows().enumerate() {
                for (j, seen) in row.iter().enumerate() {
                    let at = (x + real(j) * cell, y + 14.0 + real(i) * cell);
                    draw_seen(scene, at, cell, *seen);
                }
            }
        }
    }
}

impl Past {
    fn add(&mut self, moment: &Moment) {
        if self.scores.is_empty() {
            self.first = moment.round;
        }
        self.scores.push(moment.score);
        self.counts.extend(moment.counts);
    }
}

/// The number of windows side by side, and the width and height of one with its margins.
fn view_grid(stage: &Stage, room: f64) -> (usize, f64, f64) {
    let cell = view_cell(stage);
    let wide = real(stage.window.1).mul_add(cell, VIEW_GAP);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    let across = ((room / wide).floor() as usize).max(1);
    (across, wide, real(stage.window.0).mul_add(cell, 14.0 + VIEW_GAP))
}

fn view_cell(stage: &Stage) -> f64 {
    (70.0 / real(stage.window.0.max(stage.window.1).max(1))).floor().clamp(2.0, 14.0)
}

/// Draws a curve up to now, in a box.
fn curve(
    scene: &mut Scene,
    area: Area,
    values: &[f64],
    (first, rounds): (u32, u32),
    range: (f64, f64),
) {
    scene.rect(area, Paint::fill(GROUND));
    for (value, base) in [(range.1, area.y + 9.0), (range.0, area.bottom() - 2.0)] {
        scene.text((area.right() - 3.0, base), Anchor::End, LABEL - 1.0, MUTED, &number(value));
    }
    let room = Area { width: area.width - 24.0, ..area };
    let x = Scale::new((0.0, f64::from(rounds)), room.x, room.right());
    let y = Scale::new(range, area.bottom() - 2.0, area.y + 2.0);
    // More points than pixels would not be visible.
    let step = (values.len() / 500).max(1);
    let point = |place: usize| (x.within(real(place) + f64::from(first)), y.within(values[place]));
    let mut points: Vec<Point> = (0..values.len()).step_by(step).map(point).collect();
    let Some(last) = values.len().checked_sub(1).map(point) else { return };
    points.push(last);
    scene.path(points, Paint::line(Color::BLUE, 1.4));
    scene.circle(last, 2.5, Paint::fill(INK));
}

/// Draws the map with its agents and their choices.
pub(super) fn draw_map(scene: &mut Scene, (x, y): Point, cell: f64, moment: &Moment) {
    let (rows, columns) = size(moment);
    let (width, height) = (real(columns) * cell, real(rows) * cell);
    scene.rect(Area::new(x, y, width, height), Paint::fill(GROUND));
    if cell >= 8.0 {
        for i in 1..rows {
            scene.rect(Area::new(x, y + real(i) * cell, width, 1.0), Paint::fill(RULE));
        }
        for j in 1..columns {
            scene.rect(Area::new(x + real(j) * cell, y, 1.0, height), Paint::fill(RULE));
        }
    }
    for (i, row) in moment.grid.iter().enumerate() {
        for (j, symbol) in row.chars().enumerate() {
            draw_thing(scene, (x + real(j) * cell, y + real(i) * cell), cell, symbol);
        }
    }
    let corner = |(i, j): (i32, i32)| (x + f64::from(j) * cell, y + f64::from(i) * cell);
    let placed = || moment.agents.iter().filter_map(|agent| Some((agent, corner(agent.at?))));
    for (agent, at) in placed() {
        draw_agent(scene, at, cell, *agent);
    }
    // Arrows reach into the next cell, over the agents there.
    for (agent, at) in placed() {
        draw_choice(scene, at, cell, agent.choice);
    }
}

/// Draws the object in a cell, by its symbol in a spectator's grid. Agents are drawn later.
fn draw_thing(scene: &mut Scene, (x, y): Point, cell: f64, symbol: char) {
    let inside = Area::new(x + 1.0, y + 1.0, cell - 1.0, cell - 1.0);
    let middle = (x + cell / 2.0, y + cell / 2.0);
    let r = cell * 0.34;
    // Shapes are indistinguishable in so few pixels.
    if cell < 8.0 {
        let color = match symbol {
            'W' => Color::grey(0x4D),
            'N' => Color::YELLOW,
            'B' => Color::ORANGE,
            'F' => Color::GREEN,
            'P' => Color::VERMILLION,
            _ => return,
        };
        scene.rect(Area::new(x, y, cell, cell), Paint::fill(color));
        return;
    }
    match symbol {
        'W' => scene.rect(Area::new(x, y, cell, cell), Paint::fill(Color::grey(0x4D))),
        'N' => {
            scene.rect(inside, Paint::fill(Color::YELLOW));
            letter(scene, middle, cell, Color::BLACK, "N");
        }
        'B' => {
            scene.rect(inside, Paint::fill(Color::ORANGE));
            let (left, top, side) = (x + cell * 0.28, y + cell * 0.28, cell * 0.48);
            scene.rect(Area::new(left, top, side, side), Paint::line(Color::BLACK, 1.0));
        }
        'F' => {
            let (x, y) = middle;
            let corners = vec![(x - r, y), (x, y - r), (x + r, y), (x, y + r)];
            scene.path(corners, Paint::fill(Color::GREEN));
            letter(scene, middle, cell * 0.85, Color::BLACK, "F");
        }
        'P' => {
            let (x, y) = middle;
            let corners = vec![(x - r, y + r), (x, y - r * 1.2), (x + r, y + r)];
            scene.path(corners, Paint::fill(Color::VERMILLION));
            letter(scene, (x, y + r * 0.35), cell * 0.8, Color::BLACK, "P");
        }
        _ => {}
    }
}

fn letter(scene: &mut Scene, (x, y): Point, cell: f64, color: Color, text: &str) {
    // Smaller letters are illegible.
    const LEAST: f64 = 14.0;
    if cell >= LEAST {
        let digits = real(text.len());
        let size = (cell * 0.42).min(cell * 1.05 / digits.max(1.0));
        scene.text((x, y + size * 0.36), Anchor::Middle, size, color, text);
    }
}

/// The colour of an agent: that of its light or its load, if it has either.
fn color_of(light_on: Option<bool>, carries: bool) -> Color {
    match (light_on, carries) {
        (Some(true), _) => Color::YELLOW,
        (Some(false), _) => Color::grey(0x33),
        (None, true) => Color::ORANGE,
        (None, false) => Color::BLUE,
    }
}

fn draw_agent(scene: &mut Scene, (x, y): Point, cell: f64, agent: Agent) {
    let color = color_of(agent.light_on, agent.carries);
    let middle = (x + cell / 2.0, y + cell / 2.0);
    if cell < 8.0 {
        scene.rect(Area::new(x, y, cell, cell), Paint::fill(color));
        return;
    }
    let outline = if agent.light_on == Some(true) { 1.5 } else { 0.8 };
    scene.circle(middle, cell * 0.37, Paint::fill(color).outlined(INK, outline));
    letter(scene, middle, cell, color.text_on(), &agent.number.to_string());
    if agent.carries {
        let (x, y, r) = (x + cell * 0.82, y + cell * 0.18, cell * 0.16);
        let corners = vec![(x - r, y), (x, y - r), (x + r, y), (x, y + r)];
        scene.path(corners, Paint::fill(Color::GREEN).outlined(PAPER, 0.8));
    }
}

fn draw_choice(scene: &mut Scene, (x, y): Point, cell: f64, choice: Option<Choice>) {
    let middle = (x + cell / 2.0, y + cell / 2.0);
    match choice {
        None | Some(Choice::Stay) => {}
        Some(Choice::Nothing) => badge(scene, (x, y), cell, "?"),
        Some(Choice::Switch) => badge(scene, (x, y), cell, "S"),
        Some(Choice::Move { toward, blocked }) => draw_arrow(scene, middle, cell, toward, blocked),
    }
}

/// Draws an arrow from an agent to the next cell; empty and with a bar before it if the move was blocked.
fn draw_arrow(scene: &mut Scene, (x, y): Point, cell: f64, toward: Direction, blocked: bool) {
    let (i, j) = toward.offset();
    let (down, right) = (f64::from(i), f64::from(j));
    let at = |along: f64, aside: f64| {
        (x + cell * (along * right + aside * down), y + cell * (along * down + aside * right))
    };
    if cell < 8.0 {
        let color = if blocked { Color::VERMILLION } else { INK };
        scene.line((x, y), at(0.75, 0.0), Paint::line(color, 1.0));
        return;
    }
    let head = vec![at(0.37, 0.17), at(0.6, 0.0), at(0.37, -0.17)];
    if !blocked {
        scene.path(head, Paint::fill(INK).outlined(PAPER, 0.8));
        return;
    }
    scene.path(head, Paint::fill(PAPER).outlined(Color::VERMILLION, 1.4));
    scene.line(at(0.63, 0.2), at(0.63, -0.2), Paint::line(Color::VERMILLION, 2.0));
}

/// Draws a sign in the upper left corner of a cell.
fn badge(scene: &mut Scene, (x, y): Point, cell: f64, sign: &str) {
    if cell >= 14.0 {
        let r = cell * 0.19;
        let middle = (x + r, y + r);
        scene.circle(middle, r, Paint::fill(PAPER).outlined(INK, 0.8));
        scene.text((middle.0, middle.1 + r * 0.6), Anchor::Middle, r * 1.7, INK, sign);
    }
}

/// Draws a cell as an agent sees it.
fn draw_seen(scene: &mut Scene, (x, y): Point, cell: f64, seen: Seen) {
    let area = Area::new(x, y, cell - 1.0, cell - 1.0);
    let (color, text) = match seen {
        Seen::Outside => (AXIS, String::new()),
        Seen::Empty => (GROUND, String::new()),
        Seen::Wall => (Color::grey(0x4D), String::new()),
        Seen::Nest => (Color::YELLOW, "N".to_owned()),
        Seen::Food => (Color::GREEN, "F".to_owned()),
        Seen::Block => (Color::ORANGE, "B".to_owned()),
        Seen::Prey => (Color::VERMILLION, "P".to_owned()),
        Seen::Yourself => (Color::BLUE, "Y".to_owned()),
        Seen::Agent { number, marked } => {
            (if marked { Color::YELLOW } else { Color::SKY_BLUE }, number.to_string())
        }
    };
    scene.rect(area, Paint::fill(color));
    letter(scene, (x + cell / 2.0 - 0.5, y + cell / 2.0 - 0.5), cell * 1.3, color.text_on(), &text);
}
