use std::sync::Arc;

use swarmbench_engine::{Act, Message, Settings, TaskName, World};

use super::*;
use crate::{BUILT_IN, Identity, REVISION, STATIC_FIRST, TOOLKIT, chosen};
use swarmbench_protocol::status::Status;

fn sight(settings: &Settings, rounds: u32, agent: u16) -> (Sight, Config) {
    let config = Config::check(settings).expect("valid settings");
    let mut world = World::new(Arc::new(config.clone()));
    for _ in 0..rounds {
        let act = |n| Act { message: Message::new(&format!("I am {n}")), ..Act::of(Action::Up) };
        world.step(&(0..config.num_agents()).map(act).collect::<Vec<_>>());
    }
    let seen = world.observe(AgentId(agent));
    let description = tasks::description(&config);
    let sight = Sight::of(&seen, "ep_1".to_owned(), description, Status::Running, None);
    (sight, config)
}

/// The sections of the paper's Appendix "Prompt Design", in its order.
const SECTIONS: [&str; 14] = [
    "You are Agent_3",
    "Task description:",
    "Round: 2",
    "What you saw in the last 3 steps",
    "Your current observation:",
    "Messages you received:",
    "What you did lately:",
    "Symbols:",
    "Actions:",
    "Physics:",
    "Messages:\n1.",
    "Further rules:",
    "Think it through",
    "Finish with your choice",
];

#[test]
fn the_built_in_prompt_has_all_sections_in_order() {
    for task in TaskName::ALL {
        let (sight, config) = sight(&Settings::standard(task, 27), 2, 3);
        let prompt = render(BUILT_IN, &sight, &config).expect("it renders");
        let mut rest = prompt.as_str();
        for section in SECTIONS {
            let at = rest.find(section);
            rest = &rest
                [at.unwrap_or_else(|| panic!("{section:?} is not where it belongs: {prompt}"))..];
        }
        for action in Action::of_task(task) {
            assert!(prompt.contains(&format!(". {}: ", action.name())), "{prompt}");
        }
        let light = task == TaskName::Synchronization;
        assert_eq!(prompt.contains("Your light is"), light, "{prompt}");
        assert_eq!(prompt.contains("You carry no food"), task == TaskName::Foraging, "{prompt}");
        assert!(prompt.contains("message \"I am 3\""), "{prompt}");
    }
}

#[test]
fn views_are_tables_with_rows_and_columns_at_their_edges() {
    let (sight, config) = sight(&Settings::standard(TaskName::Transport, 27), 0, 8);
    let prompt = render(BUILT_IN, &sight, &config).expect("it renders");
    let table = "\
        \n     5    6    7    8    9\
        \n5    0    3    .    10   W\
        \n6    .    .    .    .    W\
        \n7    .    4    Y    .    W\
        \n8    .    .    .    .    W\
        \n9    W    W    W    W    W\n";
    assert!(prompt.contains(table), "{prompt}");
}

#[test]
fn escaped_and_centralized_agents_have_prompts_too() {
    let settings =
        Settings { control: "centralized".to_owned(), ..Settings::standard(TaskName::Pursuit, 1) };
    let (mut sight, config) = sight(&settings, 1, 0);
    let prompt = render(BUILT_IN, &sight, &config).expect("it renders");
    assert!(prompt.contains("You are the commander"), "{prompt}");
    (sight.view, sight.position, sight.alive) = (None, None, false);
    sight.past_views.clear();
    let prompt = render(BUILT_IN, &sight, &config).expect("it renders");
    assert!(prompt.contains("no longer on the map"), "{prompt}");
}

#[test]
fn the_built_in_templates_pass_the_check_that_others_must_pass() {
    for template in [BUILT_IN, TOOLKIT, STATIC_FIRST] {
        assert_eq!(check(template), Ok(()));
    }
    let asked = |name: &str| chosen(Some(name.to_owned()));
    assert_eq!((asked("toolkit").as_deref(), asked("default")), (Some(TOOLKIT), None));
    assert_eq!(asked("{{ agent }}").as_deref(), Some("{{ agent }}"));
}

/// The prompt shows the same as the public toolkit's: no position, a score in Pursuit alone, rounds from 0 and in the
/// history from 1.
#[test]
fn the_prompt_toolkit_shows_what_the_toolkit_shows() {
    for task in TaskName::ALL {
        let settings = Settings { rules: "reference".to_owned(), ..Settings::standard(task, 27) };
        let (sight, config) = sight(&settings, 2, 3);
        let prompt = render(TOOLKIT, &sight, &config).expect("it renders");
        assert!(prompt.contains("\n\nRound: 2\n\n"), "{prompt}");
        assert!(prompt.contains("\nRound 2: Action: UP, Message: \"I am 3\"\n"), "{prompt}");
        assert!(!prompt.contains("Round 0") && !prompt.contains("You are at"), "{prompt}");
        for (line, own) in [
            ("score: 0\n", TaskName::Pursuit),
            ("light_on: ", TaskName::Synchronization),
            ("carrying_food: False\n", TaskName::Foraging),
        ] {
            assert_eq!(prompt.contains(line), own == task, "{prompt}");
        }
        let shape = "\nA A A A\nA . . A\nA . . A\nA A A A\n";
        assert_eq!(prompt.contains(shape), task == TaskName::Flocking, "{prompt}");
        assert!(prompt.contains("\nCurrent step:\n") && prompt.contains("\n2 steps ago:\n"));
        assert!(!prompt.contains("\n\n\n\n"), "{prompt}");
    }
}

/// The prompt says what the built-in one says, and begins alike for all agents and rounds of a game.
#[test]
fn the_prompt_static_first_begins_alike_for_all() {
    for control in ["decentralized", "centralized"] {
        for task in TaskName::ALL {
            let settings = Settings { control: control.to_owned(), ..Settings::standard(task, 27) };
            let prompts: Vec<String> = [(0, 0), (0, 3), (3, 3), (3, 11)]
                .map(|(rounds, agent)| {
                    let (sight, config) = sight(&settings, rounds, agent);
                    let own = render(STATIC_FIRST, &sight, &config).expect("it renders");
                    let usual = render(BUILT_IN, &sight, &config).expect("it renders");
                    let lines: Vec<&str> = own.lines().collect();
                    let differs =
                        |line: &&str| !lines.contains(line) && !line.contains("commander");
                    let missing: Vec<&str> = usual.lines().filter(differs).collect();
                    let greeting = "one of several agents that share a world.";
                    assert!(missing.iter().all(|line| line.contains(greeting)), "{missing:?}");
                    own
                })
                .to_vec();
            let (shared, rest) = prompts[0].split_once("You are Agent_0").expect("its name");
            assert!(shared.len() > 2000 && rest.len() < shared.len(), "{}", shared.len());
            assert!(prompts.iter().all(|prompt| prompt.starts_with(shared)), "{}", prompts[3]);
        }
    }
}

#[test]
fn padded_tables_have_the_columns_of_the_toolkit() {
    let (sight, config) = sight(&Settings::standard(TaskName::Transport, 27), 0, 8);
    let table = "     5   6   7   8   9\
        \n  5  0   3   .   10  W   \
        \n  6  .   .   .   .   W   \
        \n  7  .   4   Y   .   W   \
        \n  8  .   .   .   .   W   \
        \n  9  W   W   W   W   W   ";
    assert_eq!(render("{{ views[0].padded }}", &sight, &config).as_deref(), Ok(table));
}

#[test]
fn prompts_of_the_tasks_are_true_under_both_rules_and_for_any_number_of_agents() {
    let of = |task, rules: &str, num_agents| {
        let rules = rules.to_owned();
        let settings = Settings { rules, num_agents, ..Settings::standard(task, 1) };
        tasks::description(&Config::check(&settings).expect("valid settings"))
    };
    assert!(of(TaskName::Pursuit, "paper", 12).contains("It cannot be pushed."));
    assert!(of(TaskName::Pursuit, "reference", 12).contains("can be pushed; those that come"));
    for (agents, has) in [
        (1, "a single cell with one agent on it. Where"),
        (3, "2 agents are not needed for it"),
        (5, "a square of 2 x 2 cells with 4 agents. One agent is not needed for it"),
        (12, "4 x 4 cells: 12 agents stand along its edge, and its inside is empty. Where"),
        (15, "3 agents are not needed for it"),
    ] {
        let text = of(TaskName::Flocking, "paper", agents);
        assert!(text.contains(has), "{text}");
    }
}

#[test]
fn the_filter_int_takes_decimal_places_away() {
    let (sight, config) = sight(&Settings::standard(TaskName::Transport, 27), 0, 3);
    let number = |template: &str| render(template, &sight, &config).map_err(|e| e.to_string());
    assert_eq!(
        number("{{ score }} {{ score|int }} {{ (-2.9)|int }} {{ 7|int }}").as_deref(),
        Ok("0.0 0 -2 7")
    );
    assert_eq!(number("{{ 1e300|int }}").as_deref(), Ok("9223372036854775807"));
    assert!(number("{{ agent|int }}").is_err());
}

#[test]
fn prompts_are_told_apart() {
    let name = |template: Option<&str>, revision, system: Option<&str>| {
        Identity::of(template, revision, system).to_string()
    };
    assert_eq!(name(None, 1, None), "default:1");
    assert_eq!(name(None, REVISION, None), "default");
    assert_eq!(name(Some(TOOLKIT), REVISION, None), "toolkit");
    assert_eq!(name(Some(STATIC_FIRST), REVISION, None), "static-first");
    let system = "\"You are one of many.\"";
    assert_eq!(name(Some(TOOLKIT), 1, Some(system)), "toolkit+system:4bb39329");
    // The revision belongs to templates that print the program's own words, and to no others.
    for (template, is_revised) in [
        ("{{ task.name }}", false),
        ("{{ task.description }}", true),
        ("{% for action in actions %}{{ action.meaning }}{% endfor %}", true),
    ] {
        let (old, new) =
            (Identity::of(Some(template), 1, None), Identity::of(Some(template), 2, None));
        assert_eq!(old != new, is_revised, "{template}");
        assert_eq!(old.to_string(), new.to_string());
    }
}

#[test]
fn templates_may_do_nothing_that_grows() {
    for refused in [
        "{% set x = 1 %}",
        "{% set x %}a{% endset %}",
        "{% with x = 1 %}{% endwith %}",
        "{% include 'prompt' %}",
        "{% import 'prompt' as p %}",
        "{% extends 'prompt' %}",
        "{% block a %}{% endblock %}",
        "{% filter upper %}a{% endfilter %}",
        "{% autoescape true %}{% endautoescape %}",
        "{% for a in views recursive %}{% endfor %}",
        "{% for a in [1, 2] %}{% endfor %}",
        "{% for a in range(1000000000) %}{% endfor %}",
        "{{ agent ~ agent }}",
        "{{ agent * 1000000000 }}",
        "{{ 10 ** 10 }}",
        "{{ agent + agent }}",
        "{{ {'a': 1} }}",
        "{{ agent[1:] }}",
        "{{ agent|replace('A', 'AAAA') }}",
        "{{ messages|join(agent) }}",
        "{{ agent|center(1000000000) }}",
        "{{ debug() }}",
        "{{ agent.upper() }}",
        "{{ agent is matching('a') }}",
        &format!("{{{{ '{}' in agent }}}}", "a".repeat(1025)),
    ] {
        assert!(check(refused).is_err(), "{refused}");
    }
    assert!(check("{{ unclosed").is_err());
    assert!(check(&"a".repeat(TEMPLATE_BYTES_MAX)).is_ok());
    assert!(check(&"a".repeat(TEMPLATE_BYTES_MAX + 1)).is_err());
}

#[test]
fn templates_are_bounded_when_they_run() {
    let (sight, config) = sight(&Settings::standard(TaskName::Transport, 27), 5, 3);
    let fails = |template: &str| {
        assert_eq!(check(template), Ok(()), "{template}");
        render(template, &sight, &config).expect_err(template).to_string()
    };
    let views = "{% for a in views[0].cells %}".repeat(12);
    let ends = "{% endfor %}".repeat(12);
    let fuel = fails(&format!("{views}{ends}"));
    assert!(fuel.contains("fuel"), "{fuel}");
    let (loops, ends) = ("{% for a in views[0].cells %}".repeat(4), "{% endfor %}".repeat(4));
    let long = fails(&format!("{loops}{}{ends}", "long ".repeat(5000)));
    assert!(long.contains("more than 132"), "{long}");
    let missing = fails("{{ seed }}");
    assert!(missing.contains("undefined"), "{missing}");
}

/// Custom templates read their input in all these ways: lists, fields, keys, whole values.
#[test]
fn what_is_counted_looks_as_if_it_were_not() {
    let (sight, config) = sight(&Settings::standard(TaskName::Transport, 27), 2, 3);
    let template = "{{ views[-1].round }} {{ views|length }} {{ views|first == views[0] }} {{ 'P' in views[0].text }} \
        {{ position }} {% for key in position %}{{ key }}{% endfor %} {{ task.name is defined }} \
        {{ task.nothing is defined }} {{ messages }} {{ views[0].cells[0] }} {{ 'x' in messages }} {{ views == views }}";
    assert_eq!(check(template), Ok(()));
    let environment = environment(&Work::new());
    let native = Context::new(&sight, &config, false);
    let native = minijinja::Value::from(minijinja::value::Serde(native));
    let native = environment.template_from_str(template).expect("a template").render(native);
    assert_eq!(render(template, &sight, &config), Ok(native.expect("it renders")));
}

#[test]
fn the_built_in_prompt_fits_for_all_that_can_be_seen() {
    let standard = Settings::standard(TaskName::Foraging, 1);
    let large = Settings { width: 256, height: 256, ..standard.clone() };
    for settings in [
        Settings { num_agents: 1, view_size: 513, memory: 0, ..large.clone() },
        Settings { num_agents: 1, view_size: 255, memory: 1, ..large.clone() },
        Settings { num_agents: 1, view_size: 3, memory: 50, ..large.clone() },
        Settings { control: "centralized".to_owned(), memory: 1, num_agents: 16, ..large },
        Settings { num_agents: 362, view_size: 51, memory: 1, width: 40, height: 40, ..standard },
    ] {
        Config::admit(&settings).expect("settings of a new game");
        let (mut sight, config) = sight(&settings, settings.memory.try_into().expect("few"), 0);
        for message in &mut sight.messages {
            *message = "\u{1f41d}".repeat(123);
        }
        let prompt = render(BUILT_IN, &sight, &config);
        let prompt = prompt.unwrap_or_else(|error| panic!("{settings:?}: {error}"));
        assert!(prompt.len() <= bytes_max(&sight));
    }
}

#[test]
fn what_templates_read_is_bounded() {
    let settings = Settings { view_size: 21, ..Settings::standard(TaskName::Transport, 27) };
    let (sight, config) = sight(&settings, 5, 3);
    for reads in [
        "{% if views == views %}{% endif %}",
        "{% if agent in views[0].text %}{% endif %}",
        "{% if views[0].text|upper|lower|trim|length == 0 %}{% endif %}",
        "{% if views[0].cells|upper == views[1] %}{% endif %}",
        "{% if score|round(-300) %}{% endif %}",
        "{% if score|int|int|int|int|int|int|int|int %}{% endif %}",
    ] {
        let (loops, ends) = ("{% for a in views[0].cells %}".repeat(4), "{% endfor %}".repeat(4));
        let template = format!("{loops}{reads}{ends}");
        assert_eq!(check(&template), Ok(()), "{template}");
        let reads = render(&template, &sight, &config).expect_err(reads).to_string();
        assert!(reads.contains("reads more than 16777216 bytes"), "{template}: {reads}");
    }
}

/// Settings with the widest possible window.
fn widest() -> Settings {
    let foraging = Settings::standard(TaskName::Foraging, 1);
    Settings { num_agents: 3, width: 256, height: 256, view_size: 513, memory: 0, ..foraging }
}

#[test]
fn the_instructions_of_a_prompt_are_counted() {
    let (sight, config) = sight(&widest(), 0, 0);
    let template = "{% for a in views[0].cells %}{% for b in a %}x{% endfor %}{% endfor %}";
    assert_eq!(check(template), Ok(()));
    let mut text = Bounded::new(bytes_max(&sight));
    let fuel = fill(template, &sight, &config, &mut text).expect_err("513² are too many");
    assert!(fuel.to_string().contains("fuel"), "{fuel}");
    // Each letter takes at least three instructions: the next item, the text, the jump back.
    let printed = text.bytes.len();
    assert!((10_000..=200_000 / 3).contains(&printed), "{printed} letters");
}

#[test]
fn a_prompt_is_bounded_as_it_is_written() {
    let (sight, config) = sight(&widest(), 0, 0);
    let most = bytes_max(&sight);
    let template = |text: &str| format!("{{% for row in views[0].cells %}}{text}{{% endfor %}}");
    for (text, times) in [("x", 1), ("\"", 2), ("\n", 2), ("\t\\", 4)] {
        let template = template(&text.repeat(4_000 / text.len()));
        let prompt = render(&template, &sight, &config).expect("ordinary text");
        assert!(prompt.len() > most * 9 / 10, "{} of {most} bytes", prompt.len());
        let json = serde_json::to_string(&prompt).expect("a text");
        assert_eq!(json.len(), 2 + prompt.len() * times / text.len());
        assert!(json.len() <= 5_000_000, "{}", json.len());
    }
    let mut text = Bounded::new(most);
    let control = template(&"\u{1}".repeat(4_000));
    let problem = fill(&control, &sight, &config, &mut text).expect_err("six bytes each");
    assert_eq!(
        problem.to_string(),
        format!("the prompt takes more than {} bytes as JSON", 2 * most)
    );
    assert!(6 * text.bytes.len() <= 2 * most);
    let long = render(&template(&"x".repeat(5_000)), &sight, &config).expect_err("too long");
    assert_eq!(long.to_string(), format!("the prompt has more than {most} bytes"));
}

#[test]
fn a_template_of_ones_own_sees_the_observation() {
    let (sight, config) = sight(&Settings::standard(TaskName::Transport, 27), 1, 3);
    let template = "{{ agent }} {{ round }}/{{ max_round }} ({{ position.i }},{{ position.j }}) \
        {% for row in views[0].cells %}{% for cell in row %}{{ cell }}{% endfor %}/{% endfor %} \
        {{ actions|length }} {{ messages|first|default('-') }} {{ views[1].label|upper }}";
    assert_eq!(check(template), Ok(()));
    let text = render(template, &sight, &config).expect("it renders");
    assert!(text.starts_with("Agent_3 1/100 ("), "{text}");
    assert!(text.ends_with(" 1 STEP AGO"), "{text}");
}
