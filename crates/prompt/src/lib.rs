//! Observations as text for language models.
//!
//! A crate of its own so that tools can render the server's prompts without a server.
//!
//! A prompt is a template (minijinja) filled with what one seat may see. The built-in template has the sections of the
//! paper's Appendix "Prompt Design" in its order. An episode may bring its own; it is untrusted, so it is checked when
//! the episode is created and bounded when it runs:
//!
//! - it may print, branch and loop over its input, with a few filters, but build no larger values: no assignments, no
//!   lists, no calls, no concatenation, no includes;
//! - its instructions, the bytes that it reads and the bytes that it writes are bounded.

pub mod tasks;
mod work;

use std::io;
use std::sync::Arc;

use minijinja::machinery::ast::{BinOpKind, CallArg, Expr, Stmt};
use minijinja::syntax::SyntaxConfig;
use minijinja::{Environment, Error, ErrorKind, UndefinedBehavior};
use serde::Serialize;
use swarmbench_engine::{Action, AgentId, Config, Control};

use work::{READ_BYTES_MAX, Work, count_filters, counted};

use swarmbench_protocol::Position;
use swarmbench_protocol::observation::{Cell, HistoryEntry, Sight};

/// The built-in template.
pub const BUILT_IN: &str = include_str!("prompt.txt.j2");

/// Bytes of a template.
pub const TEMPLATE_BYTES_MAX: usize = 32 * 1024;

/// Instructions that a template may run for.
const FUEL_MAX: u64 = 200_000;

/// Bytes of a prompt: many times those of the built-in one in the standard setting.
pub const PROMPT_BYTES_MAX: usize = 128 * 1024;

/// Further bytes for each cell that the seat sees or remembers: the built-in prompt needs 5.
pub const PROMPT_BYTES_PER_CELL_MAX: usize = 8;

/// Bytes of a prompt as JSON, divided by its bytes as text: quotes and line breaks take two there, other control
/// characters six.
pub const PROMPT_JSON_FACTOR_MAX: usize = 2;

/// Bytes of a text in an expression. Text outside of expressions may be as long as the template.
const CONSTANT_BYTES_MAX: usize = 1024;

/// Filters that a template may use; none of them can make a value larger than its parts.
const FILTERS: [&str; 8] =
    ["length", "upper", "lower", "trim", "first", "last", "default", "round"];

/// Tests that a template may use.
const TESTS: [&str; 9] =
    ["defined", "undefined", "none", "true", "false", "even", "odd", "eq", "ne"];

/// A template fails, when it is checked or when it runs.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct TemplateError(String);

impl From<Error> for TemplateError {
    fn from(error: Error) -> Self {
        let line = error.line().map_or_else(String::new, |line| format!(" (line {line})"));
        let detail = error.detail().map_or_else(|| error.kind().to_string(), str::to_owned);
        Self(format!("{detail}{line}"))
    }
}

/// Checks a template that came with an episode.
///
/// # Errors
/// A syntax error, or a statement or expression that is not allowed.
pub fn check(template: &str) -> Result<(), TemplateError> {
    if template.len() > TEMPLATE_BYTES_MAX {
        let is = template.len();
        return Err(TemplateError(format!(
            "must have at most {TEMPLATE_BYTES_MAX} bytes, has {is}"
        )));
    }
    let parsed = minijinja::machinery::parse(template, "prompt", syntax())?;
    check_statement(&parsed)
}

/// Renders a template with the observation of one seat.
///
/// # Errors
/// Where the template fails or exceeds its bounds.
pub fn render(template: &str, sight: &Sight, config: &Config) -> Result<String, TemplateError> {
    let mut text = Bounded::new(bytes_max(sight));
    fill(template, sight, config, &mut text)?;
    String::from_utf8(text.bytes).map_err(|error| TemplateError(error.to_string()))
}

/// Fills a template until it ends or fails.
fn fill(
    template: &str,
    sight: &Sight,
    config: &Config,
    text: &mut Bounded,
) -> Result<(), TemplateError> {
    let work = Work::new();
    let environment = environment(&work);
    let template = environment.template_from_str(template)?;
    let context = minijinja::Value::from(minijinja::value::Serde(Context::new(sight, config)));
    let rendered = template.render_captured_to(counted(context, &work), &mut *text).map(drop);
    if work.is_over() {
        return Err(TemplateError(format!("the template reads more than {READ_BYTES_MAX} bytes")));
    }
    rendered.map_err(|error| {
        if error.kind() == ErrorKind::WriteFailure {
            TemplateError(text.problem())
        } else {
            error.into()
        }
    })
}

/// The limit of a prompt's bytes, by the size of the observation.
fn bytes_max(sight: &Sight) -> usize {
    let cells = |rows: &Vec<Vec<Cell>>| rows.iter().map(Vec::len).sum::<usize>();
    let now: usize = sight.view.iter().map(|view| cells(&view.cells)).sum();
    let past: usize = sight.past_views.iter().map(|past| cells(&past.cells)).sum();
    // A line for each, with the text around it.
    let messages: usize = sight.messages.iter().map(|message| 16 + 2 * message.len()).sum();
    PROMPT_BYTES_MAX + PROMPT_BYTES_PER_CELL_MAX * (now + past) + messages
}

fn environment(work: &Arc<Work>) -> Environment<'static> {
    let mut environment = Environment::new();
    count_filters(&mut environment, work);
    environment.set_fuel(Some(FUEL_MAX));
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_syntax(syntax());
    environment
}

/// Tags on lines of their own leave no empty lines behind.
fn syntax() -> SyntaxConfig {
    let built = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    built.expect("the delimiters are the usual ones")
}

/// Text of a bounded length.
struct Bounded {
    bytes: Vec<u8>,
    most: usize,
    /// Its bytes as JSON.
    json: usize,
}

impl Bounded {
    const fn new(most: usize) -> Self {
        Self { bytes: Vec::new(), most, json: 0 }
    }

    const fn json_most(&self) -> usize {
        PROMPT_JSON_FACTOR_MAX * self.most
    }

    /// The limit that was exceeded.
    fn problem(&self) -> String {
        if self.json > self.json_most() {
            format!("the prompt takes more than {} bytes as JSON", self.json_most())
        } else {
            format!("the prompt has more than {} bytes", self.most)
        }
    }
}

impl io::Write for Bounded {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.json += bytes.iter().copied().map(json_bytes).sum::<usize>();
        if self.bytes.len() + bytes.len() > self.most || self.json > self.json_most() {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        self.bytes.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The bytes of one byte of a text as JSON.
const fn json_bytes(byte: u8) -> usize {
    match byte {
        b'"' | b'\\' | b'\n' | b'\r' | b'\t' | 0x08 | 0x0c => 2,
        0..0x20 => 6,
        _ => 1,
    }
}

fn refuse<T>(what: &str) -> Result<T, TemplateError> {
    Err(TemplateError(format!(
        "{what} may not be used: a prompt template prints, branches and loops over what it is given"
    )))
}

fn check_statement(statement: &Stmt<'_>) -> Result<(), TemplateError> {
    let all = |statements: &[Stmt<'_>]| statements.iter().try_for_each(check_statement);
    match statement {
        Stmt::Template(template) => all(&template.children),
        Stmt::EmitRaw(_) => Ok(()),
        Stmt::EmitExpr(emit) => check_expression(&emit.expr),
        Stmt::ForLoop(each) => {
            if each.recursive {
                return refuse("recursive loops");
            }
            check_expression(&each.iter)?;
            each.filter_expr.as_ref().map_or(Ok(()), check_expression)?;
            all(&each.body)?;
            all(&each.else_body)
        }
        Stmt::IfCond(branch) => {
            check_expression(&branch.expr)?;
            all(&branch.true_body)?;
            all(&branch.false_body)
        }
        _ => refuse("set, with, macro, filter, include and other statements beyond for and if"),
    }
}

fn check_expression(expression: &Expr<'_>) -> Result<(), TemplateError> {
    let argument = |argument: &CallArg<'_>| match argument {
        CallArg::Pos(value) => check_expression(value),
        _ => refuse("named and spread arguments"),
    };
    match expression {
        Expr::Const(text)
            if text.value.as_str().is_some_and(|text| text.len() > CONSTANT_BYTES_MAX) =>
        {
            refuse(&format!("a text of more than {CONSTANT_BYTES_MAX} bytes in an expression"))
        }
        Expr::Var(_) | Expr::Const(_) => Ok(()),
        Expr::UnaryOp(operation) => check_expression(&operation.expr),
        Expr::BinOp(operation) => {
            match operation.op {
                BinOpKind::Mul | BinOpKind::Pow | BinOpKind::Concat | BinOpKind::Add => {
                    return refuse("the operators ~ + * and **");
                }
                _ => {}
            }
            check_expression(&operation.left)?;
            check_expression(&operation.right)
        }
        Expr::Compare(compare) => {
            check_expression(&compare.expr)?;
            compare.ops.iter().try_for_each(|op| check_expression(&op.expr))
        }
        Expr::IfExpr(branch) => {
            check_expression(&branch.test_expr)?;
            check_expression(&branch.true_expr)?;
            branch.false_expr.as_ref().map_or(Ok(()), check_expression)
        }
        Expr::Filter(filter) => {
            if !FILTERS.contains(&filter.name) {
                return refuse(&format!("the filter {}", filter.name));
            }
            filter.expr.as_ref().map_or(Ok(()), check_expression)?;
            filter.args.iter().try_for_each(argument)
        }
        Expr::Test(test) => {
            if !TESTS.contains(&test.name) {
                return refuse(&format!("the test {}", test.name));
            }
            check_expression(&test.expr)?;
            test.args.iter().try_for_each(argument)
        }
        Expr::GetAttr(access) => check_expression(&access.expr),
        Expr::GetItem(access) => {
            check_expression(&access.expr)?;
            check_expression(&access.subscript_expr)
        }
        _ => refuse("calls, lists, maps and slices"),
    }
}

/// The input of a template: one seat's observation, and the settings of the episode.
#[derive(Serialize)]
struct Context<'a> {
    agent: &'a str,
    task: &'a swarmbench_protocol::observation::Task,
    round: u32,
    max_round: u32,
    memory: usize,
    score: f64,
    position: Option<Position>,
    light_on: Option<bool>,
    carrying_food: Option<bool>,
    messages: &'a [String],
    /// The oldest first.
    history: Vec<&'a HistoryEntry>,
    /// The current one first.
    views: Vec<ViewContext<'a>>,
    actions: Vec<ActionContext>,
    /// The size of a view.
    height: usize,
    width: usize,
    centralized: bool,
    commander: bool,
}

#[derive(Serialize)]
struct ViewContext<'a> {
    round: u32,
    /// How many rounds ago it was seen.
    ago: u32,
    /// `Now`, `1 step ago`, `2 steps ago` …
    label: String,
    origin: Position,
    cells: &'a [Vec<Cell>],
    /// A table with the numbers of rows and columns at its edges.
    text: String,
}

#[derive(Serialize)]
struct ActionContext {
    name: &'static str,
    meaning: &'static str,
}

impl<'a> Context<'a> {
    fn new(sight: &'a Sight, config: &Config) -> Self {
        let now = sight.view.iter().map(|view| (sight.round, view.origin, &view.cells));
        let past = sight.past_views.iter().map(|past| (past.round, past.origin, &past.cells));
        let view = |(round, origin, cells): (u32, Position, &'a Vec<Vec<Cell>>)| {
            let ago = sight.round - round;
            let label = match ago {
                0 => "Now".to_owned(),
                1 => "1 step ago".to_owned(),
                _ => format!("{ago} steps ago"),
            };
            ViewContext { round, ago, label, origin, cells, text: table(origin, cells) }
        };
        let centralized = config.control() == Control::Centralized;
        let current = sight.view.as_ref().map(|view| &view.cells);
        let cells = current.or(sight.past_views.first().map(|past| &past.cells));
        Self {
            agent: &sight.agent,
            task: &sight.task,
            round: sight.round,
            max_round: sight.max_round,
            memory: config.memory(),
            score: sight.score,
            position: sight.position,
            light_on: sight.light_on,
            carrying_food: sight.carrying_food,
            messages: &sight.messages,
            history: sight.history.iter().rev().collect(),
            views: now.chain(past).map(view).collect(),
            actions: (Action::of_task(config.task()).iter())
                .map(|&action| ActionContext {
                    name: action.name(),
                    meaning: tasks::meaning(action),
                })
                .collect(),
            height: cells.map_or(0, Vec::len),
            width: cells.and_then(|rows| rows.first()).map_or(0, Vec::len),
            centralized,
            commander: centralized && sight.agent == AgentId::COMMANDER.to_string(),
        }
    }
}

/// Cells as a table with the numbers of rows and columns at its edges.
fn table(origin: Position, cells: &[Vec<Cell>]) -> String {
    use std::fmt::Write;
    const WIDTH: usize = 5;
    let width = cells.first().map_or(0, Vec::len);
    let mut text = String::with_capacity(WIDTH * (width + 1) * (cells.len() + 1));
    text.push_str("     ");
    let write = |text: &mut String, what: &dyn std::fmt::Display| {
        let end = text.len() + WIDTH;
        write!(text, "{what}").expect("a string takes everything");
        while text.len() < end {
            text.push(' ');
        }
    };
    for (j, _) in (origin.j..).zip(0..width) {
        write(&mut text, &j);
    }
    for (i, row) in (origin.i..).zip(cells) {
        text.truncate(text.trim_end().len());
        text.push('\n');
        write(&mut text, &i);
        for cell in row {
            write(&mut text, &cell.0);
        }
    }
    text.truncate(text.trim_end().len());
    text
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use swarmbench_engine::{Act, Message, Settings, TaskName, World};

    use super::*;
    use swarmbench_protocol::status::Status;

    fn sight(settings: &Settings, rounds: u32, agent: u16) -> (Sight, Config) {
        let config = Config::check(settings).expect("valid settings");
        let mut world = World::new(Arc::new(config.clone()));
        for _ in 0..rounds {
            let act =
                |n| Act { message: Message::new(&format!("I am {n}")), ..Act::of(Action::Up) };
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
                rest = &rest[at
                    .unwrap_or_else(|| panic!("{section:?} is not where it belongs: {prompt}"))..];
            }
            for action in Action::of_task(task) {
                assert!(prompt.contains(&format!(". {}: ", action.name())), "{prompt}");
            }
            let light = task == TaskName::Synchronization;
            assert_eq!(prompt.contains("Your light is"), light, "{prompt}");
            assert_eq!(
                prompt.contains("You carry no food"),
                task == TaskName::Foraging,
                "{prompt}"
            );
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
        let settings = Settings {
            control: "centralized".to_owned(),
            ..Settings::standard(TaskName::Pursuit, 1)
        };
        let (mut sight, config) = sight(&settings, 1, 0);
        let prompt = render(BUILT_IN, &sight, &config).expect("it renders");
        assert!(prompt.contains("You are the commander"), "{prompt}");
        (sight.view, sight.position, sight.alive) = (None, None, false);
        sight.past_views.clear();
        let prompt = render(BUILT_IN, &sight, &config).expect("it renders");
        assert!(prompt.contains("no longer on the map"), "{prompt}");
    }

    #[test]
    fn the_built_in_template_passes_the_check_that_others_must_pass() {
        assert_eq!(check(BUILT_IN), Ok(()));
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
        let native = minijinja::Value::from(minijinja::value::Serde(Context::new(&sight, &config)));
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
            Settings {
                num_agents: 362,
                view_size: 51,
                memory: 1,
                width: 40,
                height: 40,
                ..standard
            },
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
        ] {
            let (loops, ends) =
                ("{% for a in views[0].cells %}".repeat(4), "{% endfor %}".repeat(4));
            let template = format!("{loops}{reads}{ends}");
            assert_eq!(check(&template), Ok(()), "{template}");
            let reads = render(&template, &sight, &config).expect_err(reads).to_string();
            assert!(reads.contains("reads more than 16777216 bytes"), "{template}: {reads}");
        }
    }

    /// The widest window that there is.
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
        // Each letter takes at least three: the next item, the text, the way back.
        let printed = text.bytes.len();
        assert!((10_000..=200_000 / 3).contains(&printed), "{printed} letters");
    }

    #[test]
    fn a_prompt_is_bounded_as_it_is_written() {
        let (sight, config) = sight(&widest(), 0, 0);
        let most = bytes_max(&sight);
        let template =
            |text: &str| format!("{{% for row in views[0].cells %}}{text}{{% endfor %}}");
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
}
