//! Pictures of games: their bytes, texts and colours.

mod samples;

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use roxmltree::Document;
use samples::{HOSTILE, all};
use swarmbench_engine::{Settings, TaskName};
use swarmbench_protocol::names::printable;
use swarmbench_replay::draw::frame::{Layout, Moment, Shown, Stage};
use swarmbench_replay::draw::palette::{Color, OKABE_ITO, PAPER};
use swarmbench_replay::draw::scene::{Anchor, Area, Paint, Scene, Shape};
use swarmbench_replay::draw::{Canvas, Film, Gif, font, png, svg};

/// A variable that makes the test write the golden file instead of comparing it.
const UPDATE: &str = "SWARMBENCH_UPDATE_FIGURES";
/// A variable with a folder into which all samples are written as PNG, for viewing.
const SHOW: &str = "SWARMBENCH_SHOW_FIGURES";

#[test]
fn the_same_game_gives_the_same_bytes() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/moments.svg");
    let now = svg(&samples::moments_of(TaskName::Foraging, &[3], true).scene());
    if std::env::var_os(UPDATE).is_some() {
        std::fs::write(&file, &now).expect("a folder of the repository");
    }
    let expected = std::fs::read_to_string(&file).unwrap_or_default();
    assert!(now == expected, "{} differs; {UPDATE}=1 writes it anew", file.display());
}

#[test]
fn texts_stay_inside_and_lines_have_numbers() {
    let folder = std::env::var_os(SHOW).map(PathBuf::from);
    for (name, scene) in all() {
        if let Some(folder) = &folder {
            let picture = png(&scene, 1.0).expect("a small picture");
            std::fs::write(folder.join(format!("{name}.png")), picture).expect("a folder");
        }
        for shape in &scene.shapes {
            match shape {
                Shape::Text(text) => {
                    let width = font::width(&text.text, text.size);
                    let before = match text.anchor {
                        Anchor::Start => 0.0,
                        Anchor::Middle => width / 2.0,
                        Anchor::End => width,
                    };
                    let from = text.at.0 - before;
                    let is_inside = from >= 0.0 && from + width <= scene.width;
                    assert!(is_inside && text.at.1 <= scene.height, "{name}: {text:?}");
                }
                Shape::Path(points, _) => {
                    let finite = points.iter().all(|(x, y)| x.is_finite() && y.is_finite());
                    assert!(finite, "{name}: {points:?}");
                }
                Shape::Rect(area, _) => assert!(area.width >= 0.0, "{name}: {area:?}"),
                Shape::Circle(_, radius, _) => assert!(*radius > 0.0, "{name}"),
            }
        }
    }
}

#[test]
fn hostile_texts_are_only_text() {
    let pictures = all();
    for (name, scene) in &pictures {
        let text = svg(scene);
        let document = Document::parse(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        for node in document.descendants() {
            assert!(!node.is_comment() && !node.is_pi(), "{name}: {node:?}");
            if !node.is_element() {
                continue;
            }
            let known = ["svg", "title", "rect", "circle", "path", "text"];
            assert!(known.contains(&node.tag_name().name()), "{name}: {node:?}");
            let scripts = node.attributes().any(|attribute| attribute.name().starts_with("on"));
            assert!(!scripts, "{name}: {node:?}");
        }
    }
    for (number, title) in HOSTILE.into_iter().enumerate() {
        let name = format!("hostile-{number}");
        let (_, scene) = pictures.iter().find(|(of, _)| *of == name).expect("a sample");
        let text = svg(scene);
        let document = Document::parse(&text).expect("XML");
        let texts: Vec<&str> = document.descendants().filter_map(|node| node.text()).collect();
        assert!(texts.contains(&printable(title).as_str()), "{title:?} in {texts:?}");
        assert!(!text.contains("<script"));
    }
}

#[test]
fn colours_are_those_of_okabe_and_ito_and_greys() {
    let mut found = BTreeSet::new();
    for (_, scene) in all() {
        let text = svg(&scene);
        let document = Document::parse(&text).expect("XML");
        for node in document.descendants() {
            let colors = ["fill", "stroke"].map(|of| node.attribute(of)).into_iter().flatten();
            found.extend(colors.filter(|&color| color != "none").map(str::to_owned));
        }
    }
    assert!(found.len() > 12, "{found:?}");
    for name in found {
        let part = |at: usize| u8::from_str_radix(&name[at..at + 2], 16).expect("hexadecimal");
        let color = Color(part(1), part(3), part(5));
        assert!(color == Color::grey(color.0) || OKABE_ITO.contains(&color), "{name}");
    }
}

#[test]
fn texts_can_be_read_on_what_is_below_them() {
    for (name, scene) in all() {
        for (place, shape) in scene.shapes.iter().enumerate() {
            let Shape::Text(text) = shape else { continue };
            // The middle of the text, slightly above its base line.
            let half = font::width(&text.text, text.size) / 2.0;
            let x = text.at.0
                + match text.anchor {
                    Anchor::Start => half,
                    Anchor::Middle => 0.0,
                    Anchor::End => -half,
                };
            let y = text.at.1 - text.size / 3.0;
            let mut ground = Color::WHITE;
            for below in &scene.shapes[..place] {
                let (paint, covers) = match below {
                    Shape::Rect(area, paint) => {
                        let across = (area.x..area.right()).contains(&x);
                        (paint, across && (area.y..area.bottom()).contains(&y))
                    }
                    Shape::Circle(center, radius, paint) => {
                        (paint, (center.0 - x).hypot(center.1 - y) <= *radius)
                    }
                    Shape::Path(..) | Shape::Text(_) => continue,
                };
                if let (Some(color), true) = (paint.fill, covers) {
                    ground = color;
                }
            }
            let contrast = text.color.contrast(ground);
            assert!(contrast >= 4.5, "{name}: {contrast:.2} for {text:?} on {ground:?}");
        }
    }
}

#[test]
fn a_png_has_the_size_of_its_scene() {
    let scene = samples::moments_of(TaskName::Pursuit, &[0], false).scene();
    let bytes = png(&scene, 2.0).expect("a small picture");
    assert_eq!(bytes, png(&scene, 2.0).expect("a small picture"), "the same bytes");
    let side = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().expect("4 bytes"));
    let expected = [scene.width, scene.height].map(|side| format!("{:.0}", 2.0 * side));
    assert_eq!([side(16), side(20)].map(|side| side.to_string()), expected);
    let refused = png(&scene, 1000.0).expect_err("too large");
    assert!(refused.to_string().contains("png_pixels_max"), "{refused}");
}

#[test]
fn a_png_has_the_colours_of_its_shapes() {
    let mut scene = Scene::new(8.0, 4.0, "");
    scene.rect(Area::new(0.0, 0.0, 2.0, 4.0), Paint::fill(Color::BLUE));
    scene.line((4.0, 2.0), (8.0, 2.0), Paint::line(Color::VERMILLION, 2.0));
    let bytes = png(&scene, 1.0).expect("a small picture");
    let mut reader = ::png::Decoder::new(Cursor::new(bytes)).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a small picture")];
    let info = reader.next_frame(&mut pixels).expect("a picture");
    assert_eq!((info.width, info.height, info.color_type), (8, 4, ::png::ColorType::Rgb));
    let pixel = |(x, y): (usize, usize)| &pixels[3 * (8 * y + x)..][..3];
    for (at, expected) in
        [((1, 2), Color::BLUE), ((3, 2), PAPER), ((6, 1), Color::VERMILLION), ((6, 3), PAPER)]
    {
        let Color(red, green, blue) = expected;
        assert_eq!(pixel(at), [red, green, blue], "{at:?}");
    }
}

/// The stage of a game of the samples.
fn stage(moments: &[Moment], agents: usize) -> Stage {
    let rows = moments[0].grid.len();
    Stage {
        task: "Pursuit".to_owned(),
        model: HOSTILE[4].to_owned(),
        map: (rows, moments[0].grid[0].len()),
        agents,
        window: (5, 5),
        max_round: 100,
        scores: (0.0, moments.last().expect("the layout").score),
    }
}

fn gif_of(moments: &[Moment], mut layout: Layout) -> (Vec<u8>, Canvas) {
    let mut bytes = Vec::new();
    let mut canvas = Canvas::new(&layout.clone().frame(&moments[0]));
    let mut film = Box::new(Gif::new(&mut bytes, &canvas, 4).expect("a buffer"));
    for moment in moments {
        canvas.draw(&layout.frame(moment));
        film.frame(&canvas).expect("a buffer");
    }
    film.finish().expect("a buffer");
    (bytes, canvas)
}

#[test]
fn a_replay_of_a_standard_game_is_a_small_file() {
    // A fifth of a game, as drawing all of it takes long without optimisation.
    const ROUNDS: u32 = 20;
    const BYTES_MAX: usize = 3_000_000 / 5;
    let task = TaskName::Pursuit;
    let moments = samples::moments(&Settings::standard(task, 27), task, ROUNDS, true);
    let shown = Shown { messages: true, views: true, ..Shown::default() };
    let layout = Layout::new(stage(&moments, 12), shown).expect("a small frame");
    let (bytes, canvas) = gif_of(&moments, layout);
    assert!(bytes.len() < BYTES_MAX, "{} bytes", bytes.len());
    let mut decoder = gif::Decoder::new(bytes.as_slice()).expect("a GIF");
    let size = (usize::from(decoder.width()), usize::from(decoder.height()));
    assert_eq!(size, (canvas.width(), canvas.height()));
    let mut frames = 0;
    while let Some(frame) = decoder.read_next_frame().expect("a frame") {
        assert_eq!(frame.delay, 25);
        frames += 1;
    }
    assert_eq!(frames, moments.len());
    if let Some(folder) = std::env::var_os(SHOW) {
        std::fs::write(Path::new(&folder).join("game.gif"), bytes).expect("a folder");
    }
}

#[test]
fn frames_of_a_replay_look_the_same_in_all_outputs() {
    for (name, task, agents, side, shown) in [
        ("replay-transport", TaskName::Transport, 12, 10, Shown::default()),
        (
            "replay-all",
            TaskName::Foraging,
            12,
            10,
            Shown { messages: true, views: true, ..Shown::default() },
        ),
        ("replay-large", TaskName::Pursuit, 1024, 256, Shown::default()),
    ] {
        let mut settings = Settings::standard(task, 3);
        (settings.num_agents, settings.width, settings.height) = (agents, side, side);
        let moments = samples::moments(&settings, task, 3, shown.views);
        let agents = usize::try_from(agents).expect("a number of agents");
        let mut layout = Layout::new(stage(&moments, agents), shown).expect("a small frame");
        let scenes: Vec<_> = moments.iter().map(|moment| layout.frame(moment)).collect();
        let scene = &scenes[2];
        let text = svg(scene);
        Document::parse(&text).expect("XML");
        let mut canvas = Canvas::new(scene);
        canvas.draw(scene);
        assert_eq!(canvas.pixels().len() as u64, layout.pixels());
        if let Some(folder) = std::env::var_os(SHOW) {
            let folder = Path::new(&folder);
            let picture = png(scene, 1.0).expect("a small picture");
            std::fs::write(folder.join(format!("{name}.png")), picture).expect("a folder");
            let mut bytes = Vec::new();
            let mut film = Box::new(Gif::new(&mut bytes, &canvas, 4).expect("a buffer"));
            film.frame(&canvas).expect("a buffer");
            film.finish().expect("a buffer");
            std::fs::write(folder.join(format!("{name}.gif")), bytes).expect("a folder");
        }
    }
}

#[test]
fn a_picture_ends_below_its_messages() {
    let task = TaskName::Pursuit;
    let moments = samples::moments(&Settings::standard(task, 27), task, 2, false);
    let shown = Shown { messages: true, ..Shown::default() };
    let heights = [shown, Shown { cut: true, ..shown }].map(|shown| {
        let mut layout = Layout::new(stage(&moments, 12), shown).expect("a small frame");
        [0, 1, 2].map(|place| layout.frame(&moments[place]).height)
    });
    let [first, _, last] = heights[0];
    assert!((first - last).abs() < 0.1, "{heights:?}");
    // The last state has no messages.
    assert!(heights[1][2] < heights[1][0] && heights[1][0] <= first, "{heights:?}");
}

#[test]
fn frames_that_are_too_large_name_their_limit() {
    let moments =
        samples::moments(&Settings::standard(TaskName::Pursuit, 1), TaskName::Pursuit, 1, false);
    let stage = stage(&moments, 1024);
    for shown in
        [Shown { cell: Some(512), ..Shown::default() }, Shown { views: true, ..Shown::default() }]
    {
        let refused = Layout::new(stage.clone(), shown).expect_err("too large").to_string();
        assert!(refused.contains("frame_side_max") && refused.contains("--scale"), "{refused}");
    }
}
