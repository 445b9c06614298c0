//! Observations as text for language models.
//!
//! A prompt is a template (minijinja) filled with what one seat may see. The built-in template has
//! the sections of the paper's Appendix "Prompt Design" in its order. An episode may bring its own;
//! it is not trusted, so it is checked when the episode is created and bounded when it runs:
//!
//! - it may print, branch and loop over what it is given, with a few filters, but make nothing that
//!   could grow: no assignments, no lists, no calls, no concatenation, nothing included;
//! - it runs for a bounded number of instructions, and its text is bounded.

pub mod tasks;

use std::io;

use minijinja::machinery::ast::{BinOpKind, CallArg, Expr, Stmt};
use minijinja::syntax::SyntaxConfig;
use minijinja::{Environment, Error, ErrorKind, UndefinedBehavior};
use serde::Serialize;
use swarmbench_engine::{Action, AgentId, Config, Control};

use crate::wire::Position;
use crate::wire::observation::{Cell, HistoryEntry, Sight};

/// The built-in template.
pub const BUILT_IN: &str = include_str!("prompt.txt.j2");

/// Bytes of a template.
pub const TEMPLATE_BYTES_MAX: usize = 32 * 1024;

/// Instructions that a template may run for.
const FUEL_MAX: u64 = 200_000;

/// Bytes that a prompt may have.
const PROMPT_BYTES_MAX: usize = 1024 * 1024;

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
/// What it may not do, or where it is not a template.
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

/// Fills a template with what one seat sees.
///
/// # Errors
/// Where the template fails on it or exceeds its bounds.
pub fn render(template: &str, sight: &Sight, config: &Config) -> Result<String, TemplateError> {
    let environment = environment();
    let template = environment.template_from_str(template)?;
    let mut text = Bounded(Vec::new());
    let context = minijinja::Value::from(minijinja::value::Serde(Context::new(sight, config)));
    template.render_captured_to(context, &mut text).map_err(|error| {
        if error.kind() == ErrorKind::WriteFailure {
            TemplateError(format!("the prompt has more than {PROMPT_BYTES_MAX} bytes"))
        } else {
            error.into()
        }
    })?;
    String::from_utf8(text.0).map_err(|error| TemplateError(error.to_string()))
}

fn environment() -> Environment<'static> {
    let mut environment = Environment::new();
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
struct Bounded(Vec<u8>);

impl io::Write for Bounded {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.0.len() + bytes.len() > PROMPT_BYTES_MAX {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
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

/// What a template is given: one seat's observation, and what is the same for all.
#[derive(Serialize)]
struct Context<'a> {
    agent: &'a str,
    task: &'a crate::wire::observation::Task,
    round: u32,
    max_round: u32,
    memory: usize,
    score: f64,
    position: Option<Position>,
    light_on: Option<bool>,
    carrying_food: Option<bool>,
    messages: &'a [String],
    /// The oldest first, as one reads.
    history: Vec<&'a HistoryEntry>,
    /// The current one first.
    views: Vec<ViewContext>,
    actions: Vec<ActionContext>,
    /// The size of a view.
    height: usize,
    width: usize,
    centralized: bool,
    commander: bool,
}

#[derive(Serialize)]
struct ViewContext {
    round: u32,
    /// How many rounds ago it was seen.
    ago: u32,
    /// `Now`, `1 step ago`, `2 steps ago` …
    label: String,
    origin: Position,
    cells: Vec<Vec<Cell>>,
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
        let view = |(round, origin, cells): (u32, Position, &Vec<Vec<Cell>>)| {
            let ago = sight.round - round;
            let label = match ago {
                0 => "Now".to_owned(),
                1 => "1 step ago".to_owned(),
                _ => format!("{ago} steps ago"),
            };
            ViewContext {
                round,
                ago,
                label,
                origin,
                cells: cells.clone(),
                text: table(origin, cells),
            }
        };
        let centralized = config.control() == Control::Centralized;
        let cells = sight.view.as_ref().map(|view| &view.cells);
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
    let mut text = " ".repeat(WIDTH);
    let width = cells.first().map_or(0, Vec::len);
    let write = |text: &mut String, what: &dyn std::fmt::Display| {
        write!(text, "{:<WIDTH$}", what.to_string()).expect("a string takes everything");
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
