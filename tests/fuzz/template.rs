//! Prompt templates, which anybody may bring: whatever one says, it is refused or rendered, on a stack of half the size.

use std::sync::Arc;

use bolero::{TypeGenerator, produce};
use swarmbench::work::STACK_BYTES;
use swarmbench_engine::{AgentId, Config, Settings, TaskName, World};
use swarmbench_prompt::{TEMPLATE_BYTES_MAX, check, render};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

use swarmbench_testkit::check;

/// Pieces that make a template deeper, or hide its depth.
const PIECES: [&str; 46] = [
    "{{ ",
    " }}",
    "{% if ",
    "{% elif ",
    "{% else %}",
    "{% endif %}",
    "{% for a in ",
    "{% endfor %}",
    " %}",
    "{%- if 1 -%}",
    "{# ",
    " #}",
    "{% raw %}",
    "{% endraw %}",
    "{% set a = ",
    "{% block b %}",
    "{% filter upper %}",
    "not ",
    "- ",
    "-",
    " + ",
    " ~ ",
    " ** ",
    " - ",
    " == ",
    " < ",
    " not in ",
    " in ",
    " and ",
    " or ",
    " is ",
    " is not defined",
    " if ",
    " else ",
    ".i",
    ".0",
    "[0]",
    "|upper",
    "|default(",
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    ", ",
];

const LEAVES: [&str; 10] =
    ["agent", "views", "1", "2.5", "'a'", "\"{{\"", "1 if 1 else ", "\n", "x", "none"];

/// A piece, as often as it stands there.
#[derive(Clone, Debug, TypeGenerator)]
struct Part {
    piece: u8,
    times: u16,
    is_long: bool,
}

fn text(parts: &[Part]) -> String {
    let pieces: Vec<&str> = PIECES.into_iter().chain(LEAVES).collect();
    let mut text = String::new();
    for Part { piece, times, is_long } in parts {
        let piece = pieces[usize::from(*piece) % pieces.len()];
        let most = if *is_long { TEMPLATE_BYTES_MAX } else { 4 };
        text.push_str(&piece.repeat(usize::from(*times) % most / piece.len() + 1));
    }
    text.truncate(TEMPLATE_BYTES_MAX);
    text
}

/// Templates that ended a server, and similar ones.
fn killers() -> Vec<String> {
    let printed = |before: &str, times, after: &str| {
        format!("{{{{ {}{} }}}}", before.repeat(times), after.repeat(times))
    };
    let of = |piece: &str| {
        let times = 32_000 / piece.len();
        [
            printed(piece, times, ""),
            printed(piece, times, "1"),
            format!("{{{{ a{} }}}}", piece.repeat(times)),
        ]
    };
    let mut killers: Vec<String> = PIECES.into_iter().chain(LEAVES).flat_map(of).collect();
    for (before, times, after) in [
        ("not (", 2_700, ")"),
        ("a[", 8_000, "]"),
        ("1|default(", 2_900, ")"),
        ("1 if 1 else (", 2_300, ")"),
        ("{% if 1 %}", 1_600, "{% endif %}"),
        ("{% for a in b %}", 1_100, "{% endfor %}"),
        ("{% if 0 %}{% elif 0 %}", 1_000, "{% endif %}"),
    ] {
        killers.push(printed(before, times, after));
        killers.push(format!("{}{}", before.repeat(times), after.repeat(times)));
    }
    killers.push(format!("{{% if 0 %}}{}{{% endif %}}", "{% elif 0 %}".repeat(2_700)));
    killers
}

fn on_half_a_stack(work: impl FnOnce() + Send + 'static) {
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES / 2).spawn(work);
    thread.expect("a thread").join().expect("no panic");
}

/// Checks a template and fills it, as what was stored is filled without the first check.
fn survives() -> impl Fn(&str) {
    let config = Config::check(&Settings::standard(TaskName::Transport, 27)).expect("settings");
    let seen = World::new(Arc::new(config.clone())).observe(AgentId(3));
    let sight = Sight::of(&seen, "ep_1".to_owned(), String::new(), Status::Running, None);
    move |template| {
        let rendered = render(template, &sight, &config);
        if let Err(problem) = check(template)
            && !problem.to_string().contains("a text of more than 1024 bytes")
        {
            assert_eq!(rendered, Err(problem), "{template}");
        }
    }
}

#[test]
fn templates_that_ended_a_server_end_it_no_more() {
    on_half_a_stack(|| killers().iter().map(String::as_str).for_each(survives()));
}

#[test]
fn any_template_is_refused_or_rendered() {
    on_half_a_stack(|| {
        let survives = survives();
        check!(2_000, produce::<Vec<Part>>(), |parts| survives(&text(parts)));
    });
}
