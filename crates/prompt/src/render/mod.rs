//! Checks and renders templates.

mod depth;
mod table;
mod work;

use std::io;
use std::sync::Arc;

use minijinja::machinery::ast::{BinOpKind, CallArg, Expr, Stmt};
use minijinja::syntax::SyntaxConfig;
use minijinja::{Environment, Error, ErrorKind, Template, UndefinedBehavior};
use serde::Serialize;
use swarmbench_engine::{Action, AgentId, Config, Control};

pub use depth::{TEMPLATE_CHAIN_MAX, TEMPLATE_ELIF_MAX, TEMPLATE_NESTING_MAX, TEMPLATE_UNARY_MAX};
use work::{READ_BYTES_MAX, Work, count_filters, counted};

use swarmbench_protocol::Position;
use swarmbench_protocol::observation::{Cell, HistoryEntry, Sight};

use crate::{BUILT_IN, TOOLKIT, tasks};

/// Maximum size of a template, in bytes.
pub const TEMPLATE_BYTES_MAX: usize = 32 * 1024;

/// Maximum number of instructions of a template.
const FUEL_MAX: u64 = 200_000;

/// Maximum size of a prompt, in bytes: many times the built-in prompt in the standard setting.
pub const PROMPT_BYTES_MAX: usize = 128 * 1024;

/// Additional bytes of a prompt for each cell that the seat sees or remembers: the built-in prompt needs 5.
pub const PROMPT_BYTES_PER_CELL_MAX: usize = 8;

/// Maximum ratio of a prompt's bytes as JSON to its bytes as text: in JSON quotes and line breaks take two, other
/// control characters six.
pub const PROMPT_JSON_FACTOR_MAX: usize = 2;

/// Maximum size of a text in an expression, in bytes. Text outside of expressions may be as long as the template.
const CONSTANT_BYTES_MAX: usize = 1024;

/// Filters that a template may use; none of them can make a value larger than its parts.
const FILTERS: [&str; 9] =
    ["length", "upper", "lower", "trim", "first", "last", "default", "round", "int"];

/// Tests that a template may use.
const TESTS: [&str; 9] =
    ["defined", "undefined", "none", "true", "false", "even", "odd", "eq", "ne"];

/// The error of a template that fails when it is checked or when it runs.
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

/// Checks a template of a new episode.
///
/// # Errors
/// A syntax error, or a statement or expression that is not allowed.
pub fn check(template: &str) -> Result<(), TemplateError> {
    Language { constant_bytes_max: CONSTANT_BYTES_MAX }.check(template)
}

/// Renders a template with the observation of one seat.
///
/// # Errors
/// [`TemplateError`] if the template fails or exceeds its bounds.
pub fn render(template: &str, sight: &Sight, config: &Config) -> Result<String, TemplateError> {
    let mut text = Bounded::new(bytes_max(sight));
    fill(template, sight, config, &mut text)?;
    String::from_utf8(text.bytes).map_err(|error| TemplateError(error.to_string()))
}

/// Renders a template into `text` until it ends or fails.
fn fill(
    text_of_template: &str,
    sight: &Sight,
    config: &Config,
    text: &mut Bounded,
) -> Result<(), TemplateError> {
    let work = Work::new();
    let environment = environment(&work);
    let template = compiled(text_of_template, &environment)?;
    let context = Context::new(sight, config, text_of_template.contains("padded"));
    let context = minijinja::Value::from(minijinja::value::Serde(context));
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

/// Compiles a template after a check, because its text may come from a database or from anybody's journal. No other
/// code compiles templates. Texts in expressions may be long here, because older templates had no limit.
fn compiled<'a>(
    template: &'a str,
    environment: &'a Environment<'_>,
) -> Result<Template<'a, 'a>, TemplateError> {
    if ![BUILT_IN, TOOLKIT].contains(&template) {
        Language { constant_bytes_max: usize::MAX }.check(template)?;
    }
    Ok(environment.template_from_str(template)?)
}

/// The limit of a prompt's bytes, by the size of the observation.
fn bytes_max(sight: &Sight) -> usize {
    let cells = |rows: &Vec<Vec<Cell>>| rows.iter().map(Vec::len).sum::<usize>();
    let now: usize = sight.view.iter().map(|view| cells(&view.cells)).sum();
    let past: usize = sight.past_views.iter().map(|past| cells(&past.cells)).sum();
    // Each message takes a line, with the text around it.
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

/// The syntax of templates: tags on lines of their own leave no empty lines behind.
fn syntax() -> SyntaxConfig {
    let built = SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build();
    built.expect("the delimiters are the usual ones")
}

/// Text of a bounded length.
struct Bounded {
    bytes: Vec<u8>,
    most: usize,
    /// The size of the text as JSON, in bytes.
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

/// Number of bytes that one byte of a text takes in JSON.
const fn json_bytes(byte: u8) -> usize {
    match byte {
        b'"' | b'\\' | b'\n' | b'\r' | b'\t' | 0x08 | 0x0c => 2,
        0..0x20 => 6,
        _ => 1,
    }
}

const REFUSED_STATEMENTS: &str =
    "set, with, macro, filter, include and other statements beyond for and if";

fn refuse<T>(what: &str) -> Result<T, TemplateError> {
    Err(TemplateError(format!(
        "{what} may not be used: a prompt template prints, branches and loops over what it is given"
    )))
}

/// The language of templates.
#[derive(Clone, Copy)]
struct Language {
    constant_bytes_max: usize,
}

impl Language {
    fn check(self, template: &str) -> Result<(), TemplateError> {
        if template.len() > TEMPLATE_BYTES_MAX {
            let is = template.len();
            return Err(TemplateError(format!(
                "must have at most {TEMPLATE_BYTES_MAX} bytes, has {is}"
            )));
        }
        depth::check(template)?;
        self.statement(&minijinja::machinery::parse(template, "prompt", syntax())?)
    }

    fn statement(self, statement: &Stmt<'_>) -> Result<(), TemplateError> {
        let all =
            |statements: &[Stmt<'_>]| statements.iter().try_for_each(|each| self.statement(each));
        match statement {
            Stmt::Template(template) => all(&template.children),
            Stmt::EmitRaw(_) => Ok(()),
            Stmt::EmitExpr(emit) => self.expression(&emit.expr),
            Stmt::ForLoop(each) => {
                if each.recursive {
                    return refuse("recursive loops");
                }
                self.expression(&each.iter)?;
                each.filter_expr.as_ref().map_or(Ok(()), |each| self.expression(each))?;
                all(&each.body)?;
                all(&each.else_body)
            }
            Stmt::IfCond(branch) => {
                self.expression(&branch.expr)?;
                all(&branch.true_body)?;
                all(&branch.false_body)
            }
            _ => refuse(REFUSED_STATEMENTS),
        }
    }

    fn expression(self, expression: &Expr<'_>) -> Result<(), TemplateError> {
        let argument = |argument: &CallArg<'_>| match argument {
            CallArg::Pos(value) => self.expression(value),
            _ => refuse("named and spread arguments"),
        };
        match expression {
            Expr::Const(text)
                if text.value.as_str().is_some_and(|text| text.len() > self.constant_bytes_max) =>
            {
                let most = self.constant_bytes_max;
                refuse(&format!("a text of more than {most} bytes in an expression"))
            }
            Expr::Var(_) | Expr::Const(_) => Ok(()),
            Expr::UnaryOp(operation) => self.expression(&operation.expr),
            Expr::BinOp(operation) => {
                match operation.op {
                    BinOpKind::Mul | BinOpKind::Pow | BinOpKind::Concat | BinOpKind::Add => {
                        return refuse("the operators ~ + * and **");
                    }
                    _ => {}
                }
                self.expression(&operation.left)?;
                self.expression(&operation.right)
            }
            Expr::Compare(compare) => {
                self.expression(&compare.expr)?;
                compare.ops.iter().try_for_each(|op| self.expression(&op.expr))
            }
            Expr::IfExpr(branch) => {
                self.expression(&branch.test_expr)?;
                self.expression(&branch.true_expr)?;
                branch.false_expr.as_ref().map_or(Ok(()), |each| self.expression(each))
            }
            Expr::Filter(filter) => {
                if !FILTERS.contains(&filter.name) {
                    return refuse(&format!("the filter {}", filter.name));
                }
                filter.expr.as_ref().map_or(Ok(()), |each| self.expression(each))?;
                filter.args.iter().try_for_each(argument)
            }
            Expr::Test(test) => {
                if !TESTS.contains(&test.name) {
                    return refuse(&format!("the test {}", test.name));
                }
                self.expression(&test.expr)?;
                test.args.iter().try_for_each(argument)
            }
            Expr::GetAttr(access) => self.expression(&access.expr),
            Expr::GetItem(access) => {
                self.expression(&access.expr)?;
                self.expression(&access.subscript_expr)
            }
            _ => refuse("calls, lists, maps and slices"),
        }
    }
}

/// The input of a template: one seat's observation, and the settings of the episode.
#[derive(Serialize)]
struct Context<'a> {
    agent: &'a str,
    task: &'a swarmbench_protocol::observation::Task,
    rules: &'static str,
    num_agents: u16,
    round: u32,
    round_from_1: u32,
    max_round: u32,
    memory: usize,
    score: f64,
    position: Option<Position>,
    light_on: Option<bool>,
    carrying_food: Option<bool>,
    messages: &'a [String],
    /// The history, oldest entry first.
    history: Vec<HistoryContext<'a>>,
    /// The views, current one first.
    views: Vec<ViewContext<'a>>,
    actions: Vec<ActionContext>,
    /// Rows of a view.
    height: usize,
    width: usize,
    centralized: bool,
    commander: bool,
    /// Rows of `A`, an agent, and `.`; empty in all tasks but Flocking.
    target: Vec<Vec<&'static str>>,
}

#[derive(Serialize)]
struct HistoryContext<'a> {
    #[serde(flatten)]
    entry: &'a HistoryEntry,
    round_from_1: u32,
}

#[derive(Serialize)]
struct ViewContext<'a> {
    round: u32,
    /// Age of the view in rounds.
    ago: u32,
    /// `Now`, `1 step ago`, `2 steps ago` …
    label: String,
    origin: Position,
    cells: &'a [Vec<Cell>],
    /// A table with the numbers of rows and columns at its edges.
    text: String,
    /// The table in the form of the public toolkit; only drawn for templates that name it.
    #[serde(skip_serializing_if = "Option::is_none")]
    padded: Option<String>,
}

#[derive(Serialize)]
struct ActionContext {
    name: &'static str,
    meaning: &'static str,
}

impl<'a> Context<'a> {
    fn new(sight: &'a Sight, config: &Config, has_padded: bool) -> Self {
        let now = sight.view.iter().map(|view| (sight.round, view.origin, &view.cells));
        let past = sight.past_views.iter().map(|past| (past.round, past.origin, &past.cells));
        let view = |(round, origin, cells): (u32, Position, &'a Vec<Vec<Cell>>)| {
            let ago = sight.round - round;
            let label = match ago {
                0 => "Now".to_owned(),
                1 => "1 step ago".to_owned(),
                _ => format!("{ago} steps ago"),
            };
            let padded = has_padded.then(|| table::padded(origin, cells));
            let text = table::plain(origin, cells);
            ViewContext { round, ago, label, origin, cells, text, padded }
        };
        let centralized = config.control() == Control::Centralized;
        let current = sight.view.as_ref().map(|view| &view.cells);
        let cells = current.or(sight.past_views.first().map(|past| &past.cells));
        Self {
            agent: &sight.agent,
            task: &sight.task,
            rules: config.rules().name(),
            num_agents: config.num_agents(),
            round: sight.round,
            round_from_1: sight.round + 1,
            max_round: sight.max_round,
            memory: config.memory(),
            score: sight.score,
            position: sight.position,
            light_on: sight.light_on,
            carrying_food: sight.carrying_food,
            messages: &sight.messages,
            history: (sight.history.iter().rev())
                .map(|entry| HistoryContext { entry, round_from_1: entry.round + 1 })
                .collect(),
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
            target: tasks::target(config),
        }
    }
}

#[cfg(test)]
mod tests;
